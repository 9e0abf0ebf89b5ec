"""The energy that contact gave to a falling body, in any engine whose law is known.

Of one step of semi-implicit Euler, v' = v + dt (g + d) + J/m and x' = x + dt v', the energy changes
by exactly

    dE = J·(v + v')/2  +  m dt d·(v + v')/2  -  m dt g·(v' - v)/2

for contact, the drag d, and the integrator, which moves the body with the end-of-step velocity,
while gravity acts along the mean of both. Derivation: insert both lines into m v'²/2 - m g·x' minus
the same before the step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.mechanics import mechanics
from drop_physics.analysis.drop.samples import BLOCK

Float64 = NDArray[np.float64]


def contact_energy_j(case: Case, *, airborne: int) -> float | None:
    """Return the energy that contact gave [J], what the spin lost to damping and turns included.

    None where no law of the body is known, and of several steps per sample.
    """
    law = case.law
    if not case.is_rigid or case.substeps > 1 or not law.covers(case.samples).all():
        return None
    rows, dt = slice(max(airborne - 1, 0), None), case.timestep_s
    velocity = case.samples.velocity_m_s[rows]
    if not case.scenario.stepped or len(velocity) < 2:
        return 0.0
    gravity = np.array(law.gravity_m_s2)
    mass_kg, ends = case.engine.mass_kg, (slice(rows.start, rows.start + 1), slice(-1, None))
    before_j, after_j = (float(mechanics(case.engine, case.samples, end).total_j[0])
        for end in ends)  # fmt: skip
    taken_j = 0.0
    for first in range(0, len(velocity) - 1, BLOCK):
        block = velocity[first : first + BLOCK + 1]
        before, after = block[:-1], block[1:]
        drag = law.held(law.free_velocities(before)) - before - dt * gravity
        taken_j += float(np.sum(drag * (before + after))) * mass_kg / 2
    if law.semi_implicit:
        taken_j -= mass_kg * dt / 2 * float((velocity[-1] - velocity[0]) @ gravity)
    return after_j - before_j - taken_j
