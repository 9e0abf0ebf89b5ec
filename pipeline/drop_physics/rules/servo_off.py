"""The rule `off-target` for position servos: the force that is missing at rest.

A position actuator of gain kp gives kp (ctrl - gear q), times its gear, and has no integral part.
At rest the forces on its joint sum to zero, so the gap follows from the torque that the pose
requires.
"""

from __future__ import annotations

import math

import numpy as np

from drop_physics import quantities
from drop_physics.account.balance import CONTACTS, DRIVE, JointBalance
from drop_physics.account.rows import AccountRow
from drop_physics.arrays import Flags, Float64
from drop_physics.explain.actuators import ActuatorTable
from drop_physics.explain.causes import TENDON_LIMIT
from drop_physics.explain.joints import REST_STEPS
from drop_physics.messages import Message
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import (
    AT_TARGET,
    RADIANS,
    SPARE,
    actuators_on,
    as_degrees,
    is_degrees,
    link_of,
)
from drop_physics.rules.joint_damping import alone
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, actuator_rule, joint_rule, row_rule
from drop_physics.rules.tables import ActuatorColumns, JointColumns
from drop_physics.rules.thresholds import (
    AT_TARGET_RAD,
    COASTS_RAD_S,
    COASTS_STEPS,
    EACH_STEP,
    HOLDS,
    IN_DEGREES_RAD,
    OWN_SHARE,
    SAGS,
    SLOW,
    SPRING_SHARE,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Actuator, Body
from drop_physics.trace.history import Seen

CLAMPED, RUBS, DAMPS = "joint force range", "friction loss", "joint damping"
"""The terms for a joint's own force range, its dry friction, and its damping."""
HELD, MOST = ("contact", "constraint"), 0.5
"""HELD: causes that may hold a joint on purpose; MOST: share of the drive's force above which a
cause accounts for most of that force."""


@row_rule("off-target", "asked", engines=MUJOCOS)
def off_its_servo(row: AccountRow) -> bool:
    """A joint rests, or ends, off the target of its only actuator, which acts as a spring."""
    return row.cause == "position"


@off_its_servo.counts
def _(subject: Body, unit: str, balance: JointBalance) -> float:
    size = 1.0 if unit == "rad" else size_m(subject)
    return abs(balance.gap) / size if _holds(subject, balance, unit) else 0.0


@off_its_servo.notes
def _(
    actuators: ActuatorTable,
    seen: Seen,
    subject: Body,
    joint: str,
    joints: int,
    unit: str,
    effort: str,
    balance: JointBalance,
) -> Noted:
    by, servo = _holds(subject, balance, unit), _servo(subject, balance)
    assert servo is not None
    holder = balance.holder
    gap, goal, own, needs = balance.gap, balance.goal, balance.force(DRIVE), balance.needs
    near, back = AT_TARGET[unit], balance.force("spring")
    # Controls that are never written are 0, too: nobody may have asked for that.
    level = None if actuators.sends(subject) else "model"
    if by in HELD or (by == "spring" and abs(gap) < SAGS * near):
        level = "note"
    ends = subject.joints[link_of(subject, balance.joint_rate)].limits
    degrees = math.degrees(bound := ends[gap < 0])
    takes, enough, wanted, known = "", None, own, False
    if needs is not None:
        takes = Message("; the target takes {n}", n=quantities.effort(needs, effort))
        enough, known = abs(needs) * SPARE, balance.fixed
        wanted = (known and needs) or own
    least = abs(wanted) / (near * servo.gear**2)
    digit = 10.0 ** (math.floor(math.log10(least)) - 1) if least else 1.0  # the last written
    return {
        **as_degrees(goal),
        "by": by,
        "gap": gap,
        "goal": goal,
        "own": own,
        "stop": balance.force("stops"),
        "back": back,
        "rubs": balance.force(RUBS),
        "kp": servo.kp,
        "gear": servo.gear,
        "other": None if holder is None or by != "contact" else seen.bodies[holder].label,
        "itself": holder == subject.number,
        "held": balance.held,
        "tendon": (tendon := _tendon(balance)).removeprefix(TENDON_LIMIT),
        "pulled": balance.force(tendon),
        "says": RESTS if balance.rests else ENDS,
        "level": level,
        "whole": subject.label if joints > 1 else joint,
        "bound": bound,
        "degrees": degrees,
        "turned": unit == "rad" and servo.gear == 1 and is_degrees(goal, *ends),
        "in_radians_there": unit == "rad" and abs(goal) <= abs(degrees) <= IN_DEGREES_RAD,
        "through": own + balance.force(CLAMPED),
        "takes": takes,
        "enough": enough,
        "known": known,
        "near": near,
        "stiffer": float(f"{math.ceil(least / digit) * digit:g}"),
        "leaves": LEAVES if known else STIFFER,
        "hangs": balance.fixed and -balance.force("gravity") > HOLDS * own,
        "sprung": back < 0 and abs(back) > own / 2,
    }


def _holds(body: Body, balance: JointBalance, unit: str) -> str | None:
    """Return the kind of cause that holds a joint off its target; None if uncertain."""
    servo, own = _servo(body, balance), balance.force(DRIVE)
    if servo is None or not balance.forces or not abs(balance.gap) > AT_TARGET[unit]:
        return None
    least = OWN_SHARE * abs(own)
    short = balance.at_limit and (balance.needs is None or balance.too_weak)
    if not balance.rests:
        if not balance.ends:
            return None
        if balance.at_limit:
            often = balance.limited >= EACH_STEP and balance.too_weak
            return "forcerange" if often else None
    if -balance.force("stops") > least:
        return "range"
    if abs(balance.force(CLAMPED)) > least:
        return "actuatorfrcrange"
    if balance.at_limit:
        return "forcerange" if short else _held(balance)
    # What touches it may hold it as well, but the ground that it stands on; else it may still be on
    # its way.
    touches = balance.force(CONTACTS) * balance.fixed
    moves = max(abs(balance.force(DAMPS)), abs(balance.left))
    if abs(balance.force("constraints") + touches + balance.force(_tendon(balance))) > least:
        return _held(balance)
    if moves > (HOLDS if balance.rests else SPRING_SHARE) * abs(own):
        return None
    if -balance.force(RUBS) > HOLDS * abs(own):
        return "friction-loss"
    off = abs(own - servo.kp * servo.gear**2 * abs(balance.gap))
    return "spring" if off <= SPRING_SHARE * abs(own) else None


def _held(balance: JointBalance) -> str | None:
    """Return the cause that opposes most of a resting joint's drive: a tendon, contact …."""
    most = -MOST * balance.force(DRIVE)
    if not balance.rests:
        return None
    if balance.force(_tendon(balance)) < most:
        return "tendon"
    if balance.fixed and balance.held < most:
        return "contact"
    return "constraint" if balance.force("constraints") < most else None


def _tendon(balance: JointBalance) -> str:
    """Return the cause of the tendon whose limit opposes most; empty if there is none."""
    limits = [name for name in balance.forces if name.startswith(TENDON_LIMIT)]
    return min(limits, key=balance.force, default="")


def _servo(body: Body, balance: JointBalance) -> Actuator | None:
    """Return a joint's position actuator, if no other actuator acts on the joint."""
    its = actuators_on(body, balance.joint_rate)
    return its[0] if len(its) == 1 and its[0].kind == "position" and its[0].gear else None


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
        when=lambda by, turned: by == "range" and turned,
        advice=RADIANS,
    ).like(RANGE),
    SayingRow(
        when=lambda by, in_radians_there: by == "range" and in_radians_there,
        advice=Message(
            '<compiler angle="radian"/>, if the {degrees:.3g} of the file is in radians'
        ),
        cure=Remedy("limits", "whole"),
    ).like(RANGE),
    SayingRow(when=lambda by: by == "range", cure=Remedy("limits", "whole")).like(RANGE),
    SayingRow(
        when=lambda by: by == "actuatorfrcrange",
        why=Message(
            "the joint's actuatorfrcrange lets {through:N} of the {own:N} through that its "
            "actuator would give{takes}"
        ),
        cure=Remedy("forcerange", "whole", "enough", form="joint"),
        reason="actuatorfrcrange",
    ),
    SayingRow(
        when=lambda by: by == "forcerange",
        why=Message("its actuator is at its forcerange of {own:N}{takes}"),
        cure=Remedy("forcerange", "whole", "enough", given={"gear": "gear"}),
        reason="forcerange",
    ),
    SayingRow(
        when=lambda by: by == "friction-loss",
        why=Message(
            "its actuator gives {own:N} there, and the frictionloss of the joint holds {rubs:N} "
            "of it"
        ),
        cure=Remedy("friction", "whole", 0.0, form="loss"),
        reason="friction-loss",
    ),
    SayingRow(
        when=lambda by, itself: by == "contact" and itself,
        why=Message("its own links meet"),
    ),
    SayingRow(
        when=lambda by: by == "contact",
        why=Message("{other} holds it with {held:N} of the {own:N} that its actuator gives"),
    ),
    SayingRow(
        when=lambda by: by == "tendon",
        why=Message(
            "the limit of the tendon {tendon} holds {pulled:N} of the {own:N} that its actuator "
            "gives"
        ),
    ),
    SayingRow(when=lambda by: by == "constraint", why=Message("a constraint holds it")),
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


