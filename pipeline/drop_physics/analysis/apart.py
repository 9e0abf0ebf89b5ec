"""How far two runs of one script are apart, and how that grows and converges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.checking.pairing import pairing
from drop_physics.analysis.drop.convergence import (
    grid_convergence_index,
    richardson,
    solution_order,
)
from drop_physics.analysis.times import Times
from drop_physics.seen.events import Body
from drop_physics.seen.history import Seen
from drop_physics.seen.poses import MOTION_COLUMNS

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

APART = 1e-6
"""Runs count as apart from here on [m, rad]."""
LOST = 1e-3
"""Where a displacement has grown so far, the outcome is one of many [m, rad]."""
LEAST_GROWTH = 100.0
"""Factor below which growth has no rate: a displacement also drifts."""


@dataclass(frozen=True)
class Distance:
    """A distance between two runs."""

    value: float
    unit: str
    """`m`, of positions; `rad`, of orientations and joints that turn."""
    body: str
    joint: str | None
    time_s: float


@dataclass(frozen=True)
class Apart:
    """How far two runs are apart."""

    most: list[Distance]
    """One for each unit that there is."""
    end: list[Distance]
    from_s: float | None
    """When they are first more than `APART` apart."""
    same: bool
    """Whether every position is the same to the bit."""
    times_s: Float64 = field(repr=False)
    furthest: Float64 = field(repr=False)
    """The largest distance then, of either unit."""
    ends: dict[tuple[str, str | None, int], float] = field(repr=False)
    """Where the second run ends: by body, joint, and component of its position [m, rad]."""


def apart(base: Seen, other: Seen, *, finer: int = 1) -> Apart:
    """Return how far a run is from another, which has so many steps for each of its own."""
    pairs = pairing(other, base)
    furthest: dict[float, float] = {}
    most: dict[str, Distance] = {}
    end: dict[str, Distance] = {}
    ends: dict[tuple[str, str | None, int], float] = {}
    for theirs, mine in sorted(pairs.numbers.items()):
        if theirs not in base.bodies or mine not in other.bodies:
            continue
        body = base.bodies[theirs]
        client = Times(base, body.client)
        firsts = _first(base, body.client), _first(other, other.bodies[mine].client)
        for joint, unit, steps, was, then, values in _tracks(base, other, theirs, mine):
            aim = (steps - firsts[0]) * finer + firsts[1]
            where = np.searchsorted(then, aim)
            both = np.flatnonzero(then[np.minimum(where, len(then) - 1)] == aim)
            if not len(both):
                continue
            ours = values[where[both]]
            off = _distance(was[both], ours)
            times_s = np.array([client.of(int(step)) for step in steps[both]])
            for time_s, value in zip(times_s.tolist(), off.tolist(), strict=True):
                furthest[time_s] = max(value, furthest.get(time_s, 0.0))
            for found, row in ((most, int(np.argmax(off))), (end, -1)):
                each = Distance(float(off[row]), unit, body.label, joint, float(times_s[row]))
                if unit not in found or not each.value <= found[unit].value:
                    found[unit] = each
            if unit == "m" or joint is not None:
                ends |= {(body.label, joint, at): float(value) for at, value in enumerate(ours[-1])}
    ordered = sorted(furthest)
    largest = np.array([furthest[time_s] for time_s in ordered])
    beyond = np.flatnonzero(~(largest <= APART))
    return Apart(
        most=[most[unit] for unit in sorted(most)],
        end=[end[unit] for unit in sorted(end)],
        from_s=ordered[beyond[0]] if len(beyond) else None,
        same=not largest.any(),
        times_s=np.array(ordered),
        furthest=largest,
        ends=ends,
    )


def _first(seen: Seen, client: int) -> int:
    """Return the first step of a simulation that was sampled."""
    bodies = [body.number for body in seen.bodies.values() if body.client == client]
    firsts = [int(seen.joints[number].steps[0]) for number in bodies if number in seen.joints]
    bases = seen.bases.filter(pl.col("body").is_in(bodies))["step"]
    return min([*firsts, *bases.head(1).to_list()], default=0)


def _tracks(
    base: Seen, other: Seen, theirs: int, mine: int
) -> Iterator[tuple[str | None, str, Int64, Float64, Int64, Float64]]:
    """Yield joint, unit, and steps and values in both runs, of each position of a body."""
    rows = [seen.bases.filter(pl.col("body") == number)
        for seen, number in ((base, theirs), (other, mine))]  # fmt: skip
    if all(len(each) for each in rows):
        steps = [each["step"].to_numpy() for each in rows]
        numbers = [each.select(MOTION_COLUMNS).to_numpy() for each in rows]
        for unit, columns in (("m", slice(0, 3)), ("rad", slice(3, 7))):
            yield None, unit, steps[0], numbers[0][:, columns], steps[1], numbers[1][:, columns]
    if theirs in base.joints and mine in other.joints:
        held = base.joints[theirs], other.joints[mine]
        for name, unit, columns in _joints(base.bodies[theirs]):
            yield (name, unit, held[0].steps, held[0].position[:, columns],
                held[1].steps, held[1].position[:, columns])  # fmt: skip


def _joints(body: Body) -> Iterator[tuple[str, str, slice]]:
    at = 0
    for joint in body.joints:
        if joint.widths[0]:
            unit = "m" if joint.kind == "prismatic" else "rad"
            yield joint.name, unit, slice(at, at + joint.widths[0])
            at += joint.widths[0]


def _distance(mine: Float64, theirs: Float64) -> Float64:
    """Return lengths of vectors' differences [m, rad]; of quaternions, the angles between."""
    apart = np.linalg.norm(mine - theirs, axis=1)
    if mine.shape[1] == 4:  # |q - p| = 2 sin(angle / 4)
        apart = np.minimum(apart, np.linalg.norm(mine + theirs, axis=1))
        return np.asarray(4 * np.arcsin(np.minimum(apart / 2, 1.0)))
    return np.asarray(apart)


