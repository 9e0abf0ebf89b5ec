"""Comparison with a golden recording: exactly the differences are found and named.

Each script is recorded once for all tests; differences that none can cause here are made in the
data read back.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
import shutil
import textwrap
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow as pa
import pytest
import scenes
import scripts
from altered import otherwise
from conftest import Drop, Recorder, rerun_rrd, some
from drop_physics import Camera, Scenario, simulate
from drop_physics.compare import difference as checking
from drop_physics.compare.comparison import Comparison, compare
from drop_physics.compare.difference import Difference, Side
from drop_physics.compare.tolerance import IN_CONTACT_M
from drop_physics.errors import OutputError, RecordingError
from drop_physics.recording import rrd, sampled, schema
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import Recording, read
from drop_physics.report.check import first_words
from drop_physics.stages.check import Check, check
from drop_physics.stages.record import record_script
from drop_physics.stages.run import Run
from drop_physics.trace.tables import table_of
from jsonschema import Draft202012Validator
from PIL import Image
from rerun.chunk import Chunk, LazyChunkStream, RrdReader
from test_references import schema_of, strict

GOLDEN = Path(__file__).parents[1] / "recordings/golden/standard.rrd"


def side(recording: Recording) -> Side:
    drop = checking.DropInputs(recording.scenario, recording.engine)
    return Side(recording.seen, recording.origin, recording.ended or {}, drop)


def with_samples(golden: Side, **change: Any) -> Side:
    """Return one recording of a comparison with its samples or calls replaced."""
    return replace(golden, seen=otherwise(golden.seen, **change))


def with_bases(golden: Side, bases: pl.DataFrame) -> Side:
    return with_samples(golden, bases=bases)


def with_contacts(golden: Side, contacts: pl.DataFrame) -> Side:
    return with_samples(golden, contacts=contacts)


def with_drop(golden: Side, **change: object) -> Side:
    """Return one recording of a comparison with the engine's report replaced."""
    assert golden.drop is not None
    engine = replace(golden.drop.engine, **change)  # type: ignore[arg-type]
    return replace(golden, drop=golden.drop._replace(engine=engine))


def altered(golden: Side, column: str, step: int, by: float) -> Side:
    values = table_of(golden.seen.bases)[column].to_numpy().copy()
    values[step] += by
    return with_bases(golden, table_of(golden.seen.bases).with_columns(pl.Series(column, values)))


def touched(golden: Side, column: str, step: int, by: float) -> Side:
    """Change a value of the last contact point of a step."""
    contacts = table_of(golden.seen.contacts)
    values = contacts[column].to_numpy().copy()
    values[np.flatnonzero(contacts["step"] == step)[-1]] += by
    return with_contacts(golden, contacts.with_columns(pl.Series(column, values)))


def where(found: Difference | None) -> tuple[object, ...]:
    """Return step, column and both values of a difference."""
    assert found is not None
    return found.step, found.column, found.value, found.golden


def place(found: Difference | None) -> tuple[object, ...]:
    """Return the location of a difference, and both values."""
    assert found is not None
    return found.step, found.body, found.link, found.column, found.value, found.golden


# -- the golden recording -------------------------------------------------------------------------


def test_a_fresh_standard_drop_is_the_golden_one(standard: Run) -> None:
    result = check(standard.simulation.recording, GOLDEN)
    assert result.same, result
    assert result.comparison is not None
    assert result.comparison.largest_difference_m == 0.0
    assert result.frames is not None
    assert (result.frames.compared, result.frames.differing) == (41, 0)


def test_the_golden_recording_is_small_and_opens_with_its_layout() -> None:
    assert GOLDEN.stat().st_size < 350_000
    reader = RrdReader(GOLDEN)
    assert (len(reader.recordings()), len(reader.blueprints())) == (1, 1)


# -- the command ----------------------------------------------------------------------------------


