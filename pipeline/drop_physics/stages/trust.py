"""Run a script again with variations, and tell what of its result stands."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from drop_physics.errors import DropError, OutputError
from drop_physics.files.outputs import check_target, make_folder
from drop_physics.files.whole import lock, opened, written_whole
from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.reader import read
from drop_physics.recording.recorder import Recorder
from drop_physics.seen.events import Ending
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
    ended: str
    error: str
    steps: int
    bytes: int
    sha256: str


@dataclass(frozen=True)
class Varied:
    """A run with a variation, and how far it is from the script's own."""

    name: str
    recording: Path
    apart: Apart
    made: Made
    term: str | None
    """Of the sum: which made them differ first."""


@dataclass(frozen=True)
class Trust(Shown, lines_of="drop_physics.console.show_trust:trust_lines"):
    """What of a script's result stands."""

    script: str
    recording: Path
    made: Made
    variations: list[Varied]
    standing: list[Standing]
    """Of each position that matters, the least first."""
    growth: Growth | None
    """Of the nudge; None where it does not grow, or was left out."""
    converging: list[Converging]
    """Of each end position that depends on the timestep, where three of them were run."""
    findings: list[Finding]

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
        made = self.folder.made(name)
        if made is None:
            variation = {key: value for key, value in given.items() if key != "draws"}
            program = replace(self.program, variation=variation)
            if "draws" in given:
                seed = given["draws"]
                program = replace(program, seed=(program.seed or 0) + 1 if seed is None else seed)
            null = os.open(os.devnull, os.O_WRONLY)
            try:
                made = self.folder.run(name, program, stdout=null, stderr=null)
            finally:
                os.close(null)
        base, other = (read(self.folder.recording(each)).seen for each in (BASE, name))
        finer = given.get("finer", 1)
        with np.errstate(all="ignore"):  # of states that are not finite
            found = apart(base, other, finer=finer)
            term = first_term(base, other, found, finer=finer)
        return Varied(name, self.folder.recording(name), found, made, term)


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
    folder = TrustFolder(place.resolve(), force=force)
    with folder.claimed(program, variations):
        base = folder.made(BASE) or folder.run(BASE, program, stdout=stdout)
        if not base.steps:
            raise DropError("{script} makes no step: there is nothing to compare", script=target)
        most = base.steps if base.ended in STOPPED else base.steps + 1
        work = RunVariation(replace(program, steps=most, duration_s=None), variations, folder)
        try:
            varied = _run(work, jobs=jobs, ray=ray, progress=progress)
        except BaseException as stop:
            stop.add_note(Message("run the same command again to resume it"))
            raise
        folder.finish()
    result = _trust(target, folder, base, varied, variations)
    write_outputs(result, *outputs, dark=dark, force=force)
    return result


