"""Overlap depth of moving convex hulls, against a check of all faces and what engines measure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import some
from drop_physics.arrays import Float64
from drop_physics.explain.convex import hull_faces
from drop_physics.explain.solids import AT_ONCE, MOST_CORNERS, overlap_m, solid_of
from drop_physics.physics.columns import rotation
from drop_physics.physics.tree import BASE
from drop_physics.recording import rrd, schema
from drop_physics.recording.reader import read
from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script
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


AT, TURN = (0.4, -0.2, 0.3), (0.18257419, 0.36514837, 0.54772256, 0.73029674)
"""Pose of a mesh on its link."""
CORNERS = np.reshape(CUBE, (-1, 3))
FACES = "124 143 578 586 156 162 348 387 137 175 268 284"
"""Triangles of the cube, by the numbers of their corners."""
IN_PYBULLET = """
import pybullet as p
p.connect(p.DIRECT)
back = p.invertTransform({at}, {turn})
def cube(mass, scale, x):
    shape = p.createCollisionShape(
        p.GEOM_MESH, fileName="cube.obj", meshScale=[scale] * 3, collisionFramePosition={at},
        collisionFrameOrientation={turn})
    return p.createMultiBody(mass, shape, -1, *p.multiplyTransforms([x, 0, 0], [0, 0, 0, 1], *back))
one, two = cube(0, 1, 0), cube(1, 0.5, 0.21)
p.setCollisionFilterPair(one, two, -1, -1, 0)
p.resetBaseVelocity(two, [-1, 0, 0])
for _ in range(24):
    p.stepSimulation()
print(-min(each[8] for each in p.getClosestPoints(one, two, 0.0)))
"""
IN_MUJOCO = """
import mujoco, numpy as np
at, (x, y, z, w) = np.array({at}), {turn}
turned = np.zeros(3)
mujoco.mju_rotVecQuat(turned, at, np.array([w, -x, -y, -z]))
bodies = "".join(
    f"<body name='{{name}}' pos='{{here - turned[0]}} {{-turned[1]}} {{-turned[2]}}' "
    f"quat='{{w}} {{-x}} {{-y}} {{-z}}'>{{joint}}<inertial pos='0.1 0.2 0' quat='1 1 0 0' mass='1' "
    f"diaginertia='1 1 1'/><geom type='mesh' mesh='{{name}}' pos='{{at[0]}} {{at[1]}} {{at[2]}}' "
    f"quat='{{w}} {{x}} {{y}} {{z}}'/></body>"
    for name, here, joint in (("one", 0, ""), ("two", 0.21, "<freejoint/>"))
)
model = mujoco.MjModel.from_xml_string(
    "<mujoco><option gravity='0 0 0'/><asset><mesh name='one' file='cube.obj'/>"
    "<mesh name='two' file='cube.obj' scale='0.5 0.5 0.5'/></asset>"
    f"<worldbody>{{bodies}}</worldbody>"
    "<contact><exclude body1='one' body2='two'/></contact></mujoco>"
)
data = mujoco.MjData(model)
data.qvel[0] = -1
for _ in range(50):
    mujoco.mj_step(model, data)
mujoco.mj_kinematics(model, data)
print(-mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None))
"""


@pytest.mark.parametrize(
    "scene", [pytest.param(IN_PYBULLET, marks=pytest.mark.pybullet), IN_MUJOCO], ids=["P", "M"]
)
def test_a_mesh_stands_where_its_offset_puts_it(
    scene: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two cubes overlap along x as deep as the engine says, and are drawn where it has them."""
    monkeypatch.chdir(tmp_path)
    lines = ["v {} {} {}".format(*corner) for corner in CORNERS]
    Path("cube.obj").write_text("\n".join([*lines, *("f " + " ".join(f) for f in FACES.split())]))
    Path("script.py").write_text(scene.format(at=AT, turn=TURN))
    made = record_script("script.py", out=tmp_path / "script.rrd")
    measured_m = float(capfd.readouterr().out.split("\n")[-2])
    analysis = analyze(made.recording)
    (row,) = [row for row in analysis.account if row.kind == "idle" and row.unit == "m"]
    assert 0.035 < measured_m < 0.045
    assert row.got == pytest.approx(measured_m, abs=2.1e-3)  # Bullet's meshes have margins of 1 mm
    drawn = next(
        chunk.batch.column("Mesh3D:vertex_positions").flatten().to_pylist()
        for chunk in rrd.chunks(made.recording)
        if chunk.entity.startswith(f"{schema.COLLISIONS}/0_")
    )
    base = next(put.base for put in read(made.recording).seen.puts if put.body.number == 0)
    in_world_m = base[:3] + np.array(drawn) @ rotation(base[3:7, None])[..., 0].T
    assert np.abs(in_world_m) == pytest.approx(np.full((36, 3), 0.1), abs=1.1e-3)  # 1 mm beyond
