"""Interface of a running simulation, from which expectations read quantities."""

from __future__ import annotations

import difflib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

Element = TypeVar("Element")

NUMBERS = 9
"""Number of coordinates of the three points that represent a body in `Observed.positions`."""
NEAREST = 5
"""Number of known names that are suggested for an unknown one."""


class UnknownNameError(Exception):
    """Raised for an unknown body or joint; names the most similar ones."""

    def __init__(self, name: str, known: Iterable[object]) -> None:
        super().__init__(name)
        self.name = name
        self.nearest = nearest(name, known)


MANY = 2
LONGEST = 40
"""Largest number of characters of a body's name in its label."""
LABEL = re.compile(r"\d+_(.+)")
"""Pattern of a body's label in reports: its number, and its name."""


def label_name(name: str) -> str:
    """Return a body's name as a part of its label, and so of an entity's path."""
    return re.sub(r"[^\w-]+", "_", name, flags=re.ASCII)[:LONGEST].strip("_") or "body"


def found(name: str, known: Mapping[str, Element]) -> Element:
    """Return the element of a name, or of a label whose number is not the engine's own id.

    Such a label needs a name that no other body has.

    Raises
    ------
    UnknownNameError
        If no element has the name.
    """
    label = LABEL.fullmatch(name)
    if name not in known and label is not None:
        alike = [each for each in map(LABEL.fullmatch, known) if each and each[1] == label[1]]
        name = label[1] if label[1] in known and len(alike) < MANY else name
    if name not in known:
        raise UnknownNameError(name, known)
    return known[name]


def nearest(name: str, known: Iterable[object]) -> list[str]:
    """Return the known names that are most similar to an unknown one."""
    named = sorted({str(each) for each in known})
    return difflib.get_close_matches(name, named, NEAREST, cutoff=0.0)


class Observed(ABC):
    """A running simulation, from which expectations read times, positions and forces."""

    @property
    def simulation(self) -> object:
        """The engine's id of the simulation."""
        return id(self)

    @property
    @abstractmethod
    def time_s(self) -> float:
        """The simulated time [s]."""

    @abstractmethod
    def reader(self, kind: str, *names: Any) -> Callable[[], Any]:
        """Return a function that reads a quantity's current value, a number or a vector.

        Parameters
        ----------
        kind
            `x`, `y`, `z`: the position of a body [m]; `up`: the upward component of the body's z
            axis; `joint`, `rate`: the position and the velocity of a joint [rad, m; rad/s, m/s];
            `force`: the contact force between two bodies, or between one and all others [N];
            `sensor`: a sensor of the model.
        names
            Names of the bodies, joint or sensor; a body may be given by the engine's id.

        Raises
        ------
        UnknownNameError
            If no element of this name exists yet.
        """

    @abstractmethod
    def positions(self) -> list[float]:
        """Return positions of three points on each body, which also show its rotation [m].

        The points are the body's centre of mass, and two points at the radius of gyration along its
        axes, so that they move even if the body only rotates.
        """

    @abstractmethod
    def bodies(self) -> list[str]:
        """Return the names of the bodies, in the order of `positions`."""

    @abstractmethod
    def astray(self) -> dict[str, float]:
        """Return how far joints are from their targets, by the name of the motor command.

        The distance is one of positions [rad, m] or of velocities [rad/s, m/s].
        """

    @abstractmethod
    def is_finite(self) -> bool:
        """Return whether the state is finite and the engine has not reset it."""
