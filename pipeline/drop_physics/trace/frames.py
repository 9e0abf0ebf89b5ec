"""The data with which an engine can replay recorded steps: the model, and a frame per step.

A frame is the full state before a step, including hidden parts such as a solver's warm start, and
the external inputs. Names are the engine's own, and values are exact to the bit; this module does
not interpret them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Float64, Int64


@dataclass(frozen=True, eq=False)
class ModelPart:
    """A part of a compiled model's bytes, sent with a simulation's first step."""

    number: int
    """Index of the model in the recording."""
    engine: str
    """Name and version of the engine, which alone can load the model."""
    sha256: str
    """The digest of the whole model."""
    size: int
    """Bytes of the whole model."""
    at: int
    """Byte offset of this part."""
    data: bytes


class FrameColumn(NamedTuple):
    """A state array or input, such as `ctrl`, at some steps of a chunk."""

    at: Int64
    """The steps, counted from the first of the chunk, ascending, shape (k,)."""
    rows: Float64
    """The values at those steps, shape (k, width)."""

    def held(self, step: int) -> Float64:
        """Return the row in effect at a step: the last one stored so far, shape (width,)."""
        found: Float64 = self.rows[np.searchsorted(self.at, step, side="right") - 1]
        return found


class ModelEdit(NamedTuple):
    """A script's edit of model elements during the run."""

    step: int
    """The first step that uses the new values, counted from the chunk's first step."""
    name: str
    """The field, as the engine names it."""
    indices: Int64
    """Indices into the flattened field, shape (k,)."""
    values: Float64
    """The new values, shape (k,)."""


class SharedColumns(NamedTuple):
    """Columns of a state array that equal joint samples, so that they are stored only once."""

    body: int
    """Id of the body whose joints the columns describe."""
    of: str
    """The joint series whose values the columns equal: `position` or `velocity`."""
    columns: Int64
    """Column indices in the part, shape (k,)."""
    places: Int64
    """Column indices in the joint series, shape (k,)."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Start states and inputs of n consecutive steps of a simulation."""

    client: int
    model: int
    """Index of the model."""
    first: int
    """The sample from which the first step starts."""
    timestep_s: float
    clock_s: Float64
    """The engine's own clock after each step [s], shape (n,); usually it advances by one timestep
    per step."""
    functions: Int64
    """The function that made each step, by the engine watch's index, shape (n,)."""
    after: Mapping[str, Float64]
    """The parts of the state after each step, shape (n, width) each."""
    before: Mapping[str, FrameColumn]
    """The state before a step, with its `clock_s`: given for the first step, and wherever it
    differs from the state after the previous step."""
    inputs: Mapping[str, FrameColumn]
    """External inputs; a row is in effect from its step until the next row; the first is at step 0.
    """
    posed: Mapping[str, FrameColumn] = field(default_factory=dict)
    """The state arrays from which the engine had computed positions before a step, if these were of
    another state."""
    edits: Sequence[ModelEdit] = ()
    answers: Sequence[tuple[int, bytes]] = ()
    """Effects of the script's callbacks within a step, as the engine's watch sent them, by step."""
    shared: Mapping[str, Sequence[SharedColumns]] = field(default_factory=dict)
    """Columns of `after` that need not be stored twice, by part of the state."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.clock_s)

    def state(self, step: int) -> dict[str, Float64]:
        """Return the state before a step, counted from the first: `clock_s` and arrays by name."""
        at = self.before[CLOCK].at
        which = int(np.searchsorted(at, step))
        if which < len(at) and at[which] == step:
            return {name: each.rows[which] for name, each in self.before.items()}
        left = {name: rows[step - 1] for name, rows in self.after.items()}
        return {CLOCK: self.clock_s[step - 1 : step], **left}

    def starts(self, name: str) -> Float64:
        """Return a state array before each step, shape (n, width); width 0 if absent."""
        if name not in self.after:  # of a model in which nothing moves
            return np.zeros((len(self), 0))
        rows = self.after[name]
        starts: Float64 = np.concatenate((np.zeros((1, rows.shape[1])), rows[:-1]))
        starts[self.before[name].at] = self.before[name].rows
        return starts

    def given(self, step: int) -> dict[str, Float64]:
        """Return the inputs of a step by name; steps count from the first."""
        return {name: each.held(step) for name, each in self.inputs.items()}


CLOCK = "clock_s"
"""The name of the engine's own clock as a part of the state."""
