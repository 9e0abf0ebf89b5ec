"""A row for the controls that a script holds at the end, beside the joints that they act on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.series import JointSeries
from drop_physics.account.subjects import MeasuredBody
from drop_physics.arrays import Float64
from drop_physics.messages import Message, joined
from drop_physics.quantities import number, quantity
from drop_physics.trace.events import Actuator

MOST = 8
"""Maximum number of actuators that are listed."""
HOLDS = 0.5
"""Minimum share of the steps for which the last controls are held."""
SALIENCE = 0.4


def held_controls_rows(
    subject: MeasuredBody, series: JointSeries, controls: Mapping[Actuator, Float64]
) -> Iterator[AccountRow]:
    """Yield the row for a body whose position actuators all hold their last controls for long.

    `controls` has the control of each actuator in n steps, shape (n,).
    """
    body = subject.body
    rates = {actuator: body.rate_of(actuator) for actuator in controls}
    servos = {
        actuator: rate
        for actuator, rate in rates.items()
        if rate is not None and actuator.kind == "position"
    }
    if not 1 < len(controls) <= MOST or len(servos) < len(controls):
        return
    given = np.stack([*controls.values()], axis=1)
    held = (given == given[-1]).all(axis=1)
    if not given[-1].any() or not held[int((1 - HOLDS) * len(held)) :].all():
        return
    units = {
        place.start: "m" if joint.kind == "prismatic" else "rad"
        for joint, place in zip(body.joints, body.rates, strict=True)
    }
    parts = [
        Message(
            "{actuator} {ctrl}, {joint} {position}",
            actuator=actuator.name,
            ctrl=number(float(controls[actuator][-1])),
            joint=actuator.target,
            position=quantity(float(np.round(series.after[-1, rate], 6)), units[rate]),
        )
        for actuator, rate in servos.items()
        if rate in units
    ]
    yield AccountRow(
        kind="given",
        body=body.label,
        told=Message(
            "its actuators' ctrl at the end, in their order, with their joints: {parts}",
            parts=joined("; ", parts),
        ),
        step=int(series.steps[-1]),
        salience=SALIENCE,
        subject=body,
        group=("held controls", subject.kind),
    )
