"""`constraint-apart`, `weak-constraint`: constraints whose frames do not meet, or that give way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags
from drop_physics.explain.joined import ConstraintVersion
from drop_physics.messages import Message
from drop_physics.rules.answer import Scene
from drop_physics.rules.arguments import number, site_of
from drop_physics.rules.body_properties import strained_by
from drop_physics.rules.constraint_columns import ConstraintColumns
from drop_physics.rules.held_off import to_spare
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, constraint_rule
from drop_physics.rules.thresholds import (
    APART,
    APART_RAD,
    CLOSES,
    CLOSES_STEPS,
    PULLED_BACK,
    RATIO,
    STILL_M_S,
)
from drop_physics.trace.events import Body

Float64 = NDArray[np.float64]

FULL = 1 - 1e-6
NO_GAP_M = 1e-6


def _other(scene: Scene, subject: Body, held: ConstraintVersion) -> dict[str, object]:
    """Return label and name of the other body of a constraint; the label is None for the world."""
    parent = held.bodies[0]
    is_world = parent < 0 or parent == subject.number
    label = None if is_world else scene.body(parent).label
    return {"other": label, "parent": label or Message("the world")}


@constraint_rule("constraint-apart", "asked")
def constraint_apart(joined: ConstraintColumns) -> Match | None:
    """A constraint pulls or turns together bodies that were apart when it began."""
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
def _(gap: Float64, part: Float64, closed: Float64, angle: Float64, turned: Float64) -> Float64:
    pulled = (gap > APART * part) & (-closed < CLOSES * gap)
    swings = (angle > APART_RAD) & (-turned < CLOSES * angle)
    return np.where(pulled, gap / part, np.where(swings, angle, 0.0))


@constraint_apart.notes
def _(
    scene: Scene,
    subject: Body,
    held: ConstraintVersion,
    gap: float,
    angle: float,
    closed: float,
    part: float,
) -> Noted:
    pulled = gap > APART * part and -closed < CLOSES * gap
    share = gap / part if pulled else angle
    made = {"pulled": pulled, "share": share, "made": site_of(held.made)}
    return {**_other(scene, subject, held), **made}


constraint_apart.rows(
    SayingRow(
        when=lambda pulled: pulled,
        says=Message(
            "{body} is joined to {parent} at points that are {gap:.3g} m apart, which the "
            "constraint pulls together"
        ),
        cure=Remedy("constraint-frames"),
        effect="gap",
    ),
    SayingRow(
        says=Message(
            "{body} is joined to {parent} in frames that are turned by {angle:.2g} rad, which the "
            "constraint turns back"
        ),
        cure=Remedy("constraint-frames", form="turned"),
        effect="angle",
        unit="rad",
    ),
    like=SayingRow(share="share", site="made"),
)


@constraint_rule("weak-constraint", "asked")
def weak_constraint(joined: ConstraintColumns) -> Match:
    """A constraint does not close: it is at its limit, or the solver uses all its iterations."""
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
    numbers = {name: np.full(n, last) for name, last in lasts.items()}
    numbers["held"] = np.full(n, held, object)
    since = joined.step > joined.of_held(lambda held: held.limited_since)
    step = joined.step.astype(np.float64)
    most = {"swings": np.full(n, _swings_m_s(joined))}
    return Match(np.ones(n, np.bool_), step, numbers, sums={"full": at_limit & since}, most=most)


def _touched(joined: ConstraintColumns) -> NDArray[np.int64]:
    """Return the steps in which a contact of one of its bodies may keep the constraint open."""
    pairs, numbers = joined.scene.pairs, [body.number for body in joined.bodies]
    return np.asarray(pairs.step[np.isin(pairs.body, numbers).any(axis=1)])


def _weight_n(joined: ConstraintColumns) -> float:
    """Return the held weight along its main axis; 0 if other supports share it."""
    scene, moving = joined.scene, [body for body in joined.bodies if body.base_moves]
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
    """Return the mass ratio that strains the solver; 0 if a call moved one of the constraints."""
    held = scene.constraints.of_client(client)
    numbers = {number for each in held for number in each.bodies if number >= 0}
    still = all(each.moved == each.made.at.step for each in held)
    return strained_by(scene.seen, [scene.body(each) for each in numbers]) if still else 0.0


@weak_constraint.counts
def _(stays: Flags, gap: Float64, part: Float64) -> Float64:
    return np.where(stays, gap / part, 0.0)


@weak_constraint.notes
def _(
    scene: Scene,
    subject: Body,
    held: ConstraintVersion,
    gap: float,
    part: float,
    limit: float,
    full: int,
    weight: float,
    hangs: bool,
    strained: bool,
) -> Noted | None:
    ratio = _ratio(scene, subject.client)
    if not strained and not (hangs and ratio >= RATIO and gap > APART * part):
        return None
    given = 0.0 if held.limited is None else number(held.limited, "maxForce")
    limited = Message(
        "that is at its limit of {limit:.3g} N along an axis in {count:,} steps",
        limit=limit,
        count=full,
    )
    return {
        **_other(scene, subject, held),
        "ratio": ratio,
        "why": limited,
        "limited": limited,
        "heavy": weight > limit,
        "given": given,
        "enough": float(to_spare(weight)) if weight > limit else None,
        "proposed": not hangs,
        "made": site_of(held.limited or held.made),
    }


MORE = SayingRow(
    advice=Message("give it more: p.changeConstraint(…, maxForce=…)"),
    cure=Remedy("constraint-force"),
)
HEAVY = SayingRow(why=Message("{limited}, and the weight is {weight:.3g} N"))
weak_constraint.rows(
    SayingRow(
        when=lambda strained: not strained,
        why=Message(
            "of what constraints join, one is {ratio:.4g} times as heavy as another, and the "
            "solver uses up its iterations"
        ),
        cure=Remedy("solver", value=500.0),
    ),
    SayingRow(
        when=lambda heavy, given, weight: heavy and given > weight, cure=Remedy("timestep-first")
    ).like(HEAVY),
    # Of what swings its weight is not all that pulls.
    SayingRow(
        when=lambda heavy, swings: heavy and swings < STILL_M_S,
        advice=Message("give it more: {call}"),
        cure=Remedy("constraint-force", value="enough"),
    ).like(HEAVY),
    SayingRow(when=lambda heavy: heavy).like(HEAVY).like(MORE),
    MORE,
    like=SayingRow(
        says=Message("{body} is {gap:.3g} m from where its constraint to {parent} wants it: {why}"),
        effect="gap",
        normal="part",
        site="made",
    ),
)
