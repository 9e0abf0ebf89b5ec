"""What one chunk of a recording holds: its columns as arrays, if they are of the types we write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.fields import shown
from pipeline.recording import schema
from pipeline.recording.checks import damaged
from pipeline.recording.rrd import Chunk
from pipeline.report import LARGEST

Part = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Steps, shape (n,), and some columns of the state at them, shape (n, columns)."""
Properties = dict[str, Any]

PROPERTY_BYTES = 1 << 16
"""Most that a property takes; the engine's report takes 18,000."""
LONGEST_TEXT = 4096
"""Characters in a property: as many as a path may have."""


def scalars(chunk: Chunk, path: Path) -> Part:
    """Return the samples of a chunk of `state/…`.

    Raises
    ------
    RecordingError
        If it holds something else.
    """
    steps = _column(chunk, schema.STEP_TIMELINE, pa.types.is_int64, path)
    lists = _column(chunk, "Scalars:scalars", _is_list_of(pa.types.is_float64), path)
    width = len(schema.STATE.get(chunk.entity, ())) or _width(lists)
    flat = _flat(lists, width)
    if flat is None or flat.null_count or not width:
        raise damaged(path, f"{chunk.entity} must hold {width} numbers per step")
    # Copied, so that nothing else of the chunk stays in memory.
    return steps.to_numpy().copy(), flat.to_numpy().reshape(-1, width).copy()


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


def _width(lists: pa.Array) -> int:
    """Return how many elements the first list has: how many links it is of, the engine reports."""
    return len(lists[0]) if len(lists) else 1


def _flat(lists: pa.Array, width: int) -> pa.Array | None:
    """Return what lists hold, one after the other; None where one has not `width` elements."""
    # What `flatten` does, which loads Arrow's library of computations for it.
    offsets = lists.offsets.to_numpy()
    if (np.diff(offsets) != width).any():
        return None
    return lists.values.slice(offsets[0], width * len(lists)) if len(lists) else lists.values[:0]


def _is_list_of(is_right: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda kind: pa.types.is_list(kind) and is_right(kind.value_type)
