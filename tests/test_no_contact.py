"""Bodies that overlap without a contact: why, and that nothing is said of those that touch.

`explain/overlap` is judged by what PyBullet's `getClosestPoints` says of the same shapes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from asked import findings
from conftest import some
from drop_physics.arrays import Float64
from drop_physics.explain import overlap
from drop_physics.explain.convex import outside
from drop_physics.explain.overlap import PlacedShape, overlaps
from drop_physics.rules.answer import Finding
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
    """What is said to overlap does, by 1 mm and more; what overlaps by 5 mm is found."""
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
    """The gap is 5 mm everywhere; without an end, each of 100 samples takes 800 projections."""
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


WALL = "p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 1, 1])"
POSED = f"""
wall = p.createMultiBody(0, {WALL}, -1, [1, 0, 1])
hand = p.createMultiBody({{kg}}, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 1])
for i in range(240):
    p.resetBasePositionAndOrientation(hand, [0.005 * i, 0, 1], [0, 0, 0, 1])
    p.stepSimulation()
    {{read}}
"""
ARM = """
s = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05)
arm = p.createMultiBody(0, -1, -1, [0, 0, 0], linkMasses=[1] * {n},
    linkCollisionShapeIndices=[-1] * ({n} - 1) + [s], linkVisualShapeIndices=[-1] * {n},
    linkPositions=[[0.2, 0, 0]] * {n}, linkOrientations=[[0, 0, 0, 1]] * {n},
    linkInertialFramePositions=[[0, 0, 0]] * {n},
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * {n}, linkParentIndices=range({n}),
    linkJointTypes={kinds}, linkJointAxis=[[0, 0, 1]] * {n})
w = p.createMultiBody({kg}, p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 0.05, 1]), -1,
    [1, 0.15, 0])
p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, targetVelocity=1, force=50)
steps(240)
"""
TURNS, STAYS = "p.JOINT_REVOLUTE", "p.JOINT_FIXED"
FILTERED = """
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05] * 3)
a, b = (p.createMultiBody(1, s, -1, [x, 0, 0]) for x in (0, 0.3))
p.setCollisionFilterPair(a, b, -1, -1, 0)
{more}
p.resetBaseVelocity(a, [1, 0, 0])
steps(100)
"""
BAR = (
    '<inertial><origin xyz="{x} 0 0"/><mass value="1"/><inertia ixx="1e-3" iyy="1e-2" izz="1e-2" '
    'ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="{x} 0 0"/><geometry>'
    '<box size=".2 .04 .04"/></geometry></collision>'
)
FOLDS = f"""
import os, tempfile
path = os.path.join(tempfile.mkdtemp(), "ruler.urdf")
open(path, "w").write('''<robot name="ruler"><link name="one">{BAR.format(x=-0.15)}</link>
<link name="two">{BAR.format(x=0.15)}</link><joint name="hinge" type="continuous">
<parent link="one"/><child link="two"/><axis xyz="0 0 1"/></joint></robot>''')
b = p.loadURDF(path, useFixedBase=True, flags=p.URDF_USE_SELF_COLLISION{{more}})
p.setJointMotorControl2(b, 0, p.VELOCITY_CONTROL, targetVelocity=3, force=5)
steps(240)
folded = p.getJointState(b, 0)[0]
"""
SHAPELESS = """
p.setGravity(0, 0, -9.81)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_{floor}))
b = p.createMultiBody(1, {shape}, -1, [0, 0, {z}])
steps(240)
"""


def said(scene: str, path: Path) -> list[Finding]:
    """Return the findings of this code."""
    return [each for each in findings(scene, path / "a.rrd") if each.code == "no-contact"]


READ = "p.getContactPoints(hand, wall)"
BALL = "p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)"
PASSES = {
    "two without mass": (POSED.format(kg=0, read=READ), "both-static"),
    "a tool on the first link": (
        ARM.format(n=2, kinds=f"[{TURNS}, {STAYS}]", kg=0),
        "link-counted-static",
    ),
    "a pair that is off": (FILTERED.format(more=""), "filter"),
    "a link and its parent": (FOLDS.format(more=""), "parent-and-child"),
    "no shape": (SHAPELESS.format(floor="PLANE", shape=-1, z=1), "no-shape"),
}


@pytest.mark.parametrize("what", PASSES)
def test_what_passes_through_and_why(what: str, tmp_path: Path) -> None:
    scene, reason = PASSES[what]
    (found,) = said(scene, tmp_path)
    assert found.reason == reason
    assert found.level == ("note" if reason in ("filter", "parent-and-child") else "asked")
    assert found.steps is not None
    assert found.steps.count >= 5


TOUCHES = [
    POSED.format(kg=1, read=READ),
    POSED.format(kg=0, read=""),  # nobody asks whether they touch
    ARM.format(n=3, kinds=f"[{TURNS}, {TURNS}, {STAYS}]", kg=0),
    ARM.format(n=2, kinds=f"[{TURNS}, {STAYS}]", kg=5),
    FILTERED.format(more="p.setCollisionFilterPair(a, b, -1, -1, 1)"),
    FILTERED.format(
        more="p.createConstraint(a, -1, b, -1, p.JOINT_FIXED, [0] * 3, [0.3, 0, 0], [0] * 3)"
    ),
    FOLDS.format(more=" | p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT"),
    SHAPELESS.format(floor="PLANE", shape=BALL, z=1),
]


@pytest.mark.parametrize("scene", some(TOUCHES, 4))
def test_what_touches_is_left_in_peace(scene: str, tmp_path: Path) -> None:
    assert not said(scene, tmp_path)
