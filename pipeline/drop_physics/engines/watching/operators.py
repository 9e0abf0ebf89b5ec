"""Applies the operators of trial changes, such as ×10, to numbers and arrays."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "=": lambda _, given: given,
    "*": operator.mul,
    "/": operator.truediv,
    "+": operator.add,
    "-": operator.sub,
    "|": operator.or_,
    "^": operator.xor,
    "~": lambda held, bits: held & ~bits,
    ">": lambda held, least: held.clip(min=least) if hasattr(held, "clip") else max(held, least),
    "<": lambda held, most: held.clip(max=most) if hasattr(held, "clip") else min(held, most),
}
"""Operators by name, as functions of a quantity's current value and an operand. The last five set,
toggle and clear bits, and apply a lower and an upper bound."""
QUATERNION = 4
"""Length of a quaternion."""
ROTATED = {"w-first": 1, "w-last": -1}
"""Operators on the order of a quaternion's numbers: by how many places they are rotated."""


def becoming(held: Any, how: Sequence[Any]) -> Any:
    """Apply an operator to a value, or to each element of a list."""
    name, given = how
    if name in ROTATED:
        by = -ROTATED[name] if len(held) == QUATERNION else 0
        return [*held[by:], *held[:by]]
    if name != "=" and isinstance(held, (list, tuple)):
        each = given if isinstance(given, (list, tuple)) else [given] * len(held)
        return [becoming(one, (name, by)) for one, by in zip(held, each)]
    return OPERATORS[name](held, given)
