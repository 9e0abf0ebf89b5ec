"""The error of a constraint: distance and angle between the two frames that it should join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.recording import NOBODY, ExplainedPiece
from drop_physics.messages import Message
from drop_physics.physics.rotations import matrix
from drop_physics.quantities import number

EXACT = 0.1
"""Share of a body's size to which the gap of a constraint is compared: its target distance is 0,
which gives no scale."""


@dataclass(eq=False)
class ConstraintGap:
    """The error of a constraint after each step, collected chunk by chunk."""

    most: float = 0.0
    step: int = -1
    """The sample at which the error is largest."""
    end: float = 0.0
    """The gap after the last step in which the constraint is active."""

    def add(self, off: Float64, samples: Int64, active: Flags) -> None:
        """Add errors at the given samples; all arrays have the shape (n,)."""
        off = np.where(active & np.isfinite(off), np.abs(off), 0.0)
        at = int(np.argmax(off))
        if off[at] > self.most:
            self.most, self.step = float(off[at]), int(samples[at])
        if active.any():
            self.end = float(off[np.flatnonzero(active)[-1]])


@dataclass(frozen=True)
class ConstraintFrame:
    """One of the two frames that a constraint joins, on a link."""

    body: int
    """Id of the body; NOBODY for a frame of the world."""
    link: int
    place_m: tuple[float, ...]
    """Position of the frame from the link's centre of mass, in the axes of the link's inertia; for
    a frame of the world, its position there. Shape (3,)."""
    orientation: tuple[float, ...]
    """Orientation of the frame in the same axes: a quaternion x, y, z, w."""


def frames(
    sides: Sequence[ConstraintFrame],
    explained: ExplainedPiece,
    samples: Int64,
    *,
    after: bool = True,
) -> tuple[Float64, Float64]:
    """Return the origins [m] and axes of two frames at samples, (n, 2, 3) and (n, 2, 3, 3).

    Without `after`, the poses are those before the steps that lead to the samples.
    """
    places_m = np.full((len(samples), 2, 3), np.nan)
    axes = np.full((len(samples), 2, 3, 3), np.nan)
    for k, side in enumerate(sides):
        place_m, turned = np.zeros((len(samples), 3)), np.tile(np.eye(3), (len(samples), 1, 1))
        if side.body != NOBODY:
            place_m, turned = explained.placed(side.body, side.link, samples, after=after)
        places_m[:, k] = place_m + turned @ np.array(side.place_m)
        axes[:, k] = turned @ matrix(side.orientation)
    return places_m, axes


def apart(places_m: Float64, axes: Float64) -> tuple[Float64, Float64]:
    """Return the distance [m] and the angle [rad] between two frames, shape (n,) each.

    With R the rotation between them it is |(R₃₂ - R₂₃, R₁₃ - R₃₁, R₂₁ - R₁₂)| = 2 sin φ and
    tr R - 1 = 2 cos φ.
    """
    turned = np.swapaxes(axes[:, 0], 1, 2) @ axes[:, 1]
    skewed = turned - np.swapaxes(turned, 1, 2)
    sine = np.linalg.norm(skewed[:, [2, 0, 1], [1, 2, 0]], axis=1)
    angle = np.arctan2(sine, np.trace(turned, axis1=1, axis2=2) - 1)
    return np.linalg.norm(places_m[:, 0] - places_m[:, 1], axis=1), np.asarray(angle)


def turned_by(gap: ConstraintGap, beside: float, subject: MeasuredBody, words: RowWords) -> Message:
    """Describe the angle error of a constraint; nothing if it is negligible."""
    if gap.most <= 0.1 * beside:
        return Message("")
    return Message(
        "; turned by {angle}° at {time} ({end}° at the end)",
        angle=number(float(np.degrees(gap.most))),
        time=words.time(subject, gap.step),
        end=number(float(np.degrees(gap.end))),
    )


def with_gap(row: AccountRow, gap: ConstraintGap, unit: str, size: float) -> AccountRow:
    """Return a row with an error added, compared with the given size."""
    return replace(
        row,
        asked=0.0,
        got=gap.most,
        gap=gap.most,
        unit=unit,
        step=gap.step,
        salience=gap.most / size / EXACT,
    )


def with_gaps(
    row: AccountRow, gap: ConstraintGap, turned: ConstraintGap, size_m: float
) -> AccountRow:
    """Return a row with the larger of a distance (in sizes) and an angle; the other is added."""
    if turned.most > gap.most / size_m:
        return replace(with_gap(row, turned, "rad", 1.0), besides=((gap.most, "m"),))
    return replace(with_gap(row, gap, "m", size_m), besides=((turned.most, "rad"),))
