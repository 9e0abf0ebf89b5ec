"""The size of each room of the package, in what formatting cannot squeeze.

    python tests/sizes.py            prints statements and tokens of each room, and its limits
    python tests/sizes.py --lower    lowers the budgets in `tests/budgets.toml` to what was reached;
                                     with names, --lower trace rules, only those of these rooms

A statement is any statement of Python but a docstring or an import. Tokens are those of the code,
without comments, docstrings and line ends. A room's limit is its budget and what `CHANGELOG.md`
declares in lines like

    - Size: trace +900 statements +7,000 tokens, explain -800 statements -6,500 tokens: timelines;
      instead, `seen/` and `states.py` went.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import textwrap
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pipeline/drop_physics"
BUDGETS = Path(__file__).with_name("budgets.toml")
CHANGES = ROOT / "CHANGELOG.md"
NO_CODE = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENDMARKER, tokenize.ENCODING),
}
"""Tokens that are layout."""
BULLET = re.compile(r"^- Size: (.*?)(?=^\S|\Z)", re.MULTILINE | re.DOTALL)
CHANGE = re.compile(r"\b(\w+)\s+([+-][\d,]+)\s+statements\s+([+-][\d,]+)\s+tokens")


@dataclass(frozen=True)
class Size:
    """Statements and tokens of code."""

    statements: int = 0
    tokens: int = 0

    def __add__(self, other: Size) -> Size:
        """Return both together."""
        return Size(self.statements + other.statements, self.tokens + other.tokens)

    def __sub__(self, other: Size) -> Size:
        """Return the difference, which may be negative."""
        return Size(self.statements - other.statements, self.tokens - other.tokens)

    def within(self, limit: Size) -> bool:
        """Return whether neither measure is above its limit."""
        return self.statements <= limit.statements and self.tokens <= limit.tokens


@cache
def nodes_of(code: str) -> list[ast.AST]:
    """Return all nodes of a module."""
    return [*ast.walk(ast.parse(code))]


def size_of(code: str) -> Size:
    """Return the size of a module's code."""
    statements, docstrings = 0, set()
    for node in nodes_of(code):
        match node:
            case ast.Expr(value=ast.Constant(value=str()) as text):
                docstrings.add((text.lineno, text.col_offset))
            case ast.stmt() if not isinstance(node, ast.Import | ast.ImportFrom):
                statements += 1
    tokens = sum(
        token.type not in NO_CODE and token.start not in docstrings
        for token in tokenize.generate_tokens(io.StringIO(code).readline)
    )
    return Size(statements, tokens)


def paths_of(holds: list[str], package: Path = PACKAGE) -> Iterator[Path]:
    """Yield the modules that a room's list of folders and files means."""
    for pattern in holds:
        for path in package.glob(pattern):
            yield from path.rglob("*.py") if path.is_dir() else [path]


def rooms_of(budgets: dict[str, dict], package: Path = PACKAGE) -> dict[Path, str]:
    """Return the room of each module: the first that lists it."""
    found: dict[Path, str] = {}
    for room, entry in budgets.items():
        for path in paths_of(entry["holds"], package):
            found.setdefault(path, room)
    return found


def sizes_of(budgets: dict[str, dict], package: Path = PACKAGE) -> dict[str, Size]:
    """Return the size of each room."""
    sizes = dict.fromkeys(budgets, Size())
    for path, room in rooms_of(budgets, package).items():
        sizes[room] += size_of(path.read_text(encoding="utf-8"))
    return sizes


def declared(changes: str) -> dict[str, Size]:
    """Return by how much the lines on size in a change log raise each room's budget.

    Raises `ValueError` for a line that names no room with both measures, or nothing that went.
    """
    raised: dict[str, Size] = {}
    for line in BULLET.findall(changes):
        rooms = CHANGE.findall(line)
        if not rooms or "instead" not in line:
            raise ValueError(f"names no room, or not what went instead: {line}")
        for room, *by in rooms:
            statements, tokens = (int(number.replace(",", "")) for number in by)
            raised[room] = raised.get(room, Size()) + Size(statements, tokens)
    return raised


def limits_of(budgets: dict[str, dict], changes: str) -> dict[str, Size]:
    """Return each room's limit: its budget and what was declared.

    Raises `ValueError` for a declared room that has no budget.
    """
    raised = declared(changes)
    if unknown := raised.keys() - budgets.keys():
        raise ValueError(f"tests/budgets.toml has no room {', '.join(sorted(unknown))}")
    return {
        room: Size(entry["statements"], entry["tokens"]) + raised.get(room, Size())
        for room, entry in budgets.items()
    }


