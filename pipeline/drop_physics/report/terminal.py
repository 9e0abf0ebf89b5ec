"""Renders a report for the terminal, in lines that fit and in the user's language."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import singledispatch
from typing import TYPE_CHECKING, TextIO

from rich.markup import escape

from drop_physics.console.output import (
    columns_of,
    cut,
    error,
    left,
    note,
    print_json,
    print_lines,
    print_plain,
    right,
    width,
    wrapped,
)
from drop_physics.messages import Message, joined, translated
from drop_physics.printable import Printable
from drop_physics.report import blocks
from drop_physics.report.blocks import (
    Column,
    DataTable,
    Fact,
    Facts,
    Failure,
    File,
    FindingList,
    Graphs,
    Report,
    Words,
)
from drop_physics.report.words import NEXT, beneath, besides, folded

if TYPE_CHECKING:
    from drop_physics.rules.answer import Finding

VERDICT = 12
"""Width of the title beside a verdict."""
ERROR = 7
"""Width of the title beside an error."""
NUMBER = 3
"""Width of the number of a finding."""
GAP = 3
"""Least gap before a finding's code, which is appended to the finding's last line if it fits."""
NARROW = 24
"""Width below which a wrapping cell is put below its row."""


def show(
    result: Printable,
    *,
    as_json: bool = False,
    text: str | None = None,
    stream: TextIO | None = None,
    **how: object,
) -> int:
    """Print a result's report, and return the exit code.

    `text` is the output of another renderer, printed instead; if empty, nothing is printed.
    """
    report: Report = result.report(**how)
    for each in report.notes:
        note(each)
    if as_json:
        print_json(result.as_json())
    elif text is not None:
        if text:
            print_plain(text)
    else:
        print_lines(*lines_of(report), *_next(report.next), stream=stream)
    for remark in report.remarks:
        (error if report.code == 1 else note)(remark)
    return report.code


def lines_of(report: Report) -> list[str]:
    """Render a report as lines."""
    first = report.verdict
    verdict = Facts([first], VERDICT) if isinstance(first, Fact) else first
    lines = [] if report.error is None else [*_failure(report.error), ""]
    lines += [] if verdict is None else block_lines(verdict)
    for section in report.sections:
        shown = [line for block in section.blocks for line in block_lines(block)]
        if lines and shown and section.apart:
            lines.append("")
        lines += shown
    return lines


def _next(commands: Sequence[str]) -> Iterator[str]:
    """Yield the commands to run next, quoted for a shell."""
    if commands:
        titles = [NEXT, *[""] * (len(commands) - 1)]
        rows = [
            Fact(title, command, "dim", is_command=True)
            for title, command in zip(titles, commands, strict=True)
        ]
        yield ""
        yield from block_lines(Facts(rows))


def _styled(text: str, style: str) -> str:
    return f"[{style}]{text}[/]" if style and text else text


@singledispatch
def block_lines(block: object) -> Iterator[str]:
    """Render a block as lines."""
    raise TypeError(block)


@block_lines.register
def _(words: Words) -> Iterator[str]:
    key = escape(translated(words.key))
    room = width() - len(words.margin)
    for number, line in enumerate(wrapped(translated(words.text), room, indent=words.indent)):
        text = escape(line)
        if key and not number:
            text = text.replace(key, f"[bold]{key}[/]", 1)
        yield words.margin + _styled(text, words.style)


@block_lines.register
def _(_: Graphs) -> Iterator[str]:
    """Yield nothing: a terminal shows no curves."""
    yield from ()


# -- titles, and what is beside them --------------------------------------------------------------


@block_lines.register
def _(facts: Facts) -> Iterator[str]:
    titles = (columns_of(translated(row.title)) for row in facts.rows)
    column = facts.column or 2 + max(titles, default=0)
    for row in facts.rows:
        if isinstance(row, File):
            yield from _file(row, column)
        elif row.is_command:
            yield from _command(row, column)
        else:
            yield from _fact(row, column)


def _fact(fact: Fact, column: int) -> Iterator[str]:
    """Yield a text in a column beside its title, or below it if the title is too long."""
    title = translated(fact.title)
    lines = wrapped(translated(fact.words), width() - column)
    if not lines or (title and columns_of(title) > column - 2):
        lines.insert(0, "")
    head = left(title, column) if lines[0] else title.rstrip()
    yield _styled(escape(head), fact.style) + escape(lines[0])
    yield from (" " * column + escape(line) for line in lines[1:])


_SHELL_WORD = re.compile(r"""(?:\$'(?:\\.|[^'\\])*'|'[^']*'|"[^"]*"|\S)+""")


