"""What `drop explain` says of a code: as the sources of the rules have it.

A rule's sentence, its thresholds, what it says and what it advises stand in its source;
`docs/regenerate.py` gathers them in a file beside this one, and a test sees that it is not stale.
"""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.rules.answer import Level
from drop_physics.rules.codes import CODES
from drop_physics.trace.cures import Cure

FILE = "reference.json"
"""What the sources of the rules say, by code and reason."""
PLACEHOLDER = re.compile(r"(\}?)\{(\w+)[^{}]*(?=\})")
"""A value in a template: what is before it, if that is another, and its name."""


class Blank:
    """What stands for a value that only a finding has."""

    def __init__(self, shown: str) -> None:
        self._shown = shown

    def __format__(self, form: str) -> str:
        return self._shown


@dataclass(frozen=True)
class Limit:
    """A threshold of a rule."""

    name: str
    """Name of the constant in the source."""
    value: float
    """Value in its unit."""
    unit: str
    """`share` of what the meaning names, `1` of a count."""
    meaning: str
    """The quantity that it limits."""


@dataclass(frozen=True)
class CodeExample:
    """A script of the documentation that shows a code, and what is said of it."""

    asked: str
    """The question of its user."""
    script: str
    """The script, from the root of the repository."""
    line: str | None
    """The line that a finding cites; null where it cites none."""
    says: str
    """The message of the finding."""
    advises: str | None = None
    """The advice of the finding; null where it has none."""


@dataclass(frozen=True)
class CodeReference:
    """What a code, or one of its reasons, means."""

    code: str
    """The code, or the reason."""
    reason_of: str | None
    """The code that it is a reason of; null for a code."""
    level: Level | None
    """The level, unless a finding states another; null where that depends."""
    meaning: str
    """What was asked and what happened instead, in a sentence."""
    measured: list[str] = field(default_factory=list)
    """The conditions that are looked for, a sentence per rule."""
    thresholds: list[Limit] = field(default_factory=list)
    """The thresholds that decide."""
    says: list[str] = field(default_factory=list)
    """What a finding says; … is a number or a name."""
    advises: list[str] = field(default_factory=list)
    """What changes it."""
    proposes: list[str] = field(default_factory=list)
    """What is to be tried, where nothing proves that it changes it."""
    example: CodeExample | None = None
    """A script that shows it; null where the documentation has none."""
    cures: tuple[tuple[str, Cure, bool], ...] = field(default=(), metadata={"json": False})
    """The thresholds of its rules, nan where a value depends; the engine that writes the call of
    each, and whether it is to be tried."""


def reference_of(name: str) -> CodeReference:
    """Return what a code or a reason means.

    Raises
    ------
    ScenarioError
        If there is none of that name; the message says which is alike.
    """
    if name not in CODES:
        raise ScenarioError(
            "CODE is a code or a reason of a finding, got {name!r}; did you mean {near}?",
            name=name,
            near=difflib.get_close_matches(name, CODES, 1, 0.0)[0],
        )
    return references()[name]


@cache
def references() -> dict[str, CodeReference]:
    """Return the meanings of all codes and reasons, by their names."""
    held = json.loads(resources.files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
    return {name: reference_from(name, held.get(name, {})) for name in CODES}


def reference_from(name: str, texts: Mapping[str, Any]) -> CodeReference:
    """Return what a code or a reason means, given what the sources of its rules say."""
    example = dict(texts.get("example") or {})
    for key in {"says", "advises"} & example.keys():
        example[key] = example[key] and Message(example[key])
    limits = texts.get("thresholds", ())
    cures = texts.get("cures", ())
    return CodeReference(
        code=name,
        reason_of=texts.get("reason_of"),
        level=texts.get("level"),
        meaning=Message(CODES[name]),
        measured=[Message(each) for each in texts.get("measured", ())],
        thresholds=[Limit(**{**each, "meaning": Message(each["meaning"])}) for each in limits],
        says=[blanked(each) for each in texts.get("says", ())],
        advises=[blanked(each) for each in texts.get("advises", ())],
        proposes=[blanked(each) for each in texts.get("proposes", ())],
        example=CodeExample(**example) if example else None,
        cures=tuple(
            (
                each["engine"],
                Cure(
                    each["name"],
                    value=math.nan if each["has_value"] else None,
                    form=each["form"],
                    given=dict.fromkeys(each["given"], math.nan),
                ),
                each["proposed"],
            )
            for each in cures
        ),
    )


def blanked(template: str) -> Message:
    """Return a message with … in place of what is filled in, once of two in a row."""
    found = PLACEHOLDER.findall(template)
    return Message(template, **{name: Blank("" if before else "…") for before, name in found})


def sentences() -> Iterator[str]:
    """Yield the texts of all meanings, without those that rules have as a `Message`."""
    for each in references().values():
        yield from (each.meaning, *each.measured, *(limit.meaning for limit in each.thresholds))
        if each.example is not None:
            yield from filter(None, (each.example.says, each.example.advises))
