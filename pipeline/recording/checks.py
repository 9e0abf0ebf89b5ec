"""What is asked of a recording before it is believed, and what is said of one that fails."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import RecordingError
from pipeline.fields import shown
from pipeline.recording import schema
from pipeline.report import LARGEST, EngineReport
from pipeline.scenario import STANDARD_CAMERA, Camera, Scenario

Float64 = NDArray[np.float64]

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


def check_settings(engine: EngineReport, scenario: Scenario, path: Path) -> None:
    """Check that the engine reports the settings that the scenario gives it.

    Not the mass of a body with links, of which `--mass` is one.

    Raises
    ------
    RecordingError
        If it does not.
    """
    if engine.shape == "box" and len(engine.shape_dimensions_m) != 3:
        raise damaged(path, "its engine must report three shape_dimensions_m of a box")
    reported = asdict(engine)
    given: dict[str, float | None] = {
        "solver_iterations": scenario.solver_iterations,
        "restitution": scenario.restitution,
        "lateral_friction": scenario.friction,
        "substeps": scenario.substeps,
    }
    if scenario.floor:
        given["floor_restitution"] = scenario.restitution
        given["floor_lateral_friction"] = scenario.friction
    if engine.joints == 0:
        given["mass_kg"] = scenario.mass_kg
    for name, value in given.items():
        # The engine keeps the inverse of a mass.
        if value is not None and not math.isclose(reported[name] or 0.0, value):
            raise damaged(
                path, f"its scenario says that {name} is {value:g}, its engine {reported[name]}"
            )


def check_camera(camera: Camera, path: Path) -> None:
    """Check what no option says of the camera, which `Camera` does not."""
    for name in schema.CAMERA_SAYS:
        value, standard = (np.asarray(getattr(one, name)) for one in (camera, STANDARD_CAMERA))
        if value.dtype.kind not in "if" or value.shape != standard.shape:
            raise damaged(path, f"its camera says that {name} is {shown(getattr(camera, name))}")


# -- states ---------------------------------------------------------------------------------------

_COLUMN = {name: number for number, name in enumerate(schema.state_columns(0))}
_ORIENTATION = slice(_COLUMN["qx"], _COLUMN["qw"] + 1)
_MOTION = slice(0, _COLUMN["contact_points"])

ROUNDING = 1e-12
"""Of a release, which is recorded as it was given."""
UNIT = 1e-6
"""How far an orientation may be from a quaternion of length 1, which Bullet makes it each step."""


def check_states(rows: Float64, scenario: Scenario, path: Path) -> None:
    """Check that samples are numbers, and those of a body that was released as the scenario says.

    `rows` have the columns of `schema.state_columns`.
    """
    is_number = np.abs(rows) <= LARGEST
    points, force_n = (rows[:, _COLUMN[name]] for name in ("contact_points", "contact_force_n"))
    distance, touches = _COLUMN["contact_distance_m"], points > 0
    # The distance to the floor is nan where there is no contact, and only there.
    is_number[:, distance] = np.where(touches, is_number[:, distance], np.isnan(rows[:, distance]))
    _refuse(path, (~is_number).any(axis=1), f"is not a number up to {LARGEST:g}")
    none, whole = (points == 0) & (force_n == 0), points == np.round(points)
    _refuse(path, ~(none | (touches & whole)), "has a contact that cannot be")
    _refuse(path, touches[:1], "has a contact, and no step led to it")
    if not scenario.floor:
        _refuse(path, touches, "has a contact, and its scenario no floor")
    length = np.linalg.norm(rows[:, _ORIENTATION], axis=1)
    _refuse(path, ~(np.abs(length - 1) <= UNIT), "has an orientation that cannot be")

    release = np.array(
        (
            *(0, 0, scenario.height_m),
            *scenario.orientation_xyzw,
            *scenario.velocity_m_s,
            *scenario.spin_rad_s,
        )
    )
    first = rows[:1, _MOTION].copy()
    if first[0, _ORIENTATION] @ release[_ORIENTATION] < 0:  # its negative is the same orientation
        first[0, _ORIENTATION] *= -1
    off = ~(np.abs(first - release) <= ROUNDING * np.maximum(1, np.abs(release)))
    _refuse(path, off.any(axis=1), "is not the release that its scenario says")
    if not scenario.stepped:
        moves = ~((rows == rows[0]) | (np.isnan(rows) & np.isnan(rows[0]))).all(axis=1)
        _refuse(path, moves, "differs from the first, and its scenario takes no step")


def _refuse(path: Path, wrong: ArrayLike, why: str) -> None:
    steps = np.flatnonzero(np.asarray(wrong))
    if len(steps):
        raise damaged(path, f"its state at step {steps[0]} {why}")
