"""`off-target` of a joint whose actuator is a spring: its missing force at rest.

A position actuator of gain kp gives kp (ctrl - gear q), times its gear, and has no integral part.
At rest the forces on its joint sum to zero, so the gap follows from the torque that the pose takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.causes import TENDON_LIMIT
from drop_physics.explain.joints import REST_STEPS
from drop_physics.explain.targets import SETTLED, SETTLED_STEPS
from drop_physics.messages import Message
from drop_physics.quantities import effort, place
from drop_physics.quantities import gap as distance
from drop_physics.rules.answer import Cure, Effect, Level, Scene, Span
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import OFF, actuators_on, aimed, in_radians, is_degrees
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    EACH_STEP,
    HOLDS,
    IN_DEGREES_RAD,
    OWN_SHARE,
    SAGS,
    SPRING_SHARE,
)
from drop_physics.trace.events import Actuator

CLAMPED = "joint force range"
"""The term that a joint's own range of force takes off its actuators."""
SPARE = 1.3
"""Margin of an actuator's limit over the force that it needs."""
TRIES = 5
"""The greatest gaps of a joint in a piece whose causes are looked for."""


@dataclass(frozen=True)
class ServoGap:
    """A joint off its target, with the cause; forces [N] or [N m] on the joint."""

    reason: str
    gap: float
    goal: float
    rests: bool
    since: int
    """The first step of its target."""
    own: float
    """The force of its actuator."""
    needs: float
    """Forces that hold the targets; nan where undetermined."""
    clamp: float
    stop: float
    range: tuple[float, float]
    back: float
    """The force of its own spring."""
    rubs: float
    """The force of its dry friction."""
    weighs: float
    """The force of gravity on it."""
    kp: float
    gear: float
    fixed: bool
    """Whether the base of its body is."""

    @property
    def bound(self) -> float:
        """The end of its range, short of the target."""
        return self.range[self.gap < 0]


@joint_rule("off-target", "asked", consecutive=True, engines=MUJOCOS)
def off_its_servo(joints: JointColumns) -> Match | None:
    """A joint rests, or ends, off the target of its only actuator, which is a spring.

    Of each joint it is the greatest gap of the piece whose cause is sure.
    """
    gap, rests = joints.after - joints.target, _rests(joints)
    judged = _last_of_targets(joints) & (np.abs(gap) > joints.at_target)
    judged[:-1] &= rests[:-1]
    if not (judged.any() and joints.driven.steps.covered):
        return None
    held = np.full(gap.shape, None, object)
    for k in np.flatnonzero(judged.any(axis=0)).tolist():
        rows = np.flatnonzero(judged[:, k])
        for row in rows[np.argsort(-np.abs(gap[rows, k]))][:TRIES].tolist():
            held[row, k] = _cause(joints, row, k, rests=bool(rests[row, k]))
            if held[row, k] is not None:
                break
    sizes = [1.0 if off == OFF["rad"] else size_m(joints.body) for off in joints.at_target.tolist()]
    return Match(held != np.array(None, object), np.abs(gap) / sizes, {"held": held})


@off_its_servo.counts
def _(runs: Runs, scene: Scene) -> Float64:
    ends = np.array([scene.ends[number] for number in runs.keys[:, 0].tolist()])
    rests = np.array([each.rests for each in runs.held], np.bool_)
    return np.where(rests | (runs.last == ends), runs.size, 0.0)


@off_its_servo.says
def _(worst: Worst) -> Said:
    held: ServoGap = worst.held
    why, cure, advice = WHY[held.reason](worst, held)
    if cure is not None and worst.joints > 1:
        cure = replace(cure, target=worst.body)
    message = Message("{joint}{more} ends {off} off its target of {target}: {why}")
    if held.rests:
        message = Message("{joint}{more} rests {off} off its target of {target}: {why}")
    return Said(
        message=message,
        values={
            "off": distance(held.gap, worst.unit),
            "target": place(held.goal, worst.unit),
            "why": why,
        },
        advice=advice,
        cure=cure,
        reason=held.reason,
        effect=Effect(abs(held.gap), worst.unit),
        level=_level(worst, held),
        steps=Span(held.since, worst.last, worst.last - held.since + 1),
    )


