"""Faults of controllers are named in the analysis of failed episodes; `fault_score` tells how."""

from __future__ import annotations

import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("mujoco")

import fault_score as scorer

CASES = scorer.cases()
BY_ACCOUNT = (
    *("hopper-swapped", "hopper-stale", "ant-order", "ant-slippery", "humanoid-weak-knee"),
    *("humanoid-stale", "humanoid-slippery", "cheetah-swapped", "cheetah-clamped"),
    *("quadruped-slippery", "quadruped-limited"),
    *("gripper-slippery", "gripper-heavy-cube", "gripper-swapped"),
)
"""Faults that the account names."""
BY_SEARCH = ("gripper-soft",)
"""Faults that the search names, if the search is short."""


def test_there_are_four_faults_of_each_of_six_robots() -> None:
    assert len(CASES) == 24
    assert {*BY_ACCOUNT, *BY_SEARCH} <= {*CASES}


@pytest.mark.long
@pytest.mark.parametrize("name", BY_ACCOUNT)
def test_the_account_names_a_fault(name: str) -> None:
    case = CASES[name]
    rows = scorer.rows_of(scorer.analyzed(case.robot, case.fault))
    assert case.named_by(rows[: scorer.ROWS]), rows


@pytest.mark.long
@pytest.mark.parametrize("name", BY_SEARCH)
def test_the_search_names_a_fault(name: str) -> None:
    outcomes = scorer.outcomes_of(CASES[name])
    assert CASES[name].named_by(outcomes[: scorer.OUTCOMES]), outcomes


@pytest.mark.long
@pytest.mark.parametrize("robot", sorted({each.robot for each in CASES.values()}))
def test_of_a_controller_without_a_fault_only_its_end_is_told(robot: str) -> None:
    analysis = scorer.analyzed(robot)
    assert [each.ended for each in analysis.episodes] == ["truncated"]
    assert scorer.said_of(analysis) == []
