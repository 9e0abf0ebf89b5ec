"""The reference pages match the code, and printed output matches the references."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import scenes
from command import drop_here
from conftest import some
from drop_physics.cli import app
from drop_physics.stages.run import Run
from generators.json_objects import COMMANDS
from generators.pages import blocks
from generators.typed import run_python
from jsonschema import Draft202012Validator
from regenerate import is_current, references
from typer.testing import CliRunner

SCHEMAS = Path(__file__).parents[1] / "docs/schemas"
GOLDEN = Path(__file__).parents[1] / "recordings/golden/standard.rrd"
AGAIN = "a reference is stale; make it again with: python docs/regenerate.py"


def test_the_references_are_those_of_the_code() -> None:
    for path, content in references().items():
        assert is_current(path, content), f"{path.name}: {AGAIN}"


# -- JSON -----------------------------------------------------------------------------------------


def schema_of(command: str) -> dict[str, Any]:
    return dict(json.loads((SCHEMAS / f"{command}.json").read_text(encoding="utf-8")))


def strict(schema: Any) -> Any:
    """Return a schema that rejects every key that it does not describe."""
    if isinstance(schema, list):
        return [strict(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    closed = {key: strict(value) for key, value in schema.items()}
    return {"additionalProperties": False} | closed if "properties" in schema else closed


@pytest.fixture
def printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standard: Run) -> Any:
    """Return a function that runs a command beside `run.rrd`, and returns its JSON output."""
    monkeypatch.chdir(tmp_path)
    Path("run.rrd").write_bytes(standard.simulation.recording.read_bytes())

    def call(command: str) -> dict[str, Any]:
        done = CliRunner().invoke(app, [*command.split(), "--json"])
        return dict(json.loads(done.stdout))

    return call


@pytest.mark.parametrize("command", some(COMMANDS, 3))
def test_a_schema_is_one(command: str) -> None:
    Draft202012Validator.check_schema(schema_of(command))


@pytest.mark.parametrize(
    "commands",
    some(
        [
            ["simulate --out new.rrd --no-camera"],
            ["analyze run.rrd", "analyze run.rrd --at 0.3 --at 0.5 --at 0.9"],
            *(
                [f"simulate --out new.rrd --no-camera {options}", "analyze new.rrd --at 0.1"]
                for options in (
                    "--no-step",
                    "--no-floor --velocity 1,0,3 --spin 0,5,0",
                    "--restitution 0.8 --duration 2 --coordinates maximal",
                )
            ),
            ["render run.rrd"],
            ["info run.rrd"],
            ["run --duration 0.1 --no-camera"],
            ["check run.rrd --against run.rrd", f"check run.rrd --against {GOLDEN}"],
            [
                "simulate --out new.rrd --no-camera --timestep 1/480",
                "check new.rrd --against run.rrd",
            ],
            ["check run.rrd --against golden.rrd --update"],
            ["sweep --out a --timestep 1/240,1/480,1/960 --linear-damping default,0"],
            ["sweep --out b --timestep 1/240,1/7 --no-record"],
            ["sweep --out c --samples 40 --vary height=uniform:1:2 --no-record"],
        ],
        2,
    ),
    ids=lambda commands: commands[-1].partition(" --out")[0][:60],
)
def test_what_is_printed_is_what_the_schema_says(printed: Any, commands: list[str]) -> None:
    for command in commands:
        schema = schema_of(command.partition(" ")[0])
        Draft202012Validator(strict(schema)).validate(printed(command))


def test_what_record_prints_is_what_the_schema_says(tmp_path: Path) -> None:
    tmp_path.joinpath("script.py").write_text("import pybullet as p\np.connect(p.DIRECT)\n")
    done = drop_here("record", "--json", "--twice", "script.py", folder=tmp_path)
    Draft202012Validator(strict(schema_of("record"))).validate(json.loads(done.stdout))


def test_what_is_printed_of_a_script_is_small_and_what_the_schema_says(tmp_path: Path) -> None:
    shutil.copy(SCHEMAS.parent / "examples/arm.py", tmp_path)
    done = drop_here("--json", "arm.py", folder=tmp_path)
    printed = json.loads(done.stdout)
    Draft202012Validator(strict(schema_of("script"))).validate(printed)
    assert len(done.stdout) < 2_500
    (finding,) = printed["findings"]
    assert (finding["code"], finding["site"]) == ("off-target", "arm.py:13")
    assert finding["terms"] == "towards motor +30 N m   against gravity -31.4 N m"
    # The row of that joint gives its place to the finding; another joint's stands.
    assert [row["who"] for row in printed["account"] if row["kind"] == "asked"] == [
        "lbr_iiwa_joint_4"
    ]


@pytest.mark.long
def test_what_trust_prints_is_what_the_schema_says(tmp_path: Path) -> None:
    tmp_path.joinpath("script.py").write_text(
        "import pybullet as p\np.connect(p.DIRECT)\np.setGravity(0, 0, -10)\n"
        "b = p.createMultiBody(1, basePosition=[0, 0, 9])\n"
        "for _ in range(9): p.stepSimulation()\n"
    )
    done = drop_here("trust", "--json", "--jobs", "1", "script.py", folder=tmp_path)
    Draft202012Validator(strict(schema_of("trust"))).validate(json.loads(done.stdout))


@pytest.mark.long
def test_what_why_prints_is_what_the_schema_says(tmp_path: Path) -> None:
    tmp_path.joinpath("script.py").write_text(
        "import pybullet as p\np.connect(p.DIRECT)\np.setGravity(0, 0, -10)\n"
        "b = p.createMultiBody(1, basePosition=[0, 0, 9])\n"
        "c = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 9])\n"
        "p.changeConstraint(c, maxForce=5)\n"
        "for _ in range(60): p.stepSimulation()\n"
    )
    done = drop_here("why", "--json", "--ablate", "--jobs", "1", "script.py", folder=tmp_path)
    printed = json.loads(done.stdout)
    Draft202012Validator(strict(schema_of("why"))).validate(printed)
    assert printed["findings"]
    assert printed["hangs_on"]


@pytest.mark.long
def test_what_analyze_prints_of_a_script_is_what_the_schema_says(
    printed: Any, tmp_path: Path
) -> None:
    """The scene has flights, contacts, findings, joints, and an unexplained sample."""
    scenes.record(SCENE, tmp_path / "script.rrd")
    validator = Draft202012Validator(strict(schema_of("analyze_script")))
    whole, analysis = map(
        printed, ("analyze script.rrd", "analyze script.rrd --body 1 --at 0.05 --at 0.1")
    )
    validator.validate(whole)
    validator.validate(analysis)
    (body,) = analysis["bodies"]
    assert len(body["flights"][0]["at"]) == 2
    assert body["contacts"][0]["by"][0]["body"] == "0_plane"
    assert "off-target" in [each["code"] for each in whole["findings"]]
    del whole["findings"][0]["code"]
    assert not validator.is_valid(whole)


SCENE = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("cube_small.urdf", [0, 0, 0.4])
k = p.loadURDF("kuka_iiwa/model.urdf", [1, 0, 0], useFixedBase=True)
p.setJointMotorControl2(k, 1, p.POSITION_CONTROL, 0.8, force=5)
p.setPhysicsEngineParameter(numSubSteps=2)
b = p.loadURDF("cube_small.urdf", [-1, 0, 0.1])
steps(30)
p.setPhysicsEngineParameter(numSubSteps=0)
steps(60)
"""


