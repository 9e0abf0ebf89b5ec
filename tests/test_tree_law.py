"""Verification: an articulated body's step in PyBullet equals the sum of its impulses.

Each scene is driven with bare PyBullet (`trees`). What closes to rounding is equal: the largest
remainder that was measured is 1e-12 of the largest term, and CLOSES is ten times that.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pytest
from conftest import some
from drop_physics.physics import on_links
from drop_physics.physics.base import Motion
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.impulses import Forces, Sum, impulses_of
from drop_physics.physics.kinematics import kinematics, motion, spin_jacobian
from drop_physics.physics.laws.bullet import reports as bullet_reports
from drop_physics.physics.laws.bullet import tree as bullet_tree
from drop_physics.physics.laws.bullet.air import MAX_COORDINATE_VELOCITY_M_S
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.physics.laws.bullet.tree import not_covered, sum_of
from drop_physics.physics.step_law import DampedTree, Reported, StepConditions
from drop_physics.physics.tree import States, Tree
from trees import DATA, Watched, described, engine, is_fixed, joints_of, load, motors_off, run

CLOSES = 1e-11
FIXED = ("cartpole.urdf", "kuka_iiwa/model.urdf", "franka_panda/panda.urdf")
ROBOTS = (
    "cartpole.urdf", "kuka_iiwa/model.urdf", "r2d2.urdf", "humanoid/humanoid.urdf",
    "pr2_gripper.urdf", "mjcf/ant.xml", "spherical_joint_limit.urdf", "cube_small.urdf",
)  # fmt: skip
"""Robots tested in every run; the long tests add those below."""
MORE = (
    "franka_panda/panda.urdf", "laikago/laikago_toes_zup_lores.urdf", "quadruped/minitaur.urdf",
    "husky/husky.urdf", "racecar/racecar.urdf", "mjcf/humanoid_symmetric.xml",
    "TwoJointRobot_w_fixedJoints.urdf", "TwoJointRobot_wo_fixedJoints.urdf", "a1/a1.urdf",
    "aliengo/aliengo.urdf", "bicycle/bike.urdf", "biped/biped2d_pybullet.urdf",
    "cube_no_rotation.urdf", "cube_rotate.urdf", "differential/diff_ring.urdf",
    "gripper/wsg50_one_motor_gripper.sdf", "gripper/wsg50_one_motor_gripper_new.sdf",
    "gripper/wsg50_one_motor_gripper_new_free_base.sdf",
    "gripper/wsg50_one_motor_gripper_no_finger.sdf", "gripper/wsg50_with_r2d2_gripper.sdf",
    "kuka_iiwa/kuka_with_gripper.sdf", "kuka_iiwa/kuka_with_gripper2.sdf", "kuka_iiwa/model.sdf",
    "kuka_iiwa/model_free_base.urdf", "kuka_iiwa/model_vr_limits.urdf", "laikago/laikago.urdf",
    "laikago/laikago_toes.urdf", "laikago/laikago_toes_limits.urdf",
    "laikago/laikago_toes_zup.urdf", "mini_cheetah/mini_cheetah.urdf", "mjcf/half_cheetah.xml",
    "mjcf/hopper.xml", "mjcf/humanoid.xml", "mjcf/humanoid_fixed.xml",
    "mjcf/humanoid_symmetric_no_ground.xml", "mjcf/inverted_double_pendulum.xml",
    "mjcf/inverted_pendulum.xml", "mjcf/pusher.xml", "mjcf/reacher.xml", "mjcf/striker.xml",
    "mjcf/swimmer.xml", "mjcf/thrower.xml", "mjcf/walker2d.xml", "pendulum5.urdf",
    "quadruped/microtaur/microtaur.urdf", "quadruped/minitaur_derpy.urdf",
    "quadruped/minitaur_fixed_all.urdf", "quadruped/minitaur_fixed_knees.urdf",
    "quadruped/minitaur_rainbow_dash.urdf", "quadruped/minitaur_rainbow_dash_v1.urdf",
    "quadruped/minitaur_single_motor.urdf", "quadruped/minitaur_v1.urdf",
    "quadruped/quadruped.urdf", "quadruped/spirit40.urdf", "quadruped/spirit40newer.urdf",
    "quadruped/vision60.urdf", "racecar/racecar_differential.urdf", "xarm/xarm6_robot.urdf",
    "xarm/xarm6_robot_white.urdf", "xarm/xarm6_with_gripper.urdf",
)  # fmt: skip
UNLOADED = (
    "gripper/wsg50_one_motor_gripper_free_base.sdf",
    "kuka_iiwa/kuka_world.sdf",
    "kuka_iiwa/model2.sdf",
    "kuka_iiwa/model_for_sdf.urdf",
)
"""Robots of pybullet_data that PyBullet itself cannot load: the first aborts the process."""
MODES = ("default", "off", "position", "velocity", "torque", "pd")
DRIVEN = [
    (file, MODES[(number + other) % len(MODES)])
    for number, file in enumerate(ROBOTS)
    for other in (0, 2, 4)
]
DRIVEN += [
    pytest.param(file, MODES[number % len(MODES)], marks=pytest.mark.long)
    for number, file in enumerate(MORE[::2])
]
"""Robots, each with a way of driving its joints, in turn: three ways, or one for further robots.