def test_the_same_physics_exits_0(drop: Drop, tmp_path: Path, standard: Run) -> None:
    run = tmp_path / "run.rrd"
    run.write_bytes(standard.simulation.recording.read_bytes())
    done = drop("check", "run.rrd", "--against", GOLDEN, "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, done.stderr) == (0, "")
    assert result["same"] is True
    assert result["largest_difference_m"] == 0.0
    assert result["first_difference"] is None
    assert drop("check", "run.rrd", "--against", GOLDEN).stdout.startswith("same")


def test_settings_that_differ_in_a_late_digit_are_shown_with_it(recorded: Recorder) -> None:
    for change, shown in (
        ({"height_m": 1.0000000001}, "--height 1.0000000001, golden 1.0"),
        (
            {"velocity_m_s": (0.0, 0.0, 1.0000000001)},
            "--velocity (0.0, 0.0, 1.0000000001), golden (0.0, 0.0, 1.0)",
        ),
    ):
        golden = {} if "height_m" in change else {"velocity_m_s": (0.0, 0.0, 1.0)}
        comparison = compare(side(recorded(**change)), side(recorded(**golden)))
        found = Check(Path("run.rrd"), Path("golden.rrd"), 0.0, comparison, None)
        assert shown in str(found)


def test_other_physics_exits_3_and_names_the_setting(drop: Drop) -> None:
    drop("simulate", "--out", "run.rrd", "--no-camera", "--timestep", "1/480")
    done = drop("check", "run.rrd", "--against", GOLDEN, "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 3
    assert result["same"] is False
    assert result["differences"] == [{"name": "timestep_s", "value": 1 / 480, "golden": 1 / 240}]
    assert result["first_difference"] is None
    output = drop("check", "run.rrd", "--against", GOLDEN).stdout
    assert "setting     --timestep 1/480, golden 1/240\n" in output


def test_a_file_that_is_missing_or_unfinished_exits_1(drop: Drop, tmp_path: Path) -> None:
    missing = drop("check", "no.rrd", "--against", GOLDEN)
    assert (missing.returncode, len(missing.stderr.splitlines())) == (1, 1)
    (tmp_path / "run.rrd.part").write_bytes(GOLDEN.read_bytes()[:100_000])
    partial = drop("check", "run.rrd.part", "--against", GOLDEN)
    assert (partial.returncode, len(partial.stderr.splitlines())) == (1, 1)
    wrong = drop("check", GOLDEN, "--against", GOLDEN, "--tolerance", "nan")
    assert (wrong.returncode, len(wrong.stderr.splitlines())) == (2, 1)


# -- settings, versions ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"timestep_s": 1 / 480}, "timestep_s"),
        ({"duration_s": 0.5}, "duration_s"),
        ({"linear_damping": 0.04}, "linear_damping"),
        ({"gravity_m_s2": -1.62}, "gravity_m_s2"),
        ({"mass_kg": 0.2}, "mass_kg"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_another_scenario_is_another_experiment(
    recorded: Recorder, change: dict[str, float], name: str
) -> None:
    result = compare(side(recorded(**change)), side(recorded()))
    assert not result.same
    assert result.differences[0].column == name


def test_another_version_is_reported_but_is_not_a_difference(recorded: Recorder) -> None:
    golden = side(recorded())
    newer = with_drop(golden, pybullet_version="3.3.0")
    result = compare(newer, golden)
    assert result.same
    assert [(version.name, version.value) for version in result.versions] == [
        ("pybullet_version", "3.3.0")
    ]


def test_the_same_body_under_another_name_is_the_same_body(recorded: Recorder) -> None:
    golden = side(recorded())
    assert golden.drop is not None
    scenario = replace(golden.drop.scenario, body="/elsewhere/cube.urdf")
    moved = replace(golden, drop=golden.drop._replace(scenario=scenario))
    assert compare(moved, golden).same
    other = with_drop(moved, body_sha256="another")
    assert {difference.column for difference in compare(other, golden).differences} == {
        "body",
        "body_sha256",
    }


@pytest.mark.parametrize(
    ("name", "value"),
    [("mass_kg", 1e308), ("restitution", 1e308), ("solver_iterations", 51), ("timestep_s", 1.0)],
)
def test_what_the_engine_reports_is_compared_where_the_scenario_leaves_it(
    recorded: Recorder, name: str, value: float
) -> None:
    golden = side(recorded())
    result = compare(with_drop(golden, **{name: value}), golden)
    assert not result.same
    assert [(difference.column, difference.value) for difference in result.differences] == [
        (f"engine.{name}", value)
    ]


@pytest.mark.parametrize("column", ["x_m", "z_m", "qw", "vz_m_s", "wy_rad_s"])
def test_one_bit_in_the_air_is_found_and_named(recorded: Recorder, column: str) -> None:
    golden = side(recorded())
    one_bit = float(np.spacing(table_of(golden.seen.bases)[column][50])) or 5e-324
    result = compare(altered(golden, column, 50, one_bit), golden)
    assert result.first is not None
    assert (result.first.step, result.first.column) == (50, column)


def test_in_contact_a_nanometre_passes_and_no_more(recorded: Recorder) -> None:
    assert IN_CONTACT_M == 1e-9  # docs/ci.md says so
    golden = side(recorded())
    assert compare(altered(golden, "z_m", 200, 0.5 * IN_CONTACT_M), golden).same
    beyond = compare(altered(golden, "z_m", 200, 2 * IN_CONTACT_M), golden)
    assert beyond.first is not None
    assert beyond.first.step == 200
    assert beyond.largest_difference_m == pytest.approx(2 * IN_CONTACT_M, rel=1e-6)
    # A velocity may be off by what moves the body a nanometre in a step.
    fast = IN_CONTACT_M * 240
    assert compare(altered(golden, "vz_m_s", 200, 0.5 * fast), golden).same
    assert not compare(altered(golden, "vz_m_s", 200, 2 * fast), golden).same


def test_the_tolerance_of_a_column_is_what_moves_the_body_a_nanometre(
    recorded: Recorder,
) -> None:
    """The cube's centre is 0.025 m above its floor, its mass is 0.1 kg, a step is 1/240 s."""
    golden = side(recorded())
    for column, allowed in (
        ("y_m", 1e-9),
        ("qx", 1e-9 / 0.025 / 2),
        ("vy_m_s", 1e-9 * 240),
        ("wz_rad_s", 1e-9 / 0.025 * 240),
    ):
        assert compare(altered(golden, column, 200, 0.9 * allowed), golden).same, column
        beyond = compare(altered(golden, column, 200, 1.1 * allowed), golden)
        assert beyond.first is not None, column
        assert (beyond.first.step, beyond.first.column) == (200, column)
    for column, allowed in (
        ("ax_m", 1e-9),
        ("bz_m", 1e-9),
        ("distance_m", 1e-9),
        ("nz", 1e-9 / 0.025),
        ("normal_force_n", 1e-9 * 0.1 * 240**2),
    ):
        assert compare(touched(golden, column, 200, 0.9 * allowed), golden).same, column
        beyond = compare(touched(golden, column, 200, 1.1 * allowed), golden)
        assert beyond.first is not None, column
        assert (beyond.first.step, beyond.first.column) == (200, f"contact_{column}")


def test_friction_is_compared_as_one_force(recorded: Recorder) -> None:
    """Friction directions are arbitrary if the force is small; only the force moves the body."""
    golden = side(recorded())
    turned = table_of(golden.seen.contacts).with_columns(
        friction_1_n=-pl.col("friction_1_n"),
        f1x=-pl.col("f1x"),
        f1y=-pl.col("f1y"),
        f1z=-pl.col("f1z"),
    )
    assert compare(with_contacts(golden, turned), golden).same
    allowed_n = 1e-9 * 0.1 * 240**2
    x, y, _ = golden.seen.contacts["friction_1_direction"][-1]
    axis = "x" if abs(x) > abs(y) else "y"
    assert compare(touched(golden, "friction_1_n", 240, 0.9 * allowed_n), golden).same
    beyond = compare(touched(golden, "friction_1_n", 240, 1.1 * allowed_n), golden)
    assert beyond.first is not None
    assert (beyond.first.step, beyond.first.column) == (240, f"contact_friction_{axis}_n")


@pytest.mark.parametrize("column", ["body_a", "link_b"])
def test_which_parts_touch_is_compared_with_no_tolerance(recorded: Recorder, column: str) -> None:
    golden = side(recorded())
    result = compare(touched(golden, column, 200, 1), golden, tolerance_m=1e3)
    assert result.first is not None
    assert (result.first.step, result.first.column) == (200, f"contact_{column}")


def test_the_largest_difference_is_that_of_any_axis_and_either_sign(recorded: Recorder) -> None:
    golden = side(recorded())
    apart = altered(altered(golden, "x_m", 20, -0.25), "z_m", 70, 0.125)
    result = compare(apart, golden)
    assert result.largest_difference_m == 0.25
    (largest,) = result.largest
    assert (largest.body, largest.quantity, largest.step) == ("box", "position", 20)


def test_a_difference_gives_the_value_here_and_in_the_golden_recording(
    recorded: Recorder,
) -> None:
    golden = side(recorded())
    other = altered(golden, "z_m", 50, 0.5)
    here, there = table_of(other.seen.bases)["z_m"][50], table_of(golden.seen.bases)["z_m"][50]
    assert where(compare(other, golden).first) == (50, "z_m", here, there)
    assert where(compare(golden, other).first) == (50, "z_m", there, here)
    (result,) = compare(side(recorded(duration_s=0.5)), golden).differences
    assert where(result) == (None, "duration_s", 0.5, 1.0)


def test_a_contact_that_only_one_of_them_has_differs(recorded: Recorder) -> None:
    golden = side(recorded())
    early = table_of(golden.seen.contacts).head(1).with_columns(step=pl.lit(50, pl.Int64))
    touching = with_contacts(golden, pl.concat([early, table_of(golden.seen.contacts)]))
    for mine, theirs, value, there in (
        (touching, golden, 1.0, 0.0),
        (golden, touching, 0.0, 1.0),
    ):
        result = compare(mine, theirs, tolerance_m=1.0)
        assert where(result.first) == (50, "contact_points", value, there)
    less = with_contacts(golden, table_of(golden.seen.contacts).head(-1))
    assert where(compare(less, golden, tolerance_m=1.0).first) == (240, "contact_points", 3.0, 4.0)
    assert not compare(with_contacts(golden, table_of(golden.seen.contacts).clear()), golden).same


def test_what_differs_first_comes_first(recorded: Recorder) -> None:
    """Once the number of contact points differs, later differences of points are not reported."""
    golden = side(recorded())
    less = with_contacts(golden, table_of(golden.seen.contacts).filter(pl.col("step") != 150))
    assert where(compare(less, golden).first) == (150, "contact_points", 0.0, 4.0)
    for step, column in ((149, "contact_distance_m"), (151, "contact_points")):
        result = compare(touched(less, "distance_m", step, 1e-3), golden).first
        assert result is not None
        assert (result.step, result.column) == (min(step, 150), column)
    result = compare(touched(altered(golden, "z_m", 150, 1e-3), "distance_m", 150, 1), golden).first
    assert result is not None
    assert (result.step, result.column) == (150, "z_m")


def test_a_joint_that_differs_is_named(recorded: Recorder) -> None:
    golden = side(recorded(body="r2d2.urdf", height_m=0.5, duration_s=0.25))
    joints = golden.seen.joints[0]
    position = joints.position.copy()
    position[20, 3] += 1e-3
    turned = {0: replace(joints, position=position)}
    result = compare(with_samples(golden, joints=turned), golden)
    assert result.first is not None
    assert (result.first.step, result.first.body, result.first.column) == (
        20,
        "box",
        "joint_position",
    )
    moving = [joint for joint in golden.seen.bodies[0].joints if joint.widths[0]]
    assert (result.first.link, result.first.part) == (moving[3].link, moving[3].name)
    largest = {each.quantity: each for each in result.largest}
    assert (largest["joint_position"].difference, largest["joint_position"].unit) == (
        pytest.approx(1e-3),
        "rad",
    )
    assert largest["orientation"].difference == pytest.approx(1e-3)
    assert largest["orientation"].link == result.first.link
    assert compare(with_samples(golden, joints=turned), golden, tolerance_m=0.01).same


def test_a_tolerance_is_a_length(recorded: Recorder) -> None:
    golden = side(recorded())
    moved = altered(golden, "z_m", 50, 1e-6)
    assert compare(moved, golden, tolerance_m=2e-6).same
    assert not compare(moved, golden, tolerance_m=0.5e-6).same
    aside = altered(altered(golden, "x_m", 50, 0.3e-6), "y_m", 50, 0.4e-6)
    assert compare(aside, golden).largest_difference_m == pytest.approx(0.5e-6)
    assert compare(aside, golden, tolerance_m=0.51e-6).same
    assert where(compare(aside, golden, tolerance_m=0.49e-6).first) == (50, "y_m", 0.4e-6, 0.0)
    resting = altered(golden, "z_m", 200, 1e-6)  # in contact, too
    assert compare(resting, golden, tolerance_m=2e-6).same
    assert not compare(resting, golden, tolerance_m=0.5e-6).same


def test_a_tolerance_takes_a_quaternion_and_its_negative_for_the_same(recorded: Recorder) -> None:
    golden = side(recorded())
    turned = pl.when(pl.col("step") == 50).then(-pl.col("qw")).otherwise(pl.col("qw"))
    mine = with_bases(golden, table_of(golden.seen.bases).with_columns(qw=turned))
    assert compare(mine, golden, tolerance_m=1e-9).same
    assert where(compare(mine, golden).first) == (50, "qw", -1.0, 1.0)


def test_a_fused_multiply_passes_on_machines_other_than_x86(recorded: Recorder) -> None:
    golden = side(recorded())
    arm = with_drop(golden, machine="aarch64")
    assert compare(altered(arm, "z_m", 50, 5e-13), golden).same
    assert not compare(altered(arm, "z_m", 50, 5e-12), golden).same
    assert not compare(altered(golden, "z_m", 50, 5e-13), golden).same


# -- frames ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictured") / "run.rrd"
    simulate(Scenario(duration_s=0.1), path, camera=Camera(capture_every=6, size_px=(64, 48)))
    return path


def test_frames_are_compared_by_their_pixels(
    pictured: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(recording: Recording) -> list[tuple[int, bytes]]:
        result = list(frames(recording))
        if recording.path == pictured:
            return result
        again = []
        for step, png in result:
            stream, image = io.BytesIO(), Image.open(io.BytesIO(png)).convert("RGB")
            if step == 12 and spoil:
                image.putpixel((3, 4), (255, 0, 255))
            image.save(stream, "png", compress_level=0)
            again.append((step, stream.getvalue()))
        return again

    copy = pictured.with_name("copy.rrd")
    copy.write_bytes(pictured.read_bytes())
    monkeypatch.setattr("drop_physics.stages.check.frames", other)
    spoil = False
    assert check(pictured, copy).same
    spoil = True
    result = check(pictured, copy)
    assert not result.same
    assert result.first is not None
    assert (result.first.step, result.first.column) == (12, "frame")


def test_a_frame_is_only_ever_opened_as_a_png(
    pictured: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pillow would pass an EPS file to Ghostscript if it were free to guess the format."""
    stream = io.BytesIO()
    Image.new("RGB", (64, 48)).save(stream, "eps")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("Ghostscript was asked")

    def other(recording: Recording) -> list[tuple[int, bytes]]:
        return [
            (step, png if recording.path == pictured else stream.getvalue())
            for step, png in frames(recording)
        ]

    copy = pictured.with_name("copy.rrd")
    copy.write_bytes(pictured.read_bytes())
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", never)
    monkeypatch.setattr("drop_physics.stages.check.frames", other)
    with pytest.raises(RecordingError, match="must be a PNG"):
        check(copy, pictured)


def test_without_frames_the_rest_is_compared_and_a_note_says_so(
    pictured: Path, tmp_path: Path
) -> None:
    simulate(Scenario(duration_s=0.1), tmp_path / "bare.rrd", camera=None)
    result = check(tmp_path / "bare.rrd", pictured)
    assert result.same
    assert result.frames is not None
    assert result.frames.compared == 0
    assert "bare.rrd has no frames" in str(result.frames.why)


# -- update ---------------------------------------------------------------------------------------


def test_update_writes_the_golden_anew_and_whole(drop: Drop, tmp_path: Path) -> None:
    drop("simulate", "--out", "old.rrd", "--no-camera", "--duration", "0.1")
    drop("simulate", "--out", "new.rrd", "--no-camera", "--duration", "0.2")
    first = drop("check", "old.rrd", "--against", "golden.rrd", "--update", "--json")
    assert (first.returncode, json.loads(first.stdout)["updated"]) == (0, True)
    assert drop("check", "old.rrd", "--against", "golden.rrd").returncode == 0
    assert drop("check", "new.rrd", "--against", "golden.rrd").returncode == 3
    second = drop("check", "new.rrd", "--against", "golden.rrd", "--update", "--json")
    result = json.loads(second.stdout)
    assert (second.returncode, result["same"]) == (0, False)
    assert [difference["name"] for difference in result["differences"]] == ["duration_s"]
    assert drop("check", "new.rrd", "--against", "golden.rrd").returncode == 0
    assert {file.name for file in tmp_path.iterdir()} == {
        *("old.rrd", "new.rrd", "golden.rrd", "golden.md")
    }
    assert read(tmp_path / "golden.rrd").states.equals(read(tmp_path / "new.rrd").states)


@pytest.mark.parametrize("kind", ["text", "nothing", "picture", "layer", "merged", "a link"])
def test_update_replaces_recordings_only(
    tmp_path: Path, recorded: Recorder, standard: Run, kind: str
) -> None:
    """Any other file named .rrd is kept, even a layer."""
    run, golden = recorded().path, tmp_path / "golden.rrd"
    if kind == "layer":
        golden.write_bytes(standard.analysis.layer.read_bytes())
    elif kind == "merged":
        rerun_rrd("merge", run, recorded(duration_s=0.5).path, "-o", golden)
    elif kind == "a link":
        golden.symlink_to(tmp_path / "nowhere")
    else:
        golden.write_bytes({"text": b"my notes", "nothing": b"", "picture": b"\x89PNG"}[kind])
    before = golden.lstat()
    with pytest.raises(OutputError, match=r"golden\.rrd is not a recording made by drop"):
        check(run, golden, update=True)
    after = golden.lstat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)
    assert [file.name for file in tmp_path.iterdir()] == ["golden.rrd"]


@pytest.mark.parametrize("kind", ["whole", "packed", "unfinished", "another schema"])
def test_update_replaces_a_recording_that_need_not_be_one_to_compare_with(
    tmp_path: Path, recorded: Recorder, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    run, golden = recorded().path, tmp_path / "golden.rrd"
    if kind == "packed":
        golden.write_bytes(GOLDEN.read_bytes())
    elif kind == "another schema":
        with monkeypatch.context() as other:
            other.setattr("drop_physics.recording.schema.SCHEMA_VERSION", 0)
            simulate(Scenario(), golden, camera=None)
    else:
        golden.write_bytes(run.read_bytes()[: None if kind == "whole" else -5000])
    assert check(run, golden, update=True).updated
    assert check(run, golden).same


def test_update_keeps_the_golden_where_the_new_one_cannot_be_written(
    tmp_path: Path, recorded: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    golden = tmp_path / "golden.rrd"
    golden.write_bytes(GOLDEN.read_bytes())

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("drop_physics.recording.sealing.pack", full)
    with pytest.raises(OutputError, match="No space left"):
        check(recorded().path, golden, update=True)
    monkeypatch.setattr(
        "drop_physics.recording.sealing.pack", lambda _, path: path.write_bytes(b"nonsense")
    )
    with pytest.raises(RecordingError):
        check(recorded().path, golden, update=True)
    monkeypatch.undo()

    # Rerun's command line does not notice a full disk: its output is cut off.
    def cut(*arguments: object) -> str:
        Path(str(arguments[-1])).write_bytes(GOLDEN.read_bytes()[:-100])
        return ""

    monkeypatch.setattr("drop_physics.recording.sealing._rerun", cut)
    with pytest.raises(OutputError, match="its end is missing"):
        check(recorded().path, golden, update=True)
    assert golden.read_bytes() == GOLDEN.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["golden.rrd"]


# -- scripts --------------------------------------------------------------------------------------

Record = Callable[..., Path]

BOX = """
import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1), -1, [0, 0, 0.2])
p.changeDynamics(ball, -1, linearDamping=0)
arm = p.loadURDF("arm.urdf", useFixedBase=True)
for step in range(60):
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, targetVelocity=1, force=5)
    p.stepSimulation()
    if step == 20:
        p.resetBaseVelocity(ball, [0.5, 0, 0])
p.getCameraImage(16, 16, p.computeViewMatrix([1, 1, 1], [0, 0, 0], [0, 0, 1]),
                 p.computeProjectionMatrixFOV(60, 1, 0.1, 10))
"""


ARM = """<robot name="arm"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 0.2"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/>
<origin xyz="2 0 1"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """Return a function that records `BOX` with changes as `sim.py`, once per set of changes."""
    folder = tmp_path_factory.mktemp("scripts")

    @cache
    def record(*changes: tuple[str, str], mass: float = 1.0, run: int = 0, **how: Any) -> Path:
        text = BOX
        for before, after in changes:
            assert before in text, before
            text = text.replace(before, after)
        out = folder / f"{len(list(folder.iterdir()))}-{run}.rrd"
        work = folder / out.stem
        work.mkdir()
        work.joinpath("sim.py").write_text(text)
        work.joinpath("arm.urdf").write_text(ARM.format(mass=mass))
        if set(how) <= {"arguments"}:
            scenes.record_file(work / "sim.py", out, *how.get("arguments", ()))
            return out
        with contextlib.chdir(work):
            record_script("sim.py", out=out, **how)
        return out

    return record


@pytest.fixture(scope="session")
def golden(recording: Record) -> Path:
    return recording()


def compared(path: Path, golden: Path, **how: Any) -> Comparison:
    result = check(path, golden, **how).comparison
    assert result is not None
    return result


def script_side(path: Path) -> Side:
    read_back = read(path)
    return Side(read_back.seen, read_back.origin, read_back.ended or {})


CLOTH = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadSoftBody("cloth_z_up.obj", basePosition=[0, 0, 1.0], scale=0.5, mass=1, useMassSpring=1)
for _ in range(24):
    p.stepSimulation()
"""


def recorded_script(script: str, path: Path, *arguments: str) -> Path:
    """Record a script, written to a file beside the recording."""
    source = path.parent / "sim.py"
    source.write_text(textwrap.dedent(script))
    scenes.record_file(source, path, *arguments)
    return path


GRAVITY = "p.setGravity(0, 0, -9.81)\n"


TURNS = """
    import sys, pybullet as p
    clients = [p.connect(p.DIRECT) for _ in range(3)]
    turns = clients if sys.argv[1] == "forward" else clients[::-1]
    def balls(c):
        p.setGravity(0, 0, -9.81 - c, physicsClientId=c)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=c)
        p.createMultiBody(0, ball, physicsClientId=c)
        p.createMultiBody(1 + c, ball, basePosition=[0, 0, 0.19 + 0.02 * c], physicsClientId=c)
    for c in turns:
        balls(c)
    for i in range(30):
        for c in turns:
            p.stepSimulation(physicsClientId=c)
    """


def test_a_script_and_a_drop_are_not_compared(golden: Path, drop: Drop, tmp_path: Path) -> None:
    simulate(Scenario(duration_s=0.1), tmp_path / "drop.rrd", camera=None)
    for run, against in ((golden, "drop.rrd"), ("drop.rrd", golden)):
        done = drop("check", run, "--against", against)
        assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
        assert "must be the recording of a" in done.stderr
        done = drop("check", run, "--against", against, "--update")
        assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert read(golden).ended is not None


def test_missing_files_unfinished_ones_and_bad_tolerances_are_one_line(
    golden: Path, drop: Drop, tmp_path: Path
) -> None:
    done = drop("check", golden, "--against", "no.rrd")
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert done.stderr.endswith("--against no.rrd --update\n")
    closing = f"__properties/{schema.RECORDING_PROPERTY}"
    rewritten(golden, tmp_path / "run.rrd.part", closing, lambda _: [])
    done = drop("check", "run.rrd.part", "--against", golden)
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert "never finished" in done.stderr
    done = drop("check", golden, "--against", golden, "--tolerance", "nan")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


def test_update_makes_it_the_golden_recording(
    recording: Record, golden: Path, drop: Drop, tmp_path: Path
) -> None:
    assert drop("check", golden, "--against", "new.rrd", "--update").returncode == 0
    assert check(golden, tmp_path / "new.rrd").same
    changed = recording(("-9.81", "-1.6"))
    done = drop("check", changed, "--against", "new.rrd", "--update", "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, result["same"], result["updated"]) == (0, False, True)
    assert check(changed, tmp_path / "new.rrd").same
    tmp_path.joinpath("text.rrd").write_text("not a recording")
    with pytest.raises(OutputError, match=r"text\.rrd is not a recording made by drop"):
        check(golden, tmp_path / "text.rrd", update=True)


@pytest.mark.parametrize(
    ("change", "first", "call"),
    some(
        [
            (
                ("-9.81", "-1.6"),
                (1, "1_sphere", -1, "z_m", 0.2 - 1.6 / 240**2, 0.2 - 9.81 / 240**2),
                "setGravity(0, 0, -1.6) at sim.py:4, golden 0, 0, -9.81",
            ),
            (
                ("p.createMultiBody(1,", "p.createMultiBody(2,"),
                (48, "1_sphere", -1, "contact_normal_force_n", 427.428, 213.714),
                "createMultiBody(2, 1, -1, [0, 0, 0.2]) at sim.py:6, golden 1, 1, -1, [0, 0, 0.2]",
            ),
            (
                ("[0, 0, 0.2]", "[0, 0, 0.25]"),
                (0, "1_sphere", -1, "z_m", 0.25, 0.2),
                "createMultiBody(1, 1, -1, [0, 0, 0.25]) at sim.py:6, golden 1, 1, -1, [0, 0, 0.2]",
            ),
            (
                ("[0.5, 0, 0]", "[0.7, 0, 0]"),
                (22, "1_sphere", -1, "x_m", 0.7 / 240, 0.5 / 240),
                "resetBaseVelocity(1, [0.7, 0, 0]) at sim.py:13, golden 1, [0.5, 0, 0]",
            ),
            (
                ("range(60)", "range(50)"),
                (51, "1_sphere", -1, "there", 0.0, 1.0),
                None,
            ),
        ],
        1,
    ),
)
def test_what_differs_first_is_named_and_so_is_the_call(
    recording: Record,
    golden: Path,
    change: tuple[str, str],
    first: tuple[object, ...],
    call: str | None,
) -> None:
    """Lines inserted before the call do not count as a difference."""
    for lines in ((), (("import pybullet as p", "import pybullet as p\n"),)):
        result = compared(recording(change, *lines), golden)
        *where, value, other = place(result.first)
        assert (*where,) == first[:4]
        assert (value, other) == pytest.approx(first[4:])
        assert result.first is not None
        assert result.first.time_s == pytest.approx(first[0] / 240)  # type: ignore[operator]
        assert not result.same
        other = result.other_call
        assert other is not None
        assert other.golden is not None
        if call is None:
            assert other.value is None
            continue
        assert other.value is not None
        value, line = other.value, other.value.line - len(lines)
        assert call == (
            f"{value.function}({value.arguments}) at {value.file}:{line}, golden "
            f"{other.golden.arguments}"
        )
        assert other.golden.line == line


def test_what_the_engine_does_not_report_shows_in_the_motion(
    recording: Record, golden: Path
) -> None:
    result = compared(recording(("linearDamping=0)", "linearDamping=0.1)")), golden)
    assert result.first is not None
    assert (result.first.step, result.first.body, result.first.column) == (2, "1_sphere", "z_m")
    assert result.other_call is not None
    assert result.other_call.value is not None
    assert result.other_call.value.arguments == "1, -1, linearDamping=0.1"


def test_nothing_of_two_small_recordings_is_decoded_twice(
    standard: Run, pictured: Path, golden: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Larger recordings are read twice, in chunks, to limit the memory."""
    decoded = 0
    batch_of = rrd._batch

    def counted(data: pa.Buffer) -> pa.RecordBatch:
        nonlocal decoded
        decoded += 1
        return batch_of(data)

    monkeypatch.setattr(rrd, "_batch", counted)
    for path in (standard.simulation.recording, pictured, golden):
        chunks = sum(1 for _ in rrd.chunks(path))
        decoded = 0
        assert check(path, path).same
        assert decoded == 2 * chunks
    monkeypatch.setattr(sampled, "HELD_BYTES", 0)
    decoded = 0
    assert check(golden, golden).same
    assert decoded > 2 * chunks


def test_a_joint_of_a_robot_is_named(recording: Record, golden: Path) -> None:
    path = recording(("targetVelocity=1", "targetVelocity=2"))
    result = compared(path, golden)
    assert result.first is not None
    assert (result.first.body, result.first.link, result.first.part) == ("2_arm", 0, "hinge")
    assert result.first.column == "joint_position"
    words = f"step {result.first.step}, hinge {result.first.difference:+.2g} rad"
    assert first_words(check(path, golden)) == words
    largest = {each.quantity: each for each in result.largest}
    # It is 0.24 rad ahead after 60 steps, its centre of mass 0.2 m from the hinge.
    turn = largest["joint_position"]
    assert (turn.unit, turn.step, turn.part) == ("rad", 60, "hinge")
    assert largest["position"].difference == pytest.approx(0.4 * math.sin(turn.difference / 2))
    assert (largest["position"].unit, largest["position"].part) == ("m", "rod")
    assert result.largest_difference_m == largest["position"].difference


def test_what_it_prints_of_a_script(recording: Record, golden: Path, drop: Drop) -> None:
    changed = recording(("[0, 0, 0.2]", "[0, 0, 0.25]"))
    done = drop("check", changed, "--against", golden, "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 3
    assert result["first_difference"] == {
        "step": 0,
        "body": "1_sphere",
        "link": -1,
        "column": "z_m",
        "value": 0.25,
        "golden": 0.2,
        "difference": pytest.approx(0.05),
        "time_s": 0.0,
        "part": None,
    }
    assert set(result["call_before"]) == {
        "at",
        "client",
        "function",
        "arguments",
        "file",
        "line",
        "raised",
    }
    assert result["other_call"]["golden"]["line"] == 6
    assert [each["name"] for each in result["script"]] == ["script_sha256"]
    schema_of_it = strict(schema_of("check"))
    assert not list(Draft202012Validator(schema_of_it).iter_errors(result))
    output = drop("check", changed, "--against", golden).stdout
    assert "first       step 0, 0 s, 1_sphere, z_m: 0.25, golden 0.2 (+0.05)\n" in output
    assert "call        " in output
    ended = drop("check", recording(steps=50), "--against", golden).stdout
    assert "same        to the bit in the 50 steps that both make; golden makes 60" in ended
    assert "positions   identical, as far as both go\n" in ended
    sets = ("p.setGravity(", "p.setPhysicsEngineParameter(numSolverIterations=60)\np.setGravity(")
    output = drop("check", recording(sets), "--against", golden).stdout
    assert "engine.numSolverIterations: 60.0, golden 50.0" in output
    assert "set_" not in output


def test_the_same_script_twice_is_the_same_and_a_comment_too(
    recording: Record, golden: Path, drop: Drop
) -> None:
    moved = recording(("import pybullet as p\n", "import pybullet as p\n# a comment\n"))
    for run in (recording(run=1), moved):
        done = drop("check", run, "--against", golden, "--json")
        result = json.loads(done.stdout)
        assert (done.returncode, done.stderr) == (0, "")
        assert (result["same"], result["largest_difference_m"]) == (True, 0.0)
        assert result["frames"] == {"compared": 1, "differing": 0, "first_step": None, "why": None}
        for key in ("first_difference", "call_before", "other_call"):
            assert result[key] is None
        assert (result["differences"], result["largest"]) == ([], [])
    assert "its text differs" in drop("check", moved, "--against", golden).stdout


@pytest.mark.long
def test_random_numbers_are_said(recording: Record, drop: Drop) -> None:
    drawing = (
        ("import pybullet as p", "import pybullet as p, random"),
        ("[0, 0, 0.2]", "[0, 0, random.random()]"),
    )
    one, two = (recording(*drawing, run=run) for run in (1, 2))
    assert compared(one, two).unseeded == ["random.random at sim.py:6"]
    done = drop("check", one, "--against", two)
    assert "draws       unseeded random numbers at random.random at sim.py:6" in done.stdout
    seeded = [recording(*drawing, run=run, seed=3) for run in range(2)]
    assert compared(*seeded).same


@pytest.mark.long
@pytest.mark.parametrize("steps", [1, 7, 1000])
def test_pieces_of_any_length_say_the_same(
    recording: Record, golden: Path, monkeypatch: pytest.MonkeyPatch, steps: int
) -> None:
    changed = recording(("[0.5, 0, 0]", "[0.7, 0, 0]"))
    whole = compared(changed, golden)
    monkeypatch.setattr("drop_physics.trace.history.Seen.piece_steps", lambda _: steps)
    assert repr(compared(changed, golden)) == repr(whole)  # nan is not nan
    shorter = compared(recording(steps=50), golden)
    assert place(shorter.first) == (51, "1_sphere", -1, "there", 0.0, 1.0)
    assert shorter.largest_difference_m == 0.0


def test_a_constraint_whose_force_differs_is_named(tmp_path: Path) -> None:
    text = """
        import pybullet as p
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81)
        box = p.createMultiBody(1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1] * 3))
        p.createConstraint(box, -1, -1, -1, p.JOINT_POINT2POINT, [0] * 3, [0, 0, .2], [0] * 3)
        for _ in range(10):
            p.stepSimulation()
        """
    theirs = script_side(recorded_script(text, tmp_path / "held.rrd"))
    whole = theirs.seen.sampled.piece(0, 100)
    ((key, (steps, forces)),) = whole.forces.items()
    other = forces.copy()
    other[4, 2] += 1.0
    mine = with_samples(theirs, forces={key: (steps, other)})
    result = compare(mine, theirs)
    assert result.first is not None
    assert (result.first.step, result.first.column) == (steps[4], f"constraints.{key[1]}.2")
    assert result.first.difference == pytest.approx(1.0)
    assert compare(mine, theirs, tolerance_m=1e-9).same


def test_inputs_after_the_samples_differ_are_not_the_cause(recording: Record, golden: Path) -> None:
    """The script pushes harder the larger the error; only the first cause is reported."""
    steering = (
        "    p.stepSimulation()",
        "    z = p.getBasePositionAndOrientation(ball)[0][2]\n"
        "    p.applyExternalForce(ball, -1, [0, 0, 0.3 - z], [0, 0, 0], p.LINK_FRAME)\n"
        "    p.stepSimulation()",
    )
    result = compared(recording(steering, ("-9.81", "-9.8")), recording(steering))
    assert [difference.column for difference in result.differences] == [
        "engine.gravityAccelerationZ"
    ]
    assert result.part_at == 1
    assert not compared(recording(steering), golden).same


def test_a_body_that_is_missing_or_more(recording: Record, golden: Path) -> None:
    without = (
        ("arm = p.loadURDF", "arm = 0  #"),
        ("    p.setJointMotorControl2", "    0  #"),
    )
    result = compared(recording(*without), golden)
    assert place(result.first) == (0, "2_arm", None, "there", 0.0, 1.0)
    assert result.largest_difference_m == 0.0
    assert result.other_call is not None
    assert result.other_call.golden is not None
    assert result.other_call.golden.function == "loadURDF"
    more = compared(golden, recording(*without))
    assert place(more.first) == (0, "2_arm", None, "there", 1.0, 0.0)


def test_the_calls_before_it_and_the_other_call_are_reported(
    recording: Record, golden: Path
) -> None:
    result = compared(recording(("[0.5, 0, 0]", "[0.7, 0, 0]")), golden)
    assert result.call_before is not None
    assert result.call_before.at.step == 21
    assert result.other_call is not None
    assert result.other_call.value is not None
    assert result.other_call.value.function == "resetBaseVelocity"
    assert (result.other_call.value.at.step, result.other_call.value.line) == (21, 13)
    assert result.other_call.value.arguments == "1, [0.7, 0, 0]"


@pytest.mark.long
def test_recordings_are_compared_up_to_the_end_of_the_shorter(
    recording: Record, golden: Path, drop: Drop
) -> None:
    pushed = (
        "    p.stepSimulation()",
        "    p.applyExternalForce(ball, -1, [0, 0, 1], [0, 0, 0], p.LINK_FRAME)\n"
        "    p.stepSimulation()",
    )
    assert compared(recording(pushed, steps=50), recording(pushed)).differences == []
    removing = (
        ("if step == 20:", "if step == 59: p.removeBody(1), p.removeBody(2)\n    if step == 20:"),
        ("range(60)", "range(70)"),
        ("    p.setJoint", "    step > 59 or p.setJoint"),
    )
    not_removing = (("range(60)", "range(70)"), removing[2])
    result = compared(recording(*removing), recording(*not_removing))
    assert {difference.column for difference in result.differences} == {"there"}
    result = compared(recording(steps=50), golden)
    assert place(result.first) == (51, "1_sphere", -1, "there", 0.0, 1.0)
    done = drop("check", recording(steps=50), "--against", golden)
    assert "positions   identical, as far as both go\n" in done.stdout
    assert done.returncode == 3


def test_joints_and_contact_points_are_compared_to_the_bit(golden: Path) -> None:
    theirs = script_side(golden)
    joints = theirs.seen.joints[2]
    effort = joints.effort.copy()
    effort[40] = np.nextafter(effort[40], np.inf)
    other = with_samples(theirs, joints={2: replace(joints, effort=effort)})
    first = compare(other, theirs).first
    assert first is not None
    assert (first.step, first.body, first.link, first.column) == (40, "2_arm", 0, "joint_effort")
    contacts = table_of(theirs.seen.contacts)
    assert len(contacts) > 5
    step = contacts["step"][4]
    fewer = with_samples(
        theirs, contacts=contacts.with_row_index().filter(pl.col("index") != 4).drop("index")
    )
    first = compare(fewer, theirs).first
    assert first is not None
    assert (first.step, first.column, first.difference) == (step, "contact_points", -1.0)


def test_an_image_that_differs(recording: Record, golden: Path, drop: Drop) -> None:
    result = check(recording(("[1, 1, 1], [0", "[1, 1, 2], [0")), golden)
    assert place(result.first) == (60, None, None, "frame", None, None)
    assert result.frames is not None
    assert (result.frames.compared, result.frames.differing) == (1, 1)
    output = drop("check", result.recording, "--against", golden).stdout
    assert "first       step 60: a picture\n" in output


def test_an_image_that_one_lacks_is_called_that(recording: Record) -> None:
    """An image that only one recording has is reported, and the following images still match."""
    taking = (
        ("import pybullet as p", "import sys, pybullet as p"),
        (
            "    p.stepSimulation()\n",
            "    p.stepSimulation()\n    if str(step) in sys.argv: p.getCameraImage(16, 16)\n",
        ),
    )
    run, golden = (
        recording(*taking, arguments=steps) for steps in (("9", "39"), ("9", "29", "39"))
    )
    result = check(run, golden)
    assert place(result.first) == (30, None, None, "frame", None, None)
    assert result.frames is not None
    assert (result.frames.compared, result.frames.differing) == (4, 1)


def test_a_picture_before_the_scene_is_complete_is_no_other_physics(recording: Record) -> None:
    """The images after it have no sample of the initial state."""
    looking = (
        ("import pybullet as p", "import sys, pybullet as p"),
        ("arm = p.load", "if 'look' in sys.argv: p.getCameraImage(16, 16)\narm = p.load"),
    )
    for how in ((("look",), ()), ((), ("look",))):
        result = check(*(recording(*looking, arguments=each) for each in how))
        assert place(result.first) == (0, None, None, "frame", None, None)


def test_another_file_that_the_same_calls_load(recording: Record, golden: Path) -> None:
    result = compared(recording(mass=1.1), golden)
    assert result.first is not None
    assert (result.first.step, result.first.column) == (1, "joint_position")
    assert place(result.differences[0]) == (0, "2_arm", 0, "dynamics.mass_kg", 1.1, 1.0)
    assert result.other_call is None


def test_soft_bodies_are_not_compared_and_never_the_same(drop: Drop, tmp_path: Path) -> None:
    """PyBullet does not report their state: only calls that load them can differ."""
    cloth = recorded_script(CLOTH, tmp_path / "cloth.rrd")
    done = drop("check", "cloth.rrd", "--against", "cloth.rrd", "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 3
    assert (result["same"], result["first_difference"]) == (False, None)
    assert result["not_compared"] == ["1_cloth_z_up"]
    schema_of_it = strict(schema_of("check"))
    assert not list(Draft202012Validator(schema_of_it).iter_errors(result))
    output = drop("check", "cloth.rrd", "--against", "cloth.rrd").stdout
    assert output.startswith("undecided   cloth.rrd and cloth.rrd\nleft out    1_cloth_z_up: ")
    assert drop("check", cloth, "--against", "new.rrd", "--update").returncode == 0
    higher = recorded_script(CLOTH.replace("1.0", "3.0"), tmp_path / "higher.rrd")
    result = compared(higher, cloth)
    assert (result.first, result.same) == (None, False)
    assert result.other_call is not None
    assert result.other_call.value is not None
    assert "[0, 0, 3.0]" in result.other_call.value.arguments


def test_simulations_of_other_lengths_differ_even_if_nothing_moves(tmp_path: Path) -> None:
    cloth = recorded_script(CLOTH, tmp_path / "cloth.rrd")
    longer = recorded_script(CLOTH.replace("range(24)", "range(30)"), tmp_path / "longer.rrd")
    for tolerance_m in (0.0, 1e-3):
        result = compared(longer, cloth, tolerance_m=tolerance_m)
        assert place(result.first) == (25, None, None, "there", 1.0, 0.0)


def test_links_that_pybullet_does_not_show_are_not_compared(tmp_path: Path) -> None:
    tmp_path.joinpath("arm.urdf").write_text(ARM.format(mass=1))
    path = recorded_script(
        f"""
        import pybullet as p
        p.connect(p.DIRECT)
        p.loadURDF({str(tmp_path / "arm.urdf")!r}, useMaximalCoordinates=True)
        for _ in range(5):
            p.stepSimulation()
        """,
        tmp_path / "arm.rrd",
    )
    result = compared(path, path)
    assert (result.first, result.same, result.not_compared) == (None, False, ["0_arm"])


def test_a_simulation_without_bodies_is_no_difference(recording: Record, golden: Path) -> None:
    more = recording((GRAVITY, f"{GRAVITY}z = p.connect(p.DIRECT)\np.setGravity(1, 1, 1, z)\n"))
    for run, against in ((more, golden), (golden, more)):
        assert compared(run, against).same


def test_the_folder_of_a_file_does_not_make_a_call_different(golden: Path) -> None:
    theirs = script_side(golden)

    def elsewhere(file: str) -> Side:
        calls = copy(theirs.seen.calls)
        calls.sites = {
            number: replace(site, form=site.form.replace("arm.urdf", file))
            for number, site in calls.sites.items()
        }
        return with_samples(theirs, calls=calls)

    assert compare(elsewhere("/home/me/arm.urdf"), elsewhere("/ci/arm.urdf")).other_call is None
    assert compare(elsewhere("/home/me/leg.urdf"), elsewhere("/ci/arm.urdf")).other_call is not None


@pytest.mark.long
def test_two_clients_are_compared_each_by_its_steps(tmp_path: Path) -> None:
    text = (
        scripts.PLAIN["client"]
        .replace("show(pybullet, 0, 1)", "")
        .replace("from show import show", "")
    )
    paths = []
    for number, gravity in enumerate(("-9.81 - n", "-9.81 - n", "-9.81 - 2 * n")):
        tmp_path.joinpath("two.py").write_text(textwrap.dedent(text).replace("-9.81 - n", gravity))
        paths.append(tmp_path / f"{number}.rrd")
        record_script(str(tmp_path / "two.py"), out=paths[-1])
    assert compared(paths[1], paths[0]).same
    theirs = script_side(paths[0])
    second_first = table_of(theirs.seen.contacts).sort(
        "step", "body_a", descending=[False, True], maintain_order=True
    )
    assert not second_first.equals(table_of(theirs.seen.contacts))
    swapped = with_samples(theirs, contacts=second_first)
    assert compare(swapped, theirs).same
    result = compared(paths[2], paths[0])
    assert result.first is not None
    assert result.first.step == 1, "where its effect is"
    assert (0, None, None, "engine.gravityAccelerationZ", -11.81, -10.81) in map(
        place, result.differences
    )


@pytest.mark.long
def test_the_numbers_of_clients_do_not_count(tmp_path: Path) -> None:
    """An unused connection shifts client ids, as does one that a notebook left open."""
    text = """
        import sys, pybullet as p
        for _ in range(int(sys.argv[1])):
            p.connect(p.DIRECT)
        c = p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81, physicsClientId=c)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=c)
        for z in (0, 0.19):
            p.createMultiBody(1, ball, basePosition=[0, 0, z], physicsClientId=c)
        for i in range(50):
            p.stepSimulation(physicsClientId=c)
        """
    first, second = (recorded_script(text, tmp_path / f"{n}.rrd", str(n)) for n in range(2))
    assert len(table_of(script_side(first).seen.contacts))
    for run, against in ((first, second), (second, first), (first, first)):
        for tolerance_m in (0.0, 1e-3):
            result = compared(run, against, tolerance_m=tolerance_m)
            assert (result.same, result.other_call) == (True, None)
    slower = recorded_script(text.replace("-9.81", "-1.6"), tmp_path / "moon.rrd", "1")
    result = compared(slower, first)
    assert result.first is not None
    assert result.first.step == 1, "where its effect is"
    assert (0, None, None, "engine.gravityAccelerationZ", -1.6, -9.81) in map(
        place, result.differences
    )


@pytest.mark.long
def test_which_simulation_is_first_does_not_count(tmp_path: Path) -> None:
    paths = [
        recorded_script(TURNS, tmp_path / f"{order}.rrd", order) for order in ("forward", "back")
    ]
    labels = [
        {body.client: body.label for body in script_side(path).seen.bodies.values()}
        for path in paths
    ]
    assert labels[0] != labels[1]
    for run, golden in (paths, paths[::-1]):
        for tolerance_m in (0.0, 1e-3):
            result = compared(run, golden, tolerance_m=tolerance_m)
            assert (result.same, result.other_call) == (True, None)
            assert result.largest_difference_m == 0.0
    text = TURNS.replace("-9.81 - c", "-9.81 - 2 * c")
    other = recorded_script(text, tmp_path / "other.rrd", "forward")
    result = compared(other, paths[1])
    assert "engine.gravityAccelerationZ" in [difference.column for difference in result.differences]
    assert result.other_call is not None
    calls = result.other_call.value, result.other_call.golden
    assert [call and call.arguments for call in calls] == ["0, 0, -13.81", "0, 0, -11.81"]


def test_one_of_several_simulations_may_end_earlier(tmp_path: Path) -> None:
    text = TURNS.replace(
        "        p.stepSimulation(physicsClientId=c)",
        "        if i < 20 or c or sys.argv[1] == 'forward':\n"
        "                p.stepSimulation(physicsClientId=c)",
    )
    whole, short = (
        recorded_script(text, tmp_path / f"{order}.rrd", order) for order in ("forward", "b")
    )
    result = compared(short, whole)
    assert result.first is not None
    assert (result.first.step, result.first.column, result.first.golden) == (21, "there", 1.0)


def test_twice_the_same_in_whatever_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = TURNS.replace('sys.argv[1] == "forward"', "not Path('ran').exists()")
    text = text.replace("for c in turns:", "Path('ran').touch()\n    for c in turns:", 1)
    script = tmp_path / "turns.py"
    script.write_text(textwrap.dedent("    from pathlib import Path" + text))
    monkeypatch.chdir(tmp_path)
    again = record_script(str(script), out=tmp_path / "twice.rrd", twice=True)
    assert (tmp_path / "ran").exists()
    assert (again.twice, again.first_difference) == (True, None)


def test_a_body_that_turns_over_is_the_same_within_a_tolerance(tmp_path: Path) -> None:
    """Bullet computes quaternions from matrices: at 120° the sign flips, here at other steps."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .2, .3])
        b = p.createMultiBody(1, box, useMaximalCoordinates=True)
        p.resetBaseVelocity(b, [0, 0, 0], [-float(sys.argv[1]), 0, 0])
        for _ in range(480):
            p.stepSimulation()
        """
    one, two = (recorded_script(text, tmp_path / f"{speed}.rrd", speed) for speed in ("5", "4.98"))
    states = [table_of(script_side(path).seen.bases) for path in (one, two)]
    away = (states[0]["qx"] - states[1]["qx"]).abs().max()
    assert isinstance(away, float)
    assert away > 1
    assert compared(one, two, tolerance_m=0.02).same
    assert not compared(one, two, tolerance_m=0.001).same
    assert not compared(one, two).same


def test_a_tolerance_of_an_angle_is_the_way_of_the_surface(tmp_path: Path) -> None:
    """Half the diagonal is 0.374 m, so that 0.05 rad moves the surface by 18.7 mm."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .2, .3])
        b = p.createMultiBody(1, box, baseOrientation=p.getQuaternionFromEuler(
            [0, 0, float(sys.argv[1])]))
        p.stepSimulation()
        """
    one, two = (recorded_script(text, tmp_path / f"{angle}.rrd", angle) for angle in ("0", "0.05"))
    assert compared(one, two, tolerance_m=0.0188).same
    assert not compared(one, two, tolerance_m=0.0186).same


def test_a_step_more_differs_though_nothing_moves_any_more(tmp_path: Path) -> None:
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
        b = p.createMultiBody(1, ball)
        p.stepSimulation()
        p.removeBody(b)
        for _ in range(int(sys.argv[1])):
            p.stepSimulation()
        """
    one, two = (recorded_script(text, tmp_path / f"{n}.rrd", str(n)) for n in (1, 2))
    assert compared(one, one).same
    for run, golden, there in ((one, two, (0.0, 1.0)), (two, one, (1.0, 0.0))):
        result = compared(run, golden)
        assert place(result.first) == (3, None, None, "there", *there)


def test_contact_of_a_link_that_is_not_shown_is_compared(tmp_path: Path) -> None:
    """PyBullet reports -1 as the body of such a link."""
    text = """
        import sys, pybullet as p
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -float(sys.argv[1]))
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1] * 3)
        p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
        p.createMultiBody(
            1, box, -1, [0, 0, 1], p.getQuaternionFromEuler([0, .9, 0]), linkMasses=[1],
            linkCollisionShapeIndices=[box], linkVisualShapeIndices=[-1],
            linkPositions=[[.3, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0, 0]],
            linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
            linkJointTypes=[p.JOINT_FIXED], linkJointAxis=[[0, 0, 1]],
            useMaximalCoordinates=True)
        for i in range(120):
            p.stepSimulation()
        """
    one, two = (recorded_script(text, tmp_path / f"{n}.rrd", str(n)) for n in (10, 11))
    seen = script_side(one).seen
    assert (
        -1
        in table_of(seen.contacts)["body_a"].to_list() + table_of(seen.contacts)["body_b"].to_list()
    )
    assert not compared(one, two).same


def test_an_altered_recording_is_refused_by_its_checksum(golden: Path, tmp_path: Path) -> None:
    altered = rewritten(golden, tmp_path / "altered.rrd", schema.STATES.entity, _altered)
    with pytest.raises(
        RecordingError, match="state fails its checksum; record it again with: drop record"
    ):
        check(altered, golden)
    with pytest.raises(
        RecordingError, match="state fails its checksum; record it again with: drop record"
    ):
        check(golden, altered)


def _altered(chunk: Chunk) -> list[Chunk]:
    """Return a chunk of states whose last position is shifted by a nanometre."""
    batch = chunk.to_record_batch()
    index = batch.schema.get_field_index("position_m")
    values = batch.column(index).to_pylist()
    values[-1][-1] += 1e-9
    column = pa.array(values, type=batch.schema.field(index).type)
    return Chunk.from_record_batch(batch.set_column(index, batch.schema.field(index), column))


def rewritten(
    source: Path, path: Path, entity: str, change: Callable[[Chunk], list[Chunk]]
) -> Path:
    """Write a recording with the chunks of one entity replaced."""
    chunks: list[Chunk] = []
    for chunk in RrdReader(source).stream():
        chunks += change(chunk) if chunk.entity_path == f"/{entity}" else [chunk]
    LazyChunkStream.from_iter(chunks).write_rrd(
        path,
        application_id=schema.APPLICATION_ID,
        recording_id=read(source).recording_id,
    )
    return path


def test_an_image_that_was_altered_is_damage(golden: Path, tmp_path: Path) -> None:
    """An image's digest is checked even if both recordings state the same one."""

    def change(chunk: Chunk) -> list[Chunk]:
        batch = chunk.to_record_batch()
        index = batch.schema.get_field_index("EncodedImage:blob")
        if index < 0:
            return [chunk]
        pngs = [[bytes(png) for png in row] for row in batch.column(index).to_pylist()]
        pngs[0][0] = pngs[0][0][:-20] + bytes([pngs[0][0][-20] ^ 1]) + pngs[0][0][-19:]
        values = [[list(png) for png in row] for row in pngs]
        field = batch.schema.field(index)
        column = pa.array(values, type=field.type)
        return Chunk.from_record_batch(batch.set_column(index, field, column))

    altered = rewritten(golden, tmp_path / "altered.rrd", "camera/0/image", change)
    with pytest.raises(RecordingError, match="its frames fail their checksum"):
        check(altered, golden)


