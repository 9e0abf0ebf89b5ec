"""The same drop in both engines: recorded as each engine steps it, explained by each engine's rule.

MuJoCo has more in `test_mujoco`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco_drop
import numpy as np
import polars as pl
import pyarrow as pa
import pytest
from conftest import Drop, Recorder, judge, said
from drop_physics import Scenario, colours, simulate
from drop_physics.compare.comparison import Comparison
from drop_physics.drop.case import DropCase
from drop_physics.engines import other_world
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import ScenarioError
from drop_physics.recording import other_layer, writer
from drop_physics.recording.reader import Recording, read, recording_id
from drop_physics.stages.check import check
from drop_physics.stages.simulate.recorded import case_of
from drop_physics.stages.view import view
from drop_physics.trace.tables import table_of
from dropped import departs, seen_with
from engine import shape, urdf_of
from rerun.chunk import RrdReader

BODIES = ("cube_small.urdf", "sphere_small.urdf", "block.urdf", "lego/lego.urdf")
TUMBLING = {
    "orientation": (20.0, 30.0, 0.0),
    "velocity_m_s": (1.0, 0.0, 0.0),
    "spin_rad_s": (1.0, 2.0, 0.0),
}
HEAVY = (
    '<robot name="heavy"><link name="base"><inertial><mass value="1e4"/>'
    '<inertia ixx="4e5" iyy="8e5" izz="1e6" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><box size="30 20 10"/></geometry></collision></link></robot>'
)


def drawn(seed: int) -> Scenario:
    """Return a random scenario of a flying body; every second body is thrown, every third spins."""
    rng = np.random.default_rng(seed)
    timestep_s = float(rng.choice([1 / 240, 1 / 1000, 0.01, 0.0003]))
    values: dict[str, object] = {
        "engine": "mujoco",
        "height_m": float(rng.uniform(50, 100)),
        "timestep_s": timestep_s,
        "duration_s": 60 * timestep_s,
        "gravity_m_s2": float(rng.uniform(-20, 20)),
        "mass_kg": float(10 ** rng.uniform(-2, 2)),
        "body": BODIES[seed % 4],
    }
    if seed % 2:
        values["velocity_m_s"] = tuple(rng.uniform(-5, 5, 3).tolist())
    if seed % 3 == 0:
        values["spin_rad_s"] = tuple(rng.uniform(-9, 9, 3).tolist())
        values["orientation"] = tuple(rng.uniform(-90, 90, 3).tolist())
    return Scenario(**values)  # type: ignore[arg-type]


def dropped(scenario: Scenario) -> DropCase:
    with other_world.OtherWorld(scenario) as world:
        return case_of(world, world.samples(1000))


def test_every_step_in_the_air_follows_the_law() -> None:
    to_the_bit = 0
    for seed in range(40):
        case = dropped(drawn(seed))
        assert departs(case) is None, seed
        (samples,) = case.parts()
        after = case.law.step(samples.before())
        same = np.array_equal(after.velocity_m_s[1:], samples.velocity_m_s[1:])
        to_the_bit += same and np.array_equal(after.position_m[1:], samples.position_m[1:])
    # Those that fall straight, without spin.
    assert to_the_bit >= 13


def test_a_long_flight_follows_the_law_as_well(tmp_path: Path) -> None:
    """Rounding rotates a body that is thrown sideways by less than 1e-15 rad/s."""
    heavy = tmp_path / "heavy.urdf"
    heavy.write_text(HEAVY)
    scenario = Scenario(
        engine="mujoco",
        body=str(heavy),
        timestep_s=10.0,
        duration_s=1000.0,
        gravity_m_s2=-1.62,
        velocity_m_s=(1e-9, 0.3, -2.0),
        height_m=100.0,
        floor=False,
    )
    assert departs(dropped(scenario)) is None


def test_an_altered_sample_is_noticed() -> None:
    case = dropped(drawn(9))
    assert departs(case) is None
    states = table_of(case.seen.states)
    for column in ("x_m", "vz_m_s", "wy_rad_s", "qx"):
        moved = pl.when(pl.col("step") == 30).then(pl.col(column) + 1e-7).otherwise(column)
        altered = seen_with(case.seen, states.with_columns(moved.alias(column)))
        assert departs(replace(case, seen=altered)) == 30, column


def test_both_share_the_integrator(recorded: Recorder) -> None:
    (moment,) = judge(recorded(engine="mujoco")).at
    assert moment.simulated_m == 0.5524187499999997
    assert moment.error_m * 1e3 == pytest.approx(-6.13125, abs=5e-6)
    assert moment.terms_m is not None
    assert moment.terms_m.timestep * 1e3 == pytest.approx(-6.13125, rel=1e-12)
    assert moment.terms_m.damping == 0
    assert abs(moment.terms_m.rounding) < 1e-15


@pytest.mark.long
def test_the_same_run_is_the_same_to_the_bit(
    tmp_path: Path, drop: Drop, drop_process: Drop
) -> None:
    """The runs are made in two processes."""
    tumbling = ("--spin", "3,5,-2", "--velocity", "1,0,1", "--no-camera", "--engine", "mujoco")
    for name, call in (("a.rrd", drop), ("b.rrd", drop_process)):
        done = call("simulate", *tumbling, "--out", name)
        assert done.returncode == 0, done.stderr
        # Notes only say where the engine differs from PyBullet.
        assert all(" where PyBullet has " in line for line in done.stderr.splitlines())
    a, b = (read(tmp_path / name) for name in ("a.rrd", "b.rrd"))
    assert a.states.equals(b.states)
    assert a.contacts.equals(b.contacts)


def test_findings_about_contact_are_true(recorded: Recorder) -> None:
    """A tumbling body is explained, or a reason is given; it is never reported as altered."""
    for scenario in ({}, TUMBLING, {"timestep_s": 1 / 960}, {"body": "sphere_small.urdf"}):
        analysis = judge(recorded(engine="mujoco", **scenario))
        codes = {finding.code for finding in analysis.findings}
        assert not codes & {"law-mismatch", "default-damping", "bounce-swallowed"}
        assert "PyBullet" not in str(analysis.findings)
        if analysis.segments["unexplained"]:
            assert "what the engine makes" not in (analysis.explained.why or "")
        else:
            assert analysis.explained.why is None


@pytest.mark.parametrize("solref", [0.02, 0.002])
def test_how_deep_a_long_step_goes_is_not_blamed_on_a_spring(
    recorded: Recorder, solref: float
) -> None:
    """MuJoCo has not computed a contact yet, so its time constant has no effect."""
    recording = recorded(engine="mujoco", timestep_s=0.05, duration_s=2.0, height_m=5.0)
    bare = mujoco_drop.drive(steps=40, timestep_s=0.05, height_m=5.0, solref=solref)
    depth_m = 0.025 - bare[:, 2].min()
    assert depth_m == 0.025 - recording.states["z_m"].min()
    messages = {finding.code: said(finding) for finding in judge(recording).findings}
    assert f"{depth_m * 1e3:.1f} mm into the floor" in messages["deep-penetration"]
    assert "shorten" not in messages["deep-penetration"]


def test_a_soft_contact_lets_a_body_sink_no_less_in_shorter_steps(recorded: Recorder) -> None:
    depths_m = {
        rate: 0.025 - recorded(engine="mujoco", timestep_s=1 / rate).states["z_m"].min()
        for rate in (110, 120, 1000)
    }
    assert depths_m[110] < 0.6 * depths_m[1000] < depths_m[120]
    (message,) = (
        said(finding)
        for finding in judge(recorded(engine="mujoco", timestep_s=1 / 110)).findings
        if finding.code == "deep-penetration"
    )
    assert "shorter: --timestep" not in message


def test_a_contact_that_gives_way_gradually_is_not_blamed_on_the_step(recorded: Recorder) -> None:
    recording = recorded(engine="mujoco", timestep_s=0.001, height_m=5.0, duration_s=2.0)
    analysis = judge(recording)
    assert analysis.impact is not None
    assert analysis.impact.penetration_m is not None
    assert analysis.impact.penetration_m > 0.05
    assert "deep-penetration" not in {finding.code for finding in analysis.findings}


@pytest.mark.parametrize(
    ("tilt_deg", "rest_m"),
    [(0, 0.15), (30, 0.15 * np.cos(np.pi / 6) + 0.1 * np.sin(np.pi / 6))],
)
def test_a_cylinder_is_a_cylinder(
    recorded: Recorder, tmp_path: Path, tilt_deg: float, rest_m: float
) -> None:
    """PyBullet makes a convex hull, 1 mm thicker; the inertia is the hull's in both engines."""
    can = urdf_of(tmp_path, shape('<cylinder radius="0.1" length="0.3"/>'))
    body = {"body": can, "orientation": (float(tilt_deg), 0.0, 0.0), "height_m": 0.2}
    recording, bullets = recorded(engine="mujoco", **body), recorded(**body).engine
    assert recording.engine.shape == "cylinder"
    assert recording.engine.shape_dimensions_m == (0.3, 0.1, 0.0)
    assert recording.engine.rest_height_m == pytest.approx(rest_m, abs=1e-14)
    assert (bullets.rest_height_m or 0) > rest_m + 9e-4
    assert recording.engine.inertia_kg_m2 == pytest.approx(bullets.inertia_kg_m2, rel=1e-6)
    # It first pushes in the step after it has come to the floor.
    first = int(recording.contacts.filter(pl.col("normal_force_n") > 0)["step"].to_list()[0])
    heights_m = recording.states["z_m"]
    assert heights_m[first - 2] > rest_m - 1e-3
    assert heights_m[first] < rest_m + 2e-3
    if not tilt_deg:
        assert heights_m[-1] == pytest.approx(rest_m, abs=2e-3)


