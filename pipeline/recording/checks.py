"""What is asked of a recording before it is believed, and what is said of one that fails."""

from __future__ import annotations

import contextlib
import math
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import RecordingError
from pipeline.fields import shown
from pipeline.recording import rrd, schema
from pipeline.report import LARGEST, EngineReport
from pipeline.scenario import STANDARD_CAMERA, Camera, Scenario
from pipeline.states import BASE, BODY, FLOOR

SINGLE = 2.0**-22
"""Relative rounding of what an engine with float32 is given and reports."""
BULLET_REPORTS = (
    "solver_iterations", "lateral_friction", "rolling_friction", "spinning_friction", "restitution",
    "collision_margin_m", "pybullet_api",
)  # fmt: skip
"""What PyBullet says of itself in every recording of it."""


def damaged(path: Path, what: str) -> RecordingError:
    """Return the error for a recording that is not what was written."""
    return RecordingError(f"{path} is damaged: {what}; {again(path)}")


def again(path: Path) -> str:
    """Return what to try where a recording is of no use: the command that makes one of its kind."""
    first = None
    with contextlib.suppress(rrd.DamagedError, OSError):
        first = next(rrd.chunks(path, unfinished=True), None)
    of_script = first is not None and first.entity == f"__properties/{schema.ORIGIN_PROPERTY}"
    return f"record it again with: drop {'record' if of_script else 'simulate'}"


def check_engine(engine: EngineReport, scenario: Scenario, path: Path) -> None:
    """Check that the engine reports what its scenario says, and a body that can fall.

    Raises
    ------
    RecordingError
        If it does not.
    """
    if not engine.mass_kg > 0:
        raise damaged(path, f"its body must have a mass, got {engine.mass_kg:g} kg")
    links = 1 + engine.joints
    masses_kg, moments = engine.link_masses_kg, engine.link_inertias_kg_m2
    if (len(masses_kg), len(moments)) != (links, 3 * links):
        raise damaged(path, f"its engine must report masses and inertias of {links} links")
    if engine.mass_kg != math.fsum(masses_kg) or engine.inertia_kg_m2 != moments[:3]:
        raise damaged(path, "its engine reports another mass or inertia of the body than of links")
    if scenario.engine == "bullet":
        for name in (*BULLET_REPORTS, *["floor_restitution"] * scenario.floor):
            if getattr(engine, name) is None:
                raise damaged(path, f"its engine must report {name}, and does not")
    told = (scenario.timestep_s, 0.0, 0.0, scenario.effective_gravity_m_s2)
    reported = (engine.timestep_s, *engine.gravity_m_s2)
    rounding = SINGLE if scenario.engine == "physx" else 0.0
    if not all(
        math.isclose(one, other, rel_tol=rounding)
        for one, other in zip(reported, told, strict=True)
    ):
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
        rounding = SINGLE if scenario.engine == "physx" else 1e-9
        near = math.isclose(reported[name] or 0.0, value or 0.0, rel_tol=rounding)
        if value is not None and not near:
            raise damaged(
                path, f"its scenario says that {name} is {value:g}, its engine {reported[name]}"
            )


def check_camera(camera: Camera, path: Path) -> None:
    """Check what no option says of the camera, which `Camera` does not."""
    for name in {field.name for field in fields(Camera)} - Camera.options().keys():
        value, standard = (np.asarray(getattr(one, name)) for one in (camera, STANDARD_CAMERA))
        if value.dtype.kind not in "if" or value.shape != standard.shape:
            raise damaged(path, f"its camera says that {name} is {shown(getattr(camera, name))}")


# -- states ---------------------------------------------------------------------------------------

_COLUMNS = schema.STATES.columns
_MOTION = tuple(name for names in _COLUMNS.values() if len(names) > 1 for name in names)

ROUNDING = 1e-12
"""Of a release, which is recorded as it was given."""
UNIT = 1e-6
"""How far an orientation may be from a quaternion of length 1, which Bullet makes it each step."""


