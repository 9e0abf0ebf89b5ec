"""Verification: however frames are rendered, they equal PyBullet's pixels for the pose."""

from __future__ import annotations

import io
import os
import signal
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import some
from drop_physics import Camera, DropError, Scenario, simulate
from drop_physics.engines.pybullet import camera_frames, pose_renderer
from drop_physics.engines.pybullet.camera_frames import Photographer
from drop_physics.engines.pybullet.pose_renderer import PoseRenderer
from drop_physics.engines.pybullet.visible_world import VisibleWorld, framed
from drop_physics.engines.pybullet.world import World
from drop_physics.recording import rrd, schema
from drop_physics.recording.reader import read
from drop_physics.scenario import View
from drop_physics.trace.states import BODY
from PIL import Image

SMALL = Camera(size_px=(160, 120))


def poses_in(scenario: Scenario) -> np.ndarray:
    with World(scenario) as world:
        (fall,) = world.samples(1000)
        return fall.bases[BODY][::7, :7]


def drawn_whole(scenario: Scenario, camera: Camera, poses: np.ndarray) -> list[np.ndarray]:
    with closing(VisibleWorld(scenario, "tiny")) as world:
        found = []
        for pose in poses:
            world.place(pose[:3], pose[3:])
            found.append(world.photograph(camera).pixels)
        return found


