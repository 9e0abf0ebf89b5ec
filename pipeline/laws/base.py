"""What a law of motion is: one step that an engine takes with one rigid body."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Vector = tuple[float, float, float]

EXACT_MACHINES = ("x86_64", "AMD64")
"""Those on which each operation rounds once."""
FUSED = 1e-12
"""Relative difference that a compiler may make elsewhere, where it fuses multiply and add."""


ORIENTED = 18
"""By how many units of rounding components of an orientation may be off: it is read back through a
matrix, and sin and cos are not the engine's; seen: 3."""


class Drag(NamedTuple):
    """The drag of v' = g - a v - b |v| v, in continuous time."""

    linear_per_s: float
    """a; infinite where the air is solid."""
    quadratic_per_m: float
    """b"""


@dataclass(frozen=True)
class Motion:
    """The motion of one rigid part, one row per sample; vectors in world axes, (samples, 3)."""

    position_m: Float64
    """Of its centre of mass."""
    orientation: Float64
    """World from its own axes: unit quaternions x, y, z, w, shape (samples, 4)."""
    velocity_m_s: Float64
    spin_rad_s: Float64

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.position_m)

    def at(self, samples: slice | NDArray[np.intp]) -> Motion:
        """Return some of the samples."""
        return Motion(*(getattr(self, field.name)[samples] for field in fields(Motion)))

    def before(self) -> Motion:
        """Return the sample before each; the first has itself before it."""
        return self.at(np.maximum(np.arange(len(self)) - 1, 0))


class ExactPath(NamedTuple):
    """Positions in two doubles [m], shape (n, 3): the nearest one, and what that leaves out."""

    nearest_m: Float64
    left_out_m: Float64

    def difference(self, reference_m: Float64) -> Float64:
        """Return reference - exact [m], to the last bit; the shape of `reference_m`.

        Near doubles have an exact difference (Sterbenz), so that only the second subtraction
        rounds.
        """
        return (reference_m - self.nearest_m) - self.left_out_m


class Law(Protocol):
    """The discrete law of one rigid body that nothing touches; arrays have one row per sample."""

    @property
    def timestep_s(self) -> float:
        """Time between two samples [s]."""

    @property
    def substeps(self) -> int:
        """How many steps the engine makes of each timestep."""

    @property
    def step_s(self) -> float:
        """Timestep of the integrator [s]."""

    @property
    def mass_kg(self) -> float:
        """Of the body."""

    @property
    def inertia_kg_m2(self) -> Vector:
        """Principal moments of inertia, about the body's axes."""

    @property
    def gravity_m_s2(self) -> Vector:
        """World axes."""

    @property
    def drag(self) -> Drag:
        """What the damping is in continuous time."""

    @property
    def epsilon(self) -> float:
        """Unit of rounding of the engine's numbers, relative: 2^-52 of float64."""

    @property
    def oriented(self) -> float:
        """By how much components of an orientation may be off after a step."""

    def covers(self, before: Motion) -> NDArray[np.bool_]:
        """Return of which samples the law is that of the engine, as far as it is known, (n,)."""

    @property
    def semi_implicit(self) -> bool:
        """Whether it moves the body with the velocity at the end of the step, as Euler does.

        Else along the mean of both, which is exact where gravity is all that acts.
        """

    @property
    def moves_exactly(self) -> bool:
        """Whether `moved` gives the engine's positions to the last bit."""

    def released(self, start: Motion) -> Motion:
        """Return what the engine keeps of a state that it is given."""

    def step(self, before: Motion) -> Motion:
        """Return what one timestep makes of each sample."""

    def turned_by(self, angular_impulse_n_m_s: Float64, before: Motion) -> Float64:
        """Return what angular impulses add to the spin [rad/s], both in the body's axes, (n, 3).

        In steps from these samples.
        """

    def unlimited(self, before: Motion) -> Motion:
        """Return the same as `step`, as if the engine had no limit of velocity."""

    def moved(self, before: Motion, velocity_m_s: Float64, spin_rad_s: Float64) -> Motion:
        """Return where one step of the integrator takes each sample with these velocities."""

    def bits(self, before: Motion) -> NDArray[np.bool_]:
        """Return from which samples `step` gives the engine's velocities to the last bit, (n,)."""

    def terms(self, before: Motion) -> tuple[Float64, Float64]:
        """Return the size of all that a timestep adds up to velocity and spin, shape (n,).

        [m/s] and [rad/s]; what cancels counts too, since its rounding does not.
        """

    def limited(self, before: Motion) -> NDArray[np.bool_]:
        """Return in which of these timesteps the engine held a velocity at a limit, shape (n,)."""

    def free_velocities(self, velocity_m_s: Float64) -> Float64:
        """Return what a step of the integrator makes of many velocities [m/s], before `held`."""

    def held(self, velocity_m_s: Float64) -> Float64:
        """Return velocities [m/s], shape (n, 3), within the engine's limit."""

    def spin_kept(self, spin_rad_s: Float64) -> Float64:
        """Return which part of their spin the damping leaves to samples in a step, shape (n,)."""

    def exact_path(
        self, position_m: Vector, velocity_m_s: Vector, *, steps: int, first: int = 0
    ) -> ExactPath:
        """Return the positions from sample `first` to `steps` of a flight, in exact arithmetic."""
