"""Say whether a recording is the same physics as a golden one, and if not, where and how."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from pipeline.budget.comparison import IN_CONTACT_M
from pipeline.console.output import print_json, print_lines

if TYPE_CHECKING:
    from pipeline.budget.comparison import Setting
    from pipeline.stages.check import Check

DIFFERS = 3
"""The exit code of a check that did not hold."""


def show_check(check: Check, *, as_json: bool) -> int:
    """Print what `check` found; return the exit code."""
    if as_json:
        print_json(_json(check))
    else:
        print_lines(*map(escape, _lines(check)))
    return 0 if check.same or check.updated else DIFFERS


def _json(check: Check) -> dict[str, Any]:
    compared, first = check.comparison, check.first
    return {
        "same": check.same,
        "largest_difference_m": None if compared is None else compared.largest_difference_m,
        "first_difference": None if first is None else asdict(first),
        "looks_like": None if compared is None else compared.looks_like,
        "differences": [] if compared is None else [asdict(one) for one in compared.differences],
        "versions": [] if compared is None else [asdict(one) for one in compared.versions],
        "frames": None if check.frames is None else asdict(check.frames),
        "tolerance_m": check.tolerance_m,
        "recording": str(check.recording),
        "golden": str(check.golden),
        "updated": check.updated,
    }


def _lines(check: Check) -> list[str]:
    compared = check.comparison
    if compared is None:
        return [f"{check.golden} is now {check.recording}"]
    lines = [f"{'same' if check.same else 'differs':<12}{check.recording} and {check.golden}"]
    if not compared.differences and compared.largest_difference_m is not None:
        lines.append(
            f"{'largest':<12}{compared.largest_difference_m:.3g} m at step "
            f"{compared.largest_difference_step}; allowed {_allowed(check.tolerance_m)}"
        )
    lines += [f"{'setting':<12}{_setting(one)}" for one in compared.differences]
    if not compared.differences and check.first is not None:
        lines.append(f"{'first':<12}{_first(check)}")
    if compared.looks_like is not None:
        lines.append(f"{'looks like':<12}{compared.looks_like}")
    if check.frames is not None:
        lines.append(f"{'frames':<12}{_frames(check)}")
    lines += [f"{'version':<12}{_setting(one)}" for one in compared.versions]
    return [*lines, f"{check.golden} is now {check.recording}"] if check.updated else lines


def _allowed(tolerance_m: float) -> str:
    if tolerance_m > IN_CONTACT_M:
        return f"{tolerance_m:g} m"
    air = f"{tolerance_m:g} m" if tolerance_m else "nothing"
    return f"{air} in the air, {IN_CONTACT_M:g} m in contact"


def _setting(one: Setting) -> str:
    return f"{one.name} {_value(one.value)}, golden {_value(one.golden)}"


def _value(value: object) -> str:
    return "default" if value is None else str(value)


def _first(check: Check) -> str:
    first = check.first
    assert first is not None
    if first.column == "frame":
        return f"step {first.step}, its picture"
    mine, theirs = (_number(value) for value in (first.value, first.golden))
    return f"step {first.step}, {first.column}: {mine}, golden {theirs}"


def _number(value: float | None) -> str:
    return "none" if value is None else repr(value)


def _frames(check: Check) -> str:
    frames = check.frames
    assert frames is not None
    counts = f"{frames.compared} compared, {frames.differing} differ"
    return counts if frames.why is None else f"{counts}; {frames.why}"
