"""Touchdowns: runs of samples in floor contact, between flights or at the recording's end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drop_physics.drop.case import DropCase
from drop_physics.drop.samples import DropSamples
from drop_physics.physics.base import Motion
from drop_physics.physics.laws.bullet import contact as bullet_contact
from drop_physics.physics.laws.bullet.law import BulletLaw

CORNERS = 4
"""Number of contact points of a box that lies flat."""


@dataclass
class Touchdown:
    """A floor contact after a flight, up to its latest sample so far."""

    first: int
    before: Motion
    """The sample before the contact begins."""
    approach_m_s: float
    """Downward speed at the contact."""
    lands_flat: bool
    """Whether all corners of a box touch in the first sample."""
    last: int = 0
    stays_flat: bool = True
    """Whether all corners touch in all samples of the contact."""
    pushed: int | None = None
    """The last sample at which contact pushed; None if it has not pushed yet."""
    pushed_m_s: float = 0.0
    """The upward velocity at the last sample at which contact pushed [m/s]."""
    last_m_s: float = 0.0
    """The upward velocity at the last sample."""
    highest_m: float = -np.inf
    """The greatest height of the centre between the last sample and the next contact [m]."""
    left: bool = False
    """Whether a later sample is without contact."""
    returned: bool = False
    """Whether the body touches the floor again."""

    @property
    def leaves(self) -> bool:
        """True if the body rises off the floor before the recording ends."""
        return self.left and self.last_m_s > 0


class Touchdowns:
    """The touchdowns of a drop, in order, as samples are added.

    There are none with substeps, since PyBullet reports only the contacts of the last substep.
    """

    def __init__(self, case: DropCase) -> None:
        self._case = case
        self._found: list[Touchdown] = []
        self._open: Touchdown | None = None
        """The latest floor contact, even if it does not count as a touchdown."""

    def found(self) -> list[Touchdown]:
        """Return the touchdowns in which contact pushed, once all samples are added."""
        return [each for each in self._found if each.pushed is not None]

    def add(self, part: DropSamples, before: Motion) -> None:
        """Add samples; `before` is the previous sample of each (of the very first, itself)."""
        if self._case.hides_contacts:
            return
        touching = part.touching
        edges = np.flatnonzero(np.diff(touching)) + 1
        for begin, end in zip([0, *edges.tolist()], [*edges.tolist(), len(part)], strict=True):
            if not touching[begin]:
                self._fly(part, begin, end)
                continue
            if self._open is None or self._open.left:
                self._begin(part, before, begin)
            self._touch(part, begin, end)

    def _fly(self, part: DropSamples, begin: int, end: int) -> None:
        if self._open is not None:
            self._open.left = True
            highest_m = float(part.height_m[begin:end].max())
            self._open.highest_m = max(self._open.highest_m, highest_m)

    def _begin(self, part: DropSamples, before: Motion, row: int) -> None:
        if self._open is not None:
            self._open.returned = True
        case, first, sample = self._case, part.first + row, before.at(np.array([row]))
        self._open = Touchdown(
            first, sample, _approach_m_s(case, sample), bool(part.contact_points[row] == CORNERS)
        )
        inside = first == 0 or (first == 1 and not case.starts_above)
        if self._open.approach_m_s > 0 and not inside:  # else it was in the floor already
            self._found.append(self._open)

    def _touch(self, part: DropSamples, begin: int, end: int) -> None:
        run = self._open
        assert run is not None
        run.last, run.last_m_s = part.first + end - 1, float(part.velocity_m_s[end - 1, 2])
        run.highest_m = float(part.height_m[end - 1])
        run.stays_flat &= bool((part.contact_points[begin:end] == CORNERS).all())
        pushed = np.flatnonzero(part.pushed[begin:end])
        if len(pushed):
            row = begin + int(pushed[-1])
            run.pushed, run.pushed_m_s = part.first + row, float(part.velocity_m_s[row, 2])


def _approach_m_s(case: DropCase, before: Motion) -> float:
    """Return the downward speed at the contact that follows a sample [m/s].

    Restitution acts on the velocity that the next step would lead to without a contact.
    """
    if isinstance(case.law, BulletLaw):
        return -bullet_contact.free_velocity(case.law, before.velocity_m_s[0])
    return -float(case.law.free_velocities(before.velocity_m_s)[0, 2])
