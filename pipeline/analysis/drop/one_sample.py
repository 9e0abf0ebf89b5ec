"""One sample in the air, taken apart without the rest of the recording: what a sweep asks for.

It gives the bits that `analysis_of` gives for the same sample of the whole recording, or nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.analysis.drop.decomposition import decompose
from pipeline.analysis.drop.results import Moment, Terms
from pipeline.laws import bullet_air
from pipeline.laws.flight import is_turned
from pipeline.report import EngineReport
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]

DEFAULT_AT_S = 0.3
"""The experiment's moment: time to take apart where none is asked for."""


def moment_in_the_air(
    scenario: Scenario,
    engine: EngineReport,
    position_m: Float64,
    velocity_m_s: Float64,
    *,
    touched: bool,
) -> Moment | None:
    """Take the last of these samples apart; None where that needs the whole analysis.

    It needs nothing but the samples until then where one rigid body falls straight down without
    spin, has met nothing yet, and follows Bullet's law to the last bit.

    Parameters
    ----------
    scenario
        What was dropped, and how.
    engine
        What the engine reported of the body: mass and joints.
    position_m, velocity_m_s
        Samples from the release on [m], [m/s], shape (n, 3).
    touched
        Whether there was a contact in them.
    """
    sideways = any((*scenario.velocity_m_s[:2], *scenario.spin_rad_s))
    if sideways or is_turned(scenario) or (scenario.substeps or 1) > 1:
        return None
    if not scenario.stepped or engine.joints or touched:
        return None
    if np.abs(velocity_m_s).max() >= bullet_air.MAX_COORDINATE_VELOCITY_M_S:
        return None
    fall, timestep_s = bullet_air.fall_of(scenario), scenario.timestep_s
    step = len(position_m) - 1
    law_m, law_m_s = bullet_air.airborne(
        fall, timestep_s=timestep_s, steps=step, mass_kg=engine.mass_kg
    )
    if not (np.array_equal(position_m, law_m) and np.array_equal(velocity_m_s, law_m_s)):
        return None
    parts = decompose(fall, position_m[-1:, 2], timestep_s=timestep_s, first=step)
    lowest_m = engine.rest_height_m if scenario.floor else None
    if lowest_m is not None and parts.free_fall_m[-1] <= lowest_m:
        return None  # theory has landed
    return Moment(
        time_s=step * timestep_s,
        step=step,
        phase="falling",
        simulated_m=float(position_m[-1, 2]),
        free_fall_m=float(parts.free_fall_m[-1]),
        error_m=float(parts.total_m[-1]),
        terms_m=Terms(
            timestep=float(parts.timestep_m[-1]),
            damping=float(parts.damping_m[-1]),
            interaction=float(parts.interaction_m[-1]),
            rounding=float(parts.rounding_m[-1]),
        ),
    )
