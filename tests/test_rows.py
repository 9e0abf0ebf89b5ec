"""Verification: the table of samples has a column for each joint and each term of the sum."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from drop_physics.trace.history import body_named
from scenes import analyze, record

SCENE = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
c = p.loadURDF("cube_small.urdf", [1, 0, 0.1])
for j in range(7):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.1 * j, force=100)
steps(60)
ends = [p.getJointState(k, j)[0:4:3] for j in range(7)]
"""


def test_each_joint_and_each_term_has_a_column(tmp_path: Path) -> None:
    ends = tmp_path / "ends.json"
    scene = f"{SCENE}\nimport json\nopen({str(ends)!r}, 'w').write(json.dumps(ends))\n"
    table = analyze(record(scene, tmp_path / "a.rrd").seen, whole=True).table
    arm = table.filter(table["body"] == 1)
    for number, (position, torque) in enumerate(json.loads(ends.read_text()), 1):
        joint = f"lbr_iiwa_joint_{number}"
        assert arm[f"{joint}.rad"][-1] == position
        assert arm[f"{joint}.n_m"][-1] == pytest.approx(torque, abs=1e-12)
    cube = table.filter(table["body"] == 2)
    assert cube["lbr_iiwa_joint_1.rad"].is_null().all()
    causes = [name for name in table.columns if name.endswith("_j") and name != "energy_j"]
    assert {"contact_j", "damping_j", "motors_j", "integrator_j"} <= {*causes}
    for body in (arm, cube):
        gave = sum(body[name].fill_null(0.0).to_numpy()[1:] for name in causes)
        assert np.allclose(gave, np.diff(body["energy_j"].to_numpy()), atol=1e-10)


@pytest.mark.parametrize("which", ["1", "1_model", "model.urdf", "model"])
def test_a_body_is_named_by_its_number_label_or_name(which: str, tmp_path: Path) -> None:
    bodies = record(SCENE, tmp_path / "a.rrd").seen.bodies.values()
    assert body_named(bodies, which).number == 1


def test_without_being_asked_for_there_are_few_columns(tmp_path: Path) -> None:
    assert "motors_j" not in analyze(record(SCENE, tmp_path / "a.rrd").seen).table.columns
