"""Drive PyBullet directly, through none of our code: what the tests compare it with."""

from __future__ import annotations

import hashlib

import numpy as np
import pybullet as p
import pybullet_data


def drive(
    *,
    timestep_s: float = 1 / 240,
    samples: int = 241,
    linear_damping: float | None = None,
    gravity_m_s2: float | None = -9.81,
    stepped: bool = True,
    floor: bool = True,
    picture_every: int | None = None,
) -> tuple[np.ndarray, dict[int, str]]:
    """Return positions and velocities before each step, (samples, 6), and frame hashes by step."""
    client = p.connect(p.DIRECT)
    try:
        p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
        p.setTimeStep(timestep_s, physicsClientId=client)
        if gravity_m_s2 is not None:
            p.setGravity(0, 0, gravity_m_s2, physicsClientId=client)
        if floor:
            p.loadURDF("plane.urdf", physicsClientId=client)
        box = p.loadURDF("cube_small.urdf", [0, 0, 1], physicsClientId=client)
        if linear_damping is not None:
            p.changeDynamics(box, -1, linearDamping=linear_damping, physicsClientId=client)
        rows, hashes = [], {}
        for step in range(samples):
            position, _ = p.getBasePositionAndOrientation(box, physicsClientId=client)
            velocity, _ = p.getBaseVelocity(box, physicsClientId=client)
            rows.append((*position, *velocity))
            if picture_every and step % picture_every == 0:
                hashes[step] = _picture_hash(client)
            if stepped:
                p.stepSimulation(physicsClientId=client)
        return np.array(rows), hashes
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
