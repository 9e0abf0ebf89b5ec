"""Drive articulated bodies in bare PyBullet, and convert its reports for the integration rule."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pybullet as p
import pybullet_data
from clients import release_clients
from drop_physics.physics import on_links
from drop_physics.physics.columns import rotation
from drop_physics.physics.impulses import Forces, Sum
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.laws.bullet import tree as bullet_tree
from drop_physics.physics.laws.bullet.air import MAX_COORDINATE_VELOCITY_M_S
from drop_physics.physics.servo import pd_effort
from drop_physics.physics.step_law import DampedTree, Reported
from drop_physics.physics.tree import BASE, Joint, States, Tree

DATA = pybullet_data.getDataPath()
MOVES = {p.JOINT_REVOLUTE: 1, p.JOINT_PRISMATIC: 1, p.JOINT_SPHERICAL: 3}


@contextlib.contextmanager
def engine(*, gravity_m_s2: Sequence[float] = (0, 0, -9.81), floor: bool = False) -> Iterator[int]:
    """Connect to a new engine, which is the only one: PyBullet's client 0."""
    release_clients()
    client = p.connect(p.DIRECT)
    assert client == 0
    try:
        p.setAdditionalSearchPath(DATA)
        p.setGravity(*gravity_m_s2)
        if floor:
            p.loadURDF("plane.urdf")
        yield client
    finally:
        p.disconnect(client)


JOINTS: dict[int, Joint] = {0: "revolute", 1: "prismatic", 2: "spherical", 4: "fixed"}
"""Joint types by `getJointInfo`'s jointType; planar joints (3) are not covered."""


def load(file: str, *, at: Sequence[float] = (0, 0, 0), fixed: bool = False, **how: Any) -> int:
    """Load the body with the most joints from a file in any format that PyBullet reads."""
    if file.endswith(".urdf"):
        return int(p.loadURDF(file, at, useFixedBase=fixed, **how))
    bodies = (p.loadMJCF if file.endswith(".xml") else p.loadSDF)(file)
    body = max(bodies, key=p.getNumJoints)
    position, orientation = p.getBasePositionAndOrientation(body)
    p.resetBasePositionAndOrientation(body, np.add(position, at), orientation)
    return int(body)


def is_fixed(body: int) -> bool:
    """Whether a body's base is fixed: PyBullet reports its mass as 0."""
    return bool(p.getDynamicsInfo(body, -1)[0] == 0)


def described(body: int, **damping: float) -> DampedTree:
    """Return a body's description from PyBullet's reports."""
    joints = [p.getJointInfo(body, joint) for joint in range(p.getNumJoints(body))]
    dynamics = [p.getDynamicsInfo(body, link) for link in range(-1, len(joints))]
    return replace(tree_of(joints, dynamics, fixed=is_fixed(body)), **damping)


def tree_of(
    joints: Sequence[Sequence[Any]], dynamics: Sequence[Sequence[Any]], *, fixed: bool
) -> DampedTree:
    """Return a kinematic tree from `getJointInfo` and `getDynamicsInfo` of base and links.

    With the joint damping and limits that `getJointInfo` reports, which `changeDynamics` does not
    change there.

    Raises
    ------
    KeyError
        If a joint is of a kind that is not covered: planar.
    """
    kinds = tuple(JOINTS[info[2]] for info in joints)
    links = len(kinds)
    frames = rotation(np.array([info[4] for info in dynamics[1:]]).reshape(links, 4).T)
    centres = np.array([info[3] for info in dynamics[1:]]).reshape(links, 3)
    turned = np.array([info[15] for info in joints]).reshape(links, 4) * [-1, -1, -1, 1]
    tree = Tree(
        fixed=fixed,
        masses_kg=np.array([info[0] for info in dynamics], np.float64),
        inertias_kg_m2=np.array([info[2] for info in dynamics], np.float64),
        parents=tuple(info[16] for info in joints),
        joints=kinds,
        axes=np.array([info[13] for info in joints], np.float64).reshape(links, 3),
        positions_m=np.array([info[14] for info in joints], np.float64).reshape(links, 3),
        orientations=turned,
        centres_m=np.einsum("jin,nj->ni", frames, centres),
    )
    counts = [rate.stop - rate.start for rate in tree.rates]
    damped, lower, upper = (
        np.repeat(np.array([info[k] for info in joints], np.float64), counts) for k in (6, 8, 9)
    )
    return DampedTree(
        tree=tree,
        joint_damping=damped,
        lower=lower,
        upper=upper,
        linear_damping=bullet_tree.DAMPING,
        angular_damping=bullet_tree.DAMPING,
        velocity_limit=MAX_COORDINATE_VELOCITY_M_S,
    )


