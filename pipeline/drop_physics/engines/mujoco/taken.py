"""A recorded MuJoCo run as arrays over all steps: states before and after each step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.explain.asked import answers_in
from drop_physics.engines.mujoco.frames import USER
from drop_physics.trace.frames import CLOCK, FrameColumn, Frames, ModelEdit

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Rows = Mapping[str, Float64]

PASSIVE = "qfrc_passive"
"""Name of the passive forces that callbacks add."""


@dataclass(frozen=True, eq=False)
class TakenSteps:
    """Start states, inputs and end states of a run's n steps."""

    whole: Frames
    """All replay frames of these steps, as one chunk."""
    before: Rows
    """The state before each step, shape (n, width) each."""
    inputs: Rows
    """External inputs in each step, shape (n, width) each."""
    acting: Rows
    """The same inputs, including what callbacks write within a step; `qfrc_passive` is the force
    that callbacks add."""
    edited: Mapping[str, tuple[Int64, Float64]]
    """The elements of each field that the script writes during the run, as indices of shape (k,),
    and their values in each step, of shape (n, k)."""
    starts_s: Float64
    """The clock before each step [s], shape (n,)."""
    full: Frames
    """The frames of the whole run, of which `whole` may be a part."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.whole)

    @property
    def after(self) -> Rows:
        """The state after each step."""
        return self.whole.after

    def only(self, starts: Int64, ends: Int64) -> TakenSteps:
        """Return some of the steps: starts by index; end states of the same or of other steps."""
        whole, row_of = self.whole, {step: row for row, step in enumerate(starts.tolist())}
        some = replace(
            whole,
            clock_s=whole.clock_s[ends],
            functions=whole.functions[starts],
            after={name: rows[ends] for name, rows in whole.after.items()},
            posed={name: _some(each, row_of) for name, each in whole.posed.items()},
            answers=[(row_of[step], told) for step, told in whole.answers if step in row_of],
            edits=[],
        )
        before, inputs, acting = (
            {name: rows[starts] for name, rows in held.items()}
            for held in (self.before, self.inputs, self.acting)
        )
        edited = {name: (at, rows[starts]) for name, (at, rows) in self.edited.items()}
        return TakenSteps(some, before, inputs, acting, edited, self.starts_s[starts], self.full)


def taken(pieces: Iterable[Frames], fields: Mapping[str, NDArray[Any]]) -> TakenSteps:
    """Return the steps of a run as arrays.

    Parameters
    ----------
    pieces
        The replay frames of the run, in order.
    fields
        The fields of the model as compiled.
    """
    whole = joined([*pieces])
    names = {edit.name for edit in whole.edits}
    inputs = {name: _held(each, len(whole)) for name, each in whole.inputs.items() if name in USER}
    return TakenSteps(
        whole,
        {name: whole.starts(name) for name in whole.after},
        inputs,
        _acting(whole, inputs) if whole.answers else inputs,
        {name: edited_of(whole, name, fields[name]) for name in sorted(names) if name in fields},
        _starts_s(whole),
        whole,
    )


def aligned(a: TakenSteps, b: TakenSteps) -> tuple[TakenSteps, TakenSteps, Int64]:
    """Return the steps of two runs that start and end at the same times.

    Also returns the indices of these steps in the first run. Several steps of the second run may
    correspond to one: they are merged, with the start state of the first and the end state of the
    last.
    """
    starts, ends = _places(b.starts_s), _places(b.whole.clock_s)
    rows = [
        (step, starts[begin], ends[end])
        for step, (begin, end) in enumerate(
            zip(_ticks(a.starts_s), _ticks(a.whole.clock_s), strict=True)
        )
        if begin in starts and end in ends and starts[begin] <= ends[end]
    ]
    mine, begins, finishes = np.array(rows, np.int64).reshape(-1, 3).T
    return a.only(mine, mine), b.only(begins, finishes), mine


TICK_S = 1e-9
"""Largest difference at which two times count as equal [s]."""


def _ticks(times_s: Float64) -> list[int]:
    found: list[int] = np.round(times_s / TICK_S).astype(np.int64).tolist()
    return found


def _places(times_s: Float64) -> dict[int, int]:
    return {tick: step for step, tick in reversed([*enumerate(_ticks(times_s))])}


def _some(column: FrameColumn, row_of: Mapping[int, int]) -> FrameColumn:
    which = [n for n, step in enumerate(column.at.tolist()) if step in row_of]
    at = [row_of[step] for step in column.at[which].tolist()]
    return FrameColumn(np.array(at, np.int64), column.rows[which])


def _starts_s(whole: Frames) -> Float64:
    """Return the clock before each step [s], shape (n,)."""
    starts_s = np.concatenate(([0.0], whole.clock_s[:-1]))
    before = whole.before[CLOCK]
    starts_s[before.at] = before.rows[:, 0]
    return starts_s


def _acting(whole: Frames, inputs: Rows) -> Rows:
    """Return the inputs of each step, including those that callbacks write during the step."""
    nv = whole.after["qvel"].shape[1]
    acting = {name: rows.copy() for name, rows in inputs.items()}
    acting[PASSIVE] = np.zeros((len(whole), nv))
    for step, payload in whole.answers:
        for _, parts in answers_in(payload, nv):
            for name, indices, values in parts if isinstance(parts, list) else ():
                if name in acting:
                    acting[name][step, slice(None) if indices is None else indices] = values
    return acting


def edited_of(whole: Frames, name: str, compiled: NDArray[Any]) -> tuple[Int64, Float64]:
    """Return a field's elements that the script writes, and their values in each step."""
    edits = [edit for edit in whole.edits if edit.name == name]
    indices = np.unique(np.concatenate([edit.indices for edit in edits]))
    start = np.ravel(compiled).astype(np.float64)[indices]
    rows = np.repeat(start[None], len(whole), axis=0)
    for edit in edits:
        rows[edit.step :, np.searchsorted(indices, edit.indices)] = edit.values
    return indices, rows


