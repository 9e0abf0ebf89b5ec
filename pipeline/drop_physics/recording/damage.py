"""Errors for unusable recordings, with advice on what to do."""

from __future__ import annotations

import contextlib
from pathlib import Path

from drop_physics.errors import RecordingError
from drop_physics.messages import Message
from drop_physics.recording import rrd, schema


def damaged(path: Path, what: str) -> RecordingError:
    """Return the error for a recording whose content differs from what was written."""
    return RecordingError(
        "{path} is damaged: {what}; {again}", path=path, what=what, again=again(path)
    )


def twice(entity: str) -> Message:
    """Describe the damage of a table that has two rows for the same step."""
    return Message("its {entity} has a step twice", entity=entity)


def wrong_count(entity: str, count: int, name: str) -> Message:
    """Describe the damage of a row that has a wrong number of values."""
    return Message(
        "{entity} must hold {count} numbers for each {name}", entity=entity, count=count, name=name
    )


def again(path: Path) -> Message:
    """Describe the command that would record the same again."""
    first = None
    with contextlib.suppress(rrd.DamagedError, OSError):
        first = next(rrd.chunks(path, unfinished=True), None)
    of_script = first is not None and first.entity == f"__properties/{schema.ORIGIN_PROPERTY}"
    if of_script:
        return Message("record it again with: drop record")
    return Message("record it again with: drop simulate")
