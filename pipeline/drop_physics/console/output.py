"""Print to the console: JSON, notes, wrapped lines."""

from __future__ import annotations

import json
import os
import sys
from typing import Any, TextIO

from drop_physics.fields import counted as counted
from drop_physics.messages import columns_of as columns_of
from drop_physics.messages import harmless, translated
from drop_physics.messages import wrapped as wrapped

errors_as_json = False
"""Whether errors are also printed as JSON; set when a verb starts."""
WIDTH = 80
"""Line width in a pipe, unless a name in the line is longer."""
NARROWEST, WIDEST = 50, 100
"""Smallest and greatest line width on a terminal."""


def width(stream: TextIO | None = None) -> int:
    """Return the line width in columns: the terminal's, within limits.

    `shutil.get_terminal_size` would use descriptor 1, which is /dev/null here (see `running`).
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
    """Return whether to print in colour: to a terminal, or if FORCE_COLOR is set."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return bool(os.environ.get("FORCE_COLOR")) or stream.isatty()


def left(text: str, columns: int) -> str:
    """Left-align a text in a field of this many columns."""
    return text + " " * (columns - columns_of(text))


def right(text: str, columns: int) -> str:
    """Right-align a text in a field of this many columns."""
    return " " * (columns - columns_of(text)) + text


def cut(text: str, columns: int) -> str:
    """Truncate a text to this many columns."""
    from rich.cells import set_cell_size

    return set_cell_size(text, columns)


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object, and nothing else, to standard output."""
    print_plain(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False))


def print_plain(text: str) -> None:
    """Print a text for another program, and nothing else, to standard output."""
    # Flushed, because a command may go on: `view` waits for its viewer to be closed.
    print("\n".join(map(harmless, text.rstrip("\n").split("\n"))), flush=True)


def descriptor(stream: TextIO) -> int:
    """Return a stream's file descriptor, for another process to write to."""
    try:
        return stream.fileno()
    except OSError:  # replaced by a stream in memory
        return 2 if stream is sys.stderr else 1


def note(sentence: str) -> None:
    """Print a note, which is not an error, to standard error."""
    print(one_line(f"drop: {translated(sentence)}"), file=sys.stderr)


def error(sentence: str) -> None:
    """Print an error to standard error; on a terminal, it begins in red."""
    line = one_line(f"drop: {translated(sentence)}")
    if wants_colour(sys.stderr):
        line = f"\x1b[1;31mdrop:\x1b[0m{line.removeprefix('drop:')}"
    print(line, file=sys.stderr)


def one_line(sentence: str) -> str:
    """Format a sentence as one line; on a terminal it is wrapped, with an indent."""
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
