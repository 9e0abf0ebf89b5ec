"""Comparison with a golden recording: exactly what differs is found and named."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import Drop, Recorder, rerun_rrd
from PIL import Image
from rerun.chunk import RrdReader

from pipeline import Camera, Scenario, simulate
from pipeline.analysis.drop.comparison import (
    IN_CONTACT_M,
    Comparison,
    Place,
    Setting,
    Side,
    compare,
)
from pipeline.errors import OutputError, RecordingError
from pipeline.recording.reader import Recording, frames, read
from pipeline.stages.check import Check, check
from pipeline.stages.run import Run

GOLDEN = Path(__file__).parents[1] / "recordings/golden/standard.rrd"


def side(recording: Recording) -> Side:
    return Side(recording.scenario, recording.engine, recording.states, recording.contacts)


def compared(recorded: Recorder, **change: object) -> Comparison:
    """Compare a fall with other settings with the standard fall, hiding the settings."""
    other, golden = side(recorded(**change)), side(recorded())
    return compare(replace(other, scenario=golden.scenario, engine=golden.engine), golden)


def altered(golden: Side, column: str, step: int, by: float) -> Side:
    values = golden.states[column].to_numpy().copy()
    values[step] += by
    return replace(golden, states=golden.states.with_columns(pl.Series(column, values)))


def touched(golden: Side, column: str, step: int, by: float) -> Side:
    """Alter a number of the last contact point of a step."""
    values = golden.contacts[column].to_numpy().copy()
    values[np.flatnonzero(golden.contacts["step"] == step)[-1]] += by
    return replace(golden, contacts=golden.contacts.with_columns(pl.Series(column, values)))


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
    assert result.differences[0].name == name
    assert result.looks_like is None


def test_another_version_is_reported_but_is_not_a_difference(recorded: Recorder) -> None:
    golden = side(recorded())
    newer = replace(golden, engine=replace(golden.engine, pybullet_version="3.3.0"))
    result = compare(newer, golden)
    assert result.same
    assert [(version.name, version.value) for version in result.versions] == [
        ("pybullet_version", "3.3.0")
    ]


def test_the_same_body_under_another_name_is_the_same_body(recorded: Recorder) -> None:
    golden = side(recorded())
    moved = replace(golden, scenario=replace(golden.scenario, body="/elsewhere/cube.urdf"))
    assert compare(moved, golden).same
    other = replace(moved, engine=replace(golden.engine, body_sha256="another"))
    assert {difference.name for difference in compare(other, golden).differences} == {
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
    result = compare(replace(golden, engine=replace(golden.engine, **{name: value})), golden)
    assert not result.same
    assert [(difference.name, difference.value) for difference in result.differences] == [
        (f"engine.{name}", value)
    ]


@pytest.mark.parametrize("column", ["x_m", "z_m", "qw", "vz_m_s", "wy_rad_s"])
def test_one_bit_in_the_air_is_found_and_named(recorded: Recorder, column: str) -> None:
    golden = side(recorded())
    one_bit = float(np.spacing(golden.states[column][50])) or 5e-324
    result = compare(altered(golden, column, 50, one_bit), golden)
    assert result.first is not None
    assert (result.first.step, result.first.column) == (50, column)
    assert result.looks_like is not None


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
    """The cube's centre is 0.025 m from its floor, it weighs 0.1 kg, a step is 1/240 s."""
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
        assert "the same up to a step in contact" in str(beyond.looks_like)


def test_friction_is_compared_as_one_force(recorded: Recorder) -> None:
    """Its directions are arbitrary where it is small; only the force moves the body."""
    golden = side(recorded())
    turned = golden.contacts.with_columns(
        friction_1_n=-pl.col("friction_1_n"), f1x=-pl.col("f1x"), f1y=-pl.col("f1y"),
        f1z=-pl.col("f1z"),
    )  # fmt: skip
    assert compare(replace(golden, contacts=turned), golden).same
    allowed_n, (x, y) = 1e-9 * 0.1 * 240**2, golden.contacts.select("f1x", "f1y").row(-1)
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
    assert (result.largest_difference_m, result.largest_difference_step) == (0.25, 20)


