"""Verification: with `numSubSteps` a step is the sum of its substeps, if they are known.

Bare PyBullet makes the steps. The tolerance is the rule's own: 1e-9 of the largest term where
nothing is held that the engine reports of the last substep alone, else 1e-6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from conftest import some
from drop_physics.analysis.story import Story
from drop_physics.explain.step_status import SEGMENTS
from drop_physics.physics.impulses import Summed
from drop_physics.physics.laws.bullet import substeps as bullet_substeps
from drop_physics.physics.laws.bullet.substeps import HELD, sum_of_substeps
from drop_physics.physics.step_law import Reported
from drop_physics.physics.tree import States
from scenes import body_of, explanation, found, record
from test_tree_law import MORE, ROBOTS
from trees import Watched, described, engine, joints_of, load, motors_off

CLOSES = 1e-11
"""Tolerance; 2e-14 was measured."""
ARM = "kuka_iiwa/model.urdf"
Drive = Callable[[Watched, int], None]


def watched(
    file: str,
    substeps: int,
    drive: Drive | None = None,
    *,
    fixed: bool = False,
    steps: int = 40,
    ready: Callable[[int], None] = motors_off,
    floor: bool = False,
    at: tuple[float, float, float] = (0, 0, 3),
) -> Watched:
    """Simulate a robot whose joints and base, if movable, start in motion."""
    with engine(floor=floor):
        p.setPhysicsEngineParameter(numSubSteps=substeps)
        body = load(file, at=at, fixed=fixed)
        ready(body)
        draw = np.random.default_rng(3)
        if not floor:
            for joint in joints_of(body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
                p.resetJointState(body, joint, draw.uniform(-0.2, 0.2), draw.uniform(-1, 1))
            if not fixed:
                p.resetBaseVelocity(body, [0.3, 0.2, 1], [1, 2, -1])
        seen = Watched(body, described(body))
        for step in range(steps):
            if drive is not None:
                drive(seen, step)
            p.stepSimulation()
            seen.stepped()
    return seen


def summed(
    seen: Watched, substeps: int, servos: Callable[[States], np.ndarray] | None = None
) -> tuple[Summed, np.ndarray]:
    """Return the sum, with last-substep reports scaled to the step, and PD_CONTROL's efforts."""
    said, states = seen.reported(), seen.states()
    said = replace(
        said,
        motors=said.motors * substeps,
        contacts=replace(said.contacts, force_n=said.contacts.force_n * substeps),
    )
    nothing = np.zeros((len(said.timestep_s), seen.law.tree.joint_rates))
    return sum_of_substeps(seen.law, states, said, substeps, servos or (lambda _: nothing))


