"""Output for people: an 80-column terminal with colours and bars; and output to a pipe."""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import os
import pty
import re
import shlex
import shutil
import struct
import subprocess
import termios
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
import pytest
import typer
from command import ROOT, drop_here, environment, run_here
from conftest import Drop, Recorder, judge, some
from drop_physics.account.joints import JointRow
from drop_physics.cli import app
from drop_physics.compare.comparison import Comparison
from drop_physics.compare.difference import Difference, Largest, Setting
from drop_physics.console import output, progress
from drop_physics.console.help import SCRIPT
from drop_physics.console.progress import rate
from drop_physics.fields import counted, decimals, engineering
from drop_physics.figures.composition import caption
from drop_physics.files.table import write_table
from drop_physics.messages import shell_command
from drop_physics.recording.viewer import Viewer
from drop_physics.report.blocks import Column, DataTable, Fact, Facts, File
from drop_physics.report.bodies import joint_table
from drop_physics.report.check import DIFFERS
from drop_physics.report.terminal import block_lines, show
from drop_physics.report.words import millimetres
from drop_physics.stages.check import Check, FrameComparison
from drop_physics.stages.render import Rendering
from drop_physics.stages.run import Run
from drop_physics.stages.simulate import Simulation
from drop_physics.stages.sweep import Sweep
from drop_physics.stages.view import View
from drop_physics.sweeping.plan import plan_of
from drop_physics.sweeping.rows import TERMS
from rich.text import Text

pytestmark = pytest.mark.pybullet

COMMAND: Any = typer.main.get_command(app)
EXAMPLES = {
    name: one.epilog.removeprefix("Example: ")
    for name, one in COMMAND.commands.items()
    if name != SCRIPT  # whose help is its own
}
STYLE = re.compile(r"\x1b\[[\d;]*m")
MOVE = re.compile(r"\x1b\[[\d;?]*[A-Za-ln-z]")


class Seen(NamedTuple):
    """The data sent to a terminal."""

    raw: str
    code: int

    @property
    def lines(self) -> list[str]:
        """All text that was ever shown in a line, without colours."""
        plain = MOVE.sub("\r", STYLE.sub("", self.raw))
        return [one for one in re.split(r"[\r\n]+", plain) if one.strip()]


Terminal = Callable[..., Seen]


@pytest.fixture
def terminal(tmp_path: Path) -> Terminal:
    """Return the command line, run in this process on a terminal, 80 columns wide by default."""

    def call(*arguments: object, columns: int = 80, **more: str) -> Seen:
        ours, theirs = pty.openpty()
        fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        inherited = {
            name: text
            for name, text in environment().items()
            if name not in ("COLUMNS", "NO_COLOR", "FORCE_COLOR")
        }
        with ThreadPoolExecutor(1) as reader:
            received = reader.submit(_all_of, ours)
            code = run_here(
                arguments,
                tmp_path,
                streams=(theirs, theirs, theirs),
                environment=inherited | {"TERM": "xterm-256color"} | more,
            )
            os.close(theirs)
            raw = received.result()
        os.close(ours)
        return Seen(raw.decode(), code)

    return call


def _all_of(terminal: int) -> bytes:
    """Return everything sent to a terminal until no process has it open any more."""
    received = b""
    with contextlib.suppress(OSError):  # how Linux says that nobody writes there any more
        while more := os.read(terminal, 65536):
            received += more
    return received


# -- width and colours ----------------------------------------------------------------------------


STUDY = "--timestep 1/240,1/480,1/960,1/7 --linear-damping default,0 --gravity earth,moon"
CHANCE = "--samples 5 --vary velocity_z=normal:0:0.1 --no-record"


