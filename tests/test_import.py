"""Validation: imported states are MuJoCo's steps or not, and a term shows the cause.

The causes of dumps, and what twins have otherwise, are those that `other_engines` made them with.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np
import pytest
import rerun as rr
from command import drop_here
from drop_physics import DropError, analyze, import_states
from drop_physics.recording.reader import read
from drop_physics.stages.view import view
from other_engines import DUMPS, SWINGS, TWINS, dumped, twin_of


@pytest.fixture
def swings(tmp_path: Path) -> Path:
    """Return the folder with the twins' model."""
    (tmp_path / "arm.xml").write_text(SWINGS)
    return tmp_path


def imported(folder: Path, arrays: dict[str, Any], **how: Any) -> Any:
    np.savez(folder / "arm.npz", **arrays)
    return import_states(folder / "arm.npz", out=folder / "arm.rrd", force=True, **how)


def some(names: Any, few: tuple[str, ...]) -> list[Any]:
    """Return parameters for all names, of which only a few run by default."""
    return [each if each in few else pytest.param(each, marks=pytest.mark.long) for each in names]


@pytest.mark.parametrize("name", some(DUMPS, ("gear", "action")))
def test_a_dump_says_why_its_states_do_not_stay_finite(name: str, tmp_path: Path) -> None:
    made = import_states(dumped(name, tmp_path), out=tmp_path / "dump.rrd")
    assert DUMPS[name].says in made.ended
    assert made.explained == made.steps
    analysis = analyze(made.recording)
    first_lines = " ".join(str(analysis).split())[:400]
    assert DUMPS[name].says in first_lines
    # No command is made up: inverse dynamics of rounded states leaves what was given.
    assert "no ctrl in the file" in " ".join(made.notes)


@pytest.mark.parametrize("name", some(TWINS, ("limit",)))
def test_a_twin_is_off_by_the_term_that_it_has_otherwise(name: str, swings: Path) -> None:
    twin = TWINS[name]
    arrays, first = twin_of(twin)
    made = imported(swings, arrays)
    kinds = made.gaps
    assert min(each.first for each in kinds) == first
    assert (kinds[0].kind, kinds[0].names) == (twin.kind, twin.names)
    if twin.factor is not None:
        assert kinds[0].factor == pytest.approx(twin.factor, abs=0.01)
    assert made.explained < made.steps


@pytest.mark.long
def test_a_run_in_single_precision_is_explained_whole(swings: Path) -> None:
    arrays, first = twin_of(None)
    assert first is None
    made = imported(swings, arrays)
    assert (made.explained, made.steps, made.gaps) == (299, 299, [])
    assert made.rounding == np.finfo(np.float32).eps
    # The recorded states are those of the file, and each step is a sum that closes.
    analysis = analyze(made.recording)
    assert all(not body.unexplained for body in analysis.bodies)
    held = read(made.recording)
    (rows,) = held.seen.joints.values()
    assert (rows.position == arrays["qpos"][:, :2]).all()


def test_states_without_controls_are_given_those_that_they_ask_for(swings: Path) -> None:
    arrays, _ = twin_of(None)
    ctrl = arrays.pop("ctrl")
    made = imported(swings, arrays)
    assert made.explained == made.steps
    piece = read(made.recording).seen.sampled.piece(0, 300)
    _, given = piece.controls[0]
    assert np.abs(given[-1] - ctrl[298]).max() < 1e-2
    del ctrl


@pytest.mark.long
def test_a_world_that_becomes_no_number_is_taken_and_ends_there(swings: Path) -> None:
    arrays, _ = twin_of(None, 40)
    batched = {name: np.stack([rows] * 3) for name, rows in arrays.items()}
    batched["qvel"][1, 30:, 1] = np.nan
    made = imported(swings, batched)
    assert (made.world, made.worlds, made.states) == (1, 3, 30)
    assert "state 30, where qvel of joint elbow is nan" in made.ended
    assert imported(swings, batched, world=2).ended == ""
    batched["qvel"][1] = batched["qvel"][0]
    batched["qpos"][2, 20:] += 0.1
    assert imported(swings, batched).world == 2


def test_demonstrations_are_read_from_hdf5(tmp_path: Path) -> None:
    arrays, _ = twin_of(None, 101)
    states = np.hstack([arrays["time"][:, None], arrays["qpos"], arrays["qvel"]])
    with h5py.File(tmp_path / "demos.hdf5", "w") as file:
        for number, every in ((0, 1), (1, 25)):
            demo = file.create_group(f"data/demo_{number}")
            demo.attrs["model_file"] = SWINGS
            demo.create_dataset("states", data=states[::every])
            demo.create_dataset("actions", data=arrays["ctrl"][::every])
    out = tmp_path / "demos.rrd"
    made = import_states(tmp_path / "demos.hdf5", maps=["ctrl=actions"], out=out)
    assert (made.explained, made.steps, made.worlds) == (100, 100, 2)
    apart = import_states(tmp_path / "demos.hdf5", world=1, out=out, force=True)
    assert (apart.explained, apart.steps) == (0, 4)
    assert "states are 0.05 s apart, 25 timesteps of the model" in " ".join(apart.notes)
    analysis = analyze(out)
    assert [*analysis.findings] == []
    assert "not known" in " ".join(str(each.told) for each in analysis.account)


