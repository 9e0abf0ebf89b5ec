"""Bodies that overlap: those that sink into others, and those that are placed inside them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64
from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.body_properties import part_named, size_m, strained_by, thickness_m
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, pair_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import (
    DEEP_IMPACT,
    DEEP_LASTING,
    DEEP_M,
    GROWS_STEPS,
    IMPACT_STEPS,
    JUMPED,
    MOST_RATIO,
    OVER_HALF,
    PRESSES,
    PUSHED_APART_M_S,
    RATIO,
    SINKS_M,
    STANDARD_M_S2,
)
from drop_physics.trace.acts import Act

SOLVER = 50
"""Number of the solver's iterations that no call sets."""
CARRIED = Message("a call moves one of them in each step, and it has no velocity")
FEW = Message("the solver ends after {n} iterations in place of {usual}")
SOFT = Message("contact there is as soft as {stiffness:.3g} N/m")
FAST = Message("they approach by {way:.3g} mm in one step")
NOT_SURE = {CARRIED.template, FEW.template, FAST.template}
"""Causes that need not be the only ones."""


@pair_rule("deep-penetration", "model", consecutive=True)
def deep_penetration(pair: PairColumns) -> Match:
    """Bodies that were not placed so overlap by a good part of the thinner one."""
    rows = np.flatnonzero((pair.pairs.depth_m > DEEP_M) & (pair.body != pair.other))
    points, placing = pair.points, pair.scene.placing
    steps, bodies, depth_m = pair.step[rows], pair.pairs.body[rows], pair.pairs.depth_m[rows]
    moved = placing.moved(bodies, steps[:, None])
    came_m = pair.pairs.most(points.approach_m_s)[rows].clip(0.0) * pair.timestep_s[rows]
    # A body that came with the step before may be listed as touching only now.
    late = placing.moved(bodies, steps[:, None] - 1).any(axis=1) & (depth_m > JUMPED * came_m)
    still = ~points.began_m_s[pair.starts[rows]].any(axis=2)
    return Match(
        rows,
        depth_m,
        {"deepest": steps, "links": pair.links[rows]},
        {"came": came_m, "carried": (moved & still).any(axis=1).astype(float)},
        {"fastest": came_m, **_presses(pair, rows)},
        {"placed": moved.any(axis=1) | late, "began": depth_m, "at": bodies[:, 0]},
        keys=pair.keys[rows],
    )


@deep_penetration.says
def _(worst: Worst) -> Said | None:
    thin_m = max(_thin_m(worst), 1e-9)
    if (worst.placed and worst.carried <= 1) or not np.isfinite(thin_m):
        return None  # the first is `starts-in-contact`
    took, share = worst.deepest - worst.first, worst.size / thin_m
    cause, advice, cure = _cause(worst, took)
    # What comes fast goes deeper; without a cause, only what is no physics any more is said.
    least = DEEP_LASTING if took >= GROWS_STEPS else DEEP_IMPACT
    if cause is not None and cause.template == SOFT.template:  # as a call made it
        least = SINKS_M / thin_m
    if share <= (least if cause else max(least, OVER_HALF)):
        return None
    message = Message(
        "{body} is {depth:.3g} mm inside {other} at {time:.4g} s, {share:.0%} of the thinner one",
        body=worst.body,
        other=worst.other,
        depth=worst.size * 1e3,
        share=share,
        time=worst.time_s(worst.deepest - 1),
    )
    stays = worst.last >= worst.scene.ends[worst.subject.number]
    # What a constraint holds inside, a call asked for.
    broken = stays and share > OVER_HALF and not worst.constraints
    return Said(
        message=message if cause is None else joined(": ", [message, cause]),
        advice=advice,
        cure=cure,
        proposed=cause is not None and cause.template in NOT_SURE,
        effect=Effect(worst.size, "m"),
        share=share,
        level="broken" if broken else None,
    )


