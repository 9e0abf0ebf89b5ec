"""Renders a report as HTML, without the page's title; texts from a recording are escaped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import singledispatch
from html import escape
from pathlib import Path

from drop_physics.messages import Message, harmless, joined, translated
from drop_physics.quantities import number
from drop_physics.report.blocks import (
    DataTable,
    Fact,
    Facts,
    File,
    FindingList,
    Graphs,
    Report,
    Words,
    lines_of,
)
from drop_physics.report.words import beneath, besides, folded
from drop_physics.rules.answer import Finding

CURVES = "<!-- curves -->"
"""Placeholder for curves; recorded texts cannot contain it, as they are escaped."""
AROUND = 2
"""Number of source lines shown before and after the one that a finding cites."""
Moment = Callable[[float], str]
"""Function that returns a simulated time [s] as HTML, linked to its frame if one is shown."""


def time_html(at_s: float) -> str:
    """Format a time as HTML, without a link."""
    return f"{number(at_s)} s"


def html_of(report: Report, heading: str = "h1", moment: Moment = time_html) -> Iterator[str]:
    """Yield a report's verdict as a heading, then its sections, in the user's language."""
    verdict = report.verdict
    if report.error is not None:
        yield from _listed([report.error.finding], 1, report.error.sources)
    if isinstance(verdict, Fact):
        yield f"<{heading}>{_said(report.title)}: {_said(verdict.title)}</{heading}>"
        yield f"<p>{_said(verdict.words)}</p>"
    elif verdict is not None:
        yield f"<{heading}>{_said(verdict.text)}</{heading}>"
    yield from (f'<p class="note">{_said(each)}</p>' for each in report.notes)
    for section in report.sections:
        yield "<section>"
        for block in section.blocks:
            yield from block_html(block, moment)
        yield "</section>"


def _said(text: str) -> str:
    return escape(harmless(translated(text)))


@singledispatch
def block_html(block: object, moment: Moment) -> Iterator[str]:
    """Render a block as HTML."""
    raise TypeError(block, moment)


@block_html.register
def _(words: Words, moment: Moment) -> Iterator[str]:  # noqa: ARG001
    tag = "h2" if words.style == "bold" else "p"
    yield f'<{tag} class="{words.style}">{_said(words.text)}</{tag}>'


@block_html.register
def _(facts: Facts, moment: Moment) -> Iterator[str]:
    if not facts.rows:
        return
    yield '<table class="facts">'
    for row in facts.rows:
        words = joined("   ", [str(row.path), row.facts]) if isinstance(row, File) else row.words
        text = _said(words)
        if isinstance(row, Fact) and row.is_command:
            text = f"<code>{text}</code>"
        at_s = row.at_s if isinstance(row, Fact) else None
        when = "" if at_s is None else f'<td class="when">{moment(at_s)}</td>'
        yield f"<tr><th>{_said(row.title)}</th><td>{text}</td>{when}</tr>"
    yield "</table>"


@block_html.register
def _(table: DataTable, moment: Moment) -> Iterator[str]:  # noqa: ARG001
    first, *others = table.columns
    columns = [first, *(each for each in others if each.head or any(each.cells))]
    yield '<div class="wide"><table>'
    if table.has_heads:
        heads = [table.title or first.head, *(column.head for column in columns[1:])]
        cells = zip(heads, columns, strict=True)
        yield f"<tr>{''.join(_cell('th', text, right=each.right) for text, each in cells)}</tr>"
    for place in range(len(first.cells)):
        failed = place < len(table.failed) and table.failed[place]
        total = table.has_total and place == len(first.cells) - 1
        name = "failed" if failed else "total" if total else ""
        row = "".join(_cell("td", column.cells[place], right=column.right) for column in columns)
        yield f'<tr class="{name}">{row}</tr>'
    yield "</table></div>"


def _cell(tag: str, text: str, *, right: bool) -> str:
    side = "right" if right else "left"  # a notebook has a style of its own for tables
    return f'<{tag} style="text-align: {side}">{_said(text).strip()}</{tag}>'


@block_html.register
def _(found: FindingList, moment: Moment) -> Iterator[str]:  # noqa: ARG001
    if (words := besides(found)) is not None:
        yield f"<p>{_said(words)}</p>"
    yield from _listed(found.findings[: found.most], found.first, found.sources)
    hidden = found.findings[found.most :]
    if hidden:
        more = folded(found)
        summary = Message("and {more}", more=more) if found.most else more
        yield f"<details><summary>{_said(summary)}</summary>"
        yield from _listed(hidden, found.first + found.most, found.sources)
        yield "</details>"


def _listed(findings: Sequence[Finding], first: int, sources: Mapping[str, Path]) -> Iterator[str]:
    yield f'<ol class="findings" start="{first}">'
    for finding in findings:
        yield f'<li class="{finding.level}"><p><b>{_said(finding.told)}</b></p>'
        if (advised := finding.advised) is not None:
            yield f'<p class="advice">{_said(advised)}</p>'
        yield from (f"<p>{_said(each)}</p>" for each in beneath(finding))
        yield f'<p class="code">{_said(finding.code)}{_site(finding)}</p>'
        yield from _source(finding, sources)
        yield "</li>"
    yield "</ol>"


def _site(finding: Finding) -> str:
    return "" if finding.site is None else f" · {_said(finding.site)}"


def _source(finding: Finding, sources: Mapping[str, Path]) -> Iterator[str]:
    """Yield the source line that a finding cites, with its neighbours."""
    lines = lines_of(finding, sources, AROUND)
    if lines:
        cited = int(str(finding.site).rpartition(":")[2])
        yield "<pre>"
        for line, text in lines.items():
            tag = "mark" if line == cited else "span"
            yield f"<{tag}>{line:>5}  {escape(harmless(text.expandtabs()))}</{tag}>\n"
        yield "</pre>"


@block_html.register
def _(_: Graphs, moment: Moment) -> Iterator[str]:  # noqa: ARG001
    """Yield a placeholder for curves."""
    yield CURVES