def _run(
    work: RunVariation, *, jobs: int | None, ray: str | None, progress: Progress
) -> dict[str, Varied]:
    """Run the variations, and return them in order."""
    numbers, jobs = range(len(work.variations)), min(jobs or cores(), len(work.variations))
    runs = (
        engines.on_ray(work, numbers, address=ray) if ray is not None
        else engines.in_this_process(work, numbers) if jobs == 1
        else engines.in_processes(work, numbers, jobs=jobs)
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
    folder: TrustFolder,
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
    return Trust(target, folder.recording(BASE), base, [*varied.values()], stands, grown or None,
        found, findings)  # fmt: skip


# -- the folder -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class TrustFolder:
    """Recordings, and of each what it was when it was written: whole or not there."""

    path: Path
    force: bool = False
    mark: str = ""

    @contextlib.contextmanager
    def claimed(
        self, program: Program, variations: Mapping[str, Mapping[str, Any]]
    ) -> Iterator[None]:
        """Claim the folder for these runs, and lock out others while the block runs.

        Raises
        ------
        OutputError
            If it holds something else, is in use, or cannot be written.
        """
        make_folder(self.path, "--out")
        identity = _identity(program)
        mark = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
        object.__setattr__(self, "mark", mark)
        with opened(self.path / ".lock") as handle:
            lock(handle, Message("another command is writing to {folder}; wait, or choose another "
                "--out", folder=self.path))  # fmt: skip
            known = self._described("trust")
            resumes = known is not None and not known.get("finished") and known["mark"] == mark
            if not (resumes or self.force):
                for name in ("trust", BASE, *variations):
                    for path in (self.recording(name), self._description(name)):
                        if os.path.lexists(path):
                            self._refuse(known, mark)
            if not resumes:
                for name in (BASE, *variations):
                    self._description(name).unlink(missing_ok=True)
            self._describe("trust", {"mark": mark, "finished": False, **identity})
            yield

    def _refuse(self, known: Mapping[str, Any] | None, mark: str) -> None:
        if known is not None and known.get("finished") and known["mark"] == mark:
            raise OutputError(
                "{folder} has the runs of this command already; run them again with --force, or "
                "choose another --out",
                folder=self.path,
            )
        raise OutputError(
            "{folder} has files of something else; replace them with --force, or choose another "
            "--out",
            folder=self.path,
        )

    def finish(self) -> None:
        """Note that all runs are there."""
        self._describe("trust", {**(self._described("trust") or {}), "finished": True})

    def recording(self, name: str) -> Path:
        """Return the recording of a run."""
        return self.path / f"{_file_name(name)}.rrd"

    def _description(self, name: str) -> Path:
        return self.path / f"{_file_name(name)}.json"

    def made(self, name: str) -> Made | None:
        """Return a run that is there; None if it has to be made.

        Raises
        ------
        OutputError
            If its recording is not, to the last bit, what was written.
        """
        known = self._described(name)
        if known is None or known.pop("mark", None) != self.mark:
            return None
        path = self.recording(name)
        if not path.is_file():
            return None
        if _digest(path) != (known.get("bytes"), known.get("sha256")):
            if self.force:
                return None
            raise OutputError(
                "{path} was altered or replaced after it was written; run all again with --force",
                path=path,
            )
        return Made(**known)

    def run(self, name: str, program: Program, **streams: int) -> Made:
        """Run and record a program.

        Raises
        ------
        DropError
            If it is interrupted, or cannot be started.
        """
        path = self.recording(name)
        check_target(path, force=True)
        recording_id = hashlib.sha256(f"{self.mark} {name}".encode()).hexdigest()[:32]
        ending, steps = _recorded(program, path, name, recording_id, **streams)
        if ending.how == "interrupted":
            raise DropError("{name} was interrupted", name=name)
        size, digest = _digest(path)
        made = Made(name, ending.how, ending.error, steps, size, digest)
        self._describe(name, {"mark": self.mark, **vars(made)})
        return made

    def _describe(self, name: str, facts: Mapping[str, Any]) -> None:
        with written_whole(self._description(name), force=True, ours=True) as file:
            file.write(json.dumps(facts, indent=2).encode() + b"\n")

    def _described(self, name: str) -> dict[str, Any] | None:
        try:
            with self._description(name).open("rb") as file:
                known = json.loads(file.read(MOST_BYTES))
            return known if isinstance(known, dict) and "mark" in known else None
        except (OSError, ValueError, RecursionError):
            return None


def _file_name(name: str) -> str:
    """Return a name as that of a file."""
    return "".join(each if each.isalnum() or each in "=.-+" else "_" for each in name)


def _identity(program: Program) -> dict[str, Any]:
    """Return what determines the runs, as far as it is known before."""
    return {
        "script": program.target,
        "script_sha256": digest_of_script(program.target, program.is_module),
        "arguments": [*program.arguments],
        "is_module": program.is_module, "python": program.python, "steps": program.steps,
        "duration_s": program.duration_s, "seed": program.seed,
        "drop_version": metadata.version("drop-physics"),
    }  # fmt: skip


def _digest(path: Path) -> tuple[int, str]:
    with path.open("rb") as file:
        return path.stat().st_size, hashlib.file_digest(file, "sha256").hexdigest()


def _recorded(
    program: Program, path: Path, name: str, recording_id: str, *, stdout: int,
    stderr: int | None = None,
) -> tuple[Ending, int]:  # fmt: skip
    """Run and record a program; return how it ended, and the script's number of steps."""
    origin: dict[str, Any] = {
        "kind": "script",
        "script": f"-m {program.target}" if program.is_module else Path(program.target).name,
        "arguments": [*program.arguments] or None,
        "seed": program.seed,
        "steps": program.steps,
        "duration_s": program.duration_s,
        "drop_version": metadata.version("drop-physics"),
        **({} if name == BASE else {"variation": name}),
    }
    recorder = Recorder({schema.ORIGIN_PROPERTY: origin})
    with running.Script(program, stdout=stdout, stderr=stderr) as process:
        ended = written(process, recorder, path, recording_id=recording_id, force=True)
    finer = (program.variation or {}).get("finer", 1)
    return ended, process.decoder.steps // finer
