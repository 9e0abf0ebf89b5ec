"""Executes a script's runs in a folder, and resumes after an interruption.

`trust` and sweeps use it. Rerun and polars are imported inside functions, so that they load while
the script starts.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import TypeAdapter

from drop_physics.engines.reached import Reached
from drop_physics.errors import DropError, OutputError, RecordingError
from drop_physics.files.outputs import make_folder
from drop_physics.files.whole import lock, opened, written_whole
from drop_physics.messages import Message
from drop_physics.stages.program import STOPPED, digest_of_script
from drop_physics.stages.rerun.again import Again, again_of
from drop_physics.stages.rerun.changed import RunChanged, plain, run_changed
from drop_physics.stages.rerun.no_step import no_step
from drop_physics.stages.rerun.runs import Ended, Progress, RunsUnderWay, id_of, only_of
from drop_physics.workers import cores

if TYPE_CHECKING:
    from drop_physics.engines.script import Program
    from drop_physics.experiments.run_distance import Apart
    from drop_physics.recording.reader import Recording

T = TypeVar("T")

BASE = "base"
"""Name of the script's own run among the variations."""
MOST_BYTES = 1 << 16
"""Largest file of notes that is read [bytes]."""
MOST_EXPLAINED = 20_000
"""Largest number of steps before a difference that are explained to find the responsible term."""


@dataclass(frozen=True)
class Made:
    """A completed run, with its recording."""

    name: str
    recording: Path
    ended: str
    error: str
    steps: int
    """Number of steps that the script made."""
    engine: str
    """The engine that made the run's steps."""


@dataclass(frozen=True)
class Varied:
    """A run with a variation, and its distance from the unchanged run."""

    made: Made
    apart: Apart
    term: str | None
    """The term of the sum in which the runs first differ."""

    @property
    def name(self) -> str:
        """The name of the variation."""
        return self.made.name

    @property
    def recording(self) -> Path:
        """Path of the run's recording."""
        return self.made.recording


@dataclass(frozen=True)
class RunKept(RunChanged[T]):
    """Executes numbered runs, except those whose recordings already exist."""

    @abstractmethod
    def compared(self, number: int, other: Recording) -> T:
        """Return the result for a run, from its recording."""

    def not_made(self, number: int) -> T:
        """Raise the error for a stopped run, which says how to resume."""
        raise DropError(
            "{name} was interrupted; run the same command again", name=self.name_of(number)
        )

    def __call__(self, number: int) -> T:
        """Return the result for a run; execute the run unless its recording exists."""
        path, name = self.path_of(number), self.name_of(number)
        if not os.path.lexists(path):
            return super().__call__(number)
        return self.compared(number, whole(path, id_of(self.own, name)))

    def made(self, number: int, ended: Ended) -> T:
        """Compare a run's recording with the unchanged run, and return the result."""
        from drop_physics.recording.reader import read

        if ended.how == "interrupted":
            return self.not_made(number)
        return self.compared(number, read(self.path_of(number)))


@dataclass(frozen=True)
class RunVariation(RunKept[Varied]):
    """Executes numbered variations, and compares each with the unchanged run."""

    def has_failed(self, made: Varied) -> bool:
        """Return whether a run failed by itself, and was not stopped by drop."""
        return made.made.ended == "failed"

    def compared(self, number: int, other: Recording) -> Varied:
        """Compare a variation's recording with the unchanged run."""
        from drop_physics.experiments.first_term import first_term
        from drop_physics.experiments.run_distance import apart
        from drop_physics.stages.analyze.explaining import WhatToExplain, explained

        base, finer = self.own, self.finer(number)
        with np.errstate(all="ignore"):  # of states that are not finite
            found = apart(base.seen, other.seen, finer=finer)
            until = None if found.first is None else found.first.from_step
            until = 0 if until is None or until > MOST_EXPLAINED else until + 1
            mine, theirs = (
                explained(each, WhatToExplain([(0, until * steps)])).recording.seen
                if until
                else each.seen
                for each, steps in ((base, 1), (other, finer))
            )
            term = first_term(mine, theirs, found, finer=finer)
        return Varied(made_of(self.name_of(number), other, finer=finer), found, term)


def made_of(name: str, recording: Recording, *, finer: int = 1) -> Made:
    """Describe a recorded run, in which `finer` engine steps make one step of the script."""
    steps = sum(samples - 1 for samples in recording.seen.samples.values()) // finer
    ended = recording.ended or {}
    return Made(
        name,
        recording.path,
        str(ended["ended"]),
        str(ended.get("error") or ""),
        steps,
        recording.seen.engine,
    )


def run_kept(work: RunKept[T], *, jobs: int | None, ray: str | None, progress: Progress) -> list[T]:
    """Execute all runs, the longest first, and return their results in order."""
    numbers = range(len(work.candidates))
    order = sorted(numbers, key=lambda number: -work.finer(number))
    try:
        done = run_changed(work, order, jobs=jobs or cores(), ray=ray, progress=progress)
    except BaseException as stop:
        stop.add_note(Message("run the same command again to resume it"))
        raise
    return [done[number] for number in numbers]


@dataclass(frozen=True)
class FirstRun:
    """Notes on the unchanged run, stored next to its recording."""

    reached: Reached
    took_s: float
    """Duration of the run [s]."""


