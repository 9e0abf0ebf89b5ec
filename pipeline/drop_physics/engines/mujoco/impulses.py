"""Converts explained steps from the script's process into events of a recording.

MuJoCo has the velocity of a free body at its frame's origin and its spin in the body's axes. A
recording has the velocity of the centre of mass, and both velocity and spin in world axes; its
impulses are converted accordingly:

    F = f        T = R τ - r × f

where f and τ are MuJoCo's impulse and angular impulse, R rotates from body axes to world axes, and
r points from the frame's origin to the centre of mass. Source: the power f·v + τ·ω is the same,
with v = v_c - ω × r.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import (
    DescribedBody,
    DescribedModel,
    normalized,
    xyzw,
)
from drop_physics.engines.mujoco.explain.reasons import EXPLAINED, OTHER, REASONS
from drop_physics.engines.mujoco.explained import ImpulseTerm, ReplayedPiece
from drop_physics.engines.mujoco.held import friction_of, softness_of
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.trace.events import (
    REPLAYS,
    At,
    ContactRows,
    Event,
    ImpulseCause,
    Impulses,
    PairFriction,
)
from drop_physics.trace.frames import Frames
from drop_physics.trace.states import CONTACT, Rows

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Events = Iterator[Event]

KINDS = {
    "damper": "joint damping",
    "pushed": "applied",
    "equality": "constraints",
    "limit": "stops",
    "push": "contacts",
    "friction": "contacts",
    "tendon friction": "friction loss",
}
"""Names for MuJoCo's causes in a recording, where they differ."""
UNKNOWN, NOT_REPLAYED = map(REPLAYS.index, ("unknown", "not replayed"))
NAMES = {
    "actuator": "actuator",
    "tendon": "tendon",
    "tendon limit": "tendon",
    "tendon friction": "tendon",
    "equality": "eq",
    "limit": "jnt",
}
"""The element type to which a cause's first index refers."""


@dataclass(frozen=True)
class _CausePart:
    """The share of a force term in one recorded body."""

    cause: ImpulseCause
    body: DescribedBody
    columns: Int64
    """Column indices in the term, shape (w,)."""
    rows: Int64
    """Index of each column among the cause's degrees of freedom."""


