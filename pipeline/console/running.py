"""Run the command line: every error becomes one line and an exit code."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

from pipeline.errors import DropError

if TYPE_CHECKING:
    import typer


class Stopped(BaseException):
    """A signal told the process to end. Unlike KeyboardInterrupt, Typer lets it through."""


def run(app: typer.Typer) -> int:
    """Run the command line and return its exit code; an error becomes one line.

    With `DROP_DEBUG=1` the traceback is shown instead.
    """
    received: list[int] = []

    def stop(number: int, _: object) -> None:
        received.append(number)
        raise Stopped

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        code = app(standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read us has gone: nothing is wrong here, and Python must not complain at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (Exception, Stopped) as error:  # noqa: BLE001 - this is where errors end
        if os.environ.get("DROP_DEBUG") == "1":
            raise
        # A signal that arrives inside a library may come out as that library's own error.
        said, code = _stopped(received[0]) if received else _verdict(error)
        line = "; ".join([said, *getattr(error, "__notes__", [])])
        print(f"drop: {' '.join(line.split())}", file=sys.stderr)
    return code if isinstance(code, int) else 0


def _stopped(number: int) -> tuple[str, int]:
    return "interrupted" if number == signal.SIGINT else "terminated", 128 + number


def _verdict(error: BaseException) -> tuple[str, int]:
    """Return what to say of an error, and the exit code."""
    import typer

    if isinstance(error, DropError):
        return str(error), error.exit_code
    if isinstance(error, typer.TyperException):
        return f"{error.format_message()}; see: drop --help", error.exit_code
    return f"{type(error).__name__}: {error}; DROP_DEBUG=1 shows where", 1
