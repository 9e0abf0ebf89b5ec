"""The rule `off-target` for motors: joints that rest off target, lag behind, or are too slow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics import quantities
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.joints import REST_STEPS, DrivenJoints
from drop_physics.explain.targets import flips, rings_with
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure
from drop_physics.rules.by_name import called
from drop_physics.rules.held_off import (
    MORE_FORCE,
    Cause,
    Kind,
    at_its_limit,
    cause_of,
    give_at_least,
)
from drop_physics.rules.joint import holds_off
from drop_physics.rules.rows import Noted, Remedy, SayingRow, Worst
from drop_physics.rules.rule import Match, Sized, joint_rule, target_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.target_columns import StandingTargets, TargetColumns
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
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import VELOCITY


@target_rule("off-target", "asked")
def rests_off(targets: TargetColumns, telemetry: DrivenJoints, seen: Seen) -> Match | None:
    """A joint came to rest away from its target."""
    # One that began in an earlier piece has been noted, and may have been reached since.
    rests = targets.stood.resting & (targets.off >= targets.least)
    where = (targets.stood.row >= 0) & (
        rests | (targets.stood.first < targets.driven.steps.steps[0])
    )
    if targets.late or not where.any():
        return None
    lasts = {**targets.numbers, "cause": _causes(targets, where & rests, telemetry, seen)}
    keys = np.column_stack([targets.keys, targets.stood.first])
    return Match(where, targets.off, lasts=lasts, keys=keys)


def _causes(
    targets: TargetColumns, which: Flags, telemetry: DrivenJoints, seen: Seen
) -> NDArray[Any]:
    """Return the cause of the worst missed target; None for all others."""
    causes, rows = np.full(len(which), None, object), np.flatnonzero(which)
    for at in rows[[int(targets.off[rows].argmax())]] if len(rows) else ():
        stood = targets.stood.only(np.array([at]))
        held = telemetry.holding(targets.driven, int(stood.row[0]))
        causes[at] = cause_of(seen, targets.driven, held, stood)
    return causes


@rests_off.counts
def _(cause: Float64, share: Float64) -> Sized:
    asked = [each is not None and each.level == "asked" for each in cause]
    said = np.array([each is not None for each in cause], np.bool_)
    return Sized(np.where(said, share, 0.0), graver=np.array(asked, np.bool_))


@rests_off.notes
def _missed(
    standing: StandingTargets,
    keys: list[int],
    stood: list[int],
    joint: str,
    joints: int,
    body: str,
    cause: Cause,
) -> Noted:
    """Describe a missed target, and why it was missed."""
    says = Message(
        "{joint}{more} misses a target of {target:at} by {off:gap} at step {last}: {why}"
    )
    going = standing.going.get((keys[0], keys[1]))
    if going is not None and going.stood.first[0] == stood[0]:
        says = Message("{joint}{more} ends {off:gap} off its target of {target:at}: {why}")
    cure = cause.cure
    if cure is not None and cure.name in ("force", "gains"):
        cure = replace(cure, target=joint if joints == 1 else body)
    return {
        "says": says,
        "why": cause.why,
        "kind": cause.kind,
        "last": stood[1],
        "need": cause.need,
        "advice": cause.advice,
        "cure": cure,
        "level": None if cause.level == "asked" else cause.level,
        "proposed": cause.proposed,
        "other": cause.other,
    }


MISSED = SayingRow(effect="off", share="share")
rests_off.rows(MISSED)


def _replaced(targets: TargetColumns) -> Flags:
    """Flag the targets that ended while their joint was still moving.

    Targets set in earlier steps are left out, and targets that press a joint against a body.
    """
    return np.asarray(
        ~targets.stood.left & ~targets.stood.resting & ~targets.pressed & (targets.stood.row >= 0)
    )


def _followed(targets: TargetColumns, which: Flags) -> Match | None:
    """Return targets that ended while their joint moved; the sizes are the remaining gaps."""
    moved = _replaced(targets) & (targets.ended | targets.ends_run)
    if not moved.any():
        return None
    size = np.where(which & (targets.off > targets.least) & ~targets.reached, targets.off, 0.0)
    sums = {"moved": targets.ended & moved, "limited": targets.stood.at_limit}
    numbers = {**targets.numbers, "left": np.abs(targets.stood.lawful) / targets.least}
    return Match(moved, size, numbers, sums=sums, counts=targets.stood.steps)


def _lawful(targets: TargetColumns) -> Flags:
    """Flag the gaps that agree with the motor's control law, shape (m,)."""
    off = np.abs(targets.stood.gap - targets.stood.lawful)
    return np.asarray(off <= np.maximum(LAWFUL_GAP * targets.off, targets.least * LAWFUL_GAP))


