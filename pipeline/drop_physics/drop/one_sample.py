"""Computes the error terms of one sample in flight from the samples up to it, for sweeps.

The result equals, to the bit, the result of `Story` for the same sample of the whole recording; or
it is None.
"""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.drop.results import Moment, Terms
from drop_physics.engine_report import EngineReport
from drop_physics.explain.decomposition import TERMS, decompose
from drop_physics.physics.base import Law, Motion
from drop_physics.physics.laws.lookup import fall_of, law_for
from drop_physics.physics.theory import TheoreticalFall
from drop_physics.scenario import Scenario

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
DEFAULT_AT_S = 0.3
"""The time at which the error is broken into terms if none is requested."""


def moment_in_the_air(
    scenario: Scenario,
    engine: EngineReport,
    position_m: Float64,
    velocity_m_s: Float64,
    *,
    touched: bool,
) -> Moment | None:
    """Break the last sample's error into terms; None if the samples up to it do not suffice.

    They suffice if a single rigid body falls straight down without spin, has touched nothing yet,
    and follows Bullet's law to the last bit.

    Parameters
    ----------
    scenario
        The scenario of the drop.
    engine
        The engine's report on the body: mass and joints.
    position_m, velocity_m_s
        Samples from the release on [m], [m/s], shape (n, 3).
    touched
        Whether there was a contact in these samples.
    """
    sideways = any((*scenario.velocity_m_s[:2], *scenario.spin_rad_s))
    if sideways or scenario.orientation_xyzw != UPRIGHT or (scenario.substeps or 1) > 1:
        return None
    if not scenario.stepped or engine.joints or touched:
        return None
    fall, law, step = fall_of(scenario), law_for(scenario, engine), len(position_m) - 1
    unspun = np.zeros_like(position_m)
    motion = Motion(position_m, np.tile(UPRIGHT, (step + 1, 1)), velocity_m_s, unspun)
    before = motion.at(slice(step))
    after, released = law.step(before), np.array([fall.position_m, fall.velocity_m_s])
    if not np.array_equal((position_m[0], velocity_m_s[0]), released):
        return None
    if not np.array_equal(motion.position_m[1:], after.position_m):
        return None
    if not np.array_equal(motion.velocity_m_s[1:], after.velocity_m_s):
        return None
    # Near the limit of velocities, each step would have to be asked whether it was clamped.
    if not np.array_equal(law.held(2 * velocity_m_s), 2 * velocity_m_s):
        return None
    moment = moment_of(law, fall, position_m[-1:], step)
    lowest_m = engine.rest_height_m if scenario.floor else None
    if lowest_m is not None and moment.free_fall_m <= lowest_m:
        return None  # by theory it has landed
    return moment


def moment_of(law: Law, fall: TheoreticalFall, position_m: Float64, step: int) -> Moment:
    """Break the error of a sample in free flight into terms; `position_m` has shape (1, 3)."""
    parts = decompose(law, fall, position_m, first=step)
    return Moment(
        time_s=step * law.timestep_s,
        step=step,
        phase="falling",
        simulated_m=float(position_m[0, 2]),
        free_fall_m=float(parts.free_fall_m[0, 2]),
        error_m=float(parts.total_m[0, 2]),
        terms_m=Terms(**{name: float(getattr(parts, f"{name}_m")[0, 2]) for name in TERMS}),
    )
