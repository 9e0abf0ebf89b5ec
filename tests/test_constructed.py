"""Verification of findings about scenes whose faults are known by construction, and of their cures.

Of each kind, a wrong scene and a right one; `python tests/constructed.py --seeds N` draws others.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from constructed import KINDS, Judged, judged
from drop_physics.rules.answer import Finding

WRONG, RIGHT = 1, 2
"""Seeds of faulty and of correct scenes: of three seeds, one is correct."""


@pytest.mark.long
@pytest.mark.parametrize("name", KINDS)
def test_what_is_wrong_by_construction_is_found_and_its_cure_cures(
    name: str, tmp_path: Path
) -> None:
    made = [judged(name, seed, tmp_path) for seed in (WRONG, RIGHT)]
    assert [[*each.faults()] for each in made] == [[], []]


@pytest.mark.long
def test_a_false_finding_a_missing_one_and_a_cure_that_is_none_are_faults() -> None:
    kind = KINDS["arm"]
    said = Finding(code="slides", level="asked", message="It slides.")
    right = Finding(code="off-target", level="asked", message="It is off.")
    assert [*Judged(kind, False, 0, [], []).faults()] == []
    assert [*Judged(kind, True, 1, [right], [(right, "force=9", 0.0)]).faults()] == []
    faults = [*Judged(kind, True, 1, [said, said, right], [(right, "force=9", 0.5)]).faults()]
    assert [fault.partition(":")[0] for fault in faults] == ["missed", *["false"] * 2, "not cured"]
    (scene,) = Judged(kind, False, 1, [], []).faults()
    assert scene.startswith("scene")
