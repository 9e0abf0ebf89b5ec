"""Mass matrix, bias, gravity and energies of a tree of links, for given states.

Source: Featherstone, *Rigid Body Dynamics Algorithms* (2008): the mass matrix by the composite
rigid body algorithm (chapter 6), the bias by the recursive Newton-Euler algorithm without
accelerations (chapter 5). Each composite's inertia is kept about its own centre of mass, so that a
small link far from the base loses no digits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.columns import cross, dot, product, times, turning_back
from drop_physics.physics.kinematics import Kinematics, LinkVelocities, across, generalised
from drop_physics.physics.tree import RATES


def mass_matrix(kin: Kinematics) -> Float64:
    """Return the mass matrix M, with kinetic energy ½ u·M u, shape (n, size, size)."""
    tree, n = kin.tree, len(kin)
    out = np.zeros((tree.size, tree.size, n))
    composites = _composites(kin)
    for link in range(tree.links):
        if not RATES[tree.joints[link]]:
            continue
        mass, centre, inertia = composites[link + 1]
        slides = tree.joints[link] == "prismatic"
        for k, axis in enumerate(kin.axes[link]):
            row = tree.rates[link].start + k
            # The momentum of what hangs on the joint, per unit of its rate.
            momentum = mass * (axis if slides else cross(axis, centre - kin.pivots[link]))
            angular = np.zeros((3, n)) if slides else times(inertia, axis)
            _fill_row(kin, out, link, row, centre, momentum, angular)
    if not tree.fixed:
        _fill_base(kin, out, *composites[0])
    if tree.armature is not None:
        widths = [tree.first_rate, *(rates.stop - rates.start for rates in tree.rates)]
        each = np.arange(tree.size)
        out[each, each] += np.repeat(tree.armature, widths)[:, None]
    for inertia, *moved in () if tree.coupled is None else tree.coupled:
        out += inertia * np.outer(moved, moved)[:, :, None]
    return np.ascontiguousarray(np.moveaxis(out, -1, 0))


Composite = tuple[float, Float64, Float64]
"""Mass [kg], centre of mass, (3, n), and inertia about that centre, (3, 3, n)."""


def _composites(kin: Kinematics) -> list[Composite]:
    """Return mass, centre and inertia of the branches that start at the base and at each link."""
    tree = kin.tree
    found: list[Composite] = []
    for mass, inertia, turned, centre in zip(
        tree.masses_kg, tree.inertias_kg_m2, kin.rotations, kin.centres, strict=True
    ):
        found.append((float(mass), centre, _in_world(turned, inertia)))
    for link in reversed(range(tree.links)):
        parent = tree.parents[link] + 1
        if parent > 0 or not tree.fixed:
            found[parent] = _joined(found[parent], found[link + 1])
    return found


def _in_world(turned: Float64, inertia: Float64) -> Float64:
    """Return the inertia in world axes, R diag(I) Rᵀ, shape (3, 3, n)."""
    if inertia[0] == inertia[1] == inertia[2]:
        return np.asarray(np.broadcast_to((np.eye(3) * inertia[0])[:, :, None], turned.shape))
    return product(turned * inertia[None, :, None], np.swapaxes(turned, 0, 1))


def _joined(a: Composite, b: Composite) -> Composite:
    """Combine two bodies into one, by the parallel axis theorem."""
    mass = a[0] + b[0]
    if mass == 0:
        return a[0], a[1], a[2] + b[2]
    apart = b[1] - a[1]
    reduced = a[0] * b[0] / mass
    inertia = a[2] + b[2] + reduced * _about(apart)
    return mass, a[1] + (b[0] / mass) * apart, inertia


def _about(arm: Float64) -> Float64:
    """Return the inertia of a unit point mass at r, |r|² 1 - r rᵀ, shape (3, 3, n)."""
    x, y, z = arm
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, -x * y, -x * z, -y * z
    return np.array([[yy + zz, xy, xz], [xy, xx + zz, yz], [xz, yz, xx + yy]])


def _fill_row(
    kin: Kinematics,
    out: Float64,
    link: int,
    row: int,
    centre: Float64,
    momentum: Float64,
    angular: Float64,
) -> None:
    """Fill one rate's row of the mass matrix, up to the base, from the momentum of its branch."""
    tree = kin.tree
    for joint in tree.branch(link):
        if not RATES[tree.joints[joint]]:
            continue
        slides = tree.joints[joint] == "prismatic"
        acting = momentum if slides else angular + cross(centre - kin.pivots[joint], momentum)
        for k, axis in enumerate(kin.axes[joint]):
            column = tree.rates[joint].start + k
            out[row, column] = out[column, row] = dot(axis, acting)
    if not tree.fixed:
        out[row, 3:6] = out[3:6, row] = momentum
        out[row, 0:3] = out[0:3, row] = angular + cross(centre - kin.centres[0], momentum)


