"""Bad input: any input gives a scenario, or an error in one clear line.

Property-tested over each field's whole domain and beyond it. A scenario that is accepted is
simulated and analyzed: the engine gives finite numbers, the analysis explains them, and only
results reach standard output.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from conftest import Drop, some
from drop_physics import Camera, DropError, Scenario, analyze, check, run, simulate
from drop_physics.cli import app
from drop_physics.console import running
from drop_physics.console.help import SCRIPT
from drop_physics.engines.pybullet.body_files import BodyFileError, check_urdf
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.found import find_body
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import OutputError, ScenarioError
from drop_physics.fields import Option, Optioned
from drop_physics.scenario import MAX_STEPS
from drop_physics.stages.sweep import sweep
from drop_physics.sweeping.plan import plan_of
from drop_physics.trace.states import BODY
from dropped import dropped_whole
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

NUMBERS = {name: spec for name, spec in Scenario.options().items() if math.isfinite(spec.high)}
LETTERS = st.characters(exclude_categories=["Cs"])
"""All characters that UTF-8 can encode; Hypothesis takes seconds to compute its equal default."""
ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(LETTERS),
    st.binary(),
    st.complex_numbers(),
    st.lists(st.floats(), max_size=4),
    st.tuples(st.floats(), st.floats(), st.floats()),
    st.sampled_from([10**400, -(10**400), 10**5000, 5e-324, sys.float_info.max, math.nan]),
)
"""Values of every type, and numbers that programs often handle incorrectly."""
TEXTS = st.one_of(
    st.text(LETTERS),
    st.floats().map(str),
    st.tuples(st.integers(), st.integers()).map("{0[0]}/{0[1]}".format),
    st.lists(st.floats(), min_size=2, max_size=4).map(lambda parts: ",".join(map(str, parts))),
    st.sampled_from(
        [
            "",
            " ",
            "1/0",
            "1e999",
            "-1e999",
            "nan",
            "inf",
            "1/240/2",
            "0x10",
            "1_000",
            "１２",
            "__import__('os')",
            "9" * 5000,
            "1/" + "9" * 5000,
            "default",
            "earth",
            "EARTH",
            "1,2",
            "1,2,3,4",
            ",,",
            "a\nb",
            "\0",
        ]
    ),
)


def one_line(error: BaseException) -> str:
    text = error.in_options if isinstance(error, DropError) else str(error)
    assert len(text.splitlines()) == 1
    assert len(text) < 600
    return text


def refused_or(make: Callable[[], Optioned], option: Option) -> Optioned | None:
    """Return the result of a call, or None if it is rejected in one line that names the option."""
    try:
        return make()
    except ScenarioError as error:
        line = one_line(error)
    # Another timestep may not fit the standard duration.
    assert option.name in line or "--duration" in line
    return None


# -- values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Scenario, Camera])
@given(data=st.data())
@settings(max_examples=250, deadline=None)
def test_any_value_in_any_field_is_taken_or_refused_in_one_line(
    kind: type[Optioned], data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(kind.options())))
    value = data.draw(ANYTHING)
    optioned = refused_or(lambda: kind(**{name: value}), kind.options()[name])
    if optioned is None:
        return
    taken = getattr(optioned, name)
    assert taken == value or list(taken) == list(value)
    assert type(optioned)(**dataclasses.asdict(optioned)) == optioned  # type: ignore[call-overload]


@given(data=st.data())
@settings(max_examples=250, deadline=None)
def test_any_text_for_any_option_is_taken_or_refused_in_one_line(data: st.DataObject) -> None:
    options = Scenario.options() | Camera.options()
    name = data.draw(st.sampled_from(sorted(options)))
    kind: type[Optioned] = Scenario if name in Scenario.options() else Camera
    text = data.draw(TEXTS)
    refused_or(lambda: kind.from_text({name: text}), options[name])


COMMAND: Any = typer.main.get_command(app)
COMMANDS = COMMAND.commands
NUMERIC = {
    (command, option.opts[0]): option.metavar
    for command, click_command in COMMANDS.items()
    for option in click_command.params
    if option.metavar
    in (
        "NUMBER",
        "N",
        "S",
        "K",
        "METRES",
        "SECONDS",
        "X,Y,Z",
        "R,P,Y|X,Y,Z,W",
        "NUMBER|NAME",
        "WIDTHxHEIGHT",
    )
}
GIVEN = {
    "simulate": ["--out", "a.rrd"], "analyze": ["a.rrd"], "render": ["a.rrd"], "run": [],
    "check": ["a.rrd", "--against", "b.rrd"], "sweep": ["--out", "s"],
    SCRIPT: ["script.py"], "record": ["script.py"], "trust": ["script.py"], "why": ["script.py"],
    "diff": ["a.py", "b.py"], "import": ["a.npz"],
}  # fmt: skip
ONES = {"X,Y,Z": "0,0,{}", "R,P,Y|X,Y,Z,W": "0,{},0", "WIDTHxHEIGHT": "{}x480"}


@pytest.mark.parametrize(("command", "option"), NUMERIC)
def test_a_number_is_what_every_program_takes_for_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: str, option: str
) -> None:
    """Python alone accepts underscores, digits of all scripts, and every kind of space."""
    monkeypatch.chdir(tmp_path)
    for number in ("3_2", "1__0", "٣٢", "３２", "³²", "\u2003 32", "32\u00a0"):
        text = ONES.get(NUMERIC[command, option], "{}").format(number)
        verb = [] if command == SCRIPT else [command]
        with pytest.raises((ScenarioError, typer.BadParameter)) as raised:
            COMMAND([*verb, option, text, *GIVEN[command]], standalone_mode=False)
        message, code = running._verdict(raised.value)
        assert code == 2
        assert message.startswith(f"{option} takes ")
        assert f"got {text!r}" in message
        assert list(tmp_path.iterdir()) == []


def test_every_option_that_becomes_a_number_is_read_like_that() -> None:
    held = {
        (command, option.opts[0])
        for command, click_command in COMMANDS.items()
        for option in click_command.params
        if option.type_descriptor.annotation in (int, float)
    }
    assert held
    assert held <= set(NUMERIC)


@pytest.mark.parametrize("values", ["uniform:1:1_0", "choice:1:1_0", "uniform:1:١٠"])
def test_nor_is_another_number_drawn(values: str) -> None:
    with pytest.raises(ScenarioError, match="vary"):
        plan_of({}, samples=2, vary=[f"height={values}"])


def edges(spec: Option) -> list[tuple[float, bool]]:
    """Return numbers at the edges of a domain, and whether each is inside it."""
    inward, outward = math.nextafter(spec.low, math.inf), math.nextafter(spec.low, -math.inf)
    return [
        (spec.low, not spec.above),
        (inward, True),
        (outward, False),
        (spec.high, True),
        (math.nextafter(spec.high, math.inf), False),
        (math.nan, False),
        (math.inf, False),
        (-math.inf, False),
        (sys.float_info.max, False),
    ]


@pytest.mark.parametrize("name", NUMBERS)
def test_a_domain_ends_where_it_says(name: str) -> None:
    spec = NUMBERS[name]
    for value, inside in edges(spec):
        assert spec.contains(value) == inside, value
    assert spec.domain()


@given(timestep_s=st.floats(1e-9, 10), steps=st.integers(1, MAX_STEPS), off=st.floats(0.01, 0.99))
def test_a_duration_is_a_whole_number_of_steps(timestep_s: float, steps: int, off: float) -> None:
    duration_s = steps * timestep_s
    if duration_s <= 1e9:
        assert Scenario(timestep_s=timestep_s, duration_s=duration_s).steps == steps
    if steps < 1e6:
        with pytest.raises(ScenarioError, match="whole number of timesteps"):
            Scenario(timestep_s=timestep_s, duration_s=(steps + off) * timestep_s)


def test_a_body_starts_above_its_floor_and_anywhere_without_one() -> None:
    assert Scenario(height_m=0.01).height_m == 0.01
    for height_m in (0.0, -3.0):
        assert Scenario(height_m=height_m, floor=False).height_m == height_m
        with pytest.raises(ScenarioError, match="height_m must be above 0"):
            Scenario(height_m=height_m)


@given(parts=st.tuples(*[st.floats(-360, 360)] * 4).filter(lambda q: max(map(abs, q)) > 1e-3))
def test_a_quaternion_is_made_a_unit_one_once(parts: tuple[float, ...]) -> None:
    turned = Scenario(orientation=parts).orientation  # type: ignore[arg-type]
    assert math.hypot(*turned) == pytest.approx(1, abs=1e-15)
    assert Scenario(orientation=turned).orientation == turned
    x, y = turned[0] * parts[3], turned[3] * parts[0]  # the same ratios
    assert x == pytest.approx(y, abs=1e-12)


@given(angles=st.tuples(*[st.floats(-360, 360)] * 3))
def test_angles_are_turns_about_the_worlds_axes_x_then_y_then_z(angles: Any) -> None:
    theirs = p.getQuaternionFromEuler([math.radians(angle) for angle in angles])
    assert Scenario(orientation=angles).orientation_xyzw == pytest.approx(theirs, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2", "orientation takes angles R,P,Y"),
        ("0,0,0,0", "orientation must not be the quaternion"),
        ("361,0,0", "orientation must be at least -360"),
        ("a,b,c", "orientation takes"),
    ],
)
def test_an_invalid_orientation_is_rejected(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        Scenario.from_text({"orientation": text})


@pytest.mark.parametrize("timestep_s", [1 / 240, 1 / 100, 1 / 1000, 0.1])
def test_substeps_are_those_that_the_engine_takes(timestep_s: float) -> None:
    """Bullet makes int(dt / (dt/N)) substeps, which can be N - 1: such an N is rejected."""
    refused = []
    for substeps in range(1, 301):
        try:
            Scenario(timestep_s=timestep_s, substeps=substeps)
        except ScenarioError as error:
            refused.append(substeps)
            better = int(one_line(error).rpartition("try ")[2])
            assert Scenario(timestep_s=timestep_s, substeps=better).substeps == better
    assert 1 <= len(refused) < 30
    assert all(int(timestep_s / (timestep_s / n)) == n for n in range(1, 301) if n not in refused)


def test_too_many_steps_are_refused_with_what_they_would_take() -> None:
    with pytest.raises(ScenarioError, match=r"1e\+10.* GB on disk"):
        Scenario(timestep_s=1e-9, duration_s=10.0)


def test_a_whole_number_is_as_good_as_a_float_in_every_recording_of_a_process(
    tmp_path: Path,
) -> None:
    """Rerun fixes a component's type at its first use in a process."""
    for number, height_m in enumerate((1, 1.5)):
        path = tmp_path / f"{number}.rrd"
        simulate(Scenario(height_m=height_m, mass_kg=2, duration_s=1 / 240), path, camera=None)
        assert analyze(path).scenario["height_m"] == height_m