# -- the folder -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunFolder:
    """A folder with the recordings of a script's runs, each complete or absent.

    Parameters
    ----------
    path
        The path of the folder.
    identity
        The settings that determine the runs, as far as they are known in advance.
    force
        Whether existing runs are replaced.
    described
        Name of the file that states to which runs the folder belongs.
    reads
        Whether existing results may be read without executing any run.
    """

    path: Path
    identity: Mapping[str, Any]
    force: bool = False
    described: str = "trust.json"
    reads: bool = False
    runs: RunsUnderWay = field(default_factory=RunsUnderWay, compare=False)
    """The runs in progress in this process."""

    @contextlib.contextmanager
    def claimed(self, names: Iterable[str]) -> Iterator[None]:
        """Lock the folder for runs with the given names, until the `with` block ends.

        Raises
        ------
        OutputError
            If the folder contains other files, is in use, or cannot be written to.
        """
        make_folder(self.path)
        with opened(self.path / ".lock") as handle:
            lock(
                handle,
                Message(
                    "another command is writing to {folder}; wait, or choose another --out",
                    folder=self.path,
                ),
            )
            known = self._known()
            ours = known is not None and {**known, "finished": False} == self._described(False)
            resumes = ours and known is not None and (self.reads or not known["finished"])
            recordings = [*map(self.recording, names)]
            there = [each for each in (self._description, *recordings) if os.path.lexists(each)]
            if there and not (resumes or self.force):
                if ours:
                    raise OutputError(
                        "{folder} has the runs of this command already; run them again with "
                        "--force, or choose another --out",
                        folder=self.path,
                    )
                raise OutputError(
                    "{folder} has files of something else; replace them with --force, or choose "
                    "another --out",
                    folder=self.path,
                )
            if self.force or not resumes:
                for recording in recordings:
                    recording.unlink(missing_ok=True)
            self._describe(finished=False)
            yield
            self._describe(finished=True)

    def recording(self, name: str) -> Path:
        """Return the path of a run's recording."""
        return self.path / f"{plain(name)}.rrd"

    def begun(
        self,
        program: Program,
        *,
        anyway: bool,
        stdout: int,
        note: Callable[[str], None] = lambda _: None,
    ) -> tuple[Recording, Program, Again]:
        """Execute and record the unchanged run, or read its recording if that exists.

        Also returns the program limited to the steps made, and how it can be run again; `anyway`
        even if a repetition may have side effects.

        Raises
        ------
        DropError
            If the run is interrupted, cannot be started, or makes no step.
        OutputError
            If the recording is damaged, or is not of this run.
        """
        path, two = self.recording(BASE), False
        if not os.path.lexists(path):
            began = time.monotonic()
            ended = self.runs.record(
                replace(program, listens=True),
                path,
                origin={key: value for key, value in self.identity.items() if key != "python"},
                recording_id=self.id,
                stdout=stdout,
                drawn=True,
            )
            if ended.how == "interrupted":
                raise DropError("{name} was interrupted; run the same command again", name=BASE)
            two = bool(ended.also_steps)
            first = FirstRun(ended.reached, time.monotonic() - began)
            with written_whole(self._first_run, force=True, ours=True) as file:
                file.write(TypeAdapter(FirstRun).dump_json(first, indent=2) + b"\n")
        base = whole(path, self.id)
        if two:
            note(only_of(base.seen.engine))
        made = made_of(BASE, base)
        if not made.steps:
            raise no_step(program.target, str((base.ended or {}).get("ended", "")))
        first = self._read_first_run()
        again = again_of(
            program.target,
            first.reached,
            is_module=program.is_module,
            took_s=first.took_s,
            anyway=anyway,
        )
        steps = made.steps + (made.ended not in STOPPED)
        return base, replace(program, steps=steps, of_first=True, duration_s=None), again

    @property
    def id(self) -> str:
        """Return the recording id of the unchanged run, from which others are derived."""
        text = json.dumps(self.identity, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def _first_run(self) -> Path:
        return self.path / "first-run.json"

    def _read_first_run(self) -> FirstRun:
        """Return the stored notes on the unchanged run.

        Raises
        ------
        OutputError
            If the notes were modified.
        """
        try:
            return TypeAdapter(FirstRun).validate_json(self._first_run.read_bytes())
        except (OSError, ValueError):
            raise altered(self._first_run) from None

    @property
    def _description(self) -> Path:
        return self.path / self.described

    def _described(self, finished: bool) -> dict[str, Any]:
        return {**self.identity, "finished": finished}

    def _describe(self, *, finished: bool) -> None:
        with written_whole(self._description, force=True, ours=True) as file:
            file.write(json.dumps(self._described(finished), indent=2).encode() + b"\n")

    def _known(self) -> dict[str, Any] | None:
        try:
            with self._description.open("rb") as file:
                known = json.loads(file.read(MOST_BYTES))
            return known if isinstance(known, dict) else None
        except (OSError, ValueError, RecursionError):
            return None


def whole(path: Path, recording_id: str) -> Recording:
    """Read and check the recording of an earlier run.

    Raises
    ------
    OutputError
        If the recording is damaged, or has another id.
    """
    from drop_physics.recording.reader import read

    with contextlib.suppress(RecordingError):
        recording = read(path)
        if recording.recording_id == recording_id:
            return recording
    raise altered(path)


def altered(path: Path) -> OutputError:
    """Return the error for a file in the folder that was modified."""
    return OutputError(
        "{path} was altered or replaced after it was written; run all again with --force",
        path=path,
    )


def identity_of(program: Program) -> dict[str, Any]:
    """Return all settings that determine a program's runs, as far as known in advance."""
    target = program.target
    return {
        "kind": "script",
        "script": f"-m {target}" if program.is_module else Path(target).name,
        "script_sha256": digest_of_script(target, is_module=program.is_module),
        "arguments": [*program.arguments] or None,
        "seed": program.seed,
        "steps": program.steps,
        "duration_s": program.duration_s,
        "drop_version": metadata.version("drop-physics"),
        "python": program.python,
    }
