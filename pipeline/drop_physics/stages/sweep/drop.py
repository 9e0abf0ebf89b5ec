"""One run of a sweep of scenarios, in a worker process: a drop, its row, and its recording."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics.drop.analysis import fall_of
from drop_physics.drop.one_sample import moment_in_the_air
from drop_physics.drop.results import Moment
from drop_physics.engine_report import EngineReport
from drop_physics.engines.worlds import Verdicts, believe, world_of
from drop_physics.errors import DropError, OutputError, check_signals
from drop_physics.explain.decomposition import TERMS
from drop_physics.installed import PYBULLET, is_installed
from drop_physics.recording import writer
from drop_physics.scenario import Camera, Scenario
from drop_physics.stages.simulate.recorded import BATCH, case_of, recorded
from drop_physics.sweeping.plan import Plan, replay_command
from drop_physics.sweeping.rows import SCHEMA, Row
from drop_physics.trace.events import Samples
from drop_physics.trace.states import BODY, MOTION

if TYPE_CHECKING:
    from drop_physics.engines.other_world import OtherWorld
    from drop_physics.engines.pybullet.world import World

_EMPTY: Row = dict.fromkeys(SCHEMA) | asdict(Scenario())
"""Initial row of a run: the scenario's defaults."""


def name_of_run(run: int) -> str:
    """Return the name of a run's recording."""
    return f"run-{run}"


@dataclass(frozen=True)
class RunDrop:
    """Computes the rows of a sweep, one per numbered run; picklable."""

    plan: Plan
    folder: Path
    sweep_id: str
    at_s: float
    recorded: bool
    camera: Camera | None
    tried: Verdicts = field(default_factory=dict)
    """Results of testing the plan's bodies, so that not every process has to test them again."""

    def __call__(self, run: int) -> Row:
        """Run one scenario, and return its row, even if the run fails.

        Raises
        ------
        OutputError
            If a file cannot be written, since this concerns all scenarios.
        """
        believe(self.tried)
        values, file = self.plan.values(run), f"{name_of_run(run)}.rrd"
        row: Row = _EMPTY | values
        row |= {
            "run": run,
            "sample": self.plan.sample_of(run),
            "command": replay_command(values, out=file),
        }
        try:
            moment, end_m = self._fall(Scenario(**values), file)
        except (OutputError, MemoryError):  # which say nothing about this scenario
            raise
        except DropError as error:
            return row | {"error": str(error.in_options)}
        except Exception as error:  # noqa: BLE001 - whatever it is, the other scenarios go on
            check_signals()  # else a run that a signal ended would count as failed
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
            "recording": file if self.recorded else None,
        }

    def _fall(self, scenario: Scenario, file: str) -> tuple[Moment, float]:
        """Return the error terms in the sample nearest to `at_s`, and the final height [m]."""
        fall: list[Samples] = []
        with world_of(scenario) as world:
            if self.recorded:
                self._record(world, file, fall.append)
            else:
                fall += world.samples(BATCH)
            step = round(self.at_s / scenario.timestep_s)
            moment = _in_the_air(scenario, world.report(), fall, step)
            if moment is None:
                moment = fall_of(case_of(world, fall), at_s=[self.at_s]).at[0]
        return moment, float(fall[-1].bases[BODY][-1, MOTION["position_m"]][2])

    def _record(
        self, world: World | OtherWorld, file: str, watch: Callable[[Samples], object]
    ) -> None:
        """Record a fall like `drop simulate`; partial files of a killed worker are replaced."""
        with contextlib.ExitStack() as stack:
            photographer = None
            if self.camera is not None and is_installed(PYBULLET):
                from drop_physics.engines.pybullet.camera_frames import Photographer

                # One picture at a time: the other cores run other scenarios.
                photographer = Photographer(world.scenario, self.camera, frames=1)
                stack.enter_context(photographer)
            name = file.removesuffix(".rrd")
            chunks: Any = recorded(world, photographer, BATCH, lambda *_: None, watch)
            recording_id = hashlib.sha256(f"{self.sweep_id} {name}".encode()).hexdigest()[:32]
            writer.record(
                self.folder / file,
                writer.named(chunks, name),
                recording_id=recording_id,
                blueprint=None,
                force=True,
            )


def _in_the_air(
    scenario: Scenario, engine: EngineReport, fall: list[Samples], step: int
) -> Moment | None:
    base = np.concatenate([each.bases[BODY] for each in fall])[: step + 1]
    if len(base) <= step:
        return None
    touched = any((each.contacts["step"] <= step).any() for each in fall)
    position_m, velocity_m_s = (base[:, MOTION[name]] for name in ("position_m", "velocity_m_s"))
    return moment_in_the_air(scenario, engine, position_m, velocity_m_s, touched=touched)
