"""Measures the distance between two runs of one script."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.compare.motions import NOTHING, BodySamples, motions, together
from drop_physics.compare.pairing import pairing
from drop_physics.explain.times import StepTimes
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.states import motion_of

APART = 1e-6
"""Least distance at which runs count as apart [m, rad]."""
MOST_POINTS = 4096
"""Most points in a curve of distances."""
STEPS = 4096
"""Number of the script's own steps that are compared at a time."""
Motion = tuple[Float64, Float64]
"""Positions and velocities of a base or joint over steps, shapes (n, k) and (n, j)."""


@dataclass(frozen=True)
class Distance:
    """A distance between two runs."""

    value: float
    """The distance [m, rad]; infinite if a run has no finite state."""
    unit: str
    """`m` for positions; `rad` for orientations and revolute joints."""
    body: str
    """Label of the body."""
    joint: str | None
    """Name of the joint; null for a base."""
    time_s: float
    """Simulated time in the script's own run [s]."""


@dataclass
class Track:
    """One position that is compared: a base's position or orientation, or a joint's."""

    number: int
    """Id of the body in the script's own run."""
    other: int
    """Id of the body in the other run."""
    body: str
    joint: str | None
    unit: str
    start: Float64
    last: Float64
    """Final position in the script's own run, within the time that both runs cover."""
    theirs: Float64
    """Final position in the other run, at the same time."""
    moved: float = 0.0
    """Largest distance of the script's own run from its start [m, rad]."""
    most: float = 0.0
    most_s: float = 0.0
    end: float = 0.0
    end_s: float = 0.0
    from_step: int | None = None
    """The script's own first step at which the runs are more than `APART` apart."""
    from_s: float = math.inf
    first: float = 0.0
    """Distance between the runs at that step [m, rad]."""
    fastest: float = 0.0
    """Largest rate in the script's own run, in units of the position per second."""
    their_fastest: float = 0.0
    """Largest rate in the other run."""
    same: bool = True

    def add(self, steps: Int64, times_s: Float64, mine: Float64, theirs: Float64) -> Float64:
        """Add positions at further steps; return the distances of the runs there, shape (n,)."""
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
        """Return a `Distance` of this position, with the given value and time."""
        return Distance(value, self.unit, self.body, self.joint, time_s)


@dataclass(frozen=True)
class Apart:
    """All distances between two runs."""

    tracks: list[Track]
    curves: Mapping[str, tuple[Float64, Float64]] = field(repr=False)
    """Times [s] and the largest distance at each time, by unit."""

    @property
    def end(self) -> list[Distance]:
        """Return the largest final distance of each unit."""
        return [each.distance(each.end, each.end_s) for each in self._farthest("end")]

    @property
    def most(self) -> list[Distance]:
        """Return the largest distance at any time, of each unit."""
        return [each.distance(each.most, each.most_s) for each in self._farthest("most")]

    def _farthest(self, name: str) -> Iterator[Track]:
        for unit in sorted({track.unit for track in self.tracks}):
            of_unit = [track for track in self.tracks if track.unit == unit]
            yield max(of_unit, key=lambda each: float(getattr(each, name)))

    @property
    def first(self) -> Track | None:
        """The first position to be more than `APART` apart, of several the farthest."""
        apart = [track for track in self.tracks if track.from_step is not None]
        return min(apart, key=lambda each: (each.from_s, -each.first), default=None)

    @property
    def from_s(self) -> float | None:
        """Time at which the runs are first more than `APART` apart [s]; None if never."""
        return None if self.first is None else self.first.from_s

    @property
    def same(self) -> bool:
        """True if all compared positions are equal, bit for bit; False if none was compared."""
        return bool(self.tracks) and not self.differ

    @property
    def differ(self) -> bool:
        """True if any compared position differs, by however little."""
        return any(not track.same for track in self.tracks)

    @property
    def furthest(self) -> tuple[Float64, Float64]:
        """Return the largest distance of any position at each time, with the times [s]."""
        if not self.curves:
            return np.empty(0), np.empty(0)
        times_s, _ = next(iter(self.curves.values()))
        return times_s, np.maximum.reduce([off for _, off in self.curves.values()])


