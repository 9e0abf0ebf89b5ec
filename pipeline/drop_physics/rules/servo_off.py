"""`off-target` of a joint whose actuator is a spring: what its force is short of, where it rests.

A position actuator of gain kp gives kp (ctrl - gear q), times its gear, and has no integral part.
At rest the forces on its joint sum to zero, so what the pose takes tells how far off it is.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import REST_STEPS
from drop_physics.explain.targets import SETTLED, SETTLED_STEPS
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene, Span
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import OFF, distance, effort, link_of, place
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import EACH_STEP, HOLDS, OWN_SHARE, SPRING_SHARE
from drop_physics.trace.events import Actuator

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]
Why = Literal["range", "actuatorfrcrange", "forcerange", "spring"]

CLAMPED = "joint force range"
"""The term that a joint's own range of force takes off its actuators."""
SPARE = 1.3
"""What an actuator should have over what it needs."""
TRIES = 5
"""The greatest gaps of a joint in a piece whose causes are looked for."""
NOTED = (
    *("gap", "goal", "rests", "since", "own", "needs", "clamp", "stop", "bound"),
    *("back", "kp", "gear"),
)
"""Numbers that are noted of a gap: forces [N] or [N m] on the joint, and where its range ends."""


@joint_rule("off-target", "asked", reason="range", consecutive=True, engines=MUJOCOS)
def behind_its_range(joints: JointColumns) -> Match | None:
    """A joint rests at the end of its range, which pushes it back from where it is sent."""
    return _off(joints, "range")


@behind_its_range.says
def _(worst: Worst) -> Said:
    why = Message(
        "its range ends at {limit}, and the limit pushes it back with {force}",
        limit=place(worst.bound, worst.unit),
        force=effort(worst.stop, worst.effort),
    )
    advice = Message("range=… of the <joint>, or a target in it")
    return _said(worst, why, Cure("limits", worst.joint, None, advice))


@joint_rule("off-target", "asked", reason="actuatorfrcrange", consecutive=True, engines=MUJOCOS)
def force_range_of_its_joint(joints: JointColumns) -> Match | None:
    """A joint rests off its target, as its actuatorfrcrange takes a part of what it is given."""
    return _off(joints, "actuatorfrcrange")


@force_range_of_its_joint.says
def _(worst: Worst) -> Said:
    why = Message(
        "the joint's actuatorfrcrange lets {limit} of the {own} through that its actuator would "
        "give{takes}",
        limit=effort(worst.own + worst.clamp, worst.effort),
        own=effort(worst.own, worst.effort),
        takes=_takes(worst),
    )
    advice = Message('a larger actuatorfrcrange="…" of the <joint>')
    if np.isfinite(worst.needs):
        advice = Message(
            'actuatorfrcrange="-{n:.2g} {n:.2g}" of the <joint>, or more', n=_more(worst)
        )
    return _said(worst, why, Cure("forcerange", worst.joint, _value(worst), advice, "joint"))


@joint_rule("off-target", "asked", reason="forcerange", consecutive=True, engines=MUJOCOS)
def force_range_of_its_actuator(joints: JointColumns) -> Match | None:
    """A joint is off its target, which takes more than the forcerange of its actuator."""
    return _off(joints, "forcerange")


@force_range_of_its_actuator.says
def _(worst: Worst) -> Said:
    why = Message(
        "its actuator is at its forcerange of {limit}{takes}",
        limit=effort(worst.own, worst.effort),
        takes=_takes(worst),
    )
    advice = Message('a larger forcerange="…" of the <position>')
    if np.isfinite(worst.needs):
        advice = Message(
            'forcerange="-{n:.2g} {n:.2g}" of the <position>, or more',
            n=_more(worst) / abs(worst.gear),
        )
    return _said(worst, why, Cure("forcerange", worst.joint, _value(worst), advice))


@joint_rule("off-target", "asked", reason="spring", consecutive=True, engines=MUJOCOS)
def servo_is_a_spring(joints: JointColumns) -> Match | None:
    """A position actuator is a spring: it gives what a pose takes only off its target."""
    return _off(joints, "spring")