@target_rule("off-target", "note")
def follows_behind(targets: TargetColumns) -> Match | None:
    """Targets change before their joint arrives: its gains leave a share of each change."""
    asked = targets.driven.asked.target_velocity[targets.stood.row, targets.stood.k]
    match = _followed(targets, _lawful(targets) & (targets.stood.at_limit == 0) & (asked == 0))
    # The first change may be a jump that no other is like.
    sums = {"behind": match.size, "behinds": match.size > 0} if match else {}
    return match and replace(match, sums={**match.sums, **sums})


@follows_behind.notes
def _(
    moved: int, behind: float, behinds: int, count: int, kp: float, off: float, share: float
) -> Noted | None:
    if moved < CROSSINGS or 2 * behinds < moved:
        return None  # what jumps is not followed, and some changes are not the average
    mean, every = behind / max(moved, behinds), round(count / moved)
    often = Message("every {n} steps", n=every) if every > 1 else Message("with every step")
    return {"mean": mean, "often": often, "left": (1 - kp) ** every, "part": share * mean / off}


follows_behind.rows(
    SayingRow(
        says=Message(
            "{joint} follows its targets {mean:gap} behind on average: they change {often}, and "
            "{left:.2g} of each change remains"
        ),
        advice=Message("{call} leaves nothing of it"),
        cure=Remedy("gains", "joint", 1.0, given={"positionGain": 1.0}),
        proposed=True,
        effect="mean",
        share="part",
    )
)


@target_rule("off-target", "asked")
def falls_behind(targets: TargetColumns, telemetry: DrivenJoints, seen: Seen) -> Match | None:
    """Targets change before their joint arrives, with its motor at its limit."""
    weak = ~_lawful(targets) & ~np.isnan(targets.stood.lawful) & (targets.stood.at_limit > 0)
    match = _followed(targets, weak)
    if match is None:
        return None
    stopped = targets.stopped & (match.size > 0)
    # When a piece is over, what stopped a joint in it can no longer be asked.
    size = np.where(stopped & targets.late, 0.0, match.size)
    against = _causes(targets, stopped & ~np.array(targets.late), telemetry, seen)
    return replace(match, size=size, numbers={**match.numbers, "against": against})


@falls_behind.counts
def _(limited: Float64, count: Int64, moved: Float64, size: Float64, share: Float64) -> Float64:
    often = (limited > LIMITED_OFTEN * count) & (moved > 0)
    return np.where(often & (size > 0), share, 0.0)


@falls_behind.notes
def _(
    worst: Worst,
    standing: StandingTargets,
    keys: list[int],
    stood: list[int],
    against: Cause | None,
    limit: float,
    effort: str,
    limited: int,
    count: int,
    left: float,
) -> Noted | None:
    going = standing.going.get((keys[0], keys[1]))
    there = going is not None and going.at_rest[0] and going.off[0] <= going.least
    if there and stood[1] - stood[0] + 1 < REST_STEPS:
        return None  # one of many on the way to that at which it stands
    if against is not None:  # it may press on purpose
        return called(_missed, worst, cause=replace(against, level="note"))
    weak = at_its_limit(quantities.effort(limit, effort), limited, count)
    cause = called(_takes_more, worst, weak=weak)
    if cause is None and left > 1:  # whatever its force, its gain leaves a gap
        cause = Cause("at its limit", weak, Message("give each target more steps"))
    found = cause or Cause("at its limit", weak, MORE_FORCE, Cure("force"), proposed=True)
    return called(_missed, worst, cause=found)


falls_behind.rows(MISSED)


def _takes_more(
    telemetry: DrivenJoints, keys: list[int], weak: Message, limit: float, effort: str, force: float
) -> Cause | None:
    """Return the cause for a motion that requires more torque than the motor's limit; else None."""
    efforts = telemetry.efforts[keys[0]]
    takes = efforts.on_the_way[keys[1]]
    if not takes > limit:
        return None
    need = quantities.effort(takes, effort)
    kind: Kind = "too weak on the way"
    why = Message("{weak}; the way to its target takes up to {need}", weak=weak, need=need)
    if abs(efforts.needs_at_target[keys[1]]) == takes:
        kind = "too weak at the target"
        why = Message("{weak}; the target takes {need}", weak=weak, need=need)
    return give_at_least(kind, why, takes, effort, force)


@target_rule("off-target", "asked")
def still_moves(targets: TargetColumns) -> Match | None:
    """The run ends before a joint reaches its only target."""
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
def _(alone: Flags, moved: Float64, share: Float64) -> Float64:
    return np.where(alone & (moved == 0), share, 0.0)