The others of these are driven in `test_substeps`.
"""
every = [*ROBOTS, *(pytest.param(file, marks=pytest.mark.long) for file in MORE)]
A_FEW = ("kuka_iiwa/model.urdf", "mjcf/ant.xml")
few = [
    *A_FEW,
    *(
        pytest.param(file, marks=pytest.mark.long)
        for file in (*ROBOTS, *MORE[:14:2], *MORE[-1:])
        if file not in A_FEW
    ),
]
"""Parameters for tests of a single term, which any robot shows."""
Act = Callable[[int], None]


def quiet(
    steps: int, joint_rates: int, timestep_s: float, gravity_m_s2: tuple[float, ...]
) -> Reported:
    """Return steps in which only gravity acts."""
    efforts = np.zeros((steps, joint_rates))
    return Reported(
        timestep_s=np.full(steps, timestep_s),
        gravity_m_s2=np.tile(gravity_m_s2, (steps, 1)),
        motors=efforts,
        commanded=efforts,
        pd=efforts,
    )


def closes(found: Sum) -> None:
    assert found.unexplained.max() <= CLOSES
    assert np.isfinite(found.remainder).all()


def robot(file: str, *, height_m: float = 0.0, **how: Any) -> Watched:
    fixed = file in FIXED
    body = load(file, at=(0, 0, 0 if fixed else height_m), fixed=fixed, **how)
    return Watched(body, described(body))


def target_of(body: int, joint: int, step: int) -> float:
    lower, upper = p.getJointInfo(body, joint)[8:10]
    middle, half = ((lower + upper) / 2, min((upper - lower) / 2, 1)) if lower < upper else (0, 1)
    return float(middle + 0.4 * half * math.sin(0.05 * step + joint))


def driven(watched: Watched, mode: str) -> Act:
    """Return a function that commands a body's joints in each step."""
    body = watched.body
    joints, spherical = joints_of(body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC), joints_of(body, 2)
    if mode in ("off", "torque", "pd"):
        motors_off(body)

    def act(step: int) -> None:
        for joint in joints:
            if mode == "position":
                where = target_of(body, joint, step)
                p.setJointMotorControl2(body, joint, p.POSITION_CONTROL, where, force=60)
            elif mode == "velocity":
                rate = 2 * math.cos(0.05 * step + joint)
                p.setJointMotorControl2(
                    body, joint, p.VELOCITY_CONTROL, targetVelocity=rate, force=60
                )
            elif mode == "torque":
                watched.torque(joint, 0.5 * math.sin(0.1 * step + joint))
            elif mode == "pd":
                where = target_of(body, joint, step)
                watched.steer(joint, target=where, target_velocity=0.1, kp=2, kd=0.05, limit=1)
        for joint in spherical if mode == "position" else ():
            towards = p.getQuaternionFromEuler([0.3 * math.sin(0.1 * step), 0.2, 0])
            p.setJointMotorControlMultiDof(
                body,
                joint,
                p.POSITION_CONTROL,
                targetPosition=towards,
                positionGain=0.2,
                velocityGain=1,
                force=[200, 200, 200],
            )

    return act


