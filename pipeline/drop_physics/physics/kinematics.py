"""Poses and velocities of a tree's links, and the generalised forces of forces on links.

Source: Featherstone, *Rigid Body Dynamics Algorithms* (2008), chapters 4 and 5, with the vectors in
world axes and about each link's centre of mass. Vectors have the steps last (`columns`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.physics.columns import (
    cross,
    dot,
    fixed_matrix,
    fixed_vector,
    product,
    rotation,
    skew,
    times,
)
from drop_physics.physics.tree import BASE, RATES, States, Tree


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Poses of all links. Lists have one entry per link; `rotations` has the base first."""

    tree: Tree
    rotations: list[Float64]
    """Rotations from each link's axes to world axes, shape (3, 3, n)."""
    centres: list[Float64]
    """Centres of mass [m], shape (3, n)."""
    pivots: list[Float64]
    """A point of each link on its joint axis [m], shape (3, n)."""
    axes: list[list[Float64]]
    """Axis of each rate of a link's joint, in world axes, shape (3, n)."""

    def __len__(self) -> int:
        """Return the number of states."""
        return int(self.centres[0].shape[1])

    def at(self, rows: slice | Int64) -> Kinematics:
        """Return the selected states."""
        return Kinematics(
            self.tree,
            [one[:, :, rows] for one in self.rotations],
            [one[:, rows] for one in self.centres],
            [one[:, rows] for one in self.pivots],
            [[axis[:, rows] for axis in axes] for axes in self.axes],
        )

    def position_m(self, link: int) -> Float64:
        """Return the centre of mass of a link [m], shape (n, 3)."""
        return self.centres[link + 1].T

    def matrix(self, link: int) -> Float64:
        """Return the rotation from a link's axes to world axes, shape (n, 3, 3)."""
        return np.moveaxis(self.rotations[link + 1], -1, 0)

    def point_m(self, link: int, local_m: Sequence[float] | Float64) -> Float64:
        """Return the position of a point on a link [m], shape (n, 3); `local_m` in link axes."""
        local = fixed_vector(self.rotations[link + 1], np.asarray(local_m, np.float64))
        return (self.centres[link + 1] + local).T


class LinkVelocities(NamedTuple):
    """Velocities of base and links, one entry per link: vectors in world axes, shape (3, n)."""

    spins: list[Float64]
    """Angular velocities [rad/s]."""
    velocities: list[Float64]
    """Velocities of the centres of mass [m/s]."""


def kinematics(tree: Tree, states: States) -> Kinematics:
    """Return the poses of all links from the base's pose and the joints' positions."""
    rotations = [rotation(states.orientation.T)]
    centres, pivots, axes = [np.ascontiguousarray(states.position_m.T)], [], []
    for link, parent in enumerate(tree.parents):
        unturned = fixed_matrix(rotations[parent + 1], rotation(tree.orientations[link]))
        pivot = centres[parent + 1] + fixed_vector(rotations[parent + 1], tree.positions_m[link])
        joint, axis = tree.joints[link], tree.axes[link]
        q = states.joints.T[tree.coordinates[link]]
        turned, along = unturned, []
        if joint == "revolute":
            along = [fixed_vector(unturned, axis)]
            turned = _turned(unturned, axis / np.linalg.norm(axis), q[0])
        elif joint == "prismatic":
            along = [fixed_vector(unturned, axis)]
            pivot = pivot + along[0] * q[0]
        elif joint == "spherical":
            turned = product(unturned, rotation(q))
            along = [turned[:, k] for k in range(3)]
        rotations.append(turned)
        pivots.append(pivot)
        centres.append(pivot + fixed_vector(turned, tree.centres_m[link]))
        axes.append(along)
    return Kinematics(tree, rotations, centres, pivots, axes)


def _turned(matrix: Float64, axis: Float64, angle: Float64) -> Float64:
    """Multiply matrices by rotations about a unit vector, by Rodrigues' formula."""
    c, s = np.cos(angle), np.sin(angle)
    turned = c * matrix + s * fixed_matrix(matrix, skew(axis))
    rest = (1.0 - c) * fixed_vector(matrix, axis)
    for k in range(3):
        if axis[k]:
            turned[:, k] += axis[k] * rest
    return np.asarray(turned)


def motion(kin: Kinematics, velocity: Float64) -> LinkVelocities:
    """Return the velocities of the links; `velocity` is u, shape (n, size)."""
    tree, u = kin.tree, np.ascontiguousarray(velocity.T)
    still = np.zeros((3, len(kin)))
    spins = [still if tree.fixed else u[0:3]]
    velocities = [still if tree.fixed else u[3:6]]
    for link, parent in enumerate(tree.parents):
        turning, sliding = across(kin, u, link)
        spin, moved = spins[parent + 1], velocities[parent + 1]
        moved = moved + cross(spin, kin.centres[link + 1] - kin.centres[parent + 1])
        if turning is not None:
            spin = spin + turning
            moved = moved + cross(turning, kin.centres[link + 1] - kin.pivots[link])
        if sliding is not None:
            moved = moved + sliding
        spins.append(spin)
        velocities.append(moved)
    return LinkVelocities(spins, velocities)


