"""The command line: clean output streams, exit codes, one line per error."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command import HANGS_S, wait_for
from conftest import Drop
from drop_physics import messages
from drop_physics.stages.run import Run
from rerun.chunk import LazyChunkStream

pytestmark = pytest.mark.pybullet


def lines(text: str) -> list[str]:
    return text.splitlines()


# -- the main job ---------------------------------------------------------------------------------


def test_run_makes_everything_and_tells_the_story(drop: Drop, tmp_path: Path) -> None:
    done = drop("run")
    assert done.returncode == 0
    assert done.stderr == ""
    files = {path.name for path in (tmp_path / "recordings").iterdir()}
    assert files == {"run.rrd", "run.analysis.rrd", "run.gif", "run.png"}
    for figure in ("1.0000", "0.0250", "0.5567", "0.5585", "-0.0018", "-6.13", "+4.31"):
        assert figure in done.stdout
    assert max(map(len, lines(done.stdout))) <= 80
    assert "\x1b" not in done.stdout

    again = drop("run", "--no-camera", "--duration", "0.1", "--json")
    assert again.returncode == 0
    assert (tmp_path / "recordings" / "run-2.rrd").exists()
    assert json.loads(again.stdout)["render"]["gif"] is None


def test_every_stage_prints_one_json_object(drop: Drop, tmp_path: Path, standard: Run) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    simulated = drop("simulate", "--out", "new.rrd", "--no-camera", "--json")
    assert set(json.loads(simulated.stdout)) == {
        "recording",
        "recording_id",
        "samples",
        "frames",
        "bytes",
        "wall_s",
    }
    rendered = json.loads(drop("render", "run.rrd", "--json").stdout)
    assert rendered == {"gif": "run.gif", "frames": 41, "fps": 20.0, "plot": "run.png"}

    analyzed = json.loads(drop("analyze", "run.rrd", "--at", "0.3", "--at", "0.9", "--json").stdout)
    assert {
        "recording",
        "scenario",
        "engine",
        "at",
        "airborne",
        "impact",
        "rest",
        "conservation",
        "findings",
    } <= set(analyzed)
    falling, resting = analyzed["at"]
    assert set(falling["terms_m"]) == {"timestep", "damping", "interaction", "rounding"}
    assert sum(falling["terms_m"].values()) == pytest.approx(falling["error_m"], abs=1e-15)
    assert (falling["phase"], falling["step"], falling["time_s"]) == ("falling", 72, 0.3)
    assert (resting["phase"], resting["terms_m"]) == ("rest", None)
    assert analyzed["scenario"]["timestep_s"] == 1 / 240


def test_scenario_options_reach_the_recording(drop: Drop) -> None:
    drop(
        "simulate",
        "--out",
        "run.rrd",
        "--no-camera",
        "--height",
        "2",
        "--timestep",
        "1/480",
        "--duration",
        "0.5",
        "--gravity",
        "moon",
        "--linear-damping",
        "0.1",
        "--angular-damping",
        "0",
        "--velocity",
        "0,0,-1",
        "--spin",
        "1,2,3",
        "--mass",
        "0.2",
        "--restitution",
        "0.5",
        "--contact-erp",
        "0.1",
        "--solver-residual",
        "0",
        "--solver-iterations",
        "20",
        "--coordinates",
        "maximal",
        "--no-floor",
        "--orientation",
        "90,0,45",
        "--friction",
        "0.3",
        "--restitution-threshold",
        "0.1",
        "--substeps",
        "2",
    )
    scenario = json.loads(drop("analyze", "run.rrd", "--json").stdout)["scenario"]
    assert scenario == {
        "height_m": 2.0,
        "timestep_s": 1 / 480,
        "duration_s": 0.5,
        "gravity_m_s2": -1.62,
        "linear_damping": 0.1,
        "angular_damping": 0.0,
        "velocity_m_s": [0.0, 0.0, -1.0],
        "spin_rad_s": [1.0, 2.0, 3.0],
        "body": "cube_small.urdf",
        "mass_kg": 0.2,
        "restitution": 0.5,
        "contact_erp": 0.1,
        "solver_residual": 0.0,
        "solver_iterations": 20,
        "orientation": [90.0, 0.0, 45.0],
        "friction": 0.3,
        "restitution_threshold_m_s": 0.1,
        "substeps": 2,
        "coordinates": "maximal",
        "engine": "bullet",
        "integrator": None,
        "stepped": True,
        "gravity_set": True,
        "floor": False,
    }


@pytest.mark.parametrize("suffix", ["parquet", "csv"])
def test_table_holds_every_sample(drop: Drop, tmp_path: Path, standard: Run, suffix: str) -> None:
    import polars as pl

    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    assert drop("analyze", "run.rrd", "--table", f"t.{suffix}").returncode == 0
    path = tmp_path / f"t.{suffix}"
    table = pl.read_parquet(path) if suffix == "parquet" else pl.read_csv(path)
    assert table["simulated_m"].to_list() == standard.analysis.table["simulated_m"].to_list()
    assert table["rounding_m"][72] == standard.analysis.table["rounding_m"][72]
    assert drop("analyze", "run.rrd", "--table", f"t.{suffix}").returncode == 1


# -- streams --------------------------------------------------------------------------------------


@pytest.mark.long
def test_standard_output_carries_the_result_and_nothing_else(drop_process: Drop) -> None:
    """Bullet prints its banner from C, at exit if stdout is a pipe; Rerun logs if configured to."""
    done = drop_process("simulate", "--out", "run.rrd", "--no-camera", "--json")
    assert isinstance(json.loads(done.stdout), dict)
    assert done.stderr == ""


@pytest.mark.long
def test_rerun_cannot_be_switched_off(
    drop_process: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    done = drop_process("simulate", "--out", "run.rrd", "--no-camera", "--json")
    assert json.loads(done.stdout)["bytes"] == (tmp_path / "run.rrd").stat().st_size > 10_000


LOUD = {
    "RUST_LOG": "debug",
    "MALLOC_CONF": "stats_print:true",
    "_RJEM_MALLOC_CONF": "no:thing",
    "POLARS_VERBOSE": "1",
}


@pytest.mark.long
def test_settings_of_somebodys_own_programs_make_no_library_talk(
    drop_process: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Settings for Rerun and others do not reach our processes, but the script still gets them."""
    for name, value in LOUD.items():
        monkeypatch.setenv(name, value)
    done = drop_process("run", "--duration", "0.1", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert isinstance(json.loads(done.stdout), dict)
    done = drop_process("sweep", "--height", "1,2", "--out", "s", "--jobs", "2")
    assert (done.returncode, done.stderr) == (0, "")
    tmp_path.joinpath("says.py").write_text(
        f"import os\nprint([os.environ.get(name) for name in {list(LOUD)}])\n"
    )
    done = drop_process("record", "--out", "says.rrd", "says.py")
    assert done.stdout.splitlines()[0] == str(list(LOUD.values()))
    said = ("drop: nothing was simulated", "script ", "recorded ")
    assert [one for one in done.stderr.splitlines() if not one.startswith(said)] == []


@pytest.mark.long
def test_a_home_that_nothing_can_be_written_to_is_not_mentioned(
    drop_process: Drop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/proc")
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)
    monkeypatch.setenv("DROP_LANG", "ja")  # whose plots look for a font too
    done = drop_process("run", "--duration", "0.1")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("lacks", [MemoryError, OSError(errno.EMFILE, "Too many open files")])
def test_an_error_is_said_though_no_translation_can_be_read(
    drop: Drop, monkeypatch: pytest.MonkeyPatch, lacks: Exception
) -> None:
    def translation(*_: object, **__: object) -> None:
        raise lacks

    monkeypatch.setattr("gettext.translation", translation)
    messages._catalog.cache_clear()
    monkeypatch.setenv("DROP_LANG", "ja")
    done = drop("analyze", "no.rrd")
    messages._catalog.cache_clear()
    assert (done.returncode, done.stderr) == (
        1,
        "drop: no.rrd does not exist; make it with drop record or drop simulate\n",
    )


def test_a_reader_that_closes_the_pipe_is_not_an_error() -> None:
    command = f"{sys.executable} -m drop_physics analyze --help | head -1"
    done = subprocess.run(
        ["bash", "-c", command],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[1],
        check=False,
    )
    assert done.stderr == ""


# -- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--timestep", "0"], 2, "0.0"),
        (["--timestep", "-1"], 2, "-1.0"),
        (["--timestep", "nan"], 2, "nan"),
        (["--timestep", "inf"], 2, "inf"),
        (["--timestep", "1/0"], 2, "'1/0'"),
        (["--timestep", "abc"], 2, "'abc'"),
        (["--duration", "0.3001"], 2, "try 0.3 or 0.304166666667"),
        (["--duration", "0.001"], 2, "try 0.00416666666667"),
        (["--timestep", "1e-9", "--duration", "10"], 2, "GB"),
        (["--gravity", "venus"], 2, "moon"),
        (["--velocity", "1,2"], 2, "X,Y,Z"),
        (["--spin", "1,2,x"], 2, "'1,2,x'"),
        (["--mass", "0"], 2, "--mass"),
        (["--restitution", "2"], 2, "at most 1"),
        (["--solver-iterations", "1.5"], 2, "whole number"),
        (["--coordinates", "polar"], 2, "reduced or maximal"),
        (["--capture-every", "0"], 2, "at least 1"),
        (["--size", "480"], 2, "WIDTHxHEIGHT"),
        (["--renderer", "gpu"], 2, "tiny or egl"),
        (["--body", "nope.urdf"], 2, "cube_small.urdf"),
        (["--frobnicate"], 2, "--frobnicate"),
    ],
)
def test_bad_scenarios_get_one_line(
    drop: Drop, tmp_path: Path, options: list[str], code: int, message: str
) -> None:
    done = drop("simulate", "--out", "run.rrd", *options)
    assert done.returncode == code
    assert done.stdout == ""
    assert len(lines(done.stderr)) == 1
    assert done.stderr.startswith("drop: ")
    assert message in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_exists_is_kept_and_what_cannot_be_written_is_named(
    drop: Drop, tmp_path: Path
) -> None:
    (tmp_path / "run.rrd").write_text("precious")
    exists = drop("simulate", "--out", "run.rrd", "--no-camera")
    assert (exists.returncode, len(lines(exists.stderr))) == (1, 1)
    assert "--force" in exists.stderr
    assert (tmp_path / "run.rrd").read_text() == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