def posed(body: int, seed: int = 1) -> None:
    """Give a body random joint positions within limits, joint rates, and a spinning base."""
    random = np.random.default_rng(seed)
    for joint in joints_of(body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
        lower, upper = p.getJointInfo(body, joint)[8:10]
        where = random.uniform(0.4, 0.6) * (upper - lower) + lower if lower < upper else 0.1
        p.resetJointState(body, joint, where, random.normal() * 0.3)
    for joint in joints_of(body, p.JOINT_SPHERICAL):
        turned = random.normal(size=4) * 0.2 + [0, 0, 0, 1]
        p.resetJointStateMultiDof(
            body, joint, turned / np.linalg.norm(turned), random.normal(size=3)
        )
    if not is_fixed(body):
        p.resetBaseVelocity(body, [0.5, 0.2, 0], [1, 0.5, 0.3])


@pytest.mark.long
@pytest.mark.parametrize("file", UNLOADED)
def test_robots_that_are_left_out_are_not_loaded_by_pybullet(file: str) -> None:
    loading = "loadURDF" if file.endswith(".urdf") else "loadSDF"
    script = f"import pybullet as p; p.connect(p.DIRECT); p.{loading}({str(Path(DATA, file))!r})"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode != 0


@pytest.mark.long
def test_no_other_file_of_pybullet_data_has_a_joint_that_moves() -> None:
    tried = {*ROBOTS, *MORE, *UNLOADED}
    paths = [path for suffix in ("urdf", "sdf", "xml") for path in Path(DATA).rglob(f"*.{suffix}")]
    for path in paths:
        file = str(path.relative_to(DATA))
        if file not in tried and "<joint" in path.read_text(errors="ignore"):
            with engine():
                assert described(load(file)).tree.joint_rates == 0, file


# -- by hand --------------------------------------------------------------------------------------

MASS_KG, LENGTH_M, G, DT = 2.0, 0.5, 9.81, 1 / 100
PENDULUM = Tree(
    fixed=True,
    masses_kg=np.array([0.0, MASS_KG]),
    inertias_kg_m2=np.array([[0.0, 0, 0], [0, 0, 0]]),
    parents=(-1,),
    joints=("revolute",),
    axes=np.array([[0.0, 1, 0]]),
    positions_m=np.array([[0.1, 0.2, 0.3]]),
    orientations=np.array([[0.0, 0, 0, 1]]),
    centres_m=np.array([[0, 0, -LENGTH_M]]),
)
"""A point mass on a massless rod that rotates about y and hangs at 0."""


def undamped(tree: Tree) -> DampedTree:
    nothing = np.zeros(tree.joint_rates)
    return DampedTree(
        tree=tree,
        joint_damping=nothing,
        lower=nothing,
        upper=nothing - 1,
        linear_damping=0.0,
        angular_damping=0.0,
        velocity_limit=MAX_COORDINATE_VELOCITY_M_S,
    )


def states_of(q: list[float], u: list[float]) -> States:
    count = len(q)
    base = np.zeros((count, 3)), np.tile([0.0, 0, 0, 1], (count, 1))
    return States(*base, np.array(q)[:, None], np.array(u)[:, None])


def test_three_steps_of_a_pendulum_by_hand() -> None:
    """Verify m l² (u' - u) = -dt m g l sin q, and q' = q + dt u'; q grows towards -x."""
    q, u = [0.3], [0.7]
    for _ in range(3):
        u.append(u[-1] - DT * G / LENGTH_M * math.sin(q[-1]))
        q.append(q[-1] + DT * u[-1])
    found = sum_of(undamped(PENDULUM), states_of(q, u), quiet(3, 1, DT, (0, 0, -G)))
    inertia = MASS_KG * LENGTH_M**2
    assert found.matrices[:, 0, 0] == pytest.approx([inertia] * 4, rel=1e-14)
    pulled = [-DT * MASS_KG * G * LENGTH_M * math.sin(one) for one in q[:-1]]
    assert found.terms["gravity"][:, 0] == pytest.approx(pulled, rel=1e-14)
    assert found.unexplained.max() <= 1e-14
    heights = [-MASS_KG * G * LENGTH_M * math.cos(one) for one in q]
    energy = [0.5 * inertia * u[k] ** 2 + heights[k] for k in range(4)]
    assert found.energy_change_j() == pytest.approx(np.diff(energy), abs=1e-14)
    assert found.energy_j()["integrator"] == pytest.approx(np.diff(energy), abs=1e-14)


def test_what_a_weight_rounds_is_no_remainder() -> None:
    """A pendulum hangs: its weight acts through its joint, and no term shows its magnitude."""
    rounded = 1e-16 * DT * MASS_KG * G / (MASS_KG * LENGTH_M**2)
    found = sum_of(undamped(PENDULUM), states_of([0, 0], [0, rounded]), quiet(1, 1, DT, (0, 0, -G)))
    assert found.unexplained[0] < 1e-15


def test_the_links_are_where_they_turn_to() -> None:
    kin = kinematics(PENDULUM, states_of([0.3], [0.7]))
    hung = [0.1 - LENGTH_M * math.sin(0.3), 0.2, 0.3 - LENGTH_M * math.cos(0.3)]
    assert kin.position_m(0)[0] == pytest.approx(hung, abs=1e-15)


@pytest.mark.parametrize(
    "wrong",
    [{"parents": (0,)}, {"joints": ("planar",)}, {"axes": np.ones((2, 3))}, {"joints": ()}],
)
def test_a_tree_that_is_none_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="link"):
        replace(PENDULUM, **wrong)


# -- kinematics and the mass matrix -------------------------------------------------------------


@pytest.mark.parametrize("file", some(every, 3))
def test_links_are_where_pybullet_has_them(file: str) -> None:
    """Poses agree to 1e-14 m or rad, and velocities, of up to about 3 m/s, likewise."""
    with engine():
        watched = robot(file, height_m=0.3)
        posed(watched.body)
        watched.look()
        states = watched.states()
        kin = kinematics(watched.law.tree, states)
        moved = motion(kin, states.velocity)
        for link in range(p.getNumJoints(watched.body)):
            state = p.getLinkState(watched.body, link, 1, computeForwardKinematics=True)
            turned = np.reshape(p.getMatrixFromQuaternion(state[1]), (3, 3))
            assert kin.position_m(link)[-1] == pytest.approx(state[0], abs=1e-14)
            assert kin.matrix(link)[-1] == pytest.approx(turned, abs=1e-14)
            assert moved.velocities[link + 1][:, -1] == pytest.approx(state[6], abs=1e-13)
            assert moved.spins[link + 1][:, -1] == pytest.approx(state[7], abs=1e-13)
            by_matrix = spin_jacobian(kin, link)[-1] @ states.velocity[-1]
            assert by_matrix == pytest.approx(moved.spins[link + 1][:, -1], abs=1e-13)


@pytest.mark.parametrize("file", [*FIXED, "xarm/xarm6_with_gripper.urdf", "pendulum5.urdf"])
def test_the_mass_matrix_is_pybullets(file: str) -> None:
    with engine():
        watched = robot(file)
        posed(watched.body)
        watched.look()
        states = watched.states()
        ours = mass_matrix(kinematics(watched.law.tree, states))[-1]
        theirs = np.array(p.calculateMassMatrix(watched.body, states.joints[-1].tolist()))
        assert ours == pytest.approx(theirs, abs=1e-14 * np.abs(theirs).max())


