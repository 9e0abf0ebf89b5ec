"""Validation: each finding is reported for scenes that it is true of, and not for similar ones."""

from __future__ import annotations

from pathlib import Path

import attacks
import pytest
from conftest import some

ALL = attacks.attacks()
TENTH = sorted(ALL, key=lambda name: [*ALL].index(name) % 10)


@pytest.mark.parametrize("name", some(TENTH, len(ALL) // 10))
def test_an_attack_is_answered(name: str, tmp_path: Path) -> None:
    assert [*ALL[name].shortfalls(tmp_path)] == []


def test_every_name_of_a_case_is_used() -> None:
    assert {name: each.unused() for name, each in ALL.items() if each.unused()} == {}
