"""Run the commands of a page in a folder, and return their output, 80 columns wide.

A plain `drop …` runs in this process, because starting a process takes longer than most commands;
anything else runs in bash. `INSTEAD` and `PROGRAMS` replace what a test cannot run; what they leave
out is checked in `tests/test_docs.py`.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from drop_physics.cli import app
from typer.testing import CliRunner

with contextlib.suppress(ModuleNotFoundError):
    # Before anything else imports PyBullet: its banner, which comes once, has the build time.
    import drop_physics.engines.pybullet.engine  # noqa: F401

ROOT = Path(__file__).parents[2]
os.environ["DROP_LANG"] = "en"  # what pages show does not depend on who makes them

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
    if " && " in command and "\n" not in command:
        parts = [run_command(possible(part), folder) for part in command.split(" && ")]
        return max(code for code, _ in parts), "".join(printed for _, printed in parts)
    if command.endswith(_CODE):
        code, printed = run_command(command.removesuffix(_CODE), folder)
        return 0, printed + f"exit code {code}\n" * bool(code)
    if loop := _LOOP.fullmatch(command):
        name, values, body = loop.groups()
        code, printed = 0, ""
        for value in shlex.split(values.replace("\\\n", " ")):
            for line in body.replace("\\\n", " ").splitlines():
                if not code:
                    code, more = run_command(re.sub(rf"\${name}\b", value, line), folder)
                    printed += more
        return code, printed
    words = _plain(command)
    if words[:1] != ["drop"]:
        return _in_bash(command, folder)
    with contextlib.chdir(folder):
        done = CliRunner(env={"COLUMNS": "80", "FORCE_COLOR": None}).invoke(app, words[1:])
    if done.exception is None or isinstance(done.exception, SystemExit):
        return done.exit_code, done.output
    return 1, f"{done.output}drop: {done.exception}"


def run_python(code: str, folder: Path) -> tuple[int, str]:
    """Run a Python program, and return 0 and its output; its exceptions propagate."""
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(code, "a page", "exec"), {})
    return 0, printed.getvalue()


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