# -- simulations ----------------------------------------------------------------------------------


def within(name: str) -> st.SearchStrategy[Any]:
    """Return a strategy for a field's whole domain, including its limits and small values."""
    spec, default = NUMBERS[name], getattr(Scenario(), name)
    number = st.floats(spec.low, spec.high, exclude_min=spec.above)
    number |= st.sampled_from([value for value, inside in edges(spec) if inside])
    if isinstance(default, tuple):
        return st.just(default) | st.tuples(number, number, number)
    if name in ("solver_iterations", "substeps"):
        return st.none() | st.integers(1, 200 if name == "solver_iterations" else 8)
    return st.just(default) | number


def extreme(extremes: dict[str, Any], steps: int) -> Scenario:
    """Draw a scenario of extreme values; skip those that start below their floor."""
    if extremes.get("floor", True):
        assume(extremes.get("height_m", 1.0) > 0)
    timestep_s = extremes.get("timestep_s", 1 / 240)
    try:
        return Scenario(**extremes | {"duration_s": timestep_s * steps})
    except ScenarioError as error:
        assume("substeps" not in str(error))
        raise


EXTREMES = st.fixed_dictionaries(
    {name: within(name) for name in NUMBERS if name != "duration_s"}
    | {
        "coordinates": st.sampled_from(["reduced", "maximal"]),
        "body": st.sampled_from(["cube_small.urdf", "sphere_small.urdf", "duck_vhacd.urdf"]),
        "floor": st.booleans(),
        "stepped": st.booleans(),
        "gravity_set": st.booleans(),
    }
)


