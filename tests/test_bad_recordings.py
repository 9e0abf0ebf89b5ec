"""Damaged recordings: every mutation of a real one gives correct numbers, or an error in one line.

"Right" means to the bit: the data read back from an accepted file equal those recorded, and every
number and picture is a function of them. Files are changed as bytes, as by a disk or a transfer,
and as chunks, as by a program; the latter also with new digests, as by somebody who wants the
change to pass.
"""

from __future__ import annotations

import io
import os
import random
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
import pytest
from conftest import rerun_rrd, some
from drop_physics import Camera, Scenario, analyze, check, render, simulate
from drop_physics.errors import RecordingError
from drop_physics.recording import columns, reader, rrd, schema, writer
from drop_physics.recording.digest import FrameDigest, closing_digest
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import contents, digests, read
from drop_physics.trace.tables import columns_of
from drop_physics.workers import Worker
from PIL import Image
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

pytestmark = pytest.mark.pybullet

FLIPS = 300
"""Number of flipped bits, one per file."""
SEED = 6
ENTITIES = tuple(f"/{entity}" for entity in schema.TABLES)
NUMBERS = {
    f"{table.entity}/{component}": len(columns_of(component))
    for table in schema.TABLES.values()
    for component in table.components
    if table.kind[component].base.kind == "f"
}
"""Float64 components, and their number of values per body or contact point."""
ROWS = {"state": 241, "contacts": 132}
"""Number of rows in the mutated recording: its box touches the floor with four corners from step
109 on."""
POINTS = 4
MEMORY_MB = 1000
CPU_S = 30
"""Limit on the processor time of a command [s]; one second is normal."""


@dataclass(frozen=True)
class Sound:
    """An undamaged recording, and the correct result of reading it."""

    path: Path
    data: bytes = field(repr=False)
    read: reader.Recording = field(repr=False)
    frames: dict[int, bytes] = field(repr=False)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Sound:
    path = tmp_path_factory.mktemp("sound") / "sound.rrd"
    simulate(Scenario(), path, camera=Camera(capture_every=40, size_px=(64, 48)))
    return Sound(path, path.read_bytes(), read(path), dict(frames(read(path))))


def refusal(path: Path, sound: Sound) -> dict[str, str]:
    """Return why a file is rejected, keyed by the unreadable part: all of it, or only its frames.

    Empty if it reads back, to the bit, as recorded.
    """
    try:
        recording = read(path)
    except RecordingError as error:
        return {"all": str(error)}
    assert recording.states.equals(sound.read.states)
    assert recording.contacts.equals(sound.read.contacts)
    assert (recording.scenario, recording.engine) == (sound.read.scenario, sound.read.engine)
    assert (recording.camera, recording.partial) == (sound.read.camera, False)
    try:
        pictures = dict(frames(recording))
    except RecordingError as error:
        return {"frames": str(error)}
    assert pictures == sound.frames
    return {}


def verdict(path: Path, sound: Sound) -> str:
    """Return `right`, or `refused` if the stages that need the unreadable part say so in one line.

    That each stage reads first, and then writes nothing, is tested with the command, below.
    """
    why = refusal(path, sound)
    if not why:
        return "right"
    ((what, line),) = why.items()
    if what == "frames":
        for stage in (render, lambda run: check(run, sound.path)):
            with pytest.raises(RecordingError) as raised:
                stage(path)
            assert str(raised.value) == line
        path.with_suffix(".png").unlink(missing_ok=True)  # the plot needs no frames
    assert str(path) in line
    assert len(line.splitlines()) == 1
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    return "refused"


# -- bytes ----------------------------------------------------------------------------------------


@pytest.mark.long
def test_flipped_bits_are_refused_or_change_nothing(sound: Sound, tmp_path: Path) -> None:
    """Flipped bits in the state count as damage; bits that affect no number may pass."""
    chance, path, verdicts = random.Random(SEED), tmp_path / "run.rrd", Counter[str]()
    for _ in range(FLIPS):
        data = bytearray(sound.data)
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
        verdicts[verdict(path, sound)] += 1
    assert verdicts.total() == FLIPS
    assert min(verdicts.values()) > FLIPS / 20


