"""Constraints that join two points of bodies: their distance, angle and force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.account.gap import (
    ConstraintFrame,
    ConstraintGap,
    apart,
    frames,
    turned_by,
    with_gaps,
)
from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody, in_weights
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import Points
from drop_physics.explain.joined import FIXED, ConstraintVersion
from drop_physics.explain.recording import NOBODY, ExplainedPiece
from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.quantities import quantity
from drop_physics.trace.events import Body

FULL = 1 - 1e-6
"""Share of its limit above which a constraint is at its limit."""
SOON = 10
"""Number of first and of last steps of a constraint for which data is kept."""


@dataclass(eq=False)
class HeldConstraint:
    """A constraint that joins two points, with their distance; filled chunk by chunk."""

    last: ConstraintVersion
    """The constraint as defined in its last step."""
    first_gap_m: float | None = None
    """Distance between the constraint's ends before its first step [m], the smallest one if calls
    redefined the constraint before; None if that step is not recorded."""
    first_angle_rad: float = 0.0
    """Angle between the constraint's frames before its first step; 0 if orientations are free."""
    least_gap_m: float = np.inf
    """The smallest distance after one of the first `SOON` steps."""
    least_angle_rad: float = np.inf
    gap: ConstraintGap = field(default_factory=ConstraintGap)
    """The distance between the constraint's ends after a step [m]."""
    turned: ConstraintGap = field(default_factory=ConstraintGap)
    """The angle between the ends' frames [rad], if the constraint fixes orientations, too."""
    pull_n: float = 0.0
    """Force of the constraint at the largest distance."""
    limit_n: float = np.inf
    """Maximum force of the constraint, at the largest distance."""
    most_n: float = 0.0
    steps: int = 0
    first_step: int = -1
    last_step: int = -1
    full: int = 0
    """Number of steps in which a component of the force is at its limit, since that limit was
    set."""
    last_limit_n: float = np.inf
    weight_n: float = 0.0
    """Weight of the only moving body, as its largest component along a world axis; 0 if several
    bodies move, or the body has other constraints."""
    across_m_s: float = 0.0
    """The largest component of a body's velocity perpendicular to gravity, since such motion adds
    load."""
    turns_rad_s: float = 0.0
    """The largest rate of a body or its joints."""
    ends_m: Float64 = field(default_factory=lambda: np.empty((0, 2, 3)))
    """Both ends after the last `SOON` + 1 steps, shape (n, 2, 3)."""
    strained: Flags = field(default_factory=lambda: np.empty(0, np.bool_))
    """Whether the constraint is at its limit in the last `SOON` steps, shape (n,)."""
    leans: Flags = field(default_factory=lambda: np.empty(0, np.bool_))
    """Whether a body of the constraint touches anything in the last `SOON` + 1 steps, shape
    (n,)."""

    @property
    def began(self) -> int:
        """The first step in which the constraint acts."""
        return self.last.made.at.step + 1

    @property
    def gaps_m(self) -> Float64:
        """Distances between the points after the last `SOON` + 1 steps, shape (n,)."""
        return lengths(self.ends_m[:, 0] - self.ends_m[:, 1])

    def add(
        self,
        told: Sequence[ConstraintVersion],
        which: Int64,
        steps: Int64,
        forces_n: Float64,
        explained: ExplainedPiece,
        points: Points,
        times: StepTimes,
    ) -> None:
        """Add the steps of a chunk, each with its definition and force, shapes (n,) and (n, 3)."""
        self.last = last = told[which[-1]]
        limit_n = np.array([each.limit_n_s for each in told])[which] / times.of_steps(steps)[0]
        since = np.array([each.limited_since for each in told])[which]
        at_limit = np.abs(forces_n).max(axis=1) >= limit_n * FULL
        self._begin([each for each in told if each.made is last.made], steps, explained)
        pulls_n, active = lengths(forces_n), np.ones(len(steps), np.bool_)
        off_m, off_rad = np.zeros((2, len(steps)))
        for index in np.unique(which).tolist():
            rows = np.flatnonzero(which == index)
            off_m[rows], off_rad[rows] = apart(*frames(_sides(told[index]), explained, steps[rows]))
        self.gap.add(off_m, steps, active)
        if last.kind == FIXED:
            self.turned.add(off_rad, steps, active)
        self.most_n = max(self.most_n, float(pulls_n.max()))
        if self.gap.step in steps:
            at = int(np.searchsorted(steps, self.gap.step))
            self.pull_n, self.limit_n = float(pulls_n[at]), float(limit_n[at])
        self.first_step = int(steps[0]) if self.first_step < 0 else self.first_step
        self.last_step, self.steps = int(steps[-1]), self.steps + len(steps)
        self.full += int((at_limit & (steps > since)).sum())
        self.last_limit_n = float(limit_n[-1])
        numbers = [body for body in last.bodies if body != NOBODY]
        touched = points.step[np.isin(points.body, numbers).any(axis=1)]
        late = steps[-SOON - 1 :]
        self.ends_m = _tail(self.ends_m, frames(_sides(last), explained, late)[0], SOON + 1)
        self.strained = _tail(self.strained, at_limit, SOON)
        self.leans = _tail(self.leans, np.isin(late, touched), SOON + 1)
        self._load(numbers, explained)

    def _begin(
        self, told: Sequence[ConstraintVersion], steps: Int64, explained: ExplainedPiece
    ) -> None:
        """Add the first steps of the constraint, if a chunk has them."""
        is_fixed = self.last.kind == FIXED
        if steps[0] == self.began:
            before = [
                apart(*frames(_sides(each), explained, steps[:1], after=False))
                for each in told
                if each.at.step < self.began
            ]
            self.first_gap_m = min((float(gap_m[0]) for gap_m, _ in before), default=None)
            angles = (float(angle[0]) if is_fixed else 0.0 for _, angle in before)
            self.first_angle_rad = min(angles, default=0.0)
        soon = steps[steps < self.began + SOON]
        if len(soon):
            gaps_m, angles_rad = apart(*frames(_sides(self.last), explained, soon))
            self.least_gap_m = min(self.least_gap_m, float(gaps_m.min()))
            self.least_angle_rad = min(self.least_angle_rad, float(angles_rad.min()))

    def _load(self, numbers: Sequence[int], explained: ExplainedPiece) -> None:
        """Add weight and velocities of the bodies that the constraint carries."""
        judged = [explained.bodies[body] for body in numbers if body in explained.bodies]
        moving = [each for each in judged if each.body.base_moves]
        self.weight_n = 0.0
        for each in moving:
            alone = len(moving) == 1 and explained.constraints.is_only_one_on(each.body.number)
            for steps in filter(len, each.intervals):
                tree, gravity_m_s2 = steps.law.tree, steps.reported.gravity_m_s2
                if alone:
                    weights_n = np.abs(tree.masses_kg.sum() * gravity_m_s2[-1])
                    self.weight_n = float(weights_n.max())
                acts = steps.steps >= self.began
                if tree.fixed or not acts.any():  # as long as it has no mass
                    continue
                velocity, pull = steps.after.velocity[acts], gravity_m_s2[acts]
                down = pull / np.maximum(lengths(pull), 1e-300)[:, None]
                along = np.sum(velocity[:, 3:6] * down, axis=1, keepdims=True)
                across_m_s = np.abs(velocity[:, 3:6] - along * down).max()
                turns_rad_s = np.abs(np.delete(velocity, np.s_[3:6], axis=1)).max()
                self.across_m_s = max(self.across_m_s, float(across_m_s))
                self.turns_rad_s = max(self.turns_rad_s, float(turns_rad_s))

    def row(self, its: list[MeasuredBody], child: Body, words: RowWords) -> AccountRow:
        """Return the row for the constraint; `its` are the movable bodies of the constraint."""
        lighter = min(its, key=lambda each: each.weight_n)
        size_m = min(each.size_m for each in its)
        names = [
            str(words.names.link(body, link))
            for body, link in zip(self.last.bodies, self.last.links, strict=True)
        ]
        told = Message(
            "its ends are {gap} apart at {time} ({end} at the end); it pulls with {pull} then, and "
            "with {most} at most, {weights}; its limit is {limit}",
            gap=quantity(self.gap.most, "m"),
            time=words.time(lighter, self.gap.step),
            end=quantity(self.gap.end, "m"),
            pull=quantity(self.pull_n, "N"),
            limit=quantity(self.limit_n, "N"),
            most=quantity(self.most_n, "N"),
            weights=in_weights(self.most_n, lighter, words.names.body(lighter.body.number)),
        )
        row = AccountRow(
            kind="asked",
            constraint=" – ".join(names),
            told=told + turned_by(self.turned, self.gap.most / size_m, lighter, words),
            at_limit=self.pull_n >= 0.999 * self.limit_n,
            subject=child,
            cause="constraint",
            span=(self.first_step, self.last_step, self.steps),
            noted={"held": self},
        )
        return with_gaps(row, self.gap, self.turned, size_m)


def _sides(version: ConstraintVersion) -> list[ConstraintFrame]:
    parts = version.bodies, version.links, version.pivots_m, version.orientations
    return [ConstraintFrame(*each) for each in zip(*parts, strict=True)]


def _tail(before: NDArray[Any], values: NDArray[Any], rows: int) -> NDArray[Any]:
    """Return the last rows of an array, with rows from earlier chunks if available."""
    return np.concatenate([before, values])[-rows:]
