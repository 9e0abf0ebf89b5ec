"""Validation: the simple pendulum of the IFToMM multibody benchmark (A01), against exact motion.

And verification: PyBullet's steps of it are the tree's sum, so its error is the terms' it names.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import some
from drop_physics.physics.tree import BASE
from generators import pendulum
from generators.pages import DOCS
from generators.pendulum import DAMPING, Error, G
from scipy.integrate import solve_ivp
from trees import Watched, described, engine, load, motors_off, run


@pytest.fixture(scope="module", params=some([0.0, DAMPING], 1), ids=["off", "default"])
def found(request: pytest.FixtureRequest) -> list[Error]:
    return pendulum.errors(request.param)


def test_the_exact_motion_solves_its_equation() -> None:
    times = np.linspace(0, 10, 400)
    solved = solve_ivp(
        lambda _, y: (y[1], G * math.cos(y[0])),
        (0, 10),
        (0.0, 0.0),
        "DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-13,
    )
    assert pendulum.exact(times) == pytest.approx(solved.y[0], abs=1e-10)


def test_the_error_is_what_its_causes_make(found: list[Error]) -> None:
    for one in found:
        assert sum(one.terms_m.values()) == pytest.approx(one.largest_m, abs=1e-14)
        assert abs(one.terms_m["rounding"]) <= 1e-12


def test_without_damping_the_error_is_the_timesteps_and_of_first_order() -> None:
    found = pendulum.errors(0.0)
    assert [one.largest_m for one in found] == pytest.approx(
        [9.228e-3, 2.215e-3, 5.537e-4], rel=2e-4
    )
    for one in found:
        assert one.terms_m["timestep"] == pytest.approx(one.largest_m, abs=1e-12)
        assert one.terms_m["damping"] == one.terms_m["interaction"] == 0
    assert pendulum.observed_orders(found) == pytest.approx([1, 1], abs=1e-3)


def test_with_damping_the_error_is_the_dampings_and_no_timestep_helps() -> None:
    found = pendulum.errors(DAMPING)
    assert [one.largest_m for one in found] == pytest.approx([1.763, 1.762, 1.762], abs=6e-4)
    for one in found:
        assert one.terms_m["damping"] == pytest.approx(one.largest_m, abs=2e-3)
    assert pendulum.observed_orders(found) == pytest.approx([0, 0], abs=2e-3)
    timestep, interaction = (
        [one.terms_m[cause] for one in found] for cause in ("timestep", "interaction")
    )
    for values in (timestep, interaction):  # both of first order
        assert values[0] / values[1] == pytest.approx(1000 / 240, rel=0.06)
        assert values[1] / values[2] == pytest.approx(4, rel=0.02)


def test_the_steps_of_the_pendulum_are_the_trees_sum(tmp_path: pytest.TempPathFactory) -> None:
    """The energy loss is due to damping, except for the integrator's share."""
    path = tmp_path / "pendulum.urdf"  # type: ignore[operator]
    path.write_text(pendulum.URDF)
    with engine():
        import pybullet as p

        body = load(str(path), fixed=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
        motors_off(body)
        watched = Watched(body, described(body))
        run([watched], 2400)
        found = watched.sum()
    assert found.unexplained.max() <= 1e-11
    assert found.matrices[:, 0, 0] == pytest.approx(1.0, abs=1e-15)
    energy = {cause: values.sum() for cause, values in found.energy_j().items()}
    end = watched.states()
    kinetic = 0.5 * end.velocity[-1, 0] ** 2
    lost = kinetic + G * watched.kinematics().position_m(0)[-1, 2]
    assert watched.law.tree.parents == (BASE,)
    assert sum(energy.values()) == pytest.approx(lost, abs=1e-12)
    assert energy["damping"] == pytest.approx(lost, rel=0.02)


def test_the_page_shows_these_figures() -> None:
    assert pendulum.rows() in (DOCS / "validation.md").read_text(encoding="utf-8")
