"""Code sizes are counted and printed, docstrings are sentences, and class names are unique.

Nothing here limits a size: a limit that a line of prose could raise was raised 29 times.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import sizes
from sizes import Size

SAMPLE = '''"""A docstring."""

import math  # an import is no statement


def half(x):
    """Return half."""
    # A comment.
    y = (
        x
        / 2
    )
    return y
'''


def test_a_size_counts_code_and_nothing_else() -> None:
    # def, assignment, return; import math | def half ( x ) : | y = ( x / 2 ) | return y
    assert sizes.size_of(SAMPLE) == Size(3, 2 + 6 + 7 + 2)
    assert sizes.size_of(SAMPLE.replace("(\n        x\n        / 2\n    )", "x / 2")) == Size(3, 15)


def test_rooms_stand_beside_those_of_the_last_version() -> None:
    """A new or removed room counts as one of size 0."""
    now = sizes.sizes_of({Path("rules/slides.py"): SAMPLE, Path("engines/mujoco/a/b.py"): "x"})
    then = sizes.sizes_of({Path("rules/slides.py"): "x", Path("seen/a.py"): "x"})
    rows = [line.split() for line in sizes.table(now, then)]
    assert rows[1:] == [
        ["seen", "0", "1", "0", "1", "-1"],
        ["engines/mujoco", "1", "0", "1", "0", "+1"],
        ["rules", "3", "1", "17", "1", "+16"],
        ["together", "4", "2", "18", "2", "+16"],
    ]
    assert [line.split()[1:] for line in sizes.table(now, {})][-1] == ["4", "18"]


@pytest.mark.long
def test_no_docstring_is_a_fragment() -> None:
    code = '''
WIDTH = 3
"""Of a line."""
OTHER = 4
"""Width of a line. Of no text."""
def wide(text):
    """Whether it is wide."""
def narrow(text):
    """Return whether it is narrow."""
    return "Of a string that is no docstring."
class Line:
    @cached_property
    def is_long(self):
        """Whether it is long."""
'''
    assert sizes.fragments_in(code) == ["Of a line.", "Whether it is wide."]
    for path, module in sizes.modules_now().items():
        assert sizes.fragments_in(module) == [], path


@pytest.mark.long
def test_a_class_name_means_one_thing() -> None:
    assert sizes.classes_twice() == set()


def test_columns_are_declared_and_no_sentence_decides() -> None:
    """No class defines `__getattr__`, which mypy cannot check, and no English text is compared."""
    for path, code in sizes.modules_now().items():
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ClassDef):
                methods = {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
                assert "__getattr__" not in methods, (path, node.name)
            elif isinstance(node, ast.Compare) and path.name != "messages.py":  # which translates
                compared = [node.left, *node.comparators]
                texts = [each for each in compared if isinstance(each, ast.Attribute)]
                assert "template" not in {text.attr for text in texts}, (path, node.lineno)
