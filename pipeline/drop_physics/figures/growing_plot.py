"""A plot that grows with time, shown beside a video.

The plot is drawn twice, with and without curves. An image shows the first drawing up to the current
time, and the second one after it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from drop_physics.figures import style
from drop_physics.figures.panel_plot import draw_beside
from drop_physics.figures.plot import Plot
from drop_physics.figures.theme import DARK, LIGHT

COLOURS = 128
"""Number of colours of the plot, which leaves as many for the camera's image in a gif."""
HEIGHT_IN = 3.3
"""Height of the figure [inch], which determines the relative size of its text."""


class GrowingPlot:
    """A plot's title and first panels, drawn up to any moment.

    Parameters
    ----------
    plot
        The plot, with at least one panel.
    size_px
        Width and height [px].
    dark
        Whether colours suit a dark page.
    """

    def __init__(self, plot: Plot, size_px: tuple[int, int], *, dark: bool) -> None:
        self._theme = DARK if dark else LIGHT
        width, height = size_px
        dpi = height / HEIGHT_IN
        with style.themed(self._theme):
            figure = Figure(figsize=(width / dpi, HEIGHT_IN), dpi=dpi)
            canvas = FigureCanvasAgg(figure)
            panels, self._time = draw_beside(figure, plot, self._theme)
            whole = _pixels(canvas)
            for axes in panels:
                for data in (*axes.lines, *axes.collections):
                    data.set_visible(False)
            both = Image.new("RGB", (2 * width, height))
            both.paste(whole)
            both.paste(_pixels(canvas), (width, 0))
        few = both.quantize(COLOURS, dither=Image.Dither.NONE).convert("RGB")
        self._whole = few.crop((0, 0, width, height))
        self._bare = few.crop((width, 0, 2 * width, height))
        self._to_px = panels[0].transData
        self._end = round(panels[0].bbox.x1) + 1
        self._panels_px = [
            (height - round(axes.bbox.y1), height - round(axes.bbox.y0)) for axes in panels
        ]

    def at(self, time_s: float) -> Image.Image:
        """Return the plot up to a time [s], as an image of the requested size."""
        now = round(float(self._to_px.transform((time_s * self._time.per_si, 0.0))[0]))
        picture = self._bare.copy()
        picture.paste(self._whole.crop((0, 0, min(now + 1, self._end), picture.height)))
        for top, bottom in self._panels_px:
            ImageDraw.Draw(picture).line((now, top, now, bottom), fill=self._theme.faint)
        return picture


def _pixels(canvas: FigureCanvasAgg) -> Image.Image:
    canvas.draw()  # type: ignore[no-untyped-call]
    rgba = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(rgba)).convert("RGB")
