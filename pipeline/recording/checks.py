"""What is asked of a recording before it is believed, and what is said of one that fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import RecordingError
from pipeline.scenario import Scenario

AGAIN = "record it again with: drop simulate"


def damaged(path: Path, what: str) -> RecordingError:
    """Return the error for a recording that is not what was written."""
    return RecordingError(f"{path} is damaged: {what}; {AGAIN}")


def check_engine(engine: Mapping[str, Any], scenario: Scenario, path: Path) -> None:
    """Check that the engine reports what its scenario says, and what the analysis asks it for."""
    for name, is_right in _ENGINE.items():
        if not is_right(engine.get(name)):
            raise damaged(path, f"its engine must report {name}, got {engine.get(name)!r}")
    if scenario.floor and not _is_number(engine.get("floor_restitution")):
        raise damaged(path, "its engine must report floor_restitution, and does not")
    gravity_m_s2 = [0.0, 0.0, scenario.effective_gravity_m_s2]
    if (engine["timestep_s"], engine["gravity_m_s2"]) != (scenario.timestep_s, gravity_m_s2):
        raise damaged(path, "its engine reports another timestep or gravity than its scenario")


def _is_number(value: object) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _is_vector(value: object) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))


_ENGINE: dict[str, Callable[[Any], bool]] = {
    "timestep_s": _is_number,
    "gravity_m_s2": _is_vector,
    "mass_kg": lambda value: _is_number(value) and value > 0,
    "inertia_kg_m2": _is_vector,
    "restitution": _is_number,
    "rest_height_m": _is_number,
    "joints": lambda value: isinstance(value, int) and value >= 0,
    "shape": lambda value: isinstance(value, str),
}
"""What the analysis asks the engine's report for, and when it is an answer."""
