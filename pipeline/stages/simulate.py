"""Drop the body, and put everything that happens into one recording."""

from __future__ import annotations

import contextlib
import functools
import platform
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline import colours
from pipeline.engines.bullet.camera_frames import Photographer
from pipeline.engines.bullet.engine import engine_versions, find_body
from pipeline.engines.bullet.visible_world import world_from_camera
from pipeline.engines.bullet.world import World
from pipeline.errors import check_suffix
from pipeline.laws import theory
from pipeline.laws.bullet_air import fall_of
from pipeline.recording import schema, writer
from pipeline.recording.about import about
from pipeline.recording.blueprint import Look, layout
from pipeline.recording.digest import FrameDigest, StateDigest, inputs_digest
from pipeline.recording.live import shown
from pipeline.recording.outputs import check_apart, check_room, check_target
from pipeline.recording.writer import Chunk
from pipeline.report import EngineReport
from pipeline.scenario import (
    ANALYSIS_BYTES_PER_SAMPLE,
    BYTES_PER_SAMPLE,
    STANDARD_CAMERA,
    Camera,
    Scenario,
)
from pipeline.workers import Worker

Float64 = NDArray[np.float64]

BATCH = 16384
"""Samples in one chunk of a recording: what a killed run loses at most."""

LIVE_EVERY_S = 1 / 30
"""Simulated time between two pictures of a live view [s]."""

LARGE_BYTES = 1_000_000_000
"""From here on it is said before the start what a recording takes."""

TRAIL_POINTS = 40
"""How many points the body leaves behind in the 3-D view, about."""

