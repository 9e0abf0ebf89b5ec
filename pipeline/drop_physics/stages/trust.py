"""Run a script again with variations, and tell what of its result stands."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from drop_physics.analysis.answers.answer import Finding
from drop_physics.analysis.apart import Apart, apart
from drop_physics.analysis.first_term import first_term
from drop_physics.analysis.standing import (
    Converging,
    Growth,
    Standing,
    converging,
    geometric,
    growth,
    standing,
)  # fmt: skip
from drop_physics.engines.bullet import script as running
from drop_physics.engines.bullet.script import Program
from drop_physics.errors import DropError, OutputError, RecordingError
from drop_physics.files.outputs import make_folder
from drop_physics.files.whole import lock, opened, written_whole
from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.reader import Recording, read
from drop_physics.recording.recorder import Recorder
from drop_physics.shown import Shown
from drop_physics.stages.record import (
    SEEDED_CLOCK_S,
    STOPPED,
    checked_limits,
    digest_of_script,
    written,
)
from drop_physics.stages.trust_findings import findings_of
from drop_physics.stages.trust_outputs import check_outputs, write_outputs
from drop_physics.stages.variations import variations_of
from drop_physics.sweeping import engines
from drop_physics.workers import cores

BASE = "base"
"""The script's own run, among the variations."""
MOST_BYTES = 1 << 16
"""Of a description."""

Progress = Callable[[int, int, int], None]
"""Called with the number of runs that are done, of those that failed, and of all."""


@dataclass(frozen=True)
class Made:
    """A run that was recorded."""

    name: str
    recording: Path
    ended: str
    error: str
    steps: int
    """Of the script."""


@dataclass(frozen=True)
class Varied:
    """A run with a variation, and how far it is from the script's own."""

    made: Made
    apart: Apart
    term: str | None
    """Of the sum: which made them differ first."""

    @property
    def name(self) -> str:
        """Of the variation."""
        return self.made.name

    @property
    def recording(self) -> Path:
        """Of the run."""
        return self.made.recording


@dataclass(frozen=True)
class Trust(Shown, lines_of="drop_physics.console.show_trust:trust_lines"):
    """What of a script's result stands."""

    script: str
    made: Made
    """Its own run."""
    variations: list[Varied]
    standing: list[Standing]
    """Of each position that matters, the least first."""
    growth: Growth | None
    """Of the nudge; None where it does not grow, or was left out."""
    converging: list[Converging]
    """Of each end position that depends on the timestep, where three of them were run."""
    findings: list[Finding]

    @property
    def recording(self) -> Path:
        """Of its own run."""
        return self.made.recording

    def ends_within(self, lengths: Mapping[str, float]) -> bool:
        """Return whether all variations end as near as that, by unit, and none fails."""
        if any(each.made.ended == "failed" != self.made.ended for each in self.variations):
            return False
        ends = [end for each in self.variations for end in each.apart.end]
        return all(end.value <= lengths[end.unit] for end in ends if end.unit in lengths)


@dataclass(frozen=True)
class RunVariation:
    """Runs one variation, called with its number; picklable."""

    program: Program
    variations: Mapping[str, Mapping[str, Any]]
    folder: TrustFolder

    def __call__(self, number: int) -> Varied:
        """Run a variation, record it, and compare it with the script's own run."""
        name, given = [*self.variations.items()][number]
        finer = given.get("finer", 1)
        if not self.folder.has(name):
            variation = {key: value for key, value in given.items() if key != "draws"}
            program = replace(self.program, variation=variation)
            if "draws" in given:
                seed = given["draws"]
                program = replace(program, seed=(program.seed or 0) + 1 if seed is None else seed)
            with Path(os.devnull).open("wb") as null:
                self.folder.run(name, program, stdout=null.fileno(), stderr=null.fileno())
        base, other = (read(self.folder.recording(each)) for each in (BASE, name))
        with np.errstate(all="ignore"):  # of states that are not finite
            found = apart(base.seen, other.seen, finer=finer)
            term = first_term(base.seen, other.seen, found, finer=finer)
        return Varied(_made(name, other, finer=finer), found, term)


