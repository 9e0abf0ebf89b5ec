"""Single changes as texts, as `--try` takes them beside `--expect`: `geom_friction *10 of left`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from drop_physics.engines.watching.observed import nearest
from drop_physics.engines.watching.single_changes import Change, how_of
from drop_physics.errors import ScenarioError

TEXT = re.compile(r"(?P<change>\S+) (?P<op>\S+)(?: of (?P<names>.+?))?(?: at (?P<site>\S+:\d+))?")


def text_of(change: Change) -> str:
    """Return the text that repeats a change."""
    names = [each for each in change.of if each]
    of = f" of {', '.join(names)}" if names else ""
    at = "" if change.site is None else f" at {change.site[0]}:{change.site[1]}"
    return f"{change.change} {change.op}{of}{at}"


def tried(texts: Sequence[str], changes: Sequence[Change]) -> list[Change]:
    """Return the named changes among those that a run could have.

    A factor may be any number.

    Raises
    ------
    ScenarioError
        If the run could not have one.
    """
    return [_named(text, changes) for text in texts]


def _named(text: str, changes: Sequence[Change]) -> Change:
    found = TEXT.fullmatch(text.strip())
    alike: list[Change] = []
    if found is not None:
        alike = [
            each
            for each in changes
            if each.change == found["change"]
            and found["site"] in (None, each.site and f"{each.site[0]}:{each.site[1]}")
        ]
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
        "--try takes, beside --expect, a change that the run could have, such as {example}; got "
        "{text!r}; near it are: {near}",
        example="geom_friction *10 of left, right",
        text=text,
        near="; ".join(nearest(text, map(text_of, changes))),
    )


def _by(change: Change, op: str) -> Change | None:
    """Return a change with an operator; None if it is of another kind."""
    if change.op == op:
        return change
    operator, operand = how_of(op)
    if operator == change.how[0] == "*" and operand is not None:
        return change.by(operand)
    return None
