"""Calls of a script to its engine, with the forces and properties that they set.

A recording stores a call as a call site and numbers. This module, `log` and `motors` interpret them
by the names of PyBullet's functions and arguments; those of another engine would be added here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from drop_physics.trace.acts import Act
from drop_physics.trace.events import At, Body, Site

TIMESTEPS = {Act.SET_TIMESTEP: "timeStep", Act.SET_ENGINE: "fixedTimeStep"}
"""The argument that sets the timestep, by act."""
WORLD_FRAME = 2
"""The flag of `applyExternalForce` for vectors in world axes."""
BODY_NAMES = ("bodyUniqueId", "objectUniqueId", "bodyIndex")
MOST_WHOLE = 2**53
"""Largest magnitude up to which every integer is exact as a double."""
WORDS = re.compile(r"(?:^|, )(\w+)=(True|False)(?=, |$)")
"""`True` and `False` as they appear in argument text; the engine takes them as numbers."""


@dataclass(frozen=True)
class Call:
    """An engine call made by the script."""

    at: At
    """Time of the call."""
    client: int
    """Id of the client on which the call was made."""
    site: Site
    numbers: tuple[float, ...]
    """All numbers in the call's arguments, in order."""
    result: float = math.nan
    """The returned number; nan if the call returned none."""
    raised: str = ""
    """The exception that the call raised; empty if it raised none."""

    @property
    def function(self) -> str:
        """Name of the called function."""
        return self.site.function

    @property
    def act(self) -> Act:
        """The act of the call."""
        return self.site.act

    @property
    def timestep_s(self) -> float | None:
        """The timestep that the call sets [s]; None if it does not set it."""
        numbers = self.values.get(TIMESTEPS.get(self.act, ""), ())
        return numbers[0] if numbers else None

    @property
    def file(self) -> str:
        """File of the call."""
        return self.site.file

    @property
    def line(self) -> int:
        """Line of the call, from 1."""
        return self.site.line

    @property
    def arguments(self) -> str:
        """The arguments as source text; long ones are shortened."""
        return text_of(self.site, self.numbers)

    @cached_property
    def values(self) -> dict[str, tuple[float, ...]]:
        """The numeric values of each argument; the literals True and False count as 1 and 0."""
        words = {name: (float(word == "True"),) for name, word in WORDS.findall(self.site.form)}
        return words | {name: self.numbers[place] for name, place in self.site.places.items()}


@dataclass(frozen=True)
class Push:
    """An external force or torque that acts for one step."""

    at: At
    body: Body
    link: int
    torque: bool
    vector: tuple[float, ...]
    """Force [N] or torque [N m]."""
    position_m: tuple[float, ...]
    """Point at which the force acts; nan for a torque."""
    in_world_axes: bool


@dataclass(frozen=True)
class Given:
    """Properties of a body that a call set; the engine never reports some of them."""

    at: At
    body: Body
    link: int
    """The link that the call affected, which may differ from the link that it names; -1 is the
    base."""
    values: Mapping[str, float | Sequence[float]]


def text_of(site: Site, numbers: Sequence[float]) -> str:
    """Return the arguments of a call as source text."""
    texts = [
        repr(int(number))
        if whole and abs(number) <= MOST_WHOLE and number.is_integer()
        else repr(number)
        for number, whole in zip(numbers, site.whole, strict=True)
    ]
    return site.form.format(*texts)
