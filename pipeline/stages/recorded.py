"""A world's fall as the chunks of a recording, for `simulate` and each run of a sweep."""

from __future__ import annotations

import functools
import platform
from collections.abc import Iterator
from dataclasses import replace
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.engines.bullet.camera_frames import Photographer
from pipeline.engines.bullet.engine import engine_versions
from pipeline.engines.bullet.visible_world import world_from_camera
from pipeline.engines.bullet.world import World
from pipeline.engines.other_world import OtherWorld
from pipeline.laws import theory
from pipeline.laws.lookup import fall_of
from pipeline.recording import drop
from pipeline.recording.drop import Photography, Progress
from pipeline.recording.writer import Chunk
from pipeline.report import EngineReport

Float64 = NDArray[np.float64]

BATCH = 8192
"""Samples in one chunk of a recording: the most that a killed run loses. Longer chunks take memory
while they are packed, shorter ones for the index at the end of the file."""


def recorded(
    world: World | OtherWorld, photographer: Photographer | None, batch: int, progress: Progress
) -> Iterator[Chunk]:
    """Let the body of a world fall, and yield the chunks of its recording."""
    scenario, photography, gl_renderer = world.scenario, None, None
    if photographer is not None:
        photography = Photography(photographer.camera, photographer.draw, world_from_camera)
        gl_renderer = photographer.gl_renderer
    fall = fall_of(scenario)
    floor_m = world.rest_height_m if scenario.floor else None

    def theory_m(time_s: Float64) -> tuple[Float64, Float64]:
        """Return the heights of both theories, which stop at the floor."""
        return (
            theory.stopped_by_floor(theory.free_fall_height(fall, time_s), floor_m),
            theory.stopped_by_floor(theory.damped_fall_height(fall, time_s), floor_m),
        )

    return drop.chunks_of(
        scenario,
        made_with(world, gl_renderer=gl_renderer),
        world.samples(batch),
        half_size_m=world.half_size_m,
        theory_m=theory_m,
        photography=photography,
        progress=progress,
    )


def made_with(world: World | OtherWorld, *, gl_renderer: str | None = None) -> EngineReport:
    """Return what a world reports, with the versions of everything involved in a recording."""
    versions: dict[str, Any] = engine_versions() | library_versions()
    return replace(world.report(), gl_renderer=gl_renderer or None, **versions)


@functools.cache
def library_versions() -> dict[str, str]:
    """Return the versions of the libraries involved in a recording, and the machine's kind."""
    return {
        "drop_version": metadata.version("drop-physics"),
        "numpy_version": metadata.version("numpy"),
        "rerun_version": metadata.version("rerun-sdk"),
        "python_version": platform.python_version(),
        "machine": platform.machine(),
    }
