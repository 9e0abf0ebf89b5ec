"""The content of a plot, and of a column of the viewer: panels of curves over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drop_physics.arrays import Float64, Int64

Look = Literal["line", "broad", "wide", "dashed"]


@dataclass(frozen=True, eq=False)
class Curve:
    """A named curve."""

    name: str
    times_s: Float64
    """Time of each value, shape (n,)."""
    values: Float64
    """Values, shape (n,); nan in gaps."""
    colour: str
    """The colour as `#rrggbb`; empty for that of text."""
    look: Look = "line"
    steps: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    """Step of each value, shape (n,); empty if only times are known."""


@dataclass(frozen=True)
class Inset:
    """A short time that a panel shows enlarged, with a point for each sample."""

    title: str
    first_s: float
    last_s: float


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves of one unit, and the finding that they show."""

    title: str
    unit: str
    curves: Sequence[Curve]
    mark: str = ""
    """Number of the finding that it shows."""
    span_s: tuple[float, float] | None = None
    """The time that the finding covers."""
    moment_s: float | None = None
    """The moment that it is about."""
    zero: bool = False
    """Whether the curves are read from zero."""
    stacked: bool = False
    """Whether the curves after the first add up to it: areas, from zero up and down."""
    log: bool = False
    """Whether the scale is logarithmic."""
    inset: Inset | None = None


@dataclass(frozen=True, eq=False)
class Plot:
    """A title, its meaning, and the panels that show it."""

    title: str
    lines: Sequence[str]
    """Lines below the title."""
    panels: Sequence[Panel]
