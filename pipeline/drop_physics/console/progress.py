"""Progress bars on a terminal, with share done, speed and time left.

Since the duration of a script is unknown, a line of text shows its progress.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from drop_physics.console.output import cut, left, note, wants_colour, width
from drop_physics.messages import Message, localized, translated

LINE_AFTER_S = 1.0
"""Run time from which a script's progress is shown [s]."""


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str, int, int], None]]:
    """Yield a progress callback: it takes an activity, the amount done, and the total."""
    with _bars() as show:
        yield lambda what, done, total: show(what, what, done, total)


@contextlib.contextmanager
def sweep_progress() -> Iterator[Callable[[int, int, int], None]]:
    """Yield a progress callback for sweeps: it takes the runs done, failed, and in total."""
    with _bars() as show:
        yield lambda done, failed, total: show(
            "runs", Message("runs, {failed:,} failed", failed=failed), done, total
        )


@contextlib.contextmanager
def search_progress() -> Iterator[Callable[..., None]]:
    """Yield a progress callback for searches: it takes changes tried, successes, and the total.

    The search first tries each kind of change, then single elements, so the number of tries may
    exceed the total.
    """
    with _bars() as show:
        yield lambda tried, true, total: show(
            "changes",
            Message("changes, {true:,} make it true", true=true),
            tried,
            max(tried, total),
        )


@contextlib.contextmanager
def _bars() -> Iterator[Callable[[str, str, int, int], None]]:
    """Yield a function that moves a named progress bar; in a pipe it does nothing.

    The function takes the name, the text before the bar, the amount done, and the total.
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
    bars = Progress(*columns, console=console, transient=True, speed_estimate_period=1e9)
    tasks: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:

        def show(name: str, words: str, done: int, total: int) -> None:
            words = left(translated(words), 16)
            if not tasks:  # nothing is shown before there is something to show
                stack.enter_context(bars)
            if name not in tasks:  # earlier results say nothing about the rate
                tasks[name] = bars.add_task(words, completed=done, total=total)
            bars.update(tasks[name], description=words, completed=done)

        yield show


@contextlib.contextmanager
def script_progress() -> Iterator[
    tuple[Callable[[float, int], None] | None, Callable[[str], None]]
]:
    """Yield a function that shows a script's progress on the terminal, and one that prints notes.

    In a pipe, no progress is shown. The script may print at any time: its output overwrites the
    progress line.
    """
    if not sys.stderr.isatty():
        yield None, note
        return
    columns = width(sys.stderr) - 1
    begins = time.monotonic() + LINE_AFTER_S

    def line(words: str) -> None:
        print(f"\r{left(cut(words, columns), columns)}\r", end="", file=sys.stderr, flush=True)

    def show(simulated_s: float, steps: int) -> None:
        if time.monotonic() > begins:
            how_far = Message(
                "{simulated:.2f} s simulated, {steps:,} steps; Ctrl-C ends it and keeps the "
                "recording",
                simulated=simulated_s,
                steps=steps,
            )
            line(translated(how_far))

    def say(sentence: str) -> None:
        line("")
        note(sentence)

    try:
        yield show, say
    finally:
        if time.monotonic() > begins:
            line("")


@contextlib.contextmanager
def swap_progress() -> Iterator[Callable[[int], None]]:
    """Yield a function that shows the number of repeated steps; in a pipe it does nothing."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    columns, begins = width(sys.stderr) - 1, time.monotonic() + LINE_AFTER_S

    def line(words: str) -> None:
        print(f"\r{left(cut(words, columns), columns)}\r", end="", file=sys.stderr, flush=True)

    def show(swaps: int) -> None:
        if time.monotonic() > begins:
            words = Message("{swaps:,} swaps; Ctrl-C says what is known", swaps=swaps)
            line(translated(words))

    try:
        yield show
    finally:
        if time.monotonic() > begins:
            line("")


def rate(per_second: float | None) -> str:
    """Format a rate per second, or per minute if it is below one per second."""
    if per_second is None:
        return ""
    return f"{per_second:,.0f}/s" if per_second >= 1 else f"{60 * per_second:.1f}/min"
