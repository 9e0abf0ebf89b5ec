"""Bars on a terminal: how much is done, how fast it goes, how long it will take."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from pipeline.console.output import left, wants_colour
from pipeline.messages import Message, localized, translated


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str, int, int], None]]:
    """Yield the function that stages call: what is being done, how much of it, out of how much."""
    with _bars() as show:
        yield lambda what, done, total: show(what, what, done, total)


@contextlib.contextmanager
def sweep_progress() -> Iterator[Callable[[int, int, int], None]]:
    """Yield the function that a sweep calls: runs done, runs failed, out of how many."""
    with _bars() as show:
        yield lambda done, failed, total: show(
            "runs", Message("runs, {failed:,} failed", failed=failed), done, total
        )


@contextlib.contextmanager
def _bars() -> Iterator[Callable[[str, str, int, int], None]]:
    """Yield a function that moves a bar, by its name; in a pipe it does nothing.

    It takes the name, the words before the bar, how much is done, and out of how much.
    """
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(rate(task.speed), justify="right")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=14),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f}"),
        Rate(),
        TimeRemainingColumn(),
        TextColumn(localized("left")),
    )
    console = Console(stderr=True, color_system="auto" if wants_colour(sys.stderr) else None)
    # The rate is averaged over the whole time: parts of a sweep arrive at long intervals.
    with Progress(*columns, console=console, transient=True, speed_estimate_period=1e9) as bars:
        tasks: dict[str, Any] = {}

        def show(name: str, words: str, done: int, total: int) -> None:
            words = left(translated(words), 16)
            if name not in tasks:  # earlier results say nothing about the rate
                tasks[name] = bars.add_task(words, completed=done, total=total)
            bars.update(tasks[name], description=words, completed=done)

        yield show


def rate(per_second: float | None) -> str:
    """Return a rate per second, or per minute where it is below one per second."""
    if per_second is None:
        return ""
    return f"{per_second:,.0f}/s" if per_second >= 1 else f"{60 * per_second:.1f}/min"
