"""MuJoCo's kinematic trees from a model's constants: poses, momentum and weight without MuJoCo.

A body has no joint, one, or several, one after the other; a joint is free, a ball, a slide or a
hinge (`mj_kinematics`). A degree of freedom moves its body and all that this carries: a velocity at
a point and a spin. So M u is found without M: the bodies' velocities by u, their momenta, and back
along the trees the share of each degree of freedom (`mj_rne` without forces does the same).

Trees of the same structure are one batch, and so are steps: arrays run over steps and copies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from drop_physics.engines.mujoco.described import BALL, FREE, SLIDE
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

DOFS, COORDINATES = (6, 3, 1, 1), (7, 4, 1, 1)
"""Number of degrees of freedom per joint type, and number of coordinates in `qpos`."""


@dataclass(frozen=True)
class _Joint:
    """A joint, in all copies of a kinematic tree."""

    kind: int
    numbers: Int64
    """The joint's index in the model for each copy, shape (c,)."""
    coordinates: Int64
    dofs: Int64
    """The index of the joint's first degree of freedom for each copy, shape (c,)."""


@dataclass(frozen=True)
class _Kind:
    """The kinematic trees that share one structure."""

    bodies: Int64
    """Body indices of each copy, parents first, shape (c, b)."""
    parents: tuple[int, ...]
    """Index of each body's parent within the tree; -1 for the first body, whose parent is fixed."""
    joints: tuple[tuple[_Joint, ...], ...]
    """The joints of each body."""


@dataclass(frozen=True)
class _DofMotion:
    """The motion that a degree of freedom gives to the bodies it moves, at all steps and copies."""

    spin: Float64
    velocity: Float64
    """Velocity at the tree's first body, shape (n, c, 3), like `spin`."""
    dofs: Int64
    body: int
    """Index of the degree of freedom's body within the tree."""


@dataclass(frozen=True)
class _Placed:
    """Poses of the trees of one structure, at a number of steps."""

    kind: _Kind
    positions: list[Float64]
    quaternions: list[Float64]
    """The poses of each body, shapes (n, c, 3) and (n, c, 4)."""
    motions: list[_DofMotion]
    arms: list[Float64]
    """Vector from the first body to each centre of mass [m], shape (n, c, 3)."""


