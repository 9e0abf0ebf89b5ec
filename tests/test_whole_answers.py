"""Validation: what is said of the whole of a motion is so, and is not said where it is not.

Each rule is asked of scenes in which its answer is the true one, and of scenes that look alike.
Where PyBullet alone can tell, it does: change the one thing, and the symptom goes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pytest
from asked import found as ask
from clients import release_clients
from conftest import some
from scenes import HEAD, analyze, record, site
from scenes import found as of_code
from test_call_answers import AIR, CUBE, FLOOR, one

KUKA = "k = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)\n"

# -- not-finite -----------------------------------------------------------------------------------

NAN = "float('nan')"


@pytest.mark.parametrize(
    ("scene", "call"),
    [
        (AIR + CUBE, f"p.applyExternalForce(c, -1, [0, 0, {NAN}], [0, 0, 0], p.LINK_FRAME)"),
        (AIR + KUKA, f"p.setJointMotorControl2(k, 1, p.POSITION_CONTROL, {NAN}, force=100)"),
        (AIR + CUBE, f"p.resetBaseVelocity(c, [{NAN}, 0, 0])"),
    ],
)
def test_a_state_that_is_no_number_and_the_call(scene: str, call: str, tmp_path: Path) -> None:
    found = one(scene + "steps(9)\n" + call + "\nsteps(9)", tmp_path, "not-finite")
    assert found.site == site(4)
    assert found.steps is not None
    assert found.steps.first == 10
    assert not ask(scene + "steps(18)", tmp_path, "not-finite")


@np.errstate(all="ignore")  # as `analyze` has it
def test_a_number_whose_square_is_none_breaks_a_state_too(tmp_path: Path) -> None:
    """The moment of 1e308 N at 100 m is infinite; at 1 m no number is."""
    far = "p.applyExternalForce(c, -1, [0, 0, 1e308], [{}, 0, 0], p.LINK_FRAME)"
    found = one(AIR + CUBE + "steps(9)\n" + far.format(100) + "\nsteps(9)", tmp_path, "not-finite")
    assert found.site == site(4)
    assert "was given 1e+308, whose square is no number" in found.message
    near = far.format(1).replace("1e308", "1e150")
    assert not ask(AIR + CUBE + "steps(9)\n" + near + "\nsteps(9)", tmp_path, "not-finite")


# -- unstable, velocity-clamped -------------------------------------------------------------------

SINE = """
import math
for i in range(240):
    for j in range(7):
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.4 * math.sin(0.02 * i + j),
            force=200, velocityGain={gain})
    p.stepSimulation()
"""
A1 = """
p.setGravity(0, 0, -9.81)
a = p.loadURDF("a1/a1.urdf", [0, 0, 1], useFixedBase=True)
J = [j for j in range(p.getNumJoints(a)) if p.getJointInfo(a, j)[2] == 0]
q0 = dict(zip(J, [0, 0.8, -1.6] * 4))
for j in J:
    p.resetJointState(a, j, q0[j])
    p.setJointMotorControl2(a, j, p.VELOCITY_CONTROL, force=0)
p.resetJointState(a, J[2], -1.5)
for i in range(240):
    for j, s in zip(J, p.getJointStates(a, J)):
        torque = min(max(100 * (q0[j] - s[0]) - {kd} * s[1], -33.5), 33.5)
        p.setJointMotorControl2(a, j, p.TORQUE_CONTROL, force=torque)
    p.stepSimulation()
"""
LOOSE = AIR + KUKA + "for j in range(7): p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)"


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "cured", "term"),
    some(
        [
            (AIR + KUKA + SINE.format(gain=0.1), AIR + KUKA + SINE.format(gain=1), "joint damping"),
            (
                LOOSE + "\np.resetJointState(k, 6, 0, 0.5)\nsteps(99)",
                LOOSE
                + "\np.changeDynamics(k, 6, jointDamping=0)\np.resetJointState(k, 6, 0, 0.5)\n"
                "steps(99)",
                "joint damping",
            ),
            (A1.format(kd=5), A1.format(kd=0.2), "applied"),
        ],
        1,
    ),
)
def test_what_rings_and_what_feeds_it(scene: str, cured: str, term: str, tmp_path: Path) -> None:
    found = one(scene, tmp_path, "unstable")
    assert f"the term {term} turns it around" in found.message
    assert found.joint is not None
    # That the cure cures is seen in the motion alone: nothing is said of it.
    assert not ask(cured, tmp_path, "unstable")


PENDULUM = """
p.setGravity(0, 0, -9.81)
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.02, 0.5])
b = p.createMultiBody(0, linkMasses=[1], linkCollisionShapeIndices=[s],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, -0.5]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]])
p.setJointMotorControl2(b, 0, p.VELOCITY_CONTROL, force=0)
for i in range(960):
    v = p.getJointState(b, 0)[1]
    p.setJointMotorControl2(b, 0, p.TORQUE_CONTROL, force=2 if v >= 0 else -2)
    p.stepSimulation()
