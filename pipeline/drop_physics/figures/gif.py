"""Writes gifs frame by frame, with up to 256 exact colours each, in constant memory.

Pillow's own writer merges frames that do not differ, holds all of them at once, and picks new
palettes for colours that it could keep. Therefore this module writes the container, one block per
frame as it arrives, and Pillow only decodes, compares and compresses. Each frame contains only the
rectangle that differs from the previous frame.

Layout: CompuServe, "Graphics Interchange Format, Version 89a" (1990), the sections named below.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageChops

MADE_BY_DROP = b"made by drop"
"""Comment in every gif that drop writes; only files with this comment are replaced under a default
name."""

Box = tuple[int, int, int, int]
"""A box in an image: left, top, right (exclusive), bottom (exclusive) [px]."""
Colours = NDArray[np.uint32]
"""Colours 0xRRGGBB in ascending order, shape (n,); pixels refer to them by index."""

MOST_COLOURS = 256
MAX_FPS = 50.0
"""Highest frame rate [1/s], since viewers play delays below 0.02 s as 0.1 s."""
MIN_FPS = 100 / 0xFFFF
"""Lowest frame rate [1/s], since a delay has 16 bits of 0.01 s."""


def delay_cs(frame: int, *, fps: float) -> int:
    """Return a frame's delay [0.01 s], such that no frame is off by more than 0.005 s.

    Delays are whole hundredths: at 30 frames per second they are 3, 4, 3, 3, 4, …

    Parameters
    ----------
    frame
        The index of the frame, from 0.
    fps
        Frames per second.
    """
    return round(100 * (frame + 1) / fps) - round(100 * frame / fps)


def write_gif(images: Iterable[Image.Image], stream: BinaryIO, *, fps: float) -> int:
    """Write images as a gif that loops forever, with two of them in memory at a time.

    Parameters
    ----------
    images
        RGB images of the same size, at least one.
    stream
        The stream to write to; nothing is written before the first image was read.
    fps
        Frames per second, from `MIN_FPS` to `MAX_FPS`.

    Returns
    -------
    The number of frames written.

    Raises
    ------
    ValueError
        If there is no image, or an image has another size or is too large for a gif.
    """
    shared: Colours | None = None
    frames = 0
    for image, box in _changes(images):
        patch = image.crop(box)
        colours = _colours(patch)
        if colours is None:
            # convert() makes the 256 colours of the quantised patch exact ones to carry on with.
            patch = patch.quantize(MOST_COLOURS, dither=Image.Dither.NONE).convert("RGB")
            colours = _colours(patch)
            assert colours is not None
        if shared is None:
            shared = colours
            stream.write(_head(image.size, shared))
        own = not np.isin(colours, shared).all()
        table = colours if own else shared
        indices = np.searchsorted(table, _packed(patch)).astype(np.uint8)
        delay = delay_cs(frames, fps=fps)
        stream.write(_frame(box, indices, delay=delay, own_table=table if own else None))
        frames += 1
    if not frames:
        raise ValueError("a gif needs at least one frame, got none; record with a camera")
    stream.write(b";")  # section 27, trailer
    return frames


def _changes(images: Iterable[Image.Image]) -> Iterator[tuple[Image.Image, Box]]:
    """Yield images with the smallest box in which each differs from the one before.

    For the first image the box is the whole image. For an equal image it is the first pixel, since
    a frame must not be empty.
    """
    shown: Image.Image | None = None
    for number, image in enumerate(images):
        box: Box | None
        if shown is None:
            if max(image.size) > 0xFFFF:
                raise ValueError(f"a gif is at most 65535 px wide and high, got {image.size}")
            box = (0, 0, *image.size)
        elif image is shown:
            box = None
        elif image.size != shown.size:
            raise ValueError(
                f"all frames must have one size, got {image.size} px in frame {number} "
                f"after {shown.size} px"
            )
        else:
            box = ImageChops.subtract_modulo(image, shown).getbbox()
        yield image, box or (0, 0, 1, 1)
        shown = image


# -- colours --------------------------------------------------------------------------------------


def _colours(patch: Image.Image) -> Colours | None:
    """Return an image region's colours; None if there are too many for a colour table."""
    found = patch.getcolors(MOST_COLOURS)
    if found is None:
        return None
    return np.array(
        sorted(int.from_bytes(bytes(colour), "big") for _, colour in found),  # type: ignore[arg-type]
        dtype=np.uint32,
    )


def _packed(patch: Image.Image) -> NDArray[np.uint32]:
    """Return a region's pixels as 0xRRGGBB, shape (height, width)."""
    rgb = np.asarray(patch, dtype=np.uint32)
    return (rgb[..., 0] << 16 | rgb[..., 1] << 8 | rgb[..., 2]).astype(np.uint32, copy=False)


# -- blocks of the format -------------------------------------------------------------------------


def _head(size: tuple[int, int], colours: Colours) -> bytes:
    """Return sections 17 to 19 and 24: header, screen, colours, comment; then "loop for ever"."""
    screen = struct.pack("<HHBBB", *size, 0x80 | _table_bits(colours), 0, 0)
    loop = b"!\xff\x0bNETSCAPE2.0" + struct.pack("<BBHB", 3, 1, 0, 0)
    comment = b"!\xfe" + bytes([len(MADE_BY_DROP)]) + MADE_BY_DROP + b"\0"
    return b"GIF89a" + screen + _table(colours) + comment + loop


def _frame(box: Box, indices: NDArray[np.uint8], *, delay: int, own_table: Colours | None) -> bytes:
    """Return sections 23 and 20 to 22: delay, position, own colours if any, packed pixels."""
    left, top, right, bottom = box
    leave_in_place = 1 << 2
    control = b"!\xf9" + struct.pack("<BBHBB", 4, leave_in_place, delay, 0, 0)
    flags = 0 if own_table is None else 0x80 | _table_bits(own_table)
    place = b"," + struct.pack("<HHHHB", left, top, right - left, bottom - top, flags)
    table = b"" if own_table is None else _table(own_table)
    bits_per_pixel = 8  # what Pillow's encoder starts its codes from, however small the table
    pixels = Image.fromarray(indices).tobytes("gif", "L")
    return control + place + table + bytes([bits_per_pixel]) + pixels + b"\0"


def _table_bits(colours: Colours) -> int:
    """Return n for a colour table with 2^(n + 1) entries."""
    return max(0, math.ceil(math.log2(len(colours))) - 1)


def _table(colours: Colours) -> bytes:
    entries = b"".join(int(colour).to_bytes(3, "big") for colour in colours)
    return entries.ljust(3 << _table_bits(colours) + 1, b"\0")
