"""Time series in expectations, and functions on them, such as `end`, `peak` and `drift`.

A series that is used as a number stands for its last value. The module needs numpy in the script's
interpreter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np


class Series(np.ndarray):
    """A number or vector after each step of a run; shape (n,) or (n, size).

    Used as a truth value or as a number, a series stands for its last value. The attribute
    `times_s` contains the times [s], shape (n,).
    """

    times_s: Any = None

    def __array_finalize__(self, other: Any) -> None:
        self.times_s = getattr(other, "times_s", None)

    def __bool__(self) -> bool:
        return bool(np.all(np.asarray(self)[-1]))

    def __float__(self) -> float:
        return float(np.asarray(self)[-1]) if self.ndim else float(np.asarray(self))

    def at(self, time_s: float) -> Any:
        """Return the value of the series at a time [s]."""
        return at(self, time_s)


def series_of(values: Sequence[Any], times_s: Sequence[float]) -> Series:
    """Return a series of values at the given times [s]."""
    made = np.array(values, float).view(Series)
    made.times_s = np.array(times_s, float)
    return made


def _plain(values: Any) -> Any:
    return np.asarray(values, float)


def end(values: Any) -> Any:
    """Return the last value of a series."""
    return np.asarray(values)[-1]


def peak(values: Any) -> float:
    """Return the largest magnitude in a series."""
    return float(np.max(np.abs(_plain(values))))


def low(values: Any) -> float:
    """Return the smallest value."""
    return float(np.min(_plain(values)))


def drift(values: Any) -> float:
    """Return the distance between the last and the first value."""
    plain = _plain(values)
    return float(np.linalg.norm(plain[-1] - plain[0]))


def norm(values: Any) -> Any:
    """Return the length of a vector; for a series of vectors, a series of lengths."""
    if isinstance(values, Series):
        length = np.abs(values) if values.ndim < 2 else np.linalg.norm(_plain(values), axis=1)
        made = np.asarray(length).view(Series)
        made.times_s = values.times_s
        return made
    return float(np.linalg.norm(_plain(values)))


def at(values: Any, time_s: float) -> Any:
    """Return the value of a series at a time [s]: after the first step at or after that time."""
    times = values.times_s
    place = min(int(np.searchsorted(times, time_s * (1 - 1e-12))), len(times) - 1)
    return np.asarray(values)[place]


def always(values: Any) -> bool:
    """Return whether a condition holds after every step."""
    return bool(np.all(np.asarray(values)))


def ever(values: Any) -> bool:
    """Return whether a condition holds after any step."""
    return bool(np.any(np.asarray(values)))


FUNCTIONS: dict[str, Any] = {
    **{each.__name__: each for each in (end, peak, low, drift, norm, at, always, ever)},
    "np": np,
    "math": math,
}
"""Functions that an expression may use, besides series."""
