"""The report of `drop why`: the trial runs of a script, and what they show.

Trials of a finding have the same columns as trials of an expectation: a mark, the resulting
quantity, and the change with its effect on motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.analysis.results import renamed
from drop_physics.experiments.run_distance import APART
from drop_physics.experiments.verdicts import CAUSES, VERDICTS
from drop_physics.explain.jsonable import jsonable
from drop_physics.fields import counted
from drop_physics.messages import Message, joined, shell_command, translated
from drop_physics.report import expected
from drop_physics.report.blocks import (
    Block,
    Column,
    DataTable,
    FindingList,
    Graphs,
    Report,
    Section,
    Words,
)
from drop_physics.report.expected import FAILS, NOTHING
from drop_physics.report.tried import TriedRow, table_of
from drop_physics.stages.analyze import plot_of_recording
from drop_physics.stages.trust.findings import part_of, readable
from drop_physics.trace.events import ENDED

if TYPE_CHECKING:
    from drop_physics.experiments.run_distance import Distance
    from drop_physics.rules.answer import Finding
    from drop_physics.stages.why import Proved, Tried, Why

    Again = Callable[[str], str]

MARGIN = "   "
LONGEST = 52
"""Length to which a call may be truncated if room is short [characters]."""
LISTED = 4
"""Most lines about changes that an outcome depends on, without `--all`."""
MARKS = {
    "cured": Message("cured"),
    "part": Message("in part"),
    "refuted": Message("no"),
    "void": Message("void"),
    "chaotic": Message("chaotic"),
    "untried": "",
}
"""Marks of trials by their verdict."""
REASONS = {
    "void": Message("it changed nothing that can be compared, or made the script fail"),
    "untried": Message("not tried: there was no time left, or no run can apply it"),
}
HANGS = Message("the outcome hangs on it")
FREE = ("name", "target", "value", "call", "site", "moved")
"""JSON fields of a trial that is not about a finding."""


# -- as JSON --------------------------------------------------------------------------------------


def json_of(why: Why) -> dict[str, Any]:
    """Return the JSON object that `--json` prints."""
    return dict(
        jsonable(
            {
                "script": why.script,
                "recording": why.recording,
                "ended": why.ended,
                "runs": why.runs,
                "seconds": why.seconds,
                "noise": _noise(why),
                "findings": [
                    {
                        **renamed(jsonable(finding.finding)),
                        "verdict": finding.verdict,
                        "tried": [*map(_json_of_trial, finding.tried)],
                    }
                    for finding in why.findings
                ],
                "hangs_on": [
                    {name: value for name, value in _json_of_trial(each).items() if name in FREE}
                    for each in why.hangs_on
                ],
                "no_effect": [
                    {"call": each.call.removeprefix("without "), "site": each.site}
                    for each in why.no_effect
                ],
                "shares": why.shares and asdict(why.shares),
                **(NOTHING if why.expected is None else expected.json_of(why.expected)),
            }
        )
    )


def _noise(why: Why) -> dict[str, Any] | None:
    """Return how far a slight displacement of the start moves the outcome."""
    if why.noise is not None:
        return {"value": why.noise.value, "unit": why.noise.unit}
    if why.expected is None or why.expected.noise is None:
        return None
    return {"value": why.expected.noise, "unit": None}


def _json_of_trial(tried: Tried) -> dict[str, Any]:
    what, shown, far = tried.intervention, tried.shown, tried.moved
    moved = far and {"value": far.value, "unit": far.unit, "body": far.body, "joint": far.joint}
    return {
        "name": what.name,
        "target": what.target,
        "value": what.value,
        "call": what.call,
        "site": what.site,
        "verdict": tried.verdict,
        "before": shown and shown.before,
        "after": shown and shown.after,
        "unit": shown and shown.unit,
        "left": shown and shown.left,
        "moved": moved,
        "new": [] if shown is None else shown.new,
        "recording": tried.recording,
    }


# -- as a report ----------------------------------------------------------------------------------


def report_of(why: Why, *, every: bool = False, again: Again | None = None) -> Report:
    """Report the trials, fixes first; with `every`, all changes with an effect."""
    head = Message(
        "{script} {ended}: {steps}; {trials}",
        script=why.script,
        ended=ENDED[why.ended],
        steps=counted(why.steps, "step"),
        trials=counted(why.runs, "trial"),
    )
    its = why.expected
    is_assert = its is not None and its.source == "assert"
    findings = [  # where an assert is what is expected, that the script fails is said
        each for each in why.findings if not (is_assert and each.finding.code == "script-failed")
    ]
    order = sorted(findings, key=lambda finding: VERDICTS.index(finding.verdict))
    proved = [
        Section([*_proved(number, each, why.sources)], apart=False)
        for number, each in enumerate(order, 1)
    ]
    curves = Section([Graphs(partial(plot_of_recording, why.recording))], apart=False)
    last = [*_shares(why), *_hangs(why, every=every), *_idle(why)]
    first: list[Section] = []
    if why.expected is not None:
        first = [*expected.sections_of(why.expected, every=every)]
    fails = its is not None and its.source == "option" and not its.base.holds
    return Report(
        verdict=Words(head, key=why.script, indent="  "),
        sections=[*first, *proved, curves, *last],
        next=[_look(why), *([] if again is None else [again("trust")])],
        code=FAILS if fails else 0,
    )


def _look(why: Why) -> str:
    """Return the command that shows the unchanged run beside a trial that helps."""
    filmed = why.filmed()
    if filmed is None or not _cures(why):
        return shell_command("drop", "view", why.recording)
    return shell_command("drop", "view", filmed[0], "--against", why.recording)


def _cures(why: Why) -> bool:
    """Return whether a trial meets the expectation, or removes a finding."""
    makes_true = why.expected is not None and why.expected.filmed is not None
    return makes_true or any(finding.verdict == "cured" for finding in why.findings)


def _proved(number: int, proved: Proved, sources: Mapping[str, Path]) -> Iterator[Block]:
    """Yield a finding with the results of its trials, the best first."""
    shown = replace(proved.finding, tried=tuple(map(_json_of_trial, proved.tried)))
    finding = replace(proved.finding, advice=shown.advised, proposed=False)
    yield FindingList([finding], 1, sources=sources, first=number)
    tried = sorted(proved.tried, key=lambda each: VERDICTS.index(each.verdict))
    if not tried:
        yield Words(Message("not tried: drop has no trial for this"), "dim", margin=MARGIN)
        return
    rows = [
        TriedRow(_mark(each, proved.finding), _becomes(each), _told(each, proved.finding))
        for each in tried
    ]
    yield table_of(rows, MARGIN)
    wrong = proved.verdict == "refuted" and proved.finding.code not in CAUSES
    if wrong and any(each.intervention.decides for each in tried if each.verdict == "refuted"):
        words = Message("this finding is wrong: without that cause it happens, too")
        yield Words(words, margin=MARGIN)


def _is_hinge(tried: Tried, finding: Finding) -> bool:
    """Return whether a trial shows that the outcome depends on a cause that a finding names."""
    return finding.code in CAUSES and tried.verdict in ("cured", "part")


def _mark(tried: Tried, finding: Finding) -> str:
    return Message("yes") if _is_hinge(tried, finding) else MARKS[tried.verdict]


def _becomes(tried: Tried) -> str:
    """Describe the remaining part of a finding's effect; empty if the finding has no effect."""
    shown = tried.shown
    if shown is None or shown.left is None or shown.before is None or tried.verdict == "void":
        return ""
    if shown.after is None:
        return Message("gone") if not shown.left else ""
    unit = shown.unit or ""
    return Message(
        "{after} of {before}",
        after=readable(shown.after, unit),
        before=readable(shown.before, unit),
    )


