"""The samples of one body in a script's simulations: what each step began with and led to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.general.balance import Pushes
from drop_physics.analysis.general.samples import motion_of
from drop_physics.laws.base import Motion
from drop_physics.laws.lookup import RIGID
from drop_physics.laws.rotations import rotate
from drop_physics.seen.events import At, Body, Dynamics, Settings, order
from drop_physics.seen.history import OfBody, Seen
from drop_physics.seen.poses import MOTION
from drop_physics.states import BASE

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Epoch:
    """Consecutive samples of a body under the same settings."""

    rows: slice
    life: int
    """Which of the bodies with its number it is, from 0."""
    settings: Settings
    """Of the engine."""
    dynamics: Dynamics
    """What the engine reported about the body."""
    given: Mapping[str, Any]
    """What calls set for it since it appeared, by argument of `changeDynamics`."""
    stands: bool
    """Whether it is a btRigidBody that was added without mass: even if it gets mass later, the
    engine does not integrate it (`btDiscreteDynamicsWorld::addRigidBody`)."""


@dataclass(frozen=True)
class Track:
    """The samples of one body's base, or of its first link that can move; a row for each."""

    body: Body
    steps: Int64
    motion: Motion
    before: Motion
    """What the step that led to each sample began with: the sample before, or what a call set; a
    sample that no step led to has itself before it."""
    led: Flags
    """Whether a step led to each sample, from a known state."""
    put: Flags
    """Whether that step began with a state that a call had set."""
    constrained: Flags
    """Whether a constraint held it in that step."""
    pushes: Pushes
    """What the script applied in that step."""
    epochs: Sequence[Epoch]
    """All samples, in order; one that no step led to has the first known settings."""

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.steps)


def tracks_of(seen: Seen) -> Iterator[Track]:
    """Yield the track of every body that has samples, by number."""
    for number, body in sorted(seen.bodies.items()):
        parts = [seen.parts.get((number, link)) for link in body.moving or (BASE,)]
        recorded = [rows for rows in parts if rows is not None]
        if recorded and not body.soft:
            # The base may be fixed while joints move the rest, and be moved by a call later.
            yield _track(seen, body, max(recorded, key=len))


def _track(seen: Seen, body: Body, rows: pl.DataFrame) -> Track:
    steps, motion = rows["step"].to_numpy(), motion_of(rows)
    record = seen.by_body[body.number]
    life = life_of(record, steps)
    led = (np.diff(steps, prepend=steps[0]) == 1) & (np.diff(life, prepend=0) == 0)
    before, put = motion.at(np.arange(len(steps)) - led), np.zeros(len(steps), dtype=bool)
    for each in record.puts:
        row = _row_after(steps, each.at)
        if each.counts and row is not None:
            put[row] = led[row] = True
            for name, part in MOTION.items():
                getattr(before, name)[row] = each.base[part]
    return Track(
        body,
        steps,
        motion,
        before,
        led,
        put,
        _constrained(seen, record, steps),
        _pushes(record, steps, motion, before),
        list(_epochs(seen, body, steps, led)),
    )


POSE = ("position_m", "orientation")
NUMBERS = (*POSE, "velocity_m_s", "spin_rad_s")
"""Of a motion."""


def life_of(record: OfBody, steps: Int64) -> NDArray[np.intp]:
    """Return to which of the bodies with a number each step belongs: a script may load it again.

    The sample at the step at which a body appeared is its own if none was taken before.
    """
    first = [each.at.step + each.sampled for each in record.came]
    return np.maximum(np.searchsorted(first, steps, side="right") - 1, 0)


def _row_after(steps: Int64, at: At) -> int | None:
    """Return the sample that the step after a moment led to."""
    row = int(np.searchsorted(steps, at.step + 1))
    return row if row < len(steps) and steps[row] == at.step + 1 else None


