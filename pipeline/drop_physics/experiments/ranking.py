"""Sorts the changes with which an expectation is met, for the report.

Measured on 75 questions: changes that remove nothing come first, then those that change other
motion least; in between, changes that follow commands as before precede those that follow one much
worse. Changes with the same result and equal side effects are one outcome, reported once; so are
changes to one field of the same elements.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from drop_physics.engines.source import SOURCE
from drop_physics.engines.watching.single_changes import Change
from drop_physics.experiments.motion import same, side_m
from drop_physics.experiments.search import TriedChange

SAME_VALUE = 0.01
"""Largest relative difference of the compared quantity between outcomes that count as alike."""
SIZES = {"default": 0.5, "=default": 0.5, "left-out": 0.6, "*-1": 1.5}
OF_TEXT = 2.0
"""Weight factor for the side effects of changes to the script's text."""
ADDED = 0.8
"""Assumed size of an added call; the sizes by operator are above, a factor has size 1, any other
operator 1.2."""


@dataclass(frozen=True)
class SaidChange:
    """A change that meets the expectation, and similar changes that it stands for."""

    tried: TriedChange
    alike: Sequence[TriedChange]
    """Other changes with the same result and equal motion of all other bodies."""
    side_m: float
    """RMS change of the motion of all bodies that the expectation does not name [m]."""
    also: Sequence[TriedChange] = ()
    """Changes of the same elements with other operators, which result in a different motion."""
    row: str | None = None
    """The row of the account that names the element that the change acts on."""
    is_alone: bool = False
    """Whether no slightly different factor meets the expectation, so that the result of this factor
    is a coincidence."""


def ranked(
    tried: Iterable[TriedChange],
    besides: Sequence[str] = (),
    row_of: Callable[[Change], str | None] = lambda _: None,
) -> list[SaidChange]:
    """Return the changes that meet the expectation, sorted, and similar ones merged.

    Parameters
    ----------
    tried
        All changes that were tried.
    besides
        The bodies that the expectation names: their motion is no side effect.
    row_of
        Returns the row of the account that names what a change acts on.
    """
    true = [each for each in sorted(tried, key=lambda e: e.number) if each.outcome.holds]
    groups: list[list[TriedChange]] = []
    for each in true:
        if _has_smaller(each, true):
            continue
        group = next((group for group in groups if _are_alike(group[0], each)), None)
        if group is None:
            groups.append([each])
        else:
            group.append(each)
    said = []
    for group in groups:
        first, *alike = sorted(group, key=_plainness)
        row = row_of(first.change)
        said.append(SaidChange(first, alike, side_m(first.far_m, besides), row=row))
    plain = (each for each in said if not (_is_text(each) or _takes(each)))
    farthest_m = max((each.side_m for each in plain), default=0.0)
    return [*_by_field(sorted(said, key=lambda each: _order(each, farthest_m)))]


def _is_text(said: SaidChange) -> bool:
    return said.tried.change.engine == SOURCE


def _takes(said: SaidChange) -> bool:
    """Return whether a change removes something, or worsens how commands are followed."""
    return said.tried.change.breaks or bool(said.tried.worse)


def _order(said: SaidChange, farthest_m: float) -> tuple[Any, ...]:
    """Return a sort key: changes that remove nothing, follow all commands, have few side effects.

    A number in the source text may affect many things. So such a change must have less than half
    the side effects of other changes; otherwise it is sorted with the changes that follow a command
    worse.

    Parameters
    ----------
    said
        A change that meets the expectation.
    farthest_m
        The largest side effects among changes that neither edit the text nor remove anything [m].
    """
    change, is_text = said.tried.change, _is_text(said)
    side_m = (OF_TEXT if is_text else 1.0) * said.side_m
    later = bool(said.tried.worse) or (is_text and side_m > farthest_m)
    return change.breaks, later, side_m


def _by_field(said: Sequence[SaidChange]) -> Iterator[SaidChange]:
    """Yield one change for all fields of the same elements, with the others listed in it."""
    of_field: dict[tuple[Any, ...], list[SaidChange]] = {}
    for each in said:
        change = each.tried.change
        sets = sorted(change.how[1].get("sets", ())) if isinstance(change.how[1], Mapping) else ()
        ids = frozenset(map(str, change.ids))
        key = change.change, change.site, ids, change.breaks, *sets
        of_field.setdefault(key, []).append(each)
    for first, *others in of_field.values():
        yield replace(first, also=[each.tried for each in others])


def _has_smaller(each: TriedChange, true: Sequence[TriedChange]) -> bool:
    """Return whether a change of fewer elements meets the expectation, too."""
    mine = {*map(str, each.change.ids)}
    return any(
        other.family == each.family and {*map(str, other.change.ids)} < mine
        for other in true
        if other.change.ids
    )


def _are_alike(one: TriedChange, other: TriedChange) -> bool:
    values = one.outcome.value, other.outcome.value
    alike = math.isclose(*values, rel_tol=SAME_VALUE, abs_tol=1e-9)
    unknown = all(map(math.isnan, values))
    return (alike or unknown) and same(one.far_m, other.far_m)


def _plainness(each: TriedChange) -> tuple[Any, ...]:
    """Return a sort key for changes with equal motion: the simplest first."""
    change = each.change
    size = change.is_geometry, size_of(change), each.number
    is_text = change.engine == SOURCE  # it says the line of what is found in the model
    return is_text, change.breaks, not any(change.of), len(change.ids), *size


def size_of(change: Change) -> float:
    """Return the size of a change, from its operator, for sorting."""
    if isinstance(change.how[1], Mapping):  # a call that is often left out
        return ADDED
    return SIZES.get(change.op, 1.0 if change.op[:1] in "*/" else 1.2)