def _told(tried: Tried, finding: Finding) -> str:
    """Describe a trial of a finding: the change, and the largest motion of a body or joint.

    A finding whose code is itself a cause is never cured: the outcome depends on that cause, or
    not.
    """
    parts: list[str] = [tried.intervention.short]
    if _is_hinge(tried, finding):
        parts.append(HANGS)
    if tried.verdict in ("void", "untried"):
        parts.append(REASONS[tried.verdict])
    elif tried.moved is not None:
        far = tried.moved
        part = far.joint or part_of(far.body, None, far.unit)
        moves = Message("{part} moves by {value}", part=part, value=readable(far.value, far.unit))
        parts.append(moves)
    if tried.shown is not None and tried.shown.new:
        codes = ", ".join(dict.fromkeys(tried.shown.new))
        parts.append(Message("new: {codes}", codes=codes))
    return joined("; ", parts)


def _hangs(why: Why, *, every: bool) -> Iterator[Section]:
    """Yield the changes that have an effect on the outcome."""
    moving = [(each, each.moved) for each in why.hangs_on if each.moved is not None]
    listed = moving if every else moving[:LISTED]
    rows = [(_named(each), readable(far.value, far.unit), _of(far)) for each, far in listed]
    rest = [far for _, far in moving[len(listed) :]]
    if rest:
        most = Message("{value} or less", value=readable(rest[0].value, rest[0].unit))
        rows.append((counted(len(rest), "other"), most, ""))
    chaotic = any(finding.verdict == "chaotic" for finding in why.findings)
    if why.noise is not None and (every or chaotic or why.noise.value > APART):
        noise = readable(why.noise.value, why.noise.unit)
        rows.append((Message("nudge of 1e-9"), noise, ""))
    if not rows:
        return
    calls, values, parts = ([*each] for each in zip(*rows, strict=True))
    table = DataTable(
        [
            Column(Message("the outcome hangs on"), calls, shrinks_to=LONGEST),
            Column(Message("it moves by"), values),
            Column("", parts, wraps=True),
        ]
    )
    yield Section([table])


def _of(far: Distance) -> str:
    return far.joint or part_of(far.body, None, far.unit)


def _named(tried: Tried) -> str:
    site, call = tried.intervention.site, tried.intervention.short
    leaves_out = tried.intervention.name == "without" and site is not None
    return Message("{site} {call}", site=site, call=call) if leaves_out else call


def _shares(why: Why) -> Iterator[Section]:
    """Describe one number of the outcome as a sum: -1.82 mm = -6.13 timestep +4.31 damping."""
    shares = why.shares
    if shares is None:
        return
    size, unit = (1e3, "mm") if shares.unit == "m" else (1.0, shares.unit)
    parts = joined(
        " ",
        [
            *(f"{_signed(value * size)} {name}" for name, value in shares.parts.items()),
            Message("{value} interaction", value=_signed(shares.interaction * size)),
        ],
    )
    words = Message(
        "{quantity}: {total} {unit} = {parts}",
        quantity=shares.quantity,
        total=_signed(shares.total * size),
        unit=unit,
        parts=parts,
    )
    yield Section([Words(words)])


def _signed(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}"  # no minus before a zero


def _idle(why: Why) -> Iterator[Section]:
    """Yield the script's lines whose omission has no effect."""
    sites: dict[str, list[str]] = {}
    for each in why.no_effect:
        sites.setdefault(each.site or "", []).append(each.call.removeprefix("without "))
    if sites:
        found = [f"{site} {', '.join(calls)}" for site, calls in sites.items()]
        words = Message("no effect on the run: {lines}", lines=joined("; ", found))
        yield Section([Words(translated(words))])