def across(kin: Kinematics, u: Float64, link: int) -> tuple[Float64 | None, Float64 | None]:
    """Return a link's spin and velocity relative to its parent, at the joint.

    `u` has the shape (size, n).
    """
    rates = u[kin.tree.rates[link]]
    if not len(rates):
        return None, None
    moved = sum(axis * rate for axis, rate in zip(kin.axes[link], rates, strict=True))
    moved = np.asarray(moved)
    return (None, moved) if kin.tree.joints[link] == "prismatic" else (moved, None)


def generalised(
    kin: Kinematics, forces: Mapping[int, Float64], torques: Mapping[int, Float64]
) -> Float64:
    """Return the generalised force of forces at centres of mass and torques, shape (n, size).

    Jᵀ f of each link is summed from the outermost links to the base (Featherstone, table 5.1).
    `forces` and `torques` map links to vectors of shape (3, n); links without an entry have none.
    """
    tree, n = kin.tree, len(kin)
    out = np.zeros((tree.size, n))
    force = {link: forces[link] for link in forces}
    torque = {link: torques[link] for link in torques}
    for link in reversed(range(tree.links)):
        f, t = force.pop(link, None), torque.pop(link, None)
        if f is None and t is None:
            continue
        f = np.zeros((3, n)) if f is None else f
        t = np.zeros((3, n)) if t is None else t
        parent, centre = tree.parents[link], kin.centres[link + 1]
        if RATES[tree.joints[link]]:
            out[tree.rates[link]] = _on_joint(kin, link, f, t + cross(centre - kin.pivots[link], f))
        t = t + cross(centre - kin.centres[parent + 1], f)
        force[parent] = force[parent] + f if parent in force else f
        torque[parent] = torque[parent] + t if parent in torque else t
    if not tree.fixed:
        out[0:3], out[3:6] = torque.get(BASE, 0.0), force.get(BASE, 0.0)
    return np.ascontiguousarray(out.T)


def _on_joint(kin: Kinematics, link: int, force: Float64, moment: Float64) -> list[Float64]:
    """Return the effort of a force, with its moment about the pivot, for each rate of a joint."""
    acting = force if kin.tree.joints[link] == "prismatic" else moment
    return [dot(axis, acting) for axis in kin.axes[link]]


def generalised_at_points(
    kin: Kinematics, step: Int64, link: Int64, force: Float64, point_m: Float64, torque: Float64
) -> Float64:
    """Return the generalised force of each of k forces, shape (k, size).

    It is Jᵀ f, with J at the points where the forces act, plus Jᵀ τ. Row i acts in the state
    `step[i]` on `link[i]`; force, point and torque are in world axes, shape (k, 3).
    """
    tree = kin.tree
    out = np.zeros((len(step), tree.size))
    links = link_numbers(link)
    for one in links:
        rows = np.flatnonzero(link == one) if len(links) > 1 else slice(None)
        at, f, t, x = step[rows], force[rows].T, torque[rows].T, point_m[rows].T
        for joint in tree.branch(one):
            if RATES[tree.joints[joint]]:
                slides = tree.joints[joint] == "prismatic"
                acting = f if slides else t + cross(x - kin.pivots[joint].take(at, axis=1), f)
                for k, axis in enumerate(kin.axes[joint]):
                    value = dot(axis.take(at, axis=1), acting)
                    out[rows, tree.rates[joint].start + k] = value
        if not tree.fixed:
            out[rows, 0:3] = (t + cross(x - kin.centres[0].take(at, axis=1), f)).T
            out[rows, 3:6] = f.T
    return out


def link_numbers(links: Int64) -> list[int]:
    """Return the distinct links in ascending order."""
    if len(links) and links.min() == links.max():  # as of bodies without joints
        return [int(links[0])]
    return [int(one) for one in np.unique(links)]


def spin_jacobian(kin: Kinematics, link: int, rows: Int64 | None = None) -> Float64:
    """Return the matrices that map u to the spin of a link, shape (n, 3, size).

    The matrices are those of all states, or of the states in `rows`.
    """
    tree = kin.tree
    rows = np.arange(len(kin)) if rows is None else rows
    out = np.zeros((len(rows), 3, tree.size))
    if not tree.fixed:
        out[:, :, 0:3] = np.eye(3)
    for joint in tree.branch(link):
        if tree.joints[joint] in ("revolute", "spherical"):
            for k, axis in enumerate(kin.axes[joint]):
                out[:, :, tree.rates[joint].start + k] = axis.take(rows, axis=1).T
    return out


def in_world(kin: Kinematics, link: int, step: Int64, vectors: Float64) -> Float64:
    """Rotate vectors from a link's axes, shape (k, 3), to world axes, in the states `step`."""
    return times(kin.rotations[link + 1][:, :, step], vectors.T).T
