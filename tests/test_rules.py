"""Verification: every name that a rule's functions, messages and suggested changes use exists.

Columns, notes and rows meet by name, which no type checker sees. A misspelt name would be found
only where a script makes the row speak.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from functools import cache
from string import Formatter
from types import ModuleType

import pytest
from drop_physics.messages import Message
from drop_physics.rules import every, rows, rule
from drop_physics.rules.answer import SCENE_TABLES, Scene
from drop_physics.rules.by_name import parameters
from drop_physics.rules.rows import Case, Remedy, Worst
from drop_physics.rules.rule import Rule, RunsOfBodies

ROOMS = "drop_physics.rules", "drop_physics.account"
MECHANISM = {"runs", "noted", "worst", "call", "why", *SCENE_TABLES}
"""Names that are no numbers of a case."""


@cache
def given(module: ModuleType) -> set[object]:
    """Return the names under which a module of rules provides numbers."""
    found: set[object] = set()
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        match node:
            case ast.Dict(keys=names) | ast.Tuple(elts=names):
                found |= {each.value for each in names if isinstance(each, ast.Constant)}
            case ast.Subscript(slice=ast.Constant(value=name)):
                found.add(name)
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.keyword(arg=str(name)):
                found.add(name)
    return found


def declared(one: Rule) -> set[object]:
    """Return the names that a rule may use: its own, its table's, and common ones."""
    module = sys.modules[one.matches.__module__]
    modules = {module, rule, rows}
    for each in vars(module).values():
        if getattr(each, "__module__", "").startswith(ROOMS):
            modules.add(sys.modules[each.__module__])
    if one.table == "account":  # whose rows note numbers for their findings
        modules |= {each for name, each in sys.modules.items() if name.startswith(ROOMS[1])}
    names = set[object]().union(*map(given, modules))
    members = {name for kind in (Case, Worst, RunsOfBodies) for name in dir(kind)}
    return names | members | {f"until_{name}" for name in names} | MECHANISM


def asked(one: Rule) -> Iterator[str]:
    """Yield the names that a rule's functions, messages and suggested changes use."""
    functions = [one.sizes, one.noting, *(row.when for row in one.told if row.when)]
    yield from (name for function in functions for name in parameters(function))
    for row in one.told:
        for text in (row.says, row.why, row.advice, row.unit):
            template = text.template if isinstance(text, Message) else text or ""
            yield from (name for _, name, _, _ in Formatter().parse(template) if name)
        told = row.effect, row.share, row.normal, row.least, row.site, *_of(row.cure)
        yield from (name for name in told if isinstance(name, str))


def _of(cure: Remedy | None) -> list[object]:
    if cure is None:
        return []
    numbers = [cure.given] if isinstance(cure.given, str) else [*cure.given.values()]
    return [cure.target, cure.value, *numbers, *cure.bodies]


@pytest.mark.parametrize("one", every.RULES, ids=lambda one: one.matches.__name__)
def test_each_name_of_a_rule_is_declared(one: Rule) -> None:
    assert {*asked(one)} <= declared(one)


@pytest.mark.parametrize("one", every.RULES, ids=lambda one: one.matches.__name__)
def test_each_table_of_a_rule_is_declared_as_in_the_scene(one: Rule) -> None:
    """A name that a rule notes itself is a number of its own."""
    own = 0 if one.table == "inputs" else 1
    told = [(one.matches, parameters(one.matches)[own:]), (one.noting, parameters(one.noting))]
    types, noted = Scene.__annotations__, given(sys.modules[one.matches.__module__])
    for function, names in told:
        for name in {*names} & SCENE_TABLES:
            declared_as = function.__annotations__[name]
            assert declared_as == types[name] or (function is one.noting and name in noted)
    if own:
        assert {*parameters(one.matches)[own:]} <= SCENE_TABLES


LAWS_DIFFER = {
    *("creeps", "slides", "deep-penetration", "starts-in-contact"),  # contacts: rigid, or springs
    *("off-target", "unstable"),  # motors by shares of a gap, actuators by forces
}
"""The codes whose law is another one in each engine, so that a file for each tells them."""


def test_a_code_is_told_in_one_file() -> None:
    files: dict[str, set[str]] = {}
    for each in every.RULES:
        files.setdefault(each.code, set()).add(each.matches.__module__)
    assert {code for code, its in files.items() if len(its) > 1} == LAWS_DIFFER
