"""Results that print the same text as on the terminal, and in notebooks as HTML with a plot.

A result names the module that builds its report. That module belongs to a higher room, so it is
imported only on demand.
"""

from __future__ import annotations

import importlib
from typing import Any, ClassVar

MARKDOWN, NOTEBOOK = "drop_physics.report.markdown", "drop_physics.report.notebook"
PLAIN = "drop_physics.explain.jsonable"


class Printable:
    """A result of a command; printing it in Python shows the same text as the command."""

    __slots__ = ()
    reported_by: ClassVar[str]
    """The module whose `report_of` builds the report, and whose `json_of`, if any, the JSON."""

    def __init_subclass__(cls, reported_by: str) -> None:
        cls.reported_by = reported_by
        cls._repr_pretty_ = Printable._repr_pretty_  # type: ignore[method-assign]  # before a dataclass's __repr__

    def report(self, **how: object) -> Any:  # noqa: ANN401 - a Report, of a room above
        """Return the report of the result, for any renderer."""
        return importlib.import_module(self.reported_by).report_of(self, **how)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object of `--json`: all fields, or an object from the report module."""
        plain = importlib.import_module(PLAIN).jsonable
        return dict(getattr(importlib.import_module(self.reported_by), "json_of", plain)(self))

    def markdown(self, **how: object) -> str:
        """Return the report as Markdown, in English, for files."""
        markdown_of = importlib.import_module(MARKDOWN).markdown_of
        return str(markdown_of(self.report(**how), say=str))

    def __str__(self) -> str:
        return str(importlib.import_module(NOTEBOOK).text_of(self))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # noqa: ANN401, ARG002
        printer.text(str(self))

    def _repr_html_(self) -> str:
        return str(importlib.import_module(NOTEBOOK).html_of(self))

    def view(self, *, height_px: int = 700, at_s: float | None = None) -> Any:  # noqa: ANN401 - a widget of Rerun's
        """Return a notebook widget of Rerun's viewer, with the result's recording and its analysis.

        With `at_s`, the viewer opens at this simulated time [s]. It needs `rerun-notebook`, which
        `pip install '.[notebook]'` installs, and a notebook that supports widgets; otherwise, a
        video of the recording is returned instead.
        """
        return importlib.import_module(NOTEBOOK).Viewed(self, height_px, at_s)
