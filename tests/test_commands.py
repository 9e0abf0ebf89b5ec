"""Targets and limits from joint calls in a recording: a row for each change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scenes
from drop_physics.recording import rrd
from drop_physics.trace.tables import table_of

ARM = 'b = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'


def rows(scene: str, path: Path, name: str) -> dict[int, dict[str, list[float]]]:
    """Record a scene, and return the rows of targets or limits by step."""
    scenes.record(scene, path)
    found = {}
    for chunk in rrd.chunks(path):
        if chunk.entity.endswith(f"/{name}") and "sim_step" in chunk.batch.schema.names:
            for row in chunk.batch.drop_columns(["sim_time"]).to_pylist():
                found[row["sim_step"]] = row
    return found


def test_a_target_has_a_row_when_it_changes_and_at_the_end(tmp_path: Path) -> None:
    scene = (
        ARM
        + """
for i in range(30):
    p.setJointMotorControl2(b, 1, p.POSITION_CONTROL, targetPosition=0.1 * (i // 10), force=30)
    p.stepSimulation()
"""
    )
    found = rows(scene, tmp_path / "run.rrd", "target")
    assert {step: row["Scalars:scalars"][1] for step, row in found.items()} == {
        0: 0.0,
        10: 0.1,
        20: 0.2,
        30: 0.2,
    }
    assert np.isnan(found[30]["Scalars:scalars"][0])
    limits = rows(scene, tmp_path / "limits.rrd", "limit")
    assert {step: row["Scalars:scalars"][1] for step, row in limits.items()} == {0: 30.0, 30: 30.0}
    assert [limits[0][name][1] for name in ("mode", "kp", "kd")] == [2.0, 0.1, 1.0]


def test_an_array_of_motors_and_torques_are_asked_likewise(tmp_path: Path) -> None:
    scene = (
        ARM
        + """
p.setJointMotorControlArray(b, [0, 2], p.VELOCITY_CONTROL, targetVelocities=[1, 2], forces=[0, 5])
steps(5)
p.setJointMotorControl2(b, 0, p.TORQUE_CONTROL, force=7)
try: p.setJointMotorControl2(b, 99, p.POSITION_CONTROL, targetPosition=1)
except p.error: pass
steps(5)
"""
    )
    found = rows(scene, tmp_path / "run.rrd", "target")
    assert sorted(found) == [0, 5, 10]
    assert [found[0]["velocity"][joint] for joint in (0, 2)] == [1.0, 2.0]
    assert np.isnan(found[0]["torque"][0])
    assert found[5]["torque"][0] == 7.0
    limits = rows(scene, tmp_path / "limits.rrd", "limit")
    assert [limits[0]["Scalars:scalars"][joint] for joint in (0, 2)] == [0.0, 5.0]
    assert [limits[5]["mode"][joint] for joint in (0, 2)] == [1.0, 0.0]


def test_the_last_of_several_calls_in_a_step_counts(tmp_path: Path) -> None:
    scene = (
        ARM
        + """
for i in range(5):
    p.setJointMotorControl2(b, 3, p.POSITION_CONTROL, targetPosition=-1 - i)
    p.setJointMotorControlArray(b, [3], p.POSITION_CONTROL, targetPositions=[2 + i])
    p.stepSimulation()
"""
    )
    found = rows(scene, tmp_path / "run.rrd", "target")
    targets = [found[step]["Scalars:scalars"][3] for step in sorted(found)]
    assert targets == [2.0, 3.0, 4.0, 5.0, 6.0, 6.0]


def test_a_body_with_the_id_of_another_begins_without_targets(tmp_path: Path) -> None:
    scene = (
        ARM
        + """
p.setJointMotorControl2(b, 3, p.POSITION_CONTROL, targetPosition=1)
steps(5)
p.resetSimulation()
b = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
p.setJointMotorControl2(b, 4, p.POSITION_CONTROL, targetPosition=2)
steps(5)
"""
    )
    scenes.record(scene, tmp_path / "run.rrd")
    by: dict[str, list[dict[str, list[float]]]] = {}
    for chunk in rrd.chunks(tmp_path / "run.rrd"):
        if chunk.entity.endswith("/target") and "sim_step" in chunk.batch.schema.names:
            by.setdefault(chunk.entity, []).extend(
                chunk.batch.drop_columns(["sim_time"]).to_pylist()
            )
    last = [rows[-1]["Scalars:scalars"] for rows in by.values()][-1]
    assert last[4] == 2.0
    assert np.isnan(last[3])


def test_a_body_set_to_where_it_is_leaves_no_row(tmp_path: Path) -> None:
    scene = """
b = p.createMultiBody(0, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
for i in range(20):
    p.resetBasePositionAndOrientation(b, [0.3 * i / 240, 0, 1], [0, 0, 0, 1])
    p.resetBaseVelocity(b, [0.3, 0, 0], [0, 0, 0])
    p.stepSimulation()
"""
    seen = scenes.record(scene, tmp_path / "run.rrd").seen
    there = dict(table_of(seen.bases).select("step", "x_m").rows())
    put = {each.at.step for each in seen.puts}
    assert 0 < len(put) < 20
    for step in range(2, 20):
        assert (step in put) == (there[step] != 0.3 * step / 240)
