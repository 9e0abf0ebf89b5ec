"""Verification: the joint table, against PyBullet's own values and the commands of calls."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import pybullet as p
import pytest
from asked import found
from clients import release_clients
from conftest import some
from drop_physics.account.joints import JointRow
from scenes import HEAD
from tabled import rows

KUKA = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
pose = [0, 0.8, 0, -1.2, 0, 0.6, 0]
def go(force, joints=range(7)):
    for j in joints:
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, pose[j], force=force)
"""
PANDA = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
pose = [0, 0.3, 0, -2.2, 0, 2.5, 0.8]
for j, q in enumerate(pose):
    p.resetJointState(k, j, q)
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=200)
"""
BOX = """
c = p.createMultiBody({mass}, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.03] * 3), -1,
    p.getLinkState(k, 6, computeForwardKinematics=True)[0])
p.setCollisionFilterGroupMask(c, -1, 0, 0)
"""
J2, J4 = "lbr_iiwa_joint_2", "lbr_iiwa_joint_4"


def run(scene: str) -> dict[str, Any]:
    """Run a scene in bare PyBullet; return its variables, with its client still connected."""
    release_clients()  # what a scene calls is client 0
    names: dict[str, Any] = {}
    exec(HEAD, names)
    exec(textwrap.dedent(scene), names)
    return names


def holds(scene: str, body: int = 0) -> dict[str, float]:
    """Return the result of `calculateInverseDynamics` for a scene's final pose."""
    run(scene)
    try:
        moving = [j for j in range(p.getNumJoints(body)) if p.getJointInfo(body, j)[2] in (0, 1)]
        q = [p.getJointState(body, j)[0] for j in moving]
        efforts = p.calculateInverseDynamics(body, q, [0.0] * len(q), [0.0] * len(q))
        return {
            p.getJointInfo(body, j)[1].decode(): effort
            for j, effort in zip(moving, efforts, strict=True)
        }
    finally:
        p.disconnect()


@pytest.mark.parametrize(
    "scene",
    [
        KUKA + "go(60)\nsteps(900)\n",
        KUKA.replace("[0, 0.8", "[0.4, -0.3") + "p.setGravity(1, 2, -3)\ngo(300)\nsteps(300)\n",
        PANDA + "steps(200)\n",
        KUKA + "go(30)\nsteps(333)\n",  # moving: what holding the pose would take
    ],
)
def test_free_it_takes_what_inverse_dynamics_says(scene: str, tmp_path: Path) -> None:
    found = rows(scene, tmp_path / "a.rrd")
    expected = holds(scene)
    most = max(map(abs, expected.values()))
    for name, effort in expected.items():
        assert found[name].needs == pytest.approx(effort, abs=1e-9 * most)


def test_an_arm_that_sags_onto_a_floor_needs_what_it_would_without(tmp_path: Path) -> None:
    scene = KUKA.replace("k =", 'p.loadURDF("plane.urdf")\nk =') + "go(30)\nsteps(480)\n"
    expected = holds(scene, 1)
    joint = rows(scene, tmp_path / "a.rrd", 1)[J2]
    assert joint.needs == pytest.approx(expected[J2], rel=1e-9)
    assert joint.needs == pytest.approx(-46, abs=0.5)
    assert joint.needs_at_target == pytest.approx(-41.1425, abs=1e-3)
    assert (joint.control, joint.target, joint.torque) == ("position", 0.8, -30)
    assert joint.off == pytest.approx(0.54, abs=0.01)
    assert joint.at_force_limit_steps == 480
    assert joint.force_limit == pytest.approx(30)


@pytest.mark.parametrize(
    ("mass", "kind"),
    some([(3, "FIXED"), (12, "FIXED"), (6, "POINT2POINT"), (12, "POINT2POINT")], 1),
)
def test_what_an_arm_carries_is_needed_too(mass: float, kind: str, tmp_path: Path) -> None:
    scene = (
        KUKA
        + "for j, q in enumerate(pose):\n    p.resetJointState(k, j, q)\n"
        + BOX.format(mass=mass)
        + f"p.createConstraint(k, 6, c, -1, p.JOINT_{kind}, [0] * 3, [0] * 3, [0] * 3)\n"
        + "go({force})\nsteps(1200)\n"
    )
    run(scene.format(force=1000))
    strong = p.getJointState(0, 1)[3]
    p.disconnect()
    joint = rows(scene.format(force=1000), tmp_path / "a.rrd")[J2]
    assert joint.needs == pytest.approx(strong, rel=1e-3)
    assert joint.needs_at_target == pytest.approx(strong, rel=1e-3)
    weak = rows(scene.format(force=30), tmp_path / "b.rrd")[J2]
    assert weak.needs_at_target == pytest.approx(strong, rel=1e-2)


