"""What a script read of its simulation: where, by which function, of what, how often and when.

No values: states and contacts give them back.
"""

from __future__ import annotations

from dataclasses import dataclass

from drop_physics.trace.acts import Act, act_of


@dataclass(frozen=True)
class Subject:
    """A body that is read, or a link of it, or what is between these and others."""

    body: int
    """Its number in the recording."""
    link: int | None
    """-1 is the base; None where the reading names no link."""
    other: int | None = None
    """The number of the other body, where pairs are read."""
    other_link: int | None = None
    """The link of that one."""


@dataclass(frozen=True)
class Lens:
    """What a camera sees, as it was given: column by column, 16 numbers; empty if it was not."""

    size_px: tuple[int, ...]
    """Width and height."""
    view: tuple[float, ...]
    """World to camera."""
    projection: tuple[float, ...]
    """Camera to picture."""

    @property
    def near_far_m(self) -> tuple[float, float] | None:
        """Distances between which something is drawn [m]; None without a projection of those.

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
    """A place that reads, with arguments of one form."""

    number: int
    """Its number in the recording, in the order in which places first read."""
    client: int
    """Whose simulation it reads."""
    function: str
    """What it reads with."""
    file: str
    """File of the call, without folders of this machine."""
    line: int
    """Counted from 1."""
    arguments: tuple[str, ...]
    """Those that are given, but for the client."""
    flags: dict[str, int | None]
    """Values of those that change what is read; None of what is no whole number."""
    first_step: int
    """Steps of the simulation before the first reading."""
    last_step: int
    """Before the last that was looked at."""
    count: int
    """How often it read; an estimate unless it is `exact`."""
    exact: bool
    """Whether each reading was looked at: after 256 steps it may be those of every 61st."""
    targets: tuple[Subject, ...]
    """What it read, each once; none where it reads all bodies, or none."""
    constraints: tuple[int, ...]
    """The constraints that it read, by the engine's id."""
    complete: bool
    """Whether `targets` are all; at most 1024 are kept."""
    camera: Lens | None = None
    """The lens of the first picture that it took."""

    @property
    def act(self) -> Act:
        """What it reads."""
        return act_of(self.function)
