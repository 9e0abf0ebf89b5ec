"""Read a recording back: from Rerun's chunks to our arrays.

Nothing is used unchecked. Samples, inputs and frames must have the digests that were written last;
the samples must be complete, in order and finite; scenario and engine must agree. A recording that
fails a check is damaged, and the error says why in one line.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import polars as pl

from pipeline.errors import RecordingError, ScenarioError
from pipeline.fields import counted, shown
from pipeline.messages import Message, shell_command
from pipeline.recording import columns, png, rows, rrd, schema
from pipeline.recording.checks import (
    check_camera,
    check_contacts,
    check_engine,
    check_parts,
    check_settings,
    check_states,
    damaged,
)
from pipeline.recording.columns import Properties
from pipeline.recording.contents import chunks_of, closing_of, gather
from pipeline.recording.digest import FrameDigest, inputs_digest
from pipeline.report import EngineReport
from pipeline.scenario import Camera, Scenario

T = TypeVar("T")

MOST_HELD = 4
"""Times a file's size, for its frames: PNG is already compressed, and equal ones are held once."""
FREELY_HELD = 1 << 26
"""Bytes of frames that any file may have."""


@dataclass(frozen=True)
class Recording:
    """What a recording holds, read back and checked."""

    path: Path
    recording_id: str
    scenario: Scenario
    engine: EngineReport
    camera: Camera | None
    states: pl.DataFrame
    """One row per sample and part, ordered by step, body and link: `step` and the columns of
    `schema.STATES`."""
    contacts: pl.DataFrame
    """One row per contact point, in step order: `step` and the columns of `schema.CONTACTS`."""
    partial: bool
    """Whether the recording was never finished: it holds what was written until then."""


def read(path: Path) -> Recording:
    """Read a recording; one whose name ends in `.part` may be unfinished.

    Raises
    ------
    RecordingError
        If it is missing, damaged, not a recording of ours, or not what was written.
    """
    parts: dict[str, list[pl.DataFrame]] = {entity: [] for entity in schema.TABLES}
    properties: dict[str, Properties] = {}
    recording_id, pictured = "", False
    for chunk in chunks_of(path):
        recording_id = chunk.recording_id
        pictured |= chunk.entity == schema.IMAGE
        if chunk.entity in parts:
            parts[chunk.entity].append(columns.rows(chunk, schema.TABLES[chunk.entity], path))
        elif chunk.entity.startswith("__properties/"):
            gather(properties, chunk, path)

    closing = closing_of(properties, path)
    scenario, camera = _inputs(properties, path)
    if pictured and camera is None:
        raise damaged(path, Message("it has frames, but no camera"))
    engine = _engine(properties[schema.ENGINE_PROPERTY], path)
    check_engine(engine, scenario, path)
    check_settings(engine, scenario, path)
    states, contacts = (
        rows.joined(parts[entity], table, path) for entity, table in schema.TABLES.items()
    )
    if states.is_empty():
        raise damaged(path, Message("it has no state"))
    check_parts(states, engine, path)
    samples = len(states) // (1 + engine.joints)
    _check_written(samples, states, contacts, scenario, closing, path)
    if closing is None:  # a batch's contacts are written before its states
        contacts = contacts.filter(pl.col("step") < samples)
    check_states(states, scenario, path)
    check_contacts(contacts, scenario, engine, samples, path)
    partial = closing is None
    return Recording(
        path, recording_id, scenario, engine, camera, states, contacts, partial=partial
    )


def recording_id(path: Path) -> str:
    """Return the id of a recording or layer.

    Raises
    ------
    RecordingError
        If it is missing, damaged, or not one of ours.
    """
    for chunk in chunks_of(path):
        return chunk.recording_id
    raise damaged(path, Message("it is empty"))


def is_recording(path: Path, *, of_script: bool = False) -> bool:
    """Whether a file is one recording of ours, of a drop or of a script.

    It may be unfinished, and of an older schema.
    """
    kind = schema.ORIGIN_PROPERTY if of_script else schema.SCENARIO_PROPERTY
    is_kind, ids = False, set()
    try:
        for chunk in rrd.chunks(path, unfinished=True):
            if chunk.application_id != schema.APPLICATION_ID:
                return False
            ids.add(chunk.recording_id)
            is_kind |= chunk.entity == f"__properties/{kind}"
    except (rrd.DamagedError, OSError):
        return False
    return is_kind and len(ids) == 1


def entities(path: Path) -> Iterator[str]:
    """Yield the entity of each chunk in a recording or layer.

    Raises
    ------
    RecordingError
        If it is missing, damaged, or not one of ours.
    """
    return (chunk.entity for chunk in chunks_of(path))


