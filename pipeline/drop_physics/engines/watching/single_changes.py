"""A single change of a run, as the search for causes tries it, for any engine.

The rows of an engine's table define the changes. The module `single_changes` of the engine's
`watch` finds those that have an effect in a run, and the operations that make them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

T = TypeVar("T")

ORDERS = ("exchanged", "reversed")
"""Operators on several elements together: exchange of their halves, and reversal."""
MOST_NAMES = 6
"""Largest number of changed elements that are named one by one."""


@dataclass(frozen=True)
class Change:
    """A single change: an operator, applied to a quantity of some elements."""

    change: str
    """Target of the change. MuJoCo: a field of the compiled model, `option.timestep`,
    `flag.CONTACT`, `pair` or `input.ctrl`. PyBullet: `function.argument`, or `function` if a call
    is added or left out."""
    op: str
    """The operator as in a table row: `=0`, `*10`, `=default`, `left out` …"""
    how: tuple[str, Any]
    """The operator and its operand (see `operators`), or an operator that the engine defines."""
    ids: tuple[Any, ...] = ()
    """The elements, by engine index; empty for the whole run."""
    of: tuple[str, ...] = ()
    """The names of the elements."""
    breaks: bool = False
    """Whether the change removes a part of the scene or of the command."""
    site: tuple[str, int] | None = None
    """File and line of the changed call; None for calls from all lines, or if no call is changed.
    """
    model: tuple[int, ...] = ()
    """Key of the compiled model to which the elements belong; empty without such a model."""
    engine: str = ""
    """The engine to which the change applies."""
    is_geometry: bool = False
    """Whether the change concerns positions or sizes."""
    bodies: tuple[str, ...] = ()
    """The bodies whose elements are all changed; empty if only some of their elements are."""
    on: tuple[str, ...] = ()
    """The names of the links to which the elements belong, if the elements are not named after
    them."""
    sites: tuple[tuple[str, int] | None, ...] = ()
    """File and line of the only call that sets each element; None for an element that several lines
    set. Empty if `site` is given, or if no call is changed."""

    @property
    def target(self) -> tuple[str, ...]:
        """The names of the changed elements, or of their bodies if there are too many."""
        names = self.bodies if self.bodies and len(self.of) > MOST_NAMES else self.of
        return tuple(dict.fromkeys(each for each in names if each))

    def of_some(self, places: Sequence[int]) -> Change:
        """Return the same change restricted to some of its elements, by index.

        If one line sets all of these elements, the change gets this line as its `site`.
        """

        def some(held: tuple[T, ...]) -> tuple[T, ...]:
            return tuple(held[place] for place in places if held)

        ids, sites = some(self.ids), some(self.sites)
        its = replace(self, ids=ids, of=some(self.of), on=some(self.on), sites=sites)
        if len(ids) < len(self.ids):
            its = replace(its, bodies=())
        return replace(its, site=sites[0], sites=()) if len({*sites}) == 1 and sites[0] else its

    @property
    def key(self) -> tuple[object, ...]:
        """A key that is equal for equal changes of the same elements."""
        return self.change, self.op, self.site, str(self.ids)

    def by(self, factor: float) -> Change:
        """Return the same change with another number.

        Raises
        ------
        ValueError
            If the change's operator is not a factor.
        """
        if self.how[0] != "*":
            raise ValueError(f"only a factor has others, got {self.op}")
        return replace(self, op=f"*{factor:g}", how=("*", factor))


def change_of(told: Mapping[str, Any]) -> Change:
    """Parse a change from a message of the run's process."""
    lists = ("how", "ids", "of", "site", "model", "bodies", "on")
    pairs = {name: told[name] if told[name] is None else tuple(told[name]) for name in lists}
    sites = tuple(None if each is None else tuple(each) for each in told["sites"])
    return Change(**{**told, **pairs, "sites": sites})


def how_of(op: str, default: Any = 0.0) -> tuple[str, Any]:
    """Parse a row's operator text into operator and operand: `=0`, `*10`, `=default`, `held`."""
    if op == "=default":
        return "=", default
    try:
        return op[0], float(op[1:])
    except ValueError:
        return op, None
