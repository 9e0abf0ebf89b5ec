"""Combines an image with a caption below and a growing plot beside it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl
from PIL import Image, ImageDraw

from drop_physics.figures.growing_plot import GrowingPlot
from drop_physics.figures.overlay import font
from drop_physics.figures.plot import Plot
from drop_physics.figures.theme import DARK, LIGHT

GREYS = 8
"""Grey levels for smooth edges in a caption: with few colours, a gif stays exact."""
ASPECT = 4 / 3
"""Smallest ratio of a plot's width to its height."""


class Composition:
    """Adds a caption below images, and a growing plot beside them.

    Parameters
    ----------
    size_px
        Width and height of the images [px].
    plot
        The plot beside the images; None for no plot.
    captions
        A function that returns the caption for a time [s]; None for no captions.
    dark
        Whether colours suit a dark page.
    """

    def __init__(
        self,
        size_px: tuple[int, int],
        plot: Plot | None,
        captions: Callable[[float], str] | None,
        *,
        dark: bool,
    ) -> None:
        self._captions, self._theme = captions, DARK if dark else LIGHT
        width, height = size_px
        beside = 0 if plot is None else max(width, round(ASPECT * height))
        self._plot = None if plot is None else GrowingPlot(plot, (beside, height), dark=dark)
        self._letters = max(9, min(round((width + beside) / 31), round(height / 23)))
        below = 2 * self._letters if captions else 0
        self._size = width + beside, height + below

    def composed(self, picture: Image.Image, time_s: float) -> Image.Image:
        """Return the image of a moment with its caption and plot."""
        whole = Image.new("RGB", self._size, self._theme.page)
        whole.paste(picture)
        if self._plot is not None:
            whole.paste(self._plot.at(time_s), (picture.width, 0))
        if self._captions is None:
            return whole
        shade, text = Image.new("L", (self._size[0], 2 * self._letters)), self._captions(time_s)
        letters = self._letters
        while font(letters).getlength(text) > shade.width - self._letters and letters > 1:
            letters -= 1
        ImageDraw.Draw(shade).text(
            (self._letters // 2, self._letters), text, font=font(letters), fill=255, anchor="lm"
        )
        step_of_grey = 255 / (GREYS - 1)
        few = np.round(np.round(np.asarray(shade) / step_of_grey) * step_of_grey).astype(np.uint8)
        whole.paste(self._theme.text, (0, picture.height), Image.fromarray(few))
        return whole


class Captions:
    """The captions of a drop's moments.

    Parameters
    ----------
    table
        One row per sample, at least one: `time_s`, `simulated_m`, and `error_m`, which is null
        where no law explains the error.
    """

    def __init__(self, table: pl.DataFrame) -> None:
        self._times_s, self._heights_m, self._errors_m = (
            table[name].to_numpy() for name in ("time_s", "simulated_m", "error_m")
        )
        explained = np.flatnonzero(table["timestep_m"].is_not_null())
        self._last = int(explained[-1]) if len(explained) else 0
        """Index of the last sample whose error is explained."""

    def __call__(self, time_s: float) -> str:
        """Return the caption of the sample nearest to a time."""
        row = int(np.abs(self._times_s - time_s).argmin())
        error_m = float(self._errors_m[min(row, self._last)])
        height_m = float(self._heights_m[row])
        return caption(float(self._times_s[row]), height_m, error_m, ended=row > self._last)


def caption(time_s: float, height_m: float, error_m: float, *, ended: bool = False) -> str:
    """Return the caption for a time; digits are at the same place in all captions of a drop.

    `ended` means that this is the last error that the plot explains.
    """
    height = f"{round(height_m, 4) + 0.0:.4f}"
    error = f"{round(error_m * 1e3, 3) + 0.0:+.3f}"
    what = "last error" if ended else "error"
    return f"t {time_s:.3f} s  height {height} m  {what} {error:>7} mm".replace("-", "−")