@dataclass(frozen=True)
class Growth:
    """How a small displacement grows: as exp(rate t)."""

    rate_per_s: float
    from_s: float
    until_s: float
    lost_s: float | None
    """From when on the outcome is one of many: it has grown beyond `LOST`."""


def growth(nudged: Apart, nudge: float) -> Growth | None:
    """Return the rate at which a displacement grows; None if it does not, exponentially.

    Least squares of ln d = c + rate t, between ten times the displacement and `LOST`; where
    ln d = c + n ln t fits as well, it drifts.
    """
    d, t = nudged.furthest, nudged.times_s
    started = np.flatnonzero(d > 10 * nudge)
    over = np.flatnonzero(d > LOST)
    first = int(started[0]) if len(started) else len(d)
    last = int(over[0]) if len(over) else len(d)
    within = (np.arange(len(d)) >= first) & (np.arange(len(d)) < last) & (d > 0) & (t > 0)
    if within.sum() < 8 or d[within].max() < LEAST_GROWTH * nudge:
        return None
    log, times = np.log(d[within]), t[within]
    slope, residual = _line(times, log)
    if slope <= 0 or residual >= _line(np.log(times), log)[1]:
        return None
    lost_s = float(t[last]) if len(over) else None
    return Growth(slope, float(times[0]), float(times[-1]), lost_s)


def _line(x: Float64, y: Float64) -> tuple[float, float]:
    """Return the slope of a line by least squares, and the sum of its squared residuals."""
    dx, dy = x - x.mean(), y - y.mean()
    slope = float(dx @ dy / (dx @ dx))
    return slope, float(((dy - slope * dx) ** 2).sum())


@dataclass(frozen=True)
class Converging:
    """How an end state converges as the timestep shrinks."""

    body: str
    joint: str | None
    component: int
    """Of its position."""
    order: float | None
    """Observed; None where it does not converge."""
    extrapolated: float | None
    """Where it would end with a timestep of 0 [m, rad]."""
    uncertainty: float | None


def converging(timesteps_s: Sequence[float], ends: Sequence[Apart]) -> Converging | None:
    """Return how the position that changes most converges, over three timesteps from the coarsest.

    None where nothing changes but rounding.
    """
    shared = [key for key in ends[0].ends if all(key in each.ends for each in ends)]
    values = {key: [each.ends[key] for each in ends] for key in shared}
    change, key = max(
        ((abs(each[1] - each[0]), key) for key, each in values.items()),
        key=lambda pair: pair[0], default=(0.0, None),
    )  # fmt: skip
    if key is None or not change > APART * 1e-6:
        return None
    coarse, middle, fine = values[key]
    order = solution_order(timesteps_s, values[key])
    if order is None or not math.isfinite(order) or abs(fine - middle) >= abs(middle - coarse):
        return Converging(*key, None, None, None)
    ratio = timesteps_s[1] / timesteps_s[2]
    index = grid_convergence_index(middle, fine, ratio=ratio, order=order) if fine else 0.0
    limit = richardson(middle, fine, ratio=ratio, order=order)
    return Converging(*key, order, limit, index * abs(fine))
