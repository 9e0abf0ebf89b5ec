"""Ends a watched script as it would end unwatched, and reports how it ended."""

from __future__ import annotations

import atexit
import sys
import time
import traceback
from collections.abc import Callable
from types import TracebackType

from .hidden import WRAPPERS
from .host import ScriptWatch, Stop
from .limits import end_with_parent
from .sites import is_library, shown_file

NOWHERE = "", 0
"""File and line if neither is known."""


def run(watch: ScriptWatch, script: Callable[[], None]) -> None:
    """Run a script to its end, and end the process with its exit code."""
    end_with_parent()
    atexit.register(_end_last, watch)
    code: object = 0
    try:
        script()
        _tell(watch, "finished")
    except Stop:
        end(watch, "stopped")
    except SystemExit as error:
        code = error.code
        failed = bool(code & 0xFF if isinstance(code, int) else code is not None)
        _tell(watch, "failed" if failed else "finished", f"sys.exit({code!r})" if failed else "")
    except KeyboardInterrupt:
        _tell(watch, "interrupted")
        code = 130
    except BaseException as error:  # noqa: BLE001 - the script's own
        watch.failed(error)
        watch.clock.remove()
        _tell(watch, "failed", in_one_line(error), place_of(error))
        while error.__traceback__ is not None and _is_ours(error.__traceback__):
            error.__traceback__ = error.__traceback__.tb_next
        sys.excepthook(type(error), error, error.__traceback__)
        code = 1
    if watch.forks is not None:
        watch.forks.end()
    raise SystemExit(code)  # not sys.exit, which the script may have replaced


def end(watch: ScriptWatch, how: str, error: str = "", site: tuple[str, int] = NOWHERE) -> None:
    """Send all unsent data, and a message on how the script ended; this is the last message."""
    watch.finish()
    watch.lock.remove()
    watch.tell_answer()
    _note_end(watch, how, error, site)


def _tell(watch: ScriptWatch, how: str, error: str = "", site: tuple[str, int] = NOWHERE) -> None:
    """Report how the script ended, and the line of the script in which an exception arose.

    Steps in the script's other threads, `atexit` functions and finalizers are still recorded.
    """
    with watch.lock:
        watch.settle()
        watch.tell_answer()
        _note_end(watch, how, error, site)


def _note_end(watch: ScriptWatch, how: str, error: str, site: tuple[str, int]) -> None:
    watch.pipe.note("took", processor_s=time.process_time())
    watch.pipe.note("end", how=how, error=error, site=site)
    watch.pipe.flush()


def _end_last(watch: ScriptWatch) -> None:
    """Arrange that the last data are sent after all other `atexit` functions have run.

    Only finalizers run later, in this thread; their events stay in the shared block. Other threads
    can no longer get the lock: they end wherever they are.
    """
    if watch.on:
        watch.lock.acquire()
        watch.lock.remove()
        watch.settle()


def place_of(error: BaseException, ours: str = "") -> tuple[str, int]:
    """Return file and line at which an exception arose in the script.

    Frames of drop's own file `ours` are skipped.
    """
    place = NOWHERE
    trace = error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        if not (name.startswith("<") or is_library(name) or name == ours):
            place = shown_file(name), trace.tb_lineno
        trace = trace.tb_next
    return place


def _is_ours(trace: TracebackType) -> bool:
    name = trace.tb_frame.f_code.co_filename
    return name.startswith(WRAPPERS) or "runpy" in name


def in_one_line(error: BaseException) -> str:
    """Return an exception's type and message."""
    return " ".join("".join(traceback.format_exception_only(type(error), error)).split())
