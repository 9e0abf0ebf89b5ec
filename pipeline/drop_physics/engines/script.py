"""Runs a script in its own interpreter, and reads the stream of its engine's steps."""

from __future__ import annotations

import contextlib
import json
import math
import mmap
import os
import re
import select
import signal
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drop_physics.engines.channel import WATCHING, shared_block, wide_pipe
from drop_physics.engines.decoder import MUJOCO, Decoder
from drop_physics.engines.other_processes import OtherProcesses
from drop_physics.engines.reached import Reached, reached_of, state_of
from drop_physics.engines.watching import pipe
from drop_physics.engines.watching.edits import Edit
from drop_physics.engines.whole_episodes import Episodes
from drop_physics.errors import DropError
from drop_physics.messages import Message
from drop_physics.trace.cures import ChangedRun
from drop_physics.trace.events import Ending, Event, located
from drop_physics.workers import CPU_USED_UP, how_it_ended, under_load, users_environment

MODULE = "watching.running"
"""The module that runs a script in its interpreter."""

PERTURB = "85"
"""Fill value for newly allocated memory (`MALLOC_PERTURB_`), since PyBullet reads some
uninitialised memory."""
OTHER_PERTURB = "170"
"""Fill value for a second run: a state that differs then depends on uninitialised memory."""

STOPS_WITHIN_S = 6.0
"""Time that a script may take to clean up after being stopped [s], on an idle machine."""
INTERRUPT_AGAIN_S = 2.0
"""Time [s] after which a script that still runs gets a second Ctrl-C; the terminal sends the first.
"""
TICK_S = 0.1
TOO_LONG = CPU_USED_UP
"""The signal that ends a run at its processor-time limit; None on Windows."""
ELSEWHERE = Message(
    "other processes that the script starts use the engine, too: what they step is not recorded; "
    "let the script step in its own process (with gymnasium: SyncVectorEnv)"
)
_EXIT_CODE = re.compile(r"sys\.exit\((-?\d+|True)\)")
"""Pattern of exit reasons that Python does not print; for an exception it prints a traceback, for
`sys.exit(text)` the text."""


TRIES = ("steps", "variation", "interventions", "edits", "streams", "evaluator", "limits")
"""Fields of `Program` that may differ between trials forked from the same run."""
TOLD = (
    "is_module",
    "duration_s",
    "of_first",
    "keep_sleeping",
    "seed",
    "begins_s",
    "listens",
    "keeps_files",
    "scratch",
    "private",
)
"""Further fields of `Program` that are passed to the script's process."""


@dataclass(frozen=True)
class Program:
    """A script or module to run, and its limits.

    Parameters
    ----------
    target
        The script's path, or a module's name.
    arguments
        The arguments of the script.
    python
        The path of the interpreter.
    """

    target: str
    arguments: Sequence[str]
    python: str
    is_module: bool = False
    steps: int | None = None
    """Number of steps after which the script is stopped; with `of_first`, only steps of the engine
    that steps first count."""
    duration_s: float | None = None
    keep_sleeping: bool = False
    seed: int | None = None
    begins_s: float | None = None
    """Initial time of the script's clock [s], if that is virtual."""
    perturb: str = PERTURB
    of_first: bool = False
    explain: bool = False
    """Whether MuJoCo's steps are replayed and explained in the same interpreter afterwards."""
    variation: Mapping[str, Any] | None = None
    """The arguments of a `watching.varied.Variation`, or None."""
    listens: bool = False
    """Whether to observe which files and networks the script uses, which slows it down."""
    keeps_files: bool = False
    """Whether the contents of files that the engine loads are sent."""
    interventions: Sequence[Mapping[str, Any]] = ()
    """Changes to engine calls, as made by `interventions`."""
    edits: Sequence[Edit] = ()
    """Replaced parts of the script's text."""
    scratch: str | None = None
    """A copy of the working directory in which the script runs; None for the directory itself."""
    private: Mapping[str, Any] | None = None
    """Arguments of `watching.private.Private`, the view of the file system in which it runs; None
    for the real file system."""
    limits: Mapping[str, Any] | None = None
    """Arguments of `watching.limits.keep`; None without limits, as in the first run."""
    streams: bool = True
    """Whether events are sent; otherwise only the script's end and the evaluator's result are."""
    environment: Mapping[str, str] | None = None
    """Environment variables in addition to the user's."""
    evaluator: Mapping[str, Any] | None = None
    """Evaluator that runs in the script's process: `file` and `name` of a class, and its
    `arguments`."""
    episodes: Episodes = "all"
    """The episodes of the script's environments that are recorded step by step."""

    def changed_by(self, run: ChangedRun) -> Program:
        """Return the program of a changed run."""
        variation, seed, steps = {**run.below}, self.seed, self.steps
        if "draws" in variation:
            draws = variation.pop("draws")
            seed = (seed or 0) + 1 if draws is None else draws
        return replace(
            self,
            variation=variation or None,
            interventions=run.operations,
            edits=run.edits,
            seed=seed,
            steps=None if steps is None else math.ceil(steps * run.longer),
        )


