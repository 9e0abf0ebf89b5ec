"""What a script read from its simulation: line, function, subject, how often and when.

They include the first and the last, the least and the greatest answer of a line; other values can
be computed from states and contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics.trace.acts import Act, act_of


@dataclass(frozen=True)
class Subject:
    """What a reading is about: a body, a link, or a contact between two."""

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
EFFORT = "effort"
"""Name prefix for the efforts that inverse dynamics returns, one per degree of freedom [N] or [N
m]."""


@dataclass(frozen=True)
class Answer:
    """One number that a script line reads: first, last, least and greatest value."""

    name: str
    """Name: `points`, `force of all`, `reaction fx`, `x` …; its index in the return value if it has
    no name."""
    first: float
    """Its value in the first reading."""
    last: float
    """Its value in the last reading."""
    least: float
    """Its smallest value."""
    greatest: float
    """Its largest value."""


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

        From the third row of OpenGL's matrices: of a perspective z = -(f + n)/(f - n) and
        -2 f n/(f - n), of a parallel projection -2/(f - n) and -(f + n)/(f - n).
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
    """Id of the simulation that it reads."""
    function: str
    """The function that it calls."""
    file: str
    """File of the call, without this machine's folders."""
    line: int
    """Line number, from 1."""
    arguments: tuple[str, ...]
    """Names of the given arguments, except the client."""
    flags: dict[str, int | None]
    """Values of the arguments that change what is read; None for one that is not an integer."""
    first_step: int
    """Number of the simulation's steps before the first reading."""
    last_step: int
    """Number of steps before the last observed reading."""
    count: int
    """Number of readings; an estimate unless it is `exact`."""
    exact: bool
    """Whether every reading was observed; after 256 steps, frequent ones may be sampled in every
    61st step."""
    targets: tuple[Subject, ...]
    """Subjects of the readings, each once; empty if it reads all bodies, or none."""
    constraints: tuple[int, ...]
    """The constraints that it reads, by the engine's id."""
    complete: bool
    """Whether `targets` lists all subjects; at most 1024 are kept."""
    camera: Lens | None = None
    """The camera of its first image."""
    answers: tuple[Answer, ...] = ()
    """Return values, one entry for each number; for several bodies or links those of all."""

    @property
    def act(self) -> Act:
        """What its function does."""
        return act_of(self.function)
