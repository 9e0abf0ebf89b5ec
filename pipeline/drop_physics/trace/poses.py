"""Computes poses of links from recorded bases and joints, by forward kinematics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.rotations import products, quaternions, rotate, rotate_inverse
from drop_physics.physics.tree import Joint as Kind
from drop_physics.physics.tree import States, Tree
from drop_physics.trace.events import Joint
from drop_physics.trace.states import BASE, MOTION, STATE, Joints, Rows

KINDS: Mapping[str, Kind] = {
    "revolute": "revolute",
    "prismatic": "prismatic",
    "spherical": "spherical",
}
"""Joint types that the kinematics supports; joints of other types are drawn as fixed."""


def tree_of(joints: Sequence[Joint], frames: Float64) -> Tree:
    """Build a body's kinematic tree without masses, with a moving base, to compute poses.

    Parameters
    ----------
    joints
        The joint between each link and its parent.
    frames
        Inertial frames of base and links as poses in their own frames, shape (links + 1, 7).
    """
    links = len(joints)
    orientations = np.reshape([joint.parent_orientation for joint in joints], (-1, 4))
    return Tree(
        fixed=False,
        masses_kg=np.zeros(links + 1),
        inertias_kg_m2=np.zeros((links + 1, 3)),
        parents=tuple(joint.parent for joint in joints),
        joints=tuple(KINDS.get(joint.kind, "fixed") for joint in joints),
        axes=np.reshape([joint.axis for joint in joints], (-1, 3)).astype(np.float64),
        positions_m=np.reshape([joint.parent_position_m for joint in joints], (-1, 3)),
        orientations=orientations * [-1.0, -1.0, -1.0, 1.0],
        centres_m=rotate_inverse(frames[1:, 3:], frames[1:, :3]),
    )


def inertial_frames(reported: Mapping[str, Float64]) -> Float64:
    """Return the inertial frames of base and links in their own frames, shape (links + 1, 7)."""
    frames = np.hstack((reported["inertial_position_m"], reported["inertial_orientation"]))
    # Those of a btRigidBody are not known, and of a base not needed.
    return np.where(np.isfinite(frames), frames, 0.0)


def links_of(tree: Tree, base: Float64, joints: Joints | None) -> Float64:
    """Return position, orientation, velocity and spin of base and links, shape (n, links + 1, 13).

    Parameters
    ----------
    tree
        The kinematic tree of the body.
    base
        The states of the base, shape (n, 13).
    joints
        The n states of the joints; None if no joint moves.
    """
    motions = np.empty((len(base), tree.links + 1, 13))
    motions[:, 0] = base
    if not tree.links:
        return motions
    empty = np.empty((len(base), 0))
    q, rates = (empty, empty) if joints is None else (joints.position, joints.velocity)
    q, rates = q[:, : tree.joint_coordinates], rates[:, : tree.joint_rates]
    velocity = np.hstack((base[:, 10:13], base[:, 7:10], rates))
    kin = kinematics(tree, States(base[:, :3], base[:, 3:7], q, velocity))
    moves = motion(kin, velocity)
    for link in range(tree.links):
        motions[:, link + 1, 0:3] = kin.position_m(link)
        motions[:, link + 1, 3:7] = quaternions(kin.rotations[link + 1])
        motions[:, link + 1, 7:10] = moves.velocities[link + 1].T
        motions[:, link + 1, 10:13] = moves.spins[link + 1].T
    return motions


def within(frames: Float64, poses: Float64) -> Float64:
    """Convert world poses to poses relative to frames, shape (n, 7)."""
    backwards = frames[:, 3:] * [-1.0, -1.0, -1.0, 1.0]
    return np.hstack(
        (
            rotate_inverse(frames[:, 3:], poses[:, :3] - frames[:, :3]),
            products(backwards, poses[:, 3:]),
        )
    )


def placed(frames: Float64, poses: Float64) -> Float64:
    """Convert poses relative to frames into world poses: the inverse of `within`."""
    return np.hstack(
        (frames[:, :3] + rotate(frames[:, 3:], poses[:, :3]), products(frames[:, 3:], poses[:, 3:]))
    )


def rows_of(number: int, steps: Int64, motions: Float64) -> Rows:
    """Convert motions of base and links, shape (n, links + 1, 13), to rows of dtype `STATE`."""
    count = motions.shape[1]
    rows = np.empty((len(steps), count), STATE)
    rows["step"], rows["body"] = steps[:, None], number
    rows["link"] = np.arange(BASE, count - 1)
    for name, part in MOTION.items():
        rows[name] = motions[..., part]
    return rows.reshape(-1)
