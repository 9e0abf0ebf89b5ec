"""Draw the frames of a fall from its recorded poses, as PNG.

A pose decides its picture to the last pixel, so the pictures need not be taken while the body
falls: another world, with the body put where it was, gives the same.
"""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.physics.world import World
from pipeline.scenario import Camera, Scenario


def draw(scenario: Scenario, camera: Camera, poses: NDArray[np.float64]) -> Iterator[bytes]:
    """Yield one PNG per pose.

    Parameters
    ----------
    scenario, camera
        What is in the picture, and how it is seen.
    poses
        Position [m] and orientation (quaternion x, y, z, w), shape (n, 7).
    """
    with World(scenario) as studio:
        for pose in poses:
            studio.place(pose[:3], pose[3:])
            yield _png(studio.photograph(camera))


def _png(pixels: NDArray[np.uint8]) -> bytes:
    stream = io.BytesIO()
    # The frames have a handful of colours: more effort than level 1 saves nothing worth its time.
    Image.fromarray(pixels).save(stream, format="png", compress_level=1)
    return stream.getvalue()