def lowered(text: str, changes: str, sizes: dict[str, Size]) -> str:
    """Return the text of a budget file with limits lowered to the sizes that were reached."""
    limits = limits_of(tomllib.loads(text)["rooms"], changes)
    for room, size in sizes.items():
        limit = limits[room]
        reached = Size(min(limit.statements, size.statements), min(limit.tokens, size.tokens))
        budget = reached - declared(changes).get(room, Size())
        text = re.sub(
            rf"(\[rooms\.{room}\].*?\nstatements = )-?\d+(\ntokens = )-?\d+",
            rf"\g<1>{budget.statements}\g<2>{budget.tokens}",
            text,
            count=1,
            flags=re.DOTALL,
        )
    return text


def shortened(text: str, counts: dict[str, int], names: set[str]) -> str:
    """Return the text of a budget file with lower counts, and without names that are no more."""
    held = tomllib.loads(text)
    lines = textwrap.wrap(
        " ".join(f'"{name}",' for name in held["names_twice"] if name in names), 92
    )
    listed = "".join(f"    {line}\n" for line in lines)
    text = re.sub(r"(names_twice = \[\n).*?(?=\])", rf"\g<1>{listed}", text, flags=re.DOTALL)
    for name, count in counts.items():
        text = re.sub(rf"({name} = )\d+", rf"\g<1>{min(held[name], count)}", text)
    return text


def exceptions_in(root: Path = ROOT) -> int:
    """Return how many statements the formatter is told to leave alone, in all our code."""
    mark = "# fmt" + ": skip"
    folders = ("pipeline", "tests", "docs", "benchmarks")
    paths = [path for folder in folders for path in (root / folder).rglob("*.py")]
    return sum(path.read_text(encoding="utf-8").count(mark) for path in paths)


def classes_twice(package: Path = PACKAGE) -> set[str]:
    """Return the names of classes that more than one module defines."""
    names = Counter(
        node.name
        for path in package.rglob("*.py")
        for node in nodes_of(path.read_text(encoding="utf-8"))
        if isinstance(node, ast.ClassDef)
    )
    return {name for name, times in names.items() if times > 1}


FRAGMENT = re.compile(
    r"(Of|In|By|To|From|On|At|With|Along|That|Which|As|For|Below|Above|Beside|Besides|Between"
    r"|Without|Or|If|But|Until|Beyond|Likewise|Shorter|Longer|Slower|Less|More|Not)\b"
)
"""The beginning of a docstring that only the name before it completes."""


def fragments_in(code: str) -> list[str]:
    """Return the docstrings of a module that begin like a part of a sentence.

    So does a function's that says "Whether …" where it should say "Return whether …".
    """
    found = []
    for node in nodes_of(code):
        body = getattr(node, "body", None)
        for number, statement in enumerate(body if isinstance(body, list) else []):
            match statement:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    function = isinstance(node, ast.FunctionDef) and number == 0
                    says = function and not any(map(_is_property, node.decorator_list))
                    if FRAGMENT.match(text) or (says and text.startswith("Whether ")):
                        found.append(text)
    return found


def _is_property(decorator: ast.expr) -> bool:
    return "property" in ast.unparse(decorator)


def fragments(package: Path = PACKAGE) -> int:
    """Return how many docstrings of the package begin like a part of a sentence."""
    codes = (path.read_text(encoding="utf-8") for path in package.rglob("*.py"))
    return sum(len(fragments_in(code)) for code in codes)


def counts() -> dict[str, int]:
    """Return what the budget file counts besides sizes."""
    return {"formatter_exceptions": exceptions_in(), "docstring_fragments": fragments()}


def main() -> None:
    """Print the rooms with their limits, and lower these if asked to."""
    text, changes = BUDGETS.read_text(encoding="utf-8"), CHANGES.read_text(encoding="utf-8")
    budgets = tomllib.loads(text)["rooms"]
    sizes = sizes_of(budgets)
    if sys.argv[1:2] == ["--lower"]:
        rooms = sys.argv[2:] or list(sizes)
        text = lowered(text, changes, {room: sizes[room] for room in rooms})
        text = shortened(text, counts(), classes_twice())
        BUDGETS.write_text(text, encoding="utf-8")
    limits = limits_of(tomllib.loads(text)["rooms"], changes)
    sizes["together"] = sum(sizes.values(), Size())
    limits["together"] = sum(limits.values(), Size())
    print(f"{'room':14}{'statements':>12}{'limit':>10}{'tokens':>12}{'limit':>10}")
    for room, size in sizes.items():
        limit = limits[room]
        over = "" if size.within(limit) else "  over"
        print(
            f"{room:14}{size.statements:12,}{limit.statements:10,}"
            f"{size.tokens:12,}{limit.tokens:10,}{over}"
        )


if __name__ == "__main__":
    main()
