"""Tell what a sweep found: a row per run, how the error converges, how it spreads."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from pipeline.console.output import (
    counted,
    error,
    made,
    millimetres,
    print_json,
    print_lines,
    titled,
    width,
)
from pipeline.fields import decimals, fraction

if TYPE_CHECKING:
    from pipeline.analysis.drop.convergence import Study
    from pipeline.stages.sweep import Sweep
    from pipeline.stages.sweep_groups import Group

MOST_ROWS = 30
"""So many runs fit on a screen; of more, the first are shown."""
MOST_STUDIES = 6
LONGEST = 20
"""Characters of a value in the table."""
STUDY = 24
"""Column in which a study's sentences begin."""
TERMS = {
    "error_m": "total",
    "timestep_m": "timestep",
    "damping_m": "damping",
    "interaction_m": "interaction",
    "rounding_m": "rounding",
}


def show_sweep(sweep: Sweep, *, as_json: bool) -> int:
    """Print what a sweep made and found; return the exit code: 1 where runs failed."""
    if as_json:
        print_json(_json(sweep))
    else:
        print_lines(*sweep_lines(sweep))
    if sweep.failed:
        error(f"{_failed(sweep)}; their rows in {sweep.results} say why")
    return 1 if sweep.failed else 0


def _failed(sweep: Sweep) -> str:
    return f"{sweep.failed:,} of {counted(sweep.runs, 'run')} failed"


def sweep_lines(sweep: Sweep) -> list[str]:
    """Tell what a sweep found: its runs, how the error converges or spreads, its files."""
    runs = counted(sweep.runs, "run")
    words = f"{runs}, errors at {sweep.at_s:g} s in mm, simulated minus free fall"
    first, *others = titled("", words, column=0)
    lines = [first.replace(runs, f"[bold]{runs}[/]", 1), *others]
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
        lines += ["", f"[dim]… and {more:,} more such sets of runs: see --json[/]"]
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
        "engines": [asdict(one) for one in sweep.engine_runs],
        "narrow_enough": sweep.narrow_enough,
        "table": sweep.table().to_dicts(),
    }


# -- every run ------------------------------------------------------------------------------------


def _rows(sweep: Sweep) -> list[str]:
    """Return a table of the runs: what differs between them, and their errors.

    Columns that a line has no room for are left out, from the right, but never the total.
    """
    shown = sweep.table(MOST_ROWS).to_dicts()
    labels = [[name, *(_cut(sweep.written(field, row[field])) for row in shown)]
              for field, name in sweep.axes]  # fmt: skip
    errors = [[name, *(_mm(row[term]) for row in shown)] for term, name in TERMS.items()]
    columns = [_aligned(one, str.ljust) for one in labels]
    columns += [_aligned(error, str.rjust) for error in errors]
    total = len(labels)
    left_out: list[str] = []
    while len(columns) > 1 and sum(len(column[0]) + 2 for column in columns) - 2 > width():
        at = -1 if len(columns) > total + 1 else total - 1
        total -= at == total - 1
        left_out.insert(0, columns.pop(at)[0].strip())
    lines = []
    for number, cells in enumerate(zip(*columns, strict=True)):
        line = escape("  ".join(cells).rstrip())
        failed = number and shown[number - 1]["error"] is not None
        lines.append(f"[dim]{line}[/]" if not number else f"[red]{line}[/]" if failed else line)
    if left_out:
        without = f"without {', '.join(left_out)}: see {sweep.results}"
        lines += [f"[dim]{line}[/]" for line in titled("", without, column=0)]
    if sweep.runs > len(shown):
        lines.append(f"[dim]… and {sweep.runs - len(shown):,} more in {sweep.results}[/]")
    return lines


def _aligned(cells: list[str], align: Callable[[str, int], str]) -> list[str]:
    width = max(8 if align is str.rjust else 0, *map(len, cells))
    return [align(cell, width) for cell in cells]


def _cut(text: str) -> str:
    """Return a value that takes no more than its share of a line; the end of a path tells most."""
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
    heading = "".join(pair.rjust(wide) for pair in pairs)
    lines = [
        *_heading(group.label or "by timestep"),
        f"  [dim]{'order of accuracy':<{STUDY - 2}}{heading}[/]",
        f"{'    against free fall':<{STUDY}}{free_fall}{' [yellow]*[/]' if damped else ''}",
        f"{'    against damped fall':<{STUDY}}"
        + _orders(study.orders_damped_fall, len(pairs), wide, 3),
    ]
    if damped:
        lines += _said("  *", f"meaningless: the error against free fall does not go to 0 but to "
                       f"{limit}, because damping is another model. An order has a meaning only "
                       "against 0.")  # fmt: skip
    for timestep_s in group.left_out_s:
        lines += _said("  left out", f"{fraction(timestep_s)} s, which has no sample at that time")
    if study.extrapolated_m is None:
        lines += _said("  Richardson", "needs three timesteps whose heights close in on a limit")
    else:
        lines += _said(
            "  Richardson",
            f"{decimals(study.extrapolated_m, 6)} m at order {study.order:.4f}; damped fall at "
            f"{decimals(study.damped_fall_m, 6)} m",
        )
    if study.grid_convergence_index is not None:
        lines += _said(
            "  convergence index",
            f"{study.grid_convergence_index:.4%} of the height at {steps[-1]} s; true error "
            f"{study.relative_error:.4%}",
        )
    if study.cancelling_timestep_s is not None and study.cancels_near(at_s):
        lines += _said(
            "  errors cancel at",
            f"{readable_step(study.cancelling_timestep_s)}: there timestep and damping weigh the "
            "same",
        )
    if study.refining_hurts and damped:
        lines += _said(
            "  refining hurts",
            f"the total grows again, to {limit}: take it apart first",
            style="yellow",
        )
    return lines


