"""Drive PyBullet directly, through none of our code: what the tests compare it with."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pybullet_data

ROUNDS_ONCE = platform.machine() in ("x86_64", "AMD64")
"""Whether each operation rounds once here; elsewhere a compiler may fuse multiply and add."""
MODES: tuple[Any, ...] = ("reduced", "maximal")
DATA = Path(pybullet_data.getDataPath())
AT_REST = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Driven:
    """What PyBullet says before each step; rows of shape (samples, ...)."""

    position_m: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray
    orientation_xyzw: np.ndarray
    mass_kg: float
    picture_hashes: dict[int, str] = field(default_factory=dict)
    """By step."""


def drive(
    *,
    timestep_s: float = 1 / 240,
    samples: int = 241,
    gravity_m_s2: float | None = -9.81,
    height_m: float = 1.0,
    velocity_m_s: tuple[float, float, float] = AT_REST,
    spin_rad_s: tuple[float, float, float] = AT_REST,
    floor: bool = True,
    coordinates: Any = "reduced",
    restitution: float | None = None,
    picture_every: int | None = None,
    dynamics: dict[str, Any] | None = None,
    engine: dict[str, Any] | None = None,
) -> Driven:
    """Drop cube_small.urdf; `dynamics` are told of the body, `engine` of the physics."""
    client = p.connect(p.DIRECT)
    maximal = coordinates == "maximal"
    try:
        p.setTimeStep(timestep_s, physicsClientId=client)
        p.setPhysicsEngineParameter(physicsClientId=client, **(engine or {}))
        # The floor in reduced coordinates, as `drop` and most scripts load it: the contact of a
        # btRigidBody with a btMultiBody is solved by the latter's solver.
        bodies = [
            p.loadURDF(
                str(DATA / name),
                [0, 0, z_m],
                useMaximalCoordinates=maximal and name != "plane.urdf",
                physicsClientId=client,
            )
            for name, z_m in (("plane.urdf", 0), ("cube_small.urdf", height_m))
            if floor or name != "plane.urdf"
        ]
        box = bodies[-1]
        if dynamics:
            p.changeDynamics(box, -1, physicsClientId=client, **dynamics)
        # After the mass: Bullet then weighs the body by 1 / (1 / mass), which is what it reports.
        if gravity_m_s2 is not None:
            p.setGravity(0, 0, gravity_m_s2, physicsClientId=client)
        if restitution is not None:
            for body in bodies:
                p.changeDynamics(body, -1, restitution=restitution, physicsClientId=client)
        p.resetBaseVelocity(box, velocity_m_s, spin_rad_s, physicsClientId=client)
        rows, hashes = [], {}
        for step in range(samples):
            if step:
                p.stepSimulation(physicsClientId=client)
            position, orientation = p.getBasePositionAndOrientation(box, physicsClientId=client)
            velocity, spin = p.getBaseVelocity(box, physicsClientId=client)
            rows.append((*position, *velocity, *spin, *orientation))
            if picture_every and step % picture_every == 0:
                hashes[step] = _picture_hash(client)
        parts = np.split(np.array(rows), (3, 6, 9), axis=1)
        mass_kg = p.getDynamicsInfo(box, -1, physicsClientId=client)[0]
        return Driven(*parts, mass_kg, hashes)
    finally:
        p.disconnect(client)


def _picture_hash(client: int) -> str:
    view = p.computeViewMatrixFromYawPitchRoll([0, 0, 0.5], 2.0, 45.0, -25.0, 0.0, 2)
    projection = p.computeProjectionMatrixFOV(60.0, 480 / 360, 0.1, 10.0)
    _, _, rgba, _, _ = p.getCameraImage(
        480, 360, view, projection, renderer=p.ER_TINY_RENDERER, physicsClientId=client
    )
    pixels = np.reshape(np.asarray(rgba, dtype=np.uint8), (360, 480, 4))[:, :, :3]
    return hashlib.sha256(pixels.tobytes()).hexdigest()
