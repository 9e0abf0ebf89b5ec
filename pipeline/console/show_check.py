"""Say whether a recording is the same physics as a golden one, and if not, where and how."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pipeline.analysis.drop.comparison import IN_CONTACT_M
from pipeline.console.output import print_json, print_lines, titled
from pipeline.console.words import NONE
from pipeline.messages import Message, joined
from pipeline.scenario import Scenario

if TYPE_CHECKING:
    from pipeline.analysis.drop.comparison import Comparison, Place, Setting
    from pipeline.stages.check import Check, Frames
    from pipeline.stages.check_script import ScriptCheck

DIFFERS = 3
"""The exit code of a check that found a difference, or could not compare everything."""
GOLDEN, IDENTICAL, NOTHING = Message("golden"), Message("identical"), Message("nothing")
GIVEN = {True: Message("given"), False: Message("not given")}


def show_check(check: Check, *, as_json: bool) -> int:
    """Print what `check` found; return the exit code."""
    if as_json:
        print_json(_json(check))
    else:
        print_lines(*check_lines(check))
    return 0 if check.same or check.updated else DIFFERS


def _json(check: Check) -> dict[str, Any]:
    compared, first = check.comparison, check.first
    return {
        "same": check.same,
        "largest_difference_m": None if compared is None else compared.largest_difference_m,
        "first_difference": None if first is None else asdict(first),
        "looks_like": None if compared is None else compared.looks_like,
        "differences": []
        if compared is None
        else [asdict(difference) for difference in compared.differences],
        "versions": [] if compared is None else [asdict(version) for version in compared.versions],
        "frames": None if check.frames is None else asdict(check.frames),
        "tolerance_m": check.tolerance_m,
        "recording": str(check.recording),
        "golden": str(check.golden),
        "updated": check.updated,
    }


def check_lines(check: Check) -> list[str]:
    """Say whether the two are the same, and if not, where and how."""
    compared = check.comparison
    if compared is None:
        return updated_lines(check)
    lines = verdict_lines(check)
    if compared.same_experiment and compared.largest_difference_m is not None:
        lines += line_of(Message("positions"), _positions(check, compared))
    for difference in compared.differences:
        if difference.name in Scenario.options():
            lines += line_of(Message("setting"), _option(difference))
        else:
            lines += line_of(Message("engine"), setting_line(difference))
    if compared.same_experiment and check.first is not None:
        lines += line_of(Message("first"), _first(check.first))
    if compared.looks_like is not None:
        lines += line_of(Message("looks like"), compared.looks_like)
    if check.frames is not None:
        lines += line_of(Message("frames"), frames_line(check.frames))
    for version in compared.versions:
        lines += line_of(Message("version"), setting_line(version))
    return [*lines, *updated_lines(check)] if check.updated else lines


def line_of(title: str, words: str) -> list[str]:
    """Return a line of a check: a title and words."""
    return titled(title, words, column=12)


def verdict_lines(check: Check | ScriptCheck, *, undecided: bool = False) -> list[str]:
    """Say whether two recordings are the same; nobody knows where that is undecided."""
    verdict = Message("same") if check.same else Message("differs")
    return line_of(
        Message("undecided") if undecided else verdict,
        Message(
            "{recording} and {golden}", recording=str(check.recording), golden=str(check.golden)
        ),
    )


def updated_lines(check: Check | ScriptCheck) -> list[str]:
    """Say which recording is the golden one now."""
    words = Message(
        "{golden} is now {recording}", golden=str(check.golden), recording=str(check.recording)
    )
    return line_of(GOLDEN, words)


def _positions(check: Check, compared: Comparison) -> Message:
    if compared.largest_difference_m == 0:
        return IDENTICAL
    return Message(
        "up to {apart:.3g} m apart, at step {step}; allowed: {allowed}",
        apart=compared.largest_difference_m,
        step=compared.largest_difference_step,
        allowed=_allowed(check.tolerance_m),
    )


def _allowed(tolerance_m: float) -> str:
    if tolerance_m > IN_CONTACT_M:
        return f"{tolerance_m:g} m"
    return Message(
        "{air} in the air, {contact:g} m in contact",
        air=f"{tolerance_m:g} m" if tolerance_m else NOTHING,
        contact=IN_CONTACT_M,
    )


def _option(setting: Setting) -> Message:
    """Give a setting's value in both recordings, named by its option."""
    option = Scenario.options()[setting.name]
    value, golden = (
        GIVEN[not given] if option.is_flag else option.written(given)
        for given in (setting.value, setting.golden)
    )
    if value == golden:  # to the digits that are shown
        value, golden = repr(setting.value), repr(setting.golden)
    return beside_golden(option.name, value, golden)


def beside_golden(name: str, value: object, golden: object) -> Message:
    """Give a value of a recording, and that of the golden one."""
    return Message("{name} {value}, golden {golden}", name=name, value=value, golden=golden)


def setting_line(setting: Setting) -> Message:
    """Give a setting's value in both recordings."""
    name = setting.name.removeprefix("engine.").removesuffix("_version")
    return beside_golden(name, setting.value, setting.golden)


def _first(first: Place) -> Message:
    if first.column == "frame":
        return Message("step {step}, its picture", step=first.step)
    return Message(
        "step {step}, {column}: {value}, golden {golden}",
        step=first.step,
        column=first.column,
        value=_number(first.value),
        golden=_number(first.golden),
    )


def _number(value: float | None) -> str:
    return NONE if value is None else repr(value)


def frames_line(frames: Frames) -> Message:
    """Say how pictures compare."""
    if not frames.compared:
        return Message("none compared: {why}", why=frames.why)
    differ: Message = IDENTICAL
    if frames.differing:
        differ = Message("{differing} differ", differing=frames.differing)
    counts = Message("{compared} compared, {differ}", compared=frames.compared, differ=differ)
    return counts if frames.why is None else joined("; ", [counts, frames.why])
