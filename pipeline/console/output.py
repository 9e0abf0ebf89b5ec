"""How things are printed: progress, JSON, lines, and numbers in the digits that make sense."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from typing import Any


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str, int, int], None]]:
    """Yield what stages report to: a bar on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    columns = (TextColumn("{task.description:<16}"), BarColumn(), MofNCompleteColumn(), TimeLeft())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def report(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done)

        yield report


def millimetres(value_m: float) -> str:
    """Right-align a length in mm; what four decimals cannot show is given in powers of ten."""
    value = value_m * 1e3 + 0.0  # no minus before a zero
    text = f"{value:+.4f}" if value == 0 or abs(value) >= 5e-5 else f"{value:+.1e}"
    return f"{text:>10} mm"


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object, and nothing else, to standard output."""
    # Flushed, because a command may go on: `view` waits for its viewer to be closed.
    print(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False), flush=True)


def note(sentence: str) -> None:
    """Say something that is worth knowing but no error, on standard error."""
    print(f"drop: {sentence}", file=sys.stderr)


def print_lines(*lines: str) -> None:
    """Print lines with Rich's markup: coloured on a terminal, plain in a pipe, never wrapped."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    for line in lines:
        console.print(line)
    console.file.flush()
