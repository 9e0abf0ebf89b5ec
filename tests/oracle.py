"""The correct results for a drop, computed with PyBullet alone: imports nothing of `drop_physics`.

A drop is plain values. It is replayed in a client of its own, and what is true of it is read off
the replay, step by step: contact points, poses, velocities of all links. A cause is confirmed by a
second replay in which only that cause is changed: no floor, no damping, a solver that converges.
"""

from __future__ import annotations

import functools
import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal, localcontext
from pathlib import Path
from typing import Any, Self

import numpy as np
import pybullet as p
import pybullet_data
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Float64 = NDArray[np.float64]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

AS_LOADED: Quaternion = (0.0, 0.0, 0.0, 1.0)
DEFAULT_DAMPING = float(np.float32(0.04))
"""Linear and angular damping of a btMultiBody; a btRigidBody has none."""
CONVERGED = 300
"""Iterations after which a contact solver without early stopping has converged."""
CLAMP = 100.0
"""Limit to which a btMultiBody clamps each velocity component [m/s or rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Drop:
    """Body and settings of a drop, in SI units; None keeps the engine's default."""

    body: str
    height_m: float = 1.0
    timestep_s: float = 1 / 240
    steps: int = 240
    gravity_m_s2: float | None = -9.81
    """z component; None if gravity is never set."""
    orientation: Quaternion = AS_LOADED
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    spin_rad_s: Vector = (0.0, 0.0, 0.0)
    linear_damping: float | None = None
    angular_damping: float | None = None
    mass_kg: float | None = None
    restitution: float | None = None
    friction: float | None = None
    restitution_threshold_m_s: float | None = None
    contact_erp: float | None = None
    contact_slop_m: float | None = None
    solver_residual: float | None = None
    solver_iterations: int | None = None
    substeps: int | None = None
    maximal: bool = False
    stepped: bool = True
    floor: bool = True

    @property
    def gravity(self) -> float:
        """The effective z component [m/s²]."""
        return self.gravity_m_s2 or 0.0

    @property
    def step_s(self) -> float:
        """The timestep of the engine's integration [s]."""
        return self.timestep_s / max(1, self.substeps or 1)

    @property
    def damping(self) -> float:
        """The effective coefficient of linear damping."""
        if self.linear_damping is None:
            return 0.0 if self.maximal else DEFAULT_DAMPING
        return self.linear_damping


@dataclass(frozen=True)
class Touch:
    """A contact point between body and floor, as reported by the step that led to a sample."""

    link: int
    distance_m: float
    force_n: float


