"""Makes trial runs as forks of one run, which pauses where the trials start to differ."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from drop_physics.engines.channel import shared_block, wide_pipe
from drop_physics.engines.decoder import Decoder
from drop_physics.engines.script import TOO_LONG, TRIES, Listener, Program, Script, end_group
from drop_physics.engines.watching.forks import FIRST_USE, LENGTH
from drop_physics.errors import DropError
from drop_physics.trace.events import Ending, Event

WAIT_S = 0.002
"""Interval at which messages from the paused run are checked [s]."""
TELLS_WITHIN_S = 1.0
"""Time within which the paused run reports how a trial ended after its pipe closed [s]."""


class Fork(Listener):
    """A trial run that is a fork of a paused run; use it in a `with` statement.

    Parameters
    ----------
    server
        The server that controls the paused run; it must stay open.
    number, trial
        The number and the program of the trial.
    printed
        The descriptor to which the trial prints; it is not closed.
    """

    def __init__(self, server: ForkServer, number: int, trial: Program, printed: int) -> None:
        self._server, self._number, self._trial = server, number, trial
        self._block = shared_block()
        reading, self._writing = wide_pipe()
        super().__init__(reading, self._block.fileno())
        self.decoder = Decoder((trial.variation or {}).get("finer", 1))
        self.explains_with = trial.python if trial.explain else None
        self._printed, self._process, self._why, self._before = printed, 0, "", b""
        self.tell: Callable[[], None] = lambda: None
        """Function that is called regularly while the trial runs."""

    def __enter__(self) -> Fork:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process:
            end_group(self._process)
        os.close(self._reading)
        self._block.close()
        self.decoder.close()

    def begin(self) -> bool:
        """Start the trial; return False if it would share resources with the paused run."""
        files = [self._writing, self._block.fileno(), self._printed]
        fields = {name: getattr(self._trial, name) for name in TRIES}
        try:
            self._server.ask({"number": self._number, **fields}, files)
        finally:
            os.close(self._writing)
        self._process, self._before = self._server.forked(self._number)
        return self._process > 0

    def stop(self, why: str) -> None:
        """Stop the trial; `why` is the reason to report."""
        if not self._why:
            self._why = why
            end_group(self._process)

    def events(self) -> Iterator[Event]:
        """Yield the events from the run's beginning, until the trial's process has ended."""
        yield from self.decoder.feed(self._before)
        yield from super().events()

    def ending(self) -> Ending:
        """Return how the trial ended, after its events."""
        ending = super().ending()
        if self._why or self._used_up():
            ending.how, ending.error = self._why or "interrupted", ""
        return ending

    @property
    def has_died(self) -> bool:
        """True if the process ended without a report, and nobody stopped it."""
        return not (self.decoder.ended or self.decoder.stopped or self._why)

    def _used_up(self) -> bool:
        """Return whether the system ended the trial at its processor-time limit."""
        until = time.monotonic() + TELLS_WITHIN_S
        while self.has_died and self._number not in self._server.statuses:
            if time.monotonic() > until:
                break
            time.sleep(WAIT_S)
        status = self._server.statuses.get(self._number, 0)
        return os.WIFSIGNALED(status) and os.WTERMSIG(status) == TOO_LONG

    def _is_over(self) -> bool:
        return self._closed

    def _tick(self) -> None:
        self.tell()


class ForkServer:
    """Pauses a script before an engine call, and forks trial runs there; use it in `with`.

    Parameters
    ----------
    program
        The script, with its arguments, to run again.
    at
        The number of steps after which the script pauses, or `FIRST_USE`.
    """

    def __init__(self, program: Program, *, at: int = FIRST_USE) -> None:
        self._asking, theirs = socket.socketpair()
        self._lock, self._asked = threading.Lock(), 0
        alone = replace(program, explain=False, listens=False)
        with theirs, open(os.devnull, "wb") as null:  # noqa: PTH123 - no path of a user's
            self._script = Script(
                alone, stdout=null.fileno(), stderr=null.fileno(), asks=(theirs.fileno(), at)
            )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> ForkServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._asking.close()
        self._script.kill()
        self._reader.join()
        self._script.__exit__()

    def shared(self, patience_s: float) -> str | None:
        """Return the reason that forbids forks, or an empty string; None if the run does not pause.

        Parameters
        ----------
        patience_s
            How long to wait for the pause [s].
        """
        until = time.monotonic() + patience_s
        while self._script.decoder.serving is None and self._reader.is_alive():
            if time.monotonic() > until:
                break
            time.sleep(WAIT_S)
        return self._script.decoder.serving

    def fork(self, trial: Program, printed: int) -> Fork:
        """Return a trial to be forked from the paused run, with its output redirected to a file."""
        with self._lock:
            self._asked += 1
            return Fork(self, self._asked, trial, printed)

    def ask(self, request: dict[str, Any], files: list[int]) -> None:
        """Send a request to the process of the paused run."""
        text = json.dumps(request).encode()
        with self._lock:
            try:
                socket.send_fds(self._asking, [LENGTH.pack(len(text))], files)
                self._asking.sendall(text)
            except OSError:  # it has ended
                return

    def go_on(self, steps: int) -> None:
        """Let the run continue for the given number of steps; later forks start there."""
        self._script.decoder.serving = None
        self.ask({"at": steps}, [])

    def forked(self, number: int) -> tuple[int, bytes]:
        """Return a trial's process id, 0 if there is none, and the run's output before the fork."""
        decoder = self._script.decoder
        while number not in decoder.forked and self._reader.is_alive():
            time.sleep(WAIT_S)
        process, after = decoder.forked.get(number, (0, 0))
        assert self._script.kept is not None
        return process, bytes(self._script.kept[:after])

    @property
    def statuses(self) -> dict[int, int]:
        """Exit statuses of ended trials; the paused run, which forks them, reports them."""
        return self._script.decoder.statuses

    def _read(self) -> None:
        # Why it does not come to its engine, a run from the start says.
        with contextlib.suppress(DropError):
            for _ in self._script.events():
                pass
