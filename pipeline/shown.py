"""A result prints as the terminal shows it, and in a notebook with its plot.

It names who prints it, as `module:function`: a room above, which is loaded when it is asked.
"""

from __future__ import annotations

import importlib
from typing import ClassVar

NOTEBOOK = "pipeline.console.notebook"


class Shown:
    """What every result can do: be printed, in Python as by the command."""

    __slots__ = ()
    lines_of: ClassVar[str]
    """The `module:function` that returns its lines, with Rich's markup."""

    def __init_subclass__(cls, lines_of: str) -> None:
        cls.lines_of = lines_of

    def lines(self) -> list[str]:
        """Return what the terminal prints, with Rich's markup."""
        module, _, function = self.lines_of.partition(":")
        found: list[str] = getattr(importlib.import_module(module), function)(self)
        return found

    def __str__(self) -> str:
        return str(importlib.import_module(NOTEBOOK).text_of(self))

    def _repr_html_(self) -> str:
        return str(importlib.import_module(NOTEBOOK).html_of(self))
