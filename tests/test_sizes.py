"""The package does not grow unseen: no room is larger than `tests/budgets.toml` allows."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
import sizes
from sizes import Size

TEXT = sizes.BUDGETS.read_text(encoding="utf-8")
BUDGETS = tomllib.loads(TEXT)
CHANGES = sizes.CHANGES.read_text(encoding="utf-8")

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
LOG = """# Changes

- Something else +9 statements +9 tokens.
- Size: trace +1,200 statements
  +9,000 tokens, rules -3 statements -40 tokens: timelines;
  instead, `seen/` went.
- Size: trace +1 statements +2 tokens: a column, instead of a table.

## 0.1.0
"""


def test_no_room_is_larger_than_its_budget() -> None:
    limits = sizes.limits_of(BUDGETS["rooms"], CHANGES)
    over = {
        room: f"{size}, may have {limits[room]}"
        for room, size in sizes.sizes_of(BUDGETS["rooms"]).items()
        if not size.within(limits[room])
    }
    assert not over, f"take something away, or declare it as tests/sizes.py says: {over}"


def test_every_module_belongs_to_a_room() -> None:
    modules = set(sizes.PACKAGE.rglob("*.py"))
    assert modules == sizes.rooms_of(BUDGETS["rooms"]).keys()


def test_there_are_no_more_exceptions_and_fragments() -> None:
    for name, count in sizes.counts().items():
        assert count <= BUDGETS[name], name


def test_a_docstring_that_its_name_completes_is_a_fragment() -> None:
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


def test_a_class_name_means_one_thing() -> None:
    """Those that meant two before are listed, and leave the list once one is renamed."""
    assert sizes.classes_twice() <= set(BUDGETS["names_twice"])


def test_a_size_counts_code_and_nothing_else() -> None:
    # def, assignment, return; import math | def half ( x ) : | y = ( x / 2 ) | return y
    assert sizes.size_of(SAMPLE) == Size(3, 2 + 6 + 7 + 2)
    assert sizes.size_of(SAMPLE.replace("(\n        x\n        / 2\n    )", "x / 2")) == Size(3, 15)


def test_the_change_log_raises_budgets() -> None:
    assert sizes.declared(LOG) == {"trace": Size(1201, 9002), "rules": Size(-3, -40)}
    for wrong in ("- Size: trace +1 statements +2 tokens: a column.", "- Size: more, instead."):
        with pytest.raises(ValueError, match="what went instead"):
            sizes.declared(wrong)
    with pytest.raises(ValueError, match="has no room cellar"):
        sizes.limits_of(BUDGETS["rooms"], "- Size: cellar +1 statements +2 tokens, instead of x.")


def test_budgets_are_only_lowered(tmp_path: Path) -> None:
    """What was declared stays in the log, so it is left out of the lowered budget."""
    entries = "".join(
        f'[rooms.{room}]\nholds = ["{room}"]\nstatements = 10\ntokens = 100\n'
        for room in ("trace", "rules")
    )
    log = "- Size: trace +5 statements +50 tokens, instead of x.\n"
    for room, statements in (("trace", 12), ("rules", 11)):
        (tmp_path / room).mkdir()
        (tmp_path / room / "a.py").write_text("x\n" * statements)
    reached = sizes.sizes_of(tomllib.loads(entries)["rooms"], tmp_path)
    assert reached == {"trace": Size(12, 12), "rules": Size(11, 11)}
    assert not reached["trace"].within(Size(12, 11))
    lower = tomllib.loads(sizes.lowered(entries, log, reached))["rooms"]
    assert sizes.limits_of(lower, log) == {"trace": Size(12, 12), "rules": Size(10, 11)}


def test_lists_only_get_shorter() -> None:
    counts = {"formatter_exceptions": 7, "docstring_fragments": 10**6}
    text = TEXT.replace("names_twice = []", 'names_twice = [\n    "A", "B", "C",\n]')
    shorter = tomllib.loads(sizes.shortened(text, counts, {"A", "C", "New"}))
    assert shorter["names_twice"] == ["A", "C"]
    assert shorter["formatter_exceptions"] == 7
    assert shorter["docstring_fragments"] == BUDGETS["docstring_fragments"]
