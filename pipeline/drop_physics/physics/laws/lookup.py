"""Chooses the integration rule of the engine that made a recording."""

from __future__ import annotations

from typing import Any

from drop_physics.engine_report import EngineReport
from drop_physics.physics.base import Drag, Law
from drop_physics.physics.laws.bullet.air import effective_damping
from drop_physics.physics.laws.bullet.law import BulletLaw, drag_of
from drop_physics.physics.laws.bullet.step import BULLET
from drop_physics.physics.laws.mujoco.law import MujocoLaw
from drop_physics.physics.step_law import StepLaw
from drop_physics.physics.theory import TheoreticalFall
from drop_physics.scenario import Scenario

STEP_LAWS = {"PyBullet": BULLET}
"""Integration rules of engines that do not report every impulse of a step, by engine name."""


def step_law(engine: str) -> StepLaw | None:
    """Return the integration rule of an engine for trees; None if the engine reports all causes."""
    return STEP_LAWS.get(engine.partition(" ")[0])


def fall_of(scenario: Scenario) -> TheoreticalFall:
    """Return a scenario's release state and drag, as the engine represents them."""
    if scenario.engine == "bullet":
        damping = effective_damping(scenario.linear_damping, scenario.coordinates)
        drag = drag_of(damping, scenario.coordinates)
    else:
        drag = Drag(0.0, 0.0)
    return TheoreticalFall(
        position_m=(0.0, 0.0, scenario.height_m),
        velocity_m_s=scenario.velocity_m_s,
        gravity_m_s2=scenario.effective_gravity_m_s2,
        drag=drag,
    )


def law_for(scenario: Scenario, report: EngineReport) -> Law:
    """Return the integration rule of one rigid body in the air, under the engine's settings."""
    body: dict[str, Any] = {
        "timestep_s": scenario.timestep_s,
        "gravity_m_s2": (0.0, 0.0, scenario.effective_gravity_m_s2),
        "mass_kg": report.mass_kg,
        "inertia_kg_m2": report.inertia_kg_m2,
    }
    if scenario.engine == "mujoco":
        assert scenario.effective_integrator is not None
        return MujocoLaw(**body, integrator=scenario.effective_integrator)
    return BulletLaw(
        **body,
        substeps=scenario.substeps or 1,
        linear_damping=effective_damping(scenario.linear_damping, scenario.coordinates),
        angular_damping=effective_damping(scenario.angular_damping, scenario.coordinates),
        coordinates=scenario.coordinates,
    )


RIGID = 1
"""PyBullet's constant for a btRigidBody."""
