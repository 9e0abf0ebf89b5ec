"""How far two runs of one script are apart, and how that grows and converges."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.checking.pairing import pairing
from drop_physics.analysis.drop.convergence import SAFETY_FACTOR, richardson, solution_order
from drop_physics.analysis.times import Times
from drop_physics.seen.events import Body
from drop_physics.seen.history import Piece, Seen
from drop_physics.seen.poses import MOTION_COLUMNS
from drop_physics.states import Joints

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

APART = 1e-6
"""Runs count as apart from here on [m, rad]."""
LOST = 1e-3
"""Where a displacement has grown so far, the outcome is one of many [m, rad]."""
LEAST_GROWTH = 100.0
"""Factor below which growth has no rate: a displacement also drifts."""
MOST_POINTS = 2048
"""Of a curve: beyond, two become one."""
STEPS = 4096
"""Of the script's own run, that are compared at a time."""
LEAST_ORDER, MOST_ORDER = 0.5, 2.5
"""Engines' methods are of order 1 or 2: another is a chance of these timesteps."""
ROUNDED = 1e-12
"""Changes below this share of a position are its rounding [1]."""


@dataclass(frozen=True)
class Distance:
    """A distance between two runs."""

    value: float
    """Infinite where a run has no finite state."""
    unit: str
    """`m`, of positions; `rad`, of orientations and joints that turn."""
    body: str
    """Its label."""
    joint: str | None
    """Its name; null of a base."""
    time_s: float
    """Of the script's own run."""


@dataclass
class Track:
    """One position of both runs: of a base, its orientation, or of a joint."""

    number: int
    """Of the body, in the script's own run."""
    other: int
    """The same in the other run."""
    body: str
    joint: str | None
    unit: str
    start: Float64
    last: Float64
    """Where the script's own run ends, as far as both go."""
    theirs: Float64
    """Where the other one ends."""
    moved: float = 0.0
    """The largest distance of the script's own run from its start."""
    most: float = 0.0
    most_s: float = 0.0
    end: float = 0.0
    end_s: float = 0.0
    from_step: int | None = None
    """Of the script's own run: the first where they are more than `APART` apart."""
    from_s: float = math.inf
    first: float = 0.0
    """How far they are apart then."""
    same: bool = True

    def add(self, steps: Int64, times_s: Float64, mine: Float64, theirs: Float64) -> Float64:
        """Add some steps, and return how far apart they are."""
        off = distances(mine, theirs)
        self.moved = max(self.moved, float(distances(mine, self.start[None]).max()))
        self.last, self.theirs = mine[-1], theirs[-1]
        self.end, self.end_s = float(off[-1]), float(times_s[-1])
        row = int(np.argmax(off))
        if off[row] > self.most or not self.most:
            self.most, self.most_s = float(off[row]), float(times_s[row])
        beyond = np.flatnonzero(off > APART)
        if self.from_step is None and len(beyond):
            self.from_step, self.from_s = int(steps[beyond[0]]), float(times_s[beyond[0]])
            self.first = float(off[beyond[0]])
        self.same &= not off.any()
        return off

    def distance(self, value: float, time_s: float) -> Distance:
        """Return a distance of this position."""
        return Distance(value, self.unit, self.body, self.joint, time_s)


