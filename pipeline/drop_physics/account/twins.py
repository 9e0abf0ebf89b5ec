"""Rows for drives that are weaker than the same joint's drive on the robot's other side."""

from __future__ import annotations

from collections.abc import Hashable, Iterator

import numpy as np

from drop_physics.account.asked import Axis
from drop_physics.account.rows import AccountRow
from drop_physics.account.series import JointSeries
from drop_physics.account.subjects import MeasuredBody
from drop_physics.messages import Message
from drop_physics.quantities import quantity
from drop_physics.trace.events import Joint

SAME = 1e-6
"""Relative difference of limits that counts as rounding."""


def weaker_rows(
    subject: MeasuredBody, axes: list[Axis], series: JointSeries
) -> Iterator[AccountRow]:
    """Yield a row for each joint with a lower force limit than its mirror-image joint.

    Twins are joints of one kind at the same depth of the tree, with the same range to either side,
    that carry the same masses: left and right, the legs of a quadruped.
    """
    twins: dict[Hashable, list[Axis]] = {}
    for axis in axes:
        twins.setdefault(_place(subject, axis.joint), []).append(axis)
    for its in twins.values():
        limits = {axis: _limit(series, axis) for axis in its}
        known = {axis: limit for axis, limit in limits.items() if limit is not None}
        if len(known) < 2:
            continue
        strongest = max(known, key=lambda axis: known[axis])
        for axis, limit in known.items():
            share = float(series.at_limit[:, axis.joint_rate].mean())
            if limit < known[strongest] * (1 - SAME) and share:
                yield _row(subject, axis, limit, strongest, known[strongest], share)


def _row(
    subject: MeasuredBody,
    axis: Axis,
    limit: float,
    strongest: Axis,
    most: float,
    share: float,
) -> AccountRow:
    return AccountRow(
        kind="given",
        joint=axis.name,
        told=Message(
            "its drive has a limit of {limit}, that of {other} one of {most}; it is there in "
            "{share:.0%} of the steps",
            limit=quantity(limit, axis.force_unit),
            other=strongest.name,
            most=quantity(most, axis.force_unit),
            share=share,
        ),
        asked=most,
        got=limit,
        gap=limit - most,
        unit=axis.force_unit,
        at_limit=True,
        salience=10.0 * (1 - limit / most),
        subject=subject.body,
        group=("weaker", subject.kind, limit),
    )


def _limit(series: JointSeries, axis: Axis) -> float | None:
    """Return the largest force limit of a joint's drive; None if it has none.

    The limit of the engine's own motor is left out, since no call has set it.
    """
    limit = series.limit[:, axis.joint_rate]
    own = series.controlled("default", "unknown", "off")[:, axis.joint_rate]
    known = limit[np.isfinite(limit) & (limit > 0) & ~own]
    return float(known.max()) if len(known) else None


def _place(subject: MeasuredBody, joint: Joint) -> Hashable:
    """Return a key that is equal for corresponding joints of a robot's limbs."""
    body, masses_kg = subject.body, subject.tree.masses_kg
    parents = [each.parent for each in body.joints]
    depth, link = 0, joint.link
    while link >= 0:
        depth, link = depth + 1, parents[link]
    carried_kg = masses_kg[1:].copy()
    for child in range(len(parents) - 1, -1, -1):
        if parents[child] >= 0:
            carried_kg[parents[child]] += carried_kg[child]
    reach = sorted(abs(each) for each in joint.limits)
    numbers = (masses_kg[1 + joint.link], carried_kg[joint.link], *reach)
    return (joint.kind, depth, *(round(float(each), 6) for each in numbers))
