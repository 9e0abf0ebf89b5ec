"""Collects docstrings, thresholds and advice of rules, for `drop explain`.

A code that several rules share has the texts of all these rules. Sentences and cures that a rule
computes are read from the source of its functions.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from types import FunctionType

from drop_physics.messages import Message
from drop_physics.rules import thresholds
from drop_physics.rules.codes import LEVELS, Level
from drop_physics.rules.engines import MUJOCO, MUJOCOS
from drop_physics.rules.rows import SayingRow
from drop_physics.rules.rule import Rule
from drop_physics.trace.cures import Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

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

    def add(self, more: RuleTexts) -> None:
        """Add the texts of another rule, or of a row, with the same code or reason."""
        for name in ("measured", "thresholds", "says", "advises", "proposes", "cures"):
            held = getattr(self, name)
            held += [each for each in dict.fromkeys(getattr(more, name)) if each not in held]
        rated = [each for each in (self.level, more.level) if each is not None]
        self.level = min(rated, key=LEVELS.index, default=None)


def texts_of(names: Collection[str], rules: Sequence[Rule]) -> dict[str, RuleTexts]:
    """Return the texts of rules, by code or reason."""
    made = {name: RuleTexts() for name in names}
    for rule in rules:
        told = [
            (row.code or rule.code, row.reason or rule.reason, _row_texts(rule, row))
            for row in rule.told
        ]
        own = (rule.code, rule.reason)
        kinds = dict.fromkeys([own, *((code, reason) for code, reason, _ in told)])
        mine = [each for each in kinds if made.keys() & each]
        whole = _rule_texts(rule) if mine else RuleTexts()
        for code, reason, texts in [*((*each, whole) for each in mine), *told]:
            for name in made.keys() & {code, reason or code}:
                made[name].add(texts)
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


def _rule_texts(rule: Rule) -> RuleTexts:
    """Return the texts in a rule's functions, and in what they use of its modules."""
    module = rule.matches.__globals__
    found: dict[Callable[..., object], ast.Module] = {}
    calls: list[Callable[..., object]] = [rule.matches, rule.sizes, rule.noting]
    rooms = {each.__module__ for each in calls} - {Rule.__module__}
    for each in calls:
        is_code = isinstance(each, FunctionType | type)
        if is_code and each.__module__ in rooms and each not in found:
            found[each] = ast.parse(inspect.getsource(each))
            calls += filter(callable, map(module.get, sorted(_names(found[each]))))
    inside = [node for tree in found.values() for node in ast.walk(tree)]
    keywords = {node.arg for node in inside if isinstance(node, ast.keyword)}
    proposed = rule.proposes or "proposed" in keywords
    texts = RuleTexts(
        level=None if rule.told else rule.level,
        measured=[" ".join(rule.meaning.partition("\n\n")[0].split())],
        thresholds=[
            limit
            for each, tree in found.items()
            for limit in _limits(_names(tree), vars(sys.modules[each.__module__]))
        ],
    )
    advised: list[str] = []
    for node in inside:
        match node:
            case ast.keyword(arg=name, value=value) if name in ADVISES:
                advised += _messages(value)
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in ADVISES:
                advised += _messages(value)
            case ast.Call(func=ast.Name(id="Cure")):
                texts.cures.append((_engine(rule.engines), _cure(node), proposed))
    said = (text for tree in found.values() for text in _messages(tree))
    texts.says = [text for text in said if text not in advised]
    (texts.proposes if proposed else texts.advises).extend(advised)
    return texts


def _names(tree: ast.AST) -> set[str]:
    """Return the names that a function uses."""
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _limits(names: Collection[str], module: Mapping[str, object]) -> list[Limit]:
    """Return the thresholds among the names that a function of a module uses."""
    limits = (limit for name, limit in _thresholds().items() if name in names)
    return [limit for limit in limits if module.get(limit.name) == limit.value]


def _row_texts(rule: Rule, row: SayingRow) -> RuleTexts:
    """Return the texts of one row of a rule."""
    proposed = rule.proposes if row.proposed is None else row.proposed
    texts = RuleTexts(
        level=row.level or rule.level,
        thresholds=[]
        if row.when is None
        else _limits(row.when.__code__.co_names, row.when.__globals__),
        says=[each for each in (row.says, row.why) if each],
    )
    (texts.proposes if proposed else texts.advises).extend([row.advice] if row.advice else [])
    if row.cure:
        texts.cures.append((_engine(row.engines or rule.engines), row.cure.blank, proposed))
    return texts


def _engine(engines: tuple[str, ...]) -> str:
    """Return the engine in whose syntax the calls of a rule are written."""
    return MUJOCO if engines == MUJOCOS else PYBULLET


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
    return [
        text
        for call in ast.walk(node)
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "Message" and call.args
        if (text := _text(call.args[0]))
    ]


def _text(node: ast.expr) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _keyword(call: ast.Call, name: str) -> str | None:
    return next((_text(keyword.value) for keyword in call.keywords if keyword.arg == name), None)
