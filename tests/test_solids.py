"""Overlap depth of moving convex hulls, against a check of all faces in each step."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import some
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


UP = (0.0, 0.0, 0.0, 1.0)
CUBE = tuple(float(s * 0.1) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1) for s in (x, y, z))
SHAPES = {
    "sphere": ((0.1, 0.1, 0.1), {"radius": 0.1}),
    "box": ((0.2, 0.4, 0.1), {"halfExtents": (0.1, 0.2, 0.05)}),
    "capsule": ((0.3, 0.08), {"radius": 0.08, "height": 0.3}),
    "cylinder": ((0.3, 0.08), {"radius": 0.08, "height": 0.3}),
    "mesh": ((1.0, 1.0, 1.0), {"vertices": np.reshape(CUBE, (-1, 3)).tolist()}),
}


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("one", "two"),
    some([(a, b) for k, a in enumerate(SHAPES) for b in list(SHAPES)[k:]], 4),
)
def test_overlap_is_no_more_than_the_engine_measures(one: str, two: str) -> None:
    """Reported overlaps are real; those deeper than 30 mm are found."""
    import pybullet as p

    random = np.random.default_rng(7)
    poses = np.hstack((random.uniform(-0.2, 0.2, (60, 3)), random.normal(size=(60, 4))))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
    solids = [
        solid_of(Collision(BASE, kind, SHAPES[kind][0], "", *PLACE, CUBE * (kind == "mesh")))
        for kind in (one, two)
    ]
    assert solids[0] is not None
    assert solids[1] is not None
    still = np.zeros((60, 3)), np.tile(np.eye(3), (60, 1, 1))
    turned = poses[:, :3], np.moveaxis(rotation(poses[:, 3:].T), -1, 0)
    found_m = overlap_m(solids[0], still, solids[1], turned)
    client = p.connect(p.DIRECT)
    bodies = [
        p.createMultiBody(
            0,
            p.createCollisionShape(getattr(p, f"GEOM_{kind.upper()}"), **SHAPES[kind][1]),
            physicsClientId=client,
        )
        for kind in (one, two)
    ]
    for pose, depth_m in zip(poses, found_m.tolist(), strict=True):
        p.resetBasePositionAndOrientation(
            bodies[1], pose[:3].tolist(), pose[3:].tolist(), physicsClientId=client
        )
        near = p.getClosestPoints(*bodies, 0.5, physicsClientId=client)
        deep_m = -min((each[8] for each in near), default=0.0)
        assert depth_m < max(deep_m, 0.0) + 2e-3  # meshes have margins of 1 mm
        assert depth_m > 0 or deep_m < 0.03 + 2e-3
    p.disconnect(client)
    assert 10 < (found_m > 0).sum() < 60
