"""What a recording is checked for before it is used, and the errors of one that fails."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drop_physics.errors import RecordingError
from drop_physics.fields import counted, shown
from drop_physics.messages import Message
from drop_physics.recording import rrd, schema
from drop_physics.report import LARGEST, EngineReport
from drop_physics.scenario import STANDARD_CAMERA, Camera, Scenario
from drop_physics.trace.states import BASE, BODY, FLOOR, Rows, motion_of, numbers_of

SINGLE = 2.0**-22
"""Relative rounding of the values that an engine with float32 is given and reports."""
BULLET_REPORTS = (
    "solver_iterations",
    "lateral_friction",
    "rolling_friction",
    "spinning_friction",
    "restitution",
    "collision_margin_m",
    "pybullet_api",
)
"""What PyBullet reports in each of its recordings."""


def damaged(path: Path, what: str) -> RecordingError:
    """Return the error for a recording that is not what was written."""
    return RecordingError(
        "{path} is damaged: {what}; {again}", path=path, what=what, again=again(path)
    )


def twice(entity: str) -> Message:
    """Return what is wrong with a table that has a step twice."""
    return Message("its {entity} has a step twice", entity=entity)


def wrong_count(entity: str, count: int, name: str) -> Message:
    """Return what is wrong with rows that have another number of values."""
    return Message(
        "{entity} must hold {count} numbers for each {name}", entity=entity, count=count, name=name
    )


def again(path: Path) -> Message:
    """Return what to try if a recording is unusable: the command that makes one of its kind."""
    first = None
    with contextlib.suppress(rrd.DamagedError, OSError):
        first = next(rrd.chunks(path, unfinished=True), None)
    of_script = first is not None and first.entity == f"__properties/{schema.ORIGIN_PROPERTY}"
    if of_script:
        return Message("record it again with: drop record")
    return Message("record it again with: drop simulate")


def check_engine(engine: EngineReport, scenario: Scenario, path: Path) -> None:
    """Check that the engine reports the scenario's timestep and gravity, and a body that can fall.

    Raises
    ------
    RecordingError
        If it does not.
    """
    if not engine.mass_kg > 0:
        what = Message("its body must have a mass, got {mass:g} kg", mass=engine.mass_kg)
        raise damaged(path, what)
    links = 1 + engine.joints
    masses_kg, moments = engine.link_masses_kg, engine.link_inertias_kg_m2
    if (len(masses_kg), len(moments)) != (links, 3 * links):
        what = Message(
            "its engine must report masses and inertias of {links}", links=counted(links, "link")
        )
        raise damaged(path, what)
    if engine.mass_kg != math.fsum(masses_kg) or engine.inertia_kg_m2 != moments[:3]:
        what = Message("its engine reports another mass or inertia of the body than of its links")
        raise damaged(path, what)
    if scenario.engine == "bullet":
        for name in (*BULLET_REPORTS, *["floor_restitution"] * scenario.floor):
            if getattr(engine, name) is None:
                raise damaged(path, Message("its engine does not report {name}", name=name))
    given = (scenario.timestep_s, 0.0, 0.0, scenario.effective_gravity_m_s2)
    reported = (engine.timestep_s, *engine.gravity_m_s2)
    rounding = SINGLE if scenario.engine == "physx" else 0.0
    if not all(
        math.isclose(value, wanted, rel_tol=rounding)
        for value, wanted in zip(reported, given, strict=True)
    ):
        what = Message("its engine reports another timestep or gravity than its scenario")
        raise damaged(path, what)


def check_settings(engine: EngineReport, scenario: Scenario, path: Path) -> None:
    """Check that the engine reports the settings of its scenario.

    The mass of a body with links is not checked: `--mass` is that of one link.

    Raises
    ------
    RecordingError
        If it does not.
    """
    if engine.shape == "box" and len(engine.shape_dimensions_m) != 3:
        what = Message("its engine must report three shape_dimensions_m of a box")
        raise damaged(path, what)
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
            what = Message(
                "its scenario says that {name} is {value:g}, its engine {reported}",
                name=name,
                value=value,
                reported=reported[name],
            )
            raise damaged(path, what)


def check_camera(camera: Camera, path: Path) -> None:
    """Check the camera's fields without an option, which `Camera` does not check."""
    for name in {field.name for field in fields(Camera)} - Camera.options().keys():
        value, standard = (np.asarray(getattr(held, name)) for held in (camera, STANDARD_CAMERA))
        if value.dtype.kind not in "if" or value.shape != standard.shape:
            what = Message(
                "its camera says that {name} is {value}",
                name=name,
                value=shown(getattr(camera, name)),
            )
            raise damaged(path, what)


# -- states ---------------------------------------------------------------------------------------

ROUNDING = 1e-12
"""Tolerance of a release, which is recorded as it was given."""
UNIT = 1e-6
"""How far an orientation's length may be from 1; Bullet normalizes it each step."""