def _pushes(record: OfBody, steps: Int64, motion: Motion, before: Motion) -> Pushes:
    """Return the forces and torques of each step.

    A vector in the body's axes turns with it; its point is then relative to the centre of mass
    (`processApplyExternalForceCommand`). Both are computed from where the body is at the call, and
    stay if it is put elsewhere afterwards.
    """
    force_n, torque_n_m = np.zeros((2, len(steps), 3))
    force_scale_n, torque_scale_n_m = np.zeros((2, len(steps)))
    life = life_of(record, steps)
    for push in record.pushes:
        row = _row_after(steps, push.at)
        if row is None or order(record.came[life[row]].at) > order(push.at):
            continue  # the pushed body was removed before the step
        position_m, turn = before.position_m[row], before.orientation[row : row + 1]
        earlier = [
            put
            for put in record.puts
            if put.at.step == push.at.step and order(put.at) < order(push.at)
        ]
        if earlier:
            base = earlier[-1].base
            position_m, turn = base[:3], base[None, 3:7]
        elif row and steps[row - 1] == push.at.step:
            position_m, turn = motion.position_m[row - 1], motion.orientation[row - 1 : row]
        vector = np.array([push.vector])
        arm_m = np.array([push.position_m])
        size, scale_m = np.linalg.norm(vector), np.linalg.norm(arm_m)
        if push.in_world_axes:
            arm_m = arm_m - position_m
            scale_m += np.linalg.norm(position_m)
        else:
            vector, arm_m = rotate(turn, vector), rotate(turn, arm_m)
        if push.torque:
            torque_n_m[row] += vector[0]
            torque_scale_n_m[row] += size
        else:
            force_n[row] += vector[0]
            torque_n_m[row] += np.cross(arm_m, vector)[0]
            force_scale_n[row] += size
            torque_scale_n_m[row] += size * scale_m
    return Pushes(force_n, torque_n_m, force_scale_n, torque_scale_n_m)


def _constrained(seen: Seen, record: OfBody, steps: Int64) -> Flags:
    """Return in which steps a constraint held a body; none holds a body that is loaded again."""
    held = np.zeros(len(steps), dtype=bool)
    for constraint in record.constraints:
        began = order(constraint.at)
        ends = [each.at.step for each in record.came if order(each.at) > began]
        ends += [
            other.at.step
            for other in seen.constraints
            if (other.client, other.number) == (constraint.client, constraint.number)
            and not other.there
            and order(other.at) > began
        ]
        held |= (steps > constraint.at.step) & (steps <= min(ends, default=steps[-1]))
    return held


def _epochs(seen: Seen, body: Body, steps: Int64, led: Flags) -> Iterator[Epoch]:
    settings = [each for each in seen.settings if each.client == body.client]
    record = seen.by_body[body.number]
    dynamics, given, came = record.dynamics, record.given, record.came
    # What was set before a step began applies to it; to a first sample, what was set by then.
    began = np.where(led, steps - 1, steps)
    starts = [[each.at.step for each in events] for events in (settings, dynamics, given)]
    known = [np.searchsorted(each, began, side="right") - 1 for each in starts]
    which = np.array([*known, life_of(record, steps)])
    changes = np.flatnonzero((np.diff(which, axis=1) != 0).any(axis=0)) + 1
    bounds = [0, *changes.tolist(), len(steps)]
    for first, end in pairwise(bounds):
        of_engine, of_body, last_given, life = which[:, first].tolist()
        values: dict[str, Any] = {}
        for each in given[: last_given + 1]:
            if order(each.at) >= order(came[life].at):
                values |= {
                    name: value for name, value in each.values.items() if _counts(name, value)
                }
        added = next(each for each in dynamics if order(each.at) >= order(came[life].at)).reported
        stands = bool(added["kind"][0] == RIGID and added["mass_kg"][0] == 0)
        yield Epoch(slice(first, end), life, settings[of_engine], dynamics[of_body], values, stands)


def _counts(name: str, value: object) -> bool:
    """Whether a value changes something: PyBullet ignores a negative damping or limit."""
    ignored = isinstance(value, int | float) and not value >= 0
    return not (name.endswith(("Damping", "maxJointVelocity")) and ignored)
