"""Runs a script with every combination of requested changes; each run gives a row."""

from __future__ import annotations

import functools
import itertools
import math
import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drop_physics.engines.script import Program
from drop_physics.errors import DropError, ScenarioError
from drop_physics.experiments.interventions import Intervention
from drop_physics.printable import Printable
from drop_physics.stages import verbs
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import SEEDED_CLOCK_S, checked_limits
from drop_physics.stages.rerun.asked import cures_of
from drop_physics.stages.rerun.proposals import Candidate
from drop_physics.stages.rerun.single import is_single
from drop_physics.stages.trust import OwnRun, candidates_of
from drop_physics.stages.trust.runs import BASE, RunFolder, RunKept, identity_of, made_of, run_kept
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.sweeping.rows import Row, write_rows
from drop_physics.trace.cures import Cure

if TYPE_CHECKING:
    from drop_physics.experiments.run_distance import Track
    from drop_physics.recording.reader import Recording

MOST_RUNS = 10_000
"""Largest number of runs in a sweep: each takes a process and a recording."""
GIVEN = re.compile(r"([^=/*]+)(?:[=/*](.*))?")
"""Pattern of an intervention's name and value, as typed."""


@dataclass(frozen=True)
class ScriptSweep(Printable, reported_by="drop_physics.report.sweep_script"):
    """The runs of a script with different changes."""

    script: str
    recording: Path
    """Path of the recording of the script's own run."""
    tried: list[str]
    """Names of the interventions that vary: the first columns of the table."""
    rows: list[Row]
    """One row per run: interventions, ending, and final positions of bodies and joints."""
    results: Path
    """Path of the Parquet file that contains the rows."""

    @property
    def failed(self) -> int:
        """The number of runs that failed."""
        return sum(row["ended"] == "failed" for row in self.rows)


@dataclass(frozen=True)
class RunSwept(RunKept[Row]):
    """Runs a script with one combination of changes, by number."""

    def has_failed(self, made: Row) -> bool:
        """Return whether a run failed by itself, and was not stopped by drop."""
        return bool(made["ended"] == "failed")

    def compared(self, number: int, other: Recording) -> Row:
        """Return the row for a run, from its recording."""
        from drop_physics.analysis.story import Story
        from drop_physics.experiments.run_distance import apart
        from drop_physics.stages.analyze.explaining import explained

        finer = self.finer(number)
        with np.errstate(all="ignore"):  # of states that are not finite
            far = apart(self.own.seen, other.seen, finer=finer)
        made = made_of(self.name_of(number), other, finer=finer)
        seen = explained(other).recording.seen
        findings = Story(seen, other.origin_and_end).analysis().findings
        ends = {f"end_{each.unit}": each.value for each in far.end}
        return {
            "ended": made.ended,
            "error": made.error or None,
            "steps": made.steps,
            "same": far.same,
            "end_m": ends.get("end_m"),
            "end_rad": ends.get("end_rad"),
            "findings": [each.code for each in findings],
            "recording": made.recording.name,
            **{name: value for track in far.tracks for name, value in _ends(track)},
        }


@takes_those_of(verbs.SweepScriptArguments)
def sweep_script(asked: verbs.SweepScriptArguments) -> ScriptSweep:
    """Run a script unchanged, and with every combination of changes.

    Raises
    ------
    ScenarioError
        If a tried name is not that of an intervention, or is given twice.
    OutputError
        If the folder contains other files, or cannot be written to.
    DropError
        If the script makes no step, or all runs fail.
    """
    duration_s = asked.duration_s
    _, duration_s, _ = checked_limits(None, duration_s, asked.seed)
    lists = [cures_of([text], "--try", whole=True) for text in asked.tries]
    names = [_given(cures[0])[0] for cures in lists]
    if len({*names}) < len(names):
        raise ScenarioError("--try must name an intervention once, got {names}", names=names)
    runs = math.prod(map(len, lists))
    if runs > MOST_RUNS:
        raise ScenarioError(
            "a sweep of a script has at most {most:,} runs, got {runs:,}; give fewer values",
            most=MOST_RUNS,
            runs=runs,
        )
    program = Program(
        asked.target,
        tuple(map(str, asked.arguments)),
        interpreter_of(asked.target, is_module=False, given=None, note=asked.note),
        duration_s=duration_s,
        seed=asked.seed,
        begins_s=SEEDED_CLOCK_S,
        explain=True,
    )
    identity = {**identity_of(program), "tries": [*asked.tries]}
    folder = RunFolder(Path(asked.out).resolve(), identity, asked.force, "sweep.json", reads=True)
    combined = [", ".join(each.call for each in one) for one in itertools.product(*lists)]
    with folder.claimed((BASE, *combined)):
        base, limited, rerun = folder.begun(program, anyway=asked.again, stdout=asked.stdout)
        known = OwnRun(base.seen, limited, rerun)
        tried = [candidates_of(known, cures, "--try", usual=False) for cures in lists]
        all_of = [*itertools.product(*tried)]
        candidates = [_together(each) for each in all_of]
        work = RunSwept(limited, candidates, folder.path, base.path, base, rerun, runs=folder.runs)
        found = run_kept(work, jobs=asked.jobs, ray=asked.ray, progress=asked.progress)
        rows = [
            {"run": n, **dict(_given(each.intervention.cure) for each in one), **row}
            for n, (one, row) in enumerate(zip(all_of, found, strict=True))
        ]
        results = Path(asked.out) / "results.parquet"
        write_rows(results, rows)
    swept = ScriptSweep(asked.target, base.path, names, rows, results)
    if swept.failed == runs and (base.ended or {}).get("ended") != "failed":
        raise DropError(
            "all {runs:,} runs failed, the first with: {error}", runs=runs, error=rows[0]["error"]
        )
    return swept


def _together(candidates: Sequence[Candidate]) -> Candidate:
    """Combine several changes into one."""
    call = ", ".join(each.intervention.call for each in candidates)
    runs = (each.run for each in candidates if each.run is not None)
    return Candidate(Intervention(Cure("sweep", call=call)), functools.reduce(operator.add, runs))


def _given(cure: Cure) -> tuple[str, float | str | bool]:
    """Return a change's name and value; the value is True for a change without one."""
    found = None if is_single(cure.call) else GIVEN.fullmatch(cure.call)
    name, value = (cure.call, None) if found is None else found.groups()
    if value is None:
        return name, True
    try:
        return name, float(value)
    except ValueError:
        return name, value


def _ends(track: Track) -> list[tuple[str, float]]:
    """Return the final position of a body or joint, one column per coordinate."""
    if track.joint is not None and len(track.theirs) == 1:
        return [(f"{track.body} {track.joint}_{track.unit}", float(track.theirs[0]))]
    if track.unit != "m":
        return []
    return [(f"{track.body} {axis}_m", float(track.theirs[n])) for n, axis in enumerate("xyz")]
