"""Why two PyBullet runs differ, or a PyBullet and a MuJoCo run: found by swapping calls.

PyBullet hides part of its state, so no step of it can be made alone: the log of its calls is made
again, bare, and has to be the recorded run to the bit before anything is claimed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pybullet  # noqa: F401 - what the scripts need
import pytest
from conftest import some
from drop_physics.experiments.swap import calls
from drop_physics.experiments.swap.calls import units_of, with_units
from drop_physics.report.diff import json_of, report_of
from drop_physics.stages.diff import diff
from drop_physics.trace.logs import LoggedCall, attributes_apart

HEAD = """
import os, tempfile
import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
"""
BOX = (
    HEAD
    + """
plane = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
box = p.createMultiBody(1.0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1]),
                        basePosition=[0, 0, .12])
p.resetBaseVelocity(box, [1.0, 0, 0])
p.changeDynamics(box, -1, lateralFriction=0.5)
for k in range(60):
    if k == 40: p.applyExternalForce(box, -1, [0, 1, 0], [0, 0, 0], p.LINK_FRAME)
    p.stepSimulation()
"""
)
ROD = '''
URDF = """<robot name="rig"><link name="w"><inertial><mass value="0"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="w"/><child link="rod"/><origin xyz="0 0 1"/>
<axis xyz="0 1 0"/><limit lower="-30" upper="30" effort="50" velocity="50"/></joint>
<link name="rod"><inertial><origin xyz=".2 0 0"/><mass value="1"/>
<inertia ixx=".001" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
file = tempfile.NamedTemporaryFile("w", suffix=".urdf", delete=False)
file.write(URDF)
file.close()
rod = p.loadURDF(file.name, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
os.unlink(file.name)
'''
FREE = """
for link in (-1, 0):
    p.changeDynamics(rod, link, linearDamping=0, angularDamping=0, jointDamping=0)
p.setJointMotorControl2(rod, 0, p.VELOCITY_CONTROL, force=0)
"""
STEPS = """
for k in range(60): p.stepSimulation()
"""
MUJOCO = '''
import mujoco
m = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.004166666666666667"/><worldbody>
<body pos="0 0 1"><joint name="hinge" axis="0 1 0"/>
<inertial pos=".2 0 0" mass="1" diaginertia=".001 .02 .02"/></body></worldbody></mujoco>""")
d = mujoco.MjData(m)
for k in range(60): mujoco.mj_step(m, d)
'''


def answer(folder: Path, a: str, b: str, **how: Any) -> tuple[dict[str, Any], int]:
    for name, text in (("a.py", a), ("b.py", b)):
        (folder / name).write_text(text)
    result = diff([str(folder / "a.py"), str(folder / "b.py")], **how)
    return json_of(result), report_of(result).code


def test_an_argument_is_proved_and_another_has_no_effect(tmp_path: Path) -> None:
    other = BOX.replace("lateralFriction=0.5", "lateralFriction=0.45, rollingFriction=0.0")
    printed, code = answer(tmp_path, BOX, other)
    assert (printed["class"], code) == ("model", 3)
    (cause,) = printed["because"]
    assert (cause["field"], cause["a"], cause["b"]) == (
        *("changeDynamics(lateralFriction)", 0.5),
        0.45,
    )
    assert cause["site_b"] == "b.py:11"
    assert printed["proved"] == {"by": "calls", "steps": 60, "of": 60, "exact": True}
    assert printed["no_effect"] == ["changeDynamics(rollingFriction)"]


@pytest.mark.parametrize(
    ("change", "cls", "words"),
    some(
        [
            (("", ""), "none", ""),
            (("p.stepSimulation()", "p.stepSimulation(); p.getContactPoints()"), "none", ""),
            (("[0, 1, 0]", "[0, 2, 0]"), "input", "applyExternalForce(forceObj)"),
            (("[1.0, 0, 0]", "[1.1, 0, 0]"), "start", "resetBaseVelocity(linearVelocity)"),
            (("-9.81", "-9.8"), "settings", "setGravity(gravZ): -9.81 → -9.8"),
            (("range(60)", "range(50)"), "length", ""),
        ],
        2,
    ),
)
def test_each_kind_of_call_is_told(
    change: tuple[str, str], cls: str, words: str, tmp_path: Path
) -> None:
    printed, code = answer(tmp_path, BOX, BOX.replace(*change))
    assert (printed["class"], code) == (cls, 0 if cls == "none" else 3)
    assert words in " ".join(printed["cause_text"])


def test_a_call_of_one_run_is_told_with_its_arguments_and_a_second_cause_beside_it(
    tmp_path: Path,
) -> None:
    push = "    if k >= {}: p.applyExternalForce(box, -1, [0, {}, 0], [0, 0, 0], p.LINK_FRAME)\n"
    step = "    p.stepSimulation()\n"
    both = push.format(10, 1) + "    if k == 30: p.changeDynamics(box, -1, lateralFriction=0.1)\n"
    printed, _ = answer(tmp_path, BOX, BOX.replace(step, both + step))
    assert printed["same_until"] == 9
    assert "applyExternalForce(linkIndex=-1, forceObj=[0, 1, 0]" in printed["cause_text"][0]
    assert printed["proved"]["steps"] == 30, "the later pushes belong to the first cause"
    (second,) = printed["also"]
    assert (second["field"], second["step"]) == ("changeDynamics", 30)
    assert "changeDynamics(linkIndex=-1, lateralFriction=0.1)" in printed["cause_text"][1]


def test_a_command_of_each_step_is_one_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "MOST_UNITS", 10)  # fewer than there are differences
    motor = """
for k in range(60):
    p.setJointMotorControl2(rod, 0, p.POSITION_CONTROL, 0.3, force=3)
    p.stepSimulation()
"""
    scene = HEAD + ROD + motor
    printed, _ = answer(tmp_path, scene, scene.replace("force=3", "force=4"))
    (cause,) = printed["because"]
    assert (cause["field"], cause["a"], cause["b"]) == ("setJointMotorControl2(force)", 3, 4)
    assert cause["element"].startswith("hinge (")
    assert printed["proved"]["steps"] == printed["proved"]["of"] == 60
    assert not printed["also"]
    assert not printed["no_effect"]


def test_a_file_that_is_gone_is_compared_by_its_content(tmp_path: Path) -> None:
    same, _ = answer(tmp_path, HEAD + ROD + STEPS, HEAD + ROD + STEPS)
    assert (same["class"], same["no_effect"]) == ("none", [])
    heavier = ROD.replace('mass value="1"', 'mass value="2"')
    printed, _ = answer(tmp_path, HEAD + ROD + FREE + STEPS, HEAD + heavier + FREE + STEPS)
    (cause,) = printed["because"]
    assert (cause["field"], cause["a"], cause["b"]) == ("loadURDF: mass value of rod", 1.0, 2.0)


def test_a_state_restored_is_not_one_set_by_hand(tmp_path: Path) -> None:
    again = BOX + "q, v = p.getBasePositionAndOrientation(box), p.getBaseVelocity(box)\n"
    again += "s = p.saveState()\nfor k in range(30): p.stepSimulation()\n{}\n"
    again += "for k in range(30): p.stepSimulation()\n"
    by_hand = "p.resetBasePositionAndOrientation(box, *q); p.resetBaseVelocity(box, *v)"
    printed, _ = answer(tmp_path, again.format("p.restoreState(s)"), again.format(by_hand))
    assert printed["class"] == "start"
    assert "restoreState → resetBasePosition" in printed["cause_text"][0]


@pytest.mark.long
def test_a_known_difference_of_two_engines_is_taken_away(tmp_path: Path) -> None:
    damped = FREE.replace("linearDamping=0, angularDamping=0, ", "")
    printed, code = answer(tmp_path, HEAD + ROD + damped + STEPS, MUJOCO)
    assert (printed["class"], code) == ("model", 3)
    assert "linearDamping" in printed["because"][0]["field"]
    assert printed["proved"] == {"by": "known", "steps": 60, "of": 60, "exact": False}
    same, code = answer(tmp_path, HEAD + ROD + FREE + STEPS, MUJOCO)
    assert (same["class"], code) == ("none", 0)


def test_an_armature_is_found_in_the_other_engine(tmp_path: Path) -> None:
    heavier = MUJOCO.replace('axis="0 1 0"/>', 'axis="0 1 0" armature="0.1"/>')
    printed, _ = answer(tmp_path, heavier, HEAD + ROD + FREE + STEPS)
    assert "dof_armature" in printed["because"][0]["field"]
    assert printed["proved"]["steps"] == 60


# -- parts ----------------------------------------------------------------------------------------


def call(function: str, step: int = 0, **given: Any) -> LoggedCall:
    return LoggedCall(function, given, step, "model", key=(function, str(given)))


def test_a_log_with_all_differences_is_the_other_log() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        logs = [
            sorted(
                (
                    call(str(rng.choice(["f", "g", "h"])), int(rng.integers(3)), x=int(x))
                    for x in rng.integers(3, size=8)
                ),
                key=lambda each: each.step,
            )
            for _ in range(2)
        ]
        made = with_units(logs[0], [*units_of(*logs)])
        assert [(c.function, dict(c.given), c.step) for c in made] == [
            (c.function, dict(c.given), c.step) for c in logs[1]
        ]


def test_attributes_of_files_are_told_by_their_element() -> None:
    text = '<robot><link name="arm"><mass value="{}"/></link></robot>'
    a, b = (text.format(value).encode() for value in (1, 2))
    assert [*attributes_apart(a, b)] == [("mass value of arm", "1", "2")]
    assert [*attributes_apart(a, b"no XML")] == []
    assert [*attributes_apart(a, b"<robot><link/></robot>")] == []
