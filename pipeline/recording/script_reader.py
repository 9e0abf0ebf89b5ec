"""Read a script's recording back, and check it: what was seen of its simulations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.messages import Message
from pipeline.recording import columns, rows, schema
from pipeline.recording.checks import damaged
from pipeline.recording.columns import Properties
from pipeline.recording.contents import chunks_of, closing_of, gather
from pipeline.recording.digest import RowsDigest, ToldDigest, closing_digest, inputs_digest
from pipeline.recording.script import joint_rows
from pipeline.seen import (
    Appearance,
    At,
    Body,
    Call,
    Constraint,
    Dynamics,
    Given,
    Joint,
    Joints,
    Motor,
    Push,
    Put,
    Seen,
    Settings,
    Shape,
    Solver,
)
from pipeline.states import STATE

Values = dict[str, list[Any]]
Row = tuple[At, Values]


@dataclass(frozen=True)
class ScriptRecording:
    """What the recording of a script holds, read back and checked."""

    path: Path
    recording_id: str
    origin: Properties
    """The script, the digest of its text, its arguments."""
    ended: Properties | None
    """How it ended, and what it was made with; None for an unfinished recording."""
    seen: Seen

    @property
    def partial(self) -> bool:
        """Whether the recording was never finished."""
        return self.ended is None


def read_script(path: Path) -> ScriptRecording:
    """Read the recording of a script; one whose name ends in `.part` may be unfinished.

    Raises
    ------
    RecordingError
        If it is missing, damaged, not the recording of a script, or not what was written.
    """
    tables: dict[str, list[pl.DataFrame]] = {entity: [] for entity in schema.TABLES}
    told: dict[str, list[Row]] = {entity: [] for entity in schema.TOLD}
    jointed: dict[str, list[tuple[NDArray[np.int64], list[NDArray[np.float64]]]]] = {}
    properties: dict[str, Properties] = {}
    recording_id = ""
    for chunk in chunks_of(path):
        recording_id, entity = chunk.recording_id, chunk.entity
        if entity in tables:
            tables[entity].append(columns.rows(chunk, schema.TABLES[entity], path))
        elif entity in told and chunk.batch.schema.get_field_index("TextLog:text") < 0:
            told[entity] += [
                (At(step, time_s, call), values)
                for step, time_s, call, values in columns.told(chunk, path)
            ]
        elif entity.startswith(_STATE) and entity.endswith(_JOINTS):
            label = entity.removeprefix(_STATE).removesuffix(_JOINTS)
            jointed.setdefault(label, []).append(columns.joints(chunk, path))
        elif entity.startswith("__properties/"):
            gather(properties, chunk, path)
    origin, closing = properties.get(schema.ORIGIN_PROPERTY), closing_of(properties, path)
    if origin is None:
        raise damaged(path, Message("it does not say which script was run"))
    states, contacts = (
        pl.concat([rows.empty(table), *tables[entity]], rechunk=False)
        for entity, table in schema.TABLES.items()
    )
    _check_parts(states, path)
    for entity_rows in told.values():
        entity_rows.sort(key=lambda row: (row[0].step, row[0].call))
    try:
        seen = _seen(told, jointed, states, contacts, closing or {})
    except (KeyError, ValueError, TypeError, IndexError, AttributeError):
        what = Message("its bodies and calls are not in drop's format")
        raise damaged(path, what) from None
    if closing is not None:
        _check_digests(
            {
                "state": rows.digest_of(states, schema.STATES),
                "contacts": rows.digest_of(contacts, schema.CONTACTS),
                "told": _told_digest(told),
                "joints": _joints_digests(seen),
                "inputs": inputs_digest({schema.ORIGIN_PROPERTY: origin}),
                "closing": closing_digest(closing),
            },
            closing,
            path,
        )
    return ScriptRecording(path, recording_id, origin, closing, seen)


_STATE, _JOINTS = f"{schema.STATES.entity}/", f"/{schema.JOINTS}"


# -- from rows to what was seen -------------------------------------------------------------------


def _seen(
    told: Mapping[str, list[Row]],
    jointed: Mapping[str, list[tuple[NDArray[np.int64], list[NDArray[np.float64]]]]],
    states: pl.DataFrame,
    contacts: pl.DataFrame,
    closing: Properties,
) -> Seen:
    appearances = [_appearance(*row) for row in told[schema.BODIES]]
    bodies = {appearance.body.number: appearance.body for appearance in appearances}
    numbers = {body.label: body.number for body in bodies.values()}
    return Seen(
        bodies=bodies,
        appearances=appearances,
        dynamics=[
            Dynamics(at, bodies[_one(values, "body")], _reported(values))
            for at, values in told[schema.DYNAMICS]
        ],
        given=[
            Given(at, bodies[_one(values, "body")], _values(values, but=("body",)))
            for at, values in told[schema.GIVEN]
        ],
        settings=[
            Settings(
                replace(at, time_s=_one(values, "time_s")),
                _one(values, "client"),
                _values(values, but=("client", "time_s")),
            )
            for at, values in told[schema.SETTINGS]
        ],
        pushes=[
            Push(
                at,
                bodies[_one(values, "body")],
                _one(values, "link"),
                _one(values, "torque"),
                tuple(values["vector"]),
                tuple(values["position_m"]),
                _one(values, "in_world_axes"),
            )
            for at, values in told[schema.PUSHES]
        ],
        motors=[
            Motor(
                at,
                bodies[_one(values, "body")],
                _one(values, "joint"),
                _one(values, "mode"),
                _one(values, "force"),
            )
            for at, values in told[schema.MOTORS]
        ],
        solvers=[
            Solver(at, **{name: _one(values, name) for name in values})
            for at, values in told[schema.SOLVER]
        ],
        constraints=[
            Constraint(
                at,
                _one(values, "client"),
                _one(values, "number"),
                tuple(values["bodies"]),
                _one(values, "there"),
            )
            for at, values in told[schema.CONSTRAINTS]
        ],
        calls=[
            Call(
                at,
                _one(values, "client"),
                *(
                    _one(values, name)
                    for name in ("function", "arguments", "file", "line", "raised")
                ),
            )
            for at, values in told[schema.CALLS]
        ],
        puts=[_put(at, values, bodies) for at, values in told[schema.SET]],
        samples=dict(enumerate(_list(closing.get("samples_of_clients")))),
        states=states.sort("body", "link", "step", maintain_order=True),
        contacts=rows.in_order(contacts).rechunk(),
        joints={numbers[label]: _joined(parts) for label, parts in jointed.items()},
        real_time=bool(closing.get("made_with_real_time", False)),
        unseeded=tuple(_list(closing.get("made_with_unseeded"))),
        machine=str(closing.get("made_with_machine", "")),
    )


def _one(values: Values, name: str) -> Any:  # noqa: ANN401 - any value of a row
    (value,) = values[name]
    return value


def _values(values: Values, *, but: tuple[str, ...]) -> dict[str, Any]:
    return {
        name: held[0] if len(held) == 1 else held
        for name, held in values.items()
        if name not in but
    }


def _reported(values: Values) -> dict[str, NDArray[np.float64]]:
    links = len(values["mass_kg"])
    reported = {}
    for name, held in values.items():
        if name != "body":
            numbers = np.array(held, np.float64)
            reported[name] = numbers if len(numbers) == links else numbers.reshape(links, -1)
    return reported


def _appearance(at: At, values: Values) -> Appearance:
    limits = np.reshape(values["joint_limits"], (-1, 2)).tolist()
    widths = np.reshape(values["joint_widths"], (-1, 3)).tolist()
    joints = tuple(
        Joint(link, name, kind, parent, tuple(width), tuple(limit))
        for link, name, kind, parent, width, limit in zip(
            *(values[f"joint{which}"] for which in ("_links", "s", "_kinds", "_parents")),
            widths,
            limits,
            strict=True,
        )
    )
    body = Body(
        number=_one(values, "body"),
        label=_one(values, "label"),
        name=_one(values, "name"),
        engine_id=_one(values, "engine_id"),
        client=_one(values, "client"),
        links=tuple(values["links"]),
        joints=joints,
        moving=tuple(values["moving"]),
        soft=_one(values, "soft"),
        shapes=_shapes(values),
        can_sleep=_one(values, "can_sleep"),
        hides_links=_one(values, "hides_links"),
        bounds_m=tuple(values["bounds_m"]),
    )
    return Appearance(at, body, *(_one(values, name) for name in ("there", "came", "sampled")))


def _shapes(values: Values) -> tuple[Shape, ...]:
    numbers = {
        name: map(tuple, np.reshape(values[f"shape_{name}"], (-1, width)).tolist())
        for name, width in schema.SHAPE_NUMBERS.items()
    }
    shapes = zip(
        *(values[f"shape_{name}"] for name in ("links", "kinds", "files")),
        *(numbers[name] for name in ("size_m", "position_m", "orientation", "rgba")),
        strict=True,
    )
    return tuple(
        Shape(link, kind, size_m, file, position_m, orientation, rgba)
        for link, kind, file, size_m, position_m, orientation, rgba in shapes
    )


def _put(at: At, values: Values, bodies: Mapping[int, Body]) -> Put:
    states = np.empty(len(values["link"]), STATE)
    states["step"] = at.step
    for name in schema.STATES.columns:
        states[name] = np.reshape(values[name], states[name].shape)
    number = int(states["body"][0])
    joints = Joints(
        np.array([at.step]),
        np.array([at.time_s]),
        *(np.array([values[f"joint_{name}"]], np.float64) for name in _OF_JOINTS),
    )
    return Put(at, bodies[number], states, joints, _one(values, "counts"))


_OF_JOINTS = ("position", "velocity", "torque")


def _joined(parts: list[tuple[NDArray[np.int64], list[NDArray[np.float64]]]]) -> Joints:
    steps = np.concatenate([steps for steps, _ in parts])
    order = np.argsort(steps, kind="stable")
    position, velocity, torque = (
        np.concatenate([values[number] for _, values in parts])[order] for number in range(3)
    )
    return Joints(steps[order], np.full(len(steps), np.nan), position, velocity, torque)


def _list(value: Any) -> Iterable[Any]:  # noqa: ANN401 - a list of one is read as its element
    return [] if value is None else value if isinstance(value, list) else [value]


# -- checks ---------------------------------------------------------------------------------------


def _check_parts(states: pl.DataFrame, path: Path) -> None:
    """Check that each part has one state per step."""
    parts = ("step", "body", "link")
    if states.select(parts).is_duplicated().any():
        raise damaged(path, Message("its state has a part twice in a step"))


def _check_digests(digests: Mapping[str, Any], closing: Properties, path: Path) -> None:
    """Check that everything that a number is computed from is what was written."""
    for name, digest in digests.items():
        if closing.get(f"{name}_sha256") != digest:
            raise damaged(path, Message("its section {name} fails its checksum", name=name))


def _told_digest(told: Mapping[str, list[Row]]) -> str:
    digest = ToldDigest()
    for entity, held in told.items():
        for at, values in held:
            digest.update(entity, at.step, at.call, values)
    return digest.hexdigest()


def _joints_digests(seen: Seen) -> str | list[str] | None:
    """Return the digests as a property is read: a list of one as its element."""
    digests = []
    for number in sorted(seen.joints, key=lambda number: seen.bodies[number].label):
        digest = RowsDigest()
        digest.update(joint_rows(seen.joints[number]))
        digests.append(digest.hexdigest())
    return digests[0] if len(digests) == 1 else digests or None
