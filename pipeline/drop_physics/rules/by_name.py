"""Calls functions with the values that their parameters name, such as columns of a table."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol, TypeVar

Answer = TypeVar("Answer")


class ByName(Protocol):
    """An object whose values can be looked up by name."""

    def __getitem__(self, name: str, /) -> Any:  # noqa: ANN401
        """Return a value by name."""


@cache
def parameters(function: Callable[..., object]) -> tuple[str, ...]:
    """Return the names of a function's parameters."""
    return tuple(inspect.signature(function).parameters)


def called(function: Callable[..., Answer], known: ByName, **more: object) -> Answer:
    """Call a function with the values that its parameters name, and return its result."""
    names = parameters(function)
    return function(**{name: more[name] if name in more else known[name] for name in names})
