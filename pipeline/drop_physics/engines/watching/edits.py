"""Runs a script with parts of its text replaced, or pauses it after its imports.

The script's file does not change, so that tracebacks show the user's text. Files of modules and
models are replaced in the run's private layer of the file system (`private`).
"""

from __future__ import annotations

import importlib.machinery
import os
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import ast
    from types import CodeType

    from .private import Private

Edit = Sequence[Any]
"""The file of a part, empty for the script; begin and end, as byte offsets; and the replacement."""
OTHER_S = 2
"""Time by which an edited module's file is made newer, so that Python does not use the compiled
one, whose time is in whole seconds [s]."""
OF_PYTHON = ("os", "sys", "warnings", "logging", "matplotlib")
"""Standard modules that scripts often configure between their imports."""


def edited(text: bytes, edits: Iterable[Edit], file: str = "") -> bytes:
    """Return the text of a file, by default of the script, with parts replaced."""
    for of, start, end, other in sorted(map(tuple, edits), reverse=True):
        if of == file:
            text = text[:start] + other.encode() + text[end:]
    return text


def write(edits: Sequence[Edit], private: Private | None) -> None:
    """Write edited files into this process's private view of the file system.

    Raises
    ------
    OSError
        If a file would be replaced for other processes, too.
    """
    for name in {file for file, *_ in edits} - {""}:
        if private is None or not private.holds(name):
            raise OSError(f"{name} does not lie in a layer of this process")
        with open(name, "rb") as read:
            text, of_file = read.read(), os.stat(name)
        with open(name, "wb") as written:
            written.write(edited(text, edits, name))
        os.utime(name, (of_file.st_atime, of_file.st_mtime + OTHER_S))


class InTwoParts:
    """A script's code in two parts, its imports and the rest; the rest may be edited.

    Parameters
    ----------
    text, path
        The script's text and path.
    folder
        The script's folder; imports of modules from this folder belong to the second part.

    Raises
    ------
    SyntaxError
        If the script is not valid Python.
    """

    def __init__(self, text: bytes, path: str, folder: str) -> None:
        import ast

        self._text, self._path = text, path
        lines: list[ast.stmt] = ast.parse(text, path).body
        imports = [_is_import(ast, each, folder) for each in lines]
        self._length = [*imports, False].index(False)
        self.first: CodeType = self._compiled(lines[: self._length], 0)

    def second(self, edits: Iterable[Edit]) -> CodeType:
        """Return the code of the second part, with edits."""
        import __future__

        import ast

        lines = ast.parse(edited(self._text, edits), self._path).body[self._length :]
        of_future = [getattr(__future__, each) for each in __future__.all_feature_names]
        flags = self.first.co_flags & sum({each.compiler_flag for each in of_future})
        return self._compiled(lines, flags)

    def _compiled(self, lines: list[ast.stmt], flags: int) -> CodeType:
        import ast

        code: CodeType = compile(
            ast.Module(lines, []), self._path, "exec", flags=flags, dont_inherit=True
        )
        return code


def _is_import(ast: Any, line: Any, folder: str) -> bool:
    """Return whether a line imports a library, or prepares such an import."""
    if isinstance(line, ast.Import):
        return not any(_lies_in(each.name, folder) for each in line.names)
    if isinstance(line, ast.ImportFrom):
        return not line.level and not _lies_in(line.module or "", folder)
    if isinstance(line, ast.Expr):
        root = line.value.func if isinstance(line.value, ast.Call) else line.value
        return isinstance(root, ast.Constant) or _root_of(ast, root) in OF_PYTHON
    if isinstance(line, ast.Assign):
        return all(_root_of(ast, each) in OF_PYTHON for each in line.targets)
    return False


def _lies_in(module: str, folder: str) -> bool:
    name = module.partition(".")[0]
    return importlib.machinery.PathFinder.find_spec(name, [folder]) is not None


def _root_of(ast: Any, node: Any) -> str | None:
    """Return the variable at the root of an attribute or item expression; None if it has none."""
    if not isinstance(node, (ast.Attribute, ast.Subscript)):
        return None
    while isinstance(node, (ast.Attribute, ast.Subscript)):
        node = node.value
    return getattr(node, "id", None)
