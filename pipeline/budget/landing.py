"""Impact, contact, bounces and rest: what the recording shows beside what Bullet's law predicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.budget.conservation import rotate_inverse
from pipeline.budget.phases import Phases, crossing_time
from pipeline.budget.results import Bounce, Contact, Impact, Rest, RestTerms
from pipeline.budget.samples import Samples
from pipeline.physics import contact_law, theory
from pipeline.physics.contact_law import CONTACT_ERP, CONTACT_SLOP_M
from pipeline.physics.theory import Fall
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]

LONGEST_THROW_S = 3600.0


def find_impact(
    scenario: Scenario,
    engine: Mapping[str, Any],
    fall: Fall,
    found: Phases,
    samples: Samples,
) -> Impact | None:
    """Return when the body meets the floor, or None if it never does."""
    if found.contact_step is None:
        return None
    rest_height_m, height_m = engine["rest_height_m"], samples.height_m
    lowest = int(np.argmin(height_m))
    upright = lands_upright(scenario, engine)
    free_s = theory.impact_time_free(fall, rest_height_m) if upright else None
    # An oblique throw is integrated, which is no use over days: up, in next to no gravity.
    oblique = fall.coordinates == "reduced" and any(fall.velocity_m_s[:2])
    endless = free_s is None or (oblique and free_s > LONGEST_THROW_S)
    return Impact(
        time_free_fall_s=free_s,
        time_damped_s=None if endless else theory.impact_time_damped(fall, rest_height_m),
        time_simulated_s=crossing_time(height_m, rest_height_m, scenario.timestep_s)
        if upright
        else None,
        step=found.contact_step,
        speed_m_s=float(abs(samples.velocity_m_s[max(found.contact_step - 1, 0), 2])),
        lowest_m=float(height_m[lowest]),
        lowest_step=lowest,
        penetration_m=max(0.0, rest_height_m - float(height_m[lowest])) if upright else None,
    )


def lands_upright(scenario: Scenario, engine: Mapping[str, Any]) -> bool:
    """Whether the body meets the floor as it was released: it does not spin, or is a ball."""
    return not any(scenario.spin_rad_s) or engine["shape"] == "sphere"


def expected_rest_height(
    scenario: Scenario, engine: Mapping[str, Any], orientation: Float64
) -> float | None:
    """Return the height of the centre of a body at rest [m]; None where nothing says it.

    A ball lies at its radius, a box on the face that is down by now, any other body at its release
    height above the floor if it never turned. `orientation` is a quaternion x, y, z, w.
    """
    if engine["shape"] == "box":
        up_in_box = np.abs(rotate_inverse(orientation[None, :], np.array([[0.0, 0.0, 1.0]]))[0])
        axis = int(np.argmax(up_in_box))
        # cos of 0.8°: a box that leans more than this does not lie on a face.
        return float(engine["shape_dimensions_m"][axis]) / 2 if up_in_box[axis] > 0.9999 else None
    return float(engine["rest_height_m"]) if lands_upright(scenario, engine) else None


def contact_law_path(
    scenario: Scenario,
    engine: Mapping[str, Any],
    fall: Fall,
    *,
    steps: int,
    contact_erp: float | None = None,
) -> tuple[Float64, Float64] | None:
    """Return the heights and vertical velocities of the contact law, shape (steps + 1,) each.

    None where the law does not hold: it is that of one rigid box that lands flat, without spin or
    sideways velocity. `contact_erp` is tried instead of the scenario's.
    """
    flat = not any((*scenario.velocity_m_s[:2], *scenario.spin_rad_s))
    rigid_box = engine["shape"] == "box" and not engine["joints"]
    if not (flat and rigid_box and scenario.floor and scenario.stepped):
        return None
    if contact_erp is None:
        contact_erp = CONTACT_ERP if scenario.contact_erp is None else scenario.contact_erp
    return contact_law.flat_drop(
        fall,
        timestep_s=scenario.timestep_s,
        steps=steps,
        mass_kg=engine["mass_kg"],
        rest_height_m=engine["rest_height_m"],
        restitution=pair_restitution(engine),
        contact_erp=contact_erp,
    )


def find_contact(found: Phases, height_m: Float64, law_m: Float64 | None) -> Contact | None:
    """Return how far the recorded heights are from the contact law's, or None without either."""
    if law_m is None or found.contact_step is None:
        return None
    deviation_m = np.abs(height_m - law_m)
    worst = int(np.argmax(deviation_m))
    return Contact(float(deviation_m[worst]), worst)


def find_rest(
    scenario: Scenario,
    engine: Mapping[str, Any],
    found: Phases,
    samples: Samples,
    law_m: Float64 | None,
) -> Rest | None:
    """Return where the body comes to lie, and why it is not the rest height exactly.

    `law_m` holds the contact law's heights, shape (samples,), or is None where it does not hold.
    """
    if found.rest_step is None:
        return None
    last_m = float(samples.height_m[-1])
    expected_m = expected_rest_height(scenario, engine, samples.orientation[-1])
    if expected_m is None:
        return Rest(last_m, None, None, found.rest_step, None)
    terms = None
    if law_m is not None:
        law_end_m = float(law_m[-1])
        terms = RestTerms(
            slop=-CONTACT_SLOP_M,
            solver=last_m - law_end_m,
            settling=law_end_m - (expected_m - CONTACT_SLOP_M),
        )
    return Rest(last_m, expected_m, last_m - expected_m, found.rest_step, terms)


def find_bounces(
    scenario: Scenario, engine: Mapping[str, Any], fall: Fall, samples: Samples
) -> list[Bounce]:
    """Return the rebounds that leave the floor again, beside what restitution alone would give."""
    asked = pair_restitution(engine)
    if asked == 0 or fall.gravity_m_s2 >= 0 or not scenario.floor:
        return []

    def bounces(heights_m: Float64, velocities_m_s: Float64) -> list[contact_law.Bounce]:
        return contact_law.bounces(
            heights_m,
            velocities_m_s,
            fall,
            timestep_s=scenario.timestep_s,
            mass_kg=engine["mass_kg"],
            rest_height_m=engine["rest_height_m"],
        )

    found = bounces(samples.height_m, samples.velocity_m_s[:, 2])
    # A throw, up or down, arrives as fast as a drop from v²/2g higher.
    thrown_m = fall.velocity_m_s[2] ** 2 / (-2 * fall.gravity_m_s2)
    drop_height_m = fall.height_m - engine["rest_height_m"] + thrown_m
    predicted_m = contact_law.rebound_heights(drop_height_m, asked, len(found))
    plain = contact_law_path(
        scenario, engine, fall, steps=len(samples.height_m) - 1, contact_erp=0.0
    )
    uncorrected = [] if plain is None else bounces(*plain)
    return [
        Bounce(
            step=one.step,
            approach_m_s=one.approach_m_s,
            rebound_m_s=one.rebound_m_s,
            effective_restitution=one.restitution,
            apex_m=one.apex_m,
            predicted_apex_m=float(predicted_m[number]),
            uncorrected_apex_m=uncorrected[number].apex_m if number < len(uncorrected) else None,
            correction_m_s=one.rebound_m_s - asked * one.approach_m_s,
        )
        for number, one in enumerate(found)
    ]


def pair_restitution(engine: Mapping[str, Any]) -> float:
    """Return the restitution of body and floor together: the product of the two."""
    return float((engine["restitution"] or 0.0) * (engine["floor_restitution"] or 0.0))
