"""The report of `drop check`: whether a recording agrees with the golden one, or where not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, cast

from drop_physics.compare.difference import Difference
from drop_physics.compare.tolerance import IN_CONTACT_M
from drop_physics.explain.jsonable import jsonable
from drop_physics.files.outputs import output_errors
from drop_physics.messages import Message, joined, localized, shell_command
from drop_physics.report.blocks import Fact, Facts, Report, Section
from drop_physics.report.markdown import markdown_of
from drop_physics.report.words import NONE
from drop_physics.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path

    from drop_physics.compare.comparison import Comparison
    from drop_physics.compare.difference import Largest
    from drop_physics.stages.check import Check, FrameComparison
    from drop_physics.stages.diff import Diff
    from drop_physics.trace.calls import Call

DIFFERS = 3
"""Exit code of a check that found a difference, or could not compare everything."""
GOLDEN, IDENTICAL, NOTHING = Message("golden"), Message("identical"), Message("nothing")
GIVEN = {True: Message("given"), False: Message("not given")}
MOST = 6
"""Most inputs listed; the JSON contains all."""
UNSEEN = Message(
    "{bodies}: the motion of soft bodies, and of links that PyBullet does not show, is not "
    "recorded, so it was not compared"
)
UNPAIRED = Message("{bodies}: in one of the two only, or with other joints there, so not compared")
SET = "engine.set_"
COLUMN = 12
"""Width of a title in characters."""
LONGEST = 160
"""Longest text of a call's arguments [characters]."""


def append_summary(check: Check, file: Path) -> None:
    """Append the verdict to a file, as Markdown.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with output_errors(file), file.open("a", encoding="utf-8") as stream:
        stream.write(summary_of(check))


# -- as JSON --------------------------------------------------------------------------------------


def json_of(check: Check) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    first, compared = check.first, check.comparison
    found: dict[str, Any] = {
        "same": check.same,
        "largest_difference_m": None,
        "first_difference": first and _place(first) | {"difference": first.difference},
        "call_before": None,
        "other_call": None,
        "differences": [],
        "largest": [],
        "not_compared": [],
        "script": [],
        "versions": [],
        "unseeded": [],
        "real_time": False,
    }
    if compared is not None:
        found |= {name: getattr(compared, name) for name in found if hasattr(compared, name)}
        found["same"] = check.same
        found["differences"] = [_difference_json(difference) for difference in compared.differences]
        found["call_before"] = _call_json(compared.call_before)
        other = compared.other_call
        found["other_call"] = other and {
            "value": _call_json(other.value),
            "golden": _call_json(other.golden),
        }
    found |= {
        "engines": check.engines,
        "why": None if check.why is None else check.why.as_json(),
        "frames": check.frames,
        "tolerance_m": check.tolerance_m,
        "recording": check.recording,
        "golden": check.golden,
        "updated": check.updated,
        "lacks": check.lacks,
    }
    return dict(jsonable(found))


def _difference_json(difference: Difference) -> dict[str, Any]:
    if difference.step is None:
        names = {"name": difference.column}
        return names | {"value": difference.value, "golden": difference.golden}
    values = _place(difference)
    return {"name": values.pop("column"), **values}


def _place(difference: Difference) -> dict[str, Any]:
    values = asdict(difference)
    del values["unit"]
    return values


def _call_json(call: Call | None) -> dict[str, Any] | None:
    if call is None:
        return None
    names = ("at", "client", "function", "arguments", "file", "line", "raised")
    return {name: getattr(call, name) for name in names}


# -- as lines -------------------------------------------------------------------------------------


def report_of(check: Check) -> Report:
    """Report whether two recordings are equal, or where and by how much they differ."""
    verdict, *others = _facts(check)
    code = 0 if check.same or check.updated else DIFFERS
    return Report(
        title="drop check",
        verdict=verdict,
        sections=[Section([Facts(others, COLUMN)], apart=False)],
        next=_next(check),
        code=code,
    )


def _next(check: Check) -> list[str]:
    """Return the commands to run next: show both recordings, or replace the golden one."""
    compared = ("check", check.recording, "--against", check.golden)
    if check.updated:
        return [shell_command("drop", *compared)]
    if check.same:
        return [shell_command("drop", "analyze", check.recording)]
    shown = shell_command("drop", "view", check.recording, "--against", check.golden)
    return [shown, shell_command("drop", *compared, "--update")]


def summary_of(check: Check) -> str:
    """Return the report as Markdown, for example for a CI job's summary."""
    report = markdown_of(check.report(), level=4)
    if check.same or check.updated:
        return f"{report}\n"
    words = localized("If the change is intended: {command}", command="`{}`")
    return f"{report}\n{words.format(_next(check)[-1])}\n\n"


