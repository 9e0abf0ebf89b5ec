"""Growth and decay of spring-damper systems under an integrator's step.

Let M be the mass matrix, k the stiffness, d the damping evaluated at the end of a step, and e the
damping evaluated at its beginning, all diagonal. Semi-implicit Euler with implicit damping
(MuJoCo's `mj_EulerSkip` and `mj_implicitSkip`) then maps position x and rate v, in a timestep h,
to:

    v' = v - h (M + h d)⁻¹ (k x + (d + e) v)        x' = x + h v'

The motion grows if an eigenvalue of this step is above 1 in magnitude. For one degree of freedom of
inertia I, this is the case if b > 2 or a > 2 (2 - b), with

    a = k h² / (I + h d)        b = h (d + e) / (I + h d)

or, without dampers, if k h² / I > 4. The fourth-order Runge-Kutta step evaluates all forces
explicitly: an eigenvalue z / h of the motion becomes

    1 + z + z²/2 + z³/6 + z⁴/24

Source: both results are the schemes applied to M x" = -k x - (d + e) x', in closed form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

HALVINGS = 30
"""Number of bisections for a limit, of which two digits are reported."""
RANGE = 1e12
"""Search range of a limit: from the current value divided by this factor to the value multiplied by
it."""


@dataclass(frozen=True, eq=False)
class Servos:
    """Joints as coupled springs and dampers, with the integrator that steps them."""

    timestep_s: float
    inertia: Float64
    """The mass matrix, shape (n, n) [kg m²] or [kg]."""
    stiffness: Float64
    """Spring stiffness, shape (n,) [N m/rad] or [N/m]."""
    ends: Float64
    """Damping evaluated at the end of a step, shape (n,) [N m s/rad] or [N s/m]."""
    begins: Float64
    """Damping evaluated at the start of a step, shape (n,)."""
    fourth_order: bool = False
    """Whether the integrator is fourth-order Runge-Kutta instead of Euler."""

    @property
    def growth(self) -> float:
        """The factor by which a deviation grows per step, in the long run."""
        h, one = self.timestep_s, np.eye(len(self.inertia))
        pull, damping = np.diag(self.stiffness), np.diag(self.ends + self.begins)
        if self.fourth_order:
            pulls, brakes = (np.linalg.solve(self.inertia, each) for each in (pull, damping))
            z = h * np.linalg.eigvals(np.block([[0 * one, one], [-pulls, -brakes]]))
            return float(np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24).max())
        heavy = self.inertia + h * np.diag(self.ends)
        pulls, brakes = (h * np.linalg.solve(heavy, each) for each in (pull, damping))
        step = np.block([[one - h * pulls, h * (one - brakes)], [-pulls, one - brakes]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    @property
    def grows(self) -> bool:
        """True if deviations grow by more than rounding error."""
        return self.growth > 1 + 1e-7

    def alone(self, place: int) -> Servos:
        """Return one degree of freedom alone, without springs and dampers on the others."""
        inertia = 1 / np.linalg.inv(self.inertia)[place, place]
        return replace(
            self,
            inertia=np.array([[inertia]]),
            stiffness=self.stiffness[[place]],
            ends=self.ends[[place]],
            begins=self.begins[[place]],
        )

    def calmed(self, name: str, place: int, factor: float) -> Servos:
        """Return the servos with one joint's gain divided, or inertia multiplied, by a factor."""
        if name == "timestep_s":
            return replace(self, timestep_s=self.timestep_s / factor)
        values = np.array(getattr(self, name))
        if name == "inertia":
            values[place, place] *= factor
        else:
            values[place] /= factor
        changed: dict[str, Any] = {name: values}
        return replace(self, **changed)

    def limit(self, name: str, place: int) -> float | None:
        """Return the smallest factor for `calmed` that makes the servos stable, or None."""
        return _first(lambda factor: not self.calmed(name, place, factor).grows)


def pd_effort(
    *,
    gains: Float64,
    target: Float64,
    target_velocity: Float64,
    limit: Float64,
    position: Float64,
    velocity: Float64,
) -> Float64:
    """Return the effort of a servo that acts at the start of a step, shape (n,).

    The effort is kp (q* - q) + kd (q̇* - q̇), clipped to ± `limit`; `gains` are kp and kd.
    """
    kp, kd = gains
    wanted = kp * (target - position) + kd * (target_velocity - velocity)
    return np.asarray(np.clip(wanted, -limit, limit))


def _first(holds: Callable[[float], bool]) -> float | None:
    """Return the smallest factor ≥ 1 from which a condition holds; None if it never does."""
    low, high = 1.0, 2.0
    while not holds(high):
        low, high = high, high * high
        if high > RANGE:
            return None
    for _ in range(HALVINGS):
        mid = 0.5 * (low + high)
        low, high = (low, mid) if holds(mid) else (mid, high)
    return high
