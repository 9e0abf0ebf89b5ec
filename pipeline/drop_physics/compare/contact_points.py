"""The contact points of two simulations compared."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import polars as pl

from drop_physics.compare.difference import FIRST, LED, Dated, Difference, When, off
from drop_physics.compare.pairing import Pairing
from drop_physics.trace.history import Seen


def first_contact(
    run: Seen,
    pairs: Pairing,
    mine: pl.DataFrame,
    golden: pl.DataFrame,
    allowed: Mapping[str, float],
) -> Dated | None:
    """Return the first contact point that differs by more than allowed, or step with more of them.

    Parameters
    ----------
    run, pairs
        The checked simulation, and which bodies correspond.
    mine, golden
        The contact points of the same steps, with the same numbers of bodies.
    allowed
        What is allowed in each column; nothing in the others.
    """
    if mine.equals(golden):
        return None
    clients = {body.client for body in run.bodies.values()}
    if len(clients) > 1:
        mine, golden = (_by_client(run, table) for table in (mine, golden))
    x, y = (_points(table) for table in (mine, golden))
    both = min(len(x), len(y))
    tolerated = np.array([allowed.get(name, 0.0) for name in x.columns])
    differ = off(x[:both].to_numpy(), y[:both].to_numpy(), tolerated)
    rows = np.flatnonzero(differ.any(axis=1)).tolist()
    if not rows and len(x) == len(y):
        return None
    row = rows[0] if rows else both
    step = min(int(table["step"][row]) for table in (mine, golden) if row < len(table))
    here, there = (table.filter(pl.col("step") == step) for table in (mine, golden))
    if len(here) != len(there):
        point = (here if len(here) > len(there) else there).row(0, named=True)
        column, value, other = "contact_points", len(here), len(there)
    else:
        point, name = mine.row(row, named=True), x.columns[int(np.argmax(differ[row]))]
        column, value, other = f"contact_{name}", x[name][row], y[name][row]
    body, link = _part(run, pairs, point)
    client = run.bodies[point["body_a"]].client if point["body_a"] in run.bodies else 0
    difference = Difference(step, body, link, column, value, other)
    return Dated(When(step, LED if step else FIRST), client, difference)


def _points(contacts: pl.DataFrame) -> pl.DataFrame:
    """Return contact points, friction added up to one force: a small one may have large parts."""
    friction = {
        f"friction_{axis}_n": pl.col("friction_1_n") * pl.col(f"f1{axis}")
        + pl.col("friction_2_n") * pl.col(f"f2{axis}")
        for axis in "xyz"
    }
    parts = pl.exclude("friction_1_n", "f1x", "f1y", "f1z", "friction_2_n", "f2x", "f2y", "f2z")
    return contacts.select(parts, **friction)


def _by_client(run: Seen, contacts: pl.DataFrame) -> pl.DataFrame:
    """Return contact points in the order of step and client: each client has its own steps."""
    numbers = {number: body.client for number, body in run.bodies.items()}
    client = pl.col("body_a").replace_strict(numbers, default=0, return_dtype=pl.Int64)
    return contacts.sort("step", client, maintain_order=True)


def _part(run: Seen, pairs: Pairing, point: Mapping[str, int]) -> tuple[str | None, int | None]:
    """Return label and link of a part that touches; PyBullet hides those of btRigidBodies."""
    for side in "ab":
        number, link = point[f"body_{side}"], point[f"link_{side}"]
        if number in run.bodies:
            return run.bodies[number].label, link
        if number in pairs.bodies:
            return pairs.label(number), link
    return None, None
