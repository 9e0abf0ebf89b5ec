"""A drop in MuJoCo: recorded as MuJoCo steps it, and explained by MuJoCo's integration rule."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco_drop
import numpy as np
import polars as pl
import pytest
from conftest import Drop, Recorder, judge, some
from drop_physics import Scenario, simulate
from drop_physics.drop.engines_compared import apart, flight_of
from drop_physics.drop.mechanics import Drift
from drop_physics.engines import other_world
from drop_physics.errors import DropError
from drop_physics.explain.segments import FLIGHT, segments_of
from drop_physics.physics.laws.lookup import law_for
from drop_physics.physics.laws.mujoco.contact import rest_depth_m
from drop_physics.physics.rotations import rotate
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import Recording, read
from drop_physics.scenario import INTEGRATORS
from drop_physics.stages.check import check
from drop_physics.stages.simulate.recorded import case_of
from dropped import case_with, departs

STATE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "vx_m_s", "vy_m_s", "vz_m_s"]
SPIN = ["wx_rad_s", "wy_rad_s", "wz_rad_s"]
MUJOCO = {"euler": "Euler", "rk4": "RK4", "implicit": "implicit", "implicitfast": "implicitfast"}
BLOCK = {"body": "block.urdf"}
SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)


def drawn(seed: int) -> dict[str, object]:
    """Return a random scenario of a flying body; every second body is thrown, every third spins."""
    rng = np.random.default_rng(seed)
    timestep_s = float(rng.choice([1 / 240, 1 / 1000, 0.01, 0.0003]))
    values: dict[str, object] = {
        "engine": "mujoco",
        "height_m": float(rng.uniform(50, 200)),
        "timestep_s": timestep_s,
        "duration_s": 60 * timestep_s,
        "gravity_m_s2": float(rng.uniform(-20, 20)),
        "mass_kg": float(10 ** rng.uniform(-3, 3)),
    }
    if seed % 2:
        values["velocity_m_s"] = tuple(rng.uniform(-5, 5, 3).tolist())
    if seed % 3 == 0:
        values["spin_rad_s"] = tuple(rng.uniform(-9, 9, 3).tolist())
    return values


@pytest.mark.pybullet
@pytest.mark.parametrize("integrator", some(INTEGRATORS["mujoco"], 1))
def test_every_step_in_the_air_follows_the_law(integrator: str) -> None:
    to_the_bit = 0
    for seed in range(30):
        body = BLOCK if seed % 5 == 0 else {}
        scenario = Scenario(**drawn(seed), **body, integrator=integrator)  # type: ignore[arg-type]
        with other_world.OtherWorld(scenario) as world:
            case = case_of(world, world.samples(100))
        assert departs(case) is None, seed
        if seed % 2 or seed % 3 == 0 or integrator == "rk4":
            continue
        (samples,) = case.parts()
        after = case.law.step(samples.before())  # straight up or down
        to_the_bit += np.array_equal(after.velocity_m_s[1:], samples.velocity_m_s[1:])
        to_the_bit += np.array_equal(after.position_m[1:], samples.position_m[1:])
    assert to_the_bit == (0 if integrator == "rk4" else 2 * 10)


@pytest.mark.pybullet
@pytest.mark.parametrize("integrator", INTEGRATORS["mujoco"])
def test_what_is_recorded_is_what_mujoco_does(recorded: Recorder, integrator: str) -> None:
    """The floor is included, in a model that shares only numbers with ours."""
    thrown: dict[str, object] = {"velocity_m_s": (1.0, -0.5, 2.0), "spin_rad_s": (3.0, 5.0, -2.0)}
    recording = recorded(engine="mujoco", integrator=integrator, **BLOCK, **thrown)
    engine = recording.engine
    bare = mujoco_drop.drive(
        steps=240,
        integrator=MUJOCO[integrator],
        mass_kg=engine.mass_kg,
        inertia_kg_m2=engine.inertia_kg_m2,
        edges_m=engine.shape_dimensions_m,  # type: ignore[arg-type]
        **thrown,  # type: ignore[arg-type]
    )
    assert (recording.contacts["step"].n_unique() or 0) > 5
    assert np.array_equal(recording.states.select(STATE).to_numpy(), bare[:, :10])


def test_the_integrator_is_all_there_is_of_the_error(recorded: Recorder) -> None:
    (moment,) = judge(recorded(engine="mujoco")).at
    assert moment.simulated_m == 0.5524187499999997
    assert moment.terms_m is not None
    assert moment.terms_m.timestep == pytest.approx(-6.13125e-3, rel=1e-12)
    assert moment.terms_m.damping == 0
    assert moment.error_m == pytest.approx(-6.13125e-3, rel=1e-9)


def test_runge_kutta_has_no_error_but_rounding(recorded: Recorder) -> None:
    analysis = judge(recorded(engine="mujoco", integrator="rk4"))
    (moment,) = analysis.at
    assert moment.terms_m is not None
    assert moment.terms_m.timestep == 0
    assert abs(moment.error_m) < 1e-14
    assert analysis.contact_j == pytest.approx(0, abs=1e-13) or analysis.impact is not None


@pytest.mark.pybullet
def test_a_law_that_is_another_one_is_noticed(recorded: Recorder) -> None:
    """Tested with other integrators' formulas, and with a value that is off by a few ulp."""
    recording = recorded(engine="mujoco", **BLOCK, height_m=6.0, spin_rad_s=(3.0, 5.0, -2.0))
    assert judge(recording).explained.why is None
    states = recording.states
    for column in (*STATE, *SPIN):
        off = 1e-9 if column in SPIN else 1e-12
        moved = pl.when(pl.col("step") == 100).then(pl.col(column) + off).otherwise(column)
        altered = states.with_columns(moved.alias(column))
        assert departs(case_with(recording, altered)) == 100, column
    (samples,) = case_with(recording).parts()
    for integrator in ("rk4", "implicit"):
        other = Scenario(**{**vars_of(recording.scenario), "integrator": integrator})
        found = segments_of(samples, law_for(other, recording.engine), samples.touches)
        assert found.code[1] != FLIGHT, integrator


