"""What happened besides samples, as rows of JSON: from events to a recording, and back.

A row is what changed at a moment: a body, what the engine reports, a place that calls it. JSON,
because Rerun's index of a file grows with each column of each entity.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import PurePath
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter

from drop_physics.recording import schema
from drop_physics.trace.events import (
    Appearance,
    At,
    Body,
    Dynamics,
    EngineWarning,
    Equality,
    ImpulseCause,
    PairFriction,
    Put,
    Raised,
    Settings,
    Site,
    Solver,
    Surface,
)
from drop_physics.trace.readings import Reading
from drop_physics.trace.states import Joints

T = TypeVar("T")
Values = dict[str, Any]
Row = tuple[At, Values]
Told = Mapping[str, list[Row]]
"""Rows in the order of steps and calls, by entity."""
Event = (
    Appearance
    | Surface
    | Dynamics
    | Settings
    | Site
    | Raised
    | Solver
    | Reading
    | Put
    | ImpulseCause
    | PairFriction
    | EngineWarning
    | Equality
)


def row_of(event: Event) -> tuple[str, At, Values]:
    """Return an event's entity, moment and values, which JSON can hold."""
    match event:
        case Appearance(at, body):
            values = {"there": event.there, "came": event.came, "sampled": event.sampled}
            return schema.BODIES, at, values | {"body": _plain_body(body)}
        case Surface(at):
            held = {"body": event.body, "shape": event.shape, "triangles": event.triangles.tolist()}
            # To a micrometre: as text, numbers are as long as they are exact.
            return schema.SURFACES, at, held | {"corners_m": event.corners_m.round(6).tolist()}
        case Dynamics(at, body, reported):
            held = {name: numbers.tolist() for name, numbers in reported.items()}
            return schema.DYNAMICS, at, {"body": body.number, "reported": held}
        case Settings(at, client, values):
            # The viewer's times are rounded; later times are computed from this one.
            held = {name: np.asarray(value, np.float64).tolist() for name, value in values.items()}
            row = {"client": client, "time_s": at.time_s, "values": held}
            return schema.SETTINGS, at, row | ({"engine": event.engine} if event.engine else {})
        case Site():
            # A place has no time of its own: a recording may know it before the first step.
            return schema.SITES, At(0, 0.0, event.number), _plain_values(event)
        case Raised(at, error):
            return schema.RAISED, at, {"error": error}
        case Solver(at):
            held = {each.name: getattr(event, each.name) for each in fields(event)}
            del held["at"]
            return schema.SOLVER, at, held
        case ImpulseCause() | PairFriction() | EngineWarning() | Equality():
            return BARE[type(event)], event.at, _bare(event)
        case Reading():  # at no time of its own, as a site
            return schema.READINGS, At(0, 0.0, event.number), _plain_values(event)
        case Put(at, body):
            joints = {name: getattr(event.joints, name)[0].tolist() for name in schema.OF_JOINTS}
            base = {"body": body.number, "base": event.base.tolist(), "counts": event.counts}
            return schema.SET, at, base | joints


BARE: Mapping[type[Any], str] = {
    ImpulseCause: schema.CAUSES,
    PairFriction: schema.PAIRS,
    EngineWarning: schema.WARNINGS,
    Equality: schema.EQUALITIES,
}
"""The entities of events whose rows are all that they hold."""


def _bare(event: ImpulseCause | PairFriction | EngineWarning | Equality) -> Values:
    """Return an event's values but for its moment."""
    held = _plain_values(event)
    del held["at"]
    return held


def packed(values: Values) -> str:
    """Return values as JSON."""
    return json.dumps(values, ensure_ascii=False, separators=(",", ":"))


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever an event holds
    """Return a dataclass as a dict, and what it holds likewise; `asdict` would copy each number."""
    if is_dataclass(value):
        return _plain_values(value)
    if isinstance(value, tuple) and value and not isinstance(value[0], float | str):
        return [_plain(each) for each in value]
    return value


def _plain_values(held: Any) -> Values:  # noqa: ANN401 - any dataclass
    return {each.name: _plain(getattr(held, each.name)) for each in fields(held)}


def _plain_body(body: Body) -> Values:
    plain = _plain_values(body)
    if not body.actuators:  # as recordings without any always were
        del plain["actuators"]
    for shape in (*plain["shapes"], *plain["collisions"]):
        shape["file"] = PurePath(shape["file"]).name
    for shape, held in zip(plain["collisions"], body.collisions, strict=True):
        shape["hull_m"] = [round(each, 6) for each in held.hull_m]  # to a micrometre, as surfaces
    return plain


# -- back -----------------------------------------------------------------------------------------


def events(told: Told, entity: str, kind: type[T]) -> list[T]:
    """Return the rows of an entity as what they are.

    Raises
    ------
    ValueError
        If they are something else.
    """
    if not told[entity]:
        return []
    read = _reader(kind).validate_python  # type: ignore[arg-type]  # a type has a hash
    return [read({**values, "at": at}) for at, values in told[entity]]


_reader = cache(TypeAdapter)
"""The reader of a type; making one takes 10 ms of processor time."""


def bodies_of(appearances: Iterable[Appearance]) -> dict[int, Body]:
    """Return the bodies by number, each as last seen."""
    return {appearance.body.number: appearance.body for appearance in appearances}


def surfaces(told: Told) -> list[Surface]:
    """Return the surfaces of hollow meshes."""
    return [
        Surface(
            at,
            values["body"],
            values["shape"],
            np.array(values["corners_m"], np.float64).reshape(-1, 3),
            np.array(values["triangles"], np.int64).reshape(-1, 3),
        )
        for at, values in told[schema.SURFACES]
    ]


def dynamics(told: Told, bodies: Mapping[int, Body]) -> list[Dynamics]:
    """Return what the engine reported of bodies."""
    return [
        Dynamics(
            at,
            bodies[values["body"]],
            {name: np.array(held, np.float64) for name, held in values["reported"].items()},
        )
        for at, values in told[schema.DYNAMICS]
    ]


def settings(told: Told) -> list[Settings]:
    """Return what the engine reported of itself."""
    return [
        Settings(
            replace(at, time_s=values["time_s"]),
            values["client"],
            values["values"],
            values.get("engine", ""),
        )
        for at, values in told[schema.SETTINGS]
    ]


def sites(told: Told) -> dict[int, Site]:
    """Return the places that call the engine, by number."""
    return {site.number: site for site in events(told, schema.SITES, Site)}


def puts(told: Told, bodies: Mapping[int, Body]) -> list[Put]:
    """Return where calls placed bodies."""
    found = []
    for at, values in told[schema.SET]:
        held = (np.array([values[name]], np.float64) for name in schema.OF_JOINTS)
        joints = Joints(np.array([at.step]), np.array([at.time_s]), *held)
        base = np.array(values["base"], np.float64)
        if base.shape != (13,):
            raise ValueError(base.shape)
        found.append(Put(at, bodies[values["body"]], base, joints, values["counts"]))
    return found