class MujocoTrees:
    """Kinematics of a model's bodies.

    Parameters
    ----------
    arrays
        The model's constants by MuJoCo's names: `body_…`, `jnt_…`, `dof_armature`, `qpos0`, and
        `tendon_…`, `wrap_…` where there are tendons with inertia.
    """

    def __init__(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self._m = arrays
        self._parents: list[int] = arrays["body_parentid"].tolist()
        self.nbody, self.nv = len(self._parents), int(np.size(arrays.get("dof_bodyid", ())))
        self._masses, self._inertias = arrays["body_mass"], arrays["body_inertia"]
        self._armature = np.asarray(arrays.get("dof_armature", np.zeros(self.nv)))
        self._kinds = self._kinds_of_trees()
        self._tendons = self._tendons_with_inertia()

    @property
    def is_complete(self) -> bool:
        """Return whether all inertia is known; a spatial tendon's is not."""
        return self._tendons is not None

    # -- structure --------------------------------------------------------------------------------

    def _kinds_of_trees(self) -> list[_Kind]:
        """Return the kinematic trees, grouped by structure."""
        m = self._m
        trees: dict[int, list[int]] = {}
        root_of = [-1] * self.nbody
        for body in range(1, self.nbody):
            root_of[body] = root_of[self._parents[body]]
            if root_of[body] < 0 and m["body_jntnum"][body]:
                root_of[body] = body
            if root_of[body] >= 0:
                trees.setdefault(root_of[body], []).append(body)
        alike: dict[tuple[Any, ...], list[list[int]]] = {}
        for bodies in trees.values():
            place = {body: number for number, body in enumerate(bodies)}
            structure = tuple(
                (
                    place.get(self._parents[body], -1),
                    *(int(m["jnt_type"][joint]) for joint in self._joints_of(body)),
                )
                for body in bodies
            )
            alike.setdefault(structure, []).append(bodies)
        return [
            _Kind(
                np.array(copies),
                tuple(parent for parent, *_ in structure),
                tuple(
                    tuple(
                        self._joint([copy[place] for copy in copies], which, kind)
                        for which, kind in enumerate(kinds)
                    )
                    for place, (_, *kinds) in enumerate(structure)
                ),
            )
            for structure, copies in alike.items()
        ]

    def _joints_of(self, body: int) -> range:
        first = int(self._m["body_jntadr"][body])
        return range(first, first + int(self._m["body_jntnum"][body]))

    def _joint(self, bodies: list[int], which: int, kind: int) -> _Joint:
        numbers = np.array([self._joints_of(body)[which] for body in bodies])
        m = self._m
        return _Joint(kind, numbers, m["jnt_qposadr"][numbers], m["jnt_dofadr"][numbers])

    def _tendons_with_inertia(self) -> list[tuple[float, Float64]] | None:
        """Return inertia and Jacobian of each tendon with inertia; None if any is unknown."""
        m, found = self._m, []
        for tendon in np.flatnonzero(m.get("tendon_armature", ())).tolist():
            jacobian = np.zeros(self.nv)
            first = int(m["tendon_adr"][tendon])
            for wrap in range(first, first + int(m["tendon_num"][tendon])):
                if m["wrap_type"][wrap] != 1:  # `mjWRAP_JOINT`
                    return None
                dof = m["jnt_dofadr"][m["wrap_objid"][wrap]]
                jacobian[dof] += m["wrap_prm"][wrap]
            found.append((float(m["tendon_armature"][tendon]), jacobian))
        return found

    # -- poses ------------------------------------------------------------------------------------

    def poses(
        self, qpos: Float64, mocap: tuple[Float64, Float64] | None = None
    ) -> tuple[Float64, Float64]:
        """Return positions [m] and quaternions (real part first) of all bodies.

        Parameters
        ----------
        qpos
            Coordinates at some steps, shape (n, nq).
        mocap
            Positions and quaternions of mocap bodies, shapes (n, k, 3) and (n, k, 4); None leaves
            them where the model has them.
        """
        positions, quaternions = self._standing(len(qpos), mocap)
        for placed in self._placed(qpos, positions, quaternions):
            for place, (position, quaternion) in enumerate(
                zip(placed.positions, placed.quaternions, strict=True)
            ):
                positions[:, placed.kind.bodies[:, place]] = position
                quaternions[:, placed.kind.bodies[:, place]] = quaternion
        return positions, _normed(quaternions)

    def _standing(self, n: int, mocap: tuple[Float64, Float64] | None) -> tuple[Float64, Float64]:
        """Return the poses of the bodies that no joint moves; other bodies' poses are zero."""
        m = self._m
        positions, quaternions = np.zeros((n, self.nbody, 3)), np.zeros((n, self.nbody, 4))
        quaternions[:, 0, 0] = 1.0
        moving = {body for kind in self._kinds for body in kind.bodies.ravel().tolist()}
        for body in range(1, self.nbody):
            if body in moving:
                continue
            parent, number = self._parents[body], int(m["body_mocapid"][body])
            if number >= 0 and mocap is not None:
                positions[:, body] = mocap[0][:, number]
                quaternions[:, body] = _normed(mocap[1][:, number])
                continue
            positions[:, body] = positions[:, parent] + turned(
                quaternions[:, parent], m["body_pos"][body]
            )
            quaternions[:, body] = product(quaternions[:, parent], m["body_quat"][body])
        return positions, quaternions

    def _placed(self, qpos: Float64, positions: Float64, quaternions: Float64) -> list[_Placed]:
        """Return the poses of the trees at given steps, given the poses of the fixed bodies."""
        return [self._place(kind, qpos, positions, quaternions) for kind in self._kinds]

    def _place(
        self, kind: _Kind, qpos: Float64, positions: Float64, quaternions: Float64
    ) -> _Placed:
        m, origin = self._m, np.zeros(0)
        found = _Placed(kind, [], [], [], [])
        anchored: list[tuple[Float64, Float64 | None, Int64, int]] = []
        for place, joints in enumerate(kind.joints):
            bodies, parent = kind.bodies[:, place], kind.parents[place]
            if parent < 0:
                outside = np.array(self._parents)[bodies]
                at, turn = positions[:, outside], quaternions[:, outside]
            else:
                at, turn = found.positions[parent], found.quaternions[parent]
            at = at + turned(turn, m["body_pos"][bodies])
            turn = product(turn, m["body_quat"][bodies])
            for joint in joints:
                at, turn, moves = self._through(joint, qpos, at, turn)
                anchored += [(*move, place) for move in moves]
            turn = _normed(turn)
            if place == 0:
                origin = at
            found.positions.append(at)
            found.quaternions.append(turn)
            found.arms.append(at + turned(turn, m["body_ipos"][bodies]) - origin)
        for axis, anchor, dofs, place in anchored:
            if anchor is None:
                found.motions.append(_DofMotion(np.zeros_like(axis), axis, dofs, place))
            else:
                velocity = np.cross(axis, origin - anchor)
                found.motions.append(_DofMotion(axis, velocity, dofs, place))
        return found

    def _through(
        self, joint: _Joint, qpos: Float64, at: Float64, turn: Float64
    ) -> tuple[Float64, Float64, list[tuple[Float64, Float64 | None, Int64]]]:
        """Return the pose after a joint, and axis, anchor and dof indices of its motions.

        An anchor of None is that of a motion along its axis.
        """
        m, q = self._m, joint.coordinates
        if joint.kind == FREE:
            at = qpos[:, q[:, None] + np.arange(3)]
            turn = _normed(qpos[:, q[:, None] + np.arange(3, 7)])
            moves: list[tuple[Float64, Float64 | None, Int64]] = [
                (np.broadcast_to(np.eye(3)[axis], at.shape), None, joint.dofs + axis)
                for axis in range(3)
            ]
            return at, turn, moves + _around(turn, at, joint.dofs + 3)
        local, axis = m["jnt_pos"][joint.numbers], m["jnt_axis"][joint.numbers]
        anchor = at + turned(turn, local)
        if joint.kind == BALL:
            turn = product(turn, _normed(qpos[:, q[:, None] + np.arange(4)]))
            return anchor - turned(turn, local), turn, _around(turn, anchor, joint.dofs)
        along = turned(turn, axis)
        moved = (qpos[:, q] - m["qpos0"][q])[..., None]
        if joint.kind == SLIDE:
            return at + along * moved, turn, [(along, None, joint.dofs)]
        half = np.concatenate([np.cos(moved / 2), np.sin(moved / 2) * axis], axis=-1)
        turn = product(turn, half)
        return anchor - turned(turn, local), turn, [(along, anchor, joint.dofs)]

    # -- momentum and weight ----------------------------------------------------------------------

    def momentum(
        self,
        qpos: Float64,
        velocity: Float64,
        mocap: tuple[Float64, Float64] | None = None,
    ) -> Float64:
        """Return the generalised momentum M u, shape (n, nv); `velocity` is u, of that shape."""
        found = self._armature * velocity
        for inertia, jacobian in self._tendons or ():
            found += inertia * (velocity @ jacobian)[:, None] * jacobian
        for placed in self._placed(qpos, *self._standing(len(qpos), mocap)):
            kind = placed.kind
            spins: list[Float64] = []
            speeds: list[Float64] = []
            for place, parent in enumerate(kind.parents):
                spin = spins[parent] if parent >= 0 else np.zeros_like(placed.positions[0])
                speed = speeds[parent] if parent >= 0 else np.zeros_like(placed.positions[0])
                for motion in placed.motions:
                    if motion.body == place:
                        rate = velocity[:, motion.dofs, None]
                        spin = spin + motion.spin * rate
                        speed = speed + motion.velocity * rate
                spins.append(spin)
                speeds.append(speed)
            linear, angular = [], []
            for place, arm in enumerate(placed.arms):
                bodies = kind.bodies[:, place]
                push = self._masses[bodies, None] * (speeds[place] + np.cross(spins[place], arm))
                axes = product(placed.quaternions[place], self._m["body_iquat"][bodies])
                turn = turned(axes, self._inertias[bodies] * turned(_inverse(axes), spins[place]))
                linear.append(push)
                angular.append(turn + np.cross(arm, push))
            _add_shares(found, placed, linear, angular)
        return found

    def weight(
        self,
        qpos: Float64,
        gravity_m_s2: Float64,
        mocap: tuple[Float64, Float64] | None = None,
    ) -> Float64:
        """Return the generalised weight [N or N m], shape (n, nv)."""
        found = np.zeros((len(qpos), self.nv))
        for placed in self._placed(qpos, *self._standing(len(qpos), mocap)):
            linear, angular = [], []
            for place, arm in enumerate(placed.arms):
                push = self._masses[placed.kind.bodies[:, place], None] * gravity_m_s2
                linear.append(np.broadcast_to(push, arm.shape))
                angular.append(np.cross(arm, push))
            _add_shares(found, placed, linear, angular)
        return found


def _around(
    turn: Float64, anchor: Float64, dofs: Int64
) -> list[tuple[Float64, Float64 | None, Int64]]:
    """Return the rotations about a body's own three axes."""
    return [(turned(turn, np.eye(3)[axis]), anchor, dofs + axis) for axis in range(3)]


def _add_shares(
    found: Float64, placed: _Placed, linear: list[Float64], angular: list[Float64]
) -> None:
    """Add each degree of freedom's share of the bodies' momenta, from the leaves to the root."""
    for place in range(len(placed.kind.parents) - 1, -1, -1):
        for motion in placed.motions:
            if motion.body == place:
                share = motion.velocity * linear[place] + motion.spin * angular[place]
                found[:, motion.dofs] += share.sum(axis=-1)
        parent = placed.kind.parents[place]
        if parent >= 0:
            linear[parent] = linear[parent] + linear[place]
            angular[parent] = angular[parent] + angular[place]


def product(a: Float64, b: Float64) -> Float64:
    """Return the products of quaternions, real part first, shape (…, 4)."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def turned(quaternions: Float64, vectors: Float64) -> Float64:
    """Rotate vectors by quaternions, real part first, shape (…, 3)."""
    axis = quaternions[..., 1:]
    once = np.cross(axis, vectors)
    return np.asarray(
        vectors + 2.0 * (quaternions[..., :1] * once + np.cross(axis, once)), dtype=np.float64
    )


def _inverse(quaternions: Float64) -> Float64:
    """Return the inverses of quaternions."""
    return np.asarray(quaternions * np.array([1.0, -1.0, -1.0, -1.0]), dtype=np.float64)


def _normed(quaternions: Float64) -> Float64:
    """Normalize quaternions to length 1."""
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True))
