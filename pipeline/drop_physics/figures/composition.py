"""A camera picture with a caption below it and a growing plot beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from drop_physics.figures import style
from drop_physics.figures.growing_plot import GrowingPlot

if TYPE_CHECKING:
    import polars as pl

GREYS = 8
"""Shades of a caption's edges: with few colours a gif stays exact."""


class Composition:
    """Adds captions, and optionally a plot, to the pictures of one drop.

    Parameters
    ----------
    table
        One row per sample, at least one, see `plot.build_figure`; with `error_m`.
    size_px
        Width and height of the camera's pictures [px].
    with_plot
        Whether the plot is beside them.
    dark
        Whether it is for a dark page.
    """

    def __init__(
        self, table: pl.DataFrame, size_px: tuple[int, int], *, with_plot: bool, dark: bool = False
    ) -> None:
        self._columns = {
            name: table[name].to_numpy() for name in ("time_s", "simulated_m", "error_m")
        }
        self._ink = style.DARK if dark else style.LIGHT
        width, height = size_px
        self._plot = GrowingPlot(table, size_px, dark=dark) if with_plot else None
        self._letters = max(9, min(round(width / 28), round(height / 18)))
        self._font = ImageFont.truetype(
            f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSansMono.ttf", self._letters
        )
        self._size = (width * (2 if with_plot else 1), height + 2 * self._letters)

    def composed(self, picture: Image.Image, step: int) -> Image.Image:
        """Return a camera's picture of a step, with its caption and plot."""
        step = min(step, len(self._columns["time_s"]) - 1)
        time_s, height_m, error_m = (float(column[step]) for column in self._columns.values())
        whole = Image.new("RGB", self._size, self._ink.page)
        whole.paste(picture)
        if self._plot is not None:
            whole.paste(self._plot.at(time_s), (picture.width, 0))
        shade = Image.new("L", (self._size[0], 2 * self._letters))
        ImageDraw.Draw(shade).text(
            (self._letters // 2, self._letters),
            caption(time_s, height_m, error_m),
            font=self._font,
            fill=255,
            anchor="lm",
        )
        step_of_grey = 255 / (GREYS - 1)
        few = np.round(np.round(np.asarray(shade) / step_of_grey) * step_of_grey).astype(np.uint8)
        whole.paste(self._ink.text, (0, picture.height), Image.fromarray(few))
        return whole


def caption(time_s: float, height_m: float, error_m: float) -> str:
    """Return the caption of a moment; in all captions of a drop the digits line up."""
    height = f"{round(height_m, 4) + 0.0:.4f}"
    error = f"{round(error_m * 1e3, 3) + 0.0:+.3f}"
    return f"t {time_s:.3f} s  height {height} m  error {error:>7} mm".replace("-", "−")
