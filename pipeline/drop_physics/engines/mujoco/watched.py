"""Converts messages of a MuJoCo script's process into events of a recording.

`received` assembles the stream into chunks. This module converts a chunk into bodies, samples, and
values set between two steps, with the script's lines.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import (
    DescribedBody,
    DescribedModel,
    base_of,
    described,
    joints_of,
    normalized,
    reported_of,
    standing_base,
    xyzw,
)
from drop_physics.engines.mujoco.explain.asked import answers_in
from drop_physics.engines.mujoco.explain.reasons import EXPLAINED, OTHER
from drop_physics.engines.mujoco.framed import FramesOfSteps, KeptFrames, shared_by
from drop_physics.engines.mujoco.frames import CAUSES
from drop_physics.engines.mujoco.held import equalities_of
from drop_physics.engines.mujoco.impulses import ExplainedSteps
from drop_physics.engines.mujoco.received import (
    Edited,
    Received,
    ReceivedWrite,
    ScriptLine,
    StepPiece,
)
from drop_physics.engines.mujoco.sensed import sensors_of
from drop_physics.engines.mujoco.stepping import Stepper, StepsWanted
from drop_physics.engines.surfaces import surfaces_of
from drop_physics.engines.watching.pipe import EXTREMES
from drop_physics.engines.whole_episodes import WholeEpisodes
from drop_physics.fields import all_of, counted
from drop_physics.messages import Message
from drop_physics.temporary import TemporaryFolder
from drop_physics.trace.acts import PICTURE
from drop_physics.trace.events import (
    Appearance,
    ArrayUse,
    At,
    Calls,
    Controls,
    Dynamics,
    EngineWarning,
    EpisodeEnd,
    Event,
    Put,
    Samples,
    Settings,
    Site,
    located,
)
from drop_physics.trace.frames import ModelPart
from drop_physics.trace.states import CONTACT, Joints

OLDEST = "3.3"
"""The oldest version of MuJoCo whose scripts are recorded."""
Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

GIVEN_FIRST = ("ctrl", "qfrc_applied", "xfrc_applied")
"""State parts that a script may have set before its first step, and that are zero otherwise."""
STATE = ("qpos", "qvel", "act", "ctrl", "qfrc_applied", "xfrc_applied", "eq_active")
PLACES = ("mocap_pos", "mocap_quat")
"""The state parts with the poses of mocap bodies, which only scripts write."""
MOVING = ("qpos", "qvel")
MOVES = frozenset((*MOVING, *PLACES))
"""The state parts with positions and velocities of bodies."""
BY_MEMORY = frozenset(("memory", *CAUSES[CAUSES.index("mj_forward") :]))
"""Causes of changes that the script made by writing memory, without a call."""
SILENT = "step"
"""The cause of a state that is no act of the script: MuJoCo's reset within a step."""
IMPORTED = "imported"
"""The cause of an input from another program, which is no call either."""
PLACES_BODIES = re.compile(r"opt\.|body_i?(pos|quat)|jnt_|qpos0|geom_(type|size|pos|quat)")
"""Model fields that determine the positions of bodies and shapes, or the time."""
SHAPES_BODIES = re.compile(r"body_|jnt_|dof_|geom_|qpos0")
"""Model fields that define a model's bodies."""
_FULL = "inertia", "contacts full", "constraints full"
_BAD = "bad position", "bad velocity", "bad acceleration", "bad control"
WARNINGS = {7: (*_FULL, *_BAD), 8: (*_FULL, "drawing full", *_BAD)}
"""Names of MuJoCo's warnings (`mjtWarning`), by the number of warning types in a version."""
PART_BYTES = 1 << 20
"""Number of bytes of a compiled model in one event."""
MOST_NOTES = 3
"""Largest number of different texts that are kept for one kind of note."""


