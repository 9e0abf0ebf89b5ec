"""Prints the code size of each folder of the package, compared with the last version.

A statement is any statement of Python but a docstring or an import. Tokens are those of the code,
without comments, docstrings and line ends: formatting cannot squeeze either. The last version is
read from git, at the commit before `pyproject.toml` got its present version number; without that
history only today's sizes are printed.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import tarfile
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = "pipeline/drop_physics"
NO_CODE = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENDMARKER, tokenize.ENCODING),
}
"""Token types that are layout."""


@dataclass(frozen=True)
class Size:
    """Number of statements and tokens of code."""

    statements: int = 0
    tokens: int = 0

    def __add__(self, other: Size) -> Size:
        """Return the sum of both sizes."""
        return Size(self.statements + other.statements, self.tokens + other.tokens)


def size_of(code: str) -> Size:
    """Return the size of a module's code."""
    statements, docstrings = 0, set()
    for node in ast.walk(ast.parse(code)):
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


def room_of(module: Path) -> str:
    """Return a module's room: its folder in the package; for engines, the engine's folder."""
    depth = 2 if module.parts[0] == "engines" else 1
    return "/".join(module.parent.parts[:depth]) or "(root)"


def sizes_of(modules: dict[Path, str]) -> dict[str, Size]:
    """Return each room's size, given the modules' code by path in the package."""
    sizes: dict[str, Size] = {}
    for path, code in modules.items():
        sizes[room_of(path)] = sizes.get(room_of(path), Size()) + size_of(code)
    return dict(sorted(sizes.items()))


def modules_now() -> dict[Path, str]:
    """Return the modules' current code by path in the package."""
    package = ROOT / SOURCES
    return {
        path.relative_to(package): path.read_text(encoding="utf-8")
        for path in package.rglob("*.py")
    }


def modules_before() -> dict[Path, str]:
    """Return the modules' code in the last version, by path; empty if git does not have it."""
    changed = ["log", "-1", "--format=%H", "-G", "^version = ", "--", "pyproject.toml"]
    commit = _git(*changed).decode().strip()
    held = _git("archive", "--format=tar", f"{commit}^", SOURCES) if commit else b""
    if not held:
        return {}
    with tarfile.open(fileobj=io.BytesIO(held)) as archive:
        return {
            Path(each.name).relative_to(SOURCES): file.read().decode()
            for each in archive
            if each.name.endswith(".py") and (file := archive.extractfile(each))
        }


def _git(*arguments: str) -> bytes:
    """Return the output of a git command; empty if it fails, or if git is not installed."""
    try:
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return b""


def table(now: dict[str, Size], before: dict[str, Size]) -> Iterator[str]:
    """Yield the lines of a table: each room's size now and before, and the difference in tokens."""
    now, before = (
        {**sizes, "together": sum(sizes.values(), Size())} if sizes else {}
        for sizes in (now, before)
    )
    then = f"{'then':>10}{'tokens':>10}{'then':>10}{'more':>10}" if before else f"{'tokens':>10}"
    yield f"{'room':20}{'statements':>12}{then}"
    for room in [*(before.keys() - now.keys()), *now]:
        size, old = now.get(room, Size()), before.get(room, Size())
        yield (
            f"{room:20}{size.statements:12,}{old.statements:10,}"
            f"{size.tokens:10,}{old.tokens:10,}{size.tokens - old.tokens:+10,}"
            if before
            else f"{room:20}{size.statements:12,}{size.tokens:10,}"
        )


def classes_twice() -> set[str]:
    """Return the class names that more than one module defines."""
    names = Counter(
        node.name
        for code in modules_now().values()
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.ClassDef)
    )
    return {name for name, times in names.items() if times > 1}


FRAGMENT = re.compile(
    r"(Of|In|By|To|From|On|At|With|Along|That|Which|As|For|Below|Above|Beside|Besides|Between"
    r"|Without|Or|If|But|Until|Beyond|Likewise|Shorter|Longer|Slower|Less|More|Not)\b"
)
"""Matches the beginning of a docstring that is a fragment, understandable only with its name."""


def fragments_in(code: str) -> list[str]:
    """Return a module's docstrings that are sentence fragments.

    So does a function's that says "Whether …" where it should say "Return whether …".
    """
    found = []
    for node in ast.walk(ast.parse(code)):
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


if __name__ == "__main__":
    print(*table(sizes_of(modules_now()), sizes_of(modules_before())), sep="\n")
