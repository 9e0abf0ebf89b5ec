"""Read a recording back: the only file that turns Rerun's chunks into our arrays.

Nothing is believed that was not checked: the samples must be complete and finite, and the state
must have the digest that was written last.
"""

from __future__ import annotations

import dataclasses
import hashlib
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray
from rerun.chunk import Chunk, RrdReader

from pipeline.errors import RecordingError, ScenarioError
from pipeline.recording import schema
from pipeline.scenario import Camera, Scenario

Float64 = NDArray[np.float64]
Properties = dict[str, Any]
T = TypeVar("T")


@dataclass(frozen=True)
class Recording:
    """What a recording holds, read back and checked."""

    path: Path
    recording_id: str
    scenario: Scenario
    engine: Properties
    camera: Camera | None
    states: pl.DataFrame
    """One row per sample in step order: `step` and the columns of `schema.STATE`."""
    partial: bool
    """Whether the recording was never finished: it holds what was written before it stopped."""

    def column(self, name: str) -> Float64:
        """Return one column of the states, shape (samples,)."""
        return self.states[name].to_numpy()

    def columns(self, *names: str) -> Float64:
        """Return several columns of the states, shape (samples, columns)."""
        return self.states.select(names).to_numpy()


def read(path: Path) -> Recording:
    """Read a recording.

    Raises
    ------
    RecordingError
        If it is missing, damaged, no recording of ours, or its state is not what was written.
    """
    recording_id = _open(path)[1]
    state: dict[str, list[pl.DataFrame]] = {entity: [] for entity in schema.STATE}
    properties: dict[str, Properties] = {}
    for chunk in _chunks(path, [f"/{entity}" for entity in schema.STATE] + ["/__properties/**"]):
        entity = chunk.entity_path.removeprefix("/")
        if entity in state:
            state[entity].append(_scalars(chunk, schema.STATE[entity], path))
        elif chunk.is_static:
            properties[entity.removeprefix("__properties/")] = _values(chunk)

    try:
        scenario = _dataclass(Scenario, properties[schema.SCENARIO_PROPERTY])
        engine = properties[schema.ENGINE_PROPERTY]
        camera_values = properties.get(schema.CAMERA_PROPERTY)
        camera = None if camera_values is None else _dataclass(Camera, camera_values)
    except (KeyError, TypeError, ScenarioError) as error:
        raise RecordingError(
            f"{path} lacks its scenario or engine property ({error}); {_AGAIN}"
        ) from None
    closing = properties.get(schema.RECORDING_PROPERTY)
    states = _joined(state, path)
    if closing is not None:
        _check_complete(states, scenario, closing, path)
    return Recording(path, recording_id, scenario, engine, camera, states, partial=closing is None)


def frames(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the camera frames of a recording in step order: step and PNG.

    Raises
    ------
    RecordingError
        If the recording is missing or damaged.
    """
    found: dict[int, bytes] = {}
    for chunk in _chunks(path, [f"/{schema.IMAGE}"]):
        batch = chunk.to_record_batch()
        steps = batch.column(schema.STEP_TIMELINE).to_pylist()
        for step, blob in zip(steps, batch.column("EncodedImage:blob"), strict=True):
            found[step] = blob.values[0].values.to_numpy().tobytes()
    yield from sorted(found.items())


_AGAIN = "record it again with: drop simulate"


def _open(path: Path) -> tuple[RrdReader, str]:
    if not path.is_file():
        raise RecordingError(
            f"{path} is no recording: there is no such file; see: drop simulate --help"
        )
    try:
        with warnings.catch_warnings():  # Rerun warns of a missing footer; we say so ourselves
            warnings.simplefilter("ignore")
            reader = RrdReader(path)
            stores = reader.recordings()
    except (RuntimeError, ValueError, OSError) as error:
        reason = str(error).rsplit(": ", 1)[-1]
        raise RecordingError(f"{path} is no Rerun recording: {reason}; {_AGAIN}") from None
    if len(stores) != 1:
        raise RecordingError(f"{path} must hold one recording, got {len(stores)}; {_AGAIN}")
    if stores[0].application_id != schema.APPLICATION_ID:
        raise RecordingError(
            f"{path} must be a recording made by drop, got one of {stores[0].application_id!r}; "
            f"{_AGAIN}"
        )
    return reader, stores[0].recording_id


def _chunks(path: Path, content: list[str]) -> Iterator[Chunk]:
    reader, _ = _open(path)
    try:
        yield from reader.stream().filter(content=content)
    except (RuntimeError, ValueError) as error:
        raise RecordingError(f"{path} is damaged: {error}; {_AGAIN}") from None


def _scalars(chunk: Chunk, columns: tuple[str, ...], path: Path) -> pl.DataFrame:
    batch = chunk.to_record_batch()
    try:
        steps = batch.column(schema.STEP_TIMELINE).to_numpy()
        flat = batch.column("Scalars:scalars").flatten().to_numpy()
        rows = flat.astype(np.float64, casting="safe").reshape(len(steps), len(columns))
    except (KeyError, ValueError, TypeError) as error:
        raise RecordingError(
            f"{path} is damaged in {chunk.entity_path}: {error}; {_AGAIN}"
        ) from None
    return pl.DataFrame({"step": steps} | dict(zip(columns, rows.T, strict=True)))


def _values(chunk: Chunk) -> Properties:
    row = chunk.to_record_batch().to_pylist()[0]
    listed = {key: value for key, value in row.items() if key != "rerun.controls.RowId"}
    return {key: v[0] if len(v) == 1 else v for key, v in listed.items() if v is not None}


def _dataclass(kind: type[T], values: Mapping[str, Any]) -> T:
    known = {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    given = {key: tuple(v) if isinstance(v, list) else v for key, v in values.items()}
    return kind(**{key: value for key, value in given.items() if key in known})


def _joined(state: Mapping[str, list[pl.DataFrame]], path: Path) -> pl.DataFrame:
    missing = [entity for entity, parts in state.items() if not parts]
    if missing:
        raise RecordingError(f"{path} holds no {', '.join(missing)}; {_AGAIN}")
    tables = [pl.concat(parts).sort("step") for parts in state.values()]
    whole = tables[0]
    for table in tables[1:]:
        whole = whole.join(table, on="step", how="inner", maintain_order="left")
    steps = whole["step"].to_numpy()
    if not np.array_equal(steps, np.arange(len(steps))):
        raise RecordingError(f"{path} must hold steps 0, 1, 2, … once each, and does not; {_AGAIN}")
    return whole


def _check_complete(
    states: pl.DataFrame, scenario: Scenario, closing: Properties, path: Path
) -> None:
    if len(states) != scenario.steps + 1 or len(states) != closing["samples"]:
        raise RecordingError(
            f"{path} must hold {scenario.steps + 1} samples, got {len(states)}; {_AGAIN}"
        )
    rows = states.select(schema.STATE_COLUMNS).to_numpy()
    if hashlib.sha256(np.ascontiguousarray(rows).tobytes()).hexdigest() != closing["state_sha256"]:
        raise RecordingError(
            f"{path} is damaged: its state is not the one that was written; {_AGAIN}"
        )
