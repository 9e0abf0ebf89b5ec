"""The way of one body through a script's simulations: what each step began with and led to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.analysis.general.samples import motion_of
from pipeline.laws.base import Motion
from pipeline.laws.rotations import rotate
from pipeline.seen import At, Body, Dynamics, OfBody, Seen, Settings
from pipeline.states import BASE

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Epoch:
    """Samples of a body, one after the other, that the same settings led to."""

    rows: slice
    life: int
    """Which body of its number it is, from 0 on."""
    settings: Settings
    """Of the engine."""
    dynamics: Dynamics
    """What the engine reported of the body."""
    given: Mapping[str, Any]
    """What calls had told of it in its life, by argument of `changeDynamics`."""


@dataclass(frozen=True)
class Track:
    """The samples of one body's base, or of its first link that can move; a row for each."""

    body: Body
    steps: Int64
    motion: Motion
    before: Motion
    """What the step that led to each sample began with: the sample before, or what a call made of
    it; of a sample that no step led to, itself."""
    led: Flags
    """Whether a step led to each sample, from a state that is known."""
    put: Flags
    """Whether that step began with what a call had made of the body."""
    constrained: Flags
    """Whether a constraint held it in that step."""
    force_n: Float64
    """What pushed it from outside in that step, world axes, (samples, 3)."""
    torque_n_m: Float64
    """The same about its centre of mass."""
    epochs: Sequence[Epoch]
    """All samples, in order; of one that no step led to, what was known first."""

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.steps)


def tracks_of(seen: Seen) -> Iterator[Track]:
    """Yield the track of every body that has samples, by number."""
    for number, body in sorted(seen.bodies.items()):
        # The base may stand fast where joints move the rest.
        rows = seen.parts.get((number, min(body.moving, default=BASE)))
        if rows is not None and not body.soft:
            yield _track(seen, body, rows)


def _track(seen: Seen, body: Body, rows: pl.DataFrame) -> Track:
    steps, motion = rows["step"].to_numpy(), motion_of(rows)
    told = seen.by_body[body.number]
    life = _life_of(told, steps)
    led = (np.diff(steps, prepend=steps[0]) == 1) & (np.diff(life, prepend=0) == 0)
    before, put = motion.before(), np.zeros(len(steps), dtype=bool)
    before = Motion(*(np.where(led[:, None], one, other) for one, other in _pairs(before, motion)))
    for one in told.puts:
        row = _row_after(steps, one.at)
        if one.counts and row is not None:
            base = one.states[one.states["link"] == BASE]
            put[row] = led[row] = True
            for name in NUMBERS:
                getattr(before, name)[row] = base[name][0]
    force_n, torque_n_m = _pushes(told, steps, motion, before)
    return Track(
        body,
        steps,
        motion,
        before,
        led,
        put,
        _constrained(seen, told, steps),
        force_n,
        torque_n_m,
        list(_epochs(seen, body, steps, led)),
    )


NUMBERS = ("position_m", "orientation", "velocity_m_s", "spin_rad_s")
"""Of a motion."""


def _life_of(told: OfBody, steps: Int64) -> NDArray[np.intp]:
    """Return which of the bodies of a number each step is of: a script may load it again.

    The sample of the step at which one came is its own where none was taken before.
    """
    first = [one.at.step + one.sampled for one in told.came]
    return np.maximum(np.searchsorted(first, steps, side="right") - 1, 0)


def _pairs(one: Motion, other: Motion) -> Iterator[tuple[Float64, Float64]]:
    return ((getattr(one, name), getattr(other, name)) for name in NUMBERS)


def _row_after(steps: Int64, at: At) -> int | None:
    """Return the sample that the step after a moment led to."""
    row = int(np.searchsorted(steps, at.step + 1))
    return row if row < len(steps) and steps[row] == at.step + 1 else None


def _pushes(told: OfBody, steps: Int64, motion: Motion, before: Motion) -> tuple[Float64, Float64]:
    """Return forces [N] and torques about the centre of mass [N m] of each step, world axes.

    What is given in the body's axes turns with it; a force there acts at a point that is given from
    the centre of mass (`processApplyExternalForceCommand`). Both are worked out where the body is
    at the call: one that is put elsewhere after it keeps them.
    """
    force_n, torque_n_m = np.zeros((2, len(steps), 3))
    life = _life_of(told, steps)
    for push in told.pushes:
        row = _row_after(steps, push.at)
        if row is None or order(told.came[life[row]].at) > order(push.at):
            continue  # what was pushed has gone before the step
        position_m, turn = before.position_m[row], before.orientation[row : row + 1]
        earlier = [
            one
            for one in told.puts
            if one.at.step == push.at.step and order(one.at) < order(push.at)
        ]
        if earlier:
            base = earlier[-1].states[earlier[-1].states["link"] == BASE]
            position_m, turn = base["position_m"][0], base["orientation"]
        elif row and steps[row - 1] == push.at.step:
            position_m, turn = motion.position_m[row - 1], motion.orientation[row - 1 : row]
        vector = np.array([push.vector])
        arm_m = np.array([push.position_m])
        if push.in_world_axes:
            arm_m = arm_m - position_m
        else:
            vector, arm_m = rotate(turn, vector), rotate(turn, arm_m)
        if push.torque:
            torque_n_m[row] += vector[0]
        else:
            force_n[row] += vector[0]
            torque_n_m[row] += np.cross(arm_m, vector)[0]
    return force_n, torque_n_m


def _constrained(seen: Seen, told: OfBody, steps: Int64) -> Flags:
    """Return in which steps a constraint held a body; what comes anew is held by none."""
    found = np.zeros(len(steps), dtype=bool)
    for one in told.constraints:
        ends = [other.at.step for other in told.came if order(other.at) > order(one.at)]
        ends += [
            other.at.step
            for other in seen.constraints
            if (other.client, other.number, other.there) == (one.client, one.number, False)
            and order(other.at) > order(one.at)
        ]
        found |= (steps > one.at.step) & (steps <= min(ends, default=steps[-1]))
    return found


def order(at: At) -> tuple[int, int]:
    """Return what moments are sorted by."""
    return at.step, at.call


def _epochs(seen: Seen, body: Body, steps: Int64, led: Flags) -> Iterator[Epoch]:
    settings = [one for one in seen.settings if one.client == body.client]
    told_of = seen.by_body[body.number]
    dynamics, given, came = told_of.dynamics, told_of.given, told_of.came
    # Of a step counts what was told until it began; of a first sample, what is told there.
    began = np.where(led, steps - 1, steps)
    held = [[one.at.step for one in each] for each in (settings, dynamics, given)]
    known = [np.searchsorted(each, began, side="right") - 1 for each in held]
    told = np.array([*known, _life_of(told_of, steps)])
    changes = np.flatnonzero((np.diff(told, axis=1) != 0).any(axis=0)) + 1
    bounds = [0, *changes.tolist(), len(steps)]
    for first, end in pairwise(bounds):
        of_engine, of_body, last_given, life = told[:, first].tolist()
        values: dict[str, Any] = {}
        for one in given[: last_given + 1]:
            if order(one.at) >= order(came[life].at):
                values |= {
                    name: value for name, value in one.values.items() if _counts(name, value)
                }
        yield Epoch(slice(first, end), life, settings[of_engine], dynamics[of_body], values)


def _counts(name: str, value: object) -> bool:
    """Whether a value changes something: PyBullet leaves a damping as it is that is told -1."""
    return not (name.endswith("Damping") and isinstance(value, int | float) and value < 0)
