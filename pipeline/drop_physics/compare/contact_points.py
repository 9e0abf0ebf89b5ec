"""Compares the contact points of two simulations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.compare.difference import FIRST, LED, Dated, Difference, When, off
from drop_physics.compare.pairing import Pairing
from drop_physics.trace.history import Seen
from drop_physics.trace.states import CONTACT_COLUMNS, Rows, between, numbers_of

NUMBERED = ("step", "body_a", "link_a", "body_b", "link_b")
MEASURED = ("position_a_m", "position_b_m", "normal", "distance_m", "normal_force_n")
COLUMNS = [
    *NUMBERED,
    *(column for name in MEASURED for column in CONTACT_COLUMNS.get(name, (name,))),
    *(f"friction_{axis}_n" for axis in "xyz"),
]
"""The compared quantities of a contact point. Both friction forces are added to one, since a small
sum may have large parts."""


def first_contact(
    run: Seen, pairs: Pairing, mine: Rows, golden: Rows, allowed: Mapping[str, float]
) -> Dated | None:
    """Return the first contact point that differs by more than allowed, or that one run lacks.

    Parameters
    ----------
    run, pairs
        The checked recording, and the bodies that correspond.
    mine, golden
        The contact points of both recordings in the same steps, with the same body ids.
    allowed
        Allowed difference by column; 0 for columns that are not listed.
    """
    if mine.tobytes() == golden.tobytes():
        return None
    if len({body.client for body in run.bodies.values()}) > 1:
        mine, golden = (_by_client(run, points) for points in (mine, golden))
    x, y = _numbers(mine), _numbers(golden)
    both = min(len(x), len(y))
    tolerated = np.array([allowed.get(name, 0.0) for name in COLUMNS])
    differ = off(x[:both], y[:both], tolerated)
    rows = np.flatnonzero(differ.any(axis=1)).tolist()
    if not rows and len(x) == len(y):
        return None
    row = rows[0] if rows else both
    step = min(int(points["step"][row]) for points in (mine, golden) if row < len(points))
    here, there = (between(points, step, step + 1) for points in (mine, golden))
    value: float
    other: float
    if len(here) != len(there):
        point = (here if len(here) > len(there) else there)[0]
        column, value, other = "contact_points", len(here), len(there)
    else:
        point, place = mine[row], int(np.argmax(differ[row]))
        column, kind = f"contact_{COLUMNS[place]}", int if place < len(NUMBERED) else float
        value, other = kind(x[row, place]), kind(y[row, place])
    body, link = _part(run, pairs, point)
    number = int(point["body_a"])
    client = run.bodies[number].client if number in run.bodies else 0
    difference = Difference(step, body, link, column, value, other)
    return Dated(When(step, LED if step else FIRST), client, difference)


def _numbers(points: Rows) -> Float64:
    """Return the compared numbers of contact points, shape (k, numbers)."""
    friction = sum(
        points[f"friction_{k}_n"][:, None] * points[f"friction_{k}_direction"] for k in (1, 2)
    )
    parts = [numbers_of(points, name) for name in (*NUMBERED, *MEASURED)]
    return np.hstack([*parts, np.asarray(friction)])


def _by_client(run: Seen, points: Rows) -> Rows:
    """Sort contact points by simulation and step."""
    clients = {number: body.client for number, body in run.bodies.items()}
    client = np.array([clients.get(number, 0) for number in points["body_a"].tolist()], np.int64)
    ordered: Rows = points[np.lexsort((client, points["step"]))]
    return ordered


def _part(run: Seen, pairs: Pairing, point: np.void) -> tuple[str | None, int | None]:
    """Return label and link of a touching body; a btRigidBody's links are unknown."""
    for side in "ab":
        number, link = int(point[f"body_{side}"]), int(point[f"link_{side}"])
        if number in run.bodies:
            return run.bodies[number].label, link
        if number in pairs.bodies:
            return pairs.label(number), link
    return None, None
