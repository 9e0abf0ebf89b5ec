"""The table of shape pairs with excluded contacts, in the steps in which they overlap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.solids import overlap_m
from drop_physics.physics.columns import rotation
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.tree import BASE
from drop_physics.rules.answer import Scene

EVERY = 2000
"""Number of steps of a chunk that are examined."""


@dataclass(frozen=True, eq=False)
class FilteredColumns:
    """Pairs of shapes and steps in which they overlap; all arrays have shape (n,)."""

    keys: Int64
    """Both body ids, and the index of the pair in `FilteredPairs.pairs`, shape (n, 3)."""
    step: Int64
    depth_m: Float64
    noted: Mapping[str, Float64]


def filtered_columns(scene: Scene) -> Iterator[FilteredColumns]:
    """Yield the table of the latest chunk, without pairs that overlap from the beginning."""
    poses: dict[int, tuple[Int64, Kinematics]] = {}
    at_first, pairs = scene.filtered.at_first, scene.filtered.pairs
    for number, judged in scene.judged.items() if pairs else ():
        intervals = [interval for interval in judged.intervals if len(interval)]
        if len(intervals) == 1:  # else its model is edited on the way
            (its,) = intervals
            rows = np.arange(0, len(its), max(1, -(-len(its) // EVERY)))
            poses[number] = its.steps[rows] - 1, kinematics(its.law.tree, its.before.at(rows))
    for place, pair in enumerate(pairs):
        lead = next((body for body in pair.bodies if body in poses), None)
        if place in at_first or lead is None:
            continue
        steps = poses[lead][0]
        where = [
            _where(scene, number, solid.collision.link, steps, poses.get(number))
            for number, solid in zip(pair.bodies, pair.solids, strict=True)
        ]
        if where[0] is None or where[1] is None:
            continue
        depth = overlap_m(pair.solids[0], where[0], pair.solids[1], where[1])
        if steps[0] == 0 and depth[0] > 0:
            at_first.add(place)
            continue
        rows = np.flatnonzero(depth)
        keys = np.tile((*pair.bodies, place), (len(rows), 1))
        yield FilteredColumns(keys, steps[rows] + 1, depth[rows], {})


def _where(
    scene: Scene, number: int, link: int, steps: Int64, pose: tuple[Int64, Kinematics] | None
) -> tuple[Float64, Float64] | None:
    """Return positions and rotations of a link before steps; None if they are unknown."""
    if pose is not None:
        same = np.array_equal(pose[0], steps)
        return (pose[1].position_m(link), pose[1].matrix(link)) if same else None
    if link != BASE or number not in scene.records:
        return None
    base = scene.records[number].base_at(steps)
    return base[:, :3], np.moveaxis(rotation(base[:, 3:7].T), -1, 0)
