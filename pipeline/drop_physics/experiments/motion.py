"""Compares the motion of all bodies between two runs."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.experiments.verdicts import THROWN, WILDER

POINTS = 3
"""Number of points by which a body's motion is described, so that spinning counts as motion."""


@dataclass(frozen=True)
class RunMotion:
    """Positions of all bodies at regularly sampled steps of a run."""

    stride: int
    """Number of steps between samples."""
    steps: int
    bodies: tuple[str, ...]
    astray: Mapping[str, float]
    """RMS deviations from the commands, by command, in the command's unit [m, rad, m/s, rad/s]."""
    positions_m: Float64
    """Positions of three points of each body [m], shape (states, bodies, 9); nan where a body does
    not exist."""
    step_s: float
    """Mean timestep [s]; 0 if the clock never advanced, or was reset."""

    @property
    def duration_s(self) -> float:
        """The simulated time [s]."""
        return self.steps * self.step_s

    @property
    def interval_s(self) -> float:
        """Time between samples [s], in steps if the timestep is unknown."""
        return self.stride * (self.step_s or 1.0)


def motion_of(told: Mapping[str, Any]) -> RunMotion:
    """Build a motion from the JSON message in which a run's process reports positions."""
    bodies = tuple(told["bodies"])
    flat = np.frombuffer(base64.b64decode(told["positions"]))
    size = len(bodies) * 3 * POINTS  # none where a run was stopped before it had a body
    return RunMotion(
        told["stride"],
        told["steps"],
        bodies,
        told["astray"],
        flat.reshape(len(flat) // size if size else 0, len(bodies), 3 * POINTS),
        told["step_s"],
    )


def _at_same_times(one: RunMotion, other: RunMotion) -> tuple[Float64, Float64]:
    """Return the positions of two runs at the samples of the one that has fewer per second."""
    interval_s = max(one.interval_s, other.interval_s)
    found = []
    for each in (one, other):
        times_s = np.arange(len(each.positions_m)) * each.interval_s
        count = int(times_s[-1] / interval_s + 0.5) + 1 if len(times_s) else 0
        rows = np.rint(np.arange(count) * interval_s / each.interval_s).astype(int)
        found.append(each.positions_m[rows[rows < len(times_s)]])
    return found[0], found[1]


def apart_m(one: Sequence[RunMotion], other: Sequence[RunMotion]) -> dict[str, float]:
    """Return the RMS distance of each body between two runs [m], over their common time.

    Infinite for a body that exists in only one of the runs.
    """
    far: dict[str, float] = {}
    for first, second in zip(one, other, strict=False):
        a, b = _at_same_times(first, second)
        states, bodies = min(len(a), len(b)), min(a.shape[1], b.shape[1])
        with np.errstate(all="ignore"):
            squared = np.sum((a[:states, :bodies] - b[:states, :bodies]) ** 2, axis=2) / POINTS
            squared = squared[:, ~np.isnan(squared).all(axis=0)] if states else squared
        names = [
            name
            for number, name in enumerate(first.bodies[:bodies])
            if states and not np.isnan(a[:states, number] - b[:states, number]).all()
        ]
        for name, value in zip(names, np.sqrt(np.nanmean(squared, axis=0)), strict=True):
            far[name] = math.hypot(far.get(name, 0.0), float(value))
        for name in (*first.bodies[bodies:], *second.bodies[bodies:]):
            far[name] = math.inf
    return far


def worse(one: Sequence[RunMotion], other: Sequence[RunMotion]) -> list[str]:
    """Return which commands a run follows less well than another."""
    return [
        name
        for first, second in zip(one, other, strict=False)
        for name, far in second.astray.items()
        if name in first.astray and far > WORSE * first.astray[name] + NEXT_TO_NOTHING
    ]


def side_m(far: Mapping[str, float], besides: Sequence[str] = ()) -> float:
    """Return the RMS change of all motion except that of the given bodies [m]."""
    others = [value for name, value in far.items() if name not in besides]
    return math.sqrt(sum(value * value for value in others))


def size_m(motion: RunMotion) -> float:
    """Return the diagonal of the box that contains all motion of a run [m]."""
    points = motion.positions_m.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    return float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0


def fastest(motions: Sequence[RunMotion]) -> tuple[str, float]:
    """Return the fastest body of a run, and the mean speed between two samples [m/s]."""
    found = [("", 0.0)]
    for each in motions:
        if each.step_s and len(each.positions_m) > 1:
            moved_m = np.linalg.norm(np.diff(each.positions_m[:, :, :POINTS], axis=0), axis=2)
            speeds = np.nan_to_num(moved_m).max(axis=0) / each.interval_s
            found += zip(each.bodies, map(float, speeds), strict=True)
    return max(found, key=lambda each: each[1])


def thrown(one: Sequence[RunMotion], other: Sequence[RunMotion]) -> tuple[str, float] | None:
    """Return the fastest body of the second run, and its speed [m/s]; None if it is not thrown.

    A body counts as thrown by the thresholds of `verdicts`: if it is faster than 1 m/s, and at
    least twice as fast as the fastest body of the first run.
    """
    body, speed = fastest(other)
    return (body, speed) if speed > max(THROWN["m"], WILDER * fastest(one)[1]) else None


def is_still(far: Mapping[str, float]) -> bool:
    """Return whether no body's motion differs from that in the reference run."""
    return all(value <= SAME_M for value in far.values())


def same(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Return whether two runs are equally far from a reference run, in all bodies to 1 %."""
    if one.keys() != other.keys():
        return False
    return all(math.isclose(one[name], other[name], rel_tol=SAME, abs_tol=SAME_M) for name in one)


WORSE, NEXT_TO_NOTHING = 2.0, 1e-3
"""A command counts as followed worse if its deviation grows by this factor, plus this constant
[rad, m; rad/s, m/s]: a servo that now lifts an object, instead of leaving it on the table, droops a
little more."""
SAME, SAME_M = 0.01, 1e-7
"""Largest relative and absolute difference of equal outcomes [1, m]."""
