"""Rows of named numbers: structured arrays as written, tables as read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.recording import schema
from pipeline.recording.checks import damaged, twice
from pipeline.recording.digest import RowsDigest
from pipeline.recording.schema import Table
from pipeline.states import Batch, Rows

BLOCK = 1 << 16
"""Rows of a table that are hashed at a time."""


def tables_of(batch: Batch) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return states and contacts as the tables that reading them back gives."""
    return _table(batch.states, schema.STATES), _table(batch.contacts, schema.CONTACTS)


def _table(rows: Rows, table: Table) -> pl.DataFrame:
    columns = {"step": rows["step"].copy()}
    for component, names in table.columns.items():
        columns |= named(rows[component].reshape(-1, len(names)), names)
    return pl.DataFrame(columns)


def empty(table: Table) -> pl.DataFrame:
    """Return a table without rows, as read."""
    return _table(np.empty(0, table.kind), table)


def named(values: NDArray[Any], names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Return the columns of values, shape (n, k), each as a copy."""
    return {name: values[:, number].copy() for number, name in enumerate(names)}


def joined(parts: Sequence[pl.DataFrame], table: Table, path: Path) -> pl.DataFrame:
    """Return parts of a table as one in step order, without a copy where they are in order.

    Raises
    ------
    RecordingError
        If two of them have the same step.
    """
    whole = pl.concat([empty(table), *parts], rechunk=False)
    if sum(part["step"].n_unique() for part in parts) != whole["step"].n_unique():
        raise damaged(path, twice(table.entity))
    return in_order(whole)


def in_order(table: pl.DataFrame) -> pl.DataFrame:
    """Return a table in step order, without a copy where it is in order."""
    return table if table["step"].is_sorted() else table.sort("step", maintain_order=True)


def digest_of(read: pl.DataFrame, table: Table) -> str:
    """Return the digest of a table's rows, as it was when they were written."""
    digest = RowsDigest()
    for block in read.iter_slices(BLOCK):
        rows = np.empty(len(block), table.kind)
        rows["step"] = block["step"].to_numpy()
        for component, names in table.columns.items():
            values = rows[component].reshape(len(rows), len(names))
            for number, name in enumerate(names):
                values[:, number] = block[name].to_numpy()
        digest.update(rows)
    return digest.hexdigest()