def joints_of(body: int, *kinds: int) -> list[int]:
    """Return the joints of the given types; all movable joints if none is given."""
    wanted = kinds or tuple(MOVES)
    return [j for j in range(p.getNumJoints(body)) if p.getJointInfo(body, j)[2] in wanted]


def motors_off(body: int) -> None:
    """Turn off PyBullet's default motors on every joint."""
    for joint in joints_of(body, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0)
    for joint in joints_of(body, p.JOINT_SPHERICAL):
        p.setJointMotorControlMultiDof(
            body,
            joint,
            p.POSITION_CONTROL,
            targetPosition=[0, 0, 0, 1],
            positionGain=0,
            velocityGain=0,
            force=[0, 0, 0],
        )


@dataclass
class Watched:
    """A body whose states, contacts and calls are logged, step by step."""

    body: int
    law: DampedTree
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    motors: list[list[float]] = field(default_factory=list)
    commanded: list[tuple[int, int, float]] = field(default_factory=list)
    pd: list[tuple[float, ...]] = field(default_factory=list)
    """Step, joint, gains, target and its velocity, limit, and the joint's state at the command."""
    contacts: list[tuple[Any, ...]] = field(default_factory=list)
    pushed: list[tuple[Any, ...]] = field(default_factory=list)
    timesteps: list[float] = field(default_factory=list)
    gravity: list[tuple[float, ...]] = field(default_factory=list)
    coefficients: dict[tuple[int, int], bool] = field(default_factory=dict)
    fresh: bool = True
    """Whether forward kinematics was requested since the last step."""

    def __post_init__(self) -> None:
        self.look()

    @property
    def step(self) -> int:
        """The number of the next step."""
        return len(self.rows) - 1

    def look(self) -> None:
        """Log PyBullet's current state."""
        tree, positions, rates, efforts = self.law.tree, [], [], []
        for joint, kind in enumerate(tree.joints):
            if kind == "spherical":
                q, u, _, effort = p.getJointStateMultiDof(self.body, joint)
                positions += q
                rates += u
                efforts += effort
            elif kind != "fixed":
                q, u, _, effort = p.getJointState(self.body, joint)
                positions.append(q)
                rates.append(u)
                efforts.append(effort)
        velocity, spin = p.getBaseVelocity(self.body)
        base = [] if tree.fixed else [*spin, *velocity]
        pose = p.getBasePositionAndOrientation(self.body)
        self.rows.append((*pose, positions, base + rates))
        self.motors.append(efforts)

    def stepped(self) -> None:
        """Log PyBullet's reports after a step."""
        step = self.step
        settings = p.getPhysicsEngineParameters()
        self.timesteps.append(settings["fixedTimeStep"])
        self.gravity.append(tuple(settings[f"gravityAcceleration{axis}"] for axis in "XYZ"))
        for point in p.getContactPoints():
            rolls = any(map(self.rolls, point[1:3], point[3:5]))
            sides = ((point[1], point[3], point[5]), (point[2], point[4], point[6]))
            for side, (body, link, at) in enumerate(sides):
                if body == self.body:
                    frictions = (point[10], point[12]), (point[11], point[13])
                    about = (at, point[7], point[9], *frictions, rolls)
                    self.contacts.append((step, link, side == 0, *about))
        self.look()
        self.fresh = False

    def rolls(self, body: int, link: int) -> bool:
        """Whether a link has a coefficient of rolling or spinning friction."""
        if (body, link) not in self.coefficients:
            self.coefficients[body, link] = any(p.getDynamicsInfo(body, link)[6:8])
        return self.coefficients[body, link]

    def push(
        self,
        link: int,
        force: Sequence[float],
        at: Sequence[float],
        frame: int,
        *,
        torque: bool = False,
    ) -> None:
        """Apply an external force or torque, and log it."""
        if torque:
            p.applyExternalTorque(self.body, link, force, frame)
        else:
            p.applyExternalForce(self.body, link, force, at, frame)
        self.pushed.append((self.step, link, force, at, frame, torque, self.fresh))

    def torque(self, joint: int, effort: float) -> None:
        """Command a torque for one step."""
        p.setJointMotorControl2(self.body, joint, p.TORQUE_CONTROL, force=effort)
        self.commanded.append((self.step, joint, effort))

    def steer(
        self,
        joint: int,
        *,
        target: float,
        target_velocity: float,
        kp: float,
        kd: float,
        limit: float,
    ) -> None:
        """Command PD_CONTROL, and log the values that determine its torque in the next step."""
        p.setJointMotorControl2(
            self.body,
            joint,
            p.PD_CONTROL,
            targetPosition=target,
            targetVelocity=target_velocity,
            positionGain=kp,
            velocityGain=kd,
            force=limit,
        )
        state = p.getJointState(self.body, joint)[:2]
        self.pd.append((self.step, joint, kp, kd, target, target_velocity, limit, *state))

    # -- as the law takes it ----------------------------------------------------------------------

    def states(self, rows: slice = slice(None)) -> States:
        """Return the logged states, all or a slice."""
        x, o, q, u = (np.array([row[k] for row in self.rows[rows]], float) for k in range(4))
        count = len(self.rows[rows])
        return States(x, o, q.reshape(count, -1), u.reshape(count, -1))

    def where(self, link: int) -> np.ndarray:
        """Return the position of a link's centre of mass, computed without PyBullet."""
        return kinematics(self.law.tree, self.states(slice(-1, None))).position_m(link)[-1]

    def kinematics(self) -> Kinematics:
        """Return the poses of all links in all states."""
        return kinematics(self.law.tree, self.states())

    def reported(self, **more: Any) -> Reported:
        """Return the reported data of the steps."""
        n, tree = len(self.timesteps), self.law.tree
        commanded = np.array(self.commanded, float).reshape(-1, 3)
        pd = np.array(self.pd, float).reshape(-1, 9)
        given: dict[str, Any] = {
            "timestep_s": np.array(self.timesteps),
            "gravity_m_s2": np.array(self.gravity),
            "motors": np.array(self.motors[1:]).reshape(n, tree.joint_rates),
            "commanded": self._efforts(*commanded.T),
            "pd": self._efforts(
                *pd.T[:2],
                pd_effort(
                    gains=pd.T[2:4],
                    target=pd.T[4],
                    target_velocity=pd.T[5],
                    limit=pd.T[6],
                    position=pd.T[7],
                    velocity=pd.T[8],
                ),
            ),
            "applied": self._applied(),
            "contacts": self._contacts(),
        }
        return Reported(**{**given, **more})

    def _efforts(self, step: np.ndarray, joint: np.ndarray, effort: np.ndarray) -> np.ndarray:
        tree = self.law.tree
        efforts = np.zeros((len(self.timesteps), tree.joint_rates))
        places = [tree.rates[int(one)].start - tree.first_rate for one in joint]
        np.add.at(efforts, (step.astype(int), np.array(places, int)), effort)
        return efforts

    def _contacts(self) -> Forces:
        if not self.contacts:
            return Forces()
        step, link, is_a, at, normal, force, friction, directions, rolls = map(
            np.array, zip(*self.contacts, strict=True)
        )
        return on_links.contact_forces(
            step=step,
            link=link,
            is_a=is_a,
            point_m=at,
            force_n=on_links.points_force_n(normal, force, friction, directions.swapaxes(0, 1)),
            rolling=rolls,
        )

    def _applied(self) -> Forces:
        if not self.pushed:
            return Forces()
        step, link, vector, at, frame, torque, fresh = map(np.array, zip(*self.pushed, strict=True))
        at = np.where(torque[:, None], 0.0, at.astype(float))
        local = frame == p.LINK_FRAME
        pose = np.where(fresh | (link == BASE), step, np.maximum(step - 1, 0))
        kin = self.kinematics()
        for one in np.flatnonzero(torque & ~local):  # at the centre, so that it has no moment
            at[one] = kin.position_m(int(link[one]))[pose[one]]
        return on_links.pushes(
            kin,
            step=step,
            link=link,
            force_n=np.where(torque[:, None], 0.0, vector),
            point_m=at,
            torque_n_m=np.where(torque[:, None], vector, 0.0),
            in_link_frame=local,
            pose=pose,
        )

    def sum(self, **more: Any) -> Sum:
        """Return the steps as a sum of impulses."""
        return bullet_tree.sum_of(self.law, self.states(), self.reported(**more))


def run(
    watched: Sequence[Watched], steps: int, act: Callable[[int], None] = lambda _: None
) -> None:
    """Make steps, and call `act` before each."""
    for step in range(steps):
        act(step)
        p.stepSimulation()
        for one in watched:
            one.stepped()
