"""Say what was recorded of a script, on standard error: standard output is the script's."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from pipeline.console.output import counted, made, note, print_json, print_lines

if TYPE_CHECKING:
    from pipeline.stages.record import Recorded

ENDED = {
    "finished": "finished",
    "steps": "stopped after --steps",
    "duration": "stopped by its clock",
    "interrupted": "stopped by Ctrl-C",
    "failed": "failed",
}


def show_record(recorded: Recorded, *, as_json: bool) -> int:
    """Print the recording and how the script ended, and return the exit code."""
    if as_json:
        again = {"first_difference": recorded.first_difference} if recorded.twice else {}
        print_json(
            {
                "recording": str(recorded.recording),
                "recording_id": recorded.recording_id,
                "script": recorded.script,
                "ended": recorded.ended,
                "error": recorded.error or None,
                "samples": recorded.samples,
                "bodies": recorded.bodies,
                "frames": recorded.frames,
                "bytes": recorded.bytes,
                "wall_s": recorded.wall_s,
                **again,
            }
        )
    else:
        print_lines(*record_lines(recorded), stream=sys.stderr)
    if recorded.ended != "failed":
        return 0
    note(f"the script failed: {recorded.error}; what it did until then is in {recorded.recording}")
    return 1


def record_lines(recorded: Recorded) -> list[str]:
    """Say how the script ended, and what was recorded of it."""
    facts = (
        f"{counted(recorded.samples, 'sample')}, {counted(recorded.bodies, 'body', 'bodies')}, "
        f"{counted(recorded.frames, 'frame')}, {recorded.bytes / 1e6:.2f} MB, "
        f"{recorded.wall_s:.1f} s"
    )
    lines = made("recorded", recorded.recording, facts, column=10)
    return [f"[dim]script[/]    {ENDED[recorded.ended]}", *lines]