def _made(name: str, recording: Recording, *, finer: int = 1) -> Made:
    steps = sum(samples - 1 for samples in recording.seen.samples.values()) // finer
    ended = recording.ended or {}
    return Made(name, recording.path, str(ended["ended"]), str(ended.get("error") or ""), steps)


def trust(
    target: str,
    arguments: Sequence[str] = (),
    *,
    out: Path | str | None = None,
    vary: Sequence[str] | None = None,
    is_module: bool = False,
    steps: int | None = None,
    duration_s: float | None = None,
    seed: int = 0,
    python: str | None = None,
    jobs: int | None = None,
    ray: str | None = None,
    force: bool = False,
    stdout: int = 1,
    table: Path | str | None = None,
    plot: Path | str | None = None,
    dark: bool = False,
    progress: Progress = lambda *_: None,
) -> Trust:
    """Run a script as it is and with variations, and compare them.

    Parameters
    ----------
    target, arguments, is_module
        The script's path or a module's name, and its arguments.
    out
        The folder for the recordings; None for one in `recordings`, under the script's name. What
        an interrupted call of the same has finished there is not run again.
    vary
        In place of the usual variations: texts such as `timestep/8`, `nudge` or `mass=0.9,1.1`, as
        `--vary` takes them.
    steps, duration_s, seed
        As of `record_script`; all runs but `seed` have the same seed.
    python
        The interpreter that runs it; None for the current one.
    jobs, ray
        Processes on this machine, None for one per core; or a Ray cluster's address.
    force
        Whether all is run again, and what is in the folder is replaced.
    stdout
        File descriptor of the script's standard output, in its own run.
    table
        A `.csv` or `.parquet` file for all distances, a row per variation and position, or None.
    plot
        A `.png` or `.svg` file for a plot of the distances over time, or None.
    dark
        Whether the plot is for a dark page.
    progress
        Called while it runs.

    Raises
    ------
    ScenarioError
        If a limit or a variation is out of range.
    OutputError
        If the folder holds something else, or cannot be written.
    DropError
        If the interpreter cannot be started, or the script makes no step.
    """
    steps, duration_s, _ = checked_limits(steps, duration_s, seed)
    variations = variations_of(vary)
    outputs = [None if each is None else Path(each) for each in (table, plot)]
    check_outputs(target, *outputs, is_module=is_module, force=force)
    program = Program(
        target, tuple(map(str, arguments)), python or sys.executable, is_module, steps, duration_s,
        seed=seed, begins_s=SEEDED_CLOCK_S,
    )  # fmt: skip
    place = Path("recordings") / f"{Path(target).stem}-trust" if out is None else Path(out)
    folder = TrustFolder(place.resolve(), _identity(program), force)
    with folder.claimed((BASE, *variations)):
        steps = folder.run(BASE, program, stdout=stdout)
        if not steps:
            raise DropError(
                "{script} makes no step, so there is nothing to compare; give it the arguments "
                "with which it steps",
                script=target,
            )
        base = _made(BASE, read(folder.recording(BASE)))
        most = steps if base.ended in STOPPED else steps + 1
        work = RunVariation(replace(program, steps=most, duration_s=None), variations, folder)
        try:
            varied = _run(work, jobs=jobs, ray=ray, progress=progress)
        except BaseException as stop:
            stop.add_note(Message("run the same command again to resume it"))
            raise
    result = _trust(target, base, varied, variations)
    write_outputs(result, *outputs, dark=dark, force=force)
    return result


