"""`off-target` of motors: joints rest off their targets, lag behind them, or turn too slowly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.joints import REST_STEPS
from drop_physics.explain.targets import flips, rings_with
from drop_physics.messages import Message
from drop_physics.quantities import effort, place
from drop_physics.quantities import gap as distance
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.held_off import (
    MORE_FORCE,
    Cause,
    at_limit,
    cause_of,
    give_at_least,
    holds_off,
)
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, Sized, joint_rule, target_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.target_columns import TargetColumns
from drop_physics.rules.thresholds import (
    CROSSINGS,
    HALF_THE_STEPS,
    LAWFUL_GAP,
    LIMITED_OFTEN,
    SLOW,
    SMALL_GAIN,
    STIFF,
    USUAL_STIFFNESS_HZ,
)
from drop_physics.trace.motors import VELOCITY


@target_rule("off-target", "asked")
def rests_off(targets: TargetColumns) -> Match | None:
    """A target stood until its joint was at rest, and the joint is not there."""
    # One that began in an earlier piece has been noted, and may have been reached since.
    rests = targets.stood.resting & (targets.off >= targets.least)
    where = (targets.stood.row >= 0) & (
        rests | (targets.stood.first < targets.driven.steps.steps[0])
    )
    if targets.late or not where.any():
        return None
    lasts = {**targets.numbers, "cause": _causes(targets, where & rests)}
    keys = np.column_stack([targets.keys, targets.stood.first])
    return Match(where, targets.off, lasts=lasts, keys=keys)


def _causes(targets: TargetColumns, which: Flags) -> NDArray[Any]:
    """Return the cause of the worst missed target; None for the others."""
    causes, rows = np.full(len(which), None, object), np.flatnonzero(which)
    for at in rows[[int(targets.off[rows].argmax())]] if len(rows) else ():
        stood = targets.stood.only(np.array([at]))
        held = targets.scene.joints.holding(targets.driven, int(stood.row[0]))
        causes[at] = cause_of(targets.scene, targets.driven, held, stood)
    return causes


@rests_off.counts
def _(runs: Runs, _: Scene) -> Sized:
    asked = [each is not None and each.level == "asked" for each in runs.cause]
    said = np.array([each is not None for each in runs.cause], np.bool_)
    return Sized(np.where(said, runs.share, 0.0), graver=np.array(asked, np.bool_))


@rests_off.says
def _(worst: Worst) -> Said:
    return _missed(worst, worst.cause)


def _missed(worst: Worst, cause: Cause) -> Said:
    """Return the sentence on a missed target, with its cause."""
    message = Message("{joint}{more} misses a target of {target} by {off} at step {last}: {why}")
    going = worst.scene.going.get(tuple(worst.noted.keys[0, :2].tolist()))
    if going is not None and going.stood.first[0] == worst.stood[0]:
        message = Message("{joint}{more} ends {off} off its target of {target}: {why}")
    off, target = distance(worst.off, worst.unit), place(worst.target, worst.unit)
    cure = cause.cure
    if cure is not None and cure.name in ("force", "gains"):
        cure = replace(cure, target=worst.joint if worst.joints == 1 else worst.body)
    return Said(
        message=message,
        values={
            "off": off,
            "target": target,
            "why": cause.why,
            "last": worst.stood[1],
            "need": cause.need,
        },
        advice=cause.advice,
        cure=cure,
        level=None if cause.level == "asked" else cause.level,
        proposed=cause.proposed,
        other=cause.other,
        effect=Effect(worst.off, worst.unit),
        share=worst.share,
    )


def _replaced(targets: TargetColumns) -> Flags:
    """Flag the targets that were replaced, or cut off, while their joint moved.

    Without targets left from before, and those that press joints onto something.
    """
    return np.asarray(
        ~targets.stood.left & ~targets.stood.resting & ~targets.pressed & (targets.stood.row >= 0)
    )


def _followed(targets: TargetColumns, which: Flags) -> Match | None:
    """Return the gaps of some targets, among all that were replaced while their joint moved."""
    moved = _replaced(targets) & (targets.ended | targets.ends_run)
    if not moved.any():
        return None
    size = np.where(which & (targets.off > targets.least) & ~targets.reached, targets.off, 0.0)
    sums = {"moved": targets.ended & moved, "limited": targets.stood.at_limit}
    numbers = {**targets.numbers, "left": np.abs(targets.stood.lawful) / targets.least}
    return Match(moved, size, numbers, sums=sums, counts=targets.stood.steps)


def _lawful(targets: TargetColumns) -> Flags:
    """Flag the gaps that the motor's law leaves."""
    off = np.abs(targets.stood.gap - targets.stood.lawful)
    return np.asarray(off <= np.maximum(LAWFUL_GAP * targets.off, targets.least * LAWFUL_GAP))


