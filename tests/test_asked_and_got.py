"""Validation: calls without the intended effect in PyBullet are found, and the fix works."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest
from asked import COMPLETE, findings
from conftest import some
from drop_physics.analysis.story import Story
from drop_physics.rules.answer import Finding
from scenes import analyze, record, record_file

CORPUS = Path(__file__).parent / "corpus/scripts"
REASONS = {
    "friction_to_base": "call-elsewhere",
    "float_off_edge": "velocity-set-each-step",
    "crane_drift": "no-effect",
    "spherical": "no-effect",
    "ik_short_lists": "no-effect",
    "no_force": "no-effect",
    "damping_of_base": "no-effect",
    "two_clients": "other-client",
    "base_com": "reset-frame",
    "reset_joint_each": "pose-set-each-step",
    "lift_by_constraint": "drive-lags",
    "groups_still_collide": "contact-despite-filter",
    "mass_for_all": "wrong-body",
    "panda_fingers_ik": "ik-index",
    "tiny_and_heavy": "scale-keeps-mass",
    "commanded_twice": "command-overwritten",
    "link_stale": "reading-stale",
    "kinematic_velocity": "reading-static",
}
"""Scripts of the corpus that have a cure, and the reason why a request had no effect."""

CAUSES = {
    "no_fixed_base": "free-base",
    "gear_held": "default-motor",
    "soft_floor_bounce": "no-restitution",
    "bounce_threshold": "no-restitution",
    "ball_stops": "rolling-friction",
    "swing_damped": "joint-damping",
    "mask_of_zero": "no-contact",
    "wheels_apart": "wheel-slip",
}
"""Scripts of the corpus that have a cure, and the code of the cause."""


def found(name: str, path: Path, *arguments: str) -> list[Finding]:
    seen = record_file(CORPUS / f"{name}.py", path / "run.rrd", *arguments).seen
    return analyze(seen).findings


@pytest.mark.parametrize(("name", "reason"), some(REASONS.items(), 4))
def test_a_reason_is_found_and_goes_with_its_cure(name: str, reason: str, tmp_path: Path) -> None:
    first = found(name, tmp_path)[0]
    assert first.reason == reason
    assert first.advice is not None
    assert first.site is not None
    assert reason not in {each.reason for each in found(name, tmp_path, "fix")}


@pytest.mark.parametrize(("name", "code"), some(CAUSES.items(), 2))
def test_a_cause_is_found_and_goes_with_its_cure(name: str, code: str, tmp_path: Path) -> None:
    assert code in {each.code for each in found(name, tmp_path)[:2]}
    assert code not in {each.code for each in found(name, tmp_path, "fix")}


MOVED = """
b = p.createMultiBody(0, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
for i in range(20):
    p.resetBasePositionAndOrientation(b, [0.01 * i, 0, 0], [0, 0, 0, 1])
    p.stepSimulation()
"""


def test_what_calls_alone_move_is_not_said_to_stand_still(tmp_path: Path) -> None:
    told = str(Story(record(MOVED, tmp_path / "a.rrd").seen, COMPLETE).analysis())
    assert "20 steps, nothing moved by itself" in told


def test_what_is_true_of_nearly_every_run_stands_beside_nothing_graver(tmp_path: Path) -> None:
    """Damping takes 84 J from a box that slipped out, but the finding is about friction."""
    assert "default-damping" not in {each.code for each in found("friction_to_base", tmp_path)}


LEGS = """
s = p.createCollisionShape(
    p.GEOM_BOX, halfExtents=[.1, .02, .02], collisionFramePosition=[.1, 0, 0])
a = p.createMultiBody(0, -1, -1, [0, 0, 1], linkMasses=[1] * 2, linkCollisionShapeIndices=[s] * 2,
    linkVisualShapeIndices=[-1] * 2, linkPositions=[[0, .2, 0], [0, -.2, 0]],
    linkOrientations=[[0, 0, 0, 1]] * 2, linkInertialFramePositions=[[.1, 0, 0]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0] * 2,
    linkJointTypes=[p.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 0, 1]] * 2)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.05] * 3), -1, [.15, -.35, 1])