@still_moves.notes
def _(
    worst: Worst,
    joint: str,
    unit: str,
    effort: str,
    time_s: Callable[[int], float],
    kp: float,
    lawful: float,
    rate: float,
    away: bool,
    most: float,
    off: float,
    stood: list[int],
    at_limit: int,
    steps_stood: int,
    limit: float,
    stiffness: float,
    as_usual: float,
) -> Noted | None:
    if kp < SMALL_GAIN and abs(lawful - 1) < LAWFUL_GAP:
        why = Message(
            "a positionGain of {kp:.4g} is the share of the gap that a step closes", kp=kp
        )
        return called(_missed, worst, cause=Cause("a small gain", why))
    if not rate:
        return None  # it trembles where it is
    speed = f"{abs(rate):.2g} {unit}/s"
    kind: Kind = "still moving"
    why = Message("it still moves at {rate}", rate=speed)
    if away:
        kind, why = "moving away", Message("it moves away at {rate}", rate=speed)
    elif abs(rate) > (1 - LAWFUL_GAP) * most:
        kind = "a speed limit"
        why = Message("its maxVelocity is {rate}", rate=f"{most:.3g} {unit}/s")
    if at_limit <= HALF_THE_STEPS * steps_stood:
        # What would be there in as much time again may just have been given too little.
        soon = not away and abs(rate) * (time_s(stood[1]) - time_s(stood[0] - 1)) > off
        meant = soon or kind == "a speed limit"  # which a call sets
        return called(_missed, worst, cause=Cause(kind, why, level="note" if meant else "asked"))
    weak = at_its_limit(quantities.effort(limit, effort), at_limit, steps_stood)
    if (cause := called(_takes_more, worst, weak=weak)) is not None:
        return called(_missed, worst, cause=cause)
    kind, why = "moving at its limit", Message("{why}, and {weak}", why=why, weak=weak)
    if away and stiffness > STIFF * USUAL_STIFFNESS_HZ:
        softer = float(f"{as_usual:.2g}")
        advice = Message(
            "a gain is a share of the gap per step, and at this timestep {kp:.4g} is {times:.3g} "
            "times as stiff as 0.1 at 1/240 s: {call}"
        )
        cure = Cure("gains", joint, softer, given={"positionGain": softer})
        found = called(_missed, worst, cause=Cause(kind, why, advice, cure, proposed=True))
        return found | {"reason": "gain-per-step", "times": stiffness / USUAL_STIFFNESS_HZ}
    advice = MORE_FORCE if away else Message("give it more force, or each target more steps")
    return called(_missed, worst, cause=Cause(kind, why, advice, Cure("force"), proposed=True))


still_moves.rows(MISSED)


# -- too-slow -------------------------------------------------------------------------------------


@joint_rule("off-target", "asked")
def too_slow(joints: JointColumns, telemetry: DrivenJoints, seen: Seen) -> Match:
    """A velocity motor is at its limit for most of the time of its target.

    A joint that grips a body, or presses against its stop, is meant to stand still; a target far
    beyond any possible rate is a way to command a constant force.
    """
    goal = joints.target_velocity
    told = (joints.mode == VELOCITY) & (joints.asked.impulse > 0) & (goal != 0)
    told &= np.abs(goal) < joints.steps.law.velocity_limit
    weak = told & joints.at_limit & ~flips(joints.driven)  # else that is motor-gain's
    takes = np.full_like(goal, np.nan)
    for k in np.flatnonzero(weak.any(axis=0)).tolist():
        row, way = int(np.flatnonzero(told[:, k])[-1]), np.sign(goal[:, k])
        if weak[row, k]:
            held, on = telemetry.holding(joints.driven, row), float(way[row])
            weak[:, k] &= held.stops[k] * on >= 0 and not holds_off(seen, held, k, -on)
            takes[:, k] = held.needs[k] * on
    step = np.broadcast_to(joints.step[:, None], goal.shape).astype(np.float64)
    lasts = {"weak": weak, "rate": joints.rate, "goal": goal, "takes": takes}
    lasts |= {"limit": joints.limit, "short": takes > joints.limit}
    return Match(told, step, sums={"told": told * 1}, lasts=lasts, counts=weak * 1)


@too_slow.counts
def _(weak: Flags, rate: Float64, goal: Float64, count: Int64, told: Float64) -> Float64:
    slow = weak & (rate / goal < SLOW)
    return np.where(slow & (count > HALF_THE_STEPS * told), count * 1.0, 0.0)


@too_slow.notes
def _(
    joint: str,
    joints: int,
    unit: str,
    effort: str,
    rate: float,
    goal: float,
    takes: float,
    short: bool,
    limit: float,
    count: int,
    told: int,
) -> Noted:
    weak, slow = at_its_limit(quantities.effort(limit, effort), count, told), abs(goal - rate)
    found: Noted = {"weak": weak, "unit": f"{unit}/s", "slow": slow, "part": slow / abs(goal)}
    if short:
        here = quantities.effort(takes, effort)
        found["weak"] = Message("{weak}; holding it here takes {here}", weak=weak, here=here)
        # Holding is the least of it: what turns takes more where it is heavier, and gets faster.
        found["advice"], found["cure"] = MORE_FORCE, Cure("force", joint if joints == 1 else None)
    return found


too_slow.rows(
    SayingRow(
        says=Message("{joint}{more} ends at {rate:.2g} {unit}, its target is {goal:.3g}: {weak}"),
        effect="slow",
        share="part",
    )
)
