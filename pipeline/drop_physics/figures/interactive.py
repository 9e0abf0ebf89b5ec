"""Panels as curves that a reader of a page can hover over and zoom, by Bokeh.

Its colours are legible on light and on dark pages, and what it draws is SVG, sharp in print.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drop_physics import colours
from drop_physics.errors import DropError
from drop_physics.figures.plot import Curve, Look, Panel
from drop_physics.messages import translated

GREY = "#808890"
"""Colour of axes and letters."""
FAINT = 0.25
"""Opacity of a grid."""
COVERED = 0.12
"""Opacity of the time that a finding covers."""
HEIGHT_PX = 230
WIDTHS: dict[Look, float] = {"line": 1.8, "broad": 3.5, "wide": 5.0, "dashed": 1.5}


@dataclass(frozen=True)
class Interactive:
    """Panels as parts of a page."""

    head: str
    """Scripts that the page loads once: the library, inline."""
    divs: Sequence[str]
    """The HTML of each panel's place."""
    script: str
    """The script that draws the panels there."""


def interactive(panels: Sequence[Panel]) -> Interactive:
    """Return panels on one time axis; zooming one zooms all.

    Raises
    ------
    DropError
        If Bokeh is not installed.
    """
    with _without_pandas():
        try:
            embed, models, plotting, resources = (
                importlib.import_module(f"bokeh.{name}")
                for name in ("embed", "models", "plotting", "resources")
            )
        except ModuleNotFoundError:
            raise DropError("--html needs Bokeh; try: pip install bokeh") from None
        ends_s = [curve.times_s[-1:] for panel in panels for curve in panel.curves]
        end_s = float(np.concatenate(ends_s).max(initial=0.0)) if ends_s else 0.0
        time = models.Range1d(0, end_s or 1, bounds=(0, end_s or 1))
        drawn = [_figure(panel, time, models, plotting) for panel in panels]
        script, divs = embed.components(drawn)
        head = resources.Resources(mode="inline", components=["bokeh"]).render_js()
    return Interactive(head, divs, script)


@contextlib.contextmanager
def _without_pandas() -> Iterator[None]:
    """Let Bokeh do without pandas, which it else imports, if installed: that takes a second."""
    modules: dict[str, Any] = sys.modules
    absent = "pandas" not in modules
    try:
        if absent:
            modules["pandas"] = None
        yield
    finally:
        if absent:
            del modules["pandas"]


def _figure(panel: Panel, time: Any, models: Any, plotting: Any) -> Any:  # noqa: ANN401 - Bokeh's
    tools = [
        models.BoxZoomTool(dimensions="width"),
        models.PanTool(dimensions="width"),
        models.WheelZoomTool(dimensions="width"),
        models.ResetTool(),
    ]
    figure = plotting.figure(
        height=HEIGHT_PX,
        sizing_mode="stretch_width",
        x_range=time,
        y_axis_type="log" if panel.log else "linear",
        tools=tools,
        output_backend="svg",
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
        min_border_left=75,
    )
    figure.toolbar.logo, figure.toolbar.autohide = None, True
    for axis, label in zip(figure.axis, ("t [s]", f"[{panel.unit}]"), strict=True):
        axis.axis_label, axis.axis_label_text_font_style = label, "normal"
        axis.axis_line_color = axis.major_tick_line_color = axis.minor_tick_line_color = GREY
        axis.axis_label_text_color = axis.major_label_text_color = GREY
    for grid in figure.grid:
        grid.grid_line_color, grid.grid_line_alpha = GREY, FAINT
    if panel.span_s is not None:
        first, last = panel.span_s
        covered = {"fill_color": GREY, "fill_alpha": COVERED, "line_color": None}
        figure.add_layout(models.BoxAnnotation(left=first, right=last, **covered))
    if panel.zero:  # which is then in the panel's range, too
        figure.line(time.bounds, (0, 0), color=GREY, line_width=1)
    for curve in panel.curves:
        line = figure.line(
            curve.times_s,
            curve.values.astype(np.float32),
            color=colour_of(curve),
            line_width=WIDTHS[curve.look],
            line_dash="dashed" if curve.look == "dashed" else "solid",
            name=translated(curve.name),
        )
        tip = [("", "$name"), ("t", "@x{0.0000} s"), ("", f"@y{{0.0000e+0}} {panel.unit}")]
        figure.add_tools(models.HoverTool(renderers=[line], tooltips=tip, visible=False))
    return figure


def colour_of(curve: Curve) -> str:
    """Return the colour of a curve, legible on light and on dark pages."""
    return curve.colour or colours.TOTAL_IN_VIEWER
