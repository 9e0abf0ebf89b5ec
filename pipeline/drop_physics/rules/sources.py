"""Reads docstrings, thresholds and advice from the source of the rules, for `drop explain`.

Sentence, thresholds, texts and advice of a rule are written in its source; this module only
collects them. A code that several rules share has the texts of all these rules.
"""

from __future__ import annotations

import ast
import itertools
import math
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from drop_physics.messages import Message
from drop_physics.rules import thresholds
from drop_physics.rules.codes import LEVELS, Level
from drop_physics.rules.engines import MUJOCO, MUJOCOS
from drop_physics.rules.every import RULES
from drop_physics.rules.rows import SayingRow
from drop_physics.rules.rule import Rule
from drop_physics.trace.cures import Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

ROOMS = "rules", "drop"
"""Packages whose modules define rules."""
ADVISES = {"advice", "cure"}
"""Arguments that contain advice."""
VALUE = 2
"""Position of a cure's value among its arguments."""


@dataclass(frozen=True)
class Limit:
    """A threshold of a rule."""

    name: str
    """Name of the constant in the source."""
    value: float
    """Value in its unit."""
    unit: str
    """`share` for a ratio of the quantity in the meaning, `1` for a count."""
    meaning: str
    """The quantity to which the threshold applies."""


@dataclass
class RuleTexts:
    """The texts of all rules for one code or reason."""

    reason_of: str | None = None
    level: Level | None = None
    measured: list[str] = field(default_factory=list)
    thresholds: list[Limit] = field(default_factory=list)
    says: list[str] = field(default_factory=list)
    advises: list[str] = field(default_factory=list)
    proposes: list[str] = field(default_factory=list)
    cures: list[tuple[str, Cure, bool]] = field(default_factory=list)
    """The cures, each as the engine in whose syntax the call is written, the cure (nan for values
    that depend on the run), and whether the cure is only a proposal."""


def texts_of(names: Collection[str]) -> dict[str, RuleTexts]:
    """Return the texts of the rules, by code or reason."""
    made = {name: RuleTexts() for name in names}
    for room in ROOMS:
        for file in sorted(resources.files(f"drop_physics.{room}").iterdir(), key=str):
            source = file.read_text(encoding="utf-8") if file.name.endswith(".py") else ""
            if not any(f'"{name}"' in source for name in made):
                continue
            module = ast.parse(source)
            limits = _limits_in(module)
            for parts, code, reason, level in _rules_in(module):
                for name in {code, reason or code} & made.keys():
                    _add(made[name], parts, limits, level)
                    made[name].reason_of = None if name == code else code
    for rule in RULES:
        for row in rule.told:
            code, reason = row.code or rule.code, row.reason or rule.reason
            for name in {code, reason or code} & made.keys():
                _add_row(made[name], rule, row)
                made[name].reason_of = None if name == code else code
    return made


@cache
def _thresholds() -> dict[str, Limit]:
    """Return the thresholds by name, with the docstrings that describe them."""
    source = resources.files(__package__).joinpath("thresholds.py").read_text(encoding="utf-8")
    found: dict[str, Limit] = {}
    for node, below in itertools.pairwise(ast.parse(source).body):
        if isinstance(node, ast.Assign) and isinstance(below, ast.Expr):
            name, text = ast.unparse(node.targets[0]), " ".join((_text(below.value) or "").split())
            meaning, _, rest = text.partition(" Unit: ")
            unit, _, _ = rest.partition(". Needed by: ")
            found[name] = Limit(name, float(getattr(thresholds, name)), unit, Message(meaning))
    return found


def _rules_in(
    module: ast.Module,
) -> Iterator[tuple[list[ast.FunctionDef], str, str | None, str | None]]:
    """Yield the rules in a module, with code, reason and level.

    If a module has only one rule, all texts of the module belong to that rule.
    """
    functions = [node for node in ast.walk(module) if isinstance(node, ast.FunctionDef)]
    beside = defaultdict[str, list[ast.FunctionDef]](list)
    rules: list[tuple[ast.FunctionDef, ast.Call]] = []
    for node in functions:
        for decorator in node.decorator_list:
            if isinstance(decorator, ast.Attribute) and isinstance(decorator.value, ast.Name):
                beside[decorator.value.id].append(node)
            elif isinstance(decorator, ast.Call) and _name(decorator.func).endswith("_rule"):
                rules.append((node, decorator))
    alone = functions if len(rules) == 1 else []
    for node, decorator in rules:
        given = [_text(each) for each in decorator.args]
        reason = given[2] if len(given) > 2 else _keyword(decorator, "reason")
        yield [node, *(alone or beside[node.name])], given[0] or "", reason, given[1]


