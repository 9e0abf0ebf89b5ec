"""A body as a tree of rigid links; a single body is a tree without joints.

A link's axes are its principal axes of inertia, and its origin is its centre of mass. Links are
numbered from 0, each after its parent; the base is `BASE`. If several joints connect two links in a
row, the links between them have no mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Literal, get_args

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.physics.rowed import Rowed

Joint = Literal["fixed", "revolute", "prismatic", "spherical"]

BASE = -1
"""The index of the base among the links."""
RATES: dict[Joint, int] = {"fixed": 0, "revolute": 1, "prismatic": 1, "spherical": 3}
"""Degrees of freedom by kind of joint; a spherical joint rotates about the link's axes."""
COORDINATES: dict[Joint, int] = RATES | {"spherical": 4}
"""Number of position coordinates by kind of joint: an angle, a distance, or a unit quaternion x, y,
z, w."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tree:
    """Links and the joints that connect them; row k of arrays with links describes link k - 1.

    The generalised velocity u of a tree is: spin and velocity of the base's centre of mass, in
    world axes, unless the base is fixed; then the rates of the joints, in the order of the links.

    Raises
    ------
    ValueError
        If a link precedes its parent, a joint is of an unknown kind, or a shape is wrong.
    """

    fixed: bool
    """Whether the base never moves."""
    masses_kg: Float64
    """Masses of base and links, shape (links + 1,)."""
    inertias_kg_m2: Float64
    """Principal moments of inertia of base and links, shape (links + 1, 3)."""
    parents: tuple[int, ...] = ()
    """Index of the parent of each link."""
    joints: tuple[Joint, ...] = ()
    """Kind of each link's joint."""
    axes: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    """Axis along or about which a joint moves, in the link's axes, shape (links, 3).

    The length of an axis that is not a unit vector scales the displacement of a sliding link, and
    the angular velocity of a rotating link per unit of the joint's rate, but not its angle, as in
    Bullet (`btMultiBodyLink`, `m_axes`).
    """
    positions_m: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    """Position of the joint relative to the parent's centre of mass, in the parent's axes, shape
    (links, 3)."""
    orientations: Float64 = field(default_factory=lambda: np.empty((0, 4)))
    """Rotation from the link's axes to the parent's, with the joint at 0: quaternions x,
    y, z, w."""
    centres_m: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    """Position of the link's centre of mass relative to the joint, in the link's axes, shape
    (links, 3)."""
    armature: Float64 | None = None
    """Additional inertia of the rates of base and links, as of rotors behind gears, shape (links +
    1,) [kg or kg m²]; None without any."""
    coupled: Float64 | None = None
    """Inertias coupled to several rates, such as a tendon's. A row is an inertia, followed by its
    speed per unit of each rate, shape (k, 1 + size); None without any."""

    def __post_init__(self) -> None:
        links = len(self.parents)
        widths = {"axes": 3, "positions_m": 3, "orientations": 4, "centres_m": 3}
        shapes: dict[str, tuple[int, ...]] = {name: (links, k) for name, k in widths.items()}
        shapes |= {"masses_kg": (links + 1,), "inertias_kg_m2": (links + 1, 3)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} of {links} links has the shape {shape}")
        if any(not BASE <= parent < link for link, parent in enumerate(self.parents)):
            raise ValueError(f"each link follows its parent; received the parents {self.parents}")
        if len(self.joints) != links or not {*self.joints} <= {*get_args(Joint)}:
            raise ValueError(f"each link has one of the joints {get_args(Joint)}")

    @property
    def links(self) -> int:
        """The number of links besides the base."""
        return len(self.parents)

    @property
    def first_rate(self) -> int:
        """The number of degrees of freedom of the base."""
        return 0 if self.fixed else 6

    @cached_property
    def rates(self) -> tuple[slice, ...]:
        """The slice of u for the rates of each link's joint."""
        return places([RATES[joint] for joint in self.joints], self.first_rate)

    @cached_property
    def coordinates(self) -> tuple[slice, ...]:
        """The slice of the joint positions for each link's joint."""
        return places([COORDINATES[joint] for joint in self.joints])

    @property
    def size(self) -> int:
        """The number of degrees of freedom."""
        return self.rates[-1].stop if self.rates else self.first_rate

    @property
    def joint_rates(self) -> int:
        """The number of degrees of freedom of the joints."""
        return self.size - self.first_rate

    @property
    def joint_coordinates(self) -> int:
        """The number of position coordinates of the joints."""
        return self.coordinates[-1].stop if self.coordinates else 0

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """The links with mass or inertia, and the base unless it is fixed."""
        heavy = (self.masses_kg > 0) | (self.inertias_kg_m2 > 0).any(axis=1)
        return tuple(
            k for k in range(BASE, self.links) if heavy[k + 1] and (k >= 0 or not self.fixed)
        )

    def branch(self, link: int) -> tuple[int, ...]:
        """Return a link and its ancestors up to the base, from the outermost to the first."""
        found = []
        while link != BASE:
            found.append(link)
            link = self.parents[link]
        return tuple(found)


@dataclass(frozen=True, eq=False)
class States(Rowed):
    """States of a tree, one per row."""

    position_m: Float64
    """Position of the base's centre of mass, world axes, shape (n, 3)."""
    orientation: Float64
    """Rotation from the base's axes to world axes: unit quaternions x, y, z, w, shape (n, 4)."""
    joints: Float64
    """Positions of the joints, shape (n, joint_coordinates)."""
    velocity: Float64
    """The generalised velocity u, shape (n, size)."""


def places(widths: Iterable[int], first: int = 0) -> tuple[slice, ...]:
    """Return consecutive slices with the given widths."""
    return tuple(slice(a, b) for a, b in pairwise(accumulate(widths, initial=first)))