def _facts(check: Check) -> Iterator[Fact]:
    """Yield the parts of the report, the verdict first."""
    compared = check.comparison
    if compared is not None:
        # Nobody knows where something is left out.
        undecided = check.first is None and not compared.differences
        same = Message("same") if check.same else Message("differs")
        yield Fact(
            Message("undecided") if undecided and not check.same else same,
            Message(
                "{recording} and {golden}", recording=str(check.recording), golden=str(check.golden)
            ),
        )
        yield from _compared(check, compared)
        for lacks in check.lacks:
            yield Fact(Message("lacks"), lacks)
    if check.updated:
        yield Fact(
            GOLDEN,
            Message(
                "{golden} is now {recording}",
                golden=str(check.golden),
                recording=str(check.recording),
            ),
        )


def _compared(check: Check, compared: Comparison) -> Iterator[Fact]:
    if left_out := _left_out(compared):
        yield Fact(Message("left out"), left_out)
    settings = [each for each in compared.differences if each.step is None]
    for setting in settings:
        if setting.column in Scenario.options():
            yield Fact(Message("setting"), _option(setting))
        else:
            name = setting.column.removeprefix("engine.")
            yield Fact(Message("engine"), _beside(name, setting.value, setting.golden))
    if check.why is not None:
        from drop_physics.report.diff import facts_of  # loads what runs scripts again

        yield from facts_of(cast("Diff", check.why))
    else:
        yield from _first(check, compared)
    yield from _distances(check, compared)
    # What a call sets is kept beside what the engine reports of it.
    told = {each.column for each in compared.differences}
    more = [
        each
        for each in (compared.differences if check.why is None else ())
        if each not in (*settings, check.first)
        and not (SET in each.column and each.column.replace(SET, "engine.") in told)
    ]
    for difference in more[:MOST]:
        title = Message("no effect") if check.same else Message("input")
        yield Fact(title, _difference(difference))
    if len(more) > MOST:
        yield Fact("", Message("and {more:,} more: see --json", more=len(more) - MOST))
    if check.engines is not None:
        yield Fact(Message("engines"), check.engines)
    if check.frames is not None:
        yield Fact(Message("frames"), _frames(check.frames))
    yield from _besides(compared)


def _first(check: Check, compared: Comparison) -> Iterator[Fact]:
    """Yield the first difference of a sample, and the calls near it."""
    if check.first is not None:
        yield Fact(Message("first"), _difference(check.first))
    if compared.call_before is not None:
        yield Fact(Message("after"), _call(compared.call_before))
    other = compared.other_call
    if other is not None:
        calls = {"call": _call(other.value), "golden": _call(other.golden)}
        yield Fact(Message("call"), Message("{call}, golden {golden}", **calls))


def _left_out(compared: Comparison) -> Message | None:
    """Name the bodies that were not compared, with the reason; None if all were compared."""
    unseen = [each for each in compared.not_compared if each not in compared.unpaired]
    words = [
        Message(template, bodies=", ".join(bodies[:MOST]) + (" …" if len(bodies) > MOST else ""))
        for template, bodies in ((UNSEEN, unseen), (UNPAIRED, compared.unpaired))
        if bodies
    ]
    return joined("; ", words) if words else None


def _distances(check: Check, compared: Comparison) -> Iterator[Fact]:
    """Yield the largest distances between positions, and between joint positions."""
    if compared.largest_difference_m is None:
        if not compared.of_drop:  # of which a setting says why
            yield Fact(Message("positions"), Message("nothing compared"))
        return
    farthest: dict[str, Largest] = {}
    for each in sorted(compared.largest, key=lambda each: -each.difference):
        farthest.setdefault(each.quantity, each)
    most, joint = farthest.get("position"), farthest.get("joint_position")
    if most is None:
        ends = check.first is not None and check.first.column == "there"
        yield Fact(
            Message("positions"), Message("identical, as far as both go") if ends else IDENTICAL
        )
    else:
        yield Fact(
            Message("positions"),
            Message(
                "up to {apart:.3g} m apart ({where}); allowed: {allowed}",
                apart=most.difference,
                where=_where(most),
                allowed=_allowed(check.tolerance_m, of_drop=compared.of_drop),
            ),
        )
    if joint is not None:
        yield Fact(
            Message("joints"),
            Message(
                "up to {apart:.3g} {unit} apart ({where})",
                apart=joint.difference,
                unit=joint.unit,
                where=_where(joint),
            ),
        )


def _where(place: Largest | Difference) -> Message:
    """Describe when a difference occurs, and in which part of a body."""
    words: list[str] = [Message("step {step}", step=place.step)]
    if isinstance(place, Difference) and place.time_s is not None:
        words.append(f"{place.time_s:.6g} s")
    if place.body is not None:
        words.append(place.body)
    if place.part is not None:
        words.append(Message("{part} (link {link})", part=place.part, link=place.link))
    elif place.link is not None and place.link >= 0:
        words.append(Message("link {link}", link=place.link))
    return joined(", ", words)


