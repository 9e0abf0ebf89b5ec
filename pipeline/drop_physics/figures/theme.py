"""Colours of plots and videos that differ between light and dark pages."""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics import colours


@dataclass(frozen=True)
class Theme:
    """The colours that differ between light and dark pages, as `#rrggbb`."""

    page: str
    text: str
    faint: str
    """Colour of labels and notes, which should be unobtrusive."""
    simulated: str
    """Colour of the thin simulated line, on the page and on the broad lines of theory."""
    tiles: tuple[str, str]
    """Both colours of the floor's tiles in a video."""


LIGHT = Theme("#ffffff", colours.TOTAL, "#5f6670", colours.SIMULATED, ("#e4e7eb", "#cdd2d9"))
DARK = Theme("#0d1117", "#e6edf3", "#9aa4af", "#d8effd", ("#2a2f36", "#363c45"))
