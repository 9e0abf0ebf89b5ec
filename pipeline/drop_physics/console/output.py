"""How output is printed: JSON, notes, lines, and numbers with sensible digits."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Sequence
from typing import Any, TextIO

from drop_physics.fields import counted as counted
from drop_physics.fields import decimals
from drop_physics.messages import columns_of as columns_of
from drop_physics.messages import harmless, translated
from drop_physics.messages import wrapped as wrapped

WIDTH = 80
"""Width of a line in a pipe, unless a name in it is longer."""
NARROWEST, WIDEST = 50, 100
"""Least and greatest width on a terminal that is wide enough."""


def width(stream: TextIO | None = None) -> int:
    """Return how many columns a line may take: the terminal's, within these limits.

    Not `shutil.get_terminal_size`, which asks descriptor 1: here that is /dev/null, see
    `running`.
    """
    stream = stream or sys.stdout
    if not stream.isatty():
        return WIDTH
    try:
        columns = int(os.environ["COLUMNS"])
    except (KeyError, ValueError):
        columns = os.get_terminal_size(stream.fileno()).columns
    return min(max(columns or WIDTH, NARROWEST), WIDEST)


def wants_colour(stream: TextIO) -> bool:
    """Whether a stream gets colours: it is a terminal, or FORCE_COLOR is set."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return bool(os.environ.get("FORCE_COLOR")) or stream.isatty()


def millimetres(value_m: float) -> str:
    """Right-align a length in mm; in powers of ten where four decimals would show nothing."""
    value = value_m * 1e3 + 0.0  # no minus before a zero
    small = 0 < abs(value) < 5e-5
    text = f"{value:+.1e}" if small else decimals(value, 4, "+")
    return f"{text:>10} mm"


def left(text: str, columns: int) -> str:
    """Left-align a text in columns."""
    return text + " " * (columns - columns_of(text))


def right(text: str, columns: int) -> str:
    """Right-align a text in columns."""
    return " " * (columns - columns_of(text)) + text


def cut(text: str, columns: int) -> str:
    """Cut a text to a number of columns."""
    from rich.cells import set_cell_size

    return set_cell_size(text, columns)


def beside(title: str, words: str, column: int) -> list[tuple[str, str]]:
    """Wrap words in a column beside a title; below it if the title is too long.

    Both are in the reader's language. Each line has two parts; the first is as wide as the title's
    column.
    """
    title = translated(title)
    lines = wrapped(translated(words), width() - column)
    if not lines or (title and columns_of(title) > column - 2):
        lines.insert(0, "")
    titles = [title, *[""] * (len(lines) - 1)]
    return [(left(head, column), line) for head, line in zip(titles, lines, strict=True)]


def titled(title: str, words: str, *, column: int, style: str = "") -> list[str]:
    """Return the same with Rich's markup: the words are escaped, the title may have a style."""
    from rich.markup import escape  # takes a tenth of the time of `drop --help`

    lines = [
        (escape(head if words else head.rstrip()), escape(words))
        for head, words in beside(title, words, column)
    ]
    head, first = lines[0]
    head = f"[{style}]{head}[/]" if style else head
    return [head + first, *(head + line for head, line in lines[1:])]


_SHELL_WORD = re.compile(r"""(?:\$'(?:\\.|[^'\\])*'|'[^']*'|"[^"]*"|\S)+""")


def pasteable(title: str, command: str, *, column: int, style: str = "") -> list[str]:
    """Return a command beside its title, with Rich's markup.

    A long one goes on in lines that a shell reads as one: none breaks within a quoted word.
    """
    from rich.markup import escape

    lines, room = [""], width() - column - len(" \\")
    for word in _SHELL_WORD.findall(translated(command)):
        if lines[-1] and columns_of(f"{lines[-1]} {word}") > room:
            lines.append(word)
        else:
            lines[-1] += f" {word}" if lines[-1] else word
    head = left(translated(title), column)
    heads = [f"[{style}]{head}[/]" if style else head, *[" " * column] * (len(lines) - 1)]
    ends = [*[" \\"] * (len(lines) - 1), ""]  # after `escape`, which doubles a backslash at an end
    return [a + escape(b) + c for a, b, c in zip(heads, lines, ends, strict=True)]


Column = tuple[str, Sequence[str], bool]
"""Of a table: its head, its cells, and whether they are numbers, aligned to the right."""


def table(columns: Sequence[Column], *, red: Sequence[bool] = ()) -> list[str]:
    """Return a table with Rich's markup; `red` are rows in which something failed."""
    from rich.markup import escape

    aligned = []
    for head, cells, numbers in columns:
        texts = [translated(head), *cells]
        wide = max(8 if numbers else 0, *map(columns_of, texts))
        aligned.append([(right if numbers else left)(text, wide) for text in texts])
    heads, *rows = (escape("  ".join(row).rstrip()) for row in zip(*aligned, strict=True))
    reds = [*red, *[False] * (len(rows) - len(red))]
    return [
        f"[dim]{heads}[/]",
        *(f"[red]{row}[/]" if is_red else row for row, is_red in zip(rows, reds, strict=True)),
    ]


def made(title: str, path: object, facts: str = "", *, column: int) -> list[str]:
    """Return the line of a written file; the facts go below a long name."""
    from rich.markup import escape

    title, facts = translated(title), translated(facts)
    head = f"[dim]{title}[/]{left('', column - columns_of(title))}{escape(str(path))}"
    if not facts:
        return [head]
    if column + columns_of(str(path)) + 3 + columns_of(facts) <= width():
        return [f"{head}   {facts}"]
    return [head, *(left("", column) + line for line in wrapped(facts, width() - column))]


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object, and nothing else, to standard output."""
    # Flushed, because a command may go on: `view` waits for its viewer to be closed.
    lines = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False).split("\n")
    print("\n".join(map(harmless, lines)), flush=True)


def descriptor(stream: TextIO) -> int:
    """Return a stream's file descriptor, for another process to write to."""
    try:
        return stream.fileno()
    except OSError:  # replaced by a stream in memory
        return 2 if stream is sys.stderr else 1


def note(sentence: str) -> None:
    """Print something worth knowing that is not an error, to standard error."""
    print(one_line(f"drop: {translated(sentence)}"), file=sys.stderr)


def error(sentence: str) -> None:
    """Print what went wrong to standard error; on a terminal it begins in red."""
    line = one_line(f"drop: {translated(sentence)}")
    if wants_colour(sys.stderr):
        line = f"\x1b[1;31mdrop:\x1b[0m{line.removeprefix('drop:')}"
    print(line, file=sys.stderr)


def one_line(sentence: str) -> str:
    """Return a sentence as one line; on a terminal it is wrapped, with an indent."""
    line = harmless(" ".join(sentence.split()))
    if not sys.stderr.isatty():
        return line
    return "\n".join(wrapped(line, width(sys.stderr), indent="      "))


def print_lines(*lines: str, stream: TextIO | None = None) -> None:
    """Print lines with Rich's markup: coloured on a terminal, plain in a pipe, never wrapped."""
    from rich.console import Console

    coloured = wants_colour(stream or sys.stdout)
    console = Console(
        file=stream,
        highlight=False,
        emoji=False,
        soft_wrap=True,
        force_terminal=coloured,
        color_system="auto" if coloured else None,
    )
    for line in lines:
        console.print(harmless(line))
    console.file.flush()
