"""A number, text or flag that differs between two recordings of scripts, and where it is."""

from __future__ import annotations

from dataclasses import dataclass

Value = float | str | None


@dataclass(frozen=True)
class Difference:
    """A value that the golden recording lacks, or has otherwise."""

    step: int
    """Steps made before it, by its simulation."""
    body: str | None
    """Label of the body; None if it belongs to no body."""
    link: int | None
    """Of the body, -1 is its base; None if it belongs to no link."""
    column: str
    """A column of the state, or of joints, as `joint_torque`, or of a contact point, as
    `contact_distance_m`; `contact_points` is how many there are. `dynamics.mass_kg` is in that
    entity of the recording; an element of a vector has its number after it, from 0. `rows`, as in
    `pushes.rows`, is how many were recorded by then; `there` is whether the body or its sample
    exists, and `frame` is an image."""
    value: Value = None
    """The value in the checked recording; None where there is none."""
    golden: Value = None
    """The value in the golden recording."""

    @property
    def difference(self) -> float | None:
        """Value minus golden; None if they are not numbers."""
        if isinstance(self.value, str | None) or isinstance(self.golden, str | None):
            return None
        return self.value - self.golden


@dataclass(frozen=True, order=True)
class When:
    """When a difference arose, in an order."""

    step: int
    phase: int
    """`LED`: a sample that a step led to, before `INPUT`: the inputs that the script gives then.
    `FIRST`: a first sample, after the inputs that led to it. `PUT`: where calls put a body."""
    call: int = 0
    """Calls of the script before it."""


LED, INPUT, FIRST, PUT = range(4)

Dated = tuple[When, Difference]
