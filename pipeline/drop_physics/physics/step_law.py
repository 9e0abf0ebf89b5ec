"""Inputs of a step of a kinematic tree, and the interface of an engine's integration rule."""

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
    """A kinematic tree with joint damping and limits."""

    tree: Tree
    joint_damping: Float64
    """Damping of each joint rate, shape (joint_rates,) [N s/m or N m s/rad]."""
    lower: Float64
    """Lower limit of each joint's position, shape (joint_rates,); there are no limits if lower >
    upper."""
    upper: Float64
    linear_damping: float
    """Coefficients of the engine's own damping of links."""
    angular_damping: float
    velocity_limit: float
    """Maximum of each entry of u."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Reported:
    """Forces and settings that an engine reports for n steps, in addition to the states."""

    timestep_s: Float64
    """Timestep of each step, shape (n,)."""
    gravity_m_s2: Float64
    """Gravity in world axes, shape (n, 3)."""
    motors: Float64
    """Efforts of the joints' motors [N or N m], shape (n, joint_rates)."""
    commanded: Float64
    """Sum of the efforts that calls applied for one step, shape (n, joint_rates)."""
    pd: Float64
    """Efforts of servos that are evaluated before the solver, shape (n, joint_rates)."""
    applied: Forces = field(default_factory=Forces)
    """Forces and torques that calls applied."""
    contacts: Forces = field(default_factory=Forces)
    """Forces at contact points."""
    constraints: Forces = field(default_factory=Forces)
    """Forces of constraints."""
    geared: Float64 | None = None
    """Impulses of gears [N m s], shape (n, joint_rates); None if there are no gears."""
    damped: Float64 | None = None
    """Joint rates from which joint damping is computed, shape (n, joint_rates); None for the rates
    before each step."""

    def at(self, rows: slice) -> Reported:
        """Return a slice of consecutive steps."""
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
"""Reason why a law has no sum for a step, or why the sum may be wrong."""


@dataclass(frozen=True, kw_only=True)
class StepConditions:
    """Engine and body settings that determine whether a step can be written as a sum."""

    other_engine: bool = False
    """Whether another engine, with its own law, steps the body."""
    substeps: int = 0
    """Number of substeps per step; 0 also means 1."""
    may_sleep: bool = False
    """Whether the engine is allowed to put the body to sleep."""
    maximal: bool = False
    """Whether the engine represents the body in maximal coordinates."""
    planar: bool = False
    """Whether the body has a planar joint."""


@dataclass(frozen=True, kw_only=True)
class StepLaw:
    """The integration rule of an engine that does not itself report every impulse of its steps."""

    damping: float
    """Default linear and angular damping."""
    velocity_limit: float
    """Default maximum of each entry of u."""
    least_timestep_s: float
    """Smallest timestep that the engine accepts."""
    most_turn_rad: float
    """Maximum rotation of a link in a step."""
    not_covered: Callable[[StepConditions, Tree | None], tuple[Reason, ...]]
    """Function that returns the reasons why a body's steps may not equal the sum."""
    sum_of: Callable[
        [DampedTree, States, Reported, int, Callable[[States], Float64]], tuple[Summed, Float64]
    ]
    """Function that returns n steps of the given number of substeps as sums, from the n + 1 states
    around them, and the efforts of servos in the last substep. Its last argument is a function that
    returns these efforts in given states."""
    flight: Callable[..., Law | None]
    """Function that returns the law of a body without links in free flight, or None."""
    constraint_forces: Callable[..., Forces]
    """Function that returns the forces of a constraint on one of its two bodies, from the engine's
    report."""
    gear_impulses: Callable[..., Float64]
    """Function that returns the impulses of a gear on one of its two joints, from the engine's
    report."""
