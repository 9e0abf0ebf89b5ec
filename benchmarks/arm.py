"""`drop analyze` of an arm, compared with a numpy loop over mass matrix and bias of each step."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from drop_physics.recording.reader import read

from benchmarks.harness import DROP, PYTHON, Measured, process, worked

SCENE = """
import sys
from math import sin
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for step in range(int(sys.argv[1])):
    if step % 10 == 0:
        for joint in range(7):
            p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL,
                                    targetPosition=0.3 * sin(0.005 * step + joint), force=200)
    p.stepSimulation()
"""

NUMPY = """
import numpy as np
import pybullet as p, pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
LINKS = range(p.getNumJoints(arm))
JOINTS = [p.getJointInfo(arm, joint) for joint in LINKS]
DYNAMICS = [p.getDynamicsInfo(arm, link) for link in LINKS]
GRAVITY = np.array([0, 0, -9.81])

def turned(quaternion):
    x, y, z, w = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    return np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]), (0, 1), (-2, -1))

def mass_and_bias(q, u):
    n, size = q.shape
    M, bias = np.zeros((n, size, size)), np.zeros((n, size))
    R, at = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    Jw, Jv = np.zeros((n, 3, size)), np.zeros((n, 3, size))
    spin, alpha, acceleration = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    for link in LINKS:
        axis, pivot, frame = (np.array(value) for value in JOINTS[link][13:16])
        mass, inertia = DYNAMICS[link][0], np.array(DYNAMICS[link][2])
        inside, within = (np.array(value) for value in DYNAMICS[link][3:5])
        half = q[:, link, None] / 2
        swing = turned(np.hstack([np.sin(half) * axis, np.cos(half)]))
        joint = at + R @ pivot
        R_link = R @ turned(frame * [-1, -1, -1, 1]) @ swing
        centre = joint + R_link @ (turned(within).T @ inside)
        world_axis = R_link @ axis
        Jw_link = Jw.copy()
        Jw_link[:, :, link] = world_axis
        Jv_link = Jv - np.cross((centre - at)[:, :, None], Jw, axis=1)
        Jv_link[:, :, link] += np.cross(world_axis, centre - joint)
        spin_link = np.einsum("nij,nj->ni", Jw_link, u)
        alpha_link = alpha + np.cross(spin, spin_link - spin)
        of_joint = (acceleration + np.cross(alpha, joint - at)
                    + np.cross(spin, np.cross(spin, joint - at)))
        of_centre = (of_joint + np.cross(alpha_link, centre - joint)
                     + np.cross(spin_link, np.cross(spin_link, centre - joint)))
        I = (R_link * inertia) @ R_link.transpose(0, 2, 1)
        momentum = np.einsum("nij,nj->ni", I, spin_link)
        M += mass * Jv_link.transpose(0, 2, 1) @ Jv_link + Jw_link.transpose(0, 2, 1) @ I @ Jw_link
        bias += mass * np.einsum("nij,ni->nj", Jv_link, of_centre - GRAVITY)
        torque = np.einsum("nij,nj->ni", I, alpha_link) + np.cross(spin_link, momentum)
        bias += np.einsum("nij,ni->nj", Jw_link, torque)
        R, at, Jw, Jv = R_link, centre, Jw_link, Jv_link
        spin, alpha, acceleration = spin_link, alpha_link, of_centre
    return M, bias

states = np.load("joints.npz")
position, velocity = states["position"], states["velocity"]
for first in range(0, len(position), 10_000):
    q, u = position[first:first + 10_000], velocity[first:first + 10_000]
    M, bias = mass_and_bias(q, u)
p.setGravity(*GRAVITY)
its = p.calculateInverseDynamics(arm, list(q[-1]), [0.0] * 7, [0.0] * 7)
assert abs(mass_and_bias(q[-1:], 0 * u[-1:])[1][0] - its).max() < 1e-9, "not the engine's"
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare whole processes."""
    steps = 1_000 if quick else 100_000
    (folder / "arm.py").write_text(SCENE, encoding="utf-8")
    process(
        *DROP, "record", "--duration", "1e9", "--out", "run.rrd", "arm.py", steps, folder=folder
    )
    seen = read(folder / "run.rrd").seen
    joints = [joint for piece in seen.pieces() for joint in piece.joints.values()]
    np.savez(
        folder / "joints.npz",
        position=np.concatenate([joint.position for joint in joints]),
        velocity=np.concatenate([joint.velocity for joint in joints]),
    )
    ratios, detail = worked(
        lambda: process(*DROP, "analyze", "--force", "run.rrd", folder=folder),
        lambda: process(*PYTHON, NUMPY, folder=folder),
        pairs=1 if quick else 5,
    )
    yield Measured(
        f"`drop analyze`, a kuka, {steps:.0e} steps: processor time",
        "numpy: its mass matrix and bias",
        ratios,
        1.5,
        detail=detail,
    )
