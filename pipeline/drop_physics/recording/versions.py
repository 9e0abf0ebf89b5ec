"""Lists the recording schemas that can be read, and what older ones lack.

Users keep golden recordings, so a landed change of the format raises `schema.SCHEMA_VERSION` and
adds to `ADDED` the contents that recordings of earlier schemas lack, and to `tests/recordings` some
of the schema before, which `check`, `analyze` and `info` read ever after. Contents that a change
renames or reshapes must still be read in their old form: digests are those of the rows as they were
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
    """Whether recordings of drops contain it, or only those of scripts."""
    of_replayed: bool = False
    """Whether only recordings contain it whose engine can repeat its steps."""


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
"""Additions of each schema version."""


def check_version(version: object, path: Path) -> None:
    """Check that a schema version is supported.

    Raises
    ------
    RecordingError
        If they cannot: it is too old, or later than today's.
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
    """Describe the contents that recordings of a schema version lack; None if they lack none.

    `replayed` is whether their engine can take steps again.
    """
    what = [
        added.what
        for number, added in ADDED.items()
        if number > version
        and (added.of_drops or not of_drop)
        and (replayed or not added.of_replayed)
    ]
    return joined(", ", what) if what else None