def _level(worst: Worst, held: ServoGap) -> Level | None:
    """Return the level of a gap that is small beside others."""
    if held.reason == "spring" and abs(held.gap) < SAGS * OFF[worst.unit]:
        return "note"
    # Controls that are never written are 0, too: nobody may have asked for that.
    return None if worst.scene.actuators.sends(worst.subject) else "model"


Why = tuple[Message, Cure | None, Message | None]


def _range(worst: Worst, held: ServoGap) -> Why:
    why = Message(
        "its range ends at {limit}, and the limit pushes it back with {force}",
        limit=place(held.bound, worst.unit),
        force=effort(held.stop, worst.effort),
    )
    if worst.unit == "rad" and held.gear == 1 and is_degrees(held.goal, *held.range):
        return why, None, in_radians(held.goal)
    advice, as_degrees = None, math.degrees(held.bound)
    if worst.unit == "rad" and abs(held.goal) <= abs(as_degrees) <= IN_DEGREES_RAD:
        advice = Message(
            '<compiler angle="radian"/>, if the {degrees:.3g} of the file is in radians',
            degrees=as_degrees,
        )
    return why, Cure("limits", worst.joint), advice


def _of_joint(worst: Worst, held: ServoGap) -> Why:
    why = Message(
        "the joint's actuatorfrcrange lets {limit} of the {own} through that its actuator would "
        "give{takes}",
        limit=effort(held.own + held.clamp, worst.effort),
        own=effort(held.own, worst.effort),
        takes=_takes(worst, held),
    )
    return why, Cure("forcerange", worst.joint, _more(held), form="joint"), None


def _of_actuator(worst: Worst, held: ServoGap) -> Why:
    why = Message(
        "its actuator is at its forcerange of {limit}{takes}",
        limit=effort(held.own, worst.effort),
        takes=_takes(worst, held),
    )
    return why, Cure("forcerange", worst.joint, _more(held), given={"gear": held.gear}), None


def _friction_loss(worst: Worst, held: ServoGap) -> Why:
    why = Message(
        "its actuator gives {own} there, and the frictionloss of the joint holds {rubs} of it",
        own=effort(held.own, worst.effort),
        rubs=effort(held.rubs, worst.effort),
    )
    return why, Cure("friction", worst.joint, 0.0, form="loss"), None


def _spring(worst: Worst, held: ServoGap) -> Why:
    near, known = OFF[worst.unit], held.fixed and np.isfinite(held.needs)
    needs = (known and held.needs) or held.own
    least = abs(needs) / (near * held.gear**2)
    digit = 10.0 ** (math.floor(math.log10(least)) - 1)  # the last that is written
    enough = float(f"{math.ceil(least / digit) * digit:g}")
    why = Message(
        "a position actuator is a spring, and kp = {kp:.4g} gives the {force} that this pose takes "
        "only when it is so far off",
        kp=held.kp,
        force=effort(held.own, worst.effort),
    )
    left = distance(near, worst.unit)
    cure: Cure | None = Cure("gains", worst.joint, enough)
    advice = Message('kp="{kp:g}" of the <position>', kp=enough)
    if known:
        advice = Message('kp="{kp:g}" of the <position> leaves {left}', kp=enough, left=left)
    if held.fixed and -held.weighs * math.copysign(1.0, held.own) > HOLDS * abs(held.own):
        # Written later, it counts only in a model that was compiled with some.
        advice = Message(
            '{leaves}, or gravcomp="1" of its <body>s, as the model is compiled, takes gravity off '
            "it",
            leaves=advice,
        )
    if held.back * held.own < 0 and abs(held.back) > abs(held.own) / 2:
        why = Message(
            "a position actuator is a spring of kp = {kp:.4g}, and that of the joint itself pulls "
            "it back with {force}",
            kp=held.kp,
            force=effort(abs(held.back), worst.effort),
        )
        cure = None
        advice = Message('stiffness="0" of the <joint>, or its springref at the target')
    return why, cure, advice


WHY = {
    "range": _range,
    "actuatorfrcrange": _of_joint,
    "forcerange": _of_actuator,
    "friction-loss": _friction_loss,
    "spring": _spring,
}
"""Why, and what changes it, by reason."""


