"""Measures how robust results are: growth of displacements, convergence, reliable digits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.experiments.refinement import SAFETY_FACTOR, richardson, solution_order
from drop_physics.experiments.run_distance import APART, Apart, Track

LOST = 1e-3
"""Distance from which the outcome is unpredictable [m, rad]."""
LEAST_GROWTH = 100.0
"""Least factor of growth for which an exponential rate is fitted: a displacement also grows by mere
drift."""
LEAST_ORDER, MOST_ORDER = 0.5, 2.5
"""Range of plausible observed orders: the engines' methods have order 1 or 2."""
ROUNDED = 1e-12
"""Changes below this share of a position are rounding [1]."""


@dataclass(frozen=True)
class Growth:
    """How a slight displacement of the start grows over time."""

    rate_per_s: float | None
    """Exponential rate, as in exp(rate t); None if the growth is not exponential."""
    from_s: float | None
    """Time from which on the rate is fitted."""
    until_s: float | None
    """Time up to which the rate is fitted."""
    lost_s: float | None
    """Time from which the outcome is unpredictable: the displacement exceeds 1e-3 [m, rad]."""
    start: float
    """The initial displacement [m, rad]."""
    most: float
    """The largest displacement [m, rad]."""
    unit: str
    """Unit of the largest displacement, `m` or `rad`."""


def growth(nudged: Apart, nudge: float) -> Growth | None:
    """Return the growth of a displacement; None if it grows less than a hundredfold.

    The rate is that of ln d = c + rate t by least squares, for d between ten times the initial
    displacement and `LOST`; if ln d = c + n ln t fits as well, the displacement only drifts, and
    there is no rate.
    """
    t, d = nudged.furthest
    if not len(d) or d.max() < LEAST_GROWTH * nudge:
        return None
    over = np.flatnonzero(d > LOST)
    last = int(over[0]) if len(over) else len(d)
    lost_s = float(t[last]) if len(over) else None
    started = np.flatnonzero(d > 10 * nudge)
    within = (np.arange(len(d)) >= started[0]) & (np.arange(len(d)) < last) & (t > 0)
    log, times = np.log(d[within]), t[within]
    rate: float | None = None
    if len(log) >= 8 and log.max() - log[0] > math.log(LEAST_GROWTH):
        rate, residual = _line(times, log)
        spread = float(((log - log.mean()) ** 2).sum())
        # A step, as of an impact, is no exponential.
        if rate <= 0 or residual >= min(_line(np.log(times), log)[1], spread / 4):
            rate = None
    first_s, last_s = (None, None) if rate is None else (float(times[0]), float(times[-1]))
    unit = max(nudged.curves, key=lambda curve: float(nudged.curves[curve][1].max()))
    return Growth(rate, first_s, last_s, lost_s, nudge, float(d.max()), unit)


def _line(x: Float64, y: Float64) -> tuple[float, float]:
    """Fit a line by least squares; return its slope, and the sum of squared residuals."""
    dx, dy = x - x.mean(), y - y.mean()
    slope = float(dx @ dy / (dx @ dx))
    return slope, float(((dy - slope * dx) ** 2).sum())


# -- the timestep ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Converging:
    """How a final state converges as the timestep shrinks."""

    body: str
    """Label of the body."""
    joint: str | None
    """Name of the joint; None for a base."""
    axis: str | None
    """`x`, `y` or `z` for a base's position; None for a joint."""
    unit: str
    """`m` or `rad`."""
    ends: tuple[float, float, float]
    """Final position with each timestep, the largest timestep first [m, rad]."""
    order: float | None
    """Observed order of convergence; None if it does not converge."""
    extrapolated: float | None
    """Final position extrapolated to a timestep of 0 [m, rad]."""
    uncertainty: float | None
    """Uncertainty of the extrapolation: Roache's safety factor times the distance between the
    extrapolated position and that of the finest timestep [m, rad]."""