@dataclass
class MujocoSimulation:
    """The received steps of one MjData with one model."""

    client: int
    model: int
    first: int
    """Index of the simulation's first step among all steps of the MjData."""
    described: DescribedModel
    number: int
    """Id of the simulation's first body."""
    held: dict[str, NDArray[Any]]
    """The current parts of the state, flat."""
    held_at: int
    """Number of steps that the MjData had made when `held` was updated."""
    arrays: Mapping[str, NDArray[Any]]
    """The model's constants, including edits."""
    frames: FramesOfSteps
    folder: Path
    """The folder for meshes of this simulation's model; meshes of another model may have the same
    names."""
    apart_s: float | None = None
    """The time between two consecutive states [s], if it differs from the model's timestep."""
    began: bool = False
    start: dict[str, NDArray[Any]] | None = None
    """The state before the simulation's first step."""
    last: dict[str, NDArray[Any]] = field(default_factory=dict)
    """The state after the last step of a chunk."""
    since_step: int = 0
    since_s: float = 0.0
    timestep_s: float = 0.0
    ends: int = 0
    """The last step for which there is a sample."""
    warned: dict[int, EngineWarning] = field(default_factory=dict)
    """MuJoCo's warnings, by warning type."""
    given: dict[int, Float64] = field(default_factory=dict)
    """The actuator controls of a chunk, by step, where they changed."""
    ctrl: Float64 | None = None
    """The actuator controls in the last step."""
    since: list[tuple[int, float, float]] = field(default_factory=list)
    """The changes of the timestep: the step, its time [s], and the timestep from that step on [s].
    """

    def times_s(self, steps: Int64) -> Float64:
        """Return the times of steps: sums of the preceding timesteps [s]."""
        return self.since_s + (steps - self.since_step).astype(np.float64) * self.timestep_s

    def times_then_s(self, steps: Int64) -> Float64:
        """Return the times of samples in a run whose timestep may change [s]."""
        begin, since_s, timestep_s = map(np.array, zip(*self.since, strict=True))
        which = np.maximum(np.searchsorted(begin, steps - 1, side="right") - 1, 0)
        return np.asarray(since_s[which] + (steps - begin[which]) * timestep_s[which])

    def time_s(self, step: int) -> float:
        """Return the time of a step [s]."""
        return self.since_s + (step - self.since_step) * self.timestep_s

    def take(self, written: ReceivedWrite) -> dict[str, Int64]:
        """Store what the script wrote into the state; return the indices that changed, by array."""
        changed = {}
        for name, (indices, values) in written.parts.items():
            old = self.held.get(name)
            if indices is None:
                new = np.array(values, np.float64)
                differs = np.arange(len(new))
                if old is not None and len(old) == len(new):
                    differs = np.flatnonzero(old.view(np.uint64) != new.view(np.uint64))
            else:
                size = 1 + int(indices.max()) if len(indices) else 0
                new = np.zeros(size) if old is None else old.copy()
                if len(new) < size:
                    new = np.concatenate((new, np.zeros(size - len(new))))
                new[indices] = values
                differs = indices.astype(np.int64)
            self.held[name] = new
            changed[name] = differs
        return changed


@dataclass
class _Rows:
    """Calls of the script, collected until they are recorded."""

    steps: list[int] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    sites: list[int] = field(default_factory=list)
    values: list[Float64] = field(default_factory=list)


def _is_older(version: str) -> bool:
    """Return whether a MuJoCo version is older than the oldest supported one."""
    numbers, oldest = (tuple(map(int, re.findall(r"\d+", each)[:2])) for each in (version, OLDEST))
    return numbers < oldest


