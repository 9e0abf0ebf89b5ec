"""Reports when a script waits for user input, so that the progress line is cleared."""

from __future__ import annotations

import builtins
import sys
from typing import Any

from .hidden import hiding
from .host import ScriptWatch

CLEAR = "\x1b[K"
"""Terminal sequence that clears the line from the cursor on; after a progress line, the cursor is
at the start of the line."""


def install(watch: ScriptWatch) -> None:
    """Report the start and the end of waiting for a line of input."""
    original = builtins.input

    def ask(*prompt: Any) -> str:
        _tell(watch, begins=True)
        try:
            return original(*prompt)
        finally:
            _tell(watch, begins=False)

    builtins.input = hiding(ask)
    watch.on_removal(lambda: setattr(builtins, "input", original))


def _tell(watch: ScriptWatch, *, begins: bool) -> None:
    if not watch.on:
        return
    with watch.lock:
        watch.pipe.note("waits", begins=begins)
        watch.pipe.flush()
    if begins and sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty():
        sys.stderr.write(CLEAR)
        sys.stderr.flush()
