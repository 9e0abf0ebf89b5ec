"""The report of a recorded script, and the commands to run next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import counted
from drop_physics.messages import Message, shell_command
from drop_physics.report.blocks import Fact, Facts, File, Report, Section
from drop_physics.report.words import NEXT, SCRIPT
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.stages.record import Recorded, ReplayedSteps


def json_of(recorded: Recorded) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    left_out = {"failure", "twice", "reached", "never_began", "is_elsewhere"} | (
        {"engine", "answer"} | (set() if recorded.twice else {"first_difference"})
    )
    left_out |= {name for name in ("replay", "beside") if getattr(recorded, name) is None}
    values = vars(recorded) | {"error": recorded.error or None}
    if recorded.beside is not None:
        values["beside"] = json_of(recorded.beside)
    return {name: value for name, value in jsonable(values).items() if name not in left_out}


def report_of(recorded: Recorded, *, analyzed: bool = False) -> Report:
    """Report how the script ended, and what its recording contains.

    If an analysis follows, that analysis reports the script's error and the commands to run next.
    """
    failed = recorded.ended == "failed"
    rows: list[Fact | File] = [Fact(SCRIPT, ENDED[recorded.ended], "dim"), *_written(recorded)]
    if recorded.beside is not None:
        rows += _written(recorded.beside)
    if not analyzed and (failed or recorded.samples):
        command = shell_command("drop", "analyze", recorded.recording)
        rows.append(Fact(NEXT, command, "dim", is_command=True))
    fails = Message(
        "{failure}; what it did until then is in {recording}",
        failure=recorded.failure,
        recording=str(recorded.recording),
    )
    # What it stepped is not in the recording: no success, though the script had one.
    code = int(failed or (recorded.is_elsewhere and not recorded.samples))
    notes = [fails] if failed and not analyzed else []
    return Report(sections=[Section([Facts(rows)])], notes=notes, code=code)


def _written(recorded: Recorded) -> Iterator[Fact | File]:
    """Yield the file that was written, and what it contains."""
    facts = Message(
        "{samples}, {bodies}, {frames}, {megabytes:.2f} MB, {wall_s:.1f} s",
        samples=counted(recorded.samples, "sample"),
        bodies=counted(recorded.bodies, "body", "bodies"),
        frames=counted(recorded.frames, "frame"),
        megabytes=recorded.bytes / 1e6,
        wall_s=recorded.wall_s,
    )
    yield File(Message("recorded"), recorded.recording, facts)
    if recorded.replay is not None:
        yield Fact("", _replayed(recorded.replay))


def _replayed(replay: ReplayedSteps) -> Message:
    """Describe how many MuJoCo steps were replayed."""
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
