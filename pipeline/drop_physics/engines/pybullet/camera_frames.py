"""Renders the frames of a fall from its recorded poses, as PNG, in separate processes.

A pose determines its picture to the last pixel, so pictures need not be taken while the body falls:
another world with the body in the same pose gives the same picture.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Self

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.pose_renderer import PoseRenderer
from drop_physics.engines.pybullet.probe import Verdicts, believe, verdicts
from drop_physics.engines.pybullet.visible_world import framed
from drop_physics.engines.pybullet.world import World
from drop_physics.messages import Message
from drop_physics.scenario import Camera, Scenario
from drop_physics.trace.states import BODY
from drop_physics.workers import Worker, WorkerDiedError, cores

FRAMES_PER_WORKER = 32
"""Number of frames per worker process: about as many as one worker renders while another starts."""

MOST_AHEAD = 2 * FRAMES_PER_WORKER
"""Largest number of frames that a single worker renders; more frames are divided among several
workers."""

MOST_STEPS_AHEAD = 16_384
"""Number of steps that a worker simulates ahead, which take a tenth of a second, and 2 MB of
samples."""

NO_EGL = Message(
    "EGL finds no graphics here, so the frames are drawn with --renderer tiny; for software "
    "rendering on Debian: apt-get install -y libegl1 libegl-mesa0 libgl1-mesa-dri"
)


class Photographer:
    """Renders images of one scenario; use it in a `with` statement.

    Parameters
    ----------
    scenario, camera
        The simulated drop, and the camera that renders it.
    frames
        The approximate number of frames, which determines the number of workers.
    note
        A function that is called with a sentence if another renderer has to replace the camera's.
    assistant
        A worker that is already running.
    """

    def __init__(
        self,
        scenario: Scenario,
        camera: Camera,
        *,
        frames: int,
        note: Callable[[str], None] = lambda _: None,
        assistant: Worker | None = None,
    ) -> None:
        self.scenario, self.camera = scenario, framed(camera, scenario)
        self.gl_renderer = ""
        """The renderer of EGL, as its driver reports it."""
        self._open = contextlib.ExitStack()
        self._renderer: PoseRenderer | None = None
        self._last, self._png = np.full(7, np.nan), b""
        self._workers = [assistant] if assistant and camera.renderer == "tiny" else []
        wanted = min(cores(), frames // FRAMES_PER_WORKER)
        if camera.renderer == "egl":
            wanted = 1  # one process uses the whole GPU, or all of Mesa's threads; and it may crash
        while len(self._workers) < wanted:
            self._workers.append(self._open.enter_context(Worker()))
        for worker in self._workers if verdicts() else ():
            worker.ask(f"{__name__}:_believe", verdicts())
        if camera.renderer == "egl":
            self._ask_for_egl(note)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def _ask_for_egl(self, note: Callable[[str], None]) -> None:
        (worker,) = self._workers
        worker.ask(f"{__name__}:_gl_renderer", self.scenario, self.camera)
        try:
            self.gl_renderer = worker.answer()
        except WorkerDiedError:
            note(NO_EGL)
            self.camera = replace(self.camera, renderer="tiny")
            self._workers = [self._open.enter_context(Worker())]

    def draw(self, poses: Float64) -> Iterator[bytes]:
        """Yield one PNG per pose; consecutive equal poses are rendered once.

        Parameters
        ----------
        poses
            Position [m] and orientation (quaternion x, y, z, w), shape (n, 7).

        Raises
        ------
        DropError
            If a worker died.
        """
        before = np.concatenate((self._last[None], poses[:-1]))
        moved = (poses != before).any(axis=1)
        drawn = self._drawn(list(poses[moved]))
        for pose, new in zip(poses, moved, strict=True):
            if new:
                self._last, self._png = pose, next(drawn)
            yield self._png

    def _drawn(self, poses: list[Float64]) -> Iterator[bytes]:
        if not self._workers:
            if self._renderer is None:
                self._renderer = self._open.enter_context(PoseRenderer(self.scenario, self.camera))
            yield from map(self._renderer.png, poses)
            return
        count = len(self._workers)
        for first, worker in enumerate(self._workers):
            worker.ask(f"{__name__}:_pngs", self.scenario, self.camera, poses[first::count])
        for number in range(len(poses)):
            yield self._workers[number % count].answer()


# -- what the workers do --------------------------------------------------------------------------

_renderer = functools.lru_cache(maxsize=1)(PoseRenderer)
_ahead: dict[bytes, bytes] = {}


def _pngs(scenario: Scenario, camera: Camera, poses: list[Float64]) -> Iterator[bytes]:
    for pose in poses:
        yield _ahead.pop(pose.tobytes(), b"") or _renderer(scenario, camera).png(pose)


def _believe(known: Verdicts) -> Iterator[bytes]:
    believe(known)
    return iter(())


def draw_ahead(scenario: Scenario, camera: Camera) -> Iterator[bytes]:
    """Simulate the drop in this worker, to render frames before the main process requests them.

    Meanwhile the main process loads its libraries. If it requests a pose that was predicted to the
    last bit, the picture is ready; any other pose is drawn on request. This call itself yields
    nothing.
    """
    camera = framed(camera, scenario)
    few = camera.frames_of(scenario.steps) <= MOST_AHEAD and scenario.steps <= MOST_STEPS_AHEAD
    if camera.renderer == "tiny" and few:
        with World(scenario) as world:
            (fall,) = world.samples(scenario.steps + 1)
        for pose in fall.bases[BODY][:: camera.capture_every, :7]:
            _ahead[pose.tobytes()] = _renderer(scenario, camera).png(pose)
    return iter(())


def _gl_renderer(scenario: Scenario, camera: Camera) -> str:
    return _renderer(scenario, camera).gl_renderer
