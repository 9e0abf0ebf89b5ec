"""Drop the body, and record everything that happens."""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drop_physics.engines.worlds import find_body, world_of
from drop_physics.errors import check_suffix
from drop_physics.files.outputs import check_apart, check_room, check_target
from drop_physics.installed import PYBULLET, is_installed, next_step
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.recording import writer
from drop_physics.recording.falling import Progress
from drop_physics.recording.layout import layout, look_of_drop
from drop_physics.recording.live import shown
from drop_physics.scenario import BYTES_PER_SAMPLE, STANDARD_CAMERA, Camera, Scenario
from drop_physics.stages.recorded import BATCH, recorded
from drop_physics.workers import Worker

LIVE_EVERY_S = 1 / 30
"""Simulated time between two pictures of a live view [s]."""
LARGE_BYTES = 1_000_000_000
"""The size from which on a note before the start says what a recording takes."""


@dataclass(frozen=True)
class Simulation(Printable, reported_by="drop_physics.report.run"):
    """What was recorded of a drop."""

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
        The recording to write; it gets this name only when it is complete and verified.
    camera
        How to take frames of the fall, or None for no frames.
    force
        Whether an existing file may be replaced.
    viewer
        Called before the fall, to return the URL of a viewer to show it live; or None.
    note
        Called with a sentence worth knowing that is not an error.
    progress
        Called while it runs.
    assistant
        A worker to draw frames; more are started if there are many frames.

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
    if camera is not None and not is_installed(PYBULLET):
        camera = None
        note(
            Message(
                "no frames are taken: PyBullet draws them, which is not installed; {next}",
                next=next_step(),
            )
        )
    body = find_body(scenario.body)
    check_target(path, force=force)
    check_suffix("--out", path, (".rrd",))
    _check_size(path, scenario.steps + 1, note)
    _note_gravity(scenario, note)
    check_apart([path], inputs=[body])
    recording_id = uuid.uuid4().hex
    frames = 0 if camera is None else camera.frames_of(scenario.steps)
    url = None if viewer is None else viewer()
    batch = BATCH if url is None else max(1, round(LIVE_EVERY_S / scenario.timestep_s))
    look = look_of_drop(scenario.height_m, camera.view if camera else None)
    with contextlib.ExitStack() as stack:
        photographer = None
        if camera is not None:
            from drop_physics.engines.pybullet.camera_frames import Photographer

            photographer = stack.enter_context(
                Photographer(scenario, camera, frames=frames, note=note, assistant=assistant)
            )
        world = world_of(scenario)
        stack.enter_context(world)
        for sentence in world.notes():
            note(sentence)
        chunks = writer.named(recorded(world, photographer, batch, progress), path.stem)
        if url is not None:
            chunks = shown(chunks, url=url, recording_id=recording_id, look=look, note=note)
        writer.record(
            path,
            chunks,
            recording_id=recording_id,
            blueprint=layout(look),
            force=force,
            note=note,
        )
    return Simulation(
        recording=path,
        recording_id=recording_id,
        samples=scenario.steps + 1,
        frames=frames,
        bytes=path.stat().st_size,
        wall_s=time.perf_counter() - began,
    )


def _note_gravity(scenario: Scenario, note: Callable[[str], None]) -> None:
    """Note that gravity points upwards."""
    up = scenario.gravity_m_s2
    if scenario.effective_gravity_m_s2 > 0:
        note(
            Message(
                "gravity points upwards: {up:+g} m/s²; the body will rise; try --gravity {down:g} "
                "to let it fall",
                up=up,
                down=-up,
            )
        )


def _check_size(path: Path, samples: int, note: Callable[[str], None]) -> None:
    """Check that there is room for a recording, and note what a large one takes."""
    size = samples * BYTES_PER_SAMPLE
    check_room(path, 2 * size)  # it is copied when it is sealed
    if size > LARGE_BYTES:
        note(
            Message(
                "{samples:,} samples take about {disk:.2g} GB on disk, twice that while they are "
                "sealed",
                samples=samples,
                disk=size / 1e9,
            )
        )