# -- the sum --------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", some(every, 3))
def test_free_motion_closes(file: str) -> None:
    with engine():
        watched = robot(file, height_m=5)
        motors_off(watched.body)
        posed(watched.body)
        watched = Watched(watched.body, watched.law)
        run([watched], 60)
        closes(watched.sum())


@pytest.mark.parametrize(("file", "mode"), some(DRIVEN, 3))
def test_a_robot_on_a_floor_that_may_touch_itself_closes(file: str, mode: str) -> None:
    with engine(floor=True):
        flags = {"flags": p.URDF_USE_SELF_COLLISION} if file.endswith(".urdf") else {}
        watched = robot(file, height_m=0.6, **flags)
        run([watched], 90, driven(watched, mode))
        closes(watched.sum())


def test_stops_push_inwards() -> None:
    """Forces act if a joint is beyond a limit before a step; otherwise no force is a limit's."""
    with engine(floor=True):
        watched = robot("r2d2.urdf", height_m=0.6)
        run([watched], 150, driven(watched, "velocity"))
        found, states, law = watched.sum(), watched.states(), watched.law
        closes(found)
    below, above = (np.zeros_like(found.remainder, dtype=bool) for _ in range(2))
    for link, rate in enumerate(law.tree.rates):
        for k in range(rate.start, rate.stop):
            lower, upper = law.lower[k - 6], law.upper[k - 6]
            q = states.joints[:-1, law.tree.coordinates[link].start]
            below[:, k], above[:, k] = lower <= upper and q <= lower, lower <= upper and q >= upper
    stops = found.terms["stops"]
    assert (stops[below & ~above] >= 0).all()
    assert (stops[above & ~below] <= 0).all()
    assert not stops[~(below | above)].any()
    assert np.count_nonzero(stops) > 50


def test_what_pulls_a_joint_beyond_its_stop_is_no_stop() -> None:
    law = replace(undamped(PENDULUM), lower=np.zeros(1), upper=np.ones(1))
    found = sum_of(law, states_of([0, -1], [0, -1]), quiet(1, 1, DT, (0, 0, -G)))
    assert not found.terms["stops"].any()
    assert found.remainder[0, 0] == pytest.approx(-MASS_KG * LENGTH_M**2, rel=1e-14)


# -- pushes, constraints, and what is set late ----------------------------------------------------

LAIKAGO = "r2d2.urdf"


@pytest.mark.parametrize("asked", some([False, True], 1))
@pytest.mark.parametrize("torque", [False, True])
@pytest.mark.parametrize("frame", [p.WORLD_FRAME, p.LINK_FRAME])
@pytest.mark.parametrize("link", [-1, 3])
def test_a_push_closes(link: int, frame: int, torque: bool, asked: bool) -> None:
    """A link is pushed at its pose of one step earlier, unless forward kinematics was requested."""
    with engine():
        watched = robot(LAIKAGO, height_m=2)

        def act(_: int) -> None:
            if asked:
                p.getLinkState(watched.body, 3, computeForwardKinematics=True)
                watched.fresh = True
            at = np.array([0.1, 0.02, 0.03])
            if frame == p.WORLD_FRAME:
                at = at + watched.where(link)
            watched.push(link, [3.0, 1, 2], at.tolist(), frame, torque=torque)

        run([watched], 20, act)
        closes(watched.sum())
        watched.pushed = [(*row[:-1], not row[-1]) for row in watched.pushed]
        matters = link >= 0 and not (torque and frame == p.WORLD_FRAME)
        assert (watched.sum().unexplained.max() > 1e-7) == matters


def _put_back(body: int) -> None:
    velocities, pose = p.getBaseVelocity(body), p.getBasePositionAndOrientation(body)
    p.resetBasePositionAndOrientation(body, *pose)
    p.resetBaseVelocity(body, *velocities)


REFRESHES: dict[str, Callable[[int], object]] = {
    "getLinkState of another": lambda b: p.getLinkState(b, 8, computeForwardKinematics=True),
    "getLinkStates": lambda b: p.getLinkStates(b, [3], computeForwardKinematics=True),
    "resetJointState": lambda b: p.resetJointState(b, 0, *p.getJointState(b, 0)[:2]),
    "resetBasePositionAndOrientation": _put_back,
    "resetBaseVelocity": lambda b: p.resetBaseVelocity(b, *p.getBaseVelocity(b)),
}
DOES_NOT: dict[str, Callable[[int], object]] = {
    "getLinkState without": lambda b: p.getLinkState(b, 3, computeLinkVelocity=1),
    "getJointStates": lambda b: p.getJointStates(b, [0, 3]),
    "performCollisionDetection": lambda _: p.performCollisionDetection(),
    "calculateInverseKinematics": lambda b: p.calculateInverseKinematics(b, 3, [0, 0, 0]),
}


@pytest.mark.parametrize("name", some([*REFRESHES, *DOES_NOT], 1))
def test_which_calls_let_a_push_use_the_current_pose(name: str) -> None:
    with engine():
        watched = robot(LAIKAGO, height_m=2)

        def act(_: int) -> None:
            (REFRESHES | DOES_NOT)[name](watched.body)
            watched.fresh |= name in REFRESHES
            watched.push(3, [3.0, 1, 2], [0.1, 0.02, 0.03], p.LINK_FRAME)

        run([watched], 10, act)
        closes(watched.sum())


