"""Merges a rule's matching rows over chunks, into one run of steps per body or joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64

Kind = Literal["at", "first", "last", "sum", "until", "most"]
"""How to merge a column over several rows: take the value of the largest row, the first, or the
last; the sum over all rows, or up to the largest; or the maximum."""


class Runs:
    """Runs of steps in which a rule holds, one per row, with named columns.

    Parameters
    ----------
    keys
        Subject of each row: ids of bodies, indices of joints …, shape (n, k).
    columns
        Columns by name: the kind of merging, and the values, shape (n, …). There are always the
        `first` and the `last` step, the `count` of steps, and the largest `size`.
    """

    def __init__(self, keys: Int64, columns: Mapping[str, tuple[Kind, NDArray[Any]]]) -> None:
        self.keys, self.columns = keys, columns

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.keys)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column by name."""
        return self.columns[name][1]

    @property
    def ends(self) -> Flags:
        """Flag the last row of each key; rows must be sorted by key."""
        return np.append((np.diff(self.keys, axis=0) != 0).any(axis=1), True)

    def at(self, rows: NDArray[Any]) -> Runs:
        """Return the selected rows."""
        columns = {name: (kind, each[rows]) for name, (kind, each) in self.columns.items()}
        return Runs(self.keys[rows], columns)

    @staticmethod
    def listed(parts: Sequence[Runs]) -> Runs:
        """Concatenate the rows of several tables; return a single table unchanged."""
        if len(parts) == 1:
            return parts[0]
        columns = {
            name: (kind, np.concatenate([part.columns[name][1] for part in parts]))
            for name, (kind, _) in parts[0].columns.items()
        }
        return Runs(np.concatenate([part.keys for part in parts]), columns)

    def joined(self, *, consecutive: bool) -> Runs:
        """Merge the rows of each key; with `consecutive`, only rows of consecutive steps."""
        order = np.lexsort((self["first"], *self.keys.T[::-1]))
        new = np.append(True, (np.diff(self.keys[order], axis=0) != 0).any(axis=1))
        if consecutive:
            new[1:] |= self["first"][order[1:]] != self["last"][order[:-1]] + 1
            if "begins" in self.columns:
                new |= self["begins"][order]
        starts, row = np.flatnonzero(new), np.cumsum(new) - 1
        size = self["size"][order]
        size[np.isnan(size)] = np.inf
        largest = np.flatnonzero(size == np.maximum.reduceat(size, starts)[row])
        at = largest[np.unique(row[largest], return_index=True)[1]]
        after = np.arange(len(order)) - at[row]
        rows = {"at": at, "first": starts, "last": np.append(starts[1:], len(row)) - 1}

        def kept(name: str, kind: Kind, values: NDArray[Any]) -> NDArray[Any]:
            if kind in rows:
                return np.asarray(values[order[rows[kind]]])
            values = values[order]
            if kind == "until":  # what came before the largest row, and led to that within it
                before = order[after < 0]
                values[after < 0] = self[name.removeprefix("until_")][before]
                values[after > 0] = 0.0
            reduce = np.maximum if kind == "most" else np.add
            return np.asarray(reduce.reduceat(values, starts))

        columns = {
            name: (kind, kept(name, kind, each)) for name, (kind, each) in self.columns.items()
        }
        return Runs(self.keys[order[starts]], columns)

    def noting(self, numbers: Mapping[str, NDArray[Any]]) -> Runs:
        """Return the rows with columns added."""
        more: dict[str, tuple[Kind, NDArray[Any]]]
        more = {name: ("at", number) for name, number in numbers.items()}
        return Runs(self.keys, {**self.columns, **more})

    def greatest(self, ranks: Float64) -> Runs:
        """Return the highest-ranked row of each key; `ranks` has the shape (n, k).

        Columns of `ranks` are compared in order, and then the number of steps.
        """
        them = self.at(np.lexsort((-self["count"], *-ranks.T[::-1], *self.keys.T[::-1])))
        return them.at(np.append(True, them.ends[:-1]))
