"""Tell what the bodies of a script did: a line each, their flights and contacts, the findings."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.markup import escape

from pipeline.analysis.script.results import Moment, Vector
from pipeline.console.output import (
    counted,
    millimetres,
    note,
    print_json,
    print_lines,
    titled,
)

if TYPE_CHECKING:
    from pipeline.analysis.script.results import (
        BodyAnalysis,
        ScriptAnalysis,
        ScriptContact,
        ScriptFlight,
    )

MOST_BODIES, MOST_ROWS, MOST_OF_A_CODE = 12, 3, 3
"""Bodies, flights of one and findings of one code that are told; all are in the JSON."""
TITLE = 12
"""Columns that a title takes."""


def show_script(analysis: ScriptAnalysis, *, as_json: bool) -> None:
    """Print what `analyze` found of a script's recording."""
    if analysis.partial:
        note(
            f"{analysis.recording} was never finished: this is the analysis of the "
            f"{counted(len(analysis.table), 'sample')} that it holds, unverified"
        )
    if as_json:
        print_json(analysis.as_json())
    else:
        print_lines(*_story(analysis))


def bodies_of(number: int) -> str:
    """Return a number of bodies in words."""
    return f"{number:,} {'body' if number == 1 else 'bodies'}"


def _story(analysis: ScriptAnalysis) -> list[str]:
    origin, explained = analysis.origin, analysis.explained
    lines = [
        f"[bold]{escape(str(origin['script']))}[/] {origin['ended'] or 'was never finished'}, "
        f"{bodies_of(len(analysis.bodies))}",
    ]
    if explained["of"]:
        share = explained["samples"] / explained["of"]
        words = "all" if share == 1 else f"{explained['samples']:,} of"
        lines += titled(
            "Explained",
            f"{words} {explained['of']:,} samples of bodies without joints, step by step",
            column=TITLE,
            style="bold",
        )
    moving = [one for one in analysis.bodies if one.segments["still"] < sum(one.segments.values())]
    still = [one for one in analysis.bodies if one not in moving]
    for body in moving[:MOST_BODIES]:
        lines += ["", *_body(body, full=len(moving) == 1)]
    more = len(moving) - MOST_BODIES
    if more > 0:
        lines += ["", f"and {bodies_of(more)} more: see --json, or --body"]
    if still:
        names = ", ".join(one.label for one in still[:MOST_BODIES])
        dots = " …" if len(still) > MOST_BODIES else ""
        lines += ["", *titled("Still", names + dots, column=TITLE, style="bold")]
    if analysis.findings:
        lines.append("")
    told: Counter[str] = Counter()
    for finding in analysis.findings:
        told[finding.code] += 1
        if told[finding.code] <= MOST_OF_A_CODE:
            words = f"{finding.code}: {finding.message}"
            lines += titled("Finding", words, column=TITLE, style="bold")
    for code, count in told.items():
        if count > MOST_OF_A_CODE:
            lines += titled("", f"{code}: {count - MOST_OF_A_CODE} more, see --json", column=TITLE)
    return lines


def _body(body: BodyAnalysis, *, full: bool) -> list[str]:
    counts = ", ".join(f"{count:,} {name}" for name, count in body.segments.items() if count)
    links = "" if len(body.links) == 1 else f", {counted(len(body.links) - 1, 'link')}"
    column = max(TITLE, len(body.label) + 2)
    facts = f"{body.mass_kg:.4g} kg{links}: {counts}"
    lines = titled(body.label, facts, column=column, style="bold")
    for one in body.unexplained:
        words = f"{counted(one.samples, 'sample')} from step {one.first_step} on: {one.reason}"
        lines += titled("  unexplained", words, column=TITLE + 4)
    most = 100 if full else MOST_ROWS
    lines += _taken_apart(body.flights, most) if full else _flights(body.flights, most)
    lines += _contacts(body.contacts, most)
    energy = body.energy
    if energy is not None:
        first, last = (0.0 + value for value in (energy.first_j, energy.last_j))
        words = f"{first:.4g} J at first, {last:.4g} J at last"
        if energy.largest_j > max(first, last):
            words += f", {energy.largest_j:.4g} J at most (step {energy.largest_step})"
        lines += titled("  energy", words, column=TITLE)
    return lines


