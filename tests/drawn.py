"""Geometry of the drawn contents of a figure."""

from __future__ import annotations

from matplotlib.figure import Figure


def is_within(figure: Figure) -> bool:
    """Return whether all drawn elements, ticks and texts included, lie within a figure."""
    figure.draw_without_rendering()
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    return bool(drawn.x0 >= 0 and drawn.y0 >= 0 and drawn.x1 <= width and drawn.y1 <= height)
