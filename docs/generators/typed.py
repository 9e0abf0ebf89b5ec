"""Run the commands of a page in a folder, and return their output, 80 columns wide.

A plain `drop …` runs in this process, because starting a process takes longer than most commands;
anything else runs in bash. A result of `drop` is printed in as many languages as are asked for;
what runs in bash runs again in each. `INSTEAD` and `PROGRAMS` replace what a test cannot run; what
they leave out is checked in `tests/test_docs.py`.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from unittest.mock import patch

from drop_physics import cli
from drop_physics.console import output, progress
from typer.testing import CliRunner

with contextlib.suppress(ModuleNotFoundError):
    # Before anything else imports PyBullet: its banner, which comes once, has the build time.
    import drop_physics.engines.pybullet.engine  # noqa: F401

ROOT = Path(__file__).parents[2]
os.environ["DROP_LANG"] = "en"  # what pages show does not depend on who makes them
ENGLISH = ("en",)

PROGRAMS = {
    "pip": (":", "installs; the extras it names are checked"),
    "conda": (":", "creates an environment, and enters it"),
    "pytest": (":", "runs these tests; the files and tests it names are checked"),
    "python3.11": (":", "creates an environment"),
    "sphinx-build": (":", "builds the site: tests/test_site.py does"),
    "source": (":", "activates it"),
    "rerun": ("ls", "opens a window; its files must exist"),
    "ssh": (":", "needs another machine"),
}
"""Programs that are replaced in tests, each with its substitute and the reason."""

INSTEAD = (
    (r"^git clone \S+ drop && cd drop\b", ":", "is where the tests are"),
    (r"^drop view\b", "ls", "opens a window; its files must exist"),
    (r" --spawn\b| --connect \S+", "", "opens a window: tests/test_viewer.py does"),
    (r" --ray \S+", "", "needs a cluster: tests/test_sweep.py starts one"),
    (r"^/usr/bin/time (-v|-f \".*?\") ", "", "is GNU's, not available everywhere"),
    (r"^drop run\b(?!.*--no-camera)", "drop run --no-camera", "frames take time"),
    (r"^drop simulate\b(?!.*--no-camera)", "drop simulate --size 96x72", "frames take time"),
    (r"--samples \d+", "--samples 5", "takes minutes"),
    (r"--duration \d{4}\S+", "--duration 1", "takes half a minute"),
    (r"^(python -m benchmarks.*?)( *#.*)?$", r"\1 --help", "takes minutes"),
    (r"^python -m build$", ":", "builds a wheel: .ci/run does"),
    (r"\$\{\{ vars\.PYBULLET \}\}", "3", "is a variable of GitHub's"),
)
"""Replacements by pattern, with the reason; applied only where no output is quoted."""


@contextlib.contextmanager
def in_language(code: str) -> Iterator[None]:
    """Set the program's output language within a `with` block."""
    before = os.environ["DROP_LANG"]
    os.environ["DROP_LANG"] = code
    try:
        yield
    finally:
        os.environ["DROP_LANG"] = before


def possible(command: str) -> str:
    """Return a command in a form that a test can run."""
    for pattern, instead, _ in INSTEAD:
        command = re.sub(pattern, instead, command, flags=re.MULTILINE)
    return command


_CODE = ' || echo "exit code $?"'
_LOOP = re.compile(r"for (\w+) in (.*?); do\n(.*)\ndone", re.DOTALL)


def run_command(command: str, folder: Path) -> tuple[int, str]:
    """Return a command's exit code and output; a shell loop stops at its first failing command."""
    code, (printed,) = run_in(ENGLISH, command, folder)
    return code, printed


def run_in(languages: Sequence[str], command: str, folder: Path) -> tuple[int, list[str]]:
    """Return a command's exit code, and its output in each language."""
    if " && " in command and "\n" not in command:
        parts = [run_in(languages, possible(part), folder) for part in command.split(" && ")]
        return max(code for code, _ in parts), _one_after_the_other(parts)
    if command.endswith(_CODE):
        code, printed = run_in(languages, command.removesuffix(_CODE), folder)
        return 0, [text + f"exit code {code}\n" * bool(code) for text in printed]
    if loop := _LOOP.fullmatch(command):
        name, values, body = loop.groups()
        parts = []
        for value in shlex.split(values.replace("\\\n", " ")):
            for line in body.replace("\\\n", " ").splitlines():
                if not any(code for code, _ in parts):
                    parts.append(run_in(languages, re.sub(rf"\${name}\b", value, line), folder))
        return max(code for code, _ in parts), _one_after_the_other(parts)
    words = _plain(command)
    if words[:1] == ["drop"]:
        return _by_drop(languages, words[1:], folder)
    return _in_each(languages, partial(_in_bash, command), folder)


