"""Watches a script: the part that is the same for all engines.

The part for one engine, an `EngineWatch`, is in the engine's folder: it replaces the engine's
functions, sends their effects, and calls `ScriptWatch.count` after each step.
"""

from __future__ import annotations

import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from os import getpid
from threading import current_thread, get_ident
from typing import Any
from weakref import ref

from .clock import Clock
from .edits import Edit
from .environments import Environments
from .evaluating import evaluator_of
from .forks import Forks
from .hidden import hide
from .imports import Then, on_extension, on_import
from .observed import Observed
from .outside import Outside
from .pipe import APART, Pipe
from .private import Private
from .single_changes import Change
from .sites import Sites, caller
from .turns import Turn

IDLE_S = 60.0
"""Time [s] without a step after which a script that sleeps or polls for input counts as waiting for
a user who is not there."""
Call = Callable[..., Any]
TOLD_EVERY = 8
"""Number of steps between checks whether unsent bytes have waited too long."""


class Stop(SystemExit):
    """Exception that ends a script at its step or time limit."""


class EngineWatch(ABC):
    """Interface of an engine's watch, which wraps the engine's functions.

    Parameters
    ----------
    host
        The watch of the script.
    """

    name = ""
    """The engine's name."""

    def __init__(self, host: ScriptWatch) -> None:
        self.host, self.pipe = host, host.pipe
        self.stepped = -1
        """Number of the simulation stepped last."""
        host.engines.append(self)

    def guarded(self, world: Any, do: Callable[..., object], *arguments: Any) -> None:
        """Run code of drop; if it raises an error, stop following the simulation, not the script.

        The script continues, since drop's errors must not reach it.
        """
        try:
            do(*arguments)
        except Exception as error:  # noqa: BLE001 - whatever it is
            self.lose(world, error)

    @abstractmethod
    def lose(self, world: Any, error: Exception) -> None:
        """Stop following a simulation after an error, and report that."""

    @abstractmethod
    def become(self, trial: dict[str, Any]) -> None:
        """Continue this process, a new fork, as a trial run with other changes."""

    def can_become(self, trial: dict[str, Any]) -> bool:
        """Return whether a trial run differs from this one only in steps that are not yet made."""
        del trial
        return True

    def possible(self, rows: Sequence[dict[str, Any]]) -> list[Change]:
        """Return the single changes that the rows of a table allow in this run."""
        del rows
        return []

    def tell_episode(self, **what: Any) -> None:
        """Report the beginning or end of an episode in the simulation numbered `world`."""
        self.host.tell("episode", **what)

    def observed(self) -> Observed | None:
        """Return the last stepped simulation, in the form that expectations read."""
        return None

    def catch_up(self) -> None:  # noqa: B027
        """Make the steps that are due in real-time mode; the caller holds the lock."""

    def stop(self) -> None:  # noqa: B027
        """Make the script end at its next engine call."""

    def settle(self) -> None:  # noqa: B027
        """Send all unsent data of all simulations; the caller holds the lock."""

    def finish(self) -> None:  # noqa: B027
        """Stop following all simulations."""


