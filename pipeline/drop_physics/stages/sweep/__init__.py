"""The command `sweep`: runs many scenarios; each gives a row with its position error."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import platform
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import polars as pl

from drop_physics.engines.worlds import body_digest, engine_versions, find_body, verdicts
from drop_physics.errors import DropError, ScenarioError
from drop_physics.fields import counted, outside
from drop_physics.files.outputs import check_room, make_folder
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.scenario import Camera, Scenario
from drop_physics.stages import verbs
from drop_physics.stages.rerun.runs import Progress, run_all
from drop_physics.stages.sweep.drop import RunDrop, name_of_run
from drop_physics.stages.trust.runs import RunFolder
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.sweeping import engines
from drop_physics.sweeping.plan import Plan, label_of, name_of, plan_of
from drop_physics.sweeping.rows import SCHEMA, Row, kept_rows, write_rows
from drop_physics.workers import cores

SHORT_STEPS = 200_000
"""Smallest total number of steps at which worker processes save time: starting one takes as long.
"""
LEAST_BYTES = 50_000
"""Smallest size of a run's recording [bytes]; one of 13 samples has 75 kB."""


@dataclass(frozen=True)
class Sweep(Printable, reported_by="drop_physics.report.sweep"):
    """The results of a sweep."""

    plan: Plan
    at_s: float
    computed: int
    """Number of runs computed by this call; the results of the others existed already."""
    rows: list[Row]
    """One row per run."""
    results: Path
    """Path of the Parquet file that contains the rows."""

    @property
    def runs(self) -> int:
        """The number of runs."""
        return len(self.rows)

    @property
    def failed(self) -> int:
        """The number of runs that failed."""
        return sum(map(_has_failed, self.rows))

    @property
    def at_samples(self) -> bool:
        """True if every run has a sample exactly at `at_s`; otherwise the nearest one is used."""
        times_s = [row["time_s"] for row in self.rows if row["time_s"] is not None]
        return all(abs(time_s - self.at_s) <= 1e-9 * self.at_s for time_s in times_s)

    @property
    def axes(self) -> list[tuple[str, str]]:
        """The settings that vary between scenarios, with display names."""
        return [(field, name_of(field)) for field in self.plan.axes]

    def written(self, field: str, value: object) -> str:
        """Format a field's value for display."""
        return Scenario.options()[field].written(value)

    def label(self, row: Row) -> str:
        """Describe a row's scenario by the values that distinguish it."""
        return label_of({field: row[field] for field in self.plan.axes})

    def table(self) -> pl.DataFrame:
        """Return the results, a row per run."""
        return pl.read_parquet(self.results)


@takes_those_of(verbs.SweepArguments)
def sweep(asked: verbs.SweepArguments) -> Sweep:
    """Run the scenarios of a plan whose results are not in the folder yet.

    Raises
    ------
    ScenarioError
        If an option is outside its domain.
    OutputError
        If the folder contains other files, or cannot be written to.
    DropError
        If all runs fail, workers die repeatedly, or Ray does not respond.
    """
    plan = asked.plan
    if not isinstance(plan, Plan):
        plan = plan_of(plan)
    if asked.jobs is not None and asked.jobs < 1:
        raise outside("--jobs", Message("at least {low}", low=1), asked.jobs)
    if not 0 <= asked.at_s < math.inf:
        raise outside("--at", Message("finite and at least {low:g}", low=0), asked.at_s)
    for body in plan.bodies:  # each is tried once, here
        with contextlib.suppress(ScenarioError):
            find_body(body)
    make_folder(Path(asked.out))
    folder = RunFolder(
        Path(asked.out).resolve(),
        _identity(plan, asked.at_s, asked.record, asked.camera),
        asked.force,
        "sweep.json",
        reads=True,
    )
    results = Path(asked.out) / "results.parquet"
    work = RunDrop(plan, folder.path, folder.id, asked.at_s, asked.record, asked.camera, verdicts())
    with folder.claimed(map(name_of_run, range(plan.runs)) if asked.record else ()):
        rows, computed = _run(
            work,
            folder,
            shown=Path(asked.out),
            jobs=asked.jobs,
            ray=asked.ray,
            force=asked.force,
            progress=asked.progress,
        )
        write_rows(results, rows, SCHEMA)
    swept = Sweep(plan, asked.at_s, computed, rows, results)
    if swept.failed == swept.runs == 1:
        raise DropError("the run failed with: {error}", error=rows[0]["error"])
    if swept.failed == swept.runs:
        raise DropError(
            "all {runs:,} runs failed, the first with: {error}",
            runs=swept.runs,
            error=rows[0]["error"],
        )
    return swept


