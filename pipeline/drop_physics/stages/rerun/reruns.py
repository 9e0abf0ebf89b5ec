"""Runs a script again with changes, several runs at once; shared by several commands.

If a process can be forked without sharing any open file, a run is a fork of a process that waits
just before the script first uses its engine, or after some steps: imports and the code before that
point run only once. Otherwise the script runs from the start. Either way, the run's stream is read
while it runs: it is recorded, or read as events (`process.events()`), or only the result of an
evaluator in its process is read.

    with Reruns(program, again) as reruns:
        with reruns.begun(changed, until=until) as process:
            ending = recorded(process)
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from drop_physics.engines.fork_server import Fork, ForkServer
from drop_physics.engines.script import TRIES, Program, Script
from drop_physics.engines.watching.forks import FIRST_LINE, FIRST_USE
from drop_physics.stages.rerun.again import Again

FORKS = sys.platform.startswith("linux")
"""Whether runs can be forked: a fork must not share open files, and only Linux lists these."""


class Reruns:
    """Runs a script again and again; in a `with` block, later runs are forked from one process.

    Outside such a block each run starts anew. `begun` may be called by several threads at once.

    Parameters
    ----------
    program
        The script as in its first run, with the limits for all runs.
    again
        The way to run the script again without side effects.
    at
        Number of steps after which runs are forked, or `FIRST_LINE`; by default, runs are forked
        before the first use of the engine.
    """

    def __init__(self, program: Program, again: Again, *, at: int = FIRST_USE) -> None:
        self._program, self.again, self._at = program, again, at
        self._server: ForkServer | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        if self.again.parts and FORKS:
            ready = self._stack.enter_context(self.again.ready(self._program))
            server = self._stack.enter_context(ForkServer(ready, at=self._at))
            if server.shared(self.again.patience_s()) == "":
                self._server = server
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server = None
        self._stack.__exit__(kind, error, trace)

    def go_on(self, steps: int) -> bool:
        """Advance the process that runs are forked from; return whether it reached the step.

        Parameters
        ----------
        steps
            Number of steps after which later runs are forked.
        """
        if self._server is None:
            return False
        self._server.go_on(steps)
        return self._server.shared(self.again.patience_s()) == ""

    @property
    def parts(self) -> bool:
        """True if runs are forked from one process."""
        return self._server is not None

    @contextmanager
    def begun(
        self, changed: Program, *, until: float | None = None, printed: int | None = None
    ) -> Iterator[Script | Fork]:
        """Start a run and yield its stream; the run ends with the `with` block.

        Parameters
        ----------
        changed
            The script with the changes to make.
        until
            Time at which the run is stopped, in Unix time [s]; a run that takes many times as long
            as the first run is stopped earlier.
        printed
            File descriptor for the script's output; None to discard the output.
        """
        finer = int((changed.variation or {}).get("finer", 1))
        stops = min(until or float("inf"), time.time() + self.again.patience_s(finer))
        with ExitStack() as stack:
            if printed is None:
                printed = stack.enter_context(Path(os.devnull).open("wb")).fileno()
            process = self._forked(stack, changed, finer, printed) or self._from_start(
                stack, changed, finer, printed
            )

            def look() -> None:
                if time.time() > stops:
                    process.stop("interrupted")

            process.tell = look
            yield process

    def _forked(self, stack: ExitStack, changed: Program, finer: int, printed: int) -> Fork | None:
        """Return a run as a fork; None if that is not possible."""
        alike = {name: getattr(self._program, name) for name in (*TRIES, "explain")}
        too_late = changed.edits and self._at != FIRST_LINE
        if self._server is None or too_late or replace(changed, **alike) != self._program:
            return None
        limited = replace(changed, limits=self.again.limits(finer))
        fork = stack.enter_context(self._server.fork(limited, printed))
        return fork if fork.begin() else None

    def _from_start(self, stack: ExitStack, changed: Program, finer: int, printed: int) -> Script:
        ready = stack.enter_context(self.again.ready(changed, finer=finer))
        return stack.enter_context(Script(ready, stdout=printed, stderr=printed))
