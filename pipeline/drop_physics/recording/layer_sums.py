"""Stores impulses computed after recording in the analysis layer, and reads them back.

The entities are the same as in the recording of a short run, so that a viewer shows both in the
same way. A digest protects the data: impulses whose digest is wrong are computed again.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from drop_physics.errors import RecordingError
from drop_physics.recording import columns, json_rows, schema, writer
from drop_physics.recording.contents import chunks_of
from drop_physics.recording.digest import Digests, ToldDigest
from drop_physics.recording.writer import Chunk, Times
from drop_physics.trace.events import At, ContactRows, Event, ImpulseCause, Impulses, PairFriction
from drop_physics.trace.sums import LaterSums

TOLD = {schema.CAUSES: ImpulseCause, schema.PAIRS: PairFriction}


def sums_chunks(sums: LaterSums) -> Iterator[Chunk]:
    """Yield the chunks of impulses that were computed after recording."""
    made, told = Digests(), ToldDigest()
    events: list[Event] = [*sums.causes.values(), *sums.pairs]
    for event in events:
        entity, moment, values = json_rows.row_of(event)
        text = json_rows.packed(values)
        told.update(entity, moment.step, moment.call, text)
        yield writer.texts_chunk(entity, writer.times_of(moment), [text])
    for each in sums.within(0, 1 << 62):
        if isinstance(each, Impulses):
            made.add_impulses(each)
            yield writer.impulses_chunk(each)
        elif len(each.contacts):
            rows = each.contacts
            made.tables[schema.CONTACTS.entity].update(rows)
            touching = rows["step"][writer.first_of_steps(rows)]
            at = Times(touching, each.times_s[np.searchsorted(each.steps, touching)])
            yield writer.rows_chunk(schema.CONTACTS, rows, at)
    yield writer.texts_chunk(
        schema.EXPLAINED, writer.times_of(At(0, 0.0, 0)), [json.dumps(_digests(made, told))]
    )


def _digests(made: Digests, told: ToldDigest) -> dict[str, object]:
    contacts = made.tables[schema.CONTACTS.entity].hexdigest()
    return {"impulses": made.impulses, "contacts": contacts, "told": told.hexdigest()}


def sums_in(layer: Path, recording_id: str) -> LaterSums | None:
    """Return the impulses stored in a layer; None if there are none, or some are missing."""
    sums, made, told = LaterSums(), Digests(), ToldDigest()
    digests: dict[str, object] | None = None
    rows: dict[str, list[tuple[At, str]]] = {entity: [] for entity in TOLD}
    events: list[Event] = []
    try:
        for chunk in chunks_of(layer) if layer.is_file() else ():
            entity = chunk.entity
            if chunk.recording_id != recording_id:
                return None
            if entity in rows:
                for at, text in columns.told(chunk, layer):
                    told.update(entity, at.step, at.call, text)
                    rows[entity].append((at, text))
            elif entity.startswith(f"{schema.IMPULSES}/"):
                acted = columns.impulses(chunk, layer)
                made.add_impulses(acted)
                sums.add([acted])
            elif entity == schema.CONTACTS.entity:
                table = columns.rows(chunk, schema.CONTACTS, layer)
                made.tables[entity].update(table)
                steps = np.unique(table["step"])
                sums.add([ContactRows(-1, steps, columns.times_s(chunk), table)])
            elif entity == schema.EXPLAINED:
                ((_, text),) = columns.told(chunk, layer)
                digests = json.loads(text)
        held = {
            entity: [(at, json.loads(text)) for at, text in its] for entity, its in rows.items()
        }
        for kind in TOLD.values():
            events += json_rows.events(held, kind)
        sums.add(events)
    except (RecordingError, ValueError, TypeError, KeyError, IndexError, AttributeError):
        return None
    return sums if digests == _digests(made, told) else None
