"""Which law a recording's engine follows: the one place that knows."""

from __future__ import annotations

from pipeline.laws.bullet import BulletLaw, drag_of
from pipeline.laws.bullet_air import effective_damping
from pipeline.laws.theory import Fall
from pipeline.report import EngineReport
from pipeline.scenario import Scenario


def fall_of(scenario: Scenario) -> Fall:
    """Return the release and the air of a scenario, as the engine has them."""
    damping = effective_damping(scenario.linear_damping, scenario.coordinates)
    return Fall(
        position_m=(0.0, 0.0, scenario.height_m),
        velocity_m_s=scenario.velocity_m_s,
        gravity_m_s2=scenario.effective_gravity_m_s2,
        drag=drag_of(damping, scenario.coordinates),
    )


def law_for(scenario: Scenario, report: EngineReport) -> BulletLaw:
    """Return the law of one rigid body that nothing touches, as the engine has been told."""
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
