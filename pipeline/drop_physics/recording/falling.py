"""Writes a drop's extra views: theoretical heights, the body's path, camera frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics import colours
from drop_physics.arrays import Float64, Int64
from drop_physics.messages import Message
from drop_physics.recording import pictures, schema, writer
from drop_physics.recording.writer import Chunk
from drop_physics.scenario import ENGINES, Camera, Scenario
from drop_physics.trace.events import Samples
from drop_physics.trace.states import BODY

TRAIL_POINTS = 40
"""Approximate number of points in the body's path in the 3-D view."""

Progress = Callable[[str, int, int], None]
"""Progress callback: called with the activity, the amount done, and the total."""


@dataclass(frozen=True)
class Photography:
    """How the camera takes frames of the fall."""

    camera: Camera
    draw: Callable[[Float64], Iterator[bytes]]
    """Function that draws poses, shape (n, 7), each as a PNG."""
    pose: Callable[[Camera], Float64]
    """Function that returns a camera's pose: world from camera, shape (4, 4)."""


@dataclass(frozen=True)
class Falling:
    """Writes the extra views of a drop; camera frames are also kept in `pictures`."""

    scenario: Scenario
    theory_m: Callable[[Float64], tuple[Float64, Float64]]
    """Function from times [s], shape (n,), to the heights [m] of free and of damped fall."""
    photography: Photography | None
    """The camera; None if no frames are taken."""
    progress: Progress

    def begin(self) -> Iterator[Chunk]:
        """Yield static chunks: the camera's lens, and the curves' names and colours."""
        if self.photography is not None:
            camera, timestep_s = self.photography.camera, self.scenario.timestep_s
            yield writer.lens_chunk(camera)
            if camera.view != "follow":
                pose = self.photography.pose(camera)
                yield writer.camera_chunk(None, timestep_s, pose[None])
        engine = self.scenario.engine
        name = "simulated" if engine == "bullet" else ENGINES[engine]
        for entity, label, colour in (
            (schema.HEIGHT_SIMULATED, f"{name} [m]", colours.ENGINES[engine]),
            (schema.HEIGHT_FREE_FALL, "free fall [m]", colours.FREE_FALL),
            (schema.HEIGHT_DAMPED_FALL, "damped fall [m]", colours.DAMPED_FALL),
        ):
            yield writer.curve_style_chunk(entity, label, colour)
        yield pictures.trail_style(schema.TRAIL, writer.rgba(colours.ENGINES[engine]))

    def chunks(self, seen: Samples) -> Iterator[Chunk]:
        """Yield the heights and the path."""
        timestep_s, base = self.scenario.timestep_s, seen.bases[BODY]
        free_m, damped_m = self.theory_m(seen.steps.astype(np.float64) * timestep_s)
        curves = {
            schema.HEIGHT_SIMULATED: np.ascontiguousarray(base[:, 2]),
            schema.HEIGHT_FREE_FALL: free_m,
            schema.HEIGHT_DAMPED_FALL: damped_m,
        }
        for entity, values in curves.items():
            yield writer.curve_chunk(
                entity, seen.steps, timestep_s, values, resolution=schema.HEIGHT_RESOLUTION_M
            )
        trail = seen.steps % max(1, self.scenario.steps // TRAIL_POINTS) == 0
        if trail.any():
            at = writer.at(seen.steps[trail], timestep_s)
            yield pictures.trail(schema.TRAIL, at, [base[trail, :3]])

    def frames(self, seen: Samples) -> Iterator[tuple[int, bytes, list[Chunk]]]:
        """Yield the camera frames that are due in these samples: step, PNG, and chunks."""
        if self.photography is None:
            return
        camera, timestep_s = self.photography.camera, self.scenario.timestep_s
        due = seen.steps % camera.capture_every == 0
        steps: Int64 = seen.steps[due]
        poses = seen.bases[BODY][due, :7]
        moved: list[Chunk] = []
        if camera.view == "follow" and len(steps):
            places = [camera.looking_at(tuple(at)) for at in poses[:, :3]]
            looking = np.array([self.photography.pose(place) for place in places])
            moved = [writer.camera_chunk(steps, timestep_s, looking)]
        total = camera.frames_of(self.scenario.steps)
        for step, png in zip(steps.tolist(), self.photography.draw(poses), strict=True):
            yield step, png, [*moved, image_chunk(step, timestep_s, png)]
            moved = []
            self.progress(Message("drawing frames"), camera.frames_of(step), total)


def image_chunk(step: int, timestep_s: float, png: bytes) -> Chunk:
    """Return a chunk with one camera frame."""
    return pictures.images(schema.IMAGE, writer.at(np.array([step]), timestep_s), [png])
