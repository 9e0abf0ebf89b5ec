"""How a control is computed: from which joint, at what delay and stiffness, towards which target.

Verification: controllers whose law is known; and controls of which nothing may be said.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import some
from drop_physics.account.feedback import MOST_LATE, feedback_of
from drop_physics.account.rows import AccountRow
from drop_physics.account.whole_state import state_law_of
from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script

CONTROLS, JOINTS, STEP_S = 150, 5, 0.02
K, D = 40.0, 1.5


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and rates of joints in random motion, shape (CONTROLS, JOINTS) each."""
    random = np.random.default_rng(seed)
    rate = np.cumsum(random.standard_normal((CONTROLS, JOINTS)), axis=0)
    rate -= np.linspace(0, 1, CONTROLS)[:, None] * rate[-1]
    return np.cumsum(rate, axis=0) * STEP_S, rate


TIMES_S = np.arange(CONTROLS) * STEP_S
AIMS = {"constant": 0.3 + 0 * TIMES_S, "sine": 0.3 * np.sin(18 * TIMES_S)}


@pytest.mark.parametrize("aim", AIMS)
@pytest.mark.parametrize("joint", [0, 3])
@pytest.mark.parametrize("late", [0, 1, 7, MOST_LATE])
def test_the_law_of_a_controller_is_found(aim: str, joint: int, late: int) -> None:
    position, rate = motion()
    control = K * (AIMS[aim] - np.roll(position[:, joint], late)) - D * np.roll(
        rate[:, joint], late
    )
    found = feedback_of(np.clip(control, -60, 60)[late:], position[late:], rate[late:])
    assert found is not None
    assert (found.joint, found.late) == (joint, late)
    # Of a sine, few polynomials leave up to LEFT of the control, some hundredths of which are not
    # smooth: the gains take that up.
    assert (found.stiffness, found.damping) == pytest.approx((K, D), rel=5e-3)


def test_a_control_that_only_brakes_has_no_aim() -> None:
    """Its stiffness is due to rounding, so that any target would fit."""
    position, rate = motion()
    found = feedback_of(-D * rate[:, 2], position, rate)
    assert found is not None
    assert (found.joint, found.late, found.stiffness) == (2, 0, 0.0)
    assert found.damping == pytest.approx(D)