def decoded(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


@pytest.mark.parametrize(
    "body", some(["cube_small.urdf", "sphere2.urdf", "duck_vhacd.urdf", "r2d2.urdf"], 1)
)
def test_a_body_in_front_of_the_floor_is_what_both_together_give(body: str) -> None:
    """The body falls, sinks into the floor, tumbles on it, and leaves the image."""
    scenario = Scenario(body=body, velocity_m_s=(0.5, 0.9, 0.0), spin_rad_s=(5.0, 2.0, 1.0))
    poses = poses_in(scenario)
    with PoseRenderer(scenario, SMALL) as at_work:
        for pose, whole in zip(poses, drawn_whole(scenario, SMALL, poses), strict=True):
            assert np.array_equal(decoded(at_work.png(pose)), whole)


def test_where_the_depths_leave_a_doubt_the_picture_is_drawn_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = Scenario(duration_s=0.5)
    poses, calls = poses_in(scenario), []
    place = VisibleWorld.place
    with PoseRenderer(scenario, SMALL) as at_work:
        monkeypatch.setattr(pose_renderer, "DEPTH_DOUBT", 2.0)
        monkeypatch.setattr(VisibleWorld, "place", lambda *a: (calls.append(a[0]), place(*a)))
        drawn = [decoded(at_work.png(pose)) for pose in poses]
        assert {id(world) for world in calls} == {id(at_work._alone), id(at_work._whole)}
    for picture, whole in zip(drawn, drawn_whole(scenario, SMALL, poses), strict=True):
        assert np.array_equal(picture, whole)


@pytest.mark.parametrize("workers", some([0, 2], 1))
def test_the_number_of_workers_changes_nothing(
    workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = Scenario(duration_s=0.5)
    poses = np.repeat(poses_in(scenario), 2, axis=0)  # each twice: the second is not drawn
    monkeypatch.setattr(camera_frames, "cores", lambda: workers)
    with Photographer(scenario, SMALL, frames=1000) as photographer:
        assert len(photographer._workers) == workers
        drawn = list(photographer.draw(poses[:20])) + list(photographer.draw(poses[20:]))
    with PoseRenderer(scenario, SMALL) as at_work:
        assert drawn == [at_work.png(pose) for pose in poses]


def test_a_fall_of_many_steps_is_not_dropped_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """The samples would take gigabytes, however few of them are rendered."""
    dropped: list[Scenario] = []
    monkeypatch.setattr(camera_frames, "World", lambda scenario: dropped.append(scenario))
    long, rarely = Scenario(duration_s=50_000.0), replace(SMALL, capture_every=1_000_000)
    assert list(camera_frames.draw_ahead(long, rarely)) == []
    assert dropped == []


def test_a_worker_that_is_killed_is_an_error_and_no_wait() -> None:
    scenario = Scenario(duration_s=0.5)
    with Photographer(scenario, SMALL, frames=64) as photographer:
        os.kill(photographer._workers[0]._process.pid, signal.SIGKILL)
        with pytest.raises(DropError, match="signal 9"):
            list(photographer.draw(poses_in(scenario)))


def test_what_a_worker_cannot_do_is_raised_here() -> None:
    with (
        Photographer(Scenario(body="no.urdf"), SMALL, frames=64) as photographer,
        pytest.raises(DropError, match=r"no\.urdf"),
    ):
        list(photographer.draw(poses_in(Scenario(duration_s=0.5))))


# -- cameras that come nearer ---------------------------------------------------------------------


def seen(scenario: Scenario, camera: Camera, pose: np.ndarray) -> tuple[float, float, int]:
    """Return row and column of a body's middle in its image, and its width [px]."""
    with closing(VisibleWorld(replace(scenario, floor=False), "tiny")) as world:
        world.place(pose[:3], pose[3:])
        x, y, z = pose[:3]
        rows, columns = np.nonzero(world.photograph(camera.looking_at((x, y, z))).bodies >= 0)
    assert len(rows), "the body is not in the picture"
    return (rows.min() + rows.max()) / 2, (columns.min() + columns.max()) / 2, int(np.ptp(columns))


@pytest.mark.parametrize("body", ["cube_small.urdf", "sphere2.urdf", "duck_vhacd.urdf"])
def test_a_following_camera_keeps_the_body_large_and_in_the_middle(body: str) -> None:
    scenario = Scenario(body=body, height_m=2.0, velocity_m_s=(0.5, -0.3, 0.0))
    camera = framed(Camera(view="follow"), scenario)
    for pose in poses_in(scenario)[::8]:
        row, column, width = seen(scenario, camera, pose)
        assert (row, column) == (pytest.approx(180, abs=14), pytest.approx(240, abs=14))
        assert 45 <= width <= 110


def test_the_close_camera_sees_the_body_where_it_lies() -> None:
    scenario = Scenario(velocity_m_s=(0.4, 0.2, 0.0), linear_damping=0.0)
    camera = framed(Camera(view="close"), scenario)
    with World(scenario) as world:
        (fall,) = world.samples(1000)
    landed = fall.bases[BODY][fall.contacts["step"][0], :7]
    row, column, width = seen(scenario, camera, landed)
    assert (row, column) == (pytest.approx(180, abs=20), pytest.approx(240, abs=20))
    assert width > 40
    *_, standard = seen(scenario, Camera(), landed)
    assert standard < 16


def test_a_body_that_never_lands_is_looked_at_where_it_is_released() -> None:
    camera = Camera(view="close")
    for scenario in (Scenario(floor=False), Scenario(stepped=False), Scenario(gravity_set=False)):
        assert framed(camera, scenario).target_m == (0.0, 0.0, 1.0)


def test_the_standard_camera_stays_the_experiments() -> None:
    assert framed(Camera(), Scenario(body="sphere2.urdf")) == Camera()


@pytest.mark.parametrize("view", ["close", "follow"])
def test_framing_again_changes_nothing(view: View) -> None:
    once = framed(Camera(view=view), Scenario())
    assert framed(once, Scenario()) == once


@pytest.mark.long
def test_what_follows_is_drawn_alike_by_workers_and_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, camera = Scenario(duration_s=0.25), replace(SMALL, view="follow", capture_every=7)
    poses = poses_in(scenario)
    whole = [
        pixels
        for pose in poses
        for pixels in drawn_whole(
            scenario, framed(camera, scenario).looking_at(tuple(pose[:3])), pose[None]
        )
    ]
    list(camera_frames.draw_ahead(scenario, camera))
    ahead = [camera_frames._ahead.pop(pose.tobytes()) for pose in poses]
    monkeypatch.setattr(camera_frames, "cores", lambda: 2)
    with Photographer(scenario, camera, frames=1000) as photographer:
        drawn = list(photographer.draw(poses))
    assert drawn == ahead
    assert all(map(np.array_equal, map(decoded, drawn), whole))


def test_a_recording_holds_where_a_following_camera_stood(tmp_path: Path) -> None:
    """The body's centre, projected by each frame's recorded camera pose, is in the middle."""
    scenario = Scenario(duration_s=0.25, velocity_m_s=(0.5, 0.0, 0.0))
    path = tmp_path / "run.rrd"
    simulate(scenario, path, camera=replace(SMALL, view="follow"))
    recording = read(path)
    assert recording.camera is not None
    batches = [
        chunk.batch
        for chunk in rrd.chunks(path)
        if chunk.entity == schema.CAMERA and "Transform3D:mat3x3" in chunk.batch.schema.names
    ]
    (batch,) = batches
    assert batch.column(schema.STEP_TIMELINE).to_pylist() == list(range(0, 61, 6))
    places = np.array(batch.column("Transform3D:translation").flatten().flatten())
    turns = np.array(batch.column("Transform3D:mat3x3").flatten().flatten())
    for step, place, turn in zip(
        range(0, 61, 6), places.reshape(-1, 3), turns.reshape(-1, 3, 3), strict=True
    ):
        body = recording.states.select("x_m", "y_m", "z_m").to_numpy()[step]
        # Columns of the matrix are the camera's right, up and backwards in world axes.
        right, up, back = turn @ (body - place)
        assert (right, up) == (pytest.approx(0, abs=1e-5), pytest.approx(0, abs=1e-5))
        assert -back == pytest.approx(recording.camera.distance_m, rel=1e-5)
