"""Constraints that calls have created between bodies, and the forces that they exert."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.touching import rows_of
from drop_physics.physics.impulses import Forces
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.on_links import frame_axes
from drop_physics.physics.step_law import StepLaw
from drop_physics.physics.tree import RATES, States, Tree
from drop_physics.trace.calls import Call
from drop_physics.trace.events import At

Vector = tuple[float, ...]

FIXED, POINT, GEAR = 4, 5, 6
"""Values of `jointType` for `createConstraint`."""
LIMIT_N_S = 500.0
"""Default maximum impulse of a constraint in a step (`b3RigidBodyBase`)."""
TIMESTEP_S = 1 / 240
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
Poses = Callable[[int, Int64], tuple[Tree, States]]
"""Function that returns a body's tree, and its states at the start of the steps that lead to given
samples."""


@dataclass(frozen=True)
class ConstraintVersion:
    """A constraint with the settings made by a call, valid until the next call changes them."""

    at: At
    kind: int
    bodies: tuple[int, int]
    """Ids of the parent and child bodies."""
    links: tuple[int, int]
    pivots_m: tuple[Vector, Vector]
    """The pivot point in the axes of each link, or of the world."""
    orientations: tuple[Vector, Vector]
    """The constraint's frames in the axes of each link, or of the world: quaternions x, y, z, w."""
    made: Call
    """The call that created the constraint."""
    moved: int
    """The step of the last call that created the constraint, or moved one of its frames."""
    ratio: float = 1.0
    """Ratio of a gear constraint."""
    limit_n_s: float = LIMIT_N_S
    """Maximum impulse in a step along an axis [N s]: the call's force times the timestep at the
    time of the call."""
    limited: Call | None = None
    """The last call that changed the maximum force."""
    limited_since: int = -1
    """The step since which the force limit [N] is unchanged."""


class Pull(NamedTuple):
    """The other side of a constraint: another body, or an equality, with its name."""

    name: str
    other: int | None = None
    """Id of the other body."""
    other_link: int | None = None


class ConstraintEffect(NamedTuple):
    """The forces of all constraints on one body over n steps."""

    forces: Forces
    geared: Float64 | None
    """Impulses of gears, shape (n, joint_rates); None if there are no gears."""
    unknown: Flags
    """Whether a constraint acts that the law does not support, shape (n,)."""
    by_partner: Mapping[Pull, Forces]
    """The forces, by the body or equality that exerts them."""


