"""What `drop explain` says of a code: read from the sources of the rules, so that it is not stale.

A rule's sentence, its thresholds, what it says and what it advises stand in its source; here they
are only gathered. A code that several rules share has those of all.
"""

from __future__ import annotations

import ast
import difflib
import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import field
from functools import cache
from importlib import resources
from typing import Any, get_args

from drop_physics.data import dataclass
from drop_physics.errors import ScenarioError
from drop_physics.messages import Message
from drop_physics.rules.answer import LEVELS, Level
from drop_physics.rules.codes import CODES
from drop_physics.rules.thresholds import TABLE
from drop_physics.trace.cures import Cure

ROOMS = "rules", "drop"
"""Folders whose modules find something."""
ADVISES = {"advice", "cure"}
"""Arguments that hold what is advised."""
EXAMPLES = "examples.json"
"""File of examples, by code, which `docs/regenerate.py` writes."""
FULL = 4
"""Arguments of a cure whose rule writes the call itself."""
LEAST = 25
"""Characters of a message that is a sentence, and no part of one."""
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
    """Name of the constant."""
    value: float
    """Value in its unit."""
    unit: str
    """`share` of what the meaning names, `1` of a count."""
    meaning: str
    """What it limits."""


@dataclass(frozen=True)
class CodeExample:
    """A script of the documentation that shows a code, and what is said of it."""

    asked: str
    """What its user asks."""
    script: str
    """The script, from the root of the repository."""
    line: str | None
    """The line that a finding cites; null where it cites none."""
    says: str
    """What the finding says."""
    advises: str | None = None
    """What it advises; null where it does not."""


@dataclass(frozen=True)
class CodeReference:
    """What a code, or one of its reasons, means."""

    code: str
    """The code, or the reason."""
    reason_of: str | None
    """The code that it is a reason of; null for a code."""
    level: Level | None
    """How grave it is, unless a finding says another; null where that depends."""
    meaning: str
    """What was asked and what happened instead, in a sentence."""
    measured: list[str] = field(default_factory=list)
    """What is looked for, a sentence per rule."""
    thresholds: list[Limit] = field(default_factory=list)
    """The numbers that decide."""
    says: list[str] = field(default_factory=list)
    """What a finding says; … is a number or a name."""
    advises: list[str] = field(default_factory=list)
    """What changes it."""
    example: CodeExample | None = None
    """A script that shows it; null where the documentation has none."""
    cures: tuple[Cure, ...] = field(default=(), metadata={"json": False})
    """Those of its rules whose calls the engine writes; nan where it depends."""


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
    """Return all of them, by their names."""
    folder = resources.files("drop_physics.rules")
    held = json.loads(folder.joinpath(EXAMPLES).read_text(encoding="utf-8"))
    examples = {code: _example(**example) for code, example in held.items()}
    made = {
        name: CodeReference(name, None, None, Message(meaning), example=examples.get(name))
        for name, meaning in CODES.items()
    }
    for room in ROOMS:
        for file in sorted(resources.files(f"drop_physics.{room}").iterdir(), key=str):
            if file.name.endswith(".py"):
                module = ast.parse(file.read_text(encoding="utf-8"))
                limits = _limits_in(module)
                for parts, code, reason, level in _rules_in(module):
                    for name in {code, reason or code}:
                        made[name] = _with(made[name], parts, limits, code, level)
    return made


def _example(*, says: str, advises: str | None, **where: Any) -> CodeExample:  # noqa: ANN401
    return CodeExample(**where, says=Message(says), advises=advises and Message(advises))


def sentences() -> Iterator[str]:
    """Yield what is translated of all of them, but for what stands in the rules as a `Message`."""
    for each in references().values():
        yield from (each.meaning, *each.measured, *(limit.meaning for limit in each.thresholds))
        if each.example is not None:
            yield from filter(None, (each.example.says, each.example.advises))


def _rules_in(
    module: ast.Module,
) -> Iterator[tuple[list[ast.stmt], str, str | None, str | None]]:
    """Yield each rule of a module: its functions, its code, reason and level.

    Where there is only one, all that the module says is its; keys of a table there are its reasons.
    """
    functions = [node for node in ast.walk(module) if isinstance(node, ast.FunctionDef)]
    beside = defaultdict[str, list[ast.stmt]](list)
    rules: list[tuple[ast.FunctionDef, ast.Call]] = []
    for node in functions:
        for decorator in node.decorator_list:
            if isinstance(decorator, ast.Attribute) and isinstance(decorator.value, ast.Name):
                beside[decorator.value.id].append(node)
            elif isinstance(decorator, ast.Call) and _name(decorator.func).endswith("_rule"):
                rules.append((node, decorator))
    alone = [each for each in functions if len(rules) == 1]
    for node, decorator in rules:
        given = [_text(each) for each in decorator.args]
        reason = given[2] if len(given) > 2 else _keyword(decorator, "reason")
        yield [node, *(alone or beside[node.name])], given[0] or "", reason, given[1]
        for table in ast.walk(module) if alone else ():
            pairs = (
                zip(table.keys, table.values, strict=True) if isinstance(table, ast.Dict) else ()
            )
            for key, value in pairs:
                if key is not None and (name := _text(key)) in CODES:
                    its = [each for each in functions if each.name == _name(value)]
                    yield [*its], given[0] or "", name, given[1]
    levels = _levels(module)
    for node in functions:
        for call in ast.walk(node):
            if isinstance(call, ast.Call) and _name(call.func) in ("Finding", "_found"):
                of = _keyword(call, "code") or (_text(call.args[0]) if call.args else None)
                if of is not None:
                    yield [node], of, None, levels.get(of) or _keyword(call, "level")


