"""A single change of a run, as tried by the causal search, for any engine.

The rows of the table define the changes. `single_changes` of an engine's `watch` returns those that
would change something in a run, and their effects there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

ORDERS = ("exchanged", "reversed")
"""Operators on several elements together: their first half with their second, and their order."""
MOST_NAMES = 6
"""Most elements of a change that are named one by one."""


@dataclass(frozen=True)
class Change:
    """A change of some elements in one way."""

    change: str
    """Target of the change: a field of the compiled model, `option.timestep`, `flag.CONTACT`,
    `pair`, `input.ctrl`; or `function.argument`, `function` if a call is left out or added."""
    op: str
    """The operator as a row has it: `=0`, `*10`, `=default`, `left out` …"""
    how: tuple[str, Any]
    """The operator and what it takes, as `operators` has it, or the engine's `changes`."""
    ids: tuple[Any, ...] = ()
    """The elements, as the engine numbers them; none for the whole run."""
    of: tuple[str, ...] = ()
    """Their names."""
    breaks: bool = False
    """Whether it takes a part of the scene or of the command away."""
    site: tuple[str, int] | None = None
    """File and line of the call; None for all, or if it is no call."""
    model: tuple[int, ...] = ()
    """Key of the compiled model with these elements; empty without one."""
    engine: str = ""
    """The engine whose run it is."""
    is_geometry: bool = False
    """Whether it changes where things are, or how large."""
    bodies: tuple[str, ...] = ()
    """The bodies whose elements all are changed, of which it can be; empty of some of them."""
    on: tuple[str, ...] = ()
    """The names of the links that the elements belong to, where these are not their own."""

    @property
    def target(self) -> tuple[str, ...]:
        """The names of the changed elements: if there are too many, those of their bodies."""
        names = self.bodies if self.bodies and len(self.of) > MOST_NAMES else self.of
        return tuple(dict.fromkeys(each for each in names if each))

    def of_some(self, places: Sequence[int]) -> Change:
        """Return the same change restricted to some of its elements, by their places."""
        ids, of, on = (
            tuple(held[place] for place in places if held) for held in (self.ids, self.of, self.on)
        )
        bodies = self.bodies if len(ids) == len(self.ids) else ()
        return replace(self, ids=ids, of=of, on=on, bodies=bodies)

    def by(self, factor: float) -> Change:
        """Return the same change by another factor.

        Raises
        ------
        ValueError
            If its operator is no factor.
        """
        if self.how[0] != "*":
            raise ValueError(f"only a factor has others, got {self.op}")
        return replace(self, op=f"*{factor:g}", how=("*", factor))


def change_of(told: Mapping[str, Any]) -> Change:
    """Return a change from a run's report."""
    lists = ("how", "ids", "of", "site", "model", "bodies", "on")
    pairs = {name: told[name] if told[name] is None else tuple(told[name]) for name in lists}
    return Change(**{**told, **pairs})


def how_of(op: str, default: Any = 0.0) -> tuple[str, Any]:
    """Return the operator and the operand of a row's text: `=0`, `*10`, `=default`, `held`."""
    if op == "=default":
        return "=", default
    try:
        return op[0], float(op[1:])
    except ValueError:
        return op, None