@dataclass(frozen=True)
class Replay:
    """The state before each step and after the last; arrays of shape (samples, ...), world axes."""

    position_m: Float64
    orientation: Float64
    velocity_m_s: Float64
    spin_rad_s: Float64
    touches: list[list[Touch]]
    links: Float64
    """Pose and velocities of each link's centre of mass, the base first: (samples, links, 13)."""
    mass_kg: Float64
    """Mass of each link; nan if PyBullet does not report the links' motion."""
    inertia_kg_m2: Float64
    """Principal moments of inertia of each link, shape (links, 3)."""
    gravity_m_s2: float

    @property
    def height_m(self) -> Float64:
        """Height of the base's centre of mass [m]."""
        return self.position_m[:, 2]

    @functools.cached_property
    def kinetic_linear_j(self) -> Float64:
        """Kinetic energy of all links [J], shape (samples,)."""
        return np.asarray((self.links[:, :, 7:10] ** 2).sum(axis=2) @ self.mass_kg / 2)

    @functools.cached_property
    def kinetic_angular_j(self) -> Float64:
        """Rotational energy of all links about their own centres of mass [J], shape (samples,)."""
        spin, moment = self._spins()
        return np.asarray((spin * moment).sum(axis=(1, 2)) / 2)

    @functools.cached_property
    def potential_j(self) -> Float64:
        """Potential energy of all links [J], 0 with the centre of mass at the floor's height."""
        return np.asarray(-self.gravity_m_s2 * (self.links[:, :, 2] @ self.mass_kg))

    @functools.cached_property
    def energy_j(self) -> Float64:
        """Total mechanical energy of all links [J]."""
        return self.kinetic_linear_j + self.kinetic_angular_j + self.potential_j

    @functools.cached_property
    def momentum_kg_m_s(self) -> Float64:
        """Total linear momentum of all links, shape (samples, 3)."""
        return np.asarray(np.einsum("l,nlk->nk", self.mass_kg, self.links[:, :, 7:10]))

    @functools.cached_property
    def angular_momentum_kg_m2_s(self) -> Float64:
        """Angular momentum of all links about their common centre of mass, shape (samples, 3)."""
        total, (_, moment) = self.mass_kg.sum(), self._spins()
        centre = np.einsum("l,nlk->nk", self.mass_kg, self.links[:, :, :3]) / total
        arm = self.links[:, :, :3] - centre[:, None]
        drift = self.links[:, :, 7:10] - (self.momentum_kg_m_s / total)[:, None]
        orbital = np.einsum("l,nlk->nk", self.mass_kg, np.cross(arm, drift))
        axes = matrices(self.links[:, :, 3:7])
        return np.asarray(orbital + np.einsum("nlij,nlj->ni", axes, moment))

    def _spins(self) -> tuple[Float64, Float64]:
        """Return each link's angular velocity and momentum in its own axes, (samples, links, 3)."""
        axes = matrices(self.links[:, :, 3:7])
        spin = np.einsum("nlji,nlj->nli", axes, self.links[:, :, 10:])
        known = np.where(np.isnan(self.mass_kg)[:, None], math.nan, self.inertia_kg_m2)
        return spin, spin * known

    @property
    def state(self) -> Float64:
        """Pose and velocities of the base, shape (samples, 13)."""
        return np.hstack((self.position_m, self.orientation, self.velocity_m_s, self.spin_rad_s))

    @property
    def reported(self) -> NDArray[np.bool_]:
        """Whether any contact point was reported, shape (samples,)."""
        return np.array([bool(points) for points in self.touches])


class Client:
    """A PyBullet client with a drop's body and floor; use it in a `with` statement."""

    def __init__(self, drop: Drop) -> None:
        self.drop = drop
        self.id = p.connect(p.DIRECT)
        self.close = weakref.finalize(self, p.disconnect, self.id)
        try:
            p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=self.id)
            self.body = self._load(drop.body, useMaximalCoordinates=drop.maximal)
            self.joints = p.getNumJoints(self.body, physicsClientId=self.id)
            self._set_dynamics()
            self.floor = self._load("plane.urdf") if drop.floor else None
            self._configure()
            self.place(drop.height_m, drop.orientation)
            p.resetBaseVelocity(
                self.body, drop.velocity_m_s, drop.spin_rad_s, physicsClientId=self.id
            )
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _load(self, urdf: str, **how: Any) -> int:
        return int(p.loadURDF(urdf, physicsClientId=self.id, **how))

    def change(self, body: int, link: int, **what: float | Vector | None) -> None:
        """Call changeDynamics with the arguments that are not None."""
        chosen = {name: value for name, value in what.items() if value is not None}
        if chosen:
            p.changeDynamics(body, link, physicsClientId=self.id, **chosen)

    def dynamics(self, link: int = -1) -> Any:
        """Return getDynamicsInfo for a link of the body; -1 is the base."""
        return p.getDynamicsInfo(self.body, link, physicsClientId=self.id)

    def _set_dynamics(self) -> None:
        drop = self.drop
        if drop.mass_kg is not None:
            mass, inertia = _urdf_mass(drop.body)
            scale = drop.mass_kg / mass  # another density: the inertia goes with the mass
            moments = (inertia[0] * scale, inertia[1] * scale, inertia[2] * scale)
            self.change(self.body, -1, mass=drop.mass_kg, localInertiaDiagonal=moments)
        self.change(
            self.body, -1, linearDamping=drop.linear_damping, angularDamping=drop.angular_damping
        )

    def _configure(self) -> None:
        drop = self.drop
        p.setTimeStep(drop.timestep_s, physicsClientId=self.id)
        if drop.gravity_m_s2 is not None:
            p.setGravity(0.0, 0.0, drop.gravity_m_s2, physicsClientId=self.id)
        settings = {
            "contactERP": drop.contact_erp,
            "contactSlop": drop.contact_slop_m,
            "solverResidualThreshold": drop.solver_residual,
            "numSolverIterations": drop.solver_iterations,
            "restitutionVelocityThreshold": drop.restitution_threshold_m_s,
            "numSubSteps": drop.substeps or 0,
        }
        chosen = {name: value for name, value in settings.items() if value is not None}
        p.setPhysicsEngineParameter(physicsClientId=self.id, **chosen)
        for body in (self.body, self.floor):
            if body is not None:
                links = range(-1, self.joints if body == self.body else 0)
                for link in links:
                    self.change(
                        body, link, restitution=drop.restitution, lateralFriction=drop.friction
                    )

    def place(self, height_m: float, orientation: Sequence[float]) -> None:
        """Place the body's centre at a height above the origin."""
        p.resetBasePositionAndOrientation(
            self.body, (0.0, 0.0, height_m), orientation, physicsClientId=self.id
        )

    def touches(self) -> list[Touch]:
        """Return the contact points that the last collision detection found."""
        if self.floor is None:
            return []
        points = p.getContactPoints(self.body, self.floor, physicsClientId=self.id)
        return [Touch(one[3], one[8], one[9]) for one in points]

    def box_m(self) -> Float64:
        """Return the corners of the bounding box of all links [m], shape (2, 3)."""
        boxes = np.array(
            [
                p.getAABB(self.body, link, physicsClientId=self.id)
                for link in range(-1, self.joints)
                if self.drop.maximal or p.getCollisionShapeData(self.body, link, self.id)
            ]
        )
        return np.array((boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)))

    def links(self) -> list[tuple[float, ...]]:
        """Return the current pose and velocities of each link's centre of mass, the base first."""
        position, orientation = p.getBasePositionAndOrientation(self.body, physicsClientId=self.id)
        velocity, spin = p.getBaseVelocity(self.body, physicsClientId=self.id)
        found = [(*position, *orientation, *velocity, *spin)]
        if self.joints:
            states = p.getLinkStates(
                self.body,
                range(self.joints),
                computeLinkVelocity=1,
                computeForwardKinematics=1,
                physicsClientId=self.id,
            )
            found += [(*one[0], *one[1], *one[6], *one[7]) for one in states]
        return found


