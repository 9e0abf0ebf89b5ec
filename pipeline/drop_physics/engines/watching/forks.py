"""Trials that part from a run: a fork of its process just before the first call that differs.

Engine, generators, clock and inputs are the same memory in both, so nothing has to be repeated. The
child sends into a pipe of its own, from there on; what came before, the recorder has. It shares no
file with the run: what it writes is in a layer of its own (`private`), its descriptors are its own
(`descriptors`), and its standard output goes nowhere.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import os
import random
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from . import descriptors, limits

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
        if descriptors.shared(self._ours(), watch.pipe.inode_of_block):
            self.pending.clear()  # each is a run from the start, then
        if (number, trial) not in self.pending:
            return False
        gc.unfreeze()
        descriptors.flush()
        with watch.lock:
            watch.pipe.flush()
        drawn = random.getstate()  # which Python seeds anew after a fork
        watch.is_parting = True
        gc.freeze()  # collecting would copy what is shared
        waits, ready = os.pipe()
        child = -1
        with contextlib.suppress(OSError):  # too many processes
            child = os.fork()
        if not child:
            os.close(waits)
            with _ending_where_it_fails():
                self._begin(number, ready)
            random.setstate(drawn)
            watch.become(trial)
            return True
        watch.is_parting = False
        os.close(ready)
        begun = child > 0 and os.read(waits, 1)
        os.close(waits)
        if not begun:
            self.pending.clear()
            return False
        self._children.append(child)
        self.pending.remove((number, trial))
        os.close(trial["pipe"])
        os.close(trial["block"])
        with watch.lock:
            watch.pipe.note("forked", trial=number, process=child, after=watch.pipe.sent_bytes)
            watch.pipe.flush()
        return False

    def _begin(self, number: int, ready: int) -> None:
        """Share nothing with the run that this process was forked from, which waits until then."""
        limits.lead_a_group()
        for other, each in self.pending:
            if other != number:
                os.close(each["pipe"])
                os.close(each["block"])
        trial = self.trials[number]
        self.pending, self._children, self._is_trial = [], [], True
        private = self._watch.private
        if private is not None:
            private.part(str(number))
        printed = os.open(os.devnull, os.O_WRONLY)
        ours = {*self._ours(), trial["pipe"], trial["block"], ready, printed}
        descriptors.replace(ours, private, printed)
        os.close(printed)
        os.write(ready, b"1")
        os.close(ready)

    def _ours(self) -> set[int]:
        """Return the descriptors that the script has not opened."""
        of_trials = (each[name] for _, each in self.pending for name in ("pipe", "block"))
        return {self._watch.pipe.descriptor, *of_trials}


@contextlib.contextmanager
def _ending_where_it_fails() -> Iterator[None]:
    """End this process, which has just been forked, where something fails: its parent sees that."""
    try:
        yield
    except BaseException:  # noqa: BLE001 - the script must not go on
        os._exit(1)
