"""Why a script's recording is not the golden one: another script, other calls, another engine."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from pipeline.analysis.drop.comparison import Setting
from pipeline.analysis.script.difference import TOLD, Difference, When
from pipeline.seen import Call, Seen

Facts = Mapping[str, Any]

MADE_WITH = "made_with_"
DID = ("unseeded", "real_time")
"""What a recording says that it was made with, and is what the script did."""
SHORTENED = re.compile(r"… \d+ values")
"""Stands in a call's arguments for what is not told of a long list."""
FOLDER = re.compile(r"(?<=['\"])(?:/|[A-Za-z]:[/\\])(?:[^'\"]*[/\\])?")
"""Of an absolute path in a call's arguments: it is one machine's."""


@dataclass(frozen=True)
class Side:
    """One of the two recordings."""

    origin: Facts
    """The script, the digest of its text, its arguments, what `drop record` was asked for."""
    ended: Facts
    """How it ended, and with what it was made."""
    seen: Seen


@dataclass(frozen=True)
class OtherCall:
    """The first call that is not golden's."""

    value: Call | None
    """In the recording that was checked; None where it has no more."""
    golden: Call | None
    """In the golden one; None where that has no more."""

    @property
    def moved(self) -> bool:
        """Whether it is the same call from another line."""
        return self.value is not None and self.golden is not None and _is(self.value, self.golden)

    @property
    def when(self) -> When:
        """When it was made, in whichever comes first."""
        ats = [call.at for call in (self.value, self.golden) if call is not None]
        return min(When(at.step, TOLD, at.call) for at in ats)


def other_call(run: Sequence[Call], golden: Sequence[Call]) -> OtherCall | None:
    """Return the first call that does something else, else one that stands elsewhere."""
    both = [OtherCall(*pair) for pair in zip_longest(run, golden)]
    others = (one for one in both if not (one.value and one.golden and one.moved))
    elsewhere = (
        one for one in both
        if one.value and one.golden
        and (one.value.file, one.value.line) != (one.golden.file, one.golden.line)
    )  # fmt: skip
    return next(others, None) or next(elsewhere, None)


def _is(one: Call, other: Call) -> bool:
    """Whether two calls do the same, wherever they stand and their files lie."""
    told, golden = (
        (call.client, call.function, FOLDER.sub("", call.arguments), bool(call.raised))
        for call in (one, other)
    )
    return told == golden


def versions(run: Side, golden: Side) -> Iterator[Setting]:
    """Yield what made the two recordings, where both say so and it differs."""
    mine, theirs = (_made_with(side) for side in (run, golden))
    for name, value in mine.items():
        other = theirs.get(name)
        if None not in (value, other) and value != other:
            yield Setting(name, value, other)


def _made_with(side: Side) -> dict[str, Any]:
    names = (one.removeprefix(MADE_WITH) for one in side.ended if one.startswith(MADE_WITH))
    found = {name: side.ended[MADE_WITH + name] for name in names if name not in DID}
    found = {"python_version" if name == "version" else name: one for name, one in found.items()}
    return found | {"drop_version": side.origin.get("drop_version")}