def converging(timesteps_s: Sequence[float], runs: Sequence[Apart | None]) -> list[Converging]:
    """Return how final positions converge with the timestep, the least converged first.

    Parameters
    ----------
    timesteps_s
        Three timesteps in geometric progression, the coarsest first [s].
    runs
        Distances of the run with each timestep from the script's own run; None for the own run
        itself.
    """
    found: list[tuple[float, Converging]] = []
    held = [
        {(each.body, each.joint, each.unit): each for each in run.tracks}
        for run in runs
        if run is not None
    ]
    for key, track in held[0].items():
        if len({each[key].end_s for each in held if key in each}) != 1 or not all(
            key in each for each in held
        ):  # one has ended earlier
            continue
        mine = iter(held)
        ends = np.array([track.last if run is None else next(mine)[key].theirs for run in runs])
        if ends.shape[1] == 4 or not np.isfinite(ends).all():  # a quaternion is not extrapolated
            continue
        at = int(np.argmax(np.ptp(ends, axis=0)))
        change = float(np.ptp(ends[:, at]))
        if change > max(APART * 1e-6, ROUNDED * float(np.abs(ends).max())):
            axis = "xyz"[at] if track.joint is None else None
            found.append((change, _converging(timesteps_s, ends[:, at], track, axis)))
    return [each for _, each in sorted(found, key=lambda pair: -pair[0])]


def _converging(
    timesteps_s: Sequence[float], ends: Float64, track: Track, axis: str | None
) -> Converging:
    coarse, middle, fine = map(float, ends)
    part = track.body, track.joint, axis, track.unit, (coarse, middle, fine)
    order = solution_order(timesteps_s, [coarse, middle, fine])
    if order is None or not LEAST_ORDER <= order <= MOST_ORDER:
        return Converging(*part, None, None, None)
    ratio = timesteps_s[1] / timesteps_s[2]
    limit = richardson(middle, fine, ratio=ratio, order=order)
    return Converging(*part, order, limit, SAFETY_FACTOR * abs(limit - fine))


# -- what stands ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Standing:
    """The number of reliable digits of a position: those equal in all variations."""

    body: str
    """Label of the body."""
    joint: str | None
    """Name of the joint; None for a base."""
    unit: str
    """`m` for a base's position or a prismatic joint, `rad` for an orientation or a revolute
    joint."""
    moved: float
    """The largest distance from the start [m, rad], whose reliable digits are counted."""
    end: float
    """The largest final distance between a variation and the script's own run [m, rad]."""
    end_digits: int | None
    """Number of digits of the final position equal in all variations; None if equal bit for bit."""
    end_by: str | None
    """The variation whose final position is farthest."""
    most: float
    """The largest distance of a variation from the script's own run at any time [m, rad]."""
    most_digits: int | None
    """Number of digits equal in all variations at all times."""
    most_by: str | None
    """The variation that is farthest at any time."""


MATTERS = 1e-3
"""A position is ignored if it moves by less than this share of the largest motion with the same
unit, or by less than `APART`, unless a variation moves the position as much."""


def standing(runs: Mapping[str, Apart]) -> list[Standing]:
    """Return the reliable digits of each relevant position, the fewest first."""
    by_part: dict[tuple[str, str | None, str], dict[str, Track]] = {}
    for name, run in runs.items():
        for track in run.tracks:
            by_part.setdefault((track.body, track.joint, track.unit), {})[name] = track
    largest: dict[str, float] = {}
    for (_, _, unit), tracks in by_part.items():
        for track in tracks.values():
            reach = min(max(track.moved, track.most), 1e300)
            largest[unit] = max(largest.get(unit, 0.0), reach)
    found = []
    for part, tracks in by_part.items():
        moved = max(each.moved for each in tracks.values())
        ends = max(tracks, key=lambda name: tracks[name].end)
        most = max(tracks, key=lambda name: tracks[name].most)
        end, worst = tracks[ends].end, tracks[most].most
        if max(moved, worst) < max(APART, MATTERS * largest[part[2]]):
            continue
        found.append(
            Standing(
                *part,
                moved,
                end,
                _digits(moved, end),
                ends if end else None,
                worst,
                _digits(moved, worst),
                most if worst else None,
            )
        )
    return sorted(
        found, key=lambda each: (99 if each.most_digits is None else each.most_digits, -each.most)
    )


def _digits(moved: float, off: float) -> int | None:
    """Return the number of digits of a distance that are reliable if the error is `off`."""
    if not off:
        return None
    if not math.isfinite(off) or not moved:
        return 0
    return min(15, max(0, math.floor(math.log10(moved / off))))


def geometric(factors: Sequence[int]) -> tuple[int, int, int] | None:
    """Return the three finest timesteps with a constant ratio, coarsest first; else None."""
    ordered = sorted({1, *factors}, reverse=True)
    for fine, middle, coarse in itertools.combinations(ordered, 3):
        if middle * middle == fine * coarse:
            return coarse, middle, fine
    return None