@pytest.mark.parametrize(
    ("kind", "size_m"),
    [("box", (0.1, 0.2, 0.3)), ("sphere", (0.1, 0.1, 0.0)), ("capsule", (0.1, 0.3, 0.0))],
)
def test_how_deep_a_shape_reaches_is_what_bullet_measures(
    tmp_path: Path, kind: str, size_m: tuple[float, float, float]
) -> None:
    of = {
        "box": 'size="0.1 0.2 0.3"',
        "sphere": 'radius="0.1"',
        "capsule": 'radius="0.1" length="0.3"',
    }
    placed = shape(f"<{kind} {of[kind]}/>", xyz="0.1 0.2 -0.3", rpy="1 2 3")
    body = urdf_of(tmp_path, placed)
    for turned in ((0.0, 0.0, 0.0), (20.0, 30.0, 40.0), (-100.0, 200.0, 5.0)):
        with World(Scenario(body=body, orientation=turned)) as world:
            (read_back,) = world.shapes()
            assert (read_back.kind, read_back.size_m) == (kind, pytest.approx(size_m))
            depth_m = read_back.depth_m(world.scenario.orientation_xyzw)
            assert depth_m == pytest.approx(world.rest_height_m, abs=1e-9)


def compared(one: Recording, other: Recording, **options: Any) -> Comparison:
    found = check(one.path, other.path, **options).comparison
    assert found is not None
    return found


