"""Rules about overlapping bodies: those that sink into others, and those that start inside."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.rules.body_properties import part_named, size_m, strained_by, thickness_m
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Noted, Remedy, SayingRow
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
    THROWN_M,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

SOLVER = 50
"""The solver's number of iterations if no call sets it."""
SLOP, ITERATIONS = "contactSlop", "numSolverIterations"


@pair_rule("deep-penetration", "model", consecutive=True)
def deep_penetration(pair: PairColumns, placing: Placing, chunk: StepChunk) -> Match:
    """Bodies overlap by a large share of the thinner one's thickness, though not placed so."""
    rows = np.flatnonzero((pair.pairs.depth_m > DEEP_M) & (pair.body != pair.other))
    points, placing = pair.points, placing
    steps, bodies, depth_m = pair.step[rows], pair.pairs.body[rows], pair.pairs.depth_m[rows]
    moved = placing.moved(bodies, steps[:, None])
    came_m = pair.pairs.most(points.approach_m_s)[rows].clip(0.0) * pair.timestep_s[rows]
    # A body that came with the step before may be listed as touching only now.
    late = placing.moved(bodies, steps[:, None] - 1).any(axis=1) & (depth_m > JUMPED * came_m)
    still = ~points.began_m_s[pair.starts[rows]].any(axis=2)
    presses = _presses(pair, rows, chunk)
    return Match(
        rows,
        depth_m,
        {"deepest": steps, "links": pair.links[rows], "pulled": presses.pop("pulled")},
        {"came": came_m, "carried": (moved & still).any(axis=1).astype(float)},
        {"fastest": came_m, **presses},
        {"placed": moved.any(axis=1) | late, "began": depth_m, "at": bodies[:, 0]},
        keys=pair.keys[rows],
    )


@deep_penetration.notes
def _(
    last_samples: Mapping[int, int],
    inputs: Inputs,
    seen: Seen,
    subject: Body,
    partner: Body,
    time_s: Callable[[int], float],
    links: list[int],
    at: int,
    size: float,
    first: int,
    last: int,
    deepest: int,
    began: float,
    placed: bool,
    carried: float,
    constraints: bool,
) -> Noted | None:
    both, numbers = (subject, partner), {subject.number, partner.number}
    mine = links if at == subject.number else links[::-1]
    thin_m = max(min(map(thickness_m, both, mine)), 1e-9)
    if (placed and carried <= 1) or not np.isfinite(thin_m):
        return None  # the first is `starts-in-contact`
    took, share = deepest - first, size / thin_m
    lasts = took >= GROWS_STEPS
    # What comes fast goes deeper; without a cause, only what is no physics any more is said.
    least = DEEP_LASTING if lasts else DEEP_IMPACT
    stays, ends = last >= last_samples[subject.number], took < IMPACT_STEPS
    engine = [*inputs.of(Act.SET_ENGINE)]
    soft_n_m = [
        float(np.nan_to_num(each.reported["contact_stiffness"]).max())
        for each in seen.dynamics
        if each.body.number in numbers
    ]
    stiffness = max([0.0, *soft_n_m])
    slops_m = [float(use.high[SLOP][0]) for use in engine if SLOP in use.high]
    given = [int(use.low[ITERATIONS][0]) for use in engine if ITERATIONS in use.low]
    # A call asked for an overlap in which a constraint holds two bodies.
    over = share > OVER_HALF and not constraints
    level = "broken" if stays and over else "note" if ends and not over else None
    moves = carried > (last - first) / 2
    if moves and not any(use.body in both for use in inputs.of(Act.SET_POSE)):
        return None  # what calls do with a joint is `overwritten`
    # A call makes this motion; and bodies without mass move only where calls put them.
    pushes = moves and not all(each.base_moves for each in both)
    if (stiffness or pushes) and not over:
        level = "note"
    return {
        "time": time_s(deepest - 1),
        "share": share,
        "least": least,
        "sinks": SINKS_M / thin_m,  # as a call made it
        "half": max(least, OVER_HALF),
        "level": level,
        "moves": moves,
        "lasts": lasts,
        "grows": lasts and size > 2 * began,
        "ends": ends,
        "slop": max([0.0, *slops_m]),
        "stiffness": stiffness,
        "ratio": strained_by(seen, both),
        "few": min(given, default=SOLVER),
        "usual": SOLVER,
    }


