"""A result prints as the terminal shows it, and in a notebook with its plot.

It names the function that formats it, as `module:function`: in a room above, so loaded on demand.
"""

from __future__ import annotations

import importlib
from typing import Any, ClassVar

NOTEBOOK = "drop_physics.console.notebook"


class Printable:
    """A result that Python prints as the command does."""

    __slots__ = ()
    lines_of: ClassVar[str]
    """The `module:function` that returns its lines, with Rich's markup."""

    def __init_subclass__(cls, lines_of: str) -> None:
        cls.lines_of = lines_of
        cls._repr_pretty_ = Printable._repr_pretty_  # type: ignore[method-assign]  # before a dataclass's __repr__

    def lines(self) -> list[str]:
        """Return what the terminal prints, with Rich's markup."""
        module, _, function = self.lines_of.partition(":")
        lines: list[str] = getattr(importlib.import_module(module), function)(self)
        return lines

    def __str__(self) -> str:
        return str(importlib.import_module(NOTEBOOK).text_of(self))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:  # noqa: ANN401, ARG002
        printer.text(str(self))

    def _repr_html_(self) -> str:
        return str(importlib.import_module(NOTEBOOK).html_of(self))

    def view(self, *, height_px: int = 700) -> Any:  # noqa: ANN401 - a widget of Rerun's
        """Return Rerun's viewer of the result's recording, with its analysis, for a notebook.

        It needs `rerun-notebook`, which `pip install '.[notebook]'` brings, and a page in which
        widgets live. Elsewhere a film of the recording stands in for it.
        """
        return importlib.import_module(NOTEBOOK).Viewed(self, height_px)