"""
ROBOTS = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
r = p.loadURDF("{file}", [0, 0, {z}], [{turn}], useFixedBase={fixed})
import math
J = [j for j in range(p.getNumJoints(r)) if p.getJointInfo(r, j)[2] in (0, 1)]
for i in range(240):
    for j in J:
        p.setJointMotorControl2(r, j, p.POSITION_CONTROL, 0.1 * math.sin(i / 20), force=40)
    p.stepSimulation()
"""
FAN = """
p.setGravity(0, 0, -9.81)
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.01, 0.01])
b = p.createMultiBody(0, linkMasses=[0.05], linkCollisionShapeIndices=[s],
    linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
    linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
    linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
p.setJointMotorControl2(b, 0, p.VELOCITY_CONTROL, targetVelocity={rate}, force=1)
steps(120)
"""
BULLET = """
s = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
b = p.createMultiBody(1, s, -1, [0, 0, 3000])
p.changeDynamics(b, -1, linearDamping=0)
p.resetBaseVelocity(b, [0, 0, {speed}])
steps(30)
"""


@pytest.mark.parametrize(
    "scene",
    some(
        [
            PENDULUM,
            FAN.format(rate=90),
            FAN.format(rate=150),
            AIR + BULLET.format(speed=-400),
            FLOOR + "p.loadURDF('cube_small.urdf', [0, 0, 0.3], [0.3, 0.2, 0.1, 0.9])\nsteps(400)",
            ROBOTS.format(
                file="laikago/laikago_toes.urdf", z=0.5, turn="0, .5**.5, .5**.5, 0", fixed=False
            ),
            ROBOTS.format(file="a1/a1.urdf", z=0.35, turn="0, 0, 0, 1", fixed=False),
            ROBOTS.format(file="r2d2.urdf", z=0.5, turn="0, 0, 0, 1", fixed=False),
            ROBOTS.format(file="franka_panda/panda.urdf", z=0, turn="0, 0, 0, 1", fixed=True),
            ROBOTS.format(file="kuka_iiwa/model.urdf", z=0, turn="0, 0, 0, 1", fixed=True),
        ],
        3,
    ),
)
def test_what_does_not_ring(scene: str, tmp_path: Path) -> None:
    assert not ask(scene, tmp_path, "unstable")


@pytest.mark.parametrize(
    ("scene", "slower", "unit"),
    [
        (FAN.format(rate=150), FAN.format(rate=90), "N m s"),
        (AIR + BULLET.format(speed=-400), AIR + BULLET.format(speed=-50), "N s"),
        (
            AIR + CUBE + "p.changeDynamics(c, -1, maxJointVelocity=0.5)\nsteps(60)",
            AIR + CUBE + "p.changeDynamics(c, -1, maxJointVelocity=500)\nsteps(60)",
            "N s",
        ),
    ],
)
def test_what_the_clamp_takes(scene: str, slower: str, unit: str, tmp_path: Path) -> None:
    found = one(scene, tmp_path, "velocity-clamped")
    assert found.effect is not None
    assert found.effect.unit == unit
    assert found.effect.value > 0
    assert not ask(slower, tmp_path, "velocity-clamped")


def test_what_rings_at_the_clamp_is_not_clamped(tmp_path: Path) -> None:
    assert not ask(AIR + KUKA + SINE.format(gain=0.1), tmp_path, "velocity-clamped")


# -- asleep ---------------------------------------------------------------------------------------

