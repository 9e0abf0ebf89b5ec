"""States and contact points as tables of named columns, for people and their tools."""

from __future__ import annotations

import polars as pl

from drop_physics.trace.states import CONTACT_COLUMNS, STATE_COLUMNS, Rows, numbers_of

VECTORS = STATE_COLUMNS | CONTACT_COLUMNS


def columns_of(field: str) -> tuple[str, ...]:
    """Return the names of the table columns that a field of states or contacts becomes."""
    return VECTORS.get(field, (field,))


def table_of(rows: Rows) -> pl.DataFrame:
    """Return rows of states or contact points as a table, a column for each number."""
    columns = {}
    for name in rows.dtype.names or ():
        values = numbers_of(rows, name)
        for number, column in enumerate(columns_of(name)):
            columns[column] = values[:, number].copy()
    return pl.DataFrame(columns)
