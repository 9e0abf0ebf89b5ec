"""What the bodies of a script did: a line each, their flights and contacts, the findings."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.markup import escape

from drop_physics.analysis.script.results import Moment, Vector
from drop_physics.console.output import (
    columns_of,
    counted,
    cut,
    finding,
    left,
    listed,
    millimetres,
    right,
    titled,
)
from drop_physics.console.output import width as columns
from drop_physics.console.show_record import ENDED
from drop_physics.console.words import (
    CONTACTS,
    EXPLAINED,
    FLIGHTS,
    TERMS,
    errors_by_axis,
    kinds_of_samples,
    span,
)
from drop_physics.messages import Message, joined, localized, translated

if TYPE_CHECKING:
    from drop_physics.analysis.script.results import (
        BodyAnalysis,
        ScriptAnalysis,
        ScriptFlight,
    )

MOST_BODIES, MOST_ROWS, MOST_OF_A_CODE = 12, 6, 3
"""Bodies, flights, contacts and findings of one code that are listed; all are in the JSON."""
TITLE = 12
"""Columns that a title takes."""
WIDE = 56
"""Columns of a flight that is broken down, with the unit in every row."""
LONGEST_NAME, PAIR = 8, 66
"""Characters that a name may have at the end of a row, and in a row of its own."""


def lines_of_bodies(analysis: ScriptAnalysis) -> list[str]:
    """Tell what the bodies of a script did."""
    lines = [_headline(analysis)]
    if analysis.explained["of"]:
        lines += _titled(EXPLAINED, _explained(analysis))
    moving = [
        body for body in analysis.bodies if body.segments["still"] < sum(body.segments.values())
    ]
    soft = [body.label for body in analysis.bodies if body.soft]
    still = [body.label for body in analysis.bodies if body not in moving and not body.soft]
    lines += ["", *_table_of_bodies(moving)]
    if still:
        lines += _titled(Message("Still"), _first_of(still))
    if soft:
        words = Message("{bodies}: its motion is not recorded", bodies=_first_of(soft))
        lines += _titled(Message("Soft"), words)
    if len(moving) == 1:
        lines += _broken_down(moving[0].flights)
    else:
        lines += _flights(moving)
    lines += _contacts(moving)
    if analysis.findings:
        lines.append("")
    shown: Counter[str] = Counter()
    for each in analysis.findings:
        shown[each.code] += 1
        if shown[each.code] <= MOST_OF_A_CODE:
            lines += finding(each.code, each.message, column=TITLE)
    for code, count in shown.items():
        if count > MOST_OF_A_CODE:
            more = Message(
                "{code}: {more} more, see --json", code=code, more=count - MOST_OF_A_CODE
            )
            lines += _titled("", more)
    return lines


def _first_of(labels: list[str]) -> str:
    return ", ".join(labels[:MOST_BODIES]) + (" …" if len(labels) > MOST_BODIES else "")


def _headline(analysis: ScriptAnalysis) -> str:
    origin, shown, there = analysis.origin, len(analysis.bodies), len(analysis.by_body)
    ended = ENDED.get(str(origin["ended"]), Message("never finished"))
    bodies = _bodies(there)
    if shown != there:
        bodies = Message("{shown} of {bodies}", shown=shown, bodies=bodies)
    return localized(
        "[bold]{script}[/] {ended}, {bodies}",
        script=escape(str(origin["script"])),
        ended=ended,
        bodies=bodies,
    )


def _explained(analysis: ScriptAnalysis) -> Message:
    samples, of = analysis.explained["samples"], analysis.explained["of"]
    whose: str = Message("bodies without joints")
    if len(analysis.bodies) != len(analysis.by_body):
        whose = analysis.bodies[0].label
    if samples == of:
        return Message("all {of:,} samples of {whose}, step by step", of=of, whose=whose)
    return Message(
        "{samples:,} of {of:,} samples of {whose}, step by step",
        samples=samples,
        of=of,
        whose=whose,
    )


def _titled(title: str, words: str) -> list[str]:
    return titled(title, words, column=TITLE, style="bold")


def _bodies(number: int) -> Message:
    return counted(number, "body", "bodies")


def _table_of_bodies(bodies: list[BodyAnalysis]) -> list[str]:
    """Return a line per moving body: its mass, samples and energy; and what is unexplained."""
    lines = []
    shown = bodies[:MOST_BODIES]
    column = min(max((columns_of(body.label) for body in shown), default=0) + 2, 30)
    for body in shown:
        lines += titled(body.label, _facts(body), column=column, style="bold")
        for run in body.unexplained:
            words = Message(
                "unexplained: {samples} from step {step} on: {reason}",
                samples=counted(run.samples, "sample"),
                step=run.first_step,
                reason=run.reason,
            )
            lines += titled("", words, column=column)
    more = len(bodies) - len(shown)
    if more > 0:
        lines.append(localized("and {bodies} more: see --json, or --body", bodies=_bodies(more)))
    return lines


def _facts(body: BodyAnalysis) -> Message:
    mass: str = f"{body.mass_kg:.4g} kg"
    if len(body.links) > 1:
        mass = joined(", ", [mass, counted(len(body.links) - 1, "link")])
    facts = joined(": ", [mass, kinds_of_samples(body.segments)])
    if body.energy is None:
        return facts
    first_j, last_j = (0.0 + j for j in (body.energy.first_j, body.energy.last_j))
    return joined("; ", [facts, f"{first_j:.4g} → {last_j:.4g} J"])


def _flights(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the longest flights, a row each: how far off free fall each ends."""
    flights = [(body, flight) for body in bodies for flight in body.flights]
    if not flights:
        return []
    longest = sorted(flights, key=lambda pair: pair[1].first_step - pair[1].last_step)[:MOST_ROWS]
    longest.sort(key=lambda pair: (pair[1].first_step, pair[0].id))
    longest_label = max(columns_of(body.label) for body, _ in longest)
    header = (f"{span()}  ", errors_by_axis())
    rows = [
        (
            f"{flight.start_s:7.4f} s {flight.end_s:7.4f} s  ",
            " ".join(f"{round(m * 1e3, 4) + 0.0:+9.4f} mm" for m in flight.error_m)
            + (f"  {body.label}" if longest_label <= LONGEST_NAME else f"  {body.id}"),
        )
        for body, flight in longest
    ]
    more = None
    if len(flights) > len(rows):
        shorter = counted(len(flights) - len(rows), "shorter flight")
        more = localized("and {flights}; their terms: --body", flights=shorter)
    return _listed(FLIGHTS, header, rows, more)


