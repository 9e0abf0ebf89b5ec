"""What was recorded of a script, on standard error: standard output is the script's."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from drop_physics.console.output import columns_of, note, print_json, print_lines
from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import all_of, counted
from drop_physics.messages import Message, shell_command, translated
from drop_physics.report.blocks import Fact, Facts, File, Report, Section
from drop_physics.report.terminal import block_lines, lines_of
from drop_physics.report.words import SCRIPT
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.stages.record import Recorded, ReplayedSteps

RECORDED, NEXT = Message("recorded"), Message("next")


def note_ours(
    target: str, arguments: Sequence[str], ours: Collection[str], *, verb: str | None = None
) -> None:
    """Say which of a script's arguments are options of ours, too: perhaps they were meant so.

    `verb` is the one that takes them, where none was typed.
    """
    names = dict.fromkeys(argument.partition("=")[0] for argument in arguments)
    both = [name for name in names if name.startswith("-") and name in ours]
    if both:
        values = {"names": all_of(both), "target": target}
        words = Message(
            "what comes after {target} goes to the script, {names} too; put drop's options before "
            "the script",
            **values,
        )
        if verb is not None:
            words = Message(
                "what comes after {target} goes to the script, {names} too; drop's options come "
                "before the script, in: {command}",
                command=f"drop {verb}",
                **values,
            )
        note(words)


def show_record(recorded: Recorded, *, as_json: bool, analyzed: bool = False) -> int:
    """Print the recording, how the script ended and what to type next; return the exit code.

    Where the analysis follows, it says what the script failed with.
    """
    failed = recorded.ended == "failed"
    if as_json:
        print_json(recorded.as_json())
    else:
        print_lines(*lines_of(report_of(recorded)), stream=sys.stderr)
    if failed and not analyzed:
        note(
            Message(
                "{failure}; what it did until then is in {recording}",
                failure=recorded.failure,
                recording=str(recorded.recording),
            )
        )
    if not as_json and not analyzed and (failed or recorded.samples):
        command = shell_command("drop", "analyze", recorded.recording)
        following = Facts([Fact(NEXT, command, "dim", is_command=True)], _column())
        print_lines(*block_lines(following), stream=sys.stderr)
    return int(failed)


def json_of(recorded: Recorded) -> dict[str, Any]:
    """Return what `--json` prints."""
    left_out = {"failure", "twice", "outside"} | (set() if recorded.twice else {"first_difference"})
    left_out |= {"replay"} if recorded.replay is None else set()
    values = vars(recorded) | {"error": recorded.error or None}
    return {name: value for name, value in jsonable(values).items() if name not in left_out}


def report_of(recorded: Recorded) -> Report:
    """Say how the script ended, and what was recorded of it."""
    facts = Message(
        "{samples}, {bodies}, {frames}, {megabytes:.2f} MB, {wall_s:.1f} s",
        samples=counted(recorded.samples, "sample"),
        bodies=counted(recorded.bodies, "body", "bodies"),
        frames=counted(recorded.frames, "frame"),
        megabytes=recorded.bytes / 1e6,
        wall_s=recorded.wall_s,
    )
    ended = Fact(SCRIPT, ENDED[recorded.ended], "dim")
    again = [] if recorded.replay is None else [Fact("", _replayed(recorded.replay))]
    files = Facts([ended, File(RECORDED, recorded.recording, facts), *again], _column())
    return Report(sections=[Section([files])])


def _replayed(replay: ReplayedSteps) -> Message:
    """Say what became of the steps of MuJoCo."""
    if replay.replayed and replay.explained == replay.replayed:
        return Message(
            "{replayed:,} of {steps:,} steps replayed to the bit, "
            "the sum closes to {remainder:.0e}",
            replayed=replay.replayed,
            steps=replay.steps,
            remainder=replay.remainder,
        )
    return Message(
        "{replayed:,} of {steps:,} steps replayed to the bit, {explained:,} explained",
        replayed=replay.replayed,
        steps=replay.steps,
        explained=replay.explained,
    )


def _column() -> int:
    return 2 + max(columns_of(translated(head)) for head in (SCRIPT, RECORDED, NEXT))
