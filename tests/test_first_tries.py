"""A new user's first hour: typical commands, and scripts that fail, wait or restart.

Each verb ends with what to type next, each error with what to try.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import drop_physics
import numpy as np
import pytest
from conftest import Drop, some
from drop_physics import analyze, record_script
from drop_physics.compare.comparison import compare
from drop_physics.engines.decoder import Decoder
from drop_physics.engines.watching import pipe
from drop_physics.experiments.run_distance import apart
from drop_physics.recording import scene
from drop_physics.recording.reader import read
from drop_physics.recording.scene import parts_of
from drop_physics.report import terminal
from drop_physics.report.info import report_of
from drop_physics.stages import film
from drop_physics.stages.check import check
from drop_physics.stages.info import info
from drop_physics.stages.render import render
from drop_physics.trace.events import Shape
from test_check import script_side

FALLS = """import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
for _ in range({steps}):
    p.stepSimulation()
"""


def written(folder: Path, name: str, end: str = "", *, steps: int = 24) -> Path:
    """Write a script in which a ball falls, followed by the lines `end`."""
    script = folder / name
    script.write_text(FALLS.format(steps=steps) + end)
    return script


# -- a script that ends with an error -------------------------------------------------------------


@pytest.mark.parametrize(
    ("end", "error", "line"),
    some(
        [
            ("assert False, 'too low'\n", "AssertionError: too low", "fails.py:7: assert False"),
            ("1 / 0\n", "ZeroDivisionError: division by zero", "fails.py:7: 1 / 0"),
            (
                "p.loadURDF('no.urdf')\n",
                "p.loadURDF('no.urdf')",
                "fails.py:7: p.loadURDF('no.urdf')",
            ),
            ("import sys; sys.exit(1)\n", "sys.exit(1)", ""),
            ("import os; os.kill(os.getpid(), 9)\n", "SIGKILL", ""),
        ],
        2,
    ),
)
def test_the_error_comes_first_and_the_analysis_all_the_same(
    drop: Drop, tmp_path: Path, end: str, error: str, line: str
) -> None:
    written(tmp_path, "fails.py", end)
    done = drop("fails.py")
    printed, said = done.stdout.partition("error  ")[::2]  # Bullet warns on standard output
    first, rest = f"error  {said}".split("\n\n", 1)
    assert done.returncode == 1
    assert "failed" not in printed
    assert first.startswith("error  ")
    assert error in " ".join(first.split())
    assert line in first
    assert rest.startswith("fails.py failed: 1 body, 24 steps")
    assert "0_sphere" in rest
    assert "script-failed" not in rest  # said once


@pytest.mark.starts
def test_what_ends_before_any_engine_leaves_no_recording(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text("import no_such_module\n")
    done = drop("fails.py")
    assert done.returncode == 1
    assert done.stdout.startswith("error  the script fails: ModuleNotFoundError")
    recorded = drop("record", "fails.py")
    assert (recorded.returncode, recorded.stdout) == (1, "")
    assert recorded.stderr.endswith("it came to no simulation, so nothing is recorded\n")
    assert "No module named" in json.loads(drop("record", "--json", "fails.py").stdout)["error"]
    assert not [*(tmp_path / "recordings").iterdir()]


# -- what is typed first --------------------------------------------------------------------------


def test_options_of_both_verbs_come_before_the_script(drop: Drop, tmp_path: Path) -> None:
    written(tmp_path, "ball.py", "import sys; print(sys.argv)\n", steps=240)
    done = drop("--steps", "12", "--body", "0", "ball.py", "--steps", "7")
    assert done.returncode == 0
    assert "ball.py stopped by --steps: 1 body, 12 steps" in done.stdout
    assert "next  drop why --steps 12 ball.py --steps 7" in done.stdout
    found = drop("--json", "--all", "--steps", "12", "--at", "0.02", "ball.py")
    told = json.loads(found.stdout)  # what the script prints is beside it
    assert (told["samples"], told["bodies"][0]["at"][0]["step"]) == (13, 5)
    module = drop("--steps", "12", "-m", "ball")
    assert "-m ball stopped by --steps" in module.stdout
    assert drop("--fail-on", "asked", "--table", "t.csv", "--steps", "3", "ball.py").returncode == 0
    assert (tmp_path / "t.csv").exists()


@pytest.mark.parametrize(
    ("typed", "says"),
    some([
        ("ball.rrd", "ball.rrd is a recording; what happened in it says: drop analyze ball.rrd"),
        ("record ball.rrd", "drop analyze ball.rrd"),
        ("cells.ipynb", 'with record("cells.rrd"): …'),
        ("plain", "no such command 'plain'; a script whose name does not end in .py is recorded "
         "with: drop record plain"),
        ("--json analyze", "options of analyze come after it: drop analyze …"),
        ("--steps", "'--steps' needs a value; see: drop record --help"),
        ("--no-such-option ball.py", "no such option: --no-such-option"),
        ("--python nowhere ball.py", "nowhere cannot be started"),
        ("--html p.txt ball.py", "--html must end in .html"),
        ("--select nothing ball.py", "nothing"),
        ("analyze ball.rrd --output-format xml", "--output-format must be one of 'text', 'json', "
         "'github', 'sarif', got 'xml'"),
        ("sweep --vary a=b --out s", "it must name a scenario option, such as"),
        ("why --try frction=2 ball.py", "got 'frction=2'; near it are friction"),
    ], 2),
)  # fmt: skip
def test_a_first_try_that_is_wrong_says_what_to_type(
    drop: Drop, tmp_path: Path, typed: str, says: str
) -> None:
    written(tmp_path, "ball.py")
    (tmp_path / "cells.ipynb").write_text("{}")
    (tmp_path / "plain").write_text("")
    record_script(str(tmp_path / "ball.py"), out=tmp_path / "ball.rrd", steps=2, stdout=2)
    done = drop(*typed.split())
    assert done.returncode != 0
    (line,) = done.stderr.splitlines()
    assert says in line
    assert len(line) < 300
    assert not [*tmp_path.glob("recordings/*")]  # found before anything runs


@pytest.mark.parametrize("typed", ["analyze no.rrd --json", "record --json --no-such-option x.py"])
def test_an_error_is_json_too(drop: Drop, typed: str) -> None:
    done = drop(*typed.split())
    assert done.returncode != 0
    assert done.stderr == f"drop: {json.loads(done.stdout)['error']}\n"


@pytest.mark.long
def test_every_verb_ends_with_what_to_type_next(drop: Drop, tmp_path: Path) -> None:
    written(tmp_path, "ball.py")
    written(tmp_path, "other.py", steps=30)
    sweep = ("sweep", "--timestep", "1/240,1/480", "--at", "0.1", "--out", "s")
    for typed, last in (
        (("ball.py",), ["drop why ball.py", "drop view recordings/ball.rrd"]),
        (("record", "--out", "other.rrd", "other.py"), ["drop analyze other.rrd"]),
        (("analyze", "other.rrd"), ["drop why other.py", "drop view other.rrd"]),
        (("check", "other.rrd", "--against", "recordings/ball.rrd"),
         ["drop view other.rrd --against recordings/ball.rrd",
          "drop check other.rrd --against recordings/ball.rrd --update"]),
        (("info", "recordings/ball.rrd"), ["drop view recordings/ball.rrd"]),
        (("info", "other.rrd"), ["drop view other.rrd"]),
        (("render", "other.rrd"), ["drop view other.rrd"]),
        (("export", "other.rrd"), ["drop view other.rrd"]),
        (("explain", "off-target"), ["drop explain --list"]),
        (("trust", "--out", "t", "--vary", "timestep/2", "ball.py"), ["drop why ball.py"]),
        (("why", "--out", "w", "--try", "gravity", "ball.py"), ["drop trust ball.py"]),
        (("simulate", "--out", "box.rrd", "--no-camera", "--duration", "0.1"),
         ["drop analyze box.rrd", "drop view box.rrd"]),
        (("run", "--no-camera", "--duration", "0.1"), ["drop view recordings/run.rrd"]),
        (sweep, ["drop analyze s/"]),
    ):  # fmt: skip
        done = drop(*typed)
        said = done.stderr if typed[0] == "record" else done.stdout
        ends = " ".join(said.replace("\\\n", "").rpartition("next ")[2].split())
        assert all(command in ends for command in last), (typed, said)


# -- nothing compared, and silence ----------------------------------------------------------------

ARM = """<robot name="arm"><link name="base"/><link name="upper"><inertial>
<origin xyz="0.25 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="100" velocity="10"/></joint></robot>"""
IN_BULLET = """import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("arm.urdf", useFixedBase=True)
p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0)
for _ in range(50):
    p.stepSimulation()
"""
IN_MUJOCO = """import mujoco
model = mujoco.MjModel.from_xml_path("arm.urdf")
model.opt.timestep = 1 / 240
data = mujoco.MjData(model)
for _ in range(50):
    mujoco.mj_step(model, data)
"""


