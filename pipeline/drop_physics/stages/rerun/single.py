"""Lists the single changes that are possible in a run, such as `geom_friction *10 of left`.

`--try` and `--vary` take these texts: `geom_friction *10 of left`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drop_physics.engines.cures import TABLES
from drop_physics.engines.script import Program
from drop_physics.engines.source import changes_of
from drop_physics.engines.watching.observed import nearest
from drop_physics.engines.watching.single_changes import Change, change_of, how_of
from drop_physics.errors import DropError, ScenarioError
from drop_physics.stages.rerun.again import Again
from drop_physics.stages.rerun.evaluated import Answer, EvaluatedRuns, evaluator_of
from drop_physics.stages.rerun.reruns import Reruns
from drop_physics.stages.rerun.source_texts import SourceText, source_texts
from drop_physics.trace.cures import ChangedRun

TEXT = re.compile(
    r"(?P<change>\S+) (?P<op>[-=*/+^~]\S*|[a-z]+(?:-[a-z]+)?)"
    r"(?: of (?P<names>.+?))?(?: at (?P<site>\S+:\d+))?"
)
RESIDUAL_0 = "residual 0"
"""Intervention whose text looks like that of a single change."""
SINGLE = "change"
"""Name of an intervention that stands for a single change."""


def is_single(text: str) -> bool:
    """Return whether a text names a single change, and not one from the table of fixes."""
    return text != RESIDUAL_0 and TEXT.fullmatch(text.strip()) is not None


def text_of(change: Change) -> str:
    """Return the text by which `--try` names a change."""
    if not change.op:  # an intervention, which has a name
        return change.change
    names = [each for each in change.of if each]
    of = f" of {', '.join(names)}" if names else ""
    at = "" if change.site is None else f" at {change.site[0]}:{change.site[1]}"
    return f"{change.change} {change.op}{of}{at}"


@dataclass(frozen=True)
class SeenChanges:
    """The single changes that are possible in a run."""

    answer: Answer
    """The evaluator's answer: the outcome of the expectation, and the possible changes."""
    of_engine: list[Change]
    """Changes to engine data, such as model fields and calls."""
    of_text: list[Change]
    """Changes to the source text of the script, its modules and models."""
    texts: list[SourceText]


def seen_changes(trials: EvaluatedRuns, engine: str) -> SeenChanges:
    """Run a script to find out which single changes are possible.

    Raises
    ------
    DropError
        If the script cannot be run again.
    """
    program = trials.program
    evaluator: dict[str, Any] = {**(program.evaluator or evaluator_of(None))}
    rows = {name: each.tried for name, each in TABLES.items()}
    arguments = {**evaluator["arguments"], "rows": rows}
    seen, ended = trials.answered(
        ChangedRun([{**each} for each in TABLES[engine].sees]),
        {**evaluator, "arguments": arguments},
    )
    if seen is None or seen["changes"] is None:
        raise DropError(
            "{script} cannot be run again as it was: {reason}",
            script=program.target,
            reason=ended,
        )
    script = None if program.is_module else Path(program.target)
    texts = source_texts(script, map(Path, seen["modules"]))
    layers = trials.reruns.again.folders
    of_text = [
        change
        for each in texts
        if not each.path or any(Path(each.path).is_relative_to(folder) for folder in layers)
        for change in changes_of(each.text, each.shown, arguments["text"] or "", each.path)
    ]
    return SeenChanges(seen, [*map(change_of, seen["changes"])], of_text, texts)


def possible(program: Program, again: Again, engine: str) -> list[Change]:
    """Run a program to find out which single changes are possible.

    Raises
    ------
    DropError
        If the script cannot be run again.
    """
    silent = replace(program, streams=False, explain=False)
    reruns = Reruns(silent, again)
    trials = EvaluatedRuns(silent, reruns, reruns, frozenset(), float("inf"), 1)
    seen = seen_changes(trials, engine)
    return [*seen.of_engine, *seen.of_text]


def named(text: str, changes: Sequence[Change]) -> Change:
    """Return the change that a text names; any factor is allowed.

    Raises
    ------
    ScenarioError
        If the change is not possible in the run.
    """
    found = TEXT.fullmatch(text.strip())
    alike: list[Change] = []
    if found is not None:
        alike = [
            each
            for each in changes
            if each.change == found["change"]
            and found["site"] in (None, each.site and f"{each.site[0]}:{each.site[1]}")
        ]
        alike.sort(key=lambda each: (each.op != found["op"], each.site is not None))
    for each in alike:
        assert found is not None
        change = _by(each, found["op"])
        if change is None:
            continue
        if found["names"] is None:
            return change
        names = found["names"].split(", ")
        places = [change.of.index(name) for name in names if name in change.of]
        if len(places) == len(names):
            return change.of_some(places)
    raise ScenarioError(
        "{text!r} is no change that the run could have; near it are: {near}; drop why --expect "
        "prints those that make something true",
        text=text,
        near="; ".join(nearest(text, map(text_of, changes))),
    )


def _by(change: Change, op: str) -> Change | None:
    """Return a change with another operator; None if that operator does not apply."""
    if change.op == op:
        return change
    operator, operand = how_of(op)
    if operator == change.how[0] == "*" and operand is not None:
        return change.by(operand)
    return None
