"""Rules about constraints that do not close, or give way: `constraint-apart`, `weak-constraint`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.account.pinned import SOON, HeldConstraint
from drop_physics.account.rows import AccountRow
from drop_physics.explain.joined import Constraints
from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message
from drop_physics.rules.answer import Span
from drop_physics.rules.arguments import number, site_of
from drop_physics.rules.body_properties import size_m, strained_by
from drop_physics.rules.held_off import to_spare
from drop_physics.rules.rows import Case, Noted, Remedy, SayingRow
from drop_physics.rules.rule import row_rule
from drop_physics.rules.thresholds import (
    APART,
    APART_RAD,
    CLOSES,
    PULLED_BACK,
    RATIO,
    STILL_M_S,
)
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

NO_GAP_M = 1e-6


def _other(seen: Seen, subject: Body, held: HeldConstraint) -> dict[str, object]:
    """Return label and name of the other body of a constraint; the label is None for the world."""
    parent = held.last.bodies[0]
    is_world = parent < 0 or parent == subject.number
    label = None if is_world else seen.bodies[parent].label
    return {"other": label, "parent": label or Message("the world")}


def _part_m(seen: Seen, held: HeldConstraint) -> float:
    """Return the size of the smaller part: the diagonal of its bounding box, or its body's size."""
    sizes: list[float] = []
    for place, link in zip(held.last.bodies, held.last.links, strict=True):
        if place >= 0:
            body = seen.bodies[place]
            box = np.array(body.bounds_m[6 * (link + 1) : 6 * (link + 2)])
            diagonal = float(np.linalg.norm(box[3:] - box[:3])) if len(box) == 6 else 0.0
            sizes.append(diagonal or size_m(body))
    return min(sizes)


@row_rule("constraint-apart", "asked")
def constraint_apart(row: AccountRow) -> bool:
    """A constraint pulls or turns together bodies that were apart when it began."""
    return row.cause == "constraint"


@constraint_apart.notes
def _(seen: Seen, worst: Case, subject: Body, held: HeldConstraint) -> Noted | None:
    gap, angle, part = held.first_gap_m, held.first_angle_rad, _part_m(seen, held)
    if gap is None:
        return None
    pulled = gap > APART * part and held.least_gap_m < CLOSES * gap
    swings = angle > APART_RAD and held.least_angle_rad < CLOSES * angle
    if held.last.moved >= held.began or not (pulled or swings):
        return None
    last = min(held.last_step, held.began + SOON - 1)
    worst.span = Span(held.began, last, last - held.began + 1)
    told = {"gap": gap, "angle": angle, "share": gap / part if pulled else angle}
    return {"pulled": pulled, "made": site_of(held.last.made), **told} | _other(seen, subject, held)


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


@row_rule("weak-constraint", "asked")
def weak_constraint(row: AccountRow) -> bool:
    """A constraint does not close: it is at its limit, or the solver uses all its iterations."""
    return row.cause == "constraint"


@weak_constraint.notes
def _(
    seen: Seen,
    subject: Body,
    held: HeldConstraint,
    times: Mapping[int, StepTimes],
    constraints: Constraints,
) -> Noted | None:
    gaps_m, ends_m, part = held.gaps_m, held.ends_m, _part_m(seen, held)
    timestep_s = times[subject.client].of_steps(np.array([held.last_step]))[0][0]
    # A spring swings, and what is being pulled back needs time.
    moved_m = np.linalg.norm(ends_m[-1] - ends_m[0], axis=1)
    still = (moved_m < STILL_M_S * SOON * timestep_s).any()
    dragged = held.last_step - held.last.moved <= SOON
    stays = gaps_m[-1] >= gaps_m[0] * PULLED_BACK and gaps_m[-1] > NO_GAP_M
    if not (stays and len(gaps_m) > SOON and (still or dragged)):
        return None
    # What is dragged may lag with any force, and what it leans on may hold it off.
    hangs, strained = not (dragged or held.leans.any()), bool(held.strained.all())
    ratio, weight, limit = (
        _ratio(constraints, seen, subject.client),
        held.weight_n,
        held.last_limit_n,
    )
    if not strained and not (hangs and ratio >= RATIO and gaps_m[-1] > APART * part):
        return None
    call = held.last.limited
    limited = Message(
        "that is at its limit of {limit:.3g} N along an axis in {count:,} steps",
        limit=limit,
        count=held.full,
    )
    heavy = weight > limit
    return _other(seen, subject, held) | {
        "gap": float(gaps_m[-1]),
        "part": part,
        "strained": strained,
        "weight": weight,
        "swings": max(held.across_m_s, held.turns_rad_s * part),
        "ratio": ratio,
        "why": limited,
        "limited": limited,
        "heavy": heavy,
        "given": 0.0 if call is None else number(call, "maxForce"),
        "enough": float(to_spare(weight)) if heavy else None,
        "proposed": not hangs,
        "made": site_of(call or held.last.made),
    }


def _ratio(constraints: Constraints, seen: Seen, client: int) -> float:
    """Return the mass ratio that is too large for the solver; 0 if calls move a body."""
    held = constraints.of_client(client)
    numbers = {number for each in held for number in each.bodies if number >= 0}
    still = all(each.moved == each.made.at.step for each in held)
    return strained_by(seen, [seen.bodies[each] for each in numbers]) if still else 0.0


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