def cause(
    run: Side,
    golden: Side,
    *,
    first: Difference,
    call: OtherCall | None,
    told: Sequence[Difference],
    made: Sequence[Setting],
) -> str:
    """Say in a sentence why two recordings differ.

    Parameters
    ----------
    run, golden
        The two recordings.
    first
        What differs first.
    call
        The first other call, where it came before what differs first.
    told
        What went in otherwise.
    made
        What made them, where it differs.
    """
    lead = "another text of the script, but " if _other_text(run, golden) else ""
    ends = [side.ended.get("ended") for side in (run, golden)]
    last = [_last_step(side) for side in (run, golden)]
    ended = first.column == "there" and not told and last[0] != last[1]
    # Calls that one lacks because it has ended are none that it has not made.
    if ended and (call is None or (call.value, call.golden)[last.index(min(last))] is None):
        mine, theirs = (
            f"after step {_last_step(side)} ({end})"
            for side, end in zip((run, golden), ends, strict=True)
        )
        return f"{lead}the same calls as far as both go: it ended {mine}, golden {theirs}"
    if call is not None:
        return _of_calls(run, golden)
    if said := _of_steps(run.seen.calls, golden.seen.calls, first.step):
        return f"{lead}{said}"
    if any(one.column == "engine.rows" for one in told):  # told of each connection, and after calls
        return (
            f"{lead}the same calls, and a simulation that begins or ends elsewhere: that the "
            "script connects to PyBullet, or disconnects, is no call"
        )
    changed = ", ".join(f"{one.name} {one.value}, golden {one.golden}" for one in made)
    because = f"made with {changed}" if made else ""
    if any(one.column.startswith(("bodies.", "dynamics.")) for one in told):
        files = "a file that they load has changed, or the engine reads it in another way"
        return f"{lead}the same calls made other bodies: {because or files}"
    if made:
        return f"{lead}the same calls, other numbers: another engine or machine, {because}"
    part = next((one for one in run.seen.calls if told and SHORTENED.search(one.arguments)), None)
    if part is not None:
        return (
            f"{lead}the same calls, as far as their arguments are told, which those of "
            f"{part.function} at {part.file}:{part.line} are in part"
        )
    return (
        f"{lead}the same calls, other numbers, and the same versions: another build or processor, "
        "or memory that PyBullet reads before it writes it, which drop record --twice shows"
    )


def cause_of_images(
    run: Side, golden: Side, *, call: OtherCall | None, made: Sequence[Setting]
) -> str:
    """Say in a sentence why images differ where nothing else does.

    Parameters
    ----------
    run, golden
        The two recordings.
    call
        The first other call, where it came before the first image that differs.
    made
        What made them, where it differs.
    """
    if call is not None:
        return _of_calls(run, golden)
    lead = "another text of the script, but " if _other_text(run, golden) else ""
    changed = ", ".join(f"{one.name} {one.value}, golden {one.golden}" for one in made)
    because = f"made with {changed}, or " if made else ""
    return (
        f"{lead}the same calls, other images: {because}another camera, which is no call, or a file "
        "that is drawn has changed"
    )


def _of_steps(run: Sequence[Call], golden: Sequence[Call], until: int) -> str:
    """Say which of the same calls is first made at another step, if one is by then."""
    for one, other in zip(run, golden, strict=False):
        if one.at.step != other.at.step and min(one.at.step, other.at.step) <= until:
            return (
                f"the same calls, at other steps: {one.function} at {one.file}:{one.line} after "
                f"step {one.at.step}, golden {other.at.step}"
            )
    return ""


def _of_calls(run: Side, golden: Side) -> str:
    if _other_text(run, golden):
        return "another script: its text and its calls differ"
    for name, what in (("script", "script"), ("arguments", "arguments"), ("seed", "--seed")):
        mine, theirs = (side.origin.get(name) for side in (run, golden))
        if mine != theirs:
            same = "another script" if name == "script" else "the same script, other calls"
            return f"{same}: {what} {_shown(mine)}, golden {_shown(theirs)}"
    unseeded = list(dict.fromkeys((*run.seen.unseeded, *golden.seen.unseeded)))
    if unseeded:
        return (
            f"the same script, other calls: it draws unseeded random numbers, {unseeded[0]}; "
            "record both with --seed 0"
        )
    if run.seen.real_time or golden.seen.real_time:
        return "the same script, other calls: it asked for real-time simulation, that of a clock"
    text = "the same script" if run.origin.get("script_sha256") else "a module of the same name"
    return (
        f"{text}, other calls: what it reads has changed, such as a module, a file or the time of "
        "day, which --seed holds"
    )


def _other_text(run: Side, golden: Side) -> bool:
    digests = {side.origin.get("script_sha256") for side in (run, golden)}
    return len(digests) > 1 and None not in digests


def _last_step(side: Side) -> int:
    return max(side.seen.states["step"], default=-1)


def _shown(value: object) -> str:
    if value is None:
        return "none"
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
