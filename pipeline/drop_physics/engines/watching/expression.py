"""Parses an expectation, a Python expression, and computes the margin by which it holds.

The expression is parsed before the script runs, and evaluated in the script's interpreter. It can
use the script's variables, and time series with a value for each step.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

SERIES = ("x", "y", "z", "up", "joint", "rate", "force", "sensor")
"""Functions that return a time series."""
TAKEN = ("end", "peak", "low", "drift", "norm", "at", "always", "ever")
"""Functions with a time series as argument."""
TERMINATED = "terminated"
EPISODE = (TERMINATED, "reward", "length")
"""Names for a script's environments: whether an episode was terminated, the mean return, and the
least number of steps of an episode."""
PRINTED = "printed"
"""Name of the list of numbers that the script has printed."""
OURS = "_drop_{}".format
"""Alias under which an expectation's function is called if the script has a variable of the same
name."""
UNITS = {"x": "m", "y": "m", "z": "m", "force": "N"}
"""The unit of each series that has the same unit for all elements."""
WORD = {
    ast.Gt: 1.0, ast.GtE: 1.0, ast.Lt: -1.0, ast.LtE: -1.0,
}  # fmt: skip
"""Sign of the margin for each comparison operator."""

Judged = tuple[bool, float, float]
"""Result of an expression: whether it holds, its margin (negative if it does not hold), and the
value of the first compared quantity."""


class Expression:
    """An expectation as the user wrote it.

    Parameters
    ----------
    text
        A Python expression.

    Raises
    ------
    SyntaxError
        If the text is not a Python expression.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._tree = ast.parse(text.strip(), mode="eval")

    def reads(self) -> Iterator[tuple[str, tuple[Any, ...] | None]]:
        """Yield the time series that the expression uses: functions with their arguments."""
        for node in ast.walk(self._tree):
            if isinstance(node, ast.Call) and _called(node) in SERIES:
                given = [each.value for each in node.args if isinstance(each, ast.Constant)]
                whole = len(given) == len(node.args) and not node.keywords
                yield _called(node), tuple(given) if whole else None

    @property
    def unit(self) -> str | None:
        """Unit of the compared quantities, if all are series of the same unit; otherwise None."""
        called = {_called(node) for node in ast.walk(self._tree) if isinstance(node, ast.Call)}
        names = {node.id for node in ast.walk(self._tree) if isinstance(node, ast.Name)}
        sums = all(
            isinstance(node.op, (ast.Add, ast.Sub))
            for node in ast.walk(self._tree)
            if isinstance(node, ast.BinOp)
        )
        units = {UNITS.get(name) for name in called & {*SERIES}}
        plain = names <= {*SERIES, *TAKEN, "abs", "min", "max"}
        return units.pop() if len(units) == 1 and plain and sums else None

    @property
    def is_of_end(self) -> bool:
        """True if only the end of a run matters, neither earlier steps nor printed output."""
        called = {_called(node) for node in ast.walk(self._tree) if isinstance(node, ast.Call)}
        return not (called & {*TAKEN} - {"end"} or self.reads_prints)

    @property
    def reads_prints(self) -> bool:
        """True if the expression refers to the script's printed output."""
        return any(getattr(node, "id", None) == PRINTED for node in ast.walk(self._tree))

    @property
    def reads_episodes(self) -> bool:
        """True if the expression refers to episodes of environments."""
        return any(getattr(node, "id", None) in EPISODE for node in ast.walk(self._tree))

    @property
    def reads_whole_episodes(self) -> bool:
        """True if the expression refers to quantities that only an ended episode has."""
        ended = {*EPISODE} - {TERMINATED}
        return any(getattr(node, "id", None) in ended for node in ast.walk(self._tree))

    def judged(self, script: Mapping[str, Any], ours: Mapping[str, Any]) -> Judged:
        """Return whether the expression holds, its margin, and the compared quantity.

        Parameters
        ----------
        script
            The script's variables, by name.
        ours
            The functions named in this module, and further values; variables of the script take
            precedence.

        Raises
        ------
        Exception
            Any exception that the evaluation raises.
        """
        covered = {
            name for name in (*SERIES, *TAKEN) if not callable(script.get(name)) and name in ours
        }
        tree = _Renamed(covered).visit(ast.parse(self.text.strip(), mode="eval"))
        ast.fix_missing_locations(tree)
        names = {**ours, **script, **{OURS(name): ours[name] for name in covered}}
        return _judged(tree.body, names)


