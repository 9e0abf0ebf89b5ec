"""Integrates a body's pose over a step, from the velocities at the step's end.

x' = x + v' dt        q' = q + q̇' dt        orientations turn by the exponential map
"""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.physics.rotations import products, same_way
from drop_physics.physics.tree import RATES, States, Tree

ROUNDED = 1e-13
"""Maximum difference between equal numbers, as a share of the number and its change; measured:
4e-16."""
TURNED = 1e-12
"""Maximum difference of quaternions that counts as rounding; measured: 2e-15 [1]."""


def moved(
    tree: Tree, before: States, velocity: Float64, timestep_s: Float64, most_rad: float
) -> States:
    """Integrate velocities, shape (n, size), over a step; a rotation is limited to `most_rad`.

    Source: `btMultiBody::stepPositionsMultiDof`; MuJoCo's `mj_integratePos`, which has no limit.
    """
    dt, joints = timestep_s[:, None], before.joints.copy()
    position, orientation = before.position_m, before.orientation
    if not tree.fixed:
        position = position + velocity[:, 3:6] * dt
        orientation = products(_turn(velocity[:, :3] * dt, most_rad), orientation)
        orientation = orientation / np.linalg.norm(orientation, axis=1, keepdims=True)
    for link, joint in enumerate(tree.joints):
        at, turned = tree.coordinates[link], velocity[:, tree.rates[link]] * dt
        if RATES[joint] == 1:
            joints[:, at] += turned
        elif joint == "spherical":  # its rates are about the link's own axes
            product = products(joints[:, at], _turn(turned, most_rad))
            joints[:, at] = product / np.linalg.norm(product, axis=1, keepdims=True)
    return States(position, orientation, joints, velocity)


def moved_on(
    tree: Tree, before: States, after: States, timestep_s: Float64, most_rad: float
) -> Flags:
    """Flag the steps whose final velocities integrate to their final pose, shape (n,).

    Rotations are limited to `most_rad` [rad]; spherical joints are ignored. A step with a state
    that is not finite is not flagged.
    """
    reached = moved(tree, before, after.velocity, timestep_s, most_rad)
    held = np.ones(len(before), np.bool_)
    if not tree.fixed:
        held &= _near(before.position_m, reached.position_m, after.position_m)
        off = same_way(reached.orientation, after.orientation) - after.orientation
        held &= np.abs(off).max(axis=1) <= TURNED
    for link, joint in enumerate(tree.joints):
        if RATES[joint] == 1:
            at = tree.coordinates[link]
            held &= _near(before.joints[:, at], reached.joints[:, at], after.joints[:, at])
    return held


def way_between(tree: Tree, states: States, others: States) -> Float64:
    """Return the displacement between two nearby states, one entry per degree of freedom."""
    way = np.zeros((len(states), tree.size))
    if not tree.fixed:
        way[:, :3] = _turn_between(states.orientation, others.orientation)
        way[:, 3:6] = others.position_m - states.position_m
    for link, joint in enumerate(tree.joints):
        at, rate = tree.coordinates[link], tree.rates[link]
        if RATES[joint] == 1:
            way[:, rate] = others.joints[:, at] - states.joints[:, at]
        elif joint == "spherical":
            back = [-1, -1, -1, 1]
            own = (states.joints[:, at] * back, others.joints[:, at] * back)
            way[:, rate] = -_turn_between(*own)
    return way


def _near(before: Float64, reached: Float64, after: Float64) -> Flags:
    off, way = np.abs(after - reached), np.abs(reached - before)
    return np.asarray((off <= ROUNDED * (np.abs(before) + way)).all(axis=1))


def _turn(vectors: Float64, most_rad: float) -> Float64:
    """Return the quaternions x, y, z, w of rotations by these vectors [rad], shape (n, 4).

    For angles beyond `most_rad`, the sine of half the angle is that of half the limit; the axis is
    not shortened.
    """
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    held = np.minimum(angle, most_rad)
    share = np.divide(np.sin(held / 2), held, out=np.full_like(held, 0.5), where=held > 0)
    return np.hstack((vectors * share, np.cos(held / 2)))


def _turn_between(orientation: Float64, other: Float64) -> Float64:
    """Return the small rotation vectors between two orientations [rad], shape (n, 3)."""
    back = orientation * [-1, -1, -1, 1]
    return 2 * products(same_way(other, orientation), back)[:, :3]
