"""Finds the account row with the same content as a finding, so that the finding can cite it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from drop_physics.account.rows import AccountRow
from drop_physics.rules.answer import Finding

SAME, ALIKE = 0.02, 2.0
"""Tolerances for matching a finding's number with a row's: SAME as a relative difference; ALIKE as
a factor, for the same joint or pair of bodies, since a row states its worst moment and a finding
the mean."""


def citing(findings: Iterable[Finding], account: Sequence[AccountRow]) -> Iterator[Finding]:
    """Yield findings, each with the matching account row, if there is one."""
    for finding in findings:
        rows = [row for row in account if _tells(row, finding)]
        rows.sort(key=lambda row: row.who in (row.body, ""))  # of a joint or a pair first
        yield replace(finding, row=rows[0], terms=rows[0].terms) if rows else finding


def _tells(row: AccountRow, finding: Finding) -> bool:
    """Return whether an account row has the same content as a finding."""
    effect = finding.effect
    if effect is None or finding.body is None or finding.body not in (row.body, row.other):
        return False
    same_joint = finding.joint is not None and finding.joint in (row.joint, *row.joints)
    if row.joint is not None and not same_joint:
        return False
    pair = row.other is not None and {row.body, row.other} == {finding.body, finding.other}
    most = ALIKE if pair or (same_joint and row.kind == "asked") else 1 + SAME
    return any(
        unit == effect.unit and effect.value <= most * abs(value) <= most**2 * effect.value
        for value, unit in row.numbers
    )
