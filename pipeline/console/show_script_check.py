"""Say whether the recording of a script is the same physics as a golden one; if not, where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pipeline.analysis.general.jsonable import jsonable
from pipeline.console.output import print_json, print_lines
from pipeline.console.show_check import (
    DIFFERS,
    IDENTICAL,
    NOTHING,
    frames_line,
    line_of,
    setting_line,
    updated_lines,
    verdict_lines,
)
from pipeline.console.words import NONE
from pipeline.messages import Message, joined

if TYPE_CHECKING:
    from pipeline.analysis.script.cause import OtherCall
    from pipeline.analysis.script.comparison import ScriptComparison
    from pipeline.analysis.script.difference import Difference, Value
    from pipeline.seen import Call
    from pipeline.stages.check_script import ScriptCheck

MOST = 6
"""Settings that are listed; all are in the JSON."""
LONGEST = 160
"""Characters of a call's arguments."""


def show_script_check(check: ScriptCheck, *, as_json: bool) -> int:
    """Print what `check` found; return the exit code."""
    if as_json:
        print_json(_json(check))
    else:
        print_lines(*check_lines(check))
    return 0 if check.same or check.updated else DIFFERS


def _json(check: ScriptCheck) -> dict[str, Any]:
    first, compared = check.first, check.comparison
    found: dict[str, Any] = {
        "same": check.same,
        "largest_difference_m": None,
        "first_difference": first and asdict(first) | {"difference": first.difference},
        "looks_like": None, "cause": None, "call_before": None, "other_call": None,
        "differences": [], "versions": [], "not_compared": [],
    }  # fmt: skip
    if compared is not None:
        found |= {name: getattr(compared, name) for name in found.keys() & asdict(compared).keys()}
        found["differences"] = [_as_setting(difference) for difference in compared.differences]
    found |= {
        "frames": check.frames, "tolerance_m": check.tolerance_m, "recording": check.recording,
        "golden": check.golden, "updated": check.updated,
    }  # fmt: skip
    return dict(jsonable(found))


def _as_setting(difference: Difference) -> dict[str, Any]:
    """Return a difference under the names that a setting has."""
    values = asdict(difference)
    return {"name" if name == "column" else name: value for name, value in values.items()}


def check_lines(check: ScriptCheck) -> list[str]:
    """Say whether the two are the same, and if not, where and how."""
    compared = check.comparison
    if compared is None:
        return updated_lines(check)
    lines = verdict_lines(check, undecided=check.first is None and bool(check.not_compared))
    if check.not_compared:
        lines += line_of(Message("left out"), left_out(check.not_compared))
    if compared.largest_difference_m is not None:
        lines += line_of(Message("positions"), _positions(check, compared))
    if check.first is not None:
        lines += line_of(Message("first"), _difference(check.first))
    if compared.call_before is not None:
        lines += line_of(Message("after"), _call(compared.call_before))
    if compared.looks_like is not None:
        lines += line_of(Message("looks like"), compared.looks_like)
    if compared.other_call is not None:
        lines += line_of(Message("call"), _other_call(compared.other_call))
    if compared.cause is not None:
        lines += line_of(Message("cause"), compared.cause)
    more = [difference for difference in compared.differences if difference != check.first]
    for difference in more[:MOST]:
        lines += line_of(Message("also"), _difference(difference))
    if len(more) > MOST:
        lines += line_of("", Message("and {more:,} more: see --json", more=len(more) - MOST))
    if check.frames is not None:
        lines += line_of(Message("frames"), frames_line(check.frames))
    for version in compared.versions:
        lines += line_of(Message("version"), setting_line(version))
    return [*lines, *updated_lines(check)] if check.updated else lines


def left_out(bodies: Sequence[str]) -> Message:
    """Say which bodies could not be compared, and why."""
    return Message(
        "{bodies}: the motion of soft bodies, and of links that PyBullet does not show, is not "
        "recorded, so it was not compared",
        bodies=", ".join(bodies[:MOST]) + (" …" if len(bodies) > MOST else ""),
    )


def _positions(check: ScriptCheck, compared: ScriptComparison) -> Message:
    if not compared.largest_difference_m:
        ends = check.first is not None and check.first.column == "there"
        return Message("identical, as far as both go") if ends else IDENTICAL
    return Message(
        "up to {apart:.3g} m apart; allowed: {allowed}",
        apart=compared.largest_difference_m,
        allowed=f"{check.tolerance_m:g} m" if check.tolerance_m else NOTHING,
    )


def _difference(difference: Difference) -> Message:
    if difference.column == "frame":
        return Message("step {step}, an image", step=difference.step)
    where: list[str] = [Message("step {step}", step=difference.step)]
    if difference.body is not None:
        where.append(difference.body)
    if difference.link is not None and difference.link >= 0:
        where.append(Message("link {link}", link=difference.link))
    words = Message(
        "{where}, {column}: {value}, golden {golden}",
        where=joined(", ", where),
        column=difference.column,
        value=_value(difference.value),
        golden=_value(difference.golden),
    )
    if difference.difference is None:
        return words
    return words + f" ({difference.difference:+.3g})"


def _value(value: Value) -> str:
    return NONE if value is None else value if isinstance(value, str) else repr(value)


def _other_call(other: OtherCall) -> Message:
    if other.value is not None and other.golden is not None and other.moved:
        return Message(
            "the same from other lines, first {call}, golden {file}:{line}",
            call=_call(other.value),
            file=other.golden.file,
            line=other.golden.line,
        )
    return Message("{call}, golden {golden}", call=_call(other.value), golden=_call(other.golden))


def _call(call: Call | None) -> Message:
    if call is None:
        return NONE
    arguments = call.arguments
    if len(arguments) > LONGEST:
        arguments = f"{arguments[:LONGEST]}…"
    values = {
        "call": f"{call.at.call}: {call.function}({arguments})",
        "place": f"{call.file}:{call.line}",
    }
    if call.raised:
        return Message("{call} raised {error} at {place}", error=call.raised, **values)
    return Message("{call} at {place}", **values)
