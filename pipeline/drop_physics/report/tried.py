"""The table of changes that were tried: for an expectation, and for a finding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drop_physics.messages import Message
from drop_physics.report.blocks import Column, DataTable


@dataclass(frozen=True)
class TriedRow:
    """A change that was tried, and what came of it."""

    mark: str
    """Its rank, or its verdict."""
    becomes: str
    """What becomes of the quantity; empty if there is none."""
    told: str
    """The change, with remarks."""


def table_of(rows: Sequence[TriedRow], margin: str = "") -> DataTable:
    """Return the table of changes that were tried, without a column that is empty."""
    becomes = Column(Message("becomes"), [each.becomes for each in rows], right=True)
    columns = [
        Column("", [each.mark for each in rows]),
        *([becomes] if any(each.becomes for each in rows) else []),
        Column(Message("with"), [each.told for each in rows], wraps=True),
    ]
    return DataTable(columns, margin=margin)
