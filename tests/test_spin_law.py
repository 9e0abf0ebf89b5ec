"""Verification: a body that falls and spins does so as in PyBullet, bit for bit on x86-64.

sin, cos and pow are the C library's, here and in the engine.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from engine import MODES, ROUNDS_ONCE, drive

from pipeline.physics import bullet_law, spin_law
from pipeline.physics.bullet_law import effective_damping
from pipeline.physics.theory import Fall

STEPS, TIMESTEP_S = 200, 1 / 240


@pytest.mark.parametrize("coordinates", MODES)
@pytest.mark.parametrize("damping", [None, 0.0, 0.5])
# The light body's Jacobian has a determinant below SIMD_EPSILON, and the fast one turns too far.
@pytest.mark.parametrize("inertia", [(1e-3, 2e-3, 2.5e-3), (1e-6, 2e-6, 3e-6)])
def test_the_spin_is_pybullets(coordinates: Any, damping: float | None, inertia: Any) -> None:
    coefficient = effective_damping(damping, coordinates)
    for velocity, spin in itertools.product(
        ((0.0, 0.0, 0.0), (40.0, -120.0, 3.0)),
        (
            (1e-4, 0.0, 0.0),
            (1.0, 2.0, 3.0),
            (20.0, -3.0, 0.1),
            (0.0, 150.0, 90.0),
            (300.0, 1.0, 0.0),
        ),
    ):
        fall = Fall(
            height_m=1.0,
            velocity_m_s=velocity,
            gravity_m_s2=-9.81,
            linear_damping=coefficient,
            coordinates=coordinates,
        )
        seen = drive(
            samples=STEPS + 1, floor=False, velocity_m_s=velocity, spin_rad_s=spin,
            coordinates=coordinates, dynamics={
                "linearDamping": coefficient, "angularDamping": coefficient,
                # Told an inertia alone, a btRigidBody takes as its mass what lies in the command's
                # memory: letters of the path of the URDF (PhysicsServerCommandProcessor.cpp 11106).
                "localInertiaDiagonal": inertia, "mass": 0.1,
            },
        )  # fmt: skip
        found = spin_law.spin_airborne(
            fall,
            spin_rad_s=spin,
            angular_damping=coefficient,
            inertia_kg_m2=inertia,
            timestep_s=TIMESTEP_S,
            steps=STEPS,
            mass_kg=seen.mass_kg,
        )
        for name in ("position_m", "velocity_m_s", "spin_rad_s"):
            law, engine = getattr(found, name), getattr(seen, name)
            if ROUNDS_ONCE:
                np.testing.assert_array_equal(law, engine)
            else:
                np.testing.assert_allclose(law, engine, rtol=1e-9, atol=1e-9)
        same_way = np.sum(found.orientation_xyzw * seen.orientation_xyzw, axis=1)
        assert np.abs(same_way) == pytest.approx(1, abs=1e-14 if ROUNDS_ONCE else 1e-9)


@pytest.mark.parametrize("coordinates", MODES)
def test_without_spin_it_is_the_fall(coordinates: Any) -> None:
    fall = Fall(
        height_m=1.0,
        velocity_m_s=(1.0, 2.0, 3.0),
        gravity_m_s2=-9.81,
        linear_damping=0.04,
        coordinates=coordinates,
    )
    setting: Any = {"timestep_s": TIMESTEP_S, "steps": STEPS, "mass_kg": 0.1}
    still = spin_law.spin_airborne(
        fall,
        spin_rad_s=(0.0, 0.0, 0.0),
        angular_damping=0.04,
        inertia_kg_m2=(1e-3, 2e-3, 3e-3),
        **setting,
    )
    position_m, velocity_m_s = bullet_law.airborne(fall, **setting)
    assert (still.position_m == position_m).all()
    assert (still.velocity_m_s == velocity_m_s).all()
