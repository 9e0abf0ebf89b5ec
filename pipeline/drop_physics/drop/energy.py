"""Energy that contact gives to a falling body, and conservation before the first contact.

In one step of semi-implicit Euler, v' = v + dt (g + d) + J/m and x' = x + dt v', the energy changes
by exactly

    dE = J·(v + v')/2  +  m dt d·(v + v')/2  -  m dt g·(v' - v)/2

The three terms are the contact's, the drag d's, and the integrator's, which moves the body with the
velocity at the end of the step, while gravity does work along the mean velocity. Derivation: insert
both equations into m v'²/2 - m g·x', and subtract the same expression before the step.
"""

from __future__ import annotations

import numpy as np

from drop_physics.drop.case import DropCase
from drop_physics.drop.mechanics import Drift, Mechanics
from drop_physics.drop.results import Conservation
from drop_physics.drop.samples import DropSamples
from drop_physics.physics.base import Motion


class Energies:
    """Energies of a fall, chunk by chunk: drift before the first contact, gain by contact."""

    def __init__(self, case: DropCase) -> None:
        self._case = case
        self._known = case.is_rigid and case.substeps == 1
        """Whether the law of the body is known."""
        self._energy, self._momentum = Drift(), Drift()
        self._last_j = 0.0
        self._before_j: float | None = None
        """The energy before the first contact."""
        self._start_m_s = np.zeros(3)
        """The velocity before the first contact [m/s]."""
        self._taken_j = 0.0
        """Energy lost to drag since the first contact [J]."""

    def add(self, part: DropSamples, before: Motion, energies: Mechanics, airborne: int) -> None:
        """Add samples, of which `airborne` are known to precede the first contact."""
        first = max(airborne, 1) - part.first
        if first > 0:
            self._energy.add(energies.total_j[:first])
            self._momentum.add(energies.angular_momentum_kg_m2_s[:first])
        if self._known and first < len(part):
            self._touch(before, part, energies, max(first, 0))
        self._last_j = float(energies.total_j[-1])

    def _touch(self, before: Motion, part: DropSamples, energies: Mechanics, row: int) -> None:
        """Add the contact energy of the steps that lead to the samples from `row` on."""
        case, then, after = self._case, before.velocity_m_s[row:], part.velocity_m_s[row:]
        if self._before_j is None:
            self._before_j = float(energies.total_j[row - 1]) if row else self._last_j
            self._start_m_s = then[0].copy()
        gravity = case.timestep_s * np.array(case.law.gravity_m_s2)
        drag = case.law.held(case.law.free_velocities(then)) - then - gravity
        self._taken_j += float(np.sum(drag * (then + after))) * case.engine.mass_kg / 2

    def conservation(self) -> Conservation:
        """Return the drift of energy and momentum before the first contact."""
        if self._case.substeps > 1 and not self._case.is_rigid:  # when it first touched is unknown
            return Conservation(self._energy.start, None, None)
        return Conservation(self._energy.start, self._energy.relative, self._momentum.relative)

    def contact_j(self) -> float | None:
        """Return the energy that contact gave to the body [J], minus losses of spin within steps.

        None for a body with joints, or if a timestep has several substeps.
        """
        case = self._case
        if not self._known:
            return None
        if self._before_j is None or not case.scenario.stepped:
            return 0.0
        taken_j = self._taken_j
        if case.law.semi_implicit:
            gained_m_s = case.end.velocity_m_s[0] - self._start_m_s
            pull = float(gained_m_s @ np.array(case.law.gravity_m_s2))
            taken_j -= case.engine.mass_kg * case.timestep_s / 2 * pull
        return self._last_j - self._before_j - taken_j
