"""Compares properties that calls requested with those that the engine then reported.

Before the step after a call that changes a body or the engine's settings, the recorder reads their
properties again, and writes changed values. A recording therefore contains both requested and
reported values.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from drop_physics.physics.tree import BASE
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import At, Body, Dynamics, Settings, order
from drop_physics.trace.log import Log
from drop_physics.trace.properties import (
    OF_BODIES,
    PROPERTIES,
    REPORTED,
    REPORTED_SETTINGS,
    SETTERS,
    arrives,
    link_reached,
    takes,
)

ROUNDING = 1e-9
"""Relative difference up to which a reported value agrees with the requested one: the mass of a
btRigidBody is 1 / (1 / m)."""
Row = TypeVar("Row", Dynamics, Settings)
Numbers = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Request:
    """A property that a call set on a link, or on the engine itself."""

    call: Call
    name: str
    """Name of the argument."""
    asked: Numbers
    body: Body | None = None
    """The body on which the property was set; None for a setting of the engine."""
    link: int = BASE
    """The link that the call names."""
    reached: int = BASE
    """The link that the call affected."""
    ignored: bool = False
    """Whether the engine ignores this value."""
    before: Numbers | None
    """The value reported for the named link before the call; None if none was reported, or the body
    was not recorded yet."""
    got: Numbers | None
    """The value reported for the named link before the next step."""
    elsewhere: Numbers | None = None
    """The value reported for the link that the call affected, if this is not the named link."""

    @property
    def taken(self) -> bool:
        """Return whether the named link has the requested value, if the engine reports it."""
        if self.got is not None:
            same = len(self.got) == len(self.asked)
            return same and bool(np.allclose(self.got, self.asked, rtol=ROUNDING, atol=0))
        if self.ignored or self.body is None:
            return not self.ignored
        there = self.link < len(self.body.links) - 1 or self.body.hides_links
        return there and arrives(self.name, self.link, self.reached)


def requests(
    calls: Log, dynamics: Sequence[Dynamics], settings: Sequence[Settings]
) -> list[Request]:
    """Return the values that calls requested, for bodies and then for the engine, in order.

    A request that another call replaced before the next step is left out, since no value was read
    in between.
    """
    of_body: defaultdict[int, list[Dynamics]] = defaultdict(list)
    of_client: defaultdict[int, list[Settings]] = defaultdict(list)
    for dynamic in dynamics:
        of_body[dynamic.body.number].append(dynamic)
    for setting in settings:
        of_client[setting.client].append(setting)
    latest: dict[object, Request] = {}
    for call, at, came in calls.of_bodies(Act.SET_PROPERTY):
        named = int(call.values.get("linkIndex", (BASE,))[0])
        reached = link_reached(call.values)
        before, after = _around(of_body[came.body.number], call, at, order(came.at))
        for name in (name for name in call.values if name in PROPERTIES):
            whose = BASE if name in OF_BODIES else named
            latest[came.body.number, whose, name, at.step] = Request(
                call=call,
                name=name,
                asked=call.values[name],
                body=came.body,
                link=named,
                reached=reached,
                ignored=not takes(name, call.values),
                before=_of_link(before, name, named),
                got=_of_link(after, name, named),
                elsewhere=None if reached == named else _of_link(after, name, reached),
            )
    for call in calls.of(*SETTERS):
        earlier, later = _around(of_client[call.client], call, call.at)
        for name, asked in call.values.items():
            latest[call.client, name, call.at.step, "settings"] = Request(
                call=call,
                name=name,
                asked=asked,
                before=_of_engine(earlier, name),
                got=_of_engine(later, name),
            )
    return [*latest.values()]


def _around(
    rows: Sequence[Row], call: Call, at: At, since: tuple[int, int] = (0, -1)
) -> tuple[Row | None, Row | None]:
    """Return the engine's reports before a call and before the next step."""
    first = bisect_left(rows, since, key=lambda row: order(row.at))
    later = max(first, bisect_left(rows, call.at.call, key=lambda row: row.at.call))
    before = rows[later - 1] if later > first else None
    if later == len(rows) or rows[later].at.step > at.step:
        return before, before
    return before, rows[later]


def _of_link(row: Dynamics | None, name: str, link: int) -> Numbers | None:
    """Return the reported property of a link; None if the engine does not report it."""
    values = None if row is None else row.reported.get(REPORTED.get(name, ""))
    if values is None or not BASE <= link < len(values) - 1:
        return None
    numbers = np.ravel(values[link + 1])
    return tuple(numbers.tolist()) if np.isfinite(numbers).all() else None


def _of_engine(row: Settings | None, name: str) -> Numbers | None:
    values = None if row is None else row.values.get(REPORTED_SETTINGS.get(name, name))
    return None if values is None else tuple(np.ravel(values).tolist())
