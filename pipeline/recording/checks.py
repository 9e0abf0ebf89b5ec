"""What is asked of a recording before it is believed, and what is said of one that fails."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import RecordingError
from pipeline.physics.report import EngineReport
from pipeline.scenario import Scenario

AGAIN = "record it again with: drop simulate"


def damaged(path: Path, what: str) -> RecordingError:
    """Return the error for a recording that is not what was written."""
    return RecordingError(f"{path} is damaged: {what}; {AGAIN}")


def check_engine(engine: EngineReport, scenario: Scenario, path: Path) -> None:
    """Check that the engine reports what its scenario says, and a body that can fall.

    Raises
    ------
    RecordingError
        If it does not.
    """
    if not engine.mass_kg > 0:
        raise damaged(path, f"its body must have a mass, got {engine.mass_kg:g} kg")
    if scenario.floor and engine.floor_restitution is None:
        raise damaged(path, "its engine must report floor_restitution, and does not")
    gravity_m_s2 = (0.0, 0.0, scenario.effective_gravity_m_s2)
    if (engine.timestep_s, engine.gravity_m_s2) != (scenario.timestep_s, gravity_m_s2):
        raise damaged(path, "its engine reports another timestep or gravity than its scenario")
