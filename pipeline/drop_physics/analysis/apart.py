"""How far two runs of one script are apart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.analysis.checking.pairing import pairing
from drop_physics.analysis.times import Times
from drop_physics.seen.events import Body
from drop_physics.seen.history import Piece, Seen
from drop_physics.seen.poses import MOTION_COLUMNS
from drop_physics.states import Joints

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

APART = 1e-6
"""Runs count as apart from here on [m, rad]."""
MOST_POINTS = 2048
"""Of a curve: beyond, two become one."""
STEPS = 4096
"""Of the script's own run, that are compared at a time."""


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