def _seeded(seed: int | None) -> dict[str, str]:
    """Return the environment variable that sets the hash seed, unless the user has set it.

    The hash seed determines the order of sets.
    """
    if seed is None or os.environ.get("PYTHONHASHSEED", "random") != "random":
        return {}
    return {"PYTHONHASHSEED": str(seed % 2**32)}


def _from_home(path: str) -> str:
    """Return a path without the user's home folder."""
    with contextlib.suppress(ValueError, RuntimeError):
        return str(Path("~", Path(path).absolute().relative_to(Path.home())))
    return str(Path(path).absolute())


class Listener(ABC):
    """Reads the event stream of a watched process, until the process ends.

    Parameters
    ----------
    reading, block
        File descriptors of the pipe, and of the memory that both processes see.
    """

    target = ""
    """Path of the script; empty for a block."""
    python = sys.executable
    """The interpreter that runs the script."""
    explains_with: str | None = None
    """The interpreter that replays and explains MuJoCo's steps; None if they are not replayed."""

    _others: OtherProcesses | None = None
    """Finder of other processes with an engine; None if such processes need not belong to the
    script."""

    def __init__(self, reading: int, block: int) -> None:
        self.decoder = Decoder()
        self._reading, self._memory = reading, block
        self._received = 0
        self.kept: bytearray | None = None
        """All bytes received, if other listeners need them."""
        self._closed = False
        """Whether all processes have closed the sending end of the pipe."""
        self._left = False
        """Whether reading has ended."""

    def events(self) -> Iterator[Event]:
        """Yield the events until the process has ended."""
        over = False
        while not self._left:
            ready, _, _ = select.select([self._reading], [], [], TICK_S)
            if ready:
                data = os.read(self._reading, 1 << 18)
                if not data:
                    self._closed = True
                    break
                self._received += len(data)
                if self.kept is not None:
                    self.kept += data
                yield from self.decoder.feed(data)
            elif over:
                break  # a process that it left behind holds the pipe open
            else:  # what it sent before that may have arrived since
                over = self._is_over()
            self._tick()
        while not self._left and not self._is_over():
            self._tick()
            time.sleep(TICK_S / 10)
        if not self._left:
            yield from self.decoder.feed(self._left_behind())
        self.decoder.counters = self._counters()
        yield from self.decoder.rest()
        yield from self._explained()

    def _explained(self) -> Iterator[Event]:
        if self.explains_with is not None:
            yield from self.decoder.explained(self.explains_with)

    def other(self) -> OtherEngine | None:
        """Return the listener for a second engine, after all events; None if there is none."""
        found = self.decoder.other()
        return None if found is None else OtherEngine(self, *found)

    @abstractmethod
    def _is_over(self) -> bool:
        """Return whether the process has finished sending."""

    def _tick(self) -> None:
        """Check whether the process still runs; called at least every `TICK_S`."""
        if self._others is not None:
            self._others.look()

    def steps_elsewhere(self) -> bool:
        """Return whether other processes of the script have loaded an engine."""
        loaded = self._others is not None and self._others.found
        return loaded or any(self.decoder.counters[pipe.APART : pipe.ANSWERED])

    def _left_behind(self) -> bytes:
        """Return the bytes that were still in shared memory when the process ended."""
        with mmap.mmap(self._memory, pipe.BLOCK_BYTES, access=mmap.ACCESS_READ) as memory:
            before, used = pipe.BLOCK.unpack_from(memory)
            start = pipe.BLOCK.size + max(0, self._received - before)
            return memory[start : pipe.BLOCK.size + used]

    def _counters(self) -> Sequence[int]:
        """Return how often each script line read simulation values."""
        with mmap.mmap(self._memory, pipe.SHARED_BYTES, access=mmap.ACCESS_READ) as memory:
            return array("Q", memory[pipe.BLOCK_BYTES :])

    def ending(self) -> Ending:
        """Return how the process ended, after its events."""
        decoder = self.decoder
        mujoco = decoder.mujoco.steps or decoder.engines == [MUJOCO]
        made_with = {
            **decoder.python,
            "unseeded": decoder.unseeded or None,
            "real_time": decoder.bullet.real_time,
            "mujoco": decoder.mujoco.version if mujoco else None,
        }
        notes = [*decoder.faults, *([ELSEWHERE] if self.steps_elsewhere() else [])]
        ending = Ending(main_sha256=decoder.main_sha256, notes=notes, made_with=made_with)
        if self.python != sys.executable:
            ending.interpreter = _from_home(self.python)
        ended = decoder.ended or {}
        if decoder.stopped:
            ending.how = decoder.stopped
        elif ended:
            ending.how, ending.error = ended["how"], ended["error"]
            ending.site = located(*ended["site"]) if ended["site"][0] else ""
            ending.printed = "" if _EXIT_CODE.fullmatch(ending.error) else ending.error
        else:
            ending.how, ending.error = "failed", Message("its process ended")
        return ending


