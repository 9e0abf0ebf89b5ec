"""Names the lines of a script from which calls come: file and line."""

from __future__ import annotations

import os
import re
import sys
from hashlib import sha256
from io import FileIO
from sys import _getframe
from typing import Any

from .hidden import WRAPPERS
from .pipe import Pipe

HOME: list[str] = []
"""The script's original working directory, if it runs in a copy."""
LIBRARY = os.path.dirname(os.__file__) + os.sep
"""The folder of Python's standard library."""
INSTALLED = re.compile(r"[/\\](site|dist)-packages[/\\]")
"""Path parts by which an installed library's module is recognised."""


class Sites:
    """Finds the script line of a frame; reports the digest of the file that runs as a script."""

    def __init__(self, pipe: Pipe) -> None:
        self._pipe = pipe
        self._shown: dict[str, str] = {}
        self._libraries: dict[str, bool] = {}

    def place(self, frame: Any) -> tuple[str, int]:
        """Return file and line of a frame, without the names of this machine's folders."""
        name = frame.f_code.co_filename
        shown = self._shown.get(name)
        if shown is None:
            shown = self._shown[name] = shown_file(name)
            if frame.f_globals.get("__name__") == "__main__":
                self._tell_main(name)
        return shown, frame.f_lineno

    def outside(self, frame: Any) -> Any:
        """Return the innermost frame outside libraries; the given frame if there is none."""
        outer, libraries = frame, self._libraries
        while outer is not None:
            name = outer.f_code.co_filename
            known = libraries.get(name)
            if known is None:
                known = libraries[name] = is_library(name)
            if not known:
                return outer
            outer = outer.f_back
        return frame

    def _tell_main(self, name: str) -> None:
        """Send the digest of the script's file."""
        try:
            with FileIO(name) as file:
                digest = sha256(file.read()).hexdigest()
        except OSError:
            return
        self._pipe.note("main", sha256=digest)


def caller_of(frame: Any) -> Any:
    """Return the frame that called the engine, past the frames of nested recordings."""
    while frame.f_back is not None and frame.f_code.co_filename.startswith(WRAPPERS):
        frame = frame.f_back
    return frame


def caller() -> Any:
    """Return the script's frame that called a wrapped function."""
    return caller_of(_getframe(1))


def is_library(name: str) -> bool:
    """Return whether a code file belongs to Python, to an installed library, or to drop."""
    return name.startswith(("<frozen", LIBRARY, *WRAPPERS)) or INSTALLED.search(name) is not None


def shown_file(name: str) -> str:
    """Return a file name relative to the working directory or the module path.

    A notebook's cell is shown as `In[3]`, as in IPython's tracebacks.
    """
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    cell_of = getattr(getattr(shell, "compile", None), "format_code_name", None)
    if cell_of is not None and cell_of(name):
        return str(cell_of(name)[1])
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        here = ""
    for folder in (here, *HOME, *sorted(sys.path, key=len, reverse=True)):
        if folder and name.startswith(os.path.join(folder, "")):
            return os.path.relpath(name, folder)
    return os.path.basename(name) or name