@functools.lru_cache(maxsize=4096)
def _urdf_mass(body: str) -> tuple[float, Vector]:
    """Return mass and moments of inertia of the base as given in the URDF."""
    with Client(Drop(body=body)) as client:
        mass, _, inertia = client.dynamics()[:3]
        return mass, inertia


@dataclass(frozen=True)
class BodyFacts:
    """PyBullet's information about a loaded body; links and shapes are those of a btMultiBody."""

    joints: int
    total_mass_kg: float
    mass_kg: tuple[float, ...]
    inertia_kg_m2: tuple[Vector, ...]
    restitution: float
    floor_restitution: float
    friction: tuple[float, float, float]
    floor_friction: float
    shapes: tuple[tuple[int, Vector], ...]
    """Shapes of all links, the base first: PyBullet's shape type and dimensions."""
    name: str
    margin_m: float

    @property
    def has_shape(self) -> bool:
        """Whether any link has a collision shape."""
        return bool(self.shapes)

    @property
    def is_rigid(self) -> bool:
        """Whether the body is a single rigid body without joints."""
        return self.joints == 0

    @property
    def pair_restitution(self) -> float:
        """Combined restitution of base and floor."""
        return self.restitution * self.floor_restitution


@functools.lru_cache(maxsize=4096)
def facts_of(drop: Drop) -> BodyFacts:
    """Return PyBullet's information about the drop's body."""
    with Client(replace(drop, maximal=False, floor=True)) as client:
        links = range(-1, client.joints)
        told = [client.dynamics(link) for link in links]
        shapes = [p.getCollisionShapeData(client.body, link, client.id) for link in links]
        floor = p.getDynamicsInfo(client.floor, -1, client.id)
        return BodyFacts(
            joints=client.joints,
            total_mass_kg=math.fsum(one[0] for one in told),
            mass_kg=tuple(one[0] for one in told),
            inertia_kg_m2=tuple(one[2] for one in told),
            restitution=told[0][5],
            floor_restitution=floor[5],
            friction=(told[0][1], told[0][6], told[0][7]),
            floor_friction=floor[1],
            shapes=tuple((one[2], one[3]) for shape in shapes for one in shape),
            name=p.getBodyInfo(client.body, client.id)[1].decode(),
            margin_m=told[0][11],
        )