def _takes(worst: Worst, held: ServoGap) -> str:
    takes = Message("; the target takes {n}", n=effort(held.needs, worst.effort))
    return takes if np.isfinite(held.needs) else ""


def _more(held: ServoGap) -> float | None:
    return abs(held.needs) * SPARE if np.isfinite(held.needs) else None


def _last_of_targets(joints: JointColumns) -> Flags:
    """Flag the last steps before a target changes, or a call sets the joint."""
    new = (np.diff(joints.asked.began, axis=0) != 0) | joints.steps.put[1:, None]
    return np.append(new, np.ones((1, new.shape[1]), np.bool_), axis=0)


def _rests(joints: JointColumns) -> Flags:
    """Flag the last steps of targets in which joints rest, or hardly move."""
    stood = joints.step[:, None] - joints.asked.began
    rests = np.asarray(joints.resting & (stood >= REST_STEPS))
    for row, k in np.argwhere(_last_of_targets(joints) & ~rests & (stood >= SETTLED_STEPS)):
        path = joints.after[max(row + 1 - SETTLED_STEPS, 0) : row + 1, k]
        rests[row, k] = len(path) == SETTLED_STEPS and np.ptp(path) < SETTLED
    return rests


def _cause(joints: JointColumns, row: int, k: int, *, rests: bool) -> ServoGap | None:
    """Return the cause of a joint's distance from its target; None if that is not sure."""
    driven, steps, actuator = joints.driven, joints.steps, _servo(joints, k)
    if actuator is None or not steps.closes[row]:
        return None
    rate = steps.law.tree.first_rate + k
    forces = {
        name: float(term[row, rate] / steps.reported.timestep_s[row])
        for name, term in steps.terms.items()
    }
    held = joints.scene.joints.holding(driven, row)
    goal, limit = float(joints.target[row, k]), driven.limit[row, k]
    gap = float(joints.after[row, k]) - goal
    found = ServoGap(
        reason="spring",
        gap=gap,
        goal=goal,
        rests=rests,
        since=int(joints.asked.began[row, k]) + 1,
        own=forces.get(f"actuator {actuator.name}", 0.0),
        needs=float(held.at(aimed(driven, row))[k]),
        clamp=forces.get(CLAMPED, 0.0),
        stop=forces["stops"],
        range=(float(joints.lower[row, k]), float(joints.upper[row, k])),
        back=forces.get("spring", 0.0),
        rubs=forces.get("friction loss", 0.0),
        weighs=forces["gravity"],
        kp=actuator.kp,
        gear=actuator.gear,
        fixed=steps.law.tree.fixed,
    )
    least, weak = OWN_SHARE * abs(found.own), replace(found, reason="forcerange")
    short = driven.at_limit[row, k] and not abs(found.needs) <= limit
    if not rests:
        stood = (joints.step >= found.since) & (joints.step <= joints.step[row])
        often = driven.at_limit[stood, k].mean() >= EACH_STEP
        if driven.at_limit[row, k]:
            return weak if short and often and abs(found.needs) > limit else None
    if found.stop * gap > 0 and abs(found.stop) > least:
        return replace(found, reason="range")
    if abs(found.clamp) > least:
        return replace(found, reason="actuatorfrcrange")
    if driven.at_limit[row, k]:
        return weak if short else None  # else something holds it
    # What touches it may hold it as well, but the ground that it stands on; else it may still be on
    # its way.
    others = forces.get("joint damping", 0.0), sum(forces.values())
    tendons = sum(force for name, force in forces.items() if name.startswith(TENDON_LIMIT))
    blocked = abs(forces["constraints"] + forces["contacts"] * found.fixed + tendons) > least
    blocked |= max(map(abs, others)) > (HOLDS if rests else SPRING_SHARE) * abs(found.own)
    if -found.rubs * np.sign(found.own) > HOLDS * abs(found.own) and not blocked:
        return replace(found, reason="friction-loss")
    is_spring = abs(found.own + found.kp * found.gear**2 * gap) <= SPRING_SHARE * abs(found.own)
    return found if is_spring and not blocked else None


def _servo(joints: JointColumns, k: int) -> Actuator | None:
    """Return the position actuator of a joint, if it is the only actuator of it."""
    its = actuators_on(joints.driven.body, k)
    return its[0] if len(its) == 1 and its[0].kind == "position" and its[0].gear else None
