"""Compare the images of a page with those that its commands draw."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence

TILE_PX = 32
ALIKE = 12.0
"""Tolerance on the mean grey level of square tiles, out of 255. Another font changes the mean by
less, a bounce that is a tenth lower changes it by 20."""


def small(path: Path) -> bytes:
    """Compress an image file; a GIF is already small."""
    if path.suffix != ".png":
        return path.read_bytes()
    stream = io.BytesIO()
    picture = Image.open(path).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    picture.save(stream, "png", optimize=True)
    return stream.getvalue()


def alike(picture: bytes, other: bytes) -> bool:
    """Whether two images look the same."""
    mine, theirs = _tiles(picture), _tiles(other)
    return mine.shape == theirs.shape and bool((np.abs(mine - theirs) <= ALIKE).all())


def _tiles(picture: bytes) -> NDArray[np.float32]:
    """Return the mean grey of the tiles of each frame, shape (frames, rows, columns)."""
    frames = ImageSequence.Iterator(Image.open(io.BytesIO(picture)))
    reduced = [frame.convert("RGB").convert("L").reduce(TILE_PX) for frame in frames]
    return np.stack([np.asarray(frame, dtype=np.float32) for frame in reduced])
