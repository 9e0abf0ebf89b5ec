"""Finds the Python interpreter for a script: the user's, even if `drop` is installed elsewhere.

As with `uv run`, this is the interpreter of an active virtual environment; otherwise of a `.venv`
in the script's folder or above; otherwise the one that runs `drop`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from drop_physics.messages import Message

ACTIVE = "VIRTUAL_ENV", "CONDA_PREFIX"
"""Environment variables that name the active Python environment."""
BESIDE = ".venv"
"""Folder name of a project's Python environment."""


def interpreter_of(
    target: str, *, is_module: bool, given: str | None, note: Callable[[str], None]
) -> str:
    """Return the path of the interpreter that runs a script.

    Parameters
    ----------
    target, is_module
        The script's path, or a module's name, which is resolved in the working directory.
    given
        The interpreter given by the user; None to search for one.
    note
        A function that is called with a sentence if the interpreter is not the one that runs
        `drop`.
    """
    if given is not None:
        return given
    for environment in _environments(Path() if is_module else Path(target).absolute().parent):
        if environment.resolve() == Path(sys.prefix).resolve():
            break
        python = environment / "bin" / "python"
        if os.access(python, os.X_OK):
            note(
                Message(
                    "{script} runs with {python}; --python names another interpreter",
                    script=target,
                    python=str(python),
                )
            )
            return str(python)
    return sys.executable


def _environments(folder: Path) -> Iterator[Path]:
    """Yield the Python environments that a script in a folder may use, nearest first."""
    yield from (Path(named) for name in ACTIVE if (named := os.environ.get(name)))
    folder = folder.absolute()
    for each in (folder, *folder.parents):
        if (each / BESIDE / "pyvenv.cfg").is_file():
            yield each / BESIDE
