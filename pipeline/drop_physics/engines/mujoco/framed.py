"""Builds replay frames, all that is needed to replay each step, from the received stream."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import DescribedBody
from drop_physics.engines.mujoco.frames import ASLEEP, CORE, STATE, USER
from drop_physics.engines.mujoco.received import Edited, ReceivedWrite, StepPiece
from drop_physics.trace.frames import CLOCK, FrameColumn, Frames, ModelEdit, SharedColumns

Float64 = NDArray[np.float64]
Held = Mapping[str, NDArray[Any]]
"""The parts of a state as flat arrays; a part that was never sent is zero."""
T = TypeVar("T")

FEW_STEPS = 5000
"""A run with fewer steps is explained right after recording, which usually takes a few seconds."""


class FramesOfSteps:
    """Builds the replay frames of one simulation, chunk by chunk.

    Parameters
    ----------
    client
        The number of the simulation.
    model
        The number of the simulation's model in the recording.
    first
        The index of the simulation's first step among all steps of its MjData.
    held, clock_s
        The state before the first step, and MuJoCo's clock at that time [s].
    """

    def __init__(self, client: int, model: int, first: int, held: Held, clock_s: float) -> None:
        self._client, self._model, self._first = client, model, first
        self._left: Held = dict(held)
        """The state after the last step of the previous chunk, and its clock [s]."""
        self.clock_s = clock_s
        self._written: dict[int, Held] = {}
        """States that the script wrote before a step, with the clock, by step."""
        self._inputs: dict[str, dict[int, Float64]] = {name: {} for name in USER}
        self._posed: dict[str, dict[int, Float64]] = {}
        self._asleep: dict[int, Float64] = {}
        """Sleep state of trees after the previous step, by step."""
        self._edits: dict[int, list[Edited]] = {}

    def wrote(self, written: ReceivedWrite, held: Held, piece: StepPiece) -> None:
        """Store what the script wrote before a step; `held` is the state including it."""
        step, parts = written.step, {*written.parts}
        row = step - piece.first - 1
        left_s = piece.times_s[row] if row >= 0 else self.clock_s
        if written.cause == "step":
            if ASLEEP in parts:
                self._asleep[step] = held[ASLEEP]
        elif not np.isnan(written.time_s) and (
            parts & {*STATE} or step in self._written or written.time_s != left_s
        ):
            self._written[step] = {**held, CLOCK: np.array([written.time_s])}
        for name in parts & {*USER}:
            self._inputs[name][step] = held[name]

    def posed(self, written: ReceivedWrite, held: Held) -> None:
        """Store an older state from which a step's derived positions were computed."""
        for name, (indices, values) in written.parts.items():
            row = np.array(values if indices is None else held[name], np.float64)
            row[slice(None) if indices is None else indices] = values
            self._posed.setdefault(name, {})[written.step] = row

    def edited(self, edits: Iterable[Edited]) -> None:
        """Store the script's edits of the model."""
        for edit in edits:
            self._edits.setdefault(edit.step, []).append(edit)

    def of_piece(
        self, piece: StepPiece, timestep_s: float, shared: Mapping[str, Sequence[SharedColumns]]
    ) -> Frames:
        """Return the replay frames of a chunk, after its writes and edits were stored.

        Parameters
        ----------
        piece
            The chunk of steps.
        timestep_s
            The timestep of most of its steps [s].
        shared
            The columns of joint samples that equal state arrays, by array (see `shared_by`).
        """
        first, end = piece.first, piece.first + len(piece.times_s)
        after = {name: piece.parts[name] for name in CORE if name in piece.parts}
        widths = {CLOCK: 1, **{name: rows.shape[1] for name, rows in after.items()}, **piece.widths}
        left = {**self._left, CLOCK: np.array([self.clock_s])}
        written = {first: left, **_until(self._written, end)}
        before = {
            name: _column({step: held.get(name) for step, held in written.items()}, width, first)
            for name, width in widths.items()
            if name not in USER
        }
        if ASLEEP in widths:
            after[ASLEEP] = self._asleep_after(before[ASLEEP], first, end)
        inputs = {}
        for name in USER:
            if name in widths:
                rows = {first: _of_width(left.get(name), widths[name])}
                inputs[name] = _column(rows | _until(self._inputs[name], end), widths[name], first)
        self.clock_s = float(piece.times_s[-1])
        self._left = {name: rows[-1] for name, rows in after.items()}
        self._left |= {name: each.rows[-1] for name, each in inputs.items()}
        posed = {
            name: _column(its, widths[name], first)
            for name, rows in self._posed.items()
            if (its := _until(rows, end))
        }
        return Frames(
            client=self._client,
            model=self._model,
            first=first - self._first,
            timestep_s=timestep_s,
            clock_s=piece.times_s,
            functions=(piece.functions | piece.flags).astype(np.int64),
            after=after,
            before=before,
            inputs=inputs,
            posed=posed,
            edits=[
                _edit(each, first) for step in _until(self._edits, end).values() for each in step
            ],
            answers=[(step - first, payload) for step, payload in piece.answers],
            shared=shared,
        )

    def _asleep_after(self, before: FrameColumn, first: int, end: int) -> Float64:
        """Return the sleep state of trees after each step, shape (n, trees)."""
        slept = {step - first: row for step, row in _until(self._asleep, end + 1).items()}
        changed = dict(zip(before.at.tolist(), before.rows, strict=True))
        row, rows = before.rows[0], np.empty((end - first, before.rows.shape[1]))
        for step in range(end - first):
            row = changed.get(step, row)
            row = rows[step] = slept.get(step + 1, row)
        return rows


