"""Diagnoses of scripts whose faults are known do not get worse; `score` defines the measure."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import score
from drop_physics.rules.engines import MUJOCOS
from score import Truth, Verdict, fallen, findings_of, judged, read_scores, write_scores
from spoken import row_names, spoken

MUJOCO = score.FOLDER / "mujoco"
CORPORA = [score.FOLDER, MUJOCO]
RUN = [pytest.param(score.FOLDER, marks=pytest.mark.pybullet), MUJOCO]
"""The corpora as test parameters, for tests that run the scripts."""
KNOWN = {corpus: score.truths(corpus) for corpus in CORPORA}
WEAK = Truth(
    "It sinks.",
    "At its limit of 10 N.",
    cause=["weak-constraint"],
    words=["maxForce", r"\[asked\]$"],
    numbers=[(10, 0.01), (19.6, 0.03)],
    joint="hinge",
    true=["slides"],
    false=["no-gravity", "off-target: more force"],
)
RIGHT = Truth("Is all well?", "nothing is wrong", cause=[], false=["slides"])


def said(code: str, message: str = "", **more: Any) -> dict[str, Any]:
    finding = {"code": code, "message": message, "advice": None, "level": "asked"}
    return finding | {"proposed": False, "effect": None, "joint": None} | more


FULL = said("weak-constraint", "its maxForce of 10 N", effect={"value": 19.9}, joint="hinge")


@pytest.mark.parametrize("corpus", RUN, ids=["pybullet", "mujoco"])
def test_the_tenth_is_answered_no_worse(corpus: Path) -> None:
    before, known = read_scores(corpus / "tenth.json"), KNOWN[corpus]
    now = {name: judged(known[name], findings_of(name, corpus)) for name in before}
    assert fallen(before, now, known) == []


@pytest.mark.long
@pytest.mark.parametrize("corpus", RUN, ids=["pybullet", "mujoco"])
def test_the_whole_is_answered_no_worse(corpus: Path) -> None:
    """Each row of MuJoCo's rules must be reported for some script, or be removed."""
    known = KNOWN[corpus]
    with spoken() as rows:
        now = {name: judged(known[name], findings_of(name, corpus)) for name in known}
    assert fallen(read_scores(corpus / "whole.json"), now, known) == []
    own = row_names(engines=MUJOCOS) if corpus == MUJOCO else {}
    assert [name for name, row in own.items() if row not in rows] == []


@pytest.mark.parametrize("corpus", CORPORA, ids=lambda corpus: corpus.name)
def test_each_script_has_a_truth_and_a_score(corpus: Path) -> None:
    known, code = KNOWN[corpus], {path.stem: path for path in (corpus / "scripts").glob("*.py")}
    assert code.keys() == known.keys() == read_scores(corpus / "whole.json").keys()
    tenth = len(known) // 10
    assert len(read_scores(corpus / "tenth.json")) in range(tenth, tenth + 3)
    fixed = [code[name] for name, truth in known.items() if truth.fix]
    assert all("FIX" in path.read_text(encoding="utf-8").upper() for path in fixed)


@pytest.mark.parametrize(
    "findings",
    [
        [],
        [said("slides"), said("slides"), FULL],  # a reader looks at two
        [FULL | {"code": "weak"}],
        [FULL | {"message": "at most 10 N"}],
        [FULL | {"level": "note"}],
        [FULL | {"message": "its maxForce of 11 N"}],
        [FULL | {"effect": {"value": 25.0}}],
        [FULL | {"effect": None}],
        [FULL | {"joint": "other"}],
    ],
)
def test_a_cause_is_found_where_it_is_said_whole(findings: list[dict[str, Any]]) -> None:
    assert judged(WEAK, [said("slides"), FULL]) == Verdict(True, [], [], [])
    assert judged(WEAK, [FULL | {"code": "limit", "reason": "weak-constraint"}]).found
    assert judged(WEAK, findings).found is False


def test_a_false_statement_and_noise_are_counted() -> None:
    less = said("off-target", "it gets there", advice="with more force")
    findings = [FULL, said("massless"), less, said("off-target", "too low"), said("no-gravity")]
    wrong = ["off-target", "no-gravity"]
    assert judged(WEAK, findings) == Verdict(True, wrong, ["massless"], ["massless"])
    assert judged(RIGHT, []).in_peace
    assert judged(RIGHT, [said("off-target")]) == Verdict(None, [], ["off-target"], ["off-target"])
    assert not judged(RIGHT, [said("off-target")]).in_peace
    assert not judged(RIGHT, [said("slides")]).in_peace
    known = replace(RIGHT, true=["reading"])
    assert judged(known, [said("reading", level="note")]).in_peace
    assert not judged(known, [said("reading")]).in_peace


BEST = {"a": Verdict(True, [], [], []), "b": Verdict(None, [], [], [])}
OF = {"a": WEAK, "b": RIGHT}


@pytest.mark.parametrize(
    ("now", "what"),
    [
        ({"a": Verdict(False, [], [], [])}, ["causes found: 1 -> 0", "weak-constraint found"]),
        ({"a": Verdict(True, ["x"], [], [])}, ["false statements: 0 -> 1", "x false: 0 -> 1"]),
        ({"a": Verdict(True, [], ["x"], ["x"])}, ["noise: 0 -> 1"]),
        ({"b": Verdict(None, [], ["x"], ["x"])}, ["noise: 0 -> 1", "right scripts left in peace"]),
        ({"a": Verdict(True, [], [], ["x"])}, []),
        ({"c": Verdict(False, ["x"], ["y"], [])}, []),  # it was not scored before
    ],
)
def test_each_figure_may_only_rise(now: dict[str, Verdict], what: list[str]) -> None:
    down = fallen(BEST, BEST | now, OF | {"c": WEAK})
    assert len(down) == len(what)
    assert all(line.startswith(begin) for line, begin in zip(down, what, strict=True))
    assert fallen(BEST | now, BEST, OF | {"c": WEAK}) == []


def test_scores_are_written_where_they_rise_and_only_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script = '[{}]\nasked = "?"\ntruth = "!"\ncause = ["weak"]\n'
    (tmp_path / "truth.toml").write_text(script.format("a") + script.format("b"))
    files = {which: tmp_path / f"{which}.json" for which in ("whole", "tenth")}
    missed = Verdict(False, [], [], [])
    write_scores(files["whole"], {"a": missed, "b": missed})
    write_scores(files["tenth"], {"a": missed})
    found = {"a": [said("weak")], "b": []}
    monkeypatch.setattr(score, "FOLDER", tmp_path)
    monkeypatch.setattr(
        score, "all_findings", lambda names, _: {name: found[name] for name in names}
    )
    monkeypatch.setattr(sys, "argv", ["score.py"])
    score.main()
    risen = {which: path.read_text() for which, path in files.items()}
    assert read_scores(files["tenth"]) == {"a": Verdict(True, [], [], [])}
    assert '"causes found": 0' in risen["whole"]
    assert '"causes found": 1' in risen["whole"]
    assert "causes found                   1 of 2" in capsys.readouterr().out
    found["a"] = []
    with pytest.raises(SystemExit, match="causes found: 1 -> 0"):
        score.main()
    assert risen == {which: path.read_text() for which, path in files.items()}
