"""The report of flights, contacts and momentum: the largest ones of all bodies, a row each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np

from drop_physics.explain.cause_names import cause_in_words
from drop_physics.fields import counted
from drop_physics.messages import Message, joined
from drop_physics.quantities import rounded_off
from drop_physics.report.blocks import Block, Column, DataTable, Section, Words, numbers
from drop_physics.report.words import CONTACTS, TERMS, millimetres

if TYPE_CHECKING:
    from drop_physics.analysis.results import BodyAnalysis, BodyFlight, Pusher
    from drop_physics.arrays import Vector
    from drop_physics.explain.decomposition import VectorTerms

MOST_ROWS = 6
"""Most flights and contacts listed; the JSON contains all."""
LONGEST_NAME, LEAST_NAME = 30, 10
"""Width of a name in a row, and the least width to which it may be truncated."""
MOST_FALLS = 3
"""Most bodies whose first flight is broken down without --verbose."""
LEAST_FALL_M = 1e-4
"""Least deviation from free fall at which a first flight is shown unasked [m]."""
TWICE = 2.0
"""Multiple of the rounding error up to which another number is rounding error, too."""
MOST_BODIES = 3
"""Most bodies whose momentum is shown; the JSON contains all."""


def falls(bodies: Sequence[BodyAnalysis]) -> Iterator[Section]:
    """Yield the position error of the first flight of bodies that start in the air."""
    begun = [flight for body in bodies for flight in _begins_in_the_air(body)][:MOST_FALLS]
    if not begun:
        return
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
    terms = [
        replace(
            numbers(TERMS[name], [millimetres(each[name]) for each in parts_m]),
            drop=2 if name == "interaction" else 0,
        )
        for name in shown
    ]
    at = replace(numbers(Message("at"), times), drop=1)
    yield _titled(Message("Off free fall [mm]"), _names(names), at, *terms)


def _begins_in_the_air(body: BodyAnalysis) -> Iterator[tuple[str, float, Vector, VectorTerms]]:
    """Yield the sample at 0.3 s of a body's first flight, or at its end if shorter."""
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


def flights(bodies: Sequence[BodyAnalysis]) -> Iterator[Section]:
    """Yield the position errors at the ends of the longest flights."""
    all_of_them = [(body, flight) for body in bodies for flight in body.flights]
    if not all_of_them:
        return
    longest = sorted(all_of_them, key=lambda pair: pair[1].first_step - pair[1].last_step)
    longest = sorted(longest[:MOST_ROWS], key=lambda pair: (pair[1].first_step, pair[0].id))
    more = _more(len(all_of_them) - len(longest), "shorter flight")
    if len(bodies) == 1:
        broken_down = [_terms(flight) for _, flight in longest]
        yield from broken_down[:-1]
        yield Section([*broken_down[-1].blocks, *more])
        return
    yield _titled(
        Message("Flights, off free fall at their end"),
        *_span([(flight.start_s, flight.end_s) for _, flight in longest], drop=1),
        *_axes([flight.error_m for _, flight in longest]),
        _names(body.label for body, _ in longest),
        more=more,
    )


def _terms(flight: BodyFlight) -> Section:
    """Return a flight's errors at several times, with their terms."""
    title = Message(
        "Flight from {start:.4f} s to {end:.4f} s, off free fall by",
        start=flight.start_s,
        end=flight.end_s,
    )
    blocks: list[Block] = [Words(title, "bold")]
    moments = [
        (each.time_s, each.error_m, each.terms_m)
        for each in flight.at
        if each.step != flight.last_step
    ]
    for time_s, error_m, terms_m in [*moments, (flight.end_s, flight.error_m, flight.terms_m)]:
        terms = {} if terms_m is None else asdict(terms_m)
        rows = {**terms, "total": error_m}
        if terms:  # no number is told that is not larger than its own rounding
            rows = {
                name: _beyond(values, terms["rounding"]) if name != "rounding" else values
                for name, values in rows.items()
            }
        head = Message("at {time:.4g} s", time=time_s)
        blocks.append(
            DataTable([Column(head, [TERMS[name] for name in rows]), *_axes([*rows.values()])])
        )
        if not terms:
            why = Message("not broken down: a velocity is limited, or gravity is not along z")
            blocks.append(Words(why))
    return Section(blocks)


def _beyond(values: Vector, rounding: Vector) -> Vector:
    """Return the numbers of three axes, with 0 for those that are no larger than the rounding."""
    x, y, z = (
        value if abs(value) > TWICE * abs(round_) else 0.0
        for value, round_ in zip(values, rounding, strict=True)
    )
    return x, y, z


