"""The Python interface: public names, how results print, and how errors are worded."""

from __future__ import annotations

import base64
import inspect
import io
import pydoc
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import drop_physics
import pybullet as p
import pytest
from clients import release_clients
from conftest import Drop
from drop_physics import DropError, Run, Scenario, analyze, check, plan_of, simulate, sweep
from drop_physics.engines.watching.sites import shown_file
from drop_physics.errors import (
    PARAMETERS,
    OutputError,
    RecordingError,
    ScenarioError,
    in_parameters,
)
from drop_physics.scenario import Camera
from drop_physics.trace.events import located
from PIL import Image

ROOT = Path(__file__).parents[1]


def test_what_is_public_is_listed_and_helped_with() -> None:
    functions = [
        "analyze",
        "check",
        "record",
        "record_script",
        "render",
        "render",
        "run",
        "simulate",
        "sweep",
    ]
    assert set(functions) < set(dir(drop_physics))
    told = pydoc.render_doc(drop_physics, renderer=pydoc.plaintext)
    assert all(re.search(rf"^    {name}\(", told, re.MULTILINE) for name in functions)


@pytest.mark.long
def test_the_recording_of_a_block_is_one_like_any_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standard: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    release_clients()
    with drop_physics.record("block.rrd"):
        p.connect(p.DIRECT)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
        p.createMultiBody(1, box)
        p.stepSimulation()
        p.disconnect()
    analysis = drop_physics.analyze("block.rrd")
    assert analysis.explained.samples == analysis.explained.of >= 2
    assert "no finding in 1 body" in str(analysis)
    assert drop_physics.render("block.rrd").frames == 1
    checked = drop_physics.check("block.rrd", "block.rrd")
    assert checked.same
    assert "same" in str(checked)
    Path("run.rrd").write_bytes(standard.simulation.recording.read_bytes())
    with pytest.raises(RecordingError, match=r"run\.rrd must be the recording of a script"):
        drop_physics.check("block.rrd", "run.rrd")


