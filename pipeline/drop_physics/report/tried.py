"""The table of changes that were tried: for an expectation, and for a finding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drop_physics.messages import Message
from drop_physics.report.blocks import Column, DataTable


@dataclass(frozen=True)
class TriedRow:
    """A change that was tried, and its result."""

    mark: str
    """The change's rank, or the trial's verdict."""
    becomes: str
    """The quantity or effect after the change; empty if there is none."""
    told: str
    """The change, with notes."""


def table_of(rows: Sequence[TriedRow], margin: str = "") -> DataTable:
    """Return the table of changes that were tried; an empty column is left out."""
    becomes = Column(Message("becomes"), [each.becomes for each in rows], right=True)
    columns = [
        Column("", [each.mark for each in rows]),
        *([becomes] if any(each.becomes for each in rows) else []),
        Column(Message("with"), [each.told for each in rows], wraps=True),
    ]
    return DataTable(columns, margin=margin)