def _longest(flights: list[ScriptFlight], most: int) -> list[ScriptFlight]:
    longest = sorted(flights, key=lambda one: one.first_step - one.last_step)[:most]
    return sorted(longest, key=lambda one: one.first_step)


def _flights(flights: list[ScriptFlight], most: int) -> list[str]:
    """Return the longest flights, a row each: what each is off free fall at its end."""
    if not flights:
        return []
    header = f"{'from':>9} {'to':>11}   {'x off':>12} {'y off':>12} {'z off':>12}"
    rows = [
        f"{one.start_s:9.4f} s {one.end_s:9.4f} s  "
        + " ".join(f"{round(value_m * 1e3, 4) + 0.0:+9.4f} mm" for value_m in one.error_m)
        for one in _longest(flights, most)
    ]
    return _listed("  flights", header, rows, len(flights), "shorter flight")


def _taken_apart(flights: list[ScriptFlight], most: int) -> list[str]:
    """Return the longest flights, a table each: the error at some times, and its terms."""
    lines = []
    for flight in _longest(flights, most):
        ends = Moment(flight.last_step, flight.end_s, flight.error_m, flight.terms_m)
        lines += ["", f"  flight from {flight.start_s:.4f} s to {flight.end_s:.4f} s"]
        for moment in (*flight.at, ends):
            at = f"at {moment.time_s:.4g} s"
            lines.append(f"[dim]  {at:<{TITLE}} {'x':>10}    {'y':>10}    {'z':>10}[/]")
            if moment.terms_m is None:
                lines.append("  not broken down: a velocity is limited, or gravity is not along z")
            else:
                for name, values_m in asdict(moment.terms_m).items():
                    lines.append(f"  {name:<{TITLE}} {_row(values_m)}")
            lines.append(f"  {'total':<{TITLE}} [bold]{_row(moment.error_m)}[/]")
    left = len(flights) - most
    return [*lines, f"  and {counted(left, 'shorter flight')}"] if left > 0 else lines


def _row(values_m: Vector) -> str:
    return " ".join(map(millimetres, values_m))


def _contacts(contacts: list[ScriptContact], most: int) -> list[str]:
    """Return the contacts with the greatest impulses, a row each: what they gave."""
    if not contacts:
        return []
    header = f"{'from':>9} {'to':>11}   {'impulse':>12} {'greatest force':>14} {'energy':>11}"
    greatest = sorted(contacts, key=lambda one: -math.hypot(*one.impulse_n_s))[:most]
    rows = []
    for one in sorted(greatest, key=lambda one: one.first_step):
        others = ", ".join(dict.fromkeys(pusher.body for pusher in one.by))
        rows.append(
            f"{one.start_s:9.4f} s {one.end_s:9.4f} s  {math.hypot(*one.impulse_n_s):9.4g} Ns "
            f"{one.largest_force_n:12.4g} N {one.energy_j + 0.0:+9.3g} J"
        )
        rows.append(f"{'':>24}[dim]by {escape(others[:50])}[/]")
    return _listed("  contacts", header, rows, len(contacts), "lighter contact", per_row=2)


def _listed(
    title: str, header: str, rows: list[str], count: int, thing: str, *, per_row: int = 1
) -> list[str]:
    more, indent = count - len(rows) // per_row, " " * TITLE
    lines = [f"{title:<{TITLE}}[dim]{header}[/]", *(indent + row for row in rows)]
    return [*lines, f"{indent}and {counted(more, thing)}"] if more else lines
