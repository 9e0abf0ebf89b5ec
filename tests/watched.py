"""Throw bodies in PyBullet directly, and log states and contact points, with none of our code.

`random_throw` draws what hurts: offset centres, rods, heaps of shapes, fast spins, both modes.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
from engine import DATA, MODES

BODIES: dict[str, tuple[str, str]] = {
    "box": ('<box size="0.1 0.2 0.3"/>', "0 0 0"),
    "sphere": ('<sphere radius="0.05"/>', "0 0 0"),
    "rod": ('<cylinder radius="0.02" length="0.4"/>', "0 0 0"),
    "capsule": ('<capsule radius="0.03" length="0.2"/>', "0 0 0"),
    "offset": ('<box size="0.1 0.2 0.3"/>', "0.02 0.03 -0.05"),
    "compound": ("", "0 0 0"),
}
INERTIA = (0.004, 0.005, 0.006)


@dataclass(frozen=True)
class Watched:
    """PyBullet's reports of a body before each step, and of the preceding step's contacts."""

    position_m: np.ndarray
    orientation: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray
    points: list[tuple[int, Any]]
    """Sample, and a contact point of the step that led to it, as `getContactPoints` reports it."""
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    how: dict[str, Any]
    body: int
    """The body's id; the floor has the other one, 0 or 1."""


def random_throw(rng: random.Random, folder: Path, **fixed: Any) -> Watched:
    """Return the log of a random body thrown at random."""
    how: dict[str, Any] = {
        "body": rng.choice(list(BODIES)),
        "coordinates": rng.choice(MODES),
        "timestep_s": rng.choice((1 / 60, 1 / 240, 1 / 240, 1 / 1000)),
        "restitution": rng.choice((0.0, 0.5, 0.8, 1.0)),
        "height_m": rng.uniform(0.45, 0.8),
        "orientation": _orientation(rng),
        "velocity_m_s": [rng.choice((0.0, 1.0)) * rng.uniform(-5, 5) for _ in range(3)],
        "spin_rad_s": [rng.choice((0.0, 1.0)) * rng.uniform(-20, 20) for _ in range(3)],
        "gravity_m_s2": rng.choice((-9.81, -9.81, -1.62, 0.0, 3.0)),
        "linear_damping": rng.choice((None, None, 0.0, 0.5)),
        "angular_damping": rng.choice((None, None, 0.0, 0.5)),
        "floor_first": rng.random() < 0.5,
    }
    return thrown(folder, **(how | fixed))


def _orientation(rng: random.Random) -> list[float]:
    if rng.random() < 0.25:
        return [0.0, 0.0, 0.0, 1.0]
    q = np.array([rng.gauss(0, 1) for _ in range(4)])
    return [float(each) for each in q / np.linalg.norm(q)]


def thrown(
    folder: Path,
    *,
    samples: int = 250,
    body: str = "box",
    coordinates: Any = "reduced",
    timestep_s: float = 1 / 240,
    substeps: int = 0,
    restitution: float = 0.8,
    height_m: float = 0.5,
    orientation: Any = (0.0, 0.0, 0.0, 1.0),
    velocity_m_s: Any = (0.0, 0.0, 0.0),
    spin_rad_s: Any = (0.0, 0.0, 0.0),
    gravity_m_s2: float = -9.81,
    linear_damping: float | None = None,
    angular_damping: float | None = None,
    rolling_friction: float = 0.0,
    residual: float | None = None,
    floor_first: bool = True,
    before_step: Callable[[int, int, int], None] = lambda *_: None,
) -> Watched:
    """Return the log of a thrown body; `before_step` is called with client, body and step."""
    told = {name: value for name, value in locals().items() if name != "folder"}
    client = p.connect(p.DIRECT)
    try:
        p.setTimeStep(timestep_s, physicsClientId=client)
        settings = {"numSubSteps": substeps, "solverResidualThreshold": residual}
        for name, value in settings.items():
            if value is not None:
                p.setPhysicsEngineParameter(**{name: value}, physicsClientId=client)
        p.setGravity(0, 0, gravity_m_s2, physicsClientId=client)
        if floor_first:
            p.loadURDF(str(DATA / "plane.urdf"), physicsClientId=client)
        maximal = coordinates == "maximal"
        one = p.loadURDF(_urdf(folder, body), useMaximalCoordinates=maximal, physicsClientId=client)
        if not floor_first:
            p.loadURDF(str(DATA / "plane.urdf"), physicsClientId=client)
        for each in (0, 1):
            p.changeDynamics(each, -1, restitution=restitution, physicsClientId=client)
        damping = {"linearDamping": linear_damping, "angularDamping": angular_damping}
        damping["rollingFriction"] = rolling_friction or None
        p.changeDynamics(
            one,
            -1,
            physicsClientId=client,
            **{name: value for name, value in damping.items() if value is not None},
        )
        p.resetBasePositionAndOrientation(
            one, (0, 0, height_m), orientation, physicsClientId=client
        )
        p.resetBaseVelocity(one, velocity_m_s, spin_rad_s, physicsClientId=client)
        rows, points = [], []
        for step in range(samples):
            if step:
                before_step(client, one, step)
                p.stepSimulation(physicsClientId=client)
                found = p.getContactPoints(physicsClientId=client)
                points += [(step, point) for point in found]
            place = p.getBasePositionAndOrientation(one, physicsClientId=client)
            rows.append(
                (
                    *place[0],
                    *place[1],
                    *(
                        each
                        for part in p.getBaseVelocity(one, physicsClientId=client)
                        for each in part
                    ),
                )
            )
        parts = np.split(np.array(rows), (3, 7, 10), axis=1)
        # A btRigidBody keeps inverses of mass and inertia, and reports those of them.
        twin = p.loadURDF(_urdf(folder, body), physicsClientId=client)
        mass_kg, _, inertia, *_ = p.getDynamicsInfo(twin, -1, physicsClientId=client)
        return Watched(*parts, points, mass_kg, inertia, told, one)
    finally:
        p.disconnect(client)


def _urdf(folder: Path, name: str) -> str:
    path = folder / f"{name}.urdf"
    geometry, centre = BODIES[name]
    shapes = [(geometry, "0 0 0")]
    if name == "compound":
        shapes = [('<box size="0.1 0.1 0.1"/>', "0.05 0 0"), (BODIES["sphere"][0], "-0.1 0 0")]
    x, y, z = INERTIA
    collisions = "".join(
        f'<collision><origin xyz="{at}"/><geometry>{one}</geometry></collision>'
        for one, at in shapes
    )
    path.write_text(
        f'<robot name="{name}"><link name="base"><inertial><origin xyz="{centre}" '
        f'rpy="0.1 0.2 0.3"/><mass value="0.7"/><inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" '
        f'ixz="0" iyz="0"/></inertial>{collisions}</link></robot>'
    )
    return str(path)
