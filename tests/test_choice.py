"""Selection of findings as in linters: by an option, a project's settings, or a comment.

And which let an analysis fail; where each stands.
"""

from __future__ import annotations

import ast
import hashlib
import itertools
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import drop_physics
import jsonschema
import pytest
import scenes
from conftest import Drop
from drop_physics.account.rows import AccountRow
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Finding, Proof
from drop_physics.rules.choice import Choice, minor
from drop_physics.rules.codes import CODES, LEVELS, Level
from drop_physics.stages.analyze.sources import Sources, comments_in

PACKAGE = Path(drop_physics.__file__).parent
# Two arms that cannot hold their pose, driven on lines of their own.
ARMS = """import pybullet as p

p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
rod = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.4, 0.02, 0.02])
upright = [0, 0, 0, 1]
one, other = (
    p.createMultiBody(0, -1, -1, [0, at, 1], upright, linkMasses=[2],
        linkCollisionShapeIndices=[rod], linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]],
        linkOrientations=[upright], linkInertialFramePositions=[[0.5, 0, 0]],
        linkInertialFrameOrientations=[upright], linkParentIndices=[0],
        linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]])
    for at in (0, 2))
p.setJointMotorControl2(one, 0, p.POSITION_CONTROL, 0, force=2){one}
p.setJointMotorControl2({two}
    other, 0, p.POSITION_CONTROL, 0, force=4
)
for _ in range(100):
    p.stepSimulation()
__import__("random").random()
"""
OFF = "off-target"

Analyzed = Callable[..., tuple[list[str], int]]


@pytest.fixture(scope="module")
def arms_recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that records a script, given its text, once for each text."""

    @cache
    def recording(text: str) -> Path:
        folder = tmp_path_factory.mktemp("arms")
        (folder / "arms.py").write_text(text)
        return scenes.record_file(folder / "arms.py", folder / "arms.rrd").path

    return recording


@pytest.fixture
def arms(arms_recorded: Callable[[str], Path], tmp_path: Path) -> Callable[..., None]:
    """Return a function that records the script with comments on its two lines."""

    def record(one: str = "", two: str = "") -> None:
        text = ARMS.format(one=one, two=two)
        (tmp_path / "arms.py").write_text(text)
        (tmp_path / "recordings").mkdir(exist_ok=True)
        shutil.copyfile(arms_recorded(text), tmp_path / "recordings/arms.rrd")

    return record


@pytest.fixture
def analyzed(drop: Drop) -> Analyzed:
    """Return a function that analyzes the newest recording: `off-target` sites, number left out."""

    def analyze(*options: str) -> tuple[list[str], int]:
        result = json.loads(drop("analyze", *options, "--json").stdout)
        found = [each["site"] for each in result["findings"] if each["code"] == OFF]
        return found, result["left_out"]

    return analyze


SARIF = {
    "type": "object",
    "required": ["version", "runs"],
    "properties": {
        "version": {"const": "2.1.0"},
        "runs": {
            "items": {
                "required": ["tool", "results"],
                "properties": {
                    "tool": {
                        "required": ["driver"],
                        "properties": {
                            "driver": {
                                "required": ["name"],
                                "properties": {"rules": {"items": {"required": ["id"]}}},
                            }
                        },
                    },
                    "results": {
                        "items": {
                            "required": ["message", "locations"],
                            "properties": {
                                "level": {"enum": ["none", "note", "warning", "error"]},
                                "message": {"required": ["text"]},
                                "ruleIndex": {"type": "integer", "minimum": 0},
                                "locations": {
                                    "items": {
                                        "properties": {
                                            "physicalLocation": {
                                                "required": ["artifactLocation"],
                                                "properties": {
                                                    "artifactLocation": {
                                                        "required": ["uri"],
                                                        "properties": {
                                                            "uri": {"format": "uri-reference"}
                                                        },
                                                    },
                                                    "region": {
                                                        "properties": {
                                                            "startLine": {
                                                                "type": "integer",
                                                                "minimum": 1,
                                                            }
                                                        }
                                                    },
                                                },
                                            }
                                        }
                                    }
                                },
                            },
                        }
                    },
                },
            }
        },
    },
}
"""Parts that OASIS's schema of SARIF 2.1.0 requires in the output that we write (3.13 to 3.30)."""


def project(folder: Path, text: str) -> None:
    (folder / "pyproject.toml").write_text(text)


# -- where a change is reviewed -------------------------------------------------------------------


