"""Run a script of somebody's in an interpreter of its own, with its calls of PyBullet watched."""

from __future__ import annotations

import json
import mmap
import os
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from rich.filesize import decimal

from pipeline.engines.bullet.watched import Decoder
from pipeline.engines.bullet.watching import pipe
from pipeline.errors import DropError, OutputError
from pipeline.seen import Ending, Event

WATCHING = Path(__file__).with_name("watching")

PERTURB = "85"
"""What fresh memory is filled with (`MALLOC_PERTURB_`): PyBullet reads some before it writes it."""
OTHER_PERTURB = "170"
"""What a second run fills it with: a state that differs then has read some."""

STOPS_WITHIN_S = 6.0
"""How long a script may clean up that is to stop."""
TOLD_AGAIN_S = 2.0
"""A terminal tells the script of Ctrl-C too; one that has not heard by then is told again."""
TICK_S = 0.1


@dataclass(frozen=True)
class Program:
    """What is run, and for how long.

    Parameters
    ----------
    target
        The script's path, or a module's name.
    arguments
        Its own arguments.
    python
        The interpreter.
    """

    target: str
    arguments: Sequence[str]
    python: str
    is_module: bool = False
    steps: int | None = None
    duration_s: float | None = None
    keep_sleeping: bool = False
    seed: int | None = None
    begins_s: float | None = None
    """What its clock shows at first [s], where that is virtual."""
    perturb: str = PERTURB


def shared_block() -> IO[bytes]:
    """Return a file without a name that a watched process and its listener both map.

    Raises
    ------
    OutputError
        If there is no room for it.
    """
    try:
        block = tempfile.TemporaryFile()  # noqa: SIM115 - whoever asked closes it
        try:
            block.truncate(pipe.BLOCK_BYTES)
            # On a full disk a process that maps it would be ended where it first writes to it.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(block.fileno(), 0, pipe.BLOCK_BYTES)
        except BaseException:
            block.close()
            raise
    except OSError as error:
        raise OutputError(
            f"a temporary file of {decimal(pipe.BLOCK_BYTES)}, which the script's process writes "
            f"to, cannot be made in {tempfile.tempdir or 'any folder'}: {error.strerror}; make "
            "room there, name another folder as TMPDIR, or see: ulimit -f"
        ) from error
    return block


class Listener:
    """Reads what a watched process sends; take its `events` to the end.

    Parameters
    ----------
    reading, block
        File descriptors of the pipe, and of the memory that both processes see.
    """

    def __init__(self, reading: int, block: int) -> None:
        self.decoder = Decoder()
        self._reading, self._memory = reading, block
        self._received = 0

    def events(self) -> Iterator[Event]:
        """Yield what is seen, until the process has ended."""
        while True:
            ready, _, _ = select.select([self._reading], [], [], TICK_S)
            if ready:
                data = os.read(self._reading, 1 << 18)
                if not data:
                    break
                self._received += len(data)
                yield from self.decoder.feed(data)
            elif self._is_over():
                break  # a process that it has left behind holds the pipe open
            self._tick()
        while not self._is_over():
            self._tick()
            time.sleep(TICK_S / 10)
        yield from self.decoder.feed(self._left_behind())
        yield from self.decoder.rest()

    def _is_over(self) -> bool:
        return True

    def _tick(self) -> None:
        pass

    def _left_behind(self) -> bytes:
        """Return what the process had not sent when it ended, however that was."""
        with mmap.mmap(self._memory, pipe.BLOCK_BYTES, access=mmap.ACCESS_READ) as memory:
            before, used = pipe.BLOCK.unpack_from(memory)
            start = pipe.BLOCK.size + max(0, self._received - before)
            return memory[start : pipe.BLOCK.size + used]

    def ending(self) -> Ending:
        """Return how it ended, once its events are over."""
        decoder = self.decoder
        made_with = {**decoder.python, "unseeded": decoder.unseeded or None,
            "real_time": decoder.real_time}  # fmt: skip
        ending = Ending(notes=list(decoder.faults), made_with=made_with)
        ended = decoder.ended or {}
        if decoder.stopped:
            ending.how = "steps" if decoder.stopped == "steps" else "duration"
        elif ended:
            ending.how, ending.error = ended["how"], ended["error"]
        else:
            ending.how, ending.error = "failed", "its process ended"
        return ending


class Script(Listener):
    """A script that runs; use it in a `with` statement.

    Raises
    ------
    DropError
        If the interpreter cannot be started.
    """

    def __init__(self, program: Program, *, stdout: int, stderr: int | None = None) -> None:
        self._block = shared_block()
        reading, writing = os.pipe()
        super().__init__(reading, self._block.fileno())
        self._interrupted_at: float | None = None
        self._interrupts = 0
        self._heard = 0.0
        options = {
            "pipe": writing, "block": self._block.fileno(), "module": program.is_module,
            "steps": program.steps, "duration_s": program.duration_s,
            "keep_sleeping": program.keep_sleeping, "seed": program.seed,
            "begins_s": program.begins_s,
        }  # fmt: skip
        command = [program.python, str(WATCHING), json.dumps(options), program.target]
        try:
            self._process = subprocess.Popen(
                [*command, *program.arguments],
                stdout=stdout,
                stderr=stderr,
                pass_fds=(writing, self._block.fileno()),
                env={"MALLOC_PERTURB_": program.perturb, **os.environ},
            )
        except OSError as error:
            self._let_go()
            raise DropError(
                f"{program.python} cannot be started: {error.strerror}; --python takes the path "
                "of a Python interpreter"
            ) from None
        finally:
            os.close(writing)

    def __enter__(self) -> Script:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._let_go()

    def _let_go(self) -> None:
        os.close(self._reading)
        self._block.close()

    def interrupt(self) -> None:
        """Take note of a Ctrl-C, which a terminal has told the script as well."""
        self._interrupts += 1
        if self._interrupted_at is None:
            self._interrupted_at = time.monotonic()
        else:
            self._process.kill()

    def _is_over(self) -> bool:
        return self._process.poll() is not None

    def _tick(self) -> None:
        """End a script that was to stop and does not."""
        now = time.monotonic()
        if self.decoder.stopped and not self._heard:
            self._heard = now
        if self._heard and now - self._heard > STOPS_WITHIN_S:
            self._process.kill()
        if self._interrupted_at is not None:
            waited = now - self._interrupted_at
            if waited > STOPS_WITHIN_S:
                self._process.kill()
            elif waited > TOLD_AGAIN_S and self._interrupts == 1:
                self._interrupts += 1
                self._process.send_signal(signal.SIGINT)

    def ending(self) -> Ending:
        """Return how the script ended, once its events are over."""
        ending, code = super().ending(), self._process.returncode
        if self._interrupted_at is not None:
            ending.how, ending.error = "interrupted", ""
        elif not self.decoder.stopped and not self.decoder.ended:
            ending.how = "failed" if code else "finished"
            ending.error = "" if not code else (
                f"it was ended by {signal.Signals(-code).name}" if code < 0
                else f"it ended with exit code {code}"
            )  # fmt: skip
        return ending
