"""The report of `drop export`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drop_physics.fields import counted
from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import Facts, File, Report, Section

if TYPE_CHECKING:
    from drop_physics.stages.export import Export

COLUMN = 12
"""Width of the column of titles."""


def report_of(export: Export) -> Report:
    """Report the files written, and how much they contain."""
    files = []
    for path, count in export.files.items():
        held = counted(count, "message") if path.endswith(".mcap") else counted(count, "row")
        files.append(File(Message("written"), path, held))
    view = shell_command("drop", "view", export.recording)
    return Report(sections=[Section([Facts(files, COLUMN)])], next=[view])