def check_parts(states: pl.DataFrame, engine: EngineReport, path: Path) -> None:
    """Check that every sample from the first on is there, with each part of the body once."""
    parts = 1 + engine.joints
    if not 1 <= parts <= len(states):
        raise damaged(path, f"its engine reports {engine.joints:,} joints")
    samples, rest = divmod(len(states), parts)
    due = {
        "step": np.repeat(np.arange(samples), parts),
        "body": np.full(samples * parts, BODY),
        "link": np.tile(np.arange(BASE, engine.joints), samples),
    }
    same = (np.array_equal(states[name].to_numpy(), column) for name, column in due.items())
    if rest or not all(same):
        said = "steps 0, 1, 2, … once each" + (f", {parts} parts in each" if parts > 1 else "")
        raise damaged(path, f"it must hold {said}, and does not")


def check_states(states: pl.DataFrame, scenario: Scenario, path: Path) -> None:
    """Check that states are numbers, and those of a body that was released as the scenario says."""
    steps = states["step"].to_numpy()
    _refuse(path, "state", steps, _no_number(states), f"is not a number up to {LARGEST:g}")
    length = np.linalg.norm(states.select(_COLUMNS["orientation"]).to_numpy(), axis=1)
    no_turn = ~(np.abs(length - 1) <= UNIT)
    _refuse(path, "state", steps, no_turn, "has an orientation that cannot be")

    release = {
        "position_m": (0, 0, scenario.height_m),
        "orientation": scenario.orientation_xyzw,
        "velocity_m_s": scenario.velocity_m_s,
        "spin_rad_s": scenario.spin_rad_s,
    }
    for component, value in release.items():
        given, found = np.array(value), np.array(states.select(_COLUMNS[component]).row(0))
        if component == "orientation" and found @ given < 0:  # its negative is the same orientation
            found = -found
        rounding = ROUNDING if scenario.engine != "physx" else SINGLE
        off = ~(np.abs(found - given) <= rounding * np.maximum(1, np.abs(given)))
        _refuse(path, "state", steps[:1], [off.any()], "is not the release that its scenario says")
    if not scenario.stepped:
        parts = states.filter(pl.col("step") == 0).select(_MOTION).to_numpy()
        motion = states.select(_MOTION).to_numpy().reshape(-1, *parts.shape)
        moves = (motion != parts).any(axis=2).ravel()
        _refuse(
            path, "state", steps, moves, "differs from the first, and its scenario takes no step"
        )


def check_contacts(
    contacts: pl.DataFrame, scenario: Scenario, engine: EngineReport, samples: int, path: Path
) -> None:
    """Check that contacts are numbers, of parts that there are, and of steps that were taken."""
    steps = contacts["step"].to_numpy()
    _refuse(path, "contact", steps, _no_number(contacts), f"is not a number up to {LARGEST:g}")
    sides = [
        (contacts[f"body_{side}"].to_numpy(), contacts[f"link_{side}"].to_numpy()) for side in "ab"
    ]
    known = np.ones(len(steps), dtype=bool)
    for body, link in sides:
        of_floor = (body == FLOOR) & (link == BASE) & scenario.floor
        known &= ((body == BODY) & (link >= BASE) & (link < engine.joints)) | of_floor
    (body_a, link_a), (body_b, link_b) = sides
    known &= (body_a != body_b) | (link_a != link_b)
    _refuse(path, "contact", steps, ~known, "is not one of two parts that its scenario has")
    taken = (steps > 0) & (steps < samples) & scenario.stepped
    _refuse(path, "contact", steps, ~taken, "is there, and no step led to it")


def _no_number(table: pl.DataFrame) -> NDArray[np.bool_]:
    """Return which rows have a number that is none, or is too large."""
    wrong = np.zeros(len(table), dtype=bool)
    for column in table.iter_columns():
        if column.dtype == pl.Float64:
            wrong |= ~(np.abs(column.to_numpy()) <= LARGEST)
    return wrong


def _refuse(path: Path, what: str, steps: NDArray[np.int64], wrong: ArrayLike, why: str) -> None:
    rows = np.flatnonzero(np.asarray(wrong))
    if len(rows):
        raise damaged(path, f"its {what} at step {steps[rows[0]]} {why}")
