"""Shows another recording in the same view: its bodies and heights in a different colour.

The layer gets the id of the recording beside which it is shown, so that the viewer shows both as
one.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
from rerun.blueprint import Blueprint
from rerun.chunk import Chunk, RrdReader

from drop_physics import colours
from drop_physics.recording import schema, writer

ALPHA = 0x60
"""Opacity, of 255, with which the other recording's shapes are drawn."""


@dataclass(frozen=True)
class Style:
    """Name and colour of the other recording's bodies and curves."""

    name: str
    colour: str


GOLDEN = Style(schema.GOLDEN, colours.GOLDEN)
COLOURS = (":colors", ":albedo_factor")
"""Rerun components that contain a colour."""


def write_other_layer(
    path: Path,
    other: Path,
    *,
    recording_id: str,
    labels: Collection[str] | None = None,
    style: Style = GOLDEN,
    blueprint: Blueprint | None = None,
    drawn: Iterable[Chunk] | None = None,
) -> None:
    """Write another recording's views as a layer for this recording.

    Parameters
    ----------
    path
        The file to write.
    other
        The other recording: a golden one, or that of another engine.
    recording_id
        The id of the recording beside which the other one is shown.
    labels
        Labels of the bodies to show, for a script; None for a drop.
    style
        The name and colour of these bodies.
    blueprint
        The layout for both recordings; None for that of the recording.
    drawn
        The chunks to show; None for those in the other recording, which a script's trial lacks.
    """
    drawn = _read(other) if drawn is None else drawn
    chunks = _chunks(drawn, dict(_moved(labels, style.name)), style)
    writer.record(path, chunks, recording_id=recording_id, blueprint=blueprint, on_top=True)


def _moved(labels: Collection[str] | None, name: str) -> Iterator[tuple[str, str]]:
    """Yield entity paths in the other recording, each with its path in the layer."""
    if labels is None:
        yield schema.BOX, f"{schema.WORLD}/{name}"
        yield schema.HEIGHT_SIMULATED, f"{schema.HEIGHT}/{name}"
        return
    for label in labels:
        for parent in (schema.WORLD, schema.HEIGHT):
            yield f"{parent}/{label}", f"{parent}/{name}/{label}"


def is_drawn(recording: Path) -> bool:
    """Return whether a recording contains display data."""
    return any(chunk.entity_path.startswith(f"/{schema.WORLD}") for chunk in _read(recording))


def shapes_in(recording: Path) -> Iterator[Chunk]:
    """Yield the chunks of a script's recording that define shapes, and their links."""
    for chunk in _read(recording):
        top, rest = _parted(chunk.entity_path.removeprefix("/"))
        if top.startswith(f"{schema.WORLD}/") and rest and rest[-1].isdigit():
            yield chunk


def _read(recording: Path) -> Iterable[Chunk]:
    return RrdReader(recording).stream()


def _chunks(drawn: Iterable[Chunk], moved: dict[str, str], style: Style) -> Iterator[Chunk]:
    named: set[str] = set()
    for chunk in drawn:
        top, rest = _parted(chunk.entity_path.removeprefix("/"))
        if top not in moved:
            continue
        entity = "/".join([moved[top], *rest])
        if top.startswith(f"{schema.HEIGHT}/") and entity not in named:
            named.add(entity)
            yield writer.curve_style_chunk(entity, f"{style.name} {_name(top)}", style.colour)
        if "SeriesLines:names" not in chunk.to_record_batch().schema.names:
            yield _coloured(chunk.with_entity_path(entity), style.colour)


def _parted(entity: str) -> tuple[str, list[str]]:
    """Split an entity's path into its first two names and the rest."""
    names = entity.split("/")
    return "/".join(names[:2]), names[2:]


def _name(entity: str) -> str:
    return "[m]" if entity == schema.HEIGHT_SIMULATED else entity.partition("/")[2]


def _coloured(chunk: Chunk, colour: str) -> Chunk:
    """Return a chunk with its colours replaced, if it has any."""
    batch = chunk.to_record_batch()
    for index, field in enumerate(batch.schema):
        if field.name.endswith(COLOURS):
            lists = batch.column(index)
            transparent = writer.rgba(colour) - 0xFF + ALPHA
            values = pa.array([transparent] * len(lists.values), pa.uint32())
            column = pa.ListArray.from_arrays(lists.offsets, values, type=field.type)
            batch = batch.set_column(index, field, column)
    (coloured,) = Chunk.from_record_batch(batch)
    return coloured
