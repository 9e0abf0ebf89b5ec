"""One number, text or flag that two recordings of scripts do not share, and where it stands."""

from __future__ import annotations

from dataclasses import dataclass

Value = float | str | None


@dataclass(frozen=True)
class Difference:
    """What stands in one recording and not, or otherwise, in the golden one."""

    step: int
    """Steps made before it, by its simulation."""
    body: str | None
    """Label of the body; None of what belongs to no body."""
    link: int | None
    """Of the body, -1 is its base; None of what belongs to no link."""
    column: str
    """A column of the state, or of joints, as `joint_torque`, or of a contact point, as
    `contact_distance_m`; `contact_points` is how many there are. `dynamics.mass_kg` stands in that
    entity of the recording; an element of a vector has its number behind it, from 0. `rows`, as in
    `pushes.rows`, is how many were told by then; `there` is whether the body or its sample is, and
    `frame` an image."""
    value: Value = None
    """What stands in the recording that was checked; None where there is nothing."""
    golden: Value = None
    """In the golden one."""

    @property
    def difference(self) -> float | None:
        """By how much it is more than golden; None where it is not one of numbers."""
        if isinstance(self.value, str | None) or isinstance(self.golden, str | None):
            return None
        return self.value - self.golden


@dataclass(frozen=True, order=True)
class When:
    """The order in which what differs came to be."""

    step: int
    phase: int
    """A sample that a step led to comes before what the script does after it: `LED`, `TOLD`; a
    first sample after what was done for it: `FIRST`; last where calls had put bodies: `PUT`."""
    call: int = 0
    """Calls of the script before it."""


LED, TOLD, FIRST, PUT = range(4)

Found = tuple[When, Difference]
