"""Draws marks over images: the time, a ruler, names; and places images side by side."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from drop_physics.figures.theme import Theme

Point = tuple[float, float]
"""Column and row of a pixel [px]."""


@dataclass(frozen=True)
class Mark:
    """A line with a text at its end; either may be absent."""

    line: tuple[Point, ...]
    text: str = ""
    anchor: str = "rm"
    """Anchor of the text at the line's end, in Pillow's notation."""


def draw_clock(picture: Image.Image, time_s: float, theme: Theme) -> None:
    """Write the time into the lower right corner of an image."""
    letters, text = letters_of(picture), f"t {time_s:.2f} s"
    drawn, at = _pen(picture), (picture.width - letters, picture.height - letters)
    left, top, right, bottom = drawn.textbbox(at, text, font=font(letters), anchor="rs")
    room = letters // 2
    drawn.rectangle((left - room, top - room, right + room, bottom + room), fill=theme.page)
    drawn.text(at, text, font=font(letters), fill=theme.text, anchor="rs")


def draw_marks(picture: Image.Image, marks: Sequence[Mark], theme: Theme) -> None:
    """Draw marks over an image; a text that would be cut off is left out."""
    drawn, letters = _pen(picture), font(letters_of(picture))
    for mark in marks:
        drawn.line(mark.line, fill=theme.faint)
        at = mark.line[-1]
        left, top, right, bottom = drawn.textbbox(at, mark.text, font=letters, anchor=mark.anchor)
        if min(left, top) >= 0 and right <= picture.width and bottom <= picture.height:
            drawn.text(at, mark.text, font=letters, fill=theme.faint, anchor=mark.anchor)


def beside(
    pictures: Sequence[Image.Image], titles: Sequence[str], time_s: float, theme: Theme
) -> Image.Image:
    """Place images of one size and moment side by side, each below its title."""
    wide, high = pictures[0].size
    letters = letters_of(pictures[0])
    room, gap = 2 * letters, letters // 2
    whole = Image.new("RGB", (len(pictures) * (wide + gap) - gap, high + room), theme.page)
    drawn = _pen(whole)
    for number, (picture, title) in enumerate(zip(pictures, titles, strict=True)):
        left = number * (wide + gap)
        whole.paste(picture, (left, room))
        text = title
        while text and drawn.textlength(text, font=font(letters)) > wide - letters:
            text = text[:-2] + "…" if text != "…" else ""
        at = (left + letters // 2, room // 2)
        drawn.text(at, text, font=font(letters), fill=theme.text, anchor="lm")
    draw_clock(whole, time_s, theme)
    return whole


def letters_of(picture: Image.Image) -> int:
    """Return the font size for text over an image [px]."""
    return max(9, picture.height // 24)


def _pen(picture: Image.Image) -> ImageDraw.ImageDraw:
    pen = ImageDraw.Draw(picture)
    pen.fontmode = "1"  # a gif has few colours
    return pen


@functools.cache
def font(letters: int) -> ImageFont.FreeTypeFont:
    """Return matplotlib's monospaced font, without loading matplotlib, which takes 0.4 s."""
    found = find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    fonts = Path(found.origin).with_name("mpl-data") / "fonts" / "ttf"
    return ImageFont.truetype(fonts / "DejaVuSansMono.ttf", letters)
