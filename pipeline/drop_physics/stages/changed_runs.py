"""Runs of a script with something changed, each recorded and compared with the script's own."""

from __future__ import annotations

import hashlib
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from drop_physics.engines.script import PartedTrial, Program, Script
from drop_physics.stages.again import Again
from drop_physics.stages.proposals import Candidate
from drop_physics.stages.runs import Ended, RunsUnderWay
from drop_physics.trace.cures import ChangedRun

if TYPE_CHECKING:
    from drop_physics.recording.reader import Recording

T = TypeVar("T")

SECOND = "own"
"""Name of a second, unchanged run of the script, from which others branch off."""


def plain(name: str) -> str:
    """Return the name of a run with the characters that a file name may have."""
    return "".join(each if each.isalnum() or each in "=.-+" else "_" for each in name)


@dataclass(frozen=True)
class RunChanged(ABC, Generic[T]):
    """Runs one candidate, given its number; picklable while no run is under way."""

    program: Program
    candidates: Sequence[Candidate]
    folder: Path
    recording: Path
    """The recording of the script's own run."""
    base: Recording | None
    """The same recording, read; None if it is still to be read."""
    again: Again = Again()
    """How the script is run again."""
    drawn: bool = False
    """Whether to record what only the viewer needs, too."""
    runs: RunsUnderWay = field(default_factory=RunsUnderWay)

    def run_of(self, number: int) -> ChangedRun | None:
        """Return the changes of a run; None if the engine does not support them."""
        return self.candidates[number].run

    def name_of(self, number: int) -> str:
        """Return the name of a run."""
        return self.candidates[number].intervention.call

    @abstractmethod
    def made(self, number: int, ended: Ended) -> T:
        """Return the result of a run, from its recording."""

    @abstractmethod
    def not_made(self, number: int) -> T:
        """Return the result of a run that was not made, or was stopped, or raise an error."""

    @abstractmethod
    def has_failed(self, made: T) -> bool:
        """Return whether a run failed by itself."""

    def __call__(self, number: int) -> T:
        """Run a candidate, record it, and compare it with the script's own run."""
        if self.run_of(number) is None or self.is_late(number):
            return self.not_made(number)
        until, finer = self._until(number), self.finer(number)
        with ExitStack() as stack:
            program = stack.enter_context(self.again.ready(self.program_of(number), finer=finer))
            null = stack.enter_context(Path(os.devnull).open("wb")).fileno()

            def tell(_: float, __: int) -> None:
                if time.time() > until:
                    process.stop("interrupted")

            process = stack.enter_context(Script(program, stdout=null, stderr=null, tell=tell))
            ended = self.recorded(process, number)
        return self.made(number, ended)

    def of_part(self, number: int, part: PartedTrial) -> T:
        """Record a candidate that branched off from another run, and compare it."""
        until = self._until(number)
        part.tell = lambda: part.stop("interrupted") if time.time() > until else None
        return self.made(number, self.recorded(part, number))

    def is_late(self, number: int) -> bool:
        """Return whether there is no time left to begin a candidate."""
        del number
        return False

    def stop(self) -> None:
        """Stop the run under way."""
        self.runs.stop()

    def program_of(self, number: int) -> Program:
        """Return the program to run for a candidate that the engine supports."""
        run = self.run_of(number)
        assert run is not None
        variation, seed = dict(run.below), self.program.seed
        if "draws" in variation:
            draws = variation.pop("draws")
            seed = (seed or 0) + 1 if draws is None else draws
        return replace(
            self.program, variation=variation or None, interventions=run.operations, seed=seed
        )

    def path_of(self, number: int | None) -> Path:
        """Return the path of a run's recording; None stands for the second, unchanged run."""
        name = SECOND if number is None else self.name_of(number)
        return self.folder / f"{plain(name)}.rrd"

    def id_of(self, name: str) -> str:
        """Return the id of a run's recording."""
        return hashlib.sha256(f"{self.own.recording_id} {name}".encode()).hexdigest()[:32]

    @property
    def own(self) -> Recording:
        """Return the script's own run."""
        from drop_physics.recording.reader import read

        return self.base or read(self.recording)

    def recorded(self, process: Script | PartedTrial, number: int | None) -> Ended:
        """Record a run that has begun; None stands for the unchanged one."""
        name = SECOND if number is None else self.name_of(number)
        return self.runs.recorded(
            process,
            self.path_of(number),
            origin={**self.own.origin, "variation": name},
            recording_id=self.id_of(name),
            drawn=self.drawn,
        )

    def finer(self, number: int) -> int:
        """Return the number of engine steps per step of the script."""
        run = self.run_of(number)
        return 1 if run is None else run.finer

    def _until(self, number: int) -> float:
        return time.time() + self.again.patience_s(self.finer(number))