def parted(one: Recording, other: Recording) -> str:
    """Return the comparison's description of the difference between two engines."""
    return str(check(one.path, other.path).engines)


def test_a_spinning_body_agrees_to_what_is_said_and_not_to_the_bit(recorded: Recorder) -> None:
    drop = {"spin_rad_s": (0.0, 0.0, 3.0), "velocity_m_s": (0.3, 0.1, 1.0), "height_m": 2.0}
    other = recorded(engine="mujoco", **drop)
    advice = parted(other, recorded(**drop))
    assert "--linear-damping 0 --angular-damping 0 and they agree to 1e-12 m" in advice
    undamped = recorded(**drop, linear_damping=0.0, angular_damping=0.0)
    assert "to the bit" not in parted(other, undamped)
    touched = min(int(each.contacts["step"][0]) for each in (other, undamped))
    rows = slice(0, touched)
    columns = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
    one, another = (each.states.select(columns).to_numpy()[rows] for each in (other, undamped))
    assert np.abs(one - another).max() < 1e-12
    assert not np.array_equal(one, another)


def test_a_default_that_is_what_the_other_was_told_is_no_difference(recorded: Recorder) -> None:
    other = recorded(engine="mujoco")
    told = {"linear_damping": 0.0, "friction": other.engine.lateral_friction}
    comparison = compared(other, recorded(**told))
    assert [setting.column for setting in comparison.differences] == ["engine"]
    assert "agree to the bit until contact" in parted(other, recorded(**told))
    damped = compared(other, recorded(**{**told, "linear_damping": 0.01}))
    assert {setting.column for setting in damped.differences} == {"engine"}


