"""Calls functions when a script imports certain modules."""

from __future__ import annotations

import _imp
import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

from .hidden import hiding

Then = Callable[[ModuleType], None]
"""Function that is called with an imported module."""


def on_import(name: str, then: Then, *, once: bool) -> Callable[[], None]:
    """Call a function with a module when the script imports the module: once or always.

    Returns a function that cancels this.
    """
    if name in sys.modules:
        then(sys.modules[name])
        if once:
            return _nothing
    finder = _OnImport(name, then, once=once)
    sys.meta_path.insert(0, finder)
    return finder.remove


def on_extension(name: str, then: Then) -> Callable[[], None]:
    """Call a function with every module object that is loaded from an extension file.

    `importlib` can create such a module under another name, or a second one; all are created by one
    function of Python, which is wrapped. The last part of the module's name is always the
    extension's. Returns a function that cancels this.
    """
    original = _imp.create_dynamic

    def create(spec: Any, *rest: Any) -> ModuleType:
        module: ModuleType = original(spec, *rest)
        if spec.name.rpartition(".")[2] == name:
            then(module)
        return module

    _imp.create_dynamic = hiding(create)
    for known, module in list(sys.modules.items()):
        loader = getattr(module, "__loader__", None)
        is_extension = isinstance(loader, importlib.machinery.ExtensionFileLoader)
        if is_extension and known.rpartition(".")[2] == name:
            then(module)
    return lambda: setattr(_imp, "create_dynamic", original)


def _nothing() -> None:
    pass


class _OnImport:
    """An import hook that calls a function when a module is imported.

    Python calls it as a finder (`sys.meta_path`). It does not derive from the class in
    `importlib.abc`, which takes as long to import as all of drop's modules here.
    """

    def __init__(self, name: str, then: Then, *, once: bool) -> None:
        self._name, self._then, self._once = name, then, once
        self._over = False

    def remove(self) -> None:
        """Remove the import hook."""
        self._over = True
        finders: list[Any] = sys.meta_path
        if self in finders:
            finders.remove(self)

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name or self not in sys.meta_path:
            return None
        place = sys.meta_path.index(self)
        del sys.meta_path[place]
        try:
            spec = importlib.util.find_spec(fullname)
        finally:
            sys.meta_path.insert(place, self)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                if not self._over:
                    self._over = self._once
                    self._then(module)

            loader: Any = spec.loader
            loader.exec_module = hiding(exec_module)
        return spec
