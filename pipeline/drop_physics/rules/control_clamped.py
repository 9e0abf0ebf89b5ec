"""`target-clamped`, `not-taken` of an actuator: it takes another control than it is given, or none.

What it is sent to lies outside of its range of control, or the model has actuation switched off.
"""

from __future__ import annotations

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.engines import MUJOCOS, NO_ACTUATION, is_off
from drop_physics.rules.joint import units
from drop_physics.rules.rule import Match, Said, Worst, actuator_rule
from drop_physics.rules.tables import ActuatorColumns
from drop_physics.rules.thresholds import BEYOND_RANGE, COASTS_STEPS
from drop_physics.trace.acts import Act

SENT = "position", "velocity"
"""The kinds of actuators that are sent somewhere; of others a range is how strong they are."""


@actuator_rule("target-clamped", "asked", least_count=COASTS_STEPS, engines=MUJOCOS)
def control_clamped(actuators: ActuatorColumns) -> Match:
    """An actuator that is sent beyond its ctrlrange is sent to the end of it."""
    low, high, given = actuators.lower, actuators.upper, actuators.given
    share = np.maximum(low - given, given - high) / (high - low)
    sent = np.array([each.kind in SENT for each in actuators.actuators])
    return Match(sent & (share > BEYOND_RANGE), share, {"given": given, "low": low, "high": high})


@control_clamped.says
def _(worst: Worst) -> Said:
    actuator, joint = worst.actuator, worst.joint
    unit = next((units(each)[0] for each in worst.subject.joints if each.name == joint), "")
    return Said(
        message=Message(
            "{actuator} is sent to {given:.4g} in {steps}, and its ctrlrange is {low:.4g} "
            "to {high:.4g}: it takes the end of that"
        ),
        values={"actuator": actuator.name, "kind": actuator.kind},
        cure=Cure(
            "ctrlrange",
            actuator.name,
            None,
            Message(
                'send it within that, or ctrlrange="…" of the <{kind}> around {given:.4g}; '
                "ctrl is in radians and metres, whatever the angles of the file"
            ),
        ),
        effect=Effect(worst.size * (worst.high - worst.low), unit)
        if unit and actuator.kind == "position"
        else None,
        site=worst.scene.only_site(Act.SET_CONTROL),
    )


@actuator_rule("not-taken", "asked", reason="no-effect", engines=MUJOCOS)
def switched_off(actuators: ActuatorColumns) -> Match | None:
    """An actuator is given something, and a flag of the model keeps all of them from acting."""
    if not is_off(actuators.scene.seen, actuators.client, NO_ACTUATION):
        return None
    return Match(actuators.given != 0, np.abs(actuators.given))


@switched_off.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "{name} is given up to {size:.4g}, and no actuator acts: a flag of the model switches "
            "actuation off"
        ),
        values={"name": worst.actuator.name},
        advice=Message('without <flag actuation="disable"/> of <option>'),
        share=1.0,
        site=worst.scene.only_site(Act.SET_CONTROL),
    )
