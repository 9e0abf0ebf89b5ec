"""Verification: a falling, spinning body moves as in PyBullet, bit for bit on x86-64.

sin, cos and pow are the C library's, here and in the engine.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import some
from drop_physics.engines.pybullet.world import World
from drop_physics.physics.base import Motion
from drop_physics.physics.laws.bullet.air import effective_damping
from drop_physics.physics.laws.bullet.law import BulletLaw
from drop_physics.physics.laws.lookup import law_for
from drop_physics.scenario import Scenario
from engine import MODES, ROUNDS_ONCE, box, drive, urdf_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from iterated import airborne, law_of, tumbling

STEPS, TIMESTEP_S = 120, 1 / 240


@pytest.mark.parametrize("coordinates", some(MODES, 2))
@pytest.mark.parametrize("damping", [None, 0.0, 0.5])
# The light body's Jacobian has a determinant below SIMD_EPSILON, and the fast one turns too far.
@pytest.mark.parametrize("inertia", [(1e-3, 2e-3, 2.5e-3), (1e-6, 2e-6, 3e-6)])
def test_the_spin_is_pybullets(coordinates: Any, damping: float | None, inertia: Any) -> None:
    coefficient = effective_damping(damping, coordinates)
    still, fast = (0.0, 0.0, 0.0), (40.0, -120.0, 3.0)
    for velocity, spin in (
        (still, (1e-4, 0.0, 0.0)),
        (still, (1.0, 2.0, 3.0)),
        (fast, (20.0, -3.0, 0.1)),
        (fast, (0.0, 150.0, 90.0)),
        (still, (300.0, 1.0, 0.0)),
    ):
        seen = drive(
            samples=STEPS + 1,
            floor=False,
            velocity_m_s=velocity,
            spin_rad_s=spin,
            coordinates=coordinates,
            dynamics={
                "linearDamping": coefficient,
                "angularDamping": coefficient,
                # Told an inertia alone, a btRigidBody takes as its mass what lies in the command's
                # memory: letters of the path of the URDF (PhysicsServerCommandProcessor.cpp 11106).
                "localInertiaDiagonal": inertia,
                "mass": 0.1,
            },
        )
        law = law_of(
            mass_kg=seen.mass_kg,
            inertia_kg_m2=inertia,
            linear_damping=coefficient,
            angular_damping=coefficient,
            coordinates=coordinates,
        )
        found = tumbling(law, STEPS, spin_rad_s=spin, velocity_m_s=velocity)
        for name in ("position_m", "velocity_m_s", "spin_rad_s"):
            expected, engine = getattr(found, name), getattr(seen, name)
            if ROUNDS_ONCE:
                np.testing.assert_array_equal(expected, engine)
            else:
                np.testing.assert_allclose(expected, engine, rtol=1e-9, atol=1e-9)
        same_way = np.sum(found.orientation * seen.orientation_xyzw, axis=1)
        assert np.abs(same_way) == pytest.approx(1, abs=1e-14 if ROUNDS_ONCE else 1e-9)


@pytest.mark.parametrize("coordinates", MODES)
def test_without_spin_it_is_the_fall(coordinates: Any) -> None:
    law, velocity = law_of(linear_damping=0.04, coordinates=coordinates), (1.0, 2.0, 3.0)
    still = tumbling(law, STEPS, spin_rad_s=(0.0, 0.0, 0.0), velocity_m_s=velocity)
    position_m, velocity_m_s = airborne(law, STEPS, velocity_m_s=velocity)
    assert (still.position_m == position_m).all()
    assert (still.velocity_m_s == velocity_m_s).all()


# -- of any scenario -------------------------------------------------------------------------------


def orientations() -> st.SearchStrategy[Any]:
    angle, part = st.floats(-180, 180), st.floats(-1, 1)
    some = st.tuples(part, part, part, part).filter(lambda q: sum(x * x for x in q) > 0.01)
    return st.one_of(st.just((0.0, 0.0, 0.0)), st.tuples(angle, angle, angle), some)


def vectors(largest: float) -> st.SearchStrategy[Any]:
    part = st.floats(-largest, largest)
    return st.one_of(st.just((0.0, 0.0, 0.0)), st.tuples(part, part, part))


SCENARIOS = st.fixed_dictionaries(
    {
        "orientation": orientations(),
        "spin_rad_s": vectors(150),
        "velocity_m_s": vectors(150),
        "substeps": st.sampled_from([None, 1, 2, 3, 7, 10]),
        "timestep_s": st.sampled_from([1 / 60, 1 / 240, 1 / 1000]),
        "coordinates": st.sampled_from(MODES),
        "mass_kg": st.one_of(st.none(), st.floats(1e-9, 1e6)),
        "linear_damping": st.one_of(st.none(), st.floats(0, 1)),
        "angular_damping": st.one_of(st.none(), st.floats(0, 1)),
        "gravity_m_s2": st.sampled_from([-9.81, 0.0, 3.0]),
    }
)
STEPS_OF_ANY = 40


def driven(scenario: Scenario, inertia_kg_m2: Any) -> Any:
    """Return PyBullet's own motion for a scenario, without any of our code."""
    named = {
        "mass": scenario.mass_kg,
        "linearDamping": scenario.linear_damping,
        "angularDamping": scenario.angular_damping,
    }
    dynamics = {name: value for name, value in named.items() if value is not None}
    if scenario.mass_kg is not None:  # the URDF's inertia, scaled: a box of 1 kg, m (b² + c²)/12
        dynamics["localInertiaDiagonal"] = inertia_kg_m2
    return drive(
        body=scenario.body,
        samples=STEPS_OF_ANY + 1,
        floor=False,
        dynamics=dynamics,
        engine={"numSubSteps": scenario.substeps or 0},
        timestep_s=scenario.timestep_s,
        height_m=scenario.height_m,
        velocity_m_s=scenario.velocity_m_s,
        spin_rad_s=scenario.spin_rad_s,
        orientation_xyzw=scenario.orientation_xyzw,
        gravity_m_s2=scenario.gravity_m_s2,
        coordinates=scenario.coordinates,
    )


