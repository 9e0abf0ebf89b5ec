"""`constraint-apart`, `weak-constraint`: constraints that do not meet, and those that yield."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.arguments import number, site_of
from drop_physics.rules.body_properties import strained_by
from drop_physics.rules.constraint_columns import ConstraintColumns
from drop_physics.rules.held_off import to_spare
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, constraint_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.thresholds import (
    APART,
    APART_RAD,
    CLOSES,
    CLOSES_STEPS,
    PULLED_BACK,
    RATIO,
    STILL_M_S,
)

Float64 = NDArray[np.float64]

FULL = 1 - 1e-6
NO_GAP_M = 1e-6


def _other(worst: Worst) -> str | None:
    """Return the other body of a constraint; None if it is the world."""
    parent = worst.held.bodies[0]
    is_world = parent < 0 or parent == worst.subject.number
    return None if is_world else worst.scene.body(parent).label


@constraint_rule("constraint-apart", "asked")
def constraint_apart(joined: ConstraintColumns) -> Match | None:
    """A constraint pulls or turns together what was apart when it began; a spring does not."""
    soon = joined.step < joined.began + CLOSES_STEPS
    if not soon.any() or joined.last.moved >= joined.began:
        return None
    rows = np.flatnonzero(soon)
    (gap_m, angle_rad), after = joined.apart_at_first(), joined.apart_after(rows)
    n = len(rows)
    firsts = {"gap": np.full(n, gap_m), "angle": np.full(n, angle_rad)}
    numbers = {"part": np.full(n, joined.part_m), "held": np.full(n, joined.last, object)}
    most = {"closed": -after[0], "turned": -after[1]}
    return Match(rows, np.zeros(n), numbers, most=most, firsts=firsts, keys=joined.keys[rows])


@constraint_apart.counts
def _(runs: Runs, _: Scene) -> Float64:
    pulled = (runs.gap > APART * runs.part) & (-runs.closed < CLOSES * runs.gap)
    turned = (runs.angle > APART_RAD) & (-runs.turned < CLOSES * runs.angle)
    return np.where(pulled, runs.gap / runs.part, np.where(turned, runs.angle, 0.0))


@constraint_apart.says
def _(worst: Worst) -> Said:
    gap, angle = Effect(worst.gap, "m"), Effect(worst.angle, "rad")
    pulled = gap.value > APART * worst.part and -worst.closed < CLOSES * gap.value
    message = Message(
        "{body} is joined to {other} in frames that are turned by {angle:.2g} rad, which the "
        "constraint turns back"
    )
    if pulled:
        message = Message(
            "{body} is joined to {other} at points that are {gap:.3g} m apart, which the "
            "constraint pulls together"
        )
    return Said(
        message=message,
        values={"other": _other(worst) or Message("the world")},
        other=_other(worst),
        cure=Cure("constraint-frames") if pulled else Cure("constraint-frames", form="turned"),
        effect=gap if pulled else angle,
        share=gap.value / worst.part if pulled else angle.value,
        site=site_of(worst.held.made),
    )


@constraint_rule("weak-constraint", "asked")
def weak_constraint(joined: ConstraintColumns) -> Match:
    """Where a constraint ends, it is at its limit, or the solver has used up its iterations."""
    n, held = len(joined.step), joined.last
    limit_n = joined.of_held(lambda held: held.limit_n_s) / joined.timestep_s
    at_limit = np.abs(joined.forces_n).max(axis=1) >= limit_n * FULL
    rows = np.arange(max(n - CLOSES_STEPS - 1, 0), n)
    points_m = joined.tail("points", joined.points_m(rows), CLOSES_STEPS + 1)
    strained = joined.tail("at limit", at_limit[rows], CLOSES_STEPS)
    gap_m = np.linalg.norm(points_m[:, 0] - points_m[:, 1], axis=1)
    moved_m = np.linalg.norm(points_m[-1] - points_m[0], axis=1)
    # A spring swings, and what is being pulled back needs time.
    still = (moved_m < STILL_M_S * CLOSES_STEPS * joined.timestep_s[-1]).any()
    dragged = joined.step[-1] - held.moved <= CLOSES_STEPS
    stays = gap_m[-1] >= gap_m[0] * PULLED_BACK and gap_m[-1] > NO_GAP_M
    stays &= len(gap_m) > CLOSES_STEPS and (still or dragged)
    leans = joined.tail("touches", np.isin(joined.step, _touched(joined))[rows], CLOSES_STEPS + 1)
    lasts = {"gap": gap_m[-1], "limit": limit_n[-1], "weight": _weight_n(joined)}
    lasts |= {"part": joined.part_m, "strained": strained.all()}
    # What is dragged may lag with any force, and what it leans on may hold it off.
    lasts |= {"stays": stays, "hangs": not (dragged or leans.any())}
    numbers = {name: np.full(n, each) for name, each in lasts.items()}
    numbers["held"] = np.full(n, held, object)
    since = joined.step > joined.of_held(lambda held: held.limited_since)
    step = joined.step.astype(np.float64)
    most = {"swings": np.full(n, _swings_m_s(joined))}
    return Match(np.ones(n, np.bool_), step, numbers, sums={"full": at_limit & since}, most=most)


def _touched(joined: ConstraintColumns) -> NDArray[np.int64]:
    """Return the steps in which a contact of one of its bodies may hold it off."""
    pairs, numbers = joined.scene.touches.pairs, [each.number for each in joined.bodies]
    return np.asarray(pairs.step[np.isin(pairs.body, numbers).any(axis=1)])


def _weight_n(joined: ConstraintColumns) -> float:
    """Return the held weight along its main axis; 0 if other supports share it."""
    scene, moving = joined.scene, [each for each in joined.bodies if each.base_moves]
    if len(moving) != 1 or not scene.constraints.is_only_one_on(moving[0].number):
        return 0.0
    weights_n = [
        np.abs(steps.law.tree.masses_kg.sum() * steps.reported.gravity_m_s2[-1]).max()
        for _, steps in scene.intervals(moving[0].number)
    ]
    return float(weights_n[-1]) if weights_n else 0.0


def _swings_m_s(joined: ConstraintColumns) -> float:
    """Return the speed at which the held body turns or moves across gravity, which adds load."""
    fastest = [0.0]
    for body in joined.bodies:
        for _, steps in joined.scene.intervals(body.number) if body.base_moves else ():
            if steps.law.tree.fixed:  # as long as it has no mass
                continue
            acts = steps.steps >= joined.began
            velocity, g = steps.after.velocity[acts], steps.reported.gravity_m_s2[acts]
            down = g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-300)
            along = np.sum(velocity[:, 3:6] * down, axis=1, keepdims=True)
            turns = np.delete(velocity, np.s_[3:6], axis=1) * joined.part_m
            across = np.hstack((turns, velocity[:, 3:6] - along * down))
            fastest.append(float(np.abs(across).max(initial=0)))
    return float(np.nanmax(fastest))


def _ratio(scene: Scene, client: int) -> float:
    """Return the solver's largest ratio of masses, without constraints that a call moved."""
    held = scene.constraints.of_client(client)
    numbers = {number for each in held for number in each.bodies if number >= 0}
    still = all(each.moved == each.made.at.step for each in held)
    return strained_by(scene.seen, [scene.body(each) for each in numbers]) if still else 0.0


