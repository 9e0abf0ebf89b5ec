"""The report of an account: a row each, with the terms towards and against below it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from drop_physics.messages import Message, joined
from drop_physics.quantities import number
from drop_physics.report.blocks import Fact, Facts, Section, Words

if TYPE_CHECKING:
    from drop_physics.account.rows import AccountRow, RowTerm
    from drop_physics.rules.answer import Finding

FEW, MANY = 6, 12
"""Rows that are shown beside findings, and without any."""
NEGLIGIBLE = 0.01
"""Rows below this salience are in the JSON only: drives on their targets."""
SHOWN_TERMS = 2
"""Terms of each side."""
COLUMN = 8
"""Width of the kinds."""
WORDS = {
    "asked": Message("asked"),
    "given": Message("given"),
    "moved": Message("moved"),
    "turned": Message("turned"),
    "held": Message("held"),
    "set": Message("set"),
    "press": Message("press"),
    "slips": Message("slips"),
    "energy": Message("energy"),
    "reads": Message("reads"),
    "idle": Message("idle"),
}
"""The kinds of rows as readers see them."""


def rows_beside(rows: Sequence[AccountRow], findings: Sequence[Finding]) -> list[AccountRow]:
    """Return the rows worth reading beside findings, which take the place of theirs."""
    told = [finding.row for finding in findings if finding.row is not None]
    return [
        row for row in rows if row.salience >= NEGLIGIBLE and not any(row is each for each in told)
    ]


def account_of(rows: Sequence[AccountRow], most: int) -> list[Section]:
    """Return the account, at most so many rows; empty if there is none."""
    if not rows:
        return []
    facts = [fact for row in rows[:most] for fact in facts_of(row)]
    blocks: list[Facts | Words] = [Facts(facts, COLUMN)]
    if len(rows) > most:
        more = Message("{rows} more rows: --account {all}", rows=len(rows) - most, all=len(rows))
        blocks.append(Words(more, "dim"))
    return [Section(blocks)]


def facts_of(row: AccountRow) -> list[Fact]:
    """Return a row as facts: what was asked and came, and the terms for and against it."""
    told = joined("  ", [who_of(row), row.told])
    facts = [Fact(WORDS[row.kind], told, "bold", at_s=row.time_s)]
    if row.terms:
        facts.append(Fact("", joined("", ["  ", sides_of(row.terms)])))
    return facts


def who_of(row: AccountRow) -> str:
    """Return the subject of a row, and the number of further subjects that it stands for."""
    if row.alike:
        return Message("{who} and {alike} more", who=row.who, alike=row.alike)
    return row.who


def sides_of(terms: Sequence[RowTerm]) -> Message:
    """Return the terms of a row as one line: those towards the target, and those against."""
    towards = _terms([term for term in terms if term.towards])
    against = _terms([term for term in terms if not term.towards])
    if terms[0].unit == "J":
        return Message("by {towards}   against {against}", towards=towards, against=against)
    return Message("towards {towards}   against {against}", towards=towards, against=against)


def _terms(terms: Sequence[RowTerm]) -> str:
    """Return the terms of one side, the unit behind the last."""
    shown = [
        Message("{cause} {value}", cause=term.words, value=number(term.value, "+"))
        for term in terms[:SHOWN_TERMS]
    ]
    return (
        Message("{terms} {unit}", terms=joined(", ", shown), unit=terms[0].unit) if shown else "–"
    )
