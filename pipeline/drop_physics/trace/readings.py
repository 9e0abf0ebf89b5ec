"""The values that a script read from its simulation: line, function, subject, how often and when.

For each line, the first, last, least and greatest value are recorded; other values can be computed
from states and contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics.trace.acts import Act, act_of


@dataclass(frozen=True)
class Subject:
    """Subject of a reading: a body, a link, or a contact between two bodies."""

    body: int
    """Body id in the recording."""
    link: int | None
    """Link index; -1 is the base; None if the reading names no link."""
    other: int | None = None
    """Id of the other body, if the reading is about a pair."""
    other_link: int | None = None
    """Link of the other body."""


POINTS, FIRST_FORCE, FORCE, DISTANCE = "points", "force of the first", "force of all", "distance"
"""Names of contact quantities: number of points, normal forces [N], smallest distance [m]."""
REACTION, TORQUE = "reaction", "torque"
"""Name prefixes for the readings of a joint's force-torque sensor, and for the motor torque [N] or
[N m]."""
FRACTION = "fraction"
"""Name of the share of a ray at which it meets a body."""
EFFORT = "effort"
"""Name prefix for the efforts that inverse dynamics returns, one per degree of freedom [N] or [N
m]."""


@dataclass(frozen=True)
class Answer:
    """One number that a script line reads: first, last, least and greatest value."""

    name: str
    """Name of the number: `points`, `force of all`, `reaction fx`, `x` …; for a number without a
    name, the index in the return value."""
    first: float
    """Value in the first reading."""
    last: float
    """Value in the last reading."""
    least: float
    """Smallest value."""
    greatest: float
    """Largest value."""


@dataclass(frozen=True)
class Lens:
    """A camera's matrices in column order, 16 numbers each; empty if none was given."""

    size_px: tuple[int, ...]
    """Width and height."""
    view: tuple[float, ...]
    """View matrix: world to camera."""
    projection: tuple[float, ...]
    """Projection matrix: camera to image."""

    @property
    def near_far_m(self) -> tuple[float, float] | None:
        """Near and far clipping distances [m]; None for other kinds of projection.

        The distances n and f follow from the third row of OpenGL's matrix, which contains -(f +
        n)/(f - n) and -2 f n/(f - n) for a perspective, -2/(f - n) and -(f + n)/(f - n) for a
        parallel projection.
        """
        if len(self.projection) != 16:
            return None
        z, is_perspective, shift = (
            self.projection[10],
            self.projection[11] != 0,
            self.projection[14],
        )
        try:
            if is_perspective:
                return shift / (z - 1), shift / (z + 1)
            return (shift + 1) / z, (shift - 1) / z
        except ZeroDivisionError:
            return None


@dataclass(frozen=True)
class Reading:
    """A script line that reads the simulation, with arguments of one structure."""

    number: int
    """Index in the recording, in the order of the first readings."""
    client: int
    """Id of the simulation that the line reads."""
    function: str
    """The engine function that the line calls."""
    file: str
    """File of the call, without this machine's folders."""
    line: int
    """Line number, from 1."""
    arguments: tuple[str, ...]
    """Names of the given arguments, except the client."""
    flags: dict[str, int | None]
    """Values of arguments that change which values are read; None for one that is not an integer.
    """
    first_step: int
    """Number of the simulation's steps before the first reading."""
    last_step: int
    """Number of steps before the last observed reading."""
    count: int
    """Number of readings; an estimate unless `exact`."""
    exact: bool
    """Whether every reading was observed; after 256 steps, frequent ones may be sampled in every
    61st step."""
    targets: tuple[Subject, ...]
    """Distinct subjects of the readings; empty if the line reads all bodies, or none."""
    constraints: tuple[int, ...]
    """The constraints that the line reads, by the engine's id."""
    complete: bool
    """Whether `targets` lists all subjects; at most 1024 are kept."""
    camera: Lens | None = None
    """The camera of the line's first image."""
    answers: tuple[Answer, ...] = ()
    """Summary of the return values, one entry for each number, over all bodies and links that the
    line reads."""

    @property
    def act(self) -> Act:
        """The act of the line's function."""
        return act_of(self.function)
