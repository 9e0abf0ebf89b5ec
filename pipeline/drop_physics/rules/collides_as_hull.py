"""The rule `collides-as-hull`: contacts away from the surface of a hollow mesh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.bodies import Record
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.rotations import rotate_inverse
from drop_physics.physics.tree import BASE
from drop_physics.physics.vectors import distinct_bytes, lengths
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, BULLETS
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, side_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import HULL_EVERY, HULL_OFF_M
from drop_physics.trace.events import Body, Surface
from drop_physics.trace.history import Seen

SAME_M = 1e-3
"""Points of a link closer together than this are examined as one."""


@side_rule("collides-as-hull", "asked", subject=1, engines=ANY)
def collides_as_hull(
    pair: PairColumns, seen: Seen, chunk: StepChunk, records: Mapping[int, Record]
) -> Match:
    """Bodies touch away from the surface of the mesh in its file."""
    points, side = pair.pairs.points, pair.side
    acts = (points.normal_n > 0) & (points.step % HULL_EVERY == 0)
    acts &= points.body[:, 0] != points.body[:, 1]
    off_m = np.zeros(len(pair.step))
    of_links: dict[tuple[int, int], list[Surface]] = {}
    for surface in seen.surfaces:
        of_links.setdefault(_link(seen, surface), []).append(surface)
    for (number, link), its in of_links.items():
        shapes = [
            collision for collision in seen.bodies[number].collisions if collision.link == link
        ]
        mine = (points.body[:, side] == number) & (points.link[:, side] == link)
        rows = np.flatnonzero(acts & mine)
        if len(shapes) > len(its) or not len(rows):
            continue  # another of its shapes may be what is touched
        local_m = _local_m(chunk, records, number, link, points.at_m[rows, side], points.step[rows])
        cells = (local_m / SAME_M).round() + 0.0  # of zeros only one
        firsts, which = distinct_bytes(cells)
        cells = cells[firsts]
        known, gaps_m = np.isfinite(cells).all(axis=1), np.zeros(len(cells))
        gaps_m[known] = np.min(
            [distances_m(cells[known] * SAME_M, each.corners_m, each.triangles) for each in its],
            axis=0,
        )
        # What rests in the overlap, or moves within the step, may be elsewhere by so much.
        moved = lengths(points.began_m_s[rows, side]) * points.timestep_s[rows]
        slack = HULL_OFF_M + np.maximum(-points.distance_m[rows], 0.0) + moved
        gaps_m = gaps_m[which]
        np.maximum.at(off_m, pair.pairs.row[rows], np.where(gaps_m > slack, gaps_m, 0.0))
    return Match(off_m > 0, off_m)


@collides_as_hull.notes
def _(seen: Seen, asked: AskedOfBodies, subject: Body, keys: list[int]) -> Noted:
    return {"other": seen.bodies[keys[1]].label, "loaded": asked.loaded(subject)}


collides_as_hull.rows(
    SayingRow(
        engines=BULLETS,
        advice=Message(
            'if it never moves, {call}, in a URDF <collision concave="yes">; '
            "else split it into convex parts, as p.vhacd(…) does"
        ),
    ),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{other} touches {body} {size:mm} off the surface of its mesh: {engine} "
            "collides the convex hull of a mesh, which closes its hollows"
        ),
        cure=Remedy("concave"),
        effect="size",
        normal="body_size_m",
        site="loaded",
    ),
)


def _link(seen: Seen, surface: Surface) -> tuple[int, int]:
    """Return the body and the link that a mesh surface belongs to."""
    return surface.body, seen.bodies[surface.body].collisions[surface.shape].link


def _local_m(
    chunk: StepChunk,
    records: Mapping[int, Record],
    number: int,
    link: int,
    at_m: Float64,
    ends: Int64,
) -> Float64:
    """Transform points into a link's axes before steps; nan where its pose is unknown."""
    local_m = np.full((len(at_m), 3), np.nan)
    if number not in chunk.judged and link == BASE:
        base = records[number].base_at(ends)
        return rotate_inverse(base[:, 3:7], at_m - base[:, :3])
    for _, steps in chunk.intervals(number):
        rows = np.flatnonzero(np.isin(ends, steps.steps))
        if len(rows) and steps.covered:
            at = np.searchsorted(steps.steps, ends[rows])
            kin = kinematics(steps.law.tree, steps.before.at(at))
            from_centre = at_m[rows] - kin.position_m(link)
            local_m[rows] = np.einsum("nji,nj->ni", kin.matrix(link), from_centre)
    return local_m


def distances_m(points_m: Float64, corners_m: Float64, triangles: Int64) -> Float64:
    """Return the distance of points from the nearest of the given triangles [m], shape (n,)."""
    a, b, c = (corners_m[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    kept = sizes > 0
    a, b, c, normals = a[kept], b[kept], c[kept], normals[kept] / sizes[kept, None]
    found = np.full(len(points_m), np.inf)
    for k, point in enumerate(points_m):
        nearest = np.inf
        inside = np.ones(len(a), np.bool_)
        for start, end in ((a, b), (b, c), (c, a)):
            edge, way = end - start, point - start
            share = np.einsum("ti,ti->t", way, edge) / np.einsum("ti,ti->t", edge, edge)
            gaps = np.linalg.norm(way - np.clip(share, 0.0, 1.0)[:, None] * edge, axis=1)
            nearest = min(nearest, float(gaps.min(initial=np.inf)))
            inside &= np.einsum("ti,ti->t", np.cross(edge, way), normals) >= 0
        above = np.abs(np.einsum("ti,ti->t", point - a, normals))
        found[k] = min(nearest, float(above[inside].min(initial=np.inf)))
    return found
