"""Update the pages: run their commands, and insert the output and the images.

Each page is played from top to bottom, in its own folder, which is otherwise like a clone. The kind
of a block says how:

    sh         commands, each of which must succeed, or end in `|| echo …`
    console    the same, each after `$ ` and followed by its output; it may end with 3, an answer
    python     a program
    text       the output of the block before it
    yaml       a workflow, whose `run:` steps are commands
    mermaid    a picture, nothing to run; the same for a block of no kind

In quoted output, a line `…` stands for omitted lines; the excerpts around it stay the same ones:

    $ drop analyze recordings/run.rrd
    cube_small.urdf dropped from 1.0000 m, timestep 1/240 s, damping default
    …
    Rest        0.0250 m: the position is the body's centre, not its underside
    …

A translation says to type what its page does, and shows what the program prints in its language.
A picture in one of the pages `DRAWN` is the file of that name written by a command.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path

from generators.pictures import small
from generators.typed import ENGLISH, ROOT, possible, run_in, run_python

DOCS = ROOT / "docs"
WALKTHROUGH = DOCS / "walkthrough.md"
PIPELINE = DOCS / "pipeline.md"
DRAWN = (WALKTHROUGH, PIPELINE)
"""Pages whose images are drawn by their own commands."""
LANGUAGES = (*ENGLISH, "ja")
"""Languages of a page and of its translation."""
REFERENCES = {"commands.md", "recording.md"}
"""Pages that the other generators write from the code."""
CUT = "…"

_BODY = """<robot name="bracket"><link name="bracket">
  <inertial><mass value="0.5"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
  </inertial><collision><geometry><box size="0.04 0.04 0.04"/></geometry></collision>
</link></robot>"""

_SCRIPT = """import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
cube = p.loadURDF("cube_small.urdf", [0, 0, 0.5])
for _ in range(240):
    p.stepSimulation()
"""

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_PICTURE = re.compile(r"(?:(?<=\]\()|(?<=srcset=\")|(?<=src=\"))images/[^)\"]+")
_VARIES = re.compile(r"[\d.,]+ [kM]B(?:, |、)[\d.]+ s$| +[\d.]+ µs$")
"""Output that varies by run: size of a recording and time to make it; time per engine step."""


class PageError(Exception):
    """A command on a page does not work."""


@dataclass(frozen=True)
class Block:
    """A code block of a page."""

    kind: str
    text: str

    @property
    def quotes(self) -> bool:
        """Whether the block shows output."""
        return self.kind in ("console", "text")


def pages() -> list[Path]:
    """Return all pages except translations and references."""
    paths = [path for folder in (ROOT, DOCS, ROOT / "recordings") for path in folder.glob("*.md")]
    return sorted(path for path in paths if path.name not in REFERENCES and ".ja." not in path.name)


def translations(page: Path) -> list[Path]:
    """Return the translations of a page."""
    return [path for path in [page.with_suffix(".ja.md")] if path.exists()]


def blocks(text: str) -> list[Block]:
    """Return the code blocks in a page's text."""
    return [Block(*groups) for groups in _BLOCK.findall(text)]


def typed(block: Block) -> str:
    """Return the input that a block tells readers to type, without the output that it shows."""
    if block.kind == "console":
        return "".join(f"{command}\n" for command, _ in _typed(block.text))
    return "" if block.quotes else block.text


def pictures(text: str) -> list[str]:
    """Return the paths of the images in a page's text, relative to the page."""
    return _PICTURE.findall(text)


def played(page: Path) -> dict[Path, bytes]:
    """Return a page, its translations and its images, updated with the program's current output.

    Raises
    ------
    PageError
        If a command fails.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in [page, *translations(page)]}
    with _clone() as folder:
        quoted = _quoted({path: blocks(text) for path, text in texts.items()}, folder)
        made = {path: _filled(text, quoted[path]).encode() for path, text in texts.items()}
        for picture in pictures(texts[page]) if page in DRAWN else []:
            made[DOCS / picture] = small(_found(folder, Path(picture).name))
    return made


@contextmanager
def _clone() -> Iterator[Path]:
    """Yield a temporary folder with the files that the pages' commands expect in a clone."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "recordings/golden", folder / "recordings/golden")
        shutil.copytree(DOCS / "examples", folder / "docs/examples")
        (folder / "models").mkdir()
        (folder / "models/bracket.urdf").write_text(_BODY)
        (folder / "sim.py").write_text(_SCRIPT)
        yield folder


def _filled(text: str, quoted: list[str]) -> str:
    """Return a page's text with its output blocks replaced by the current output."""
    following = iter(quoted)

    def fill(match: re.Match[str]) -> str:
        block = Block(*match.groups())
        return f"```{block.kind}\n{next(following, '')}```" if block.quotes else match[0]

    return _BLOCK.sub(fill, text)


def _found(folder: Path, name: str) -> Path:
    (path,) = folder.rglob(name)
    return path


# -- what is typed --------------------------------------------------------------------------------


