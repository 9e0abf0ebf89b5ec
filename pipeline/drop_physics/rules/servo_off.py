"""The rule `off-target` for position servos: the force that is missing at rest.

A position actuator of gain kp gives kp (ctrl - gear q), times its gear, and has no integral part.
At rest the forces on its joint sum to zero, so the gap follows from the torque that the pose takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from drop_physics import quantities
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.causes import TENDON_LIMIT
from drop_physics.explain.joints import REST_STEPS
from drop_physics.explain.targets import SETTLED, SETTLED_STEPS
from drop_physics.messages import Message
from drop_physics.rules.answer import Scene
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import (
    OFF,
    RADIANS,
    actuators_on,
    aimed,
    as_degrees,
    is_degrees,
)
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    EACH_STEP,
    HOLDS,
    IN_DEGREES_RAD,
    OWN_SHARE,
    SAGS,
    SPRING_SHARE,
)
from drop_physics.trace.events import Actuator, Body

CLAMPED = "joint force range"
"""The term by which a joint's own force range reduces the force of its actuators."""
SPARE = 1.3
"""Safety factor of a recommended actuator limit over the required force."""
TRIES = 5
"""Number of a joint's largest gaps in a chunk whose causes are examined."""


@dataclass(frozen=True)
class ServoGap:
    """A joint off its servo's target, with the reason; forces on the joint [N] or [N m]."""

    reason: str
    gap: float
    goal: float
    rests: bool
    since: int
    """The first step in which its target is in effect."""
    own: float
    """The force of the joint's actuator."""
    needs: float
    """Forces required to hold the targets; nan where undetermined."""
    clamp: float
    stop: float
    range: tuple[float, float]
    back: float
    """The force of the joint's own spring."""
    rubs: float
    """The force of the joint's dry friction."""
    weighs: float
    """The force of gravity on the joint."""
    kp: float
    gear: float
    fixed: bool
    """Whether the base of its body is fixed."""

    @property
    def bound(self) -> float:
        """The end of the actuator's range that limits the force towards the target."""
        return self.range[self.gap < 0]

    def stiffer(self, near: float) -> float:
        """Return the gain that would reduce the gap to the given one, rounded up."""
        needs = (self.fixed and np.isfinite(self.needs) and self.needs) or self.own
        least = abs(needs) / (near * self.gear**2)
        digit = 10.0 ** (math.floor(math.log10(least)) - 1)  # the last that is written
        return float(f"{math.ceil(least / digit) * digit:g}")


