"""What the recording of a drop holds, and in which order."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline import colours
from pipeline.messages import Message
from pipeline.recording import schema, writer
from pipeline.recording.about import about
from pipeline.recording.digest import FrameDigest, RowsDigest, inputs_digest
from pipeline.recording.writer import Chunk
from pipeline.report import EngineReport
from pipeline.scenario import ENGINES, Camera, Scenario
from pipeline.states import Batch, Rows, poses_of

Float64 = NDArray[np.float64]

TRAIL_POINTS = 40
"""Approximate number of points in the body's trail in the 3-D view."""

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and the total."""


@dataclass(frozen=True)
class Photography:
    """How the fall is photographed."""

    camera: Camera
    draw: Callable[[Float64], Iterator[bytes]]
    """From poses, shape (n, 7), to a PNG each."""
    pose: Callable[[Camera], Float64]
    """From a camera to its pose: world from camera, shape (4, 4)."""


def chunks_of(
    scenario: Scenario,
    engine: EngineReport,
    batches: Iterable[Batch],
    *,
    half_size_m: Float64,
    theory_m: Callable[[Float64], tuple[Float64, Float64]],
    photography: Photography | None,
    progress: Progress,
) -> Iterator[Chunk]:
    """Yield the whole recording: inputs, then the fall, and last the counts and digests.

    Parameters
    ----------
    scenario, engine
        What was dropped and how, and what the engine reported.
    batches
        All samples; each batch is requested after the previous one was yielded.
    half_size_m
        Half the body's extent along its own axes [m], shape (3,).
    theory_m
        From times [s], shape (n,), to the heights [m] of free and of damped fall.
    photography
        None where there are no frames.
    progress
        Called while it runs.
    """
    camera = None if photography is None else photography.camera
    inputs = {
        schema.SCENARIO_PROPERTY: asdict(scenario),
        schema.ENGINE_PROPERTY: engine.as_properties(),
    }
    if camera is not None:
        inputs[schema.CAMERA_PROPERTY] = asdict(camera)
    for name, values in inputs.items():
        yield writer.property_chunk(name, values)
    colour = colours.ENGINES[scenario.engine]
    yield from _scene(camera, tuple(half_size_m.tolist()), scenario.floor, colour)
    if photography is not None and photography.camera.view != "follow":
        pose = photography.pose(photography.camera)
        yield writer.camera_chunk(None, scenario.timestep_s, pose[None])
    yield from _curve_styles(scenario)
    yield writer.document_chunk(schema.ABOUT, about(scenario, camera, engine))

    timestep_s, samples, done = scenario.timestep_s, scenario.steps + 1, 0
    strobe = max(1, scenario.steps // TRAIL_POINTS)
    states, contacts, pictures = RowsDigest(), RowsDigest(), FrameDigest()
    for batch in batches:
        states.update(batch.states)
        contacts.update(batch.contacts)
        # Before the states: wherever the file ends, each sample in it has its contacts.
        if len(batch.contacts):
            yield writer.contacts_chunk(batch.contacts, timestep_s)
        yield from writer.state_chunks(batch.states, timestep_s)
        base = batch.base
        yield from _heights(base, timestep_s, theory_m)
        trail = base[base["step"] % strobe == 0]
        if len(trail):
            yield writer.trail_chunk(trail["step"], timestep_s, trail["position_m"], colour)
        if photography is not None:
            yield from _frames(photography, scenario, base, pictures, progress)
        done += len(base)
        progress(Message("stepping"), done, samples)

    yield writer.property_chunk(
        schema.RECORDING_PROPERTY,
        {
            "schema_version": schema.SCHEMA_VERSION,
            "samples": samples,
            "frames": 0 if camera is None else camera.frames_of(scenario.steps),
            "state_sha256": states.hexdigest(),
            "contacts_sha256": contacts.hexdigest(),
            "frames_sha256": pictures.hexdigest(),
            "inputs_sha256": inputs_digest(inputs),
        },
    )


@functools.lru_cache(maxsize=8)  # the runs of a sweep share it
def _scene(
    camera: Camera | None, half_size_m: tuple[float, ...], floor: bool, colour: str
) -> list[Chunk]:
    size_m = np.array(half_size_m)
    return list(writer.scene_chunks(camera, size_m, floor=floor, colour=colour))


def _curve_styles(scenario: Scenario) -> Iterator[Chunk]:
    engine = scenario.engine
    name = "simulated" if engine == "bullet" else ENGINES[engine]
    colour = colours.ENGINES[engine]
    yield writer.curve_style_chunk(schema.HEIGHT_SIMULATED, f"{name} [m]", colour)
    yield writer.curve_style_chunk(schema.HEIGHT_FREE_FALL, "free fall [m]", colours.FREE_FALL)
    yield writer.curve_style_chunk(
        schema.HEIGHT_DAMPED_FALL, "damped fall [m]", colours.DAMPED_FALL
    )


def _heights(
    base: Rows, timestep_s: float, theory_m: Callable[[Float64], tuple[Float64, Float64]]
) -> Iterator[Chunk]:
    """Yield the height curves."""
    free_m, damped_m = theory_m(base["step"].astype(np.float64) * timestep_s)
    curves = {
        schema.HEIGHT_SIMULATED: base["position_m"][:, 2],
        schema.HEIGHT_FREE_FALL: free_m,
        schema.HEIGHT_DAMPED_FALL: damped_m,
    }
    for entity, values in curves.items():
        yield writer.curve_chunk(
            entity, base["step"], timestep_s, values, resolution=schema.HEIGHT_RESOLUTION_M
        )


def _frames(
    photography: Photography,
    scenario: Scenario,
    base: Rows,
    digest: FrameDigest,
    progress: Progress,
) -> Iterator[Chunk]:
    """Yield the frames due among these samples, drawn from the recorded poses."""
    camera, timestep_s = photography.camera, scenario.timestep_s
    due = base[base["step"] % camera.capture_every == 0]
    if camera.view == "follow" and len(due):
        poses = [photography.pose(camera.looking_at(tuple(at))) for at in due["position_m"]]
        yield writer.camera_chunk(due["step"], timestep_s, np.array(poses))
    total = camera.frames_of(scenario.steps)
    for step, png in zip(due["step"].tolist(), photography.draw(poses_of(due)), strict=True):
        digest.update(step, png)
        yield writer.image_chunk(step, timestep_s, png)
        progress(Message("drawing frames"), camera.frames_of(step), total)
