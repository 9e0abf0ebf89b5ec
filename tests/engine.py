"""Drive PyBullet directly, with none of our code, as a reference for the tests."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pybullet_data
from drop_physics.engines.pybullet import probe

ROUNDS_ONCE = platform.machine() in ("x86_64", "AMD64")
"""Whether each operation rounds once on this machine; elsewhere compilers may fuse multiply-add."""
MODES: tuple[Any, ...] = ("reduced", "maximal")
DATA = Path(pybullet_data.getDataPath())
AT_REST = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Driven:
    """PyBullet's reported state before each step; arrays of shape (samples, ...)."""

    position_m: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray
    orientation_xyzw: np.ndarray
    mass_kg: float
    picture_hashes: dict[int, str] = field(default_factory=dict)
    """Hashes of rendered images by step."""


def drive(
    *,
    timestep_s: float = 1 / 240,
    samples: int = 241,
    gravity_m_s2: float | None = -9.81,
    height_m: float = 1.0,
    velocity_m_s: tuple[float, float, float] = AT_REST,
    spin_rad_s: tuple[float, float, float] = AT_REST,
    orientation_xyzw: tuple[float, ...] | None = None,
    body: str | None = None,
    floor: bool = True,
    coordinates: Any = "reduced",
    restitution: float | None = None,
    picture_every: int | None = None,
    dynamics: dict[str, Any] | None = None,
    engine: dict[str, Any] | None = None,
) -> Driven:
    """Drop a body loaded from a URDF, cube_small.urdf by default.

    `dynamics` are told of the body, `engine` of the physics.
    """
    client = p.connect(p.DIRECT)
    maximal = coordinates == "maximal"
    try:
        p.setTimeStep(timestep_s, physicsClientId=client)
        p.setPhysicsEngineParameter(physicsClientId=client, **(engine or {}))
        bodies = []
        if floor:  # always a btMultiBody
            bodies.append(p.loadURDF(str(DATA / "plane.urdf"), physicsClientId=client))
        path, height = str(body or DATA / "cube_small.urdf"), [0, 0, height_m]
        bodies.append(
            p.loadURDF(path, height, useMaximalCoordinates=maximal, physicsClientId=client)
        )
        one = bodies[-1]
        if dynamics:
            p.changeDynamics(one, -1, physicsClientId=client, **dynamics)
        # After the mass: Bullet then weighs the body by 1 / (1 / mass), which is what it reports.
        if gravity_m_s2 is not None:
            p.setGravity(0, 0, gravity_m_s2, physicsClientId=client)
        if restitution is not None:
            for each in bodies:
                p.changeDynamics(each, -1, restitution=restitution, physicsClientId=client)
        if orientation_xyzw is not None:
            p.resetBasePositionAndOrientation(one, height, orientation_xyzw, physicsClientId=client)
        p.resetBaseVelocity(one, velocity_m_s, spin_rad_s, physicsClientId=client)
        rows, hashes = [], {}
        for step in range(samples):
            if step:
                p.stepSimulation(physicsClientId=client)
            position, orientation = p.getBasePositionAndOrientation(one, physicsClientId=client)
            velocity, spin = p.getBaseVelocity(one, physicsClientId=client)
            rows.append((*position, *velocity, *spin, *orientation))
            if picture_every and step % picture_every == 0:
                hashes[step] = _picture_hash(client)
        parts = np.split(np.array(rows), (3, 6, 9), axis=1)
        mass_kg = p.getDynamicsInfo(one, -1, physicsClientId=client)[0]
        return Driven(*parts, mass_kg, hashes)
    finally:
        p.disconnect(client)


def shape(geometry: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """Return the URDF element of a collision shape."""
    return (
        f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></collision>'
    )


def box(size: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """Return the URDF element of a box-shaped collision shape with the given edges [m]."""
    return shape(f'<box size="{size}"/>', xyz, rpy)


def urdf_of(
    folder: Path,
    *shapes: str,
    mass_kg: float = 1.0,
    inertia: float = 1.0,
    centre: str = "0 0 0",
    contact: str = "",
) -> str:
    """Write a URDF of one link with the given collision shapes, and return its path."""
    path = folder / f"body-{len(list(folder.iterdir()))}.urdf"
    path.write_text(
        f'<robot name="body"><link name="base"><contact>{contact}</contact><inertial>'
        f'<origin xyz="{centre}"/><mass value="{mass_kg}"/>'
        f'<inertia ixx="{inertia:g}" iyy="{inertia:g}" izz="{inertia:g}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>"
        f"{''.join(shapes)}</link></robot>"
    )
    files = (path.resolve(),)
    probe.believe({files[0]: probe.Verdict("", files, probe.digest_of(files))})
    return str(path)


def lowered(body: str, orientation: Any, *, from_m: float, maximal: bool) -> float | None:
    """Lower a body at 1 mm/s, and return the height at which the floor first pushes it [m]."""
    client = p.connect(p.DIRECT)
    try:
        p.setAdditionalSearchPath(str(DATA), physicsClientId=client)
        floor = p.loadURDF("plane.urdf", physicsClientId=client)
        one = p.loadURDF(body, useMaximalCoordinates=maximal, physicsClientId=client)
        p.changeDynamics(one, -1, linearDamping=0, physicsClientId=client)
        p.setTimeStep(1e-3, physicsClientId=client)
        p.resetBasePositionAndOrientation(one, (0, 0, from_m), orientation, physicsClientId=client)
        p.resetBaseVelocity(one, (0, 0, -1e-3), (0, 0, 0), physicsClientId=client)
        for _ in range(300):
            (_, _, z_m), _ = p.getBasePositionAndOrientation(one, physicsClientId=client)
            p.stepSimulation(physicsClientId=client)
            points = p.getContactPoints(one, floor, physicsClientId=client)
            if any(point[9] > 0 for point in points):
                return float(z_m)
        return None
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
