"""Run many scenarios, and show how the error behaves, by timestep or at random."""

from __future__ import annotations

import contextlib
import itertools
import math
import platform
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from drop_physics.drop.one_sample import DEFAULT_AT_S
from drop_physics.engines.pybullet.engine import engine_versions
from drop_physics.engines.pybullet.found import body_digest, find_body
from drop_physics.engines.pybullet.probe import verdicts
from drop_physics.errors import DropError, ScenarioError
from drop_physics.fields import counted, outside
from drop_physics.files.outputs import check_apart, check_room, check_target
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.scenario import Camera, Scenario
from drop_physics.stages.sweep_groups import Group, statistics_of, studies_of
from drop_physics.stages.sweep_ledger import LEAST_SAMPLES, Ledger, Progress
from drop_physics.stages.sweep_shard import RunShard, ShardDone, release_world
from drop_physics.sweeping import engines
from drop_physics.sweeping.folder import Folder
from drop_physics.sweeping.plan import Plan, name_of, plan_of
from drop_physics.workers import cores

if TYPE_CHECKING:
    from drop_physics.stages.sweep_engines import EngineRun, EngineTrajectory

SHORT_STEPS = 200_000
"""Least number of steps for which a second process pays off: it takes as long to start."""
LEAST_BYTES = 50_000
"""Minimum size of a run's recording: one of 13 samples has 75 kB."""


@dataclass(frozen=True)
class Sweep(Printable, reported_by="drop_physics.report.sweep"):
    """The results of a sweep."""

    plan: Plan
    at_s: float
    runs: int
    failed: int
    computed: int
    """Number of runs of this call; the others were already there."""
    results: Path
    """One Parquet file, a row per run."""
    plot: Path | None
    studies: list[Group]
    """One study for each set of scenarios that differ in the timestep only."""
    statistics: list[Group]
    """Statistics of each scenario that is sampled."""
    narrow_enough: bool | None
    """Whether `until_ci_m` was reached; None if it was not given."""
    at_samples: bool = True
    """Whether every run has a sample at `at_s`; if not, the nearest one counts."""
    engine_runs: Sequence[EngineRun] = ()
    """Facts of each run beyond its error, where engines are compared or the body spins."""

    @property
    def axes(self) -> list[tuple[str, str]]:
        """Fields that have more than one value, with their names."""
        return [(field, name_of(field)) for field in self.plan.axes]

    def written(self, field: str, value: object) -> str:
        """Return a field's value as it is displayed."""
        return Scenario.options()[field].written(value)

    def table(self, most: int | None = None) -> pl.DataFrame:
        """Return the results, a row per run, or the first of them."""
        return pl.read_parquet(self.results, n_rows=most)

    def first_failure(self) -> dict[str, Any]:
        """Return the first row that has an error."""
        rows = pl.scan_parquet(self.results).filter(pl.col("error").is_not_null())
        return rows.first().collect().row(0, named=True)


