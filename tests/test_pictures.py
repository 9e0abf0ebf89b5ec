"""Verification: however frames are drawn, they are the pixels that PyBullet gives for the pose."""

from __future__ import annotations

import io
import os
import signal
from contextlib import closing

import numpy as np
import pytest
from PIL import Image

from pipeline import Camera, DropError, Scenario
from pipeline.physics import studio
from pipeline.physics.pictures import Photographer
from pipeline.physics.studio import Studio
from pipeline.physics.visible_world import VisibleWorld
from pipeline.physics.world import World

SMALL = Camera(size_px=(160, 120))


def poses_of(scenario: Scenario) -> np.ndarray:
    with World(scenario) as world:
        return np.concatenate(list(world.samples(1000)))[::7, :7]


def drawn_whole(scenario: Scenario, camera: Camera, poses: np.ndarray) -> list[np.ndarray]:
    with closing(VisibleWorld(scenario, "tiny")) as world:
        pictures = []
        for pose in poses:
            world.place(pose[:3], pose[3:])
            pictures.append(world.photograph(camera).pixels)
        return pictures


def decoded(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


@pytest.mark.parametrize(
    "body", ["cube_small.urdf", "sphere2.urdf", "duck_vhacd.urdf", "r2d2.urdf"]
)
def test_a_body_in_front_of_the_floor_is_what_both_together_give(body: str) -> None:
    """Falling, sinking into the floor, tumbling on it, and flying out of the picture."""
    scenario = Scenario(body=body, velocity_m_s=(0.5, 0.9, 0.0), spin_rad_s=(5.0, 2.0, 1.0))
    poses = poses_of(scenario)
    with Studio(scenario, SMALL) as at_work:
        for pose, whole in zip(poses, drawn_whole(scenario, SMALL, poses), strict=True):
            assert np.array_equal(decoded(at_work.png(pose)), whole)


def test_where_the_depths_leave_a_doubt_the_picture_is_drawn_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = Scenario(duration_s=0.5)
    poses, calls = poses_of(scenario), []
    place = VisibleWorld.place
    with Studio(scenario, SMALL) as at_work:
        monkeypatch.setattr(studio, "DEPTH_DOUBT", 2.0)
        monkeypatch.setattr(VisibleWorld, "place", lambda *a: (calls.append(a[0]), place(*a)))
        pictures = [decoded(at_work.png(pose)) for pose in poses]
        assert {id(world) for world in calls} == {id(at_work._alone), id(at_work._whole)}
    for picture, whole in zip(pictures, drawn_whole(scenario, SMALL, poses), strict=True):
        assert np.array_equal(picture, whole)


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_the_number_of_workers_changes_nothing(
    workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = Scenario(duration_s=0.5)
    poses = np.repeat(poses_of(scenario), 2, axis=0)  # each twice: the second is not drawn
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(workers)))
    with Photographer(scenario, SMALL, frames=1000) as photographer:
        assert len(photographer._workers) == workers
        pictures = list(photographer.draw(poses[:20])) + list(photographer.draw(poses[20:]))
    with Studio(scenario, SMALL) as at_work:
        assert pictures == [at_work.png(pose) for pose in poses]


def test_a_worker_that_is_killed_is_an_error_and_no_wait() -> None:
    scenario = Scenario(duration_s=0.5)
    with Photographer(scenario, SMALL, frames=64) as photographer:
        os.kill(photographer._workers[0]._process.pid, signal.SIGKILL)
        with pytest.raises(DropError, match="signal 9"):
            list(photographer.draw(poses_of(scenario)))


def test_what_a_worker_cannot_do_is_raised_here() -> None:
    with (
        Photographer(Scenario(body="no.urdf"), SMALL, frames=64) as photographer,
        pytest.raises(DropError, match=r"no\.urdf"),
    ):
        list(photographer.draw(poses_of(Scenario(duration_s=0.5))))
