"""Why a script's recording differs from golden: another script, other calls, another engine."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from pipeline.analysis.drop.comparison import Setting
from pipeline.analysis.script.difference import INPUT, Difference, When
from pipeline.messages import Message, joined
from pipeline.seen import Call, Seen

Facts = Mapping[str, Any]

RECONNECTED = Message(
    "the same calls, and a simulation that begins or ends elsewhere: connecting to PyBullet and "
    "disconnecting do not count as calls"
)
MADE_WITH = "made_with_"
DID = ("unseeded", "real_time")
"""Facts of that prefix that are not versions: what the script did."""
SHORTENED = re.compile(r"… \d+ values")
"""In a call's arguments: replaces the rest of a long list."""
FILE = re.compile(r"\.\w+['\"]")
"""In a call's arguments: the end of a file's name."""
FOLDER = re.compile(r"(?<=['\"])(?:/|[A-Za-z]:[/\\])(?:[^'\"]*[/\\])?")
"""The folder of an absolute path in a call's arguments, which depends on the machine."""


@dataclass(frozen=True)
class Side:
    """One of the two recordings."""

    origin: Facts
    """The script, the digest of its text, its arguments, the options of `drop record`."""
    ended: Facts
    """How it ended, and what it was made with."""
    seen: Seen


@dataclass(frozen=True)
class OtherCall:
    """The first call that differs from golden's."""

    value: Call | None
    """In the checked recording; None where it has no more."""
    golden: Call | None
    """In the golden recording; None where it has no more."""
    moved: bool
    """Whether it is the same call from another line."""

    @property
    def when(self) -> When:
        """When it was made, in the recording where it came first."""
        ats = [call.at for call in (self.value, self.golden) if call is not None]
        return min(When(at.step, INPUT, at.call) for at in ats)


def other_call(run: Sequence[Call], golden: Sequence[Call]) -> OtherCall | None:
    """Return the first call that does something else, else the first from another line.

    The calls of each client are compared: how those of several alternate does not count, as threads
    take turns at random.
    """
    found = [other for pair in _by_client(run, golden) if (other := _first_other(*pair))]
    return min(found, key=lambda other: (other.moved, other.when), default=None)


def _by_client(
    run: Sequence[Call], golden: Sequence[Call]
) -> Iterator[tuple[list[Call], list[Call]]]:
    """Yield the calls of each client in both."""
    for client in sorted({call.client for call in (*run, *golden)}):
        mine, theirs = (
            [call for call in calls if call.client == client] for calls in (run, golden)
        )
        yield mine, theirs


def _first_other(run: Sequence[Call], golden: Sequence[Call]) -> OtherCall | None:
    pairs = [
        OtherCall(call, other, moved=bool(call and other and _does(call) == _does(other)))
        for call, other in zip_longest(run, golden)
    ]
    others = (pair for pair in pairs if not pair.moved)
    elsewhere = (
        pair for pair in pairs
        if pair.value and pair.golden
        and (pair.value.file, pair.value.line) != (pair.golden.file, pair.golden.line)
    )  # fmt: skip
    return next(others, None) or next(elsewhere, None)


def _does(call: Call) -> tuple[object, ...]:
    """Return what a call does, from whatever line and with files in whatever folder."""
    return call.function, FOLDER.sub("", call.arguments), bool(call.raised)


def versions(run: Side, golden: Side) -> Iterator[Setting]:
    """Yield the versions that made the two recordings, where both have one and they differ."""
    mine, theirs = (_made_with(side) for side in (run, golden))
    for name, value in mine.items():
        other = theirs.get(name)
        if None not in (value, other) and value != other:
            yield Setting(name, value, other)


def _made_with(side: Side) -> dict[str, Any]:
    names = (name.removeprefix(MADE_WITH) for name in side.ended if name.startswith(MADE_WITH))
    made = {
        "python_version" if name == "version" else name: side.ended[MADE_WITH + name]
        for name in names
        if name not in DID
    }
    return made | {"drop_version": side.origin.get("drop_version")}