def test_the_largest_states_of_a_run_that_diverges_are_not_all_of_it() -> None:
    """Large last states must not hide that the first half of the run had half the stiffness."""
    position, rate = motion()
    grown = np.exp(np.linspace(0, 24, CONTROLS))[:, None]
    position, rate = position * grown, rate * grown
    stiffness = np.where(np.arange(CONTROLS) < CONTROLS // 2, K / 2, K)
    same, other = (k * position[:, 1] + D * rate[:, 1] for k in (K, stiffness))
    assert feedback_of(-same, position, rate) is not None
    assert feedback_of(-other, position, rate) is None


@pytest.mark.long
def test_nothing_is_said_of_what_is_no_law_of_one_joint() -> None:
    position, rate = motion()
    random = np.random.default_rng(1)
    policies = [
        np.tanh(position @ random.standard_normal(JOINTS) + rate @ random.standard_normal(JOINTS)),
        K * (AIMS["sine"] - position[:, 0]) - 0.2 * K * position[:, 1],
        AIMS["sine"],
        random.standard_normal(CONTROLS),
        np.sign(random.standard_normal(CONTROLS)),
        np.zeros(CONTROLS),
        K * (0.3 - position[:, 0]) * (1 + 0.1 * random.standard_normal(CONTROLS)),
    ]
    assert [feedback_of(policy, position, rate) for policy in policies] == [None] * len(policies)
    alike = position.copy(), rate.copy()
    for each in alike:  # two fingers that mirror each other: either may be meant
        each[:, 1] = -each[:, 0]
    assert feedback_of(-K * position[:, 0] - D * rate[:, 0], *alike) is None


GAINS = np.array([[30.0, 0.0, -8.0, 5.0, 2.0], [3.0, 0.0, 0.5, -1.0, 0.0]])
"""Gains of the positions and of the rates of all joints; nothing answers to joint 1."""


@pytest.mark.parametrize("late", [0, 1, 7, MOST_LATE])
def test_the_delay_of_the_whole_state_is_found(late: int) -> None:
    position, rate = motion()
    control = (
        4.0 - np.roll(position, late, axis=0) @ GAINS[0] - np.roll(rate, late, axis=0) @ GAINS[1]
    )
    control, position, rate = control[late:], position[late:], rate[late:]
    most = float(np.quantile(np.abs(control), 0.6))
    kept = np.abs(control) < most
    found = state_law_of(np.clip(control, -most, most), position, rate, kept, MOST_LATE)
    assert found is not None
    assert found.late == late
    assert [found.follows(own) for own in range(JOINTS)] == [
        0,
        int(np.argmax(found.shares)),
        2,
        3,
        4,
    ]
    # From a controller of one joint, nothing is different.
    assert feedback_of(control, position, rate) is None


def test_no_delay_is_told_where_several_fit_or_none_does() -> None:
    """If the motion is linear, any delay fits equally well, so that none is reported."""
    position, rate = motion()
    every = np.ones(CONTROLS, np.bool_)
    random = np.random.default_rng(2)
    policy = np.tanh(position @ GAINS[0] / 40 + rate @ GAINS[1] / 40)
    assert state_law_of(policy, position, rate, every, MOST_LATE) is None
    noisy = position @ GAINS[0] + 1e-6 * random.standard_normal(CONTROLS)
    assert state_law_of(noisy, position, rate, every, MOST_LATE) is None
    turn = 0.1 * random.standard_normal((2 * JOINTS, 2 * JOINTS))
    states = [random.standard_normal(2 * JOINTS)]
    for _ in range(CONTROLS - 1):
        states.append(states[-1] + (turn - turn.T) @ states[-1] * STEP_S)
    linear = np.array(states)
    control = linear @ GAINS.ravel()
    assert state_law_of(control, *np.split(linear, 2, axis=1), every, MOST_LATE) is None


LINKS = """
<mujoco><option timestep="0.002"/><worldbody>
<body name="upper" pos="0 0 2"><joint name="a" axis="0 1 0" damping="0.1"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.4" mass="1"/>
<body name="lower" pos="0 0 -0.4"><joint name="b" axis="0 1 0" damping="0.1"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.4" mass="1"/></body></body></worldbody>
<actuator><motor name="ma" joint="a" gear="2" ctrlrange="-20 20"/>
<motor name="mb" joint="b" gear="2" ctrlrange="-20 20"/></actuator></mujoco>
"""
DRIVEN = """
import collections, mujoco, numpy as np
model = mujoco.MjModel.from_xml_string('''{links}''')
data = mujoco.MjData(model)
data.qpos[:] = 1.0, -0.5
aim, kp, kd, late, order, most = np.array([0.4, 0.8]), 3 * np.eye(2), 0.3 * np.eye(2), 0, [0, 1], 20
{fault}
given = collections.deque([np.zeros(2)] * late, late + 1)
for control in range(80):
    torque = kp @ (aim - data.qpos) - kd @ data.qvel
    given.append(np.clip(torque, -most, most)[order])
    data.ctrl[:] = given[0]
    mujoco.mj_step(model, data, 10)
"""


def rows_of(tmp_path: Path, fault: str) -> list[AccountRow]:
    script = tmp_path / "script.py"
    script.write_text(DRIVEN.format(links=LINKS, fault=fault))
    recorded = record_script(str(script), out=tmp_path / "run.rrd")
    return [*analyze(recorded.recording).account]


@pytest.mark.parametrize(
    ("fault", "said"),
    some(
        [
            ("order = [1, 0]", "its control follows b, not a"),
            ("kd = kd[:, ::-1]", "its control takes the position of a and the rate of b"),
            ("late = 2", "its control is late: of the state 0.04 s before (2 × 0.02 s)"),
            (
                "late, kp, kd = 2, np.array([[3.0, 1.0], [1.0, 3.0]]), np.array([[0.3, 0.1]] * 2)",
                "its control is late: of the state 0.04 s before (2 × 0.02 s)",
            ),
            ("kp = np.diag([-3.0, 3.0])", "its control drives it away"),
            ("most = 0.5", "ctrl is exactly ±0.5 in"),
        ],
        1,
    ),
)
def test_a_faulty_controller_is_told_first(tmp_path: Path, fault: str, said: str) -> None:
    assert said in str(rows_of(tmp_path, fault)[0].told)


def test_a_right_controller_is_told_by_what_it_aims_at(tmp_path: Path) -> None:
    rows = rows_of(tmp_path, "")
    assert not [row for row in rows if row.misled]
    asked = {row.joint: row for row in rows if row.kind == "asked"}
    assert asked["a"].asked == pytest.approx(0.4, abs=1e-5)
    assert "by its control, 6 N m/rad" in str(asked["a"].told)  # kp times the gear


TWINS = """
<mujoco><worldbody><body pos="0 0 1"><freejoint/><geom size="0.1" mass="5"/>
<body pos="0 0.2 0"><joint name="left" axis="0 1 0" range="-150 60"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="0.5"/></body>
<body pos="0 -0.2 0"><joint name="right" axis="0 -1 0" range="-60 150"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="0.5"/></body></body></worldbody>
<actuator><motor name="left" joint="left" ctrlrange="-1 1" gear="{left}"/>
<motor name="right" joint="right" ctrlrange="-1 1" gear="40"/></actuator></mujoco>
"""
SWUNG = """
import mujoco, numpy as np
model = mujoco.MjModel.from_xml_string('''{links}''')
data = mujoco.MjData(model)
for step in range(100):
    data.ctrl[:] = np.sin(step / 10) * np.array([1, -1]) * {given}
    mujoco.mj_step(model, data)
"""


@pytest.mark.parametrize(
    ("left", "given", "is_told"), some([(2, 1.1, True), (40, 1.1, False), (2, 0.9, False)], 1)
)
def test_a_drive_that_is_weaker_than_its_twin_is_told(
    tmp_path: Path, left: float, given: float, *, is_told: bool
) -> None:
    """The control of 1.1 sin(0.1 k) is cut off in the steps with sin(0.1 k) above 1 / 1.1."""
    script = tmp_path / "script.py"
    script.write_text(SWUNG.format(links=TWINS.format(left=left), given=given))
    recorded = record_script(str(script), out=tmp_path / "run.rrd")
    rows = [*analyze(recorded.recording).account]
    told = [row for row in rows if "its drive has a limit of" in str(row.told)]
    assert [(row.joint, row.got, row.asked) for row in told] == [("left", 2, 40)] * is_told
    share = np.mean(np.abs(given * np.sin(np.arange(100) / 10)) >= 1)
    if is_told:
        assert f"in {share:.0%} of the steps" in str(told[0].told)
        assert rows[0] is told[0]


WHEELS = """
import pybullet as p
p.connect(p.DIRECT)
wheel = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05)
cart = p.createMultiBody(
    5, wheel, -1, [0, 0, 1], linkMasses=[1, 1], linkCollisionShapeIndices=[wheel, wheel],
    linkVisualShapeIndices=[-1, -1], linkPositions=[[0, 0.2, 0], [0, -0.2, 0]],
    linkOrientations=[[0, 0, 0, 1]] * 2, linkInertialFramePositions=[[0, 0, 0]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0, 0],
    linkJointTypes=[p.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 1, 0]] * 2)
for joint, force in {forces}.items():
    p.setJointMotorControl2(cart, joint, p.VELOCITY_CONTROL, targetVelocity=1000, force=force)
for _ in range(100):
    p.stepSimulation()
"""


@pytest.mark.long
@pytest.mark.pybullet
@pytest.mark.parametrize(("forces", "told"), [({0: 0.1}, []), ({0: 0.1, 1: 0.4}, [0.1])])
def test_a_drive_is_not_compared_with_the_motor_that_the_engine_adds(
    tmp_path: Path, forces: dict[int, float], told: list[float]
) -> None:
    script = tmp_path / "script.py"
    script.write_text(WHEELS.format(forces=forces))
    recorded = record_script(str(script), out=tmp_path / "run.rrd")
    rows = [*analyze(recorded.recording).account]
    assert [row.got for row in rows if "its drive has a limit of" in str(row.told)] == told
