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
    finding,
    listed,
    millimetres,
    note,
    print_json,
    print_lines,
    titled,
)
from pipeline.console.output import width as columns
from pipeline.console.show_record import ENDED

if TYPE_CHECKING:
    from pipeline.analysis.script.results import (
        BodyAnalysis,
        ScriptAnalysis,
        ScriptFlight,
    )

MOST_BODIES, MOST_ROWS, MOST_OF_A_CODE = 12, 6, 3
"""Bodies, flights, contacts and findings of one code that are told; all are in the JSON."""
TITLE = 12
"""Columns that a title takes."""
WIDE = 56
"""Columns of a flight that is taken apart, with the unit in every row."""
LONGEST_NAME, PAIR = 8, 66
"""Characters that a name may have at the end of a row, and in a row of its own."""


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
        print_lines(*analysis_lines(analysis))


def analysis_lines(analysis: ScriptAnalysis) -> list[str]:
    """Tell what the bodies of a script did."""
    origin, explained = analysis.origin, analysis.explained
    ended = ENDED.get(str(origin["ended"]), "never finished")
    shown, there = len(analysis.bodies), len(analysis.by_body)
    bodies = _bodies(there) if shown == there else f"{shown} of {_bodies(there)}"
    lines = [f"[bold]{escape(str(origin['script']))}[/] {ended}, {bodies}"]
    if explained["of"]:
        whole = explained["samples"] == explained["of"]
        words = "all" if whole else f"{explained['samples']:,} of"
        whose = "bodies without joints" if shown == there else analysis.bodies[0].label
        words += f" {explained['of']:,} samples of {whose}, step by step"
        lines += _titled("Explained", words)
    moving = [one for one in analysis.bodies if one.segments["still"] < sum(one.segments.values())]
    still = [one.label for one in analysis.bodies if one not in moving]
    lines += ["", *_table_of_bodies(moving)]
    if still:
        dots = " …" if len(still) > MOST_BODIES else ""
        lines += _titled("Still", ", ".join(still[:MOST_BODIES]) + dots)
    if len(moving) == 1:
        lines += _taken_apart(moving[0].flights)
    else:
        lines += _flights(moving)
    lines += _contacts(moving)
    if analysis.findings:
        lines.append("")
    told: Counter[str] = Counter()
    for one in analysis.findings:
        told[one.code] += 1
        if told[one.code] <= MOST_OF_A_CODE:
            lines += finding(one.code, one.message, column=TITLE)
    for code, count in told.items():
        if count > MOST_OF_A_CODE:
            lines += _titled("", f"{code}: {count - MOST_OF_A_CODE} more, see --json")
    return lines


def _titled(title: str, words: str) -> list[str]:
    return titled(title, words, column=TITLE, style="bold")


def _bodies(number: int) -> str:
    return counted(number, "body", "bodies")


def _table_of_bodies(bodies: list[BodyAnalysis]) -> list[str]:
    """Return a line per body that moves: its mass, its samples, its energy; what is unexplained."""
    lines = []
    shown = bodies[:MOST_BODIES]
    width = max((len(one.label) for one in shown), default=0) + 2
    for body in shown:
        links = "" if len(body.links) == 1 else f", {counted(len(body.links) - 1, 'link')}"
        counts = ", ".join(f"{count:,} {name}" for name, count in body.segments.items() if count)
        facts = f"{body.mass_kg:.4g} kg{links}: {counts}"
        if body.energy is not None:
            first_j, last_j = (0.0 + j for j in (body.energy.first_j, body.energy.last_j))
            facts += f"; {first_j:.4g} → {last_j:.4g} J"
        lines += titled(body.label, facts, column=min(width, 30), style="bold")
        for one in body.unexplained:
            words = f"{counted(one.samples, 'sample')} from step {one.first_step} on: {one.reason}"
            lines += titled("", f"unexplained: {words}", column=min(width, 30))
    more = len(bodies) - len(shown)
    return [*lines, f"and {_bodies(more)} more: see --json, or --body"] if more > 0 else lines