@joint_rule("off-target", "asked", consecutive=True, engines=MUJOCOS)
def off_its_servo(joints: JointColumns) -> Match | None:
    """A joint rests, or ends, off the target of its only actuator, which acts as a spring.

    For each joint, it is the greatest gap of the piece with a sure cause.
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
def _(held: Float64, last: Int64, size: Float64, ends: Int64) -> Float64:
    rests = np.array([each.rests for each in held], np.bool_)
    return np.where(rests | (last == ends), size, 0.0)


@off_its_servo.notes
def _(
    scene: Scene,
    subject: Body,
    joint: str,
    joints: int,
    unit: str,
    effort: str,
    last: int,
    held: ServoGap,
) -> Noted:
    near, finite = OFF[unit], bool(np.isfinite(held.needs))
    # Controls that are never written are 0, too: nobody may have asked for that.
    level = None if scene.actuators.sends(subject) else "model"
    if held.reason == "spring" and abs(held.gap) < SAGS * near:
        level = "note"
    degrees = math.degrees(held.bound)
    takes = Message("; the target takes {n}", n=quantities.effort(held.needs, effort))
    return {
        **vars(held),
        **as_degrees(held.goal),
        "says": RESTS if held.rests else ENDS,
        "level": level,
        "stood": (held.since, last),
        "whole": subject.label if joints > 1 else joint,
        "bound": held.bound,
        "degrees": degrees,
        "turned": unit == "rad" and held.gear == 1 and is_degrees(held.goal, *held.range),
        "in_radians_there": unit == "rad" and abs(held.goal) <= abs(degrees) <= IN_DEGREES_RAD,
        "through": held.own + held.clamp,
        "takes": takes if finite else "",
        "enough": abs(held.needs) * SPARE if finite else None,
        "known": held.fixed and finite,
        "near": near,
        "stiffer": held.stiffer(near) if held.reason == "spring" else None,
        "leaves": LEAVES if held.fixed and finite else STIFFER,
        "hangs": held.fixed and -held.weighs * math.copysign(1.0, held.own) > HOLDS * abs(held.own),
        "sprung": held.back * held.own < 0 and abs(held.back) > abs(held.own) / 2,
    }


ENDS = Message("{joint}{more} ends {gap:gap} off its target of {goal:at}: {why}")
RESTS = Message("{joint}{more} rests {gap:gap} off its target of {goal:at}: {why}")
LEAVES = Message('kp="{stiffer:g}" of the <position> leaves {near:gap}')
STIFFER = Message('kp="{stiffer:g}" of the <position>')
RANGE = SayingRow(
    why=Message("its range ends at {bound:at}, and the limit pushes it back with {stop:N}"),
    reason="range",
)
SPRING = SayingRow(
    why=Message(
        "a position actuator is a spring, and kp = {kp:.4g} gives the {own:N} that this pose takes "
        "only when it is so far off"
    ),
    cure=Remedy("gains", "whole", "stiffer"),
    reason="spring",
)
off_its_servo.rows(
    SayingRow(
        when=lambda reason, turned: reason == "range" and turned,
        advice=RADIANS,
    ).like(RANGE),
    SayingRow(
        when=lambda reason, in_radians_there: reason == "range" and in_radians_there,
        advice=Message(
            '<compiler angle="radian"/>, if the {degrees:.3g} of the file is in radians'
        ),
        cure=Remedy("limits", "whole"),
    ).like(RANGE),
    SayingRow(when=lambda reason: reason == "range", cure=Remedy("limits", "whole")).like(RANGE),
    SayingRow(
        when=lambda reason: reason == "actuatorfrcrange",
        why=Message(
            "the joint's actuatorfrcrange lets {through:N} of the {own:N} through that its "
            "actuator would give{takes}"
        ),
        cure=Remedy("forcerange", "whole", "enough", form="joint"),
        reason="actuatorfrcrange",
    ),
    SayingRow(
        when=lambda reason: reason == "forcerange",
        why=Message("its actuator is at its forcerange of {own:N}{takes}"),
        cure=Remedy("forcerange", "whole", "enough", given={"gear": "gear"}),
        reason="forcerange",
    ),
    SayingRow(
        when=lambda reason: reason == "friction-loss",
        why=Message(
            "its actuator gives {own:N} there, and the frictionloss of the joint holds {rubs:N} "
            "of it"
        ),
        cure=Remedy("friction", "whole", 0.0, form="loss"),
        reason="friction-loss",
    ),
    SayingRow(
        when=lambda sprung: sprung,
        why=Message(
            "a position actuator is a spring of kp = {kp:.4g}, and that of the joint itself pulls "
            "it back with {back:N}"
        ),
        advice=Message('stiffness="0" of the <joint>, or its springref at the target'),
        reason="spring",
    ),
    # Written later, gravcomp counts only in a model that was compiled with some.
    SayingRow(
        when=lambda hangs: hangs,
        advice=Message(
            '{leaves}, or gravcomp="1" of its <body>s, as the model is compiled, takes gravity off '
            "it"
        ),
    ).like(SPRING),
    SayingRow(when=lambda known: known, advice=LEAVES).like(SPRING),
    SayingRow(advice=STIFFER).like(SPRING),
    like=SayingRow(effect="gap"),
)


def _last_of_targets(joints: JointColumns) -> Flags:
    """Flag the last steps before a target changes, or a call sets the joint."""
    new = (np.diff(joints.asked.began, axis=0) != 0) | joints.steps.put[1:, None]
    return np.append(new, np.ones((1, new.shape[1]), np.bool_), axis=0)


def _rests(joints: JointColumns) -> Flags:
    """Flag the last steps of targets in which joints hardly move."""
    stood = joints.step[:, None] - joints.asked.began
    rests = np.asarray(joints.resting & (stood >= REST_STEPS))
    for row, k in np.argwhere(_last_of_targets(joints) & ~rests & (stood >= SETTLED_STEPS)):
        path = joints.after[max(row + 1 - SETTLED_STEPS, 0) : row + 1, k]
        rests[row, k] = len(path) == SETTLED_STEPS and np.ptp(path) < SETTLED
    return rests


def _cause(joints: JointColumns, row: int, k: int, *, rests: bool) -> ServoGap | None:
    """Return why a joint is off its target; None if that is uncertain."""
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
    """Return a joint's position actuator, if no other actuator acts on the joint."""
    its = actuators_on(joints.driven.body, k)
    return its[0] if len(its) == 1 and its[0].kind == "position" and its[0].gear else None
