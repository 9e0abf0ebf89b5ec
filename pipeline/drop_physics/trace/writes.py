"""A script's writes into engine memory: which elements of a field, and their new values.

A recording stores a write as a call with the name of the field (`trace.acts`). The arguments are
all elements, or `[index]=value` for some; a write to a model also has the previous values.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.trace.calls import Call

INDEX, BEFORE = "index", "before"
"""Names of the arguments in addition to the field's own."""
COMPUTED, READ = re.compile(r"; then (?!mj_jac)(\w+)"), re.compile(r"; then (mj_jac\w*)")
"""Regular expressions for the function called right after the write, unless it was a step: one that
recomputes dependent values, or one that reads them."""


class WrittenElements(NamedTuple):
    """The elements of a field that a write changed; shape (n,) each."""

    indices: Int64
    """Indices into the flattened field."""
    values: Float64
    before: Float64
    """The previous values; nan if they are not recorded."""


def written_by(call: Call) -> WrittenElements:
    """Return the elements that a recorded write changed; its call is named after the field."""
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
    """Return the function that recomputed dependent values right after a write; empty if none."""
    found = COMPUTED.search(call.site.form)
    return found[1] if found else ""


def read_by(call: Call) -> str:
    """Return the function that read dependent values right after a write; empty if none did."""
    found = READ.search(call.site.form)
    return found[1] if found else ""
