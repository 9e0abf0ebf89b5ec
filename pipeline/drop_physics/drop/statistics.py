"""Statistics of many samples of one quantity: mean, spread, quantiles, confidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from drop_physics.arrays import Float64

CONFIDENCE = 0.95
QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Moments:
    """Count, mean and sum of squared deviations: all that a confidence interval needs."""

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def with_values(self, values: ArrayLike) -> Moments:
        """Return the moments with more values included."""
        new: Float64 = np.asarray(values, dtype=np.float64)
        if not len(new):
            return self
        # Relative to the first: equal values have exactly their mean, and no spread.
        apart = new - new[0]
        mean = float(apart.mean())
        squares = float(np.sum((apart - mean) ** 2))
        return self.merged(Moments(len(new), float(new[0]) + mean, squares))

    def merged(self, other: Moments) -> Moments:
        """Return the moments of both.

        Source: T. F. Chan, G. H. Golub and R. J. LeVeque, "Updating formulae and a pairwise
        algorithm for computing sample variances", Stanford STAN-CS-79-773 (1979), equation 2.1.
        """
        count = self.count + other.count
        if not count:
            return self
        apart = other.mean - self.mean
        return Moments(
            count,
            self.mean + apart * other.count / count,
            self.squares + other.squares + apart**2 * self.count * other.count / count,
        )

    @property
    def spread(self) -> float | None:
        """Standard deviation, with n - 1; None for fewer than two values."""
        return math.sqrt(self.squares / (self.count - 1)) if self.count > 1 else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Confidence interval of the mean at 95 %: mean ± t s/√n with Student's t."""
        if self.spread is None:
            return None
        half = students_t(self.count - 1) * self.spread / math.sqrt(self.count)
        return self.mean - half, self.mean + half


def students_t(degrees: int) -> float:
    """Return the quantile of Student's t that encloses `CONFIDENCE` with its negative."""
    from scipy.special import stdtrit  # takes as long to import as a hundred runs

    return float(stdtrit(degrees, (1 + CONFIDENCE) / 2))


@dataclass(frozen=True)
class Summary:
    """Statistics of one quantity over the samples that have it."""

    quantity: str
    """The column of the table."""
    count: int
    """Number of samples that it is over: those in the air, in theory too; or if there are none,
    all."""
    mean: float
    """Their mean."""
    spread: float | None
    """Their standard deviation, with n - 1; None for fewer than two."""
    quantiles: dict[str, float]
    """The quantiles `5%`, `50%` and `95%`, interpolated between two samples."""
    interval: tuple[float, float] | None
    """Confidence interval of the mean, 95 %."""


def summaries(rows: pl.LazyFrame, quantities: tuple[str, ...]) -> list[Summary]:
    """Return a summary of each quantity over all rows that have it.

    A quantity that no row has is left out. Each takes one pass over the file.
    """
    summaries = []
    for quantity in quantities:
        values = rows.select(pl.col(quantity).drop_nulls()).collect()[quantity].to_numpy()
        if not len(values):
            continue
        moments = Moments().with_values(values)
        quantiles = np.quantile(values, QUANTILES)
        summaries.append(
            Summary(
                quantity=quantity,
                count=moments.count,
                mean=moments.mean,
                spread=moments.spread,
                quantiles={
                    f"{share:.0%}": float(value)
                    for share, value in zip(QUANTILES, quantiles, strict=True)
                },
                interval=moments.interval,
            )
        )
    return summaries
