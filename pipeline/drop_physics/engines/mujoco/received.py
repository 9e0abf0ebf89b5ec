"""Assembles models, steps and writes from the byte stream of a MuJoCo script's process.

`watch` sends the stream; `frames` describes its format.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco import frames
from drop_physics.engines.mujoco.frames import ASLEEP, CAUSES, USER
from drop_physics.engines.whole_episodes import LONGEST_BYTES, Decision, WholeEpisodes

Float64 = NDArray[np.float64]
T = TypeVar("T")

PIECE_STEPS, PIECE_BYTES = 1 << 12, 1 << 22
"""Largest number of steps in a chunk, and of bytes of states."""
LEFT_OUT = "imported"
"""Cause of a state that follows omitted steps, for which there is no call of the script."""
WHERE = struct.Struct("<4xII")
"""Format of simulation and site in a `frames.STEP_HEAD`."""
STEP_HEAD = np.dtype(
    [
        *(("kind", "S1"), ("function", np.uint8), ("zero", np.uint16), ("world", np.uint32)),
        *(("site", np.uint32), ("time_s", np.float64)),
    ]
)
"""Format of a `frames.STEP_HEAD`."""


class Constants(Mapping[str, NDArray[Any]]):
    """The constants of a model that the analysis reads, by MuJoCo's names.

    Options have names such as `opt.timestep`. An array is created from the received bytes on each
    access, since stored arrays would take four times the memory for a small model.

    Parameters
    ----------
    payload
        The bytes of all arrays.
    places
        Type, shape and first byte of each array, by name.
    """

    def __init__(self, payload: bytes, places: Mapping[str, frames.ArrayPlace]) -> None:
        self._payload, self._places = payload, places

    def __getitem__(self, name: str) -> NDArray[Any]:
        found: NDArray[Any] = self._places[name].of(self._payload)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


@dataclass
class MujocoModel:
    """A compiled model, as it was at its first step."""

    number: int
    digest: str
    fields: tuple[tuple[str, np.dtype[Any], tuple[int, ...]], ...]
    """The editable fields: name, type and shape."""
    arrays: Mapping[str, NDArray[Any]]
    """The model's `Constants`."""
    held: dict[int, NDArray[Any]] = field(default_factory=dict)
    """The values of fields that the script has edited, by field index."""


@dataclass(frozen=True)
class ScriptLine:
    """A line of the script that calls MuJoCo, perhaps through a library."""

    file: str
    line: int
    via: str
    via_line: int


WrittenParts = Mapping[str, tuple[NDArray[np.uint32] | None, NDArray[Any]]]
"""Element indices (None for all) and their values, by name of a part of the state."""


class ReceivedWrite(NamedTuple):
    """Values that the script wrote into the state before a step."""

    step: int
    """The first step that uses the values."""
    cause: str
    """The cause of the write, one of `frames.CAUSES`."""
    argument: int
    """The keyframe to which a reset set the state, or the digest of an image."""
    site: int
    """The site where the write was detected, or the site of the call that made it."""
    since: int
    """The site of the previous call, or -1: a write without a call lies between the two."""
    time_s: float
    """The time of the state after the write [s]."""
    parts: WrittenParts
    """The written elements and values."""


class Edited(NamedTuple):
    """Values that the script wrote into model fields during the run."""

    step: int
    """The first step that uses the values."""
    world: int
    """The simulation in whose step or call the edit was detected."""
    model: int
    name: str
    """The field, named as scripts write it: `geom_friction`, `opt.timestep`."""
    indices: NDArray[np.uint32]
    """Indices into the flat array."""
    old: NDArray[Any]
    new: NDArray[Any]
    site: int
    since: int


class EndedEpisode(NamedTuple):
    """An episode of a reinforcement-learning environment that has ended."""

    first: int
    """Number of the simulation's steps before the episode."""
    end: int
    """Number of the simulation's steps at the end of the episode."""
    told: dict[str, Any]
    """The environment's report."""


@dataclass(frozen=True)
class StepPiece:
    """A chunk of consecutive steps of one simulation."""

    world: int
    model: int
    first: int
    """Index of the first step; a simulation's first is 0."""
    times_s: Float64
    """Time after each step, shape (n,)."""
    functions: NDArray[np.uint8]
    """The function that made each step, as an index into `frames.STEPS`, shape (n,)."""
    flags: NDArray[np.uint8]
    """0, or flags STALE, UNPOSED, NEAR or APART of `frames`, shape (n,)."""
    sites: NDArray[np.int32]
    """The site of each call, shape (n,)."""
    parts: dict[str, Float64]
    """The state after each step, by the names in `frames.CORE`, shape (n, width)."""
    widths: Mapping[str, int]
    """Number of elements of each state part that the messages of steps do not contain."""
    written: list[ReceivedWrite]
    edited: list[Edited]
    warnings: list[tuple[int, int, int, int]]
    """Warnings: step, warning type, count within that step, and MuJoCo's last info."""
    episodes: list[EndedEpisode]
    answers: list[tuple[int, bytes]]
    """Effects of callbacks within a step, in the format of `frames`."""


