"""Where a step of Bullet's moves a body, given the velocities that it ends with.

x' = x + v' dt        q' = q + q̇' dt        orientations turn by the exponential map
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.physics.bullet_spin import MAX_TURN_RAD
from drop_physics.physics.rotations import products, same_way
from drop_physics.physics.tree import RATES, States, Tree

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROUNDED = 1e-13
"""Share of a number and its change up to which they are the same; measured: 4e-16."""
TURNED = 1e-12
"""Largest difference of quaternions that is rounding; measured: 2e-15 [1]."""


def moved_on(tree: Tree, before: States, after: States, timestep_s: Float64) -> Flags:
    """Return whether the velocities after each step lead to its pose, shape (n,).

    Spherical joints are not looked at. False where a state is not finite.
    """
    dt = timestep_s[:, None]
    held = np.ones(len(before), np.bool_)
    if not tree.fixed:
        turn, way = after.velocity[:, :3] * dt, after.velocity[:, 3:6] * dt
        held &= _near(before.position_m, way, after.position_m)
        held &= _turned(before.orientation, turn, after.orientation)
    for link, joint in enumerate(tree.joints):
        if RATES[joint] == 1:
            at, rate = tree.coordinates[link], tree.rates[link]
            way = after.velocity[:, rate] * dt
            held &= _near(before.joints[:, at], way, after.joints[:, at])
    return held


def _near(before: Float64, way: Float64, after: Float64) -> Flags:
    off = np.abs(after - (before + way))
    return np.asarray((off <= ROUNDED * (np.abs(before) + np.abs(way))).all(axis=1))


def _turned(before: Float64, turn: Float64, after: Float64) -> Flags:
    """Return whether orientations (x, y, z, w) are others, turned by these vectors [rad].

    The sine of half the angle is that of MAX_TURN_RAD where it turns by more, its axis is not
    shortened (`btMultiBody::stepPositionsMultiDof`).
    """
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    held = np.minimum(angle, MAX_TURN_RAD)
    share = np.divide(np.sin(held / 2), held, out=np.full_like(held, 0.5), where=held > 0)
    product = products(np.hstack((turn * share, np.cos(held / 2))), before)
    product = product / np.linalg.norm(product, axis=1, keepdims=True)
    return np.asarray(np.abs(same_way(product, after) - after).max(axis=1) <= TURNED)
