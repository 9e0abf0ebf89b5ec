"""Scenes for which an answer once said something false: now it says nothing, or what is true."""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import codes, findings

FLOOR = "p.setGravity(0, 0, -9.81)\np.loadURDF('plane.urdf')\n"
BALL = "ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)\n"

SILENT = {
    "restitution that is set after the landing": (
        FLOOR + BALL + "b = p.createMultiBody(1, ball, -1, [0, 0, 0.6])\nsteps(200)\n"
        "p.changeDynamics(b, -1, restitution=0.9)\nsteps(20)",
        "no-restitution",
    ),
    "restitution that is taken back before it": (
        FLOOR + BALL + "b = p.createMultiBody(1, ball, -1, [0, 0, 0.6])\n"
        "p.changeDynamics(b, -1, restitution=0.9)\nsteps(20)\n"
        "p.changeDynamics(b, -1, restitution=0)\nsteps(180)",
        "no-restitution",
    ),
    "seven joints, each pushed once": (
        FLOOR + "k = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)\n"
        "for j in range(7):\n"
        "    p.setJointMotorControl2(k, j, p.TORQUE_CONTROL, force=5)\n    steps(5)",
        "push-lasted-a-step",
    ),
    "a force beside what cannot turn": (
        "b = p.createMultiBody(1, -1, -1, [0, 0, 2])\n"
        "for _ in range(20):\n"
        "    p.applyExternalForce(b, -1, [0, 1, 0], [0, 0, 0], p.WORLD_FRAME)\n    steps(1)",
        "force-off-centre",
    ),
    "a mass that changes in flight": (
        "box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .2, .3])\n"
        "b = p.createMultiBody(1, box)\np.resetBaseVelocity(b, [0, 0, 0], [0.1, 0.1, 0.1])\n"
        "p.changeDynamics(b, -1, linearDamping=0, angularDamping=0)\nsteps(60)\n"
        "p.changeDynamics(b, -1, mass=5)\nsteps(60)",
        "momentum-drift",
    ),
}
"""Scene, and what is not said of it."""


@pytest.mark.parametrize("what", SILENT)
def test_what_is_not_sure_is_not_said(what: str, tmp_path: Path) -> None:
    scene, code = SILENT[what]
    found = [each for each in findings(scene, tmp_path / "scene.rrd") if each.code == code]
    assert [each.message for each in found if "every" in each.message or each.level != "note"] == []


def test_a_push_of_a_slider_is_a_force(tmp_path: Path) -> None:
    scene = (
        "c = p.loadURDF('cartpole.urdf')\n"
        "p.setJointMotorControl2(c, 0, p.VELOCITY_CONTROL, force=0)\n"
        "p.setJointMotorControl2(c, 0, p.TORQUE_CONTROL, force=50)\nsteps(60)"
    )
    (found,) = (
        each
        for each in findings(scene, tmp_path / "scene.rrd")
        if each.code == "push-lasted-a-step"
    )
    assert "50 N in one step" in found.message


def test_a_constraints_id_may_be_used_again_by_another_kind(tmp_path: Path) -> None:
    scene = """
b = p.loadURDF("cube_small.urdf", [0, 0, 1])
for kind in (p.JOINT_FIXED, p.JOINT_POINT2POINT):
    c = p.createConstraint(b, -1, -1, -1, kind, [0, 0, 0], [0, 0, 0], [0, 0, 1])
    steps(20)
    p.removeConstraint(c)
"""
    assert "weak-constraint" not in codes(scene, tmp_path / "scene.rrd")