def cause(
    run: Side,
    golden: Side,
    *,
    first: Difference,
    call: OtherCall | None,
    inputs: Sequence[Difference],
    made: Sequence[Setting],
) -> Message:
    """Say in a sentence why two recordings differ.

    Parameters
    ----------
    run, golden
        The two recordings.
    first
        The first difference.
    call
        The first other call, where it came before the first difference.
    inputs
        The differences in the inputs.
    made
        The versions that differ.
    """
    last = [_last_step(side) for side in (run, golden)]
    ended = first.column == "there" and not inputs and last[0] != last[1]
    # Calls that one lacks because it has ended are no other calls.
    if ended and (call is None or (call.value, call.golden)[last.index(min(last))] is None):
        connections = [_connections(side.seen, until=min(last)) for side in (run, golden)]
        if connections[0] != connections[1]:
            return _of_text(run, golden, RECONNECTED)
        why = Message(
            "the same calls as far as both go: it ended after step {step} ({end}), golden after "
            "step {golden_step} ({golden_end})",
            step=last[0],
            end=run.ended.get("ended"),
            golden_step=last[1],
            golden_end=golden.ended.get("ended"),
        )
        return _of_text(run, golden, why)
    if call is not None:
        return _of_calls(run, golden)
    steps = [side.seen.samples for side in (run, golden)]
    apart = [client for client in sorted(steps[0]) if steps[0][client] != steps[1].get(client)]
    if first.column == "there" and not inputs and apart and apart[0] in steps[1]:
        why = Message(
            "the same calls as far as both go: simulation {client} ended after step {step}, golden "
            "after step {golden_step}",
            client=apart[0],
            step=steps[0][apart[0]] - 1,
            golden_step=steps[1][apart[0]] - 1,
        )
        return _of_text(run, golden, why)
    return _of_text(run, golden, _of_inputs(run, golden, first=first, inputs=inputs, made=made))


def _of_inputs(
    run: Side,
    golden: Side,
    *,
    first: Difference,
    inputs: Sequence[Difference],
    made: Sequence[Setting],
) -> Message:
    """Say why two recordings with the same calls differ."""
    later = _later_call(run.seen.calls, golden.seen.calls, first.step)
    if later is not None:
        return later
    if any(each.column == "engine.rows" for each in inputs):  # of each connection, and after calls
        return RECONNECTED
    causes = joined(", or ", _possible(run, first=first, inputs=inputs, made=made))
    if any(each.column.startswith(("bodies.", "dynamics.")) for each in inputs):
        return Message("the same calls, other bodies: {causes}", causes=causes)
    part = _part(run.seen.calls)
    if inputs and part is not None and not made:
        return Message(
            "the same calls, as far as recorded: the arguments of {function} at {file}:{line} are "
            "recorded only in part",
            function=part.function,
            file=part.file,
            line=part.line,
        )
    if made:
        return Message("the same calls, other numbers: {causes}", causes=causes)
    return Message("the same calls, other numbers, and the same versions: {causes}", causes=causes)


def _possible(
    run: Side, *, first: Difference, inputs: Sequence[Difference], made: Sequence[Setting]
) -> Iterator[Message]:
    """Yield what may make the same calls give other bodies or numbers; none of it is recorded."""
    calls = [call for call in run.seen.calls if call.at.step <= first.step]
    if made:
        yield Message("another engine or machine, made with {made}", made=_versions(made))
    part = _part(calls)
    if part is not None:
        yield Message(
            "the arguments of {function} at {file}:{line}, recorded only in part, differ",
            function=part.function,
            file=part.file,
            line=part.line,
        )
    if any(FILE.search(call.arguments) for call in calls):
        yield Message("a file that they load has changed")
    if _is_block(run):
        yield Message(
            "what the process did before the block still acts, as contactBreakingThreshold does "
            "in every later simulation"
        )
    if not made:
        yield Message("another build or processor")
        if not inputs and _is_block(run):
            yield Message("uninitialized memory that PyBullet reads")
        elif not inputs:
            yield Message(
                "uninitialized memory that PyBullet reads, which drop record --twice shows"
            )


def _part(calls: Iterable[Call]) -> Call | None:
    """Return the first of some calls whose arguments are recorded only in part."""
    return next((call for call in calls if SHORTENED.search(call.arguments)), None)


def cause_of_images(
    run: Side,
    golden: Side,
    *,
    call: OtherCall | None,
    made: Sequence[Setting],
    missing: int | None,
) -> Message:
    """Say in a sentence why images differ where nothing else does.

    Parameters
    ----------
    run, golden
        The two recordings.
    call
        The first other call, where it came before the first image that differs.
    made
        The versions that differ.
    missing
        The step of the first image that differs, where only one of both took it.
    """
    if call is not None:
        return _of_calls(run, golden)
    if missing is not None:
        why = Message(
            "the same calls, but at step {step} only one of them took an image, which does not "
            "count as a call",
            step=missing,
        )
        return _of_text(run, golden, why)
    why = Message(
        "the same calls, other images: another camera, which does not count as a call, or a file "
        "that is drawn has changed"
    )
    if made:
        why = Message(
            "the same calls, other images: made with {made}, or another camera, which does not "
            "count as a call, or a file that is drawn has changed",
            made=_versions(made),
        )
    return _of_text(run, golden, why)