def test_a_difference_gives_the_value_here_and_in_the_golden_recording(
    recorded: Recorder,
) -> None:
    golden = side(recorded())
    other = altered(golden, "z_m", 50, 0.5)
    here, there = other.states["z_m"][50], golden.states["z_m"][50]
    assert compare(other, golden).first == Place(50, "z_m", here, there)
    assert compare(golden, other).first == Place(50, "z_m", there, here)
    (result,) = compare(side(recorded(duration_s=0.5)), golden).differences
    assert result == Setting("duration_s", 0.5, 1.0)


def test_a_contact_that_only_one_of_them_has_differs(recorded: Recorder) -> None:
    golden = side(recorded())
    early = golden.contacts.head(1).with_columns(step=pl.lit(50, pl.Int64))
    touching = replace(golden, contacts=pl.concat([early, golden.contacts]))
    for mine, theirs, value, there in (
        (touching, golden, 1.0, 0.0), (golden, touching, 0.0, 1.0),
    ):  # fmt: skip
        result = compare(mine, theirs, tolerance_m=1.0)
        assert result.first == Place(50, "contact_points", value, there)
    less = replace(golden, contacts=golden.contacts.head(-1))
    assert compare(less, golden, tolerance_m=1.0).first == Place(240, "contact_points", 3.0, 4.0)
    assert not compare(replace(golden, contacts=golden.contacts.clear()), golden).same


def test_what_differs_first_comes_first(recorded: Recorder) -> None:
    """After a step with more points in one recording, points no longer correspond."""
    golden = side(recorded())
    less = replace(golden, contacts=golden.contacts.filter(pl.col("step") != 150))
    assert compare(less, golden).first == Place(150, "contact_points", 0.0, 4.0)
    for step, column in ((149, "contact_distance_m"), (151, "contact_points")):
        result = compare(touched(less, "distance_m", step, 1e-3), golden).first
        assert result is not None
        assert (result.step, result.column) == (min(step, 150), column)
    result = compare(touched(altered(golden, "z_m", 150, 1e-3), "distance_m", 150, 1), golden).first
    assert result is not None
    assert (result.step, result.column) == (150, "z_m")


def test_a_link_that_differs_is_named(recorded: Recorder) -> None:
    golden = side(recorded(body="r2d2.urdf", height_m=0.5, duration_s=0.25))
    (row,) = np.flatnonzero((golden.states["step"] == 20) & (golden.states["link"] == 3))
    result = compare(altered(golden, "y_m", int(row), 1e-3), golden)
    assert result.first is not None
    assert (result.first.step, result.first.column) == (20, "link3_y_m")
    assert result.largest_difference_m == pytest.approx(1e-3)
    assert result.looks_like == "the same fall of the base, whose links move differently"


def test_a_tolerance_is_a_length(recorded: Recorder) -> None:
    golden = side(recorded())
    moved = altered(golden, "z_m", 50, 1e-6)
    assert compare(moved, golden, tolerance_m=2e-6).same
    assert not compare(moved, golden, tolerance_m=0.5e-6).same
    aside = altered(altered(golden, "x_m", 50, 0.3e-6), "y_m", 50, 0.4e-6)
    assert compare(aside, golden).largest_difference_m == pytest.approx(0.5e-6)
    assert compare(aside, golden, tolerance_m=0.51e-6).same
    assert compare(aside, golden, tolerance_m=0.49e-6).first == Place(50, "y_m", 0.4e-6, 0.0)
    resting = altered(golden, "z_m", 200, 1e-6)  # in contact, too
    assert compare(resting, golden, tolerance_m=2e-6).same
    assert not compare(resting, golden, tolerance_m=0.5e-6).same


def test_a_tolerance_takes_a_quaternion_and_its_negative_for_the_same(recorded: Recorder) -> None:
    golden = side(recorded())
    turned = pl.when(pl.col("step") == 50).then(-pl.col("qw")).otherwise(pl.col("qw"))
    mine = replace(golden, states=golden.states.with_columns(qw=turned))
    assert compare(mine, golden, tolerance_m=1e-9).same
    assert compare(mine, golden).first == Place(50, "qw", -1.0, 1.0)


