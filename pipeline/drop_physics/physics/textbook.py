"""The step of the engines that follow a textbook: no limit, one step per sample.

    v' = k (v + dt g)        x' = x + dt v'                  semi-implicit Euler
    v' = v + dt g            x' = x + dt (v + v')/2          exact where only gravity acts

k is the factor left by the damping d, 1 without any. Each engine has its own order of operations,
and its own law of spin.
"""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import TypeVar

import numpy as np

from drop_physics.arrays import Float64, Vector
from drop_physics.physics.base import Drag, Law, Motion
from drop_physics.physics.rotations import rotate, rotate_inverse

Number = TypeVar("Number", float, Decimal)

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class TextbookLaw(Law):
    """The step that these laws share."""

    linear_damping: float = 0.0
    """d of v' = g - d v, in continuous time [1/s]."""
    semi_implicit: bool = True
    """Whether it moves the body with the end-of-step velocity."""

    @property
    def moves_exactly(self) -> bool:
        """Whether `moved` has the engine's positions to the last bit."""
        return self.semi_implicit

    @property
    def drag(self) -> Drag:
        """The damping in continuous time; these engines have none by default."""
        return Drag(self.linear_damping, 0.0)

    def kept(self, number: Callable[[float], Number]) -> Number:
        """Return the factor by which a step's implicit damping scales a velocity: 1/(1 + dt d)."""
        return 1 / (1 + number(self.timestep_s) * number(self.linear_damping))

    @abstractmethod
    def velocities(self, before: Motion) -> tuple[Float64, Float64]:
        """Return velocity [m/s] and spin [rad/s] after a step, shape (n, 3) each."""

    @abstractmethod
    def turned(self, before: Motion, spin_rad_s: Float64) -> Float64:
        """Return the orientations after a step with these spins, shape (n, 4)."""

    def step(self, before: Motion) -> Motion:
        """Return each sample one timestep later."""
        return self.moved(before, *self.velocities(before))

    def moved(self, before: Motion, velocity_m_s: Float64, spin_rad_s: Float64) -> Motion:
        """Return each sample moved by one integrator step with these velocities."""
        mean_m_s = velocity_m_s
        if not self.semi_implicit:
            mean_m_s = (before.velocity_m_s + velocity_m_s) / 2
        position_m = before.position_m + self.timestep_s * mean_m_s
        return Motion(position_m, self.turned(before, spin_rad_s), velocity_m_s, spin_rad_s)

    def turned_by(self, angular_impulse_n_m_s: Float64, before: Motion) -> Float64:  # noqa: ARG002
        """Return the change of spin by angular impulses [rad/s], in the body's axes, (n, 3)."""
        return np.asarray(angular_impulse_n_m_s / np.array(self.inertia_kg_m2))

    def terms(self, before: Motion) -> tuple[Float64, Float64]:
        """Return the size of the summands of velocity and spin in a timestep, shape (n,).

        Forces are moved to the centre of mass from a point that is off by the rounding of x;
        v × m v is then a torque, which cancels except for rounding.
        """
        dt, inertia = self.timestep_s, self.inertia_kg_m2
        x, v, w = (
            np.linalg.norm(each, axis=1)
            for each in (before.position_m, before.velocity_m_s, before.spin_rad_s)
        )
        pull = float(np.linalg.norm(self.gravity_m_s2))
        uneven = max(inertia) / min(inertia)
        arm = self.mass_kg / min(inertia)
        linear = v + dt * (pull + v * w + x * w**2 * uneven)
        return linear, 8 * w + dt * (w**2 * uneven + arm * (v**2 + x * (pull + v * w)))

    def free_velocities(self, velocity_m_s: Float64) -> Float64:
        """Return velocities after a step [m/s], shape (n, 3)."""
        pulled = velocity_m_s + self.timestep_s * np.array(self.gravity_m_s2)
        return np.asarray(self.kept(float) * pulled)

    def exact_path(
        self, position_m: Vector, velocity_m_s: Vector, *, first: int = 0
    ) -> Iterator[Sequence[Decimal]]:
        """Yield the positions of a flight from sample `first` on, for `exactly`."""
        path = self._damped if self.linear_damping else self._undamped
        axes = zip(position_m, velocity_m_s, self.gravity_m_s2, strict=True)
        return zip(
            *(path(Decimal(x), Decimal(v), Decimal(g), first) for x, v, g in axes), strict=True
        )

    def _undamped(self, x: Decimal, v: Decimal, g: Decimal, first: int) -> Iterator[Decimal]:
        """Yield x0 + n dt v0 + dt² g n (n + 1)/2, or n² for n (n + 1) where the step is exact."""
        dt, more = Decimal(self.timestep_s), int(self.semi_implicit)
        for n in itertools.count(first):
            yield x + n * dt * v + dt * dt * g * (n * (n + more)) / 2

    def _damped(self, x: Decimal, v: Decimal, g: Decimal, first: int) -> Iterator[Decimal]:
        """Yield the same step by step."""
        dt, kept = Decimal(self.timestep_s), self.kept(Decimal)
        for n in itertools.count():
            if n >= first:
                yield x
            v = kept * (v + dt * g)
            x += dt * v


def turned_about(orientation: Float64, spin_body: Float64, timestep_s: float) -> Float64:
    """Return q exp(ω dt/2) of unit quaternions q and spins ω in the body's axes, shape (n, 4)."""
    speed = np.linalg.norm(spin_body, axis=1, keepdims=True)
    axis = np.divide(spin_body, speed, out=np.zeros_like(spin_body), where=speed > 0)
    half = timestep_s * speed / 2
    x, y, z, w = (orientation / np.linalg.norm(orientation, axis=1, keepdims=True)).T
    a, b, c = (axis * np.sin(half)).T
    d = np.cos(half)[:, 0]
    return np.stack(
        (
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ),
        axis=1,
    )


def explicit_spin(before: Motion, inertia_kg_m2: Vector, timestep_s: float) -> Float64:
    """Return the spin after a step with an explicit gyroscopic term [rad/s], world axes, (n, 3).

    ω' = ω + dt I^-1 (-ω × I ω), the forward Euler step of Euler's equation.
    """
    inertia = np.array(inertia_kg_m2)
    spin = rotate_inverse(before.orientation, before.spin_rad_s)
    change = rotate(before.orientation, -np.cross(spin, inertia * spin) / inertia)
    return before.spin_rad_s + timestep_s * change
