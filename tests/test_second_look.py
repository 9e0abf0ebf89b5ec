"""A user's second hour: an edited script is recorded and analyzed again.

What is recorded under the default name, which recording is meant where none is named, and what the
commands say about it.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from command import drop_here, environment
from conftest import Drop, some
from drop_physics import record_script
from drop_physics.errors import ScenarioError

pytestmark = pytest.mark.pybullet

FALLS = """import pybullet as p
p.connect(p.DIRECT)
p.createMultiBody({mass}, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
p.setGravity(0, 0, -10)
for _ in range({steps}):
    p.stepSimulation()
"""


def falls(path: Path, *, mass: float = 1.0, steps: int = 3) -> Path:
    """Write a script in which a ball of a given mass falls."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(FALLS.format(mass=mass, steps=steps))
    return path


def names(folder: Path) -> list[str]:
    return sorted(each.name for each in (folder / "recordings").iterdir())


def mass_kg(drop: Drop, *recording: object) -> str:
    """Return the ball's mass as `analyze` reports it."""
    (found,) = re.findall(r"(\S+ kg)", drop("analyze", "--verbose", *recording).stdout)
    return str(found)


def made_at(path: Path, seconds: int) -> None:
    """Set the modification time of a file: on a fast disk two writes may have the same time."""
    os.utime(path, (seconds, seconds))


# -- what is recorded -----------------------------------------------------------------------------


def test_the_second_look_shows_the_new_answer(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "ball.py", mass=1)
    drop("record", "ball.py")
    assert mass_kg(drop, "recordings/ball.rrd") == "1 kg"
    falls(tmp_path / "ball.py", mass=2)
    again = drop("record", "ball.py", "--its-own", "argument")
    assert "recordings/ball.rrd" in again.stderr
    assert names(tmp_path) == ["ball.rrd"]  # the layer of the first went with it
    assert mass_kg(drop, "recordings/ball.rrd") == "2 kg"


@pytest.mark.long
def test_a_module_replaces_its_own_recording(
    drop: Drop, drop_process: Drop, tmp_path: Path
) -> None:
    falls(tmp_path / "ball.py")
    for command in (drop_process, drop):
        assert command("record", "-m", "ball").returncode == 0
    assert names(tmp_path) == ["ball.rrd"]
    assert drop("record", "ball.py").returncode == 0  # no module: another script
    assert names(tmp_path) == ["ball-2.rrd", "ball.rrd"]


def test_a_script_elsewhere_of_the_same_name_is_another(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "a/ball.py", mass=1)
    falls(tmp_path / "b/ball.py", mass=2)
    for script in ("a/ball.py", "b/ball.py", "a/ball.py", "./b/../b/ball.py"):
        drop("record", script)
    assert names(tmp_path) == ["ball-2.rrd", "ball.rrd"]
    assert mass_kg(drop, "recordings/ball.rrd") == "1 kg"
    assert mass_kg(drop, "recordings/ball-2.rrd") == "2 kg"
    assert mass_kg(drop, "a/ball.py") == "1 kg"
    (tmp_path / "c").symlink_to("b")
    assert mass_kg(drop, "c/ball.py") == "2 kg"  # the same file


@pytest.mark.parametrize("what", some(["text", "a drop", "a link", "a folder", "no path"], 1))
def test_what_else_has_the_name_is_left_alone(drop: Drop, tmp_path: Path, what: str) -> None:
    falls(tmp_path / "ball.py")
    theirs = tmp_path / "recordings/ball.rrd"
    theirs.parent.mkdir()
    if what == "text":
        theirs.write_text("mine")
    elif what == "a drop":
        drop("simulate", "--out", theirs, "--no-camera", "--duration", "0.1")
    elif what == "a link":
        drop("record", "ball.py")
        theirs.rename(tmp_path / "kept.rrd")
        theirs.symlink_to(tmp_path / "kept.rrd")
    elif what == "a folder":
        theirs.mkdir()
    else:  # a block says nothing of a script
        block = (
            f"from drop_physics import record\nwith record({str(theirs)!r}):\n"
            f"    exec({FALLS.format(mass=1, steps=2)!r})"
        )
        subprocess.run([sys.executable, "-c", block], env=environment(), check=True)
    before = theirs.lstat()
    for _ in range(2):  # of the second time, too: that replaces its own
        drop("record", "ball.py")
        assert names(tmp_path) == ["ball-2.rrd", "ball.rrd"]
    assert os.path.samestat(theirs.lstat(), before)
    assert theirs.lstat().st_mtime_ns == before.st_mtime_ns


def test_a_layer_of_something_else_stays(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    drop("record", "--out", "other.rrd", "ball.py")
    drop("analyze", "other.rrd", "--out", "recordings/ball.analysis.rrd")
    drop("record", "ball.py")
    assert names(tmp_path) == ["ball.analysis.rrd", "ball.rrd"]


BROKEN = "import pybullet as p\np.connect(p.DIRECT)\nraise ValueError('a typo')\n"


def test_without_a_step_nothing_is_replaced_but_what_has_none(drop: Drop, tmp_path: Path) -> None:
    script = falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    script.write_text(BROKEN)
    for _ in range(2):
        failed = drop("record", "ball.py")
        assert failed.returncode == 1
        assert "recordings/ball-2.rrd" in failed.stderr
        assert names(tmp_path) == ["ball-2.rrd", "ball.rrd"]
    assert mass_kg(drop, "recordings/ball.rrd") == "1 kg"
    falls(script, mass=3)
    drop("record", "ball.py")
    assert mass_kg(drop, "recordings/ball.rrd") == "3 kg"


def test_a_script_that_fails_after_a_step_replaces(drop: Drop, tmp_path: Path) -> None:
    script = falls(tmp_path / "ball.py", mass=1)
    drop("record", "ball.py")
    script.write_text(FALLS.format(mass=2, steps=1) + "raise ValueError\n")
    assert drop("record", "ball.py").returncode == 1
    assert names(tmp_path) == ["ball.rrd"]
    assert mass_kg(drop, "recordings/ball.rrd") == "2 kg"


def test_a_recording_that_is_not_finished_replaces_nothing(drop: Drop, tmp_path: Path) -> None:
    script = falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    before = (tmp_path / "recordings/ball.rrd").read_bytes()
    script.write_text("import os\n" + FALLS.format(mass=2, steps=3) + "os.kill(os.getppid(), 9)\n")
    done = subprocess.run(
        [sys.executable, "-m", "drop_physics", "record", "ball.py"],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        check=False,
    )
    assert done.returncode == -9
    assert (tmp_path / "recordings/ball.rrd").read_bytes() == before
    assert mass_kg(drop) == "1 kg"


def test_what_another_process_recorded_meanwhile_is_left_alone(drop: Drop, tmp_path: Path) -> None:
    """A script records itself with other arguments, as a shell loop over seeds does."""
    again = "import subprocess, sys\nif len(sys.argv) < 2:\n    subprocess.run({command})\n"
    command = [sys.executable, "-m", "drop_physics", "record", "ball.py", "inner"]
    script = falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    script.write_text(FALLS.format(mass=2, steps=3) + again.format(command=command))
    drop("record", "ball.py")
    assert names(tmp_path) == ["ball-2.rrd", "ball.rrd"]
    arguments = {
        name: json.loads(drop("analyze", f"recordings/{name}", "--json").stdout)["origin"]
        for name in ("ball.rrd", "ball-2.rrd")
    }
    assert "inner" in str(arguments["ball.rrd"])
    assert "inner" not in str(arguments["ball-2.rrd"])


def test_keep_numbers_and_force_replaces_whatever_there_is(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    drop("record", "--keep", "ball.py")
    drop("record", "--keep", "ball.py")
    assert names(tmp_path) == ["ball-2.rrd", "ball-3.rrd", "ball.rrd"]
    (tmp_path / "recordings/ball.rrd").write_text("mine")
    drop("record", "--force", "ball.py")
    assert names(tmp_path) == ["ball-2.rrd", "ball-3.rrd", "ball.rrd"]
    assert mass_kg(drop, "recordings/ball.rrd") == "1 kg"
    for more in (["--force"], ["--out", "x.rrd"]):
        wrong = drop("record", "--keep", *more, "ball.py")
        assert (wrong.returncode, len(wrong.stderr.splitlines())) == (2, 1)
    with pytest.raises(ScenarioError, match=r"^keep numbers"):
        record_script(str(tmp_path / "ball.py"), keep=True, force=True)


def test_force_is_about_the_name_without_a_number(drop: Drop, tmp_path: Path) -> None:
    """Another script's recording, named ball-2, is not replaced if this run fails."""
    falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    falls(tmp_path / "b/ball.py", steps=0)
    drop("record", "b/ball.py")
    theirs = (tmp_path / "recordings/ball-2.rrd").read_bytes()
    (tmp_path / "ball.py").write_text(BROKEN)
    failed = drop("record", "--force", "ball.py")
    assert (failed.returncode, "recordings/ball-3.rrd" in failed.stderr) == (1, True)
    assert names(tmp_path) == ["ball-2.rrd", "ball-3.rrd", "ball.rrd"]
    assert (tmp_path / "recordings/ball-2.rrd").read_bytes() == theirs
    assert mass_kg(drop, "recordings/ball.rrd") == "1 kg"


@pytest.mark.long
def test_a_folder_that_is_not_there_is_made(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "ball.py")
    assert drop("record", "--out", "a/b/ball.rrd", "ball.py").returncode == 0
    assert drop("analyze", "a/b/ball.rrd", "--out", "c/l.rrd", "--table", "d/t.csv").returncode == 0
    assert drop("render", "a/b/ball.rrd", "--out", "e/f.gif", "--plot", "g/p.svg").returncode == 0
    assert drop("check", "a/b/ball.rrd", "--against", "h/g.rrd", "--update").returncode == 0
    for made in ("a/b/ball.rrd", "c/l.rrd", "d/t.csv", "e/f.gif", "g/p.svg", "h/g.rrd"):
        assert (tmp_path / made).is_file(), made


def test_a_folder_that_cannot_be_made_is_one_line(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "ball.py")
    done = drop("record", "--out", "ball.py/a/ball.rrd", "ball.py")
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert "the folder ball.py/a cannot be created: Not a directory" in done.stderr


# -- which recording is meant ---------------------------------------------------------------------


def test_without_a_file_the_newest_recording_is_taken_and_named(drop: Drop, tmp_path: Path) -> None:
    for name, mass in (("old", 1), ("new", 2)):
        falls(tmp_path / f"{name}.py", mass=mass)
        drop("record", f"{name}.py")
    folder = tmp_path / "recordings"
    drop("analyze", "recordings/old.rrd", "--out", "recordings/a-layer.rrd")
    drop("analyze", "recordings/old.rrd")
    for name in ("golden.rrd", "new-golden.rrd", "x.rrd.part", "y.rrd.2.part"):
        (folder / name).write_bytes((folder / "old.rrd").read_bytes())
    for name in ("golden", "old-trust", "sweep/recordings"):
        (folder / name).mkdir(parents=True)
        (folder / name / "run.rrd").write_bytes((folder / "old.rrd").read_bytes())
    for path in folder.rglob("*.*"):
        made_at(path, 2_000_000_000)
    made_at(folder / "old.rrd", 1_000_000_000)
    made_at(folder / "new.rrd", 1_500_000_000)
    said = "drop: recordings/new.rrd is the newest recording\n"
    done = drop("analyze", "--json")
    assert (json.loads(done.stdout)["recording"], done.stderr) == ("recordings/new.rrd", said)
    assert mass_kg(drop) == "2 kg"
    done = drop("render", "--json")
    assert (json.loads(done.stdout)["plot"], done.stderr) == ("recordings/new.png", said)
    assert said in drop("info").stderr
    made_at(folder / "old.rrd", 1_600_000_000)
    assert mass_kg(drop) == "1 kg"


def test_view_opens_the_newest(drop: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drop_physics.stages.view.show", lambda _: None)
    monkeypatch.setenv("DISPLAY", ":0")
    falls(tmp_path / "ball.py")
    drop("record", "ball.py")
    for given in ([], ["ball.py"]):
        done = drop("view", *given, "--json")
        assert json.loads(done.stdout)["recordings"] == ["recordings/ball.rrd"], done.stderr
        assert "recordings/ball.rrd is the newest recording" in done.stderr


def test_the_recording_of_a_script_called_golden_is_no_golden(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "golden.py", mass=2)
    drop("record", "golden.py")
    assert mass_kg(drop) == "2 kg"


def test_a_drop_counts_and_what_is_not_ours_does_not(drop: Drop, tmp_path: Path) -> None:
    from rerun.chunk import LazyChunkStream

    folder = tmp_path / "recordings"
    drop("simulate", "--out", "recordings/run.rrd", "--no-camera", "--duration", "0.1")
    LazyChunkStream.from_iter([]).write_rrd(
        folder / "theirs.rrd", application_id="x", recording_id="y"
    )
    made_at(folder / "theirs.rrd", 2_000_000_000)
    assert "recordings/run.rrd is the newest" in drop("analyze").stderr
    (folder / "damaged.rrd").write_bytes((folder / "run.rrd").read_bytes()[:-9999])
    made_at(folder / "damaged.rrd", 2_000_000_001)
    done = drop("analyze")  # the older one would be taken for it
    assert done.returncode == 1
    assert "damaged.rrd" in done.stderr


def test_where_there_is_none_it_says_how_to_make_one(drop: Drop, tmp_path: Path) -> None:
    for command in ("analyze", "render", "view"):
        done = drop(command)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr == (
            "drop: there is no recording in recordings; make one with: drop record SCRIPT.py, or "
            "name the file\n"
        )
    falls(tmp_path / "ball.py")
    done = drop("analyze", "ball.py")
    assert (done.returncode, done.stderr) == (
        1,
        "drop: there is no recording of ball.py in recordings; make one with: drop record "
        "ball.py\n",
    )


def test_of_a_script_its_own_recording_is_taken(drop: Drop, tmp_path: Path) -> None:
    for name, mass in (("ball", 1), ("other", 2)):
        falls(tmp_path / f"{name}.py", mass=mass)
        drop("record", f"{name}.py")
    done = drop("analyze", "ball.py")
    assert "1 body, 3 steps" in done.stdout
    assert done.stderr == "drop: recordings/ball.rrd is the newest recording of ball.py\n"
    falls(tmp_path / "ball.py", mass=3)
    done = drop("analyze", "ball.py")
    assert "1 body, 3 steps" in done.stdout
    assert done.stderr == (
        "drop: recordings/ball.rrd is the newest recording of ball.py, which has changed since; "
        "record it again: drop record ball.py\n"
    )


# -- drop SCRIPT.py -------------------------------------------------------------------------------


def test_a_script_alone_is_recorded_and_analyzed(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "ball.py", mass=2)
    done = drop("ball.py")
    assert done.returncode == 0
    assert "ball.py finished: 1 body, 3 steps, 100 % explained" in done.stdout
    assert "recorded  recordings/ball.rrd" in done.stderr
    assert "drop analyze" not in done.stderr
    assert names(tmp_path) == ["ball.analysis.rrd", "ball.rrd"]


def test_what_stands_after_it_is_the_scripts(drop: Drop, tmp_path: Path) -> None:
    (tmp_path / "says.py").write_text("import sys\nprint(sys.argv[1:])\n")
    own = ["--help", "--json", "--", "-x", "record"]
    done = drop("says.py", *own)
    assert done.stdout.splitlines()[0] == str(own)
    assert done.stderr.splitlines()[0] == (
        "drop: what comes after says.py goes to the script, --json too; put drop's options before "
        "the script"
    )


@pytest.mark.parametrize(
    ("script", "code"),
    [("import sys\nsys.exit(7)\n", 1), ("import pybullet\n", 0), (BROKEN, 1)],
)
def test_the_exit_code_is_that_of_record(
    drop: Drop, tmp_path: Path, script: str, code: int
) -> None:
    (tmp_path / "ends.py").write_text(script)
    assert drop("record", "ends.py").returncode == code
    assert drop("ends.py").returncode == code


def test_a_name_with_a_typo_is_asked_about(drop: Drop) -> None:
    done = drop("anlyze")
    assert (done.returncode, done.stderr) == (
        2,
        "drop: no such command 'anlyze'; did you mean 'analyze'?; see: drop --help\n",
    )
    done = drop("bal.py")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "'bal.py'" in done.stderr


# -- what is said ---------------------------------------------------------------------------------


def test_record_ends_with_the_next_step(drop: Drop, tmp_path: Path) -> None:
    falls(tmp_path / "my ball.py")
    done = drop("record", "my ball.py")
    assert done.stderr.splitlines()[-1] == "next      drop analyze 'recordings/my ball.rrd'"
    falls(tmp_path / "ball.py")
    assert drop("record", "--out", "b.rrd", "ball.py").stderr.endswith("drop analyze b.rrd\n")
    (tmp_path / "fails.py").write_text(BROKEN)
    failed = drop("record", "fails.py").stderr.splitlines()
    assert failed[-1] == "next      drop analyze recordings/fails.rrd"
    assert "next" not in drop("record", "--json", "ball.py").stderr
    (tmp_path / "empty.py").write_text("")
    assert "next" not in drop("record", "empty.py").stderr  # there is nothing to look at


def test_help_says_what_it_is_for_and_groups_the_commands(drop: Drop) -> None:
    said = drop("--help").stdout
    assert len(said.splitlines()) <= 40
    assert said.index("a PyBullet or MuJoCo script") < said.index("a box")
    own, box, recordings = (
        said.index(f"\n{each}:\n") for each in ("Your own script", "The falling box", "Recordings")
    )
    assert own < box < recordings
    groups = {"own": said[own:box], "box": said[box:recordings], "recordings": said[recordings:]}
    commands = {
        "own": {"SCRIPT.py", "diff", "explain", "import", "record", "trust", "why"},
        "box": {"run", "simulate", "sweep"},
        "recordings": {"analyze", "check", "export", "info", "render", "view"},
    }
    for group, expected in commands.items():
        assert {*re.findall(r"^  (\S+)  ", groups[group], re.MULTILINE)} == expected


HEAVY = {"numpy", "polars", "pyarrow", "pybullet", "rerun", "matplotlib", "scipy", "PIL"}


WRONG = (
    *("anlyze", "analyze", "analyze no.rrd", "analyze .", "analyze no.py", "render picture.png"),
    *("view no.rrd", "info no.rrd", "record no.py", "no.py"),
)


def test_an_error_that_needs_no_library_loads_none(tmp_path: Path) -> None:
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    code = f"""
import sys
from drop_physics.console.running import main
for command in {WRONG}:
    sys.argv = ["drop", *command.split()]
    try:
        main()
    except SystemExit as ended:
        print(ended.code, sorted({HEAVY} & set(sys.modules)), file=sys.stderr)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    said = done.stderr.splitlines()
    assert len(said) == 2 * len(WRONG)
    assert all(error.startswith("drop: ") for error in said[::2])
    assert {*said[1::2]} == {"1 []", "2 []"}


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n" + b"0" * 99, b"hello", b""])
@pytest.mark.parametrize("command", ["analyze", "render", "info", "view"])
def test_what_is_no_recording_is_not_called_damaged(
    tmp_path: Path, command: str, content: bytes
) -> None:
    (tmp_path / "some.png").write_bytes(content)
    done = drop_here(command, "some.png", folder=tmp_path)
    assert (done.returncode, done.stderr) == (
        1,
        "drop: some.png is not a Rerun recording; make one with: drop record, or drop simulate\n",
    )


@pytest.mark.parametrize(
    ("script", "printed", "ours"),
    some(
        [
            ("raise ValueError('a typo')", "ValueError: a typo", "the script fails; what"),
            ("import sys; sys.exit('no such arm')", "no such arm", "the script fails; what"),
            ("import sys; sys.exit(4)", "sys.exit(4)", "the script fails: sys.exit(4); what"),
            (
                "import pybullet as p; p.connect(2); p.loadURDF('no.urdf')",
                "pybullet.error: Cannot load URDF file",
                "a file that it cannot find or read: There is no no.urdf",
            ),
            (
                "import pybullet as p; p.stepSimulation()",
                "Not connected to physics server",
                "the script fails: There is no simulation with that number",
            ),
            (
                "import os; os.kill(os.getpid(), 9)",
                "it was ended by SIGKILL",
                "the script fails: it was ended by SIGKILL; what",
            ),
        ],
        2,
    ),
)
def test_the_error_of_a_script_is_printed_once(
    drop: Drop, tmp_path: Path, script: str, printed: str, ours: str
) -> None:
    """The script prints it, or we do if it does not; the underlying error is added."""
    (tmp_path / "fails.py").write_text(script + "\n")
    said = drop("record", "fails.py").stderr
    assert said.count(printed) == 1
    assert ours in " ".join(said.split())
    alone = drop("analyze", "fails.py").stdout  # where nothing else says it
    assert printed in " ".join(alone.split())
