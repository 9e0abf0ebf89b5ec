"""A plot that grows with time, beside a film.

It is drawn twice, with and without its data; a moment shows the first up to now, then the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from drop_physics.figures import style
from drop_physics.figures.ink import DARK, LIGHT, Ink
from drop_physics.figures.story import Story
from drop_physics.figures.story_plot import draw_beside
from drop_physics.figures.style import Unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = 64
"""This many leave room for the camera's in a gif's table of 256."""
HEIGHT_IN = 3.3
"""Height of the figure [inch], which sets the relative size of its letters."""


class GrowingStory:
    """What a plot tells, up to any moment: its title, and its first panels.

    Parameters
    ----------
    story
        With a panel at least.
    size_px
        Width and height [px].
    dark
        Whether it is for a dark page.
    """

    def __init__(self, story: Story, size_px: tuple[int, int], *, dark: bool) -> None:
        ink = DARK if dark else LIGHT
        with style.plain(ink):
            dpi = size_px[1] / HEIGHT_IN
            figure = Figure(figsize=(size_px[0] / dpi, HEIGHT_IN), dpi=dpi)
            canvas = FigureCanvasAgg(figure)
            panels, time = draw_beside(figure, story, ink)
            self._take(canvas, panels, time, ink)

    def _take(self, canvas: FigureCanvasAgg, panels: Sequence[Axes], time: Unit, ink: Ink) -> None:
        whole = _pixels(canvas)
        for axes in panels:
            for data in (*axes.lines, *axes.collections):
                data.set_visible(False)
        bare = _pixels(canvas)
        width, height = whole.size
        both = Image.new("RGB", (2 * width, height))
        both.paste(whole)
        both.paste(bare, (width, 0))
        few = both.quantize(COLOURS, dither=Image.Dither.NONE).convert("RGB")
        self._whole = few.crop((0, 0, width, height))
        self._bare = few.crop((width, 0, 2 * width, height))
        self._ink, self._time, self._to_px = ink, time, panels[0].transData
        self._end = round(panels[0].bbox.x1) + 1
        self._panels_px = [
            (height - round(axes.bbox.y1), height - round(axes.bbox.y0)) for axes in panels
        ]

    def at(self, time_s: float) -> Image.Image:
        """Return the plot as it is at a time [s]: a picture of the size asked for."""
        now = round(float(self._to_px.transform((time_s * self._time.per_si, 0.0))[0]))
        picture = self._bare.copy()
        picture.paste(self._whole.crop((0, 0, min(now + 1, self._end), picture.height)))
        for top, bottom in self._panels_px:
            ImageDraw.Draw(picture).line((now, top, now, bottom), fill=self._ink.faint)
        return picture


def _pixels(canvas: FigureCanvasAgg) -> Image.Image:
    canvas.draw()  # type: ignore[no-untyped-call]
    rgba = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(rgba)).convert("RGB")
