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

if TYPE_CHECKING:
    from .host import ScriptWatch


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

    def __init__(self, watch: ScriptWatch, trials: Sequence[dict[str, Any]]) -> None:
        self._watch, self.trials = watch, trials
        self.pending = [*enumerate(trials)]
        """Those that have not parted, by number."""
        self._children: list[int] = []
        self._is_trial = False

    def part(self, differs: Callable[[dict[str, Any]], bool]) -> bool:
        """Let trials part before a call in which they differ; return whether this is one now."""
        return any(self._forked(*each) for each in [*self.pending] if differs(each[1]))

    def end(self) -> None:
        """Wait for the trials to end, each read by the recorder; end a trial at once.

        What else Python would do then is to free memory, which copies it in a child.
        """
        while self._children:
            os.waitpid(self._children.pop(), 0)
        if self._is_trial:
            atexit._run_exitfuncs()
            os._exit(0)

    def _forked(self, number: int, trial: dict[str, Any]) -> bool:
        """Part from the run; return whether this is the trial."""
        watch = self._watch
        if threading.active_count() > 1:  # others would be lost in the child
            self.pending.clear()
        if (number, trial) not in self.pending:
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
            self.pending.clear()
            return False
        if not child:
            random.setstate(drawn)
            for other, each in self.pending:
                if other != number:
                    os.close(each["pipe"])
                    os.close(each["block"])
            self.pending, self._children, self._is_trial = [], [], True
            watch.become(trial)
            return True
        watch.is_parting = False
        self._children.append(child)
        self.pending.remove((number, trial))
        os.close(trial["pipe"])
        os.close(trial["block"])
        with watch.lock:
            watch.pipe.note("forked", trial=number, process=child, after=watch.pipe.sent_bytes)
            watch.pipe.flush()
        return False
