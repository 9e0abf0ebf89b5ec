"""One degree of freedom on a spring and dampers: what a step makes of it.

With inertia I, stiffness k, damping d taken at the end of a step and e at its beginning, a timestep
h makes of position x and rate v, by semi-implicit Euler with its dampers on the left (MuJoCo's
`mj_EulerSkip` and `mj_implicitSkip`):

    v' = v - h (k x + (d + e) v) / (I + h d)        x' = x + h v'

whose eigenvalues have the sum 2 - a - b and the product 1 - b, with

    a = k h² / (I + h d)        b = h (d + e) / (I + h d)

so it grows where b > 2 or a > 2 (2 - b): without dampers where k h² / I > 4. Runge and Kutta's step
takes everything at its beginning: an eigenvalue z / h of the motion becomes

    1 + z + z²/2 + z³/6 + z⁴/24

Source: both are the schemes applied to I x" = -k x - (d + e) x', in closed form.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

HALVINGS = 60
"""Bisections of a limit: as many as a double has digits."""
RANGE = 1e12
"""A limit is searched for between the current value divided by this and multiplied by this."""


@dataclass(frozen=True, kw_only=True)
class Servo:
    """One degree of freedom, and how it is stepped."""

    timestep_s: float
    inertia: float
    """[kg m²] or [kg]."""
    stiffness: float
    """[N m/rad] or [N/m]."""
    ends: float = 0.0
    """Damping evaluated at the end of a step [N m s/rad] or [N s/m]."""
    begins: float = 0.0
    """Damping evaluated at its beginning."""
    fourth_order: bool = False
    """Whether steps are Runge and Kutta's instead of Euler's."""

    @property
    def growth(self) -> float:
        """The factor by which a step multiplies a gap, in the long run."""
        h, damping = self.timestep_s, self.ends + self.begins
        if self.fourth_order:
            z = h * np.roots([self.inertia, damping, self.stiffness])
            return float(np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24).max())
        heavy = self.inertia + h * self.ends
        a, b = self.stiffness * h * h / heavy, h * damping / heavy
        return float(np.abs(np.roots([1.0, a + b - 2, 1 - b])).max())

    @property
    def grows(self) -> bool:
        """Whether gaps grow by more than rounding."""
        return self.growth > 1 + 1e-9

    def limit(self, name: str) -> float | None:
        """Return where it begins to grow as one of its numbers changes; None if it never does."""
        now = float(getattr(self, name))
        if not now > 0:
            return None
        less = name != "inertia"

        def held(factor: float) -> bool:
            changed: dict[str, Any] = {name: now / factor if less else now * factor}
            return not replace(self, **changed).grows

        found = _first(held)
        return None if found is None else now / found if less else now * found


def pd_effort(
    *,
    gains: Float64,
    target: Float64,
    target_velocity: Float64,
    limit: Float64,
    position: Float64,
    velocity: Float64,
) -> Float64:
    """Return the effort of a servo that acts at the beginning of a step, shape (n,).

    clip(kp (q* - q) + kd (q̇* - q̇), ± force); `gains` are kp and kd.
    """
    kp, kd = gains
    wanted = kp * (target - position) + kd * (target_velocity - velocity)
    return np.asarray(np.clip(wanted, -limit, limit))


def _first(holds: Callable[[float], bool]) -> float | None:
    """Return the least factor, at least 1, from which on something holds; None without any."""
    low, high = 1.0, 2.0
    while not holds(high):
        low, high = high, high * high
        if high > RANGE:
            return None
    for _ in range(HALVINGS):
        mid = 0.5 * (low + high)
        low, high = (low, mid) if holds(mid) else (mid, high)
    return high