GRIP = (
    PANDA.replace("k =", 'p.loadURDF("plane.urdf")\nk =')
    + """
for j in (9, 10):
    p.resetJointState(k, j, 0.04)
s = p.getLinkState(k, 11, computeForwardKinematics=True)
c = p.loadURDF("cube_small.urdf", s[0], s[1])
for j in (9, 10):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0, force={force})
steps(480)
"""
)


@pytest.mark.parametrize("force", [10, 40])
def test_a_grip_does_not_need_its_own_force(force: float, tmp_path: Path) -> None:
    scene = GRIP.format(force=force)
    found = rows(scene, tmp_path / "a.rrd", 1)
    fingers = [row for name, row in found.items() if "finger" in name]
    assert [row.needs for row in fingers] == [None, None]
    assert all(row.at_force_limit_steps > 400 for row in fingers)
    # The arm carries the cube: 0.98 N.
    alone, joint = holds(scene, 1)["panda_joint2"], found["panda_joint2"]
    assert joint.needs == pytest.approx(joint.torque, rel=1e-3)
    assert 0.3 < abs(joint.needs or 0) - abs(alone) < 0.7


@pytest.mark.long
def test_a_load_that_two_share_belongs_to_neither(tmp_path: Path) -> None:
    scene = """
    p.setGravity(0, 0, -9.81)
    arms = [p.loadURDF("kuka_iiwa/model.urdf", [0, y, 0], useFixedBase=True) for y in (-.3, .3)]
    pose = [0, 1.0, 0, -0.8, 0, 0.5, 0]
    for k in arms:
        for j, q in enumerate(pose):
            p.resetJointState(k, j, q)
            p.setJointMotorControl2(k, j, p.POSITION_CONTROL, q, force=300)
    x, _, z = p.getLinkState(k, 6, computeForwardKinematics=True)[0]
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.2, 0.02])
    bar = p.createMultiBody(8, shape, -1, [x, 0, z])
    p.setCollisionFilterGroupMask(bar, -1, 0, 0)
    for k, y in zip(arms, (-0.3, 0.3)):
        p.createConstraint(k, 6, bar, -1, p.JOINT_POINT2POINT, [0] * 3, [0] * 3, [0, y, 0])
    steps(300)
    """
    for body in (0, 1):
        assert rows(scene, tmp_path / "a.rrd", body)[J2].needs is None


def test_a_robot_that_stands_does_not_hang(tmp_path: Path) -> None:
    scene = """
    p.setGravity(0, 0, -9.81)
    p.loadURDF("plane.urdf")
    b = p.loadURDF("laikago/laikago_toes.urdf", [0, 0, 0.48], [0, 0.5, 0.5, 0])
    for j in range(p.getNumJoints(b)):
        if p.getJointInfo(b, j)[2] == 0:
            p.setJointMotorControl2(b, j, p.POSITION_CONTROL, 0, force=40)
    steps(240)
    """
    found = rows(scene, tmp_path / "a.rrd", 1)
    assert len(found) == 12
    assert all(row.needs is None for row in found.values())


def row_of(calls: str, tmp_path: Path, name: str = J2) -> JointRow:
    return rows(KUKA + calls + "\nsteps(30)\n", tmp_path / "a.rrd")[name]


def test_each_mode_is_known(tmp_path: Path) -> None:
    calls = """
p.setJointMotorControl2(k, 1, p.VELOCITY_CONTROL, targetVelocity=0.5, force=50)
p.setJointMotorControl2(k, 2, p.VELOCITY_CONTROL, force=0)
p.setJointMotorControl2(k, 3, p.PD_CONTROL, targetPosition=0.2, positionGain=20, force=7)
p.setJointMotorControlArray(k, [4, 5], p.POSITION_CONTROL, [0.1, 0.2], forces=[30, 20])
p.setJointMotorControl2(k, 6, p.POSITION_CONTROL, 0.3, force=0)
p.setJointMotorControl2(k, 6, p.TORQUE_CONTROL, force=0.1)
"""
    found = [*rows(KUKA + calls + "steps(30)\n", tmp_path / "a.rrd").values()]
    assert [row.control for row in found] == [
        "default",
        "velocity",
        "off",
        "pd",
        "position",
        "position",
        "torque",
    ]
    assert [row.target for row in found] == [None, 0.5, None, 0.2, 0.1, 0.2, None]
    limits = [row.force_limit for row in found]
    assert limits == pytest.approx([240, 50, 0, 7, 30, 20, 0])
    assert [row.off is None for row in found] == [True, False, True, False, False, False, True]
    assert found[1].reached == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(
    ("calls", "limit"),
    [
        ("go(100)\np.setTimeStep(1 / 60)", 25.0),
        ("p.setTimeStep(1 / 60)\ngo(100)", 100.0),
        ("go(100)\np.setPhysicsEngineParameter(fixedTimeStep=1 / 1000)", 416.667),
        ("p.setTimeStep(1 / 60)", 60.0),
        ("go(100)\nsteps(5)\np.setTimeStep(1 / 60)\nsteps(5)\ngo(100, [1])", 100.0),
    ],
)
def test_a_motor_keeps_an_impulse(calls: str, limit: float, tmp_path: Path) -> None:
    assert row_of(calls, tmp_path).force_limit == pytest.approx(limit, rel=1e-5)