@pytest.mark.long
def test_arms_with_other_names_are_not_called_identical(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    for name, text in (("bullet", IN_BULLET), ("other", IN_MUJOCO)):
        (tmp_path / f"{name}.py").write_text(text)
        drop("record", f"{name}.py")
    paths = [tmp_path / f"recordings/{name}.rrd" for name in ("other", "bullet")]
    done = drop("check", paths[0], "--against", paths[1])
    assert done.returncode == 3
    assert "nothing compared" in done.stdout
    assert "identical" not in done.stdout
    told = json.loads(drop("check", paths[0], "--against", paths[1], "--json").stdout)
    assert (told["same"], told["first_difference"]) == (False, None)
    assert told["largest_difference_m"] is None
    assert {*told["not_compared"]} == {"0_upper", "0_arm"}
    mine, theirs = (read(path).seen for path in paths)
    assert not apart(mine, theirs).same
    assert apart(mine, mine).same


def test_recordings_without_a_state_are_not_the_same(tmp_path: Path) -> None:
    script = tmp_path / "connects.py"
    script.write_text("import pybullet as p\np.connect(p.DIRECT)\n")
    paths = [tmp_path / "a.rrd", tmp_path / "b.rrd"]
    for path in paths:
        record_script(str(script), out=path)
    checked = check(*paths)
    assert not checked.same
    assert str(checked).startswith("undecided")
    assert "nothing compared" in str(checked)


def test_a_setting_that_only_one_version_has_is_no_difference(tmp_path: Path) -> None:
    """An example is `sleep_tolerance`, which only later versions of MuJoCo report."""
    (tmp_path / "arm.urdf").write_text(ARM)
    script = tmp_path / "arm.py"
    script.write_text(IN_MUJOCO.replace('"arm.urdf"', repr(str(tmp_path / "arm.urdf"))))
    record_script(str(script), out=tmp_path / "arm.rrd")
    mine, theirs = (script_side(tmp_path / "arm.rrd") for _ in range(2))
    for setting in theirs.seen.settings:
        del setting.values["sleep_tolerance"]
    for sides in ((mine, theirs), (theirs, mine)):
        assert compare(*sides).same
    for setting in theirs.seen.settings:
        setting.values["tolerance"] = 1e-7  # both have it: this is a difference
    found = compare(mine, theirs)
    assert found.same  # it has no effect
    assert found.first is None
    assert [difference.column for difference in found.differences] == ["engine.tolerance"]


def test_a_recording_says_which_pybullet_made_it(tmp_path: Path) -> None:
    script = written(tmp_path, "ball.py")
    record_script(str(script), out=tmp_path / "ball.rrd")
    assert (read(tmp_path / "ball.rrd").ended or {})["made_with_pybullet"] == "3.2.7"
    assert info(tmp_path / "ball.rrd").engine.startswith("PyBullet 3.2.7 in Python")


def test_of_nothing_found_it_is_said_what_was_looked_at(tmp_path: Path) -> None:
    script = written(tmp_path, "ball.py", steps=3)
    record_script(str(script), out=tmp_path / "ball.rrd")
    analysis = analyze(tmp_path / "ball.rrd")
    assert not analysis.findings
    for shown in (str(analysis), analysis.markdown(), analysis.markdown(at_the_end=True)):
        assert "no finding in 1 body, 0 movable joints, 3 steps" in shown
        assert "second look" not in shown


# -- scripts that start again, elsewhere, or ask --------------------------------------------------

AGAIN = {
    "the same file": "os.execv(sys.executable, [sys.executable, *sys.argv])",
    "with options": "os.execvp(sys.executable, [sys.executable, '-X', 'dev', '-u', *sys.argv])",
    "as it was started": "os.execv(sys.executable, sys.orig_argv)",
    "a module": "os.execle(sys.executable, 'python', '-m', 'ball', os.environ)",
}


@pytest.mark.starts
@pytest.mark.parametrize("how", some(AGAIN, 1))
def test_a_script_that_replaces_itself_is_recorded(drop: Drop, tmp_path: Path, how: str) -> None:
    again = f"if 'AGAIN' not in os.environ:\n    os.environ['AGAIN'] = ''\n    {AGAIN[how]}\n"
    (tmp_path / "ball.py").write_text("import os, sys\n" + again + FALLS.format(steps=24))
    done = drop("ball.py")
    assert done.returncode == 0
    assert "ball.py finished: 1 body, 24 steps, 100 % explained" in done.stdout


@pytest.mark.parametrize("steps", [0, 5])
def test_another_program_in_its_place_is_said_not_to_be_recorded(
    drop: Drop, tmp_path: Path, steps: int
) -> None:
    end = f"import os, sys\nos.execv({sys.executable!r}, ['python', '-c', 'print(1 + 1)'])\n"
    written(tmp_path, "ball.py", end, steps=steps)
    done = drop("ball.py")
    assert done.stdout.startswith("2\n")
    assert f"{steps} step" in done.stdout
    assert "not said  the script becomes another program" in done.stdout


FORKS = (
    FALLS.format(steps=0)
    + """
import os
child = os.fork()
if not child:
    for _ in range(9):
        p.stepSimulation()
    os._exit(0)
os.waitpid(child, 0)
p.disconnect()
"""
)


def test_what_other_processes_step_is_named_where_the_answer_is(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "forks.py").write_text(FORKS)
    done = drop("forks.py")
    assert "not said  other processes that the script starts use the engine" in done.stdout


def test_no_progress_is_shown_while_a_script_waits(tmp_path: Path) -> None:
    script = written(tmp_path, "asks.py", "print(input('how high? '))\n")
    asked = tmp_path / "typed.txt"
    asked.write_text("1.5\n")
    sent: list[dict[str, object]] = []

    class Kept(Decoder):
        def _on_waits(self, *, begins: bool) -> None:
            sent.append({"begins": begins})
            super()._on_waits(begins=begins)

    decoder = Kept()
    frames = [
        pipe.frame(pipe.NOTE, pipe.encoded({"what": "waits", "begins": now}))
        for now in (True, False)
    ]
    assert [*decoder.feed(pipe.MAGIC + frames[0])] == []
    assert decoder.waits
    assert [*decoder.feed(frames[1])] == []
    assert not decoder.waits
    with asked.open("rb") as stdin:
        kept = os.dup(0)
        os.dup2(stdin.fileno(), 0)
        try:
            recorded = record_script(str(script), out=tmp_path / "asks.rrd")
        finally:
            os.dup2(kept, 0)
            os.close(kept)
    assert recorded.ended == "finished"


@pytest.mark.starts
def test_a_viewer_that_needs_a_window_says_so(
    drop: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "looks.py").write_text(
        "import mujoco, mujoco.viewer\nmodel = mujoco.MjModel.from_xml_string('<mujoco/>')\n"
        "mujoco.viewer.launch(model, mujoco.MjData(model))\n"
    )
    done = drop("looks.py")
    assert done.returncode == 1
    assert "mujoco.mj_step(model, data) in a loop" in " ".join(done.stdout.split())
    assert info(tmp_path / "recordings/looks.rrd").engine.startswith("MuJoCo ")


@pytest.mark.long
def test_the_plot_of_a_script_has_the_call_that_changes_it(tmp_path: Path) -> None:
    script = written(tmp_path, "ball.py", steps=240)
    record_script(str(script), out=tmp_path / "ball.rrd")
    drawn = render(tmp_path / "ball.rrd", plot=tmp_path / "ball.svg").plot
    assert drawn is not None
    (finding,) = analyze(tmp_path / "ball.rrd").findings
    assert finding.cure is not None
    assert finding.cure.call in drawn.read_text()


def test_info_of_a_recording_with_a_layer_says_how_to_see_it(tmp_path: Path) -> None:
    script = written(tmp_path, "ball.py")
    record_script(str(script), out=tmp_path / "ball.rrd", python=os.path.realpath(sys.executable))
    analyze(tmp_path / "ball.rrd")
    told = info(tmp_path / "ball.rrd")
    assert report_of(told).next == [f"drop view {tmp_path / 'ball.rrd'}"]
    assert f"--python {os.path.realpath(sys.executable)}" in str(told.command)


def test_a_narrow_terminal_says_which_columns_it_leaves_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    script = tmp_path / "arm.py"
    turns = IN_BULLET.replace("VELOCITY_CONTROL, force=0", "POSITION_CONTROL, 1, force=5")
    script.write_text(turns.replace("arm.urdf", str(tmp_path / "arm.urdf")))
    record_script(str(script), out=tmp_path / "arm.rrd")
    analysis = analyze(tmp_path / "arm.rrd")
    for columns, said in ((100, False), (55, True)):
        monkeypatch.setattr("drop_physics.report.terminal.width", lambda wide=columns: wide)
        lines = terminal.lines_of(analysis.report(verbose=True))
        assert any("left out, for want of room: " in line for line in lines) == said


@pytest.mark.long
def test_a_notebook_names_no_option_of_the_command_line(tmp_path: Path) -> None:
    script = written(tmp_path, "ball.py", "import random; random.random()\n", steps=240)
    recorded = record_script(str(script), out=tmp_path / "ball.rrd")
    analysis = analyze(tmp_path / "ball.rrd")
    for result in (recorded, analysis, check(tmp_path / "ball.rrd", tmp_path / "ball.rrd")):
        shown = result._repr_html_().partition("<img")[0]
        assert "--" not in shown
        assert "drop analyze" not in shown
    assert "as_json()" in analysis._repr_html_()


@pytest.mark.long
def test_a_block_prints_as_its_recording_and_warns_where_it_is_empty(tmp_path: Path) -> None:
    code = f"""
import pybullet as p, warnings
from drop_physics import record
warnings.simplefilter("error")
with record({str(tmp_path / "a.rrd")!r}) as block:
    exec({FALLS.format(steps=24)!r})
    assert repr(block) == "being recorded, 24 steps so far", repr(block)
assert str(block) == str(block.recorded), str(block)
assert "25 samples" in block._repr_html_()
try:
    with record({str(tmp_path / "b.rrd")!r}):
        pass
except UserWarning as warned:
    print(warned)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "nothing was simulated in this block" in done.stdout


def test_the_package_says_what_it_is_for() -> None:
    said = str(drop_physics.__doc__)
    assert said.index("MuJoCo") < said.index("box")
    assert drop_physics.why.__name__ == "why"


SEVERAL = """import pybullet as p
for _ in range(3):
    client = p.connect(p.DIRECT)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=client)
    p.createMultiBody(1, shape, physicsClientId=client)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    for _ in range(24):
        p.stepSimulation(physicsClientId=client)