def held(kind: int, arm: Watched, link: int, steps: int) -> list[tuple[Watched, Forces]]:
    """Swing a cube held by a constraint with a robot, and return both bodies with their forces."""
    where = arm.where(link)
    cube = load("cube_small.urdf", at=np.add(where, [0.1, 0.02, 0.05]))
    turned = p.getQuaternionFromEuler([0.3, 0.2, 0.1])
    pivots, said = ([0.01, 0.02, 0.08], [0.01, 0, 0.03]), []
    constraint = p.createConstraint(
        arm.body,
        link,
        cube,
        -1,
        kind,
        [0, 0, 0],
        *pivots,
        turned,
        p.getQuaternionFromEuler([0.1, 0, 0]),
    )
    bodies = arm, Watched(cube, described(cube))
    for _ in range(steps):
        for joint in joints_of(arm.body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
            p.setJointMotorControl2(arm.body, joint, p.POSITION_CONTROL, 0.3, force=87)
        run(bodies, 1)
        said.append(p.getConstraintState(constraint))
    axes = on_links.frame_axes(arm.kinematics(), link, turned)[:-1]
    return [
        (
            one,
            bullet_reports.constraint_forces(
                one.kinematics(),
                kind="fixed" if kind == p.JOINT_FIXED else "point2point",
                as_parent=one is arm,
                link=at,
                pivot_m=pivot,
                axes=axes,
                reported=np.array(said),
            ),
        )
        for one, at, pivot in zip(bodies, (link, -1), pivots, strict=True)
    ]


@pytest.mark.parametrize("kind", [p.JOINT_FIXED, p.JOINT_POINT2POINT])
def test_a_constraint_between_an_arm_and_a_cube_closes_for_both(kind: int) -> None:
    with engine():
        for watched, forces in held(kind, robot("kuka_iiwa/model.urdf"), 6, steps=100):
            closes(watched.sum(constraints=forces))
            assert watched.sum().unexplained.max() > 1e-3


def test_a_constraint_to_the_world_closes() -> None:
    with engine():
        watched, said = robot(LAIKAGO, height_m=1), []
        constraint = p.createConstraint(
            watched.body, 2, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0.1], [0.2, 0, 1]
        )
        for _ in range(60):
            run([watched], 1)
            said.append(p.getConstraintState(constraint))
        forces = bullet_reports.constraint_forces(
            watched.kinematics(),
            kind="point2point",
            as_parent=True,
            link=2,
            pivot_m=[0, 0, 0.1],
            axes=np.zeros((60, 3, 3)),
            reported=np.array(said),
        )
        closes(watched.sum(constraints=forces))


def test_a_gear_closes() -> None:
    with engine(floor=True):
        watched, said = robot("racecar/racecar_differential.urdf", height_m=0.1), []
        gear = p.createConstraint(
            watched.body, 9, watched.body, 11, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0]
        )
        p.changeConstraint(gear, gearRatio=-1.5, maxForce=10000)
        p.setJointMotorControl2(watched.body, 9, p.VELOCITY_CONTROL, targetVelocity=3, force=2)
        for _ in range(60):
            run([watched], 1)
            said.append(p.getConstraintState(gear)[0])
        given: dict[str, Any] = {
            "ratio": -1.5,
            "reported": np.array(said),
            "timestep_s": np.full(60, 1 / 240),
        }
        geared = sum(
            bullet_reports.gear_impulses(watched.law.tree, as_parent=parent, link=link, **given)
            for parent, link in ((True, 9), (False, 11))
        )
        closes(watched.sum(geared=geared))
        assert watched.sum().unexplained.max() > 1e-4


@pytest.mark.parametrize("timestep_s", [1 / 60, 1 / 1000])
def test_a_timestep_set_after_the_motors_calls_closes(timestep_s: float) -> None:
    """PyBullet keeps the motor's maximum impulse: force times the timestep at the call."""
    with engine(floor=True):
        watched = robot("kuka_iiwa/model.urdf")
        for joint in range(5):
            p.setJointMotorControl2(watched.body, joint, p.POSITION_CONTROL, 0.8, force=100)
        p.setTimeStep(timestep_s)
        run([watched], 60)
        found = watched.sum()
        closes(found)
        given = np.abs(found.terms["motors"][:, :5]).max()
        assert given == pytest.approx(100 / 240, rel=1e-12)


def test_both_clamps_close() -> None:
    """A motor that would cause 150 rad/s is clamped to 100 after the solver."""
    with engine():
        watched = robot("kuka_iiwa/model.urdf")
        p.setJointMotorControl2(watched.body, 6, p.VELOCITY_CONTROL, targetVelocity=150, force=100)
        run([watched], 40)
        found = watched.sum()
        closes(found)
        assert found.velocity[:, 6].max() == 100
        assert np.abs(found.terms["clamp"][:, 6]).max() > 1e-3


NO_ROLLING = {"rollingFriction": 0.0, "spinningFriction": 0.0}