def test_a_fused_multiply_passes_on_machines_other_than_x86(recorded: Recorder) -> None:
    golden = side(recorded())
    arm = replace(golden, engine=replace(golden.engine, machine="aarch64"))
    assert compare(altered(arm, "z_m", 50, 5e-13), golden).same
    assert not compare(altered(arm, "z_m", 50, 5e-12), golden).same
    assert not compare(altered(golden, "z_m", 50, 5e-13), golden).same


# -- what it looks like ---------------------------------------------------------------------------


def test_other_damping_gravity_and_law_are_recognised(recorded: Recorder) -> None:
    """Each is another run of the engine, presented as if it had the golden settings."""
    for change, words in (
        ({"linear_damping": 0.1}, "the same law with linear damping 0.1 instead of 0.04"),
        ({"linear_damping": 0.0}, "the same law with linear damping"),
        ({"gravity_m_s2": -9.8}, "the same law with gravity -9.8 instead of -9.81 m/s²"),
        ({"linear_damping": 0.1, "gravity_m_s2": -9.0},
         "-9.81 m/s² (or a constant force), linear damping 0.1 instead of 0.04"),
        ({"coordinates": "maximal", "linear_damping": 0.1}, "another law of damping"),
        ({"contact_erp": 0.5}, "the same up to a step in contact, and there another restitution"),
        ({"restitution": 0.5}, "the same up to a step in contact"),
        ({"height_m": 1.1}, "another release"),
    ):  # fmt: skip
        result = compared(recorded, **change)
        assert result.looks_like is not None
        assert words in result.looks_like, change


@pytest.mark.parametrize(
    ("weight_before", "words"), [(1.0, "explicit Euler"), (0.5, "trapezoidal")]
)
def test_another_integrator_is_recognised(
    recorded: Recorder, weight_before: float, words: str
) -> None:
    """The golden velocities, but the position advanced by those before the step, or the mean."""
    golden = side(recorded())
    v, dt = golden.states["vz_m_s"].to_numpy(), golden.scenario.timestep_s
    z = golden.states["z_m"].to_numpy().copy()
    for step in range(100):
        moving = weight_before * v[step] + (1 - weight_before) * v[step + 1]
        z[step + 1] = z[step] + dt * moving
    run = replace(golden, states=golden.states.with_columns(z_m=z))
    result = compare(run, golden)
    assert result.looks_like is not None
    assert words in result.looks_like


def test_what_fits_no_law_is_not_called_one(recorded: Recorder) -> None:
    """Another timestep or substeps shift positions; one kick is no law; nor is 1e-9 of gravity."""
    drop = {"linear_damping": 0.5, "duration_s": 0.8}
    for golden_too, change, words in (
        (drop, {"timestep_s": 1 / 241, "duration_s": 192 / 241}, "do not follow from its velociti"),
        ({"coordinates": "maximal"}, {"substeps": 2}, "do not follow from its velociti"),
        ({}, {"substeps": 2}, "substeps"),
        ({}, {"gravity_m_s2": -9.810000001}, "differ by less than a millionth"),
        ({"velocity_m_s": (1.0, 0.0, 2.0), "spin_rad_s": (0.0, 3.0, 0.0), "duration_s": 0.5},
         {"angular_damping": 0.0}, "turning differently"),
    ):  # fmt: skip
        golden = side(recorded(**golden_too))
        run = replace(golden, states=side(recorded(**{**golden_too, **change})).states)
        assert words in str(compare(run, golden).looks_like), change
    golden = side(recorded(linear_damping=0.0))
    v, z = (golden.states[name].to_numpy().copy() for name in ("vz_m_s", "z_m"))
    v[50:] += 1e-3
    z[50:] += 1e-3 * np.arange(1, len(z) - 49) / 240
    kicked = replace(golden, states=golden.states.with_columns(vz_m_s=v, z_m=z))
    assert "but for 1 step in the air, the first at sample 50" in str(
        compare(kicked, golden).looks_like
    )
    assert "golden departs from it in 1 step in the air, the first at sample 50" in str(
        compare(golden, kicked).looks_like
    )