def _run(
    work: RunDrop,
    folder: RunFolder,
    *,
    shown: Path,
    jobs: int | None,
    ray: str | None,
    force: bool,
    progress: Progress,
) -> tuple[list[Row], int]:
    """Return the rows of all runs, and how many were computed now."""
    plan, kept = work.plan, folder.path / "rows.jsonl"
    if force:
        kept.unlink(missing_ok=True)
    with kept_rows(kept, folder.id) as (known, add):
        rows = {
            run: row
            for run, row in known.items()
            if row["recording"] is None or (folder.path / row["recording"]).exists()
        }
        failed = sum(map(_has_failed, rows.values()))
        left = [run for run in range(plan.runs) if run not in rows]
        if work.recorded:
            check_room(folder.path, len(left) * LEAST_BYTES)

        def entered(run: int, row: Row) -> None:
            rows[run] = row
            add(row)

        def told(done: int, failing: int, _: int) -> None:
            progress(plan.runs - len(left) + done, failed + failing, plan.runs)

        try:
            with _answering(work, len(left), jobs) as (answer, stop, at_once):
                run_all(
                    answer,
                    left,
                    stop=stop,
                    has_failed=_has_failed,
                    jobs=at_once,
                    progress=told,
                    ray=None if ray is None else (work, ray),
                    entered=entered,
                )
        except BaseException as stopped:
            stopped.add_note(
                Message(
                    "{done:,} of {runs} done in {folder}; run the same command again to resume",
                    done=len(rows),
                    runs=counted(plan.runs, "run"),
                    folder=shown,
                )
            )
            raise
    return [rows[run] for run in range(plan.runs)], len(left)


@contextlib.contextmanager
def _answering(work: RunDrop, runs: int, jobs: int | None) -> Iterator[engines.Answering[Row]]:
    """Yield the function that computes a row: in worker processes, or in this one if as fast."""
    try:
        steps = runs * Scenario(**work.plan.values(0)).steps
    except ScenarioError:
        steps = runs
    if steps < SHORT_STEPS and jobs in (None, 1):
        yield work, lambda: None, 1
        return
    with engines.in_workers(work, jobs=min(jobs or cores(), runs)) as answering:
        yield answering


def _has_failed(row: Row) -> bool:
    return row["error"] is not None


def _identity(plan: Plan, at_s: float, record: bool, camera: Camera | None) -> dict[str, Any]:
    """Return all settings that determine the rows, so that different sweeps do not mix."""
    runs = json.dumps(asdict(plan), sort_keys=True).encode()
    packages = ["drop-physics", "numpy"]
    if "mujoco" in plan.engines and find_spec("mujoco"):
        packages.append("mujoco")
    return {
        "kind": "drops",
        "runs_sha256": hashlib.sha256(runs).hexdigest(),
        "bodies": {body: body_digest(body) for body in plan.bodies},
        "at_s": at_s,
        "recorded": record,
        "camera": None if camera is None else asdict(camera),
        **engine_versions(),
        **{f"{package}_version": metadata.version(package) for package in packages},
        "machine": platform.machine(),
    }