def _allowed(tolerance_m: float, *, of_drop: bool) -> str:
    air = f"{tolerance_m:g} m" if tolerance_m else NOTHING
    if not of_drop or tolerance_m > IN_CONTACT_M:
        return air
    return Message("{air} in the air, {contact:g} m in contact", air=air, contact=IN_CONTACT_M)


def _option(setting: Difference) -> Message:
    """Describe a setting that differs, by the name of its option."""
    option = Scenario.options()[setting.column]
    value, golden = (
        GIVEN[not given] if option.is_flag else option.written(given)
        for given in (setting.value, setting.golden)
    )
    if value == golden:  # to the digits that are shown
        value, golden = repr(setting.value), repr(setting.golden)
    return _beside(option.name, value, golden)


def _beside(name: str, value: object, golden: object) -> Message:
    """Format a value of the checked recording beside that of the golden one."""
    return Message("{name} {value}, golden {golden}", name=name, value=value, golden=golden)


def _difference(difference: Difference) -> Message:
    """Describe where a difference occurs, and both values to the last digit."""
    at = _where(difference)
    if difference.column == "frame":
        return Message("{where}: a picture", where=at)
    if difference.column == "there":
        if difference.value:
            return Message("{where}: here, but not in golden", where=at)
        return Message("{where}: in golden, but not here", where=at)
    words = Message(
        "{where}, {column}: {value}, golden {golden}",
        where=at,
        column=difference.column,
        value=_value(difference.value),
        golden=_value(difference.golden),
    )
    if difference.difference is None:
        return words
    return words + f" ({difference.difference:+.3g})"


def first_words(check: Check) -> Message:
    """Describe the first difference in a few words."""
    first = check.first
    if first is None:
        compared = check.comparison
        assert compared is not None
        if compared.differences:
            return _difference(compared.differences[0])
        return _left_out(compared) or Message("nothing compared")
    if first.step is None or first.difference is None:
        return _difference(first)
    return Message(
        "step {step}, {what} {difference}",
        step=first.step,
        what=first.part if first.unit else " ".join(filter(None, (first.body, first.column))),
        difference=f"{first.difference:+.2g} {first.unit}".rstrip(),
    )


def _value(value: object) -> str:
    return NONE if value is None else value if isinstance(value, str) else repr(value)


def _call(call: Call | None) -> Message:
    if call is None:
        return NONE
    arguments = call.arguments
    if len(arguments) > LONGEST:
        arguments = f"{arguments[:LONGEST]}…"
    values = {
        "call": f"{call.at.call}: {call.function}({arguments})",
        "place": call.site.place,
    }
    if call.raised:
        return Message("{call} raised {error} at {place}", error=call.raised, **values)
    return Message("{call} at {place}", **values)


def _frames(frames: FrameComparison) -> Message:
    """Describe the comparison of the images."""
    if not frames.compared:
        return Message("none compared: {why}", why=frames.why)
    differ: Message = IDENTICAL
    if frames.differing:
        differ = Message("{differing} differ", differing=frames.differing)
    counts = Message("{compared} compared, {differ}", compared=frames.compared, differ=differ)
    return counts if frames.why is None else joined("; ", [counts, frames.why])


OF_BITS = frozenset(("mujoco",))
"""Libraries whose version may change the last bits of a run."""


def _besides(compared: Comparison) -> Iterator[Fact]:
    """Yield differences other than physics, and possible causes of the differences."""
    for setting in compared.script:
        if setting.name == "script_sha256":
            yield Fact(Message("script"), Message("its text differs"))
        else:
            value, golden = (
                " ".join(map(str, each)) if isinstance(each, list) else _value(each)
                for each in (setting.value, setting.golden)
            )
            names = Message("{call}, golden {golden}", call=value, golden=golden)
            named = _beside(setting.name, value, golden)
            yield Fact(Message("script"), names if setting.name == "script" else named)
    if compared.other_call is not None and compared.unseeded:
        yield Fact(
            Message("draws"),
            Message(
                "unseeded random numbers at {places}; --seed 0 fixes them",
                places=", ".join(compared.unseeded[:MOST]),
            ),
        )
    if compared.other_call is not None and compared.real_time:
        yield Fact(Message("clock"), Message("real-time simulation was asked for"))
    for version in compared.versions:
        name = version.name.removesuffix("_version")
        yield Fact(Message("version"), _beside(name, version.value, version.golden))
    if OF_BITS & {version.name for version in compared.versions}:
        yield Fact(
            Message("bits"),
            Message(
                "agree only within one version of MuJoCo and one kind of processor; otherwise use "
                "--tolerance"
            ),
        )