def test_controls_that_stand_in_the_next_row_are_found(swings: Path) -> None:
    arrays, _ = twin_of(None)
    arrays["ctrl"] = np.roll(arrays["ctrl"], 1, axis=0)
    made = imported(swings, arrays)
    assert made.explained >= made.steps - 1
    assert "in the row that it ends in" in " ".join(made.notes)


def test_an_input_that_is_no_number_is_the_cause(swings: Path) -> None:
    arrays, _ = twin_of(None, 60)
    arrays["ctrl"][40:, 1] = np.nan
    arrays["qvel"][42:] = np.nan
    made = imported(swings, arrays)
    assert made.ended.startswith(
        "ctrl of actuator elbow is nan from state 40 on; it ends at state 42"
    )
    assert (made.states, made.explained) == (41, 40)


def test_states_in_half_precision_are_read_without_a_warning(swings: Path) -> None:
    """The largest number that MuJoCo allows is not representable in half precision."""
    arrays, _ = twin_of(None, 10)
    arrays["qpos"] = arrays["qpos"].astype(np.float16)
    assert imported(swings, arrays).states == 10


class Never:
    """An object that must never be unpickled when a file is read."""

    def __reduce__(self) -> Any:
        return exec, ("raise SystemExit('unpickled')",)


BAD = {
    "qpos must have 9 numbers": lambda arrays: arrays.update(qpos=arrays["qpos"][:, 1:]),
    "has no qvel": lambda arrays: arrays.pop("qvel"),
    "must begin with two states of finite numbers": lambda arrays: arrays["qvel"].fill(np.nan),
    "as many qvel as qpos": lambda arrays: arrays.update(qvel=arrays["qvel"][1:]),
    "time must rise": lambda arrays: arrays.update(time=0 * arrays["time"]),
    "ctrl must have a row for each": lambda arrays: arrays.update(ctrl=arrays["ctrl"][:10]),
    "has no qpos": lambda arrays: arrays.update(qpos=np.array([Never()], dtype=object)),
}


@pytest.mark.parametrize("says", BAD)
def test_bad_input_is_one_line(says: str, swings: Path) -> None:
    arrays, _ = twin_of(None, 30)
    BAD[says](arrays)
    with pytest.raises(DropError, match=says) as raised:
        imported(swings, arrays)
    assert "\n" not in str(raised.value)
    assert not (swings / "arm.rrd").exists()


def test_bad_files_are_one_line(swings: Path) -> None:
    np.savez(swings / "other.npz", qpos=np.zeros((3, 9)))
    (swings / "cut.npz").write_bytes((swings / "other.npz").read_bytes()[:200])
    with zipfile.ZipFile(swings / "bytes.npz", "w") as archive:
        archive.writestr("qpos.npy", b"no array")
    (swings / "bad.mjb").write_bytes(b"no model")
    (swings / "bad.hdf5").write_bytes(b"no data")
    np.savez(swings / "arm.npz", **twin_of(None, 5)[0])
    for words, says in {
        ("other.npz",): "does not say which model",
        ("cut.npz", "--model", "arm.xml"): "cannot be read as npz",
        ("bytes.npz", "--model", "arm.xml"): "has no qpos",
        ("bad.hdf5",): "cannot be read as hdf5",
        ("arm.npz", "--model", "bad.mjb"): "must be a model that MuJoCo",
        ("arm.npz", "--model", "none.xml"): "--model must be a file",
        ("arm.npz", "--map", "speed=qvel"): "--map takes KEY=ARRAY",
        ("arm.npz", "--map", "qvel=speed"): "no array 'speed'; it has time, qpos, qvel, ctrl",
        ("arm.npz", "--world", "1"): "--world must be 0",
        ("arm.csv",): "must end in .npz, .hdf5 or .h5",
        ("none.npz",): "there is none",
    }.items():
        done = drop_here("import", *words, folder=swings)
        assert done.returncode in (1, 2)
        assert says in " ".join(done.stderr.split()), done.stderr


def test_a_recording_of_another_program_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "other.rrd"
    with rr.RecordingStream("other") as stream:
        stream.save(path)
        stream.set_time("frame", sequence=1)
        stream.log("box", rr.Transform3D(translation=[0, 0, 1]))
        stream.flush()
    with view([path], web=True) as shown:
        assert shown.recordings == [path]
        assert [*shown.report().next] == []


def test_the_json_and_the_report_say_the_same(swings: Path) -> None:
    np.savez(swings / "arm.npz", **twin_of(TWINS["limit"], 60)[0])
    printed = json.loads(drop_here("import", "arm.npz", "--json", folder=swings).stdout)
    assert printed["recording"] == "recordings/arm.rrd"
    assert printed["gaps"][0]["kind"] == "limit"
    assert printed["engine"] == f"MuJoCo {mujoco.__version__}"
    done = drop_here("import", "arm.npz", folder=swings)
    assert "limit elbow" in done.stdout
    assert "next      drop analyze recordings/arm.rrd" in done.stdout
