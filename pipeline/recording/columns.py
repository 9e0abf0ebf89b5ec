"""What one chunk of a recording holds: its columns as arrays, if they are of the types we write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.fields import shown
from pipeline.recording import schema
from pipeline.recording.checks import damaged
from pipeline.recording.rows import named
from pipeline.recording.rrd import Chunk
from pipeline.recording.schema import Table
from pipeline.report import LARGEST

Properties = dict[str, Any]

PROPERTY_BYTES = 1 << 16
"""Most that a property takes; the engine's report takes 18,000."""
LONGEST_TEXT = 4096
"""Characters in a property: as many as a path may have."""


def rows(chunk: Chunk, table: Table, path: Path) -> pl.DataFrame:
    """Return the rows of a table that a chunk of it holds.

    Raises
    ------
    RecordingError
        If it holds something else than lists of the table's numbers.
    """
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_numpy()
    found: dict[str, NDArray[Any]] = {}
    counts = np.empty(0, np.int64)
    for component, names in table.columns.items():
        whole, width = table.kind[component].base.kind == "i", len(names)
        is_right = _is_list_of(pa.types.is_int64 if whole else pa.types.is_float64)
        lists = _column(chunk, component, is_right, path)
        lengths, flat = np.diff(lists.offsets.to_numpy()), _between(lists)
        if not found:
            counts = lengths // width
            found["step"] = np.repeat(steps, counts)
        if flat.null_count or not counts.all() or not np.array_equal(lengths, counts * width):
            raise damaged(path, f"{chunk.entity} must hold {width} numbers for each {component}")
        # Copied, so that nothing else of the chunk stays in memory.
        found |= named(flat.to_numpy().reshape(-1, width), names)
    if len(np.unique(steps)) < len(steps):
        raise damaged(path, f"its {chunk.entity} has a step twice")
    return pl.DataFrame(found)


def told(chunk: Chunk, path: Path) -> Iterator[tuple[int, float, int, dict[str, list[Any]]]]:
    """Yield the rows of what was told of a script: step, time [s], calls before, named lists.

    Raises
    ------
    RecordingError
        If a chunk holds something else than lists of numbers, texts, true and false.
    """
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_pylist()
    calls = _column(chunk, schema.CALL_TIMELINE, pa.types.is_int64, path).to_pylist()
    times = _column(chunk, schema.TIME_TIMELINE, pa.types.is_duration, path)
    times_s = times.cast(pa.int64()).to_numpy() / 1e9
    lists: dict[str, list[list[Any]]] = {}
    for name, column in zip(chunk.batch.schema.names, chunk.batch.columns, strict=True):
        if name in _OF_A_ROW:
            continue
        if not any(_is_list_of(is_ours)(column.type) for is_ours in _PLAIN):
            raise damaged(path, f"{chunk.entity} has a {shown(name)} of another type")
        lists[name] = column.to_pylist()
    for number, (step, time_s, call) in enumerate(zip(steps, times_s.tolist(), calls, strict=True)):
        row = {name: values[number] for name, values in lists.items()}
        if any(values is None or None in values for values in row.values()):
            raise damaged(path, f"{chunk.entity} has gaps")
        yield step, time_s, call, row


_OF_A_ROW = (
    "rerun.controls.RowId", schema.STEP_TIMELINE, schema.CALL_TIMELINE, schema.TIME_TIMELINE,
)  # fmt: skip


def joints(chunk: Chunk, path: Path) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]]:
    """Return steps, positions, velocities and torques of joints, of shape (n,) and (n, k).

    Raises
    ------
    RecordingError
        If a chunk holds something else.
    """
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path).to_numpy()
    found = []
    for name in ("position", "velocity", "torque"):
        lists = _column(chunk, name, _is_list_of(pa.types.is_float64), path)
        lengths, flat = np.diff(lists.offsets.to_numpy()), _between(lists)
        if flat.null_count or len(set(lengths.tolist())) > 1:
            raise damaged(path, f"{chunk.entity} must hold as many numbers for each {name}")
        found.append(flat.to_numpy().reshape(len(steps), -1).copy())
    return steps, found


def images(chunk: Chunk, path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield step and PNG of the camera frames in a chunk.

    Raises
    ------
    RecordingError
        If it holds something else.
    """
    if chunk.batch.schema.get_field_index("EncodedImage:blob") < 0:
        return  # the media type, which `rerun rrd split` writes into a chunk of its own
    bytes_ = _is_list_of(_is_list_of(pa.types.is_uint8))
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path)
    blobs = _column(chunk, "EncodedImage:blob", bytes_, path)
    pictures = _flat(blobs, 1)
    if pictures is None or pictures.null_count or pictures.values.null_count:
        raise damaged(path, "its frames must be one picture per step")
    for step, blob in zip(steps.to_pylist(), pictures, strict=True):
        yield step, blob.values.to_numpy().tobytes()


def values(chunk: Chunk, path: Path) -> Properties:
    """Return a property's values by name; a list of one is its element.

    Raises
    ------
    RecordingError
        If it holds something else than short texts, numbers up to `LARGEST`, true and false.
    """
    name, batch = chunk.entity.removeprefix("__properties/"), chunk.batch
    if batch.num_rows != 1:
        raise damaged(path, f"its property {name} must have one row")
    if chunk.size > PROPERTY_BYTES:
        raise damaged(path, f"its property {name} takes {chunk.size:,} bytes")
    found: Properties = {}
    for key, column in zip(batch.schema.names, batch.columns, strict=True):
        if not pa.types.is_list(column.type):
            continue  # what Rerun keeps of the row
        if not any(is_ours(column.type.value_type) for is_ours in _PLAIN):
            raise damaged(path, f"its property {name} has a {shown(key)} of another type")
        value = column[0].as_py()
        if value is None:
            continue
        for one in value:
            if not _is_plain(one):
                raise damaged(path, f"its property {name} says that {shown(key)} is {shown(one)}")
        found[key] = value[0] if len(value) == 1 else value
    return found


_PLAIN = (pa.types.is_float64, pa.types.is_int64, pa.types.is_boolean, pa.types.is_string)
"""The types of which we write properties."""


def _is_plain(value: object) -> bool:
    if isinstance(value, float):
        return abs(value) <= LARGEST
    return value is not None and not (isinstance(value, str) and len(value) > LONGEST_TEXT)


def _column(chunk: Chunk, name: str, is_right: Callable[[Any], bool], path: Path) -> pa.Array:
    """Return a column of the type that we write, every row of it given."""
    index = chunk.batch.schema.get_field_index(name)
    if index < 0 or not is_right(chunk.batch.schema.field(index).type):
        raise damaged(path, f"{chunk.entity} has no column {name} of the right type")
    column = chunk.batch.column(index)
    if column.null_count:
        raise damaged(path, f"{chunk.entity} has gaps in {name}")
    return column


def _flat(lists: pa.Array, width: int) -> pa.Array | None:
    """Return what lists hold, one after the other; None where one has not `width` elements."""
    return None if (np.diff(lists.offsets.to_numpy()) != width).any() else _between(lists)


def _between(lists: pa.Array) -> pa.Array:
    """Return what lists hold, one after the other."""
    # What `flatten` does, which loads Arrow's library of computations for it.
    if not len(lists):
        return lists.values[:0]
    offsets = lists.offsets.to_numpy()
    return lists.values.slice(offsets[0], offsets[-1] - offsets[0])


def _is_list_of(is_right: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda kind: pa.types.is_list(kind) and is_right(kind.value_type)