def torques(seen: Watched, step: int) -> None:
    for joint in joints_of(seen.body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
        seen.torque(joint, 3 * np.sin(step / 9 + joint))


def pushes(seen: Watched, _: int) -> None:
    seen.push(-1, [0.3, 0.1, 2], [0.05, 0, 0.02], p.LINK_FRAME)
    seen.push(-1, [0, 0.01, 0.02], [0, 0, 0], p.WORLD_FRAME, torque=True)


FREE: dict[str, tuple[str, Drive | None, bool]] = {
    "a cube": ("cube_small.urdf", None, False),
    "a cube that is pushed": ("cube_small.urdf", pushes, False),
    "an arm": (ARM, None, True),
    "an arm with torques": (ARM, torques, True),
    "a robot with legs": ("laikago/laikago.urdf", None, False),
    "a robot with legs that is pushed": ("laikago/laikago.urdf", pushes, False),
    "wheels": ("husky/husky.urdf", torques, False),
    "a walker with many joints": ("quadruped/minitaur.urdf", torques, False),
}


@pytest.mark.parametrize("substeps", some([2, 5], 3))
@pytest.mark.parametrize("name", [*FREE])
def test_what_nothing_touches_follows_to_rounding(name: str, substeps: int) -> None:
    file, drive, fixed = FREE[name]
    seen = watched(file, substeps, drive, fixed=fixed)
    sums = summed(seen, substeps)[0]
    assert sums.unexplained.max() <= CLOSES
    assert (sums.allowed < HELD).all()
    changed, given = sums.changed_j, sum(sums.energy_j.values())
    assert np.abs(changed - given).max() <= 1e-12 * max(1.0, np.abs(given).max())


@pytest.mark.parametrize("file", some({file: file for file in (*ROBOTS, *MORE[1::2])}, 6))
def test_any_robot_follows_to_rounding_off_its_stops(file: str) -> None:
    with engine():
        p.setPhysicsEngineParameter(numSubSteps=4)
        body = load(file, at=(0, 0, 5))
        motors_off(body)
        for joint in joints_of(body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
            lower, upper = p.getJointInfo(body, joint)[8:10]
            p.resetJointState(body, joint, (lower + upper) / 2 if lower < upper else 0.0, 0.5)
        seen = Watched(body, described(body))
        for _ in range(25):
            p.stepSimulation()
            seen.stepped()
    free = ~np.isin(np.arange(25), seen.reported().contacts.step) & off_its_stops(seen)
    assert summed(seen, 4)[0].unexplained[free].max(initial=0.0) <= CLOSES


def off_its_stops(seen: Watched) -> np.ndarray:
    """Return the steps in which no joint is near a limit, before or after."""
    law, joints = seen.law, seen.states().joints
    near = np.zeros(len(joints), np.bool_)
    for kind, at, rate in zip(law.tree.joints, law.tree.coordinates, law.tree.rates, strict=True):
        k = rate.start - law.tree.first_rate
        if kind == "spherical":
            near |= min(law.lower[k], law.upper[k]) > 0
        elif kind != "fixed" and law.lower[k] <= law.upper[k]:
            q = joints[:, at.start]
            near |= (q < law.lower[k] + 0.01) | (q > law.upper[k] - 0.01)
    return ~(near[:-1] | near[1:])


def test_spherical_joints_turn_as_pybullet_turns_them() -> None:
    """The chain built here has no joint limits, unlike the humanoid."""
    with engine():
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.05, 0.02])
        body = p.createMultiBody(
            1,
            box,
            basePosition=[0, 0, 3],
            linkMasses=[1, 1],
            linkCollisionShapeIndices=[box] * 2,
            linkVisualShapeIndices=[-1] * 2,
            linkPositions=[[0.3, 0, 0]] * 2,
            linkOrientations=[[0, 0, 0, 1]] * 2,
            linkInertialFramePositions=[[0, 0, 0]] * 2,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
            linkParentIndices=[0, 1],
            linkJointTypes=[p.JOINT_SPHERICAL] * 2,
            linkJointAxis=[[0, 0, 1]] * 2,
        )
        p.setPhysicsEngineParameter(numSubSteps=3)
        motors_off(body)
        for joint in (0, 1):
            p.resetJointStateMultiDof(body, joint, [0, 0.1, 0.2, 0.97], [3, -2, 1])
        seen = Watched(body, described(body))
        for _ in range(30):
            p.stepSimulation()
            seen.stepped()
    assert summed(seen, 3)[0].unexplained.max() <= CLOSES


@pytest.mark.parametrize("substeps", [1, 2, 4])
def test_pd_control_is_added_in_each_substep(substeps: int) -> None:
    """The k-th substep applies k times the torque: with four, the mean is 2.5 times as large."""

    def steer(seen: Watched, _: int) -> None:
        for joint in range(7):
            seen.steer(joint, target=0.3, target_velocity=0.1, kp=20, kd=1, limit=3)

    def servos(states: States) -> np.ndarray:
        return np.clip(20 * (0.3 - states.joints) + (0.1 - states.velocity), -3, 3)

    seen = watched(ARM, substeps, steer, fixed=True)
    sums, pd = summed(seen, substeps, servos)
    assert sums.unexplained.max() <= CLOSES
    assert np.abs(pd).max() > 2.9 * substeps
    if substeps > 1:
        assert summed(seen, substeps, lambda s: servos(s) / substeps)[0].unexplained.min() > HELD


def hold(force: float) -> Callable[[int], None]:
    def ready(body: int) -> None:
        for joint in joints_of(body):
            p.setJointMotorControl2(body, joint, p.POSITION_CONTROL, 0.4, force=force)

    return ready