def apart(base: Seen, other: Seen, *, finer: int = 1) -> Apart:
    """Return the distances between two runs; the other makes `finer` steps for each base step.

    Both runs are read in chunks.
    """
    numbers = paired(base, other)
    times = {client: StepTimes(base, client) for client in {b.client for b in base.bodies.values()}}
    tracks: dict[tuple[int, str | None, str], Track] = {}
    size = base.sampled.last + 1
    times_s, curves = np.zeros(size), {"m": np.zeros(size), "rad": np.zeros(size)}
    for piece in base.pieces(STEPS):
        read = other.sampled.piece(piece.first * finer, (piece.end - 1) * finer + 1)
        found = motions(piece.bases, piece.joints), motions(read.bases, read.joints)
        for theirs in numbers.keys() & found[0].keys():
            body, number = base.bodies[theirs], numbers[theirs]
            both = together(found[0][theirs], found[1].get(number, NOTHING), finer=finer)
            was, values = (_motions(body, each) for each in both)
            for joint, unit in was.keys() & values.keys():
                (start, own_rates), (place, rates) = was[joint, unit], values[joint, unit]
                rows = np.flatnonzero(np.isfinite(start).all(axis=1))
                if not len(rows):
                    continue
                key, steps = (theirs, joint, unit), both[0].steps[rows]
                at = start[rows[0]]
                track = tracks.setdefault(
                    key, Track(theirs, number, body.label, joint, unit, at, at, at)
                )
                now_s = times[body.client].of_all(steps)
                off = track.add(steps, now_s, start[rows], place[rows])
                track.fastest = max(track.fastest, _greatest(own_rates))
                track.their_fastest = max(track.their_fastest, _greatest(rates))
                times_s[steps] = np.maximum(times_s[steps], now_s)
                curves[unit][steps] = np.maximum(curves[unit][steps], off)
    units = {unit for _, _, unit in tracks}
    return Apart(
        [track for _, track in sorted(tracks.items(), key=_order)],
        {unit: _thinned(times_s, curve) for unit, curve in curves.items() if unit in units},
    )


def paired(base: Seen, other: Seen) -> dict[int, int]:
    """Map the body ids of one run to those of another run of the same script.

    Bodies correspond by name. The rest, such as bodies of temporary files with changing names,
    correspond in the order of their appearance, if links and joints are the same.
    """
    pairs = pairing(other, base)
    found = {body: twin for body, twin in pairs.numbers.items() if twin in pairs.common}
    left = [body for number, body in sorted(other.bodies.items()) if number not in pairs.common]
    for number, body in sorted(base.bodies.items()):
        if number in found:
            continue
        like = (pairs.clients[body.client], body.links, body.joints)
        twin = next((one for one in left if (one.client, one.links, one.joints) == like), None)
        if twin is not None:
            found[number] = twin.number
            left.remove(twin)
    return dict(sorted(found.items()))


def _order(item: tuple[tuple[int, str | None, str], Track]) -> tuple[int, bool, str, str]:
    number, joint, unit = item[0]
    return number, joint is not None, unit if joint is None else "", joint or ""


def _thinned(times_s: Float64, off: Float64) -> tuple[Float64, Float64]:
    """Thin out a curve to a bounded number of points, keeping the largest of each group."""
    edges = np.arange(0, len(off), -(-len(off) // MOST_POINTS))
    return np.maximum.reduceat(times_s, edges), np.maximum.reduceat(off, edges)


def _motions(body: Body, motion: BodySamples) -> dict[tuple[str | None, str], Motion]:
    """Return a body's positions and velocities, by joint and unit."""
    found: dict[tuple[str | None, str], Motion] = {}
    if motion.base is not None:
        numbers = motion_of(motion.base)
        found |= {
            (None, "m"): (numbers[:, :3], numbers[:, 7:10]),
            (None, "rad"): (numbers[:, 3:7], numbers[:, 10:]),
        }
    if motion.joints is not None:
        for name, unit, columns, rates in joints_of(body):
            found[name, unit] = motion.joints.position[:, columns], motion.joints.velocity[:, rates]
    return found


def _greatest(rates: Float64) -> float:
    """Return the largest length of velocities, shape (n, k); infinite if one is not finite."""
    lengths = np.linalg.norm(rates, axis=1)
    return float(np.where(np.isnan(lengths), np.inf, lengths).max(initial=0.0))


def joints_of(body: Body) -> Iterator[tuple[str, str, slice, slice]]:
    """Yield each movable joint's name and unit, and the indices of its position and velocity."""
    for joint, at, rate in zip(body.joints, body.coordinates, body.rates, strict=True):
        if joint.widths[0]:
            yield joint.name, "m" if joint.kind == "prismatic" else "rad", at, rate


def distances(mine: Float64, theirs: Float64) -> Float64:
    """Return the lengths of difference vectors [m, rad]; for quaternions, angles between them."""
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.linalg.norm(mine - theirs, axis=1)
        if mine.shape[1] == 4:  # |q - p| = 2 sin(angle / 4)
            off = np.minimum(off, np.linalg.norm(mine + theirs, axis=1))
            off = 4 * np.arcsin(np.minimum(off / 2, 1.0))
    return np.where(np.isnan(off), np.inf, off)
