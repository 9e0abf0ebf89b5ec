"""Rows for actuators that drive tendons, sites or ball joints: control, length, force, arms."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.words import answered_range
from drop_physics.explain.actuators import ActuatorRow
from drop_physics.messages import Message, joined
from drop_physics.quantities import number, rounded_off
from drop_physics.trace.events import LENGTH
from drop_physics.trace.history import Seen

MOST_ARMS = 2
"""Maximum number of joints whose moment arms a row shows."""


def transmission_rows(
    subject: MeasuredBody, seen: Seen, actuators: Sequence[ActuatorRow]
) -> Iterator[AccountRow]:
    """Yield a row for each actuator that does not drive just one degree of freedom.

    `actuators` are the table rows of the body's actuators, in the order of `body.actuators`.
    """
    if not subject.lasts(seen):
        return
    lengths = seen.measured(LENGTH, subject.body.client)
    for actuator, row in zip(subject.body.actuators, actuators, strict=True):
        length, asks = lengths.get(row.name), row.kind == "position"
        if length is None or row.given is None or subject.body.rate_of(actuator) is not None:
            continue
        if row.acts_on == "joint" and not asks:  # each axis of a ball has a row of its own
            continue
        template = (
            Message("the length of {target} {given}, got {length} at the end")
            if asks
            else Message("ctrl {given} on {target}, whose length is {length} at the end")
        )
        told = Message(
            template, target=row.target, given=number(row.given), length=number(length.last)
        )
        gap = length.last - row.given
        yield AccountRow(
            kind="asked" if asks else "given",
            actuator=row.name,
            told=told + answered_range(length) + _force(row, length.last),
            asked=row.given,
            got=length.last if asks else None,
            gap=gap if asks else None,
            unit="",
            step=subject.ledger.last,
            salience=abs(gap) / (abs(row.given) + 0.1) if asks else 0.4,
            subject=subject.body,
        )


def _force(row: ActuatorRow, length: float) -> Message:
    """Describe an actuator's force and the joints that it moves; nothing if unknown.

    A moment arm that is rounding error beside the actuator's length is 0.
    """
    if row.force is None:
        return Message("")
    arms = sorted(row.moments.items(), key=lambda each: -abs(each[1]))[:MOST_ARMS]
    told = Message("; force {force}", force=number(row.force))
    if arms:
        each = [
            Message("{arm} on {joint}", arm=number(rounded_off(arm, length)), joint=joint)
            for joint, arm in arms
        ]
        told = told + Message(", with a moment arm of {arms}", arms=joined(", ", each))
    return told
