"""Rules about MuJoCo bodies that overlap at the start: `starts-in-contact`, `static-parent`.

MuJoCo's contacts push overlapping bodies apart over many steps, so the speed is known only once
they have separated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.messages import Message
from drop_physics.physics.vectors import distinct_rows
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, pair_rule
from drop_physics.rules.tables import PairColumns, Rows
from drop_physics.rules.thresholds import DEEP_M, EACH_STEP, STANDARD_M_S2, THROWN_M
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

BASE = -1
HALF = 1e-3
"""Tolerance, as a share of a length, for an overlap that would vanish if the body had half its
size."""


@pair_rule("starts-in-contact", "asked", consecutive=True, engines=MUJOCOS)
def starts_inside(pair: PairColumns, placing: Placing, seen: Seen) -> Match:
    """Bodies of different trees overlap at the start, and are thrown apart."""
    rows = np.flatnonzero(pair.body != pair.other)
    placed = placing.placed(pair.pairs.body[rows], pair.step[rows, None]).any(axis=1)
    starts = placed & (pair.pairs.depth_m[rows] > DEEP_M) & (pair.pairs.normal_n[rows] > 0)
    return Match(
        rows,
        pair.pairs.most(pair.points.parting_m_s)[rows],
        firsts={
            "starts": starts,
            "depth_m": pair.pairs.depth_m[rows],
            "lifts": _lifts(pair)[rows] & ~_chained(pair, rows, starts, seen),
        },
        keys=pair.keys[rows],
        begins=starts,
    )


def _lifts(pair: PairColumns) -> Flags:
    """Flag the pairs whose contacts all push the body up, so that lifting it would help."""
    points, side = pair.points, np.where(pair.keys[:, 0] == pair.pairs.body[:, 0], 1, -1)
    down = np.where(points.distance_m < -DEEP_M, -points.normal[:, 2] * side[pair.pairs.row], -1.0)
    return np.asarray(pair.pairs.most(down) < HALF - 1)


def _chained(pair: PairColumns, rows: Rows, starts: Flags, seen: Seen) -> Flags:
    """Flag the pairs with a body that overlaps a third body at the start, too."""
    bodies = pair.pairs.body[rows]
    keys = pair.step[rows, None] * (bodies.max(initial=0) + 1) + bodies
    found, counts = np.unique(
        keys[starts[:, None] & np.isin(bodies, seen.moving)], return_counts=True
    )
    return np.asarray(np.isin(keys, found[counts > 1]).any(axis=1))


@starts_inside.counts
def _(size: Float64, starts: Flags) -> Float64:
    thrown = size.clip(0.0) ** 2 / (2 * STANDARD_M_S2) >= THROWN_M
    return np.where(starts & thrown, size, 0.0)


@starts_inside.notes
def _(
    subject: Body,
    partner: Body,
    time_s: Callable[[int], float],
    first: int,
    size: float,
    depth_m: float,
    lifts: bool,
) -> Noted:
    shapes = *subject.collisions, *partner.collisions
    # A contact with a heightfield is that with one of its prisms, and so is the depth.
    whole = not any(each.kind == "heightfield" for each in shapes)
    return {
        "time": time_s(first - 1),
        "lifts": lifts and whole,
        "half": whole and _is_half(subject, depth_m),
        "part": size**2 / (2 * STANDARD_M_S2) / THROWN_M,
    }


LIFTED = Remedy("lifted", "body", "depth_m")
starts_inside.rows(
    SayingRow(
        when=lambda lifts, half: lifts and half,
        advice=Message("{call}; a <geom>'s size is half of its length, or its radius"),
        cure=LIFTED,
    ),
    SayingRow(
        when=lambda half: half,
        advice=Message("a <geom>'s size is half of its length, or its radius"),
    ),
    SayingRow(when=lambda lifts: lifts, cure=LIFTED),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{body} begins {depth_m:mm} inside {other} at {time:.4g} s: contacts push "
            "them apart, at up to {size:.3g} m/s"
        ),
        effect="depth_m",
        share="part",
    ),
)


def _is_half(body: Body, depth_m: float) -> bool:
    """Return whether an overlap looks like full sizes given as half sizes."""
    lengths = [
        length
        for collision in body.collisions
        for length in (*collision.size_m, 2 * collision.size_m[-1])
        if collision.kind in ("box", "sphere", "cylinder")
    ]
    return any(abs(depth_m - length / 4) < HALF * length for length in lengths)


@pair_rule("static-parent", "asked", subject=1, engines=MUJOCOS)
def static_parent(pair: PairColumns, seen: Seen) -> Match:
    """A body collides with its parent only if the parent cannot move."""
    points = pair.points
    own = np.flatnonzero((points.body[:, 0] == points.body[:, 1]) & (points.normal_n > 0))
    both = np.column_stack([points.body[own, 0], np.sort(points.link[own], axis=1)])
    known, _, which = distinct_rows(both)
    is_so = [_is_parent(seen.bodies[number], a, b) for number, a, b in known.tolist()]
    so = np.array(is_so, np.bool_)[which]
    own, both = own[so], both[so]
    keys, _, which = distinct_rows(np.column_stack([pair.pairs.row[own], both]))
    force, depth = np.zeros(len(keys)), np.zeros(len(keys))
    np.add.at(force, which, points.normal_n[own])
    np.maximum.at(depth, which, -points.distance_m[own])
    return Match(keys[:, 0], depth, {"links": keys[:, 2:]}, most={"force": force}, keys=keys[:, 1:])


@static_parent.counts
def _(first: Int64, count: Int64, size: Float64, ends: Int64) -> Float64:
    lasts = (first <= 1) & (count >= EACH_STEP * (ends - 1))
    return np.where(lasts & (size >= DEEP_M), size, 0.0)


@static_parent.notes
def _(subject: Body, links: list[int]) -> Noted:
    parent, inner = (subject.links[link + 1] for link in links)
    return {"parent": parent, "child": inner}


static_parent.rows(
    SayingRow(
        says=Message(
            "{child} is {size:mm} inside {parent} from the first step on, and they "
            "push each other with up to {force:N}: parent and child do not collide unless "
            "the parent cannot move, as here"
        ),
        cure=Remedy("exclude", "child", given={"parent": "parent", "child": "child"}),
        effect="size",
        normal=DEEP_M,
    )
)


def _is_parent(body: Body, parent: int, link: int) -> bool:
    """Return whether only joints lie between a link and a parent that cannot move."""
    above = body.joints[link].parent
    while above != BASE and body.links[above + 1].startswith(f"{body.links[link + 1]}/"):
        above = body.joints[above].parent
    return above == parent and parent not in body.moving