@joint_rule(
    "off-target",
    "asked",
    reason="damper",
    least_count=REST_STEPS,
    consecutive=True,
    engines=MUJOCOS,
)
def servo_is_a_damper(joints: JointColumns) -> Match:
    """A joint's only actuator is a damper, which exerts force only off its target velocity."""
    goal, dt = joints.target_velocity, joints.steps.reported.timestep_s[:, None]
    kv, own = np.zeros(goal.shape), joints.torque * dt
    for k in range(goal.shape[1]):
        its = actuators_on(joints.driven.body, k)
        if [each.kind for each in its] == ["velocity"]:
            kv[:, k] = its[0].kv * its[0].gear ** 2
    gap, gains = joints.rate - goal, joints.inertia * np.abs(joints.rate - joints.rate_before)
    where = (np.abs(gap) > np.maximum(SLOW * np.abs(goal), COASTS_RAD_S)) & alone(joints)
    where &= (kv > 0) & ~joints.at_limit & (gains < SPRING_SHARE * np.abs(own))
    numbers = {"rate": joints.rate, "goal": goal, "kv": kv, "force": joints.torque}
    # A damper that takes more than its joint's momentum in a step turns it around.
    return Match(where, np.abs(gap), numbers | {"most": joints.inertia / dt / 2})


@servo_is_a_damper.notes
def _(unit: str, goal: float, force: float, most: float, size: float) -> Noted:
    near = max(SPRING_SHARE * abs(goal), COASTS_RAD_S)
    return {
        "unit": f"{unit}/s",
        "stiffer": float(f"{min(abs(force) / near, most):.2g}"),
        "part": size / max(abs(goal), COASTS_RAD_S),
    }


servo_is_a_damper.rows(
    SayingRow(
        says=Message(
            "{joint}{more} goes at {rate:.3g} {unit} where its target is {goal:.3g}: a velocity "
            "actuator is a damper, and kv = {kv:.4g} gives the {force:N} that this takes only so "
            "far off"
        ),
        cure=Remedy("gains", "joint", "stiffer", form="kv"),
        effect="size",
        share="part",
    )
)
