"""Reads a chunk's columns as arrays, and checks that they have the types that drop writes."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.engine_report import LARGEST
from drop_physics.fields import shown
from drop_physics.messages import Message
from drop_physics.recording import schema
from drop_physics.recording.damage import damaged, twice, wrong_count
from drop_physics.recording.rrd import Chunk
from drop_physics.recording.schema import Table
from drop_physics.recording.step_frames import PackedFrames
from drop_physics.trace.events import At, Calls, Impulses
from drop_physics.trace.frames import ModelPart
from drop_physics.trace.states import Rows

Properties = dict[str, Any]

PROPERTY_BYTES, LARGEST_BYTES = 1 << 16, 1 << 24
"""Largest sizes of a property [bytes]: of most properties (the engine's report has 18,000); and of
the origin, with a script's arguments (two megabytes at most on Linux), and the closing property,
which has a digest of 64 letters for each body with joints, constraint and client."""
LARGE = schema.ORIGIN_PROPERTY, schema.RECORDING_PROPERTY


def rows(chunk: Chunk, table: Table, path: Path) -> Rows:
    """Return a table's rows from one of its chunks.

    Raises
    ------
    RecordingError
        If the chunk has any content but lists of the table's numbers.
    """
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_numpy()
    in_order = (steps[1:] > steps[:-1]).all()
    if not in_order and len(np.unique(steps)) < len(steps):
        raise damaged(path, twice(chunk.entity))
    read: Rows | None = None
    counts, empty = np.empty(0, np.int64), False
    for component in table.components:
        kind, width = table.kind[component].base, max(1, math.prod(table.kind[component].shape))
        is_right = pa.types.is_int64 if kind.kind == "i" else pa.types.is_float64
        lists = _column(chunk, component, _is_list_of(is_right), path)
        lengths, flat = np.diff(lists.offsets.to_numpy()), between(lists)
        if read is None:
            counts = lengths // width
            empty = not counts.all()
            read = np.empty(int(counts.sum()), table.kind)
            read["step"] = np.repeat(steps, counts)
        if flat.null_count or empty or not np.array_equal(lengths, counts * width):
            raise damaged(path, wrong_count(chunk.entity, width, component))
        # Copied, so that the chunk can be freed.
        read[component] = flat.to_numpy().reshape(read[component].shape)
    assert read is not None
    return read


def told(chunk: Chunk, path: Path) -> Iterator[tuple[At, str]]:
    """Yield step, time and JSON text of each row in a chunk.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_pylist()
    calls = _column(chunk, schema.CALL_TIMELINE, pa.types.is_int64, path).to_pylist()
    times = _column(chunk, schema.TIME_TIMELINE, pa.types.is_duration, path)
    times_s = (times.view(pa.int64()).to_numpy() / 1e9).tolist()
    texts = _flat(_column(chunk, schema.JSON, _is_list_of(pa.types.is_string), path), 1)
    if texts is None or texts.null_count:
        raise damaged(path, Message("{entity} has gaps", entity=chunk.entity))
    for step, time_s, call, text in zip(steps, times_s, calls, texts.to_pylist(), strict=True):
        yield At(step, time_s, call), text


def series(chunk: Chunk, path: Path) -> tuple[Int64, Float64] | None:
    """Return steps (n,) and values (n, k) of a series; None for a chunk that only has its name.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    if chunk.batch.schema.get_field_index("Scalars:scalars") < 0:
        return None
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_numpy()
    lists = _column(chunk, "Scalars:scalars", _is_list_of(pa.types.is_float64), path)
    lengths, flat = np.diff(lists.offsets.to_numpy()), between(lists)
    if flat.null_count or len(set(lengths.tolist())) > 1:
        what = Message("{entity} must hold equally many numbers in each row", entity=chunk.entity)
        raise damaged(path, what)
    return steps, flat.to_numpy().reshape(len(steps), -1).copy()


def holders(chunk: Chunk, path: Path) -> Int64:
    """Return the constraint id of each row of forces, shape (n,).

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    if chunk.batch.schema.get_field_index(schema.CONSTRAINT) < 0:  # as once: its entity's name
        return np.full(chunk.batch.num_rows, int(chunk.entity.rpartition("_")[2]))
    ids = _flat(_column(chunk, schema.CONSTRAINT, _is_list_of(pa.types.is_int64), path), 1)
    if ids is None or ids.null_count:
        raise damaged(path, wrong_count(chunk.entity, 1, schema.CONSTRAINT))
    return np.asarray(ids.to_numpy())


def calls(chunk: Chunk, path: Path) -> Calls:
    """Return the calls in a chunk, all from one simulation.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    steps, times_s, held, counts = _lists(chunk, _OF_CALLS, path)
    first = _column(chunk, schema.CALL_TIMELINE, pa.types.is_int64, path).to_numpy()
    many = counts["site"]
    same = all(np.array_equal(counts[name], many) for name in ("after", "result"))
    if not (same and len(many) and many.all() and len(set(held["client"].tolist())) == 1):
        raise damaged(path, wrong_count(chunk.entity, 1, "site"))
    return Calls(
        int(held["client"][0]),
        np.repeat(steps, many),
        np.repeat(times_s, many),
        np.repeat(first, many) + held["after"],
        held["site"],
        held["numbers"],
        held["result"],
    )


def impulses(chunk: Chunk, path: Path) -> Impulses:
    """Return the impulses of the steps in a chunk.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    steps, times_s, held, counts = _lists(chunk, _OF_IMPULSES, path)
    if not ((counts["status"] == 1) & (counts["remainder"] == 1)).all():
        raise damaged(path, wrong_count(chunk.entity, 1, "status"))
    return Impulses(
        int(chunk.entity.rpartition("/")[2]),
        steps,
        times_s,
        held["status"],
        held["remainder"],
        counts["cause"].astype(np.int64),
        counts["impulse"].astype(np.int64),
        held["cause"],
        held["impulse"],
    )


def model_parts(chunk: Chunk, path: Path) -> Iterator[ModelPart]:
    """Yield the parts of compiled MuJoCo models that a chunk contains.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    said, data = _rows_of(chunk, {schema.JSON: pa.types.is_string, "data": pa.types.is_uint8}, path)
    for texts, held in zip(said, data, strict=True):
        try:
            (text,) = texts.to_pylist()
            yield ModelPart(**json.loads(text), data=held.to_numpy().tobytes())
        except (ValueError, TypeError):
            what = Message("{entity} is not in drop's format", entity=chunk.entity)
            raise damaged(path, what) from None


def steps(chunk: Chunk, path: Path) -> Iterator[PackedFrames]:
    """Yield the replay frames in a chunk, one row per batch of steps.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    for texts, *held in zip(*_rows_of(chunk, _OF_STEPS, path), strict=True):
        if len(texts) != 1:
            raise damaged(path, wrong_count(chunk.entity, 1, schema.JSON))
        numbers, at, answers = (each.to_numpy() for each in held)
        yield PackedFrames(texts.to_pylist()[0], numbers, at, answers.tobytes())


def _rows_of(
    chunk: Chunk, kinds: Mapping[str, Callable[[Any], bool]], path: Path
) -> Iterator[list[pa.Array]]:
    """Yield a chunk's rows, each with the lists in its columns."""
    for name, is_right in kinds.items():
        lists = _column(chunk, name, _is_list_of(is_right), path)
        offsets = lists.offsets.to_numpy()
        yield [lists.values.slice(a, b - a) for a, b in pairwise(offsets.tolist())]


_OF_STEPS = {
    schema.JSON: pa.types.is_string,
    "numbers": pa.types.is_float64,
    "at": pa.types.is_int64,
    "answers": pa.types.is_uint8,
}


def _lists(
    chunk: Chunk, kinds: Mapping[str, Callable[[Any], bool]], path: Path
) -> tuple[Int64, Float64, dict[str, NDArray[Any]], dict[str, Int64]]:
    """Return a chunk's steps and times [s], the elements of its lists, and the list lengths."""
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_numpy()
    times = _column(chunk, schema.TIME_TIMELINE, pa.types.is_duration, path)
    held: dict[str, NDArray[Any]] = {}
    counts: dict[str, Int64] = {}
    for name, is_right in kinds.items():
        lists = _column(chunk, name, _is_list_of(is_right), path)
        flat = between(lists)
        if flat.null_count:
            raise damaged(path, Message("{entity} has gaps", entity=chunk.entity))
        held[name], counts[name] = flat.to_numpy().copy(), np.diff(lists.offsets.to_numpy())
    return steps, times.view(pa.int64()).to_numpy() / 1e9, held, counts


_OF_IMPULSES = {
    "status": pa.types.is_int64,
    "remainder": pa.types.is_float64,
    "cause": pa.types.is_int64,
    "impulse": pa.types.is_float64,
}

_OF_CALLS = {
    "client": pa.types.is_int64,
    "site": pa.types.is_int64,
    "after": pa.types.is_int64,
    "result": pa.types.is_float64,
    "numbers": pa.types.is_float64,
}


def images(chunk: Chunk, path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the step and the PNG of each camera frame in a chunk.

    Raises
    ------
    RecordingError
        If the chunk has any other content.
    """
    if chunk.batch.schema.get_field_index("EncodedImage:blob") < 0:
        return  # the media type, which `rerun rrd split` writes into a separate chunk
    bytes_ = _is_list_of(_is_list_of(pa.types.is_uint8))
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path)
    blobs = _column(chunk, "EncodedImage:blob", bytes_, path)
    pictures = _flat(blobs, 1)
    if pictures is None or pictures.null_count or pictures.values.null_count:
        raise damaged(path, Message("it must hold one picture per step for its frames"))
    for step, blob in zip(steps.to_pylist(), pictures, strict=True):
        yield step, blob.values.to_numpy().tobytes()


def values(chunk: Chunk, path: Path) -> Properties:
    """Return a property's values by name; a list with one element becomes that element.

    Raises
    ------
    RecordingError
        If a value is not a text, a number up to `LARGEST`, or a boolean.
    """
    name, batch = chunk.entity.removeprefix("__properties/"), chunk.batch
    if batch.num_rows != 1:
        raise damaged(path, Message("its property {name} must have one row", name=name))
    if chunk.size > (LARGEST_BYTES if name in LARGE else PROPERTY_BYTES):
        what = Message("its property {name} takes {size:,} bytes", name=name, size=chunk.size)
        raise damaged(path, what)
    read: Properties = {}
    for key, column in zip(batch.schema.names, batch.columns, strict=True):
        if not pa.types.is_list(column.type):
            continue  # Rerun's own columns
        if not any(is_ours(column.type.value_type) for is_ours in _PLAIN):
            what = Message(
                "its property {name} has the wrong type of {key}", name=name, key=shown(key)
            )
            raise damaged(path, what)
        value = column[0].as_py()
        if value is None:
            continue
        for element in value:
            if not _is_plain(element):
                what = Message(
                    "its property {name} says that {key} is {value}",
                    name=name,
                    key=shown(key),
                    value=shown(element),
                )
                raise damaged(path, what)
        read[key] = value[0] if len(value) == 1 else value
    return read


_PLAIN = (pa.types.is_float64, pa.types.is_int64, pa.types.is_boolean, pa.types.is_string)
"""The types of the properties that drop writes."""


def _is_plain(value: object) -> bool:
    if isinstance(value, float):
        return abs(value) <= LARGEST
    return value is not None


def _column(chunk: Chunk, name: str, is_right: Callable[[Any], bool], path: Path) -> pa.Array:
    """Return a column, after a check that it has the type that drop writes and no gaps."""
    index = chunk.batch.schema.get_field_index(name)
    if index < 0 or not is_right(chunk.batch.schema.field(index).type):
        what = Message(
            "{entity} has no column {name} of the right type", entity=chunk.entity, name=name
        )
        raise damaged(path, what)
    column = chunk.batch.column(index)
    if column.null_count:
        what = Message("{entity} has gaps in {name}", entity=chunk.entity, name=name)
        raise damaged(path, what)
    return column


def _flat(lists: pa.Array, width: int) -> pa.Array | None:
    """Return the elements of lists as one array; None unless each list has `width` elements."""
    return None if (np.diff(lists.offsets.to_numpy()) != width).any() else between(lists)


def between(lists: pa.Array) -> pa.Array:
    """Return the elements of consecutive lists as one array."""
    # As `flatten` does, but that loads Arrow's compute library.
    if not len(lists):
        return lists.values[:0]
    offsets = lists.offsets.to_numpy()
    return lists.values.slice(offsets[0], offsets[-1] - offsets[0])


def _is_list_of(is_right: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda kind: pa.types.is_list(kind) and is_right(kind.value_type)


def times_s(chunk: Chunk) -> Float64:
    """Return the simulated time of each row [s], shape (rows,); 0 for static rows."""
    index = chunk.batch.schema.get_field_index(schema.TIME_TIMELINE)
    if index < 0:
        return np.zeros(chunk.batch.num_rows)
    times = chunk.batch.column(index).view(pa.int64()).to_numpy(zero_copy_only=False)
    return np.asarray(times / 1e9, np.float64)