def _cause(worst: Worst, took: int) -> tuple[Message | None, Message | None, Cure | None]:
    """Return reason, advice and cure; None where these are not sure."""
    lasts = took >= GROWS_STEPS
    grows = lasts and worst.size > 2 * worst.began
    both = worst.subject, worst.partner
    soft_n_m = [
        float(np.nan_to_num(each.reported["contact_stiffness"]).max())
        for each in worst.scene.seen.dynamics
        if each.body.number in (worst.subject.number, worst.partner.number)
    ]
    slops_m = [
        float(use.high["contactSlop"][0])
        for use in worst.scene.inputs.of(Act.SET_ENGINE)
        if "contactSlop" in use.high
    ]
    stiffness_n_m, slop_m = max([0.0, *soft_n_m]), max([0.0, *slops_m])
    ratio = strained_by(worst.scene.seen, both)
    more = Cure("solver", value=500.0)
    if worst.carried > (worst.last - worst.first) / 2:
        why = CARRIED
        posed = any(use.body in both for use in worst.scene.inputs.of(Act.SET_POSE))
        cure = Cure("support-velocity", bodies=(worst.body, worst.other))
        return why, None, cure if posed else None  # a joint's is `overwritten`
    if grows and worst.constraints and not worst.motors:
        why = Message(
            "a constraint presses them together, and the solver ends before it can "
            "tell which of both has to give"
        )
        return why, Message("give it less force"), Cure("constraint-force", form="less")
    if lasts and 2 * slop_m > worst.size:
        why = Message("contactSlop={slop:g} lets bodies overlap by so much", slop=slop_m)
        return why, None, Cure("solver", value=0.0, given={"contactSlop": 0})
    if stiffness_n_m and lasts:
        why = Message(SOFT.template, stiffness=stiffness_n_m)
        return why, Message("raise p.changeDynamics(…, contactStiffness=…), or do without"), None
    if took < IMPACT_STEPS and not stiffness_n_m and worst.size <= 1.05 * worst.until_came:
        why = Message(FAST.template, way=worst.fastest * 1e3)
        return why, Message("use a shorter timestep: {call}"), Cure("timestep", value=4.0)
    if grows and worst.motors:
        why = Message(
            "motors press them together, and the solver ends before it can tell which "
            "of both has to give"
        )
        return why, Message("give the motors less force, or more iterations: {call}"), more
    if RATIO <= ratio <= MOST_RATIO and lasts:
        why = Message(
            "one is {ratio:.4g} times as heavy as the other, and the solver uses up its iterations",
            ratio=ratio,
        )
        return why, None, more
    given = [
        int(use.low["numSolverIterations"][0])
        for use in worst.scene.inputs.of(Act.SET_ENGINE)
        if "numSolverIterations" in use.low
    ]
    if lasts and given and min(given) < SOLVER:
        why = Message(FEW.template, n=min(given), usual=SOLVER)
        return why, None, more
    return None, None, None


def _thin_m(worst: Worst) -> float:
    """Return the shortest known edge of the overlapping parts; inf if neither is known."""
    links = worst.links if worst.at == worst.subject.number else worst.links[::-1]
    return min(map(thickness_m, (worst.subject, worst.partner), links))


def _presses(pair: PairColumns, rows: NDArray[np.intp]) -> dict[str, Float64]:
    """Return the pressure of constraints, and of motors, against the contacts of either body."""
    found = {name: np.zeros(len(rows)) for name in ("constraints", "motors")}
    for side in (0, 1):
        bodies = pair.pairs.body[rows, side]
        for steps, its, at in pair.scene.steps_at(bodies, pair.step[rows]):
            for name in found if steps.terms else ():
                contacts = steps.terms["contacts"][at]
                against = -np.minimum(steps.terms[name][at] * contacts, 0.0).sum(axis=1)
                found[name][its] = np.maximum(
                    found[name][its], against > PRESSES * (contacts**2).sum(axis=1)
                )
    return found


# -- starts-in-contact ----------------------------------------------------------------------------


