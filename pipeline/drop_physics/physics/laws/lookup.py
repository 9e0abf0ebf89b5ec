"""Find the law that a recording's engine follows."""

from __future__ import annotations

from typing import Any

from drop_physics.engine_report import EngineReport
from drop_physics.physics.base import Drag, Law
from drop_physics.physics.laws.bullet.air import effective_damping
from drop_physics.physics.laws.bullet.law import BulletLaw, drag_of
from drop_physics.physics.laws.bullet.step import BULLET
from drop_physics.physics.laws.dart import DartLaw
from drop_physics.physics.laws.drake import DrakeLaw
from drop_physics.physics.laws.mujoco.law import MujocoLaw
from drop_physics.physics.laws.physx import DEFAULT_ANGULAR_DAMPING, PhysxLaw
from drop_physics.physics.step_law import StepLaw
from drop_physics.physics.theory import TheoreticalFall
from drop_physics.scenario import EXACT_INTEGRATORS, Scenario

STEP_LAWS = {"PyBullet": BULLET}
"""Laws of engines that do not report what acted in a step, by the engine's name."""


def step_law(engine: str) -> StepLaw | None:
    """Return how an engine steps a tree; None where it says itself what acted in each step."""
    return STEP_LAWS.get(engine.partition(" ")[0])


def fall_of(scenario: Scenario) -> TheoreticalFall:
    """Return the release and the drag of a scenario, as the engine has them."""
    if scenario.engine == "bullet":
        damping = effective_damping(scenario.linear_damping, scenario.coordinates)
        drag = drag_of(damping, scenario.coordinates)
    else:
        drag = Drag(scenario.linear_damping or 0.0, 0.0)
    return TheoreticalFall(
        position_m=(0.0, 0.0, scenario.height_m),
        velocity_m_s=scenario.velocity_m_s,
        gravity_m_s2=scenario.effective_gravity_m_s2,
        drag=drag,
    )


def law_for(scenario: Scenario, report: EngineReport) -> Law:
    """Return the law of one rigid body in the air, with the engine's settings."""
    if scenario.engine != "bullet":
        return _textbook_law(scenario, report)
    return BulletLaw(
        timestep_s=scenario.timestep_s,
        substeps=scenario.substeps or 1,
        gravity_m_s2=(0.0, 0.0, scenario.effective_gravity_m_s2),
        mass_kg=report.mass_kg,
        inertia_kg_m2=report.inertia_kg_m2,
        linear_damping=effective_damping(scenario.linear_damping, scenario.coordinates),
        angular_damping=effective_damping(scenario.angular_damping, scenario.coordinates),
        coordinates=scenario.coordinates,
    )


def _textbook_law(scenario: Scenario, report: EngineReport) -> Law:
    integrator = scenario.effective_integrator
    body: dict[str, Any] = {
        "timestep_s": scenario.timestep_s,
        "gravity_m_s2": (0.0, 0.0, scenario.effective_gravity_m_s2),
        "mass_kg": report.mass_kg,
        "inertia_kg_m2": report.inertia_kg_m2,
        "linear_damping": scenario.linear_damping or 0.0,
        "semi_implicit": integrator not in EXACT_INTEGRATORS,
    }
    if scenario.engine == "mujoco":
        assert integrator is not None
        return MujocoLaw(**body, integrator=integrator)
    if scenario.engine == "physx":
        damping = scenario.angular_damping
        return PhysxLaw(
            **body, angular_damping=DEFAULT_ANGULAR_DAMPING if damping is None else damping
        )
    if scenario.engine == "dart":
        return DartLaw(**body)
    return DrakeLaw(**body, latest_s=scenario.duration_s)


RIGID = 1
"""PyBullet's number for a btRigidBody."""
