"""Everything that an engine needs to repeat the steps of a recording: its model, and frames.

A frame is the full state before a step, including hidden parts such as a solver's warm start, and
the inputs from outside. Names are the engine's own, values its numbers to the bit; nothing here
knows their meaning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Float64, Int64


@dataclass(frozen=True, eq=False)
class ModelPart:
    """A part of a compiled model, at a simulation's first step with it."""

    number: int
    """The number of the model in the recording."""
    engine: str
    """The engine and its version: the only one that can load it."""
    sha256: str
    """The digest of the whole model."""
    size: int
    """Bytes of the whole model."""
    at: int
    """The first byte of the part."""
    data: bytes


class FrameColumn(NamedTuple):
    """Values of one name at some steps of a piece."""

    at: Int64
    """The steps, counted from the first of the piece, ascending, shape (k,)."""
    rows: Float64
    """Shape (k, width)."""

    def held(self, step: int) -> Float64:
        """Return the row in effect at a step: the last one up to it, shape (width,)."""
        found: Float64 = self.rows[np.searchsorted(self.at, step, side="right") - 1]
        return found


class ModelEdit(NamedTuple):
    """Elements of a model that a script changed in place."""

    step: int
    """The first step that sees it, counted from the first of the piece."""
    name: str
    """The field, as the engine names it."""
    indices: Int64
    """Indices into the flattened field, shape (k,)."""
    values: Float64
    """Shape (k,)."""


class SharedColumns(NamedTuple):
    """Columns of a part of the state that samples hold, too, to the bit."""

    body: int
    """The number of the body whose joints they are of."""
    of: str
    """`position` or `velocity`."""
    columns: Int64
    """Columns of the part, shape (k,)."""
    places: Int64
    """Columns of the joints' series, shape (k,)."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of n consecutive steps of a simulation."""

    client: int
    model: int
    """The number of its model."""
    first: int
    """The sample that the first of these steps starts from."""
    timestep_s: float
    clock_s: Float64
    """The engine's own clock after each step [s], shape (n,): most often a timestep later."""
    functions: Int64
    """The function that made each step, by the engine's number, shape (n,)."""
    after: Mapping[str, Float64]
    """The parts of the state after each step, shape (n, width) each."""
    before: Mapping[str, FrameColumn]
    """The state before a step, with its `clock_s`, where that is not what the step before left,
    and before the first one."""
    inputs: Mapping[str, FrameColumn]
    """Inputs from outside, from a step on until the next row; the first is of step 0."""
    posed: Mapping[str, FrameColumn] = field(default_factory=dict)
    """The parts of another state that the engine had computed positions for before a step."""
    edits: Sequence[ModelEdit] = ()
    answers: Sequence[tuple[int, bytes]] = ()
    """Effects of the script's callbacks within a step, as the engine's watch sent them, by step."""
    shared: Mapping[str, Sequence[SharedColumns]] = field(default_factory=dict)
    """Columns of `after` that need not be held twice, by part."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.clock_s)

    def state(self, step: int) -> dict[str, Float64]:
        """Return the state before a step, counted from the first: `clock_s` and parts by name."""
        at = self.before[CLOCK].at
        which = int(np.searchsorted(at, step))
        if which < len(at) and at[which] == step:
            return {name: each.rows[which] for name, each in self.before.items()}
        left = {name: rows[step - 1] for name, rows in self.after.items()}
        return {CLOCK: self.clock_s[step - 1 : step], **left}

    def starts(self, name: str) -> Float64:
        """Return a part of the state before each step, shape (n, width); of width 0 without it."""
        if name not in self.after:  # of a model in which nothing moves
            return np.zeros((len(self), 0))
        rows = self.after[name]
        starts: Float64 = np.concatenate((np.zeros((1, rows.shape[1])), rows[:-1]))
        starts[self.before[name].at] = self.before[name].rows
        return starts

    def given(self, step: int) -> dict[str, Float64]:
        """Return the inputs of a step, counted from the first, by name."""
        return {name: each.held(step) for name, each in self.inputs.items()}


CLOCK = "clock_s"
"""The name of the engine's own clock among the parts of a state."""
