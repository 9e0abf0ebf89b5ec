"""The known facts of a tree's steps, and the interface of an engine's law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from drop_physics.arrays import Float64
from drop_physics.physics.base import Law
from drop_physics.physics.impulses import Forces, Summed
from drop_physics.physics.tree import States, Tree


@dataclass(frozen=True, eq=False, kw_only=True)
class DampedTree:
    """A tree with damping and limits."""

    tree: Tree
    joint_damping: Float64
    """[N s/m or N m s/rad] of each joint's rate, shape (joint_rates,)."""
    lower: Float64
    """Limits of each joint's position, shape (joint_rates,); none where lower > upper."""
    upper: Float64
    linear_damping: float
    """Coefficients of the law's own damping of links."""
    angular_damping: float
    velocity_limit: float
    """Limit of each entry of u."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Reported:
    """Everything known of n steps besides the states; rows of Forces carry their step's index."""

    timestep_s: Float64
    """Shape (n,)."""
    gravity_m_s2: Float64
    """World axes, shape (n, 3)."""
    motors: Float64
    """Efforts of the joints' motors [N or N m], shape (n, joint_rates)."""
    commanded: Float64
    """Sum of the efforts that calls gave for one step, shape (n, joint_rates)."""
    pd: Float64
    """Efforts of servos that act before the solver, shape (n, joint_rates)."""
    applied: Forces = field(default_factory=Forces)
    """Forces and torques that calls applied."""
    contacts: Forces = field(default_factory=Forces)
    """Forces of contact points."""
    constraints: Forces = field(default_factory=Forces)
    """Forces of constraints."""
    geared: Float64 | None = None
    """Impulses of gears [N m s], shape (n, joint_rates); None without gears."""
    damped: Float64 | None = None
    """Rates that joint damping acts on, shape (n, joint_rates); None for those before each step."""

    def at(self, rows: slice) -> Reported:
        """Return consecutive steps."""
        numbers: dict[str, Any] = {
            each.name: value.between(rows.start, rows.stop)
            if isinstance(value, Forces)
            else value[rows]
            for each in fields(self)
            if (value := getattr(self, each.name)) is not None
        }
        return Reported(**numbers)


Reason = Literal[
    "engine",
    "substeps",
    "asleep",
    "soft",
    "maximal",
    "massless",
    "planar",
    "constraint",
    "rolling unreported",
]
"""Reason why a law has no sum for a step, or need not have one."""


@dataclass(frozen=True, kw_only=True)
class StepConditions:
    """Facts of engine and body that decide whether a step can be written as a sum."""

    other_engine: bool = False
    """Whether another engine steps the body, by a law of its own."""
    substeps: int = 0
    """Number of substeps per step; 0 means 1, too."""
    may_sleep: bool = False
    """Whether the engine may put the body to sleep."""
    maximal: bool = False
    """Whether the engine uses maximal coordinates for it."""
    planar: bool = False
    """Whether it has a planar joint."""


@dataclass(frozen=True, kw_only=True)
class StepLaw:
    """The law of an engine that does not itself report all causes of its steps."""

    damping: float
    """Default of linear and angular damping."""
    velocity_limit: float
    """Default limit of each entry of u."""
    least_timestep_s: float
    """Smallest timestep that the engine takes."""
    most_turn_rad: float
    """Largest rotation of a link in a step."""
    not_covered: Callable[[StepConditions, Tree | None], tuple[Reason, ...]]
    """Returns why a body's steps need not be the sum."""
    sum_of: Callable[
        [DampedTree, States, Reported, int, Callable[[States], Float64]], tuple[Summed, Float64]
    ]
    """Returns n steps of so many substeps as sums, from the n + 1 states before and after them, and
    the efforts of servos in the last substep; the last argument returns these in some states."""
    flight: Callable[..., Law | None]
    """Returns the law of a body without links where nothing touches it, if there is one."""
    constraint_forces: Callable[..., Forces]
    """Returns what a constraint does to one of its two bodies, from what the engine reports."""
    gear_impulses: Callable[..., Float64]
    """Returns the impulses of a gear on one of its two joints, likewise."""