@pair_rule("starts-in-contact", "asked")
def starts_in_contact(pair: PairColumns) -> Match | None:
    """The engine pushes what overlaps apart: faster, the deeper and the shorter the timestep."""
    points, placing, both = pair.points, pair.scene.placing, pair.pairs.body
    # How fast the deepest parts leave each other after the step.
    parting = pair.pairs.most(np.where(points.distance_m < -DEEP_M, points.parting_m_s, 0.0))
    pressed = pair.pairs.normal_n > 0
    # With substeps the last one is reported: the push may be over, and they have parted since.
    substeps = _substeps(pair)
    pushed = parting + pair.pairs.most(points.approach_m_s) > PUSHED_APART_M_S
    pressed |= (substeps > 1) & pushed
    depth_m = pair.pairs.depth_m + parting * pair.timestep_s * (1 - 1 / substeps)
    rows = np.flatnonzero((pair.pairs.depth_m > DEEP_M) & pressed & (parting > PUSHED_APART_M_S))
    if not len(rows):
        return None
    follows, presses = np.zeros(len(both), np.bool_), np.flatnonzero(pressed)
    follows[presses] = pair.before(presses) >= 0
    bodies, steps = both[rows], pair.step[rows, None]
    came_m = pair.pairs.most(points.approach_m_s)[rows].clip(0.0) * pair.timestep_s[rows]
    jumped = (pair.pairs.depth_m[rows] > JUMPED * came_m + DEEP_M)[:, None]
    # A body that came with the step before may be listed as touching only now.
    late = placing.posed(bodies, steps - 1) & ~follows[rows, None]
    late &= ~np.any(placing.moved(bodies, steps), axis=1, keepdims=True)
    # What calls set no deeper than its velocity brings it moves on.
    placed = placing.posed(bodies, steps) & (jumped | placing.came(bodies, steps))
    placed |= late & jumped
    # Of two, that which was loaded last, or which alone was placed; none if calls move the other.
    its = placed.any(axis=1) & ~np.any(placing.moved(bodies, steps) & ~placed, axis=1)
    rows, second = rows[its], placed[its, 1:]
    order = np.lexsort((points.distance_m, pair.pairs.row))  # in each pair the deepest is first
    deepest = order[pair.starts[rows]]
    links = points.link[deepest]
    keys, step = np.where(second, both[rows, ::-1], both[rows]), pair.step[rows]
    sites = [
        placing.site(pair.scene.body(number), at)
        for number, at in zip(keys[:, 0].tolist(), step.tolist(), strict=True)
    ]
    return Match(
        rows,
        parting[rows],
        {
            "step": step,
            "links": np.where(second, links[:, ::-1], links),
            "placed_at": np.array(sites, object),
            "away": points.normal[deepest] * np.where(second, -1, 1),
        },
        most={"depth_m": depth_m[rows]},
        keys=keys,
    )


def _substeps(pair: PairColumns) -> Float64:
    """Return the number of substeps of each step, shape (n,)."""
    bodies, which = np.unique(pair.body, return_inverse=True)
    settings = [pair.scene.settings(pair.scene.body(each).client) for each in bodies.tolist()]
    return np.maximum([each.get("numSubSteps", 0.0) for each in settings], 1.0)[which]


@starts_in_contact.says
def _(worst: Worst) -> Said:
    body, other = worst.subject, worst.partner
    size, itself = min(size_m(body), size_m(other)), body is other
    advice = Message("place it at least {call} from {other}")
    came = worst.scene.placing.came(body.number, worst.step)
    away = {"away": tuple(worst.away)}
    cure = Cure("lifted", worst.body, worst.depth_m, form="" if came else "set", given=away)
    if itself:
        message = Message(
            "{body} collides with itself as it starts: it is {depth:.3g} mm inside {other}, "
            "and they are pushed apart at {speed:.3g} m/s"
        )
        advice = Message("load it {call}, or p.setCollisionFilterPair(…, 0) for these links")
        cure = Cure("collision-off", worst.body)
    elif came:
        message = Message(
            "{body} is loaded {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed "
            "apart at {speed:.3g} m/s{hull}"
        )
    else:
        message = Message(
            "{body} is set {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed "
            "apart at {speed:.3g} m/s{hull}"
        )
    thrown = worst.size**2 / (2 * STANDARD_M_S2) > size
    return Said(
        code="self-collision" if itself else None,
        level="model" if itself else "broken" if thrown else "asked",
        message=message,
        values={
            "body": part_named(body, worst.links[0]),
            "other": part_named(other, worst.links[1]),
            "depth": worst.depth_m * 1e3,
            "speed": worst.size,
            "time": worst.time_s(worst.step - 1),
            "hull": _hull(worst),
        },
        advice=advice,
        cure=cure,
        effect=Effect(worst.depth_m, "m"),
        share=worst.depth_m / size,
        site=worst.placed_at,
    )


def _hull(worst: Worst) -> str:
    """Return the remark that the engine fills the hollow of a mesh, if one of both has any."""
    both = (worst.subject, worst.partner)
    if any(each.kind == "plane" for body in both for each in body.collisions):
        return ""  # a mesh and its hull go equally deep into a plane
    for body, link in zip(both, worst.links, strict=True):
        for each in worst.scene.seen.surfaces:
            if each.body == body.number and body.collisions[each.shape].link == link:
                return Message(
                    "; the mesh of {body} has a hollow, which PyBullet fills: it collides as its "
                    "convex hull",
                    body=part_named(body, link),
                )
    return ""
