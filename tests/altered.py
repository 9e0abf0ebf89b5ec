"""Replaces samples of a recording after it was made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.states import BASE_STATE, CONTACT, Rows, between
from drop_physics.trace.tables import columns_of


@dataclass(frozen=True)
class Held:
    """Samples held in memory."""

    whole: Piece

    @property
    def first(self) -> int:
        """The first step."""
        return self.whole.first

    @property
    def last(self) -> int:
        """The last step."""
        return self.whole.end - 1

    def piece(self, first: int, end: int) -> Piece:
        """Return the samples from step `first` up to, but not including, step `end`."""
        held = self.whole
        return Piece(
            first,
            end,
            between(held.bases, first, end),
            {
                number: joints.at(slice(*np.searchsorted(joints.steps, [first, end])))
                for number, joints in held.joints.items()
            },
            {
                key: (steps[rows], values[rows])
                for key, (steps, values) in held.forces.items()
                for rows in [slice(*np.searchsorted(steps, [first, end]))]
            },
            between(held.contacts, first, end),
            held.calls.between(first, end),
        )


def otherwise(seen: Seen, **parts: Any) -> Seen:
    """Return a recording with its `bases`, `joints`, `forces`, `contacts` or `calls` replaced.

    Bases and contacts may be tables.
    """
    for name, kind in (("bases", BASE_STATE), ("contacts", CONTACT)):
        if isinstance(parts.get(name), pl.DataFrame):
            parts[name] = rows_in(parts[name], kind)
    sampled = seen.sampled
    whole = sampled.piece(sampled.first, sampled.last + 1)
    return replace(seen, sampled=Held(replace(whole, **parts)))


def rows_in(table: pl.DataFrame, kind: np.dtype[np.void]) -> Rows:
    """Convert a table of states or contact points to an array of records."""
    rows = np.empty(len(table), kind)
    for name in kind.names or ():
        values = table.select(columns_of(name)).to_numpy()
        rows[name] = values.reshape(rows[name].shape)
    return rows
