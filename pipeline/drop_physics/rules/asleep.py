"""The rule about bodies that the engine has put to sleep."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags
from drop_physics.explain.cause_names import cause_in_words
from drop_physics.messages import Message
from drop_physics.rules.rows import Noted, SayingRow
from drop_physics.rules.rule import Match, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import UNBALANCED


@body_rule("asleep", "asked")
def asleep(bodies: BodyColumns) -> Match | None:
    """A body's state stays the same bit for bit, although the forces on it are not balanced."""
    if "asleep" not in bodies.whole.config.reasons or not bodies.terms:
        return None
    unbalanced = bodies.whole.unexplained > UNBALANCED
    left = np.abs(bodies.whole.remainder)
    rows = np.arange(len(left)), left.argmax(axis=1)
    terms = np.array([*bodies.terms], object)
    largest = np.argmax([np.abs(term[rows]) for term in bodies.terms.values()], axis=0)
    return Match(
        _still(bodies) & (unbalanced | _off_target(bodies)),
        left[rows] / bodies.reported.timestep_s,
        {"term": np.where(unbalanced, terms[largest], "motors")},
    )


@asleep.notes
def _(term: str) -> Noted:
    return {"term": cause_in_words(term)}


asleep.rows(
    SayingRow(
        says=Message(
            "{body} sleeps: from step {first:,} on it does not move in {steps} in which "
            "the sum of what acts on it is not zero, most of all {term}"
        ),
        advice=Message(
            "wake it and keep it awake: p.changeDynamics(body, -1, "
            "activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)"
        ),
        effect="size",
        unit="N or N m",
        share=1.0,
    )
)


def _off_target(bodies: BodyColumns) -> Flags:
    """Flag the steps in which a motor misses its target, and could exert more force."""
    off = np.zeros(len(bodies.step), np.bool_)
    for driven in bodies.driven:
        joints = bodies.joints(driven)
        far = np.abs(joints.after - joints.target) > joints.at_target
        free = ~joints.at_limit & (joints.limit > 0) & (joints.asked.kp > 0)
        off[joints.steps.rows] |= (far & free).any(axis=1)
    return off


def _still(bodies: BodyColumns) -> Flags:
    """Flag the steps that leave the state bitwise unchanged, unless a call sets it."""
    moves = bodies.put | bodies.after.velocity.any(axis=1)
    for name in ("position_m", "orientation", "joints", "velocity"):
        moves |= (getattr(bodies.before, name) != getattr(bodies.after, name)).any(axis=1)
    return np.asarray(~moves)
