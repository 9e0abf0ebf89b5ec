"""The command `simulate`: drops a body, and records everything that happens."""

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
from drop_physics.recording.layout import layout, look_of_drop
from drop_physics.recording.live import shown
from drop_physics.scenario import BYTES_PER_SAMPLE, Scenario
from drop_physics.stages import verbs
from drop_physics.stages.simulate.recorded import BATCH, recorded
from drop_physics.stages.verbs.taken import takes_those_of

LIVE_EVERY_S = 1 / 30
"""Simulated time between two images of a live view [s]."""
LARGE_BYTES = 1_000_000_000
"""Size from which a note announces how much space a recording takes [bytes]."""


@dataclass(frozen=True)
class Simulation(Printable, reported_by="drop_physics.report.run"):
    """The recording of a drop."""

    recording: Path
    """Path of the recording."""
    recording_id: str
    """Id of the recording; its analysis layer has the same id."""
    samples: int
    """Number of samples: one more than the number of steps."""
    frames: int
    """Number of camera frames."""
    bytes: int
    """Size of the recording [bytes]."""
    wall_s: float
    """Wall-clock time of the simulation [s]."""


@takes_those_of(verbs.SimulateArguments)
def simulate(asked: verbs.SimulateArguments) -> Simulation:
    """Drop the body of a scenario; record the states before each step and after the last.

    Raises
    ------
    ScenarioError
        If the body cannot be found or loaded, or the recording's name does not end in .rrd.
    OutputError
        If the recording cannot be written, or would replace the body.
    ViewerError
        If no viewer can be reached.
    """
    camera = asked.camera
    began = time.perf_counter()
    path = Path(asked.out)
    if camera is not None and not is_installed(PYBULLET):
        camera = None
        asked.note(
            Message(
                "no frames are taken: PyBullet draws them, which is not installed; {next}",
                next=next_step(),
            )
        )
    body = find_body(asked.scenario.body)
    check_target(path, force=asked.force)
    check_suffix("--out", path, (".rrd",))
    _check_size(path, asked.scenario.steps + 1, asked.note)
    _note_gravity(asked.scenario, asked.note)
    check_apart([path], inputs=[body])
    recording_id = uuid.uuid4().hex
    frames = 0 if camera is None else camera.frames_of(asked.scenario.steps)
    url = None if asked.viewer is None else asked.viewer()
    batch = BATCH if url is None else max(1, round(LIVE_EVERY_S / asked.scenario.timestep_s))
    look = look_of_drop(asked.scenario.height_m, camera.view if camera else None)
    with contextlib.ExitStack() as stack:
        photographer = None
        if camera is not None:
            from drop_physics.engines.pybullet.camera_frames import Photographer

            photographer = stack.enter_context(
                Photographer(
                    asked.scenario,
                    camera,
                    frames=frames,
                    note=asked.note,
                    assistant=asked.assistant,
                )
            )
        world = world_of(asked.scenario)
        stack.enter_context(world)
        for sentence in world.notes():
            asked.note(sentence)
        chunks = writer.named(recorded(world, photographer, batch, asked.progress), path.stem)
        if url is not None:
            chunks = shown(chunks, url=url, recording_id=recording_id, look=look, note=asked.note)
        writer.record(
            path,
            chunks,
            recording_id=recording_id,
            blueprint=layout(look),
            force=asked.force,
            note=asked.note,
        )
    return Simulation(
        recording=path,
        recording_id=recording_id,
        samples=asked.scenario.steps + 1,
        frames=frames,
        bytes=path.stat().st_size,
        wall_s=time.perf_counter() - began,
    )


def _note_gravity(scenario: Scenario, note: Callable[[str], None]) -> None:
    """Tell the user if gravity points upwards."""
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
    """Check that the disk has room for a recording, and note the size if it is large."""
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