@dataclass
class _World:
    """The received part of a simulation (an MjData)."""

    number: int
    model: int
    core: list[tuple[str, int, int]]
    """Name, offset and size [bytes] of each part within a step's bytes."""
    widths: Mapping[str, int]
    size: int
    step: int = 0
    site: int = -1
    payloads: list[bytes] = field(default_factory=list)
    """The bytes of the steps that are not yet part of a chunk."""
    written: list[ReceivedWrite] = field(default_factory=list)
    edited: list[Edited] = field(default_factory=list)
    warnings: list[tuple[int, int, int, int]] = field(default_factory=list)
    episodes: list[EndedEpisode] = field(default_factory=list)
    episode: int = 0
    """Number of steps before the current episode."""
    answers: list[tuple[int, bytes]] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    settled: int = 0
    """Number of first steps that will surely be recorded; later ones may still be left out."""
    decided: int = 0
    """Number of steps up to the end of the last episode that the recording's filter has judged."""
    latest: int | None = None
    """Number of steps before the latest failed episode, which is kept until the next failed one
    ends."""
    left_out: int = 0
    """Number of steps that were made but not recorded."""
    held: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Current values of the sleep state, and of those state parts that the script has written and
    steps do not change."""

    def __post_init__(self) -> None:
        size = self.size + 8 * sum(self.widths.values())
        self.most = min(PIECE_STEPS, -(-PIECE_BYTES // max(size, 1)))
        """Number of steps in a chunk."""

    @property
    def first(self) -> int:
        """Index of the first step that is not yet part of a chunk."""
        return self.step - len(self.payloads)

    def parts(self, payload: bytes) -> WrittenParts:
        """Return the whole state after a step, except arrays that the script never wrote."""
        core = memoryview(payload)[STEP_HEAD.itemsize :]
        return {
            **{name: (None, held) for name, held in self.held.items()},
            **{
                name: (None, np.frombuffer(core[begin : begin + size], np.float64))
                for name, begin, size in self.core
            },
        }

    def hold(self, parts: WrittenParts) -> None:
        """Store written state arrays that the messages of steps do not repeat."""
        for name, (indices, values) in parts.items():
            if name not in USER and name != ASLEEP:
                continue
            if indices is None:
                self.held[name] = values
                continue
            old = self.held.get(name, np.zeros(0, values.dtype))
            size = max(len(old), 1 + int(indices.max())) if len(indices) else len(old)
            new = self.held[name] = np.zeros(size, values.dtype)
            new[: len(old)] = old
            new[indices] = values

    def leave_out(self, begin: int, end: int) -> None:
        """Drop the steps from `begin` to before `end`, but keep the state after them.

        Model edits made in the dropped steps remain in effect. An episode that ends with them is
        recorded without steps.
        """
        gone = end - begin
        if not gone:
            return
        at = begin - self.first
        left = self.payloads[at + gone - 1]
        *_, clock_s = frames.STEP_HEAD.unpack_from(left)
        del self.payloads[at : at + gone]
        became = ReceivedWrite(begin, LEFT_OUT, -1, self.site, self.site, clock_s, self.parts(left))

        def after(step: int) -> int:
            return step - gone if step >= end else min(step, begin)

        before = [each for each in self.written if each.step < begin]
        later = [each._replace(step=each.step - gone) for each in self.written if each.step >= end]
        self.written = [*before, became, *later]
        self.warnings = [
            (after(step), kind, count, info)
            for step, kind, count, info in self.warnings
            if not begin <= step < end
        ]
        self.answers = [
            (after(step), payload) for step, payload in self.answers if not begin <= step < end
        ]
        # A long training has many of these, and only the last ones change.
        for k in _last_where(self.edited, lambda edit: edit.step > begin):
            self.edited[k] = self.edited[k]._replace(step=after(self.edited[k].step))
        for k in _last_where(self.episodes, lambda episode: episode.end > begin):
            episode = self.episodes[k]
            self.episodes[k] = episode._replace(first=after(episode.first), end=after(episode.end))
        self.step, self.episode = after(self.step), after(self.episode)
        self.settled, self.left_out = after(self.settled), self.left_out + gone

    def pieces(self) -> Iterator[StepPiece]:
        """Yield full chunks of steps that will surely be recorded."""
        while self.settled - self.first >= self.most:
            yield self.piece(self.most)

    def piece(self, n: int) -> StepPiece:
        """Return the first `n` waiting steps as a chunk; the others keep waiting."""
        begins, first = STEP_HEAD.itemsize, self.first
        taken, self.payloads = self.payloads[:n], self.payloads[n:]
        # An event between two chunks belongs to the second, if there is one.
        end = first + n if self.payloads else self.step + 1
        raw = np.frombuffer(b"".join(taken), np.uint8).reshape(n, begins + self.size)
        heads = np.ascontiguousarray(raw[:, :begins]).view(STEP_HEAD)[:, 0]
        raw, functions = raw[:, begins:], heads["function"]
        parts = {
            name: np.ascontiguousarray(raw[:, begin : begin + size]).view(np.float64)
            for name, begin, size in self.core
        }
        found = StepPiece(
            world=self.number,
            model=self.model,
            first=first,
            times_s=heads["time_s"].copy(),
            functions=(functions & 15).astype(np.uint8),
            flags=(functions & 0xF0).astype(np.uint8),
            sites=heads["site"].astype(np.int32),
            parts=parts,
            widths=self.widths,
            written=[each for each in self.written if each.step < end],
            edited=[each for each in self.edited if each.step < end],
            warnings=[warning for warning in self.warnings if warning[0] < end],
            episodes=[episode for episode in self.episodes if episode.end <= end],
            answers=[answer for answer in self.answers if answer[0] < end],
        )
        self.written = [each for each in self.written if each.step >= end]
        self.edited = [each for each in self.edited if each.step >= end]
        self.warnings = [warning for warning in self.warnings if warning[0] >= end]
        self.episodes = [episode for episode in self.episodes if episode.end > end]
        self.answers = [answer for answer in self.answers if answer[0] >= end]
        return found


def _last_where(rows: Sequence[T], holds: Callable[[T], bool]) -> range:
    """Return the indices of the trailing rows that all meet a condition."""
    begin = len(rows)
    while begin and holds(rows[begin - 1]):
        begin -= 1
    return range(begin, len(rows))


class Received:
    """Assembles messages of the script's process into chunks of steps, one simulation each.

    Parameters
    ----------
    models
        A folder to which each model is written in MuJoCo's binary format, named by its digest; None
        to write no models.
    whole
        The filter that decides which episodes are recorded.
    """

    def __init__(self, models: Path | None, whole: WholeEpisodes) -> None:
        self._models_folder, self._whole = models, whole
        self.version = self.python = ""
        self.models: dict[int, MujocoModel] = {}
        self.sites: list[ScriptLine] = []
        self.sensed: dict[int, tuple[int, int]] = {}
        """Index of a simulation's first sensor reading in the shared memory, and the number of
        readings."""
        self.apart_s: dict[int, float] = {}
        """The time between consecutive states of an imported simulation in which no step was made
        [s]."""
        self.uncaught: list[dict[str, Any]] = []
        """Functions that make steps which are not recorded: `name`, `file`, `line`."""
        self.idle: list[tuple[int, int]] = []
        """Simulations, each with its model, whose derived data were recomputed repeatedly without a
        step."""
        self.array_uses: dict[tuple[int, str, str, int], dict[str, Any]] = {}
        """The latest report of each use of an array, by simulation, kind, array and site."""
        self.warnings: list[str] = []
        """The distinct texts of MuJoCo's warnings."""
        self.callbacks: list[str] = []
        self.faults: list[str] = []
        self.warning_kinds = 0
        """Number of kinds of warnings in MuJoCo; 0 while it has not warned."""
        self.viewer = False
        """Whether the script opened a passive viewer."""
        self.posed_without_steps: dict[int, int] = {}
        """Number of times that positions were changed before `mj_forward` and the first step, by
        simulation: a script with an integrator of its own makes no visible step."""
        self._constants: dict[str, Constants] = {}
        self._alike: dict[tuple[Any, ...], Any] = {}
        """Layouts of constants and fields, shared by models of the same structure."""
        self._worlds: dict[int, _World] = {}
        self._edits: dict[int, list[Edited]] = {}
        """All edits of each model so far."""

    @property
    def steps(self) -> int:
        """Number of steps received so far, including those left out of the recording."""
        return sum(world.step + world.left_out for world in self._worlds.values())

    @property
    def left_out(self) -> int:
        """Number of steps left out of the recording so far."""
        return sum(world.left_out for world in self._worlds.values())

    def take(self, payload: bytes) -> Iterable[StepPiece]:
        """Read one message; return the chunks that it completes."""
        kind = payload[:1]
        if kind == frames.STEP:
            return self._on_step(payload)
        if kind == frames.WRITTEN:
            self._on_written(payload)
        elif kind == frames.NOTE:
            note = json.loads(payload[1:])
            return getattr(self, f"_on_{note.pop('what')}")(**note) or ()
        elif kind == frames.EDITED:
            self._on_edited(payload)
        elif kind == frames.WARNED:
            self._on_warned(payload)
        elif kind == frames.DONE:
            self._on_done(payload)
        elif kind == frames.CALLBACK:
            *_, number, _ = frames.CALLBACK_HEAD.unpack_from(payload)
            world = self._worlds[number]
            world.answers.append((world.step, payload))
        elif kind == frames.ARRAYS:
            head, places = frames.places_of(payload)
            if head["what"] == "constants":
                alike = self._alike.setdefault(tuple(places.items()), places)
                self._constants[head["digest"]] = arrays = Constants(payload, alike)
                for model in self.models.values():
                    if model.digest == head["digest"]:
                        model.arrays = arrays
            elif self._models_folder is not None:
                with (self._models_folder / f"{head['digest']}.mjb").open("ab") as file:
                    file.write(places["bytes"].of(payload).data)
        return ()

    def rest(self) -> Iterator[StepPiece]:
        """Yield the remaining chunks after the last message."""
        for world in self._worlds.values():
            self._settle(world)
            yield from world.pieces()
            if world.payloads:
                yield world.piece(len(world.payloads))

    # -- numbers ----------------------------------------------------------------------------------

    def _on_step(self, payload: bytes) -> tuple[StepPiece, ...]:
        number, site = WHERE.unpack_from(payload)
        world = self._worlds[number]
        # Only now all is known that lies between the steps of the piece before.
        whole = (*world.pieces(),) if len(world.payloads) >= world.most else ()
        world.payloads.append(payload)
        world.step, world.site = world.step + 1, site
        waiting = (world.step - world.settled) * len(payload)
        if self._whole.all_so_far or waiting > LONGEST_BYTES:
            self._settle(world)
        return whole

    def _settle(self, world: _World) -> None:
        """Mark all steps of a simulation so far as surely recorded."""
        self._whole.kept_bytes += (world.step - world.settled) * (STEP_HEAD.itemsize + world.size)
        world.settled, world.latest = world.step, None

    def _on_written(self, payload: bytes) -> None:
        _, cause, count, number, site, argument, time_s = frames.WRITTEN_HEAD.unpack_from(payload)
        at, parts = frames.WRITTEN_HEAD.size, {}
        for _ in range(count):
            name, indices, values, at = frames.part_of(payload, at)
            parts[name] = indices, values
        world = self._worlds[number]
        world.hold(parts)
        if CAUSES[cause] == "mj_forward" and not world.step and "qpos" in parts:
            self.posed_without_steps[number] = self.posed_without_steps.get(number, 0) + 1
        world.written.append(
            ReceivedWrite(world.step, CAUSES[cause], argument, site, world.site, time_s, parts)
        )
        if CAUSES[cause] != "posed":
            world.site = site

    def _on_done(self, payload: bytes) -> None:
        _, cause, _, number, site, argument = frames.DONE_HEAD.unpack_from(payload)
        world = self._worlds[number]
        world.written.append(
            ReceivedWrite(world.step, CAUSES[cause], argument, site, world.site, np.nan, {})
        )
        world.site = site

    def _on_edited(self, payload: bytes) -> None:
        _, _, which, number, by, site, count = frames.EDITED_HEAD.unpack_from(payload)
        model, world = self.models[number], self._worlds[by]
        name, dtype, shape = model.fields[which]
        at = frames.EDITED_HEAD.size
        indices = np.frombuffer(payload, np.uint32, count, at)
        new = np.frombuffer(payload, dtype, count, at + 4 * count)
        held = model.held.get(which)
        if held is None:
            held = np.array(model.arrays.get(name, np.zeros(shape, dtype)), dtype).ravel()
            model.held[which] = held
        old = held[indices]
        held[indices] = new
        edited = Edited(world.step, by, number, name, indices, old, new, site, world.site)
        self._edits.setdefault(number, []).append(edited)
        for other in self._worlds.values():  # whoever has seen it, it is in the model of all
            if other.model == number:
                other.edited.append(edited._replace(step=other.step))

    def _on_warned(self, payload: bytes) -> None:
        _, anew, _, number = frames.WARNED_HEAD.unpack_from(payload)
        pairs = np.frombuffer(payload, np.int32, offset=frames.WARNED_HEAD.size).reshape(-1, 2)
        world, self.warning_kinds = self._worlds[number], len(pairs)
        for kind, (info, times) in enumerate(pairs.tolist()):
            before = 0 if anew else world.counts.get(kind, 0)
            world.counts[kind] = times
            if times > before:
                world.warnings.append((world.step - 1, kind, times - before, info))

    # -- notes ------------------------------------------------------------------------------------

    def _on_mujoco(self, version: str, python: str) -> None:
        self.version, self.python = version, python

    def _on_model(self, number: int, digest: str, fields: list[Any], **_: Any) -> None:  # noqa: ANN401
        made = tuple((name, np.dtype(kind), tuple(shape)) for name, kind, shape in fields)
        of_fields = self._alike.setdefault(made, made)
        self.models[number] = MujocoModel(
            number, digest, of_fields, self._constants.get(digest, {})
        )

    def _on_world(
        self,
        number: int,
        model: int,
        core: list[tuple[str, int, int]],
        user: list[tuple[str, int, int]],
        core_bytes: int,
        sensed: tuple[int, int] | None = None,
        apart_s: float | None = None,
        **_: Any,  # noqa: ANN401
    ) -> None:
        if apart_s is not None:
            self.apart_s[number] = apart_s
        if sensed is not None:
            self.sensed[number] = sensed
        widths = {name: size // frames.kind_of(name).itemsize for name, _, size in user}
        self._worlds[number] = _World(number, model, core, widths, core_bytes)
        self._worlds[number].edited = [each._replace(step=0) for each in self._edits.get(model, ())]

    def _on_model_of(self, world: int, model: int) -> Iterator[StepPiece]:
        its = self._worlds[world]
        self._settle(its)
        yield from its.pieces()
        if its.payloads:
            yield its.piece(len(its.payloads))
        its.model = model
        its.edited = [each._replace(step=its.step) for each in self._edits.get(model, ())]

    def _on_site(self, number: int, **place: Any) -> None:  # noqa: ANN401
        if number != len(self.sites):
            raise ValueError(f"site {number} after {len(self.sites)}")
        self.sites.append(ScriptLine(**place))

    def _on_idle(self, world: int) -> None:
        self.idle.append((world, self._worlds[world].model))

    def _on_episode(self, world: int, how: str, **told: Any) -> None:  # noqa: ANN401
        its = self._worlds[world]
        if how != "begins":
            its.episodes.append(EndedEpisode(its.episode, its.step, {"how": how, **told}))
            self._ended(its, self._whole.decide(how, **told))
        its.episode = its.step

    def _ended(self, its: _World, decision: Decision) -> None:
        """Keep or drop a simulation's episode that has ended, as the recording's filter decided."""
        if decision == "whole" or its.settled > its.decided:
            self._settle(its)
        elif decision == "latest":
            if its.latest is None:
                its.latest = its.decided
            else:
                its.leave_out(its.latest, its.decided)
                self._whole.left_out += 1
        else:
            its.leave_out(its.decided, its.step)
            self._whole.left_out += 1
        its.decided = its.step

    def _on_use(
        self,
        world: int,
        use: str,
        name: str,
        site: int,
        count: int,
        since: int = 0,
        **more: Any,  # noqa: ANN401
    ) -> None:
        its = self._worlds[world]
        last = max(its.step - since, 0)
        first = self.array_uses.get((world, use, name, site), {}).get("first", last)
        self.array_uses[world, use, name, site] = {
            **more,
            "model": its.model,
            "first": first,
            "last": last,
            "count": count,
        }

    def _on_uncaught(self, **what: Any) -> None:  # noqa: ANN401
        self.uncaught.append(what)

    def _on_warning(self, text: str, **_: Any) -> None:  # noqa: ANN401
        self.warnings.append(text)

    def _on_callback(self, name: str, **_: Any) -> None:  # noqa: ANN401
        if name not in self.callbacks:
            self.callbacks.append(name)

    def _on_viewer(self) -> None:
        self.viewer = True

    def _on_fault(self, error: str, **_: Any) -> None:  # noqa: ANN401
        self.faults.append(error)
