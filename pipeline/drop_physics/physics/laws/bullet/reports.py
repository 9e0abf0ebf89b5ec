"""What PyBullet reports, in the form of the law: the tree, forces on links, efforts.

Which body of a pair, in which axes, at which point, with which sign. File names and line numbers
are bullet3's, and what is said of them was measured with PyBullet 3.2.7 (`docs/validation.md`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drop_physics.physics.columns import cross, rotation
from drop_physics.physics.impulses import Forces
from drop_physics.physics.kinematics import Kinematics, in_world
from drop_physics.physics.tree import Tree

Float64 = NDArray[np.float64]
Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]

# -- what the engine reports, as forces on links ------------------------------------------------


def contact_forces(
    *,
    step: Rows,
    link: Rows,
    is_a: Flags,
    point_m: Float64,
    force_n: Float64,
    rolling: Flags,
) -> Forces:
    """Return contact points of `getContactPoints`, seen from one of the two bodies.

    A body that touches itself has two rows per point. `point_m` is positionOnA or positionOnB;
    `force_n` the force on a, (k, 3). `rolling`: whether either link has a coefficient of rolling or
    spinning friction.
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
    """Return the forces on a at contact points of `getContactPoints`, shape (k, 3).

    `normal` is contactNormalOnB, (k, 3); `friction_n` both lateral frictions, (k, 2), and
    `directions` those of each, (k, 3).
    """
    first, second = (friction_n[:, d, None] * directions[d] for d in range(2))
    return np.asarray(normal * normal_force_n[:, None] + (first + second))


def pushes(
    kin: Kinematics,
    *,
    step: Rows,
    link: Rows,
    force_n: Float64,
    point_m: Float64,
    torque_n_m: Float64,
    in_link_frame: Flags,
    pose: Rows,
) -> Forces:
    """Return what `applyExternalForce` and `applyExternalTorque` do, shape (k,) rows.

    `pose` is the state whose pose of the link PyBullet uses: the force acts at the centre of mass
    where the link is, but its frame and its moment are those of that pose
    (`PhysicsServerCommandProcessor.cpp` 12609, `m_cachedWorldTransform`). It is the current one for
    the base; for a link that of one step earlier, unless a call has refreshed the poses of this
    body's links since: `getLinkState` or `getLinkStates` of any of its links with
    `computeForwardKinematics=True`, `resetJointState` and its multi-dof form,
    `resetBasePositionAndOrientation`, `resetBaseVelocity`; and before the first step. Other reads,
    `performCollisionDetection` and `calculateInverseKinematics` do not.
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


def constraint_forces(
    kin: Kinematics,
    *,
    kind: Literal["fixed", "point2point"],
    as_parent: bool,
    link: int,
    pivot_m: Sequence[float],
    axes: Float64,
    reported: Float64,
) -> Forces:
    """Return what a constraint of `createConstraint` does to one of its two bodies, n rows.

    `pivot_m` is this body's, in its link's axes; `axes` the parent's frame in the world, shape
    (n, 3, 3); `reported` the numbers of `getConstraintState` after each step, (n, 6) or (n, 3):
    forces along the world's axes, then torques about the parent frame's
    (`btMultiBodyFixedConstraint.cpp` 150-183, `btMultiBodyPoint2Point.cpp` 120: its axes are
    negative).
    """
    sign = 1.0 if as_parent == (kind == "fixed") else -1.0
    steps = np.arange(len(reported))
    torque = np.zeros((len(steps), 3))
    if kind == "fixed":
        torque = np.einsum("nij,nj->ni", axes, reported[:, 3:6])
    return Forces(
        step=steps,
        link=np.full(len(steps), link),
        force_n=sign * reported[:, :3],
        point_m=kin.point_m(link, pivot_m)[: len(steps)],
        torque_n_m=sign * torque,
        rolling=np.zeros(len(steps), np.bool_),
    )


def gear_impulses(
    tree: Tree, *, as_parent: bool, link: int, ratio: float, reported: Float64, timestep_s: Float64
) -> Float64:
    """Return what a JOINT_GEAR does to one of its two joints, shape (n, joint_rates).

    `reported` is the one number of `getConstraintState` after each step, shape (n,): the effort on
    the parent's joint, and times the gear ratio that on the child's
    (`btMultiBodyGearConstraint.cpp` 98-106).
    """
    impulses = np.zeros((len(reported), tree.joint_rates))
    acting = reported * timestep_s * (1.0 if as_parent else ratio)
    impulses[:, tree.rates[link].start - tree.first_rate] = acting
    return impulses


def frame_axes(kin: Kinematics, link: int, orientation: Sequence[float]) -> Float64:
    """Return a link's frame, turned by a quaternion x, y, z, w, in the world, shape (n, 3, 3)."""
    return np.asarray(kin.matrix(link) @ rotation(np.asarray(orientation, np.float64)))


def pd_effort(
    *,
    gains: Float64,
    target: Float64,
    target_velocity: Float64,
    limit: Float64,
    position: Float64,
    velocity: Float64,
) -> Float64:
    """Return what PD_CONTROL gives, which `getJointState` reports as 0; shape (n,).

    clip(kp (q* - q) + kd (q̇* - q̇), ± force) of the state before the step; `gains` are kp and kd.
    """
    kp, kd = gains
    wanted = kp * (target - position) + kd * (target_velocity - velocity)
    return np.asarray(np.clip(wanted, -limit, limit))
