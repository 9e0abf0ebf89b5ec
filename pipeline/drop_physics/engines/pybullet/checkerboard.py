"""An infinite checkerboard as seen by a camera: the floor in images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.visible_world import world_from_camera
from drop_physics.scenario import Camera
from drop_physics.trace.events import Pose

UInt8 = NDArray[np.uint8]
Float32 = NDArray[np.float32]

LEAST_NEARNESS = 1e-6
"""Smallest inverse distance at which squares are drawn [1/m]."""
FADES, FADED = 12, 0.3
"""Number of steps in which squares fade into the background towards the horizon, and the slope at
which fading begins."""


def checkerboard(
    camera: Camera, place: Pose, side_m: float, colours: UInt8
) -> tuple[UInt8, Float32]:
    """Render the floor as an infinite checkerboard, from a camera's point of view.

    TinyRenderer takes five times as long for the floor as for everything else in a picture.

    Parameters
    ----------
    camera
        The camera; the floor is invisible from below.
    place
        The pose of the floor's frame, whose x and y axes span the plane.
    side_m
        The side of a square [m].
    colours
        RGB colours of the two kinds of squares and of the background, shape (3, 3).

    Returns
    -------
    RGB colours, shape (height, width, 3); and 1 over the depth [1/m], 0 outside the plane.
    """
    eye = world_from_camera(camera)
    axes = np.reshape(p.getMatrixFromQuaternion(place[1]), (3, 3))
    at_m, turned = (eye[:3, 3] - place[0]) @ axes, axes.T @ eye[:3, :3]
    # Where the middles of pixels are, 1 m before the camera.
    pixel_m = 1 / camera.focal_length_px
    width, height = camera.size_px
    columns = pixel_m * (np.arange(width, dtype=np.float32) - (width - 1) / 2)
    rows = pixel_m * ((height - 1) / 2 - np.arange(height, dtype=np.float32)[:, None])
    x, y, z = (right * columns + (up * rows - back) for right, up, back in turned.tolist())
    if at_m[2] <= 0:
        return np.zeros((height, width, 3), np.uint8), np.zeros_like(z)
    nearness = np.maximum(z / np.float32(-at_m[2]), 0)
    distance_m = 1 / np.maximum(nearness, np.float32(LEAST_NEARNESS))
    across_m, along_m = x * distance_m + np.float32(at_m[0]), y * distance_m + np.float32(at_m[1])
    across, along = (
        np.floor(each / np.float32(side_m)).astype(np.int32) for each in (across_m, along_m)
    )
    # Where a pixel sees several squares, it is of both colours.
    sees_m = pixel_m / at_m[2] * distance_m**2
    kind = np.where(sees_m > side_m / 3, 2, (across + along) & 1)
    faded = np.clip(np.rint(-z * (FADES / FADED)), 0, FADES).astype(np.int32)
    which = faded * 3 + kind
    return _palette(colours).reshape(-1, 3).take(which, axis=0), nearness


def _palette(colours: UInt8) -> UInt8:
    """Return the colours of the squares as they fade, shape (background to full, kind, 3)."""
    page, tiles = colours[2:], np.vstack((colours[:2], colours[:2].mean(axis=0)))
    share = np.linspace(0, 1, FADES + 1)[:, None, None]
    colour: UInt8 = (page + share * (tiles - page)).astype(np.uint8)
    return colour