@servo_is_a_spring.says
def _(worst: Worst) -> Said:
    near, needs = OFF[worst.unit], worst.needs if np.isfinite(worst.needs) else worst.own
    enough = abs(needs or worst.own) / (near * worst.gear**2)
    why = Message(
        "a position actuator is a spring, and kp = {kp:.4g} gives the {force} that this pose takes "
        "only when it is so far off",
        kp=worst.kp,
        force=effort(worst.own, worst.effort),
    )
    advice = Message(
        'kp="{kp}" of the <position> leaves {off}, or gravcomp="1" of its bodies takes gravity '
        "off it",
        kp=f"{float(f'{enough:.2g}'):g}",
        off=distance(near, worst.unit),
    )
    if worst.back * worst.own < 0 and abs(worst.back) > abs(worst.own) / 2:
        why = Message(
            "a position actuator is a spring of kp = {kp:.4g}, and that of the joint itself pulls "
            "it back with {force}",
            kp=worst.kp,
            force=effort(abs(worst.back), worst.effort),
        )
        advice = Message(
            'stiffness="0" of the <joint>, its springref at the target, or a kp well above '
            "{kp} of the <position>",
            kp=advice.values["kp"],
        )
    return _said(worst, why, Cure("gains", worst.joint, enough, advice))


SERVO_RULES = (
    *(behind_its_range, force_range_of_its_joint),
    *(force_range_of_its_actuator, servo_is_a_spring),
)


def _sizes(runs: Runs, scene: Scene) -> Float64:
    """Return how far off joints are where they rest, or where the run ends."""
    ends = np.array([scene.ends[number] for number in runs.keys[:, 0].tolist()])
    return np.where((runs.rests > 0) | (runs.last == ends), runs.size, 0.0)


for _rule in SERVO_RULES:
    _rule.counts(_sizes)


def _takes(worst: Worst) -> str:
    needs = worst.needs
    return (
        Message("; the target takes {n}", n=effort(needs, worst.effort)) if needs == needs else ""
    )


def _more(worst: Worst) -> float:
    return abs(float(worst.needs)) * SPARE


def _value(worst: Worst) -> float | None:
    return _more(worst) if np.isfinite(worst.needs) else None


def _said(worst: Worst, why: Message, cure: Cure) -> Said:
    message = Message("{joint}{more} ends {off} off its target of {target}: {why}")
    if worst.rests:
        message = Message("{joint}{more} rests {off} off its target of {target}: {why}")
    since, last = int(worst.since), worst.last
    values = {"off": distance(worst.gap, worst.unit), "target": place(worst.goal, worst.unit)}
    return Said(
        message=message,
        values={**values, "why": why},
        cure=cure,
        effect=Effect(abs(worst.gap), worst.unit),
        steps=Span(since, last, last - since + 1),
    )


def _off(joints: JointColumns, why: Why) -> Match | None:
    """Return where joints are off the targets of their only actuators for a reason.

    Of each joint it is the greatest gap of the piece whose cause is sure.
    """
    gap, rests = joints.after - joints.target, _rests(joints)
    judged = _last_of_targets(joints) & (np.abs(gap) > joints.at_target)
    judged[:-1] &= rests[:-1]
    if not (judged.any() and joints.driven.steps.covered):
        return None
    where = np.zeros(gap.shape, np.bool_)
    numbers = {name: np.full(gap.shape, np.nan) for name in NOTED}
    for k in np.flatnonzero(judged.any(axis=0)).tolist():
        rows = np.flatnonzero(judged[:, k])
        for row in rows[np.argsort(-np.abs(gap[rows, k]))][:TRIES].tolist():
            found = _cause(joints, row, k, rests=bool(rests[row, k]))
            if found is not None:
                if found[0] == why:
                    where[row, k] = True
                    for name, value in zip(NOTED, found[1], strict=True):
                        numbers[name][row, k] = value
                break
    body = joints.driven.body
    sizes = [1.0 if off == OFF["rad"] else size_m(body) for off in joints.at_target.tolist()]
    return Match(where, np.abs(gap) / sizes, numbers)


