"""Say whether a recording is the same physics as a golden one, and if not, where and how."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pipeline.analysis.drop.comparison import IN_CONTACT_M
from pipeline.console.output import print_json, print_lines, titled
from pipeline.scenario import Scenario

if TYPE_CHECKING:
    from pipeline.analysis.drop.comparison import Comparison, Place, Setting
    from pipeline.stages.check import Check, Frames

DIFFERS = 3
"""The exit code of a check that failed."""


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
        return _titled("golden", f"{check.golden} is now {check.recording}")
    lines = _titled("same" if check.same else "differs", f"{check.recording} and {check.golden}")
    if compared.same_experiment and compared.largest_difference_m is not None:
        lines += _titled("positions", _positions(check, compared))
    for difference in compared.differences:
        is_option = difference.name in Scenario.options()
        lines += _titled(
            *(
                ("setting", _option(difference))
                if is_option
                else ("engine", setting_line(difference))
            )
        )
    if compared.same_experiment and check.first is not None:
        lines += _titled("first", _first(check.first))
    if compared.looks_like is not None:
        lines += _titled("looks like", compared.looks_like)
    if check.frames is not None:
        lines += _titled("frames", frames_line(check.frames))
    for version in compared.versions:
        lines += _titled("version", setting_line(version))
    updated = _titled("golden", f"{check.golden} is now {check.recording}")
    return [*lines, *updated] if check.updated else lines


def _titled(title: str, words: str) -> list[str]:
    return titled(title, words, column=12)


def _positions(check: Check, compared: Comparison) -> str:
    if compared.largest_difference_m == 0:
        return "identical"
    return (
        f"up to {compared.largest_difference_m:.3g} m apart, at step "
        f"{compared.largest_difference_step}; allowed: {_allowed(check.tolerance_m)}"
    )


def _allowed(tolerance_m: float) -> str:
    if tolerance_m > IN_CONTACT_M:
        return f"{tolerance_m:g} m"
    air = f"{tolerance_m:g} m" if tolerance_m else "nothing"
    return f"{air} in the air, {IN_CONTACT_M:g} m in contact"


def _option(one: Setting) -> str:
    """Name a setting by the option that makes it."""
    option = Scenario.options()[one.name]
    if option.is_flag:
        given, golden = ("not given" if value else "given" for value in (one.value, one.golden))
        return f"{option.name} {given}, golden {golden}"
    return f"{option.name} {option.written(one.value)}, golden {option.written(one.golden)}"


def setting_line(one: Setting) -> str:
    """Say what both recordings have of something."""
    name = one.name.removeprefix("engine.").removesuffix("_version")
    return f"{name} {one.value}, golden {one.golden}"


def _first(first: Place) -> str:
    if first.column == "frame":
        return f"step {first.step}, its picture"
    mine, theirs = (_number(value) for value in (first.value, first.golden))
    return f"step {first.step}, {first.column}: {mine}, golden {theirs}"


def _number(value: float | None) -> str:
    return "none" if value is None else repr(value)


def frames_line(frames: Frames) -> str:
    """Say how pictures compare."""
    if not frames.compared:
        return f"none compared: {frames.why}"
    differ = f"{frames.differing} differ" if frames.differing else "identical"
    counts = f"{frames.compared} compared, {differ}"
    return counts if frames.why is None else f"{counts}; {frames.why}"
