"""Start watching: from now on, what the script does with pybullet is reported."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import platform
import sys
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

from .clock import Clock
from .draws import Draws
from .hooks import Watch
from .pipe import Pipe
from .varied import Variation


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
) -> Watch:
    """Watch pybullet, as soon as it is imported.

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
    """
    started = Watch(
        Pipe(pipe, block),
        Clock(real=keep_sleeping, begins_s=begins_s),
        steps=steps,
        duration_s=duration_s,
        variation=None if variation is None else Variation(**variation),
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
    for name, then in (("pybullet", started.install), ("numpy.random", draws.on_numpy)):
        once = name != "pybullet"  # which a script may forget, and import again
        if name in sys.modules:
            then(sys.modules[name])
            if once:
                continue
        finder = _OnImport(name, then, once=once)
        sys.meta_path.insert(0, finder)
        started.on_removal(finder.remove)
    return started


class _OnImport(importlib.abc.MetaPathFinder):
    """Calls a function with a module when the script imports it: every time, or once."""

    def __init__(self, name: str, then: Callable[[ModuleType], None], *, once: bool) -> None:
        self._name, self._then, self._once = name, then, once
        self._over = False

    def remove(self) -> None:
        """Stop waiting."""
        self._over = True
        if self in sys.meta_path:
            sys.meta_path.remove(self)

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
            loader.exec_module = exec_module
        return spec