def run_python(code: str, folder: Path, languages: Sequence[str] = ENGLISH) -> list[str]:
    """Run a Python program, and return its output in each language; its exceptions propagate."""

    def run(folder: Path) -> tuple[int, str]:
        with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(code, "a page", "exec"), {})
        return 0, printed.getvalue()

    return _in_each(languages, run, folder)[1]


def _one_after_the_other(parts: Sequence[tuple[int, list[str]]]) -> list[str]:
    return ["".join(texts) for texts in zip(*(printed for _, printed in parts), strict=True)]


def _in_each(
    languages: Sequence[str], run: Callable[[Path], tuple[int, str]], folder: Path
) -> tuple[int, list[str]]:
    """Run in one language after the other, each time in the same folder as it was before."""
    first, *others = languages
    printed = []
    for language in others:
        with in_language(language), _kept(folder):
            printed.append(run(folder)[1])
    with in_language(first):
        code, text = run(folder)
    return code, [text, *printed]


@contextlib.contextmanager
def _kept(folder: Path) -> Iterator[None]:
    """Restore a folder's contents afterwards."""
    with tempfile.TemporaryDirectory() as name:
        before = shutil.copytree(folder, Path(name, "before"), symlinks=True)
        yield
        shutil.rmtree(folder)
        shutil.move(before, folder)


def _by_drop(
    languages: Sequence[str], arguments: Sequence[str], folder: Path
) -> tuple[int, list[str]]:
    """Run a command of `drop` once, and print its result and its notes in each language.

    Raises
    ------
    RuntimeError
        If the command prints other text, which may have a translation.
    """
    printed = [io.StringIO() for _ in languages]
    prints = partial(_in_all, [*zip(languages, printed, strict=True)] if len(printed) > 1 else [])
    with (
        contextlib.chdir(folder),
        patch.object(cli, "_show", prints(cli._show)),
        patch.object(output, "print_json", prints(output.print_json)),
        patch.object(output, "note", prints(output.note)),
        patch.object(progress, "note", prints(output.note)),
    ):
        done = CliRunner(env={"COLUMNS": "80", "FORCE_COLOR": None}).invoke(cli.app, arguments)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        return 1, [f"{done.output}drop: {done.exception}" for _ in languages]
    if len(languages) > 1 and done.output != printed[0].getvalue():
        raise RuntimeError(f"drop {shlex.join(arguments)} prints more than results: {done.output}")
    return done.exit_code, [done.output, *(each.getvalue() for each in printed[1:])]


def _in_all(
    printed: Sequence[tuple[str, io.StringIO]], prints: Callable[..., object]
) -> Callable[..., object]:
    """Return a function that prints in each language as well, into a stream for each."""

    def print_all(*values: object, **how: object) -> object:
        for language, stream in printed:
            there = {"stream": stream} if "stream" in how else {}
            with (
                in_language(language),
                contextlib.redirect_stdout(stream),
                contextlib.redirect_stderr(stream),
            ):
                prints(*values, **how | there)
        return prints(*values, **how)

    return print_all


def _plain(command: str) -> list[str]:
    """Split a command into its arguments; return None if it needs a shell."""
    line = command.replace("\\\n", " ")
    return [] if re.search(r"[$`;<>|&\n]", line) else shlex.split(line, comments=True)


def _in_bash(command: str, folder: Path) -> tuple[int, str]:
    programs = {"drop": '"$PYTHON" -m drop_physics', "python": '"$PYTHON"'}
    programs |= {name: instead for name, (instead, _) in PROGRAMS.items()}
    head = "".join(f'{name}() {{ {instead} "$@"; }}\n' for name, instead in programs.items())
    done = subprocess.run(
        ["bash", "-euc", head + command],
        cwd=folder,
        env={
            **os.environ,
            "PYTHON": sys.executable,
            "PYTHONPATH": str(ROOT),
            "COLUMNS": "80",
            "ROOT": str(ROOT),
        },
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=600,
        check=False,
    )
    return done.returncode, done.stdout