@weak_constraint.counts
def _(runs: Runs, _: Scene) -> Float64:
    return np.where(runs.stays, runs.gap / runs.part, 0.0)


@weak_constraint.says
def _(worst: Worst) -> Said | None:
    held, limit_n, weight_n = worst.held, worst.limit, worst.weight
    ratio = _ratio(worst.scene, worst.subject.client)
    if worst.strained:
        why = Message(
            "that is at its limit of {limit:.3g} N along an axis in {count:,} steps",
            limit=limit_n,
            count=worst.full,
        )
        advice: Message | None = Message("give it more: p.changeConstraint(…, maxForce=…)")
        cure = Cure("constraint-force")
        if weight_n > limit_n:
            why = Message("{why}, and the weight is {weight:.3g} N", why=why, weight=weight_n)
            if worst.swings < STILL_M_S:  # else its weight is not all that pulls
                cure = Cure("constraint-force", value=float(to_spare(weight_n)))
                advice = Message("give it more: {call}")
            if held.limited is not None and number(held.limited, "maxForce") > weight_n:
                advice, cure = None, Cure("timestep-first")
    elif worst.hangs and ratio >= RATIO and worst.gap > APART * worst.part:
        why = Message(
            "of what constraints join, one is {ratio:.4g} times as heavy as another, and the "
            "solver uses up its iterations",
            ratio=ratio,
        )
        advice = None
        cure = Cure("solver", value=500.0)
    else:
        return None
    message = Message("{body} is {gap:.3g} m from where its constraint to {other} wants it: {why}")
    return Said(
        message=message,
        values={"other": _other(worst) or Message("the world"), "why": why},
        other=_other(worst),
        advice=advice,
        cure=cure,
        proposed=not worst.hangs,
        effect=Effect(worst.gap, "m"),
        share=worst.gap / worst.part,
        site=site_of(held.limited or held.made),
    )