def test_findings_are_annotations_at_their_lines(drop: Drop, arms: Callable[..., None]) -> None:
    arms()
    as_json = json.loads(drop("analyze", "--json").stdout)
    assert json.loads(drop("analyze", "--output-format", "json").stdout) == as_json
    found = as_json["findings"]

    annotations = drop("analyze", "--output-format", "github").stdout.splitlines()
    assert len(annotations) == len(found)
    for line, finding in zip(annotations, found, strict=True):
        file, _, number = (finding["site"] or "arms.py:").rpartition(":")
        place = f"file={file}," + (f"line={number}," if number else "")
        level = {"broken": "error", "asked": "warning", "model": "warning"}
        start = f"::{level.get(finding['level'], 'notice')} {place}title=drop%3A {finding['code']}"
        assert line.startswith(f"{start}::{finding['message'][:20]}".replace("\n", "%0A"))

    log = json.loads(drop("analyze", "--output-format", "sarif").stdout)
    jsonschema.validate(log, SARIF)
    (run,) = log["runs"]
    described = run["tool"]["driver"]["rules"]
    rules = [each["id"] for each in described]
    for each in described:  # as `drop explain` does
        meaning = drop("explain", each["id"]).stdout
        assert each["shortDescription"]["text"] in " ".join(meaning.split())
        assert each["defaultConfiguration"]["level"] in ("error", "warning", "note")
    for result, finding in zip(run["results"], found, strict=True):
        assert rules[result["ruleIndex"]] == result["ruleId"] == finding["code"]
        place = result["locations"][0]["physicalLocation"]
        line = place.get("region", {}).get("startLine", "")
        site = f"{place['artifactLocation']['uri']}:{line}"
        assert site == (finding["site"] or "arms.py:")


def test_an_annotation_names_the_file_from_the_working_directory(
    drop: Drop, arms: Callable[..., None], tmp_path: Path
) -> None:
    arms()
    (tmp_path / "scripts").mkdir()
    for name in ("arms.py", "recordings"):
        (tmp_path / name).rename(tmp_path / "scripts" / name)
    analyze = ("analyze", "scripts/recordings/arms.rrd", "--output-format", "github")
    assert "file=scripts/arms.py," in drop(*analyze).stdout
    (tmp_path / "scripts/arms.py").write_text("another text")  # whose lines are others
    assert "file=arms.py," in drop(*analyze).stdout


# -- a command ------------------------------------------------------------------------------------


def test_a_command_selects_and_ignores_and_says_how_many(
    drop: Drop, arms: Callable[..., None], analyzed: Analyzed
) -> None:
    arms()
    result = json.loads(drop("analyze", "--json").stdout)
    codes = [each["code"] for each in result["findings"]]
    assert (codes.count(OFF), result["left_out"]) == (1, 0)
    others = len(codes) - 1
    assert others > 0
    assert analyzed("--ignore", OFF) == ([], 1)
    assert analyzed("--select", OFF) == (["arms.py:14"], others)
    assert analyzed("--select", f"slides, {OFF}", "--ignore", OFF) == ([], others + 1)
    assert analyzed("--ignore", "all") == ([], others + 1)
    assert "left out" not in drop("analyze").stdout
    said = drop("analyze", "--ignore", OFF).stdout
    assert "\n1 finding left out: --select all\n" in said
    assert "its motor is at its" not in said


def test_of_a_drop_too(drop: Drop) -> None:
    drop("simulate", "--out", "run.rrd", "--no-camera", "--no-gravity")
    result = json.loads(drop("analyze", "run.rrd", "--ignore", "no-gravity", "--json").stdout)
    assert "no-gravity" not in [each["code"] for each in result["findings"]]
    assert result["left_out"] == 1
    assert "1 finding left out" in drop("analyze", "run.rrd", "--ignore", "no-gravity").stdout
    assert drop("analyze", "run.rrd", "--fail-on", "asked").returncode == 3


@pytest.mark.parametrize(("level", "code"), [("broken", 0), ("asked", 3), ("never", 0)])
def test_what_is_as_grave_or_graver_fails(
    drop: Drop, arms: Callable[..., None], level: str, code: int
) -> None:
    arms()
    done = drop("analyze", "--select", OFF, "--fail-on", level)
    assert done.returncode == code
    assert OFF in done.stdout  # it is all printed
    assert ("1 finding of level" in done.stderr) == bool(code)
    assert drop("analyze", "--ignore", "all", "--fail-on", level).returncode == 0