"""


def test_a_film_shows_simulations_side_by_side(tmp_path: Path) -> None:
    script = tmp_path / "several.py"
    script.write_text(SEVERAL)
    record_script(str(script), out=tmp_path / "several.rrd")
    held = read(tmp_path / "several.rrd")
    parts = parts_of(held.path, held.seen)
    poses = film._poses(parts, np.array([0.0, 0.05]))
    moved = film._side_by_side(parts, poses, film._places(held.seen, parts, poses))
    apart_m = np.linalg.norm(moved[:, :, None, :3] - moved[:, None, :, :3], axis=-1)
    assert (apart_m[:, ~np.eye(3, dtype=bool)] > 0.2).all()  # no ball is within another
    assert np.array_equal(moved[1] - moved[0], poses[1] - poses[0])


def test_what_is_far_from_a_links_centre_is_in_the_ball_around_it() -> None:
    """A torso has a head whose far side is 0.4 m from the torso's centre."""
    torso = Shape(-1, "sphere", (0.1,), "", (0.0, 0.0, -0.1), (0, 0, 0, 1), (1, 1, 1, 1))
    head = replace(torso, size_m=(0.1,), position_m=(0.0, 0.0, 0.3))
    body = SimpleNamespace(shapes=(torso, head), bounds_m=(-0.1, -0.1, -0.2, 0.1, 0.1, 0.4))
    assert scene._radius_m(body, -1) == pytest.approx(0.4)
