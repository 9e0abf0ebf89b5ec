"""`drop` without PyBullet, and scripts in environments of their own."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path

import drop_physics
import numpy as np
import pytest
from command import HANGS_S
from drop_physics.engines.channel import wide_pipe
from drop_physics.engines.other_world import OtherWorld
from drop_physics.engines.urdf import STANDARD, read_urdf
from drop_physics.errors import ScenarioError
from drop_physics.scenario import Scenario
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.trace.states import BODY
from drop_physics.workers import cores

PACKAGE = Path(drop_physics.__file__).parent
MISSING = "import sys\nsys.modules.update(pybullet=None, pybullet_data=None)\n"
"""A `sitecustomize` that makes PyBullet impossible to import or find."""
Call = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def without(tmp_path: Path) -> Call:
    """Return the command line as a process without PyBullet, in a folder of its own."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site/sitecustomize.py").write_text(MISSING)
    paths = os.pathsep.join(map(str, (tmp_path / "site", PACKAGE.parent)))

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "drop_physics", *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": paths},
            capture_output=True,
            text=True,
            check=False,
            timeout=HANGS_S,
        )

    return call


# -- without PyBullet -----------------------------------------------------------------------------


def test_the_box_falls_in_mujoco_and_the_first_line_says_so(without: Call, tmp_path: Path) -> None:
    done = without("run")
    first, *_ = done.stderr.splitlines()
    assert ": this is MuJoCo's fall; " in first
    assert "pip install" in first
    assert done.returncode == 0
    assert "dropped in MuJoCo" in done.stdout
    assert "-6.1313 mm" in done.stdout  # what Euler's method adds; MuJoCo damps nothing
    made = {path.name for path in (tmp_path / "recordings").iterdir()}
    assert made == {"run.rrd", "run.analysis.rrd", "run.png"}
    again = without("check", "recordings/run.rrd", "--against", "recordings/run.rrd")
    assert "identical" in again.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        "run --engine bullet",
        "simulate --out a.rrd --engine bullet",
        "sweep --engine bullet --out a",
    ],
)
def test_pybullet_that_is_asked_for_is_missed_in_one_line(without: Call, arguments: str) -> None:
    done = without(*arguments.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "--engine bullet cannot be used: PyBullet " in done.stderr
    assert "pip install" in done.stderr


def test_a_sweep_and_a_plot_need_none(without: Call, tmp_path: Path) -> None:
    swept = without("sweep", "--timestep", "1/240,1/480", "--out", "swept")
    assert swept.returncode == 0, swept.stderr
    assert "1/480" in swept.stdout
    hop = "import mujoco\nm = mujoco.MjModel.from_xml_string('<mujoco><worldbody><body><freejoint/>"
    hop += '<geom size=".1"/></body></worldbody></mujoco>\')\nd = mujoco.MjData(m)\n'
    (tmp_path / "hop.py").write_text(f"{hop}for _ in range(50): mujoco.mj_step(m, d)\n")
    assert without("hop.py").stdout.startswith("hop.py finished: 1 body, 50 steps")
    rendered = without("render", "recordings/hop.rrd")
    assert (rendered.returncode, rendered.stdout.startswith("plot")) == (0, True)
    film = without("render", "recordings/hop.rrd", "--out", "hop.gif")
    assert film.returncode == 2
    assert "a film of poses cannot be used: PyBullet " in film.stderr


def test_a_golden_recording_of_mujoco_names_its_version(without: Call, tmp_path: Path) -> None:
    import mujoco

    scene = "import mujoco\nm = mujoco.MjModel.from_xml_path('ball.xml')\n"
    ball = '<body><freejoint/><geom size=".1"/></body>'
    (tmp_path / "ball.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    (tmp_path / "sim.py").write_text(f"{scene}mujoco.mj_step(m, mujoco.MjData(m))\n")
    assert without("record", "--out", "new.rrd", "sim.py").returncode == 0
    made = without("check", "new.rrd", "--against", "golden.rrd", "--update")
    assert made.returncode == 0, made.stderr
    assert f"Made with MuJoCo {mujoco.__version__}." in (tmp_path / "golden.md").read_text()


def test_a_script_of_pybullet_is_told_what_it_needs(tmp_path: Path) -> None:
    """The script's interpreter does not have PyBullet; `drop` itself may."""
    venv.create(tmp_path / ".venv", symlinks=True)
    (tmp_path / "fall.py").write_text("import pybullet\n")
    done = subprocess.run(
        [sys.executable, "-m", "drop_physics", "record", "fall.py"],
        cwd=tmp_path,
        env={
            name: each for name, each in os.environ.items() if name not in (*ACTIVE, "PYTHONPATH")
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    said = " ".join(done.stderr.split())
    assert f"fall.py runs with {tmp_path}/.venv/bin/python" in said
    assert "this needs pybullet: " in said
    assert "-m pip install pybullet" in said


def test_what_only_linux_has_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """On macOS pipes cannot be enlarged, and a process's processors are not reported."""
    monkeypatch.delattr(fcntl, "F_SETPIPE_SZ")
    monkeypatch.delattr(os, "sched_getaffinity")
    for end in wide_pipe():
        os.close(end)
    assert cores() == os.cpu_count()


# -- what a URDF says -----------------------------------------------------------------------------

INERTIA = '<mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
"""The URDF's inertia, which neither we nor PyBullet use."""
BODIES = {
    "box": '<collision><geometry><box size=".1 .2 .3"/></geometry></collision>',
    "ball": '<collision><geometry><sphere radius=".07"/></geometry></collision>',
    "turned box": '<inertial><origin xyz=".01 .02 .03"/>' + INERTIA + "<collision>"
    '<origin xyz=".05 0 .1" rpy=".3 .2 .1"/><geometry><box size=".1 .2 .3"/></geometry>'
    "</collision>",
}


@pytest.mark.pybullet
@pytest.mark.parametrize("kind", BODIES)
def test_a_body_is_read_as_pybullet_reads_it(kind: str, tmp_path: Path) -> None:
    """An exception is an off-centre shape's inertia: PyBullet uses that of its bounding box."""
    from drop_physics.engines.pybullet.world import World

    file, turned = tmp_path / "body.urdf", (20.0, 30.0, 40.0)
    inertial = "" if "<inertial>" in BODIES[kind] else f"<inertial>{INERTIA}"
    file.write_text(f'<robot name="b"><link name="l">{inertial}{BODIES[kind]}</link></robot>')
    scenario = Scenario(body=str(file), orientation=turned)
    ours = read_urdf(file)
    with World(scenario) as world:
        report, (shape,) = world.report(), world.shapes()
        assert ours.half_size_m == pytest.approx(world.half_size_m, abs=2e-3)  # and its margin
    (own,) = ours.body.shapes
    assert (ours.body.mass_kg, own.kind) == (report.mass_kg, shape.kind)
    assert own.position_m == pytest.approx(shape.position_m, abs=1e-12)
    assert own.orientation == pytest.approx(shape.orientation, abs=1e-12)
    assert report.rest_height_m is not None
    assert ours.rest_height_m(scenario.orientation_xyzw) == pytest.approx(
        report.rest_height_m, abs=1e-6
    )
    if kind != "turned box":
        assert ours.body.inertia_kg_m2 == pytest.approx(report.inertia_kg_m2, rel=1e-12)


@pytest.mark.pybullet
def test_the_standard_body_falls_the_same_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Airborne and without spin: Bullet's inertia differs in the last digit, due to its margin."""
    scenario = Scenario(engine="mujoco", velocity_m_s=(1.0, 0.0, 2.0))
    falls = []
    for has in (True, False):
        monkeypatch.setattr("drop_physics.engines.other_world.is_installed", lambda _, has=has: has)
        with OtherWorld(scenario) as world:
            (samples,) = world.samples(scenario.steps + 1)
            falls.append((samples.bases[BODY], world.rest_height_m))
    (theirs, _), (ours, _) = falls
    in_the_air = theirs[:, 2] > 0.026
    assert in_the_air.sum() > 100
    assert np.array_equal(theirs[in_the_air], ours[in_the_air])
    assert ours[-1, 2] == pytest.approx(theirs[-1, 2], abs=1e-6)
    assert falls[0][1] == pytest.approx(falls[1][1], abs=1e-12)


def test_inertia_is_that_of_uniform_shapes() -> None:
    """A capsule's inertia is integrated over its slices: discs of radius r at height z."""
    z_m = np.linspace(-0.2, 0.2, 400_001)
    radius_m = np.sqrt(np.clip(0.05**2 - np.clip(np.abs(z_m) - 0.15, 0, None) ** 2, 0, None))
    weight = radius_m**2 / (radius_m**2).sum()
    along = 3 * (weight * radius_m**2 / 2).sum()
    across = 3 * (weight * (radius_m**2 / 4 + z_m**2)).sum()
    from drop_physics.engines.rigid_body import PrimitiveShape
    from drop_physics.engines.urdf import _of_shape

    capsule = PrimitiveShape("capsule", (0.05, 0.3, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert _of_shape(3.0, capsule) == pytest.approx([across, across, along], rel=1e-6)
    assert read_urdf(STANDARD, 0.6).body.inertia_kg_m2 == pytest.approx([0.6 * 0.05**2 / 6] * 3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("no xml", "must be a URDF"),
        ('<robot><link name="a"/><link name="b"/></robot>', "a body of one link, got 2 links"),
        ('<robot><link><inertial><mass value="0"/></inertial></link></robot>', "must have a mass"),
        (
            '<robot><link><collision><geometry><mesh filename="a.obj"/></geometry></collision>'
            "</link></robot>",
            "a shape of kind mesh",
        ),
        (
            '<robot><link><collision><geometry><box size="1 2"/></geometry></collision></link>'
            "</robot>",
            "must be a URDF",
        ),
    ],
)
def test_what_we_cannot_read_is_named(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "body.urdf").write_text(text)
    with pytest.raises(ScenarioError, match=said):
        read_urdf(tmp_path / "body.urdf")


# -- the script's interpreter ---------------------------------------------------------------------

ACTIVE = "VIRTUAL_ENV", "CONDA_PREFIX"


def environment(folder: Path) -> str:
    """Create an environment, and return its interpreter."""
    (folder / "bin").mkdir(parents=True)
    (folder / "pyvenv.cfg").touch()
    (folder / "bin/python").symlink_to(sys.executable)
    return str(folder / "bin/python")


def test_a_script_runs_in_its_users_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ACTIVE:
        monkeypatch.delenv(name, raising=False)
    script, notes = tmp_path / "project/src/sim.py", list[str]()
    script.parent.mkdir(parents=True)

    def found(given: str | None = None) -> str:
        notes.clear()
        return interpreter_of(str(script), is_module=False, given=given, note=notes.append)

    assert (found(), notes) == (sys.executable, [])
    above = environment(tmp_path / "project/.venv")
    assert found() == above
    assert notes == [f"{script} runs with {above}; --python names another interpreter"]
    beside = environment(script.parent / ".venv")
    assert found() == beside
    active = environment(tmp_path / "active")
    monkeypatch.setenv("VIRTUAL_ENV", str(tmp_path / "active"))
    assert found() == active
    monkeypatch.setenv("VIRTUAL_ENV", sys.prefix)  # ours
    assert (found(), notes) == (sys.executable, [])
    assert (found(given="python9"), notes) == ("python9", [])


def test_a_module_is_run_from_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ACTIVE:
        monkeypatch.delenv(name, raising=False)
    here = environment(tmp_path / ".venv")
    monkeypatch.chdir(tmp_path)
    assert interpreter_of("sims.pick", is_module=True, given=None, note=lambda _: None) == here