def _broken_down(flights: list[ScriptFlight]) -> list[str]:
    """Return the longest flights, a table each: the error at some times, and its terms."""
    longest = sorted(flights, key=lambda flight: flight.first_step - flight.last_step)[:MOST_ROWS]
    lines = []
    for flight in sorted(longest, key=lambda flight: flight.first_step):
        ends = Moment(flight.last_step, flight.end_s, flight.error_m, flight.terms_m)
        words = Message(
            "from {start:.4f} s to {end:.4f} s, off free fall by",
            start=flight.start_s,
            end=flight.end_s,
        )
        lines += ["", *_titled(Message("Flight"), words)]
        for moment in dict.fromkeys((*flight.at, ends)):
            at = left(localized("at {time:.4g} s", time=moment.time_s), TITLE)
            unit, gap = (" [mm]", " ") if columns() < WIDE else ("", "    ")
            axes = gap.join(f"{axis + unit:>10}" for axis in "xyz")
            lines.append(f"[dim]{escape(f'  {at} {axes}')}[/]")
            terms = {} if moment.terms_m is None else asdict(moment.terms_m)
            for name, values_m in terms.items():
                lines.append(f"  {left(translated(TERMS[name]), TITLE)} {_row(values_m)}")
            if not terms:
                lines.append(
                    "  "
                    + localized("not broken down: a velocity is limited, or gravity is not along z")
                )
            total = left(translated(TERMS["total"]), TITLE)
            lines.append(f"  {total} [bold]{_row(moment.error_m)}[/]")
    more = len(flights) - len(longest)
    if more:
        lines.append("  " + localized("and {more}", more=counted(more, "shorter flight")))
    return lines


def _row(values_m: Vector) -> str:
    return " ".join(map(_length, values_m))


def _length(value_m: float) -> str:
    """Return a length in mm; on a narrow terminal the heading has the unit."""
    text = millimetres(value_m)
    return text.removesuffix(" mm") if columns() < WIDE else text


def _contacts(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the contacts with the greatest impulses, a row each."""
    contacts = [(body, contact) for body in bodies for contact in body.contacts]
    if not contacts:
        return []
    greatest = sorted(contacts, key=lambda pair: -math.hypot(*pair[1].impulse_n_s))[:MOST_ROWS]
    names = (localized("impulse"), localized("at most"), localized("energy"))
    header = (f"{span()}  ", " ".join(right(name, 12) for name in names))
    rows = []
    for body, contact in sorted(greatest, key=lambda pair: (pair[1].first_step, pair[0].id)):
        others = ", ".join(dict.fromkeys(pusher.body for pusher in contact.by))
        pair = localized("on {others}", others=others)
        if len(bodies) > 1:
            pair = localized("{body} on {others}", body=body.label, others=others)
        when = f"{contact.start_s:7.4f} s {contact.end_s:7.4f} s  "
        gave = (
            f"{math.hypot(*contact.impulse_n_s):9.4g} Ns {contact.largest_force_n:10.4g} N "
            f"{contact.energy_j + 0.0:+10.3g} J"
        )
        most = min(PAIR, columns() - TITLE - 2)
        rows += [
            (when, gave),
            (pair if columns_of(pair) <= most else f"{cut(pair, most - 2)} …", ""),
        ]
    more = None
    if len(contacts) > len(greatest):
        lighter = counted(len(contacts) - len(greatest), "lighter contact")
        more = localized("and {more}", more=lighter)
    return _listed(CONTACTS, header, rows, more)


def _listed(
    title: str, header: tuple[str, str], rows: list[tuple[str, str]], more: str | None
) -> list[str]:
    lines = ["", *listed(title, [header, *rows], column=TITLE)]
    return lines if more is None else [*lines, " " * TITLE + more]
