"""A plot that grows with time: heights above, the error and its terms below.

It is drawn twice, with and without its data; a moment shows the first up to now, then the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image, ImageDraw

from drop_physics import colours
from drop_physics.figures import style
from drop_physics.figures.error_panel import COLUMNS, draw_terms
from drop_physics.figures.height_panel import CURVES, draw_heights
from drop_physics.figures.plot import with_theory_that_applies
from drop_physics.figures.story import Story
from drop_physics.figures.story_plot import draw_beside
from drop_physics.figures.style import Ink, Unit

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

SEEN = {name: colour for name, colour in colours.TERMS.items() if name != "rounding"}
COLOURS = 64
"""This many leave room for the camera's in a gif's table of 256."""
HEIGHT_IN = 3.3
"""Height of the figure [inch], which sets the relative size of its letters."""


class Growing:
    """A plot up to any moment; `_take` draws it."""

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


class GrowingStory(Growing):
    """What the plot of a script tells, up to any moment: its title, and its first panels.

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
        ink = style.DARK if dark else style.LIGHT
        with style.plain(ink):
            dpi = size_px[1] / HEIGHT_IN
            figure = Figure(figsize=(size_px[0] / dpi, HEIGHT_IN), dpi=dpi)
            canvas = FigureCanvasAgg(figure)
            panels, time = draw_beside(figure, story, ink)
            self._take(canvas, panels, time, ink)


class GrowingPlot(Growing):
    """The plot of a drop, up to any moment of it.

    Parameters
    ----------
    table
        One row per sample, at least one, see `plot.build_figure`.
    size_px
        Width and height [px].
    dark
        Whether it is for a dark page.
    """

    def __init__(self, table: pl.DataFrame, size_px: tuple[int, int], *, dark: bool) -> None:
        width, height = size_px
        ink = style.DARK if dark else style.LIGHT
        self._ink, self._time = (
            ink, style.unit_for(float(table["time_s"][-1]), style.SECONDS, usual="s"),
        )  # fmt: skip
        with style.plain(ink):
            dpi = height / HEIGHT_IN
            figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi)
            canvas = FigureCanvasAgg(figure)
            panels = self._drawn(figure, table)
            self._take(canvas, panels, self._time, ink)

    def _drawn(self, figure: Figure, table: pl.DataFrame) -> tuple[Axes, Axes]:
        above, below = figure.subplots(2, 1, sharex=True)
        figure.subplots_adjust(0.1, 0.12, 0.955, 0.93, hspace=0.3)
        below.set_xlim(0, float(table["time_s"][-1]) * self._time.per_si or 1)
        below.set_xlabel(style.words("time [{unit}]", unit=self._time.name), size=9)
        draw_heights(
            above,
            with_theory_that_applies(table),
            impact_s=None,
            rest_m=None,
            time=self._time,
            ink=self._ink,
        )
        draw_terms(below, table.drop_nulls(COLUMNS), self._time, self._ink)
        for line in above.lines:
            line.set_linewidth(0.6 * line.get_linewidth())
        drawn = {line.get_label() for line in above.lines}
        labels = {style.words(label): colour for label, colour, _ in CURVES.values()}
        labels[style.words("simulated")] = self._ink.simulated
        heights = {label: colour for label, colour in labels.items() if label in drawn}
        terms = {style.words(name): colour for name, colour in SEEN.items()}
        for axes, what, names in (
            (above, style.words("height"), heights),
            (below, style.words("error"), {style.words("total"): self._ink.text} | terms),
        ):
            unit = axes.get_ylabel().rpartition("[")[2]
            axes.set_ylabel("")
            axes.set_title(f"{what} [{unit}", loc="left", size=9.5, pad=4)
            axes.tick_params(labelsize=8.5)
            figure.legend(  # not the axes' own, which would be hidden as data
                handles=[Line2D([], []) for _ in names],
                labels=list(names),
                labelcolor=list(names.values()),
                prop={"size": 9, "weight": "bold"},
                loc="lower right",
                bbox_to_anchor=(axes.get_position().x1, axes.get_position().y1),
                ncols=len(names),
                handlelength=0,
                handletextpad=0,
                columnspacing=1,
                borderpad=0.2,
                borderaxespad=0,
            )
        return above, below


def _pixels(canvas: FigureCanvasAgg) -> Image.Image:
    canvas.draw()  # type: ignore[no-untyped-call]
    rgba = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(rgba)).convert("RGB")
