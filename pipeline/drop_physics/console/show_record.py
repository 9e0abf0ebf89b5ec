"""What was recorded of a script, on standard error: standard output is the script's."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from drop_physics.console.output import (
    columns_of,
    counted,
    made,
    note,
    print_json,
    print_lines,
    titled,
)
from drop_physics.console.words import SCRIPT
from drop_physics.fields import all_of
from drop_physics.messages import Message, translated
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.stages.record import Recorded


def note_ours(target: str, arguments: Sequence[str], ours: Collection[str]) -> None:
    """Say which of a script's arguments are options of ours, too: perhaps they were meant so."""
    names = dict.fromkeys(argument.partition("=")[0] for argument in arguments)
    both = [name for name in names if name.startswith("-") and name in ours]
    if both:
        note(
            Message(
                "what stands after {target} is its own, {names} included; options of drop stand "
                "before it",
                target=target,
                names=all_of(both),
            )
        )


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
    note(
        Message(
            "{failure}; what it did until then is in {recording}",
            failure=recorded.failure,
            recording=str(recorded.recording),
        )
    )
    return 1


def record_lines(recorded: Recorded) -> list[str]:
    """Say how the script ended, and what was recorded of it."""
    facts = Message(
        "{samples}, {bodies}, {frames}, {megabytes:.2f} MB, {wall_s:.1f} s",
        samples=counted(recorded.samples, "sample"),
        bodies=counted(recorded.bodies, "body", "bodies"),
        frames=counted(recorded.frames, "frame"),
        megabytes=recorded.bytes / 1e6,
        wall_s=recorded.wall_s,
    )
    title = Message("recorded")
    column = 2 + max(columns_of(translated(head)) for head in (title, SCRIPT))
    return [
        *titled(SCRIPT, ENDED[recorded.ended], column=column, style="dim"),
        *made(title, recorded.recording, facts, column=column),
    ]
