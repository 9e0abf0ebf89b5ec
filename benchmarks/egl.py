"""Frames per second of the EGL renderer, compared with TinyRenderer's."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drop_physics import Camera
from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.camera_frames import Photographer

from benchmarks.harness import Measured, done, paired, slow_fall


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:  # noqa: ARG001
    """Render the same frames with both renderers, in one worker each, start-up time excluded."""
    count = 10 if quick else 200
    scenario, poses = slow_fall(count)
    with Photographer(scenario, Camera(renderer="egl"), frames=1) as egl:
        if egl.camera.renderer != "egl":
            return
        with Photographer(scenario, Camera(), frames=1) as tiny:
            ratios, detail = paired(
                lambda: done(lambda: _draw(egl, poses)),
                lambda: done(lambda: _draw(tiny, poses)),
                pairs=1 if quick else 3,
                warm=not quick,
            )
    yield Measured(
        f"{count} frames by EGL ({egl.gl_renderer})", "TinyRenderer", ratios, detail=detail
    )


def _draw(photographer: Photographer, poses: Float64) -> None:
    for _ in photographer.draw(poses):
        pass
