"""What lies in a file of ours, whatever it is a recording of: chunks, and its properties."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path

from pipeline.errors import RecordingError
from pipeline.fields import shown
from pipeline.files.outputs import free_part_of, is_part
from pipeline.recording import columns, rrd, schema
from pipeline.recording.checks import again, damaged
from pipeline.recording.columns import Properties

MOST_VALUES = 1000
"""Of a property; the engine's report has some thirty."""


def chunks_of(path: Path) -> Iterator[rrd.Chunk]:
    """Yield the chunks of the one recording in a file; nothing else may be in it.

    Raises
    ------
    RecordingError
        If there is none, or it is damaged.
    """
    only: str | None = None
    try:
        if not path.is_file():
            why = "not a regular file" if path.exists() else "not there"
            raise RecordingError(
                f"{path} is not a recording: it is {why}; make one with: drop simulate"
            )
        for chunk in rrd.chunks(path, unfinished=is_part(path)):
            only = chunk.recording_id if only is None else only
            if chunk.application_id != schema.APPLICATION_ID:
                raise RecordingError(
                    f"{path} must be a recording made by drop, got one of "
                    f"{shown(chunk.application_id)}; {again(path)}"
                )
            if chunk.recording_id != only:
                raise RecordingError(f"{path} must hold one recording, got several; {again(path)}")
            yield chunk
        if only is None and is_part(path):
            raise _empty(path)
    except rrd.UnfinishedError as error:
        raise _unfinished(path, str(error)) from None
    except rrd.DamagedError as error:
        if is_part(path) and not path.stat().st_size:
            raise _empty(path) from None
        raise damaged(path, str(error)) from None
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be read: {error.strerror or error}; see: "
            f"{shlex.join(['ls', '-l', str(path)])}"
        ) from None


def is_script(path: Path) -> bool:
    """Whether a file is the recording of a script, finished or not: that is said in it first.

    Raises
    ------
    RecordingError
        If it is missing, damaged, or not a recording of ours.
    """
    first = next(chunks_of(path), None)
    return first is not None and first.entity == f"__properties/{schema.ORIGIN_PROPERTY}"


def gather(properties: dict[str, Properties], chunk: rrd.Chunk, path: Path) -> None:
    """Add what a chunk holds of a property: `rerun rrd split` writes each value on its own.

    Raises
    ------
    RecordingError
        If it holds something else than a property, or says two things.
    """
    name = chunk.entity.removeprefix("__properties/")
    if name not in (*schema.PROPERTIES, schema.ORIGIN_PROPERTY):
        return
    gathered = properties.setdefault(name, {})
    for key, value in columns.values(chunk, path).items():
        if gathered.setdefault(key, value) != value:
            raise damaged(path, f"its property {name} says two things of {shown(key)}")
    if len(gathered) > MOST_VALUES:
        raise damaged(path, f"its property {name} has {len(gathered):,} values")


def closing_of(properties: Mapping[str, Properties], path: Path) -> Properties | None:
    """Return the property that was written last; None where the recording may lack it.

    Raises
    ------
    RecordingError
        If it is missing, or another version of drop wrote it.
    """
    closing = properties.get(schema.RECORDING_PROPERTY)
    if closing is None:
        if is_part(path):
            return None
        if not properties:  # that of what was run is written first
            raise RecordingError(
                f"{path} must be a recording, got a layer, as RUN.analysis.rrd is of RUN.rrd; give "
                "the recording that it belongs to"
            )
        raise _unfinished(path, "it lacks the property that is written last")
    version = closing.get("schema_version")
    if version == 1:
        raise RecordingError(f"{path} was made by an earlier version of drop; {again(path)}")
    if version != schema.SCHEMA_VERSION:
        raise RecordingError(
            f"{path} must be of schema {schema.SCHEMA_VERSION}, got {shown(version)}; read it "
            f"with the drop that wrote it, or {again(path)}"
        )
    return closing


def _empty(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} holds nothing yet: what wrote it, a drop or a script's recording, was stopped "
        "before its first rows were whole; record it again"
    )


def _unfinished(path: Path, what: str) -> RecordingError:
    rename = shlex.join(["mv", str(path), str(free_part_of(path))])
    return RecordingError(f"{path} is damaged: {what}; to read what it holds, rename it: {rename}")