def put(j, q): p.resetJointState(a, j, q)
put(0, 0)
for i in range(240):
    {other}
    put(1, -i / 240)
    steps(1)
"""


@pytest.mark.parametrize("other", ["pass", "put(0, i / 500)"])
def test_the_joint_that_is_set_into_something_is_named(other: str, tmp_path: Path) -> None:
    its = findings(LEGS.format(other=other), tmp_path / "run.rrd")
    (first,) = (each for each in its if each.reason == "pose-set-each-step")
    assert first.joint == "joint2"
    # A base's velocity is no advice for a joint.
    assert "p.resetBaseVelocity" not in " ".join(str(each.advice) for each in its)


@pytest.mark.pybullet
def test_what_a_script_set_itself_is_a_note_at_most(tmp_path: Path) -> None:
    """A slippery box on a ramp, a soft floor, a pusher without mass, and a frame without a mass."""
    (tmp_path / "cart.urdf").write_text(
        '<robot name="cart"><link name="cart"><inertial><mass value="9"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><box size="1 1 1"/></geometry></collision></link>'
        '<link name="frame"/><joint name="joint" type="continuous"><parent link="cart"/>'
        '<child link="frame"/><axis xyz="0 0 1"/></joint></robot>'
    )
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import pybullet as p, pybullet_data

            p.connect(p.DIRECT)
            p.setAdditionalSearchPath(pybullet_data.getDataPath())
            p.setGravity(0, 0, -9.81)
            p.loadURDF("plane.urdf")
            p.loadURDF("./cart.urdf", [9, 0, 0.5])
            tilt = p.getQuaternionFromEuler([0, 0.4, 0])
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 1, 0.1])
            p.createMultiBody(0, shape, -1, [0, 9, 9], tilt)
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
            box = p.createMultiBody(1, shape, -1, [0.08, 9, 9.19], tilt)
            p.changeDynamics(box, -1, lateralFriction=0.05)
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 1])
            floor = p.createMultiBody(0, shape, -1, [20, 0, 1])
            p.changeDynamics(floor, -1, contactStiffness=8000, contactDamping=20)
            shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.5)
            p.createMultiBody(10, shape, -1, [20, 0, 3.5])
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.3, 0.2])
            pusher = p.createMultiBody(0, shape, -1, [-9.5, 0, 0.2])
            p.loadURDF("cube_small.urdf", [-9.4, 0, 0.025])
            for step in range(240):
                p.resetBasePositionAndOrientation(
                    pusher, [-9.5 + 0.001 * step, 0, 0.2], [0, 0, 0, 1])
                p.stepSimulation()
            """
        )
    )
    found = analyze(record_file(script, tmp_path / "script.rrd").seen).findings
    notes = {(each.code, each.reason) for each in found if each.level == "note"}
    ours = {("slides", None), ("overwritten", "pose-set-each-step"), ("no-inertial", None)}
    ours.add(("deep-penetration", None))
    assert ours <= notes
    assert not ours & {(each.code, each.reason) for each in found if each.level != "note"}


@pytest.mark.pybullet
def test_a_constraint_that_pulls_a_box_into_a_hand_is_what_presses(tmp_path: Path) -> None:
    """The motors of the arm, which are the engine's own, only hold against it."""
    scene = """
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
    part = p.loadURDF("cube_small.urdf", [0, 0, 1.45])
    zero = [0, 0, 0]
    p.createConstraint(arm, 6, part, -1, p.JOINT_FIXED, zero, zero, zero)
    for _ in range(240):
        p.stepSimulation()
    """
    script = tmp_path / "script.py"
    head = "import pybullet as p, pybullet_data\np.connect(p.DIRECT)\n"
    script.write_text(head + textwrap.dedent(scene))
    found = analyze(record_file(script, tmp_path / "script.rrd").seen).findings
    (deep,) = [each for each in found if each.code == "deep-penetration"]
    assert "a constraint presses them together" in deep.message
