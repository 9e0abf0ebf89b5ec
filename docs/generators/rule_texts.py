"""What the sources of the rules say of each code, for `drop explain`: `rules/reference.json`.

A rule's sentence, its thresholds, what it says and what it advises stand in its source; here they
are only gathered. A code that several rules share has those of all.
"""

from __future__ import annotations

import ast
import itertools
from collections import defaultdict
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

from drop_physics.rules import thresholds
from drop_physics.rules.answer import LEVELS
from drop_physics.rules.codes import CODES
from drop_physics.rules.engines import MUJOCO
from drop_physics.rules.reference import blanked
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

ROOMS = "rules", "drop"
"""Folders whose modules find something."""
ADVISES = {"advice", "cure"}
"""Arguments that hold what is advised."""
VALUE = 2
"""Place of a cure's value among its arguments."""
LEAST = 25
"""Characters of a message that is a sentence, and no part of one."""
Texts = dict[str, Any]
"""What is told of a code: `reason_of`, `level`, and lists of all else."""


def _thresholds() -> dict[str, Texts]:
    """Return the thresholds by their names, from the sentences below each."""
    body = ast.parse(Path(thresholds.__file__).read_text(encoding="utf-8")).body
    found: dict[str, Texts] = {}
    for node, below in itertools.pairwise(body):
        if isinstance(node, ast.Assign) and isinstance(below, ast.Expr):
            name, text = ast.unparse(node.targets[0]), " ".join((_text(below.value) or "").split())
            meaning, _, rest = text.partition(" Unit: ")
            unit, _, _ = rest.partition(". Needed by: ")
            value = float(getattr(thresholds, name))
            found[name] = {"name": name, "value": value, "unit": unit, "meaning": meaning}
    return found


def gathered() -> dict[str, Texts]:
    """Return what is told of each code and reason, by their names."""
    made: dict[str, Texts] = {
        name: {"reason_of": None, "level": None}
        | {key: [] for key in ("measured", "thresholds", "says", "advises", "proposes", "cures")}
        for name in CODES
    }
    for room in ROOMS:
        for file in sorted(resources.files(f"drop_physics.{room}").iterdir(), key=str):
            if file.name.endswith(".py"):
                module = ast.parse(file.read_text(encoding="utf-8"))
                limits = _limits_in(module)
                for parts, code, reason, level in _rules_in(module):
                    for name in {code, reason or code}:
                        _add(made[name], parts, limits, level)
                        made[name]["reason_of"] = None if name == code else code
    return made


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
                    if its or _messages(value):  # else it is a number of that name
                        yield [*its], given[0] or "", name, given[1]


def _limits_in(module: ast.Module) -> set[str]:
    """Return the names of thresholds that a module takes from their table."""
    return {
        name.name
        for node in module.body
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith(".thresholds")
        for name in node.names
    }


def _add(known: Texts, parts: list[ast.stmt], limits: set[str], level: str | None) -> None:
    """Add to what is known of a name what one more rule of it tells."""
    documented = [each for each in parts if isinstance(each, ast.FunctionDef)]
    first = [_first(ast.get_docstring(each)) for each in documented[:1]]
    advised: list[str] = []
    names = {node.id for each in parts for node in ast.walk(each) if isinstance(node, ast.Name)}
    engine = MUJOCO if "MUJOCOS" in names else PYBULLET
    cures: list[Texts] = []
    proposed = _proposes(parts)
    for node in [inner for each in parts for inner in ast.walk(each)]:
        match node:
            case ast.keyword(arg=name, value=value) if name in ADVISES:
                advised += _messages(value)
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in ADVISES:
                advised += _messages(value)
        if isinstance(node, ast.Call) and _name(node.func) == "Cure":
            cures.append({"engine": engine, "proposed": proposed, **_cure(node)})
    said = [text for each in parts for text in _messages(each) if text not in advised]
    told: dict[str, list[Any]] = {
        "measured": [each for each in first if not each.startswith(("Return", "Yield"))],
        "thresholds": [each for name, each in THRESHOLDS.items() if name in names & limits],
        "says": [text for text in said if len(blanked(text)) > LEAST],
        "proposes" if proposed else "advises": advised,
        "cures": cures,
    }
    for key, each in told.items():
        known[key] += [one for one in each if one and one not in known[key]]
    rated = [each for each in (known["level"], level) if each in LEVELS]
    known["level"] = min(rated, key=LEVELS.index, default=None)


def _proposes(parts: list[ast.stmt]) -> bool:
    """Return whether what a rule advises is only to be tried."""
    keywords = [node for each in parts for node in ast.walk(each) if isinstance(node, ast.keyword)]
    return any(each.arg in ("proposes", "proposed") for each in keywords)


def _cure(call: ast.Call) -> Texts:
    """Return a cure as its rule writes it."""
    given = next((each.value for each in call.keywords if each.arg == "given"), None)
    names = (
        [_text(each) or "" for each in given.keys if each] if isinstance(given, ast.Dict) else []
    )
    has_value = len(call.args) > VALUE or any(each.arg == "value" for each in call.keywords)
    return {
        "name": _text(call.args[0]) or "",
        "has_value": has_value,
        "form": _keyword(call, "form") or "",
        "given": names,
    }


def _messages(node: ast.AST) -> list[str]:
    """Return the templates of the messages in a node."""
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
    return next((_text(each.value) for each in call.keywords if each.arg == name), None)


def _name(node: ast.expr) -> str:
    return getattr(node, "id", None) or getattr(node, "attr", None) or ""


THRESHOLDS = _thresholds()
"""All thresholds of the rules."""
