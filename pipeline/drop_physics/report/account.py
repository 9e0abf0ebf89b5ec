"""The account in a report: a line per row, and below it the terms for and against."""

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
"""Number of rows shown beside findings, and without findings."""
NEGLIGIBLE = 0.01
"""Rows below this salience appear only in the JSON, for example drives on their targets."""
SHOWN_TERMS = 2
"""Number of terms shown on each side, for and against."""
COLUMN = 8
"""Width of the column that shows a row's kind."""
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
"""Display names of the kinds of rows."""


def rows_beside(rows: Sequence[AccountRow], findings: Sequence[Finding]) -> list[AccountRow]:
    """Return the account's rows worth reading, without those that a displayed finding covers."""
    told = [finding.row for finding in findings if finding.row is not None]
    return [
        row for row in rows if row.salience >= NEGLIGIBLE and not any(row is each for each in told)
    ]


def account_of(rows: Sequence[AccountRow], most: int) -> list[Section]:
    """Return the account as a block, with at most `most` rows; empty if there are none."""
    if not rows:
        return []
    facts = [fact for row in rows[:most] for fact in facts_of(row)]
    blocks: list[Facts | Words] = [Facts(facts, COLUMN)]
    if len(rows) > most:
        more = Message("{rows} more rows: --account {all}", rows=len(rows) - most, all=len(rows))
        blocks.append(Words(more, "dim"))
    return [Section(blocks)]


def facts_of(row: AccountRow) -> list[Fact]:
    """Describe a row: what was requested and reached, and the terms for and against."""
    told = joined("  ", [who_of(row), row.told])
    facts = [Fact(WORDS[row.kind], told, "bold", at_s=row.time_s)]
    if row.terms:
        facts.append(Fact("", joined("", ["  ", sides_of(row.terms)])))
    return facts


def who_of(row: AccountRow) -> str:
    """Return the name of a row's subject, with the number of similar ones it represents."""
    if row.alike and (row.subject is None or not row.subject.node_of):
        return Message("{who} and {alike} more", who=row.who, alike=row.alike)
    return row.who


def sides_of(terms: Sequence[RowTerm], mean: str = "") -> Message:
    """Describe a row's terms in one line: towards the target, and against it.

    `mean` describes the steps over which they are averaged.
    """
    sides = _sides(terms)
    return Message("{sides}, {mean}", sides=sides, mean=mean) if mean else sides


def _sides(terms: Sequence[RowTerm]) -> Message:
    towards = _terms([term for term in terms if term.towards])
    against = _terms([term for term in terms if not term.towards])
    gave = terms[0].unit == "J"
    if not towards:
        return Message("against {against}", against=against)
    template = Message("by {towards}") if gave else Message("towards {towards}")
    told = Message(template, towards=towards)
    return told + Message("   against {against}", against=against) if against else told


def _terms(terms: Sequence[RowTerm]) -> str:
    """Format the terms of one side, with the unit after the last."""
    shown = [
        Message("{cause} {value}", cause=term.words, value=number(term.value, "+"))
        for term in terms[:SHOWN_TERMS]
    ]
    return Message("{terms} {unit}", terms=joined(", ", shown), unit=terms[0].unit) if shown else ""
