"""Trials that part from one second run of a script, just before the first call that differs.

What is common to all is run once: the interpreter's start, imports, loads. The run itself must be
the recorded one, to the bit; else, and where a trial cannot part, each is a run of its own.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.engines.pybullet import script as running
from drop_physics.stages.runs import Ended
from drop_physics.stages.why_trials import RunTrial, TrialRun

if TYPE_CHECKING:
    from drop_physics.recording.reader import Recording

MOST = 24
"""Trials that part from one run: each has two open files, and a process until it is read."""
WAIT_S = 0.005


def can_part(*, reaches_out: bool, ray: str | None) -> bool:
    """Return whether trials of a script can part from one run: what it opened would be shared."""
    forks = sys.platform.startswith(("linux", "darwin"))
    return forks and not reaches_out and ray is None


class Parting:
    """A second run, from which trials part.

    Parameters
    ----------
    work
        Runs a candidate on its own.
    numbers
        The candidates that may part, by number.
    process
        The run, which has begun.
    own
        What it comes to, recorded as `own.rrd`.
    """

    def __init__(
        self,
        work: RunTrial,
        numbers: Sequence[int],
        process: running.Script,
        own: Future[Ended],
    ) -> None:
        self._work, self._process, self._own = work, process, own
        self._numbers = [*numbers]
        self._stopped = False

    def __call__(self, number: int) -> TrialRun:
        """Run a candidate: as it parts, or on its own where it does not, or fails only there."""
        work = self._work
        if number in self._numbers and not work.is_late(number):
            part = self._parted(number)
            if part is not None:
                with part:
                    made = work.of_part(number, part)
                outcome = made.outcome
                if outcome is None or outcome.ended != "failed":
                    return made
        return TrialRun(None, None) if self._stopped else work(number)

    def stop(self) -> None:
        """End what runs now, and begin nothing more."""
        self._stopped = True
        self._work.runs.stop()

    def is_same(self, base: Recording) -> bool:
        """Return whether the run is the recorded one, to the bit."""
        from drop_physics.experiments.run_distance import apart
        from drop_physics.recording.reader import read

        self._process.end_parts()  # it waits for those that nobody has read
        ended = self._own.result()
        other = read(own_recording(self._work))
        steps = sum(samples - 1 for samples in base.seen.samples.values())
        same = ended.steps == steps and ended.how != "interrupted"
        return same and apart(base.seen, other.seen).same

    def _parted(self, number: int) -> running.PartedTrial | None:
        """Return a trial when it has parted; None if it does not."""
        which = self._numbers.index(number)
        trial, decoder = self._process.trials[which], self._process.decoder
        while True:
            over = bool(decoder.ended or decoder.stopped or self._own.done())
            part = self._process.part(which, trial)
            if part is not None or over:
                return part
            time.sleep(WAIT_S)


def own_recording(work: RunTrial) -> Path:
    """Return where the second run itself is recorded."""
    return work.folder / "own.rrd"


@contextmanager
def parting(work: RunTrial, numbers: Sequence[int]) -> Iterator[Parting]:
    """Begin a second run, from which candidates part."""
    able = [number for number in numbers if work.run_of(number) is not None]
    trials = [work.program_of(number) for number in able]
    program = replace(work.program, trials=trials, explain=False)
    until = time.time() + work.patience_s * (1 + len(able))

    def tell(_: float, __: int) -> None:
        if time.time() > until:
            process.stop("interrupted")

    with (
        ThreadPoolExecutor(1) as reader,
        Path(os.devnull).open("wb") as null,
        running.Script(program, stdout=null.fileno(), stderr=null.fileno(), tell=tell) as process,
    ):
        path = own_recording(work)
        own = reader.submit(work.recorded, process, path, path.stem)
        try:
            yield Parting(work, able, process, own)
        finally:
            process.end_parts()