@pytest.mark.parametrize("substeps", [2, 4])
def test_motors_that_hold_give_the_same_in_each_substep(substeps: int) -> None:
    """At the end they agree to rounding; before that they do not, and this is reported."""
    seen = watched(ARM, substeps, fixed=True, ready=hold(300), steps=600)
    sums = summed(seen, substeps)[0]
    assert (sums.allowed == HELD).all()
    assert sums.unexplained[:20].min() > HELD
    assert sums.unexplained[-100:].max() <= 1e-12
    weight = np.abs(sums.terms["gravity"][-1]).max()
    assert sums.terms["motors"][-1] == pytest.approx(-sums.terms["gravity"][-1], abs=1e-6 * weight)


def test_a_cart_at_its_motors_limit_is_given_that_in_each_substep() -> None:
    """The limit is force × the whole timestep: two substeps apply twice the force."""

    def push(body: int) -> None:
        for joint in (0, 1):
            p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, targetVelocity=50, force=2)

    seen = watched("cartpole.urdf", 2, fixed=True, ready=push, steps=40)
    sums, _ = summed(seen, 2)
    assert sums.unexplained.max() <= CLOSES
    assert sums.terms["motors"][:, 0] == pytest.approx(2 * 2 / 240, rel=1e-12)


def altered(name: str) -> Callable[[Watched], Summed]:
    """Return a variant of the integration rule with one deliberate error."""

    def rates(seen: Watched) -> Summed:
        """Compute joint damping from the rates before each substep, as if it were a whole step."""
        kept = bullet_substeps._substeps

        def fresh(*args: object) -> tuple[list[States], list[Reported]]:
            begins, given = kept(*args)  # type: ignore[arg-type]
            return begins, [replace(each, damped=None) for each in given]

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(bullet_substeps, "_substeps", fresh)
            return summed(seen, 3)[0]

    return {
        "substeps": lambda seen: summed(seen, 2)[0],
        "joint damping": rates,
    }[name]


@pytest.mark.parametrize("name", ["substeps", "joint damping"])
def test_another_law_does_not_close(name: str) -> None:
    seen = watched(ARM, 3, torques, fixed=True)
    assert summed(seen, 3)[0].unexplained.max() <= CLOSES
    assert np.median(altered(name)(seen).unexplained) > HELD


# -- in recordings ---------------------------------------------------------------------------------

BOX = """
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(numSubSteps=4)
p.loadURDF("plane.urdf")
b = p.loadURDF("cube_small.urdf", [0, 0, 0.5])
steps(480)
"""
HELD_ARM = """
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(numSubSteps=4)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for j in range(7):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.4 * (j % 2), force=30)
steps(480)
"""


def test_a_box_that_comes_to_rest_is_explained_before_and_after_its_bounces(
    tmp_path: Path,
) -> None:
    """Its bounces are unexplained, because the engine reports only their last substep."""
    seen = record(BOX, tmp_path / "box.rrd").seen
    totals = explanation(seen).totals[1]
    counts = dict(zip(SEGMENTS, totals.segments.tolist(), strict=True))
    assert counts["flight"] > 70
    assert counts["contact"] > 300
    assert {*totals.unexplained} == {"substeps"}
    assert totals.unexplained["substeps"].samples < 60
    assert 1e-9 < totals.remainder <= HELD
    analysis = Story(seen, {}).analysis()
    (contact,) = body_of(analysis, 1).contacts
    weight_n = 0.1 * 9.81
    assert contact.largest_force_n == pytest.approx(weight_n, rel=1e-3)
    rest_s = contact.end_s - contact.start_s + 1 / 240
    assert contact.impulse_n_s[2] == pytest.approx(weight_n * rest_s, rel=1e-3)
    (touch,) = body_of(analysis, 1).touches
    assert touch.impulse_n_s is touch.energy_j is touch.energy_of_pair_j is None


def test_torques_are_those_that_hold_the_arm(tmp_path: Path) -> None:
    """PyBullet reports a quarter of the torques, and allows each motor four times its force."""
    analysis = Story(record(HELD_ARM, tmp_path / "arm.rrd").seen, {}).analysis()
    body = body_of(analysis, 0)
    for joint in body.joints:
        assert joint.torque == pytest.approx(joint.needs, abs=1e-3)
        assert joint.force_limit == pytest.approx(4 * 30)
    assert max(abs(joint.torque or 0) for joint in body.joints) > 10
    assert found(analysis, "substeps-scale-motors").message
    assert body.segments["driven"] > 200