class OtherEngine(Listener):
    """Events of the second engine of a script; close its `decoder`.

    Parameters
    ----------
    listener
        The listener that has read the whole stream.
    decoder, kept
        The decoder of the second engine, and that engine's events.
    """

    def __init__(self, listener: Listener, decoder: Decoder, kept: Iterator[Event]) -> None:
        self.decoder, self._kept = decoder, kept
        self.target, self.python = listener.target, listener.python
        self.explains_with = listener.explains_with
        self._listener = listener

    def events(self) -> Iterator[Event]:
        """Yield the events of the second engine."""
        yield from self._kept
        yield from self._explained()

    def ending(self) -> Ending:
        """Return how the script ended, with warnings about this engine."""
        ending, its = self._listener.ending(), super().ending()
        ending.notes, ending.made_with = its.notes, its.made_with
        return ending

    def _is_over(self) -> bool:
        return True


def end_group(leader: int) -> None:
    """End all processes of a group that drop started, given its leader's id."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(leader, signal.SIGKILL)


class BlockListener(Listener):
    """Reads the stream of a watched `with` block, whose process started this one.

    Parameters
    ----------
    process
        The id of the block's process.
    """

    def __init__(self, reading: int, block: int, *, process: int) -> None:
        super().__init__(reading, block)
        self._process = process

    def stop(self, why: str) -> None:
        """Stop reading: the block ends at its next engine call."""
        if not self._left:
            self.decoder.stopped = why
            self.close()

    def close(self) -> None:
        """Close the pipe."""
        self.decoder.close()
        if not self._left:
            self._left = True
            os.close(self._reading)

    def _is_over(self) -> bool:
        return self._closed or self.decoder.ended is not None or os.getppid() != self._process


class Script(Listener):
    """A running script; use it in a `with` statement.

    Parameters
    ----------
    program
        The script or module to run.
    stdout, stderr
        File descriptors for the script's output; None for those of this process.
    progress
        A function that is called every `TICK_S` with the simulated time [s] and the number of
        steps.
    asks
        The descriptor of a socket through which trials are requested, and the number of steps after
        which the script pauses for them (see `watching.forks`); None without trials.

    Raises
    ------
    DropError
        If the interpreter cannot be started.
    """

    def __init__(
        self,
        program: Program,
        *,
        stdout: int,
        stderr: int | None = None,
        progress: Callable[[float, int], None] = lambda *_: None,
        asks: tuple[int, int] | None = None,
    ) -> None:
        self._before = state_of(Path.cwd()) if program.listens else None
        self._is_limited = program.limits is not None
        self._block = shared_block()
        reading, writing = wide_pipe()
        super().__init__(reading, self._block.fileno())
        self.kept = None if asks is None else bytearray()
        self.decoder = Decoder((program.variation or {}).get("finer", 1), program.episodes)
        self.target, self.python = program.target, program.python
        self.explains_with = program.python if program.explain else None
        self._interrupted_at: float | None = None
        self._interrupts = 0
        self._why = "interrupted"
        self._stopped_at = self._told_at = 0.0
        self._progress = progress
        self.tell: Callable[[], None] = lambda: None
        """Function that is called regularly while the script runs."""
        options = {
            "pipe": writing,
            "block": self._block.fileno(),
            **{name: getattr(program, name) for name in (*TRIES, *TOLD)},
            "asks": None if asks is None else {"asks": asks[0], "at": asks[1]},
        }
        command = [program.python, str(WATCHING), MODULE, json.dumps(options), program.target]
        try:
            self._process = subprocess.Popen(
                [*command, *program.arguments],
                stdin=subprocess.DEVNULL if self._is_limited else None,
                stdout=stdout,
                stderr=stderr,
                process_group=0 if self._is_limited else None,
                pass_fds=(writing, self._block.fileno(), *([] if asks is None else asks[:1])),
                env={
                    "MALLOC_PERTURB_": program.perturb,
                    **users_environment(),
                    **_seeded(program.seed),
                    **(program.environment or {}),
                },
            )
        except (OSError, ValueError) as error:  # ValueError: the path has a null character
            self._close()
            raise DropError(
                "{python} cannot be started: {reason}; --python takes the path of a Python "
                "interpreter",
                python=program.python,
                reason=getattr(error, "strerror", None) or str(error),
            ) from None
        finally:
            os.close(writing)
        self._others = OtherProcesses(self._process.pid)

    def reached(self) -> Reached:
        """Return the resources that the script used, after its end, if they were observed."""
        after = None if self._before is None else state_of(Path.cwd())
        return reached_of(self.decoder.outside, self._before, after, self.decoder.processor_s)

    def __enter__(self) -> Script:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        if self._is_limited:  # what it has started, too
            end_group(self._process.pid)
        self._close()

    def _close(self) -> None:
        os.close(self._reading)
        self._block.close()
        self.decoder.close()

    def interrupt(self) -> None:
        """Note that the script also received a Ctrl-C, from the terminal."""
        self._interrupts += 1
        if self._interrupted_at is None:
            self._interrupted_at = time.monotonic()
        else:
            self._process.kill()

    def kill(self) -> None:
        """Kill the script's process."""
        self._process.kill()

    def stop(self, why: str) -> None:
        """Stop the script as Ctrl-C does."""
        if self._interrupted_at is None:
            self._interrupted_at, self._why = time.monotonic(), why
            self._process.send_signal(signal.SIGINT)

    def events(self) -> Iterator[Event]:
        """Yield the events, until the process has ended.

        Raises
        ------
        DropError
            If the process ended before the script began.
        """
        yield from super().events()
        began = self.decoder.python or self.decoder.cut_off
        if not began and self._interrupted_at is None:
            raise DropError(
                "{python} ended with {how} before it came to the script; run it again, or name "
                "another Python interpreter with --python",
                python=self._process.args[0],  # type: ignore[index]
                how=how_it_ended(self._process.returncode),
            )

    def _is_over(self) -> bool:
        return self._process.poll() is not None

    def _tick(self) -> None:
        """Report the script's progress; kill it if it ignores its limit."""
        super()._tick()
        self.tell()
        now = time.monotonic()
        if now - self._told_at > TICK_S and not self.decoder.waits:
            self._told_at = now
            self._progress(self.decoder.time_s, self.decoder.steps)
        if self.decoder.stopped and not self._stopped_at:
            self._stopped_at = now
        if self._stopped_at and now - self._stopped_at > under_load(STOPS_WITHIN_S):
            self._process.kill()
        if self._interrupted_at is not None:
            waited = now - self._interrupted_at
            if waited > under_load(STOPS_WITHIN_S):
                self._process.kill()
            elif waited > under_load(INTERRUPT_AGAIN_S) and self._interrupts == 1:
                self._interrupts += 1
                self._process.send_signal(signal.SIGINT)

    def ending(self) -> Ending:
        """Return how the script ended, after its events."""
        ending, code = super().ending(), self._process.returncode
        if self._interrupted_at is not None:
            ending.how, ending.error = self._why, ""
        elif not self.decoder.stopped and not self.decoder.ended:
            ending.how, ending.error = ("failed" if code else "finished"), ""
            if self._is_limited and -code == TOO_LONG:
                ending.how = "interrupted"
            elif code < 0:
                name = signal.Signals(-code).name
                ending.error = Message("it was ended by {signal}", signal=name)
            elif code:
                ending.error = Message("it ended with exit code {code}", code=code)
        return ending