def _fill_base(
    kin: Kinematics, out: Float64, mass: float, centre: Float64, inertia: Float64
) -> None:
    """Fill the rows for a moving base: the whole tree as one body."""
    arm = centre - kin.centres[0]
    out[0:3, 0:3] = inertia + mass * _about(arm)
    for k, axis in enumerate(np.eye(3)[:, :, None]):
        out[3 + k, 3 + k] = mass
        out[0:3, 3 + k] = out[3 + k, 0:3] = mass * cross(arm, axis)


def gravity(kin: Kinematics, gravity_m_s2: Float64) -> Float64:
    """Return the generalised force of gravity, shape (n, size); `gravity_m_s2` is (n, 3)."""
    tree = kin.tree
    pull = gravity_m_s2.T
    return generalised(kin, {link: tree.masses_kg[link + 1] * pull for link in tree.moving}, {})


def bias(kin: Kinematics, moved: LinkVelocities, velocity: Float64) -> Float64:
    """Return Coriolis, centrifugal and gyroscopic forces, shape (n, size).

    -Σ Jvᵀ m a + Jwᵀ (I α + ω × I ω), with the accelerations a, α of the links at constant u.
    """
    tree, u = kin.tree, velocity.T
    still = np.zeros((3, len(kin)))
    turns, moves = [still], [still]  # angular and linear accelerations
    for link, parent in enumerate(tree.parents):
        turning, sliding = across(kin, u, link)
        spin, alpha = moved.spins[parent + 1], turns[parent + 1]
        if turning is None:
            arm = kin.centres[link + 1] - kin.centres[parent + 1]
            acceleration = moves[parent + 1] + _swung(alpha, spin, arm)
            if sliding is not None:
                acceleration = acceleration + 2.0 * cross(spin, sliding)
        else:
            pivot = kin.pivots[link]
            acceleration = moves[parent + 1] + _swung(alpha, spin, pivot - kin.centres[parent + 1])
            alpha = alpha + cross(spin, turning)
            arm = kin.centres[link + 1] - pivot
            acceleration = acceleration + _swung(alpha, moved.spins[link + 1], arm)
        turns.append(alpha)
        moves.append(acceleration)
    forces, torques = {}, {}
    for link in tree.moving:
        spin, inertia = moved.spins[link + 1], _inertia_times(kin, link)
        forces[link] = -tree.masses_kg[link + 1] * moves[link + 1]
        torques[link] = -inertia(turns[link + 1]) - cross(spin, inertia(spin))
    return generalised(kin, forces, torques)


def _swung(alpha: Float64, spin: Float64, arm: Float64) -> Float64:
    return cross(alpha, arm) + cross(spin, cross(spin, arm))


def _inertia_times(kin: Kinematics, link: int) -> Callable[[Float64], Float64]:
    turned, inertia = kin.rotations[link + 1], kin.tree.inertias_kg_m2[link + 1][:, None]
    return lambda vector: times(turned, inertia * turning_back(turned, vector))


def angular_momenta(kin: Kinematics, moved: LinkVelocities) -> dict[int, Float64]:
    """Return I ω of each massive link, about its centre of mass [kg m²/s], shape (3, n)."""
    return {link: _inertia_times(kin, link)(moved.spins[link + 1]) for link in kin.tree.moving}


def lifted_j(kin: Kinematics, gravity_m_s2: Float64) -> Float64:
    """Return the change of potential energy from each state to the next [J], shape (n - 1,).

    The change is -Σ m g·(c' - c), with the gravity g of each step, shape (n - 1, 3).
    """
    tree, pull = kin.tree, gravity_m_s2.T
    out = np.zeros(len(kin) - 1)
    for link in tree.moving:
        centre = kin.centres[link + 1]
        out -= tree.masses_kg[link + 1] * dot(pull, centre[:, 1:] - centre[:, :-1])
    return out