def ball(**dynamics: float) -> Watched:
    """Return a ball that rolls and spins on the floor."""
    body = load("sphere_small.urdf", at=(0, 0, 0.03))
    p.changeDynamics(body, -1, **dynamics)
    p.resetBaseVelocity(body, [1, 0.5, 0], [1, 2, 8])
    return Watched(body, described(body))


def test_rolling_and_spinning_friction_of_a_ball() -> None:
    """Rolling and spinning friction give only a torque, and none without coefficients."""
    for dynamics in ({"rollingFriction": 0.01, "spinningFriction": 0.02}, NO_ROLLING):
        with engine(floor=True):
            watched = ball(**dynamics)
            run([watched], 100)
            found = watched.sum()
            closes(found)
            assert found.terms["rolling"].any() == any(dynamics.values())
            assert not found.terms["rolling"][:, 3:].any()


def test_a_cube_in_a_gripper_closes_for_both() -> None:
    """The panda's fingers have spinning friction."""
    with engine(floor=True):
        arm = robot("franka_panda/panda.urdf")
        ready = dict(
            zip((*range(7), 9, 10), (0, 0.3, 0, -2.2, 0, 2.5, 0.8, 0.04, 0.04), strict=True)
        )
        for joint, where in ready.items():
            p.resetJointState(arm.body, joint, where)
        cube = load("cube_small.urdf", at=p.getLinkState(arm.body, 11)[0])
        bodies = Watched(arm.body, arm.law), Watched(cube, described(cube))

        def act(step: int) -> None:
            for joint, where in ready.items():
                if joint < 9:
                    lift = 0.1 if step > 100 and joint == 1 else 0
                    p.setJointMotorControl2(
                        arm.body, joint, p.POSITION_CONTROL, where + lift, force=200
                    )
                else:
                    p.setJointMotorControl2(
                        arm.body, joint, p.VELOCITY_CONTROL, targetVelocity=-0.2, force=20
                    )

        run(bodies, 150, act)
        for one in bodies:
            found = one.sum()
            closes(found)
            assert found.terms["rolling"].any()


# -- the same for every robot ---------------------------------------------------------------------


@pytest.mark.parametrize("asked", [False, True])
@pytest.mark.parametrize("file", few)
def test_any_robot_that_is_pushed_closes(file: str, asked: bool) -> None:
    """Forces and torques act on its last link, in both frames at once."""
    with engine(floor=True):
        watched = robot(file, height_m=0.6)
        last = p.getNumJoints(watched.body) - 1

        def act(_: int) -> None:
            if asked and last >= 0:
                p.getLinkState(watched.body, last, computeForwardKinematics=True)
                watched.fresh = True
            at = np.add(watched.where(last), [0.01, 0.02, 0.03])
            for torque in (False, True):
                watched.push(last, [0.3, 0.1, 0.2], at.tolist(), p.WORLD_FRAME, torque=torque)
                watched.push(last, [0.1, 0.1, -0.2], [0.01, 0, 0], p.LINK_FRAME, torque=torque)

        run([watched], 30, act)
        closes(watched.sum())


@pytest.mark.parametrize("file", few)
def test_any_robot_with_rolling_and_spinning_friction_closes(file: str) -> None:
    with engine(floor=True):
        flags = {"flags": p.URDF_USE_SELF_COLLISION} if file.endswith(".urdf") else {}
        watched = robot(file, height_m=0.3, **flags)
        for link in range(-1, p.getNumJoints(watched.body)):
            p.changeDynamics(watched.body, link, rollingFriction=0.01, spinningFriction=0.02)
        run([watched], 120, driven(watched, "position"))
        closes(watched.sum())


@pytest.mark.parametrize("file", few)
def test_any_robot_whose_timestep_is_set_after_its_motors_closes(file: str) -> None:
    with engine(floor=True):
        watched = robot(file, height_m=0.3)
        driven(watched, "position")(10)
        p.setTimeStep(1 / 60)
        run([watched], 40)
        p.setTimeStep(1 / 500)
        run([watched], 40)
        closes(watched.sum())


@pytest.mark.parametrize("kind", [p.JOINT_FIXED, p.JOINT_POINT2POINT])
@pytest.mark.parametrize("file", few)
def test_any_robot_that_holds_a_cube_closes(file: str, kind: int) -> None:
    with engine(floor=True):
        one = robot(file, height_m=0.6)
        link = p.getNumJoints(one.body) - 1
        for watched, forces in held(kind, one, link, steps=60):
            closes(watched.sum(constraints=forces))


# -- each term is worth its test ----------------------------------------------------------------

Altered = tuple[DampedTree, dict[str, Any]]
LEFT_OUT: dict[str, Callable[[Watched], Altered]] = {
    "gravity": lambda w: (w.law, {"gravity_m_s2": np.zeros((len(w.timesteps), 3))}),
    "linear damping": lambda w: (replace(w.law, linear_damping=0.0), {}),
    "angular damping": lambda w: (replace(w.law, angular_damping=0.0), {}),
    "joint damping": lambda w: (replace(w.law, joint_damping=0 * w.law.joint_damping), {}),
    "applied": lambda w: (w.law, {"applied": Forces()}),
    "commanded": lambda w: (w.law, {"commanded": 0 * w.reported().commanded}),
    "pd": lambda w: (w.law, {"pd": 0 * w.reported().pd}),
    "motors": lambda w: (w.law, {"motors": 0 * w.reported().motors}),
    "contacts": lambda w: (w.law, {"contacts": Forces()}),
    "friction": lambda w: (w.law, {"contacts": _without_friction(w)}),
    "rolling": lambda w: (w.law, {"contacts": _without_rolling(w)}),
    "stops": lambda w: (replace(w.law, lower=0 * w.law.lower + 1, upper=0 * w.law.upper), {}),
    "clamp": lambda w: (replace(w.law, velocity_limit=np.inf), {}),
}


