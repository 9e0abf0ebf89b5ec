"""The colours of plots and films that differ between light and dark pages."""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics import colours


@dataclass(frozen=True)
class Ink:
    """The colours that differ between light and dark pages."""

    page: str
    text: str
    faint: str
    """For explanations that must not stand out: labels of axes, notes."""
    simulated: str
    """A thin line on the page, and on the broad lines of theory."""


LIGHT = Ink(page="#ffffff", text=colours.TOTAL, faint="#5f6670", simulated=colours.SIMULATED)
DARK = Ink(page="#0d1117", text="#e6edf3", faint="#9aa4af", simulated="#d8effd")