def sweep(
    plan: Plan | Mapping[str, Any],
    out: Path | str,
    *,
    at_s: float = DEFAULT_AT_S,
    record: bool = True,
    camera: Camera | None = None,
    jobs: int | None = None,
    ray: str | None = None,
    until_ci_m: float | None = None,
    plot: Path | str | None = None,
    dark: bool = False,
    force: bool = False,
    progress: Progress = lambda *_: None,
) -> Sweep:
    """Run the scenarios of a plan that are not yet in the folder.

    Parameters
    ----------
    plan
        Which scenarios: lists of values by field of `Scenario`, as {"timestep_s": [1/240, 1/480]},
        or a plan, which `plan_of` makes of lists and of what is drawn.
    out
        The folder for results and recordings; created if missing. The same plan resumes in it,
        another plan is rejected.
    at_s
        Time at which to break the error down [s].
    record
        Whether each run's recording is kept.
    camera
        How to take frames of the recorded falls, or None for no frames.
    jobs
        Processes on this machine; None for one per core where that pays off.
    ray
        Address of a Ray cluster to run on instead, `auto`, or `local`.
    until_ci_m
        Stop sampling when the 95 % confidence interval of the mean error is this narrow [m], over
        the samples in the air, or over all if none is; not before there are `LEAST_SAMPLES`, nor
        while all are equal.
    plot
        A `.png` or `.svg` file for the plot of errors over the timestep, or None.
    dark
        Whether the plot is for a dark page.
    force
        Whether an existing plot may be replaced.
    progress
        Called while it runs.

    Raises
    ------
    ScenarioError
        If the options cannot be combined.
    OutputError
        If the folder holds another sweep, or cannot be written.
    DropError
        If all runs fail, workers die repeatedly, or Ray does not answer.
    """
    if not isinstance(plan, Plan):
        plan = plan_of(plan)
    _check(plan, until_ci_m=until_ci_m, jobs=jobs, at_s=at_s)
    bodies = _bodies(plan)
    if plot is not None:
        _check_plot(Path(plot), plan, bodies, force=force)
    work = RunShard(plan, Path(out).resolve(), at_s, record, camera, verdicts())
    folder = Folder(Path(out))
    with folder.claimed(_identity(work)):
        ledger, before = _run(work, folder, until_ci_m, progress, jobs=jobs, ray=ray)
        results = folder.merge(ledger.shards)
        runs, failed = _counted(results)
        studies, falls = studies_of(plan, results), _falls(plan, results)
        at_samples = _at_samples(results, at_s)
        if plot is not None:
            from drop_physics.stages.sweep_plot import plot_sweep

            plot_sweep(
                Path(plot),
                plan,
                studies,
                falls,
                at_s=at_s,
                at_samples=at_samples,
                dark=dark,
                force=force,
            )
    return Sweep(
        plan=plan,
        at_s=at_s,
        runs=runs,
        failed=failed,
        computed=sum(len(plan.runs_of(shard)) for shard in {*range(ledger.shards)} - before),
        results=folder.results,
        plot=None if plot is None else Path(plot),
        studies=studies,
        statistics=statistics_of(plan, results),
        at_samples=at_samples,
        engine_runs=[fall.run for fall in falls],
        narrow_enough=None if until_ci_m is None else ledger.narrow,
    )


def _run(
    work: RunShard,
    folder: Folder,
    until_ci_m: float | None,
    progress: Progress,
    *,
    jobs: int | None,
    ray: str | None,
) -> tuple[Ledger, set[int]]:
    """Run the shards that are not yet in the folder; return all, and which were there before."""
    plan = work.plan
    before = {shard: ShardDone.of(part) for shard, part in folder.finished(plan)}
    ledger = Ledger(plan, dict(before), until_ci_m, progress)
    if work.recorded and until_ci_m is None:
        check_room(folder.path / "recordings", (plan.runs - ledger.runs) * LEAST_BYTES)
    left = (shard for shard in range(plan.shards) if shard not in before)
    # Shards under way are finished: a worker leaves nothing half written.
    todo = itertools.takewhile(lambda _: not ledger.enough, left)
    try:
        if not ledger.enough:
            # Closing it also ends the workers.
            with contextlib.closing(_engine(work, todo, jobs=jobs, ray=ray)) as finished:
                for shard, done in finished:
                    ledger.enter(shard, done)
    except BaseException as stop:
        stop.add_note(
            Message(
                "{done:,} of {runs} done in {folder}; run the same command again to resume",
                done=ledger.runs,
                runs=counted(plan.runs, "run"),
                folder=folder.path,
            )
        )
        raise
    finally:
        release_world()
    return ledger, {*before}


def _counted(results: pl.LazyFrame) -> tuple[int, int]:
    """Return how many runs there are, and how many failed.

    Raises
    ------
    DropError
        If all did.
    """
    errors = pl.col("error")
    counts = results.select(runs=pl.len(), failed=errors.count(), first=errors.first())
    runs, failed, error = counts.collect().row(0)
    if failed < runs:
        return runs, failed
    if runs == 1:
        raise DropError("the run failed with: {error}", error=error)
    raise DropError("all {runs:,} runs failed, the first with: {error}", runs=runs, error=error)