def test_what_is_sent_on_with_every_step_follows_behind(tmp_path: Path) -> None:
    """A gain k leaves 1 - k of a gap, so targets δ apart are followed (1 - k) δ / k behind."""
    scene = """
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
    arm = p.createMultiBody(0, -1, -1, linkMasses=[1], linkCollisionShapeIndices=[box],
        linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0.3, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
    for k in range(240):
        p.setJointMotorControl2(arm, 0, p.POSITION_CONTROL, 0.01 * k, force=1e4, positionGain=0.2)
        p.stepSimulation()
    """
    (one,) = found(scene, tmp_path, "off-target")
    assert one.effect is not None
    assert one.effect.value == pytest.approx(0.8 * 0.01 / 0.2, rel=0.03)  # less in the first steps
    assert "they change with every step, and 0.8 of each change remains" in one.message


def test_stops_are_counted(tmp_path: Path) -> None:
    scene = KUKA + "go(0)\nsteps(900)\n"
    joint = rows(scene, tmp_path / "a.rrd")[J2]
    assert joint.control == "off"
    assert joint.at_stop_steps > 0
    assert rows(KUKA + "go(300)\nsteps(60)\n", tmp_path / "b.rrd")[J2].at_stop_steps == 0


def test_a_spherical_joint_has_three_rows(tmp_path: Path) -> None:
    scene = """
    h = p.loadURDF("humanoid/humanoid.urdf", [0, 0, 3])
    p.setJointMotorControlMultiDof(h, 1, p.POSITION_CONTROL, targetPosition=[0, 0, 0, 1],
        force=[200, 100, 50])
    steps(20)
    """
    found = rows(scene, tmp_path / "a.rrd")
    assert [found[f"chest.{axis}"].axis for axis in range(3)] == [0, 1, 2]
    chest = [found[f"chest.{axis}"] for axis in range(3)]
    assert [row.force_limit for row in chest] == pytest.approx([200, 100, 50])
    assert {row.target for row in chest} == {None}
    assert found["neck.0"].control == "default"


@pytest.mark.parametrize("scene", some([KUKA + "go(30)\nsteps(100)\n", GRIP.format(force=20)], 1))
def test_pieces_come_to_the_same(scene: str, tmp_path: Path) -> None:
    body = 1 if scene is not None and "plane" in scene else 0
    whole = rows(scene, tmp_path / "a.rrd", body)
    parts = rows(scene, tmp_path / "b.rrd", body, steps=7)
    for name, row in whole.items():
        for field, value in vars(row).items():
            other = getattr(parts[name], field)
            assert other == (
                pytest.approx(value, rel=1e-9, abs=1e-9) if isinstance(value, float) else value
            )


@pytest.mark.parametrize("load_kg", [0, 2])
def test_a_joint_carries_what_hangs_on_it(load_kg: float, tmp_path: Path) -> None:
    """At rest its reaction is the weight of the links beyond, and of the box that they carry."""
    scene = KUKA + "go(300)\nfor _ in range(1500): p.stepSimulation()\n"
    if load_kg:
        scene += f"""
c = p.createMultiBody({load_kg}, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.03] * 3))
p.createConstraint(k, 6, c, -1, p.JOINT_FIXED, [0] * 3, [0, 0, 0.1], [0] * 3)
p.setCollisionFilterGroupMask(c, -1, 0, 0)
for _ in range(1500): p.stepSimulation()
"""
    table = rows(scene, tmp_path / "scene.rrd")
    run(scene)
    masses_kg = [p.getDynamicsInfo(0, link)[0] for link in range(7)]
    for row in table.values():
        weight_n = (sum(masses_kg[row.index :]) + load_kg) * 9.81
        assert row.reaction_n == pytest.approx((0, 0, weight_n), rel=1e-3, abs=1e-2 * weight_n)
        assert row.reaction_n_m is not None
        axis = p.getLinkState(0, row.index)[5]
        about = p.rotateVector(axis, p.getJointInfo(0, row.index)[13])
        along = sum(a * b for a, b in zip(about, row.reaction_n_m, strict=True))
        assert along == pytest.approx(row.torque, abs=0.05 + 1e-2 * abs(row.torque or 0))
