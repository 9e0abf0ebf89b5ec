"""The flights and contacts of bodies: the longest and greatest, a row each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.markup import escape

from drop_physics.console.output import Column, counted, cut, millimetres, table, wrapped
from drop_physics.console.output import width as columns
from drop_physics.console.words import CONTACTS, TERMS
from drop_physics.messages import Message, localized, translated

if TYPE_CHECKING:
    from drop_physics.analysis.results import BodyAnalysis, BodyFlight, Vector
    from drop_physics.explain.decomposition import VectorTerms

MOST_ROWS = 6
"""Flights and contacts that are listed; all are in the JSON."""
LONGEST_NAME, LEAST_NAME, NUMBERS = 30, 10, 50
"""Characters of a name in a row, and columns of the numbers before it; where there is no room for
the least of it, one of these is left out."""
MOST_FALLS = 3
"""Bodies whose first flight is broken down without --verbose."""
LEAST_FALL_M = 1e-4
"""Distance from free fall [m] of a first flight worth a line that nobody asked for."""


def fall_lines(bodies: list[BodyAnalysis]) -> list[str]:
    """Break down how far off free fall those bodies are that begin in the air."""
    begun = [flight for body in bodies for flight in _begins_in_the_air(body)][:MOST_FALLS]
    if not begun:
        return []
    lines = ["", *_heading(Message("Off free fall [mm]"))]
    cells: list[tuple[str, str, dict[str, float]]] = []
    for label, time_s, error_m, terms_m in begun:
        parts = {**asdict(terms_m), "total": error_m}
        cells += [
            (f"{label} {axis}", f"{time_s:.4g} s", {name: m[row] for name, m in parts.items()})
            for row, axis in enumerate("xyz")
            if abs(error_m[row]) >= LEAST_FALL_M
        ]
    names, times, parts_m = zip(*cells, strict=True)
    # Rounding moves no digit that is shown.
    shown = [name for name in parts_m[0] if name != "rounding"]
    rows: list[Column] = [
        ("", [*map(_name, names)], False),
        (Message("at"), times, True),
        *((TERMS[name], [_mm(each[name]) for each in parts_m], True) for name in shown),
    ]
    return lines + table(rows)


def _begins_in_the_air(body: BodyAnalysis) -> Iterator[tuple[str, float, Vector, VectorTerms]]:
    """Yield where the first flight of a body is at 0.3 s, or at its end if that comes first."""
    if not body.flights:
        return
    first = body.flights[0]
    if body.contacts and body.contacts[0].first_step <= first.first_step:
        return
    moment = next((each for each in first.at if each.step > first.first_step), None)
    time_s, error_m, terms_m = (
        (moment.time_s, moment.error_m, moment.terms_m)
        if moment
        else (first.end_s, first.error_m, first.terms_m)
    )
    if terms_m is not None and max(map(abs, error_m)) >= LEAST_FALL_M:
        yield body.label, time_s, error_m, terms_m


def flight_lines(bodies: list[BodyAnalysis]) -> list[str]:
    """Tell how far off free fall the longest flights end; of one body also their terms."""
    flights = [(body, flight) for body in bodies for flight in body.flights]
    if not flights:
        return []
    longest = sorted(flights, key=lambda pair: pair[1].first_step - pair[1].last_step)[:MOST_ROWS]
    longest.sort(key=lambda pair: (pair[1].first_step, pair[0].id))
    if len(bodies) == 1:
        lines = [line for _, flight in longest for line in _terms(flight)]
    else:
        start, end = _span([(flight.start_s, flight.end_s) for _, flight in longest])
        names = ("", [_name(body.label) for body, _ in longest], False)
        errors = _axes([flight.error_m for _, flight in longest])
        rows = [start, *([] if _is_narrow() else [end]), *errors, names]
        lines = ["", *_heading(Message("Flights, off free fall at their end")), *table(rows)]
    more = len(flights) - len(longest)
    return lines + _more(counted(more, "shorter flight") if more else None)


def _terms(flight: BodyFlight) -> list[str]:
    """Return how far off free fall a flight is at some times, and why."""
    words = Message(
        "Flight from {start:.4f} s to {end:.4f} s, off free fall by",
        start=flight.start_s,
        end=flight.end_s,
    )
    lines = ["", *_heading(words)]
    moments = [
        (each.time_s, each.error_m, each.terms_m)
        for each in flight.at
        if each.step != flight.last_step
    ]
    for time_s, error_m, terms_m in [*moments, (flight.end_s, flight.error_m, flight.terms_m)]:
        terms = {} if terms_m is None else asdict(terms_m)
        rows = {**terms, "total": error_m}
        names = [translated(TERMS[name]) for name in rows]
        lines += table(
            [(Message("at {time:.4g} s", time=time_s), names, False), *_axes([*rows.values()])]
        )
        if not terms:
            why = localized("not broken down: a velocity is limited, or gravity is not along z")
            lines += map(escape, wrapped(why, columns()))
    return lines


def contact_lines(bodies: list[BodyAnalysis]) -> list[str]:
    """Return the contacts with the greatest impulses, a row each."""
    contacts = [(body, contact) for body in bodies for contact in body.contacts]
    if not contacts:
        return []
    greatest = sorted(contacts, key=lambda pair: -math.hypot(*pair[1].impulse_n_s))[:MOST_ROWS]
    greatest.sort(key=lambda pair: (pair[1].first_step, pair[0].id))
    pairs = []
    for body, contact in greatest:
        others = ", ".join(dict.fromkeys(pusher.body for pusher in contact.by))
        pair = Message("{body} on {others}", body=body.label, others=others)
        if len(bodies) == 1:
            pair = Message("on {others}", others=others)
        pairs.append(_name(translated(pair)))
    its = [contact for _, contact in greatest]
    most = (Message("N at most"), [f"{each.largest_force_n:.4g}" for each in its], True)
    rows: list[Column] = [
        *_span([(each.start_s, each.end_s) for each in its]),
        ("N s", [f"{math.hypot(*each.impulse_n_s):.4g}" for each in its], True),
        *([] if _is_narrow() else [most]),
        ("J", [f"{each.energy_j + 0.0:+.3g}" for each in its], True),
        ("", pairs, False),
    ]
    more = len(contacts) - len(greatest)
    return [
        "",
        *_heading(CONTACTS),
        *table(rows),
        *_more(counted(more, "lighter contact") if more else None),
    ]


def _heading(words: str) -> list[str]:
    return [f"[bold]{escape(line)}[/]" for line in wrapped(translated(words), columns())]


def _more(what: Message | None) -> list[str]:
    return [] if what is None else [localized("and {more}", more=what)]


def _span(ends_s: list[tuple[float, float]]) -> list[Column]:
    heads = Message("from"), Message("to")
    return [
        (f"{translated(head)} [s]", [f"{each:.4f}" for each in values], True)
        for head, values in zip(heads, zip(*ends_s, strict=True), strict=True)
    ]


def _axes(errors_m: list[Vector]) -> list[Column]:
    return [
        (f"{axis} [mm]", [_mm(m) for m in values], True)
        for axis, values in zip("xyz", zip(*errors_m, strict=True), strict=True)
    ]


def _mm(value_m: float) -> str:
    return millimetres(value_m).removesuffix(" mm").strip()


def _is_narrow() -> bool:
    return columns() < NUMBERS + LEAST_NAME


def _name(text: str) -> str:
    """Cut a name at the end of a row to what there is room for."""
    return cut(text, min(LONGEST_NAME, max(LEAST_NAME, columns() - NUMBERS))).rstrip()