@pytest.mark.parametrize(
    "coarse",
    [
        {"solver_residual": 1.0, "height_m": 0.05},
        {"solver_iterations": 1, "spin_rad_s": (1.0, 2.0, 0.0), "solver_residual": 0.0},
    ],
)
def test_what_a_coarse_solver_leaves_is_no_alteration(
    recorded: Recorder, coarse: dict[str, Any]
) -> None:
    """The residual may have any size, and the proposed setting explains every step."""
    analysis = judge(recorded(engine="mujoco", **coarse))
    assert analysis.segments["unexplained"]
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}
    why = str(analysis.explained.why)
    assert "--solver-residual 0" in why
    exact = {**coarse, "solver_residual": 0.0, "solver_iterations": None}
    assert judge(recorded(engine="mujoco", **exact)).segments["unexplained"] == 0


def test_a_state_altered_in_contact_is_not_explained(recorded: Recorder) -> None:
    recording = recorded(engine="mujoco", solver_residual=0.0)
    first = recording.contacts["step"].min()
    moved = pl.when(pl.col("step") == first).then(pl.col("vx_m_s") + 0.01).otherwise("vx_m_s")
    states = recording.states.with_columns(moved.alias("vx_m_s"))
    assert judge(recording).segments["unexplained"] == 0
    assert judge(recording, states).explained.until_s == pytest.approx((first - 1) / 240)


UNSTABLE: dict[str, dict[str, Any]] = {
    "acceleration": {**BLOCK, "spin_rad_s": (1e4, 9e3, 8e3)},
    "position": {"gravity_m_s2": -1e4, "timestep_s": 10.0, "duration_s": 1e5, "floor": False},
}


@pytest.mark.pybullet
@pytest.mark.parametrize("too_large", UNSTABLE)
def test_mujoco_does_not_start_again_from_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, too_large: str
) -> None:
    """It would where a number exceeds 1e10, with a warning in a file in the working folder."""
    scenario = Scenario(engine="mujoco", **UNSTABLE[too_large])
    monkeypatch.chdir(tmp_path)
    with other_world.OtherWorld(scenario) as world, pytest.raises(DropError) as raised:
        list(world.samples(10_000))
    step = int(str(raised.value).split("at step ")[1].split(",")[0])
    assert {"acceleration": 3, "position": 142}[too_large] == step
    assert not list(tmp_path.iterdir())


