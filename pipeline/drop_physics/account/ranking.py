"""Sorts an account's rows by one measure, salience, and merges similar rows."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import PurePath

from drop_physics.account.rows import AccountRow

MOST = 2.5
"""The maximum salience; above 1 it grows only logarithmically."""
READ = 1.3
"""Factor for the rows of a body that the script reads, if it does not read all bodies."""
REPEATED = 0.05
"""Factor for a body's energy row if a row about its motion already lists the same causes."""
RAISED = 0.9
"""Share of a moving body's salience that the joints driving it inherit, in proportion to their
energy."""


def ranked(
    rows: Iterable[AccountRow], read: Collection[int], about: str | None = None
) -> list[AccountRow]:
    """Sort rows by salience; merge similar rows into one, with the number of rows merged.

    `read` has the ids of the bodies whose state the script reads; empty if it reads all or none.
    `about` names a body or a joint whose rows come first.
    """
    weighed = [replace(row, salience=_salience(row, read)) for row in rows]
    weighed = [*_repeating(_raised(weighed))]
    weighed.sort(key=lambda row: (not is_about(row, about), -row.salience))
    first: dict[Hashable, list[int]] = defaultdict(list)
    found: list[AccountRow] = []
    for row in weighed:
        node_of = None if row.subject is None else row.subject.node_of
        key = None if row.group is None else (row.kind, node_of or row.group)
        places = [] if key is None else first[key]
        place = next((each for each in places if _agree(found[each], row)), None)
        if place is not None:
            stands = found[place]
            joints = (row.joint,) if row.joint and row.body == stands.body else ()
            found[place] = replace(stands, alike=stands.alike + 1, joints=(*stands.joints, *joints))
            continue
        places.append(len(found))
        found.append(row)
    return found


def _agree(row: AccountRow, other: AccountRow) -> bool:
    """Return whether no cause acts only towards in one row, and only against in the other."""
    ours, theirs = ({(term.cause, term.towards) for term in each.terms} for each in (row, other))
    return all(
        (cause, side) in theirs or (cause, not side) in ours or (cause, not side) not in theirs
        for cause, side in ours
    )


def is_about(row: AccountRow, about: str | None) -> bool:
    """Return whether a row is about a body, a link or a joint, or about contact with it."""
    if about is None:
        return False
    names = {row.body, row.joint, row.link, row.actuator, row.constraint, *(row.pair or ())}
    if (body := row.subject) is not None:
        names |= {body.short, body.name, PurePath(body.name).stem}
    return about in names


def _raised(rows: Sequence[AccountRow]) -> Iterator[AccountRow]:
    """Yield rows; joints that drive a moving robot gain salience by their share of the energy."""
    moves: dict[str | None, float] = {}
    gave_j: dict[str | None, float] = {}
    for row in rows:
        if row.kind in ("moved", "turned") and row.joint is None:
            moves[row.body] = max(moves.get(row.body, 0.0), row.salience)
        gave_j[row.body] = gave_j.get(row.body, 0.0) + row.gives_j
    for row in rows:
        raised = moves.get(row.body, 0.0) * RAISED if row.gives_j else 0.0
        share = row.gives_j / gave_j[row.body] if raised else 0.0
        yield replace(row, salience=max(row.salience, raised * share))


def _repeating(rows: Iterable[AccountRow]) -> Iterator[AccountRow]:
    """Yield rows; energy rows that repeat the causes of a row about motion lose salience."""
    every = [*rows]
    told: dict[str | None, set[tuple[str, str | None]]] = {}
    for row in every:
        if row.kind in ("moved", "turned") and row.joint is None:
            told.setdefault(row.body, set()).update((each.cause, each.body) for each in row.terms)
    for row in every:
        causes = {(each.cause, each.body) for each in row.terms}
        again = row.kind == "energy" and causes and causes <= told.get(row.body, set())
        yield replace(row, salience=row.salience * REPEATED) if again else row


def _salience(row: AccountRow, read: Collection[int]) -> float:
    value = row.salience if math.isfinite(row.salience) else 3.0
    value = max(value, 1e-3)
    if value > 1:
        value = min(1 + math.log10(value) / 2, MOST)
    if row.subject is not None and row.subject.number in read:
        value *= READ
    return value
