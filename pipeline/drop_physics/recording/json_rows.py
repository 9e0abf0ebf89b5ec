"""What happened besides samples, as rows of JSON: from events to a recording, and back.

A row is what changed at a moment: a body, what the engine reports, a place that calls it. JSON,
because Rerun's index of a file grows with each column of each entity. It holds the event's fields
by name, an array as lists, and of a body that another row describes its number.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import cache
from pathlib import PurePath
from types import MappingProxyType
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import PlainValidator, ValidationInfo, create_model

from drop_physics.recording import schema
from drop_physics.trace.events import (
    Appearance,
    At,
    Body,
    Dynamics,
    EngineWarning,
    Equality,
    Event,
    ImpulseCause,
    PairFriction,
    Put,
    Raised,
    Settings,
    Site,
    SolverStop,
    Surface,
)
from drop_physics.trace.readings import Reading

T = TypeVar("T")
Values = dict[str, Any]
Row = tuple[At, Values]
Told = Mapping[str, list[Row]]
"""Rows in the order of steps and calls, by entity."""

ENTITIES: Mapping[type[Any], str] = {
    Appearance: schema.BODIES,
    Surface: schema.SURFACES,
    Dynamics: schema.DYNAMICS,
    Settings: schema.SETTINGS,
    Site: schema.SITES,
    Raised: schema.RAISED,
    SolverStop: schema.SOLVER,
    Reading: schema.READINGS,
    Put: schema.SET,
    ImpulseCause: schema.CAUSES,
    PairFriction: schema.PAIRS,
    EngineWarning: schema.WARNINGS,
    Equality: schema.EQUALITIES,
}
"""Where the rows of each kind of event are."""
SHAPES: Mapping[str, tuple[int, ...]] = {
    "base": (13,),
    "corners_m": (-1, 3),
    "triangles": (-1, 3),
}
"""The shapes of arrays that have the same one in every event."""


def row_of(event: Event) -> tuple[str, At, Values]:
    """Return an event's entity, moment and values, which JSON can hold."""
    values = _plain_values(event)
    # A place has no time of its own: a recording may know it before the first step.
    at: At = values.pop("at", None) or At(0, 0.0, values["number"])
    match event:
        case Appearance():
            values["body"] = _plain_body(event.body)
        case Surface():  # to a micrometre: as text, numbers are as long as they are exact
            values["corners_m"] = event.corners_m.round(6).tolist()
        case Settings():  # the viewer's times are rounded; later times are computed from this one
            values["time_s"] = at.time_s
    return ENTITIES[type(event)], at, values


def packed(values: Values) -> str:
    """Return values as JSON."""
    return json.dumps(values, ensure_ascii=False, separators=(",", ":"))


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever an event holds
    """Return what JSON holds in place of a value; `asdict` would copy each number."""
    if isinstance(value, Body):
        return value.number
    if is_dataclass(value) and not isinstance(value, At):
        return _plain_values(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, tuple) and value and not isinstance(value[0], float | str):
        return [_plain(each) for each in value]
    return value


def _plain_values(held: Any) -> Values:  # noqa: ANN401 - any dataclass
    return {each.name: _plain(getattr(held, each.name)) for each in fields(held)}


def _plain_body(body: Body) -> Values:
    plain = _plain_values(body)
    for shape in (*plain["shapes"], *plain["collisions"]):
        shape["file"] = PurePath(shape["file"]).name
    for shape, held in zip(plain["collisions"], body.collisions, strict=True):
        shape["hull_m"] = [round(each, 6) for each in held.hull_m]  # to a micrometre, as surfaces
    return plain


# -- back -----------------------------------------------------------------------------------------


def events(told: Told, kind: type[T], bodies: Mapping[int, Body] = MappingProxyType({})) -> list[T]:
    """Return the events of a kind, which may name these bodies by number.

    Raises
    ------
    ValueError
        If the rows are something else.
    """
    rows = told[ENTITIES[kind]]
    if not rows:
        return []
    read = _reader(kind)  # type: ignore[arg-type]  # a type has a hash
    found = []
    for at, values in rows:
        exact = replace(at, time_s=values["time_s"]) if kind is Settings else at
        found.append(kind(**read({**values, "at": exact}, bodies)))
    return found


@cache
def _reader(kind: type[Any]) -> Callable[[Values, Mapping[int, Body]], Values]:
    """Return what makes the fields of an event from a row; it takes 10 ms of processor time."""
    hints = get_type_hints(kind)
    typed: dict[str, Any] = {
        each.name: (
            hints[each.name] if kind is Appearance else _typed(each.name, hints[each.name]),
            ... if each.default is MISSING else each.default,
        )
        for each in fields(kind)
    }
    model = create_model(kind.__name__, **typed)
    return lambda row, bodies: dict(model.model_validate(row, context=bodies))


def _typed(name: str, hint: Any) -> Any:  # noqa: ANN401 - a type
    """Return the type by which a field of some type is read from JSON."""
    if hint is Body:
        return Annotated[Any, PlainValidator(_body)]
    if get_origin(hint) is np.ndarray:
        (kind,) = get_args(get_args(hint)[1])

        def array(value: Any) -> Any:  # noqa: ANN401 - lists
            read = np.array(value, kind)
            return read.reshape(SHAPES.get(name, read.shape))

        return Annotated[Any, PlainValidator(array)]
    if get_origin(hint) is Mapping:
        return dict.__class_getitem__((str, _typed(name, get_args(hint)[1])))
    return hint


def _body(number: Any, info: ValidationInfo) -> Any:  # noqa: ANN401
    return info.context[number]  # type: ignore[index]


def bodies_of(appearances: Iterable[Appearance]) -> dict[int, Body]:
    """Return the bodies by number, each as last seen."""
    return {appearance.body.number: appearance.body for appearance in appearances}
