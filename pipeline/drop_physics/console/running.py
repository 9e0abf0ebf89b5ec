"""Run the command line as a process: every error becomes one line and an exit code."""

from __future__ import annotations

import contextlib
import errno
import gc
import importlib
import io
import os
import re
import signal
import sys
from typing import TYPE_CHECKING

from drop_physics import loading, temporary, workers
from drop_physics.console import output
from drop_physics.console.output import width
from drop_physics.errors import NO_MEMORY, DropError, Stopped, signals
from drop_physics.messages import Message, joined

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import typer


PANIC = "PanicException"
"""Class name of panics in libraries written in Rust, which are not an `Exception`."""
UNMAPPED = "failed to map segment"
"""Message of the dynamic loader (glibc) if a library does not fit into memory."""
COLLECTED_EVERY = 1_000_000
"""Number of new objects that triggers garbage collection: more than the imports create.

With Python's default of 700, garbage collection takes 0.17 s of the 1.4 s of `drop run
--no-camera`.
"""


def main() -> None:
    """Run `drop` as this process, and handle its signals and streams until it ends.

    The command line is imported after the handlers are set, so that a signal during the import
    also ends in one line.
    """

    def stop(number: int, _: object) -> None:
        signals.append(number)
        signal.signal(number, signal.SIG_DFL)  # a second signal ends it at once
        raise Stopped

    def load() -> typer.Typer:
        workers.check_limits()
        _open_closed_streams()
        _keep_standard_output()
        app: typer.Typer = importlib.import_module("drop_physics.cli").app
        return app

    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as `nohup` and `&` start programs
            signal.signal(number, stop)
    workers.given = dict(os.environ)
    for name in workers.LOUD:
        os.environ.pop(name, None)
    os.environ |= workers.SAFE
    workers.silence()
    gc.set_threshold(COLLECTED_EVERY)
    loading.load_less()
    temporary.remove_leftovers()
    try:
        code = run(load, signals)
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):  # done: Python is only cleaning up
            signal.signal(number, signal.SIG_IGN)
        workers.given = {}
    _give_up_standard_output()
    gc.freeze()  # or all objects would be looked through once more at the end: 0.08 s
    raise SystemExit(code)


def run(load: Callable[[], typer.Typer], received: Sequence[int] = ()) -> int:
    """Run the command line and return its exit code; an error becomes one line.

    With `DROP_DEBUG=1` the traceback is shown instead.

    Parameters
    ----------
    load
        A function that returns the command-line app; its errors become one line, too.
    received
        The list of received signals, to which the handler adds each before it raises.
    """
    output.errors_as_json = False
    try:
        command = load()
        how = {"terminal_width": width()} if sys.stdout.isatty() else {}
        code = command(prog_name="drop", standalone_mode=False, **how)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            return int(error.code or 0)  # completion ends like this; fish asks for the code
        return 141  # the reader has gone; Click and Rich turn that into an exit
    except BaseException as error:
        if not isinstance(error, Exception | Stopped) and type(error).__name__ != PANIC:
            raise
        if os.environ.get("DROP_DEBUG") == "1":
            raise
        # A signal that arrives inside a library may come out as that library's own error.
        sentence, code = _stopped(received[0]) if received else _verdict(error)
        line = joined("; ", [sentence, *getattr(error, "__notes__", [])])
        from drop_physics.console.output import error as say

        with contextlib.suppress(OSError):
            say(line)
            if output.errors_as_json or (code == 2 and "--json" in sys.argv):  # not yet parsed
                output.print_json({"error": str(line)})
    return code if isinstance(code, int) else 0


def _open_closed_streams() -> None:
    """Open closed standard streams (`>&-`), so that no recording gets their descriptors.

    Characters outside the stream's encoding are written as escapes, which are also valid in JSON.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _keep_standard_output() -> None:
    """Keep C code off standard output: Bullet prints there, sometimes at exit."""
    kept = os.dup(1)
    _send_nowhere(1)
    sys.stdout = os.fdopen(
        kept,
        "w",
        1 if os.isatty(kept) else -1,
        encoding=sys.stdout.encoding,
        errors="backslashreplace",
    )


def _give_up_standard_output() -> None:
    """Discard output that cannot be flushed, so that Python does not complain at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        _send_nowhere(sys.stdout.fileno())