@dataclass(eq=False)
class ExplainedSteps:
    """Converts the explained steps of one simulation into events.

    Parameters
    ----------
    client
        The number of the simulation.
    described
        The bodies of the simulation's model.
    """

    client: int
    described: DescribedModel
    _parts: dict[tuple[int, int], list[_CausePart]] = field(default_factory=dict)
    """The parts of terms, by the index of the loaded model and the index of the term in that model.
    """
    _causes: dict[tuple[object, ...], ImpulseCause] = field(default_factory=dict)
    _starts: Float64 = field(default_factory=lambda: np.empty((0, 0)))
    """`qpos` before each step of a chunk."""
    _frictions: dict[tuple[int, int, int, int], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._bodies = {made.body.number: made for made in self.described.bodies}
        geoms = np.atleast_1d(self.described.arrays.get("geom_bodyid", ()))
        places = [self.described.link_of[body] for body in geoms.tolist()]
        self._geoms = np.array(places, np.int64).reshape(-1, 2)

    def know(self, causes: Iterable[ImpulseCause]) -> None:
        """Continue with causes that were recorded earlier, and keep their indices."""
        self._causes |= {
            (cause.kind, cause.name, cause.body, cause.places): cause
            for cause in causes
            if cause.client == self.client
        }

    def events(
        self, piece: ReplayedPiece, frames: Frames, times_s: Float64, numbers: Iterator[int]
    ) -> Events:
        """Yield the events of a chunk's steps.

        Parameters
        ----------
        piece
            The explained steps.
        frames
            The replay frames of these steps; it may contain further frames.
        times_s
            The times of the samples after the steps [s].
        numbers
            Unused numbers, for new causes.
        """
        n = len(piece.status)
        steps = piece.first + 1 + np.arange(n, dtype=np.int64)
        status = np.array([_replay(reason) for reason in REASONS])[piece.reason]
        status[(piece.status == OTHER) & (status == UNKNOWN)] = NOT_REPLAYED
        status = np.where(piece.status == EXPLAINED, 0, status)
        at = piece.steps - piece.first
        remainder = np.zeros(n)
        remainder[at] = np.where(np.isfinite(piece.remainder), piece.remainder, 1.0)
        known = len(self._causes)
        begin = piece.first - frames.first
        if "qpos" in frames.after:
            self._starts = frames.starts("qpos")[begin : begin + n]
        blocks = self._blocks(piece, numbers)
        yield from [*self._causes.values()][known:]
        yield _impulses(self.client, steps, times_s, status, remainder, blocks)
        contacts = self._contacts(piece)
        yield from self._pairs(piece, contacts)
        yield ContactRows(self.client, steps, times_s, contacts)

    def _blocks(
        self, piece: ReplayedPiece, numbers: Iterator[int]
    ) -> list[tuple[int, Int64, Float64]]:
        """Return the causes that act: indices, the rows of their steps, and their impulses."""
        found: dict[int, list[tuple[Int64, Float64]]] = {}
        for term, (rows, values) in _by_term(piece):
            for part in self._parts_of((piece.model, term), piece.vocabulary.terms[term], numbers):
                block = np.zeros((len(rows), len(part.cause.places)))
                block[:, part.rows] = values[:, part.columns]
                self._turn(part, block, rows)
                found.setdefault(part.cause.number, []).append((rows, block))
        blocks = []
        for number, parts in sorted(found.items()):
            rows = np.concatenate([rows for rows, _ in parts])
            held = np.concatenate([block for _, block in parts])
            if len(parts) > 1:
                rows, which = np.unique(rows, return_inverse=True)
                summed = np.zeros((len(rows), held.shape[1]))
                np.add.at(summed, which.ravel(), held)
                held = summed
            blocks.append((number, rows, held))
        return blocks

    def _turn(self, part: _CausePart, block: Float64, rows: Int64) -> None:
        """Rotate impulses on a free base or ball joint into the recording's axes, in place."""
        places, made = part.cause.places, part.body
        if made.free >= 0 and places[0] < 6:
            at = int(self.described.arrays["jnt_qposadr"][made.free])
            turn = normalized(xyzw(self._starts[rows, at + 3 : at + 7]))
            arm = rotate(turn, np.tile(_centre(self.described, made), (len(turn), 1)))
            block[:, 0:3] = rotate(turn, block[:, 0:3]) - np.cross(arm, block[:, 3:6])
        first = 6 * (made.free >= 0)
        for _, rates, axes in made.balls:
            if first + rates.start in places:
                at = places.index(first + rates.start)
                many = np.tile(axes, (len(block), 1))
                block[:, at : at + 3] = rotate_inverse(many, block[:, at : at + 3])

    def _parts_of(
        self, number: tuple[int, int], term: ImpulseTerm, numbers: Iterator[int]
    ) -> list[_CausePart]:
        """Divide a force term among the recorded bodies on which it acts."""
        if number in self._parts:
            return self._parts[number]
        of_body: dict[int, list[tuple[int, int]]] = {}
        for column, dof in enumerate(term.dofs.tolist()):
            body, place = self.described.dof_of[dof]
            of_body.setdefault(body, []).append((column, place))
        parts = self._parts[number] = []
        for body, held in of_body.items():
            made = self._bodies[body]
            places = _whole(made, {place for _, place in held})
            kind, name = self._named(term, body)
            key = kind, name, body, places
            cause = self._causes.get(key)
            if cause is None:
                new = next(numbers)
                at = At(0, 0.0, new)
                cause = self._causes[key] = ImpulseCause(
                    at, new, self.client, body, kind, name, places
                )
            parts.append(
                _CausePart(
                    cause,
                    made,
                    np.array([column for column, _ in held]),
                    np.array([places.index(place) for _, place in held]),
                )
            )
        return parts

    def _named(self, term: ImpulseTerm, body: int) -> tuple[str, str]:
        """Return a force term's name in the recording, and the cause for one body."""
        kind, names = KINDS.get(term.kind, term.kind), self.described.names
        if term.kind in ("push", "friction"):
            bodies = self._geoms[[term.first, term.second], 0].tolist()
            other = bodies[0] if bodies[1] == body else bodies[1]
            return kind, self._bodies[other].body.label if other in self._bodies else ""
        if term.kind == "pushed":
            return kind, names["body"][term.first]
        if term.kind in NAMES and 0 <= term.first < len(names[NAMES[term.kind]]):
            return kind, names[NAMES[term.kind]][term.first]
        return kind, ""

    # -- contact points ---------------------------------------------------------------------------

    def _contacts(self, piece: ReplayedPiece) -> Rows:
        """Return contact points in recording format: MuJoCo's second geom is on body a."""
        touches = piece.touches
        rows = np.zeros(len(touches), CONTACT)
        rows["step"] = touches["step"] + 1
        for side, geom in (("a", touches["second"]), ("b", touches["first"])):
            places = self._geoms[np.maximum(geom, 0)]
            rows[f"body_{side}"], rows[f"link_{side}"] = places[:, 0], places[:, 1]
            rows[f"position_{side}_m"] = touches["position_m"]
        normal, force = touches["normal"], touches["force_n"]
        pressed = np.einsum("ki,ki->k", normal, force)
        across = force - pressed[:, None] * normal
        size = np.linalg.norm(across, axis=1)
        along = np.divide(across, size[:, None], out=np.zeros_like(across), where=size[:, None] > 0)
        rows["normal"], rows["distance_m"] = normal, touches["distance_m"]
        rows["normal_force_n"] = pressed
        rows["friction_1_n"], rows["friction_1_direction"] = size, along
        rows["friction_2_direction"] = np.cross(normal, along)
        return rows

    def _pairs(self, piece: ReplayedPiece, contacts: Rows) -> Iterator[PairFriction]:
        """Yield the friction coefficients of geom pairs that touch for the first time."""
        names = ["body_a", "link_a", "body_b", "link_b"]
        if not len(contacts):
            return
        keys, which = np.unique(contacts[names], return_inverse=True)
        friction = piece.touches["friction"][:, 0]
        for number, key in enumerate(keys.tolist()):
            its = friction[which.ravel() == number]
            geoms = piece.touches[["first", "second"]][which.ravel() == number][0].tolist()
            condim, rolling = friction_of(self.described.arrays, *geoms)
            value = float(its[0]) if (its == its[0]).all() else np.nan
            value = 0.0 if condim == 1 else value
            known = self._frictions.get(key)
            if known is None or (known != value and not np.isnan(known)):
                self._frictions[key] = value = value if known is None else np.nan
                step = int(contacts["step"][which.ravel() == number][0])
                at = At(step, 0.0, 0)
                body_a, link_a, body_b, link_b = key
                solref, solimp = softness_of(self.described.arrays, *geoms)
                links = body_a, link_a, body_b, link_b
                yield PairFriction(
                    at, self.client, *links, value, solref, solimp, condim=condim, rolling=rolling
                )


def _centre(described: DescribedModel, made: DescribedBody) -> Float64:
    """Return a base's centre of mass in the base frame [m], shape (3,)."""
    return np.asarray(described.arrays["body_ipos"][made.root], np.float64)


def _replay(reason: str) -> int:
    """Return the recording's name for the reason why a step was not explained."""
    return REPLAYS.index(reason or "unknown")


def _whole(made: DescribedBody, places: set[int]) -> tuple[int, ...]:
    """Extend dof indices to all dofs of a free base or ball joint of which one is included."""
    first = 6 * (made.free >= 0)
    blocks = [range(6)] if first else []
    blocks += [range(first + rates.start, first + rates.stop) for _, rates, _ in made.balls]
    for block in blocks:
        if places & {*block}:
            places = places | {*block}
    return tuple(sorted(places))


def _by_term(piece: ReplayedPiece) -> Iterator[tuple[int, tuple[Int64, Float64]]]:
    """Yield each force term of a chunk: the rows of its steps, and its values."""
    vocabulary, k = piece.vocabulary, len(piece.steps)
    if not k:
        return
    terms = np.concatenate([vocabulary.patterns[each] for each in piece.pattern.tolist()])
    counts = np.array([len(pattern) for pattern in vocabulary.patterns])[piece.pattern]
    step = np.repeat(piece.steps - piece.first, counts)
    width = np.array([len(term.dofs) for term in vocabulary.terms])
    begin = np.concatenate(([0], np.cumsum(width[terms])))[:-1]
    order = np.argsort(terms, kind="stable")
    bounds = np.flatnonzero(np.diff(terms[order], prepend=-1, append=-2))
    for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        its = order[a:b]
        number = int(terms[its[0]])
        index = begin[its][:, None] + np.arange(width[number])
        yield number, (step[its], piece.values[index])


def _impulses(
    client: int,
    steps: Int64,
    times_s: Float64,
    status: Int64,
    remainder: Float64,
    blocks: list[tuple[int, Int64, Float64]],
) -> Impulses:
    """Return the impulses of all causes as one event, ordered by step."""
    none = np.empty(0, np.int64)
    rows = np.concatenate([none, *(rows for _, rows, _ in blocks)])
    causes = np.concatenate([none, *(np.full(len(rows), one) for one, rows, _ in blocks)])
    width = np.concatenate([none, *(np.full(len(r), b.shape[1]) for _, r, b in blocks)])
    order = np.argsort(rows, kind="stable")
    begin = np.empty(len(order), np.int64)
    begin[order] = np.cumsum(width[order]) - width[order]
    flat, done = np.empty(int(width.sum())), 0
    for _, its, block in blocks:
        at = begin[done : done + len(its)]
        flat[at[:, None] + np.arange(block.shape[1])] = block
        done += len(its)
    counts = np.bincount(rows, minlength=len(steps)).astype(np.int64)
    widths = np.bincount(rows, weights=width, minlength=len(steps)).astype(np.int64)
    return Impulses(
        client,
        steps,
        times_s,
        status.astype(np.int64),
        remainder,
        counts,
        widths,
        causes[order],
        flat,
    )