@pytest.mark.parametrize(
    "command",
    some(
        [
            "",
            "--help",
            *(f"{name} --help" for name in (*EXAMPLES,)[:4]),
            "run",
            "simulate --out new.rrd --no-camera --gravity 9.81",
            "analyze run.rrd --at 0.1 --at 0.9",
            "render run.rrd",
            "check run.rrd --against run.rrd",
            "check bounce.rrd --against run.rrd",
            f"sweep --out s --spin 0,0,0;1,2,3 --body cube_small.urdf,sphere_small.urdf {STUDY}",
            "foo",
            "simulate",
            "simulate --out new.rrd --timestep 1/0",
            "render no.rrd",
            "sweep --out s --samples 3 --vary zzz=uniform:1:2",
            "check run.rrd --against no.rrd",
        ],
        6,
    ),
)
def test_no_line_is_wider_than_a_terminal_of_80_columns(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run, command: str
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    if "bounce" in command:
        drop("simulate", "--out", "bounce.rrd", "--restitution", "0.9", "--size", "32x24")
    seen = terminal(*command.split())
    assert "Traceback" not in seen.raw
    assert "DROP_DEBUG" not in seen.raw
    assert [line for line in seen.lines if len(line) > 80] == []


SCRIPT = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
for place in range({boxes}):
    p.loadURDF("cube_small.urdf", [place, 0, 0.2 + 0.1 * place])
for _ in range(120):
    p.stepSimulation()
"""


@pytest.mark.long
@pytest.mark.parametrize("columns", [20, 140])
def test_lines_are_as_wide_as_the_terminal_between_50_and_100_columns(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run, columns: int
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    for boxes in (1, 3):
        (tmp_path / "script.py").write_text(SCRIPT.format(boxes=boxes))
        drop("record", "-o", f"script-{boxes}.rrd", "script.py")
    widest = 0
    for command in (
        "--help",
        "simulate -h",
        "analyze run.rrd",
        "info run.rrd",
        "info script-3.rrd",
        "analyze script-1.rrd",
        "analyze script-3.rrd",
        "analyze no-recording-of-this-name.rrd",
        f"sweep -o s{columns} --timestep 1/240,1/480,1/960 --no-record",
        "render run.rrd",
    ):
        seen = terminal(*command.split(), columns=columns)
        told = [line.rstrip() for line in seen.lines if "━" not in line]
        assert [line for line in told if len(line) > min(max(columns, 50), 100)] == [], command
        widest = max(widest, *map(len, told))
    assert widest > min(max(columns, 50), 100) - 5


def test_the_width_is_that_of_columns_where_it_is_set(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    assert max(map(len, terminal("check", "-h", COLUMNS="60").lines)) <= 60
    assert max(map(len, terminal("check", "-h", COLUMNS="wide", columns=60).lines)) <= 60
    assert max(map(len, terminal("check", "-h", columns=0).lines)) > 70
    piped = drop("analyze", "run.rrd").stdout
    assert 76 < max(map(len, piped.splitlines())) <= 80


def test_codes_and_errors_stand_out_on_terminals_only(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    assert "\x1b[2mdefault-damping\x1b[0m" in terminal("analyze", "run.rrd").raw
    assert "   default-damping\n" in drop("analyze", "run.rrd").stdout
    assert "\x1b[1;31mdrop:\x1b[0m no.rrd does not" in terminal("analyze", "no.rrd").raw
    assert "\x1b" not in terminal("analyze", "no.rrd", NO_COLOR="1").raw
    assert drop("analyze", "no.rrd").stderr.startswith("drop: no.rrd does not")


@pytest.mark.long
def test_colours_are_for_terminals_that_want_them(
    terminal: Terminal, drop: Drop, tmp_path: Path, standard: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    for command in (["analyze", "run.rrd"], ["render", "run.rrd"]):
        assert STYLE.search(terminal(*command).raw), command
        assert not STYLE.search(terminal(*command, NO_COLOR="1").raw), command
        assert "\x1b" not in drop(*command).stdout, command
    monkeypatch.setenv("FORCE_COLOR", "1")
    forced = drop("analyze", "run.rrd")
    assert STYLE.search(forced.stdout)
    assert forced.stderr == ""
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in drop("analyze", "run.rrd").stdout


@pytest.mark.parametrize(
    ("options", "titles"),
    [
        ("--timestep 1/240,1/480 --no-record", ("4 runs",)),
        (CHANCE, ("10 runs", "linear damping 0")),
    ],
)
def test_titles_are_bold(terminal: Terminal, options: str, titles: tuple[str, ...]) -> None:
    raw = terminal(*f"sweep --out s --linear-damping default,0 {options}".split()).raw
    assert all(f"\x1b[1m{title}\x1b[0m" in raw for title in titles)


# -- what others wrote ----------------------------------------------------------------------------

HOSTILE = "\x1b]0;owned\x07 \x1b[2J \x9b31m \u202egnp \x7f\x00 [red]:bomb:"
SHOWN = r"\u001b]0;owned\u0007 \u001b[2J \u009b31m \u202egnp \u007f\u0000 [red]:bomb:"


def test_what_a_terminal_would_obey_is_shown_and_not_sent(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    output.print_lines(*block_lines(Facts([Fact("title", HOSTILE)], 8)))
    output.print_lines(*block_lines(Facts([File("file", Path(HOSTILE))], 8)))
    assert [one.count(SHOWN) for one in STYLE.sub("", capsys.readouterr().out).splitlines()] == [
        1,
        1,
    ]
    output.note(HOSTILE)
    assert capsys.readouterr().err == f"drop: {SHOWN}\n"
    output.print_json({"name": f"Δ\xa0{HOSTILE}\n\ud800\U000e0001"})
    said = capsys.readouterr().out
    assert json.loads(said) == {"name": f"Δ\xa0{HOSTILE}\n\ud800\U000e0001"}
    assert "Δ\xa0" in said
    assert all(one.isprintable() for one in said.replace("\n", "").replace("\xa0", ""))


def test_names_with_control_characters_are_harmless_in_errors(
    drop: Drop, tmp_path: Path, standard: Run
) -> None:
    name = "a\x1b[31m\u202eb.rrd"
    assert drop("analyze", name).stderr.startswith(r"drop: a\u001b[31m\u202eb.rrd")
    (tmp_path / name).write_bytes(standard.simulation.recording.read_bytes())
    told = drop("render", name)
    assert told.returncode == 0
    assert "\x1b" not in told.stdout
    assert "\u202e" not in told.stdout


def test_a_table_is_harmless_on_a_terminal(tmp_path: Path) -> None:
    name = "a\x1b[31m\u202eb"
    for suffix in (".csv", ".parquet"):
        write_table(tmp_path / f"t{suffix}", pl.DataFrame({name: [name]}), force=False)
    assert (tmp_path / "t.csv").read_text() == "a\\u001b[31m\\u202eb\n" * 2
    assert pl.read_parquet(tmp_path / "t.parquet").to_dict(as_series=False) == {name: [name]}


# -- progress -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "what"),
    some(
        [
            ("analyze run.rrd", "analyzing"),
            ("simulate --out a.rrd --duration 400 --no-camera", "stepping"),
            ("simulate --out a.rrd", "drawing frames"),
            ("render run.rrd", "writing gif"),
            ("sweep --out s --duration 1,0.3001,2 --no-record", "runs, 1 failed"),
        ],
        1,
    ),
)
def test_what_takes_long_has_a_bar_with_count_rate_and_time_left(
    terminal: Terminal, tmp_path: Path, standard: Run, command: str, what: str
) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    seen = terminal(*command.split())
    assert seen.code == (1 if "1 failed" in what else 0)
    shown = [line for line in seen.lines if line.startswith(what)]
    assert any(
        re.search(r"━ +[\d,]+/[\d,]+ +[\d,.]+/(s|min) +\d:\d\d:\d\d left", line) for line in shown
    ), seen.lines


def test_a_script_has_a_line_that_says_how_far_it_is_and_how_to_stop_it(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(progress, "LINE_AFTER_S", 0.0)
    (tmp_path / "script.py").write_text(SCRIPT.format(boxes=1))
    seen = terminal("record", "script.py")
    says = r"[\d.]+ s simulated, [\d,]+ steps; Ctrl-C ends it and keeps the recording *"
    assert any(re.fullmatch(says, line) for line in seen.lines), seen.lines
    assert max(map(len, seen.lines)) <= 80
    assert re.search(r"\r +\rscript +finished", re.sub(r"\x1b[^m]*m", "", seen.raw))


def test_a_pipe_gets_no_bar(drop: Drop) -> None:
    assert drop("simulate", "--out", "a.rrd", "--duration", "0.1").stderr == ""


@pytest.mark.parametrize(
    ("per_second", "said"),
    [(None, ""), (85_123.4, "85,123/s"), (1.0, "1/s"), (0.5, "30.0/min"), (0.01, "0.6/min")],
)
def test_a_rate_is_a_number_above_one_where_it_can(per_second: float | None, said: str) -> None:
    assert rate(per_second) == said


# -- what is printed ------------------------------------------------------------------------------

RUN, GOLDEN = Path("run.rrd"), Path("golden.rrd")
SAME = Comparison(
    of_drop=True,
    differences=[],
    first=None,
    call_before=None,
    other_call=None,
    largest=[],
    largest_difference_m=0.0,
    part_at=None,
    not_compared=[],
    script=[],
    versions=[],
    unseeded=[],
    real_time=False,
)


def lines_of(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return the printed lines, with runs of spaces collapsed to one."""
    return [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]


def test_printed_check_of_the_same_physics(capsys: pytest.CaptureFixture[str]) -> None:
    version = Setting("numpy_version", "2.4", "2.3")
    check = Check(
        RUN, GOLDEN, 0.0, replace(SAME, versions=[version]), FrameComparison(41, 0, None, None)
    )
    assert show(check, as_json=False) == 0
    assert lines_of(capsys) == [
        "same run.rrd and golden.rrd",
        "positions identical",
        "frames 41 compared, identical",
        "version numpy 2.4, golden 2.3",
        "",
        "next drop analyze run.rrd",
    ]
    assert show(check, as_json=True) == 0
    assert json.loads(capsys.readouterr().out) == {
        "same": True,
        "largest_difference_m": 0.0,
        "first_difference": None,
        "call_before": None,
        "other_call": None,
        "differences": [],
        "largest": [],
        "not_compared": [],
        "script": [],
        "unseeded": [],
        "real_time": False,
        "engines": None,
        "why": None,
        "tolerance_m": 0.0,
        "recording": "run.rrd",
        "golden": "golden.rrd",
        "versions": [{"name": "numpy_version", "value": "2.4", "golden": "2.3"}],
        "frames": {"compared": 41, "differing": 0, "first_step": None, "why": None},
        "updated": False,
        "lacks": [],
    }


def test_printed_check_of_other_samples_says_where_and_by_how_much(
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = Difference(50, "box", -1, "vz_m_s", -2.0, None, 0.25)
    largest = Largest("box", -1, "position", 3.21e-7, 70, "m")
    comparison = replace(SAME, first=place, largest=[largest], largest_difference_m=3.21e-7)
    frames = FrameComparison(30, 2, 12, "11 taken when the bodies are elsewhere")
    check = Check(RUN, GOLDEN, 2e-6, comparison, frames, "they part")
    assert show(check, as_json=False) == DIFFERS
    assert lines_of(capsys) == [
        "differs run.rrd and golden.rrd",
        "first step 50, 0.25 s, box, vz_m_s: -2.0, golden none",
        "positions up to 3.21e-07 m apart (step 70, box); allowed: 2e-06 m",
        "engines they part",
        "frames 30 compared, 2 differ; 11 taken when the bodies are elsewhere",
        "",
        "next drop view run.rrd --against golden.rrd",
        "drop check run.rrd --against golden.rrd --update",
    ]
    assert show(check, as_json=True) == DIFFERS
    told = json.loads(capsys.readouterr().out)
    assert (told["same"], told["tolerance_m"], told["engines"]) == (False, 2e-6, "they part")
    assert told["first_difference"] == {
        "step": 50,
        "body": "box",
        "link": -1,
        "column": "vz_m_s",
        "value": -2.0,
        "golden": None,
        "time_s": 0.25,
        "part": None,
        "difference": None,
    }
    assert told["largest"] == [
        {
            "body": "box",
            "link": -1,
            "quantity": "position",
            "difference": 3.21e-7,
            "step": 70,
            "unit": "m",
            "part": None,
        },
    ]
    assert show(replace(check, updated=True), as_json=False) == 0
    assert lines_of(capsys)[-3] == "golden golden.rrd is now run.rrd"


@pytest.mark.parametrize(
    ("tolerance_m", "said"),
    [
        (0.0, "nothing in the air, 1e-09 m in contact"),
        (1e-12, "1e-12 m in the air, 1e-09 m in"),
        (1e-6, "allowed: 1e-06 m"),
    ],
)
def test_printed_check_says_what_is_allowed(
    capsys: pytest.CaptureFixture[str], tolerance_m: float, said: str
) -> None:
    largest = Largest("box", -1, "position", 1e-10, 150, "m")
    apart = replace(SAME, largest=[largest], largest_difference_m=1e-10)
    show(Check(RUN, GOLDEN, tolerance_m, apart, None), as_json=False)
    (_, positions, *others) = lines_of(capsys)
    assert said in " ".join([positions, *others])


def test_printed_check_names_settings_by_their_options(capsys: pytest.CaptureFixture[str]) -> None:
    values: list[tuple[str, Any, Any]] = [
        ("timestep_s", 1 / 480, 1 / 240),
        ("floor", False, True),
        ("gravity_set", True, False),
        ("mass_kg", None, 0.2),
        ("solver_iterations_of_engine", 40, 50),
    ]
    settings = [Difference(None, None, None, *each) for each in values]
    comparison = replace(SAME, differences=settings, largest_difference_m=None)
    assert show(Check(RUN, GOLDEN, 0.0, comparison, None), as_json=False) == DIFFERS
    assert lines_of(capsys)[1:-3] == [
        "setting --timestep 1/480, golden 1/240",
        "setting --no-floor given, golden not given",
        "setting --no-gravity not given, golden given",
        "setting --mass default, golden 0.2",
        "engine solver_iterations_of_engine 40, golden 50",
    ]


def test_printed_check_without_frames_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    check = Check(RUN, GOLDEN, 0.0, SAME, FrameComparison(0, 0, None, "run.rrd has no frames"))
    show(check, as_json=False)
    assert lines_of(capsys)[-3] == "frames none compared: run.rrd has no frames"
    other_picture = replace(check, frames=FrameComparison(41, 1, 12, None))
    assert show(other_picture, as_json=False) == DIFFERS
    assert "first step 12: a picture" in lines_of(capsys)


def swept(*, runs: int = 4, failed: int = 1, computed: int = 3, **plan: Any) -> Sweep:
    """Return a sweep over a number of timesteps, of which the last few runs failed."""
    rows = []
    for number in range(runs):
        timestep_m = -0.00613 / (number + 1)
        rows.append(
            {
                "run": number,
                "timestep_s": 1 / (240 * (number + 1)),
                "time_s": 0.3,
                "error_m": timestep_m + 0.00431,
                "timestep_m": timestep_m,
                "damping_m": 0.00431,
                "interaction_m": 7e-7,
                "rounding_m": -2.8e-16,
                "error": None,
            }
        )
    for row in rows[runs - failed :]:
        row |= {"error": "the engine fell over", "time_s": None} | dict.fromkeys(TERMS)
    steps = ",".join(f"1/{240 * (number + 1)}" for number in range(runs))
    planned = plan_of(**{"given": {"timestep_s": steps}} | plan)
    return Sweep(planned, 0.3, computed, rows, Path("s/results.parquet"))


def test_printed_sweep_has_a_row_for_each_run(capsys: pytest.CaptureFixture[str]) -> None:
    """Errors are in mm, under the names of the terms; a failed run has none."""
    show(swept(), as_json=False)
    said = lines_of(capsys)
    assert said[0] == "4 runs, errors at 0.3 s in mm, simulated minus free fall"
    assert said[2:7] == [
        "timestep total timestep damping interaction rounding",
        "1/240 -1.8200 -6.1300 +4.3100 +0.0007 -2.8e-13",
        "1/480 +1.2450 -3.0650 +4.3100 +0.0007 -2.8e-13",
        "1/720 +2.2667 -2.0433 +4.3100 +0.0007 -2.8e-13",
        "1/960 – – – – –",
    ]
    assert "1 of 4 runs failed, see the column error; run 3:" in said
    assert "the engine fell over" in said
    assert "4 rows, 1 of them from an earlier run" in " ".join(said)
    show(swept(failed=0, computed=4), as_json=False)
    without = " ".join(lines_of(capsys))
    assert "failed" not in without
    assert "before" not in without
    show(swept(failed=0, runs=1, computed=1), as_json=False)
    one = lines_of(capsys)
    assert one[0].startswith("1 run, errors")
    assert one[-1].endswith("1 row")


def test_printed_sweep_of_many_runs_says_how_many_it_does_not_show(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show(swept(runs=40, computed=40, failed=0), as_json=False)
    said = lines_of(capsys)
    assert sum(line.startswith("1/") for line in said) == 30
    assert any(line.startswith("… and 10 more in") for line in said)


def test_one_of_a_thing_is_no_plural(capsys: pytest.CaptureFixture[str], drop: Drop) -> None:
    for runs, failed, said in (
        (1, 0, "over the 1 sample in the air, in theory too"),
        (3, 2, "over the 1 of 3 samples in the air, in theory too"),
        (1, 1, "the sample failed"),
        (3, 3, "all 3 samples failed"),
    ):
        sampled = {"samples": runs, "vary": ["mass=uniform:1:2"], "given": {}}
        show(swept(runs=runs, failed=failed, **sampled), as_json=False)
        assert said in " ".join(lines_of(capsys))
    done = drop("simulate", "--duration", "1/240", "--capture-every", "5", "--out", "r.rrd")
    assert " 2 samples, 1 frame, " in done.stdout


def test_printed_json_of_a_sweep_is_what_it_found(capsys: pytest.CaptureFixture[str]) -> None:
    made = swept()
    show(made, as_json=True)
    assert json.loads(capsys.readouterr().out) == {
        "runs": 4,
        "failed": 1,
        "at_s": 0.3,
        "results": str(made.results),
        "table": made.rows,
    }


@pytest.mark.parametrize(
    ("value_m", "said"),
    [
        (0.00431, "+4.3100 mm"),
        (-6.13125e-3, "-6.1313 mm"),
        (6.8e-7, "+0.0007 mm"),
        (5.1e-8, "+0.0001 mm"),
        (4.9e-8, "+4.9e-05 mm"),
        (-2.8e-16, "-2.8e-13 mm"),
        (0.0, "+0.0000 mm"),
        (-0.0, "+0.0000 mm"),
        (-4905.0, "-4.905e6 mm"),
    ],
)
def test_printed_millimetres_are_signed_and_never_a_false_zero(value_m: float, said: str) -> None:
    assert f"{millimetres(value_m)} mm" == said


@pytest.mark.parametrize(
    ("frames", "fps", "speed", "facts"),
    [
        (41, 20.0, 0.5, "41 frames, 2.05 s, 2 times slower"),
        (41, 40.0, 1.0, "41 frames, 1.02 s, in real time"),
        (30, 10.0, 3.0, "30 frames, 3.00 s, 3 times faster"),
        (2, 20.0, None, "2 frames, 0.10 s"),
        (1, 20.0, None, "1 frame, 0.05 s"),
    ],
)
def test_printed_rendering_says_how_it_plays(
    capsys: pytest.CaptureFixture[str], frames: int, fps: float, speed: float | None, facts: str
) -> None:
    made = Rendering(Path("fall.webp"), frames, fps, Path("fall.png"), speed)
    show(made, as_json=False, recording=Path("fall.rrd"))
    said = lines_of(capsys)
    assert said == [f"webp fall.webp {facts}", "plot fall.png", "", "next drop view fall.rrd"]
    show(made, as_json=True, recording=Path("fall.rrd.part"))
    out, err = capsys.readouterr()
    assert json.loads(out) == {
        "gif": "fall.webp",
        "frames": frames,
        "fps": fps,
        "plot": "fall.png",
    }
    assert "fall.rrd.part was never finished" in err


def test_printed_simulation_says_what_was_recorded(capsys: pytest.CaptureFixture[str]) -> None:
    made = Simulation(RUN, "an id", samples=12_001, frames=41, bytes=345_678, wall_s=1.26)
    show(made, as_json=False)
    assert lines_of(capsys) == [
        "recording run.rrd 12,001 samples, 41 frames, 346 kB, 1.3 s",
        "",
        "next drop analyze run.rrd",
        "drop view run.rrd",
    ]
    show(made, as_json=True)
    assert json.loads(capsys.readouterr().out) == {
        "recording": "run.rrd",
        "recording_id": "an id",
        "samples": 12_001,
        "frames": 41,
        "bytes": 345_678,
        "wall_s": 1.26,
    }


@pytest.mark.parametrize(
    ("value", "places", "said"),
    [
        (0.025, 4, "0.0250"),
        (-4.905, 4, "-4.9050"),
        (999_999.0, 1, "999999.0"),
        (1e6, 4, "1e6"),
        (-9.81e9, 4, "-9.81e9"),
        (123_456_789.0, 1, "123.457e6"),
        (999_999_999.0, 4, "1e9"),
        (1e60, 2, "1e60"),
        (math.inf, 2, "inf"),
        (-math.inf, 1, "-inf"),
    ],
)
def test_printed_large_numbers_are_in_powers_of_a_thousand(
    value: float, places: int, said: str
) -> None:
    assert decimals(value, places) == said


def test_printed_small_numbers_among_large_ones_are_so_too() -> None:
    assert [engineering(one, "+") for one in (0.0, 0.25, -1234.5, 9.81e9)] == [
        "+0",
        "+250e-3",
        "-1.2345e3",
        "+9.81e9",
    ]


def test_printed_story_of_a_heavy_body_has_no_digits_that_mean_nothing(
    capsys: pytest.CaptureFixture[str], recorded: Recorder
) -> None:
    """The body is 1,000 kg, 1,000 km above the floor; a truncated recording is covered too."""
    analysis = judge(recorded(height_m=1e6, mass_kg=1000.0, linear_damping=0.0, duration_s=0.5))
    show(analysis, as_json=False)
    told = capsys.readouterr().out
    assert "dropped from 1e6 m" in told
    assert "9.81e9 → 9.81e9 J" in told
    assert not re.search(r"\d{7}\.", told), told
    one = replace(analysis, partial=True, recording=RUN, samples=1)
    show(one, as_json=True)
    assert "the analysis of the 1 sample that it holds" in capsys.readouterr().err


def test_printed_view_names_files_and_where_they_are_seen(
    capsys: pytest.CaptureFixture[str],
) -> None:
    viewer = Viewer(["rerun", "run.rrd"], 9876, "http://127.0.0.1:9090?url=x")
    layer, old = Path("run.analysis.rrd"), Path("other.analysis.rrd")
    view = View([RUN], [layer], [old], viewer)
    show(view, as_json=False)
    said = capsys.readouterr()
    assert "showing            run.rrd run.analysis.rrd\n" in said.out
    assert "open in a browser  http://127.0.0.1:9090?url=x " in said.out
    assert said.err.startswith("drop: other.analysis.rrd belongs to an earlier recording")
    show(replace(view, stale=[], viewer=replace(viewer, page=None)), as_json=False)
    said = capsys.readouterr()
    assert ("browser" in said.out, said.err) == (False, "")
    show(replace(view, stale=[]), as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert (told["recordings"], told["layers"]) == (["run.rrd"], ["run.analysis.rrd"])
    assert (told["url"], told["page"]) == (viewer.url, viewer.page)
    assert told["command"] == ["rerun", "run.rrd"]


@pytest.mark.parametrize("value", [-0.0, -1e-9, -0.004])
def test_nothing_has_no_minus(value: float) -> None:
    assert [decimals(value, 2), decimals(value, 2, "+")] == ["0.00", "+0.00"]
    assert decimals(-0.006, 2) == "-0.01"
    assert caption(0.0, value / 100, value / 10_000).count("−") == 0


@pytest.mark.parametrize(
    ("number", "said"), [(0, "0 runs"), (1, "1 run"), (2, "2 runs"), (1000, "1,000 runs")]
)
def test_one_of_a_thing_is_counted_as_one(number: int, said: str) -> None:
    assert counted(number, "run") == said
    assert counted(number, "body", "bodies").endswith("body") == (number == 1)


@pytest.mark.parametrize(
    ("columns", "elbow", "finger"),
    [
        (80, "0.250 -0.250 rad 3.0 5 N m", "0.250 -0.250 m/s 3.0 5 N"),
        (60, "0.250 -0.250 rad", "0.250 -0.250 m/s"),
    ],
)
def test_each_number_of_a_joint_has_its_unit(
    monkeypatch: pytest.MonkeyPatch, columns: int, elbow: str, finger: str
) -> None:
    """On a narrow terminal, a unit is omitted once the last of its values is omitted."""
    turns = JointRow(
        name="elbow",
        index=0,
        axis=None,
        kind="revolute",
        control="position",
        target=0.5,
        reached=0.25,
        off=-0.25,
        torque=3.0,
        force_limit=5.0,
        needs=9.81,
        needs_at_target=None,
        at_force_limit_steps=0,
        at_stop_steps=0,
        reaction_n=None,
        reaction_n_m=None,
    )
    slides = replace(turns, name="finger", index=1, kind="prismatic", control="velocity")
    monkeypatch.setattr("drop_physics.report.terminal.width", lambda: columns)
    _, *rows = block_lines(joint_table("a_robot_with_a_name", [turns, slides]))
    assert " ".join(rows[0].split()).endswith(elbow)
    assert " ".join(rows[1].split()).endswith(finger)
    long = replace(turns, torque=-90000.0, force_limit=110000.0)
    *_, row = block_lines(joint_table("a_robot_with_a_name", [long]))
    assert " -9e+04 1.1e+05 " in row or columns < 70, row


@pytest.mark.parametrize("columns", [30, 60, 80])
def test_a_long_cell_leaves_room_for_the_one_that_wraps(
    monkeypatch: pytest.MonkeyPatch, columns: int
) -> None:
    monkeypatch.setattr("drop_physics.report.terminal.width", lambda: columns)
    long, said = (
        "p.createConstraint with one and the same point in both " * 2,
        "cured: moves by 2 m",
    )
    table = DataTable(
        [Column("", ["tried"]), Column("", [long], shrinks_to=12), Column("", [said], wraps=True)],
        margin="   ",
        has_heads=False,
    )
    lines = list(block_lines(table))
    assert max(map(len, lines)) <= columns
    told = " ".join(" ".join(lines).split())
    assert "…" in told
    assert all(word in told for word in said.split())


def test_texts_of_findings_name_options_that_exist() -> None:
    """Any text in the rules' source that looks like an option is an option of a command."""
    options = {
        name for one in COMMAND.commands.values() for param in one.params for name in param.opts
    }
    found = {
        name
        for room in ("rules", "drop", "analysis")
        for path in (ROOT / "pipeline/drop_physics" / room).rglob("*.py")
        for name in re.findall(r"(?<![\w-])--[a-z][a-z-]+", path.read_text(encoding="utf-8"))
    }
    assert len(found) > 10
    assert found <= options


@pytest.mark.long
def test_printed_commands_can_be_pasted(drop: Drop, tmp_path: Path) -> None:
    """The folder's name contains a space and a quote."""
    folder = "it's a folder"
    told = drop("run", "--no-camera", "--duration", "0.1", "--out-dir", folder).stdout
    command = told.partition("next  ")[2].strip()
    assert shlex.split(command) == ["drop", "view", f"{folder}/run.rrd"]
    told = drop("info", f"{folder}/run.rrd").stdout
    assert shlex.split(told.partition("repeat")[2].splitlines()[0])[:2] == ["drop", "simulate"]
    (tmp_path / folder / "run.analysis.rrd").unlink()
    told = " ".join(drop("info", f"{folder}/run.rrd").stdout.split())
    assert shlex.split(told.partition("none yet: ")[2]) == ["drop", "analyze", f"{folder}/run.rrd"]


ODD_WORDS = [
    "", "a", "-x", "it's", "a b", "a  b   c", " a ", "line\nbreak\tand\\'s", "\x1b[1m\x01f",
    "\u202eé\U0001f600", "\u00a0", "\udcffa", "$HOME `ls` \"!\"", "{braces}", "\u2028\U000e0001",
]  # fmt: skip


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_a_shell_reads_the_words_of_a_printed_command_as_they_were() -> None:
    command = shell_command("printf", r"%s\0", *ODD_WORDS, Path("-a/b"), Path("b"))
    lines = " ".join(command.split())  # as a line of ours has it
    wrapped = [
        Text.from_markup(line).plain
        for line in block_lines(Facts([Fact("", lines, is_command=True)], 12))
    ]
    assert len(wrapped) > 1
    for text in (lines, "\n".join(wrapped)):
        done = subprocess.run(
            ["bash", "-c", text],
            stdout=subprocess.PIPE,
            check=True,
            env={**os.environ, "LC_ALL": "C.UTF-8"},
        )
        assert list(map(os.fsdecode, done.stdout.split(b"\0")[:-1])) == [*ODD_WORDS, "./-a/b", "b"]
    assert command.isprintable()


def test_info_gives_the_command_that_records_a_script_again(drop: Drop, tmp_path: Path) -> None:
    arguments = ["", "two\nlines", "a long argument that fills a line", "and another one of these"]
    (tmp_path / "-né.py").write_text(SCRIPT.format(boxes=1))
    limits = ("--duration", "0.0125", "--seed", "12345678901234")
    drop("record", *limits, "-o", "./-s.rrd", "--", "-né.py", *arguments)
    done = drop("info", "./-s.rrd")
    printed = done.stdout.partition("repeat ")[2].partition("run it in the script")[0]
    assert len(printed.splitlines()) > 1
    assert all(len(line) <= 80 for line in done.stdout.splitlines())
    command = json.loads(drop("info", "./-s.rrd", "--json").stdout)["command"]
    for text in (printed.replace("\\\n", ""), command):  # which shlex does not know, nor $'…'
        words = shlex.split(text.replace(r"$'two\nlines'", "'two\nlines'"))
        assert words == ["drop", "record", *limits, "--", "-né.py", *arguments]
    assert done.stdout.endswith("none yet: drop analyze ./-s.rrd\n")
    # A byte that is not UTF-8 is not known any more.
    drop("record", "--steps", "3", "--force", "-o", "./-s.rrd", "./-né.py", "\udcff")
    assert "repeat " not in drop("info", "./-s.rrd").stdout


# -- drop info ------------------------------------------------------------------------------------


def test_info_says_what_a_drop_is_in_ten_lines(drop: Drop, tmp_path: Path, standard: Run) -> None:
    (tmp_path / "run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    done = drop("info", "run.rrd")
    assert (done.returncode, done.stderr) == (0, "")
    lines = re.sub(r"\n {2,}", " ", done.stdout).splitlines()
    told = dict(line.split(maxsplit=1) for line in lines)
    assert len(told) <= 10
    assert told["recording"].endswith(" kB, complete; numbers and frames verified, not its layout")
    assert told["drop"] == "cube_small.urdf dropped from 1 m"
    assert told["bodies"] == "cube_small.urdf, 0.1 kg"
    assert told["samples"].startswith("241 in 1 s, 132 of them in contact")
    assert told["frames"] == "41"
    assert told["analysis"] == "none yet: drop analyze run.rrd"
    drop("analyze", "run.rrd")
    assert "analysis    run.analysis.rrd\n" in drop("info", "run.rrd").stdout
    # A layer that belongs to another recording is not its analysis.
    drop("simulate", "-o", "run.rrd", "--force", "--no-camera", "--height", "2", "--no-floor")
    told = json.loads(drop("info", "run.rrd", "--json").stdout)
    assert (told["layer"], told["frames"], told["contact_samples"]) == (None, 0, 0)
    again = shlex.split(told["command"])
    assert again[-3:] == ["--height", "2.0", "--no-floor"]
    drop(*again[1:])
    assert drop("check", "again.rrd", "--against", "run.rrd").returncode == 0


@pytest.mark.long
def test_info_says_what_the_recording_of_a_script_is(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT.format(boxes=2))
    words = ("record", "--seed", "1", "--steps", "60")
    drop(*words, "-o", "s.rrd", "script.py", "--its own")
    done = drop("info", "s.rrd")
    told = dict(line.split(maxsplit=1) for line in done.stdout.splitlines())
    assert len(told) <= 10
    assert told["script"] == "script.py '--its own', stopped by --steps"
    assert told["bodies"] == "0_plane, held still; 1_cube_small, 0.1 kg; 2_cube_small, 0.1 kg"
    assert told["samples"].startswith("61 in 0.25 s, ")
    assert shlex.split(told["repeat"]) == [
        "drop",
        "record",
        "--steps",
        "60",
        "--seed",
        "1",
        "script.py",
        "--its own",
    ]
    (tmp_path / "s.rrd").rename(tmp_path / "s.rrd.part")
    assert json.loads(drop("info", "s.rrd.part", "--json").stdout)["complete"]


# -- where to start -------------------------------------------------------------------------------


def test_drop_alone_says_what_to_type_first_and_then_lists_the_commands(drop: Drop) -> None:
    alone = drop()
    assert (alone.returncode, alone.stderr) == (0, "")
    assert alone.stdout == drop("--help").stdout
    assert alone.stdout.rstrip().endswith("Start with: drop my_script.py, or: drop run")
    for name in EXAMPLES:
        assert f"\n  {name} " in alone.stdout


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_every_command_is_one_that_it_takes(drop: Drop, name: str) -> None:
    assert f"\n  Example: {EXAMPLES[name]}\n" in drop(name, "--help").stdout
    program, command, *arguments = shlex.split(EXAMPLES[name])
    assert (program, command) == ("drop", name)
    with COMMAND.make_context("drop", [command, *arguments]) as context:
        COMMAND.commands[name].make_context(name, list(arguments), parent=context)


@pytest.mark.long
def test_the_examples_work_one_after_the_other(drop: Drop, tmp_path: Path, standard: Run) -> None:
    """All are run but `view`, which waits for a viewer; `run` renders its frames once."""
    golden = tmp_path / "recordings/golden"
    golden.mkdir(parents=True)
    recording = standard.simulation.recording.read_bytes()
    for path in (golden / "standard.rrd", tmp_path / "recordings/run.rrd", tmp_path / "run.rrd"):
        path.write_bytes(recording)
    for name in ("simulate", "analyze", "render", "check", "sweep"):
        done = drop(*shlex.split(EXAMPLES[name])[1:])
        assert (done.returncode, done.stderr) == (0, ""), name
    assert {"moon.rrd", "run.csv", "fall.webp", "sweep"} <= {one.name for one in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["foo"], "no such command 'foo'; see: drop --help"),
        (["simulat"], "no such command 'simulat'; did you mean 'simulate'?; see: drop --help"),
        (["simulate", "--out", "a.rrd", "--higth", "2"], "--height"),
        (
            ["sweep", "--out", "s", "--samples", "2", "--vary", "hight=uniform:1:2"],
            "such as height",
        ),
        (["sweep", "--out", "s", "--samples", "2", "--vary", "zzz=uniform:1:2"], "velocity_z"),
        (
            ["render", "run.rrd", "--fps", "fast"],
            "--fps takes a number or a fraction such as 1/480, got 'fast'",
        ),
        (["sweep", "--out", "s", "--jobs", "1.5"], "--jobs takes a whole number, got '1.5'"),
        (
            ["simulate", "-o", "a.rrd", "--timestep", "240"],
            "at most 10, got 240.0; did you mean 1/240?",
        ),
        (["sweep", "-o", "s", "--samples", "9"], "--samples draws nothing without --vary; add"),
        (
            ["simulate", "-o", "a.rrd", "--body", "no.urdf"],
            "here or in pybullet_data, got 'no.urdf', which is in neither place; try cube",
        ),
        (["simulate", "-o", "a.rrd", "--body", "."], "got '.', which is a folder; try cube"),
        (
            ["simulate", "-o", "a.rrd", "--body"],
            "'--body' needs a value; see: drop simulate --help",
        ),
        (["--show-completion", "tcsh"], "takes bash, zsh, fish, got 'tcsh'"),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(
    drop: Drop, arguments: list[str], said: str
) -> None:
    done = drop(*arguments)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
    assert said in done.stderr


@pytest.mark.parametrize("verb", ["analyze", "render", "check", "info", "view"])
def test_what_is_no_recording_is_called_what_it_is(
    drop: Drop, tmp_path: Path, standard: Run, verb: str
) -> None:
    layer = standard.analysis.layer
    assert layer is not None
    (tmp_path / "folder").mkdir()
    (tmp_path / "sweep" / "recordings").mkdir(parents=True)
    (tmp_path / "sweep" / "recordings" / "run-0.rrd").touch()
    (tmp_path / "a.analysis.rrd").write_bytes(layer.read_bytes())
    (tmp_path / "a.analysis.rrd.part").write_bytes(layer.read_bytes()[:3000])
    (tmp_path / "empty.rrd.part").touch()
    kinds = {
        "folder": "is a folder; name a recording in it, such as folder/run.rrd",
        "sweep": "is a folder; name a recording in it, such as sweep/recordings/run-0.rrd",
    }
    if verb != "view":  # which shows layers, too
        kinds |= {
            "a.analysis.rrd": "must be a recording, got a layer, as",
            "a.analysis.rrd.part": "must be a recording, got an unfinished layer, as",
            "empty.rrd.part": "holds nothing yet: the process that wrote it",
        }
    for name, said in kinds.items():
        done = drop(verb, name, *(["--against", "b.rrd"] if verb == "check" else []))
        assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (1, "", 1)
        assert done.stderr.startswith(f"drop: {name} "), done.stderr
        assert said in done.stderr


def test_a_mesh_that_cannot_be_loaded_is_named(drop: Drop, tmp_path: Path) -> None:
    mesh = '<geometry><mesh filename="{}"/></geometry>'
    body = '<robot name="a"><link name="a"><collision>{}</collision></link></robot>'
    (tmp_path / "bad.obj").write_text("this is no mesh\n")
    for name, said in (
        ("no.obj", "cannot find 'no.obj'"),
        ("bad.obj", "bad.obj': it has no faces"),
    ):
        (tmp_path / "own.urdf").write_text(body.format(mesh.format(name)))
        done = drop("simulate", "-o", "a.rrd", "--body", "own.urdf")
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
        assert "own.urdf" in done.stderr
        assert said in done.stderr


def test_a_sweep_with_failed_runs_fails_and_says_how_many(drop: Drop) -> None:
    words = ("sweep", "-o", "s", "--duration", "1,0.3001,0.3002", "--no-record")
    for more in ((), ("--json",)):  # the second time nothing is computed any more
        done = drop(*words, *more)
        assert done.returncode == 1
        assert done.stderr == "drop: 2 of 3 runs failed; their rows in s/results.parquet say why\n"
    assert json.loads(done.stdout)["failed"] == 2
    assert drop("sweep", "-o", "t", "--duration", "1,2", "--no-record").returncode == 0


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_short_options_are_the_long_ones(drop: Drop, name: str) -> None:
    assert drop(name, "-h").stdout == drop(name, "--help").stdout
    without = dict.fromkeys(("check", "info", "view", "explain"))
    long = {"run": "--out-dir", **without}.get(name, "--out")
    shorts = {param.opts[0]: param.opts for param in COMMAND.commands[name].params}
    assert long is None or shorts[long] == [long, "-o"]


def test_gravity_that_points_up_is_noted_and_recorded(drop: Drop) -> None:
    done = drop("simulate", "--out", "up.rrd", "--no-camera", "--gravity", "9.81")
    assert done.returncode == 0
    assert done.stderr == (
        "drop: gravity points upwards: +9.81 m/s²; the body will rise; try --gravity -9.81 to let "
        "it fall\n"
    )
    switched_off = drop(
        "simulate", "--out", "off.rrd", "--no-camera", "--gravity", "9.81", "--no-gravity"
    )
    assert switched_off.stderr == ""


# -- completion -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shells_script_is_shown(drop: Drop, shell: str) -> None:
    done = drop("--show-completion", shell)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"complete_{shell}" in done.stdout


WORDS = [
    ("drop si", ["simulate"]),
    ("drop render --f", ["--fps", "--force"]),
    ("drop run --coordinates ", ["reduced", "maximal"]),
    ("drop render r", []),  # a file: left to the shell
]


def completed(shell: str, line: str, action: str = "get-args") -> tuple[list[str], int]:
    """Return a shell's completions, and the exit code."""
    words = line.split(" ")
    done = drop_here(
        folder=ROOT,
        _DROP_COMPLETE=f"complete_{shell}",
        COMP_WORDS=line,
        COMP_CWORD=str(len(words) - 1),
        _TYPER_COMPLETE_ARGS=line,
        _TYPER_COMPLETE_FISH_ACTION=action,
    )
    assert done.stderr == ""
    return done.stdout.splitlines(), done.returncode


@pytest.mark.parametrize(("line", "expected"), WORDS)
def test_words_are_completed(line: str, expected: list[str]) -> None:
    in_bash, code = completed("bash", line)
    assert (list(filter(None, in_bash)), code) == (expected, 0)
    in_fish, _ = completed("fish", line)
    assert [one.partition("\t")[0] for one in in_fish if one] == expected
    # Whether fish may offer files is told by the exit code.
    assert completed("fish", line, "is-args")[1] == (0 if expected else 1)
    zsh = "\n".join(completed("zsh", line)[0])
    assert all(f'"{word}"' in zsh for word in expected) if expected else zsh == "_files"
