"""The report of a sweep: a row per run, how the error converges, how it spreads."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from drop_physics.fields import counted, decimals, fraction
from drop_physics.messages import Message
from drop_physics.report.blocks import (
    Block,
    Column,
    DataTable,
    Fact,
    Facts,
    File,
    Report,
    Section,
    Style,
    Words,
    numbers,
)
from drop_physics.report.words import MISSING, PLOT, TERMS, millimetres

if TYPE_CHECKING:
    from drop_physics.drop.convergence import Study
    from drop_physics.stages.sweep import Sweep
    from drop_physics.stages.sweep_groups import Group

MOST_ROWS = 30
"""Most runs that are shown."""
MOST_STUDIES = 6
LONGEST = 20
"""Most characters of a value in the table."""
MOST_PAIRS = 3
"""Most pairs of timesteps whose order is shown: the finest."""
STUDY = 24
"""Column at which a study's sentences begin."""
COLUMNS = {"error_m": "total"} | {f"{name}_m": name for name in TERMS if name != "total"}
"""Columns of the results, and the terms that they hold."""


def _failed(sweep: Sweep) -> Message:
    runs = counted(sweep.runs, "run")
    return Message("{failed:,} of {runs} failed", failed=sweep.failed, runs=runs)


def report_of(sweep: Sweep) -> Report:
    """Report a sweep: its runs, how the error converges or spreads, its files."""
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
    sections = [Section([*_statistics(group)]) for group in sweep.statistics]
    if not sections:
        sections.append(Section([*_rows(sweep)]))
    sections += [
        Section([*_study(group, group.study, sweep.at_s)])
        for group in sweep.studies[:MOST_STUDIES]
        if group.study is not None and any(run.error_m for run in group.study.runs)
    ]
    more = len(sweep.studies) - MOST_STUDIES
    if more > 0:
        sets = Message("… and {more:,} more such sets of runs: see --json", more=more)
        sections.append(Section([Words(sets, "dim")]))
    sections += _engines(sweep)
    if sweep.failed:
        sections.append(_failures(sweep))
    sections.append(Section([*_files(sweep)]))
    remarks = [
        Message(
            "{failed}; their rows in {results} say why",
            failed=_failed(sweep),
            results=str(sweep.results),
        )
    ]
    return Report(
        verdict=Words(words, key=runs),
        sections=sections,
        remarks=remarks if sweep.failed else (),
        code=1 if sweep.failed else 0,
    )


def json_of(sweep: Sweep) -> dict[str, Any]:
    """Return the object that `--json` prints."""
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
        Column(name, [_cut(sweep.written(field, row[field])) for row in rows], drop=place)
        for place, (field, name) in enumerate(sweep.axes, 1)
    ]


def _rows(sweep: Sweep) -> Iterator[Block]:
    """Yield a table of the runs: the values that differ between them, and their errors.

    Columns that do not fit in a line are left out, from the right, but never the total.
    """
    shown, results = sweep.table(MOST_ROWS).to_dicts(), str(sweep.results)
    labels = _labels(sweep, shown)
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
    """Return a value shortened to its share of a line; of a path, the end is kept."""
    return text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"


# -- convergence ----------------------------------------------------------------------------------


def _study(group: Group, study: Study, at_s: float) -> Iterator[Block]:
    """Yield the effect of the timestep."""
    steps = [fraction(run.timestep_s) for run in study.runs]
    limit_mm = study.limit_m * 1e3
    large = abs(limit_mm) >= 5e-3
    limit = f"{decimals(limit_mm, 2, '+') if large else f'{limit_mm:+.1e}'} mm"
    damped = study.damping_matters
    yield Words(group.label or Message("by timestep"), "bold")
    yield _orders(study, steps)
    facts: list[Fact] = []

    def say(title: str, words: str, style: Style = "") -> None:
        facts.append(Fact("  " + title, words, style))

    if damped:
        words = Message(
            "meaningless: the error against free fall tends to {limit}, not to 0, because damping "
            "is another model; an order of accuracy needs an error that tends to 0",
            limit=limit,
        )
        say("*", words)
    for timestep_s in group.left_out_s:
        words = Message(
            "{timestep} s, which has no sample at that time", timestep=fraction(timestep_s)
        )
        say(Message("left out"), words)
    if study.extrapolated_m is None:
        words = Message("needs three timesteps whose heights converge")
    else:
        words = Message(
            "{height} m at order {order:.4f}; damped fall at {damped} m",
            height=decimals(study.extrapolated_m, 6),
            order=study.order,
            damped=decimals(study.damped_fall_m, 6),
        )
    say(Message("Richardson"), words)
    if study.grid_convergence_index is not None:
        words = Message(
            "{index:.4%} of the height at {timestep} s; true error {error:.4%}",
            index=study.grid_convergence_index,
            timestep=steps[-1],
            error=study.relative_error,
        )
        say(Message("convergence index"), words)
    if study.cancelling_timestep_s is not None and study.cancels_near(at_s):
        words = Message(
            "{timestep}: timestep and damping are equal there",
            timestep=readable_step(study.cancelling_timestep_s),
        )
        say(Message("errors cancel at"), words)
    if study.refining_hurts and damped:
        words = Message("the total tends to {limit}: break it down first", limit=limit)
        say(Message("refining hurts"), words, "yellow")
    yield Facts(facts, STUDY)