MORE = Remedy("solver", value=500.0)
deep_penetration.rows(
    SayingRow(
        when=lambda moves: moves,
        why=Message("a call moves one of them in each step, and it has no velocity"),
        cure=Remedy("support-velocity", bodies=("body", "other")),
        proposed=True,
    ),
    SayingRow(
        when=lambda grows, pulled: grows and pulled,
        why=Message(
            "a constraint presses them together, and the solver ends before it can "
            "tell which of both has to give"
        ),
        advice=Message("give it less force"),
        cure=Remedy("constraint-force", form="less"),
    ),
    SayingRow(
        when=lambda lasts, slop, size: lasts and 2 * slop > size,
        why=Message("contactSlop={slop:g} lets bodies overlap by so much"),
        cure=Remedy("solver", value=0.0, given={"contactSlop": 0}),
    ),
    SayingRow(
        when=lambda lasts, stiffness: lasts and stiffness,
        why=Message("contact there is as soft as {stiffness:.3g} N/m"),
        advice=Message("raise p.changeDynamics(…, contactStiffness=…), or do without"),
        least="sinks",
    ),
    SayingRow(
        when=lambda ends, stiffness, size, until_came: (
            ends and not stiffness and size <= 1.05 * until_came
        ),
        why=Message("they approach by {fastest:mm} in one step"),
        advice=Message("use a shorter timestep: {call}"),
        cure=Remedy("timestep", value=4.0),
        proposed=True,
    ),
    SayingRow(
        when=lambda grows, motors: grows and motors,
        why=Message(
            "motors press them together, and the solver ends before it can tell which "
            "of both has to give"
        ),
        advice=Message("give the motors less force, or more iterations: {call}"),
        cure=MORE,
    ),
    SayingRow(
        when=lambda lasts, ratio: lasts and RATIO <= ratio <= MOST_RATIO,
        why=Message(
            "one is {ratio:.4g} times as heavy as the other, and the solver uses up its iterations"
        ),
        cure=MORE,
    ),
    SayingRow(
        when=lambda lasts, few: lasts and few < SOLVER,
        why=Message("the solver ends after {few} iterations in place of {usual}"),
        cure=MORE,
        proposed=True,
    ),
    SayingRow(
        says=Message(
            "{body} is {size:mm} inside {other} at {time:.4g} s, {share:.0%} of the thinner one"
        ),
        least="half",
    ),
    like=SayingRow(
        says=Message(
            "{body} is {size:mm} inside {other} at {time:.4g} s, {share:.0%} of the thinner one: "
            "{why}"
        ),
        effect="size",
        share="share",
        least="least",
    ),
)


def _presses(pair: PairColumns, rows: NDArray[np.intp], chunk: StepChunk) -> dict[str, Float64]:
    """Flag the rows in which motors or constraints press a body against its contacts.

    `pulled` flags the rows in which only constraints, but no motor, press the body.
    """
    found = {name: np.zeros(len(rows)) for name in ("constraints", "motors", "pulled")}
    for side in (0, 1):
        bodies = pair.pairs.body[rows, side]
        for steps, its, at in chunk.steps_at(bodies, pair.step[rows]):
            if not steps.terms:
                continue
            contacts = steps.terms["contacts"][at]
            least = PRESSES * (contacts**2).sum(axis=1)
            presses = {
                name: -np.minimum(steps.terms[name][at] * contacts, 0.0).sum(axis=1) > least
                for name in ("constraints", "motors")
            }
            presses["pulled"] = presses["constraints"] & ~presses["motors"]
            for name, flags in presses.items():
                found[name][its] = np.maximum(found[name][its], flags)
    return found