class ScriptWatch:
    """Watches a script while it runs: steps, limits, clock, engines.

    Parameters
    ----------
    pipe, clock
        The pipe to the recorder, and the script's clock.
    steps
        The number of steps after which the script is ended; None for no limit.
    of_first
        Whether only steps of the engine that makes the first step count.
    duration_s
        The time on the script's clock after which the script is ended [s]; None for no limit.
    asks
        The arguments of `Forks`, for a run from which trials are forked; None for other runs.
    streams
        Whether steps and calls are sent; otherwise only the script's end and the evaluator's result
        are.
    evaluator
        The description of an evaluator (see `evaluating.evaluator_of`), or None.
    is_plain
        Whether the run is the script's own, without any change.
    private
        The private view of the file system that the process has entered; None for the real file
        system.
    edits
        The replacements in the script's text.
    """

    def __init__(
        self,
        pipe: Pipe,
        clock: Clock,
        *,
        steps: int | None,
        duration_s: float | None,
        of_first: bool = False,
        asks: Mapping[str, int] | None = None,
        streams: bool = True,
        evaluator: Mapping[str, Any] | None = None,
        is_plain: bool = True,
        private: Private | None = None,
        edits: Sequence[Edit] = (),
    ) -> None:
        self.pipe, self.clock, self.private = pipe, clock, private
        self.edits = edits
        self.on = True
        self.keeps_files = False
        """Whether contents of files that an engine loads are sent."""
        self.lock, self.sites = Turn(), Sites(pipe)
        self.engines: list[EngineWatch] = []
        self.engine: EngineWatch | None = None
        """The engine that made the last step."""
        self.environments = Environments(self)
        self.is_parting = False
        """Whether a trial run is being forked: unlike other children, it is watched, too."""
        self.forks: Forks | None = None if asks is None else Forks(self, **asks)
        self.evaluator = evaluator_of(evaluator)
        if not streams:
            pipe.mute()
        self.stopped: str | None = None
        self.steps_made = self._beside = 0
        self._first: EngineWatch | None = None
        """The engine that made the first step, if only its steps count."""
        self._of_first = of_first
        self._intervened: set[int] = set()
        self._limit_steps, self._limit_s = steps, duration_s
        self._undo: list[Callable[[], None]] = []
        self.steppers: list[tuple[Any, str, Any]] = []
        """Replaced functions that make steps: their owners, names and wrappers."""
        self._is_plain = is_plain
        self._outside: Outside | None = None
        self._left: Any = None
        """The counters in the parent's shared memory, in a forked child; None in other processes.
        """
        self._process, self._thread = getpid(), get_ident()
        self._threads: set[threading.Thread] = set()
        """Threads other than the main one that have made steps."""
        clock.passed = self._time_has_passed
        clock.timing = self._tell_timing
        if hasattr(os, "register_at_fork"):
            # What is registered is kept as long as the process lives.
            os.register_at_fork(after_in_child=partial(_leave, ref(self)))

    def become(self, trial: dict[str, Any], pipe: int, block: int) -> None:
        """Continue this process, a new fork, as a trial run.

        Parameters
        ----------
        trial
            The trial's `steps`, `variation`, `interventions`, `edits`, `streams` and `evaluator`,
            as for a separate run.
        pipe, block
            File descriptors of the trial's pipe, and of the memory that it shares with the
            recorder.
        """
        self._process, self.is_parting = getpid(), False
        self.pipe.become(pipe, block)
        if not trial["streams"]:
            self.pipe.mute()
        self.evaluator = evaluator_of(trial["evaluator"])
        self._limit_steps, self._intervened = trial["steps"], set()
        self.edits = trial["edits"]
        for engine in self.engines:
            engine.become(trial)

    def can_become(self, trial: dict[str, Any]) -> bool:
        """Return whether a trial run differs from this one only in steps that are not yet made.

        All engines must be imported already: one that is imported later would not get the trial's
        changes.
        """
        differs = bool(trial["variation"] or trial["interventions"])
        return all(each.can_become(trial) for each in self.engines) and (
            bool(self.engines) or not differs
        )

    def on_removal(self, undo: Callable[[], None]) -> None:
        """Register a function to be called when this watch ends."""
        self._undo.append(undo)

    def on_import(self, name: str, then: Then, *, once: bool = True) -> None:
        """Call a function with a module when the script imports the module: once or always."""
        self.on_removal(on_import(name, then, once=once))

    def on_extension(self, name: str, then: Then) -> None:
        """Call a function with every module object that is loaded from an extension file."""
        self.on_removal(on_extension(name, then))

    def remove(self) -> None:
        """Restore all replaced functions; wrappers that the script has stored call the engine."""
        self.on = False
        while self._undo:
            self._undo.pop()()
        self.clock.remove()
        self.lock.remove()

    def leave(self) -> None:
        """Stop watching in a process that the script forked; only its first step is reported."""
        self.remove()
        self._left = self.pipe.counters
        self.pipe.leave()
        for owner, name, hook in self.steppers if self._is_plain else ():
            setattr(owner, name, hook)

    def step_apart(self) -> None:
        """Note that a process which the script forked makes a step."""
        if self._left is not None:
            self._left[APART] = 1

    def standing(self, original: Call, call: Call) -> Call:
        """Wrap a function: `call` replaces it as long as the script is watched.

        Frames of the wrapper are hidden in tracebacks.
        """

        def stand(*args: Any, **kwargs: Any) -> Any:
            try:
                return (call if self.on else original)(*args, **kwargs)
            except BaseException as error:
                hide(error)
                raise

        return stand

    # -- what is told -----------------------------------------------------------------------------

    def tell(self, what: str, **values: Any) -> None:
        """Send a message to the recorder."""
        with self.lock:
            self.pipe.note(what, **values)

    def tell_place(self, what: str, frame: Any, **values: Any) -> None:
        """Send a message about the script's line that a frame belongs to."""
        file, line = self.sites.place(frame)
        self.tell(what, file=file, line=line, **values)

    def tell_draw(self, called: str, frame: Any) -> None:
        """Report an unseeded random number, with the script's line."""
        self.tell_place("unseeded", self.sites.outside(frame), called=called)

    def tell_intervention(self, number: int) -> None:
        """Report, once, that a trial change had an effect."""
        if number not in self._intervened:
            self._intervened.add(number)
            self.tell("intervened", number=number)

    def _tell_timing(self, frame: Any) -> None:
        """Report the script's line that reads the clock between steps."""
        self.tell_place("timing", frame)

    def listen_outside(self) -> None:
        """Report which files, devices and networks the script uses, until it ends."""
        self._outside = Outside(self._tell_outside, lambda: {self.pipe.descriptor})
        self._outside.listen()

    def _tell_outside(self, what: str, name: str) -> None:
        if self.on:
            self.tell("outside", how=what, name=name)

    def _look_outside(self) -> None:
        if self._outside is not None:
            self._outside.look()

    # -- steps and time ---------------------------------------------------------------------------

    def count(self, time_s: float, engine: EngineWatch) -> None:
        """Count a step that leads to the given time [s]; end the script at a limit."""
        self.steps_made += 1
        self.engine = engine
        if engine is not self._first:
            self._first = self._first or engine
            self._beside += self._of_first and engine is not self._first
        if get_ident() != self._thread:
            self._threads.add(current_thread())
        self.clock.step(time_s)
        if self.steps_made == 1:
            self._look_outside()
        if self.evaluator is not None:
            self._evaluate(engine)
        if self.steps_made - self._beside == self._limit_steps:
            self.stop("steps")
        if self._limit_s is not None:
            self._check_time()
        if not self.steps_made % TOLD_EVERY:
            self.pipe.tick()

    def _evaluate(self, engine: EngineWatch) -> None:
        assert self.evaluator is not None
        try:
            self.evaluator.step(engine, caller())
        except Exception as error:  # noqa: BLE001 - it must not reach the script
            self.evaluator = None
            self.tell("answer", value=None, error=f"{type(error).__name__}: {error}")

    def tell_answer(self) -> None:
        """Send the evaluator's answer after the run."""
        if self.evaluator is None:
            return
        try:
            value, error = self._apart(self.evaluator.answer), ""
        except Exception as raised:  # noqa: BLE001 - the script's own names may be anything
            value, error = None, f"{type(raised).__name__}: {raised}"
        self.evaluator = None
        self.tell("answer", value=value, error=error)

    def failed(self, error: BaseException) -> None:
        """Tell the evaluator of an exception that ends the script, or one of its tests."""
        if self.evaluator is not None:
            evaluator = self.evaluator
            self._apart(lambda: evaluator.failed(error))

    def before_end(self) -> None:
        """Tell the evaluator that a simulation is about to end."""
        if self.evaluator is not None:
            self._apart(self.evaluator.before_end)

    def _apart(self, evaluate: Callable[[], Any]) -> Any:
        """Evaluate something with the original engine functions, unwatched and unchanged."""
        on, self.on = self.on, False
        try:
            return evaluate()
        finally:
            self.on = on

    def _time_has_passed(self) -> None:
        if not self.on:
            return
        with self.lock:
            self.check()
            for engine in self.engines:
                engine.catch_up()
            self._check_time()

    def _check_time(self) -> None:
        now_s = max(self.clock.simulated_s, self.clock.waited_s)
        if self._limit_s is not None and now_s >= self._limit_s * (1 - 1e-12):
            self.stop("duration")
        elif self.clock.idle_s >= IDLE_S:
            self.stop("idle")

    def stop(self, why: str) -> None:
        """End the script at once, and again at any further engine call."""
        self.stopped = why
        for engine in self.engines:
            engine.stop()
        self.pipe.note("stop", why=why)
        self.pipe.flush()
        raise Stop(0)

    def check(self) -> None:
        """End the script if it should have ended, or if the recorder is gone."""
        if self.stopped or self.pipe.gone:
            raise Stop(0)

    # -- the end ----------------------------------------------------------------------------------

    def settle(self) -> None:
        """Send all data of all simulations that are not yet sent."""
        with self.lock:
            self._look_outside()
            self.environments.settle()
            for engine in self.engines:
                engine.settle()
            self.pipe.flush()

    def finish(self) -> None:
        """Send all unsent data, and stop watching: nothing further is recorded."""
        with self.lock:
            self.settle()
            here = current_thread()
            if any(thread.is_alive() for thread in self._threads if thread is not here):
                self.pipe.note("running")
            for engine in self.engines:
                engine.finish()
            self.on = False


def _leave(kept: ref[ScriptWatch]) -> None:
    """Stop watching in a process that a watched script has forked."""
    watch = kept()
    if watch is None or watch.is_parting:
        return
    if watch.on and getpid() != watch._process:
        watch.leave()
