"""Tell what a sweep found: a row per run, how the error converges, how it spreads."""

from __future__ import annotations

import contextlib
import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pipeline.console.output import millimetres, print_json, print_lines
from pipeline.fields import fraction, readable

if TYPE_CHECKING:
    from pipeline.budget.convergence import Study
    from pipeline.budget.statistics import Summary
    from pipeline.stages.sweep import Sweep
    from pipeline.stages.sweep_groups import Group

MOST_ROWS = 30
"""So many runs fit on a screen; of more, the first are shown."""
TERMS = {
    "error_m": "total",
    "timestep_m": "timestep",
    "damping_m": "damping",
    "interaction_m": "interaction",
    "rounding_m": "rounding",
}


@contextlib.contextmanager
def sweep_progress() -> Iterator[Callable[[int, int, int], None]]:
    """Yield what a sweep reports to: done, failed, rate and time left; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.completed:,.0f} of {task.total:,.0f} runs"),
        BarColumn(),
        TextColumn("{task.fields[failed]:,} failed, {task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, failed=0, rate="")
        before: list[int] = []

        def report(done: int, failed: int, total: int) -> None:
            before[:] = before or [done]  # what was there before says nothing of the rate
            elapsed_s = bar.tasks[0].elapsed or 0.0
            rate = (done - before[0]) / elapsed_s if elapsed_s > 0 else 0.0
            bar.update(
                task, completed=done, total=total, failed=failed,
                rate=f"{rate:,.0f} a second" if rate >= 1 else f"{60 * rate:.1f} a minute",
            )  # fmt: skip

        yield report


def show_sweep(sweep: Sweep, *, as_json: bool) -> None:
    """Print what a sweep made and found."""
    if as_json:
        print_json(_json(sweep))
        return
    lines = [
        f"[bold]{sweep.runs:,} runs[/], errors at {sweep.at_s:g} s in mm, simulated minus free fall"
    ]
    if sweep.statistics:
        for group in sweep.statistics:
            lines += ["", *_statistics(group)]
    else:
        lines += ["", *_rows(sweep)]
    for group in sweep.studies:
        if group.study is not None:
            lines += ["", *_study(group, group.study)]
    lines += ["", *_failures(sweep), *_files(sweep)]
    print_lines(*lines)


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
            group.values | {"summaries": [asdict(one) for one in group.statistics]}
            for group in sweep.statistics
        ],
        "narrow_enough": sweep.narrow_enough,
        "table": sweep.table().to_dicts(),
    }


# -- every run ------------------------------------------------------------------------------------


def _rows(sweep: Sweep) -> list[str]:
    """Return a table of the runs: what differs between them, and their errors."""
    axes = sweep.axes
    shown = sweep.table(MOST_ROWS).to_dicts()
    table = [[*(label for _, label in axes), *TERMS.values()]]
    for row in shown:
        named = [readable(row[field]) for field, _ in axes]
        errors = [_mm(row[term]) for term in TERMS]
        table.append([*named, *errors])
    left = len(axes)
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    lines = []
    for number, texts in enumerate(table):
        cells = [
            cell.ljust(width) if column < left else cell.rjust(max(width, 9))
            for column, (cell, width) in enumerate(zip(texts, widths, strict=True))
        ]
        line = "  ".join(cells).rstrip()
        failed = number and shown[number - 1]["error"] is not None
        lines.append(f"[dim]{line}[/]" if not number else f"[red]{line}[/]" if failed else line)
    if sweep.runs > len(shown):
        lines.append(f"[dim]… and {sweep.runs - len(shown):,} more in {sweep.results}[/]")
    return lines


def _mm(value_m: float | None) -> str:
    return "–" if value_m is None else millimetres(value_m).removesuffix(" mm").strip()


# -- convergence ----------------------------------------------------------------------------------


def _study(group: Group, study: Study) -> list[str]:
    """Tell what the timestep does, in lines of at most 100 characters."""
    steps = [fraction(run.timestep_s) for run in study.runs]
    pairs = [f"{one} → {two}" for one, two in itertools.pairwise(steps)][-3:]
    width = max(map(len, pairs)) + 3
    limit = f"{study.limit_m * 1e3:+.2f} mm"
    damped = study.limit_m != 0
    lines = [
        f"[bold]{group.label or 'By timestep'}[/]",
        f"  [dim]{'order of accuracy':<22}{''.join(pair.rjust(width) for pair in pairs)}[/]",
        f"    {'against free fall':<20}{_orders(study.orders_free_fall, width, 2 if damped else 3)}"
        + ("   [yellow]meaningless, see below[/]" if damped else ""),
        f"    {'against damped fall':<20}{_orders(study.orders_damped_fall, width, 3)}",
    ]
    if damped:
        lines += [
            f"    The error against free fall does not go to 0 but to {limit}: damping is another",
            "    model, which no timestep makes up for. An order has a meaning only against 0.",
        ]
    for timestep_s in group.left_out_s:
        lines.append(
            f"  [dim]without {fraction(timestep_s)} s, which has no sample at that time[/]"
        )
    finest = steps[-1]
    if study.extrapolated_m is not None and study.grid_convergence_index is not None:
        lines += [
            f"  {'Richardson':<22}height {study.extrapolated_m:.6f} m at order {study.order:.4f}; "
            f"damped fall is at {study.damped_fall_m:.6f} m",
            f"  {'convergence index':<22}{study.grid_convergence_index:.4%} of the height at "
            f"{finest} s; its true error is {study.relative_error:.4%}",
        ]
    else:
        lines.append(f"  {'Richardson':<22}needs three timesteps whose heights close in on a limit")
    if study.cancelling_timestep_s is not None:
        lines.append(
            f"  {'errors cancel at':<22}{readable_step(study.cancelling_timestep_s)}, where the "
            "timestep's share is as large as the damping's"
        )
    if study.refining_hurts:
        lines.append(
            f"  [yellow]refining hurts[/]        the total grows again, towards {limit}: take it "
            "apart before refining"
        )
    return lines


def readable_step(timestep_s: float) -> str:
    """Write a timestep that is no fraction by design: about 1/341 s."""
    return f"{timestep_s:.4g} s" if timestep_s > 0.5 else f"about 1/{1 / timestep_s:.0f} s"


def _orders(orders: Sequence[float | None], width: int, decimals: int) -> str:
    texts = ["–" if one is None else f"{one:.{decimals}f}" for one in orders[-3:]]
    return "  " + "".join(text.rjust(width) for text in texts)


# -- chance ---------------------------------------------------------------------------------------


def _statistics(group: Group) -> list[str]:
    lines = [f"[bold]{group.label}[/]"] if group.label else []
    quantiles = list(group.statistics[0].quantiles) if group.statistics else []
    heads = ["mean", "spread", *quantiles]
    head = "".join(f"{one:>11}" for one in heads)
    lines.append(f"[dim]{'':<12}{head}   mean, 95 % confidence[/]")
    for one in group.statistics:
        spread = _mm(one.spread).removeprefix("+")
        cells = "".join(
            f"{cell:>11}" for cell in (_mm(one.mean), spread, *map(_mm, one.quantiles.values()))
        )
        lines.append(f"{TERMS[one.quantity]:<12}{cells}   {_interval(one)}")
    counts = {one.count for one in group.statistics}
    if counts:
        lines.append(f"[dim]over the {min(counts):,} samples that were in the air[/]")
    else:
        lines.append("no sample was taken apart: none was in the air at that time")
    return lines


def _interval(summary: Summary) -> str:
    if summary.interval is None:
        return "–"
    low, high = summary.interval
    return f"{_mm(low)} … {_mm(high)}"


# -- what else ------------------------------------------------------------------------------------


def _failures(sweep: Sweep) -> list[str]:
    if not sweep.failed:
        return []
    first = sweep.first_failure()
    return [
        f"[red]{sweep.failed:,} of {sweep.runs:,} runs failed[/], see the column error; run "
        f"{first['run']}:",
        f"  {first['error']}",
        "",
    ]


def _files(sweep: Sweep) -> list[str]:
    old = sweep.runs - sweep.computed
    known = f", {old:,} of them were there before" if old > 0 else ""
    lines = [f"[dim]results[/]     {sweep.results}   {sweep.runs:,} rows{known}"]
    if sweep.plot is not None:
        lines.append(f"[dim]plot[/]        {sweep.plot}")
    if sweep.narrow_enough is False:
        lines.append("[yellow]the interval is not yet as narrow as asked for: more --samples[/]")
    return lines
