"""The report of a script's runs with all combinations of changes: a row per run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import counted
from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import Column, DataTable, Facts, File, Report, Section, Words
from drop_physics.stages.trust.findings import readable

if TYPE_CHECKING:
    from drop_physics.stages.sweep.script import ScriptSweep
    from drop_physics.sweeping.rows import Row

MOST_ROWS = 30
"""Most runs shown."""


def json_of(sweep: ScriptSweep) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    return dict(
        jsonable(
            {
                "script": sweep.script,
                "recording": sweep.recording,
                "runs": len(sweep.rows),
                "failed": sweep.failed,
                "results": sweep.results,
                "table": sweep.rows,
            }
        )
    )


def report_of(sweep: ScriptSweep) -> Report:
    """Report where the runs end, and how far from the unchanged run."""
    runs = counted(len(sweep.rows), "run")
    head = Message("{script}: {runs}, beside its own", script=sweep.script, runs=runs)
    rows = sweep.rows[:MOST_ROWS]
    tried = [Column(name, [_value(row[name]) for row in rows]) for name in sweep.tried]
    moved = Column(Message("at the end"), [_moved(row) for row in rows])
    found = [", ".join(dict.fromkeys(row["findings"])) for row in rows]
    blocks = [DataTable([*tried, moved, Column(Message("findings"), found, wraps=True)])]
    sections = [Section([*blocks])]
    if len(sweep.rows) > len(rows):
        more = counted(len(sweep.rows) - len(rows), "run")
        sections.append(Section([Words(Message("and {more} more: --json", more=more), "dim")]))
    sections.append(Section([Facts([File(Message("results"), sweep.results)], 12)]))
    own = shell_command("drop", "analyze", sweep.results.with_name(sweep.recording.name))
    return Report(verdict=Words(head, key=sweep.script), sections=sections, next=[own])


def _value(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else "" if value is True else str(value)


def _moved(row: Row) -> str:
    """Describe how far a run ends from the unchanged run."""
    if row["ended"] == "failed":
        return Message("fails")
    if row["same"]:
        return Message("the same")
    off = {unit: row[f"end_{unit}"] for unit in ("m", "rad") if row[f"end_{unit}"] is not None}
    if not off:
        return Message("nothing compared")
    return ", ".join(readable(value, unit) for unit, value in off.items() if value) or "0"
