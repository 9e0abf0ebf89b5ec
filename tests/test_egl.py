"""Validation: `--renderer egl` renders without a display, or falls back to TinyRenderer.

Debian needs: libegl1 libegl-mesa0 libgl1-mesa-dri.
"""

from __future__ import annotations

import ctypes.util
import io
from pathlib import Path

import numpy as np
import pytest
from conftest import Drop
from drop_physics import Camera, Scenario, simulate
from drop_physics.engines.pybullet import camera_frames
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import Recording, read
from PIL import Image

pytestmark = pytest.mark.long

EGL = Camera(renderer="egl", capture_every=20, size_px=(160, 120))
SHORT = Scenario(duration_s=0.25)


@pytest.fixture(scope="module")
def by_egl(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    if ctypes.util.find_library("EGL") is None:
        pytest.skip("no libEGL; try: apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri")
    path = tmp_path_factory.mktemp("egl") / "run.rrd"
    notes: list[str] = []
    simulate(SHORT, path, camera=EGL, note=notes.append)
    assert notes == []
    return read(path)


def pixels_of(path: Path) -> dict[int, np.ndarray]:
    return {
        step: np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
        for step, png in frames(read(path))
    }


def test_egl_is_recorded_as_what_it_is(by_egl: Recording) -> None:
    assert by_egl.camera == EGL
    assert by_egl.engine.gl_renderer


def test_egl_sees_the_box_where_tinyrenderer_sees_it(by_egl: Recording, tmp_path: Path) -> None:
    """Shading differs, so the box is located by the pixels that change from release to last frame.

    It has five pixels; which of its faces are visible on the floor depends on their shade.
    """
    tiny = Camera(capture_every=20, size_px=(160, 120))
    simulate(SHORT, tmp_path / "tiny.rrd", camera=tiny)
    expected, actual = pixels_of(tmp_path / "tiny.rrd"), pixels_of(by_egl.path)
    assert list(actual) == list(expected) == [0, 20, 40, 60]
    for images in (expected, actual):
        assert len(np.unique(images[0].reshape(-1, 3), axis=0)) > 3  # not an empty picture
    moved = [
        np.argwhere(np.abs(images[60] - images[0]).max(axis=2) > 40)
        for images in (expected, actual)
    ]
    centres = [where.mean(axis=0) for where in moved]
    assert np.abs(centres[0] - centres[1]).max() < 3


def test_the_fall_is_the_same_whatever_draws_it(by_egl: Recording, tmp_path: Path) -> None:
    simulate(SHORT, tmp_path / "none.rrd", camera=None)
    assert by_egl.states.equals(read(tmp_path / "none.rrd").states)


def test_without_egl_tinyrenderer_draws_and_the_recording_says_so(
    drop_process: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plugin ends its process if there is no device; that process must not be ours."""
    monkeypatch.setenv("EGL_VISIBLE_DEVICES", "99")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nowhere")
    options = ("--renderer", "egl", "--duration", "0.25", "--size", "160x120")
    done = drop_process("simulate", "--out", "run.rrd", *options)
    assert done.returncode == 0, done.stderr
    assert done.stderr == f"drop: {camera_frames.NO_EGL}\n"
    recording = read(tmp_path / "run.rrd")
    assert recording.camera is not None
    assert recording.camera.renderer == "tiny"
    assert recording.engine.gl_renderer is None
    assert len(pixels_of(recording.path)) == 11
