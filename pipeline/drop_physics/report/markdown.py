"""Renders a report as Markdown, for the viewer, golden recordings, and CI summaries."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import singledispatch

from drop_physics.messages import translated
from drop_physics.report.blocks import (
    DataTable,
    Fact,
    Facts,
    File,
    FindingList,
    Graphs,
    Report,
    Words,
)
from drop_physics.report.words import beneath, besides
from drop_physics.rules.answer import Finding

Say = Callable[[str], str]
"""Function that translates a text, or `str` for English."""


def markdown_of(report: Report, *, level: int = 2, say: Say = translated) -> str:
    """Render a report as Markdown, with headings of this level."""
    lines = [*_verdict(report, level, say)]
    for section in report.sections:
        for block in section.blocks:
            lines += block_markdown(block, say)
    return "\n".join(lines)


def _verdict(report: Report, level: int, say: Say) -> Iterator[str]:
    verdict = report.verdict
    if report.error is not None:
        yield from _finding(report.error.finding, say)
    if isinstance(verdict, Fact):
        yield f"{'#' * level} {report.title}: {say(verdict.title)}"
        yield from ("", say(verdict.words), "")
    elif verdict is not None:
        yield from block_markdown(verdict, say)


def _escaped(text: str) -> str:
    return re.sub(r"([\\|`*_<>\[\]])", r"\\\1", text).replace("\n", " ")


@singledispatch
def block_markdown(block: object, say: Say) -> Iterator[str]:
    """Yield a block's lines as Markdown, with an empty line at the end."""
    raise TypeError(block, say)


@block_markdown.register
def _(words: Words, say: Say) -> Iterator[str]:
    heading = "### " if words.style == "bold" else ""
    yield from (heading + _escaped(say(words.text)), "")


@block_markdown.register
def _(facts: Facts, say: Say) -> Iterator[str]:
    if any(isinstance(row, Fact) and row.at_s is not None for row in facts.rows):
        yield from (_moment(row, say) for row in facts.rows if isinstance(row, Fact))
    elif facts.rows:
        yield from ("| | |", "| --- | --- |")
        for row in facts.rows:
            yield _row([row.title, str(row.path) if isinstance(row, File) else row.words], say)
    yield ""


def _moment(row: Fact, say: Say) -> str:
    """Return a fact as a list item, or as a line below one; the viewer cannot wrap table cells."""
    words = _escaped(say(row.words)).strip()
    if not row.title:
        return f"  {words}"
    when = "" if row.at_s is None else f" · `--at {row.at_s:g}`"
    # Two spaces end a line.
    return f"- **{_escaped(say(row.title))}** {words}{when}  "


@block_markdown.register
def _(table: DataTable, say: Say) -> Iterator[str]:
    first, *others = table.columns
    others = [each for each in others if each.head or any(each.cells)]
    yield _row([table.title or first.head, *(each.head for each in others)], say)
    yield _row(["---:" if each.right else "---" for each in (first, *others)], say)
    for cells in zip(*(each.cells for each in (first, *others)), strict=True):
        yield _row(cells, say)
    yield ""


@block_markdown.register
def _(_: Graphs, say: Say) -> Iterator[str]:  # noqa: ARG001
    """Yield nothing: Markdown shows no curves."""
    yield from ()


def _row(cells: Sequence[str], say: Say) -> str:
    return f"| {' | '.join(_escaped(say(cell)).strip() for cell in cells)} |"


@block_markdown.register
def _(found: FindingList, say: Say) -> Iterator[str]:
    yield from ("## Findings", "")
    if (words := besides(found)) is not None:
        yield from (_escaped(say(words)), "")
    for finding in found.findings:
        yield from _finding(finding, say)


def _finding(finding: Finding, say: Say) -> Iterator[str]:
    about = f" ({finding.body})" if finding.body else ""
    site = f" at `{finding.site}`" if finding.site else ""
    # Two spaces end a line.
    advised = finding.advised
    end = "  " if advised else ""
    yield f"- **{finding.code}**{about}{site}: {say(finding.message)}{end}"
    if advised:
        yield f"  *{say(advised)}*"
    yield from (f"  {say(each)}" for each in beneath(finding))
    yield ""
