"""Overlap depth of moving convex hulls, against a check of all faces in each step."""

from __future__ import annotations

import numpy as np
import pytest
from drop_physics.arrays import Float64
from drop_physics.explain.convex import hull_faces
from drop_physics.explain.solids import AT_ONCE, MOST_CORNERS, overlap_m, solid_of
from drop_physics.physics.columns import rotation
from drop_physics.physics.tree import BASE
from drop_physics.trace.events import Collision

STEPS = 100
PLACE = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)


def egg(corners: int, seed: int) -> Collision:
    """Return a hull of random corners on an ellipsoid, which rotates off its centre."""
    points = np.random.default_rng(seed).normal(size=(corners, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points = points * [0.05, 0.05, 0.14] + [0.0, 0.0, 0.1]
    return Collision(BASE, "mesh", (1.0,) * 3, "", *PLACE, hull_m=tuple(points.ravel().tolist()))


def by_all_faces(shape: Collision, points_m: Float64) -> float:
    """Return the depth of the deepest of several points in a hull; 0 if none is inside."""
    faces = hull_faces(shape.hull_m)
    assert faces is not None
    return max(0.0, float(-(points_m @ faces[:, :3].T + faces[:, 3]).max(axis=1).min()))


@pytest.mark.parametrize("turns_rad", [0.05, 1.0, 12.0])
def test_overlap_of_moving_hulls_is_that_of_each_step(turns_rad: float) -> None:
    """The hulls may move far within these steps, and may separate in between."""
    one, two = egg(400, 0), egg(300, 1)
    solids = [solid_of(one), solid_of(two)]
    assert solids[0] is not None
    assert solids[1] is not None
    assert STEPS * len(hull_faces(one.hull_m)) * MOST_CORNERS > 4 * AT_ONCE  # type: ignore[arg-type]
    angle = np.linspace(0.0, turns_rad, STEPS)
    half = np.stack((np.sin(angle / 2), 0 * angle, 0 * angle, np.cos(angle / 2)))
    turned = np.moveaxis(rotation(half), -1, 0)
    moved_m = np.stack((0.03 * np.sin(angle), 0 * angle, 0.2 + 0.01 * angle), axis=1)
    there = np.zeros((STEPS, 3)), np.tile(np.eye(3), (STEPS, 1, 1))
    found_m = overlap_m(solids[0], there, solids[1], (moved_m, turned))
    expected_m = [
        max(
            by_all_faces(one, solids[1].points_m @ turn.T + at_m),
            by_all_faces(two, (solids[0].points_m - at_m) @ turn),
        )
        for turn, at_m in zip(turned, moved_m, strict=True)
    ]
    assert max(expected_m) > 0.02
    assert found_m == pytest.approx(np.array(expected_m), abs=1e-14)