SLEEPER = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.2] * 3)
low = p.createMultiBody(0, s, -1, [0, 0, 0.2])
b = p.loadURDF("cube_small.urdf", [0, 0, 0.425]{flags})
steps(600)
{more}
steps(60)
"""


@pytest.mark.parametrize(
    "more",
    some(
        [
            "p.removeBody(low)",
            "p.setGravity(3, 0, 9.81)",
            "p.resetBasePositionAndOrientation(low, [5, 0, 0.2], [0, 0, 0, 1])",
        ],
        1,
    ),
)
def test_a_body_that_sleeps_through_it(more: str, tmp_path: Path) -> None:
    flags = ", flags=p.URDF_ENABLE_SLEEPING"
    found = one(SLEEPER.format(flags=flags, more=more), tmp_path, "asleep")
    assert found.level == "asked"
    assert found.steps is not None
    assert found.steps.count >= 59
    # One that may not sleep falls.
    assert not ask(SLEEPER.format(flags="", more=more), tmp_path, "asleep")


def test_a_body_that_sleeps_where_it_lies(tmp_path: Path) -> None:
    flags = ", flags=p.URDF_ENABLE_SLEEPING"
    assert not ask(SLEEPER.format(flags=flags, more=""), tmp_path, "asleep")


# -- momentum-drift -------------------------------------------------------------------------------

TUMBLING = """
p.setTimeStep(1 / {rate})
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.15, 0.05, 0.02]))
p.changeDynamics(b, -1, linearDamping=0, angularDamping=0)
p.resetBaseVelocity(b, [0, 0, 0], {spin})
steps({n})
"""
FLOATING = """
import math
k = p.loadURDF("{file}", [0, 0, 2])
p.setTimeStep(1 / {rate})
J = [j for j in range(p.getNumJoints(k)) if p.getJointInfo(k, j)[2] == 0]
p.changeDynamics(k, -1, linearDamping=0, angularDamping=0)
for j in J:
    p.changeDynamics(k, j, jointDamping=0)
for i in range(2 * {rate}):
    t = i / {rate}
    for n, j in enumerate(J):
        where = 0.8 * math.sin(6 * t + n) * min(1, t)
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, where, force={force},
            positionGain=24 / {rate})
    p.stepSimulation()
"""


@pytest.mark.parametrize(
    ("scene", "unit"),
    some(
        [
            (TUMBLING.format(rate=240, spin="[0.05, 10, 0.05]", n=1200), "kg m²/s"),
            (FLOATING.format(file="kuka_iiwa/model_free_base.urdf", rate=240, force=100), "kg m/s"),
        ],
        1,
    ),
)
def test_momentum_that_nothing_gave(scene: str, unit: str, tmp_path: Path) -> None:
    found = one(scene, tmp_path, "momentum-drift")
    assert found.effect is not None
    assert found.effect.unit == unit
    # It promises no factor: where gains are shares per step, a finer timestep is another motion.
    assert str(found.advice).startswith("a shorter timestep makes it less: p.setTimeStep(")


SWAYING = """
import math
k = p.loadURDF("{file}", [0, 0, 2])
p.setTimeStep(1 / {rate})
J = [j for j in range(p.getNumJoints(k)) if p.getJointInfo(k, j)[2] == 0]
p.changeDynamics(k, -1, linearDamping=0, angularDamping=0)
for i in range(2 * {rate}):
    for j in J:
        p.setJointMotorControl2(k, j, p.POSITION_CONTROL, .8 * math.sin(6 * i / {rate}), force=200,
            positionGain=24 / {rate})
    p.stepSimulation()
"""
ITS_CENTRE = """
def centre(x=0, mass=0):
    for j in range(-1, p.getNumJoints(k)):
        m = p.getDynamicsInfo(k, j)[0]
        at = p.getLinkState(k, j, computeForwardKinematics=1) if j >= 0 else (
            p.getBasePositionAndOrientation(k))
        x, mass = x + m * np.array(at[0]), mass + m
    return x / mass
