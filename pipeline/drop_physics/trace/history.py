"""All recorded data of a run, in order, as the analysis reads them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import PurePath
from typing import Protocol, TypeVar

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.errors import ScenarioError
from drop_physics.trace.events import (
    Appearance,
    ArrayUse,
    Body,
    Dynamics,
    EngineWarning,
    EpisodeEnd,
    Equality,
    Event,
    ImpulseCause,
    Impulses,
    Put,
    Samples,
    Sensor,
    Settings,
    SolverStop,
    Surface,
)
from drop_physics.trace.log import Log
from drop_physics.trace.poses import inertial_frames, links_of, rows_of, tree_of
from drop_physics.trace.readings import Answer, Reading
from drop_physics.trace.states import (
    BASE,
    BASE_STATE,
    MOTION,
    STATE,
    Joints,
    Rows,
    between,
    by_body,
    motion_of,
)

T = TypeVar("T")

PIECE, LEAST, NUMBERS = 1 << 13, 1 << 5, 1 << 18
"""Largest and smallest number of steps in a chunk, and most numbers (degrees of freedom of all
bodies times steps)."""
DEFAULT_ENGINE = "PyBullet"
"""The engine of a recording in which none is named."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A chunk of consecutive steps of all simulations: samples, and the calls between them."""

    first: int
    """Index of the chunk's first step."""
    end: int
    """Index after the chunk's last step."""
    bases: Rows
    """States of bases, of dtype `BASE_STATE`: one row per step and movable base, in step order."""
    joints: Mapping[int, Joints]
    """Joint states, by body id."""
    forces: Mapping[tuple[int, int], tuple[Int64, Float64]]
    """Steps and forces of each constraint, by client and the engine's constraint id."""
    contacts: Rows
    """Contact points, of dtype `CONTACT`, in step order."""
    calls: Log
    impulses: Mapping[int, Sequence[Impulses]] = field(default_factory=dict)
    """The impulses in the steps, by client, if the engine replayed them."""
    controls: Mapping[int, tuple[Int64, Float64]] = field(default_factory=dict)
    """Steps and actuator controls, by client; the first row is the last one before the chunk."""


class Sampled(Protocol):
    """A source of samples, read chunk by chunk."""

    @property
    def first(self) -> int:
        """The first step with any sample; 0 if there is none."""

    @property
    def last(self) -> int:
        """The last step with any sample; -1 if there is none."""

    def piece(self, first: int, end: int) -> Piece:
        """Return the samples of the steps from `first` up to, not including, `end`."""


@dataclass(frozen=True)
class HeldSamples:
    """Samples in memory, for a simulation without a recording."""

    bases: Rows
    """States of dtype `BASE_STATE`, in step order."""
    contacts: Rows
    """Contact points of dtype `CONTACT`, in step order."""
    joints: Mapping[int, Joints] = field(default_factory=dict)
    """Joint states, by body id."""

    @classmethod
    def of(cls, parts: Sequence[Samples]) -> HeldSamples:
        """Join consecutive samples of one simulation."""
        return cls(
            np.concatenate([rows_of_bases(part) for part in parts]),
            np.concatenate([part.contacts for part in parts]),
            {
                number: Joints.joined([part.joints[number] for part in parts])
                for number in parts[0].joints
            },
        )

    @property
    def first(self) -> int:
        """Step of the first sample."""
        return int(self.bases["step"][0])

    @property
    def last(self) -> int:
        """Step of the last sample."""
        return int(self.bases["step"][-1])

    def piece(self, first: int, end: int) -> Piece:
        """Return the samples of the steps from `first` up to, not including, `end`."""
        joints = {
            number: joint.at((joint.steps >= first) & (joint.steps < end))
            for number, joint in self.joints.items()
        }
        bases, contacts = (between(each, first, end) for each in (self.bases, self.contacts))
        return Piece(first, end, bases, joints, {}, contacts, Log())


Softness = tuple[tuple[float, ...], tuple[float, ...]]
"""`solref` and `solimp` of a contact, as in `PairFriction`."""