def test_levels_are_ordered() -> None:
    finding = Finding(code=OFF, message=Message("it"), level="model")
    grave = [level for level in LEVELS if Choice(fail_on=level).grave([finding])]
    assert grave == ["model", "repeat", "note"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--select", "offtarget"], "--select takes codes of findings, got 'offtarget'; did you"),
        (["--ignore", ""], "--ignore takes codes of findings, got ''"),
        (["--fail-on", "grave"], "--fail-on takes broken or asked or model or repeat or note or"),
    ],
)
def test_what_is_no_code_or_level_is_one_line(
    drop: Drop, arms: Callable[..., None], options: list[str], said: str
) -> None:
    arms()
    done = drop("analyze", "recordings/arms.rrd", *options)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert said in done.stderr


# -- a project ------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_project_chooses_and_the_command_counts_more(
    drop: Drop, arms: Callable[..., None], analyzed: Analyzed, tmp_path: Path
) -> None:
    arms()
    project(tmp_path.parent, f'[tool.drop]\nignore = ["{OFF}"]\nfail-on = "note"\n')
    try:
        assert analyzed() == ([], 1)
        assert analyzed("--select", OFF)[0] == ["arms.py:14"]
        assert analyzed("--select", "all") == (["arms.py:14"], 0)
        assert analyzed("--ignore", "slides") == ([], 1)
        assert drop("analyze", "--select", "all").returncode == 3
        assert drop("analyze", "--select", "all", "--fail-on", "broken").returncode == 0
        assert drop("analyze", "--select", "all", "--fail-on", "never").returncode == 0
        project(tmp_path, "[project]\nname = 'nearest'\n")  # without a table of ours
        assert analyzed() == (["arms.py:14"], 0)
        project(tmp_path, '[tool.drop]\nselect = ["slides"]\n')
        assert analyzed()[0] == []
        assert analyzed("--select", OFF)[0] == ["arms.py:14"]
    finally:
        (tmp_path.parent / "pyproject.toml").unlink()


def test_a_project_lets_a_script_alone_fail(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "arms.py").write_text(ARMS.format(one="", two=""))
    assert drop("arms.py").returncode == 0
    project(tmp_path, '[tool.drop]\nfail-on = "asked"\n')
    assert drop("arms.py").returncode == 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[tool.drop]\nignored = []", "has no ignored; did you mean ignore?"),
        ('[tool.drop]\nignore = "slides"', "takes a list of codes, got 'slides'"),
        ('[tool.drop]\nignore = ["slide"]', "got 'slide'; did you mean slides?"),
        ('[tool.drop]\nselect = ["slide"]', "got 'slide'; did you mean slides?"),
        ('[tool.drop]\nfail-on = "bad"', "takes broken or asked or model or repeat or note or"),
        ("[tool.drop]\nfail-on = 3", "takes a level, got 3"),
        ("[tool.drop]\ntolerance = true", "takes a number of metres, got True"),
        ("[tool.drop", "cannot be read"),
        ("tool = 3", "[tool.drop] must be a table"),
        ("tool.drop = 3", "[tool.drop] must be a table"),
    ],
)
def test_a_project_that_asks_for_what_is_not_there_is_one_line(
    drop: Drop, tmp_path: Path, standard_recording: Path, text: str, said: str
) -> None:
    project(tmp_path, text)
    done = drop("analyze", standard_recording)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert said in done.stderr
    assert "pyproject.toml" in done.stderr