@target_rule("off-target", "note")
def follows_behind(targets: TargetColumns) -> Match | None:
    """Targets change before their joint is there: its gains leave a share of each change."""
    asked = targets.driven.asked.target_velocity[targets.stood.row, targets.stood.k]
    match = _followed(targets, _lawful(targets) & (targets.stood.at_limit == 0) & (asked == 0))
    # The first change may be a jump that no other is like.
    sums = {"behind": match.size, "behinds": match.size > 0} if match else {}
    return match and replace(match, sums={**match.sums, **sums})


@follows_behind.says
def _(worst: Worst) -> Said | None:
    if worst.moved < CROSSINGS:
        return None  # what jumps is not followed
    behind = worst.behind / worst.behinds
    every = round(worst.count / worst.moved)
    often = Message("every {n} steps", n=every) if every > 1 else Message("with every step")
    return Said(
        message=Message(
            "{joint} follows its targets {off} behind on average: they change {often}, and "
            "{left:.2g} of each change remains"
        ),
        values={
            "off": distance(behind, worst.unit),
            "often": often,
            "left": (1 - worst.kp) ** every,
        },
        advice=Message("{call} leaves nothing of it"),
        cure=Cure("gains", worst.joint, 1.0, given={"positionGain": 1.0}),
        proposed=True,
        effect=Effect(behind, worst.unit),
        share=worst.share * behind / worst.off,
    )


@target_rule("off-target", "asked")
def falls_behind(targets: TargetColumns) -> Match | None:
    """Targets change before their joint is there, and its motor is at its limit."""
    weak = ~_lawful(targets) & ~np.isnan(targets.stood.lawful) & (targets.stood.at_limit > 0)
    match = _followed(targets, weak)
    if match is None:
        return None
    stopped = targets.stopped & (match.size > 0)
    # When a piece is over, what stopped a joint in it can no longer be asked.
    size = np.where(stopped & targets.late, 0.0, match.size)
    against = _causes(targets, stopped & ~np.array(targets.late))
    return replace(match, size=size, numbers={**match.numbers, "against": against})


@falls_behind.counts
def _(runs: Runs, _: Scene) -> Float64:
    often = (runs.limited > LIMITED_OFTEN * runs.count) & (runs.moved > 0)
    return np.where(often & (runs.size > 0), runs.share, 0.0)


@falls_behind.says
def _(worst: Worst) -> Said | None:
    first, last = worst.stood
    going = worst.scene.going.get(tuple(worst.noted.keys[0, :2].tolist()))
    there = going is not None and going.at_rest[0] and going.off[0] <= going.least
    if there and last - first + 1 < REST_STEPS:
        return None  # one of many on the way to that at which it stands
    if worst.against is not None:  # it may press on purpose
        return _missed(worst, replace(worst.against, level="note"))
    weak = at_limit(effort(worst.limit, worst.effort), worst.limited, worst.count)
    if (cause := _takes_more(worst, weak)) is not None:
        return _missed(worst, cause)
    if worst.left > 1:  # whatever its force, its gain leaves a gap
        return _missed(worst, Cause(weak, Message("give each target more steps")))
    return _missed(worst, Cause(weak, MORE_FORCE, Cure("force"), proposed=True))


def _takes_more(worst: Worst, weak: Message) -> Cause | None:
    """Return the effort needed on the way to a target, if it exceeds the motor's limit."""
    number, k = worst.noted.keys[0, :2].tolist()
    takes = worst.scene.joints.on_the_way(number, k)
    if not takes > worst.limit:
        return None
    need, there = effort(takes, worst.effort), worst.scene.joints.rows(number)[k]
    why = Message("{weak}; the way to its target takes up to {need}", weak=weak, need=need)
    if abs(there.needs_at_target or 0.0) == takes:
        why = Message("{weak}; the target takes {need}", weak=weak, need=need)
    return give_at_least(why, takes, worst.effort, worst.force)


@target_rule("off-target", "asked")
def still_moves(targets: TargetColumns) -> Match | None:
    """The run ends before a joint is at the only target that it had."""
    moved = _replaced(targets)
    where = (moved & targets.ended) | targets.ends_run
    if not where.any():
        return None
    # What rings is motor-gain's; at rest in a run too short to tell it may be there or not.
    alone = moved & targets.ends_run & ~targets.at_rest & (targets.off >= targets.least)
    alone &= ~rings_with(targets.stood.kp, targets.kd)
    lasts = {**targets.numbers, "alone": alone, "lawful": targets.stood.lawful / targets.stood.gap}
    lasts |= {"away": targets.stood.rate * targets.stood.gap > 0}
    lasts |= {
        "rate": targets.stood.rate,
        "at_limit": targets.stood.at_limit,
        "steps_stood": targets.stood.steps,
    }
    timestep_s = targets.driven.steps.reported.timestep_s[-1]
    lasts["stiffness"] = targets.stood.kp / timestep_s
    lasts["as_usual"] = np.full(len(where), USUAL_STIFFNESS_HZ * timestep_s)
    return Match(where, targets.off, lasts=lasts, sums={"moved": targets.ended & moved})


@still_moves.counts
def _(runs: Runs, _: Scene) -> Float64:
    return np.where(runs.alone & (runs.moved == 0), runs.share, 0.0)


