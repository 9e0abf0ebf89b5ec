"""Renders the body in any pose, as PNG.

TinyRenderer spends nine tenths of its time on the floor, which never changes. It draws one body
after another into the same depth buffer, and without shadows they do not affect each other: each
pixel is that of the nearer body (`triangle` in bullet3's `TinyRenderer/our_gl.cpp`). So the floor
is drawn once, and then only the body in front of it. If at any pixel the two are too close to tell
which is nearer, the whole picture is drawn; so is each picture of a moving camera.
"""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.visible_world import Picture, VisibleWorld
from drop_physics.scenario import Camera, Scenario

Pixels = NDArray[np.uint8]

OUT_OF_SIGHT_M = 1e6
DEPTH_DOUBT = 1e-6
"""Smallest difference of two depths (0 to 1, single precision) at which their order is certain: 16
units in the last place, where the depth buffer's rounding takes two or three."""


class PoseRenderer:
    """Renders images of one scenario; use it in a `with` statement.

    Parameters
    ----------
    scenario, camera
        The simulated drop, and the camera that renders it.

    Raises
    ------
    DropError
        If the camera's renderer cannot be loaded.
    """

    def __init__(self, scenario: Scenario, camera: Camera) -> None:
        self._camera = camera
        self._whole = VisibleWorld(scenario, camera.renderer)
        self.gl_renderer = self._whole.gl_renderer
        self._alone: VisibleWorld | None = None
        self._floor: Picture | None = None
        if scenario.floor and camera.renderer == "tiny" and camera.view != "follow":
            self._alone = VisibleWorld(replace(scenario, floor=False), "tiny")
            self._whole.place((0.0, 0.0, OUT_OF_SIGHT_M), (0.0, 0.0, 0.0, 1.0))
            self._floor = self._whole.photograph(camera)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._whole.close()
        if self._alone is not None:
            self._alone.close()

    def png(self, pose: Float64) -> bytes:
        """Return the image of a pose: position [m] and quaternion x, y, z, w, shape (7,)."""
        return encoded(self._pixels(pose))

    def _pixels(self, pose: Float64) -> Pixels:
        if self._alone is not None and self._floor is not None:
            self._alone.place(pose[:3], pose[3:])
            pixels = _in_front(self._alone.photograph(self._camera), self._floor)
            if pixels is not None:
                return pixels
        self._whole.place(pose[:3], pose[3:])
        x, y, z = map(float, pose[:3])
        return self._whole.photograph(self._camera.looking_at((x, y, z))).pixels


def _in_front(body: Picture, floor: Picture) -> Pixels | None:
    """Draw the body over the floor; return None if it is unclear which one is nearer."""
    where = np.nonzero(body.bodies >= 0)
    nearer = floor.depth[where] - body.depth[where]
    if (np.abs(nearer) < DEPTH_DOUBT).any():
        return None
    rows, columns = (index[nearer > 0] for index in where)
    pixels = floor.pixels.copy()
    pixels[rows, columns] = body.pixels[rows, columns]
    return pixels


def encoded(pixels: Pixels) -> bytes:
    """Return pixels, shape (height, width, 3), as a lossless PNG.

    TinyRenderer's pictures have four or five colours. With a palette they take less than half the
    bytes, in less time.
    """
    image = Image.fromarray(pixels)
    few = image.quantize(256, method=Image.Quantize.FASTOCTREE)
    exact = np.array_equal(np.asarray(few.convert("RGB")), pixels)
    stream = io.BytesIO()
    (few if exact else image).save(stream, format="png", compress_level=6)
    return stream.getvalue()
