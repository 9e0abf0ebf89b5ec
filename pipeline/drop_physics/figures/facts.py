"""What a plot points out, beside its table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Facts:
    """What a plot points out; what is None is left out."""

    title: str
    subtitle: str = ""
    at_s: float | None = None
    """The time whose error is broken down [s], moved to the nearest sample that has terms; None
    for the last one that has."""
    impact_s: float | None = None
    rest_m: float | None = None
