"""`starts-in-contact`, `self-collision`: bodies are placed inside others, or inside themselves."""

from __future__ import annotations

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.rule import Match, Said, Worst, pair_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import DEEP_M, JUMPED, PUSHED_APART_M_S, STANDARD_M_S2
from drop_physics.trace.events import Body


@pair_rule("starts-in-contact", "asked")
def starts_in_contact(pair: PairColumns) -> Match:
    """The engine pushes what overlaps apart: faster, the deeper and the shorter the timestep."""
    points, placing, both = pair.points, pair.scene.placing, pair.pairs.body
    # How fast the deepest parts leave each other after the step.
    parting = pair.most(np.where(points.distance_m < -DEEP_M, points.parting_m_s, 0.0))
    pressed = pair.normal_n > 0
    follows, presses = np.zeros(len(both), np.bool_), np.flatnonzero(pressed)
    follows[presses] = pair.before(presses) >= 0
    rows = np.flatnonzero((pair.depth_m > DEEP_M) & pressed & (parting > PUSHED_APART_M_S))
    bodies, steps = both[rows], pair.step[rows, None]
    came_m = pair.most(points.approach_m_s)[rows].clip(0.0) * pair.timestep_s[rows]
    jumped = (pair.depth_m[rows] > JUMPED * came_m + DEEP_M)[:, None]
    # A body that came with the step before may be listed as touching only now.
    late = placing.placed(bodies, steps - 1) & ~follows[rows, None]
    late &= ~np.any(placing.moved(bodies, steps), axis=1, keepdims=True)
    # What calls set no deeper than its velocity brings it moves on.
    placed = placing.placed(bodies, steps) & (jumped | placing.came(bodies, steps))
    placed |= late & jumped
    # Of two, that which was loaded last, or which alone was placed.
    its = placed.any(axis=1)
    rows, second = rows[its], placed[its, 1:]
    order = np.lexsort((points.distance_m, pair.row))  # in each pair the deepest is first
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
        most={"depth_m": pair.depth_m[rows]},
        keys=keys,
    )


@starts_in_contact.says
def _(worst: Worst) -> Said:
    body, other = worst.subject, worst.partner
    size, itself = min(size_m(body), size_m(other)), body is other
    advice = Message("place it at least {depth:.3g} mm farther away from {other}")
    came = worst.scene.placing.came(body.number, worst.step)
    away = {"away": tuple(worst.away)}
    cure = Cure("lifted", worst.body, worst.depth_m, form="" if came else "set", given=away)
    if itself:
        message = Message(
            "{body} collides with itself as it starts: it is {depth:.3g} mm inside {other}, "
            "and they are pushed apart at {speed:.3g} m/s"
        )
        advice = Message(
            "load it without URDF_USE_SELF_COLLISION, or call p.setCollisionFilterPair(…, 0) "
            "for these links"
        )
        cure = Cure("collision-off", worst.body)
    elif came:
        message = Message(
            "{body} is loaded {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed "
            "apart at {speed:.3g} m/s"
        )
    else:
        message = Message(
            "{body} is set {depth:.3g} mm inside {other} at {time:.4g} s: they are pushed "
            "apart at {speed:.3g} m/s"
        )
    thrown = worst.size**2 / (2 * STANDARD_M_S2) > size
    return Said(
        code="self-collision" if itself else None,
        level="model" if itself else "broken" if thrown else "asked",
        message=message,
        values={
            "body": _named(body, worst.links[0]),
            "other": _named(other, worst.links[1]),
            "depth": worst.depth_m * 1e3,
            "speed": worst.size,
            "time": worst.time_s(worst.step - 1),
        },
        advice=advice,
        cure=cure,
        effect=Effect(worst.depth_m, "m"),
        share=worst.depth_m / size,
        site=worst.placed_at,
    )


def _named(body: Body, link: int) -> str:
    """Return what a link is called; of a body that has no other, what that is."""
    single = len(body.links) < 2 or link + 1 >= len(body.links)
    return body.label if single else f"{body.label} ({body.links[link + 1]})"
