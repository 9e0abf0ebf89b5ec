"""Reads a script's failed `assert` from its exception, to use it as an expectation.

This includes tests run by pytest, which catches the exception: it is read where pytest calls the
test.
"""

from __future__ import annotations

import ast
import linecache
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .sites import is_library, shown_file

if TYPE_CHECKING:
    from .host import ScriptWatch


class Assertion:
    """A failed `assert` statement.

    Parameters
    ----------
    text
        The source text of the condition.
    file, line
        The file and line of the statement.
    frame
        The frame in which the statement failed.
    """

    def __init__(self, text: str, file: str, line: int, frame: Any) -> None:
        self.text, self.file, self.line, self.frame = text, file, line, frame

    def told(self) -> dict[str, Any]:
        """Return the assertion as a JSON message for the recorder."""
        return {"text": self.text, "file": self.file, "line": self.line}


def assertion_of(error: BaseException) -> Assertion | None:
    """Return the script's own `assert` that raised an exception; None if there is none."""
    if not isinstance(error, AssertionError):
        return None
    found, trace = None, error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        if not name.startswith("<") and not is_library(name):
            found = trace
        trace = trace.tb_next
    if found is None:
        return None
    name, line = found.tb_frame.f_code.co_filename, found.tb_lineno
    test = _test_at(name, line)
    return None if test is None else Assertion(test, shown_file(name), line, found.tb_frame)


def _test_at(file: str, line: int) -> str | None:
    """Return the condition that an `assert` statement tests; None if there is no `assert` there."""
    try:
        tree = ast.parse("".join(linecache.getlines(file)))
    except (SyntaxError, ValueError):
        return None
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert) and node.lineno <= line <= (node.end_lineno or line):
            return ast.unparse(node.test)
    return None


def install(watch: ScriptWatch) -> None:
    """Report exceptions of tests that pytest runs, which pytest catches."""

    def on_runner(module: ModuleType) -> None:
        info: Any = module.CallInfo
        original = info.from_call.__func__

        def from_call(cls: Any, *args: Any, **kwargs: Any) -> Any:
            result = original(cls, *args, **kwargs)
            if result.excinfo is not None:
                watch.failed(result.excinfo.value)
            return result

        info.from_call = classmethod(from_call)

    watch.on_import("_pytest.runner", on_runner)