def _command(fact: Fact, column: int) -> Iterator[str]:
    """Yield a command on several lines, joined for the shell; never split a quoted word."""
    lines, room = [""], width() - column - len(" \\")
    for word in _SHELL_WORD.findall(translated(fact.words)):
        if lines[-1] and columns_of(f"{lines[-1]} {word}") > room:
            lines.append(word)
        else:
            lines[-1] += f" {word}" if lines[-1] else word
    heads = [_styled(left(translated(fact.title), column), fact.style)]
    heads += [" " * column] * (len(lines) - 1)
    ends = [*[" \\"] * (len(lines) - 1), ""]  # after `escape`, which doubles a backslash at an end
    for head, line, end in zip(heads, lines, ends, strict=True):
        yield head + escape(line) + end


def _file(file: File, column: int) -> Iterator[str]:
    """Yield the line for a written file, and the facts about it below if its name is long."""
    title, facts, path = translated(file.title), translated(file.facts), str(file.path)
    head = f"[dim]{title}[/]{left('', column - columns_of(title))}{escape(path)}"
    if facts and column + columns_of(path) + 3 + columns_of(facts) <= width():
        yield f"{head}   {facts}"
        return
    yield head
    yield from (left("", column) + line for line in wrapped(facts, width() - column))


# -- tables ---------------------------------------------------------------------------------------


@block_lines.register
def _(table: DataTable) -> Iterator[str]:
    columns, left_out = _fitted(table)
    widths = [_width(column) for column in columns]
    rows = len(columns[0].cells)
    if table.has_heads:
        heads = [_padded(translated(each.head), each, wide) for each, wide in _and(columns, widths)]
        line = "".join(heads).rstrip()
        if table.title:
            title = left(cut(translated(table.title), widths[0]).rstrip(), widths[0])
            rest = "".join(heads[1:]).rstrip()
            yield f"{table.margin}[bold]{escape(title)}[/][dim]{escape(rest)}[/]"
        else:
            yield f"{table.margin}[dim]{escape(line)}[/]"
    for number in range(rows):
        failed = number < len(table.failed) and table.failed[number]
        total = table.has_total and number == rows - 1
        yield from (
            table.margin + _styled(line, "red" if failed else "")
            for line in _row(columns, widths, number, margin=len(table.margin), total=total)
        )
    named = [head for head in left_out if head]
    if named and table.left_out is not None:
        yield from block_lines(table.left_out(joined(", ", named)))


def _and(columns: Sequence[Column], widths: Sequence[int]) -> Iterator[tuple[Column, int]]:
    """Yield a table's columns with widths, separated by gaps."""
    for number, (column, wide) in enumerate(zip(columns, widths, strict=True)):
        yield (column if number else replace(column, gap=0)), wide


def _padded(text: str, column: Column, wide: int) -> str:
    return " " * column.gap + (right if column.right else left)(text, wide)


def _row(
    columns: Sequence[Column], widths: Sequence[int], number: int, *, margin: int, total: bool
) -> Iterator[str]:
    """Yield the lines of a table row, wrapping its last cell."""
    line, plain, more = "", "", list[str]()
    for column, wide in _and(columns, widths):
        text = translated(column.cells[number])
        if column.fits:
            cell = " " * column.gap + text if text else ""
            cell = cell if columns_of(plain + cell) + margin <= width() else ""
        elif column.wraps:
            before = columns_of(plain) + column.gap
            is_below = width() - margin - before < min(NARROW, columns_of(text))
            before = widths[0] + GAP if is_below else before
            lines = wrapped(text, max(width() - margin - before, 1))
            first, *more = ["", *lines] if is_below else lines or [""]
            more = [" " * before + _styled(escape(each), column.style) for each in more]
            cell = " " * column.gap + first if first else ""
        else:
            cell = _padded(_cut(text, column.most), column, wide)
        style = "bold" if total and column.right else column.style
        gap = len(cell) - len(cell.lstrip())
        line += cell[:gap] + _styled(escape(cell[gap:]), style)
        plain += cell
    yield line.rstrip()
    yield from more