def vars_of(scenario: Scenario) -> dict[str, object]:
    return {name: getattr(scenario, name) for name in scenario.options()}


def test_on_the_floor_every_force_is_accounted_for(recorded: Recorder) -> None:
    tumbling = {"orientation": (20.0, 30.0, 0.0), "velocity_m_s": (1.0, 0.0, 0.0)}
    for integrator in ("euler", "implicit", "implicitfast"):
        analysis = judge(
            recorded(engine="mujoco", integrator=integrator, solver_residual=0.0, **tumbling)
        )
        assert analysis.explained.why is None
        assert analysis.segments["contact"] > 50
        assert "law-mismatch" not in {finding.code for finding in analysis.findings}


def test_what_the_solver_leaves_is_said(recorded: Recorder) -> None:
    analysis = judge(recorded(engine="mujoco", timestep_s=1 / 960))
    assert analysis.segments["unexplained"]
    assert "--solver-residual 0" in (analysis.explained.why or "")
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}
    assert (
        judge(recorded(engine="mujoco", timestep_s=1 / 960, solver_residual=0.0)).segments[
            "unexplained"
        ]
        == 0
    )


def test_runge_kutta_claims_nothing_of_contact(recorded: Recorder) -> None:
    analysis = judge(recorded(engine="mujoco", integrator="rk4"))
    assert analysis.segments["contact"] == 0
    assert "does not add up" in (analysis.explained.why or "")
    assert analysis.bounces == []
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}


@pytest.mark.parametrize("mass_kg", [None, 50.0])
@pytest.mark.parametrize("gravity_m_s2", [-9.81, -1.62])
def test_the_rest_has_a_closed_form(
    recorded: Recorder, mass_kg: float | None, gravity_m_s2: float
) -> None:
    analysis = judge(
        recorded(engine="mujoco", mass_kg=mass_kg, gravity_m_s2=gravity_m_s2, duration_s=4.0)
    )
    rest = analysis.rest
    assert rest is not None
    assert rest.sinks_m == rest_depth_m(-gravity_m_s2, 4, SOLREF, SOLIMP)
    assert rest.error_m == pytest.approx(-rest.sinks_m, abs=1e-9)
    if gravity_m_s2 == -9.81:
        assert rest.sinks_m == pytest.approx(107.755420e-6, abs=1e-12)


@pytest.mark.pybullet
@pytest.mark.parametrize("timestep_s", [0.01, 0.02])
def test_no_time_constant_is_below_two_timesteps(recorded: Recorder, timestep_s: float) -> None:
    """A smaller time constant has no effect."""
    values = {"body": "cube.urdf", "timestep_s": timestep_s}
    analysis = judge(recorded(engine="mujoco", duration_s=2.0, **values))
    rows = [
        mujoco_drop.drive(
            steps=round(2 / timestep_s),
            timestep_s=timestep_s,
            mass_kg=1.0,
            inertia_kg_m2=analysis.engine.inertia_kg_m2,
            edges_m=(1.0, 1.0, 1.0),
            solref=solref,
        )
        for solref in (0.02, 0.001)
    ]
    assert rows[0][-1, 2] == pytest.approx(rows[1][-1, 2], abs=1e-9)
    assert analysis.rest is not None
    assert analysis.rest.sinks_m == pytest.approx(0.5 - rows[0][-1, 2], abs=1e-9)


def test_a_shorter_time_constant_is_stiffer() -> None:
    depths = [rest_depth_m(9.81, 4, (constant, 1.0), SOLIMP) for constant in (0.02, 0.01, 0.005)]
    assert all(depth is not None for depth in depths)
    assert depths == sorted(depths, reverse=True)  # type: ignore[type-var]
    assert rest_depth_m(9.81, 4, (-100.0, -10.0), SOLIMP) is None


@pytest.mark.long
def test_the_same_run_is_the_same_to_the_bit(tmp_path: Path, drop_process: Drop) -> None:
    tumbling = ("--spin", "3,5,-2", "--velocity", "1,0,1", "--no-camera", "--engine", "mujoco")
    for name in ("a.rrd", "b.rrd"):
        assert drop_process("simulate", *tumbling, "--out", name).returncode == 0
    a, b = (read(tmp_path / name) for name in ("a.rrd", "b.rrd"))
    assert a.states.equals(b.states)
    assert a.contacts.equals(b.contacts)


