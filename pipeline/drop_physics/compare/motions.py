"""Collects bodies' samples in a range of steps, to compare two recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.trace.states import Joints, Rows, by_body, motion_of


@dataclass(frozen=True)
class BodySamples:
    """A body's samples, of the base if it can move, and of the joints if there are any."""

    steps: Int64
    base: Rows | None
    joints: Joints | None

    def at(self, rows: Flags) -> BodySamples:
        """Return the samples with the given indices."""
        base = None if self.base is None else self.base[rows]
        joints = None if self.joints is None else self.joints.at(rows)
        return BodySamples(self.steps[rows], base, joints)

    @property
    def numbers(self) -> Float64:
        """All numbers of the samples, the base's first, shape (n, numbers)."""
        parts = [] if self.base is None else [motion_of(self.base)]
        if self.joints is not None:
            parts += [self.joints.position, self.joints.velocity, self.joints.effort]
        return np.hstack(parts) if parts else np.empty((len(self.steps), 0))


NOTHING = BodySamples(np.empty(0, np.int64), None, None)


def motions(bases: Rows, joints: Mapping[int, Joints]) -> dict[int, BodySamples]:
    """Return the samples of bodies, by body id."""
    found = {
        number: BodySamples(rows["step"], rows, None) for number, rows in by_body(bases).items()
    }
    for number, held in joints.items():
        base = found.get(number)
        if base is None:
            found[number] = BodySamples(held.steps, None, held)
            continue
        base, jointed = together(base, BodySamples(held.steps, None, held))
        if len(base.steps):
            found[number] = BodySamples(base.steps, base.base, jointed.joints)
    return found


def together(
    mine: BodySamples, theirs: BodySamples, *, finer: int = 1
) -> tuple[BodySamples, BodySamples]:
    """Return the samples at common times, if the second run makes `finer` steps for each step."""
    due = mine.steps * finer
    if np.array_equal(due, theirs.steps):
        return mine, theirs
    return mine.at(np.isin(due, theirs.steps)), theirs.at(np.isin(theirs.steps, due))