def joined(pieces: list[Frames]) -> Frames:
    """Concatenate the replay frames of a run's chunks; an empty chunk if there are none."""
    first = pieces[0]
    starts = np.cumsum([0, *map(len, pieces)])[:-1].tolist()
    both = [*zip(starts, pieces, strict=True)]

    def columns(group: str) -> dict[str, FrameColumn]:
        found: dict[str, list[tuple[int, FrameColumn]]] = {}
        for start, piece in both:
            for name, column in getattr(piece, group).items():
                found.setdefault(name, []).append((start, column))
        return {
            name: FrameColumn(
                np.concatenate([start + each.at for start, each in its]),
                np.concatenate([each.rows for _, each in its]),
            )
            for name, its in found.items()
        }

    # The first step of a piece has its state told again: only one that was written counts.
    before = columns("before")
    again = [start for start, piece in both[1:] if _continues(pieces, starts, start)]
    before = {
        name: FrameColumn(each.at[~np.isin(each.at, again)], each.rows[~np.isin(each.at, again)])
        for name, each in before.items()
    }
    return replace(
        first,
        clock_s=np.concatenate([each.clock_s for each in pieces]),
        functions=np.concatenate([each.functions for each in pieces]),
        after={name: np.concatenate([each.after[name] for each in pieces]) for name in first.after},
        before=before,
        inputs=columns("inputs"),
        posed=columns("posed"),
        edits=[
            ModelEdit(start + edit.step, edit.name, edit.indices, edit.values)
            for start, piece in both
            for edit in piece.edits
        ],
        answers=[(start + step, told) for start, piece in both for step, told in piece.answers],
        shared={},
    )


def _continues(pieces: list[Frames], starts: list[int], start: int) -> bool:
    """Return whether a chunk starts with the end state of the previous chunk."""
    number = starts.index(start)
    before, piece = pieces[number - 1], pieces[number]
    return all(
        np.array_equal(piece.before[name].rows[0], rows[-1]) for name, rows in before.after.items()
    ) and bool(piece.before[CLOCK].rows[0, 0] == before.clock_s[-1])


def _held(column: FrameColumn, count: int) -> Float64:
    """Return each step's row of a column that stores a row only where it changes."""
    which = np.searchsorted(column.at, np.arange(count), side="right") - 1
    rows: Float64 = column.rows[np.maximum(which, 0)]
    return rows
