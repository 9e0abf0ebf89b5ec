"""Run the command line as a user does: in this process if that suffices, else in a separate one.

A process of its own takes a second for its imports alone. It is needed where signals, limits, the
module path, what is read at import, or the end of the process itself are tested.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import math
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from unittest.mock import patch

import typer.main
from drop_physics import loading
from drop_physics.console.running import main
from forked import fork_scripts

ROOT = Path(__file__).parents[1]
# A process makes the command from its functions once, which takes a tenth of `drop analyze`.
typer.main.get_command = functools.cache(typer.main.get_command)
fork_scripts()
SIGNALS = (signal.SIGINT, signal.SIGTERM)
HANGS_S = 600
"""Time after which a process counts as hung [s], whatever the machine's load."""


def wait_for(condition: Callable[[], bool], what: str) -> None:
    """Wait until a condition holds; fail with a description of it after a time limit."""
    deadline = time.monotonic() + HANGS_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.005)


def environment(**more: str) -> dict[str, str]:
    """Return environment variables with which a process of the command imports this checkout."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "80"} | more


def run_here(
    arguments: Sequence[object],
    folder: Path,
    *,
    streams: Sequence[int | None],
    environment: Mapping[str, str],
) -> int:
    """Run the command in this process, and return its exit code.

    What the command takes for its own, because the process is, is afterwards as it was before:
    streams, file descriptors, signal handlers, arguments, environment, working directory, the
    garbage collector's threshold.

    Parameters
    ----------
    arguments
        What is typed behind `drop`.
    folder
        Where it is typed.
    streams
        File descriptors of standard input, output and error; None where one is closed.
    environment
        All variables.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(_standard_streams(streams))
        stack.enter_context(_signal_handlers())
        stack.callback(gc.set_threshold, *gc.get_threshold())
        stack.callback(gc.unfreeze)
        stack.enter_context(patch.dict(os.environ, environment, clear=True))
        stack.enter_context(patch.object(sys, "argv", ["drop", *map(str, arguments)]))
        stack.enter_context(contextlib.chdir(folder))
        stack.enter_context(patch.object(loading, "load_less"))
        try:
            main()
        except SystemExit as ended:
            return int(ended.code or 0)
    raise AssertionError("it did not end")


@contextlib.contextmanager
def _standard_streams(streams: Sequence[int | None]) -> Iterator[None]:
    kept = [os.dup(number) for number in range(3)]
    before = sys.stdin, sys.stdout, sys.stderr
    for number, stream in enumerate(streams):
        if stream is None:
            os.close(number)
        else:
            os.dup2(stream, number)
    modes = (("r", -1, "strict"), ("w", -1, "strict"), ("w", 1, "backslashreplace"))
    ours = [  # where one is closed, Python has none
        None
        if stream is None
        else open(number, mode, size, encoding="utf-8", errors=errors, closefd=False)  # noqa: SIM115
        for number, (stream, (mode, size, errors)) in enumerate(zip(streams, modes, strict=True))
    ]
    sys.stdin, sys.stdout, sys.stderr = ours  # type: ignore[assignment]
    try:
        yield
    finally:
        for each in filter(None, {sys.stdin, sys.stdout, sys.stderr, *ours}):
            with contextlib.suppress(OSError):
                each.close()
        sys.stdin, sys.stdout, sys.stderr = before
        ctypes.CDLL(None).fflush(None)  # what C has printed and not yet written
        for number, copy in enumerate(kept):
            os.dup2(copy, number)
            os.close(copy)


@contextlib.contextmanager
def _signal_handlers() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def drop_here(
    *arguments: object, folder: Path, stdin: int | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run the command in this process, with output redirected to files and empty input.

    `variables` are added to those of the environment.
    """
    with (
        tempfile.TemporaryFile("w+b") as out,
        tempfile.TemporaryFile("w+b") as err,
        Path(os.devnull).open("rb") as nothing,
    ):
        code = run_here(
            arguments,
            folder,
            environment=environment(**variables),
            streams=(nothing.fileno() if stdin is None else stdin, out.fileno(), err.fileno()),
        )
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(
            arguments, code, out.read().decode(), err.read().decode()
        )


def measured(
    arguments: list[str], folder: Path, cpu_s: int
) -> tuple[subprocess.CompletedProcess[str], float]:
    """Run the command in this worker process, which is ended if it exceeds a processor time limit.

    Returns
    -------
    What it said, and the most memory [MB] that this process had meanwhile.
    """
    Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here on
    allowed, most = resource.getrlimit(resource.RLIMIT_CPU)
    used_s = math.ceil(time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (used_s + cpu_s, most))
    done = drop_here(*arguments, folder=folder, stdin=0)  # where the worker is asked
    resource.setrlimit(resource.RLIMIT_CPU, (allowed, most))
    (peak_kb,) = re.findall(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return done, int(peak_kb) / 1024


def drop_alone(*arguments: object, folder: Path, **how: object) -> subprocess.CompletedProcess[str]:
    """Run the command as a separate process, with pipes as its streams."""
    return subprocess.run(
        [sys.executable, "-m", "drop_physics", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment(),
        timeout=HANGS_S,
        check=False,
        **how,  # type: ignore[call-overload]
    )