def _send_nowhere(number: int) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)


def _stopped(number: int) -> tuple[str, int]:
    interrupted = number == signal.SIGINT
    return Message("interrupted") if interrupted else Message("terminated"), 128 + number


def _verdict(error: BaseException) -> tuple[str, int]:
    """Return the message and exit code for an error."""
    if isinstance(error, DropError):
        return error.in_options, error.exit_code
    unmapped = isinstance(error, ImportError) and UNMAPPED in str(error)
    if unmapped or isinstance(error, MemoryError):
        return NO_MEMORY, 1
    if type(error).__name__ == PANIC:
        return Message("a library has failed; is there enough memory? See: ulimit -a"), 1
    import typer

    full = {
        errno.ENOSPC: Message("no space left"),
        errno.EFBIG: Message("the file is too large; see: ulimit -f"),
    }
    if isinstance(error, OSError) and error.errno in full and error.filename is None:
        return Message(
            "standard output cannot be written: {why}; send it elsewhere", why=full[error.errno]
        ), 1
    if isinstance(error, typer.TyperException):
        context = getattr(error, "ctx", None)
        # An option that lacks its value comes without.
        verb = next((word for word in sys.argv[1:] if not word.startswith("-")), "record")
        command = f"drop {verb}" if context is None else context.command_path
        if command == "drop SCRIPT.py":  # has no help of its own
            command = "drop record"
        sentence: str | None = _unreadable(error)
        if sentence is None:
            sentence = _of_typer(error.format_message().rstrip("."))
        return Message(
            "{error}; see: {command} --help", error=sentence, command=command
        ), error.exit_code
    return Message("{error}; DROP_DEBUG=1 shows where", error=f"{type(error).__name__}: {error}"), 1


_TYPERS: dict[str, Callable[..., Message]] = {
    r"Missing (?:option|argument) (.+)": lambda what: Message("{what} is missing", what=what),
    r"No such option: (\S+)": lambda what: Message("no such option: {what}", what=what),
    r"No such option: (\S+) \(Possible options: (.+)\)": lambda what, near: Message(
        "no such option: {what}; did you mean {near}?", what=what, near=near
    ),
    r"No such command (.+?)": lambda what: Message("no such command {what}", what=what),
    r"No such command (.+?)\. Did you mean (.+)\?": lambda what, near: Message(
        "no such command {what}; did you mean {near}?", what=what, near=near
    ),
    r"Option (.+) requires an argument": lambda what: Message("{what} needs a value", what=what),
    r"Option (.+) does not take a value": lambda what: Message("{what} takes no value", what=what),
    r"Invalid value for '(.+?)': Value error, (.+)": lambda option, why: Message(
        "{option} cannot be read: {why}", option=option, why=why
    ),
    r"Invalid value for '(.+?)': Value error, '?(.*?)'? is not one of (.+)": (
        lambda option, value, choices: Message(
            "{option} must be one of {choices}, got {value!r}",
            option=option,
            choices=choices,
            value=value,
        )
    ),
    r"Got unexpected extra argument\(?s?\)? \((.+)\)": lambda what: Message(
        "unexpected argument: {what}", what=what
    ),
}
"""Translated messages that replace Typer's errors about a wrong command line."""


def _of_typer(text: str) -> str:
    """Return drop's message in place of Typer's."""
    found = ((make, re.fullmatch(pattern, text, re.DOTALL)) for pattern, make in _TYPERS.items())
    ours = [make(*match.groups()) for make, match in found if match]
    return ours[-1] if ours else f"{text[:1].lower()}{text[1:]}"


def _unreadable(error: BaseException) -> Message | None:
    """Return the message for a text that is not a number; Typer's does not quote the text."""
    from drop_physics.fields import shown

    for details in getattr(error.__cause__, "errors", list)():
        wanted = details.get("ctx", {}).get("error")
        if isinstance(wanted, DropError):
            return Message(
                "{option} takes {wanted}, got {text}",
                option=getattr(error, "param").opts[0],  # noqa: B009 - of some errors only
                wanted=wanted.in_options,
                text=shown(details["input"]),
            )
    return None
