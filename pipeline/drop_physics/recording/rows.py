"""Rows of named numbers: structured arrays as written, tables as read."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from drop_physics.recording import schema
from drop_physics.recording.digest import RowsDigest
from drop_physics.recording.schema import Table
from drop_physics.trace.history import table_of
from drop_physics.trace.states import Batch, Rows

BLOCK = 1 << 16
"""Rows of a table that are hashed at a time."""


def tables_of(batch: Batch) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return states and contacts as the tables that reading them back gives."""
    return table_of(batch.states), _table(batch.contacts, schema.CONTACTS)


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


def in_order(table: pl.DataFrame) -> pl.DataFrame:
    """Return a table in step order, without a copy where it is in order."""
    return table if table["step"].is_sorted() else table.sort("step", maintain_order=True)


def digest_of(read: pl.DataFrame, table: Table) -> str:
    """Return the digest of a table's rows, as it was when they were written."""
    digest = RowsDigest()
    add(digest, read, table)
    return digest.hexdigest()


def add(digest: RowsDigest, read: pl.DataFrame, table: Table) -> None:
    """Add a table's rows to a digest, as it was done when they were written."""
    for block in read.iter_slices(BLOCK):
        rows = np.empty(len(block), table.kind)
        rows["step"] = block["step"].to_numpy()
        for component, names in table.columns.items():
            values = rows[component].reshape(len(rows), len(names))
            for number, name in enumerate(names):
                values[:, number] = block[name].to_numpy()
        digest.update(rows)