def law_for_world(scenario: Scenario) -> BulletLaw:
    with World(scenario) as world:
        return law_for(scenario, world.report())


def flight_of(scenario: Scenario, law: BulletLaw) -> Motion:
    return tumbling(
        law,
        STEPS_OF_ANY,
        spin_rad_s=scenario.spin_rad_s,
        velocity_m_s=scenario.velocity_m_s,
        height_m=scenario.height_m,
        orientation=scenario.orientation_xyzw,
    )


@pytest.fixture(scope="module")
def brick(tmp_path_factory: pytest.TempPathFactory) -> str:
    return urdf_of(tmp_path_factory.mktemp("brick"), box("0.1 0.2 0.3"))


@pytest.mark.long
@settings(
    max_examples=25,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(how=SCENARIOS)
def test_the_law_of_any_scenario_is_pybullets(brick: str, how: dict[str, Any]) -> None:
    scenario = Scenario(body=brick, floor=False, **how)
    with World(scenario) as world:
        report = world.report()
    law = flight_of(scenario, law_for(scenario, report))
    engine = driven(scenario, report.inertia_kg_m2)
    for name in ("position_m", "velocity_m_s", "spin_rad_s"):
        if ROUNDS_ONCE:
            np.testing.assert_array_equal(getattr(law, name), getattr(engine, name))
        else:
            np.testing.assert_allclose(getattr(law, name), getattr(engine, name), rtol=1e-9)
    same_way = np.sum(law.orientation * engine.orientation_xyzw, axis=1, keepdims=True)
    turned = np.where(same_way < 0, -law.orientation, law.orientation)
    atol = 0 if ROUNDS_ONCE else 1e-9
    np.testing.assert_allclose(turned, engine.orientation_xyzw, rtol=0, atol=atol)


# -- the limit of ±100 -----------------------------------------------------------------------------

FAST: Any = {"linear_damping": 0.0, "angular_damping": 0.0, "floor": False}


@pytest.mark.parametrize(
    ("how", "first"),
    [
        # v = -99 - 9.81 i / 240 falls below -100 in step 25, and stays there.
        ({"velocity_m_s": (0.0, 0.0, -99.0)}, 25),
        ({"velocity_m_s": (0.0, 0.0, -99.0), "substeps": 2}, 25),
        ({"velocity_m_s": (0.0, 0.0, -99.0), "coordinates": "maximal"}, None),
        # Exactly 100 is the limit and not beyond it.
        ({"velocity_m_s": (100.0, 0.0, 0.0)}, None),
        ({"velocity_m_s": (0.0, -100.1, 0.0)}, 1),
        ({"spin_rad_s": (120.0, 0.0, 0.0)}, 1),
        ({"spin_rad_s": (99.0, 0.0, 0.0)}, None),
        # The drag of a timestep, 4.5 m/s, leaves less than 100; that of its first substep does not.
        ({"velocity_m_s": (0.0, 104.0, 0.0), "linear_damping": 0.1}, None),
        ({"velocity_m_s": (0.0, 104.0, 0.0), "linear_damping": 0.1, "substeps": 10}, 1),
    ],
)
def test_the_first_sample_that_the_limit_acts_on_is_known(how: Any, first: int | None) -> None:
    scenario = Scenario(**(FAST | how))
    law = law_for_world(scenario)
    held = np.flatnonzero(law.limited(flight_of(scenario, law)))
    assert (int(held[0]) + 1 if len(held) else None) == first
