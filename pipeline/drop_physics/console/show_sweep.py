"""What a sweep found: a row per run, how the error converges, how it spreads."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.text import Text

from drop_physics.console.output import (
    Column,
    columns_of,
    counted,
    error,
    left,
    made,
    millimetres,
    print_json,
    print_lines,
    table,
    titled,
    width,
)
from drop_physics.console.words import PLOT, TERMS
from drop_physics.fields import decimals, fraction
from drop_physics.messages import Message, localized, translated

if TYPE_CHECKING:
    from drop_physics.drop.convergence import Study
    from drop_physics.stages.sweep import Sweep
    from drop_physics.stages.sweep_groups import Group

MOST_ROWS = 30
"""Runs that fit on a screen; of more, the first are shown."""
MOST_STUDIES = 6
LONGEST = 20
"""Characters of a value in the table."""
STUDY = 24
"""Column in which a study's sentences begin."""
COLUMNS = {"error_m": "total"} | {f"{name}_m": name for name in TERMS if name != "total"}
"""Columns of the results, and which terms they are."""


def show_sweep(sweep: Sweep, *, as_json: bool) -> int:
    """Print the results of a sweep; return the exit code: 1 if runs failed."""
    if as_json:
        print_json(_json(sweep))
    else:
        print_lines(*sweep_lines(sweep))
    if sweep.failed:
        error(
            Message(
                "{failed}; their rows in {results} say why",
                failed=_failed(sweep),
                results=str(sweep.results),
            )
        )
    return 1 if sweep.failed else 0


def _failed(sweep: Sweep) -> Message:
    runs = counted(sweep.runs, "run")
    return Message("{failed:,} of {runs} failed", failed=sweep.failed, runs=runs)


def sweep_lines(sweep: Sweep) -> list[str]:
    """Tell what a sweep found: its runs, how the error converges or spreads, its files."""
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
    first, *others = titled("", words, column=0)
    count = translated(runs)
    lines = [first.replace(count, f"[bold]{count}[/]", 1), *others]
    if sweep.statistics:
        for group in sweep.statistics:
            lines += ["", *_statistics(group)]
    else:
        lines += ["", *_rows(sweep)]
    for group in sweep.studies[:MOST_STUDIES]:
        if group.study is not None and any(run.error_m for run in group.study.runs):
            lines += ["", *_study(group, group.study, sweep.at_s)]
    more = len(sweep.studies) - MOST_STUDIES
    if more > 0:
        sets = localized("… and {more:,} more such sets of runs: see --json", more=more)
        lines += ["", f"[dim]{sets}[/]"]
    if sweep.engine_runs:
        lines += ["", *_engines(sweep)]
    return [*lines, "", *_failures(sweep), *_files(sweep)]


def _json(sweep: Sweep) -> dict[str, Any]:
    return {
        "runs": sweep.runs,
        "failed": sweep.failed,
        "results": str(sweep.results),
        "at_s": sweep.at_s,
        "plot": None if sweep.plot is None else str(sweep.plot),
        "convergence": [
            group.values
            | {"study": asdict(group.study) | {"refining_hurts": group.study.refining_hurts}}
            for group in sweep.studies
            if group.study is not None
        ],
        "statistics": [
            group.values | {"summaries": [asdict(statistic) for statistic in group.statistics]}
            for group in sweep.statistics
        ],
        "engines": [asdict(run) for run in sweep.engine_runs],
        "narrow_enough": sweep.narrow_enough,
        "table": sweep.table().to_dicts(),
    }


# -- tables ---------------------------------------------------------------------------------------


def _labels(sweep: Sweep, rows: Sequence[dict[str, Any]]) -> list[Column]:
    """Return a column for each field that differs between the runs."""
    return [
        (name, [_cut(sweep.written(field, row[field])) for row in rows], False)
        for field, name in sweep.axes
    ]


def _rows(sweep: Sweep) -> list[str]:
    """Return a table of the runs: what differs between them, and their errors.

    Columns that do not fit in a line are left out, from the right, but never the total.
    """
    shown = sweep.table(MOST_ROWS).to_dicts()
    total, *terms = (
        (TERMS[name], [_mm(row[column]) for row in shown], True) for column, name in COLUMNS.items()
    )
    labels, failed = _labels(sweep, shown), [row["error"] is not None for row in shown]
    left_out: list[str] = []
    while columns_of(Text.from_markup(table([*labels, total, *terms])[0]).plain) > width():
        if not (terms or labels):
            break
        left_out.insert(0, translated((terms or labels).pop()[0]))
    lines = table([*labels, total, *terms], red=failed)
    results = str(sweep.results)
    if left_out:
        words = Message(
            "without {columns}: see {results}", columns=", ".join(left_out), results=results
        )
        lines += [f"[dim]{line}[/]" for line in titled("", words, column=0)]
    if sweep.runs > len(shown):
        more = sweep.runs - len(shown)
        more_rows = localized("… and {more:,} more in {results}", more=more, results=results)
        lines.append(f"[dim]{escape(more_rows)}[/]")
    return lines


