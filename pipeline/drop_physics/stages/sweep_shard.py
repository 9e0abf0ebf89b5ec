"""Run one shard of a sweep: its scenarios one after another, with a row and a recording for each.

This is all that a worker does, wherever it runs. It keeps its world from shard to shard.
"""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from drop_physics.drop.one_sample import moment_in_the_air
from drop_physics.drop.results import Moment
from drop_physics.drop.statistics import Moments
from drop_physics.engine_report import EngineReport
from drop_physics.engines.other_world import OtherWorld
from drop_physics.engines.pybullet.lasting_world import LastingWorld
from drop_physics.engines.pybullet.probe import Verdicts, believe
from drop_physics.engines.worlds import Worlds
from drop_physics.errors import DropError, OutputError, check_signals
from drop_physics.explain.decomposition import TERMS
from drop_physics.files.outputs import make_folder
from drop_physics.files.whole import onto_disk
from drop_physics.scenario import Camera, Scenario
from drop_physics.sweeping.folder import EXPLAINED, SCHEMA, Folder, Row
from drop_physics.sweeping.plan import Plan, replay_command
from drop_physics.trace.events import Samples
from drop_physics.trace.states import BODY, MOTION

if TYPE_CHECKING:
    from drop_physics.drop.case import Case

_EMPTY: Row = dict.fromkeys(SCHEMA) | asdict(Scenario())
"""The row of a run before it starts: the scenario's defaults."""

_worlds = Worlds()
"""The worlds of this process."""


def release_world() -> None:
    """Close this process's own world, which PyBullet calls without a client id might reach."""
    _worlds.close()


@dataclass(frozen=True)
class ShardDone:
    """A worker's report on a shard: the rows themselves are in the shard's part."""

    runs: int
    failed: int
    error_m: Moments
    """Moments of the total error, over the runs that have one."""
    explained_m: Moments
    """The same over the runs whose error was broken down."""

    @classmethod
    def of(cls, rows: pl.DataFrame) -> ShardDone:
        """Return the report on a part."""
        errors = rows.filter(pl.col("error").is_null())
        explained = errors.filter(EXPLAINED)
        return cls(
            runs=len(rows),
            failed=len(rows) - len(errors),
            error_m=Moments().with_values(errors["error_m"].to_numpy()),
            explained_m=Moments().with_values(explained["error_m"].to_numpy()),
        )