def _without_friction(watched: Watched) -> Forces:
    given = watched.reported().contacts
    upright = np.abs(given.force_n) * [0, 0, 1]
    return replace(given, force_n=upright)


def _without_rolling(watched: Watched) -> Forces:
    given = watched.reported().contacts
    return replace(given, rolling=np.zeros(len(given), bool))


def everything() -> Watched:
    """Return an arm with all terms at once, except the clamp (and rolling, which needs a ball)."""
    watched = robot("kuka_iiwa/model.urdf")
    p.changeDynamics(watched.body, 6, rollingFriction=0.01)
    block = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.3, 0.1])
    p.createMultiBody(0, block, -1, [0.5, 0.1, 0.35])
    for joint in (2, 4):
        p.setJointMotorControl2(watched.body, joint, p.VELOCITY_CONTROL, force=0)

    def act(_: int) -> None:
        p.setJointMotorControl2(watched.body, 1, p.POSITION_CONTROL, 1.4, force=300)
        p.setJointMotorControl2(watched.body, 3, p.POSITION_CONTROL, -2.4, force=300)
        watched.torque(2, 0.3)
        watched.steer(4, target=0.4, target_velocity=0, kp=3, kd=0.1, limit=2)
        watched.push(6, [0, 5, 1], watched.where(6).tolist(), p.WORLD_FRAME)

    run([watched], 150, act)
    return watched


@pytest.fixture(scope="module")
def scene() -> Watched:
    with engine(floor=True):
        return everything()


def altered(watched: Watched, name: str) -> Sum:
    law, more = LEFT_OUT[name](watched)
    return sum_of(law, watched.states(), watched.reported(**more))


@pytest.mark.parametrize(
    "name", [name for name in LEFT_OUT if name not in ("rolling", "stops", "clamp")]
)
def test_without_one_term_the_sum_of_an_arm_does_not_close(scene: Watched, name: str) -> None:
    closes(scene.sum())
    assert altered(scene, name).unexplained.max() > 1e3 * CLOSES


def test_without_the_bias_the_sum_does_not_close(
    scene: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bullet_tree, "bias", lambda kin, *_: np.zeros((len(kin), kin.tree.size)))
    assert scene.sum().unexplained.max() > 1e3 * CLOSES


@pytest.mark.parametrize(
    ("name", "file", "mode"),
    [
        ("stops", "r2d2.urdf", "velocity"),
        ("clamp", "kuka_iiwa/model.urdf", "torque"),
        ("rolling", "pr2_gripper.urdf", "default"),
    ],
)
def test_without_what_is_not_reported_the_sum_does_not_close(
    name: str, file: str, mode: str
) -> None:
    with engine(floor=True):
        watched = robot(file, height_m=0.6)
        run([watched], 150, driven(watched, mode))
        closes(watched.sum())
        assert altered(watched, name).unexplained.max() > 1e3 * CLOSES


# -- energy and momentum by cause -----------------------------------------------------------------


@pytest.mark.parametrize("file", few)
def test_energy_and_momentum_by_cause_close_over_hundreds_of_steps(file: str) -> None:
    with engine(floor=True):
        watched = robot(file, height_m=0.6)
        run([watched], 400, driven(watched, "position"))
        found = watched.sum()
    by_cause, change = found.energy_j(), found.energy_change_j()
    largest = max(np.abs(values).max() for values in by_cause.values())
    assert np.abs(change - sum(by_cause.values())).max() <= CLOSES * largest
    totals = {cause: values.sum() for cause, values in by_cause.items()}
    assert abs(change.sum() - sum(totals.values())) <= CLOSES * max(map(abs, totals.values()))
    assert abs(totals["remainder"]) <= CLOSES * max(map(abs, totals.values()))
    if watched.law.tree.fixed:
        return
    moved = {cause: values.sum(axis=0) for cause, values in found.momentum_kg_m_s().items()}
    left = found.momentum_change_kg_m_s().sum(axis=0) - sum(moved.values())
    assert np.abs(left).max() <= CLOSES * max(np.abs(value).max() for value in moved.values())
    masses = watched.law.tree.masses_kg[:, None, None]
    speeds = motion(watched.kinematics(), watched.states().velocity).velocities
    momentum = (masses * np.array(speeds)).sum(axis=0)
    assert found.momentum_change_kg_m_s().sum(axis=0) == pytest.approx(
        momentum[:, -1] - momentum[:, 0], abs=CLOSES * np.abs(momentum).max()
    )


# -- one law --------------------------------------------------------------------------------------


