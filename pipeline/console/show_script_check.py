"""Say whether the recording of a script is the same physics as a golden one; if not, where."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pipeline.analysis.general.jsonable import jsonable
from pipeline.console.output import print_json, print_lines, titled
from pipeline.console.show_check import DIFFERS, frames_line, setting_line

if TYPE_CHECKING:
    from pipeline.analysis.script.cause import OtherCall
    from pipeline.analysis.script.comparison import ScriptComparison
    from pipeline.analysis.script.difference import Difference, Value
    from pipeline.seen import Call
    from pipeline.stages.check_script import ScriptCheck

MOST = 6
"""Settings that are told; all are in the JSON."""
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
        "differences": [], "versions": [],
    }  # fmt: skip
    if compared is not None:
        found |= {name: getattr(compared, name) for name in found.keys() & asdict(compared).keys()}
        found["differences"] = [_as_setting(one) for one in compared.differences]
    found |= {
        "frames": check.frames, "tolerance_m": check.tolerance_m, "recording": check.recording,
        "golden": check.golden, "updated": check.updated,
    }  # fmt: skip
    return dict(jsonable(found))


def _as_setting(one: Difference) -> dict[str, Any]:
    """Return a difference under the names that a setting has."""
    return {"name" if name == "column" else name: value for name, value in asdict(one).items()}


def check_lines(check: ScriptCheck) -> list[str]:
    """Say whether the two are the same, and if not, where and how."""
    compared = check.comparison
    updated = _titled("golden", f"{check.golden} is now {check.recording}")
    if compared is None:
        return updated
    lines = _titled("same" if check.same else "differs", f"{check.recording} and {check.golden}")
    if compared.largest_difference_m is not None:
        lines += _titled("positions", _positions(check, compared))
    if check.first is not None:
        lines += _titled("first", _difference(check.first))
    if compared.call_before is not None:
        lines += _titled("after", _call(compared.call_before))
    if compared.looks_like is not None:
        lines += _titled("looks like", compared.looks_like)
    if compared.other_call is not None:
        lines += _titled("call", _other_call(compared.other_call))
    if compared.cause is not None:
        lines += _titled("cause", compared.cause)
    more = [one for one in compared.differences if one != check.first]
    for difference in more[:MOST]:
        lines += _titled("also", _difference(difference))
    if len(more) > MOST:
        lines += _titled("", f"and {len(more) - MOST:,} more: see --json")
    if check.frames is not None:
        lines += _titled("frames", frames_line(check.frames))
    for version in compared.versions:
        lines += _titled("version", setting_line(version))
    return [*lines, *updated] if check.updated else lines


def _titled(title: str, words: str) -> list[str]:
    return titled(title, words, column=12)


def _positions(check: ScriptCheck, compared: ScriptComparison) -> str:
    if not compared.largest_difference_m:
        ends = check.first is not None and check.first.column == "there"
        return "identical, as far as both go" if ends else "identical"
    allowed = f"{check.tolerance_m:g} m" if check.tolerance_m else "nothing"
    return f"up to {compared.largest_difference_m:.3g} m apart; allowed: {allowed}"


def _difference(one: Difference) -> str:
    if one.column == "frame":
        return f"step {one.step}, an image"
    where = [f"step {one.step}"]
    if one.body is not None:
        where.append(one.body)
    if one.link is not None and one.link >= 0:
        where.append(f"link {one.link}")
    said = f"{', '.join(where)}, {one.column}: {_value(one.value)}, golden {_value(one.golden)}"
    return said if one.difference is None else f"{said} ({one.difference:+.3g})"


def _value(value: Value) -> str:
    return "none" if value is None else value if isinstance(value, str) else repr(value)


def _other_call(other: OtherCall) -> str:
    if other.value is None or other.golden is None:
        return f"{_call(other.value)}, golden {_call(other.golden)}"
    if other.moved:
        place = f"{other.golden.file}:{other.golden.line}"
        return f"the same from other lines, first {_call(other.value)}, golden {place}"
    return f"{_call(other.value)}, golden {_call(other.golden)}"


def _call(call: Call | None) -> str:
    if call is None:
        return "none"
    told = call.arguments
    told = told if len(told) <= LONGEST else f"{told[:LONGEST]}…"
    raised = f" raised {call.raised}" if call.raised else ""
    return f"{call.at.call}: {call.function}({told}){raised} at {call.file}:{call.line}"