@functools.lru_cache(maxsize=64)
def replay(drop: Drop, start: tuple[float, ...] | None = None) -> Replay:
    """Simulate the drop again; `start` is an initial base state that replaces the release."""
    facts = facts_of(body_only(drop))
    seen = not drop.maximal or facts.is_rigid  # PyBullet hides the links of btRigidBodies
    links, touches = [], []
    with Client(drop) as client:
        if start is not None:
            # A btRigidBody keeps the inertia it was loaded with until its first step.
            p.resetBasePositionAndOrientation(client.body, (0, 0, 1e6), start[3:7], client.id)
            p.stepSimulation(physicsClientId=client.id)
            p.resetBasePositionAndOrientation(client.body, start[:3], start[3:7], client.id)
            p.resetBaseVelocity(client.body, start[7:10], start[10:], physicsClientId=client.id)
        told = [client.dynamics(link) for link in range(-1, client.joints)]
        for step in range(drop.steps + 1):
            if step and drop.stepped:
                p.stepSimulation(physicsClientId=client.id)
            links.append(client.links())
            touches.append(client.touches())
    rows = np.array(links)
    position, orientation, velocity, spin = np.split(rows[:, 0], (3, 7, 10), axis=1)
    mass = np.array([one[0] if seen else math.nan for one in told])
    inertia = np.array([one[2] for one in told])
    return Replay(position, orientation, velocity, spin, touches, rows, mass, inertia, drop.gravity)