@pytest.mark.long
@given(extremes=EXTREMES, steps=st.sampled_from([1, 2, 30, 200]))
@settings(max_examples=120, deadline=None)
@example(extremes={"spin_rad_s": (1e4, -1e4, 1e4), "timestep_s": 10.0}, steps=30)
@example(extremes={"velocity_m_s": (1e4, 1e4, -1e4), "coordinates": "maximal"}, steps=200)
@example(extremes={"height_m": 1e6, "gravity_m_s2": -1e4, "timestep_s": 10.0}, steps=200)
@example(extremes={"mass_kg": 1e-9, "restitution": 1.0, "contact_erp": 1.0}, steps=200)
@example(extremes={"linear_damping": 1e-300, "coordinates": "maximal"}, steps=200)
@example(
    extremes={"linear_damping": 1.0, "timestep_s": 10.0, "velocity_m_s": (0, 0, -1e4)}, steps=30
)
def test_the_engine_copes_with_the_whole_domain(extremes: dict[str, Any], steps: int) -> None:
    scenario = extreme(extremes, steps)
    with World(scenario) as world:
        states = dropped_whole(world).bases[BODY]
    assert len(states) == steps + 1
    assert np.isfinite(states).all()
    assert np.allclose(np.linalg.norm(states[:, 3:7], axis=1), 1, atol=1e-9)