def _said(title: str, words: str, style: str = "") -> list[str]:
    return titled(title, words, column=STUDY, style=style)


def readable_step(timestep_s: float) -> str:
    """Write a timestep that is no fraction by design: about 1/341 s."""
    return f"{timestep_s:.4g} s" if timestep_s > 0.5 else f"about 1/{1 / timestep_s:.0f} s"


def _orders(orders: Sequence[float | None], last: int, width: int, decimals: int) -> str:
    texts = ["–" if order is None else f"{order:.{decimals}f}" for order in orders[-last:]]
    return "".join(text.rjust(width) for text in texts)


# -- engines --------------------------------------------------------------------------------------


def _engines(sweep: Sweep) -> list[str]:
    """Return a table of what each engine does on the floor, and one of what drifts."""
    runs, table = sweep.engine_runs, sweep.table(MOST_ROWS).to_dicts()
    labels = [
        [name, *(_cut(sweep.written(field, table[one.run][field])) for one in runs)]
        for field, name in sweep.axes
    ]
    floor = {
        "impact": [_unit(one.impact_s, 1, "s", 4) for one in runs],
        "deepest": [_unit(one.penetration_m, 1e3, "mm", 2) for one in runs],
        "at rest": [_unit(one.rest_error_m, 1e6, "µm", 2, "+") for one in runs],
        "cause": [one.rest_cause or "–" for one in runs],
        "contact": [_unit(one.contact_j, 1, "J", 4, "+") for one in runs],
        "a step": [f"{one.step_us:6.1f} µs" for one in runs],
    }
    drift = {
        "angular momentum": [_drift(one.angular_momentum_drift) for one in runs],
        "order": [_unit(one.order, 1, "", 3) for one in runs],
        "energy": [_drift(one.energy_drift) for one in runs],
    }
    lines = []
    if any(one.impact_s is not None or one.penetration_m is not None for one in runs):
        lines += [*_heading("on the floor"), *_table(labels, floor)]
    if any(one.angular_momentum_drift is not None for one in runs):
        lines += [""] if lines else []
        lines += [*_heading("drift before the first contact"), *_table(labels, drift)]
    return lines


def _table(labels: list[list[str]], columns: dict[str, list[str]]) -> list[str]:
    cells = [_aligned(one, str.ljust) for one in labels]
    for name, values in columns.items():
        align: Callable[[str, int], str] = str.ljust if name == "cause" else str.rjust
        width = max(map(len, (name, *values)))
        cells.append([align(cell, width) for cell in (name, *values)])
    rows = [escape("  ".join(row).rstrip()) for row in zip(*cells, strict=True)]
    return [f"[dim]{rows[0]}[/]", *rows[1:]]


def _unit(value: float | None, per_si: float, unit: str, places: int, sign: str = "") -> str:
    if value is None:
        return "–"
    return f"{decimals(round(value * per_si, places) + 0.0, places, sign)} {unit}".rstrip()


def _drift(value: float | None) -> str:
    return "–" if value is None else f"{value:.2e}"


# -- chance ---------------------------------------------------------------------------------------


def _statistics(group: Group) -> list[str]:
    lines = _heading(group.label) if group.label else []
    quantiles = list(group.statistics[0].quantiles) if group.statistics else []
    lines.append(_cells("", ["mean", "± 95 %", "spread", *quantiles], style="dim"))
    for statistic in group.statistics:
        half = (
            None
            if statistic.interval is None
            else (statistic.interval[1] - statistic.interval[0]) / 2
        )
        widths = [_mm(width).removeprefix("+") for width in (half, statistic.spread)]
        cells = [_mm(statistic.mean), *widths, *map(_mm, statistic.quantiles.values())]
        lines.append(_cells(TERMS[statistic.quantity], cells))
    count = group.statistics[0].count if group.statistics else 0
    samples = counted(group.samples, "sample")
    over = samples if count == group.samples else f"{count:,} of {samples}"
    if not count:
        lines.append(f"all {samples} failed" if group.samples > 1 else "the sample failed")
    elif group.in_the_air:
        lines.append(f"[dim]over the {over} in the air; ± 95 % is that of the mean[/]")
    else:
        lines.append(f"[dim]over {over}; none was in the air, so there is only the total[/]")
    return lines


def _cells(name: str, cells: Sequence[str], style: str = "") -> str:
    line = f"{name:<12}" + "".join(f"{cell:>11}" for cell in cells)
    return f"[{style}]{line}[/]" if style else line


# -- what else ------------------------------------------------------------------------------------


def _failures(sweep: Sweep) -> list[str]:
    if not sweep.failed:
        return []
    first = sweep.first_failure()
    return [
        f"[red]{_failed(sweep)}[/], see the column error; run {first['run']}:",
        *titled("", first["error"], column=2),
        "",
    ]


def _files(sweep: Sweep) -> list[str]:
    old = sweep.runs - sweep.computed
    rows = counted(sweep.runs, "row")
    known = f", {old:,} of them from before" if old > 0 else ""
    lines = made("results", sweep.results, rows + known, column=12)
    if sweep.plot is not None:
        lines += made("plot", sweep.plot, column=12)
    if sweep.narrow_enough is False:
        lines.append("[yellow]the interval is not yet as narrow as asked for: more --samples[/]")
    return lines