@pytest.mark.long
def test_the_script_on_the_page_of_the_box_runs_twice(tmp_path: Path) -> None:
    script, japanese = (
        re.findall(r"```python\n(.*?)```", (ROOT / page).read_text("utf-8"), re.DOTALL)
        for page in ("docs/drop.md", "docs/drop.ja.md")
    )
    assert script == japanese
    done = subprocess.run(
        [sys.executable, "-c", script[-1] * 2],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert {one.name for one in tmp_path.iterdir()} == {
        "fine.rrd",
        "fine.analysis.rrd",
        "fine.gif",
        "fine.png",
    }


# -- how results print ----------------------------------------------------------------------------


@pytest.mark.long
def test_a_result_prints_as_the_terminal_prints_it(
    drop: Drop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standard: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("run.rrd").write_bytes(standard.simulation.recording.read_bytes())

    def printed(*words: str) -> str:  # but for what to type next
        return drop(*words).stdout.partition("\n\nnext  ")[0].rstrip("\n")

    assert str(analyze("run.rrd")) == printed("analyze", "run.rrd")
    assert str(check("run.rrd", "run.rrd")) == printed("check", "run.rrd", "--against", "run.rrd")
    rendered = drop_physics.render("run.rrd")
    assert str(rendered) == printed("render", "run.rrd")
    swept = sweep({"timestep_s": [1 / 240, 1 / 480]}, "a", record=False)
    shown = printed("sweep", "--timestep", "1/240,1/480", "--out", "b", "--no-record")
    assert str(swept) == shown.replace("b/results", "a/results")
    assert all("\x1b" not in str(one) for one in (standard, swept, rendered))


@pytest.mark.long
def test_without_a_viewer_a_notebook_shows_a_film_and_says_why(
    standard: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    shown = standard.analysis.view()
    html = shown._repr_html_()
    assert "a viewer in a notebook needs rerun-notebook" in html
    data = re.findall('src="data:image/gif;base64,([^"]*)"', html)
    with Image.open(io.BytesIO(base64.b64decode(data[0]))) as film:
        assert film.n_frames == 21  # every second one, so that it is short
    swept = sweep({"timestep_s": [1 / 240]}, tmp_path / "swept")
    with pytest.raises(ScenarioError, match="only a result that has a recording can be viewed"):
        swept.view()


def test_a_line_of_a_notebook_is_named_by_its_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    """The name is as in IPython's tracebacks; any other file keeps its name."""
    cells = {"/nowhere/ipykernel_7/1234.py": ("Cell", "In[3]")}
    shell = SimpleNamespace(compile=SimpleNamespace(format_code_name=cells.get))
    assert shown_file("/nowhere/ipykernel_7/1234.py") == "1234.py"
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    assert located(shown_file("/nowhere/ipykernel_7/1234.py"), 15) == "In[3], line 15"
    assert located(shown_file("/tmp/other.py"), 15) == "other.py:15"


@pytest.mark.long
def test_a_notebook_shows_text_table_and_plot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standard: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    shown = standard.analysis._repr_html_()
    assert 'timestep</td><td style="text-align: right">-6.1313 mm</td>' in shown
    assert shown.count('<img style="max-width: 100%" src="data:image/png;base64,iVBOR') == 1
    assert re.findall("data:image/(gif|png)", standard._repr_html_()) == ["gif", "png"]
    swept = sweep({"timestep_s": [1 / 240, 1 / 480]}, "a", record=False)
    shown = swept._repr_html_()
    assert "<table" in shown
    made = simulate(Scenario(body=str(_body(tmp_path / "<b>.urdf"))), "<i>.rrd", camera=None)
    assert "&lt;i&gt;.rrd" in made._repr_html_()
    assert "<i>" not in made._repr_html_()
    assert "&lt;b&gt;.urdf" in analyze("<i>.rrd")._repr_html_()


def _body(path: Path) -> Path:
    box = '<geometry><box size="0.1 0.1 0.1"/></geometry>'
    path.write_text(
        f'<robot name="box"><link name="box"><collision>{box}</collision><inertial>'
        '<mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link></robot>"
    )
    return path


# -- in which words errors speak ------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Scenario, Camera])
def test_every_options_parameter_is_its_field(kind: type[Scenario | Camera]) -> None:
    for field, spec in kind.options().items():
        said = field + "=False" if spec.is_flag else field
        assert in_parameters(f"{spec.name} must") == f"{said} must"


@pytest.mark.parametrize(
    ("options", "parameters"),
    [
        ("try --timestep 1/480 or --mass 0.1", "try timestep_s=1/480 or mass_kg=0.1"),
        ("--coordinates reduced; --jobs 1 to see", "coordinates='reduced'; jobs=1 to see"),
        ("--against takes one, got '--force'", "against takes one, got '--force'"),
        ("try --timestep 1/240,1/480", "try timestep_s 1/240,1/480"),
        ("Bullet's --mass, the body's", "Bullet's mass_kg, the body's"),
        ("again: drop check a --against b --update", "again: drop check a --against b --update"),
        ("start one with: ray start --head", "start one with: ray start --head"),
        ("drop it with --engine bullet", "drop it with engine='bullet'"),
    ],
)
def test_options_become_parameters_and_commands_stay(options: str, parameters: str) -> None:
    assert in_parameters(options) == parameters


def test_an_error_speaks_of_parameters_in_python_and_of_options_on_the_command_line(
    tmp_path: Path, drop: Drop
) -> None:
    with pytest.raises(ScenarioError) as raised:
        Scenario(timestep_s=0)
    assert str(raised.value).startswith("timestep_s must be at least 1e-09")
    assert drop("simulate", "--out", "a.rrd", "--timestep", "0").stderr == (
        f"drop: {raised.value.in_options}\n"
    )
    assert raised.value.in_options.startswith("--timestep must")
    out = tmp_path / "run.rrd"
    out.touch()
    with pytest.raises(OutputError, match=r"or force=True$"):
        simulate(Scenario(), out)
    swept = drop("sweep", "--out", "s", "--duration", "1,0.3001", "--no-record")
    assert "--duration must be a whole number of timesteps" in swept.stdout


def test_the_parameters_are_those_of_the_functions() -> None:
    taken = set(Scenario.options()) | set(Camera.options()) | {"camera"}
    taken |= set(inspect.signature(drop_physics.Animation).parameters)
    for name in ("simulate", "analyze", "render", "run", "check", "sweep", "record"):
        taken |= set(inspect.signature(getattr(drop_physics, name)).parameters)
    assert {one.partition("=")[0] for one in PARAMETERS.values()} <= taken


# -- sweeps ---------------------------------------------------------------------------------------


def test_a_plan_takes_values_as_well_as_texts() -> None:
    given = {"timestep_s": [1 / 240, 1 / 480], "velocity_m_s": (0, 0, 1), "stepped": [True, False]}
    plan = plan_of(given)
    assert plan.lists == (
        ("timestep_s", (1 / 240, 1 / 480)),
        ("velocity_m_s", ((0.0, 0.0, 1.0),)),
        ("stepped", (True, False)),
    )
    assert plan_of({"timestep_s": "1/240,1/480"}) == plan_of({"timestep_s": [1 / 240, 1 / 480]})


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"timestep": [1]}, "got 'timestep'; they are: height_m, timestep_s"),
        ({"timestep_s": [0]}, "timestep_s must be at least"),
        ({"timestep_s": ["fast"]}, "timestep_s must be a number, got 'fast'"),
        ({"height_m": [1, 1.0]}, "height_m must list each value once"),
    ],
)
def test_a_plan_that_cannot_be_says_why(given: dict[str, object], said: str) -> None:
    with pytest.raises(DropError, match=re.escape(said)):
        plan_of(given)


@pytest.mark.long
def test_nothing_false_is_said_of_what_was_set_before_a_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PyBullet reports no damping: steps unlike its default are attributed to earlier calls."""
    monkeypatch.chdir(tmp_path)
    release_clients()
    client = p.connect(p.DIRECT)
    try:
        p.setGravity(0, 0, -9.81)
        sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
        _, undamped = (p.createMultiBody(1, sphere, -1, [x, 0, 9]) for x in (0, 3))
        p.changeDynamics(undamped, -1, linearDamping=0)
        with drop_physics.record("block.rrd"):
            for _ in range(60):
                p.stepSimulation()
    finally:
        p.disconnect(client)
    analysis = drop_physics.analyze("block.rrd")
    first, second = analysis.bodies
    assert first.segments["flight"] == 60
    assert second.segments["unexplained"] > 50
    assert "before the recording" in second.unexplained[0].reason
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}
