"""An endless checkerboard as a camera sees it: the floor in pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int8
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.visible_world import world_from_camera
from drop_physics.scenario import Camera
from drop_physics.trace.events import Pose

UInt8 = NDArray[np.uint8]
Float32 = NDArray[np.float32]

LEAST_NEARNESS = 1e-6
"""Least nearness at which squares are drawn [1/m]."""
FADES, FADED = 12, 0.3
"""Number of steps in which squares fade into the page towards the horizon, and the slope at which
they begin to."""
SHADE = 0.72
"""Share of its colour that a square keeps in a shadow."""
SUN = (0.1, -0.24, 1.0)
"""Direction of the light: nearly from above, so that shadows are near what casts them, and seen
beside it."""
TEXELS, AWAY = 384, 40.0
"""Side of the picture seen from the light [px], and its distance, in half sides."""


def checkerboard(
    camera: Camera, client: int, place: Pose, side_m: float, colours: UInt8
) -> tuple[UInt8, Float32]:
    """Return what a camera sees of a plane, to be laid behind what is nearer.

    TinyRenderer takes five times as long for it as for all else in a picture.

    Parameters
    ----------
    camera
        What looks at it; from below it is not seen.
    client
        The simulation whose bodies cast shadows on it.
    place
        Where the plane is, which is that of its own x and y.
    side_m
        The side of a square [m].
    colours
        Of both kinds of squares, and of the page, shape (3, 3).

    Returns
    -------
    Colours, shape (height, width, 3), and 1 over the distance along the camera's axis [1/m], shape
    (height, width), 0 where the plane is not seen.
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
    dark = _shadowed(client, camera, (*axes.T[:2], np.array(place[0])), (across_m, along_m))
    which = (dark * np.int32(FADES + 1) + faded) * 3 + kind
    return _palette(colours).reshape(-1, 3).take(which, axis=0), nearness


def _palette(colours: UInt8) -> UInt8:
    """Return the colours of squares, shape (lit or not, from page to full colour, kind, 3)."""
    page, tiles = colours[2:], np.vstack((colours[:2], colours[:2].mean(axis=0)))
    share = np.linspace(0, 1, FADES + 1)[:, None, None]
    lit = [page + share * (shade * tiles - page) for shade in (1.0, SHADE)]
    return np.array(lit).astype(np.uint8)


def _shadowed(
    client: int, camera: Camera, plane: Sequence[Float64], on_plane_m: Sequence[Float32]
) -> Int8:
    """Return where a plane is in the shadow of a body near what a camera looks at: 1, else 0.

    `plane` has its x and y axes and its origin, shape (3,) each; `on_plane_m` the points' x and y.
    """
    reach_m = camera.distance_m
    sun_m = np.array(camera.target_m) + AWAY * reach_m * np.array(SUN) / np.linalg.norm(SUN)
    view = p.computeViewMatrix(sun_m.tolist(), camera.target_m, (0.0, 1.0, 0.0))
    lens = p.computeProjectionMatrixFOV(
        2 * np.degrees(np.arctan(1 / AWAY)), 1.0, AWAY * reach_m / 2, AWAY * reach_m * 2
    )
    *_, bodies = p.getCameraImage(
        TEXELS, TEXELS, view, lens, renderer=p.ER_TINY_RENDERER, physicsClientId=client
    )
    # A border, which is lit, stands for all that is beside the picture.
    casts = np.pad(np.reshape(bodies, (TEXELS, TEXELS)) >= 0, 1).astype(np.int8)
    sees = np.array(view).reshape(4, 4)
    # What the sun sees right, up and behind of it is linear in the place on the plane.
    per_x, per_y, start = np.array(plane, np.float64) @ sees[:3, :3]
    right, up, back = (
        np.float32(of_x) * on_plane_m[0] + np.float32(of_y) * on_plane_m[1] + np.float32(at)
        for of_x, of_y, at in zip(per_x, per_y, start + sees[3, :3], strict=True)
    )
    column, row = (
        np.clip(TEXELS / 2 * (1 - AWAY * each / back) + 1, 0, TEXELS + 1).astype(np.int32)
        for each in (right, -up)
    )
    shadow: Int8 = casts[row, column]
    return shadow
