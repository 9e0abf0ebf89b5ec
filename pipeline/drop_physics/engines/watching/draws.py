"""Seeds random generators, or reports the script's first unseeded random number.

Numbers that a library draws while it is imported are ignored: it tests itself, or creates examples
for its documentation.
"""

from __future__ import annotations

import functools
import random
import re
from collections.abc import Callable
from linecache import getline
from sys import _getframe
from types import ModuleType
from typing import Any

from .hidden import hide
from .sites import INSTALLED, is_library

SEEDS = ("seed", "setstate", "set_state", "set_bit_generator")
"""Generator methods that determine the numbers drawn."""
SILENT = ("getstate", "get_state", "getrandbits")
"""Generator methods that draw nothing, or that Python's library calls for its own draws."""
OF_NUMPY = ("seed", "sample", "ranf", "set_bit_generator")
"""Module-level functions of `numpy.random` that are not generator methods."""
COPIES = "__bit_generator_ctor"
"""The numpy function that creates a generator, and then sets its state to another generator's."""
SEEDED_STATE = re.compile(r"RandomState\((?!\s*(None\s*)?\))")
"""Pattern of a call that seeds `numpy.random.RandomState`."""


class Draws:
    """Seeds or watches the generators of `random` and `numpy.random`.

    Parameters
    ----------
    seed
        The seed of all generators; None leaves the generators unchanged.
    tell
        A function that is called with the name and frame of a function that draws a number without
        a seed; once per generator.
    """

    def __init__(self, seed: int | None, tell: Callable[[str, Any], None]) -> None:
        self._seed, self._tell = seed, tell
        self._quiet: set[str] = set()
        self._entropy = random.Random(seed)
        self._undo: list[Callable[[], None]] = []

    def begin(self) -> None:
        """Start with the generator of Python's `random`."""
        if self._seed is None:
            self._watch(random, "random", getattr(random, "_inst"))  # noqa: B009
        else:
            self._seed_generators()
            random.seed(self._seed)

    def on_numpy(self, module: ModuleType) -> None:
        """Include numpy's generators, once `numpy.random` is imported."""
        if self._seed is None:
            self._watch(module, "numpy.random", getattr(module.mtrand, "_rand"))  # noqa: B009
        else:
            module.seed(self._seed % 2**32)
        source: Any = module.bit_generator
        original = source.randbits

        def randbits(count: int) -> int:
            if self._seed is not None:
                return self._entropy.getrandbits(count)
            frame = _getframe(1)
            # A seed of numpy's own generator is reported once that draws.
            seeds = frame.f_code.co_filename == __file__ or _gives_seed(frame)
            if not (seeds or is_made(frame)):
                self._drawn("numpy.random.SeedSequence", frame)
            return int(original(count))

        source.randbits = randbits
        self._undo.append(lambda: setattr(source, "randbits", original))

    def remove(self) -> None:
        """Restore the original generator functions."""
        while self._undo:
            self._undo.pop()()

    def _seed_generators(self) -> None:
        """Make `random.seed()` and `random.Random()` without arguments reproducible."""
        original, entropy = random.Random.seed, self._entropy

        @functools.wraps(original)
        def seed(generator: random.Random, a: Any = None, version: int = 2) -> None:
            try:
                original(generator, entropy.getrandbits(64) if a is None else a, version)
            except BaseException as error:
                hide(error)
                raise

        for owner, name, function in (
            (random.Random, "seed", seed),
            (random, "seed", functools.partial(seed, getattr(random, "_inst"))),  # noqa: B009
        ):
            self._undo.append(functools.partial(setattr, owner, name, getattr(owner, name)))
            setattr(owner, name, function)

    def _watch(self, module: ModuleType, name: str, generator: object) -> None:
        for attribute, function in list(vars(module).items()):
            of_module = module is not random and attribute in OF_NUMPY
            if of_module or getattr(function, "__self__", None) is generator:
                setattr(module, attribute, self._watched(f"{name}.{attribute}", name, function))
                self._undo.append(functools.partial(setattr, module, attribute, function))

    def _watched(self, called: str, name: str, function: Any) -> Any:
        function_name = called.rpartition(".")[2]
        seeds, draws = function_name in SEEDS, function_name not in (*SEEDS, *SILENT)

        @functools.wraps(function)
        def notice(*args: Any, **kwargs: Any) -> Any:
            if seeds and (args or kwargs) and args[:1] != (None,):
                self._quiet.add(name)
            elif seeds:
                self._quiet.discard(name)
            elif draws and name not in self._quiet:
                self._drawn(called, _getframe(1), name)
            try:
                return function(*args, **kwargs)
            except BaseException as error:
                hide(error)
                raise

        return notice

    def _drawn(self, called: str, frame: Any, name: str = "") -> None:
        if (name or called) not in self._quiet and not is_imported(frame):
            self._quiet.add(name or called)
            self._tell(called, frame)


def is_imported(frame: Any) -> bool:
    """Return whether a library module is being imported, anywhere up the call stack."""
    while frame is not None:
        code = frame.f_code
        if code.co_name == "<module>" and not code.co_filename.startswith("<"):
            is_main = frame.f_globals.get("__name__") == "__main__"
            return not is_main and INSTALLED.search(code.co_filename) is not None
        frame = frame.f_back
    return False


def is_made(frame: Any) -> bool:
    """Return whether a library is creating an object, which may be seeded before use."""
    while frame is not None and is_library(frame.f_code.co_filename):
        if frame.f_code.co_name == "__init__":
            return True
        frame = frame.f_back
    return False


def _gives_seed(frame: Any) -> bool:
    """Return whether a frame seeds a generator, or sets its state.

    numpy draws a random seed before it sets the given one.
    """
    line = getline(frame.f_code.co_filename, frame.f_lineno)
    return frame.f_code.co_name == COPIES or SEEDED_STATE.search(line) is not None
