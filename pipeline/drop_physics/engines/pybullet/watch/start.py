"""Start watching: from now on, what the script does with its engines is reported."""

from __future__ import annotations

import _imp
import importlib.machinery
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType
from typing import Any

from .calls import HOME
from .clock import Clock
from .draws import Draws
from .hidden import hide
from .hooks import Watch
from .pipe import MUJOCO, Pipe, frame
from .varied import varied_by


def watch(
    pipe: int,
    block: int,
    *,
    steps: int | None,
    duration_s: float | None,
    keep_sleeping: bool,
    seed: int | None,
    begins_s: float | None = None,
    variation: dict[str, Any] | None = None,
    interventions: Sequence[dict[str, Any]] = (),
    trials: Sequence[dict[str, Any]] = (),
) -> Watch:
    """Watch pybullet and mujoco, as soon as they are imported.

    Parameters
    ----------
    pipe, block
        File descriptors of the pipe, and of the memory shared with its reader.
    steps, duration_s
        When to stop the script; None for never.
    keep_sleeping
        Whether the script's clock is the real one.
    seed
        Seed of all random numbers, or None.
    begins_s
        What a virtual clock shows at first [s]; None for the time of day.
    variation
        The arguments of a `Variation`; None for the script's own run.
    interventions
        What its calls do otherwise, as `intervene` takes it.
    trials
        Runs that part from this one, as `forks` takes them.
    """
    started = Watch(
        Pipe(pipe, block),
        Clock(real=keep_sleeping, begins_s=begins_s),
        steps=steps,
        duration_s=duration_s,
        variation=varied_by(variation),
        interventions=interventions,
        trials=trials,
    )
    version = ".".join(map(str, sys.version_info[:3]))
    started.pipe.note(
        "python", version=version, machine=platform.machine(), virtual_time=not keep_sleeping
    )
    started.clock.install()
    started.lock.install()
    draws = Draws(seed, started.tell_draw)
    draws.begin()
    started.on_removal(draws.remove)

    def on_import(name: str, then: Callable[[ModuleType], None], *, once: bool = True) -> None:
        if name in sys.modules:
            then(sys.modules[name])
            if once:
                return
        finder = _OnImport(name, then, once=once)
        sys.meta_path.insert(0, finder)
        started.on_removal(finder.remove)

    on_import("numpy.random", draws.on_numpy)
    # A script may forget an engine, and import it again.
    _on_extension("pybullet", started)
    differs = interventions, variation
    on_import("mujoco", partial(_on_mujoco, started, on_import, differs, []), once=False)
    return started


def enter(scratch: str | None) -> None:
    """Work in a copy of the working directory; files are named as in that."""
    if scratch is not None:
        HOME.append(os.getcwd())
        os.chdir(scratch)


def _on_extension(name: str, started: Watch) -> None:
    """Watch every module that an extension's file becomes, however it is loaded.

    `importlib` can make one under another name, or beside the one that is imported already; all of
    them come from one function of Python's. The last part of the name is always the extension's.
    """
    original = _imp.create_dynamic

    def create(spec: Any, *rest: Any) -> ModuleType:
        try:
            module: ModuleType = original(spec, *rest)
        except BaseException as error:
            hide(error)
            raise
        if spec.name.rpartition(".")[2] == name:
            started.install(module)
        return module

    _imp.create_dynamic = create
    started.on_removal(lambda: setattr(_imp, "create_dynamic", original))
    for known, module in list(sys.modules.items()):
        loader = getattr(module, "__loader__", None)
        is_extension = isinstance(loader, importlib.machinery.ExtensionFileLoader)
        if is_extension and known.rpartition(".")[2] == name:
            started.install(module)


def _on_mujoco(
    host: Watch, on_import: Any, differs: Any, known: list[Any], module: ModuleType
) -> None:
    """Watch mujoco; what does so needs numpy, and is loaded when mujoco is."""
    if not known:
        watch = importlib.import_module(f"{_mujoco_package()}.watch.hooks")
        known.append(watch.MujocoWatch(host, MUJOCO, frame, on_import, *differs))
    known[0].install(module)


def _mujoco_package() -> str:
    """Return the name of the package beside our own; in a script's process it has one of ours."""
    if not __package__.startswith("_"):
        return "drop_physics.engines.mujoco"
    name = "_drop_mujoco"
    if name not in sys.modules:
        folder = os.path.join(os.path.dirname(__file__), "..", "..", "mujoco")
        folder = os.path.abspath(folder)
        spec = importlib.util.spec_from_file_location(
            name, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
        )
        assert spec is not None
        assert spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        sys.modules[name] = package
        spec.loader.exec_module(package)
    return name


class _OnImport:
    """Calls a function with a module when the script imports it: every time, or once.

    Python asks it as a finder (`sys.meta_path`); `importlib.abc` has a class for those, and takes
    as long to import as all of ours.
    """

    def __init__(self, name: str, then: Callable[[ModuleType], None], *, once: bool) -> None:
        self._name, self._then, self._once = name, then, once
        self._over = False

    def remove(self) -> None:
        """Stop waiting."""
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
                try:
                    execute(module)
                except BaseException as error:
                    hide(error)
                    raise
                if not self._over:
                    self._over = self._once
                    self._then(module)

            loader: Any = spec.loader
            loader.exec_module = exec_module
        return spec
