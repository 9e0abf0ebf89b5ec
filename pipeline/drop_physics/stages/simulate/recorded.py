"""Simulates a drop and yields its recording, for `simulate` and sweeps."""

from __future__ import annotations

import functools
import platform
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drop_physics import colours
from drop_physics.arrays import Float64
from drop_physics.drop.case import DropCase
from drop_physics.engine_report import EngineReport
from drop_physics.engines.other_world import OtherWorld
from drop_physics.engines.worlds import engine_versions
from drop_physics.messages import Message
from drop_physics.physics import theory
from drop_physics.physics.laws.lookup import fall_of
from drop_physics.recording import schema
from drop_physics.recording.about import about_drop
from drop_physics.recording.falling import Falling, Photography, Progress
from drop_physics.recording.recorder import Recorder
from drop_physics.recording.writer import Chunk
from drop_physics.trace.events import (
    Appearance,
    At,
    Body,
    Dynamics,
    Ending,
    Event,
    Samples,
    Settings,
    Shape,
)
from drop_physics.trace.history import seen_in
from drop_physics.trace.states import BASE, BODY, BODY_LABEL, FLOOR, FLOOR_LABEL

if TYPE_CHECKING:
    from drop_physics.engines.pybullet.camera_frames import Photographer
    from drop_physics.engines.pybullet.world import World

BATCH = 8192
"""Number of samples in a chunk of a recording, which is the most that a killed run loses. Larger
chunks take more memory while they are packed; smaller ones enlarge the index at the end of the
file."""
FLOOR_M = (1.5, 1.5)
"""Size of the drawn part of the floor [m]."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def recorded(
    world: World | OtherWorld,
    photographer: Photographer | None,
    batch: int,
    progress: Progress,
    watch: Callable[[Samples], object] = lambda _: None,
) -> Iterator[Chunk]:
    """Simulate a drop, and yield the chunks of its recording.

    `watch` is also called with all samples.
    """
    scenario, photography, gl_renderer = world.scenario, None, None
    if photographer is not None:
        from drop_physics.engines.pybullet.visible_world import world_from_camera

        photography = Photography(photographer.camera, photographer.draw, world_from_camera)
        gl_renderer = photographer.gl_renderer
    fall = fall_of(scenario)
    floor_m = world.rest_height_m if scenario.floor else None

    def theory_m(time_s: Float64) -> tuple[Float64, Float64]:
        """Return the heights of free and damped fall, down to the floor [m]."""
        return (
            theory.stopped_by_floor(theory.free_fall_height(fall, time_s), floor_m),
            theory.stopped_by_floor(theory.damped_fall_height(fall, time_s), floor_m),
        )

    engine = made_with(world, gl_renderer=gl_renderer)
    camera = None if photographer is None else photographer.camera
    inputs = {
        schema.SCENARIO_PROPERTY: asdict(scenario),
        schema.ENGINE_PROPERTY: engine.as_properties(),
    }
    if camera is not None:
        inputs[schema.CAMERA_PROPERTY] = asdict(camera)
    recorder = Recorder(inputs, of_drop=True)
    falling = Falling(scenario, theory_m, photography, progress)

    def events() -> Iterator[Event]:
        yield from bodies_of(world, engine)
        for sample in world.samples(batch):
            watch(sample)
            yield sample
            progress(Message("stepping"), int(sample.steps[-1]) + 1, scenario.steps + 1)

    return recorder.chunks(
        events(),
        lambda: Ending("finished"),
        lambda _: about_drop(scenario, camera, engine),
        falling,
    )


def case_of(world: World | OtherWorld, samples: Iterable[Samples]) -> DropCase:
    """Return the input of an analysis from a world's samples, without a recording."""
    engine = made_with(world)
    return DropCase(world.scenario, engine, seen_in([*bodies_of(world, engine), *samples]))


def bodies_of(world: World | OtherWorld, engine: EngineReport) -> Iterator[Event]:
    """Yield the events that precede the first step: body, floor, and engine settings."""
    at, scenario = At(0, 0.0, 0), world.scenario
    joints = world.joints
    rgb = bytes.fromhex(colours.ENGINES[scenario.engine].removeprefix("#"))
    shape = Shape(
        BASE,
        "box",
        tuple((2 * world.half_size_m).tolist()),
        "",
        (0.0, 0.0, 0.0),
        UPRIGHT,
        (*(channel / 255 for channel in rgb), 1.0),
    )
    links = (engine.body_name, *(joint.name for joint in joints))
    body = Body(
        BODY,
        BODY_LABEL,
        Path(scenario.body).name,
        BODY,
        0,
        links,
        joints,
        tuple(range(BASE, len(joints))),
        soft=False,
        shapes=(shape,),
    )
    yield Settings(
        at,
        0,
        {
            "fixedTimeStep": engine.timestep_s,
            "numSubSteps": engine.substeps,
            **{
                f"gravityAcceleration{axis}": value
                for axis, value in zip("XYZ", engine.gravity_m_s2, strict=True)
            },
        },
    )
    yield Appearance(at, body, there=True, came=True)
    frames = world.inertial_frames
    yield Dynamics(
        at,
        body,
        world.dynamics()
        | {
            "mass_kg": np.array(engine.link_masses_kg),
            "inertia_kg_m2": np.reshape(engine.link_inertias_kg_m2, (-1, 3)),
            "inertial_position_m": frames[:, :3],
            "inertial_orientation": frames[:, 3:],
        },
    )
    if scenario.floor:
        plane = Shape(BASE, "plane", FLOOR_M, "", (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0, 1.0))
        floor = Body(
            FLOOR,
            FLOOR_LABEL,
            "plane.urdf",
            FLOOR,
            0,
            ("base",),
            (),
            (),
            soft=False,
            shapes=(plane,),
        )
        yield Appearance(at, floor, there=True, came=True)
        if dynamics := world.dynamics(FLOOR):
            yield Dynamics(at, floor, dynamics)


def made_with(world: World | OtherWorld, *, gl_renderer: str | None = None) -> EngineReport:
    """Return an engine's report, with the versions of all software involved."""
    versions: dict[str, Any] = engine_versions() | library_versions()
    return replace(world.report(), gl_renderer=gl_renderer or None, **versions)


@functools.cache
def library_versions() -> dict[str, str]:
    """Return the versions of the libraries involved, and the processor type."""
    return {
        "drop_version": metadata.version("drop-physics"),
        "numpy_version": metadata.version("numpy"),
        "rerun_version": metadata.version("rerun-sdk"),
        "python_version": platform.python_version(),
        "machine": platform.machine(),
    }