@pytest.fixture(scope="module")
def standard_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recording of a short drop."""
    path = tmp_path_factory.mktemp("drop") / "run.rrd"
    scenario = drop_physics.Scenario(duration_s=0.1)
    drop_physics.simulate(scenario, path, camera=None)
    return path


def test_a_project_says_how_far_a_golden_may_be_off(drop: Drop, tmp_path: Path) -> None:
    for name, height in (("golden", "1"), ("run", "1.000001")):
        drop("simulate", "--out", f"{name}.rrd", "--no-camera", "--height", height)
    check = ["check", "run.rrd", "--against", "golden.rrd"]
    assert drop(*check).returncode == 3
    project(tmp_path, "[tool.drop]\ntolerance = 1e-3\n")
    said = drop(*check, "--json")
    assert json.loads(said.stdout)["tolerance_m"] == 1e-3
    assert json.loads(drop(*check, "--tolerance", "0", "--json").stdout)["tolerance_m"] == 0


@pytest.mark.long
def test_a_plot_is_of_what_is_reported(
    drop: Drop, arms: Callable[..., None], tmp_path: Path
) -> None:
    arms()

    def plotted(*options: str) -> str:
        drop("render", "--plot", "p.svg", "--force", *options)
        return (tmp_path / "p.svg").read_text()

    project(tmp_path, f'[tool.drop]\nignore = ["{OFF}"]\n')
    assert "off its target" not in plotted()
    assert "off its target" in plotted("--select", OFF)
    project(tmp_path, "")
    arms(**dict.fromkeys(("one", "two"), "  # drop: ignore[off-target]"))
    assert "off its target" not in plotted()


# -- a comment ------------------------------------------------------------------------------------


def test_a_comment_spares_its_line_and_no_other(
    arms: Callable[..., None], analyzed: Analyzed
) -> None:
    """Equal findings on two arms are merged; a comment on one line does not suppress both."""
    arms(two="  # drop: ignore[off-target]")
    assert analyzed() == (["arms.py:14"], 1)
    arms(one="  # it is weak  # drop: ignore[slides, off-target]")
    assert analyzed() == (["arms.py:15"], 1)
    arms(one="  # drop: ignore[slides]", two="  # drop: ignore[]")
    assert analyzed() == (["arms.py:14"], 0)
    arms(one="  # drop: ignore[off-target]", two="  # drop: ignore[off-target]")
    assert analyzed() == ([], 1)
    assert analyzed("--select", OFF)[0] == ["arms.py:14"]  # the command counts more


def test_a_comment_counts_only_in_the_text_that_was_recorded(
    arms: Callable[..., None], analyzed: Analyzed, tmp_path: Path
) -> None:
    script = tmp_path / "arms.py"
    arms()
    assert analyzed() == (["arms.py:14"], 0)
    both = dict.fromkeys(("one", "two"), "  # drop: ignore[off-target]")
    script.write_text(ARMS.format(**both))  # edited, and not recorded again
    assert analyzed() == (["arms.py:14"], 0)
    arms(**both)
    assert analyzed() == ([], 1)
    script.unlink()
    assert analyzed() == (["arms.py:14"], 0)


@pytest.mark.long
def test_the_script_is_found_from_elsewhere_and_of_a_module_too(
    drop: Drop, drop_process: Drop, tmp_path: Path
) -> None:
    folder = tmp_path / "sims"
    folder.mkdir()
    both = dict.fromkeys(("one", "two"), "  # drop: ignore[off-target]")
    (folder / "arms.py").write_text(ARMS.format(**both))
    assert drop_process("record", "-m", "sims.arms").returncode == 0
    recorded = tmp_path / "recordings/sims.arms.rrd"
    result = json.loads(drop("analyze", "--json").stdout)
    assert (result["left_out"], result["recording"]) == (1, "recordings/sims.arms.rrd")
    drop("record", "--out", "one.rrd", "sims/arms.py")
    assert json.loads(drop("analyze", "one.rrd", "--json").stdout)["left_out"] == 1
    (tmp_path / "e/f").mkdir(parents=True)
    for analysis in (
        drop("analyze", "one.rrd", "--json"),
        drop("analyze", "--json", recorded),
    ):
        assert json.loads(analysis.stdout)["left_out"] == 1


def test_no_name_in_a_recording_leads_out_of_a_folder_or_waits_for_a_pipe(tmp_path: Path) -> None:
    text, digest = b"steps(1)\n", hashlib.sha256(b"steps(1)\n").hexdigest()
    inner = tmp_path / "inner"
    inner.mkdir()
    for path in (inner / "own.py", tmp_path / "outer.py"):
        path.write_bytes(text)
    os.mkfifo(inner / "pipe.py")
    sources = Sources(digest, [inner])
    asked = ["own.py", "../outer.py", str(tmp_path / "outer.py"), "pipe.py", "/dev/zero"]
    assert sources.files(asked) == {"own.py": inner / "own.py"}


def test_only_comments_count_and_only_whole_ones() -> None:
    text = b"""a = "# drop: ignore[one]"
