"""The runs of `drop trust`: the script's own and its variations, recorded in a folder that resumes.

Rerun and polars are imported where they are used: the script starts while they load.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics.errors import DropError, OutputError, RecordingError
from drop_physics.files.outputs import make_folder
from drop_physics.files.whole import lock, opened, written_whole
from drop_physics.messages import Message
from drop_physics.stages.program import digest_of_script
from drop_physics.stages.runs import Progress, RunsUnderWay, run_all
from drop_physics.workers import cores

if TYPE_CHECKING:
    from drop_physics.engines.pybullet.script import Program
    from drop_physics.experiments.run_distance import Apart
    from drop_physics.recording.reader import Recording

BASE = "base"
"""The script's own run, among the variations."""
MOST_BYTES = 1 << 16
"""Largest size of a description."""


@dataclass(frozen=True)
class Made:
    """A run that was recorded."""

    name: str
    recording: Path
    ended: str
    error: str
    steps: int
    """Steps that the script made."""
    engine: str
    """The engine that steps it."""


@dataclass(frozen=True)
class Varied:
    """A run with a variation, and how far it is from the script's own."""

    made: Made
    apart: Apart
    term: str | None
    """The term of the sum that made them differ first."""

    @property
    def name(self) -> str:
        """Return the name of the variation."""
        return self.made.name

    @property
    def recording(self) -> Path:
        """Return the recording of the run."""
        return self.made.recording


@dataclass(frozen=True)
class RunVariation:
    """Runs one variation, called with its number; picklable."""

    program: Program
    variations: Mapping[str, Mapping[str, Any]]
    folder: TrustFolder
    base: Recording | None = None
    """The script's own run; None where it is to be read."""

    def __call__(self, number: int) -> Varied:
        """Run a variation, record it, and compare it with the script's own run."""
        from drop_physics.experiments.first_term import first_term
        from drop_physics.experiments.run_distance import apart
        from drop_physics.recording.reader import read

        name, given = [*self.variations.items()][number]
        finer = given.get("finer", 1)
        other = self.folder.found(name)
        if other is None:
            variation = {key: value for key, value in given.items() if key != "draws"}
            program = replace(self.program, variation=variation)
            if "draws" in given:
                seed = given["draws"]
                program = replace(program, seed=(program.seed or 0) + 1 if seed is None else seed)
            with Path(os.devnull).open("wb") as null:
                self.folder.run(name, program, stdout=null.fileno(), stderr=null.fileno())
            other = read(self.folder.recording(name))
        base = self.base or read(self.folder.recording(BASE))
        with np.errstate(all="ignore"):  # of states that are not finite
            found = apart(base.seen, other.seen, finer=finer)
            term = first_term(base.seen, other.seen, found, finer=finer)
        return Varied(made_of(name, other, finer=finer), found, term)


def made_of(name: str, recording: Recording, *, finer: int = 1) -> Made:
    """Return what a run was, of its recording with so many steps for one of the script's."""
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


def run_varied(
    work: RunVariation, *, jobs: int | None, ray: str | None, progress: Progress
) -> dict[str, Varied]:
    """Run the variations, those with the most steps first, and return them in order."""
    numbers = range(len(work.variations))
    steps = [each.get("finer", 1) for each in work.variations.values()]
    done = run_all(
        work,
        sorted(numbers, key=lambda number: -steps[number]),
        stop=work.folder.runs.stop,
        has_failed=lambda varied: varied.made.ended == "failed",
        jobs=jobs or cores(),
        progress=progress,
        ray=None if ray is None else (replace(work, base=None), ray),
    )
    return {done[number].name: done[number] for number in numbers}


# -- the folder -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class TrustFolder:
    """The recordings of a script's runs: each whole, with an id of its own, or not there.

    Parameters
    ----------
    path
        The folder.
    identity
        What determines the runs, as far as it is known before.
    force
        Whether what is there is replaced.
    """

    path: Path
    identity: Mapping[str, Any]
    force: bool = False
    runs: RunsUnderWay = field(default_factory=RunsUnderWay, compare=False)
    """What runs now in this process."""

    @contextlib.contextmanager
    def claimed(self, names: Iterable[str]) -> Iterator[None]:
        """Claim the folder for runs of these names, and lock out others while the block runs.

        Raises
        ------
        OutputError
            If it holds something else, is in use, or cannot be written.
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
            resumes = ours and known is not None and not known["finished"]
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
                for each in recordings:
                    each.unlink(missing_ok=True)
            self._describe(finished=False)
            yield
            self._describe(finished=True)

    def recording(self, name: str) -> Path:
        """Return the recording of a run."""
        plain = "".join(each if each.isalnum() or each in "=.-+" else "_" for each in name)
        return self.path / f"{plain}.rrd"

    def found(self, name: str) -> Recording | None:
        """Return a run that is there.

        Raises
        ------
        OutputError
            If its recording is another, or damaged.
        """
        from drop_physics.recording.reader import read

        path = self.recording(name)
        if not os.path.lexists(path):
            return None
        with contextlib.suppress(RecordingError):
            recording = read(path)
            if recording.recording_id == self._id(name):
                return recording
        raise OutputError(
            "{path} was altered or replaced after it was written; run all again with --force",
            path=path,
        )

    def run(self, name: str, program: Program, *, stdout: int, stderr: int | None = None) -> int:
        """Run and record a program, and return how many steps it made.

        What is only for looking is recorded of the script's own run alone.

        Raises
        ------
        DropError
            If it is interrupted, or cannot be started.
        """
        variation = {} if name == BASE else {"variation": name}
        origin = {key: value for key, value in self.identity.items() if key != "python"}
        ended = self.runs.record(
            program,
            self.recording(name),
            origin={**origin, **variation},
            recording_id=self._id(name),
            stdout=stdout,
            stderr=stderr,
            drawn=name == BASE,
        )
        if ended.how == "interrupted":
            raise DropError("{name} was interrupted; run the same command again", name=name)
        return ended.steps

    def _id(self, name: str) -> str:
        text = json.dumps([self.identity, name], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def _description(self) -> Path:
        return self.path / "trust.json"

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


def identity_of(program: Program) -> dict[str, Any]:
    """Return what determines the runs of a program, as far as it is known before."""
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