def test_moving_from_pybullet_only_the_damping_differs(recorded: Recorder) -> None:
    said = parted(recorded(engine="mujoco"), recorded())
    assert "--linear-damping 0 and they agree to the bit until contact" in said
    assert "damping -1" in said


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"engine": "mujoco", "contact_erp": 0.1}, "contact_erp is an option of PyBullet, not of"),
        ({"engine": "mujoco", "restitution": 0.5}, "not of MuJoCo; omit it"),
        ({"engine": "bullet", "integrator": "rk4"}, "integrator must be omitted for PyBullet"),
    ],
)
def test_an_option_that_it_does_not_have(options: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        Scenario(**options)  # type: ignore[arg-type]


# -- side by side ---------------------------------------------------------------------------------


def test_recordings_of_one_drop_open_as_one_a_colour_for_each(tmp_path: Path) -> None:
    paths = [tmp_path / f"{engine}.rrd" for engine in ("bullet", "mujoco")]
    for path in paths:
        simulate(Scenario(engine=path.stem), path, camera=None)  # type: ignore[arg-type]
    with view(paths, web=True) as shown:
        layers = [
            Path(argument) for argument in shown.viewer.command if argument.endswith("/0.rrd")
        ]
        (layer,) = layers
        assert shown.recordings == paths
        assert recording_id(layer) == recording_id(paths[0])
        chunks = list(RrdReader(layer).stream())
        assert {"/world/MuJoCo/base", "/height/MuJoCo"} <= {chunk.entity_path for chunk in chunks}
        batches = [chunk.to_record_batch() for chunk in chunks]
        seen = str(
            [
                column.to_pylist()
                for batch in batches
                for column in batch.columns
                if not pa.types.is_duration(column.type)
            ]
        )
        assert str(writer.rgba(colours.ENGINES["mujoco"]) - 0xFF + other_layer.ALPHA) in seen
    simulate(Scenario(engine="mujoco", height_m=2.0), tmp_path / "other.rrd", camera=None)
    with view([paths[0], tmp_path / "other.rrd"], web=True) as shown:
        assert not any("drop-" in argument for argument in shown.viewer.command)


def test_a_note_says_what_an_engine_ignores_in_the_urdf(tmp_path: Path) -> None:
    urdf = tmp_path / "box.urdf"
    urdf.write_text(
        """<robot name="box"><link name="box"><contact><lateral_friction value="0.3"/>
        <rolling_friction value="0.01"/></contact><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>"""
    )
    short = {"body": str(urdf), "height_m": 2.0, "duration_s": 1 / 240}
    notes: list[str] = []

    def noted(**how: Any) -> list[str]:
        notes.clear()
        simulate(
            Scenario(**short, **how), tmp_path / "x.rrd", camera=None, force=True, note=notes.append
        )
        return notes

    assert noted() == []
    friction, rolling = noted(engine="mujoco")
    assert friction == (
        "MuJoCo has a lateral friction of 1 for this body, where PyBullet has 0.3; to have the "
        "same, set --friction"
    )
    assert "ignores the rolling friction" in rolling
    assert len(noted(engine="mujoco", friction=0.3)) == 1
