"""A drop as it is analyzed, without a file between simulation and analysis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import polars as pl
from drop_physics.drop.case import Case
from drop_physics.drop.course import Course
from drop_physics.drop.results import DropAnalysis
from drop_physics.drop.samples import Samples
from drop_physics.drop.story import drop_analysis_of
from drop_physics.engines.pybullet.world import World
from drop_physics.recording.rows import tables_of
from drop_physics.stages.recorded import BATCH, bodies_of, made_with
from drop_physics.trace.events import Appearance, Body, Dynamics, Settings
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.log import Log
from drop_physics.trace.states import BASE, BODY, Batch, Joints


@dataclass(frozen=True)
class Sampled:
    """Samples of one simulation, in memory."""

    states: pl.DataFrame
    contacts: pl.DataFrame
    joints: Joints | None
    first: int = 0

    @property
    def last(self) -> int:
        """The last step."""
        return int(self.states["step"].max())  # type: ignore[arg-type]

    def piece(self, first: int, end: int) -> Piece:
        """Return what was sampled of some steps."""
        its = (pl.col("step") >= first) & (pl.col("step") < end)
        bases = self.states.filter(its & (pl.col("link") == BASE)).drop("link")
        joints = {} if self.joints is None else {BODY: self.joints.at(slice(first, end))}
        return Piece(first, end, bases, joints, {}, self.contacts.filter(its), Log())


def departs(case: Case, samples: Iterable[Samples]) -> int | None:
    """Return the first sample in the air that the law does not lead to."""
    course = Course(case)
    for part in samples:
        course.add(part)
    return course.air.departs


def analysis_of_world(world: World) -> DropAnalysis:
    """Drop the body of a world, and analyze that."""
    batch, engine = Batch.joined([*world.samples(BATCH)]), made_with(world)
    states, contacts = tables_of(batch)
    events = [*bodies_of(world, engine)]
    appearances = [each for each in events if isinstance(each, Appearance)]
    bodies: dict[int, Body] = {each.body.number: each.body for each in appearances}
    seen = Seen(
        bodies=bodies,
        appearances=appearances,
        dynamics=[each for each in events if isinstance(each, Dynamics)],
        settings=[each for each in events if isinstance(each, Settings)],
        surfaces=[],
        solvers=[],
        puts=[],
        samples={},
        sampled=Sampled(states, contacts, batch.joints),
        real_time=False,
        unseeded=(),
        machine=engine.machine or "",
    )
    return drop_analysis_of(world.scenario, engine, seen)
