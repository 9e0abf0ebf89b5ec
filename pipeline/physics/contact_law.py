# PLACEHOLDER by the lead; the physics helper replaces this file whole.
import numpy as np
from pipeline.physics.theory import Fall

CONTACT_SLOP_M = 1e-5
DEFAULT_CONTACT_ERP = 0.08
RESTITUTION_THRESHOLD_M_S = 0.2


def flat_drop(f, *, timestep_s, steps, mass_kg, rest_height_m, restitution, contact_erp=0.08):
    z, v, dt, g, k = f.height_m, f.velocity_m_s[2], timestep_s, f.gravity_m_s2, f.linear_damping
    Z, V = [z], [v]
    for _ in range(steps):
        d = z - rest_height_m
        v += dt * (g - k * v * (1 + abs(v)))
        if d < 0:
            gap = d + CONTACT_SLOP_M
            rest = restitution * abs(v) if abs(v) >= 0.2 and v < 0 else 0
            v = max(v, rest + (-gap * contact_erp / dt if gap <= 0 else -gap / dt))
        z += dt * v
        Z.append(z)
        V.append(v)
    return np.array(Z), np.array(V)