class KeptFrames:
    """The replay frames of a short run, kept until its steps are explained; call `close`."""

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None
        self._places: list[tuple[int, int]] = []
        """The simulation of each chunk, and the chunk's position in the file."""
        self._steps = 0

    @property
    def is_full(self) -> bool:
        """True if the run is too long to be explained right after recording: no frames are kept."""
        return self._steps >= FEW_STEPS

    def add(self, frames: Frames) -> None:
        """Keep the replay frames of a chunk."""
        self._steps += len(frames)
        if self.is_full:
            self.close()
            return
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 - until it is closed
        self._places.append((frames.client, self._file.tell()))
        pickle.dump(frames, self._file, pickle.HIGHEST_PROTOCOL)

    def in_order(self) -> Iterator[Frames]:
        """Yield all chunks, one simulation after the other."""
        for _, place in sorted(self._places):
            assert self._file is not None
            self._file.seek(place)
            yield pickle.load(self._file)

    def close(self) -> None:
        """Delete all replay frames."""
        if self._file is not None:
            self._file.close()
        self._file, self._places = None, []


def _until(rows: dict[int, T], end: int) -> dict[int, T]:
    """Remove and return the stored rows for steps before `end`."""
    return {step: rows.pop(step) for step in sorted(rows) if step < end}


def _of_width(row: NDArray[Any] | None, width: int) -> Float64:
    """Return an array of the given width; zeros if the script's process never sent it."""
    whole = np.zeros(width)
    if row is not None:
        whole[: len(row)] = row
    return whole


def _column(rows: Mapping[int, NDArray[Any] | None], width: int, first: int) -> FrameColumn:
    """Return sparse rows, keyed by step, as a column of replay frames."""
    whole = np.array([_of_width(row, width) for row in rows.values()])
    return FrameColumn(np.array([*rows], np.int64) - first, whole)


def _edit(edit: Edited, first: int) -> ModelEdit:
    indices, values = edit.indices.astype(np.int64), edit.new.astype(np.float64)
    return ModelEdit(max(edit.step - first, 0), edit.name, indices, values)


def shared_by(bodies: Iterable[DescribedBody]) -> dict[str, list[SharedColumns]]:
    """Return the columns in which joint samples equal elements of `qpos` and `qvel`.

    Ball joints are left out: their samples are in other axes than `qpos` and `qvel`.
    """
    found: dict[str, list[SharedColumns]] = {"qpos": [], "qvel": []}
    for made in bodies:
        series = ("qpos", "position", made.positions), ("qvel", "velocity", made.rates)
        for kind, (name, of, columns) in enumerate(series):
            turned = [np.arange(len(columns))[ball[kind]] for ball in made.balls]
            places = np.setdiff1d(np.arange(len(columns)), np.concatenate([[], *turned]))
            if len(places):
                its = SharedColumns(made.body.number, of, columns[places], places)
                found[name].append(its)
    return found