# -- starts-in-contact ----------------------------------------------------------------------------


@pair_rule("starts-in-contact", "asked")
def starts_in_contact(
    pair: PairColumns, placing: Placing, seen: Seen, chunk: StepChunk
) -> Match | None:
    """The engine pushes overlapping bodies apart, faster with depth and with shorter timesteps."""
    points, placing, both = pair.points, placing, pair.pairs.body
    # How fast the deepest parts leave each other after the step.
    parting = pair.pairs.most(np.where(points.distance_m < -DEEP_M, points.parting_m_s, 0.0))
    pressed = pair.pairs.normal_n > 0
    # With substeps the last one is reported: the push may be over, and they have parted since.
    substeps = _substeps(pair, chunk, seen)
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
        placing.site(seen.bodies[number], at)
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


def _substeps(pair: PairColumns, chunk: StepChunk, seen: Seen) -> Float64:
    """Return the number of substeps of each step, shape (n,)."""
    bodies, which = np.unique(pair.body, return_inverse=True)
    settings = [chunk.settings(seen.bodies[each].client) for each in bodies.tolist()]
    return np.maximum([each.get("numSubSteps", 0.0) for each in settings], 1.0)[which]


@starts_in_contact.notes
def _(
    seen: Seen,
    subject: Body,
    partner: Body,
    time_s: Callable[[int], float],
    links: list[int],
    step: int,
    size: float,
    away: list[float],
    placing: Placing,
) -> Noted:
    scale_m, itself = min(size_m(subject), size_m(partner)), subject is partner
    height_m = size**2 / (2 * STANDARD_M_S2)
    thrown, lifted = height_m > scale_m, height_m >= THROWN_M
    return {
        "itself": itself,
        "level": "model" if itself else "broken" if thrown else "asked" if lifted else "note",
        "as_loaded": placing.is_as_loaded(subject.number, step),
        "one": part_named(subject, links[0]),
        "two": part_named(partner, links[1]),
        "away": tuple(away),
        "time": time_s(step - 1),
        "scale": scale_m,
        "hull": _hull(seen, (subject, partner), links),
    }


starts_in_contact.rows(
    SayingRow(
        when=lambda itself: itself,
        says=Message(
            "{one} collides with itself as it starts: it is {depth_m:mm} inside {two}, "
            "and they are pushed apart at {size:.3g} m/s"
        ),
        advice=Message("load it {call}, or p.setCollisionFilterPair(…, 0) for these links"),
        cure=Remedy("collision-off", "body"),
        code="self-collision",
    ),
    SayingRow(
        when=lambda as_loaded: as_loaded,
        says=Message(
            "{one} is loaded {depth_m:mm} inside {two} at {time:.4g} s: they are pushed "
            "apart at {size:.3g} m/s{hull}"
        ),
        cure=Remedy("lifted", "body", "depth_m", given={"away": "away"}),
    ),
    SayingRow(
        says=Message(
            "{one} is set {depth_m:mm} inside {two} at {time:.4g} s: they are pushed "
            "apart at {size:.3g} m/s{hull}"
        ),
        cure=Remedy("lifted", "body", "depth_m", form="set", given={"away": "away"}),
    ),
    like=SayingRow(
        advice=Message("place it at least {call} from {two}"),
        effect="depth_m",
        normal="scale",
        site="placed_at",
    ),
)


def _hull(seen: Seen, both: tuple[Body, Body], links: list[int]) -> str:
    """Return a note that a mesh's hollow counts as filled, if either body has a mesh."""
    if any(collision.kind == "plane" for body in both for collision in body.collisions):
        return ""  # a mesh and its hull go equally deep into a plane
    for body, link in zip(both, links, strict=True):
        for surface in seen.surfaces:
            if surface.body == body.number and body.collisions[surface.shape].link == link:
                return Message(
                    "; the mesh of {body} has a hollow, which PyBullet fills: it collides as its "
                    "convex hull",
                    body=part_named(body, link),
                )
    return ""
