"""Reads the chunks and properties of a recording made by `drop`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from drop_physics.errors import RecordingError
from drop_physics.fields import shown
from drop_physics.files.outputs import free_part_of, is_part
from drop_physics.messages import Message, shell_command
from drop_physics.recording import columns, rrd, schema
from drop_physics.recording.columns import Properties
from drop_physics.recording.damage import again, damaged
from drop_physics.recording.first_look import check_file, unreadable
from drop_physics.recording.versions import check_version

MOST_VALUES = 1000
"""Largest number of values in a property; the engine's report has about thirty."""


class ForeignError(RecordingError):
    """Raised for a recording that another program made with Rerun."""


def chunks_of(path: Path) -> Iterator[rrd.Chunk]:
    """Yield the chunks of a file, which must contain exactly one recording.

    Raises
    ------
    RecordingError
        If there is no recording, or the file is damaged.
    """
    only: str | None = None
    try:
        check_file(path)
        for chunk in rrd.chunks(path, unfinished=is_part(path)):
            only = chunk.recording_id if only is None else only
            if chunk.application_id != schema.APPLICATION_ID:
                raise ForeignError(
                    "{path} must be a recording made by drop, got one made by {application}; "
                    "{again}",
                    path=path,
                    application=shown(chunk.application_id),
                    again=again(path),
                )
            if chunk.recording_id != only:
                raise RecordingError(
                    "{path} must hold one recording, got several; {again}",
                    path=path,
                    again=again(path),
                )
            yield chunk
        if only is None and is_part(path):
            raise _empty(path)
    except rrd.UnfinishedError as error:
        raise _unfinished(path, error.what) from None
    except rrd.DamagedError as error:
        if is_part(path) and not path.stat().st_size:
            raise _empty(path) from None
        raise damaged(path, error.what) from None
    except OSError as error:
        raise unreadable(path, error) from None


def is_script(path: Path) -> bool:
    """Return whether a file is a script's recording, finished or not, judging by its first chunk.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or was not written by drop.
    """
    first = next(chunks_of(path), None)
    return first is not None and first.entity == f"__properties/{schema.ORIGIN_PROPERTY}"


def beginning_of(path: Path) -> tuple[str, Properties] | None:
    """Return name and values of the property at a recording's start; None for a layer.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or was not written by drop.
    """
    first = next(chunks_of(path), None)
    if first is None or not first.entity.startswith("__properties/"):
        return None
    return first.entity.removeprefix("__properties/"), columns.values(first, path)


def properties_of(path: Path) -> dict[str, Properties]:
    """Return the properties of a recording, by name.

    Raises
    ------
    RecordingError
        If the file is missing, damaged, or was not written by drop.
    """
    properties: dict[str, Properties] = {}
    for chunk in chunks_of(path):
        if chunk.entity.startswith("__properties/"):
            gather(properties, chunk, path)
    return properties


def gather(properties: dict[str, Properties], chunk: rrd.Chunk, path: Path) -> None:
    """Add a chunk's values to its property; `rerun rrd split` writes each value as a chunk.

    Raises
    ------
    RecordingError
        If the chunk has other content than a property, or contradicts another chunk.
    """
    name = chunk.entity.removeprefix("__properties/")
    if name not in schema.PROPERTIES:
        return
    gathered = properties.setdefault(name, {})
    for key, value in columns.values(chunk, path).items():
        if gathered.setdefault(key, value) != value:
            what = Message("its property {name} has two values of {key}", name=name, key=shown(key))
            raise damaged(path, what)
    if len(gathered) > MOST_VALUES:
        what = Message("its property {name} has {count:,} values", name=name, count=len(gathered))
        raise damaged(path, what)


def closing_of(properties: Mapping[str, Properties], path: Path) -> Properties | None:
    """Return the property that ends a finished recording; None if the recording is unfinished.

    Raises
    ------
    RecordingError
        If the property is missing, or written by an unsupported version of drop.
    """
    closing = properties.get(schema.RECORDING_PROPERTY)
    if closing is None:
        if not properties and next(chunks_of(path), None):  # a recording's first is a property
            if is_part(path):
                raise RecordingError(
                    "{path} must be a recording, got an unfinished layer, as RUN.analysis.rrd is "
                    "of RUN.rrd; give the recording that it belongs to",
                    path=path,
                )
            raise RecordingError(
                "{path} must be a recording, got a layer, as RUN.analysis.rrd is of RUN.rrd; give "
                "the recording that it belongs to",
                path=path,
            )
        if is_part(path):
            return None
        raise _unfinished(path, Message("it lacks the property that is written last"))
    check_version(closing.get("schema_version"), path)
    return closing


def _empty(path: Path) -> RecordingError:
    return RecordingError(
        "{path} holds nothing yet: the process that wrote it was stopped before its first rows "
        "were complete; record it again",
        path=path,
    )


def _unfinished(path: Path, what: Message) -> RecordingError:
    return RecordingError(
        "{path} is damaged: {what}; what is whole of it can be read once it is renamed: {command}",
        path=path,
        what=what,
        command=shell_command("mv", path, free_part_of(path)),
    )