class _Renamed(ast.NodeTransformer):
    """Renames calls of an expectation's functions if the script has a variable of the same name."""

    def __init__(self, covered: set[str]) -> None:
        self._covered = covered

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self._covered:
            node.func = ast.copy_location(ast.Name(OURS(node.func.id), ast.Load()), node.func)
        return node


def _judged(node: ast.expr, names: dict[str, Any]) -> Judged:
    """Evaluate a part of the expression: `and` counts as its worst operand, `or` as its best."""
    if isinstance(node, ast.BoolOp):
        parts = [_judged(each, names) for each in node.values]
        best = isinstance(node.op, ast.Or)
        return (max if best else min)(parts, key=lambda part: (part[0], part[1]))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        holds, margin, value = _judged(node.operand, names)
        return not holds, -margin, value
    if isinstance(node, ast.Call) and _called(node) in ("always", "ever") and len(node.args) == 1:
        inner = node.args[0]
        if isinstance(inner, ast.Compare) and len(inner.ops) == 1 and type(inner.ops[0]) in WORD:
            holds = bool(_value(node, names))
            left, right = (_value(each, names) for each in (inner.left, inner.comparators[0]))
            over = _numbers(left - right)
            sign = WORD[type(inner.ops[0])]
            margins = [sign * each for each in over]
            worst = min(margins) if _called(node) == "always" else max(margins)
            at = margins.index(worst)
            return holds, worst, _numbers(left)[at] if len(_numbers(left)) > at else worst
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        pairs = zip(node.ops, sides, sides[1:])
        parts = [_compared(op, left, right, names) for op, left, right in pairs]
        return min(parts, key=lambda part: (part[0], part[1]))
    value = _value(node, names)
    margin = 0.0 if value else -1.0
    if value is True and getattr(node, "id", None) == TERMINATED:
        margin = 1 / max(names["length"], 1)  # a later end is nearer to none
    return bool(value), margin, _number(value)


def _compared(op: ast.cmpop, left: ast.expr, right: ast.expr, names: dict[str, Any]) -> Judged:
    """Evaluate a comparison; the reported quantity is the side that varies."""
    one, other = _value(left, names), _value(right, names)
    holds = bool(_COMPARES[type(op)](one, other))
    first, second = _number(one), _number(other)
    value = second if isinstance(left, ast.Constant) else first
    if not (math.isfinite(first) and math.isfinite(second)):
        return holds, 0.0 if holds else -math.inf, value
    far = first - second
    if type(op) in WORD:
        return holds, WORD[type(op)] * far, value
    if isinstance(op, (ast.Eq, ast.NotEq)):
        return holds, -abs(far) if isinstance(op, ast.Eq) else abs(far) - (not holds), value
    return holds, 0.0 if holds else -1.0, value


_COMPARES: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Gt: lambda one, other: one > other,
    ast.GtE: lambda one, other: one >= other,
    ast.Lt: lambda one, other: one < other,
    ast.LtE: lambda one, other: one <= other,
    ast.Eq: lambda one, other: one == other,
    ast.NotEq: lambda one, other: one != other,
    ast.Is: lambda one, other: one is other,
    ast.IsNot: lambda one, other: one is not other,
    ast.In: lambda one, other: one in other,
    ast.NotIn: lambda one, other: one not in other,
}


def _called(node: ast.Call) -> str:
    return str(getattr(node.func, "id", "")).removeprefix(OURS(""))


def _value(node: ast.expr, names: dict[str, Any]) -> Any:
    code = compile(ast.Expression(node), "<expect>", "eval")
    return eval(code, names)  # the user's own expression


def _number(value: Any) -> float:
    """Return a value as a number: the last element of a sequence; nan if it is not numeric."""
    try:
        return float(value)
    except (TypeError, ValueError):
        numbers = _numbers(value)
        return numbers[-1] if numbers else math.nan


def _numbers(value: Any) -> Sequence[float]:
    """Return all numbers in a value."""
    try:
        return [float(each) for each in _plain(value)]
    except (TypeError, ValueError):
        return [math.nan]


def _plain(value: Any) -> Any:
    plain = value.tolist() if hasattr(value, "tolist") else value
    return plain if isinstance(plain, (list, tuple)) else [plain]