class Curve:
    """The largest distance by time, in a bounded number of points."""

    def __init__(self) -> None:
        self._values, self._times = np.zeros(2 * MOST_POINTS), np.zeros(2 * MOST_POINTS)
        self._width, self._used = 1, 0

    def add(self, since: Int64, times_s: Float64, values: Float64) -> None:
        """Add values at steps since the first."""
        while len(since) and since[-1] // self._width >= 2 * MOST_POINTS:
            for each in (self._values, self._times):
                each[:MOST_POINTS] = np.maximum(each[::2], each[1::2])
                each[MOST_POINTS:] = 0.0
            self._width, self._used = 2 * self._width, (self._used + 1) // 2
        np.maximum.at(self._values, since // self._width, values)
        np.maximum.at(self._times, since // self._width, times_s)
        self._used = max(self._used, int(since[-1]) // self._width + 1)

    @property
    def points(self) -> tuple[Float64, Float64]:
        """Times [s] and distances."""
        return self._times[: self._used].copy(), self._values[: self._used].copy()


@dataclass(frozen=True)
class Apart:
    """How far two runs are apart."""

    tracks: list[Track]
    firsts: Mapping[int, tuple[int, int]]
    """The first step in both, by client of the script's own run."""
    curves: Mapping[str, tuple[Float64, Float64]] = field(repr=False)
    """By unit, times [s] and the largest distance then."""

    @property
    def end(self) -> list[Distance]:
        """The farthest at the end, one for each unit that there is."""
        return [each.distance(each.end, each.end_s) for each in self._farthest("end")]

    @property
    def most(self) -> list[Distance]:
        """The farthest at worst, one for each unit that there is."""
        return [each.distance(each.most, each.most_s) for each in self._farthest("most")]

    def _farthest(self, name: str) -> Iterator[Track]:
        for unit in sorted({each.unit for each in self.tracks}):
            of_unit = [each for each in self.tracks if each.unit == unit]
            yield max(of_unit, key=lambda each: float(getattr(each, name)))

    @property
    def first(self) -> Track | None:
        """What is first more than `APART` apart, of several the farthest; None if nothing is."""
        apart = [each for each in self.tracks if each.from_step is not None]
        return min(apart, key=lambda each: (each.from_s, -each.first), default=None)

    @property
    def from_s(self) -> float | None:
        """When they are first more than `APART` apart."""
        return None if self.first is None else self.first.from_s

    @property
    def same(self) -> bool:
        """Whether every position is the same to the bit."""
        return all(each.same for each in self.tracks)

    @property
    def furthest(self) -> tuple[Float64, Float64]:
        """Times [s], and the largest distance then, of either unit."""
        found = [*self.curves.values()]
        if not found:
            return np.empty(0), np.empty(0)
        longest = max(found, key=lambda curve: len(curve[0]))
        value = longest[1].copy()
        for _, values in found:
            value[: len(values)] = np.maximum(value[: len(values)], values)
        return longest[0], value


def apart(base: Seen, other: Seen, *, finer: int = 1) -> Apart:
    """Return how far a run is from another, which has so many steps for each of its own.

    Both are read in pieces: memory does not grow with their length.
    """
    pairs = [
        (theirs, mine)
        for theirs, mine in sorted(pairing(other, base).numbers.items())
        if theirs in base.bodies and mine in other.bodies
    ]
    starts = _starts(base), _starts(other)
    firsts = {
        base.bodies[theirs].client: (
            starts[0].get(base.bodies[theirs].client, 0),
            starts[1].get(other.bodies[mine].client, 0),
        )
        for theirs, mine in pairs
    }
    times = {client: Times(base, client) for client in firsts}
    tracks: dict[tuple[int, str | None, str], Track] = {}
    curves = {"m": Curve(), "rad": Curve()}
    for piece in base.pieces(STEPS):
        read = _counterpart(other, piece, firsts, finer)
        if read is None:
            continue
        rows = [_bases(each) for each in (piece, read)]
        for theirs, mine in pairs:
            body = base.bodies[theirs]
            first, start = firsts[body.client]
            for joint, unit, steps, was, then, values in _positions(
                body, rows[0].get(theirs), rows[1].get(mine), piece.joints.get(theirs),
                read.joints.get(mine),
            ):  # fmt: skip
                aim = (steps - first) * finer + start
                where = np.searchsorted(then, aim)
                both = np.flatnonzero(
                    (then[np.minimum(where, len(then) - 1)] == aim) & np.isfinite(was).all(axis=1)
                )
                if not len(both):
                    continue
                track = tracks.get((theirs, joint, unit))
                if track is None:
                    at = was[both[0]]
                    track = Track(theirs, mine, body.label, joint, unit, at, at, at)
                    tracks[theirs, joint, unit] = track
                times_s = times[body.client].of_all(steps[both])
                off = track.add(steps[both], times_s, was[both], values[where[both]])
                curves[unit].add(steps[both] - base.sampled.first, times_s, off)
    found = {unit: curve.points for unit, curve in curves.items()}
    return Apart([*tracks.values()], firsts, {u: c for u, c in found.items() if len(c[0])})


def _starts(seen: Seen) -> dict[int, int]:
    """Return the first sampled step of each simulation, by client."""
    clients = {each.client for each in seen.bodies.values() if each.moving}
    found: dict[int, int] = {}
    for piece in seen.pieces(STEPS):
        firsts = [(number, int(joints.steps[0])) for number, joints in piece.joints.items()]
        firsts += piece.bases.group_by("body").agg(pl.col("step").min()).rows()
        for number, step in firsts:
            client = seen.bodies[number].client
            found[client] = min(step, found.get(client, step))
        if clients <= found.keys():
            break
    return found


def _counterpart(
    other: Seen, piece: Piece, firsts: Mapping[int, tuple[int, int]], finer: int
) -> Piece | None:
    """Return the steps of the other run that belong to a piece of the script's own."""
    ends = [
        (max(piece.first - first, 0) * finer + start, (piece.end - 1 - first) * finer + start)
        for first, start in firsts.values()
        if piece.end > first
    ]
    if not ends:
        return None
    low, high = min(low for low, _ in ends), max(high for _, high in ends)
    return other.sampled.piece(low, min(high, other.sampled.last) + 1)


def _bases(piece: Piece) -> dict[int, pl.DataFrame]:
    parts = piece.bases.partition_by("body", as_dict=True, maintain_order=True)
    return {int(key[0]): rows for key, rows in parts.items()}


def _positions(
    body: Body, base: pl.DataFrame | None, other: pl.DataFrame | None, mine: Joints | None,
    theirs: Joints | None,
) -> Iterator[tuple[str | None, str, Int64, Float64, Int64, Float64]]:  # fmt: skip
    """Yield joint, unit, and steps and values in both runs, of each position of a body."""
    if base is not None and other is not None:
        steps = [each["step"].to_numpy() for each in (base, other)]
        numbers = [each.select(MOTION_COLUMNS).to_numpy() for each in (base, other)]
        for unit, columns in (("m", slice(0, 3)), ("rad", slice(3, 7))):
            yield None, unit, steps[0], numbers[0][:, columns], steps[1], numbers[1][:, columns]
    if mine is not None and theirs is not None:
        for name, unit, columns, _ in joints_of(body):
            yield (name, unit, mine.steps, mine.position[:, columns],
                theirs.steps, theirs.position[:, columns])  # fmt: skip


def joints_of(body: Body) -> Iterator[tuple[str, str, slice, slice]]:
    """Yield name and unit of each joint that moves, and where its position and its rate are."""
    at = rate = 0
    for joint in body.joints:
        ends = at + joint.widths[0], rate + joint.widths[1]
        if joint.widths[0]:
            unit = "m" if joint.kind == "prismatic" else "rad"
            yield joint.name, unit, slice(at, ends[0]), slice(rate, ends[1])
        at, rate = ends


def distances(mine: Float64, theirs: Float64) -> Float64:
    """Return lengths of vectors' differences [m, rad]; of quaternions, the angles between."""
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.linalg.norm(mine - theirs, axis=1)
        if mine.shape[1] == 4:  # |q - p| = 2 sin(angle / 4)
            off = np.minimum(off, np.linalg.norm(mine + theirs, axis=1))
            off = 4 * np.arcsin(np.minimum(off / 2, 1.0))
    return np.where(np.isnan(off), np.inf, off)


# -- a displacement that grows --------------------------------------------------------------------


@dataclass(frozen=True)
class Growth:
    """How a small displacement grows."""

    rate_per_s: float | None
    """As exp(rate t); None where it does not grow like that."""
    from_s: float | None
    """From here on the rate is fitted."""
    until_s: float | None
    """Until here the rate is fitted."""
    lost_s: float | None
    """From when on the outcome is one of many: it has grown beyond 1e-3 [m, rad]."""
    start: float
    """The displacement [m, rad]."""
    most: float
    """The largest distance [m, rad]."""
    unit: str
    """Of that, `m` or `rad`."""


def growth(nudged: Apart, nudge: float) -> Growth | None:
    """Return how a displacement grows; None if it does not, a hundredfold.

    Least squares of ln d = c + rate t, between ten times the displacement and `LOST`; where
    ln d = c + n ln t fits as well, it drifts.
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
    unit = max(nudged.curves, key=lambda each: float(nudged.curves[each][1].max()))
    return Growth(rate, first_s, last_s, lost_s, nudge, float(d.max()), unit)


def _line(x: Float64, y: Float64) -> tuple[float, float]:
    """Return the slope of a line by least squares, and the sum of its squared residuals."""
    dx, dy = x - x.mean(), y - y.mean()
    slope = float(dx @ dy / (dx @ dx))
    return slope, float(((dy - slope * dx) ** 2).sum())


# -- the timestep ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Converging:
    """How an end state converges as the timestep shrinks."""

    body: str
    """Its label."""
    joint: str | None
    """Its name; None of a base."""
    axis: str | None
    """`x`, `y` or `z` of a base's position; else None."""
    unit: str
    """`m` or `rad`."""
    ends: tuple[float, float, float]
    """Where it ends with each timestep, the coarsest first [m, rad]."""
    order: float | None
    """Observed; None where it does not converge."""
    extrapolated: float | None
    """Where it would end with a timestep of 0 [m, rad]."""
    uncertainty: float | None
    """Of that: Roache's safety factor times its distance from the finest [m, rad]."""


def converging(timesteps_s: Sequence[float], runs: Sequence[Apart | None]) -> list[Converging]:
    """Return how each end position converges, the one that changes most first.

    Parameters
    ----------
    timesteps_s
        Three, the coarsest first, of one ratio.
    runs
        How far the runs with each are from the script's own; None for that itself.
    """
    found: list[tuple[float, Converging]] = []
    held = [{(each.body, each.joint, each.unit): each for each in run.tracks}
        for run in runs if run is not None]  # fmt: skip
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
    """To how many digits a position is the same in all variations."""

    body: str
    """Its label."""
    joint: str | None
    """Its name; None of a base."""
    unit: str
    """`m`, or `rad` of an orientation or a joint that turns."""
    moved: float
    """The largest distance from its start [m, rad]: what digits count of."""
    end: float
    """The largest distance between a variation and the script's own run, at the end."""
    end_digits: int | None
    """To how many digits the end stands; None where it is the same to the bit."""
    end_by: str | None
    """The variation that ends farthest."""
    most: float
    """The largest distance at any time."""
    most_digits: int | None
    """To how many digits it stands at any time."""
    most_by: str | None
    """The variation that is farthest at any time."""


MATTERS = 1e-3
"""A position that moves less than this share of what moves most does not matter, nor does one that
moves less than `APART`, unless a variation moves it as much."""


def standing(runs: Mapping[str, Apart]) -> list[Standing]:
    """Return what stands of each position that matters, the least first."""
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
        found.append(Standing(
            *part, moved, end, _digits(moved, end), ends if end else None,
            worst, _digits(moved, worst), most if worst else None,
        ))  # fmt: skip
    return sorted(found, key=lambda each: (
        99 if each.most_digits is None else each.most_digits, -each.most))  # fmt: skip


def _digits(moved: float, off: float) -> int | None:
    """Return how many digits of a distance stand."""
    if not off:
        return None
    if not math.isfinite(off) or not moved:
        return 0
    return min(15, max(0, math.floor(math.log10(moved / off))))


def geometric(factors: Sequence[int]) -> tuple[int, int, int] | None:
    """Return the three finest of some refinements that have one ratio, coarse first."""
    ordered = sorted({1, *factors}, reverse=True)
    for fine, middle, coarse in itertools.combinations(ordered, 3):
        if middle * middle == fine * coarse:
            return coarse, middle, fine
    return None
