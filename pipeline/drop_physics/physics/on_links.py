"""Converts contacts, applied forces and constraints to forces on links, in world axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.physics.columns import cross, rotation
from drop_physics.physics.impulses import Forces
from drop_physics.physics.kinematics import Kinematics, in_world


def contact_forces(
    *,
    step: Int64,
    link: Int64,
    is_a: Flags,
    point_m: Float64,
    force_n: Float64,
    rolling: Flags,
) -> Forces:
    """Return contact points as forces on links of one of the two touching bodies.

    A body that touches itself has two rows per point. `point_m` lies on the body; `force_n` is the
    force on side a, (k, 3); `rolling` flags points at which either link has rolling or spinning
    friction.
    """
    return Forces(
        step=step,
        link=link,
        force_n=force_n * np.where(is_a, 1.0, -1.0)[:, None],
        point_m=point_m,
        torque_n_m=np.zeros_like(force_n),
        rolling=rolling,
    )


def points_force_n(
    normal: Float64, normal_force_n: Float64, friction_n: Float64, directions: Sequence[Float64]
) -> Float64:
    """Return the forces on body a at contact points, shape (k, 3).

    `normal` points from b to a, (k, 3); `friction_n` are both lateral friction forces, (k, 2), and
    `directions` the directions of the first and of the second, (k, 3) each.
    """
    first, second = (friction_n[:, d, None] * directions[d] for d in range(2))
    return np.asarray(normal * normal_force_n[:, None] + (first + second))


def pushes(
    kin: Kinematics,
    *,
    step: Int64,
    link: Int64,
    force_n: Float64,
    point_m: Float64,
    torque_n_m: Float64,
    in_link_frame: Flags,
    pose: Int64,
) -> Forces:
    """Return external forces and torques as forces on links, k rows.

    `pose` is the index of the state at whose link pose the engine applies the force: the force acts
    at the link's current centre of mass, but its direction and its moment are computed at that
    pose.
    """
    force, point, torque = force_n.copy(), point_m.copy(), torque_n_m.copy()
    centre, arm = np.empty_like(force), np.empty_like(force)
    for one in np.unique(link):
        rows = link == one
        centre[rows] = kin.position_m(int(one))[step[rows]]
        arm[rows] = point[rows] - kin.position_m(int(one))[pose[rows]]
        turned = rows & in_link_frame
        for vectors, local in ((force, force_n), (arm, point_m), (torque, torque_n_m)):
            vectors[turned] = in_world(kin, int(one), pose[turned], local[turned])
    moment = torque + cross(arm.T, force.T).T
    return Forces(
        step=step,
        link=link,
        force_n=force,
        point_m=centre,
        torque_n_m=moment,
        rolling=np.zeros(len(step), np.bool_),
    )


def frame_axes(kin: Kinematics, link: int, orientation: Sequence[float]) -> Float64:
    """Return the world axes of a link's frame rotated by a quaternion x, y, z, w, (n, 3, 3)."""
    return np.asarray(kin.matrix(link) @ rotation(np.asarray(orientation, np.float64)))