@still_moves.says
def _(worst: Worst) -> Said | None:
    if worst.kp < SMALL_GAIN and abs(worst.lawful - 1) < LAWFUL_GAP:
        why = Message(
            "a positionGain of {kp:.4g} is the share of the gap that a step closes", kp=worst.kp
        )
        return _missed(worst, Cause(why))
    if not worst.rate:
        return None  # it trembles where it is
    rate = f"{abs(worst.rate):.2g} {worst.unit}/s"
    why = Message("it still moves at {rate}", rate=rate)
    if worst.away:
        why = Message("it moves away at {rate}", rate=rate)
    elif abs(worst.rate) > (1 - LAWFUL_GAP) * worst.most:
        why = Message("its maxVelocity is {rate}", rate=f"{worst.most:.3g} {worst.unit}/s")
    if worst.at_limit <= HALF_THE_STEPS * worst.steps_stood:
        # What would be there in as much time again may just have been given too little.
        time_s = worst.time_s(worst.stood[1]) - worst.time_s(worst.stood[0] - 1)
        soon = not worst.away and abs(worst.rate) * time_s > worst.off
        return _missed(worst, Cause(why, level="note" if soon else "asked"))
    weak = at_limit(effort(worst.limit, worst.effort), worst.at_limit, worst.steps_stood)
    if (cause := _takes_more(worst, weak)) is not None:
        return _missed(worst, cause)
    why = Message("{why}, and {weak}", why=why, weak=weak)
    if worst.away and worst.stiffness > STIFF * USUAL_STIFFNESS_HZ:
        softer = float(f"{worst.as_usual:.2g}")
        advice = Message(
            "a gain is a share of the gap per step, and at this timestep {kp:.4g} is {times:.3g} "
            "times as stiff as 0.1 at 1/240 s: {call}"
        )
        cure = Cure("gains", worst.joint, softer, given={"positionGain": softer})
        said = _missed(worst, Cause(why, advice, cure))
        values = {"kp": worst.kp, "times": worst.stiffness / USUAL_STIFFNESS_HZ}
        values = {**said.values, **values}
        return replace(said, values=values, reason="gain-per-step", proposed=True)
    advice = MORE_FORCE
    if not worst.away:
        advice = Message("give it more force, or each target more steps")
    return _missed(worst, Cause(why, advice, Cure("force"), proposed=True))


# -- too-slow -------------------------------------------------------------------------------------


@joint_rule("off-target", "asked")
def too_slow(joints: JointColumns) -> Match:
    """A velocity motor is at its limit, most of the time that its target stood.

    What grips something, or presses its stop, is to stand still; and a target beyond every rate
    stands for a constant force.
    """
    goal = joints.target_velocity
    told = (joints.mode == VELOCITY) & (joints.asked.impulse > 0) & (goal != 0)
    told &= np.abs(goal) < joints.steps.law.velocity_limit
    weak = told & joints.at_limit & ~flips(joints.driven)  # else that is motor-gain's
    takes = np.full_like(goal, np.nan)
    for k in np.flatnonzero(weak.any(axis=0)).tolist():
        row, way = int(np.flatnonzero(told[:, k])[-1]), np.sign(goal[:, k])
        if weak[row, k]:
            held, on = joints.scene.joints.holding(joints.driven, row), float(way[row])
            weak[:, k] &= held.stops[k] * on >= 0 and not holds_off(joints.scene, held, k, -on)
            takes[:, k] = held.needs[k] * on
    step = np.broadcast_to(joints.step[:, None], goal.shape).astype(np.float64)
    lasts = {"weak": weak, "rate": joints.rate, "goal": goal, "takes": takes}
    lasts |= {"limit": joints.limit}
    return Match(told, step, sums={"told": told * 1}, lasts=lasts, counts=weak * 1)


@too_slow.counts
def _(runs: Runs, _: Scene) -> Float64:
    slow = runs.weak & (runs.rate / runs.goal < SLOW)
    return np.where(slow & (runs.count > HALF_THE_STEPS * runs.told), runs.count * 1.0, 0.0)


@too_slow.says
def _(worst: Worst) -> Said:
    rate, goal, unit, takes = worst.rate, worst.goal, f"{worst.unit}/s", worst.takes
    why = at_limit(effort(worst.limit, worst.effort), worst.count, worst.told)
    advice = cure = None
    if takes > worst.limit:
        here = effort(takes, worst.effort)
        why = Message("{weak}; holding it here takes {here}", weak=why, here=here)
        # Holding is the least of it: what turns takes more where it is heavier, and gets faster.
        advice = MORE_FORCE
        cure = Cure("force", worst.joint if worst.joints == 1 else None)
    message = Message("{joint}{more} ends at {rate:.2g} {unit}, its target is {target:.3g}: {weak}")
    return Said(
        message=message,
        values={"unit": unit, "target": goal, "weak": why},
        advice=advice,
        cure=cure,
        effect=Effect(abs(goal - rate), unit),
        share=abs(goal - rate) / abs(goal),
    )