def _check_plot(plot: Path, plan: Plan, bodies: list[Path], *, force: bool) -> None:
    from drop_physics.figures.convergence_plot import check_plot

    timesteps = len(dict(plan.lists).get("timestep_s", ()))
    check_plot(plot, timesteps=timesteps, engines="engine" in plan.axes)
    check_target(plot, force=force)
    check_apart([plot], inputs=bodies)


def _check(plan: Plan, *, until_ci_m: float | None, jobs: int | None, at_s: float) -> None:
    if until_ci_m is not None:
        if not 0 < until_ci_m < math.inf:
            raise outside("--until-ci", Message("finite and above {low:g}", low=0), until_ci_m)
        if plan.samples is None or plan.axes:
            raise ScenarioError("--until-ci takes one scenario with --samples, and no lists")
        if plan.samples < LEAST_SAMPLES:
            raise ScenarioError(
                "--until-ci needs at least {least} --samples, got {samples}",
                least=LEAST_SAMPLES,
                samples=plan.samples,
            )
    if jobs is not None and jobs < 1:
        raise outside("--jobs", Message("at least {low}", low=1), jobs)
    if not 0 <= at_s < math.inf:
        raise outside("--at", Message("finite and at least {low:g}", low=0), at_s)


def _bodies(plan: Plan) -> list[Path]:
    """Return the files of the bodies that can be loaded; each is tried once."""
    files = []
    for body in plan.bodies:
        with contextlib.suppress(ScenarioError):
            files.append(find_body(body))
    return files


def _identity(work: RunShard) -> dict[str, Any]:
    """Return everything that determines the rows: results of different sweeps must not mix."""
    return {
        "lists": {name: list(values) for name, values in work.plan.lists},
        "vary": [asdict(variation) for variation in work.plan.variations],
        "samples": work.plan.samples,
        "seed": work.plan.seed,
        "bodies": {body: body_digest(body) for body in work.plan.bodies},
        "at_s": work.at_s,
        "recorded": work.recorded,
        "camera": None if work.camera is None else asdict(work.camera),
        "made_with": {
            **engine_versions(),
            **{f"{name}_version": metadata.version(name) for name in _imported(work.plan)},
            "drop_version": metadata.version("drop-physics"),
            "machine": platform.machine(),
        },
    }


def _imported(plan: Plan) -> Iterator[str]:
    """Yield the packages that step the plan's bodies beside PyBullet."""
    yield "numpy"
    if "mujoco" in plan.engines and find_spec("mujoco"):
        yield "mujoco"


def _at_samples(results: pl.LazyFrame, at_s: float) -> bool:
    """Return whether every run that did not fail has a sample at that time."""
    apart_s = (pl.col("time_s") - at_s).abs().max()
    return bool(results.select(apart_s.fill_null(0) <= 1e-9 * at_s).collect().item())


def _engine(
    work: RunShard, todo: Iterator[int], *, jobs: int | None, ray: str | None
) -> Generator[tuple[int, ShardDone]]:
    if ray is not None:
        return engines.on_ray(work, todo, address=ray)
    plan = work.plan
    if jobs is None:
        try:
            steps = plan.runs * Scenario(**plan.values(0)).steps
        except ScenarioError:
            steps = plan.runs
        jobs = 1 if steps < SHORT_STEPS else cores()
    jobs = min(jobs, plan.shards)
    if jobs == 1:
        return ((shard, work(shard)) for shard in todo)
    return engines.in_processes(work, todo, jobs=jobs)


def _falls(plan: Plan, results: pl.LazyFrame) -> list[EngineTrajectory]:
    """Return what each run does beyond its error, in sweeps over engines or of spinning bodies."""
    spins = "spin_rad_s" in dict(plan.lists)
    if plan.samples is not None or not ("engine" in plan.axes or spins):
        return []
    from drop_physics.stages.sweep_engines import MOST_RUNS, engine_falls

    return engine_falls(plan, results) if plan.runs <= MOST_RUNS else []
