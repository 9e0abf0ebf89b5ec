"""The time in a corner of a picture."""

from __future__ import annotations

import functools
from importlib.util import find_spec
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from drop_physics.figures.ink import Ink


def with_clock(picture: Image.Image, time_s: float, ink: Ink) -> Image.Image:
    """Return a picture with the time in its lower left corner."""
    letters = max(9, picture.height // 24)
    drawn, text, at = (
        ImageDraw.Draw(picture),
        f"t {time_s:.2f} s",
        (letters, picture.height - letters),
    )
    drawn.fontmode = "1"  # a gif has few colours
    left, top, right, bottom = drawn.textbbox(at, text, font=font(letters), anchor="ls")
    room = letters // 2
    drawn.rectangle((left - room, top - room, right + room, bottom + room), fill=ink.page)
    drawn.text(at, text, font=font(letters), fill=ink.text, anchor="ls")
    return picture


@functools.cache
def font(letters: int) -> ImageFont.FreeTypeFont:
    """Return matplotlib's fixed-width font, without loading matplotlib, which takes 0.4 s."""
    found = find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    fonts = Path(found.origin).with_name("mpl-data") / "fonts" / "ttf"
    return ImageFont.truetype(fonts / "DejaVuSansMono.ttf", letters)
