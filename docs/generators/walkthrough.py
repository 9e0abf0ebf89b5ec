"""Play the walkthrough: run its commands, and put what they print and draw into its pages.

A block of commands looks like a terminal. `$ ` begins a command, a line `…` stands for lines that
are left out, and what is shown around it stays where it was:

    $ drop analyze recordings/run.rrd
    cube_small.urdf dropped from 1.0000 m, timestep 1/240 s, damping default
    …
    Rest        0.0250 m: the position is the body's centre, not its underside
    …

All pages have the same blocks and pictures. A picture is the file of its name that a command made.
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence

DOCS = Path(__file__).parents[1]
PAGES = (DOCS / "walkthrough.md", DOCS / "walkthrough.ja.md")
CUT = "…"
TILE_PX = 32
ALIKE = 12.0
"""Pictures are compared by the mean grey of square tiles, of 255. Another font moves that by
less, a bounce that is a tenth lower by 20."""

_BLOCK = re.compile(r"^```console\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_PICTURE = re.compile(r"(?:(?<=\]\()|(?<=srcset=\")|(?<=src=\"))images/[^)\"]+")
_VARIES = re.compile(r"[\d.,]+ kB, [\d.]+ s$")
"""How large a recording became, and how long it took."""


def made() -> dict[Path, bytes]:
    """Return the pages and pictures as the program makes them now."""
    texts = {page: page.read_text(encoding="utf-8") for page in PAGES}
    first = texts[PAGES[0]]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        played = [_played(block, folder) for block in blocks(first)]
        drawn = {DOCS / one: _small(_found(folder, Path(one).name)) for one in pictures(first)}
    return {page: _filled(text, played).encode() for page, text in texts.items()} | drawn


def blocks(page: str) -> list[str]:
    """Return the blocks of commands in a page."""
    return _BLOCK.findall(page)


def pictures(page: str) -> list[str]:
    """Return the pictures in a page, relative to it."""
    return _PICTURE.findall(page)


def _filled(page: str, played: list[str]) -> str:
    following = iter(played)
    return _BLOCK.sub(lambda _: f"```console\n{next(following, '')}```", page)


# -- commands -------------------------------------------------------------------------------------


def _played(block: str, folder: Path) -> str:
    """Return a block with what its commands print now."""
    lines = []
    for command, shown in _commands(block):
        lines += [*f"$ {command}".splitlines(), *cut_alike(shown, _printed(command, folder))]
    return "".join(f"{line}\n" for line in lines)


def _commands(block: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the commands of a block, each with the lines that it is shown to print."""
    for one in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        lines = one.splitlines()
        end = next(number for number, line in enumerate(lines) if not line.endswith("\\")) + 1
        yield "\n".join(lines[:end]), lines[end:]


def _printed(command: str, folder: Path) -> list[str]:
    """Return what a command prints on a terminal of 80 columns."""
    done = subprocess.run(
        ["bash", "-c", f'drop() {{ "$PYTHON" -m cli "$@"; }}\n{command}'],
        cwd=folder,
        env={**os.environ, "PYTHON": sys.executable, "PYTHONPATH": str(DOCS.parent),
             "COLUMNS": "80"},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120, check=False,
    )  # fmt: skip
    return done.stdout.splitlines()


# -- what is shown of it --------------------------------------------------------------------------


def cut_alike(shown: list[str], printed: list[str]) -> list[str]:
    """Return what is printed, cut where it was cut before."""
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
    """Return where a piece is found from some line on; its numbers may have changed."""

    def likeness(start: int) -> float:
        pairs = zip(piece, printed[start:], strict=False)
        return sum(1.0 if a == b else SequenceMatcher(None, a, b).ratio() for a, b in pairs)

    return max(range(begin, max(len(printed) - len(piece), begin) + 1), key=likeness)


def _refreshed(shown: list[str], printed: list[str]) -> list[str]:
    """Return what is printed, but lines as they were shown where only what varies is another."""
    known = {_VARIES.sub("", line): line for line in shown}
    return [known.get(_VARIES.sub("", line), line) for line in printed]


# -- pictures -------------------------------------------------------------------------------------


def _found(folder: Path, name: str) -> Path:
    (path,) = folder.rglob(name)
    return path


def _small(path: Path) -> bytes:
    """Return a picture in few bytes; a gif is small already."""
    if path.suffix != ".png":
        return path.read_bytes()
    stream = io.BytesIO()
    picture = Image.open(path).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    picture.save(stream, "png", optimize=True)
    return stream.getvalue()


def alike(one: bytes, other: bytes) -> bool:
    """Whether two pictures look the same."""
    mine, theirs = _tiles(one), _tiles(other)
    return mine.shape == theirs.shape and bool((np.abs(mine - theirs) <= ALIKE).all())


def _tiles(picture: bytes) -> NDArray[np.float32]:
    """Return the mean grey of the tiles of each frame, shape (frames, rows, columns)."""
    frames = ImageSequence.Iterator(Image.open(io.BytesIO(picture)))
    small = [frame.convert("RGB").convert("L").reduce(TILE_PX) for frame in frames]
    return np.stack([np.asarray(frame, dtype=np.float32) for frame in small])
