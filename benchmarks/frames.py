"""Rendering frames: two workers against one process; the floor drawn once against in each frame."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from drop_physics import Camera, Scenario
from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.camera_frames import Photographer
from drop_physics.engines.pybullet.pose_renderer import encoded
from drop_physics.engines.pybullet.visible_world import VisibleWorld

from benchmarks.harness import Measured, done, paired, slow_fall


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:  # noqa: ARG001
    """Render the frames of a slow fall."""
    count = 50 if quick else 1000
    camera = Camera()
    scenario, poses = slow_fall(count)
    ratios, detail = paired(
        lambda: done(lambda: _draw(scenario, camera, poses, workers=False)),
        lambda: done(lambda: _draw(scenario, camera, poses, workers=True)),
        pairs=1 if quick else 7,
        warm=not quick,
    )
    yield Measured(
        f"{count} frames by 2 workers: times faster",
        "one process",
        ratios,
        1.8,
        more_is_better=True,
        detail=detail,
    )
    few = poses[:: count // 50]
    ratios, detail = paired(
        lambda: done(lambda: _draw(scenario, camera, few, workers=False)),
        lambda: done(lambda: _draw_whole(scenario, camera, few)),
        pairs=1 if quick else 7,
        warm=not quick,
    )
    yield Measured(f"{len(few)} frames, floor drawn once", "each whole", ratios, detail=detail)


def _draw(scenario: Scenario, camera: Camera, poses: Float64, *, workers: bool) -> None:
    with Photographer(scenario, camera, frames=len(poses) if workers else 0) as photographer:
        assert len(list(photographer.draw(poses))) == len(poses)


def _draw_whole(scenario: Scenario, camera: Camera, poses: Float64) -> None:
    with contextlib.closing(VisibleWorld(scenario, "tiny")) as world:
        for pose in poses:
            world.place(pose[:3], pose[3:])
            encoded(world.photograph(camera).pixels)
