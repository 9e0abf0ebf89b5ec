"""The flights and contacts of a script's bodies: the longest and greatest, a row each."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.markup import escape

from drop_physics.console.output import (
    columns_of,
    counted,
    cut,
    left,
    listed,
    millimetres,
    right,
    titled,
)
from drop_physics.console.output import width as columns
from drop_physics.console.words import CONTACTS, FLIGHTS, TERMS, errors_by_axis, span
from drop_physics.messages import Message, localized, translated

if TYPE_CHECKING:
    from drop_physics.analysis.results import BodyAnalysis, BodyFlight, Vector

MOST_ROWS = 6
"""Flights and contacts that are listed; all are in the JSON."""
TITLE = 12
"""Columns that a title takes."""
WIDE = 56
"""Columns of a flight that is broken down, with the unit in every row."""
LONGEST_NAME, PAIR = 8, 66
"""Characters that a name may have at the end of a row, and in a row of its own."""


def flight_lines(bodies: list[BodyAnalysis]) -> list[str]:
    """Tell the flights: of one body broken down, of several a row each."""
    return _broken_down(bodies[0].flights) if len(bodies) == 1 else _flights(bodies)


def _flights(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the longest flights, a row each: how far off free fall each ends."""
    flights = [(body, flight) for body in bodies for flight in body.flights]
    if not flights:
        return []
    longest = sorted(flights, key=lambda pair: pair[1].first_step - pair[1].last_step)[:MOST_ROWS]
    longest.sort(key=lambda pair: (pair[1].first_step, pair[0].id))
    several = len({body.id for body, _ in flights}) > 1
    longest_label = max(columns_of(body.label) for body, _ in longest)
    header = (f"{span()}  ", errors_by_axis())
    rows = [
        (
            f"{flight.start_s:7.4f} s {flight.end_s:7.4f} s  ",
            " ".join(f"{round(m * 1e3, 4) + 0.0:+9.4f} mm" for m in flight.error_m)
            + (
                ""
                if not several
                else f"  {body.label}"
                if longest_label <= LONGEST_NAME
                else f"  {body.id}"
            ),
        )
        for body, flight in longest
    ]
    more = None
    if len(flights) > len(rows):
        shorter = counted(len(flights) - len(rows), "shorter flight")
        more = localized("and {more}", more=shorter)
        if several:
            more = localized("and {flights}; their terms: --body", flights=shorter)
    return _listed(FLIGHTS, header, rows, more)


def _broken_down(flights: list[BodyFlight]) -> list[str]:
    """Return the longest flights, a table each: the error at some times, and its terms."""
    from drop_physics.analysis.results import Moment

    longest = sorted(flights, key=lambda flight: flight.first_step - flight.last_step)[:MOST_ROWS]
    lines = []
    for flight in sorted(longest, key=lambda flight: flight.first_step):
        moments = {each.step: each for each in flight.at}
        moments[flight.last_step] = Moment(
            flight.last_step, flight.end_s, flight.error_m, flight.terms_m
        )
        words = Message(
            "from {start:.4f} s to {end:.4f} s, off free fall by",
            start=flight.start_s,
            end=flight.end_s,
        )
        lines += ["", *titled(Message("Flight"), words, column=TITLE, style="bold")]
        for moment in moments.values():
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


def contact_lines(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the contacts with the greatest impulses, a row each."""
    contacts = [(body, contact) for body in bodies for contact in body.contacts]
    if not contacts:
        return []
    greatest = sorted(contacts, key=lambda pair: -math.hypot(*pair[1].impulse_n_s))[:MOST_ROWS]
    names = (localized("impulse"), localized("at most"), localized("energy"))
    header = (f"{span()}  ", " ".join(right(name, 12) for name in names))
    rows = []
    several = len({(body.id, *(pusher.id for pusher in contact.by))
        for body, contact in contacts}) > 1  # fmt: skip
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
        rows.append((when, gave))
        if several:
            rows.append((pair if columns_of(pair) <= most else f"{cut(pair, most - 2)} …", ""))
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
