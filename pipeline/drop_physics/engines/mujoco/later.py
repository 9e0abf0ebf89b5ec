"""Explains steps of a recording on demand, any range in any order."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.described import described
from drop_physics.engines.mujoco.impulses import ExplainedSteps
from drop_physics.engines.mujoco.stepping import Stepper, StepsWanted
from drop_physics.trace.events import Event, ImpulseCause
from drop_physics.trace.frames import Frames, ModelEdit

Window = tuple[int, int, int]
"""A range of steps of one simulation: client, first and end (exclusive), by start sample."""
Times = Callable[[int, NDArray[np.int64]], NDArray[np.float64]]
"""Function that returns the times of a simulation's samples [s]."""


class RecordedFrames(Protocol):
    """The compiled models and replay frames of a recording."""

    def model(self, number: int) -> bytes:
        """Return a compiled model by index."""

    def model_of(self, client: int) -> int:
        """Return the index of a simulation's model."""

    def edits(self, client: int, end: int) -> list[ModelEdit]:
        """Return the script's model edits in the chunks before sample `end`."""

    def pieces(self, client: int, first: int, end: int) -> Iterator[Frames]:
        """Yield replay frames of the chunks with steps from sample `first` to before `end`."""


def explained_later(
    stepper: Stepper,
    recorded: RecordedFrames,
    windows: Iterable[Window],
    *,
    firsts: Mapping[int, int],
    causes: Mapping[int, ImpulseCause],
    times_s: Times,
    folder: Path,
) -> Iterator[Event]:
    """Replay step ranges of a recording, and yield the causes of their impulses.

    Parameters
    ----------
    stepper
        The process that replays the steps.
    recorded
        The replay frames in the recording.
    windows
        The ranges of steps to explain.
    firsts
        The id of each simulation's first body, by client.
    causes
        The causes that the recording already has, by number.
    times_s
        A function that returns the times of samples [s].
    folder
        A folder for temporary files.

    Raises
    ------
    DropError
        If the process ends before all steps are replayed.
    """
    numbers = itertools.count(max(causes, default=-1) + 1)
    for client, its in itertools.groupby(sorted(windows), key=lambda window: window[0]):
        number = recorded.model_of(client)
        path = folder / f"{number}.mjb"
        if not path.exists():
            path.write_bytes(recorded.model(number))
        arrays = stepper.constants(path)
        for edit in recorded.edits(client, 1 << 62):
            if edit.name in arrays:
                arrays[edit.name] = np.array(arrays[edit.name])
                arrays[edit.name].reshape(-1)[edit.indices] = edit.values
        made = ExplainedSteps(
            client, described(arrays, client=client, first=firsts[client], folder=folder)
        )
        made.know(causes.values())
        for wanted, piece in stepper.explained(_wanted(recorded, path, [*its])):
            steps = piece.first + 1 + np.arange(len(piece.status), dtype=np.int64)
            yield from made.events(piece, wanted.frames, times_s(client, steps), numbers)


def _wanted(
    recorded: RecordedFrames, model: Path, windows: Iterable[Window]
) -> Iterator[StepsWanted]:
    """Yield the steps in one simulation's ranges, chunk by chunk."""
    for client, first, end in windows:
        edits: list[ModelEdit] | None = None
        for frames in recorded.pieces(client, first, end):
            begin = max(first - frames.first, 0)
            last = min(end - frames.first, len(frames))
            edits = recorded.edits(client, frames.first) if edits is None else edits
            yield StepsWanted(model, frames, begin, last, edits)
