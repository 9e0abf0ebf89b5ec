"""`drop export`: other tools read the values that the script saw and the recording holds."""

from __future__ import annotations

import json
import math
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from command import drop_here
from drop_physics.files.mcap_file import SCHEMAS, written_mcap

pytestmark = pytest.mark.pybullet

SCRIPT = """
import json, pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
cube = p.loadURDF("cube_small.urdf", [1, 0, 0.03])
doll = p.loadURDF("humanoid/humanoid.urdf", [0, 3, 3], globalScaling=0.25)
seen = []
def look():
    joint, base = p.getJointState(arm, 1), p.getBasePositionAndOrientation(cube)
    seen.append([joint[0], joint[1], base[0], base[1], len(p.getContactPoints(0, cube))])
for _ in range(60):
    look()
    p.stepSimulation()
look()
json.dump(seen, open("seen.json", "w"))
"""
STEPS = 61


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[list[Any]]]:
    """Return the folder of the recording and its tables, and the values that the script saw."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "look.py").write_text(SCRIPT)
    done = drop_here("record", "--out", "run.rrd", "look.py", folder=folder)
    assert done.returncode == 0, done.stderr
    done = drop_here("export", "run.rrd", "--json", folder=folder)
    files = json.loads(done.stdout)["files"]
    assert list(files) == ["run.states.csv", "run.joints.csv", "run.contacts.csv"]
    assert files["run.states.csv"] == len(pl.read_csv(folder / "run.states.csv"))
    return folder, json.loads((folder / "seen.json").read_text())


def test_tables_hold_what_the_script_saw(exported: tuple[Path, list[list[Any]]]) -> None:
    folder, seen = exported
    states, joints, contacts = (
        pl.read_csv(folder / f"run.{name}.csv") for name in ("states", "joints", "contacts")
    )
    cube = states.filter(pl.col("label") == "2_cube_small")
    assert cube["step"].to_list() == [*range(STEPS)]
    assert cube["time_s"].to_list() == pytest.approx([step / 240 for step in range(STEPS)])
    assert cube.select("x_m", "y_m", "z_m").rows() == [tuple(row[2]) for row in seen]
    assert cube.select("qx", "qy", "qz", "qw").rows() == [tuple(row[3]) for row in seen]
    joint = joints.filter(pl.col("name") == "lbr_iiwa_joint_2")
    assert joint.select("position", "velocity").rows() == [tuple(row[:2]) for row in seen]
    assert joint["coordinate"].unique().to_list() == [0]
    ball = joints.filter(pl.col("name") == "neck", pl.col("step") == 3).sort("coordinate")
    assert ball["coordinate"].to_list() == [0, 1, 2, 3]  # a quaternion; and three velocities
    assert ball["velocity"].null_count() == 1
    touched = contacts.filter(pl.col("label_b") == "2_cube_small").group_by("step").len()
    found = dict(touched.rows())
    assert [found.get(step, 0) for step in range(STEPS)] == [row[4] for row in seen]
    assert set(contacts["link_name_a"]) == {"planeLink"}


@pytest.mark.needs("mcap")
def test_mcap_is_read_by_its_own_reader(exported: tuple[Path, list[list[Any]]]) -> None:
    from mcap.reader import make_reader

    folder, seen = exported
    done = drop_here("export", "run.rrd", "--out", "run.mcap", folder=folder)
    assert done.returncode == 0, done.stderr
    messages: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with (folder / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert schema.name == SCHEMAS[channel.topic][0]
            assert json.loads(schema.data)["type"] == "object"
            messages[channel.topic].append((message.log_time, json.loads(message.data)))
    times = [round(step / 240 * 1e9) for step in range(STEPS)]
    assert [time for time, _ in messages["/tf"]] == pytest.approx(times, abs=1)
    for (time, transforms), (_, _, position, orientation, _) in zip(
        messages["/tf"], seen, strict=True
    ):
        by_name = {each["child_frame_id"]: each for each in transforms["transforms"]}
        cube = by_name["2_cube_small"]
        assert [*cube["translation"].values()] == position
        assert [*cube["rotation"].values()] == orientation
        assert cube["timestamp"]["sec"] * 10**9 + cube["timestamp"]["nsec"] == time
        assert "1_model/lbr_iiwa_link_7" in by_name
    for (_, states), (position, velocity, *_) in zip(messages["/joint_states"], seen, strict=True):
        by_name = {each["name"]: each for each in states["joints"]}
        second = by_name["1_model/lbr_iiwa_joint_2"]
        assert (second["position"], second["velocity"]) == (position, velocity)
        assert len(by_name) == 7 + 4  # of the doll its knees and elbows: others are balls
    points = {time: len(each["contacts"]) for time, each in messages["/contacts"]}
    assert [points.get(time, 0) for time, _ in messages["/tf"]] == [row[4] for row in seen]


@pytest.mark.needs("mcap")
def test_mcap_has_no_number_that_json_lacks(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    path = tmp_path / "nan.mcap"
    with written_mcap(path, force=False) as write:
        write("/joint_states", -1.0, {"joints": [{"name": "a", "position": math.nan}]})
    with path.open("rb") as file:
        ((_, _, message),) = make_reader(file).iter_messages()
    assert message.log_time == 0
    assert json.loads(message.data)["joints"][0]["position"] is None


def test_without_the_package_it_says_what_to_install(
    exported: tuple[Path, list[list[Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, _ = exported
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    done = drop_here("export", "run.rrd", "--out", "other.mcap", folder=folder)
    assert done.returncode == 1
    assert "try: pip install mcap" in done.stderr
    assert not (folder / "other.mcap").exists()


def test_what_is_no_format_of_its_own_is_refused(exported: tuple[Path, list[list[Any]]]) -> None:
    folder, _ = exported
    done = drop_here("export", "run.rrd", "--out", "run.bag", folder=folder)
    assert done.returncode == 2
    assert "--out must end in .mcap, .csv or .parquet, got 'run.bag'" in done.stderr
    done = drop_here("export", "run.rrd", folder=folder)
    assert done.returncode == 1  # not over what is there
    assert "--force" in done.stderr
