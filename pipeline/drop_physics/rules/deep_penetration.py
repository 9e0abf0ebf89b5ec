"""`deep-penetration`: bodies overlap by a good part of the thinner one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message, joined
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.body_properties import strained_by
from drop_physics.rules.rule import Match, Said, Worst, pair_rule
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
    RATIO,
)

Float64 = NDArray[np.float64]


@pair_rule("deep-penetration", "model", consecutive=True)
def deep_penetration(pair: PairColumns) -> Match:
    """Bodies that were not placed so overlap by a good part of the thinner one."""
    rows = np.flatnonzero((pair.depth_m > DEEP_M) & (pair.body != pair.other))
    points, placing = pair.points, pair.scene.placing
    steps, bodies, depth_m = pair.step[rows], pair.pairs.body[rows], pair.depth_m[rows]
    moved = placing.moved(bodies, steps[:, None])
    came_m = pair.most(points.approach_m_s)[rows].clip(0.0) * pair.timestep_s[rows]
    # A body that came with the step before may be listed as touching only now.
    late = placing.moved(bodies, steps[:, None] - 1).any(axis=1) & (depth_m > JUMPED * came_m)
    still = ~points.began_m_s[pair.starts[rows]].any(axis=2)
    order = np.lexsort((points.distance_m, pair.row))  # in each pair the deepest is first
    return Match(
        rows,
        depth_m,
        {"deepest": steps, "links": points.link[order[pair.starts[rows]]]},
        {"came": came_m, "carried": (moved & still).any(axis=1).astype(float)},
        {"fastest": came_m, **_presses(pair, rows)},
        {"placed": moved.any(axis=1) | late, "began": depth_m, "at": bodies[:, 0]},
        keys=pair.keys[rows],
    )


@deep_penetration.says
def _(worst: Worst) -> Said | None:
    if (worst.placed and worst.carried <= 1) or not _edges_m(worst):
        return None  # the first is `starts-in-contact`
    thin_m = max(min(_edges_m(worst)), 1e-9)
    took, share = worst.deepest - worst.first, worst.size / thin_m
    cause, advice, cure = _cause(worst, took)
    # What comes fast goes deeper; without a cause, only what is no physics any more is said.
    least = DEEP_LASTING if took >= GROWS_STEPS else DEEP_IMPACT
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
        effect=Effect(worst.size, "m"),
        share=share,
        level="broken" if broken else None,
    )


def _cause(
    worst: Worst, took: int
) -> tuple[Message, Message, Cure | None] | tuple[None, None, None]:
    """Return why, and what changes it; None where that is not sure."""
    lasts = took >= GROWS_STEPS
    grows = lasts and worst.size > 2 * worst.began
    both = worst.subject, worst.partner
    soft = [
        float(np.nan_to_num(each.reported["contact_stiffness"]).max())
        for each in worst.scene.seen.dynamics
        if each.body.number in [body.number for body in both]
    ]
    stiffness_n_m = max([0.0, *soft])
    if worst.carried > (worst.last - worst.first) / 2:
        return (
            Message("a call moves one of them in each step, and it has no velocity"),
            Message("give it the velocity that it moves with: p.resetBaseVelocity(…)"),
            Cure("support-velocity", bodies=(worst.body, worst.other)),
        )
    if grows and worst.constraints:
        return (
            Message(
                "a constraint presses them together, and the solver ends before it can "
                "tell which of both has to give"
            ),
            Message("give it less force: p.changeConstraint(…, maxForce=…)"),
            Cure("constraint-force", form="less"),
        )
    if stiffness_n_m and lasts:
        return (
            Message("contact there is as soft as {stiffness:.3g} N/m", stiffness=stiffness_n_m),
            Message("raise p.changeDynamics(…, contactStiffness=…), or do without"),
            None,
        )
    if took < IMPACT_STEPS and not stiffness_n_m and worst.size <= 1.05 * worst.until_came:
        return (
            Message("they approach by {way:.3g} mm in one step", way=worst.fastest * 1e3),
            Message("use a shorter timestep: p.setTimeStep(…)"),
            Cure("timestep", value=4.0),
        )
    if grows and worst.motors:
        return (
            Message(
                "motors press them together, and the solver ends before it can tell which "
                "of both has to give"
            ),
            Message(
                "give the motors less force, or raise "
                "p.setPhysicsEngineParameter(numSolverIterations=500)"
            ),
            Cure("solver", value=500.0),
        )
    ratio = strained_by(worst.scene.seen, both)
    if RATIO <= ratio <= MOST_RATIO and lasts:
        return (
            Message(
                "one is {ratio:.4g} times as heavy as the other, and the solver uses up "
                "its iterations",
                ratio=ratio,
            ),
            Message("raise p.setPhysicsEngineParameter(numSolverIterations=500)"),
            Cure("solver", value=500.0),
        )
    return None, None, None


def _edges_m(worst: Worst) -> list[float]:
    """Return the shortest edge of each part that overlaps and can move."""
    edges = []
    links = worst.links if worst.at == worst.subject.number else worst.links[::-1]
    for body, link in zip((worst.subject, worst.partner), links, strict=True):
        boxes = np.reshape(body.bounds_m, (-1, 2, 3))
        if body.number in worst.scene.ends and link + 1 < len(boxes):
            edges.append(float((boxes[link + 1, 1] - boxes[link + 1, 0]).min()))
    return edges


def _presses(pair: PairColumns, rows: NDArray[np.intp]) -> dict[str, Float64]:
    """Return where constraints, and motors, act against the contacts of either body."""
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
