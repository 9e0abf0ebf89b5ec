"""Why torques move a joint less than they should: its file's joint damping takes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.joint import effort
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import DAMPS_ANY, DAMPS_STEADY, MOVES, SAME_SIGN

OTHERS = ("contacts", "constraints", "rolling", "stops", "clamp", "motors")
"""Where one of these acts on a joint, it is not damping that decides."""


@joint_rule("joint-damping", "model")
def joint_damping(joints: JointColumns) -> Match:
    """`<dynamics damping>` acts on joints that torques drive, and inverse dynamics omits it."""
    damping, applied = joints.steps.law.joint_damping, joints.term("applied")
    # One that a call set is meant.
    told = joints.of_joints(lambda each: each.damping)
    alone = ~np.any([joints.term(name) != 0 for name in OTHERS], axis=0)
    where = alone & (applied != 0) & ~np.isnan(joints.torque_since) & (damping > 0)
    drive = applied + joints.term("gravity")
    driven, taken = np.abs(drive), np.abs(joints.term("joint damping"))
    return Match(
        where & (told == damping),
        taken,
        {"damping": damping},
        {"driven": driven, "net": drive, "taken": taken},
        firsts={"torque_site": joints.torque_site},
        lasts={"inertia": joints.inertia},
    )


@joint_damping.counts
def _(runs: Runs, _: Scene) -> NDArray[np.float64]:
    share = np.where(runs.driven > MOVES * runs.inertia, runs.taken / runs.driven, 0.0)
    steady = np.abs(runs.net) > SAME_SIGN * runs.driven
    return np.where(share > np.where(steady, DAMPS_STEADY, DAMPS_ANY), share, 0.0)


@joint_damping.says
def _(worst: Worst) -> Said:
    unit = f"{worst.effort} s"
    return Said(
        message=Message(
            "{joint} is driven by torques: beyond its weight they give it {given}, and the "
            "joint damping in its file, {damping}, takes {taken} (joints of this robot: "
            "{count})",
            joint=worst.joint,
            count=worst.joints,
            given=effort(worst.driven, unit),
            taken=effort(worst.taken, unit),
            damping=effort(worst.damping, unit + ("/m" if unit == "N s" else "/rad")),
        ),
        advice=Message(
            "p.changeDynamics(body, {link}, jointDamping=0), or give torques that make up "
            "for it: p.calculateInverseDynamics leaves it out"
        ),
        cure=Cure("joint-damping", worst.body, 0.0),
        effect=Effect(worst.taken, unit),
        share=min(worst.taken / worst.driven, 1.0),
        site=worst.scene.site(worst.torque_site),
    )