def test_a_free_body_is_a_tree_without_joints() -> None:
    """The sum for trees also closes over steps of a single body."""
    law = BulletLaw(
        timestep_s=DT,
        gravity_m_s2=(0.3, 0.1, -G),
        mass_kg=1.7,
        inertia_kg_m2=(0.1, 0.2, 0.25),
        linear_damping=0.04,
        angular_damping=0.07,
        coordinates="reduced",
    )
    tree = Tree(fixed=False, masses_kg=np.array([1.7]), inertias_kg_m2=np.array([[0.1, 0.2, 0.25]]))
    body = replace(undamped(tree), linear_damping=0.04, angular_damping=0.07)
    now = Motion(*(np.array([row]) for row in ((1, 2, 3), (0, 0, 0, 1), (4, 0, 5), (1, -5, 2))))
    path = [now]
    for _ in range(100):
        path.append(law.step(path[-1]))
    columns = [
        np.concatenate([getattr(one, name) for one in path])
        for name in ("position_m", "orientation", "velocity_m_s", "spin_rad_s")
    ]
    u = np.hstack((columns[3], columns[2]))
    states = States(columns[0], columns[1], np.empty((101, 0)), u)
    found = sum_of(body, states, quiet(100, 0, DT, (0.3, 0.1, -G)))
    assert found.unexplained.max() <= 1e-13


def test_pieces_give_what_the_whole_gives(scene: Watched) -> None:
    whole, states, said = scene.sum(), scene.states(), scene.reported()
    for first, last in ((0, 50), (50, 150)):
        piece = states.at(slice(first, last + 1))
        found = sum_of(scene.law, piece, said.at(slice(first, last)))
        for name, term in found.terms.items():
            assert term == pytest.approx(whole.terms[name][first:last], abs=1e-15), name


def test_memory_in_pieces_does_not_grow_with_the_steps(scene: Watched) -> None:
    states, said = scene.states(), scene.reported()

    def peak(pieces: int) -> int:
        tracemalloc.start()
        try:
            for _ in range(pieces):
                sum_of(scene.law, states.at(slice(0, 51)), said.at(slice(0, 50)))
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(1)  # what is kept for good, such as the places of the joints
    assert peak(10) < 1.1 * peak(2)


def test_a_state_that_is_no_number_spoils_its_own_steps_only(scene: Watched) -> None:
    """A diverging engine's steps are not explained, but the steps before are."""
    rates = scene.states().velocity.copy()
    rates[100] = np.nan
    with np.errstate(all="ignore"):
        found = sum_of(scene.law, replace(scene.states(), velocity=rates), scene.reported())
    spoilt = np.flatnonzero(~(found.unexplained <= CLOSES))
    assert spoilt.tolist() == [99, 100]


def test_each_contact_is_a_part_of_the_term(scene: Watched) -> None:
    said = scene.reported()
    parts = impulses_of(scene.kinematics(), said.contacts, said.timestep_s)
    assert parts.shape == (len(said.contacts), 7)
    together = np.zeros((150, 7))
    np.add.at(together, said.contacts.step, parts)
    assert scene.sum().terms["contacts"] == pytest.approx(together, abs=1e-15)


# -- where it does not hold -----------------------------------------------------------------------

SETTINGS: dict[str, dict[str, Any]] = {
    "engine": {"other_engine": True}, "substeps": {"substeps": 2}, "asleep": {"may_sleep": True},
    "maximal": {"maximal": True}, "planar": {"planar": True},
}  # fmt: skip


@pytest.mark.parametrize("reason", SETTINGS)
def test_settings_say_where_the_sum_need_not_hold(reason: str) -> None:
    assert not_covered(StepConditions(**SETTINGS[reason])) == (reason,)
    assert not_covered(StepConditions(substeps=1), PENDULUM) == ()


def test_a_tree_without_inertia_has_no_mass_matrix_to_invert() -> None:
    point = replace(PENDULUM, centres_m=np.zeros((1, 3)))
    assert not_covered(StepConditions(), replace(PENDULUM, masses_kg=np.zeros(2))) == ("massless",)
    assert not_covered(StepConditions(), point) == ("massless",)
    free = Tree(fixed=False, masses_kg=np.zeros(1), inertias_kg_m2=np.ones((1, 3)))
    assert not_covered(StepConditions(), free) == ("massless",)


def unreliable(reason: str) -> float:
    """Return the remainder of a step in a scene that the predicate declares unreliable."""
    with engine(floor=True):
        if reason == "substeps":
            p.setPhysicsEngineParameter(numSubSteps=2)
        if reason == "rolling unreported":
            p.setPhysicsEngineParameter(enableConeFriction=0)
        maximal = reason == "maximal"
        body = load("cube_small.urdf", at=(0, 0, 0.1), useMaximalCoordinates=maximal)
        if reason == "asleep":
            p.changeDynamics(body, -1, activationState=p.ACTIVATION_STATE_ENABLE_SLEEPING)
        if reason == "rolling unreported":
            p.changeDynamics(body, -1, rollingFriction=0.01)
            p.resetBaseVelocity(body, [1, 0.3, 0], [0, 3, 0])
        watched = Watched(body, described(body))
        run([watched], 600 if reason == "asleep" else 60)
        return float(watched.sum().unexplained.max())


@pytest.mark.parametrize("reason", ["substeps", "asleep", "maximal", "rolling unreported"])
def test_there_it_does_not_hold(reason: str) -> None:
    assert unreliable(reason) > 1e3 * CLOSES
