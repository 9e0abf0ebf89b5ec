"""How things are printed: JSON, notes, lines, and numbers in the digits that make sense."""

from __future__ import annotations

import json
import os
import re
import sys
import textwrap
import unicodedata
from collections.abc import Sequence
from typing import Any, TextIO

from pipeline.fields import counted as counted
from pipeline.fields import decimals

WIDTH = 80
"""Columns that a line of ours takes in a pipe, where no name in it is longer."""
NARROWEST, WIDEST = 50, 100
"""Columns that it takes at least and at most on a terminal, as far as that has them."""


def width(stream: TextIO | None = None) -> int:
    """Return how many columns a line may take: those of the terminal, within reason.

    Not `shutil.get_terminal_size`, which asks descriptor 1: that leads nowhere here, see
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


def harmless(text: str) -> str:
    """Return a text with what a terminal would obey, or not show, in the escapes of JSON.

    Names and texts may come from a recording that somebody else made: control characters, escape
    sequences, marks that reverse the direction of reading.
    """
    if text.isprintable():
        return text
    return "".join(
        one if one.isprintable() or unicodedata.category(one) == "Zs" else _escaped(one)
        for one in text
    )


def _escaped(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[first : first + 4]}" for first in range(0, len(units), 4))


def wants_colour(stream: TextIO) -> bool:
    """Whether a stream may carry colours: a terminal, or one that FORCE_COLOR speaks for."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return bool(os.environ.get("FORCE_COLOR")) or stream.isatty()


def millimetres(value_m: float) -> str:
    """Right-align a length in mm; what four decimals cannot show is given in powers of ten."""
    value = value_m * 1e3 + 0.0  # no minus before a zero
    small = 0 < abs(value) < 5e-5
    text = f"{value:+.1e}" if small else decimals(value, 4, "+")
    return f"{text:>10} mm"


def beside(title: str, words: str, column: int) -> list[str]:
    """Return words beside a title, wrapped in a column of their own; below it where it is long."""
    lines = textwrap.wrap(words, width() - column, break_on_hyphens=False, break_long_words=False)
    if not lines or (title and len(title) > column - 2):
        lines.insert(0, "")
    titles = [title, *[""] * (len(lines) - 1)]
    return [f"{a:<{column}}{b}".rstrip() for a, b in zip(titles, lines, strict=True)]


def titled(title: str, words: str, *, column: int, style: str = "") -> list[str]:
    """Return the same with Rich's markup: words are escaped, and the title may have a style."""
    from rich.markup import escape  # takes a tenth of the time of `drop --help`

    first, *others = beside(title, words, column)
    head = escape(first[:column])
    head = f"[{style}]{head}[/]" if style else head
    return [head + escape(first[column:]), *map(escape, others)]


_SHELL_WORD = re.compile(r"""(?:\$'(?:\\.|[^'\\])*'|'[^']*'|"[^"]*"|\S)+""")


def pasteable(title: str, command: str, *, column: int, style: str = "") -> list[str]:
    """Return a command beside its title, with Rich's markup.

    A long one goes on in lines that a shell reads as one: none breaks within a quoted word.
    """
    from rich.markup import escape

    lines, room = [""], width() - column - len(" \\")
    for word in _SHELL_WORD.findall(command):
        if lines[-1] and len(lines[-1]) + 1 + len(word) > room:
            lines.append(word)
        else:
            lines[-1] += f" {word}" if lines[-1] else word
    head = f"[{style}]{title}[/]" if style else title
    heads = [head + " " * (column - len(title)), *[" " * column] * (len(lines) - 1)]
    ends = [*[" \\"] * (len(lines) - 1), ""]  # after `escape`, which doubles a backslash at an end
    return [a + escape(b) + c for a, b, c in zip(heads, lines, ends, strict=True)]


def finding(code: str, message: str, *, column: int) -> list[str]:
    """Return a finding with Rich's markup: its code stands out."""
    first, *others = titled("Finding", f"{code}: {message}", column=column, style="bold")
    return [first.replace(f"{code}:", f"[yellow]{code}[/]:", 1), *others]


def listed(title: str, pairs: Sequence[tuple[str, str]], *, column: int) -> list[str]:
    """Return a table beside its title, with Rich's markup; the first row is its heading.

    Each row has two parts; on a narrow terminal the second stands below the first.
    """
    from rich.markup import escape

    wide = column + max(len(one) + len(other) for one, other in pairs) <= width()
    heading, *rows = (
        [one + other] if wide else [one.rstrip(), *([f"  {other}"] if other else [])]
        for one, other in pairs
    )
    indent = " " * (column if wide else 2)
    lines = [f"[bold]{title:<{column}}[/][dim]{heading[0]}[/]"]
    lines += [f"{indent}[dim]{part}[/]" for part in heading[1:]]
    return [*lines, *(f"{indent}{escape(part)}" for row in rows for part in row)]


def made(title: str, path: object, facts: str = "", *, column: int) -> list[str]:
    """Return the line of a file that was made; what is said of it goes below a long name."""
    from rich.markup import escape

    head = f"[dim]{title}[/]{'':<{column - len(title)}}{escape(str(path))}"
    if not facts:
        return [head]
    fits = column + len(str(path)) + 3 + len(facts) <= width()
    return [f"{head}   {facts}"] if fits else [head, f"{'':<{column}}{facts}"]


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object, and nothing else, to standard output."""
    # Flushed, because a command may go on: `view` waits for its viewer to be closed.
    lines = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False).split("\n")
    print("\n".join(map(harmless, lines)), flush=True)


def descriptor(stream: TextIO) -> int:
    """Return a stream's file descriptor, for another process to write to."""
    try:
        return stream.fileno()
    except OSError:  # somebody has put a stream in memory in its place
        return 2 if stream is sys.stderr else 1


def note(sentence: str) -> None:
    """Say something that is worth knowing but no error, on standard error."""
    print(one_line(f"drop: {sentence}"), file=sys.stderr)


def error(sentence: str) -> None:
    """Say what went wrong, on standard error; on a terminal the beginning is red."""
    line = one_line(f"drop: {sentence}")
    if wants_colour(sys.stderr):
        line = f"\x1b[1;31mdrop:\x1b[0m{line.removeprefix('drop:')}"
    print(line, file=sys.stderr)


def one_line(sentence: str) -> str:
    """Return a sentence as one line; a terminal gets it wrapped at words, with an indent."""
    line = harmless(" ".join(sentence.split()))
    if not sys.stderr.isatty():
        return line
    return textwrap.fill(
        line,
        width(sys.stderr),
        subsequent_indent="      ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def print_lines(*lines: str, stream: TextIO | None = None) -> None:
    """Print lines with Rich's markup: coloured on a terminal, plain in a pipe, never wrapped."""
    from rich.console import Console

    coloured = wants_colour(stream or sys.stdout)
    console = Console(
        file=stream, highlight=False, emoji=False, soft_wrap=True, force_terminal=coloured,
        color_system="auto" if coloured else None,
    )  # fmt: skip
    for line in lines:
        console.print(harmless(line))
    console.file.flush()
