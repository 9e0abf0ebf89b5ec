"""`collides-as-hull`: a mesh with a hollow is touched where its file has no surface."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.bodies import records_of
from drop_physics.explain.contact_points import Points
from drop_physics.messages import Message
from drop_physics.physics.columns import rotation
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Notes, Scene
from drop_physics.rules.body_properties import size_m
from drop_physics.trace.events import Surface

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

OFF_M = 2e-3
"""Margins put points of contact less far off a surface."""
EVERY = 8
"""The steps that are examined, as a touch lasts."""
SAME_M = 1e-3
"""Points of a link this close are looked at once."""


class CollidesAsHull(Answer):
    """The engine says where bodies touch; how far that is off the file's surface is geometry."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._surfaces: dict[tuple[int, int], list[Surface]] = {}
        for each in scene.seen.surfaces:
            link = scene.body(each.body).collisions[each.shape].link
            self._surfaces.setdefault((each.body, link), []).append(each)
        for number, link in [*self._surfaces]:
            shapes = [each for each in scene.body(number).collisions if each.link == link]
            if len(shapes) > len(self._surfaces[number, link]):
                del self._surfaces[number, link]  # another of its shapes may be what is touched
        self._records = records_of(scene.seen) if self._surfaces else {}
        self._found: Notes[tuple[int, int]] = Notes()

    def see(self) -> None:
        """Take a piece."""
        if not self._surfaces:
            return
        points = self.scene.touches.pairs.points
        acts = (points.normal_n > 0) & (points.step % EVERY == 0)
        acts &= points.body[:, 0] != points.body[:, 1]
        for (number, link), surfaces in self._surfaces.items():
            for side in (0, 1):
                its = (points.body[:, side] == number) & (points.link[:, side] == link)
                rows = np.flatnonzero(acts & its)
                if len(rows):
                    self._look(number, link, surfaces, points, rows, side)

    def _look(
        self,
        number: int,
        link: int,
        surfaces: list[Surface],
        points: Points,
        rows: NDArray[np.intp],
        side: int,
    ) -> None:
        """Compare points of contact with the surfaces of a link."""
        local_m = self._local_m(number, link, points.at_m[rows, side], points.step[rows])
        cells, which = np.unique((local_m / SAME_M).round(), axis=0, return_inverse=True)
        known = np.isfinite(cells).all(axis=1)
        gaps_m = np.full(len(cells), -1.0)
        gaps_m[known] = np.min(
            [
                distances_m(cells[known] * SAME_M, each.corners_m, each.triangles)
                for each in surfaces
            ],
            axis=0,
        )
        # What rests in the overlap, or moves within the step, may be elsewhere by so much.
        moved = np.linalg.norm(points.began_m_s[rows, side], axis=1) * points.timestep_s[rows]
        slack = OFF_M + SAME_M + np.maximum(-points.distance_m[rows], 0.0) + moved
        off = gaps_m[which.ravel()] > slack
        for other in np.unique(points.body[rows[off], 1 - side]).tolist():
            its = np.flatnonzero(off & (points.body[rows, 1 - side] == other))
            steps, first = np.unique(points.step[rows[its]], return_index=True)
            most = np.maximum.reduceat(gaps_m[which.ravel()[its]], first)
            self._found.add((number, other), steps, most)

    def _local_m(self, number: int, link: int, at_m: Float64, ends: Int64) -> Float64:
        """Return points in the axes of a link as steps began; nan where its pose is not known."""
        local_m = np.full((len(at_m), 3), np.nan)
        if number not in self.scene.judged and link == BASE:
            base = self._records[number].told(ends)
            turns = np.moveaxis(rotation(base[:, 3:7].T), -1, 0)
            return np.asarray(np.einsum("nji,nj->ni", turns, at_m - base[:, :3]))
        for _, steps in self.scene.stretches(number):
            rows = np.flatnonzero(np.isin(ends, steps.steps))
            if len(rows) and steps.covered:
                at = np.searchsorted(steps.steps, ends[rows])
                kin = kinematics(steps.law.tree, steps.before.at(at))
                from_centre = at_m[rows] - kin.position_m(link)
                local_m[rows] = np.einsum("nji,nj->ni", kin.matrix(link), from_centre)
        return local_m

    def findings(self) -> Iterator[Finding]:
        """Yield each mesh with what touches it farthest off its surface."""
        for number in dict.fromkeys(number for number, _ in self._found):
            mine = {other: each for (one, other), each in self._found.items() if one == number}
            other, found = max(mine.items(), key=lambda each: each[1].most)
            body = self.scene.body(number)
            yield Finding(
                code="collides-as-hull",
                level="asked",
                message=Message(
                    "{other} touches {body} {off:.3g} mm off the surface of its mesh: PyBullet "
                    "collides the convex hull of a mesh, which closes its hollows",
                    other=self.scene.body(other).label,
                    body=body.label,
                    off=found.most * 1e3,
                ),
                advice=Message(
                    "if it never moves, p.createCollisionShape(…, "
                    'flags=p.GEOM_FORCE_CONCAVE_TRIMESH), in a URDF <collision concave="yes">; '
                    "else split it into convex parts, as p.vhacd(…) does"
                ),
                cure=Cure("concave"),
                body=body.label,
                other=self.scene.body(other).label,
                effect=Effect(found.most, "m"),
                share=found.most / size_m(body),
                steps=found.span,
                site=self.scene.asked.loaded(body),
            )


def distances_m(points_m: Float64, corners_m: Float64, triangles: Int64) -> Float64:
    """Return how far points are from the nearest of some triangles [m], shape (n,)."""
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
