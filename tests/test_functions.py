"""Every function of pybullet has a role; the older motor call is read as the command it gives."""

from __future__ import annotations

import inspect
from collections import Counter
from pathlib import Path

import numpy as np
import pybullet as p
from drop_physics.engines.pybullet.watch.arguments import ARGUMENTS
from drop_physics.engines.pybullet.watch.functions import CHANGES_NOTHING, READ_AGAIN, ROLES
from scenes import explanation, record

OF_MODULE = {name for name, value in vars(p).items() if inspect.isbuiltin(value)}
NAMED = Counter(name for names in ROLES.values() for name in names.split())
TWICE = {"loadSDF", "loadMJCF", "loadBullet", "executePluginCommand"}
"""Functions with two roles: they create or remove bodies, and have a further effect."""
WITHOUT_ARGUMENTS = {"renderImage"}
"""Functions that were removed from PyBullet, and raise."""


def test_the_table_has_every_function_of_the_module_and_no_other() -> None:
    assert NAMED.keys() == OF_MODULE
    assert {name for name, roles in NAMED.items() if roles > 1} == TWICE
    assert ARGUMENTS.keys() == OF_MODULE - WITHOUT_ARGUMENTS


def test_what_changes_nothing_is_not_read_again() -> None:
    assert not CHANGES_NOTHING & READ_AGAIN
    setters = [name for name in OF_MODULE if name.startswith(("set", "reset", "apply", "change"))]
    asked_of_windows = {name for name in setters if name in CHANGES_NOTHING}
    assert asked_of_windows == {
        "setDebugObjectColor",
        "setVRCameraState",
        "setTimeOut",
        "resetDebugVisualizerCamera",
    }


OLDER = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
calls = [
    (p.POSITION_CONTROL, 0.4), (p.VELOCITY_CONTROL, 0.3), (p.TORQUE_CONTROL, 2.0),
    (p.POSITION_CONTROL, 0.4, 40.0), (p.VELOCITY_CONTROL, 0.3, 30.0),
    (p.POSITION_CONTROL, 0.4, 80.0, 0.3), (p.VELOCITY_CONTROL, 0.2, 80.0, 0.5),
    (p.POSITION_CONTROL, 0.4, 0.1, 90.0, 0.2, 0.8), (p.VELOCITY_CONTROL, 0.4, 0.1, 90.0, 0.2, 0.8),
    (p.TORQUE_CONTROL, 0.4, 0.1, 90.0, 0.2, 0.8),
]
for n in range(200):
    for j in range(7):
        p.setJointMotorControl(k, j, *calls[(n // 20 + j) % len(calls)])
    p.stepSimulation()
"""


def test_the_older_motor_call_means_what_its_mode_and_length_say(tmp_path: Path) -> None:
    """One line in ten forms: each call is interpreted as PyBullet executes it, in every step."""
    seen = record(OLDER, tmp_path / "older.rrd").seen
    totals = explanation(seen).totals[0]
    assert totals.explained == totals.samples == 201
    told = {}
    for command in seen.calls.commands():
        sent = {name: tuple(values[0].tolist()) for name, values in command.values.items()}
        told[len(command.site.names), int(sent["controlMode"][0])] = sent
    assert told[4, 2] == {"controlMode": (2,), "targetPosition": (0.4,)}
    assert told[4, 0] == {"controlMode": (0,), "targetVelocity": (0.3,)}
    assert told[4, 1] == {"controlMode": (1,), "force": (2.0,)}
    assert told[5, 0] == {"controlMode": (0,), "targetVelocity": (0.3,), "force": (30.0,)}
    assert told[6, 2] == told[4, 2] | {"force": (80.0,), "positionGain": (0.3,)}
    assert told[6, 0]["velocityGain"] == (0.5,)
    whole = {"positionGain": (0.2,), "velocityGain": (0.8,), "targetVelocity": (0.1,)}
    assert told[8, 2] == told[4, 2] | whole | {"force": (90.0,)}
    assert "force" not in told[8, 1]  # PyBullet applies no torque then


def test_torque_control_without_a_torque_gives_the_default_of_the_force(tmp_path: Path) -> None:
    """The default is 100,000 N m, which takes a joint to PyBullet's velocity clamp in one step."""
    scene = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for j in range(7):
    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
p.setJointMotorControl2(k, 0, p.TORQUE_CONTROL)
steps(2)
p.setJointMotorControlArray(k, [1, 2], p.TORQUE_CONTROL)
p.setJointMotorControl(k, 3, p.TORQUE_CONTROL, 0, 0, 5, 0, 0)
steps(2)
"""
    seen = record(scene, tmp_path / "torque.rrd").seen
    totals = explanation(seen).totals[0]
    assert totals.explained == totals.samples == 5
    assert np.abs(seen.joints[0].velocity[1]).max() == 100.0
