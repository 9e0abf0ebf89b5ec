"""The report of a sweep of scenarios: a row per run, and the spread of position errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics.fields import counted
from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import (
    Block,
    Column,
    DataTable,
    Facts,
    File,
    Report,
    Section,
    Words,
    numbers,
)
from drop_physics.report.words import TERMS, millimetres

if TYPE_CHECKING:
    from drop_physics.stages.sweep import Sweep
    from drop_physics.sweeping.rows import Row

MOST_ROWS = 30
"""Most runs shown."""
LONGEST = 20
"""Longest value in the table [characters]."""
COLUMNS = {"error_m": "total"} | {f"{name}_m": name for name in TERMS if name != "total"}
"""Columns of the results that contain terms of the error."""
QUANTILES = {"5%": 0.05, "50%": 0.5, "95%": 0.95}


def report_of(sweep: Sweep) -> Report:
    """Report a sweep: its runs, or the spread of their errors, and its files."""
    runs = counted(sweep.runs, "run")
    words = Message(
        "{runs}, errors at {at:g} s in mm, simulated minus free fall", runs=runs, at=sweep.at_s
    )
    if not sweep.at_samples:
        words = Message(
            "{runs}, errors at the samples nearest to {at:g} s in mm, simulated minus free fall",
            runs=runs,
            at=sweep.at_s,
        )
    failed = Message("{failed:,} of {runs} failed", failed=sweep.failed, runs=runs)
    if sweep.plan.samples is None:
        sections = [Section([*_rows(sweep)])]
    else:
        each = sweep.plan.samples
        groups = [sweep.rows[first : first + each] for first in range(0, sweep.runs, each)]
        sections = [Section([*_spread(sweep, group)]) for group in groups]
    if sweep.failed:
        first = next(row for row in sweep.rows if row["error"] is not None)
        words_of = Message(
            "{failed}, see the column error; run {run}:", failed=failed, run=first["run"]
        )
        told = [Words(words_of, key=failed), Words(first["error"], margin="  ")]
        sections.append(Section([*told]))
    old, rows = sweep.runs - sweep.computed, counted(sweep.runs, "row")
    if old > 0:
        rows = Message("{rows}, {old:,} of them from an earlier run", rows=rows, old=old)
    sections.append(Section([Facts([File(Message("results"), sweep.results, rows)], 12)]))
    remark = Message(
        "{failed}; their rows in {results} say why", failed=failed, results=str(sweep.results)
    )
    return Report(
        verdict=Words(words, key=runs),
        sections=sections,
        remarks=[remark] if sweep.failed else (),
        next=[*_next(sweep)],
        code=1 if sweep.failed else 0,
    )


def _next(sweep: Sweep) -> Iterator[str]:
    """Yield the command that explains the sweep's first recorded run."""
    recordings = (row.get("recording") for row in sweep.rows)
    first = next(filter(None, recordings), None)
    if first is not None:
        yield shell_command("drop", "analyze", sweep.results.parent / first)


def json_of(sweep: Sweep) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    return {
        "runs": sweep.runs,
        "failed": sweep.failed,
        "results": str(sweep.results),
        "at_s": sweep.at_s,
        "table": sweep.rows,
    }


def _rows(sweep: Sweep) -> Iterator[Block]:
    """Yield a table of the runs: the values that vary between them, and the errors.

    Columns that do not fit in a line are left out from right to left, except the total.
    """
    shown, results = sweep.rows[:MOST_ROWS], str(sweep.results)
    labels = [
        Column(name, [_cut(sweep.written(field, row[field])) for row in shown], drop=place)
        for place, (field, name) in enumerate(sweep.axes, 1)
    ]
    terms = [
        numbers(TERMS[name], [millimetres(row[column]) for row in shown], drop=place)
        for place, (column, name) in enumerate(COLUMNS.items(), len(labels) + 1)
    ]
    terms[0] = replace(terms[0], drop=0)  # the total
    failed = [row["error"] is not None for row in shown]

    def without(columns: str) -> Words:
        words = Message("without {columns}: see {results}", columns=columns, results=results)
        return Words(words, "dim")

    yield DataTable([*labels, *terms], failed=failed, left_out=without)
    if sweep.runs > len(shown):
        more = sweep.runs - len(shown)
        words = Message("… and {more:,} more in {results}", more=more, results=results)
        yield Words(words, "dim")


def _cut(text: str) -> str:
    """Truncate a value to its share of a line; the end of a path is kept."""
    return text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"


def _spread(sweep: Sweep, rows: Sequence[Row]) -> Iterator[Block]:
    """Yield the spread of each scenario's errors; if possible, over samples in the air."""
    if label := sweep.label(rows[0]):
        yield Words(label, "bold")
    in_the_air = [row for row in rows if row["rounding_m"] is not None]
    told = in_the_air or [row for row in rows if row["error_m"] is not None]
    samples = counted(len(rows), "sample")
    if not told:
        failed = Message("all {samples} failed", samples=samples)
        yield Words(failed if len(rows) > 1 else Message("the sample failed"))
        return
    columns = [name for name in COLUMNS if told[0][name] is not None]
    errors_m = np.array([[row[name] for name in columns] for row in told])
    apart_m = errors_m - errors_m[0]  # of equal ones exactly 0
    mean_m = errors_m[0] + apart_m.mean(axis=0)
    spread_m = apart_m.std(axis=0, ddof=1) if len(told) > 1 else [None] * len(columns)
    yield DataTable(
        [
            Column("", [TERMS[COLUMNS[name]] for name in columns]),
            numbers(Message("mean"), [*map(millimetres, mean_m.tolist())]),
            numbers(Message("spread"), [millimetres(m).removeprefix("+") for m in spread_m]),
            *(
                numbers(head, [*map(millimetres, np.quantile(errors_m, share, axis=0).tolist())])
                for head, share in QUANTILES.items()
            ),
        ]
    )
    over = samples
    if len(told) != len(rows):
        over = Message("{count:,} of {samples}", count=len(told), samples=samples)
    words = (
        Message("over the {samples} in the air, in theory too", samples=over)
        if in_the_air
        else Message(
            "over {samples}; none was in the air, in theory too, so there is only the total",
            samples=over,
        )
    )
    yield Words(words, "dim")
