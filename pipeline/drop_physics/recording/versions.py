"""Lists the recording schemas that can be read, and the contents that older ones lack.

Users keep golden recordings. A change of the format therefore raises `schema.SCHEMA_VERSION`, adds
to `ADDED` the contents that earlier recordings lack, and adds recordings of the previous schema to
`tests/recordings`, which `check`, `analyze` and `info` must always be able to read. Renamed or
reshaped contents must still be read in their old form, since the digests are those of the rows as
written.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from drop_physics.errors import RecordingError
from drop_physics.fields import shown
from drop_physics.messages import Message, joined
from drop_physics.recording import schema
from drop_physics.recording.damage import again


class Addition(NamedTuple):
    """What a schema version added to recordings."""

    what: Message
    of_drops: bool
    """Whether recordings of drops contain the addition; otherwise only those of scripts do."""
    of_replayed: bool = False
    """Whether only recordings of an engine that can repeat its steps contain it."""


OLDEST = 3
"""The earliest supported schema version."""
ADDED: Mapping[int, Addition] = {
    4: Addition(Message("where the script read its simulation"), of_drops=False),
    6: Addition(
        Message("the model and the states with which a step can be taken again"),
        of_drops=False,
        of_replayed=True,
    ),
    7: Addition(Message("the episodes of its environments"), of_drops=False),
    8: Addition(Message("what the script's readings gave"), of_drops=False),
}
"""Contents that each schema version added."""


def check_version(version: object, path: Path) -> None:
    """Check that a schema version is supported.

    Raises
    ------
    RecordingError
        If the version is too old, or newer than this version of drop.
    """
    if isinstance(version, int) and OLDEST <= version <= schema.SCHEMA_VERSION:
        return
    if version in range(1, OLDEST):
        raise RecordingError(
            "{path} was made by an earlier version of drop; {again}", path=path, again=again(path)
        )
    raise RecordingError(
        "{path} must be of schema {schema}, got {version}; read it with the drop that wrote it, "
        "or {again}",
        path=path,
        schema=schema.SCHEMA_VERSION,
        version=shown(version),
        again=again(path),
    )


def lacking(version: int, *, of_drop: bool, replayed: bool) -> Message | None:
    """Describe the contents that recordings of a schema version lack; None for the current one.

    `replayed` is True if the engine can repeat its steps.
    """
    what = [
        added.what
        for number, added in ADDED.items()
        if number > version
        and (added.of_drops or not of_drop)
        and (replayed or not added.of_replayed)
    ]
    return joined(", ", what) if what else None
