"""MuJoCo's step of one free body, for each integrator; no velocity limit, one step per sample.

    v' = v + dt g            x' = x + dt v'                  semi-implicit Euler
    v' = v + dt g            x' = x + dt (v + v')/2          rk4: exact where only gravity acts

A body that falls or rises vertically, without spin or rotation, follows this law to the last bit:
its acceleration is (g m)(1/m), force times the inverse of the mass, or (g m)/m with implicit
integrators. With a sideways velocity, MuJoCo adds a torque v × m v, which is 0 except for rounding
(`engine_core_smooth.c`, `mj_rne`): velocities are then within a few units of 2^-52 of the step's
summands, and positions still exact. The integrators are those of `engine_forward.c`
(`mj_EulerSkip`, `mj_implicitSkip`, `mj_RungeKutta`); `mju_quatIntegrate` rotates the body. Checked
against MuJoCo 4.0 in `tests/test_mujoco.py`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from drop_physics.arrays import Flags, Float64, Vector
from drop_physics.physics.base import Drag, Law, Motion
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.scenario import EXACT_INTEGRATORS, Integrator

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
SLOW_RAD_S = 1e-15
"""Spin [rad/s] below which MuJoCo rotates a body about its x axis (`mju_normalize3`, `mjMINVAL`).
"""


@dataclass(frozen=True, kw_only=True)
class MujocoLaw(Law):
    """MuJoCo's step of one free body; spin is stored in body axes, and reported in world axes."""

    integrator: Integrator

    @property
    def semi_implicit(self) -> bool:
        """True if the body moves with the velocity at the end of the step."""
        return self.integrator not in EXACT_INTEGRATORS

    @property
    def moves_exactly(self) -> bool:
        """True if `moved` reproduces the engine's positions to the last bit."""
        return self.semi_implicit

    @property
    def drag(self) -> Drag:
        """The damping in continuous time: none."""
        return Drag(0.0, 0.0)

    def step(self, before: Motion) -> Motion:
        """Advance each sample by one timestep."""
        return self.moved(before, *self.velocities(before))

    def moved(self, before: Motion, velocity_m_s: Float64, spin_rad_s: Float64) -> Motion:
        """Move each sample by one integrator step with the given velocities."""
        mean_m_s = velocity_m_s
        if not self.semi_implicit:
            mean_m_s = (before.velocity_m_s + velocity_m_s) / 2
        position_m = before.position_m + self.timestep_s * mean_m_s
        return Motion(position_m, self.turned(before, spin_rad_s), velocity_m_s, spin_rad_s)

    def velocities(self, before: Motion) -> tuple[Float64, Float64]:
        """Return velocity [m/s] and spin [rad/s] after a step, shape (n, 3) each."""
        weight_n = np.array(self.gravity_m_s2) * self.mass_kg
        implicit = self.integrator in ("implicit", "implicitfast")  # solved, not multiplied
        pull = weight_n / self.mass_kg if implicit else weight_n * (1 / self.mass_kg)
        velocity_m_s = before.velocity_m_s + self.timestep_s * pull
        spin = rotate_inverse(before.orientation, before.spin_rad_s)
        after = spin + self.timestep_s * self._mean_acceleration(spin)
        # A turn about the new spin does not change it; rk4 turns about another.
        turned = before.orientation
        if self.integrator == "rk4":
            turned = self.turned(before, after)
        return velocity_m_s, rotate(turned, after)

    def _mean_acceleration(self, spin: Float64) -> Float64:
        """Return the angular acceleration [rad/s²] that the integrator uses, in body axes."""
        if self.integrator == "rk4":
            a, b, c, d = (self._acceleration(stage) for stage in self._stages(spin))
            return (a + 2 * b + 2 * c + d) / 6
        if self.integrator == "euler":
            return self._acceleration(spin)
        inertia = np.array(self.inertia_kg_m2)
        return self._solved(spin, -np.cross(spin, inertia * spin))

    def _solved(self, spin: Float64, torque: Float64) -> Float64:
        """Return the implicit integrators' response to torques: (I + dt d(ω × I ω)/dω)^-1 τ."""
        inertia = np.array(self.inertia_kg_m2)
        slope = _cross_matrix(spin) * inertia - _cross_matrix(inertia * spin)
        implicit = np.diag(inertia) + self.timestep_s * slope
        return np.asarray(np.linalg.solve(implicit, torque[..., None])[..., 0])

    def turned_by(self, angular_impulse_n_m_s: Float64, before: Motion) -> Float64:
        """Return the change of spin due to angular impulses [rad/s], in body axes, (n, 3)."""
        if self.integrator == "euler":
            return np.asarray(angular_impulse_n_m_s / np.array(self.inertia_kg_m2))
        spin = rotate_inverse(before.orientation, before.spin_rad_s)
        return self._solved(spin, angular_impulse_n_m_s)

    def _acceleration(self, spin: Float64) -> Float64:
        """Return the angular acceleration given by Euler's equation, I ω' = -ω × I ω."""
        inertia = np.array(self.inertia_kg_m2)
        return np.asarray(-np.cross(spin, inertia * spin) / inertia)

    def _stages(self, spin: Float64) -> list[Float64]:
        """Return the four spins evaluated by the Runge-Kutta method."""
        dt, stages = self.timestep_s, [spin]
        for share in (0.5, 0.5, 1.0):
            stages.append(spin + share * dt * self._acceleration(stages[-1]))
        return stages

    def turned(self, before: Motion, spin_rad_s: Float64) -> Float64:
        """Return the orientations after a step with the given spins, shape (n, 4)."""
        if self.integrator == "rk4":
            spin = self._mean_spin(rotate_inverse(before.orientation, before.spin_rad_s))
        else:
            spin = rotate_inverse(before.orientation, spin_rad_s)
        speed = np.linalg.norm(spin, axis=1, keepdims=True)
        spin = np.where(speed < SLOW_RAD_S, speed * (1.0, 0.0, 0.0), spin)
        return _turned_about(before.orientation, spin, self.timestep_s)

    def _mean_spin(self, spin: Float64) -> Float64:
        """Return the constant spin that rotates a body like a Runge-Kutta step, in body axes.

        The spins of the stages are first mapped back to the axes of the start: the method of
        Munthe-Kaas, which MuJoCo 4.0 follows to 1e-15, as found by experiment.
        """
        dt = self.timestep_s
        a, b, c, d = self._stages(spin)
        b = _taken_back(dt / 2 * a, b)
        c = _taken_back(dt / 2 * b, c)
        d = _taken_back(dt * c, d)
        return np.asarray((a + 2 * b + 2 * c + d) / 6)

    def released(self, start: Motion) -> Motion:
        """Return a state as the engine stores it, with the spin in body axes."""
        spin = rotate_inverse(start.orientation, start.spin_rad_s)
        return Motion(
            start.position_m, start.orientation, start.velocity_m_s, rotate(start.orientation, spin)
        )

    def bits(self, before: Motion) -> Flags:
        """Flag the samples from which `step` reproduces the engine's velocities bitwise, (n,)."""
        straight = ~before.velocity_m_s[:, :2].any(axis=1) & (not any(self.gravity_m_s2[:2]))
        turned = (before.orientation != UPRIGHT).any(axis=1) | before.spin_rad_s.any(axis=1)
        return np.asarray(straight & ~turned & (self.integrator != "rk4"))

    def terms(self, before: Motion) -> tuple[Float64, Float64]:
        """Return the magnitude of the summands of velocity and spin in a timestep, shape (n,).

        MuJoCo shifts forces to the centre of mass from a point whose position has the rounding
        error of x. The torque v × m v also cancels except for rounding.
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
        return np.asarray(velocity_m_s + self.timestep_s * np.array(self.gravity_m_s2))

    def exact_path(
        self, position_m: Vector, velocity_m_s: Vector, *, first: int = 0
    ) -> Iterator[Sequence[Decimal]]:
        """Yield the positions of a flight, starting at sample `first`, for `exactly`.

        The position is x0 + n dt v0 + dt² g n (n + 1)/2; for an exact step, n² replaces n (n + 1).
        """
        dt, more = Decimal(self.timestep_s), int(self.semi_implicit)
        axes = [
            (Decimal(x), Decimal(v), Decimal(g))
            for x, v, g in zip(position_m, velocity_m_s, self.gravity_m_s2, strict=True)
        ]
        for n in itertools.count(first):
            yield [x + n * dt * v + dt * dt * g * (n * (n + more)) / 2 for x, v, g in axes]


def _turned_about(orientation: Float64, spin_body: Float64, timestep_s: float) -> Float64:
    """Return q exp(ω dt/2) for unit quaternions q and spins ω in body axes, shape (n, 4)."""
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


def _cross_matrix(vectors: Float64) -> Float64:
    """Return the matrices that map b to a × b, shape (n, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), 2, 0)


def _taken_back(turn_rad: Float64, spin: Float64) -> Float64:
    """Apply the inverse derivative of the exponential map to a spin after a rotation, (n, 3).

    k + u × k / 2 + (1 - θ/2 cot θ/2)/θ² u × (u × k), with θ = |u|.
    """
    angle = np.linalg.norm(turn_rad, axis=1, keepdims=True)
    small = angle < 1e-3
    half = np.where(small, 1.0, angle) / 2
    share = np.where(small, 1 / 12 + angle**2 / 720, (1 - half / np.tan(half)) / (4 * half**2))
    once = np.cross(turn_rad, spin)
    return np.asarray(spin + once / 2 + share * np.cross(turn_rad, once))
