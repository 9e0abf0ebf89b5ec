"""`drop explain` describes each finding code with the text of its rule."""

from __future__ import annotations

import json
from collections.abc import Callable
from subprocess import CompletedProcess

import pytest
from command import ROOT
from drop_physics.drop.findings import ALL_RULES
from drop_physics.errors import ScenarioError
from drop_physics.rules.codes import CODES
from drop_physics.rules.reference import PLACEHOLDER, references
from drop_physics.rules.rule import RULES
from drop_physics.rules.thresholds import BEYOND_RANGE
from drop_physics.stages.explain import CodeManual, explain

Drop = Callable[..., "CompletedProcess[str]"]


def test_every_code_and_reason_is_explained() -> None:
    made = references(ALL_RULES)
    assert made.keys() == CODES.keys()
    assert all(each.meaning.endswith(".") for each in made.values())
    assert {each.reason_of for each in made.values() if each.reason_of} <= CODES.keys()


def test_a_rule_is_explained_in_its_own_words() -> None:
    made = references(ALL_RULES)
    for rule in ALL_RULES:
        sentence = " ".join(rule.meaning.split("\n\n")[0].split())
        for name in {rule.code, rule.reason or rule.code}:
            assert sentence in made[name].measured
    assert {made["ik-index"].reason_of, made["filter"].reason_of} == {
        "taken-elsewhere",
        "no-contact",
    }


def test_a_cure_is_written_for_the_engine_that_its_row_is_about() -> None:
    """A rule for both engines has a level and a syntax for each of its rows."""
    made = references(ALL_RULES, ["flag", "tunnelled"])
    assert (made["flag"].level, {engine for engine, *_ in made["flag"].cures}) == (
        "model",
        {"MuJoCo"},
    )
    assert {(engine, cure.name) for engine, cure, _ in made["tunnelled"].cures} == {
        ("PyBullet", "without"),
        ("PyBullet", "timestep"),
        ("MuJoCo", "solref"),
    }


@pytest.mark.long
def test_thresholds_messages_and_cure_are_those_of_the_rule() -> None:
    """Of two rules in one file, each has its own texts."""
    (made,) = explain("target-clamped").codes
    limits = {threshold.name: threshold.value for threshold in made.thresholds}
    assert limits["BEYOND_RANGE"] == BEYOND_RANGE
    assert "CROSSINGS" not in limits
    assert any(say.endswith("PyBullet takes the limit as the target") for say in made.says)
    assert any("jointLowerLimit" in advise for advise in made.advises)
    assert not any(PLACEHOLDER.search(text) for text in (*made.says, *made.advises))
    apart, weak = (references(ALL_RULES)[code] for code in ("constraint-apart", "weak-constraint"))
    assert not {*apart.says} & {*weak.says}


@pytest.mark.long
def test_what_a_rule_only_proposes_is_to_try() -> None:
    for rule in RULES:
        (made,) = explain(rule.code).codes
        assert made.proposes or not rule.proposes
    (free,) = explain("free-base").codes
    assert (free.advises, free.proposes) == ([], ["load it with p.loadURDF(…, useFixedBase=True)"])
    assert "to try      load it with" in str(CodeManual([free]))
    (apart,) = explain("constraint-apart").codes
    assert (bool(apart.advises), apart.proposes) == (True, [])


def test_an_example_is_a_line_of_a_script_that_there_is() -> None:
    examples = [
        reference.example
        for reference in references(ALL_RULES).values()
        if reference.example is not None
    ]
    assert len(examples) > 25
    for example in examples:
        lines = (ROOT / example.script).read_text(encoding="utf-8").splitlines()
        assert example.line is None or "p." in lines[example.line - 1]
    shown = references(ALL_RULES, ["unstable", "default-damping"])
    assert all(each.example and each.example.advises for each in shown.values())


def test_what_is_not_known_is_likened() -> None:
    with pytest.raises(ScenarioError, match="did you mean off-target"):
        explain("of-target")
    for asked in ({}, {"code": "slides", "every": True}):
        with pytest.raises(ScenarioError, match="give one code"):
            explain(**asked)  # type: ignore[arg-type]


def test_one_in_full_or_all_in_a_line_each(drop: Drop) -> None:
    text = drop("explain", "constraint-apart").stdout
    assert "0.05 rad" in text
    assert "childFrameOrientation" in text
    assert "example     docs/examples/why/constraint_apart.py:12\n" in text
    listed = drop("explain", "--list").stdout
    assert all(name in listed for name in CODES)
    (one,) = json.loads(drop("explain", "no-effect", "--json").stdout)["codes"]
    assert (one["code"], one["reason_of"]) == ("no-effect", "not-taken")