def _flights(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the longest flights of all, a row each: what each is off free fall at its end."""
    flights = [(body, flight) for body in bodies for flight in body.flights]
    if not flights:
        return []
    longest = sorted(flights, key=lambda one: one[1].first_step - one[1].last_step)[:MOST_ROWS]
    longest.sort(key=lambda one: (one[1].first_step, one[0].id))
    width = max(len(body.label) for body, _ in longest)
    header = (f"{'from':>9} {'to':>9}  ", f"{'x off':>12} {'y off':>12} {'z off':>12}")
    rows = [
        (
            f"{flight.start_s:7.4f} s {flight.end_s:7.4f} s  ",
            " ".join(f"{round(m * 1e3, 4) + 0.0:+9.4f} mm" for m in flight.error_m)
            + (f"  {body.label}" if width <= LONGEST_NAME else f"  {body.id}"),
        )
        for body, flight in longest
    ]
    more = f"and {counted(len(flights) - len(rows), 'shorter flight')}; their terms: --body"
    return _listed("Flights", header, rows, more if len(flights) > len(rows) else None)


def _taken_apart(flights: list[ScriptFlight]) -> list[str]:
    """Return the longest flights, a table each: the error at some times, and its terms."""
    longest = sorted(flights, key=lambda one: one.first_step - one.last_step)[:MOST_ROWS]
    lines = []
    for flight in sorted(longest, key=lambda one: one.first_step):
        ends = Moment(flight.last_step, flight.end_s, flight.error_m, flight.terms_m)
        words = f"from {flight.start_s:.4f} s to {flight.end_s:.4f} s, off free fall by"
        lines += ["", *_titled("Flight", words)]
        for moment in dict.fromkeys((*flight.at, ends)):
            at = f"at {moment.time_s:.4g} s"
            unit, gap = (" [mm]", " ") if columns() < WIDE else ("", "    ")
            axes = gap.join(f"{axis + unit:>10}" for axis in "xyz")
            lines.append(f"[dim]{escape(f'  {at:<{TITLE}} {axes}')}[/]")
            terms = {} if moment.terms_m is None else asdict(moment.terms_m)
            for name, values_m in terms.items():
                lines.append(f"  {name:<{TITLE}} {_row(values_m)}")
            if not terms:
                lines.append("  not broken down: a velocity is limited, or gravity is not along z")
            lines.append(f"  {'total':<{TITLE}} [bold]{_row(moment.error_m)}[/]")
    more = len(flights) - len(longest)
    return [*lines, f"  and {counted(more, 'shorter flight')}"] if more else lines


def _row(values_m: Vector) -> str:
    return " ".join(map(_length, values_m))


def _length(value_m: float) -> str:
    """Return a length in mm; on a narrow terminal the heading has the unit."""
    text = millimetres(value_m)
    return text.removesuffix(" mm") if columns() < WIDE else text


def _contacts(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the contacts with the greatest impulses, a row each: what they gave."""
    contacts = [(body, contact) for body in bodies for contact in body.contacts]
    if not contacts:
        return []
    greatest = sorted(contacts, key=lambda one: -math.hypot(*one[1].impulse_n_s))[:MOST_ROWS]
    header = (f"{'from':>9} {'to':>9}  ", f"{'impulse':>12} {'at most':>12} {'energy':>12}")
    rows = []
    for body, one in sorted(greatest, key=lambda pair: (pair[1].first_step, pair[0].id)):
        others = ", ".join(dict.fromkeys(pusher.body for pusher in one.by))
        pair = f"{body.label} on {others}" if len(bodies) > 1 else f"on {others}"
        when = f"{one.start_s:7.4f} s {one.end_s:7.4f} s  "
        gave = (
            f"{math.hypot(*one.impulse_n_s):9.4g} Ns {one.largest_force_n:10.4g} N "
            f"{one.energy_j + 0.0:+10.3g} J"
        )
        most = min(PAIR, columns() - TITLE - 2)
        rows += [(when, gave), (pair if len(pair) <= most else f"{pair[: most - 2]} …", "")]
    more = f"and {counted(len(contacts) - len(greatest), 'lighter contact')}"
    return _listed("Contacts", header, rows, more if len(contacts) > len(greatest) else None)


def _listed(
    title: str, header: tuple[str, str], rows: list[tuple[str, str]], more: str | None
) -> list[str]:
    lines = ["", *listed(title, [header, *rows], column=TITLE)]
    return lines if more is None else [*lines, " " * TITLE + more]