@pytest.mark.pybullet
def test_frames_are_drawn_from_its_poses(tmp_path: Path) -> None:
    """The image of a pose is the same, whichever engine computed the pose."""
    short = {"duration_s": 1 / 240, "height_m": 0.5}
    for engine in ("bullet", "mujoco"):
        simulate(Scenario(engine=engine, **short), tmp_path / f"{engine}.rrd")  # type: ignore[arg-type]
    pictures = [dict(frames(read(tmp_path / f"{engine}.rrd"))) for engine in ("bullet", "mujoco")]
    assert pictures[0][0] == pictures[1][0]


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--restitution", "0.5"], "--restitution is an option of PyBullet"),
        (["--linear-damping", "0.1"], "not of MuJoCo; omit it"),
        (["--coordinates", "maximal"], "--coordinates is an option of PyBullet, not of MuJoCo"),
        (["--integrator", "discrete"], "must be euler or rk4 or implicit or implicitfast, got"),
        (["--body", "r2d2.urdf"], "a body of one link"),
        (["--body", "duck_vhacd.urdf"], "drop it with --engine bullet"),
    ],
)
def test_what_it_does_not_have_is_said_in_a_line(drop: Drop, options: list[str], said: str) -> None:
    done = drop("simulate", "--engine", "mujoco", "--out", "x.rrd", *options)
    assert done.returncode == 2
    assert said in " ".join(done.stderr.split())


@pytest.mark.pybullet
def test_an_integrator_of_pybullet_is_refused(drop: Drop) -> None:
    done = drop("simulate", "--integrator", "rk4", "--out", "x.rrd")
    assert done.returncode == 2
    assert "--integrator must be omitted for PyBullet" in " ".join(done.stderr.split())


def test_its_own_settings_reach_it(recorded: Recorder) -> None:
    slow = {"velocity_m_s": (2.0, 0.0, 0.0), "height_m": 0.025, "duration_s": 0.5}
    slides = [
        float(recorded(engine="mujoco", friction=mu, **slow).states["x_m"][-1])
        for mu in (None, 0.1)
    ]
    assert slides[1] > 1.5 * slides[0]
    report = recorded(engine="mujoco", friction=0.1, solver_iterations=7).engine
    assert (report.lateral_friction, report.solver_iterations) == (0.1, 7)
    assert report.restitution is None
    assert report.solref == SOLREF
    assert report.solimp == SOLIMP


def test_a_drop_without_a_step_stays(recorded: Recorder) -> None:
    analysis = judge(recorded(engine="mujoco", stepped=False))
    assert [finding.code for finding in analysis.findings] == ["not-stepped"]
    assert "stepSimulation" not in analysis.findings[0].message


def test_angular_momentum_drifts_as_measured() -> None:
    """The drift is first order in the timestep with Euler; 2.7e-11 with the Runge-Kutta method."""
    inertia = np.array([0.80833, 0.68333, 0.14167])
    drifts = {}
    for integrator in ("Euler", "implicit", "RK4"):
        rows = mujoco_drop.drive(
            steps=10_000,
            timestep_s=1e-3,
            gravity_m_s2=0.0,
            integrator=integrator,
            mass_kg=1.0,
            inertia_kg_m2=tuple(inertia.tolist()),
            spin_rad_s=(0.1, 5.0, 0.1),
            height_m=50.0,
        )
        momentum = rotate(rows[:, 3:7], rows[:, 10:] * inertia)
        drift = Drift()
        drift.add(momentum)
        drifts[integrator] = drift.relative or 0.0
    assert drifts["Euler"] == pytest.approx(0.01307, abs=2e-6)
    assert drifts["implicit"] == pytest.approx(0.01245, abs=2e-6)
    assert drifts["RK4"] < 1e-10


def parted(run: Recording, golden: Recording) -> str:
    """Return the comparison's description of the difference between two engines."""
    return str(check(run.path, golden.path).engines)