def _versions(made: Sequence[Setting]) -> Message:
    """Return the versions that differ, in words."""
    return joined(
        ", ",
        (
            Message(
                "{name} {value}, golden {golden}",
                name=setting.name,
                value=setting.value,
                golden=setting.golden,
            )
            for setting in made
        ),
    )


def _of_text(run: Side, golden: Side, why: Message) -> Message:
    """Return a cause, with the note that the scripts differ where they do."""
    if not _other_text(run, golden):
        return why
    return Message("another text of the script, but {cause}", cause=why)


def _later_call(run: Sequence[Call], golden: Sequence[Call], until: int) -> Message | None:
    """Say which of the same calls is first made at another step, if one is by then."""
    pairs = (pair for calls in _by_client(run, golden) for pair in zip(*calls, strict=False))
    for call, other in pairs:
        if call.at.step != other.at.step and min(call.at.step, other.at.step) <= until:
            return Message(
                "the same calls, at other steps: {function} at {file}:{line} after step {step}, "
                "golden {golden}",
                function=call.function,
                file=call.file,
                line=call.line,
                step=call.at.step,
                golden=other.at.step,
            )
    return None


def _of_calls(run: Side, golden: Side) -> Message:
    """Say why two recordings have different calls."""
    if _other_text(run, golden):
        return Message("another script: its text and its calls differ")
    mine, theirs = (side.origin.get("script") for side in (run, golden))
    if mine != theirs and run.origin.get("script_sha256") is None:
        return Message("another script: {value}, golden {golden}", value=mine, golden=theirs)
    if _is_block(run):
        return _of_block(run, golden)
    causes = joined(", or ", _possible_of_calls(run, golden))
    if run.origin.get("script_sha256"):
        return Message("the same script, other calls: {causes}", causes=causes)
    return Message("a module of the same name, other calls: {causes}", causes=causes)


def _possible_of_calls(run: Side, golden: Side) -> Iterator[Message]:
    """Yield what may give the same script other calls; which of them did is not recorded."""
    for name in ("script", "arguments", "seed"):
        mine, theirs = (side.origin.get(name) for side in (run, golden))
        if mine == theirs:
            continue
        both = {"value": _shown(mine), "golden": _shown(theirs)}
        if name == "script":
            yield Message("its name {value}, golden {golden}", **both)
        elif name == "arguments":
            yield Message("arguments {value}, golden {golden}", **both)
        else:
            yield Message("--seed {value}, golden {golden}", **both)
    for place in (*run.seen.unseeded, *golden.seen.unseeded)[:1]:
        yield Message(
            "it draws unseeded random numbers, {place}, which --seed 0 fixes", place=place
        )
    if run.seen.real_time or golden.seen.real_time:
        yield Message("it asked for real-time simulation, which follows a clock")
    yield Message(
        "what it reads has changed, such as a module, a file, the environment or the time of day, "
        "or what is not the same in every run, such as how threads take turns or the order of a set"
    )


def _of_block(run: Side, golden: Side) -> Message:
    """Say why two blocks of Python, whose text is not recorded, have different calls."""
    unseeded = (*run.seen.unseeded, *golden.seen.unseeded)
    if unseeded:
        return Message(
            "other calls: the block's code has changed, or what it reads, or it draws unseeded "
            "random numbers, {place}; record both with seed=0",
            place=unseeded[0],
        )
    return Message(
        "other calls: the block's code has changed, its seed, or what it reads, such as a file or "
        "the time of day, or what is not the same in every run, such as the order of a set"
    )


def _is_block(side: Side) -> bool:
    """Whether a block of Python was recorded: the text of scripts is known, and modules have -m."""
    script = str(side.origin.get("script"))
    return side.origin.get("script_sha256") is None and not script.startswith("-m ")


def _other_text(run: Side, golden: Side) -> bool:
    digests = {side.origin.get("script_sha256") for side in (run, golden)}
    return len(digests) > 1 and None not in digests


def _last_step(side: Side) -> int:
    counts = side.seen.samples.values()
    return max([max(side.seen.states["step"], default=-1), *(count - 1 for count in counts)])


def _connections(seen: Seen, *, until: int) -> int:
    """Return how often a script connected up to a step: the engine is reported without a call."""
    called = {(call.client, call.at.step) for call in seen.calls}
    reports = [(each.client, each.at.step) for each in seen.settings if each.at.step <= until]
    return sum(report not in called for report in reports)


def _shown(value: object) -> str:
    if value is None:
        return Message("none")
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