def _cut(text: str) -> str:
    """Shorten a value to its share of a line; of a path the end matters most."""
    return text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"


def _heading(label: str) -> list[str]:
    return [f"[bold]{line}[/]" for line in titled("", label, column=0)]


def _mm(value_m: float | None) -> str:
    return "–" if value_m is None else millimetres(value_m).removesuffix(" mm").strip()


# -- convergence ----------------------------------------------------------------------------------


def _study(group: Group, study: Study, at_s: float) -> list[str]:
    """Tell what the timestep does."""
    steps = [fraction(run.timestep_s) for run in study.runs]
    pairs = [f"{coarse} → {fine}" for coarse, fine in itertools.pairwise(steps)]
    wide = max(map(len, pairs)) + 3
    pairs = pairs[-max(1, min(3, (width() - STUDY - 2) // wide)) :]
    limit_mm = study.limit_m * 1e3
    large = abs(limit_mm) >= 5e-3
    limit = f"{decimals(limit_mm, 2, '+') if large else f'{limit_mm:+.1e}'} mm"
    damped = study.damping_matters
    free_fall = _orders(study.orders_free_fall, len(pairs), wide, 2 if damped else 3)
    damped_fall = _orders(study.orders_damped_fall, len(pairs), wide, 3)
    star = " [yellow]*[/]" if damped else ""
    heading = "".join(pair.rjust(wide) for pair in pairs)
    lines = [
        *_heading(group.label or Message("by timestep")),
        "  [dim]" + left(localized("order of accuracy"), STUDY - 2) + f"{heading}[/]",
        "    " + left(localized("against free fall"), STUDY - 4) + free_fall + star,
        "    " + left(localized("against damped fall"), STUDY - 4) + damped_fall,
    ]
    if damped:
        words = Message(
            "meaningless: the error against free fall does not go to 0 but to {limit}, because "
            "damping is another model. An order has a meaning only against 0.",
            limit=limit,
        )
        lines += _said("*", words)
    for timestep_s in group.left_out_s:
        words = Message(
            "{timestep} s, which has no sample at that time", timestep=fraction(timestep_s)
        )
        lines += _said(Message("left out"), words)
    if study.extrapolated_m is None:
        words = Message("needs three timesteps whose heights converge")
    else:
        words = Message(
            "{height} m at order {order:.4f}; damped fall at {damped} m",
            height=decimals(study.extrapolated_m, 6),
            order=study.order,
            damped=decimals(study.damped_fall_m, 6),
        )
    lines += _said(Message("Richardson"), words)
    if study.grid_convergence_index is not None:
        words = Message(
            "{index:.4%} of the height at {timestep} s; true error {error:.4%}",
            index=study.grid_convergence_index,
            timestep=steps[-1],
            error=study.relative_error,
        )
        lines += _said(Message("convergence index"), words)
    if study.cancelling_timestep_s is not None and study.cancels_near(at_s):
        words = Message(
            "{timestep}: timestep and damping are equal there",
            timestep=readable_step(study.cancelling_timestep_s),
        )
        lines += _said(Message("errors cancel at"), words)
    if study.refining_hurts and damped:
        words = Message("the total tends to {limit}: break it down first", limit=limit)
        lines += _said(Message("refining hurts"), words, style="yellow")
    return lines


def _said(title: str, words: str, style: str = "") -> list[str]:
    return titled("  " + translated(title), words, column=STUDY, style=style)


def readable_step(timestep_s: float) -> str:
    """Write a computed timestep as an approximate fraction: about 1/341 s."""
    if timestep_s > 0.5:
        return f"{timestep_s:.4g} s"
    return Message("about 1/{steps:.0f} s", steps=1 / timestep_s)


def _orders(orders: Sequence[float | None], last: int, width: int, decimals: int) -> str:
    texts = ["–" if order is None else f"{order:.{decimals}f}" for order in orders[-last:]]
    return "".join(text.rjust(width) for text in texts)


# -- engines --------------------------------------------------------------------------------------


def _engines(sweep: Sweep) -> list[str]:
    """Return a table of what each engine does on the floor, and a table of drifts."""
    runs, rows = sweep.engine_runs, sweep.table(MOST_ROWS).to_dicts()
    labels = _labels(sweep, [rows[run.run] for run in runs])
    floor = [
        (Message("impact"), [_unit(run.impact_s, 1, "s", 4) for run in runs], True),
        (Message("deepest"), [_unit(run.penetration_m, 1e3, "mm", 2) for run in runs], True),
        (Message("at rest"), [_unit(run.rest_error_m, 1e6, "µm", 2, "+") for run in runs], True),
        (Message("cause"), [translated(run.rest_cause or "–") for run in runs], False),
        (Message("contact"), [_unit(run.contact_j, 1, "J", 4, "+") for run in runs], True),
        (Message("a step"), [f"{run.step_us:6.1f} µs" for run in runs], True),
    ]
    drift = [
        (Message("angular momentum"), [_drift(run.angular_momentum_drift) for run in runs], True),
        (Message("order"), [_unit(run.order, 1, "", 3) for run in runs], True),
        (Message("energy"), [_drift(run.energy_drift) for run in runs], True),
    ]
    lines = []
    if any(run.impact_s is not None or run.penetration_m is not None for run in runs):
        lines += [*_heading(Message("on the floor")), *table([*labels, *floor])]
    if any(run.angular_momentum_drift is not None for run in runs):
        lines += [""] if lines else []
        lines += [*_heading(Message("drift before the first contact")), *table([*labels, *drift])]
    return lines


def _unit(value: float | None, per_si: float, unit: str, places: int, sign: str = "") -> str:
    if value is None:
        return "–"
    return f"{decimals(round(value * per_si, places) + 0.0, places, sign)} {unit}".rstrip()


def _drift(value: float | None) -> str:
    return "–" if value is None else f"{value:.2e}"


# -- statistics -----------------------------------------------------------------------------------


def _statistics(group: Group) -> list[str]:
    lines = _heading(group.label) if group.label else []
    found, samples = group.statistics, counted(group.samples, "sample")
    if not found:
        failed = Message("all {samples} failed", samples=samples)
        return [*lines, translated(failed if group.samples > 1 else Message("the sample failed"))]

    def wide(value_m: float | None) -> str:
        return _mm(value_m).removeprefix("+")

    halves = [one.interval and (one.interval[1] - one.interval[0]) / 2 for one in found]
    lines += table(
        [
            ("", [translated(TERMS[COLUMNS[one.quantity]]) for one in found], False),
            (Message("mean"), [_mm(one.mean) for one in found], True),
            ("± 95 %", [*map(wide, halves)], True),
            (Message("spread"), [wide(one.spread) for one in found], True),
            *(
                (head, [_mm(one.quantiles[head]) for one in found], True)
                for head in found[0].quantiles
            ),
        ]
    )
    over, count = samples, found[0].count
    if count != group.samples:
        over = Message("{count:,} of {samples}", count=count, samples=samples)
    words = (
        Message(
            "over the {samples} in the air, in theory too; ± 95 % is that of the mean", samples=over
        )
        if group.in_the_air
        else Message(
            "over {samples}; none was in the air, in theory too, so there is only the total",
            samples=over,
        )
    )
    return [*lines, f"[dim]{translated(words)}[/]"]


# -- failures and files ---------------------------------------------------------------------------


def _failures(sweep: Sweep) -> list[str]:
    if not sweep.failed:
        return []
    first = sweep.first_failure()
    return [
        localized(
            "[red]{failed}[/], see the column error; run {run}:",
            failed=_failed(sweep),
            run=first["run"],
        ),
        *titled("", first["error"], column=2),
        "",
    ]


def _files(sweep: Sweep) -> list[str]:
    old = sweep.runs - sweep.computed
    rows = counted(sweep.runs, "row")
    if old > 0:
        rows = Message("{rows}, {old:,} of them from before", rows=rows, old=old)
    lines = made(Message("results"), sweep.results, rows, column=12)
    if sweep.plot is not None:
        lines += made(PLOT, sweep.plot, column=12)
    if sweep.narrow_enough is False:
        more = localized(
            "the interval is wider than asked for, or of fewer than 30 samples: use more --samples"
        )
        lines.append(f"[yellow]{more}[/]")
    return lines
