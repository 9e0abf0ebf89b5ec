"""Runs a script with changes, records each run, and compares it with the unchanged run."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from drop_physics.engines.fork_server import Fork
from drop_physics.engines.script import Program, Script
from drop_physics.stages.rerun.again import Again
from drop_physics.stages.rerun.proposals import Candidate
from drop_physics.stages.rerun.reruns import Reruns
from drop_physics.stages.rerun.runs import Ended, Progress, RunsUnderWay, run_all
from drop_physics.trace.cures import ChangedRun

if TYPE_CHECKING:
    from drop_physics.recording.reader import Recording

T = TypeVar("T")


def plain(name: str) -> str:
    """Return a run's name with each character that is unsafe in file names replaced by `_`."""
    return "".join(each if each.isalnum() or each in "=.-+" else "_" for each in name)


@dataclass(frozen=True)
class RunChanged(ABC, Generic[T]):
    """Runs a script with numbered changes; picklable while no run is in progress."""

    program: Program
    candidates: Sequence[Candidate]
    folder: Path
    recording: Path
    """Path of the script's own recording."""
    base: Recording | None
    """The content of that recording; None before it is read."""
    again: Again = Again()
    """The way to run the script again without side effects."""
    drawn: bool = False
    """Whether to record also the data that only the viewer needs."""
    runs: RunsUnderWay = field(default_factory=RunsUnderWay)
    reruns: Reruns | None = None
    """The shared run from which others may be forked; None if each run starts anew."""

    def run_of(self, number: int) -> ChangedRun | None:
        """Return the changes of a numbered run; None if the engine does not support them."""
        return self.candidates[number].run

    def name_of(self, number: int) -> str:
        """Return the name of a run."""
        return self.candidates[number].intervention.call

    @abstractmethod
    def made(self, number: int, ended: Ended) -> T:
        """Return the result of a run, from its recording."""

    @abstractmethod
    def not_made(self, number: int) -> T:
        """Return the result for a run that was not made or was stopped; or raise an error."""

    @abstractmethod
    def has_failed(self, made: T) -> bool:
        """Return whether a run failed by itself, rather than being stopped by `drop`."""

    def __call__(self, number: int) -> T:
        """Make a numbered run, record it, and compare it with the unchanged run."""
        if self.run_of(number) is None or self.is_late(number):
            return self.not_made(number)
        ended, died = self._run(self.reruns or Reruns(self.program, self.again), number)
        if died:  # perhaps because it was a fork
            ended, _ = self._run(Reruns(self.program, self.again), number)
        return self.made(number, ended)

    def _run(self, reruns: Reruns, number: int) -> tuple[Ended, bool]:
        """Make a run and record it; return also whether it was a fork that died."""
        with reruns.begun(self.program_of(number), until=self.ends_by) as process:
            ended = self.recorded(process, number)
            return ended, isinstance(process, Fork) and process.has_died

    @property
    def ends_by(self) -> float | None:
        """Time at which each run is stopped, in Unix time [s]; None for no limit."""
        return None

    def is_late(self, number: int) -> bool:
        """Return whether too little time is left to start a run."""
        del number
        return False

    def stop(self) -> None:
        """Stop the run in progress."""
        self.runs.stop()

    def program_of(self, number: int) -> Program:
        """Return the program for a run: the script with its changes."""
        run = self.run_of(number)
        assert run is not None
        return self.program.changed_by(run)

    def path_of(self, number: int) -> Path:
        """Return the path of a run's recording."""
        return self.folder / f"{plain(self.name_of(number))}.rrd"

    @property
    def own(self) -> Recording:
        """Return the recording of the unchanged run."""
        from drop_physics.recording.reader import read

        return self.base or read(self.recording)

    def recorded(self, process: Script | Fork, number: int) -> Ended:
        """Record a run that has started."""
        path, name = self.path_of(number), self.name_of(number)
        return self.runs.varied(process, path, self.own, name, drawn=self.drawn)

    def finer(self, number: int) -> int:
        """Return how many engine steps make one step of the script."""
        run = self.run_of(number)
        return 1 if run is None else run.finer


def run_changed(
    work: RunChanged[T],
    numbers: Sequence[int],
    *,
    jobs: int,
    ray: str | None,
    progress: Progress,
    entered: Callable[[int, T], object] = lambda *_: None,
) -> dict[int, T]:
    """Make numbered runs in the given order, and return the result of each.

    Parameters
    ----------
    work, numbers
        The function object that makes a numbered run, and the numbers to run.
    jobs, ray
        Number of simultaneous runs on this machine; or a Ray cluster's address.
    progress
        Called with the numbers of finished, failed and all runs.
    entered
        Called with each result, as it arrives.
    """
    reruns = Reruns(work.program, work.again)
    with contextlib.nullcontext() if ray is not None else reruns:
        return run_all(
            replace(work, reruns=reruns),
            numbers,
            stop=work.stop,
            has_failed=work.has_failed,
            jobs=1 if work.again.alone else jobs,
            progress=progress,
            ray=None if ray is None else (replace(work, base=None), ray),
            entered=entered,
        )