@pytest.mark.parametrize("stage", ["analyze", "render"])
@pytest.mark.parametrize("kind", ["missing", "empty", "text", "cut", "folder", "foreign"])
def test_bad_recordings_get_one_line(
    drop: Drop, tmp_path: Path, standard: Run, kind: str, stage: str
) -> None:
    path, whole = tmp_path / "run.rrd", standard.simulation.recording.read_bytes()
    if kind == "folder":
        path.mkdir()
    elif kind == "foreign":
        LazyChunkStream.from_iter([]).write_rrd(path, application_id="x", recording_id="y")
    elif kind != "missing":
        path.write_bytes({"empty": b"", "text": b"hello" * 99, "cut": whole[:-9999]}[kind])
    before = {file.name for file in tmp_path.iterdir()}
    done = drop(stage, "run.rrd")
    assert done.returncode == 1
    assert done.stdout == ""
    assert len(lines(done.stderr)) == 1
    assert done.stderr.startswith("drop: run.rrd")
    assert {file.name for file in tmp_path.iterdir()} == before


def test_a_time_outside_the_recording_is_wrong_usage(
    drop: Drop, tmp_path: Path, standard: Run
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    for at in ("1.5", "-1", "nan", "x"):
        done = drop("analyze", "run.rrd", "--at", at)
        assert (done.returncode, len(lines(done.stderr))) == (2, 1)


@pytest.mark.long
def test_a_traceback_only_on_request(drop_process: Drop, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "Traceback" not in drop_process("analyze", "no.rrd").stderr
    monkeypatch.setenv("DROP_DEBUG", "1")
    assert "Traceback" in drop_process("analyze", "no.rrd").stderr


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)],
)
def test_interrupted_it_says_so_and_keeps_the_part(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "drop_physics",
            "simulate",
            "--out",
            "run.rrd",
            "--duration",
            "5000",
            "--no-camera",
        ],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    part = tmp_path / "run.rrd.part"
    wait_for(lambda: part.exists() and part.stat().st_size > 1_000_000, "no .part")
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=HANGS_S)
    assert process.returncode == code
    assert stdout == ""
    assert len(lines(stderr)) == 1
    assert "run.rrd.part" in stderr
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd.part"]


def test_interrupted_while_it_is_still_being_imported_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text("import os\nos.kill(os.getpid(), 2)\nraise SystemExit(7)\n")
    places = os.pathsep.join([str(tmp_path), str(Path(__file__).parents[1])])
    done = subprocess.run(
        [sys.executable, "-m", "drop_physics", "run"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": places},
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "drop: interrupted\n")


# -- help -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["simulate", "analyze", "render", "run"])
def test_every_command_has_help_with_an_example(drop: Drop, command: str) -> None:
    done = drop(command, "--help")
    assert done.returncode == 0
    assert "Example: drop " in done.stdout
    assert "--json" in done.stdout


def test_the_version_is_printed(drop: Drop) -> None:
    assert drop("--version").stdout.startswith("drop 0.")