def _orders(study: Study, steps: Sequence[str]) -> DataTable:
    """Return the order of accuracy between each two timesteps, the finest at the right."""
    damped = study.damping_matters
    pairs = [f"{coarse} → {fine}" for coarse, fine in itertools.pairwise(steps)]
    wide = max(map(len, pairs)) + 3
    both = [
        [MISSING if order is None else f"{order:.{places}f}" for order in orders]
        for orders, places in (
            (study.orders_free_fall, 2 if damped else 3),
            (study.orders_damped_fall, 3),
        )
    ]
    names = ["  " + Message("against free fall"), "  " + Message("against damped fall")]
    columns = [Column(Message("order of accuracy"), names, least=STUDY - 2)]
    columns += [
        Column(pair, cells, right=True, least=wide, gap=0, drop=len(pairs) - 1 - place)
        for place, (pair, *cells) in enumerate(zip(pairs, *both, strict=True))
    ][-MOST_PAIRS:]
    columns.append(Column("", ["*" if damped else "", ""], gap=1, style="yellow"))
    return DataTable(columns, margin="  ")


def readable_step(timestep_s: float) -> str:
    """Return a computed timestep as an approximate fraction: about 1/341 s."""
    if timestep_s > 0.5:
        return f"{timestep_s:.4g} s"
    return Message("about 1/{steps:.0f} s", steps=1 / timestep_s)


# -- engines --------------------------------------------------------------------------------------


def _engines(sweep: Sweep) -> Iterator[Section]:
    """Yield a table of what happens on the floor in each engine, and a table of drifts."""
    runs, rows = sweep.engine_runs, sweep.table(MOST_ROWS).to_dicts()
    labels = _labels(sweep, [rows[run.run] for run in runs])
    floor = [
        numbers(Message("impact"), [_unit(run.impact_s, 1, "s", 4) for run in runs]),
        numbers(Message("deepest"), [_unit(run.penetration_m, 1e3, "mm", 2) for run in runs]),
        numbers(Message("at rest"), [_unit(run.rest_error_m, 1e6, "µm", 2, "+") for run in runs]),
        Column(Message("cause"), [run.rest_cause or MISSING for run in runs]),
        numbers(Message("contact"), [_unit(run.contact_j, 1, "J", 4, "+") for run in runs]),
        numbers(Message("a step"), [f"{run.step_us:6.1f} µs" for run in runs]),
    ]
    drift = [
        numbers(Message("angular momentum"), [_drift(run.angular_momentum_drift) for run in runs]),
        numbers(Message("order"), [_unit(run.order, 1, "", 3) for run in runs]),
        numbers(Message("energy"), [_drift(run.energy_drift) for run in runs]),
    ]
    if any(run.impact_s is not None or run.penetration_m is not None for run in runs):
        yield Section([Words(Message("on the floor"), "bold"), DataTable([*labels, *floor])])
    if any(run.angular_momentum_drift is not None for run in runs):
        title = Words(Message("drift before the first contact"), "bold")
        yield Section([title, DataTable([*labels, *drift])])


def _unit(value: float | None, per_si: float, unit: str, places: int, sign: str = "") -> str:
    if value is None:
        return MISSING
    return f"{decimals(round(value * per_si, places) + 0.0, places, sign)} {unit}".rstrip()


def _drift(value: float | None) -> str:
    return MISSING if value is None else f"{value:.2e}"


# -- statistics -----------------------------------------------------------------------------------


def _statistics(group: Group) -> Iterator[Block]:
    if group.label:
        yield Words(group.label, "bold")
    found, samples = group.statistics, counted(group.samples, "sample")
    if not found:
        failed = Message("all {samples} failed", samples=samples)
        yield Words(failed if group.samples > 1 else Message("the sample failed"))
        return

    def wide(value_m: float | None) -> str:
        return millimetres(value_m).removeprefix("+")

    halves = [one.interval and (one.interval[1] - one.interval[0]) / 2 for one in found]
    yield DataTable(
        [
            Column("", [TERMS[COLUMNS[one.quantity]] for one in found]),
            numbers(Message("mean"), [millimetres(one.mean) for one in found]),
            numbers("± 95 %", [*map(wide, halves)]),
            numbers(Message("spread"), [wide(one.spread) for one in found]),
            *(
                numbers(head, [millimetres(one.quantiles[head]) for one in found])
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
    yield Words(words, "dim")


# -- failures and files ---------------------------------------------------------------------------


def _failures(sweep: Sweep) -> Section:
    first, failed = sweep.first_failure(), _failed(sweep)
    words = Message("{failed}, see the column error; run {run}:", failed=failed, run=first["run"])
    return Section([Words(words, key=failed), Words(first["error"], margin="  ")])


def _files(sweep: Sweep) -> Iterator[Block]:
    old = sweep.runs - sweep.computed
    rows = counted(sweep.runs, "row")
    if old > 0:
        rows = Message("{rows}, {old:,} of them from an earlier run", rows=rows, old=old)
    files = [File(Message("results"), sweep.results, rows)]
    if sweep.plot is not None:
        files.append(File(PLOT, sweep.plot))
    yield Facts(files, 12)
    if sweep.narrow_enough is False:
        more = Message(
            "the interval is wider than asked for, or there are fewer than 30: use more --samples"
        )
        yield Words(more, "yellow")
