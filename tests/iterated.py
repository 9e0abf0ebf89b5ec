"""Bullet's integration rule in floats, iterated from a release: must match PyBullet bit for bit.

The program takes single steps from recorded samples, in arrays; the formulas are the same ones.
"""

from __future__ import annotations

import math
from itertools import islice
from typing import Any

import numpy as np
from drop_physics.physics.base import Motion
from drop_physics.physics.columns import rotation
from drop_physics.physics.laws.bullet import air as bullet_air
from drop_physics.physics.laws.bullet import spin as bullet_spin
from drop_physics.physics.laws.bullet.air import effective_damping
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.physics.theory import TheoreticalFall

SIN, COS = (np.vectorize(function, otypes=[float]) for function in (math.sin, math.cos))
"""The C library's functions, which the engine uses too."""
AT_REST = (0.0, 0.0, 0.0)


def law_of(
    *,
    timestep_s: float = 1 / 240,
    substeps: int = 1,
    gravity_m_s2: float = -9.81,
    mass_kg: float = 0.1,
    inertia_kg_m2: Any = (1e-3, 2e-3, 2.5e-3),
    linear_damping: float | None = None,
    angular_damping: float | None = None,
    coordinates: Any = "reduced",
) -> BulletLaw:
    """Return the integration rule for a body with the given damping settings."""
    return BulletLaw(
        timestep_s=timestep_s,
        substeps=substeps,
        gravity_m_s2=(0.0, 0.0, gravity_m_s2),
        mass_kg=mass_kg,
        inertia_kg_m2=inertia_kg_m2,
        linear_damping=effective_damping(linear_damping, coordinates),
        angular_damping=effective_damping(angular_damping, coordinates),
        coordinates=coordinates,
    )


def thrown_as(
    law: BulletLaw, velocity_m_s: Any = AT_REST, height_m: float = 1.0
) -> TheoreticalFall:
    """Return the fall of a body under the rule's air damping."""
    return TheoreticalFall(
        position_m=(0.0, 0.0, height_m),
        velocity_m_s=velocity_m_s,
        gravity_m_s2=law.gravity_m_s2[2],
        drag=law.drag,
    )


def airborne(
    law: BulletLaw, steps: int, *, velocity_m_s: Any = AT_REST, height_m: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities before each step and after the last, (steps + 1, 3)."""
    after, weight = bullet_air.velocity_law(law, float)
    x, v = np.array((0.0, 0.0, height_m)), np.array(velocity_m_s, dtype=float)
    rows = [(x, v)]
    for step in range(1, steps * law.substeps + 1):
        squared = float(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        speed = math.sqrt(squared) if squared > bullet_air.EPSILON else 0.0
        v = np.array([after(float(u), speed, f) for u, f in zip(v, weight, strict=True)])
        x = x + law.step_s * v
        if step % law.substeps == 0:
            rows.append((x, v))
    positions, velocities = zip(*rows, strict=True)
    return np.array(positions), np.array(velocities)


def tumbling(
    law: BulletLaw,
    steps: int,
    *,
    spin_rad_s: Any,
    velocity_m_s: Any = AT_REST,
    height_m: float = 1.0,
    orientation: Any = (0.0, 0.0, 0.0, 1.0),
) -> Motion:
    """Return the motion before each step and after the last, as PyBullet reads it back."""

    def states() -> Any:
        start = (0.0, 0.0, height_m), velocity_m_s, spin_rad_s, orientation
        x, v, w, q = (np.array(each, float)[:, None] for each in start)
        while True:
            seen = read_back(q[:, 0].tolist())
            if law.coordinates == "maximal":  # a btTransform keeps a matrix
                q = np.array(seen)[:, None]
            yield x[:, 0], seen, v[:, 0], w[:, 0]
            v, w = bullet_spin.velocities(law, v, w, q)
            x = x + v * law.step_s
            q = bullet_spin.turned(law, q, w, sin=SIN, cos=COS)

    seen = islice(states(), 0, steps * law.substeps + 1, law.substeps)
    return Motion(*(np.array(each, dtype=float) for each in zip(*seen, strict=True)))


def read_back(q: Any) -> tuple[float, float, float, float]:
    """Return a quaternion as `btMatrix3x3::getRotation` reads it back from its matrix."""
    m = rotation(np.array(q)).tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0.0:
        root = math.sqrt(trace + 1.0)
        s = 0.5 / root
        x, y, z = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
        return x * s, y * s, z * s, root * 0.5
    i = max(range(3), key=lambda axis: m[axis][axis])
    j, k = (i + 1) % 3, (i + 2) % 3
    root = math.sqrt(m[i][i] - m[j][j] - m[k][k] + 1.0)
    s, found = 0.5 / root, [0.0] * 4
    found[i], found[3] = root * 0.5, (m[k][j] - m[j][k]) * s
    found[j], found[k] = (m[j][i] + m[i][j]) * s, (m[k][i] + m[i][k]) * s
    return found[0], found[1], found[2], found[3]
