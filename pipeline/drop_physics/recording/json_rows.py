"""Converts events other than samples to rows of JSON, and back.

A row is an event at some time, such as a new body, a report of the engine, or a new call site. It
is a JSON object of the event's fields, with arrays as lists, and a body that another row describes
as its id. JSON keeps Rerun's index small, which grows with each column of each entity.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import cache, partial
from hashlib import blake2b
from pathlib import PurePath
from types import MappingProxyType, NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic_core import CoreSchema, SchemaValidator, core_schema

from drop_physics.recording import schema
from drop_physics.trace.events import (
    Appearance,
    ArrayUse,
    At,
    Body,
    Dynamics,
    EngineWarning,
    EpisodeEnd,
    Equality,
    Event,
    ImpulseCause,
    PairFriction,
    Put,
    Raised,
    Sensor,
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
"""Rows of JSON by entity, in the order of steps and calls."""

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
    EpisodeEnd: schema.EPISODES,
    Sensor: schema.SENSORS,
    ArrayUse: schema.ARRAY_USES,
}
"""Entity that stores the events of each class."""
MESH, ARRAYS = "mesh", ("corners_m", "triangles")
"""Keys of a mesh row: the digest of the surface, and its arrays, which only the first row with this
digest has."""
SHAPES: Mapping[str, tuple[int, ...]] = {
    "base": (13,),
    "corners_m": (-1, 3),
    "triangles": (-1, 3),
}
"""Shapes of arrays whose shape is the same in every event, by field."""
PLAIN: Mapping[Any, CoreSchema] = {
    int: core_schema.int_schema(),
    float: core_schema.float_schema(),
    str: core_schema.str_schema(),
    bool: core_schema.bool_schema(),
    NoneType: core_schema.none_schema(),
}
"""Validation schema of each plain JSON type."""


def row_of(event: Event) -> tuple[str, At, Values]:
    """Convert an event to JSON types; return them with entity path, step and time."""
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


def keep_once(surface: Values, kept: set[str]) -> None:
    """Add a surface's digest to its row; drop the arrays if another row has the same digest."""
    arrays = {name: surface.pop(name) for name in ARRAYS}
    surface[MESH] = mesh = blake2b(packed(arrays).encode(), digest_size=16).hexdigest()
    if mesh not in kept:
        kept.add(mesh)
        surface |= arrays


def packed(values: Values) -> str:
    """Return values as JSON."""
    return json.dumps(values, ensure_ascii=False, separators=(",", ":"))


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever an event holds
    """Convert a value to JSON types; `asdict` would copy each number."""
    if value is None or isinstance(value, float | str | int):  # most are; the next ask for more
        return value
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
    return {name: _plain(getattr(held, name)) for name in _names_of(type(held))}  # type: ignore[arg-type]


@cache
def _names_of(kind: Any) -> tuple[str, ...]:  # noqa: ANN401 - any dataclass
    return tuple(each.name for each in fields(kind))


def _plain_body(body: Body) -> Values:
    plain = _plain_values(body)
    for shape in (*plain["shapes"], *plain["collisions"]):
        shape["file"] = PurePath(shape["file"]).name
    for shape, held in zip(plain["collisions"], body.collisions, strict=True):
        shape["hull_m"] = [round(each, 6) for each in held.hull_m]  # to a micrometre, as surfaces
    return plain


# -- back -----------------------------------------------------------------------------------------


def events(told: Told, kind: type[T], bodies: Mapping[int, Body] = MappingProxyType({})) -> list[T]:
    """Parse rows as events of one kind; bodies are given by id.

    Raises
    ------
    ValueError
        If the rows have another content.
    """
    rows = told[ENTITIES[kind]]
    if not rows:
        return []
    read = _reader(kind)  # type: ignore[arg-type]  # a type has a hash
    found = []
    for at, values in rows:
        exact = replace(at, time_s=values["time_s"]) if kind is Settings else at
        found.append(read({**values, "at": exact}, bodies))
    return found


def surfaces(told: Told) -> list[Surface]:
    """Return the surfaces of meshes; equal surfaces share their arrays.

    Raises
    ------
    ValueError
        If the rows have another content.
    """
    found, meshes = list[Surface](), dict[Any, Values]()
    # In the order of steps, a row may come before the one that has its arrays.
    for at, values in sorted(told[schema.SURFACES], key=lambda row: ARRAYS[0] not in row[1]):
        arrays = meshes.get(mesh := values.get(MESH), {})
        found += events({schema.SURFACES: [(at, {**arrays, **values})]}, Surface)
        meshes[mesh] = {name: getattr(found[-1], name) for name in ARRAYS}
    return found


@cache
def _reader(kind: type[T]) -> Callable[[Values, Mapping[int, Body]], T]:
    """Return a function that builds an event from a row."""
    validator = SchemaValidator(_of_class(kind, nested=kind is not Appearance))
    return lambda row, bodies: validator.validate_python(row, context=bodies)


def _of_class(kind: type[Any], *, nested: bool) -> CoreSchema:
    """Return the validation schema of a dataclass; if `nested`, bodies are given by id.

    A pydantic model could do the same, but takes 5 ms to create.
    """
    hints = get_type_hints(kind)
    parts = []
    for each in fields(kind):
        part = _schema(each.name, hints[each.name], nested=nested)
        if each.default is not MISSING:
            part = core_schema.with_default_schema(part, default=each.default)
        parts.append(core_schema.dataclass_field(each.name, part))
    arguments = core_schema.dataclass_args_schema(kind.__name__, parts)
    return core_schema.dataclass_schema(kind, arguments, [each.name for each in fields(kind)])


def _schema(name: str, hint: Any, *, nested: bool) -> CoreSchema:  # noqa: ANN401 - a type
    """Return the schema that validates a field of this type in JSON."""
    if hint in PLAIN:
        return PLAIN[hint]
    if hint is Body and nested:
        return core_schema.with_info_plain_validator_function(_body)
    if isinstance(hint, type) and is_dataclass(hint):
        return _of_class(hint, nested=nested)
    of, its = get_origin(hint), get_args(hint)
    if of is NDArray or of is np.ndarray:  # the former from numpy 2.5 on
        (kind,) = its if of is NDArray else get_args(its[1])
        return core_schema.no_info_plain_validator_function(partial(_array, name, kind))
    parts = [_schema(name, each, nested=nested) for each in its if each is not Ellipsis]
    if of is tuple:
        rest = 0 if its[1:] == (Ellipsis,) else None
        return core_schema.tuple_schema(parts, variadic_item_index=rest)
    if of is Sequence:
        return core_schema.list_schema(*parts)
    if of in (Mapping, dict):
        return core_schema.dict_schema(*parts)
    assert of in (Union, UnionType), f"{name}: {hint}"
    return core_schema.union_schema([*parts])


def _array(name: str, kind: Any, value: Any) -> NDArray[Any]:  # noqa: ANN401 - a dtype, lists
    read = np.asarray(value, kind)
    return read.reshape(SHAPES.get(name, read.shape))


def _body(number: Any, info: core_schema.ValidationInfo) -> Any:  # noqa: ANN401
    return info.context[number]  # type: ignore[index]


def bodies_of(appearances: Iterable[Appearance]) -> dict[int, Body]:
    """Return the bodies by id, with their latest descriptions."""
    return {appearance.body.number: appearance.body for appearance in appearances}
