"""Follows scripts that replace their program (`os.exec…`), as some do to set environment variables.

If the new program is a Python interpreter that runs a file or a module, and no step was made yet,
it is watched instead. Otherwise its steps are reported as missing.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from os import getpid
from typing import Any

from .hidden import hiding
from .host import ScriptWatch
from .sites import HOME

FUNCTIONS = ("execv", "execve")
"""The functions that all other `os.exec…` functions call."""
PYTHON = re.compile(r"(?:python|pypy)[\d.]*")
VALUED = ("-W", "-X")
"""Options of Python that take a value."""
WATCHING = os.path.dirname(os.path.abspath(__file__))
MODULE = "watching.running"


class Programs:
    """Continues to watch a script in the program by which it replaces itself.

    Parameters
    ----------
    watch
        The watch of the script.
    options
        The options with which the script was started (see `running.main`), with `block` still open.
    """

    def __init__(self, watch: ScriptWatch, options: dict[str, Any]) -> None:
        self._watch, self._options, self._process = watch, options, getpid()

    def install(self) -> None:
        """Wrap the functions that replace the process."""
        for name in FUNCTIONS:
            original = getattr(os, name)
            setattr(os, name, hiding(partial(self._exec, original)))
            self._watch.on_removal(partial(setattr, os, name, original))

    def _exec(self, original: Callable[..., Any], file: Any, arguments: Any, *env: Any) -> Any:
        watch = self._watch
        given = [*arguments]
        if not watch.on or getpid() != self._process or not os.access(file, os.X_OK):
            return original(file, given, *env)
        program = os.fsdecode(file)
        again = None
        if not watch.steps_made and PYTHON.fullmatch(os.path.basename(program)):
            again = self._watched([*map(os.fsdecode, given)])
        with watch.lock:
            if again is None:
                watch.pipe.note("replaced", program=program)
            else:
                watch.pipe.note("again")
                watch.pipe.hand_on()
                os.set_inheritable(self._options["block"], True)
            watch.settle()
        watch.on = False  # what the watched program reaches, it tells itself
        try:
            if again is not None and HOME:
                os.chdir(HOME[-1])
            return original(file, again or given, *env)
        finally:
            watch.on = True

    def _watched(self, arguments: Sequence[str]) -> list[str] | None:
        """Return a Python command line extended by watching; None if it runs no file or module."""
        if list(arguments[1:3]) == [WATCHING, MODULE]:  # as `sys.orig_argv` has it
            return self._command(arguments[:1], self._options["is_module"], arguments[4:])
        at = 1
        while at < len(arguments) and arguments[at].startswith("-"):
            if arguments[at] == "-m":
                return self._command(arguments[:at], True, arguments[at + 1 :])
            if arguments[at][1:2] in ("", "c", "m"):
                return None
            at += 2 if arguments[at] in VALUED else 1
        return self._command(arguments[:at], False, arguments[at:])

    def _command(
        self, python: Sequence[str], is_module: bool, script: Sequence[str]
    ) -> list[str] | None:
        # Views of the file system and limits outlive a program.
        entered = {"private": None, "limits": None, "again": True}
        options = {**self._options, **entered, "is_module": is_module}
        return [*python, WATCHING, MODULE, json.dumps(options), *script] if script else None