class MujocoDecoder:
    """Decodes the messages of a script's process into events, in order; call `close` at the end.

    The decoder owns a temporary folder for the files of replays.

    Parameters
    ----------
    whole
        The filter that decides which episodes are recorded.
    """

    def __init__(self, whole: WholeEpisodes | None = None) -> None:
        self._whole = whole or WholeEpisodes()
        self._temporary: TemporaryFolder | None = None
        self._folder: Path | None = None
        self._frames = KeptFrames()
        self._received: Received | None = None
        self._simulations: dict[tuple[int, int], MujocoSimulation] = {}
        self._latest: dict[int, MujocoSimulation] = {}
        """The latest simulation of each MjData."""
        self._bodies = 0
        """Number of bodies of all simulations."""
        self._described_before: dict[str, tuple[DescribedBody, ...]] = {}
        """The bodies of each model, by its digest, since many simulations may use the same model.
        """
        self._models: dict[str, int] = {}
        """The numbers of models in the recording, by digest."""
        self._told: set[int] = set()
        """Numbers of the models that the recording already has."""
        self._edited: set[int] = set()
        """The edits that were recorded, by `id` of their values, which are kept alive."""
        self._kept: list[NDArray[Any]] = []
        self._sites: dict[tuple[str, str, int, int], int] = {}
        """Numbers of call sites, by written field, form, and the lines of the detecting and of the
        previous call."""
        self._shown: dict[tuple[str, str, str, int], int] = {}
        """Numbers of call sites, by their displayed form."""
        self._new_sites: list[Site] = []
        self._calls = 0
        self.samples = self.replayed = self.explains = 0
        """Number of samples; of steps replayed to the bit; and of those whose sum closes."""
        self.remainder = 0.0
        """Largest remainder of a step, as a share of its largest term."""

    @property
    def lost(self) -> int:
        """Number of simulations that could not be followed."""
        return 0 if self._received is None else len(self._received.faults)

    def close(self) -> None:
        """Delete the temporary files."""
        self._frames.close()
        if self._temporary is not None:
            self._temporary.close()

    @property
    def steps(self) -> int:
        """Number of steps that all simulations have made."""
        return 0 if self._received is None else self._received.steps

    @property
    def kept_steps(self) -> int:
        """Number of steps that the recording keeps."""
        return 0 if self._received is None else self._received.steps - self._received.left_out

    @property
    def is_long(self) -> bool:
        """True if there are too many steps to explain right after recording."""
        return self._frames.is_full

    @property
    def version(self) -> str:
        """MuJoCo's version; empty until it is known."""
        return "" if self._received is None else self._received.version

    @property
    def time_s(self) -> float:
        """The simulated time of the most advanced simulation so far [s]."""
        return max(
            (simulation.time_s(simulation.ends) for simulation in self._simulations.values()),
            default=0.0,
        )

    def take(self, payload: bytes) -> Iterable[Event]:
        """Return the events that a message contains."""
        if self._received is None:
            self._temporary = TemporaryFolder()
            self._folder = self._temporary.path
            self._received = Received(self._folder, self._whole)
        pieces = self._received.take(payload)
        return self._on_pieces(pieces) if pieces else ()

    def rest(self, answers: Float64) -> Iterator[Event]:
        """Yield the remaining events after the last message.

        `answers` contains the extremes of sensor readings, from the memory shared with the script's
        process.
        """
        if self._received is not None:
            yield from self._on_pieces(self._received.rest())
            if not self.steps:
                for world, model in self._received.idle:
                    yield self._settings(self._simulation(world, model, 0), At(0, 0.0, 0))
            yield from self._array_uses()
        for (world, _), its in self._simulations.items():
            yield from its.warned.values()
            if self._received is not None and world in self._received.sensed and its.ends:
                begin, numbers = self._received.sensed[world]
                kept = answers[begin : begin + EXTREMES * numbers].reshape(EXTREMES, numbers)
                yield from sensors_of(its.described, its.client, kept)

    def _array_uses(self) -> Iterator[ArrayUse]:
        """Yield the lines by which the script uses arrays to another effect than it seems."""
        assert self._received is not None
        for (world, use, name, site), told in self._received.array_uses.items():
            its = self._simulations.get((world, told["model"]))
            if its is None or not its.ends:
                continue
            line = self._received.sites[site]
            first, last = (max(told[key] - its.first, 0) for key in ("first", "last"))
            yield ArrayUse(
                At(first, its.time_s(first), self._calls),
                its.client,
                use,
                name,
                line.file,
                line.line,
                told["count"],
                last,
                told.get("size", 0.0),
                told.get("element", ""),
                told.get("old", 0.0),
                tuple(told.get("others", ())),
            )

    def explained(self, python: str) -> Iterator[Event]:
        """Replay and explain all steps of a short run; yield the explanations as events.

        Parameters
        ----------
        python
            The script's interpreter.

        Raises
        ------
        DropError
            If the replaying process ends before all steps are replayed.
        """
        if self._received is None or not self.steps or self.is_long:
            return
        numbers = itertools.count()
        of_client = {its.client: its for its in self._simulations.values()}
        made = {client: ExplainedSteps(client, its.described) for client, its in of_client.items()}
        with Stepper(python, self.version) as stepper:
            for wanted, piece in stepper.explained(self._wanted()):
                its = of_client[wanted.frames.client]
                steps = piece.first + 1 + np.arange(len(piece.status), dtype=np.int64)
                self.replayed += int((piece.status != OTHER).sum())
                self.explains += int((piece.status == EXPLAINED).sum())
                closes = piece.remainder[piece.status[piece.steps - piece.first] == EXPLAINED]
                self.remainder = max(self.remainder, float(closes.max(initial=0.0)))
                times_s = its.times_then_s(steps)
                yield from made[its.client].events(piece, wanted.frames, times_s, numbers)

    def _wanted(self) -> Iterator[StepsWanted]:
        """Yield requests to replay all steps, one simulation after the other."""
        assert self._folder is not None
        files = {number: self._folder / f"{digest}.mjb" for digest, number in self._models.items()}
        for frames in self._frames.in_order():
            yield StepsWanted(files[frames.model], frames, 0, len(frames))

    def notes(self) -> Iterator[Message]:
        """Yield warnings about the recording."""
        received = self._received
        if received is None:
            return
        for each in received.uncaught[:MOST_NOTES]:
            place = located(each["file"], each["line"]) if each["file"] else ""
            if place:
                yield Message(
                    "what {name} does, at {place}, is not recorded: it steps outside of mj_step",
                    name=each["name"],
                    place=place,
                )
            else:
                yield Message(
                    "what {name} does is not recorded: it steps outside of mj_step",
                    name=each["name"],
                )
        if not received.steps and received.posed_without_steps:
            yield Message(
                "no step was seen: positions change between {calls} of mj_forward, so the script "
                "sets them itself",
                calls=counted(1 + max(received.posed_without_steps.values()), "call"),
            )
        if received.warnings:
            shown: list[str] = list(received.warnings[:MOST_NOTES])
            yield Message("MuJoCo warned: {warnings}", warnings=all_of(shown))
        if received.faults and _is_older(received.version):
            yield Message(
                "{engine} {version} is too old to be read; with {oldest} or later it is: "
                "pip install 'mujoco>={oldest}'",
                engine="MuJoCo",
                version=received.version,
                oldest=OLDEST,
            )
            return
        for fault in received.faults[:MOST_NOTES]:
            yield Message("a simulation could not be read: {error}", error=fault)

    # -- pieces -----------------------------------------------------------------------------------

    def _on_pieces(self, pieces: Iterable[StepPiece]) -> Iterator[Event]:
        for piece in pieces:
            yield from self._on_piece(piece)

    def _on_piece(self, piece: StepPiece) -> Iterator[Event]:
        """Yield a chunk's events, split at model edits that change the meaning of later samples."""
        simulation = self._simulation(piece.world, piece.model, piece.first)
        self._warned(simulation, piece)
        end = _end(piece)
        edited = [each for each in piece.edited if piece.first < each.step < end]
        cuts = {each.step for each in edited if PLACES_BODIES.match(each.name)}
        if not simulation.began:  # what it is at first is told before any change
            cuts |= {each.step for each in edited[:1]}
        for first, last in zip([piece.first, *sorted(cuts)], [*sorted(cuts), end], strict=True):
            here = [
                each
                for each in piece.edited
                if first <= each.step < last or (last == end and each.step >= end)
            ]
            yield from self._on_steps(simulation, piece, first, last, here)
        shared = shared_by(simulation.described.bodies)
        frames = simulation.frames.of_piece(piece, simulation.timestep_s, shared)
        if simulation.apart_s is None:
            self._frames.add(frames)
            yield frames
        for episode in piece.episodes:
            step = episode.end - simulation.first
            at = At(step, float(simulation.times_then_s(np.array([step]))[0]), self._calls)
            first = max(episode.first - simulation.first, 0)
            yield EpisodeEnd(at, simulation.client, first, **episode.told)

    def _warned(self, its: MujocoSimulation, piece: StepPiece) -> None:
        """Count MuJoCo's warnings in a chunk."""
        assert self._received is not None
        kinds = WARNINGS.get(self._received.warning_kinds, ())
        for step, kind, count, info in piece.warnings:
            sample = step - its.first + 1
            known = its.warned.get(kind)
            if known is None:
                at = At(sample, 0.0, 0)
                known = EngineWarning(at, its.client, kinds[kind], 0, 0, sample, info)
            its.warned[kind] = replace(
                known, count=known.count + count, steps=known.steps + 1, last_step=sample
            )

    def _simulation(self, world: int, number_of_model: int, first: int) -> MujocoSimulation:
        """Return the simulation of an MjData with a model; create it if it is new."""
        key = world, number_of_model
        found = self._simulations.get(key)
        if found is not None:
            return found
        assert self._received is not None
        assert self._folder is not None
        model = self._received.models[number_of_model]
        number, client = self._bodies, len(self._simulations)
        alike = enumerate(self._described_before.get(model.digest, ()), number)
        known = {each: body.as_number(each, client) for each, body in alike}
        folder = self._folder / model.digest
        folder.mkdir(exist_ok=True)
        made = described(model.arrays, client=client, first=number, folder=folder, known=known)
        self._described_before[model.digest] = made.bodies
        before = self._latest.get(world)
        held = {} if before is None else dict(before.held)
        clock_s = 0.0 if before is None else before.frames.clock_s
        which = self._models.setdefault(model.digest, len(self._models))
        frames = FramesOfSteps(client, which, first, held, clock_s)
        found = MujocoSimulation(
            client, number_of_model, first, made, number, held, first, model.arrays, frames, folder
        )
        found.apart_s = self._received.apart_s.get(world)
        self._simulations[key] = self._latest[world] = found
        self._bodies += len(made.bodies)
        return found

    def _on_steps(
        self, its: MujocoSimulation, piece: StepPiece, first: int, end: int, edits: list[Edited]
    ) -> Iterator[Event]:
        """Yield the events of a chunk's steps from `first` to before `end`."""
        assert self._received is not None
        rows, puts = _Rows(), list[Event]()
        changes = list[Event]()
        wrote = [
            each
            for each in piece.written
            if first <= each.step < end or (each.step >= end and end == _end(piece))
        ]
        edits = sorted(edits, key=lambda each: (each.step, each.name))  # as in every run
        acts: list[Edited | ReceivedWrite] = [*edits, *wrote]
        acts.sort(key=lambda each: each.step)
        its.frames.edited(edits)
        for step, together in itertools.groupby(acts, key=lambda act: act.step):
            now = [*together]
            edited = [each for each in now if isinstance(each, Edited)]
            for edit in edited:
                self._on_edit(its, edit, rows)
            if edited and its.began:
                changes += self._changed(its, edited, step - its.first)
            elif edited:
                its.described = self._described(its)
            for each in now:
                if isinstance(each, ReceivedWrite):
                    puts += self._on_written(its, piece, each, rows)
        told = changes
        if not its.began:
            told = [*self._beginning(its), *changes]
        yield from self._new_sites
        self._new_sites = []
        yield from told
        if rows.steps:
            yield self._gathered(its, rows)
        yield from puts
        yield from self._controls(its, first, piece.answers)
        yield self._sampled(its, piece, first, end)

    def _beginning(self, its: MujocoSimulation) -> Iterator[Event]:
        """Yield the events that describe a simulation before its first step."""
        its.began, its.timestep_s = True, _timestep(its)
        at = At(0, 0.0, self._calls)
        if its.apart_s is None:
            yield from self._model(its)
        its.since.append((0, 0.0, its.timestep_s))
        yield self._settings(its, at)
        yield from equalities_of(its.described, its.client)
        # What was written before later steps of the piece is held by now.
        now, its.held = its.held, its.held if its.start is None else its.start
        puts = {
            made.body.number: self._put(its, made, at, counts=False)
            for made in its.described.bodies
            if made.free < 0
        }
        its.held = now
        for made in its.described.bodies:
            yield Appearance(at, made.body, there=True, came=True)
            yield Dynamics(at, made.body, reported_of(its.arrays, made))
            yield from surfaces_of(at, made.body, its.folder)
            if made.body.number in puts:
                yield puts[made.body.number]

    def _model(self, its: MujocoSimulation) -> Iterator[ModelPart]:
        """Yield a simulation's compiled model, unless the recording already has it."""
        assert self._received is not None
        assert self._folder is not None
        digest = self._received.models[its.model].digest
        number = self._models[digest]
        if number in self._told:
            return
        self._told.add(number)
        file = self._folder / f"{digest}.mjb"
        size = file.stat().st_size
        with file.open("rb") as binary:
            for at in range(0, size, PART_BYTES):
                data = binary.read(PART_BYTES)
                engine = f"MuJoCo {self._received.version}"
                yield ModelPart(number, engine, digest, size, at, data)

    def _settings(self, its: MujocoSimulation, at: At) -> Settings:
        assert self._received is not None
        named_options = (name for name in its.arrays if name.startswith("opt."))
        values_of = {name: its.arrays[name] for name in named_options}
        options = {
            name.removeprefix("opt."): value.ravel().tolist()
            if value.size > 1
            else float(value.item())
            for name, value in values_of.items()
            if name not in ("opt.timestep", "opt.gravity")
        }
        gravity = np.ravel(its.arrays["opt.gravity"]).tolist()
        named = {f"gravityAcceleration{axis}": g for axis, g in zip("XYZ", gravity, strict=True)}
        substeps = max(1, round(_timestep(its) / float(its.arrays["opt.timestep"].item())))
        values = {"fixedTimeStep": _timestep(its), "numSubSteps": substeps, **named}
        return Settings(at, its.client, values | options, f"MuJoCo {self._received.version}")

    def _changed(self, its: MujocoSimulation, edits: list[Edited], step: int) -> Iterator[Event]:
        """Yield the settings and bodies that changed because the script edited the model."""
        at = At(step, its.time_s(step), self._calls)
        if any(edit.name.startswith("opt.") for edit in edits):
            its.since_s, its.since_step = its.time_s(step), step
            its.timestep_s = _timestep(its)
            its.since.append((step, its.since_s, its.timestep_s))
            yield self._settings(its, at)
        if not any(SHAPES_BODIES.match(edit.name) for edit in edits):
            return
        before, edited = its.described, _edited_bodies(its, edits)
        its.described = self._described(its, edited)
        for old, new in zip(before.bodies, its.described.bodies, strict=True):
            if new.body.number not in edited:
                continue
            if old.body != new.body:
                yield Appearance(at, new.body, there=True)
            was, now = (reported_of(a, b) for a, b in ((before.arrays, old), (its.arrays, new)))
            same = was.keys() == now.keys()
            same = same and all(np.array_equal(was[n], now[n], equal_nan=True) for n in now)
            if not same:
                yield Dynamics(at, new.body, now)

    def _described(self, its: MujocoSimulation, edited: Set[int] | None = None) -> DescribedModel:
        """Describe the model as bodies of the recording: all, or only those with the given ids."""
        bodies = {made.body.number: made for made in its.described.bodies}
        return described(
            its.arrays,
            client=its.client,
            first=its.number,
            folder=its.folder,
            known={} if edited is None else {n: bodies[n] for n in bodies.keys() - edited},
        )

    # -- states -----------------------------------------------------------------------------------

    def _controls(
        self, its: MujocoSimulation, first: int, answers: Sequence[tuple[int, bytes]]
    ) -> Iterator[Controls]:
        """Yield the actuator controls where they changed; those of callbacks are in effect."""
        names = tuple(its.described.names["actuator"]) if its.apart_s is None else ()
        given, its.given = its.given, {}
        if first == its.first and names:
            given = {first: np.zeros(len(names)), **given}
        if names:
            given = _with_callbacks(its, given, answers)
        if not given or not names or any(len(each) != len(names) for each in given.values()):
            return
        steps = np.array(sorted(given), np.int64)
        values = np.array([given[step] for step in steps.tolist()])
        steps = steps - its.first + 1
        yield Controls(its.client, steps, its.times_s(steps), names, values)

    def _sampled(self, its: MujocoSimulation, piece: StepPiece, first: int, end: int) -> Samples:
        """Return the states after the steps from `first` to before `end`, as samples."""
        begin = its.first == first
        which = slice(first - piece.first, end - piece.first)
        states = {name: piece.parts.get(name, np.zeros((0, 0)))[which] for name in MOVING}
        if begin:  # the state before the first step
            start = its.held if its.start is None else its.start
            states = {
                name: np.vstack((_of_size(start.get(name), rows.shape[1])[None], rows))
                for name, rows in states.items()
            }
        steps = np.arange(first + 1 - begin, end + 1, dtype=np.int64) - its.first
        times_s = its.times_s(steps)
        bases, joints = {}, {}
        for made in its.described.bodies:
            number = made.body.number
            if made.free >= 0:
                bases[number] = base_of(its.arrays, made, states["qpos"], states["qvel"])
            if len(made.rates):
                position, velocity = joints_of(made, states["qpos"], states["qvel"])
                joints[number] = Joints(
                    steps, times_s, position, velocity, np.zeros((len(steps), 0))
                )
        its.last = {name: rows[which][-1].copy() for name, rows in piece.parts.items()}
        if its.held_at < end:
            its.held |= its.last
            its.held_at = end
        its.ends = int(steps[-1])
        self.samples += len(steps)
        return Samples(
            its.client, steps, times_s, self._calls, bases, joints, np.empty(0, CONTACT), {}
        )

    def _put(self, its: MujocoSimulation, made: DescribedBody, at: At, *, counts: bool) -> Put:
        """Return a body's current state, which the script has set, as an event."""
        nq, nv = (int(its.arrays[name].item()) for name in ("nq", "nv"))
        qpos = _of_size(its.held.get("qpos"), nq)[None]
        qvel = _of_size(its.held.get("qvel"), nv)[None]
        base = (
            standing_base(its.arrays, made, self._mocap(its, made))
            if made.free < 0
            else base_of(its.arrays, made, qpos, qvel)[0]
        )
        position, velocity = joints_of(made, qpos, qvel)
        return Put(at, made.body, base, position[0], velocity[0], np.empty(0), counts)

    def _mocap(self, its: MujocoSimulation, made: DescribedBody) -> tuple[Float64, Float64] | None:
        """Return the pose of a mocap body, which the script moves; None for other bodies."""
        which = int(its.arrays["body_mocapid"][made.root]) if made.links[0].of > 0 else -1
        if which < 0 or "mocap_pos" not in its.held:
            return None
        turn = its.held["mocap_quat"][4 * which : 4 * which + 4]
        return its.held["mocap_pos"][3 * which : 3 * which + 3], normalized(xyzw(turn))

    # -- what was set -----------------------------------------------------------------------------

    def _on_written(
        self, its: MujocoSimulation, piece: StepPiece, written: ReceivedWrite, rows: _Rows
    ) -> Iterator[Put]:
        """Apply the script's writes before a step; yield the new states of moved bodies."""
        step = written.step - its.first
        if written.cause == "picture":
            values = np.array([float(written.argument)])
            self._call(PICTURE, written.site, -1, step, "{}", ("key",), values, rows)
            return
        if written.step > its.first and its.start is None:
            its.start = dict(its.held)
        row = written.step - piece.first - 1
        if its.held_at != written.step and row >= 0:  # what the step before left
            for name, held in piece.parts.items():
                its.held[name] = held[row]
        its.held_at = written.step
        if written.cause == "posed":
            its.frames.posed(written, its.held)
            return
        changed = its.take(written)
        its.frames.wrote(written, its.held, piece)
        if "ctrl" in changed:
            its.given[written.step] = its.held["ctrl"]
        if written.cause == SILENT:
            return
        if written.cause == "first":
            for name in GIVEN_FIRST:
                if name in changed and its.held[name].any():
                    self._set(its, written, step, name, changed[name], rows)
            return
        if written.cause in BY_MEMORY:
            for name in (*STATE, *PLACES):
                if name in changed and len(changed[name]):
                    self._set(its, written, step, name, changed[name], rows)
        elif written.cause != IMPORTED:
            names: tuple[str, ...] = ()
            values = np.empty(0)
            if written.cause == "mj_resetDataKeyframe":
                names, values = ("key",), np.array([float(written.argument)])
            form = ", ".join("key={}" for _ in names)
            self._call(written.cause, written.site, -1, step, form, names, values, rows)
        if step == 0 or not changed.keys() & MOVES:  # the first sample follows it
            return
        at = At(step, its.time_s(step), self._calls)
        for made in its.described.bodies:
            if self._moves(its, made, changed):
                yield self._put(its, made, at, counts=True)

    def _moves(
        self, its: MujocoSimulation, made: DescribedBody, changed: Mapping[str, Int64]
    ) -> bool:
        """Return whether the script's writes changed the pose or velocity of a body."""
        if made.links[0].of > 0 and (which := int(its.arrays["body_mocapid"][made.root])) >= 0:
            for name, width in (("mocap_pos", 3), ("mocap_quat", 4)):
                if (changed.get(name, np.empty(0, np.int64)) // width == which).any():
                    return True
        for name, places, kind, width in (
            ("qpos", made.positions, "qpos", 7),
            ("qvel", made.rates, "dof", 6),
        ):
            where = changed.get(name)
            if where is None or not len(where):
                continue
            if made.free >= 0:
                at = int(its.arrays[f"jnt_{kind}adr"][made.free])
                places = np.concatenate((places, np.arange(at, at + width)))
            if np.isin(where, places).any():
                return True
        return False

    def _set(
        self,
        its: MujocoSimulation,
        written: ReceivedWrite,
        step: int,
        name: str,
        where: Int64,
        rows: _Rows,
    ) -> None:
        """Record that the script wrote a state array, such as `ctrl`, or elements of it."""
        held = its.held[name]
        if len(where) == len(held):
            form, names, values = _blanks(len(held)), (name,) * len(held), held
        else:
            form = ", ".join("[{}]={}" for _ in where)
            names = ("index", name) * len(where)
            values = np.stack((where.astype(np.float64), held[where]), axis=1).ravel()
        if written.cause in BY_MEMORY - {"memory"}:
            form += f"; then {written.cause}"
        self._call(name, written.site, written.since, step, form, names, values, rows)

    def _on_edit(self, its: MujocoSimulation, edit: Edited, rows: _Rows) -> None:
        """Record that the script edited model elements."""
        its.arrays = _edited(its.arrays, edit)
        if id(edit.new) in self._edited:
            return
        self._edited.add(id(edit.new))
        self._kept.append(edit.new)
        new, old = edit.new.astype(np.float64), edit.old.astype(np.float64)
        names: tuple[str, ...]
        if its.arrays.get(edit.name, np.zeros(2)).size == 1:
            form, names, values = "{}, was {}", (edit.name, "before"), np.array([*new, *old])
        else:
            form = ", ".join("[{}]={} was {}" for _ in new)
            names = ("index", edit.name, "before") * len(new)
            values = np.stack((edit.indices.astype(np.float64), new, old), axis=1).ravel()
        step = max(edit.step - its.first, 0)
        self._call(edit.name, edit.site, edit.since, step, form, names, values, rows)

    def _call(
        self,
        function: str,
        site: int,
        since: int,
        step: int,
        form: str,
        names: tuple[str, ...],
        values: Float64,
        rows: _Rows,
    ) -> None:
        """Record an act of the script as a call from its line."""
        number = self._sites.get((function, form, site, since))
        if number is None:
            number = self._site(function, form, site, since, names)
        rows.steps.append(step)
        rows.numbers.append(self._calls)
        rows.sites.append(number)
        rows.values.append(values)
        self._calls += 1

    def _site(self, function: str, form: str, site: int, since: int, names: tuple[str, ...]) -> int:
        """Return the index of a call site in the recording; add the site if it is new."""
        assert self._received is not None
        line, key = self._received.sites[site], (function, form, site, since)
        if since >= 0 and since != site:
            form += f"; after {_place(self._received.sites[since])}"
        shown = function, form, line.file, line.line
        number = self._shown.get(shown)
        if number is None:
            number = self._shown[shown] = len(self._shown)
            whole = tuple(name in ("index", "key") for name in names)
            form = form.replace("{", "{{").replace("}", "}}").replace("{{}}", "{}")
            self._new_sites.append(Site(number, function, line.file, line.line, form, names, whole))
        self._sites[key] = number
        return number

    def _gathered(self, its: MujocoSimulation, rows: _Rows) -> Calls:
        steps = np.array(rows.steps, np.int64)
        return Calls(
            its.client,
            steps,
            its.times_s(steps),
            np.array(rows.numbers, np.int64),
            np.array(rows.sites, np.int64),
            np.concatenate(rows.values),
            np.full(len(steps), np.nan),
        )


@cache
def _blanks(count: int) -> str:
    """Return a placeholder for the arguments of a recorded write of `count` numbers."""
    return ", ".join("{}" for _ in range(count))


def _end(piece: StepPiece) -> int:
    return piece.first + len(piece.times_s)


def _of_size(held: NDArray[Any] | None, size: int) -> Float64:
    """Return a state array; zeros if the script's process never sent it."""
    found = np.zeros(size)
    if held is not None:
        found[: len(held)] = held[:size]
    return found


def _timestep(its: MujocoSimulation) -> float:
    return its.apart_s or float(its.arrays["opt.timestep"].item())


def _place(line: ScriptLine) -> str:
    return located(line.file, line.line)


def _edited(arrays: Mapping[str, NDArray[Any]], edit: Edited) -> Mapping[str, NDArray[Any]]:
    """Return a model's constants with an edit applied."""
    if edit.name not in arrays:
        return arrays
    held = np.array(arrays[edit.name])
    held.reshape(-1)[edit.indices] = edit.new
    return {**arrays, edit.name: held}


def _edited_bodies(its: MujocoSimulation, edits: list[Edited]) -> set[int]:
    """Return the ids of the bodies that edits changed."""
    arrays, link_of, found = its.arrays, its.described.link_of, set[int]()
    for edit in edits:
        kind = edit.name.partition("_")[0]
        if kind not in ("body", "jnt", "dof", "geom") or edit.name not in arrays:
            return {made.body.number for made in its.described.bodies}
        held = arrays[edit.name]
        rows = np.unique(edit.indices // max(held.size // len(held), 1))
        bodies = rows if kind == "body" else arrays[f"{kind}_bodyid"][rows]
        found |= {link_of[body][0] for body in bodies.tolist() if body in link_of}
    return found


def _with_callbacks(
    its: MujocoSimulation, given: Mapping[int, Float64], answers: Sequence[tuple[int, bytes]]
) -> dict[int, Float64]:
    """Return controls by the steps where they change, including those that callbacks write."""
    written: dict[int, list[bytes]] = {}
    for step, payload in answers:
        written.setdefault(step, []).append(payload)
    whole: dict[int, Float64] = {}
    for step in sorted({*given, *written}):
        ctrl = given.get(step, its.ctrl)
        for payload in written.get(step, ()):
            for _, parts in answers_in(payload, int(its.arrays["nv"].item())):
                for name, indices, values in parts if isinstance(parts, list) else ():
                    if name == "ctrl" and ctrl is not None:
                        ctrl = ctrl.copy()
                        ctrl[... if indices is None else indices] = values
        if ctrl is None:
            continue
        if step in given or its.ctrl is None or not np.array_equal(ctrl, its.ctrl):
            whole[step] = ctrl
        its.ctrl = ctrl
    return whole