@pytest.mark.long
@given(extremes=EXTREMES, steps=st.sampled_from([1, 30]))
@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@example(  # the parts that cancel in a step are larger than the rest
    extremes={"spin_rad_s": (0, 1, 49), "timestep_s": 1.0, "floor": False, "gravity_set": False},
    steps=30,
)
@example(  # without its limit it would overflow
    extremes={"spin_rad_s": (0, 0, 5240), "timestep_s": 7.0, "substeps": 6, "floor": False},
    steps=1,
)
def test_what_the_engine_made_of_it_is_recorded_and_analyzed(
    tmp_path: Path, extremes: dict[str, Any], steps: int
) -> None:
    scenario = extreme(extremes, steps)
    simulate(scenario, tmp_path / "run.rrd", camera=None, force=True)
    analysis = analyze(tmp_path / "run.rrd")
    json.dumps(analysis.as_json(), allow_nan=False)
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}


# -- bodies ---------------------------------------------------------------------------------------

BOX = '<box size="0.1 0.1 0.1"/>'
LINK = """<link name="base"><inertial><mass value="{mass}"/><inertia ixx="{inertia}" iyy="1" izz="1"
ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>{shape}</geometry></collision></link>"""
JOINT = '<joint name="j" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'


def urdf(more: str = "", *, mass: object = 1, inertia: object = 1, shape: str = BOX) -> str:
    link = LINK.format(mass=mass, inertia=inertia, shape=shape)
    return f'<robot name="own">{link}{more}</robot>'