@pytest.mark.pybullet
def test_moving_from_pybullet_says_where_they_part_and_why(recorded: Recorder) -> None:
    found = check(recorded(engine="mujoco").path, recorded().path)
    assert not found.same
    assert found.first is not None
    assert found.first.step == 2  # the first step begins without a velocity to damp
    assert found.engines is not None
    assert "diverge at step 2" in found.engines
    assert "mm apart along z: damping -18.01" in found.engines
    assert "--linear-damping 0 and they agree to the bit until contact" in found.engines


@pytest.mark.pybullet
def test_what_it_promises_of_pybullet_without_damping_holds(recorded: Recorder) -> None:
    found = check(recorded(engine="mujoco").path, recorded(linear_damping=0.0).path)
    assert found.comparison is not None
    assert [setting.column for setting in found.comparison.differences] == ["engine"]
    assert found.first is not None
    assert found.first.step == 108
    assert str(found.engines).startswith(
        "MuJoCo and PyBullet agree to the bit until contact (step 108)"
    )


@pytest.mark.pybullet
def test_nothing_is_advised_where_nothing_is_damped(recorded: Recorder) -> None:
    """The engines differ by rounding only."""
    drop = {"body": "jenga/jenga.urdf", "velocity_m_s": (0.0, -7.3, 0.0), "duration_s": 0.4}
    found = parted(recorded(**drop, linear_damping=0.0), recorded(**drop, engine="mujoco"))
    assert found.endswith("less than 0.0001 mm apart")


@pytest.mark.pybullet
def test_engines_with_another_integrator_part_by_the_timestep(recorded: Recorder) -> None:
    found = parted(recorded(engine="mujoco", integrator="rk4"), recorded(linear_damping=0.0))
    assert "diverge at step 1" in found
    assert "mm apart along z: timestep +9.11" in found


@pytest.mark.pybullet
def test_engines_part_where_they_are_farthest_and_not_by_terms_of_what_is_clamped(
    recorded: Recorder,
) -> None:
    thrown = {"velocity_m_s": (20.0, 0.0, 0.0), "gravity_m_s2": 0.0, "height_m": 3.0}
    found = parted(recorded(engine="mujoco", **thrown), recorded(**thrown))
    assert "mm apart along x: damping +" in found
    fast = {"velocity_m_s": (0.0, 0.0, -95.0), "height_m": 1e3, "linear_damping": 0.0}
    found = parted(recorded(engine="mujoco", **fast | {"linear_damping": None}), recorded(**fast))
    assert "; PyBullet clamps a velocity in step 123" in found
    assert "interaction" not in found


@pytest.mark.pybullet
def test_nothing_is_promised_that_the_law_does_not_give(recorded: Recorder) -> None:
    """MuJoCo's gravity is altered, so PyBullet would not match it even without damping."""
    golden = recorded()
    run = recorded(engine="mujoco")
    states = run.states.with_columns(pl.col("z_m") + 1e-6 * pl.col("step"))
    flights = [
        flight_of(case_with(each, moved))
        for each, moved in ((run, states), (golden, golden.states))
    ]
    assert "agree" not in apart(*flights, parts_at=1)


@pytest.mark.pybullet
def test_another_mass_is_another_experiment(recorded: Recorder) -> None:
    found = check(recorded(engine="mujoco", mass_kg=0.2).path, recorded().path)
    assert found.comparison is not None
    assert "mass_kg" in [setting.column for setting in found.comparison.differences]
    assert found.engines is None


@pytest.mark.pybullet
def test_a_sweep_has_a_row_of_each_engine(tmp_path: Path, drop: Drop) -> None:
    done = drop("sweep", "--engine", "bullet,mujoco", "--out", "engines", "--json")
    assert done.returncode == 0, done.stderr
    table = pl.read_parquet(tmp_path / "engines/results.parquet").sort("engine")
    assert table["engine"].to_list() == ["bullet", "mujoco"]
    assert table["simulated_m"].to_list() == [0.5567296523863766, 0.5524187499999997]
    assert table["damping_m"][1] == 0


def test_forces_that_do_not_balance_at_little_friction_are_no_alteration(
    recorded: Recorder,
) -> None:
    recording = recorded(engine="mujoco", friction=0.0, solver_residual=0.0)
    analysis = judge(recording)
    assert analysis.segments["unexplained"] > 0
    assert "law-mismatch" not in {finding.code for finding in analysis.findings}
    assert "does not add up" in str(analysis.explained.why)
