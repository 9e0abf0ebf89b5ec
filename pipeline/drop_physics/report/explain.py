"""The report of `drop explain`: the meaning of one code in full, or of all in a line each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import Fact, Facts, Report, Section

if TYPE_CHECKING:
    from drop_physics.rules.reference import CodeReference
    from drop_physics.rules.sources import Limit
    from drop_physics.stages.explain import CodeManual

COLUMN, CODE_COLUMN = 12, 24
"""Widths of the columns of titles, and of codes."""


def report_of(manual: CodeManual) -> Report:
    """Report the meanings of codes."""
    if len(manual.codes) > 1:
        rows = [Fact(code.code, code.meaning) for code in manual.codes]
        first = shell_command("drop", "explain", manual.codes[0].code)
        return Report(sections=[Section([Facts(rows, CODE_COLUMN)])], next=[first])
    (one,) = manual.codes
    others = shell_command("drop", "explain", "--list")
    return Report(sections=[Section([Facts(_rows(one), COLUMN)])], next=[others])


def _rows(one: CodeReference) -> list[Fact]:
    """Return the parts of a code's meaning, each with a title."""
    rows = [Fact(Message("code"), one.code), Fact(Message("means"), one.meaning)]
    if one.reason_of is not None:
        rows.append(Fact(Message("reason of"), one.reason_of))
    if one.level is not None:
        rows.append(Fact(Message("level"), one.level))
    limits = [
        Message(
            "{meaning} ({value})",
            meaning=threshold.meaning,
            value=_in_its_unit(threshold),
        )
        for threshold in one.thresholds
    ]
    shown = []
    if (example := one.example) is not None:
        line = "" if example.line is None else f":{example.line}"
        shown = [f"{example.script}{line}", example.says, example.advises or ""]
    for title, texts in (
        (Message("measured"), one.measured),
        (Message("threshold"), limits),
        (Message("says"), one.says),
        (Message("example"), [*filter(None, shown)]),
        (Message("cure"), one.advises),
        (Message("to try"), one.proposes),
    ):
        rows += [Fact("" if number else title, text) for number, text in enumerate(texts)]
    return rows


def _in_its_unit(limit: Limit) -> str:
    if limit.unit == "share":
        return f"{100 * limit.value:g} %"
    return f"{limit.value:g}" if limit.unit == "1" else f"{limit.value:g} {limit.unit}"