def contacts(bodies: Sequence[BodyAnalysis]) -> Iterator[Section]:
    """Yield the contacts with the largest impulses, a row each."""
    all_of_them = [(body, contact) for body in bodies for contact in body.contacts]
    if not all_of_them:
        return
    greatest = sorted(all_of_them, key=lambda pair: -math.hypot(*pair[1].impulse_n_s))[:MOST_ROWS]
    greatest.sort(key=lambda pair: (pair[1].first_step, pair[0].id))
    pairs = []
    for body, contact in greatest:
        others = ", ".join(dict.fromkeys(pusher.body for pusher in contact.by))
        pair = Message("{body} on {others}", body=body.label, others=others)
        if len(bodies) == 1:
            pair = Message("on {others}", others=others)
        pairs.append(pair)
    its = [contact for _, contact in greatest]
    yield _titled(
        CONTACTS,
        *_span([(each.start_s, each.end_s) for each in its]),
        numbers("N s", [f"{math.hypot(*each.impulse_n_s):.4g}" for each in its]),
        numbers(Message("N at most"), [f"{each.largest_force_n:.4g}" for each in its], drop=1),
        numbers("J", [f"{each.energy_j + 0.0:+.3g}" for each in its]),
        _names(pairs),
        more=_more(len(all_of_them) - len(greatest), "lighter contact"),
    )


def momentum(bodies: Sequence[BodyAnalysis]) -> Iterator[Section]:
    """Yield the momentum of the first bodies: at start and end, and its changes by cause."""
    for body in [body for body in bodies if body.momentum is not None][:MOST_BODIES]:
        assert body.momentum is not None
        rows = {
            Message("at the start"): body.momentum.start_kg_m_s,
            **{
                cause_in_words(name): each
                for name, each in body.momentum.by_cause_kg_m_s.items()
                if any(each)
            },
            Message("at the end"): body.momentum.end_kg_m_s,
        }
        largest = float(np.abs([*rows.values()]).max())
        each_axis = [
            numbers(axis, [f"{rounded_off(value, largest) + 0.0:+.4g}" for value in values])
            for axis, values in zip("xyz", zip(*rows.values(), strict=True), strict=True)
        ]
        title = Message("Momentum of {body} [kg m/s]", body=body.label)
        given: dict[tuple[int, int], list[Pusher]] = {}
        for pusher in (each for contact in body.contacts for each in contact.by):
            given.setdefault((pusher.id, pusher.link), []).append(pusher)
        by = []
        for _, each in sorted(given.items()):
            x, y, z = np.sum([one.impulse_n_s for one in each], axis=0).tolist()
            by.append(replace(each[0], impulse_n_s=(x, y, z)))
        more = [Words(contact_by(by), indent="  ")] if by else []
        yield _titled(title, Column("", [*rows]), *each_axis, more=more)


def contact_by(pushers: Sequence[Pusher]) -> Message:
    """List the impulses in a contact by the body that exerts them."""
    gave = [
        Message(
            "{body} {impulse}",
            body=each.body if each.link < 0 else f"{each.body}:{each.link}",
            impulse=_components(each.impulse_n_s),
        )
        for each in pushers
    ]
    return Message("contact by {gave} N s", gave=joined(", ", gave))


def _components(vector: Vector) -> str:
    largest = max(map(abs, vector))
    return "(" + ", ".join(f"{rounded_off(part, largest) + 0.0:+.3g}" for part in vector) + ")"


def _titled(title: str, *columns: Column, more: Sequence[Words] = ()) -> Section:
    return Section([Words(title, "bold"), DataTable(columns), *more])


def _more(number: int, what: str) -> list[Words]:
    return [Words(Message("and {more}", more=counted(number, what)))] if number else []


def _span(ends_s: Sequence[tuple[float, float]], drop: int = 0) -> Iterator[Column]:
    """Yield the columns of start and end times; the end may be removed if room is short."""
    for head, values in zip(
        (Message("from"), Message("to")), zip(*ends_s, strict=True), strict=True
    ):
        yield numbers(head + " [s]", [f"{each:.4f}" for each in values], drop=drop * (head == "to"))


def _axes(errors_m: Sequence[Vector]) -> Iterator[Column]:
    for axis, values in zip("xyz", zip(*errors_m, strict=True), strict=True):
        yield numbers(f"{axis} [mm]", [*map(millimetres, values)])


def _names(names: Iterable[str]) -> Column:
    return Column("", [*names], most=LONGEST_NAME, shrinks_to=LEAST_NAME)
