"""Rules about actuators that apply a different control than the script set, or none.

Reasons are a control beyond the actuator's range, a gear, a model flag that switches actuation off,
and a reset.
"""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.messages import Message
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import RADIANS, as_degrees, is_degrees, units
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, actuator_rule
from drop_physics.rules.tables import ActuatorColumns
from drop_physics.rules.thresholds import (
    AT_TARGET_RAD,
    BEYOND_RANGE,
    CHATTERS,
    COASTS_STEPS,
    EACH_STEP,
    IN_DEGREES_RAD,
    WATCHED,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Actuator, Body
from drop_physics.trace.history import Seen
from drop_physics.trace.switches import NO_ACTUATION, is_off
from drop_physics.trace.writes import written_by

SENT = "position", "velocity"
"""The kinds of actuators whose control is a target."""
RANGE_FREE = "motor", *SENT
"""The kinds of actuators that work without a ctrlrange, unlike dampers and adhesion."""


@actuator_rule("target-clamped", "asked", least_count=COASTS_STEPS, engines=MUJOCOS)
def control_clamped(actuators: ActuatorColumns) -> Match:
    """An actuator's control beyond its ctrlrange is clamped to the end of the range."""
    low, high, given = actuators.lower, actuators.upper, actuators.given
    share = np.maximum(low - given, given - high) / (high - low)
    beyond, sent = share > BEYOND_RANGE, np.zeros(share.shape, np.bool_)
    sent[:] = [actuator.kind in SENT for actuator in actuators.actuators]
    numbers = {"given": given, "low": low, "high": high}
    turned = beyond & (given * actuators.before < 0)
    return Match(beyond, share, numbers, sums={"turned": turned * 1.0}, lasts={"sent": sent})


@control_clamped.counts
def _(count: Int64, sent: Flags, size: Float64, ends: Int64) -> Float64:
    # Of what pushes, a range says how strong it is.
    always = count >= EACH_STEP * ends
    return np.where(sent | always, size, 0.0)


@control_clamped.notes
def _(
    actuator: Actuator,
    joint: str | None,
    subject: Body,
    given: float,
    low: float,
    high: float,
    size: float,
) -> Noted:
    unit = next((units(each)[0] for each in subject.joints if each.name == joint), "")
    placed = actuator.kind == "position"
    return {
        "free": actuator.kind in RANGE_FREE,
        "unit": unit,
        "placed": placed and unit,
        "in_degrees": placed and unit == "rad" and is_degrees(given, low, high),
        "beyond": size * (high - low),
        **as_degrees(given),
    }


SENT_BEYOND = SayingRow(
    says=Message(
        "{name} is sent to {given:.4g} in {steps}, and its ctrlrange is {low:.4g} "
        "to {high:.4g}: it takes the end of that"
    ),
    advice=Message("send it within that, or {call}"),
    cure=Remedy("ctrlrange", "name"),
    site=Act.SET_CONTROL,
)
# What gives more than a motor can may be wrong itself.
GIVEN_BEYOND = SayingRow(
    says=Message(
        "{name} is given up to {given:.4g}, beyond its ctrlrange of {low:.4g} to {high:.4g} in "
        "{steps}: it gives no more than the end of that"
    ),
    level="model",
    proposed=True,
    site=Act.SET_CONTROL,
)
control_clamped.rows(
    SayingRow(when=lambda in_degrees: in_degrees, advice=RADIANS, effect="beyond").like(
        SENT_BEYOND
    ),
    SayingRow(when=lambda placed: placed, effect="beyond").like(SENT_BEYOND),
    SayingRow(when=lambda sent: sent).like(SENT_BEYOND),
    # A greater range would let it overshoot by more.
    SayingRow(
        when=lambda turned, count: turned > CHATTERS * count,
        says=Message(
            "{name} is given up to {given:.4g}, beyond its ctrlrange of {low:.4g} to {high:.4g} in "
            "{steps}, and changes its sign in {turned:,.0f} of them: what computes it overshoots "
            "within a step"
        ),
        advice=Message("a smaller gain, or a shorter timestep"),
    ).like(GIVEN_BEYOND),
    SayingRow(when=lambda free: free, cure=Remedy("ctrlrange", "name")).like(GIVEN_BEYOND),
    SayingRow(advice=Message("give it a ctrl of {low:.4g} to {high:.4g}")).like(GIVEN_BEYOND),
)


@actuator_rule("off-target", "note", reason="gear", least_count=COASTS_STEPS, engines=MUJOCOS)
def divided_by_gear(actuators: ActuatorColumns) -> Match:
    """A position actuator sends its joint to its control divided by its gear."""
    gears = [
        actuator.gear
        if (actuator.kind, actuator.acts_on) == ("position", "joint") and actuator.gear
        else 1.0
        for actuator in actuators.actuators
    ]
    off = np.abs(actuators.given * (1 - 1 / np.array(gears)))
    return Match(off > AT_TARGET_RAD, off, {"given": actuators.given})


@divided_by_gear.notes
def _(actuator: Actuator, given: float) -> Noted:
    return {"gear": actuator.gear, "to": given / actuator.gear}


divided_by_gear.rows(
    SayingRow(
        says=Message(
            "{name} is given {given:.4g} and sends {joint} to {to:.4g}, as its gear is {gear:g}"
        ),
        advice=Message("give it the target times its gear, if the script does not"),
    )
)


@actuator_rule(
    "off-target",
    "note",
    reason="units",
    least_count=COASTS_STEPS,
    consecutive=True,
    engines=MUJOCOS,
)
def sent_by_turns(actuators: ActuatorColumns, seen: Seen) -> Match:
    """A position actuator sends a joint without a range by more than one turn at once."""
    turning = {
        joint.name
        for joint in seen.bodies[actuators.number].joints
        if joint.kind == "revolute" and joint.limits[0] > joint.limits[1]
    }
    least = [
        IN_DEGREES_RAD * abs(actuator.gear)
        if (actuator.kind, actuator.acts_on) == ("position", "joint") and actuator.target in turning
        else np.inf
        for actuator in actuators.actuators
    ]
    given, by = actuators.given, np.abs(actuators.given - actuators.before)
    # What is computed is seldom a whole number that stays, and what is in degrees most often is.
    jumps = (by > np.array(least)) & (given == np.round(given))
    return Match(
        jumps | (by == 0), np.abs(given), {"given": given}, firsts={"jumps": jumps}, begins=jumps
    )


@sent_by_turns.counts
def _(jumps: Flags, size: Float64) -> Float64:
    return np.where(jumps, size, 0.0)


@sent_by_turns.notes
def _(actuator: Actuator, given: float) -> Noted:
    return {"to": given / actuator.gear, **as_degrees(given)}


sent_by_turns.rows(
    SayingRow(
        says=Message("{name} sends {joint} by more than a turn at once, to {to:.4g} rad"),
        advice=RADIANS,
        site=Act.SET_CONTROL,
    )
)


@actuator_rule("not-taken", "asked", reason="no-effect", engines=MUJOCOS)
def switched_off(actuators: ActuatorColumns, seen: Seen) -> Match | None:
    """An actuator has a control, but a flag of the model switches all actuators off."""
    if not is_off(seen, actuators.client, NO_ACTUATION):
        return None
    return Match(actuators.given != 0, np.abs(actuators.given))


switched_off.rows(
    SayingRow(
        says=Message(
            "{name} is given up to {size:.4g}, and no actuator acts: a flag of the model switches "
            "actuation off"
        ),
        advice=Message('without <flag actuation="disable"/> of <option>'),
        share=1.0,
        site=Act.SET_CONTROL,
    )
)


@actuator_rule(
    "reset-leaves",
    "model",
    reason="reset-clears",
    least_count=WATCHED,
    consecutive=True,
    engines=MUJOCOS,
)
def reset_clears(actuators: ActuatorColumns, chunk: StepChunk) -> Match:
    """A reset of the state sets controls to zero, and nothing sets them again.

    An episode that begins with zeros like the previous one is not reported, since the script may
    have written them: a write is visible only if it changes a value.
    """
    given, before = actuators.given, actuators.before.copy()
    cleared, written = np.zeros(given.shape, np.bool_), dict[int, dict[int, float]]()
    kept = actuators.earlier.first_controls
    began = kept.get(actuators.number, given[0])
    resets = {call.at.step for call in chunk.piece.calls.of(Act.RESET_STATE)}
    for call in chunk.piece.calls.of(Act.SET_CONTROL, Act.RESET_STATE) if resets else ():
        if call.client != actuators.client or call.at.step not in resets:
            continue
        row = int(np.searchsorted(actuators.step, call.at.step + 1))
        there = row < len(given) and actuators.step[row] == call.at.step + 1
        rows, wrote = slice(row, row + there), written.setdefault(call.at.step, {})
        if call.act is Act.SET_CONTROL:
            indices, values, _ = written_by(call)
            wrote |= zip(indices.tolist(), values.tolist(), strict=True)
            continue
        for k, actuator in enumerate(actuators.actuators):
            before[rows, k] = wrote.get(actuator.number, before[rows, k])
            cleared[rows, k] = began[k] != 0 or actuator.number in wrote
        began = given[row] if there else began
    kept[actuators.number] = began
    cleared &= (before != 0) & (given == 0)
    return Match(given == 0, np.ones(given.shape), firsts={"was": before * cleared}, begins=cleared)


@reset_clears.counts
def _(was: Float64, size: Float64) -> Float64:
    return np.where(was != 0, size, 0.0)


reset_clears.rows(
    SayingRow(
        says=Message(
            "{name} is given 0 in {steps} after a reset, which clears ctrl: before it was {was:.4g}"
        ),
        cure=Remedy("targets-held", "body", form="reset"),
    )
)
