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
    """Yield what stages report to: what is done, how much of it, out of how much."""
    with _bars() as show:
        yield lambda what, done, total: show(what, what, done, total)


@contextlib.contextmanager
def sweep_progress() -> Iterator[Callable[[int, int, int], None]]:
    """Yield what a sweep reports to: runs done, how many of them failed, out of how many."""
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
    # The rate is that of the whole time: shares of a sweep come far apart.
    with Progress(*columns, console=console, transient=True, speed_estimate_period=1e9) as bars:
        tasks: dict[str, Any] = {}

        def show(name: str, words: str, done: int, total: int) -> None:
            words = left(translated(words), 16)
            if name not in tasks:  # what was there before says nothing of the rate
                tasks[name] = bars.add_task(words, completed=done, total=total)
            bars.update(tasks[name], description=words, completed=done)

        yield show


def rate(per_second: float | None) -> str:
    """Return how fast something goes, in the unit in which it is a number above one."""
    if per_second is None:
        return ""
    return f"{per_second:,.0f}/s" if per_second >= 1 else f"{60 * per_second:.1f}/min"
