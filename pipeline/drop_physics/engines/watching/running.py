"""Runs a script as Python would run it, while watching it."""

from __future__ import annotations

import builtins
import importlib.machinery
import json
import os
import runpy
import sys
from types import ModuleType

from . import asking, ending, limits, start
from .edits import InTwoParts, edited, write
from .host import ScriptWatch
from .private import private_of
from .programs import Programs

_ALWAYS = {
    "abc", "codecs", "encodings", "genericpath", "io", "ntpath", "os", "posixpath", "site", "stat",
    "zipimport",
}  # fmt: skip
"""Modules that Python imports before the script's folder is on the path."""
_PACKAGE = __name__.partition(".")[0]


def main(options: str, *command: str) -> None:
    """Run a script, while watching it.

    Parameters
    ----------
    options
        JSON: the arguments of `start.watch`, where `private` has the arguments of `Private`;
        `is_module`; `listens`, whether files, programs and networks that the script uses are
        reported; the run's `limits`; and `scratch`, a copy of the working directory in which the
        script runs, or None.
    command
        The script or the name of a module, and its arguments.
    """
    arguments = json.loads(options)
    again = {**arguments, "block": os.dup(arguments["block"])}
    is_module, listens = arguments.pop("is_module"), arguments.pop("listens")
    scratch, limited = arguments.pop("scratch"), arguments.pop("limits")
    private = private_of(arguments.pop("private"))
    if limited is not None:
        limits.keep(limited)
    if private is not None:
        private.enter()
    write(arguments["edits"], private)
    start.enter(scratch)
    sys.argv = [*command]
    watch = start.watch(**arguments, private=private)
    Programs(watch, again).install()
    asking.install(watch)
    if listens:
        watch.listen_outside()
    run = _run_module if is_module else _run_file
    ending.run(watch, lambda: run(watch, command[0]))


def _enter(folder: str) -> None:
    """Put a script's folder first on the module path, as Python does.

    Already imported modules are removed if the folder has modules of the same name: the script has
    to get its own.
    """
    if getattr(sys.flags, "safe_path", False):
        return
    sys.path.insert(0, folder)
    known = {name.partition(".")[0] for name in sys.modules} - _ALWAYS - {"__main__", _PACKAGE}
    for name in known.difference(sys.builtin_module_names):
        frozen = importlib.machinery.FrozenImporter.find_spec(name)
        if frozen is None and importlib.machinery.PathFinder.find_spec(name, [folder]) is not None:
            for module in [module for module in sys.modules if module.partition(".")[0] == name]:
                del sys.modules[module]


def _run_file(watch: ScriptWatch, name: str) -> None:
    path = os.path.abspath(name)
    folder = os.path.dirname(os.path.realpath(path))
    _enter(folder)
    module = _new_main()
    module.__file__ = path
    module.__loader__ = importlib.machinery.SourceFileLoader("__main__", path)
    with open(path, "rb") as file:
        text = file.read()
    if watch.forks is not None and watch.forks.at_first_line:
        begun = InTwoParts(text, path, folder)
        exec(begun.first, vars(module))
        watch.forks.stop_at_first_line()
        exec(begun.second(watch.edits), vars(module))
    else:
        exec(compile(edited(text, watch.edits), path, "exec", dont_inherit=True), vars(module))


def _run_module(watch: ScriptWatch, name: str) -> None:
    _enter(os.getcwd())
    _new_main()
    if watch.forks is not None and watch.forks.at_first_line:
        watch.forks.stop_at_first_line()
    # As `python -m` does: in the module's own `__main__`, not in a copy of it.
    runpy._run_module_as_main(name)  # type: ignore[attr-defined]


def _new_main() -> ModuleType:
    module = ModuleType("__main__")
    vars(module).update(__builtins__=builtins, __spec__=None, __cached__=None)
    if "__annotations__" in vars(sys.modules["__main__"]):  # as every Python before 3.14 has it
        vars(module)["__annotations__"] = {}
    sys.modules["__main__"] = module
    return module