b = 1  # drop: ignore[two, three]
c = 2  # drop:ignore[four] and why
d = 3  # drop: ignore four
e = (  # drop: ignore[five]
    6,
)
"""
    assert comments_in(text) == {2: {"two", "three"}, 3: {"four"}, 5: {"five"}}
    assert comments_in(b"x = '\n# drop: ignore[one]\n") in ({}, {2: {"one"}})  # no Python: no error


# -- what stands where ----------------------------------------------------------------------------


def test_a_site_stands_first_and_alone(drop: Drop, arms: Callable[..., None]) -> None:
    arms()
    said = drop("analyze").stdout
    assert re.search(r"^\narms\.py:14\n1  0_box: joint1 ", said, re.MULTILINE)
    assert said.count("arms.py:14") == 1
    assert re.search(r"^(?:   .*)? {3,}off-target$", said, re.MULTILINE)


def test_every_code_of_a_finding_can_be_chosen() -> None:
    """The codes are exactly those in the source code of the rules."""
    written: set[str] = set()
    for path in [*(PACKAGE / "rules").rglob("*.py"), *(PACKAGE / "drop").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.keyword(arg="code" | "reason", value=value):
                    texts = ast.walk(value)
                case ast.Assign(targets=[ast.Name(id="code")], value=value):
                    texts = ast.walk(value)
                case ast.Call(func=ast.Name(id=name), args=[value, _, *more]) if name.endswith(
                    "_rule"
                ):
                    texts = itertools.chain.from_iterable(map(ast.walk, (value, *more)))
                case ast.Assign(
                    targets=[ast.Tuple(elts=[ast.Name(id="code"), *_])],
                    value=ast.Tuple(elts=[value, *_]),
                ):
                    texts = ast.walk(value)
                case ast.AnnAssign(target=ast.Name(id="WHY"), value=ast.Dict(keys=keys)):
                    texts = iter(keys)
                case ast.Dict(keys=keys, values=values):  # the numbers of a row
                    named = dict(zip(map(ast.dump, filter(None, keys)), values, strict=False))
                    texts = filter(None, [named.get(ast.dump(ast.Constant("reason")))])
                case _:
                    continue
            written |= {
                text.value
                for text in texts
                if isinstance(text, ast.Constant) and isinstance(text.value, str)
            }
    assert written - {"reason"} == CODES.keys()  # that is how a row looks its own up
    assert len(LEVELS) == 5


# -- the package ----------------------------------------------------------------------------------

ROOT = Path(__file__).parents[1]


def test_the_version_is_the_packages_and_stands_where_it_is_cited() -> None:
    import tomllib
    from importlib.metadata import version

    assert drop_physics.__version__ == version("drop-physics")
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert f"\nversion: {declared['version']}\n" in (ROOT / "CITATION.cff").read_text()
    assert (ROOT / "CHANGELOG.md").read_text().splitlines()[2] == f"## {declared['version']}"
    assert {"authors", "urls", "classifiers"} <= declared.keys()
    systems = [each for each in declared["classifiers"] if each.startswith("Operating System ::")]
    assert systems == ["Operating System :: POSIX :: Linux"]


def test_what_explains_little_is_folded_away() -> None:
    """The limit is a tenth of the gravest mistake's share; without a mistake, of the largest."""

    def of(level: Level, share: float) -> Finding:
        return Finding(code="slides", level=level, message="", share=share)

    mistake, small, large = of("asked", 1.0), of("model", 0.09), of("model", 0.11)
    assert minor([mistake, small, large, of("note", 0.05)]) == [small, of("note", 0.05)]
    assert minor([large, small]) == []
    assert minor([of("asked", 0.01), large]) == []
    assert minor([large, of("note", 0.01)]) == [of("note", 0.01)]


def test_what_nothing_proves_leads_only_if_it_is_most_of_what_acted() -> None:
    """A note without a proof, alone: that of a quarter is folded, that of the most is shown."""

    def of(share: float, proof: Proof) -> Finding:
        energy = Effect(value=share, unit="J")
        return Finding(
            code="default-damping",
            level="note",
            message="",
            share=share,
            proof=proof,
            effect=energy,
        )

    quarter, most = of(0.27, "none"), of(0.83, "none")
    assert minor([quarter]) == [quarter]
    assert minor([most]) == []
    assert minor([of(0.27, "sum")]) == []


def test_a_joint_that_the_account_has_far_farther_off_does_not_lead() -> None:
    """Off by 3 mm before it presses, and by 105 mm after: the former is not what is asked for."""
    off = Finding(
        code="off-target",
        level="asked",
        message="",
        share=0.003,
        body="2_gripper",
        joint="lift",
        effect=Effect(value=0.003, unit="m"),
    )
    row = AccountRow(
        kind="asked", body="2_gripper", joint="lift", told="", gap=0.105, unit="m", salience=1.0
    )
    assert minor([off], [row]) == [off]
    assert minor([off], [replace(row, gap=-0.02)]) == []
    assert minor([off], [replace(row, joint="turn")]) == []
    assert minor([off], [replace(row, unit="rad")]) == []