@pytest.mark.parametrize(
    ("entity", "name", "value"),
    [
        ("__properties/recording", "ended", ["finishee"]),
        ("__properties/recording", "made_with_real_time", [True]),
    ],
)
def test_a_recordings_properties_have_a_checksum(
    golden: Path, tmp_path: Path, entity: str, name: str, value: list[Any]
) -> None:
    def change(chunk: Chunk) -> list[Chunk]:
        batch = chunk.to_record_batch()
        index = batch.schema.get_field_index(name)
        rows = batch.column(index).to_pylist()
        column = pa.array([value, *rows[1:]], type=batch.schema.field(index).type)
        return Chunk.from_record_batch(batch.set_column(index, batch.schema.field(index), column))

    altered = rewritten(golden, tmp_path / "altered.rrd", entity, change)
    with pytest.raises(RecordingError, match=r"fails its checksum; .*: drop record"):
        read(altered)


def test_a_summary_is_a_table_in_markdown_after_what_is_there(
    drop: Drop, tmp_path: Path, standard: Run
) -> None:
    shutil.copy(standard.simulation.recording, tmp_path / "golden.rrd")
    (tmp_path / "summary.md").write_text("# Physics\n\n")
    drop("simulate", "--out", "a|b.rrd", "--linear-damping", "0", "--no-camera")
    arguments = ("--against", "golden.rrd", "--summary", "summary.md")
    assert drop("check", "golden.rrd", "--against", "golden.rrd").returncode == 0
    assert drop("check", "a|b.rrd", *arguments).returncode == 3
    text = (tmp_path / "summary.md").read_text()
    assert text.startswith("# Physics\n\n#### drop check: differs\n\na|b.rrd and golden.rrd\n")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert all(len(re.findall(r"(?<!\\)[|]", row)) == 3 for row in rows), rows
    (first,) = [row for row in rows if row.startswith("| first")]
    assert "z\\_m: 0.9994890625, golden 0.9994890920456699" in first
    assert "`drop check 'a|b.rrd' --against golden.rrd --update`" in text
    done = drop("check", "a|b.rrd", "--against", "golden.rrd", "--summary", "golden.rrd")
    assert (done.returncode, done.stdout) == (1, "")
    done = drop("check", "a|b.rrd", "--against", "golden.rrd", "--summary", "golden.rrd/s.md")
    assert (done.returncode, done.stdout) == (1, "")