def matrices(orientation: Float64) -> Float64:
    """Return the rotation matrices of quaternions x, y, z, w; shapes (…, 4) and (…, 3, 3)."""
    x, y, z, w = np.moveaxis(orientation, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def body_only(drop: Drop) -> Drop:
    """Return a drop with only the settings that define its body, as a cache key."""
    return Drop(
        body=drop.body,
        mass_kg=drop.mass_kg,
        restitution=drop.restitution,
        friction=drop.friction,
        maximal=drop.maximal,
    )


# -- where the floor is ----------------------------------------------------------------------------


def touching_height(drop: Drop, orientation: Sequence[float]) -> float | None:
    """Return the centre's height at which the body in this orientation just touches the floor [m].

    Bisection with the engine's own collision detection; links stand as they were loaded. None
    where it never touches.
    """
    body = body_only(drop)
    if not facts_of(body).is_rigid:  # the links of btRigidBodies stay behind when it is placed
        body = replace(body, maximal=False)
    return _touching_height(body, tuple(map(float, orientation)))


@functools.lru_cache(maxsize=4096)
def _touching_height(drop: Drop, orientation: Quaternion) -> float | None:
    if not facts_of(drop).has_shape:
        return None
    client = scratch(drop)
    client.place(0.0, orientation)
    lowest, highest = client.box_m()[:, 2]

    def deep(height_m: float) -> bool:
        client.place(height_m, orientation)
        p.performCollisionDetection(physicsClientId=client.id)
        return min((one.distance_m for one in client.touches()), default=1.0) <= 0

    low, high = -float(highest), -float(lowest) + 1e-3
    if deep(high):
        return None
    while not deep(low):  # a margin reaches further than what touches
        low += (high - low) / 8
        if high - low < 1e-9:
            return None
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if deep(middle) else (low, middle)
    return high


@functools.lru_cache(maxsize=2)
def scratch(drop: Drop) -> Client:
    """Return a cached client for collision queries at arbitrary poses."""
    return Client(drop)


def extent_m(drop: Drop, orientation: Sequence[float]) -> Float64:
    """Return the edges of the body's bounding box in an orientation [m], margins included."""
    client = scratch(body_only(drop))
    client.place(0.0, orientation)
    low, high = client.box_m()
    return np.asarray(high - low)


def reach_m(drop: Drop) -> float:
    """Return the largest distance between the body's surface and its centre of mass [m]."""
    client = scratch(body_only(drop))
    client.place(0.0, AS_LOADED)
    return float(np.linalg.norm(np.abs(client.box_m()).max(axis=0)))


def shape_pose(drop: Drop) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return position [m] and quaternion of the base's first shape, in body axes."""
    client = scratch(body_only(replace(drop, maximal=False)))
    shape = p.getCollisionShapeData(client.body, -1, client.id)[0]
    return tuple(shape[5]), tuple(shape[6])


def depth_m(drop: Drop, height_m: float, orientation: Sequence[float]) -> float | None:
    """Return how deep the lowest point of a jointless body is in the floor [m]."""
    touching = touching_height(drop, orientation)
    return None if touching is None else touching - height_m


def turn_rad(a: Sequence[float] | Float64, b: Sequence[float] | Float64) -> float:
    """Return the angle between two orientations [rad]."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    vector = (
        aw * bx - bw * ax + (ay * bz - az * by),
        aw * by - bw * ay + (az * bx - ax * bz),
        aw * bz - bw * az + (ax * by - ay * bx),
    )
    return 2 * math.atan2(math.hypot(*vector), abs(ax * bx + ay * by + az * bz + aw * bw))


@functools.lru_cache(maxsize=4096)
def _is_ball(drop: Drop) -> bool:
    """Return whether a body is a ball: it touches the floor at one height in any orientation."""
    turns = np.random.default_rng(0).normal(size=(6, 4))
    heights = [touching_height(drop, turn / np.linalg.norm(turn)) for turn in turns]
    known = [one for one in heights if one is not None]
    return len(known) == len(heights) and max(known) - min(known) < 1e-9


# -- a fall through the air ------------------------------------------------------------------------


def free_fall_m(drop: Drop, time_s: float) -> float:
    """Return the height in free fall, z0 + v0 t + g t²/2 [m]."""
    return drop.height_m + (drop.velocity_m_s[2] + drop.gravity * time_s / 2) * time_s


def damping_m(drop: Drop, time_s: float) -> Float64:
    """Return the drag's displacement from free fall at a time [m] (x, y, z), from its own ODE.

    What is integrated is the difference from free fall over the coefficient, which is no
    difference of large numbers.
    """
    if drop.damping == 0 or time_s == 0:
        return np.zeros(3)
    if drop.maximal and drop.damping == 1:  # it stops at once
        way = np.array(drop.velocity_m_s) * time_s
        way[2] = free_fall_m(drop, time_s) - drop.height_m
        return -way
    solution = _drag_ode(drop, time_s)
    return np.asarray(drop.damping * solution.y[:3, -1])


def _drag_ode(drop: Drop, time_s: float, event: Any = None) -> Any:
    k, v0 = drop.damping, np.array(drop.velocity_m_s)
    rate = -math.log1p(-k) / k if drop.maximal else 1.0

    def derivative(t: float, y: Float64) -> Float64:
        v = v0 + k * y[3:]
        v[2] += drop.gravity * t
        drag = -rate * v if drop.maximal else -v * (1 + math.sqrt(v @ v))
        return np.concatenate((y[3:], drag))

    return solve_ivp(
        derivative, (0.0, time_s), np.zeros(6), "DOP853", rtol=1e-12, atol=1e-20, events=event
    )


def falls_to_s(drop: Drop, floor_m: float, *, damped: bool, latest_s: float) -> float | None:
    """Return the time at which a fall without a floor first reaches a height [s]; None if later."""
    k = drop.damping if damped else 0.0
    if drop.height_m <= floor_m:
        return 0.0
    if k == 0:
        a, b, c = drop.gravity / 2, drop.velocity_m_s[2], drop.height_m - floor_m
        roots = np.roots((a, b, c) if a else (b, c)) if a or b else np.empty(0)
        later = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
        found = min(later, default=None)
        return found if found is not None and found <= latest_s else None
    if drop.maximal and k == 1:
        return None

    def gap(t: float, y: Float64) -> float:
        return free_fall_m(drop, t) + k * float(y[2]) - floor_m

    gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
    times = _drag_ode(drop, latest_s, gap).t_events[0]
    return float(times[0]) if len(times) else None


def exact_law_m(
    drop: Drop, steps: int, sideways_m: tuple[float, float] = (0.0, 0.0)
) -> tuple[list[tuple[Decimal, Decimal, Decimal]], bool]:
    """Return the discrete step's positions in 40-digit arithmetic, and whether a clamp acted.

    Semi-implicit Euler: v' = v + h (g - k v (1 + |v|)) of a btMultiBody, v' = v (1 - k)^h + h g of
    a btRigidBody, and x' = x + h v'. `steps` counts samples, of which each is of `substeps`.
    """
    h, k, g = Decimal(drop.step_s), Decimal(drop.damping), Decimal(drop.gravity)
    with localcontext(Context(prec=40)):
        kept = Decimal(math.pow(1.0 - drop.damping, drop.step_s))
        v = [Decimal(one) for one in drop.velocity_m_s]
        x = [Decimal(one) for one in (*sideways_m, drop.height_m)]
        clamped, limit = False, Decimal(CLAMP)
        none = Decimal(2.0**-52)  # `btVector3::safeNorm` takes a squared length up to this for none
        places = [(x[0], x[1], x[2])]
        for _ in range(steps):
            for _ in range(max(1, drop.substeps or 1)):
                if drop.maximal:
                    v = [one * kept for one in v]
                else:
                    squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
                    drag = k * (1 + (squared.sqrt() if squared > none else 0))
                    v = [one - h * drag * one for one in v]
                v[2] += h * g
                if not drop.maximal and max(map(abs, v)) > limit:
                    v, clamped = [max(-limit, min(limit, one)) for one in v], True
                x = [one + h * speed for one, speed in zip(x, v, strict=True)]
            places.append((x[0], x[1], x[2]))
        return places, clamped


# -- what is true of a drop ------------------------------------------------------------------------


@dataclass(frozen=True)
class Rebound:
    """A contact that the body left again into the air."""

    step: int
    """The last sample before the contact."""
    end: int
    """The first sample after the contact that does not touch."""
    until: int
    """The first sample of the next contact, or one past the end."""


class Truth:
    """The correct results for one drop, computed on demand."""

    def __init__(self, drop: Drop) -> None:
        self.drop = drop
        self.facts = facts_of(body_only(drop))
        self.run = replay(drop)
        self.release_height_m = touching_height(drop, drop.orientation)
        """Height at which the body touches the floor in its release orientation."""

    def again(self, **changed: Any) -> Replay:
        """Return a replay in which only the given settings are changed."""
        return replay(replace(self.drop, **changed))

    def converged(self, **changed: Any) -> Replay:
        """Return the replay with a contact solver that does not stop early."""
        return self.again(solver_residual=0.0, solver_iterations=CONVERGED, **changed)

    def from_sample(self, step: int, steps: int, **changed: Any) -> Replay:
        """Return a replay that starts with a recorded sample."""
        state = tuple(map(float, self.run.state[step]))
        return replay(replace(self.drop, steps=steps, **changed), state)

    @functools.cached_property
    def acted_step(self) -> int | None:
        """The first sample whose state differs from a replay without the floor."""
        seen = self.run.reported.any() or max(1, self.drop.substeps or 1) > 1
        if not (self.drop.floor and self.drop.stepped and seen):
            return None
        alone = self.again(floor=False)
        other = np.flatnonzero((alone.state != self.run.state).any(axis=1))
        return int(other[0]) if len(other) else None

    @functools.cached_property
    def pushed_steps(self) -> NDArray[np.int64]:
        """Samples whose step reports a contact point with a positive force."""
        return np.flatnonzero([any(one.force_n > 0 for one in touch) for touch in self.run.touches])

    @functools.cached_property
    def touching_steps(self) -> NDArray[np.int64]:
        """Samples whose step found a contact point that pushes, or has no gap to the floor."""
        return np.flatnonzero(
            [
                any(one.force_n > 0 or one.distance_m <= 0 for one in touch)
                for touch in self.run.touches
            ]
        )

    @functools.cached_property
    def touched_steps(self) -> NDArray[np.int64]:
        """`touching_steps`, and the floor's first acting step, which substeps may have hidden."""
        if self.acted_step is None or max(1, self.drop.substeps or 1) == 1:
            return self.touching_steps
        return np.unique(np.append(self.touching_steps, self.acted_step))

    @property
    def last(self) -> int:
        """Number of the last sample."""
        return self.drop.steps

    @functools.cached_property
    def clamped_steps(self) -> NDArray[np.int64]:
        """Samples whose step hit a btMultiBody's velocity limit."""
        if self.drop.maximal or not self.drop.stepped:
            return np.empty(0, np.int64)
        each, run = max(1, self.drop.substeps or 1), self.run
        if each > 1:  # the engine's own steps, of which a sample shows each last one only
            run = self.again(timestep_s=self.drop.step_s, steps=self.last * each, substeps=None)
        fast = np.abs(np.hstack((run.velocity_m_s, run.spin_rad_s)))[1:]
        return np.unique(np.flatnonzero((fast >= CLAMP).any(axis=1)) // each) + 1

    @functools.cached_property
    def is_ball(self) -> bool:
        """Whether the body touches the floor at the same height in any orientation."""
        return self.facts.is_rigid and self.facts.has_shape and _is_ball(body_only(self.drop))

    def tilted_rad(self, step: int) -> float:
        """Return the angle between world-up in body axes, at a sample, and at the release [rad]."""
        first, then = matrices(self.run.orientation[[0, step]])[:, 2]
        return 2 * math.asin(min(1.0, float(np.linalg.norm(first - then)) / 2))

    def lean_rad(self, step: int) -> float:
        """Return the angle between the vertical and the nearest axis of the body [rad]."""
        up = np.abs(matrices(self.run.orientation[step])[2])
        return math.atan2(float(np.linalg.norm(np.sort(up)[:2])), float(up.max()))

    def is_flat(self, step: int, within_rad: float) -> bool:
        """Return whether the body lies flat: a box on a face, other bodies as released."""
        if self.is_ball:
            return True
        is_box = self.facts.is_rigid and [kind for kind, _ in self.facts.shapes] == [p.GEOM_BOX]
        return (self.lean_rad(step) if is_box else self.tilted_rad(step)) <= within_rad

    def tumbles_at(self, within_rad: float) -> int:
        """Return the first touching sample that does not lie flat; one past the last if none."""
        steps = list(map(int, self.touching_steps))
        if steps and max(1, self.drop.substeps or 1) > 1:  # not every touch is reported
            steps = list(range(steps[0], self.last + 1))
        found = (one for one in steps if not self.is_flat(one, within_rad))
        return next(found, self.last + 1)

    def depth_m(self, step: int) -> float | None:
        """Return the depth of a sample's lowest point in the floor [m]; negative above it."""
        if not self.facts.is_rigid:
            return None
        return depth_m(self.drop, float(self.run.height_m[step]), self.run.orientation[step])

    def contact_after(self, step: int) -> Rebound | None:
        """Return the first contact after a sample if it ends in the air; None otherwise."""
        touched = set(map(int, self.touching_steps))
        if step in touched or step + 1 not in touched:
            return None
        end = next((one for one in range(step + 1, self.last + 1) if one not in touched), None)
        if end is None:
            return None
        until = next((one for one in range(end, self.last + 1) if one in touched), self.last + 1)
        return Rebound(step, end, until)

    @functools.cached_property
    def rebounds(self) -> list[Rebound]:
        """All contacts that begin in the air and end with an upward velocity, in order."""
        found = (self.contact_after(int(step) - 1) for step in self.touching_steps if step)
        up = self.run.velocity_m_s[:, 2]
        return [one for one in found if one is not None and up[one.end - 1] > 0]

    def apex_m(self, one: Rebound) -> float:
        """Return the centre's greatest height between a contact and the next one [m]."""
        return float(self.run.height_m[one.end - 1 : one.until].max())

    def stays(self, since: int, position_m: float, turn_by: float) -> bool:
        """Whether the pose stays within tolerances from a sample on, also for 20 further steps."""
        state = self.again(steps=self.last + 20).state
        end = state[self.last]
        moved = np.abs(state[since:, :3] - end[:3]).max()
        turned = max(turn_rad(end[3:7], one) for one in state[since:, 3:7])
        return bool(moved <= position_m and turned <= turn_by)


def data_path(name: str) -> Path:
    """Return the path of a file in pybullet_data."""
    return Path(pybullet_data.getDataPath()) / name