def _quoted(versions: dict[Path, list[Block]], folder: Path) -> dict[Path, list[str]]:
    """Run the blocks of a page, and return the current text of those that show output.

    All versions, the page itself first, type the same, which is run once for all of them.
    """
    page = next(iter(versions))
    quoted: dict[Path, list[str]] = {path: [] for path in versions}
    printed = ["" for _ in versions]
    kinds = [block.kind for block in versions[page]]
    for number, (kind, after) in enumerate(pairwise([*kinds, ""])):
        is_quoted = "text" in (kind, after) or kind == "console"
        of_all = [blocks[number] for blocks in versions.values()][: None if is_quoted else 1]
        try:
            lines, printed = _run(of_all, folder, printed)
        except PageError as error:
            raise PageError(f"{page.name}: {error}") from None
        for path, shown in zip(versions, lines, strict=False):
            quoted[path].append("".join(f"{line}\n" for line in shown))
    return quoted


def _run(
    versions: list[Block], folder: Path, printed: list[str]
) -> tuple[list[list[str]], list[str]]:
    """Run a block in the languages of its versions.

    Returns
    -------
    The lines to show in each version, none if the block shows no output, and the last command's
    whole output in each language.
    """
    block, languages = versions[0], LANGUAGES[: len(versions)]
    lines: list[list[str]] = []
    match block.kind:
        case "sh":
            texts = [_printed(command, languages, folder) for command in commands(block.text)]
            printed = ["".join(parts) for parts in zip(*texts, strict=True)]
        case "yaml":
            for command in re.findall(r"^ +- run: (.*)$", block.text, re.MULTILINE):
                _printed(command, languages, folder)
        case "python":
            printed = run_python(block.text, folder, languages)
        case "text":
            lines = [
                cut_alike(version.text.splitlines(), text.splitlines())
                for version, text in zip(versions, printed, strict=True)
            ]
        case "console":
            lines = [[] for _ in versions]
            for typed in zip(*(_typed(version.text) for version in versions), strict=True):
                printed = _printed(typed[0][0], languages, folder, exactly=True)
                for kept, (command, shown), text in zip(lines, typed, printed, strict=True):
                    kept += [*f"$ {command}".splitlines(), *cut_alike(shown, text.splitlines())]
        case "mermaid" | "toml" | "":
            pass
        case kind:
            raise PageError(f"a block cannot be of kind {kind!r}")
    return lines, printed


def commands(text: str) -> list[str]:
    """Split a block into commands: a script, or lines that belong together, are one command."""
    if text.startswith("#!"):
        return [text]
    joined = [""]
    for line in text.splitlines():
        if joined[-1].endswith("\\\n") or line.startswith((" ", "done")):
            joined[-1] += f"{line}\n"
        else:
            joined.append(f"{line}\n")
    return [command.removesuffix("\n") for command in joined if command.strip()]


def _typed(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the commands after `$ `, each with the output shown for it."""
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        lines = part.splitlines()
        end = next(number for number, line in enumerate(lines) if not line.endswith("\\")) + 1
        yield "\n".join(lines[:end]), lines[end:]


def _printed(
    command: str, languages: Sequence[str], folder: Path, *, exactly: bool = False
) -> list[str]:
    """Return a command's output in each language.

    Exit code 3 is an answer: an expectation does not hold, two runs differ. Its output is quoted.
    """
    code, printed = run_in(languages, command if exactly else possible(command), folder)
    if code not in ((0, 3) if exactly else (0,)):
        raise PageError(f"`{command}` exits with {code}: {printed[0]}")
    return printed


# -- what is shown of it --------------------------------------------------------------------------


def cut_alike(shown: list[str], printed: list[str]) -> list[str]:
    """Return the printed output, abridged at the same points as the output that a page shows."""
    first, *others = _pieces(shown)
    kept = _refreshed(first, printed[: len(first)] if others else printed)
    at = len(first)
    for number, piece in enumerate(others, start=1):
        last = len(printed) - len(piece)
        start = max(last, at) if number == len(others) else _most_alike(piece, printed, at)
        at = start + len(piece)
        kept += [CUT, *_refreshed(piece, printed[start:at])]
    return kept


def _pieces(shown: list[str]) -> list[list[str]]:
    pieces: list[list[str]] = [[]]
    for line in shown:
        if line == CUT:
            pieces.append([])
        else:
            pieces[-1].append(line)
    return pieces


def _most_alike(piece: list[str], printed: list[str], begin: int) -> int:
    """Return the index at which an excerpt matches the output best, as numbers may have changed."""

    def likeness(start: int) -> float:
        pairs = zip(piece, printed[start:], strict=False)
        return sum(1.0 if a == b else SequenceMatcher(None, a, b).ratio() for a, b in pairs)

    return max(range(begin, max(len(printed) - len(piece), begin) + 1), key=likeness)


def _refreshed(shown: list[str], printed: list[str]) -> list[str]:
    """Return the printed output, but keep shown lines that differ only in values varying by run."""
    known = {_VARIES.sub("", line): line for line in shown}
    return [known.get(_VARIES.sub("", line), line) for line in printed]
