"""Overlap of collision shapes, against PyBullet's `getClosestPoints` for the same shapes.

Why some make no contact is in `corpus/attacks/contacts.toml`.
"""

from __future__ import annotations

import numpy as np
import pybullet as p
import pytest
from conftest import some
from drop_physics.arrays import Float64
from drop_physics.explain import overlap
from drop_physics.explain.convex import outside
from drop_physics.explain.overlap import PlacedShape, overlaps
from drop_physics.trace.events import Collision

UP = (0.0, 0.0, 0.0, 1.0)
HALF = (0.1, 0.2, 0.05)
CUBE = tuple(float(s * 0.1) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1) for s in (x, y, z))
SHAPES = {
    "sphere": ((0.1, 0.1, 0.1), {"radius": 0.1}),
    "box": (tuple(2 * each for each in HALF), {"halfExtents": HALF}),
    "capsule": ((0.3, 0.08), {"radius": 0.08, "height": 0.3}),
    "cylinder": ((0.3, 0.08), {"radius": 0.08, "height": 0.3}),
    "mesh": ((1.0, 1.0, 1.0), {"vertices": np.reshape(CUBE, (-1, 3)).tolist()}),
}


def shape(kind: str, poses: np.ndarray) -> PlacedShape:
    hull = CUBE if kind == "mesh" else ()
    held = Collision(-1, kind, SHAPES[kind][0], "", (0.0, 0.0, 0.0), UP, hull)
    return PlacedShape(held, poses[:, :3], poses[:, 3:])


@pytest.mark.parametrize(
    ("one", "two"),
    some([(a, b) for k, a in enumerate(SHAPES) for b in list(SHAPES)[k:]], 4),
)
def test_overlap_is_what_the_engine_measures(one: str, two: str) -> None:
    """Reported overlaps are real, by at least 1 mm; overlaps of 5 mm are found."""
    random = np.random.default_rng(7)
    poses = np.hstack((random.uniform(-0.2, 0.2, (60, 3)), random.normal(size=(60, 4))))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
    still = np.tile([0.0, 0, 0, *UP], (60, 1))
    found = overlaps(shape(one, still), shape(two, poses), 1e-3)
    client = p.connect(p.DIRECT)
    bodies = [
        p.createMultiBody(
            0,
            p.createCollisionShape(getattr(p, f"GEOM_{kind.upper()}"), **SHAPES[kind][1]),
            physicsClientId=client,
        )
        for kind in (one, two)
    ]
    for pose, deep in zip(poses, found.tolist(), strict=True):
        p.resetBasePositionAndOrientation(
            bodies[1], pose[:3].tolist(), pose[3:].tolist(), physicsClientId=client
        )
        near = p.getClosestPoints(*bodies, 0.5, physicsClientId=client)
        deep_m = -min((each[8] for each in near), default=0.0)
        assert deep_m > 0.5e-3 if deep else deep_m < 8e-3  # meshes have margins of 1 mm
    p.disconnect(client)
    assert 10 < found.sum() < 60


def test_shapes_that_are_apart_are_known_to_be_after_a_few_looks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The gap is 5 mm everywhere; without early stopping, 100 samples take 800 projections each."""
    looks = [0]

    def counted(shape: Collision, local: Float64) -> tuple[Float64, Float64]:
        looks[0] += len(local)
        return outside(shape, local)

    monkeypatch.setattr(overlap, "outside", counted)
    still = np.tile([0.0, 0, 0, *UP], (100, 1))
    beside = still + np.linspace(0, 0.1, 100)[:, None] * [0, 1, 1, 0, 0, 0, 0]
    beside[:, 0] = 0.205
    assert not overlaps(shape("mesh", still), shape("mesh", beside), 1e-3).any()
    assert looks[0] < 20 * len(still)
    beside[:, 0] = 0.195
    assert overlaps(shape("mesh", still), shape("mesh", beside), 1e-3).all()
