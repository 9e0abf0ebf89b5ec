"""Changed runs that part from one second run of a script, just before the first call that differs.

What is common to all is run once: the interpreter's start, imports, loads. The run itself must be
the recorded one, to the bit, or end at its first step where all have parted before; else, and where
one cannot part, each is a run of its own.
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
from typing import Generic, TypeVar

from drop_physics.engines import script as running
from drop_physics.stages.changed_runs import RunChanged
from drop_physics.stages.runs import Ended, Progress, run_all
from drop_physics.trace.cures import ChangedRun

T = TypeVar("T")

MOST = 24
"""Most runs that branch off from one: each has two open files, and a process until it is read."""
WAIT_S = 0.005
FORKS = sys.platform.startswith("linux")
"""Whether a process can be forked that shares nothing: only Linux shows what it has open."""


def run_changed(
    work: RunChanged[T],
    numbers: Sequence[int],
    *,
    jobs: int,
    ray: str | None,
    progress: Progress,
) -> dict[int, T]:
    """Run candidates in this order, and return what came of each by its number.

    Parameters
    ----------
    work, numbers
        What runs a candidate, and which.
    jobs, ray
        How many run at once on this machine; or a Ray cluster's address.
    progress
        Called while they run.
    """

    def run_by(runs: RunChanged[T] | Parting[T], some: Sequence[int]) -> dict[int, T]:
        return run_all(
            runs,
            some,
            stop=runs.stop,
            has_failed=work.has_failed,
            jobs=1 if work.again.alone else jobs,
            progress=progress,
            ray=None if ray is None else (replace(work, base=None), ray),
        )

    if not (work.again.parts and FORKS and ray is None):
        return run_by(work, numbers)
    done: dict[int, T] = {}
    for at in range(0, len(numbers), MOST):
        some = numbers[at : at + MOST]
        with parting(work, some) as runs:
            made = run_by(runs, some)
            same = runs.is_same()
        for number in () if same else some:
            work.path_of(number).unlink(missing_ok=True)
        done |= made if same else run_by(work, some)
    return done


class Parting(Generic[T]):
    """A second run, from which others branch off.

    Parameters
    ----------
    work
        Runs a candidate on its own.
    numbers
        The candidates that may branch off, by number.
    process
        The run, which has begun.
    own
        Its outcome, once it has ended.
    ends_early
        Whether it ends at its first step.
    """

    def __init__(
        self,
        work: RunChanged[T],
        numbers: Sequence[int],
        process: running.Script,
        own: Future[Ended],
        *,
        ends_early: bool,
    ) -> None:
        self._work, self._process, self._own = work, process, own
        self._numbers, self._ends_early = [*numbers], ends_early
        self._stopped = False

    def __call__(self, number: int) -> T:
        """Run a candidate: branched off, or on its own if that is not possible, or fails."""
        work = self._work
        if number in self._numbers and not work.is_late(number):
            part = self._parted(number)
            if part is not None:
                with part:
                    made = work.of_part(number, part)
                if not work.has_failed(made):
                    return made
                work.path_of(number).unlink(missing_ok=True)
        return work.not_made(number) if self._stopped else work(number)

    def stop(self) -> None:
        """Stop the run under way, and begin no other."""
        self._stopped = True
        self._work.stop()

    def is_same(self) -> bool:
        """Return whether the run repeats the recorded one to the bit, as far as it goes."""
        from drop_physics.experiments.run_distance import apart
        from drop_physics.recording.reader import read

        self._process.end_parts()  # it waits for those that nobody has read
        ended = self._own.result()
        if self._ends_early:
            return True
        base, path = self._work.own, self._work.path_of(None)
        steps = sum(samples - 1 for samples in base.seen.samples.values())
        same = ended.steps == steps and ended.how != "interrupted"
        return same and apart(base.seen, read(path).seen).same

    def _parted(self, number: int) -> running.PartedTrial | None:
        """Return the run of a candidate once it has branched off; None if it does not."""
        which = self._numbers.index(number)
        trial, decoder = self._process.trials[which], self._process.decoder
        while True:
            over = bool(decoder.ended or decoder.stopped or self._own.done())
            part = self._process.part(which, trial)
            if part is not None or over:
                return part
            time.sleep(WAIT_S)


@contextmanager
def parting(work: RunChanged[T], numbers: Sequence[int]) -> Iterator[Parting[T]]:
    """Begin a second run, from which candidates branch off."""
    runs = {number: work.run_of(number) for number in numbers}
    able = [n for n, run in runs.items() if run is not None and "draws" not in run.below]
    early = all(map(parts_first, runs.values()))
    program = replace(
        work.program,
        trials=[work.program_of(number) for number in able],
        explain=False,
        steps=1 if early else work.program.steps,
    )
    finer = max((work.finer(number) for number in able), default=1)
    until = time.time() + work.again.patience_s(finer) * (1 + len(able))

    def tell(_: float, __: int) -> None:
        if time.time() > until:
            process.stop("interrupted")

    with (
        ThreadPoolExecutor(1) as reader,
        Path(os.devnull).open("wb") as null,
        work.again.ready(program, finer=finer) as ready,
        running.Script(ready, stdout=null.fileno(), stderr=null.fileno(), tell=tell) as process,
    ):
        own = reader.submit(work.recorded, process, None)
        try:
            yield Parting(work, able, process, own, ends_early=early)
        finally:
            process.end_parts()
            work.path_of(None).unlink(missing_ok=True)


def parts_first(run: ChangedRun | None) -> bool:
    """Return whether a run differs before its first step, from the connection to an engine on."""
    if run is None or run.below:
        return True
    return any("connect" in each.get("functions", ()) for each in run.operations)