Progress = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done, and out of how much."""


@dataclass(frozen=True)
class Simulation:
    """What a run made."""

    recording: Path
    """The file."""
    recording_id: str
    """Its id, which its layer shares."""
    samples: int
    """How many samples it holds: one more than steps."""
    frames: int
    """How many camera frames it holds."""
    bytes: int
    """Its size."""
    wall_s: float
    """How long it took [s]."""


def simulate(
    scenario: Scenario,
    out: Path | str,
    *,
    camera: Camera | None = STANDARD_CAMERA,
    force: bool = False,
    viewer: Callable[[], str] | None = None,
    note: Callable[[str], None] = lambda _: None,
    progress: Progress = lambda *_: None,
    assistant: Worker | None = None,
) -> Simulation:
    """Drop the body of a scenario and record it, the state before each step and after the last.

    Parameters
    ----------
    scenario
        What to drop, and how.
    out
        The recording to write; it has this name only when it is whole and verified.
    camera
        How to photograph the fall, or None for no frames.
    force
        Whether an existing file may be replaced.
    viewer
        Called before the fall, to return the URL of a viewer that is to show it live; or None.
    note
        Told in a sentence what is worth knowing but no reason to stop.
    progress
        Called while it runs.
    assistant
        A worker to draw frames with; where there are many, others help it.

    Raises
    ------
    ScenarioError
        If the body cannot be found or loaded, or the recording's name does not end in .rrd.
    OutputError
        If the recording cannot be written, or would replace the body.
    ViewerError
        If no viewer can be reached.
    """
    began = time.perf_counter()
    path = Path(out)
    check_target(path, force=force)
    check_suffix("--out", path, (".rrd",))
    _check_size(path, scenario.steps + 1, note)
    if scenario.effective_gravity_m_s2 > 0:
        up = scenario.gravity_m_s2
        note(
            f"gravity points upwards: {up:+g} m/s²; the body will rise; try --gravity {-up:g} to "
            "let it fall"
        )
    check_apart([path], inputs=[find_body(scenario.body)])
    recording_id = uuid.uuid4().hex
    frames = 0 if camera is None else camera.frames_of(scenario.steps)
    url = None if viewer is None else viewer()
    batch = BATCH if url is None else max(1, round(LIVE_EVERY_S / scenario.timestep_s))
    look = Look(height_m=scenario.height_m, camera=camera.view if camera else None)
    with contextlib.ExitStack() as stack:
        photographer = None
        if camera is not None:
            photographer = stack.enter_context(
                Photographer(scenario, camera, frames=frames, note=note, assistant=assistant)
            )
        world = stack.enter_context(World(scenario))
        chunks = chunks_of(world, photographer, batch, progress)
        if url is not None:
            chunks = shown(chunks, url=url, recording_id=recording_id, look=look, note=note)
        writer.record(
            path, chunks, recording_id=recording_id, blueprint=layout(**look), force=force,
            note=note,
        )  # fmt: skip
    return Simulation(
        recording=path,
        recording_id=recording_id,
        samples=scenario.steps + 1,
        frames=frames,
        bytes=path.stat().st_size,
        wall_s=time.perf_counter() - began,
    )


def chunks_of(
    world: World, photographer: Photographer | None, batch: int, progress: Progress
) -> Iterator[Chunk]:
    """Yield the whole recording: what it was made with, the fall, and last what must be in it."""
    scenario = world.scenario
    camera = None if photographer is None else photographer.camera
    engine = made_with(world, gl_renderer=photographer.gl_renderer if photographer else None)
    inputs = {
        schema.SCENARIO_PROPERTY: asdict(scenario),
        schema.ENGINE_PROPERTY: engine.as_properties(),
    }
    if camera is not None:
        inputs[schema.CAMERA_PROPERTY] = asdict(camera)
    for name, values in inputs.items():
        yield writer.property_chunk(name, values)
    yield from writer.scene_chunks(camera, world.half_size_m, floor=scenario.floor)
    if camera is not None and camera.view != "follow":
        pose = world_from_camera(camera)
        yield writer.camera_chunk(None, scenario.timestep_s, pose[None])
    yield from _curve_styles()
    yield writer.document_chunk(schema.ABOUT, about(scenario, camera, engine))

    samples = scenario.steps + 1
    digest, pictures = StateDigest(), FrameDigest()
    first, strobe = 0, max(1, scenario.steps // TRAIL_POINTS)
    for rows in world.samples(batch):
        steps = np.arange(first, first + len(rows))
        digest.update(rows)
        yield from writer.state_chunks(steps, scenario.timestep_s, rows)
        yield from _heights(scenario, world.rest_height_m, steps, rows[:, 2])
        lit = steps % strobe == 0
        if lit.any():
            yield writer.trail_chunk(steps[lit], scenario.timestep_s, rows[lit, :3])
        if photographer is not None:
            yield from _frames(photographer, steps, rows, pictures, progress)
        first += len(rows)
        progress("stepping", first, samples)

    yield writer.property_chunk(
        schema.RECORDING_PROPERTY,
        {
            "schema_version": schema.SCHEMA_VERSION,
            "samples": samples,
            "frames": 0 if camera is None else camera.frames_of(scenario.steps),
            "state_sha256": digest.hexdigest(),
            "frames_sha256": pictures.hexdigest(),
            "inputs_sha256": inputs_digest(inputs),
        },
    )


def _check_size(path: Path, samples: int, note: Callable[[str], None]) -> None:
    """Make sure that there is room for a recording, and say of a large one what it takes."""
    size = samples * BYTES_PER_SAMPLE
    check_room(path, 2 * size)  # it is copied when it is sealed
    if size > LARGE_BYTES:
        memory = samples * ANALYSIS_BYTES_PER_SAMPLE
        note(
            f"{samples:,} samples take some {size / 1e9:.2g} GB on the disk, twice that while they "
            f"are sealed, and {memory / 1e9:.2g} GB of memory to analyze"
        )


def _curve_styles() -> Iterator[Chunk]:
    yield writer.curve_style_chunk(schema.HEIGHT_SIMULATED, "simulated [m]", colours.SIMULATED)
    yield writer.curve_style_chunk(schema.HEIGHT_FREE_FALL, "free fall [m]", colours.FREE_FALL)
    yield writer.curve_style_chunk(
        schema.HEIGHT_DAMPED_FALL, "damped fall [m]", colours.DAMPED_FALL
    )


def _heights(
    scenario: Scenario, rest_height_m: float | None, steps: NDArray[np.int64], simulated_m: Float64
) -> Iterator[Chunk]:
    """Yield the height curves; theory stops at the floor and stays at the rest height."""
    fall, time_s = fall_of(scenario), steps.astype(np.float64) * scenario.timestep_s
    free_m, damped_m = (
        theory.stopped_by_floor(height(fall, time_s), rest_height_m if scenario.floor else None)
        for height in (theory.free_fall_height, theory.damped_fall_height)
    )
    curves = {
        schema.HEIGHT_SIMULATED: simulated_m,
        schema.HEIGHT_FREE_FALL: free_m,
        schema.HEIGHT_DAMPED_FALL: damped_m,
    }
    for entity, values in curves.items():
        yield writer.curve_chunk(
            entity, steps, scenario.timestep_s, values, resolution=schema.HEIGHT_RESOLUTION_M
        )


def _frames(
    photographer: Photographer,
    steps: NDArray[np.int64],
    rows: Float64,
    digest: FrameDigest,
    progress: Progress,
) -> Iterator[Chunk]:
    """Yield the frames due among these samples, drawn from the recorded poses."""
    scenario, camera = photographer.scenario, photographer.camera
    due = steps % camera.capture_every == 0
    if camera.view == "follow" and due.any():
        poses = [world_from_camera(camera.looking_at((x, y, z))) for x, y, z in rows[due, :3]]
        yield writer.camera_chunk(steps[due], scenario.timestep_s, np.array(poses))
    total = camera.frames_of(scenario.steps)
    for step, png in zip(steps[due], photographer.draw(rows[due, :7]), strict=True):
        digest.update(int(step), png)
        yield writer.image_chunk(step, scenario.timestep_s, png)
        progress("drawing frames", camera.frames_of(int(step)), total)


def made_with(world: World, *, gl_renderer: str | None = None) -> EngineReport:
    """Return what a world reports, with the versions of all that takes part in a recording."""
    versions: dict[str, Any] = engine_versions() | library_versions()
    return replace(world.report(), gl_renderer=gl_renderer or None, **versions)


@functools.cache
def library_versions() -> dict[str, str]:
    """Return the versions of what takes part in a recording, and what it is made on."""
    return {
        "drop_version": metadata.version("drop-physics"),
        "numpy_version": metadata.version("numpy"),
        "rerun_version": metadata.version("rerun-sdk"),
        "python_version": platform.python_version(),
        "machine": platform.machine(),
    }
