"""The table of constraints: gap, angle and force of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.joined import FIXED, POINT, ConstraintVersion
from drop_physics.physics.rotations import matrix
from drop_physics.physics.vectors import lengths
from drop_physics.rules.answer import Scene
from drop_physics.rules.body_properties import size_m
from drop_physics.trace.events import Body

Rows = NDArray[np.intp]


def constraint_columns(scene: Scene) -> Iterator[ConstraintColumns]:
    """Yield the constraints of the latest chunk that close all distance between two points."""
    for told, steps, forces in scene.constraints.in_steps():
        which = np.searchsorted([each.at.step for each in told], steps, side="left") - 1
        for made in dict.fromkeys(each.made.at.call for each in told):
            its = [each.made.at.call == made for each in told]
            rows = np.flatnonzero((which >= 0) & np.array(its)[which])
            if len(rows) and told[which[rows[0]]].kind in (FIXED, POINT):
                yield ConstraintColumns(scene, told, which[rows], steps[rows], forces[rows, :3])


class ConstraintColumns:
    """One constraint over n steps: columns of shape (n,); its forces have shape (n, 3) [N]."""

    def __init__(
        self,
        scene: Scene,
        told: list[ConstraintVersion],
        which: Rows,
        steps: Int64,
        forces_n: Float64,
    ) -> None:
        self.scene, self.step, self.forces_n = scene, steps, forces_n
        self.noted: Mapping[str, Float64] = {}
        self._told, self._which = told, which
        self.last: ConstraintVersion = told[which[-1]]
        """The constraint as defined in the last step."""
        self.began = self.last.made.at.step + 1
        """The first step in which the constraint acts."""
        self.keys = np.full((len(steps), 2), (self.bodies[-1].number, self.last.made.at.call))
        self.timestep_s = scene.times[self.bodies[0].client].of_steps(steps)[0]

    @property
    def bodies(self) -> list[Body]:
        """Parent and child of the constraint, without the world."""
        return [self.scene.body(number) for number in self.last.bodies if number >= 0]

    @property
    def part_m(self) -> float:
        """Size of the smaller part: the diagonal of its bounding box, or its body's size."""
        sizes: list[float] = []
        for number, link in zip(self.last.bodies, self.last.links, strict=True):
            if number >= 0:
                body = self.scene.body(number)
                box = np.array(body.bounds_m[6 * (link + 1) : 6 * (link + 2)])
                diagonal = float(np.linalg.norm(box[3:] - box[:3])) if len(box) == 6 else 0.0
                sizes.append(diagonal or size_m(body))
        return min(sizes)

    def of_held(self, number: Callable[[ConstraintVersion], float]) -> Float64:
        """Return a numeric property of the constraint in each step, shape (n,)."""
        return np.array([number(each) for each in self._told], np.float64)[self._which]

    def apart_at_first(self) -> tuple[float, float]:
        """Return gap [m] and angle [rad] of a new or changed constraint before its first step.

        The least of these; nan if its first step is not in this piece.
        """
        began = [each for each in self._told if each.made.at.call == self.last.made.at.call]
        began = [each for each in began if each.at.step < self.began]
        if self.step[0] != self.began or not began:
            return np.nan, np.nan
        ends = [self._ends(each, self.step[:1], after=False) for each in began]
        gaps, angles = zip(*(_apart(*end) for end in ends), strict=True)
        return float(np.min(gaps)), float(np.min(angles)) if self.last.kind == FIXED else 0.0

    def apart_after(self, rows: Rows) -> tuple[Float64, Float64]:
        """Return gap [m] and angle [rad] after the given steps, shape (m,) each."""
        return _apart(*self._ends(self.last, self.step[rows], after=True))

    def points_m(self, rows: Rows) -> Float64:
        """Return both anchor points after the given steps, shape (m, 2, 3); nan where unknown."""
        return self._ends(self.last, self.step[rows], after=True)[0]

    def tail(self, name: str, values: NDArray[Any], rows: int) -> NDArray[Any]:
        """Return the last rows of an array, extended back into earlier chunks as far as possible.

        `values` are those of the last steps of the chunk, `rows` of them or all.
        """
        key = f"constraint {name}", self.last.made.at.call
        before = self.scene.carried.get(key, values[:0])
        self.scene.carried[key] = np.concatenate([before, values])[-rows:]
        return self.scene.carried[key]

    def _ends(
        self, held: ConstraintVersion, samples: Int64, *, after: bool
    ) -> tuple[Float64, Float64]:
        """Return origins and axes of both frames, shape (m, 2, 3) and (m, 2, 3, 3)."""
        points_m = np.full((len(samples), 2, 3), np.nan)
        axes = np.full((len(samples), 2, 3, 3), np.nan)
        for side, (number, link) in enumerate(zip(held.bodies, held.links, strict=True)):
            point_m, turn = held.pivots_m[side], matrix(held.orientations[side])
            place_m, turned = np.zeros(3), np.eye(3)
            if number >= 0:
                place_m, turned = self.scene.placed(number, link, samples, after=after)
            points_m[:, side], axes[:, side] = place_m + turned @ point_m, turned @ turn
        return points_m, axes


def _apart(points_m: Float64, axes: Float64) -> tuple[Float64, Float64]:
    """Return the distances and angles between two frames, shape (m,) each."""
    turned = np.einsum("nji,njk->nik", axes[:, 0], axes[:, 1])
    cosine = ((np.trace(turned, axis1=1, axis2=2) - 1) / 2).clip(-1, 1)
    return lengths(points_m[:, 0] - points_m[:, 1]), np.arccos(cosine)
