"""Trials that part from a run: a fork of its process just before the first call that differs.

Engine, generators, clock and inputs are the same memory in both, so nothing has to be repeated. The
child sends into a pipe of its own, from there on; what came before, the recorder has.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import random
import sys
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from .arguments import client_of, named
from .functions import MAKES_BODIES
from .intervene import Interventions, hiding

if TYPE_CHECKING:
    from .hooks import Watch

Call = Callable[..., Any]


class Forks:
    """The trials of a run.

    Parameters
    ----------
    watch
        What watches the run.
    trials
        Of each the file descriptors of its `pipe` and its `block`, and its `steps`, `variation`
        and `interventions`, as of a run of its own.
    """

    def __init__(self, watch: Watch, trials: Sequence[dict[str, Any]]) -> None:
        self._watch = watch
        self._pending = [*enumerate(trials)]
        self._children: list[int] = []
        self._is_trial = False
        self._known = Interventions([each for t in trials for each in t["interventions"]], _silent)

    def of(self, name: str, call: Call) -> Call:
        """Return what stands before a watched function, which may part here."""
        if not self._pending:
            return call

        def parting(*args: Any, **kwargs: Any) -> Any:
            if self._pending:
                arguments, client = named(name, args, kwargs), client_of(name, args, kwargs)
                for number, trial in self._differing(name, arguments, client):
                    if self._forked(number, trial):
                        return self._watch.calls_of(name)(*args, **kwargs)
            result = call(*args, **kwargs)
            if self._pending and name in MAKES_BODIES | {"connect", "resetSimulation"}:
                self._known.came(name, result if name == "connect" else client, result)
            return result

        return hiding(parting)

    def end(self) -> None:
        """Wait for the trials to end, each read by the recorder; end a trial at once.

        What else Python would do then is to free memory, which copies it in a child.
        """
        while self._children:
            os.waitpid(self._children.pop(), 0)
        if self._is_trial:
            atexit._run_exitfuncs()
            os._exit(0)

    def _differing(
        self, name: str, arguments: dict[str, Any], client: int
    ) -> list[tuple[int, dict[str, Any]]]:
        """Return the trials that differ in a call."""
        return [
            (number, trial)
            for number, trial in self._pending
            if (trial["variation"] and name == "connect")
            or any(
                name in each.get("functions", ())
                and self._known.is_about(each, name, arguments, client)
                for each in trial["interventions"]
            )
        ]

    def part(self) -> None:
        """Let the trials part in which a loaded model differs: before its first call all do."""
        for number, trial in [*self._pending]:
            loaded = not any(each.get("at_load") for each in trial["interventions"])
            if loaded and self._forked(number, trial):
                return

    def _forked(self, number: int, trial: dict[str, Any]) -> bool:
        """Part from the run; return whether this is the trial."""
        watch = self._watch
        if threading.active_count() > 1:  # others would be lost in the child
            self._pending.clear()
            return False
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(AttributeError, OSError, ValueError):  # closed, or none
                stream.flush()
        with watch.lock:
            watch.pipe.flush()
        drawn = random.getstate()  # which Python seeds anew after a fork
        watch.is_parting = True
        gc.freeze()  # collecting would copy what is shared
        try:
            child = os.fork()
        except OSError:  # too many processes
            watch.is_parting = False
            self._pending.clear()
            return False
        if not child:
            random.setstate(drawn)
            for other, each in self._pending:
                if other != number:
                    os.close(each["pipe"])
                    os.close(each["block"])
            self._pending, self._children, self._is_trial = [], [], True
            watch.become(trial, self._known.next_body)
            return True
        watch.is_parting = False
        self._children.append(child)
        self._pending.remove((number, trial))
        os.close(trial["pipe"])
        os.close(trial["block"])
        with watch.lock:
            watch.pipe.note("forked", trial=number, process=child, after=watch.pipe.sent_bytes)
            watch.pipe.flush()
        return False


def _silent(_: int) -> None:
    pass