def _levels(module: ast.Module) -> dict[str, str]:
    """Return levels by their codes, as a table of a module has them."""
    for node in ast.walk(module):
        match node:
            case ast.AnnAssign(target=ast.Name(id="LEVEL_OF"), value=ast.Dict() as table):
                levels: dict[str, str] = ast.literal_eval(table)
                return levels
    return {}


def _limits_in(module: ast.Module) -> set[str]:
    """Return the names of thresholds that a module takes from their table."""
    return {
        name.name
        for node in module.body
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith(".thresholds")
        for name in node.names
    }


def _with(
    known: CodeReference, parts: list[ast.stmt], limits: set[str], code: str, level: str | None
) -> CodeReference:
    """Return what is known of a name, and what one more rule of it tells."""
    documented = [each for each in parts if isinstance(each, ast.FunctionDef | ast.ClassDef)]
    first = [Message(_first(ast.get_docstring(each))) for each in documented[:1]]
    measured = [each for each in first if each and not each.startswith(("Return", "Yield"))]
    advised: list[str] = []
    said: list[str] = []
    cures: list[Cure] = []
    for node in [inner for each in parts for inner in ast.walk(each)]:
        match node:
            case ast.keyword(arg=name, value=value) if name in ADVISES:
                advised += _messages(value)
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in ADVISES:
                advised += _messages(value)
        if isinstance(node, ast.Call) and _name(node.func) == "Cure" and len(node.args) < FULL:
            cures.append(_cure(node))
    for each in parts:
        said += [text for text in _messages(each) if text not in advised and len(text) > LEAST]
    names = {node.id for each in parts for node in ast.walk(each) if isinstance(node, ast.Name)}
    used = [
        Limit(name, TABLE[name].value, TABLE[name].unit, Message(TABLE[name].meaning))
        for name in TABLE
        if name in names & limits
    ]
    rated = next((each for each in get_args(Level) if each == level), None)
    return CodeReference(
        code=known.code,
        reason_of=None if known.code == code else code,
        level=min((each for each in (known.level, rated) if each), key=LEVELS.index, default=None),
        meaning=known.meaning,
        measured=_once([*known.measured, *measured]),
        thresholds=[*dict.fromkeys([*known.thresholds, *used])],
        says=_once([*known.says, *said]),
        advises=_once([*known.advises, *advised]),
        example=known.example,
        cures=(*known.cures, *cures),
    )


def _cure(call: ast.Call) -> Cure:
    """Return a cure as its rule writes it."""
    given = next((each.value for each in call.keywords if each.arg == "given"), None)
    numbers = dict.fromkeys(
        [_text(each) or "" for each in given.keys if each] if isinstance(given, ast.Dict) else (),
        math.nan,
    )
    has_value = len(call.args) == FULL - 1 or any(each.arg == "value" for each in call.keywords)
    return Cure(
        _text(call.args[0]) or "",
        value=math.nan if has_value else None,
        form=_keyword(call, "form") or "",
        given=numbers,
    )


def _messages(node: ast.AST) -> list[str]:
    """Return the messages in a node, with … in place of what is filled in, once of two in a row."""
    texts = [
        _text(call.args[0])
        for call in ast.walk(node)
        if isinstance(call, ast.Call) and _name(call.func) == "Message" and call.args
    ]
    blanks = [
        {name: Blank("" if before else "…") for before, name in PLACEHOLDER.findall(text or "")}
        for text in texts
    ]
    return [Message(text, **those) for text, those in zip(texts, blanks, strict=True) if text]


def _once(texts: list[str]) -> list[str]:
    return [*dict.fromkeys(texts)]


def _first(docstring: str | None) -> str:
    return " ".join((docstring or "").split("\n\n")[0].split())


def _text(node: ast.expr) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _keyword(call: ast.Call, name: str) -> str | None:
    return next((_text(each.value) for each in call.keywords if each.arg == name), None)


def _name(node: ast.expr) -> str:
    return getattr(node, "id", None) or getattr(node, "attr", None) or ""