def _limits_in(module: ast.Module) -> set[str]:
    """Return the names of the thresholds that a module imports."""
    return {
        name.name
        for node in module.body
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith(".thresholds")
        for name in node.names
    }


def _add(known: RuleTexts, parts: list[ast.FunctionDef], limits: set[str], level: Any) -> None:  # noqa: ANN401
    """Add the texts of another rule with the same code or reason."""
    inside = [inner for part in parts for inner in ast.walk(part)]
    measured = [_first(ast.get_docstring(part)) for part in parts[:1]]
    names = {node.id for node in inside if isinstance(node, ast.Name)}
    keywords = {node.arg for node in inside if isinstance(node, ast.keyword)}
    proposed = bool(keywords & {"proposes", "proposed"})
    engine = MUJOCO if "MUJOCOS" in names else PYBULLET
    advised: list[str] = []
    cures: list[tuple[str, Cure, bool]] = []
    for node in inside:
        match node:
            case ast.keyword(arg=name, value=value) if name in ADVISES:
                advised += _messages(value)
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in ADVISES:
                advised += _messages(value)
            case ast.Call() if _name(node.func) == "Cure":
                cures.append((engine, _cure(node), proposed))
    said = [text for part in parts for text in _messages(part) if text not in advised]
    of_code = [threshold for name, threshold in _thresholds().items() if name in names & limits]
    told: list[tuple[list[Any], list[Any]]] = [
        (known.measured, [each for each in measured if not each.startswith(("Return", "Yield"))]),
        (known.thresholds, of_code),
        (known.says, said),
        (known.proposes if proposed else known.advises, advised),
        (known.cures, cures),
    ]
    for held, more in told:
        held += [fromkey for fromkey in dict.fromkeys(more) if fromkey and fromkey not in held]
    rated = [each for each in (known.level, level) if each in LEVELS]
    known.level = min(rated, key=LEVELS.index, default=None)


def _add_row(known: RuleTexts, rule: Rule, row: SayingRow) -> None:
    """Add the texts of one row of a rule."""
    proposed = rule.proposes if row.proposed is None else row.proposed
    engine = MUJOCO if (row.engines or rule.engines) == MUJOCOS else PYBULLET
    decides = () if row.when is None else row.when.__code__.co_names
    told: list[tuple[list[Any], list[Any]]] = [
        (
            known.thresholds,
            [threshold for name, threshold in _thresholds().items() if name in decides],
        ),
        (known.says, [row.says, row.why]),
        (known.proposes if proposed else known.advises, [row.advice]),
        (known.cures, [(engine, row.cure.blank, proposed)] if row.cure else []),
    ]
    for held, more in told:
        held += [each for each in more if each and each not in held]
    rated = [each for each in (known.level, row.level or rule.level) if each in LEVELS]
    known.level = min(rated, key=LEVELS.index, default=None)


def _cure(call: ast.Call) -> Cure:
    """Return a rule's suggested change, with nan for numbers that depend on the run."""
    given = next((keyword.value for keyword in call.keywords if keyword.arg == "given"), None)
    keys = given.keys if isinstance(given, ast.Dict) else []
    has_value = len(call.args) > VALUE or any(keyword.arg == "value" for keyword in call.keywords)
    return Cure(
        _text(call.args[0]) or "",
        value=math.nan if has_value else None,
        form=_keyword(call, "form") or "",
        given={_text(each) or "": math.nan for each in keys if each},
    )


def _messages(node: ast.AST) -> list[str]:
    """Return the texts of the messages in a syntax-tree node."""
    texts = [
        _text(call.args[0])
        for call in ast.walk(node)
        if isinstance(call, ast.Call) and _name(call.func) == "Message" and call.args
    ]
    return [*filter(None, texts)]


def _first(docstring: str | None) -> str:
    return " ".join((docstring or "").split("\n\n")[0].split())


def _text(node: ast.expr) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _keyword(call: ast.Call, name: str) -> str | None:
    return next((_text(keyword.value) for keyword in call.keywords if keyword.arg == name), None)


def _name(node: ast.expr) -> str:
    return getattr(node, "id", None) or getattr(node, "attr", None) or ""