def test_what_info_prints_of_a_script_is_what_the_schema_says(printed: Any, tmp_path: Path) -> None:
    scenes.record(SCENE, tmp_path / "script.rrd")
    Draft202012Validator(strict(schema_of("info"))).validate(printed("info script.rrd"))


def test_what_view_prints_is_what_the_schema_says(
    printed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drop_physics.stages.view.show", lambda _: None)
    monkeypatch.setenv("DISPLAY", ":0")
    Draft202012Validator(strict(schema_of("view"))).validate(printed("view run.rrd --web"))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_key_is_described(command: str) -> None:
    assert list(undescribed(schema_of(command))) == []


def undescribed(schema: Any, path: str = "") -> Iterator[str]:
    """Yield the keys of a schema that have no description."""
    for key, one in schema.get("properties", {}).items():
        if not one.get("description"):
            yield f"{path}{key}"
        yield from undescribed(one.get("items", one), f"{path}{key}.")


def test_every_entry_of_the_recordings_reference_is_described() -> None:
    page = (SCHEMAS.parent / "recording.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    assert len(rows) > 50
    assert [row for row in rows if row.endswith("|  |")] == []


def test_a_recording_is_read_as_its_reference_says(tmp_path: Path, standard: Run) -> None:
    page = blocks((SCHEMAS.parent / "recording.md").read_text(encoding="utf-8"))
    (code,) = (one.text for one in page if one.kind == "python")
    (shown,) = (one.text for one in page if one.kind == "text")
    (tmp_path / "recordings").mkdir()
    shutil.copy(standard.simulation.recording, tmp_path / "recordings/run.rrd")
    assert run_python(code, tmp_path) == [shown]
    assert standard.analysis.impact is not None
    depth_m = standard.analysis.impact.penetration_m
    assert depth_m is not None
    assert f"distance {-depth_m:.4f} m" in shown


def test_a_schema_misses_a_key_that_stays_and_lets_a_new_one_pass(printed: Any) -> None:
    analysis = printed("analyze run.rrd")
    validator = Draft202012Validator(schema_of("analyze"))
    validator.validate(analysis | {"more": 1})
    for path in (
        ["at"],
        ["at", 0, "terms_m", "damping"],
        ["impact", "penetration_m"],
        ["scenario", "timestep_s"],
        ["findings", 0, "code"],
    ):
        broken = copy.deepcopy(analysis)
        inner: Any = broken
        for step in path[:-1]:
            inner = inner[step]
        del inner[path[-1]]
        assert not validator.is_valid(broken), path
    assert not validator.is_valid(analysis | {"at": [{"time_s": "0.3"}]})
