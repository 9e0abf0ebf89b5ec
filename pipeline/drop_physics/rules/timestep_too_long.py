"""Steps in which a body moves further than it is thick, or a robot's motors overshoot."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.steps import BodySteps
from drop_physics.fields import fraction
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.engines import ANY, MUJOCO
from drop_physics.rules.rule import Match, Said, Worst, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import ENDLESS_M, LONG_S
from drop_physics.trace.history import PYBULLET

LATE = {
    PYBULLET: Message(
        "{body} is simulated in steps of {step_s} s: position motors close a share of "
        "their gap per step, and contacts act only at its end"
    ),
    MUJOCO: Message(
        "{body} is simulated in steps of {step_s} s: MuJoCo makes no contact and no limit stiffer "
        "than a time constant of 2 steps, and actuators act on a state as old as a step"
    ),
}
"""What long steps do, by engine."""
FINER = 4.0
"""By what a timestep is divided to be tried."""


@body_rule("timestep-too-long", "model", engines=ANY)
def far(bodies: BodyColumns) -> Match | None:
    """Before or after a contact, a body moves further in a step than it is thick."""
    if bodies.law.tree.size != 6:
        return None
    step_s = bodies.reported.timestep_s / bodies.substeps
    way_m = np.linalg.norm(bodies.after.velocity[:, 3:6], axis=1) * step_s
    thick_m = bodies.of_each(_thick_m)
    meets = [bodies.scene.touching(bodies.body, bodies.step + later) for later in (0, 1)]
    far = (thick_m > 0) & (thick_m < ENDLESS_M) & (way_m > thick_m) & np.isfinite(way_m)
    return Match(far & np.any(meets, axis=0), way_m, {"step": step_s, "thick": thick_m})


@far.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "{body} moves {way:.3g} m in a step of {step_s} s, and is {thick:.3g} m thick: it "
            "can pass through others, or overlap them before contact acts"
        ),
        values={"way": worst.size, "step_s": fraction(worst.step)},
        cure=Cure("timestep", value=FINER),
        effect=Effect(worst.size, "m"),
        share=worst.size / worst.thick,
    )


@body_rule("timestep-too-long", "model", engines=ANY)
def long(bodies: BodyColumns) -> Match:
    """A robot's steps are so long that motors and contacts act late."""
    step_s = bodies.reported.timestep_s / bodies.substeps
    jointed = bodies.of_each(lambda each: len(each.body.joints) > 0)
    return Match((step_s > LONG_S) & jointed, step_s)


@long.says
def _(worst: Worst) -> Said:
    return Said(
        message=LATE[worst.engine],
        values={"step_s": fraction(worst.size)},
        cure=Cure("timestep", value=FINER),
        effect=Effect(worst.size, "s"),
        share=worst.size / LONG_S,
    )


def _thick_m(steps: BodySteps) -> float:
    """Return the shortest edge of a single body's box; 0 of one with joints."""
    box = np.array(steps.body.bounds_m[:6])
    return 0.0 if steps.body.joints or len(box) < 6 else float((box[3:] - box[:3]).min())