@dataclass(frozen=True)
class RunShard:
    """Everything needed to run any shard of one sweep; called with the shard's number."""

    plan: Plan
    folder: Path
    at_s: float
    recorded: bool
    camera: Camera | None
    tried: Verdicts = field(default_factory=dict)
    """Verdicts on the plan's bodies, so that they are not tried in every process."""

    def __call__(self, shard: int) -> ShardDone:
        """Run a shard and write its part.

        Raises
        ------
        OutputError
            If a file cannot be written, as that concerns more than one scenario.
        """
        believe(self.tried)
        rows = []
        for run in self.plan.runs_of(shard):
            rows.append(self.row(run))
            check_signals()  # else a run that a signal ended would count as failed
        # A part exists only once its recordings are on the disk.
        onto_disk(self.folder / row["recording"] for row in rows if row["recording"])
        return ShardDone.of(self._home.write(shard, rows))

    def row(self, run: int) -> Row:
        """Run one scenario, and return its row, even if it fails."""
        values = self.plan.values(run)
        name = f"run-{run}.rrd"
        row: Row = _EMPTY | values
        row |= {
            "run": run,
            "sample": self.plan.sample_of(run),
            "command": replay_command(values, out=name),
        }
        try:
            scenario = Scenario(**values)
            path = self._recording(run) if self.recorded else None
            moment, end_m = self._fall(scenario, path)
        except (OutputError, MemoryError):  # which say nothing about this scenario
            raise
        except DropError as error:
            return row | {"error": str(error.in_options)}
        except Exception as error:  # noqa: BLE001 - whatever it is, the other scenarios go on
            return row | {"error": f"{type(error).__name__}: {error}"}
        terms = moment.terms_m
        return row | {
            "step": moment.step,
            "time_s": moment.time_s,
            "phase": moment.phase,
            "simulated_m": moment.simulated_m,
            "free_fall_m": moment.free_fall_m,
            "error_m": moment.error_m,
            **{f"{name}_m": terms and getattr(terms, name) for name in TERMS},
            "end_m": end_m,
            "recording": path and str(path.relative_to(self.folder)),
        }

    @property
    def _home(self) -> Folder:
        return Folder(self.folder)

    def _recording(self, run: int) -> Path:
        path = self._home.recording(self.plan, run)
        make_folder(path.parent)
        return path

    def _fall(self, scenario: Scenario, path: Path | None) -> tuple[Moment, float]:
        """Return the breakdown of the sample nearest to `at_s`, and the height at the end [m]."""
        step = round(self.at_s / scenario.timestep_s)
        world = _worlds.world_of(scenario)
        engine = world.report()
        if path is not None:
            fall = self._record(world, path, step)
            moment = _in_the_air(scenario, engine, fall, step)
            return moment or self._recorded(path), world.height_m()
        batches = world.samples(step + 1)
        fall = [next(batches)]
        moment = _in_the_air(scenario, engine, fall, step)
        if moment is None:
            return self._analyzed(world, [*fall, *batches]), world.height_m()
        world.skip(scenario.steps - step)
        return moment, world.height_m()

    def _record(self, world: LastingWorld | OtherWorld, path: Path, step: int) -> list[Samples]:
        """Record a fall as `drop simulate` does, and return its samples up to `step` at least."""
        from drop_physics.recording import writer
        from drop_physics.stages.recorded import BATCH, recorded

        seen: list[Samples] = []

        def watch(samples: Samples) -> None:
            if len(seen) * BATCH <= step:
                seen.append(samples)

        with contextlib.ExitStack() as stack:
            photographer = None
            if self.camera is not None:
                from drop_physics.engines.pybullet.camera_frames import Photographer

                # One picture at a time: the other cores run other shards.
                photographer = Photographer(world.scenario, self.camera, frames=1)
                stack.enter_context(photographer)
            chunks: Iterable[writer.Chunk] = writer.named(
                recorded(world, photographer, BATCH, lambda *_: None, watch), path.stem
            )
            if world.scenario.steps < BATCH:
                # Rerun's writer takes chunks in its own thread. With ready ones it does not wait
                # for Python's lock, which saves a tenth of a short run's time.
                chunks = list(chunks)
            # What a killed worker left there is replaced.
            recording_id = uuid.uuid4().hex
            writer.record(path, chunks, recording_id=recording_id, blueprint=None, force=True)
        return seen

    def _recorded(self, path: Path) -> Moment:
        from drop_physics.drop.case import Case
        from drop_physics.recording.reader import read

        recording = read(path)
        return self._moment(Case(recording.scenario, recording.engine, recording.seen))

    def _analyzed(self, world: LastingWorld | OtherWorld, fall: list[Samples]) -> Moment:
        from drop_physics.stages.recorded import case_of

        return self._moment(case_of(world, fall))

    def _moment(self, case: Case) -> Moment:
        from drop_physics.drop.analysis import fall_of

        return fall_of(case, at_s=[self.at_s]).at[0]


def _in_the_air(
    scenario: Scenario, engine: EngineReport, fall: list[Samples], step: int
) -> Moment | None:
    base = np.concatenate([each.bases[BODY] for each in fall])[: step + 1]
    if len(base) <= step:
        return None
    touched = any((each.contacts["step"] <= step).any() for each in fall)
    position_m, velocity_m_s = (base[:, MOTION[name]] for name in ("position_m", "velocity_m_s"))
    return moment_in_the_air(scenario, engine, position_m, velocity_m_s, touched=touched)
