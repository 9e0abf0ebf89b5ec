"""Analyze a drop in memory, without a file between simulation and analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import polars as pl
from altered import otherwise
from drop_physics.drop.case import DropCase
from drop_physics.drop.course import Course
from drop_physics.drop.results import DropAnalysis
from drop_physics.drop.story import drop_analysis_of
from drop_physics.engines.other_world import OtherWorld
from drop_physics.recording.reader import Recording
from drop_physics.stages.simulate.recorded import BATCH, case_of
from drop_physics.trace.events import Samples
from drop_physics.trace.history import Seen

if TYPE_CHECKING:
    from drop_physics.engines.pybullet.world import World


def seen_with(
    seen: Seen, states: pl.DataFrame | None, contacts: pl.DataFrame | None = None
) -> Seen:
    """Return the record of a drop with its body's states or contact points replaced."""
    given = {"contacts": contacts}
    if states is not None:
        given["bases"] = states.filter(pl.col("link") == -1).sort("step")
    return otherwise(seen, **{name: each for name, each in given.items() if each is not None})


def case_with(recording: Recording, states: pl.DataFrame | None = None) -> DropCase:
    """Return a recording's drop, optionally with its states replaced."""
    return DropCase(recording.scenario, recording.engine, seen_with(recording.seen, states))


def dropped_whole(world: World | OtherWorld) -> Samples:
    """Drop the body of a world, and return all samples as one chunk."""
    (samples,) = world.samples(world.scenario.steps + 1)
    return samples


def departs(case: DropCase) -> int | None:
    """Return the first airborne sample that the integration rule does not lead to."""
    course = Course(case)
    for part in case.parts():
        course.add(part)
    return course.air.departs


def analysis_of_world(world: World) -> DropAnalysis:
    """Drop the body of a world, and return the analysis."""
    case = case_of(world, world.samples(BATCH))
    return drop_analysis_of(case.scenario, case.engine, case.seen)