@dataclass(frozen=True)
class Seen:
    """Everything recorded of a run; lists are in the order of events."""

    bodies: Mapping[int, Body]
    """Bodies by id, each in its latest state."""
    appearances: list[Appearance]
    surfaces: list[Surface]
    """Surfaces of hollow meshes that the engine replaces by their hulls."""
    dynamics: list[Dynamics]
    settings: list[Settings]
    solvers: list[SolverStop]
    """One entry for each simulation and iteration limit for which the solver stopped early."""
    readings: list[Reading]
    """The lines of the script that read the simulation's state."""
    puts: list[Put]
    samples: Mapping[int, int]
    """Number of samples of each simulation, by client; empty if unknown."""
    sampled: Sampled
    real_time: bool
    """Whether the script requested real-time simulation, and was stepped by a virtual clock
    instead."""
    unseeded: tuple[str, ...]
    """The script lines that drew random numbers without a seed."""
    machine: str
    """Kind of processor; empty if unknown."""
    causes: Mapping[int, ImpulseCause] = field(default_factory=dict)
    """Causes of impulses, by their index in the recording."""
    frictions: Mapping[tuple[int, int, int, int], float] = field(default_factory=dict)
    """Coefficients of friction by pair of bodies and links, if the engine has one for each pair."""
    softness: Mapping[tuple[int, int, int, int], Softness] = field(default_factory=dict)
    """`solref` and `solimp` by pair of bodies and links, as in `frictions`."""
    condims: Mapping[tuple[int, int, int, int], tuple[int, float]] = field(default_factory=dict)
    """`condim` and rolling friction by pair of bodies and links, as in `frictions`."""
    can_replay: bool = False
    """Whether the recording contains the data with which the engine can replay the steps."""
    windows: Sequence[tuple[int, int, int]] = ()
    """Ranges of steps that were explained after the recording: client, first and end (exclusive),
    by start sample; empty if all steps were explained at once."""
    warnings: Sequence[EngineWarning] = ()
    equalities: Sequence[Equality] = ()
    episode_ends: Sequence[EpisodeEnd] = ()
    """The ends of episodes, as gymnasium environments reported them."""
    cuts: Sequence[int] = ()
    """Samples at which a chunk must begin."""
    sensors: Sequence[Sensor] = ()
    array_uses: Sequence[ArrayUse] = ()

    @property
    def engine(self) -> str:
        """Name and version of the engine; for PyBullet, the name only."""
        return next((each.engine for each in self.settings if each.engine), DEFAULT_ENGINE)

    @property
    def w_first(self) -> bool:
        """Whether the engine's quaternions begin with w; PyBullet's end with it."""
        return self.engine != DEFAULT_ENGINE

    @property
    def moving(self) -> list[int]:
        """Ids of the bodies that can move."""
        return [number for number, body in self.bodies.items() if body.moving]

    def steps_of(self, client: int) -> int:
        """Return the number of steps of a simulation; 0 if unknown."""
        return self.samples.get(client, 1) - 1

    def freedom(self, client: int, index: int) -> tuple[Body, int] | None:
        """Return the body that has an engine's degree of freedom, and its index among the body's.

        The three linear velocities of a free base are the first, and its angular ones the next.
        """
        for body in self.bodies.values():
            if body.client != client:
                continue
            if index < body.freedoms:
                return body, index
            index -= body.freedoms
        return None

    def clients_with(self, setting: str, value: float) -> set[int]:
        """Return the simulations in which an engine setting ever had the given value."""
        return {
            each.client
            for each in self.settings
            if setting in each.values and float(np.ravel(each.values[setting])[0]) == value
        }

    def soft(self, bodies: Sequence[int], links: Sequence[int]) -> Softness | None:
        """Return the softness of the contact between two links, if the engine reports it."""
        (a, b), (i, k) = bodies, links
        return self.softness.get((a, i, b, k), self.softness.get((b, k, a, i)))

    def measured(self, kind: str, client: int) -> dict[str, Answer]:
        """Return the first component of a simulation's sensors of one kind, by sensor name."""
        return {
            sensor.name: sensor.answers[0]
            for sensor in self.sensors
            if sensor.kind == kind and sensor.client == client
        }

    def condim(self, bodies: Sequence[int], links: Sequence[int]) -> tuple[int, float]:
        """Return the dimension (`condim`) and the rolling friction of two links' contacts."""
        (a, b), (i, k) = bodies, links
        return self.condims.get((a, i, b, k), self.condims.get((b, k, a, i), (3, 0.0)))

    def piece_steps(self, most: int = PIECE, numbers: int = NUMBERS) -> int:
        """Return the chunk size in steps, limited by `most` and by the degrees of freedom."""
        freedoms = sum(body.freedoms for body in self.bodies.values() if not body.soft)
        return min(most, max(LEAST, numbers // max(freedoms, 1)))

    def pieces(self, steps: int = 0) -> Iterator[Piece]:
        """Yield the samples in chunks of `steps` steps, or of as many as fit into memory."""
        steps = steps or self.piece_steps()
        first, last = self.sampled.first, self.sampled.last
        # A piece is all explained, or not at all.
        edges = {edge + 1 for _, *both in self.windows for edge in both} | {*self.cuts}
        bounds = [first, *sorted(edge for edge in edges if first < edge <= last), last + 1]
        for begin, end in pairwise(bounds):
            for at in range(begin, end, steps):
                yield self.sampled.piece(at, min(at + steps, end))

    @cached_property
    def _whole(self) -> Piece:
        return self.sampled.piece(self.sampled.first, self.sampled.last + 1)

    @property
    def bases(self) -> Rows:
        """States of dtype `BASE_STATE`: one row per step and movable base, in step order."""
        return self._whole.bases

    @property
    def joints(self) -> Mapping[int, Joints]:
        """Joint states in all steps, by body id."""
        return self._whole.joints

    @property
    def contacts(self) -> Rows:
        """Contact points of dtype `CONTACT`, in step order."""
        return self._whole.contacts

    @property
    def calls(self) -> Log:
        """All calls of the script."""
        return self._whole.calls

    @cached_property
    def states(self) -> Rows:
        """States of dtype `STATE`, one row per step and part, ordered by body, link and step."""
        parts: dict[tuple[int, int], list[Rows]] = {}
        for piece in self.pieces():  # contacts of all steps would take four times as much
            for part, states in self.parts_of(piece).items():
                parts.setdefault(part, []).append(states)
        return joined({part: np.concatenate(held) for part, held in parts.items()})

    def parts_of(self, piece: Piece) -> dict[tuple[int, int], Rows]:
        """Return the states of each movable part in a chunk, by body and link."""
        bases = by_body(piece.bases)
        parts: dict[tuple[int, int], Rows] = {}
        for number, body in self.bodies.items():
            base, joints = bases.get(number), piece.joints.get(number)
            if joints is not None:
                steps = joints.steps
            elif base is not None:
                steps = base["step"]
            else:
                continue
            if len(body.links) == 1 and base is not None:
                parts[number, BASE] = rows_of(number, base["step"], motion_of(base)[:, None])
                continue
            states = rows_of(number, steps, self.motions(body, steps, base, joints))
            by_link = states.reshape(len(steps), -1)
            for link in body.moving:
                parts[number, link] = by_link[:, link + 1]
        return parts

    def motions(
        self, body: Body, steps: Int64, base: Rows | None, joints: Joints | None
    ) -> Float64:
        """Return the motions of base and links, shape (n, links, 13)."""
        first = next(each for each in self.dynamics if each.body.number == body.number)
        tree = tree_of(body.joints, inertial_frames(first.reported))
        sampled = np.empty(0, np.int64) if base is None else base["step"]
        motion = np.zeros((len(steps), 13))
        puts = [put for put in self.puts if put.body.number == body.number]
        if puts and len(sampled) < len(steps):  # a base that only calls move, at least at first
            which = np.searchsorted([put.at.step for put in puts], steps, side="right") - 1
            motion = np.array([put.base for put in puts])[np.maximum(which, 0)]
        if base is not None:
            within = np.isin(sampled, steps)
            motion[np.searchsorted(steps, sampled[within])] = motion_of(base)[within]
        if joints is not None and len(joints.steps) != len(steps):
            joints = joints.at(np.isin(joints.steps, steps))
        return links_of(tree, motion, joints)


def rows_of_bases(seen: Samples) -> Rows:
    """Return the states of bases as rows of dtype `BASE_STATE`, ordered by step and body id."""
    numbers = sorted(seen.bases)
    rows = np.empty((len(seen.steps), len(numbers)), BASE_STATE)
    rows["step"] = seen.steps[:, None]
    rows["body"] = numbers
    for column, number in enumerate(numbers):
        for name, part in MOTION.items():
            rows[name][:, column] = seen.bases[number][:, part]
    return rows.reshape(-1)


def seen_in(events: Iterable[Event]) -> Seen:
    """Build the record of one simulation from its events in memory."""
    told = [*events]

    def those(kind: type[T]) -> list[T]:
        return [each for each in told if isinstance(each, kind)]

    appearances, sampled = those(Appearance), HeldSamples.of(those(Samples))
    return Seen(
        bodies={appearance.body.number: appearance.body for appearance in appearances},
        appearances=appearances,
        surfaces=[],
        dynamics=those(Dynamics),
        settings=those(Settings),
        solvers=[],
        readings=[],
        puts=[],
        samples={0: sampled.last + 1},
        sampled=sampled,
        real_time=False,
        unseeded=(),
        machine="",
    )


def joined(parts: Mapping[tuple[int, int], Rows]) -> Rows:
    """Concatenate the states of all parts, in the order of body, link and step."""
    return np.concatenate([np.empty(0, STATE), *(rows for _, rows in sorted(parts.items()))])


def names_of_body(body: Body) -> Iterator[str]:
    """Yield the names of a body, its links, joints and actuators."""
    yield from (body.label, body.short, body.name, PurePath(body.name).stem, *body.links)
    yield from (joint.name for joint in body.joints)
    yield from (actuator.name for actuator in body.actuators)


def body_named(bodies: Iterable[Body], which: str) -> Body:
    """Return the body with an id, label or name; a file's suffix may be omitted from the name.

    Raises
    ------
    ScenarioError
        If no body, or several bodies, match.
    """
    candidates = list(bodies)
    matches = [
        body
        for body in candidates
        if which in {str(body.number), body.label, body.short, body.name, PurePath(body.name).stem}
    ]
    if len(matches) == 1:
        return matches[0]
    shown = matches or candidates
    listed = ", ".join(f"{body.number} ({body.name})" for body in shown[:10])
    listed += " …" if len(shown) > 10 else ""
    if matches:
        raise ScenarioError(
            "--body must be a body of the recording, got {which!r}, the name of several; "
            "use a number: {listed}",
            which=which,
            listed=listed,
        )
    raise ScenarioError(
        "--body must be a body of the recording, got {which!r}, which is none; it has: {listed}",
        which=which,
        listed=listed,
    )
