"""Impact, contact, bounces and rest: what the recording shows beside what Bullet's law predicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.budget.phases import Phases, crossing_time
from pipeline.budget.results import Bounce, Contact, Impact, Rest, RestTerms
from pipeline.physics import contact_law, theory
from pipeline.physics.contact_law import CONTACT_SLOP_M, DEFAULT_CONTACT_ERP
from pipeline.physics.theory import Fall
from pipeline.scenario import Scenario

Float64 = NDArray[np.float64]


def find_impact(
    scenario: Scenario,
    engine: Mapping[str, Any],
    fall: Fall,
    found: Phases,
    height_m: Float64,
    velocity_m_s: Float64,
) -> Impact | None:
    """Return when the body meets the floor, or None if it never does.

    `height_m` has shape (samples,), `velocity_m_s` (samples, 3).
    """
    if found.contact_step is None:
        return None
    rest_height_m = engine["rest_height_m"]
    lowest = int(np.argmin(height_m))
    return Impact(
        time_free_fall_s=theory.impact_time_free(fall, rest_height_m),
        time_damped_s=theory.impact_time_damped(fall, rest_height_m),
        time_simulated_s=crossing_time(height_m, rest_height_m, scenario.timestep_s),
        step=found.contact_step,
        speed_m_s=float(abs(velocity_m_s[max(found.contact_step - 1, 0), 2])),
        lowest_m=float(height_m[lowest]),
        lowest_step=lowest,
        penetration_m=max(0.0, rest_height_m - float(height_m[lowest])),
    )


def contact_law_heights(
    scenario: Scenario, engine: Mapping[str, Any], fall: Fall, *, steps: int
) -> Float64 | None:
    """Return the heights that the contact law predicts, shape (steps + 1,).

    None where the law does not hold: it is that of one rigid box in reduced coordinates that lands
    flat, without spin or sideways velocity.
    """
    flat = not any((*scenario.velocity_m_s[:2], *scenario.spin_rad_s))
    rigid_box = engine["shape"] == "box" and not engine["joints"]
    if not (flat and rigid_box and scenario.floor and scenario.stepped):
        return None
    if scenario.coordinates != "reduced":
        return None
    heights_m, _ = contact_law.flat_drop(
        fall,
        timestep_s=scenario.timestep_s,
        steps=steps,
        mass_kg=engine["mass_kg"],
        rest_height_m=engine["rest_height_m"],
        restitution=engine["restitution"] * engine["floor_restitution"],
        contact_erp=_contact_erp(scenario),
    )
    return heights_m


def find_contact(found: Phases, height_m: Float64, law_m: Float64 | None) -> Contact | None:
    """Return how far the recorded heights are from the contact law's, or None without either."""
    if law_m is None or found.contact_step is None:
        return None
    deviation_m = np.abs(height_m - law_m)
    worst = int(np.argmax(deviation_m))
    return Contact(float(deviation_m[worst]), worst)


def find_rest(
    engine: Mapping[str, Any], found: Phases, height_m: Float64, law_m: Float64 | None
) -> Rest | None:
    """Return where the body comes to lie, and why it is not the rest height exactly."""
    if found.rest_step is None:
        return None
    last_m, expected_m = float(height_m[-1]), float(engine["rest_height_m"])
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
    scenario: Scenario,
    engine: Mapping[str, Any],
    fall: Fall,
    height_m: Float64,
    vertical_m_s: Float64,
    contact_points: Float64,
) -> list[Bounce]:
    """Return the rebounds that leave the floor again, in order.

    Each argument array has shape (samples,). A rebound that rises by less than it would in one step
    of settling is none: only those faster than the restitution threshold count.
    """
    asked = engine["restitution"] * engine.get("floor_restitution", 0.0)
    if asked == 0 or fall.gravity_m_s2 >= 0:
        return []
    gravity = -fall.gravity_m_s2
    fallen_m = fall.height_m - engine["rest_height_m"] + fall.velocity_m_s[2] ** 2 / (2 * gravity)
    touching = contact_points > 0
    landings = np.flatnonzero(touching[1:] & ~touching[:-1]) + 1
    bounces: list[Bounce] = []
    for landing in landings:
        leaves = int(landing + np.argmin(touching[landing:])) if not touching[landing:].all() else 0
        if not leaves:
            break
        approach = float(-vertical_m_s[landing - 1]) + gravity * scenario.timestep_s
        rebound = float(vertical_m_s[landing:leaves].max())
        if rebound <= 0:
            continue
        later = np.flatnonzero(touching[leaves:])
        until = leaves + int(later[0]) if len(later) else len(height_m)
        apex = leaves + int(np.argmax(height_m[leaves:until]))
        seen = apex < len(height_m) - 1
        number = len(bounces) + 1
        bounces.append(
            Bounce(
                step=leaves,
                approach_m_s=approach,
                rebound_m_s=rebound,
                effective_restitution=rebound / approach,
                apex_m=float(height_m[apex]) - engine["rest_height_m"] if seen else None,
                predicted_apex_m=asked ** (2 * number) * fallen_m,
                correction_m_s=rebound - asked * approach,
            )
        )
    return bounces


def _contact_erp(scenario: Scenario) -> float:
    return DEFAULT_CONTACT_ERP if scenario.contact_erp is None else scenario.contact_erp
