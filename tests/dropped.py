"""A drop as it is analyzed, without a file between simulation and analysis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drop_physics.drop.case import Case
from drop_physics.drop.course import Course
from drop_physics.drop.results import DropAnalysis
from drop_physics.drop.samples import DropSamples
from drop_physics.drop.story import drop_analysis_of
from drop_physics.engines.pybullet.world import World
from drop_physics.stages.recorded import BATCH, bodies_of, made_with
from drop_physics.trace.events import Appearance, Body, Dynamics, Settings
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.log import Log
from drop_physics.trace.states import (
    BASE_STATE,
    BODY,
    Batch,
    Joints,
    Rows,
    base_of,
    between,
)


@dataclass(frozen=True)
class Sampled:
    """Samples of one simulation, in memory."""

    states: Rows
    contacts: Rows
    joints: Joints | None
    first: int = 0

    @property
    def last(self) -> int:
        """The last step."""
        return int(self.states["step"].max())

    def piece(self, first: int, end: int) -> Piece:
        """Return what was sampled of some steps."""
        bases = base_of(between(self.states, first, end))[[*(BASE_STATE.names or ())]]
        joints = {} if self.joints is None else {BODY: self.joints.at(slice(first, end))}
        return Piece(
            first,
            end,
            bases.astype(BASE_STATE),
            joints,
            {},
            between(self.contacts, first, end),
            Log(),
        )


def departs(case: Case, samples: Iterable[DropSamples]) -> int | None:
    """Return the first sample in the air that the law does not lead to."""
    course = Course(case)
    for part in samples:
        course.add(part)
    return course.air.departs


def analysis_of_world(world: World) -> DropAnalysis:
    """Drop the body of a world, and analyze that."""
    batch, engine = Batch.joined([*world.samples(BATCH)]), made_with(world)
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
        readings=[],
        puts=[],
        samples={},
        sampled=Sampled(batch.states, batch.contacts, batch.joints),
        real_time=False,
        unseeded=(),
        machine=engine.machine or "",
    )
    return drop_analysis_of(world.scenario, engine, seen)
