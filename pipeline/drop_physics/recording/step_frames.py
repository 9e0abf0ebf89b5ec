"""Packs the replay frames of a batch of steps into a row of a recording, and unpacks them.

State arrays that equal joint samples are not stored again, and neither is the clock where it
advances by one timestep.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.trace.events import Body
from drop_physics.trace.frames import (
    CLOCK,
    FrameColumn,
    Frames,
    ModelEdit,
    ModelPart,
    SharedColumns,
)

T = TypeVar("T", bound=np.generic)

SPARSE = ("before", "inputs", "posed")
"""Groups of columns that have rows only for some steps."""

MOST_PART_BYTES = 1 << 24
"""Largest unpacked size [bytes] of a part of a model."""

Series = Callable[[str, str], Float64]
"""Function that returns a series of a body's joint samples after each step, given the body's label
and the series' name, shape (n, places)."""


class PackedFrames(NamedTuple):
    """A row with the replay frames of a batch of steps."""

    layout: str
    """Structure of the numbers, as JSON."""
    numbers: Float64
    at: Int64
    """Indices of steps: those with an unusual clock, then those with rows of each sparse column;
    then the indices of each model edit."""
    answers: bytes


def packed(frames: Frames, bodies: Mapping[int, Body]) -> PackedFrames:
    """Pack replay frames into a row; `bodies` are given by id."""
    other = np.flatnonzero(frames.clock_s != _starts_s(frames) + frames.timestep_s)
    numbers: list[Float64] = [frames.clock_s[other], frames.functions.astype(np.float64)]
    at: list[Int64] = [other]
    after = {}
    for name, rows in frames.after.items():
        shared = frames.shared.get(name, ())
        where = [each.columns for each in shared]
        own = np.setdiff1d(np.arange(rows.shape[1]), np.concatenate([[], *where]))
        numbers.append(rows[:, own].ravel())
        after[name] = {
            "width": rows.shape[1],
            "joints": [
                [bodies[each.body].label, each.of, each.columns.tolist(), each.places.tolist()]
                for each in shared
            ],
        }
    sparse: dict[str, dict[str, list[int]]] = {}
    for group in SPARSE:
        columns: Mapping[str, FrameColumn] = getattr(frames, group)
        sparse[group] = {name: [*column.rows.shape] for name, column in columns.items()}
        numbers += [column.rows.ravel() for column in columns.values()]
        at += [column.at for column in columns.values()]
    numbers += [edit.values for edit in frames.edits]
    at += [edit.indices for edit in frames.edits]
    layout = {
        "client": frames.client,
        "model": frames.model,
        "first": frames.first,
        "steps": len(frames),
        "timestep_s": frames.timestep_s,
        "other_times": len(other),
        "after": after,
        **sparse,
        "edits": [[edit.step, edit.name, len(edit.values)] for edit in frames.edits],
        "answers": [[step, len(payload)] for step, payload in frames.answers],
    }
    return PackedFrames(
        json.dumps(layout, separators=(",", ":")),
        np.concatenate(numbers),
        np.concatenate(at),
        b"".join(payload for _, payload in frames.answers),
    )


def deflated(part: ModelPart) -> ModelPart:
    """Compress a part of a compiled model."""
    return replace(part, data=zlib.compress(part.data, 1))


def inflated(data: bytes) -> bytes:
    """Decompress a part of a compiled model.

    Raises
    ------
    ValueError
        If the data are not compressed, or too large when decompressed.
    """
    inflating = zlib.decompressobj()
    try:
        found = inflating.decompress(data, MOST_PART_BYTES)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if not inflating.eof:
        raise ValueError("too large")
    return found


class FrameSpan(NamedTuple):
    """The range of steps stored in a row."""

    client: int
    model: int
    first: int
    """Index of the sample from which the first step starts."""
    steps: int
    edited: bool
    """Whether the model was edited before any of the steps."""


def span_of(row: PackedFrames) -> FrameSpan:
    """Return the range of steps stored in a row.

    Raises
    ------
    ValueError, LookupError, TypeError
        If the row is not as `packed` makes it.
    """
    layout = json.loads(row.layout)
    client, model, first, steps = (
        int(layout[name]) for name in ("client", "model", "first", "steps")
    )
    return FrameSpan(client, model, first, steps, bool(layout["edits"]))


