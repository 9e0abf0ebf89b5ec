"""Functions whose parameters name what they are given: columns of a rule's runs, or its worst."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol, TypeVar

Answer = TypeVar("Answer")


class ByName(Protocol):
    """Values by their names."""

    def __getitem__(self, name: str, /) -> Any:  # noqa: ANN401
        """Return a value."""


@cache
def parameters(function: Callable[..., object]) -> tuple[str, ...]:
    """Return the names of a function's parameters."""
    return tuple(inspect.signature(function).parameters)


def called(function: Callable[..., Answer], known: ByName, **more: object) -> Answer:
    """Return the answer of a function to the values that its parameters name."""
    names = parameters(function)
    return function(**{name: more[name] if name in more else known[name] for name in names})
