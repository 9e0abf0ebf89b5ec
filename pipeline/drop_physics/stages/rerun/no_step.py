"""The error for a script that makes no step, so that its runs cannot be compared."""

from __future__ import annotations

from drop_physics.errors import RecordingError


def no_step(script: str, how: str) -> RecordingError:
    """Return the error; `how` is the script's ending as named in `trace.events.ENDED`."""
    if how == "disk":
        return RecordingError(
            "{script} was stopped before its first step, as the disk is nearly full; make room "
            "there, or choose another folder",
            script=script,
        )
    return RecordingError(
        "{script} makes no step, so there is nothing to compare; give it the arguments with which "
        "it steps",
        script=script,
    )
