"""The content of a plot, or of a column of the viewer: panels of curves over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drop_physics.arrays import Float64, Int64

Look = Literal["line", "broad", "wide", "dashed"]


@dataclass(frozen=True, eq=False)
class Curve:
    """A named curve over time."""

    name: str
    times_s: Float64
    """Time of each value, shape (n,)."""
    values: Float64
    """Values, shape (n,); nan for gaps."""
    colour: str
    """Colour as `#rrggbb`; empty for the text colour."""
    look: Look = "line"
    steps: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    """Step of each value, shape (n,); empty if only the times are known."""


@dataclass(frozen=True)
class Inset:
    """A short time of a panel, enlarged, with a point for each sample."""

    title: str
    first_s: float
    last_s: float


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves with a common unit, and the number of the finding that they illustrate."""

    title: str
    unit: str
    curves: Sequence[Curve]
    mark: str = ""
    """Number of the finding that the panel illustrates."""
    span_s: tuple[float, float] | None = None
    """Time span of the finding."""
    moment_s: float | None = None
    """The moment that the finding concerns."""
    zero: bool = False
    """Whether the axis starts at zero."""
    stacked: bool = False
    """Whether the first curve is the sum of the others, which are drawn as stacked areas."""
    log: bool = False
    """Whether the axis is logarithmic."""
    inset: Inset | None = None


@dataclass(frozen=True, eq=False)
class Plot:
    """A title, lines that explain it, and panels of curves."""

    title: str
    lines: Sequence[str]
    """Lines below the title."""
    panels: Sequence[Panel]
