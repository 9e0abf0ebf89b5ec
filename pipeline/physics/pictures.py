"""Draw the frames of a fall from its recorded poses, as PNG, in processes of their own.

A pose decides its picture to the last pixel, so the pictures need not be taken while the body
falls: another world, with the body put where it was, gives the same. PyBullet holds Python's lock
while it draws, so worker processes are what makes it faster. They are plain subprocesses fed
through their pipes: unlike `multiprocessing` this asks nothing of a caller's main module, and a
worker whose parent is gone reads the end of its input and ends.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import DropError
from pipeline.scenario import Camera, Scenario

Poses = NDArray[np.float64]

FRAMES_PER_WORKER = 8
"""Fewer than these are drawn sooner than a worker has started."""


class Photographer:
    """Draws pictures of one scenario; use it in a `with` statement.

    Parameters
    ----------
    scenario, camera
        What is in the pictures, and how it is seen.
    frames
        About how many there will be, to decide on the number of workers.
    """

    def __init__(self, scenario: Scenario, camera: Camera, *, frames: int) -> None:
        self.scenario, self.camera = scenario, camera
        wanted = min(len(os.sched_getaffinity(0)), frames // FRAMES_PER_WORKER)
        self._workers = [_Worker(scenario, camera) for _ in range(wanted if wanted > 1 else 0)]
        self._studio: World | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end()
        if self._studio is not None:
            self._studio.close()

    def draw(self, poses: Poses) -> Iterator[bytes]:
        """Yield one PNG per pose.

        Parameters
        ----------
        poses
            Position [m] and orientation (quaternion x, y, z, w), shape (n, 7).

        Raises
        ------
        DropError
            If a worker died.
        """
        distinct, picture_of = _distinct(poses)
        drawn = self._drawn(poses[distinct])
        pngs: list[bytes] = []
        for picture in picture_of:
            while len(pngs) <= picture:
                pngs.append(next(drawn))
            yield pngs[picture]

    def _drawn(self, poses: Poses) -> Iterator[bytes]:
        if not self._workers:
            self._studio = self._studio or World(self.scenario)
            for pose in poses:
                yield _picture(self._studio, self.camera, pose)
            return
        count = len(self._workers)
        for first, worker in enumerate(self._workers):
            worker.ask(poses[first::count])
        for number in range(len(poses)):
            yield self._workers[number % count].picture()


class _Worker:
    """One process that draws, fed and read through its pipes."""

    def __init__(self, scenario: Scenario, camera: Camera) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "pipeline.physics.pictures"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        self._send((scenario, camera))

    def ask(self, poses: Poses) -> None:
        self._send(poses)

    def picture(self) -> bytes:
        assert self._process.stdout is not None
        try:
            png: bytes = pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError):
            raise _died(self._process) from None
        return png

    def end(self) -> None:
        self._process.kill()  # it holds nothing that could be lost
        self._process.communicate()

    def _send(self, what: object) -> None:
        assert self._process.stdin is not None
        try:
            pickle.dump(what, self._process.stdin)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise _died(self._process) from None


def _died(process: subprocess.Popen[bytes]) -> DropError:
    code = process.wait()
    how = f"signal {-code}" if code < 0 else f"code {code}"
    return DropError(
        f"a process that draws frames died with {how}; run it again, or without frames: --no-camera"
    )


def _distinct(poses: Poses) -> tuple[Sequence[int], Sequence[int]]:
    """Return which poses have a picture of their own, and the picture of each pose.

    Renderers take a body's transform in single precision (`m_modelMatrix` in bullet3's
    `TinyRendererVisualShapeConverter.cpp`), so poses that are equal there have the same picture: a
    body at rest creeps by nanometres.
    """
    _, first, inverse = np.unique(
        poses.astype(np.float32), axis=0, return_index=True, return_inverse=True
    )
    order = np.argsort(first)
    rank = np.argsort(order)
    return first[order].tolist(), rank[inverse.ravel()].tolist()


def _work() -> None:
    """Draw what standard input asks for, until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    scenario, camera = pickle.load(source)
    with World(scenario) as studio, contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            for pose in pickle.load(source):
                pickle.dump(_picture(studio, camera, pose), sink)
                sink.flush()


if __name__ == "__main__":
    _work()
