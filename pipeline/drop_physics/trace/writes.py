"""Writes of a script into its engine's memory: the elements of a field, and their values.

A recording holds a write as a call by the name of the field (`trace.acts`), whose arguments are the
elements: all of them, or `[index]=value` for some; for a model's field, with the former values.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.trace.calls import Call

INDEX, BEFORE = "index", "before"
"""Names of the arguments besides the field's own."""
COMPUTED, READ = re.compile(r"; then (?!mj_jac)(\w+)"), re.compile(r"; then (mj_jac\w*)")
"""Match the function in a form that was called right after the write, unless it was a step: one
that computes what depends on it, or one that reads that."""


class WrittenElements(NamedTuple):
    """Written elements of a field; shape (n,) each."""

    indices: Int64
    """Indices into the flattened field."""
    values: Float64
    before: Float64
    """The previous values; nan if they are not recorded."""


def written_by(call: Call) -> WrittenElements:
    """Return the elements that a call, named after a field, wrote into it."""
    names, numbers = np.array(call.site.names), np.array(call.numbers)
    values = numbers[names == call.function]
    indices = numbers[names == INDEX].astype(np.int64)
    before = numbers[names == BEFORE]
    return WrittenElements(
        indices if len(indices) else np.arange(len(values)),
        values,
        before if len(before) else np.full(len(values), np.nan),
    )


def computed_by(call: Call) -> str:
    """Return the function called right afterwards to recompute dependents; empty without one."""
    found = COMPUTED.search(call.site.form)
    return found[1] if found else ""


def read_by(call: Call) -> str:
    """Return the function that read dependents right afterwards; empty without one."""
    found = READ.search(call.site.form)
    return found[1] if found else ""
