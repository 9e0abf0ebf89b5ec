from __future__ import annotations
from dataclasses import dataclass
import numpy as np
from pipeline.physics import bullet_law
from pipeline.physics.spin_law import spin_airborne


@dataclass
class Flight:
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray
    orientation_xyzw: np.ndarray
    clamped_step: int | None


def flight_of(scenario, report, *, steps):
    fall = bullet_law.fall_of(scenario)
    how = dict(timestep_s=scenario.timestep_s, steps=steps, mass_kg=report.mass_kg)
    if any(scenario.spin_rad_s):
        r = spin_airborne(
            fall,
            spin_rad_s=scenario.spin_rad_s,
            angular_damping=bullet_law.effective_damping(
                scenario.angular_damping, scenario.coordinates
            ),
            inertia_kg_m2=report.inertia_kg_m2,
            **how,
        )
        x, v, w, q = r
    else:
        x, v = bullet_law.airborne(fall, **how)
        w = np.zeros_like(x)
        q = np.tile((0.0, 0.0, 0.0, 1.0), (steps + 1, 1))
    c = (
        np.flatnonzero(np.abs(np.hstack((v, w))).max(axis=1) >= 100)
        if scenario.coordinates == "reduced"
        else []
    )
    return Flight(x, v, w, q, int(c[0]) if len(c) else None)
