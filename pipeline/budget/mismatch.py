"""How far the recorded state follows the law of the engine that the recording names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.budget.phases import Phases
from pipeline.budget.results import Coverage
from pipeline.budget.samples import Samples
from pipeline.physics import bullet_law
from pipeline.physics.spin_law import spin_airborne
from pipeline.physics.theory import Fall
from pipeline.scenario import Scenario


def find_mismatch(
    scenario: Scenario,
    engine: Mapping[str, Any],
    fall: Fall,
    samples: Samples,
    *,
    airborne: int,
) -> tuple[int, float] | None:
    """Return the first sample in the air that does not follow Bullet's law, and by how much."""
    if not scenario.stepped or engine["joints"]:
        return None
    airborne = max(1, airborne)  # the release is in the air, whatever is recorded of contact
    spins = any(scenario.spin_rad_s)
    how: dict[str, Any] = {
        "timestep_s": scenario.timestep_s, "steps": airborne - 1, "mass_kg": engine["mass_kg"]
    }  # fmt: skip
    if spins:
        position_m, velocity_m_s, spin_rad_s, orientation = spin_airborne(
            fall,
            spin_rad_s=scenario.spin_rad_s,
            angular_damping=bullet_law.effective_damping(
                scenario.angular_damping, scenario.coordinates
            ),
            inertia_kg_m2=tuple(engine["inertia_kg_m2"]),
            **how,
        )
    else:
        position_m, velocity_m_s = bullet_law.airborne(fall, **how)
        spin_rad_s = np.zeros_like(position_m)
        orientation = np.tile((0.0, 0.0, 0.0, 1.0), (airborne, 1))
    state = (samples.position_m, samples.velocity_m_s, samples.spin_rad_s, samples.orientation)
    recorded = np.hstack([part[:airborne] for part in state])
    # A quaternion and its negative are the same orientation.
    agree = np.sum(orientation * samples.orientation[:airborne], axis=1, keepdims=True)
    turned = np.where(agree < 0, -orientation, orientation)
    law = np.hstack((position_m, velocity_m_s, spin_rad_s, turned))
    # Spin goes through sin and cos, which differ between C libraries, and tumbling amplifies that.
    exact = engine.get("machine") in bullet_law.EXACT_MACHINES
    tolerance = 1e-9 if spins else 0.0 if exact else bullet_law.FUSED
    deviation = np.abs(recorded - law).max(axis=1)
    off = np.flatnonzero(~(deviation <= tolerance * np.maximum(1.0, np.abs(law).max(axis=1))))
    return (int(off[0]), float(deviation[off[0]])) if len(off) else None


def coverage_of(
    scenario: Scenario,
    engine: Mapping[str, Any],
    found: Phases,
    mismatch: tuple[int, float] | None,
) -> Coverage:
    """Say how far the law of the air explains the recording."""
    if not scenario.stepped:
        return Coverage(0, found.samples, "no step was taken, so no law of motion applies")
    if engine["joints"]:
        why = f"the body has {engine['joints']} joints, and the law is that of one rigid body"
        return Coverage(0, found.samples, why)
    if mismatch is not None:
        why = f"from sample {mismatch[0]} on the state does not follow Bullet's law"
        return Coverage(mismatch[0], found.samples, why)
    if found.contact_step is not None:
        why = f"from sample {found.contact_step} on the body is, or has been, in contact"
        return Coverage(found.airborne, found.samples, why)
    return Coverage(found.samples, found.samples, "the whole recording is in the air")
