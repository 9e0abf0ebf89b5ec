"""Readings of a simulation by its script: place, function, subject, number and time.

They include the first and the last, the least and the greatest answer of a line; other values can
be computed from states and contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics.trace.acts import Act, act_of


@dataclass(frozen=True)
class Subject:
    """The subject of a reading: a body, a link of it, or its contact with others."""

    body: int
    """Number in the recording."""
    link: int | None
    """-1 is the base; None where the reading names no link."""
    other: int | None = None
    """Number of the other body, if pairs are read."""
    other_link: int | None = None
    """Link of the other body."""


POINTS, FIRST_FORCE, FORCE, DISTANCE = "points", "force of the first", "force of all", "distance"
"""Names of the numbers of contact points: how many, normal forces [N], least distance [m]."""
REACTION, TORQUE = "reaction", "torque"
"""Beginning of the names of what a joint's sensor reads, and what a motor gives [N] or [N m]."""
EFFORT = "effort"
"""Beginning of the names of the efforts that inverse dynamics gives, a rate each [N] or [N m]."""


@dataclass(frozen=True)
class Answer:
    """A number in the answers of a line's counted readings."""

    name: str
    """Name: `points`, `force of all`, `reaction fx`, `x` …; its place in the answer where it has no
    name."""
    first: float
    """First reading."""
    last: float
    """Last reading."""
    least: float
    """The least that any gave."""
    greatest: float
    """The greatest."""


@dataclass(frozen=True)
class Lens:
    """The matrices of a camera, column by column, 16 numbers each; empty if none was given."""

    size_px: tuple[int, ...]
    """Width and height."""
    view: tuple[float, ...]
    """World to camera."""
    projection: tuple[float, ...]
    """Camera to picture."""

    @property
    def near_far_m(self) -> tuple[float, float] | None:
        """Distances between which things are drawn [m]; None for other kinds of projections.

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
    """A line of the script that reads, with arguments of one form."""

    number: int
    """Number in the recording, in the order of the first readings."""
    client: int
    """The simulation that it reads."""
    function: str
    """The function that it calls."""
    file: str
    """File of the call, without folders of this machine."""
    line: int
    """Line number, from 1."""
    arguments: tuple[str, ...]
    """The arguments that are given, except the client."""
    flags: dict[str, int | None]
    """Values of the arguments that change what is read; None if it is not a whole number."""
    first_step: int
    """Number of steps of the simulation before the first reading."""
    last_step: int
    """Number of steps before the last reading that was observed."""
    count: int
    """Number of readings; an estimate unless it is `exact`."""
    exact: bool
    """Whether every reading was observed: after 256 steps it may be those of every 61st step."""
    targets: tuple[Subject, ...]
    """Subjects of the reading, each once; empty if it reads all bodies, or none."""
    constraints: tuple[int, ...]
    """The constraints that it read, by the engine's id."""
    complete: bool
    """Whether `targets` is complete; at most 1024 are kept."""
    camera: Lens | None = None
    """The camera of its first picture."""
    answers: tuple[Answer, ...] = ()
    """Answers, a number each; for several bodies or links those of all."""

    @property
    def act(self) -> Act:
        """The meaning of its function."""
        return act_of(self.function)