MALFORMED = {
    "empty": "", "a text": "hello", "cut": urdf()[:150], "binary": "\0\1\2" * 100,
    "another root": "<sdf/>", "no link": '<robot name="x"/>', "no shape": urdf(shape=""),
    "deep": "<robot>" + "<a>" * 20_000 + "</a>" * 20_000 + "</robot>",
    "an entity": '<!DOCTYPE r [<!ENTITY a "b">]>' + urdf(),
    "a file as an entity": '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + urdf(),
    "a long name": urdf().replace('"own"', f'"{"x" * 100_000}"'),
    "two roots": urdf('<link name="other"/>'), "a name twice": urdf('<link name="base"/>'),
    "a joint to nowhere": urdf(JOINT.format("base", "gone")),
    "a joint to itself": urdf(JOINT.format("base", "base")),
    "a ring": urdf('<link name="c"/>' + JOINT.format("base", "c") + JOINT.format("c", "base")),
    "a ring apart": urdf('<link name="c"/><link name="d"/>' + JOINT.format("c", "d")
                         + JOINT.format("d", "c")),
    "a joint without ends": urdf('<joint name="j" type="fixed"/>'),
    "no mass": urdf(mass=0), "mass nan": urdf(mass="nan"), "mass inf": urdf(mass="inf"),
    "mass negative": urdf(mass=-1), "mass a word": urdf(mass="heavy"),
    "mass huge": urdf(mass=1e308),
    "inertia nan": urdf(inertia="nan"), "inertia a word": urdf(inertia="x"),
    **{
        f"box {size}": urdf(shape=f'<box size="{size}"/>')
        for size in ("0 0 0", "nan 1 1", "1 1", "-1 1 1", "a b c", "1e30 1 1")
    },
    **{
        f"sphere {radius}": urdf(shape=f'<sphere radius="{radius}"/>')
        for radius in ("0", "inf")
    },
    **{
        f"mesh {name}": urdf(shape=f'<mesh filename="{name}"/>')
        for name in ("", "gone.obj", "../../gone.stl", "package://x/y.dae")
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", some(MALFORMED, 2))
def test_a_malformed_urdf_is_one_line(tmp_path: Path, kind: str) -> None:
    (tmp_path / "own.urdf").write_text(MALFORMED[kind])
    with pytest.raises(ScenarioError, match="body must") as raised:
        simulate(Scenario(body=str(tmp_path / "own.urdf")), tmp_path / "run.rrd", camera=None)
    one_line(raised.value)
    assert not (tmp_path / "run.rrd").exists()


@pytest.mark.parametrize("kind", ["two roots", "a long name", "empty", "mesh gone.obj", "mass nan"])
def test_a_malformed_urdf_neither_crashes_the_command_nor_soils_its_output(
    drop: Drop, tmp_path: Path, kind: str
) -> None:
    (tmp_path / "own.urdf").write_text(MALFORMED[kind])
    done = drop("simulate", "--out", "run.rrd", "--body", "own.urdf", "--json")
    assert done.returncode == 2
    assert done.stderr == f"drop: {json.loads(done.stdout)['error']}\n"
    assert done.stderr.startswith("drop: --body")


@given(cuts=st.data())
@settings(max_examples=60, deadline=None)
def test_the_text_of_a_urdf_with_anything_in_it_passes_or_is_refused(cuts: st.DataObject) -> None:
    text = urdf('<link name="c"/>' + JOINT.format("base", "c"))
    start = cuts.draw(st.integers(0, len(text)))
    stop = cuts.draw(st.integers(start, min(len(text), start + 40)))
    words = [
        "nan",
        "-1",
        "0",
        "1e308",
        "",
        "<",
        ">",
        '"',
        "/>",
        "base",
        "c",
        "<link/>",
        "&amp;",
        "\0",
    ]
    inserted = cuts.draw(st.sampled_from(words) | st.text(max_size=10))
    own = Path(__file__).parent / "__pycache__" / "mutated.urdf"
    own.parent.mkdir(exist_ok=True)
    own.write_text(text[:start] + inserted + text[stop:], errors="replace")
    try:
        check_urdf(own)
    except BodyFileError as error:
        one_line(error)
    finally:
        own.unlink()


def test_every_body_of_pybullet_data_is_found_silently() -> None:
    assert find_body("cube_small.urdf").is_file()
    assert find_body("../pybullet_data/cube_small.urdf").is_file()
    for body in (
        "/etc/passwd",
        "../../../../../../etc/passwd",
        "x" * 5000,
        "gone.urdf",
        ".",
        "a\nb",
    ):
        with pytest.raises(ScenarioError) as raised:
            find_body(body)
        one_line(raised.value)


def test_a_good_urdf_is_left_to_bullet(tmp_path: Path) -> None:
    (tmp_path / "own.urdf").write_text(urdf())
    check_urdf(tmp_path / "own.urdf")


# -- names ----------------------------------------------------------------------------------------

NAMES = (
    'with space, it\'s a "quote"; $(touch x)',
    "ünïcödé 日本語 📦 …",
    "new\nline, tab\tin",
    "[red] per%cent {brace} back\\slash",
    "-dash",
    "~",
)


@pytest.mark.parametrize("name", some(NAMES, 1))
def test_names_are_taken_as_they_are_whatever_is_in_them(
    drop: Drop, tmp_path: Path, name: str
) -> None:
    """Folder, recording and body names are used and printed unchanged, on one line."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / f"{name}.urdf").write_text(urdf())
    run = folder / f"{name}.rrd"
    short = ("--no-camera", "--duration", "0.1", "--body", f"{folder}/{name}.urdf")
    simulated = drop("simulate", f"--out={run}", *short, "--json")
    assert simulated.returncode == 0, simulated.stderr
    assert json.loads(simulated.stdout)["recording"] == str(run)
    analyzed = drop("analyze", run)
    assert (analyzed.returncode, analyzed.stderr) == (0, "")
    again = drop("simulate", f"--out={run}", *short)
    assert again.returncode == 1
    assert len(again.stderr.splitlines()) == 1
    assert {file.name for file in tmp_path.iterdir()} == {name}
    assert {file.suffix for file in folder.iterdir()} == {".rrd", ".urdf"}


def test_a_name_with_a_dash_in_front_is_no_option_of_rerun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rerun is called to seal recordings, and to pack golden ones."""
    monkeypatch.chdir(tmp_path)
    run, golden = Path("-x.rrd"), Path("--golden.rrd")
    simulate(Scenario(duration_s=0.1), run, camera=None)
    assert analyze(run).layer == Path("-x.analysis.rrd")
    assert check(run, golden, update=True).updated
    assert check(run, golden).same
    assert {file.name for file in tmp_path.iterdir()} == {
        "--golden.md",
        "-x.rrd",
        "-x.analysis.rrd",
        "--golden.rrd",
    }


@pytest.mark.parametrize("name", ["~/runs", "~", "~root/runs"])
def test_a_home_that_the_shell_did_not_expand_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """An example is `--out-dir=~/runs`: no folder called ~ is created; an existing one is used."""
    monkeypatch.chdir(tmp_path)
    home = Path(name).expanduser()
    for write in (
        lambda: run(Scenario(duration_s=0.1), name, camera=None),
        lambda: sweep(plan_of({"height_m": "1,2"}), name, record=False),
        lambda: simulate(Scenario(duration_s=0.1), f"{name}/run.rrd", camera=None),
    ):
        with pytest.raises(OutputError, match="the shell did not expand the ~") as raised:
            write()
        assert f"write {home} instead" in one_line(raised.value)
    assert list(tmp_path.iterdir()) == []
    Path(name).mkdir(parents=True)
    simulate(Scenario(duration_s=0.1), f"{name}/run.rrd", camera=None)
    assert Path(name, "run.rrd").is_file()


def test_a_name_that_is_not_text_is_rejected(drop: Drop, tmp_path: Path) -> None:
    name = b"\xff\xfe.rrd".decode(errors="surrogateescape")
    done = drop("simulate", f"--out={name}", "--no-camera", "--duration", "0.1", "--json")
    assert (done.returncode, [*json.loads(done.stdout)]) == (1, ["error"])
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