"""


@pytest.mark.long
@pytest.mark.parametrize(
    "file",
    some(["kuka_iiwa/model_free_base.urdf", "franka_panda/panda.urdf", "a1/a1.urdf"], 1),
)
def test_a_robot_that_sways_in_empty_space_drifts(file: str, tmp_path: Path) -> None:
    said, ways = [], []
    for rate in (240, 480):
        scene = SWAYING.format(file=file, rate=rate)
        (found,) = ask(scene, tmp_path, "momentum-drift")
        assert found.effect is not None
        said.append(found.effect.value)
        ways.append(np.linalg.norm(centre_of(scene) - centre_of(scene.split("for i in")[0])))
    assert said[0] == pytest.approx(2 * said[1], rel=0.15)
    assert ways[0] == pytest.approx(2 * ways[1], rel=0.2)


def centre_of(scene: str) -> Any:
    """Return where the centre of mass of k ends up, in plain PyBullet."""
    names: dict[str, Any] = {}
    release_clients()
    exec(HEAD + "import numpy as np\n" + scene + ITS_CENTRE + "end = centre()", names)
    p.disconnect()
    return names["end"]


@pytest.mark.parametrize(
    "scene",
    [
        SWAYING.format(file="husky/husky.urdf", rate=240),  # its wheels turn, and it stays
        TUMBLING.format(rate=240, spin="[0, 10, 0]", n=300),  # about one axis
        AIR + CUBE + "steps(90)",
        FLOOR + "p.loadURDF('cube_small.urdf', [0, 0, 0.3], [0.3, 0.2, 0.1, 0.9])\nsteps(240)",
        "b = p.loadURDF('r2d2.urdf')\nfor i in range(60):\n"
        "    p.applyExternalForce(b, -1, [50, 0, 0], [0, 0, 0.3], p.LINK_FRAME)\n"
        "    p.stepSimulation()",
    ],
)
def test_momentum_that_stays_or_was_given(scene: str, tmp_path: Path) -> None:
    assert not ask(scene, tmp_path, "momentum-drift")


@pytest.mark.parametrize(
    ("set_up", "label", "call"),
    some(
        [
            (
                "p.resetBaseVelocity(c, [1e200, 0, 0])\np.resetJointState(k, 2, float('inf'))",
                "model",
                2,
            ),
            (
                "p.resetJointState(k, 2, float('inf'))\np.resetBaseVelocity(c, [1e200, 0, 0])",
                "model",
                1,
            ),
            ("p.resetBaseVelocity(c, [1e200, 0, 0])", "cube_small", None),
        ],
        1,
    ),
)
def test_a_call_is_blamed_only_for_its_own_body(
    set_up: str, label: str, call: int | None, tmp_path: Path
) -> None:
    scene = AIR + CUBE + KUKA
    recording = record(scene + set_up + "\nsteps(5)", tmp_path / "overflow.rrd")
    found = of_code(analyze(recording.seen), "not-finite")
    assert (found.level, found.steps and found.steps.first) == ("broken", 1)
    assert label in str(found.body)
    assert found.site == (call and site(scene.count("\n") + call))


@pytest.mark.parametrize("how", ["", ", useMaximalCoordinates=True"])
@pytest.mark.parametrize(
    "call",
    some(
        [
            "p.changeDynamics(b, -1, linearDamping=0, maxJointVelocity=1e308)\n"
            "p.resetBaseVelocity(b, [1e200, 0, 0])",
            "p.resetBasePositionAndOrientation(b, [0, 0, 1e100], [0, 0, 0, 1])",
            "p.changeDynamics(b, -1, mass=float('inf'))",
            "p.changeDynamics(b, -1, localInertiaDiagonal=[float('nan'), 1, 1])",
            "p.setTimeStep(1e300)",
            "k = p.loadURDF('kuka_iiwa/model.urdf')\np.resetJointState(k, 2, 0, float('inf'))",
            "k = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)\n"
            "p.setJointMotorControl2(k, 2, p.POSITION_CONTROL, 1, positionGain=float('inf'))",
            "p.loadURDF('cube_small.urdf', globalScaling=1e300)",
        ],
        3,
    ),
)
def test_numbers_that_overflow_warn_nobody(call: str, how: str, tmp_path: Path) -> None:
    """Warnings are errors here, in recording and in analysis."""
    scene = f"p.setGravity(0, 0, -9.81)\nb = p.loadURDF('cube_small.urdf', [0, 0, 1]{how})\n"
    path = tmp_path / "overflow.rrd"
    analysis = analyze(record(scene + "steps(3)\n" + call + "\nsteps(6)", path).seen)
    assert not any("inf m " in str(each.message) for each in analysis.findings)


def test_a_throw_that_drag_would_stop_at_once_is_analyzed(tmp_path: Path) -> None:
    scene = """
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
p.changeDynamics(b, -1, maxJointVelocity=1e308)
steps(5)
p.resetBaseVelocity(b, [1e20, 0, 0])
steps(6)
"""
    (body,) = analyze(record(scene, tmp_path / "run.rrd").seen).bodies
    assert body.flights[-1].terms_m is None