def edits_of(row: PackedFrames) -> list[ModelEdit]:
    """Return the model edits stored in a row, without unpacking the rest.

    Raises
    ------
    ValueError, LookupError, TypeError
        If the row is not as `packed` makes it.
    """
    listed = json.loads(row.layout)["edits"]
    count = sum(each[2] for each in listed)
    numbers = _Taken(row.numbers[len(row.numbers) - count :])
    at = _Taken(row.at[len(row.at) - count :])
    return [ModelEdit(step, name, at.take(k), numbers.take(k)) for step, name, k in listed]


def unpacked(row: PackedFrames, numbers_of: Mapping[str, int], series: Series) -> Frames:
    """Unpack the replay frames in a row.

    Parameters
    ----------
    row
        The packed row.
    numbers_of
        The ids of bodies, by label.
    series
        A function that returns the samples of joints.

    Raises
    ------
    ValueError, LookupError, TypeError
        If the row is not as `packed` makes it.
    """
    layout = json.loads(row.layout)
    n, numbers, at = layout["steps"], _Taken(row.numbers), _Taken(row.at)
    many = layout["other_times"]
    other = FrameColumn(at.take(many), numbers.take(many)[:, None])
    functions = numbers.take(n).astype(np.int64)
    after: dict[str, Float64] = {}
    shared: dict[str, list[SharedColumns]] = {}
    for name, part in layout["after"].items():
        rows = after[name] = np.empty((n, part["width"]))
        own = np.ones(part["width"], np.bool_)
        for label, of, columns, places in part["joints"]:
            rows[:, columns] = series(label, of)[:, places]
            own[columns] = False
            its = SharedColumns(numbers_of[label], of, np.array(columns), np.array(places))
            shared.setdefault(name, []).append(its)
        rows[:, own] = numbers.take(n * int(own.sum())).reshape(n, -1)
    sparse = {
        group: {
            name: FrameColumn(at.take(count), numbers.take(count * width).reshape(count, width))
            for name, (count, width) in layout[group].items()
        }
        for group in SPARSE
    }
    edits = [
        ModelEdit(step, name, at.take(count), numbers.take(count))
        for step, name, count in layout["edits"]
    ]
    answers, done = [], 0
    for step, size in layout["answers"]:
        answers.append((step, row.answers[done : done + size]))
        done += size
    return Frames(
        client=layout["client"],
        model=layout["model"],
        first=layout["first"],
        timestep_s=layout["timestep_s"],
        clock_s=_clock_s(n, layout["timestep_s"], other, sparse["before"][CLOCK]),
        functions=functions,
        after=after,
        **sparse,
        edits=edits,
        answers=answers,
        shared=shared,
    )


def _starts_s(frames: Frames) -> Float64:
    """Return the simulation's clock before each step [s], shape (n,)."""
    starts_s = np.concatenate(([0.0], frames.clock_s[:-1]))
    before = frames.before[CLOCK]
    starts_s[before.at] = before.rows[:, 0]
    return starts_s


def _clock_s(n: int, timestep_s: float, other: FrameColumn, before: FrameColumn) -> Float64:
    """Return the clock after each step [s], shape (n,), summed up as the engine does."""
    told, starts = (
        dict(zip(each.at.tolist(), each.rows[:, 0].tolist(), strict=True))
        for each in (other, before)
    )
    clock_s, now_s = np.empty(n), 0.0
    for step in range(n):
        now_s = clock_s[step] = told.get(step, starts.get(step, now_s) + timestep_s)
    return clock_s


class _Taken(Generic[T]):
    """A reader that consumes an array from front to back."""

    def __init__(self, values: NDArray[T]) -> None:
        self._values, self._done = values, 0

    def take(self, count: int) -> NDArray[T]:
        """Return the next `count` elements."""
        begin, self._done = self._done, self._done + count
        if count < 0 or self._done > len(self._values):
            raise ValueError(f"{self._done} of {len(self._values)} elements")
        return self._values[begin : self._done]