def _cut(text: str, most: int) -> str:
    if not most or columns_of(text) <= most:
        return text
    end = text[-(most // 2) :]  # names differ at their ends
    return f"{cut(text, most - 1 - columns_of(end)).rstrip()}…{end}"


def _width(column: Column) -> int:
    return 0 if column.fits or column.wraps else max(column.least, _longest(column))


def _longest(column: Column) -> int:
    cells = (_cut(translated(cell), column.most) for cell in column.cells)
    return max(map(columns_of, (translated(column.head), *cells)))


def _fitted(table: DataTable) -> tuple[list[Column], list[str]]:
    """Return the columns that fit, and the headings of those removed.

    Columns with an order of removal are removed first; then cells that may be truncated are
    truncated.
    """
    columns, left_out = [*table.columns], list[Column]()
    room = width() - len(table.margin)

    def needed(least: Callable[[Column], int]) -> int:
        least_of = (
            (each, min(NARROW, _longest(each)) if each.wraps else least(each)) for each in columns
        )
        return sum(wide + each.gap for each, wide in least_of if not each.fits) - columns[0].gap

    def shrunk(column: Column) -> int:
        wide = _width(column)
        return min(wide, column.shrinks_to or wide)

    while needed(shrunk) > room and any(each.drop for each in columns):
        left_out.append(max(columns, key=lambda each: each.drop))
        columns.remove(left_out[-1])
    over = needed(_width) - room
    for at, column in enumerate(columns):
        if over > 0 and column.shrinks_to:
            columns[at] = replace(column, most=max(column.shrinks_to, _width(column) - over))
    return columns, [each.head for each in table.columns if each in left_out]


# -- findings -------------------------------------------------------------------------------------


@block_lines.register
def _(found: FindingList) -> Iterator[str]:
    for number, finding in enumerate(found.findings[: found.most], found.first):
        yield ""
        yield from _finding(number, finding)
    hidden = len(found.findings) - found.most
    if hidden > 0:
        more = Message("{findings}: --verbose", findings=folded(found))
        yield f"[dim]{' ' * NUMBER}{escape(translated(more))}[/]"
    if (words := besides(found)) is not None:
        yield ""
        yield from (f"[dim]{escape(line)}[/]" for line in wrapped(translated(words), width()))


def _failure(failure: Failure) -> Iterator[str]:
    """Yield the error that ended a script, and the line that raised it."""
    finding = failure.finding
    yield from _fact(Fact(Message("error"), finding.told, "red"), ERROR)
    text = "".join(blocks.lines_of(finding, failure.sources).values()).strip()
    if finding.site is not None:
        cited = f"{finding.site}: {text}" if text else finding.site
        yield f"{' ' * ERROR}[cyan]{escape(cited)}[/]"


def _finding(number: int, finding: Finding) -> Iterator[str]:
    style = "bold red" if finding.level == "broken" else "bold"
    room = width() - NUMBER
    message = wrapped(translated(finding.told), room)
    advised = finding.advised
    advice = [] if advised is None else wrapped(translated(advised), room)
    first, *rest = message
    # Alone on its line, as linters write it: terminals and editors open that.
    lines = [f"[cyan]{escape(finding.site)}[/]"] if finding.site else []
    lines += [f"[{style}]{left(str(number), NUMBER)}[/][{style}]{escape(first)}[/]"]
    lines += [f"{' ' * NUMBER}{escape(line)}" for line in rest]
    lines += [f"{' ' * NUMBER}[green]{escape(line)}[/]" for line in advice]
    code = f"[dim]{finding.code}[/]"
    space = room - columns_of((advice or message)[-1]) - columns_of(finding.code)
    if space < GAP:
        yield from [*lines, f"{' ' * NUMBER}{code}"]
    else:
        yield from [*lines[:-1], f"{lines[-1]}{' ' * space}{code}"]
    for words in beneath(finding):
        tried = wrapped(translated(words), room)
        yield from (f"{' ' * NUMBER}{escape(line)}" for line in tried)