def test_a_difference_in_a_later_flight_is_none_of_contact(recorded: Recorder) -> None:
    golden = side(recorded(restitution=0.8))
    touching = golden.contacts["step"].to_numpy()
    later = next(step for step in range(touching[0], 241) if step not in touching)
    v = golden.states["vz_m_s"].to_numpy().copy()
    v[later:] += 1e-3
    kicked = replace(golden, states=golden.states.with_columns(vz_m_s=v))
    said = str(compare(kicked, golden).looks_like)
    assert said.startswith("the same up to a flight after the first contact")


def test_altered_samples_turning_and_rounding_are_recognised(recorded: Recorder) -> None:
    golden = side(recorded())
    assert "one altered sample" in str(compare(altered(golden, "z_m", 50, 0.1), golden).looks_like)
    short = side(recorded(duration_s=0.1))
    end = compare(altered(short, "vz_m_s", short.states["step"][-1], 1.0), short)
    assert "moved it there" in str(end.looks_like)
    turned = compare(altered(golden, "wx_rad_s", 50, 0.1), golden)
    assert "turning differently" in str(turned.looks_like)
    z = golden.states["z_m"].to_numpy().copy()
    z[50:] += np.spacing(1.0)
    rounded = compare(replace(golden, states=golden.states.with_columns(z_m=z)), golden)
    assert "rounded differently" in str(rounded.looks_like)


# -- frames ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictured") / "run.rrd"
    simulate(Scenario(duration_s=0.1), path, camera=Camera(capture_every=6, size_px=(64, 48)))
    return path


def test_frames_are_compared_by_their_pixels(
    pictured: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(path: Path) -> list[tuple[int, bytes]]:
        result = list(frames(path))
        if path == pictured:
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
    monkeypatch.setattr("pipeline.stages.check.frames", other)
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
    """Pillow passes an EPS to Ghostscript if it may guess the format."""
    stream = io.BytesIO()
    Image.new("RGB", (64, 48)).save(stream, "eps")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("Ghostscript was asked")

    def other(path: Path) -> list[tuple[int, bytes]]:
        return [
            (step, png if path == pictured else stream.getvalue()) for step, png in frames(path)
        ]

    copy = pictured.with_name("copy.rrd")
    copy.write_bytes(pictured.read_bytes())
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", never)
    monkeypatch.setattr("pipeline.stages.check.frames", other)
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
    assert {file.name for file in tmp_path.iterdir()} == {"old.rrd", "new.rrd", "golden.rrd"}
    assert read(tmp_path / "golden.rrd").states.equals(read(tmp_path / "new.rrd").states)


@pytest.mark.parametrize("kind", ["text", "nothing", "picture", "layer", "merged", "a link"])
def test_update_replaces_recordings_only(
    tmp_path: Path, recorded: Recorder, standard: Run, kind: str
) -> None:
    """Any other file called .rrd is kept, even a layer."""
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
            other.setattr("pipeline.recording.schema.SCHEMA_VERSION", 0)
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

    monkeypatch.setattr("pipeline.recording.sealing.pack", full)
    with pytest.raises(OutputError, match="No space left"):
        check(recorded().path, golden, update=True)
    monkeypatch.setattr(
        "pipeline.recording.sealing.pack", lambda _, path: path.write_bytes(b"nonsense")
    )
    with pytest.raises(RecordingError):
        check(recorded().path, golden, update=True)
    monkeypatch.undo()

    # Rerun's command line does not notice a full disk: its output is cut off.
    def cut(*arguments: object) -> str:
        Path(str(arguments[-1])).write_bytes(GOLDEN.read_bytes()[:-100])
        return ""

    monkeypatch.setattr("pipeline.recording.sealing._rerun", cut)
    with pytest.raises(OutputError, match="its end is missing"):
        check(recorded().path, golden, update=True)
    assert golden.read_bytes() == GOLDEN.read_bytes()
    assert [file.name for file in tmp_path.iterdir()] == ["golden.rrd"]