class Constraints:
    """All constraints of a recording, filled chunk by chunk."""

    def __init__(self, law: StepLaw | None) -> None:
        self._law = law
        self._versions: dict[tuple[int, int], list[ConstraintVersion]] = {}
        """The versions of each constraint in chronological order, by client and the engine's id."""
        self._forces: Mapping[tuple[int, int], tuple[Int64, Float64]] = {}
        self._timesteps_s: dict[int, float] = {}
        """Current timestep of each client [s]."""

    def begin(self, forces: Mapping[tuple[int, int], tuple[Int64, Float64]]) -> None:
        """Start a chunk with its constraint forces; forget versions that no longer apply."""
        self._forces = forces
        self._versions = {key: versions[-1:] for key, versions in self._versions.items()}

    def create(self, call: Call, at: At, bodies: tuple[int, int]) -> None:
        """Add a call of `createConstraint`; `bodies` are the ids of parent and child."""
        values = call.values
        roles = "parent", "child"
        parent, child = (int(values.get(f"{role}LinkIndex", (-1,))[0]) for role in roles)
        pivots = [values.get(f"{role}FramePosition", (0.0,) * 3) for role in roles]
        turned = [_turned(values.get(f"{role}FrameOrientation", ())) for role in roles]
        held = ConstraintVersion(
            at,
            int(values.get("jointType", (-1,))[0]),
            bodies,
            (parent, child),
            (pivots[0], pivots[1]),
            (turned[0], turned[1]),
            call,
            call.at.step,
            limited_since=call.at.step,
        )
        self._versions.setdefault((call.client, int(call.result)), []).append(held)

    def change(self, call: Call) -> None:
        """Add a call of `changeConstraint`."""
        values, step = call.values, call.at.step
        versions = self._versions.get(
            (call.client, int(values.get("userConstraintUniqueId", (-1,))[0]))
        )
        if not versions:
            return
        held, pivot = versions[-1], values.get("jointChildPivot", ())
        moved = replace(
            held,
            pivots_m=(held.pivots_m[0], pivot if len(pivot) == 3 else held.pivots_m[1]),
            orientations=(
                held.orientations[0],
                _turned(values.get("jointChildFrameOrientation", ()), held.orientations[1]),
            ),
        )
        held = replace(moved, moved=step) if moved != held else held
        if "gearRatio" in values:
            held = replace(held, ratio=values["gearRatio"][0])
        limit_n_s = values.get("maxForce", (np.nan,))[0] * self.timestep_s(call.client)
        if np.isfinite(limit_n_s) and limit_n_s != held.limit_n_s:
            held = replace(held, limit_n_s=limit_n_s, limited=call, limited_since=step)
        if held != versions[-1]:
            versions.append(replace(held, at=call.at))

    def set_timestep(self, call: Call) -> None:
        """Note a call that may set the timestep, which is needed for limits in newtons."""
        if call.timestep_s is None:
            return
        self._timesteps_s[call.client] = call.timestep_s
        for (client, _), versions in self._versions.items():
            if client == call.client:
                versions.append(replace(versions[-1], at=call.at, limited_since=call.at.step))

    def timestep_s(self, client: int) -> float:
        """Return the current timestep of a simulation, after the calls so far [s]."""
        return self._timesteps_s.get(client, TIMESTEP_S)

    def in_steps(self) -> Iterator[tuple[list[ConstraintVersion], Int64, Float64]]:
        """Yield each version of a constraint in the latest chunk, with its steps and forces."""
        for key, (steps, forces) in self._forces.items():
            if key in self._versions and len(steps):
                yield self._versions[key], steps, forces

    def of_client(self, client: int) -> list[ConstraintVersion]:
        """Return the latest version of each constraint of a simulation."""
        return [versions[-1] for (of, _), versions in self._versions.items() if of == client]

    def is_only_one_on(self, body: int) -> bool:
        """Return whether exactly one constraint acts on a body."""
        holds = (True for versions in self._versions.values() if body in versions[-1].bodies)
        return len([*islice(holds, 2)]) == 1

    def gears(self, body: int) -> bool:
        """Return whether a gear constraint acts on a body in the latest chunk, or acted before."""
        held = (version for versions in self._versions.values() for version in versions)
        return any(each.kind == GEAR and body in each.bodies for each in held)

    def acting(self, sample: int) -> list[ConstraintVersion]:
        """Return the constraints that acted in the step to a given sample of the chunk."""
        found = []
        for key, versions in self._versions.items():
            before = [held for held in versions if held.at.step < sample]
            if before and key in self._forces and sample in self._forces[key][0]:
                found.append(before[-1])
        return found

    def on(
        self, body: int, tree: Tree, ends: Int64, before: States, timestep_s: Float64, poses: Poses
    ) -> ConstraintEffect:
        """Return the effect of all constraints on a body in the steps to samples `ends`, (n,)."""
        acting, geared, unknown = Forces(), None, np.zeros(len(ends), np.bool_)
        by_partner: dict[Pull, Forces] = {}
        if self._law is None:
            return ConstraintEffect(acting, geared, unknown, by_partner)
        for key, versions in self._versions.items():
            if not any(body in held.bodies for held in versions) or key not in self._forces:
                continue
            sampled, forces = self._forces[key]
            # A constraint has no forces in steps in which it did not exist.
            found, rows = rows_of(sampled, ends)
            which = np.searchsorted([h.at.step for h in versions], sampled[found], side="left") - 1
            for number, held in enumerate(versions):
                its = which == number
                if not its.any() or body not in held.bodies:
                    continue
                at, reported = rows[its], forces[found[its]]
                for side in range(2):
                    if held.bodies[side] != body:
                        continue
                    if held.kind == GEAR and _is_geared(tree, held.links[side]):
                        impulses = np.zeros((len(ends), tree.joint_rates))
                        impulses[at] = self._law.gear_impulses(
                            tree,
                            as_parent=side == 0,
                            link=held.links[side],
                            ratio=held.ratio,
                            reported=reported[:, 0],
                            timestep_s=timestep_s[at],
                        )
                        geared = impulses if geared is None else geared + impulses
                    elif held.kind in (FIXED, POINT):
                        kin = kinematics(tree, before.at(at))
                        axes = _axes(held, side, kin, ends[at], poses)
                        forces_on = self._law.constraint_forces(
                            kin,
                            kind="fixed" if held.kind == FIXED else "point2point",
                            as_parent=side == 0,
                            link=held.links[side],
                            pivot_m=held.pivots_m[side],
                            axes=axes,
                            reported=reported,
                        )
                        forces_on = replace(forces_on, step=at)
                        partner = Pull("", held.bodies[1 - side], held.links[1 - side])
                        known = by_partner.get(partner)
                        by_partner[partner] = forces_on if known is None else known.then(forces_on)
                        acting = acting.then(forces_on)
                    else:
                        unknown[at] = True
        return ConstraintEffect(acting, geared, unknown, by_partner)


def _is_geared(tree: Tree, link: int) -> bool:
    """Return whether a link's joint has one degree of freedom, which a gear needs."""
    return 0 <= link < tree.links and RATES[tree.joints[link]] == 1


def _turned(orientation: Vector, default: Vector = UPRIGHT) -> Vector:
    """Return a frame's orientation; PyBullet ignores a value that is not four numbers."""
    return orientation if len(orientation) == 4 else default


def _axes(
    held: ConstraintVersion, side: int, kin: Kinematics, ends: Int64, poses: Poses
) -> Float64:
    """Return the axes of the parent's frame in the world, shape (n, 3, 3)."""
    if held.kind == POINT:
        return np.zeros((len(ends), 3, 3))
    if side == 1:
        kin = kinematics(*poses(held.bodies[0], ends))
    return frame_axes(kin, held.links[0], held.orientations[0])
