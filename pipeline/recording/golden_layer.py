"""A golden recording as a layer of another one: its bodies and their heights, in grey.

It carries the other recording's id, so that the viewer shows both as one.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import pyarrow as pa
from rerun.chunk import Chunk, RrdReader

from pipeline import colours
from pipeline.recording import schema, writer

ALPHA = 0x60
"""Of 255: what is under it is seen."""
COLOURS = (":colors", ":albedo_factor")
"""Components that say which colour something has."""


def write_golden_layer(
    path: Path, golden: Path, *, recording_id: str, labels: Collection[str] | None
) -> None:
    """Write what is to be seen of a golden recording that was read, and is what was written.

    Parameters
    ----------
    path
        The file to write.
    golden
        The golden recording.
    recording_id
        Of the recording that it is shown with.
    labels
        Labels of the bodies of a script that are to be seen; None for the body of a drop.
    """
    moved = dict(_moved(labels))
    writer.record(path, _chunks(golden, moved), recording_id=recording_id, blueprint=None)


def _moved(labels: Collection[str] | None) -> Iterator[tuple[str, str]]:
    """Yield entities of the golden recording, and where they are shown."""
    if labels is None:
        yield schema.BOX, f"{schema.WORLD}/{schema.GOLDEN}"
        yield schema.HEIGHT_SIMULATED, f"{schema.HEIGHT}/{schema.GOLDEN}"
        return
    for label in labels:
        for parent in (schema.WORLD, schema.HEIGHT):
            yield f"{parent}/{label}", f"{parent}/{schema.GOLDEN}/{label}"


def _chunks(golden: Path, moved: dict[str, str]) -> Iterator[Chunk]:
    for chunk in RrdReader(golden).stream():
        top, rest = _parted(chunk.entity_path.removeprefix("/"))
        if top not in moved:
            continue
        entity = "/".join([moved[top], *rest])
        if "SeriesLines:names" in chunk.to_record_batch().schema.names:
            yield writer.curve_style_chunk(entity, f"golden {_name(top)}", colours.GOLDEN)
        else:
            yield from _grey(chunk.with_entity_path(entity))


def _parted(entity: str) -> tuple[str, list[str]]:
    """Return the first two names of an entity's path, and the others."""
    names = entity.split("/")
    return "/".join(names[:2]), names[2:]


def _name(entity: str) -> str:
    return "[m]" if entity == schema.HEIGHT_SIMULATED else entity.partition("/")[2]


def _grey(chunk: Chunk) -> list[Chunk]:
    """Return a chunk with another colour, if it has any."""
    batch = chunk.to_record_batch()
    for index, field in enumerate(batch.schema):
        if field.name.endswith(COLOURS):
            lists = batch.column(index)
            grey = pa.array(
                [writer.rgba(colours.GOLDEN) - 0xFF + ALPHA] * len(lists.values), pa.uint32()
            )
            column = pa.ListArray.from_arrays(lists.offsets, grey, type=field.type)
            batch = batch.set_column(index, field, column)
    return Chunk.from_record_batch(batch)
