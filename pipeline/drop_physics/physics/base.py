"""The interface of a free-flight integration rule: how an engine steps one rigid body."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from decimal import Context, Decimal, localcontext
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Vector
from drop_physics.physics.rowed import Rowed

EXACT_MACHINES = ("x86_64", "AMD64")
"""Machines on which each floating-point operation is rounded once."""
FUSED = 1e-12
"""Relative difference that is allowed on other machines, whose compilers may fuse a multiplication
and an addition."""


ROUNDING = 2.0**-52
"""Relative rounding unit of the engines' numbers."""
ORIENTED = 18 * ROUNDING
"""Allowed deviation of an orientation's components after a step: the orientation is read back
through a matrix, and numpy's sin and cos differ from the engine's. Measured: 3 rounding units."""


class Drag(NamedTuple):
    """The drag in v' = g - a v - b |v| v, in continuous time."""

    linear_per_s: float
    """The coefficient a; infinite if the drag stops a body at once."""
    quadratic_per_m: float
    """The coefficient b."""


@dataclass(frozen=True)
class Motion(Rowed):
    """The motion of one rigid part, one row per sample; vectors in world axes, (samples, 3)."""

    position_m: Float64
    """Position of the centre of mass."""
    orientation: Float64
    """Rotation from body axes to world axes: unit quaternions x, y, z, w, shape (samples, 4)."""
    velocity_m_s: Float64
    spin_rad_s: Float64

    def at(self, samples: slice | NDArray[np.intp]) -> Motion:
        """Return the selected samples."""
        return Motion(*(getattr(self, field.name)[samples] for field in fields(Motion)))

    def before(self) -> Motion:
        """Return the previous sample of each sample; for the first sample, the sample itself."""
        return self.at(np.maximum(np.arange(len(self)) - 1, 0))


class ExactPath(NamedTuple):
    """Positions as sums of two doubles [m], shape (n, 3): the nearest double, and the rest."""

    nearest_m: Float64
    left_out_m: Float64

    def difference(self, reference_m: Float64) -> Float64:
        """Return reference - exact [m], accurate to the last bit; same shape as `reference_m`.

        Doubles close to each other have an exact difference (Sterbenz), so only the second
        subtraction rounds.
        """
        return (reference_m - self.nearest_m) - self.left_out_m


def exactly(path: Iterator[Sequence[Decimal]], samples: int, start_m: Vector) -> ExactPath:
    """Return the next positions on a path (`Law.exact_path`), computed with 40 digits.

    A vertical path has no x and y, which remain those of the start.
    """
    nearest = np.tile(np.array(start_m, np.float64), (samples, 1))
    left_out = np.zeros((samples, 3))
    with localcontext(Context(prec=40)):
        for row, position in enumerate(itertools.islice(path, samples)):
            for axis, exact in enumerate(position, 3 - len(position)):
                nearest[row, axis] = near = float(exact)
                left_out[row, axis] = float(exact - Decimal(near))
    return ExactPath(nearest, left_out)


@dataclass(frozen=True, kw_only=True)
class FreeBody:
    """A rigid body and the engine-independent settings that its step depends on."""

    timestep_s: float
    """Time between two samples [s]."""
    substeps: int = 1
    """Number of engine steps per timestep."""
    gravity_m_s2: Vector
    """Gravity in world axes."""
    mass_kg: float
    inertia_kg_m2: Vector
    """Principal moments of inertia, about the body's axes."""

    @property
    def step_s(self) -> float:
        """Timestep of the integrator [s]."""
        return self.timestep_s / self.substeps


class Law(FreeBody, ABC):
    """An engine's integration rule for one rigid body in the air; arrays have one row per sample.

    The default methods are for an engine without a velocity limit.
    """

    @property
    @abstractmethod
    def drag(self) -> Drag:
        """The damping in continuous time."""

    @property
    def semi_implicit(self) -> bool:
        """True if the body moves with the velocity at the end of the step (semi-implicit Euler).

        Otherwise it moves with the mean of the velocities before and after the step, which is exact
        if only gravity acts.
        """
        return True

    @property
    @abstractmethod
    def moves_exactly(self) -> bool:
        """True if `moved` reproduces the engine's positions to the last bit."""

    def released(self, start: Motion) -> Motion:
        """Return a release state as the engine stores it, with the engine's rounding."""
        return start

    @abstractmethod
    def step(self, before: Motion) -> Motion:
        """Advance each sample by one timestep."""

    @abstractmethod
    def turned_by(self, angular_impulse_n_m_s: Float64, before: Motion) -> Float64:
        """Return the change of spin due to angular impulses [rad/s], in body axes, (n, 3).

        In steps from the samples `before`.
        """

    def unlimited(self, before: Motion) -> Motion:
        """Advance each sample by one timestep, without the engine's velocity limit."""
        return self.step(before)

    @abstractmethod
    def moved(self, before: Motion, velocity_m_s: Float64, spin_rad_s: Float64) -> Motion:
        """Move each sample by one integrator step with the given velocities."""

    @abstractmethod
    def bits(self, before: Motion) -> Flags:
        """Flag the samples from which `step` gives the engine's velocities bit for bit, (n,)."""

    @abstractmethod
    def terms(self, before: Motion) -> tuple[Float64, Float64]:
        """Return the magnitude of the summands of velocity and spin in a timestep, shape (n,).

        Units are [m/s] and [rad/s]. Summands that cancel are included, since their rounding does
        not cancel.
        """

    def limited(self, before: Motion) -> Flags:
        """Flag the timesteps in which the engine clamped a velocity, shape (n,)."""
        return np.zeros(len(before), np.bool_)

    @abstractmethod
    def free_velocities(self, velocity_m_s: Float64) -> Float64:
        """Return velocities after a step of the integrator [m/s], before `held`, shape (n, 3).

        Operations are in textbook order, so the result may differ from the engine's in the last
        bits.
        """

    def held(self, velocity_m_s: Float64) -> Float64:
        """Return velocities clamped to the engine's limit [m/s], shape (n, 3)."""
        return velocity_m_s

    @abstractmethod
    def exact_path(
        self, position_m: Vector, velocity_m_s: Vector, *, first: int = 0
    ) -> Iterator[Sequence[Decimal]]:
        """Yield the positions of a flight, starting at sample `first`, for `exactly`.

        For a vertical flight, only z.
        """