def frames(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the camera frames of a recording in step order: step and PNG.

    Raises
    ------
    RecordingError
        If the recording is missing or damaged.
    """
    pictures: dict[int, bytes] = {}
    properties: dict[str, Properties] = {}
    held, last = 0, b""
    for chunk in chunks_of(path):
        if chunk.entity == schema.IMAGE:
            for step, picture in columns.images(chunk, path):
                if pictures.get(step, picture) != picture:
                    raise damaged(path, Message("it has two frames of step {step}", step=step))
                if picture != last:
                    held, last = held + len(picture), picture
                if held > FREELY_HELD + MOST_HELD * path.stat().st_size:
                    raise damaged(path, Message("its frames take over {size:,} bytes", size=held))
                pictures[step] = last
        elif chunk.entity.startswith("__properties/"):
            gather(properties, chunk, path)

    closing, (scenario, camera) = closing_of(properties, path), _inputs(properties, path)
    pictures = dict(sorted(pictures.items()))
    _check_frames(pictures, scenario, camera, closing, path)
    yield from pictures.items()


def _check_frames(
    pictures: Mapping[int, bytes],
    scenario: Scenario,
    camera: Camera | None,
    closing: Properties | None,
    path: Path,
) -> None:
    """Check that the frames are those that the camera takes; an unfinished recording has fewer."""
    due = range(0, scenario.steps + 1, camera.capture_every) if camera else range(0)
    expected = due if closing is not None else due[: len(pictures)]
    if list(pictures) != list(itertools.islice(expected, len(pictures) + 1)):
        what = Message(
            "it must hold {frames}, got {count:,}",
            frames=counted(len(due), "frame"),
            count=len(pictures),
        )
        raise damaged(path, what)
    for step, picture in pictures.items():
        # A decoder allocates what the header claims.
        if camera is None or png.size_px(picture) != camera.size_px:
            what = Message("its frame at step {step} is not a PNG of the camera's size", step=step)
            raise damaged(path, what)
    if closing is None:
        return
    digest = FrameDigest()
    for step, picture in pictures.items():
        digest.update(step, picture)
    if (closing.get("frames"), closing.get("frames_sha256")) != (len(due), digest.hexdigest()):
        raise damaged(path, Message("its frames fail their checksum"))


# -- properties -----------------------------------------------------------------------------------


def _inputs(properties: Mapping[str, Properties], path: Path) -> tuple[Scenario, Camera | None]:
    """Return scenario and camera, checked."""
    if schema.ORIGIN_PROPERTY in properties:
        raise RecordingError(
            "{path} must be the recording of a drop, got that of a script; look at it with: "
            "{command}",
            path=path,
            command=shell_command("drop", "view", path),
        )
    names = (schema.SCENARIO_PROPERTY, schema.ENGINE_PROPERTY)
    for name in names:
        if name not in properties:
            raise damaged(path, Message("it lacks its {name} property", name=name))
    closing = properties.get(schema.RECORDING_PROPERTY)
    inputs = {key: value for key, value in properties.items() if key in schema.INPUT_PROPERTIES}
    if closing is not None and inputs_digest(inputs) != closing.get("inputs_sha256"):
        raise damaged(path, Message("its scenario, engine or camera fails its checksum"))
    camera = properties.get(schema.CAMERA_PROPERTY)
    try:
        scenario = _dataclass(Scenario, properties[schema.SCENARIO_PROPERTY])
        if camera is None:
            return scenario, None
        taken = _dataclass(Camera, camera)
    except (TypeError, ScenarioError) as error:
        what = Message("its scenario or camera is invalid ({error})", error=str(error))
        raise damaged(path, what) from None
    check_camera(taken, path)
    return scenario, taken


def _engine(values: Properties, path: Path) -> EngineReport:
    try:
        return EngineReport.from_properties(values)
    except RecordingError as error:
        raise damaged(path, error.in_options) from None


def _dataclass(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return the dataclass that a property holds; an unknown name is a ScenarioError."""
    unknown = values.keys() - {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if unknown:
        raise ScenarioError("this drop does not know {name}", name=shown(min(unknown)))
    return kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in values.items()})


# -- states ---------------------------------------------------------------------------------------


def _check_written(
    samples: int,
    states: pl.DataFrame,
    contacts: pl.DataFrame,
    scenario: Scenario,
    closing: Properties | None,
    path: Path,
) -> None:
    due = scenario.steps + 1
    if closing is not None and not samples == due == closing.get("samples"):
        what = Message(
            "it must hold {samples}, got {count:,}", samples=counted(due, "sample"), count=samples
        )
        raise damaged(path, what)
    if samples > due:
        what = Message(
            "it must hold at most {samples}, got {count:,}",
            samples=counted(due, "sample"),
            count=samples,
        )
        raise damaged(path, what)
    if closing is None:
        return
    if rows.digest_of(states, schema.STATES) != closing.get("state_sha256"):
        raise damaged(path, Message("its state fails its checksum"))
    if rows.digest_of(contacts, schema.CONTACTS) != closing.get("contacts_sha256"):
        raise damaged(path, Message("its contacts fail their checksum"))