@pytest.mark.parametrize("percent", range(0, 100, 10))
def test_a_recording_cut_at_any_percent_is_refused(
    sound: Sound, tmp_path: Path, percent: int
) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(sound.data[: len(sound.data) * percent // 100])
    assert verdict(path, sound) == "refused"


@pytest.mark.parametrize("missing", [1, 31, 33])
def test_a_recording_cut_by_a_few_bytes_is_refused(
    sound: Sound, tmp_path: Path, missing: int
) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(sound.data[:-missing])
    assert verdict(path, sound) == "refused"


@pytest.mark.parametrize("percent", range(0, 101, 10))
def test_a_part_that_was_cut_gives_the_samples_before_the_cut(
    sound: Sound, tmp_path: Path, percent: int
) -> None:
    path = tmp_path / "run.rrd.part"
    path.write_bytes(sound.data[: len(sound.data) * percent // 100])
    try:
        recording = read(path)
    except RecordingError as error:  # the samples are one batch here: all present, or none
        recording, why = None, str(error)
    if recording is None:
        assert percent < 60, why
        return
    assert recording.partial == ("recording" not in properties_of(path))
    assert recording.states.equals(sound.read.states)
    assert recording.contacts.equals(sound.read.contacts)


def test_a_part_with_no_sample_yet_is_refused(sound: Sound, tmp_path: Path) -> None:
    """A filtering tool may write such a file; our writer saves whole batches."""
    closing = f"/__properties/{schema.RECORDING_PROPERTY}"
    path = rewritten(
        sound.path, tmp_path / "run.rrd.part", both(taken(lambda _: []), without(closing))
    )
    with pytest.raises(RecordingError, match="it has no state"):
        read(path)


def test_of_a_part_that_was_cut_before_its_states_the_contacts_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch's contacts are written first, so that no sample is ever read without them."""
    monkeypatch.setattr("drop_physics.stages.simulate.BATCH", 60)
    whole, path = tmp_path / "run.rrd", tmp_path / "run.rrd.part"
    simulate(Scenario(), whole, camera=None)
    expected, data = read(whole), whole.read_bytes()
    lengths = set()
    for percent in range(5, 100, 3):
        path.write_bytes(data[: len(data) * percent // 100])
        try:
            recording = read(path)
        except RecordingError:  # nothing was written yet
            continue
        samples = len(recording.states)
        lengths.add(samples)
        assert recording.states.equals(expected.states.head(samples))
        assert recording.contacts.equals(expected.contacts.filter(pl.col("step") < samples))
    assert lengths >= {60, 120, 180, 240}


BYTES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "one byte": lambda _: b"R",
    "only the header": lambda data: data[:12],
    "doubled": lambda data: data + data,
    "doubled without its header": lambda data: data + data[12:],
    "garbage at the end": lambda data: data + random.Random(1).randbytes(1000),
    "a byte at the end": lambda data: data + b"\0",
    "zeros at the end": lambda data: data + bytes(4096),
    "garbage at the start": lambda data: random.Random(2).randbytes(100) + data,
    "all zeros": lambda data: bytes(len(data)),
    "all garbage": lambda data: random.Random(3).randbytes(len(data)),
    "garbage after the header": lambda data: data[:12] + random.Random(4).randbytes(len(data)),
    "a text": lambda _: b"# not a recording\n" * 1000,
    "a page of zeros": lambda data: data[:40_000] + bytes(4096) + data[44_096:],
    "two pages swapped": lambda data: (
        data[:16384] + data[20480:24576] + data[16384:20480] + data[24576:]
    ),
    "backwards": lambda data: data[::-1],
    "an older format": lambda data: b"RRF1" + data[4:],
    "a message of 2^63 bytes": lambda data: data[:20] + b"\0\0\0\0\0\0\0\x80" + data[28:],
    "a message of 1 TB": lambda data: data[:20] + (10**12).to_bytes(8, "little") + data[28:],
    "a message of another kind": lambda data: data[:12] + b"\x09" + data[13:],
}


@pytest.mark.parametrize("kind", BYTES)
def test_other_damage_to_bytes_is_refused(sound: Sound, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(BYTES[kind](sound.data))
    assert verdict(path, sound) == "refused"


@pytest.mark.parametrize("claimed", [1 << 29, 1 << 40, (1 << 63) - 1])
def test_a_chunk_that_claims_to_be_huge_is_not_believed(
    sound: Sound, tmp_path: Path, claimed: int
) -> None:
    """The message states the unpacked size, which Rerun's own reader allocates unchecked."""
    head = next(rrd.chunks(sound.path)).position
    size = head + 64  # its field 3
    assert sound.data[size] == 0x18
    end = next(place for place in range(size + 1, size + 9) if sound.data[place] < 0x80) + 1
    grown = b"\x18" + varint(claimed)
    length = int.from_bytes(sound.data[head + 8 : head + 16], "little") + len(grown) - (end - size)
    path = tmp_path / "run.rrd"
    path.write_bytes(
        sound.data[: head + 8]
        + length.to_bytes(8, "little")
        + sound.data[head + 16 : size]
        + grown
        + sound.data[end:]
    )
    with pytest.raises(RecordingError, match="claims to unpack"):
        read(path)
    assert verdict(path, sound) == "refused"


def varint(value: int) -> bytes:
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + varint(rest) if rest else bytes([low])


# -- chunks ---------------------------------------------------------------------------------------

Batch = pa.RecordBatch
Change = Callable[[str, Batch], Iterator[Batch] | None]
"""Function from an entity and its rows to the rows written instead; None keeps them."""


def rewritten(source: Path, path: Path, change: Change, *, resealed: bool = False) -> Path:
    """Write a recording with a change applied; `resealed` updates its digests."""
    closing = f"/__properties/{schema.RECORDING_PROPERTY}"
    chunks: list[Chunk] = []
    for chunk in RrdReader(source).stream():
        if resealed and chunk.entity_path == closing:
            continue
        batches = change(chunk.entity_path, chunk.to_record_batch())
        if batches is None:
            chunks.append(chunk)
        else:
            chunks += [chunk for batch in batches for chunk in Chunk.from_record_batch(batch)]
    write(path, chunks)
    if resealed:
        write(path, [*chunks, seal_of(path)])
    return path


def write(path: Path, chunks: list[Chunk]) -> None:
    LazyChunkStream.from_iter(chunks).write_rrd(
        path, application_id=schema.APPLICATION_ID, recording_id="rewritten"
    )


def seal_of(path: Path) -> Chunk:
    """Return the closing property with the correct digests for a file's contents."""
    try:
        held = contents(path)
    except RecordingError:  # of properties that are refused before their digest matters
        return writer.property_chunk(
            schema.RECORDING_PROPERTY, {"schema_version": schema.SCHEMA_VERSION}
        )
    pictures: dict[int, bytes] = {}
    for chunk in rrd.chunks(path):
        if chunk.entity == schema.IMAGE:
            pictures.update(columns.images(chunk, path))
    digest = FrameDigest()
    for step, png in sorted(pictures.items()):
        digest.update(step, png)
    closing = {
        "schema_version": schema.SCHEMA_VERSION,
        "samples": len(np.unique(held.sampled.table("state", 0, held.sampled.last + 1)["step"])),
        "frames": len(pictures),
        "frames_sha256": digest.hexdigest() if pictures else None,
        **{f"{name}_sha256": value for name, value in digests(held).items()},
    }
    closing |= {"closing_sha256": closing_digest(closing)}
    return writer.property_chunk(schema.RECORDING_PROPERTY, closing)


def properties_of(path: Path) -> dict[str, dict[str, Any]]:
    """Return all properties of a file."""
    return {
        chunk.entity.removeprefix("__properties/"): {
            key: value[0] if len(value) == 1 else value
            for key, value in chunk.batch.to_pylist()[0].items()
            if isinstance(value, list)
        }
        for chunk in rrd.chunks(path, unfinished=True)
        if chunk.entity.startswith("__properties/")
    }


def with_column(batch: Batch, name: str, values: pa.Array) -> Batch:
    index = batch.schema.get_field_index(name)
    kept = batch.schema.field(index)
    changed = pa.field(name, values.type, nullable=True, metadata=kept.metadata)
    return batch.set_column(index, changed, values)


def with_numbers(change: Callable[[np.ndarray], Any], *components: str) -> Change:
    """Change the values of components, shape (rows, values); of all components if none is named."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity not in ENTITIES:
            return None
        for component in components or NUMBERS:
            of, _, name = component.partition("/")
            if f"/{of}" == entity:
                column = batch.column(name)
                values = change(np.array(column.to_pylist()))
                batch = with_column(batch, name, pa.array(list(values), type=column.type))
        return iter([batch])

    return changed


def cast(kind: pa.DataType) -> Change:
    """Convert the positions to another type."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity != STATES:
            return None
        values = batch.column("position_m").to_pylist()
        if pa.types.is_string(kind.value_type):
            values = [[str(value) for value in row] for row in values]
        elif pa.types.is_integer(kind.value_type):
            values = [[round(value * 1000) for value in row] for row in values]
        return iter([with_column(batch, "position_m", pa.array(values, type=kind))])

    return changed


def stripped(component: str) -> Change:
    """Remove a component."""
    of, _, name = component.partition("/")

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity != f"/{of}":
            return None
        return iter([batch.remove_column(batch.schema.get_field_index(name))])

    return changed


def at_step(row: int, step: int) -> Change:
    """Move a row of the contacts to another step."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity != CONTACTS:
            return None
        steps = batch.column("sim_step").to_pylist()
        steps[row] = step
        order = pa.array(np.argsort(steps))
        return iter([with_column(batch, "sim_step", pa.array(steps, pa.int64())).take(order)])

    return changed


def taken(steps: Callable[[int], list[int]], *entities: str) -> Change:
    """Select and reorder rows of states, contacts, or both, by index."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity not in (entities or ENTITIES):
            return None
        return iter([batch.take(pa.array(steps(batch.num_rows), pa.int64()))])

    return changed


def without(*entities: str) -> Change:
    return lambda entity, _: iter([]) if entity in entities else None


def doubled(*entities: str) -> Change:
    return lambda entity, batch: iter([batch, batch]) if entity in entities else None


def with_property(name: str, key: str, value: Any) -> Change:
    """Change one value of a property, or add it; None removes it."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity != f"/__properties/{name}":
            return None
        index = batch.schema.get_field_index(key)
        if value is None:
            return iter([batch.remove_column(index)])
        values = value if isinstance(value, pa.Array) else pa.array([value])
        if index < 0:
            metadata = {"rerun:component": key, "rerun:kind": "data"}
            return iter(
                [batch.append_column(pa.field(key, values.type, metadata=metadata), values)]
            )
        return iter([with_column(batch, key, values)])

    return changed


def both(*changes: Change) -> Change:
    """Apply two changes, one after the other."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        batches, touched = [batch], False
        for change in changes:
            results = [change(entity, new_batches) for new_batches in batches]
            touched |= any(new_batches is not None for new_batches in results)
            batches = [
                new
                for old, new_batches in zip(batches, results, strict=True)
                for new in ([old] if new_batches is None else new_batches)
            ]
        return iter(batches) if touched else None

    return changed


def put(row: int, column: Any, value: Any) -> Callable[[np.ndarray], np.ndarray]:
    def changed(rows: np.ndarray) -> np.ndarray:
        rows = rows.copy()
        rows[row, column] = value
        return rows

    return changed


STATES, CONTACTS = ENTITIES
POSITION, VELOCITY = "state/position_m", "state/velocity_m_s"
ORIENTATION, SPIN = "state/orientation", "state/spin_rad_s"


def shuffled(rows: int) -> list[int]:
    return random.Random(SEED).sample(range(rows), rows)


HARMLESS: dict[str, Change] = {
    "unchanged": lambda _entity, _batch: None,
    "every frame twice": doubled(f"/{schema.IMAGE}"),
    "rows out of order": taken(shuffled),
    "states out of order": taken(shuffled, STATES),
    "contacts out of order": taken(shuffled, CONTACTS),
    "one chunk per row": lambda entity, batch: (
        iter([batch.slice(row, 1) for row in range(batch.num_rows)]) if entity in ENTITIES else None
    ),
    "without what is only looked at": without("/world/box", "/height/simulated", "/about"),
    "times of another scale": lambda entity, batch: (
        iter([with_column(batch, "sim_time", pa.array(range(batch.num_rows), pa.duration("ns")))])
        if entity in ENTITIES
        else None
    ),
}  # fmt: skip
REFUSED: dict[str, Change] = {
    **{f"without {name}": without(name) for name in ENTITIES},
    **{
        f"without {table.entity}/{name}": stripped(f"{table.entity}/{name}")
        for table in schema.TABLES.values()
        for name in table.components
    },
    **{f"without property {name}": without(f"/__properties/{name}") for name in schema.PROPERTIES
       if name != schema.ORIGIN_PROPERTY},
    **{f"doubled {name}": doubled(name) for name in ENTITIES},
    **{
        f"positions as {kind}": cast(pa.list_(kind))
        for kind in (pa.float32(), pa.int64(), pa.int16(), pa.string(), pa.float16())
    },
    **{
        f"{value} in {name} at {row}": with_numbers(put(row, 0, value), name)
        for name in NUMBERS
        for value, row in ((np.nan, 120), (-np.inf, ROWS[name.partition("/")[0]] - 1))
    },
    **{
        f"step {step} missing in {name}": taken(
            lambda rows, step=step: [row for row in range(rows) if row != step], *entities
        )
        for step in (0, 1, 120, 240)
        for name, entities in (("all", ENTITIES), ("states", (STATES,)))
    },
    **{
        f"step {step} twice in {name}": taken(
            lambda rows, step=step: [*range(rows), step], *entities
        )
        for step in (0, 120)
        for name, entities in (("all", ENTITIES), ("contacts", (CONTACTS,)))
    },
    "half the samples": taken(lambda rows: list(range(rows // 2))),
    "no samples": taken(lambda _: []),
    "two numbers per position": with_numbers(lambda rows: rows[:, :2], POSITION),
    "four numbers per position": with_numbers(lambda rows: rows[:, [0, 1, 2, 2]], POSITION),
    "two positions per part": with_numbers(lambda rows: np.hstack((rows, rows)), POSITION),
    "no position": with_numbers(lambda rows: rows[:, :0], POSITION),
    "one distance for four points": with_numbers(lambda rows: rows[:, :1], "contacts/distance_m"),
    "everything in millimetres": with_numbers(lambda rows: rows * 1000, POSITION),
    "the other sign": with_numbers(lambda rows: -rows, VELOCITY),
    "one unit in the last place": with_numbers(lambda rows: np.nextafter(rows, 2), POSITION),
    "one step of contacts missing": taken(
        lambda rows: [row for row in range(rows) if row != 60], CONTACTS
    ),
    "contacts before there are any": at_step(0, 60),
    "timestep in milliseconds": with_property("scenario", "timestep_s", [1000 / 240]),
    "timestep as a text": with_property("scenario", "timestep_s", ["1/240"]),
    "timestep nan": with_property("scenario", "timestep_s", [np.nan]),
    "a floor of 1": with_property("scenario", "floor", [1]),
    "gravity of the Moon": with_property("scenario", "gravity_m_s2", [-1.62]),
    "another body": with_property("scenario", "body", ["sphere_small.urdf"]),
    "mass in grams": with_property("engine", "mass_kg", [100.0]),
    "no mass": with_property("engine", "mass_kg", [0.0]),
    "mass nan": with_property("engine", "mass_kg", [np.nan]),
    "another mass of the links": with_property("engine", "link_masses_kg", [0.2]),
    "an inertia of one number": with_property("engine", "link_inertias_kg_m2", [1e-4]),
    "another inertia of the links": with_property(
        "engine", "link_inertias_kg_m2", [1e-4, 1e-4, 2e-4]
    ),
    "mass as a text": with_property("engine", "mass_kg", ["heavy"]),
    "inertia of two": with_property("engine", "inertia_kg_m2", [1.0, 2.0]),
    "joints as a text": with_property("engine", "joints", ["none"]),
    "frames of another size": with_property("camera", "size_px", [640, 480]),
    "a later schema": with_property("recording", "schema_version", [schema.SCHEMA_VERSION + 1]),
    "more samples": with_property("recording", "samples", [999]),
    "another digest": with_property("recording", "state_sha256", ["0" * 64]),
    "another digest of contacts": with_property("recording", "contacts_sha256", ["0" * 64]),
    **{
        f"engine without {key}": with_property("engine", key, None)
        for key in ("timestep_s", "gravity_m_s2", "mass_kg", "inertia_kg_m2", "restitution",
                    "rest_height_m", "joints", "shape", "floor_restitution")
    },
    **{
        f"scenario without {key}": with_property("scenario", key, None)
        for key in ("timestep_s", "height_m", "gravity_m_s2", "body")
    },
    **{
        f"recording without {key}": with_property("recording", key, None)
        for key in ("schema_version", "samples", "state_sha256", "contacts_sha256",
                    "frames_sha256", "inputs_sha256")
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", HARMLESS)
def test_what_changes_no_number_is_read_as_it_was(sound: Sound, tmp_path: Path, kind: str) -> None:
    path = rewritten(sound.path, tmp_path / "run.rrd", HARMLESS[kind])
    assert verdict(path, sound) == "right"


@pytest.mark.parametrize("kind", some(REFUSED, 3))
def test_chunks_that_were_changed_are_refused(sound: Sound, tmp_path: Path, kind: str) -> None:
    path = rewritten(sound.path, tmp_path / "run.rrd", REFUSED[kind])
    assert verdict(path, sound) == "refused"


def test_every_bit_of_the_state_matters(sound: Sound, tmp_path: Path) -> None:
    """Flip single bits of states and contacts, in any component, row, value and bit position."""
    chance, path = random.Random(SEED), tmp_path / "run.rrd"
    for _ in range(25):
        component, bit = chance.choice([*NUMBERS]), chance.randrange(64)
        of = component.partition("/")[0]
        row = chance.randrange(ROWS[of])
        number = chance.randrange(NUMBERS[component] * (POINTS if of == "contacts" else 1))

        def flip(
            rows: np.ndarray, row: int = row, number: int = number, bit: int = bit
        ) -> np.ndarray:
            rows = rows.copy()
            rows.view(np.uint64)[row, number] ^= np.uint64(1 << bit)
            return rows

        change = with_numbers(flip, component)
        assert verdict(rewritten(sound.path, path, change), sound) == "refused"


def test_two_recordings_in_one_file_are_refused(sound: Sound, tmp_path: Path) -> None:
    """Such files are made by `rerun rrd merge`, and by two processes that write to one file."""
    other, path = tmp_path / "other.rrd", tmp_path / "both" / "run.rrd"
    path.parent.mkdir()
    simulate(Scenario(height_m=2.0), other, camera=None)
    rerun_rrd("merge", sound.path, other, "-o", path)
    assert verdict(path, sound) == "refused"


# -- altered together with its digests ------------------------------------------------------------

NOTICED: dict[str, Change] = {
    "one height": with_numbers(put(60, 2, 0.7), POSITION),
    "one height by one unit in the last place": with_numbers(
        lambda rows: put(60, 2, float(np.nextafter(rows[60, 2], 2)))(rows), POSITION
    ),
    "one velocity": with_numbers(put(60, 2, -2.0), VELOCITY),
    "a drift to the side": with_numbers(put(60, 0, 1e-12), POSITION),
    "one orientation": with_numbers(put(60, 0, 1e-6), ORIENTATION),
    "one spin": with_numbers(put(60, 0, 1e-6), SPIN),
    "velocities in km/h": with_numbers(lambda rows: rows * 3.6, VELOCITY),
    "the fall without its contacts": without(CONTACTS),
    "another timestep everywhere": both(
        with_property("scenario", "timestep_s", [1 / 480]),
        with_property("scenario", "duration_s", [0.5]),
        with_property("engine", "timestep_s", [1 / 480]),
    ),
    "another gravity everywhere": both(
        with_property("scenario", "gravity_m_s2", [-9.8]),
        with_property("engine", "gravity_m_s2", [0.0, 0.0, -9.8]),
    ),
    "other coordinates": with_property("scenario", "coordinates", ["maximal"]),
}  # fmt: skip


@pytest.mark.parametrize("kind", some(NOTICED, 2))
def test_what_was_altered_together_with_its_digests_is_noticed_by_the_law(
    sound: Sound, tmp_path: Path, kind: str
) -> None:
    path = rewritten(sound.path, tmp_path / "run.rrd", NOTICED[kind], resealed=True)
    assert "law-mismatch" in {finding.code for finding in analyze(path).findings}


def test_another_damping_is_noticed_by_the_law(tmp_path: Path) -> None:
    simulate(Scenario(linear_damping=0.1), tmp_path / "damped.rrd", camera=None)
    change = with_property("scenario", "linear_damping", [0.11])
    path = rewritten(tmp_path / "damped.rrd", tmp_path / "run.rrd", change, resealed=True)
    assert "law-mismatch" in {finding.code for finding in analyze(path).findings}


def test_with_its_digests_anew_and_no_change_nothing_is_noticed(
    sound: Sound, tmp_path: Path
) -> None:
    path = rewritten(sound.path, tmp_path / "run.rrd", lambda *_: None, resealed=True)
    assert verdict(path, sound) == "right"
    assert "law-mismatch" not in {finding.code for finding in analyze(path).findings}


OF_ANOTHER_DROP: dict[str, Change] = {
    "an option that nobody knows": with_property("scenario", "wind_m_s", [10.0]),
    "an engine that nobody knows": with_property("scenario", "engine", ["newton"]),
    "a value that was not reported": with_property("engine", "mass_kg", None),
}
"""Changes as an earlier or later version may have written them, with valid digests."""


@pytest.mark.parametrize("kind", OF_ANOTHER_DROP)
def test_inputs_that_this_drop_does_not_know_are_one_line(
    sound: Sound, tmp_path: Path, kind: str
) -> None:
    change = OF_ANOTHER_DROP[kind]
    path = rewritten(sound.path, tmp_path / "run.rrd", change, resealed=True)
    assert verdict(path, sound) == "refused"


def blob(*values: Any, kind: pa.DataType) -> pa.Array:
    return pa.array([list(values)], type=pa.list_(kind))


OTHER_KINDS: dict[str, Change] = {
    **{
        f"{values.type.value_type} in {name}.{key}": with_property(name, key, values)
        for name, key in (("engine", "mass_kg"), ("scenario", "height_m"), ("camera", "yaw_deg"))
        for values in (
            blob(1.0, kind=pa.float32()),
            blob(2**62, kind=pa.timestamp("s")),
            blob(b"x", kind=pa.binary()),
            blob(1, kind=pa.decimal128(10)),
            blob(2**64 - 1, kind=pa.uint64()),
            blob([1.0], kind=pa.list_(pa.float64())),
            blob({"a": 1}, kind=pa.struct([("a", pa.int64())])),
            blob(None, kind=pa.null()),
            blob(None, 1.0, kind=pa.float64()),
            blob("x", kind=pa.large_string()),
        )
    },
}
"""Changes to columns that none of our digests cover."""


@pytest.mark.parametrize("kind", OTHER_KINDS)
def test_columns_of_other_kinds_are_one_line(sound: Sound, tmp_path: Path, kind: str) -> None:
    path = rewritten(sound.path, tmp_path / "run.rrd", OTHER_KINDS[kind])
    assert verdict(path, sound) == "refused"


# -- frames that lie ------------------------------------------------------------------------------


def with_frames(change: Callable[[int, bytes], bytes | None]) -> Change:
    """Replace the images by step; None removes one."""

    def changed(entity: str, batch: Batch) -> Iterator[Batch] | None:
        if entity != f"/{schema.IMAGE}":
            return None
        column = batch.column("EncodedImage:blob")
        (step,), png = batch.column("sim_step").to_pylist(), bytes(column[0].as_py()[0])
        picture = change(step, png)
        if picture is None:
            return iter([])
        again = pa.array([[list(picture)]], type=column.type)
        return iter([with_column(batch, "EncodedImage:blob", again)])

    return changed


def png_chunk(kind: bytes, data: bytes) -> bytes:
    return len(data).to_bytes(4) + kind + data + zlib.crc32(kind + data).to_bytes(4)


def picture_as(kind: str, size: tuple[int, int] = (64, 48)) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", size).save(stream, kind)
    return stream.getvalue()


HUGE = png_chunk(b"IHDR", (30_000).to_bytes(4) * 2 + b"\x08\x02\0\0\0")
ZEROS = zlib.compress(bytes(10**6))
LYING_FRAMES: dict[str, Change] = {
    "none of them": with_frames(lambda *_: None),
    "one missing": with_frames(lambda step, png: None if step == 80 else png),
    "only the first": with_frames(lambda step, png: png if step == 0 else None),
    "frames without a camera": without("/__properties/camera"),
    "half of it zeros": with_frames(lambda _, png: png[:60] + bytes(len(png) - 60)),
    "an empty one": with_frames(lambda *_: b""),
    "a gif": with_frames(lambda *_: picture_as("gif")),
    "an EPS": with_frames(lambda *_: picture_as("eps")),
    "of another size": with_frames(lambda *_: picture_as("png", (64, 49))),
    "a second header": with_frames(lambda _, png: png[:33] + HUGE + png[33:]),
    "a text that unpacks": with_frames(
        lambda _, png: png[:33] + png_chunk(b"zTXt", b"a\0\0" + ZEROS) + png[33:]
    ),
    "more behind the end": with_frames(lambda _, png: png + b"%!PS"),
    "two of every step": lambda entity, batch: (
        iter([batch, *(with_frames(lambda *_: picture_as("png"))(entity, batch) or ())])
        if entity == f"/{schema.IMAGE}"
        else None
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", some(LYING_FRAMES, 3))
def test_frames_that_were_changed_are_refused(sound: Sound, tmp_path: Path, kind: str) -> None:
    path = rewritten(sound.path, tmp_path / "run.rrd", LYING_FRAMES[kind])
    assert verdict(path, sound) == "refused"


def test_a_frame_whose_pixels_cannot_be_decoded_is_refused(sound: Sound, tmp_path: Path) -> None:
    """The frame has the structure of a PNG of the right size, and a valid digest."""

    def spoilt(_: int, png: bytes) -> bytes:
        end = png.index(b"IDAT") - 4
        return png[:end] + png_chunk(b"IDAT", b"no pixels") + png_chunk(b"IEND", b"")

    path = rewritten(sound.path, tmp_path / "run.rrd", with_frames(spoilt), resealed=True)
    for stage in (render, lambda run: check(run, sound.path)):
        with pytest.raises(RecordingError, match="frame"):
            stage(path)
    assert not path.with_suffix(".gif").exists()


# -- bombs ----------------------------------------------------------------------------------------


def arrow(columns: dict[str, pa.Array], *, entity: str = "/x", compression: str = "") -> pa.Buffer:
    """Return a chunk in Arrow's stream format: a schema, and one batch of rows."""
    batch = pa.record_batch(
        list(columns.values()),
        schema=pa.schema(
            [pa.field(name, values.type) for name, values in columns.items()],
            metadata={"rerun:entity_path": entity},
        ),
    )
    sink, how = pa.BufferOutputStream(), pa.ipc.IpcWriteOptions(compression=compression or None)
    with pa.ipc.new_stream(sink, batch.schema, options=how) as stream:
        stream.write_batch(batch)
    return sink.getvalue()


def message(data: pa.Buffer, *, more: bytes = b"") -> bytes:
    """Return a chunk as a message of the file format, compressed as Rerun does."""

    def field(number: int, value: int | bytes) -> bytes:
        if isinstance(value, int):
            return varint(number << 3) + varint(value)
        return varint(number << 3 | 2) + varint(len(value)) + value

    store = field(1, 1) + field(2, b"bomb") + field(3, field(1, schema.APPLICATION_ID.encode()))
    packed = pa.compress(data, codec="lz4_raw", asbytes=True)
    body = field(1, store) + field(2, 2) + field(3, data.size) + field(5, packed) + more
    return struct.pack("<QQ", rrd.CHUNK, len(body)) + body


def zeros(count: int, kind: pa.DataType | None = None) -> pa.Array:
    kind = kind or pa.float64()
    return pa.Array.from_buffers(
        kind, count, [None, pa.py_buffer(bytes(count * kind.bit_width // 8))]
    )


def one_list(values: pa.Array) -> pa.Array:
    return pa.ListArray.from_arrays(pa.array([0, len(values)], pa.int32()), values)


def resting(rows: int) -> dict[str, pa.Array]:
    lists = pa.ListArray.from_arrays(
        pa.array(range(0, 3 * rows + 1, 3), pa.int32()), zeros(3 * rows)
    )
    return {"sim_step": zeros(rows, pa.int64()), "position_m": lists}


NOTHING = pa.Array.from_buffers(pa.null(), (1 << 31) - 1, [None])
BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "a property of 250 MB": (
        lambda: message(arrow({"mass_kg": one_list(zeros(10**8, pa.uint8()))},
                              entity="/__properties/engine")),
        "unpacks to over",
    ),
    "a property of 1 MB": (
        lambda: message(arrow({"mass_kg": one_list(zeros(10**5))}, entity="/__properties/engine")),
        "its property engine takes",
    ),
    "zeros for a state": (
        lambda: message(arrow(resting(100_000), entity=STATES)) * 20,
        "claims 100,000 rows",
    ),
    "rows of nothing": (lambda: message(arrow({"x": NOTHING})), "claims 2,147,483,647 rows"),
    "zeros that nobody asked for": (
        lambda: message(arrow({"x": one_list(zeros(10**6))})) * 100,
        "unpacks to over",
    ),
    "columns packed once more": (
        lambda: message(arrow({"x": one_list(zeros(10**6))}, compression="zstd")),
        "unknown encoding",
    ),
    "10,000 columns": (
        lambda: message(arrow({f"c{number}": pa.nulls(1) for number in range(10_000)})),
        "has an unknown header",
    ),
    "a name of 10,000 characters": (
        lambda: message(arrow({"x": pa.nulls(1)}, entity="/" + "x" * 10_000)), "a name of",
    ),
    "a million fields": (
        lambda: message(arrow({"x": pa.nulls(1)}), more=b"\x78\0" * 10**6), "header",
    ),
    "a hundred thousand messages": (
        lambda: struct.pack("<QQ", rrd.STORE, 0) * 100_000, "messages in",
    ),
}  # fmt: skip
"""Chunks placed at the start of a file, and the expected error for each."""


def with_bomb(sound: Sound, path: Path, kind: str) -> Path:
    path.write_bytes(sound.data[:12] + BOMBS[kind][0]() + sound.data[12:])
    return path


@pytest.mark.parametrize("kind", some(BOMBS, 2))
def test_what_unpacks_to_far_more_than_it_is_is_refused(
    sound: Sound, tmp_path: Path, kind: str
) -> None:
    path = with_bomb(sound, tmp_path / "run.rrd", kind)
    with pytest.raises(RecordingError, match=BOMBS[kind][1]):
        read(path)
    assert verdict(path, sound) == "refused"


def test_a_recording_is_closed_by_a_digest_of_each_of_its_many_series(tmp_path: Path) -> None:
    """Each body with joints, each constraint and each client adds a digest of 64 characters."""
    closing = {"series_sha256": [f"{number:064x}" for number in range(100_000)]}
    made = writer.property_chunk(schema.RECORDING_PROPERTY, closing).to_record_batch()
    entity = f"__properties/{schema.RECORDING_PROPERTY}"
    chunk = rrd.Chunk(schema.APPLICATION_ID, "many", entity, made, made.nbytes, 0)
    assert columns.values(chunk, tmp_path) == closing


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    """Return a worker process that runs the command within limits."""
    with Worker() as worker:
        yield worker


def test_a_bomb_takes_little_memory(sound: Sound, tmp_path: Path, worker: Worker) -> None:
    """Peak memory may exceed the 150 MB of interpreter and libraries, but stays far below 1 GB."""
    for kind in ("a property of 250 MB", "zeros for a state", "zeros that nobody asked for"):
        path = with_bomb(sound, tmp_path / "run.rrd", kind)
        worker.ask("command:measured", ["analyze", path], tmp_path, CPU_S)
        done, peak_mb = worker.answer()
        assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
        assert peak_mb < MEMORY_MB


# -- what is not a file ---------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["missing", "folder", "pipe", "device"])
def test_what_is_not_a_plain_file_is_one_line_and_no_waiting(
    sound: Sound, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / "run.rrd"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path = Path("/dev/zero")
    why = {
        "missing": "does not exist; make it with drop record or drop simulate",
        "folder": "is a folder; name a recording in it",
    }.get(kind, "is not a recording: it is not a regular file")
    stages: list[Callable[[], object]] = [
        lambda: read(path),
        lambda: list(frames(read(path))),
        lambda: reader.recording_id(path),
        lambda: check(path, sound.path),
    ]
    if kind != "missing":
        stages.append(lambda: check(sound.path, path))
    for stage in stages:
        with pytest.raises(RecordingError, match=f"{path} {why}"):
            stage()


def test_a_script_in_place_of_its_recording_is_recorded_first(tmp_path: Path) -> None:
    path = tmp_path / "arm.py"
    path.write_text("import pybullet")
    with pytest.raises(RecordingError, match="record it first: drop record"):
        read(path)


# -- the command ----------------------------------------------------------------------------------

SAMPLE = (
    "flip 0", "flip 1", "cut 70", "doubled", "without /contacts", "nan in state/position_m at 120",
    *(f"flip {number}" for number in range(2, 8)), "cut 30", "cut 99", "a text",
    "a message of 1 TB", "all garbage", "positions as float",
)  # fmt: skip


@pytest.mark.parametrize("kind", some(SAMPLE, 1))
def test_the_command_says_one_line_soon_and_in_little_memory(
    sound: Sound, tmp_path: Path, worker: Worker, kind: str
) -> None:
    path = tmp_path / "run.rrd"
    name, _, number = kind.partition(" ")
    if name == "flip":
        data, chance = bytearray(sound.data), random.Random(int(number))
        data[chance.randrange(80_000)] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
    elif name == "cut":
        path.write_bytes(sound.data[: len(sound.data) * int(number) // 100])
    elif kind in BYTES:
        path.write_bytes(BYTES[kind](sound.data))
    else:
        rewritten(sound.path, path, REFUSED[kind])
    why = refusal(path, sound)
    for arguments in (
        ["analyze", path],
        ["render", path],
        ["check", path, "--against", sound.path],
    ):
        before = {file.name for file in tmp_path.iterdir()}
        worker.ask("command:measured", arguments, tmp_path, CPU_S)
        done, peak_mb = worker.answer()
        refused = "all" in why or ("frames" in why and arguments[0] != "analyze")
        assert done.returncode == (1 if refused else 0), done.stderr
        assert peak_mb < MEMORY_MB
        if refused:
            assert done.stdout == ""
            assert len(done.stderr.splitlines()) == 1
            assert done.stderr.startswith(f"drop: {path}")
            after = {file.name for file in tmp_path.iterdir()} - before
            assert after <= ({"run.png"} if "frames" in why else set())