def _last_of_targets(joints: JointColumns) -> Flags:
    """Return which steps are the last before a target is another, or a call sets the joint."""
    new = (np.diff(joints.asked.began, axis=0) != 0) | joints.steps.put[1:, None]
    return np.append(new, np.ones((1, new.shape[1]), np.bool_), axis=0)


def _rests(joints: JointColumns) -> Flags:
    """Return in which of the last steps of targets joints rest, or hardly move any more."""
    stood = joints.step[:, None] - joints.asked.began
    rests = np.asarray(joints.resting & (stood >= REST_STEPS))
    for row, k in np.argwhere(_last_of_targets(joints) & ~rests & (stood >= SETTLED_STEPS)):
        path = joints.after[max(row + 1 - SETTLED_STEPS, 0) : row + 1, k]
        rests[row, k] = len(path) == SETTLED_STEPS and np.ptp(path) < SETTLED
    return rests


def _cause(
    joints: JointColumns, row: int, k: int, *, rests: bool
) -> tuple[Why, tuple[float, ...]] | None:
    """Return why a joint is off its target, and what is noted of it; None if that is not sure."""
    driven, steps, actuator = joints.driven, joints.steps, _servo(joints, k)
    if actuator is None or not steps.closes[row]:
        return None
    gap, rate = float(joints.after[row, k] - joints.target[row, k]), steps.law.tree.first_rate + k
    forces = {
        name: float(term[row, rate] / steps.reported.timestep_s[row])
        for name, term in steps.terms.items()
    }
    own, clamp = forces.get(f"actuator {actuator.name}", 0.0), forces.get(CLAMPED, 0.0)
    needs, stop = _needs(joints, row, k), forces["stops"]
    bound = joints.upper[row, k] if gap < 0 else joints.lower[row, k]
    first, least, limit = joints.asked.began[row, k] + 1, OWN_SHARE * abs(own), driven.limit[row, k]
    noted = gap, joints.target[row, k], float(rests), first, own, needs, clamp, stop, bound
    numbers = *noted, forces.get("spring", 0.0), actuator.kp, actuator.gear
    if not rests:
        stood = joints.step >= first
        held = driven.at_limit[stood & (joints.step <= joints.step[row]), k]
        short = driven.at_limit[row, k] and held.mean() >= EACH_STEP and abs(needs) > limit
        return ("forcerange", numbers) if short else None
    if stop * gap > 0 and abs(stop) > least:
        return "range", numbers
    if abs(clamp) > least:
        return "actuatorfrcrange", numbers
    if driven.at_limit[row, k]:
        return None if abs(needs) <= limit else ("forcerange", numbers)  # else something holds it
    # What rubs in the joint, or touches it, may hold it as well; else it may still be on its way.
    blocked = abs(forces["contacts"] + forces["constraints"]) > least
    others = (
        forces.get("friction loss", 0.0),
        forces.get("joint damping", 0.0),
        sum(forces.values()),
    )
    blocked |= max(map(abs, others)) > HOLDS * abs(own)
    is_spring = abs(own + actuator.kp * actuator.gear**2 * gap) <= SPRING_SHARE * abs(own)
    return ("spring", numbers) if is_spring and not blocked else None


def _needs(joints: JointColumns, row: int, k: int) -> float:
    """Return what the targets take of a joint's actuator; nan if that is not determined."""
    steps, tree, aims = joints.steps, joints.steps.law.tree, joints.asked.target[row]
    positions = steps.after.joints[row].copy()
    for link, at in enumerate(tree.coordinates):
        rate = tree.rates[link].start - tree.first_rate
        if at.stop - at.start == 1 and np.isfinite(aims[rate]):
            positions[at] = aims[rate]
    return float(joints.scene.joints.holding(joints.driven, row).at(positions)[k])


def _servo(joints: JointColumns, k: int) -> Actuator | None:
    """Return the position actuator of a joint, if it is the only actuator of it."""
    body = joints.driven.body
    name = body.joints[link_of(body, k)].name
    its = [each for each in body.actuators if each.acts_on == "joint" and each.target == name]
    return its[0] if len(its) == 1 and its[0].kind == "position" and its[0].gear else None