def _run(
    work: RunVariation, *, jobs: int | None, ray: str | None, progress: Progress
) -> dict[str, Varied]:
    """Run the variations, and return them in order."""
    numbers, jobs = range(len(work.variations)), min(jobs or cores(), len(work.variations))
    steps = [each.get("finer", 1) for each in work.variations.values()]
    longest = sorted(numbers, key=lambda number: -steps[number])
    runs = (
        engines.on_ray(work, longest, address=ray) if ray is not None
        else engines.in_this_process(work, longest) if jobs == 1
        else engines.in_processes(work, longest, jobs=jobs)
    )  # fmt: skip
    done: dict[int, Varied] = {}
    progress(0, 0, len(numbers))
    with contextlib.closing(runs) as finished:
        for number, varied in finished:
            done[number] = varied
            failed = sum(each.made.ended == "failed" for each in done.values())
            progress(len(done), failed, len(numbers))
    return {done[number].name: done[number] for number in numbers}


def _trust(
    target: str,
    base: Made,
    varied: dict[str, Varied],
    variations: Mapping[str, Mapping[str, Any]],
) -> Trust:
    for name, given in variations.items():
        if given == {"draws": None} and varied[name].apart.same:  # it draws none
            del varied[name]
    nudge = next((name for name in varied if "nudge" in variations[name]), None)
    grown = nudge and growth(varied[nudge].apart, variations[nudge]["nudge"])
    finer = {variations[name].get("finer", 1): each for name, each in varied.items()
        if "finer" in variations[name]}  # fmt: skip
    three = geometric([*finer])
    found = []
    if three is not None:
        runs = [None if each == 1 else finer[each].apart for each in three]
        found = converging([1 / each for each in three], runs)
    stands = standing({name: each.apart for name, each in varied.items()})
    findings = findings_of(varied, stands, grown or None, found, base)
    return Trust(target, base, [*varied.values()], stands, grown or None, found, findings)


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

    @contextlib.contextmanager
    def claimed(self, names: Iterable[str]) -> Iterator[None]:
        """Claim the folder for runs of these names, and lock out others while the block runs.

        Raises
        ------
        OutputError
            If it holds something else, is in use, or cannot be written.
        """
        make_folder(self.path, "--out")
        with opened(self.path / ".lock") as handle:
            lock(handle, Message("another command is writing to {folder}; wait, or choose another "
                "--out", folder=self.path))  # fmt: skip
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

    def has(self, name: str) -> bool:
        """Whether a run is there.

        Raises
        ------
        OutputError
            If its recording is another, or damaged.
        """
        path = self.recording(name)
        if not os.path.lexists(path):
            return False
        with contextlib.suppress(RecordingError):
            if read(path).recording_id == self._id(name):
                return True
        raise OutputError(
            "{path} was altered or replaced after it was written; run all again with --force",
            path=path,
        )

    def run(self, name: str, program: Program, *, stdout: int, stderr: int | None = None) -> int:
        """Run and record a program, and return how many steps it made.

        Raises
        ------
        DropError
            If it is interrupted, or cannot be started.
        """
        variation = {} if name == BASE else {"variation": name}
        origin = {key: value for key, value in self.identity.items() if key != "python"}
        recorder = Recorder({schema.ORIGIN_PROPERTY: {**origin, **variation}})
        with running.Script(program, stdout=stdout, stderr=stderr) as process:
            ended = written(
                process, recorder, self.recording(name), recording_id=self._id(name), force=True
            )
        if ended.how == "interrupted":
            raise DropError("{name} was interrupted; run the same command again", name=name)
        return process.decoder.steps

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


def _identity(program: Program) -> dict[str, Any]:
    target = program.target
    return {
        "kind": "script",
        "script": f"-m {target}" if program.is_module else Path(target).name,
        "script_sha256": digest_of_script(target, program.is_module),
        "arguments": [*program.arguments] or None,
        "seed": program.seed,
        "steps": program.steps,
        "duration_s": program.duration_s,
        "drop_version": metadata.version("drop-physics"),
        "python": program.python,
    }