def check_parts(states: Rows, engine: EngineReport, path: Path, *, first: int) -> None:
    """Check that no sample is missing from step `first` on, and that each has every part once."""
    parts = 1 + engine.joints
    if not 1 <= parts <= len(states):
        what = Message("its engine reports {joints}", joints=counted(engine.joints, "joint"))
        raise damaged(path, what)
    samples, rest = divmod(len(states), parts)
    due = {
        "step": np.repeat(np.arange(first, first + samples), parts),
        "body": np.full(samples * parts, BODY),
        "link": np.tile(np.arange(BASE, engine.joints), samples),
    }
    same = (np.array_equal(states[name], column) for name, column in due.items())
    if rest or not all(same):
        what = Message("it must hold steps 0, 1, 2, … once each, and does not")
        if parts > 1:
            what = Message(
                "it must hold steps 0, 1, 2, … once each, {parts} parts in each, and does not",
                parts=parts,
            )
        raise damaged(path, what)


def check_states(states: Rows, released: Rows, scenario: Scenario, path: Path) -> None:
    """Check that states are numbers, and that those of step 0 are the release in the scenario."""
    steps = states["step"]
    _refuse(
        path,
        steps,
        _not_numbers(states),
        lambda step: Message(
            "its state at step {step} is not a number up to {largest:g}", step=step, largest=LARGEST
        ),
    )
    length = np.linalg.norm(states["orientation"], axis=1)
    no_turn = ~(np.abs(length - 1) <= UNIT)
    _refuse(
        path,
        steps,
        no_turn,
        lambda step: Message("its state at step {step} has an impossible orientation", step=step),
    )

    release = {
        "position_m": (0, 0, scenario.height_m),
        "orientation": scenario.orientation_xyzw,
        "velocity_m_s": scenario.velocity_m_s,
        "spin_rad_s": scenario.spin_rad_s,
    }
    for component, value in release.items():
        given, first = np.array(value), released[component][0]
        if component == "orientation" and first @ given < 0:  # its negative is the same orientation
            first = -first
        rounding = ROUNDING if scenario.engine != "physx" else SINGLE
        off = ~(np.abs(first - given) <= rounding * np.maximum(1, np.abs(given)))
        if off.any():
            what = Message("its state at step 0 is not the release in its scenario")
            raise damaged(path, what)
    if not scenario.stepped:
        parts = motion_of(released)
        motion = motion_of(states).reshape(-1, *parts.shape)
        moves = (motion != parts).any(axis=2).ravel()
        _refuse(
            path,
            steps,
            moves,
            lambda step: Message(
                "its state at step {step} differs from the first, and its scenario takes no step",
                step=step,
            ),
        )


def check_contacts(
    contacts: Rows, scenario: Scenario, engine: EngineReport, samples: int, path: Path
) -> None:
    """Check that contacts are numbers, of parts that exist, and of steps that were taken."""
    steps = contacts["step"]
    _refuse(
        path,
        steps,
        _not_numbers(contacts),
        lambda step: Message(
            "its contact at step {step} is not a number up to {largest:g}",
            step=step,
            largest=LARGEST,
        ),
    )
    sides = [(contacts[f"body_{side}"], contacts[f"link_{side}"]) for side in "ab"]
    known = np.ones(len(steps), dtype=bool)
    for body, link in sides:
        of_floor = (body == FLOOR) & (link == BASE) & scenario.floor
        known &= ((body == BODY) & (link >= BASE) & (link < engine.joints)) | of_floor
    (body_a, link_a), (body_b, link_b) = sides
    known &= (body_a != body_b) | (link_a != link_b)
    _refuse(
        path,
        steps,
        ~known,
        lambda step: Message(
            "its contact at step {step} is not between two parts of its scenario", step=step
        ),
    )
    taken = (steps > 0) & (steps < samples) & scenario.stepped
    _refuse(
        path,
        steps,
        ~taken,
        lambda step: Message("its contact at step {step} has no step that led to it", step=step),
    )


def _not_numbers(rows: Rows) -> NDArray[np.bool_]:
    """Return which rows have a number that is not finite, or too large."""
    wrong = np.zeros(len(rows), dtype=bool)
    for name in rows.dtype.names or ():
        if rows.dtype[name].base.kind == "f":
            wrong |= ~(np.abs(numbers_of(rows, name)) <= LARGEST).all(axis=1)
    return wrong


def _refuse(
    path: Path,
    steps: NDArray[np.int64],
    wrong: NDArray[np.bool_],
    what: Callable[[int], Message],
) -> None:
    """Raise the error about the step of the first wrong row, if there is one."""
    rows = np.flatnonzero(wrong)
    if len(rows):
        raise damaged(path, what(int(steps[rows[0]])))
