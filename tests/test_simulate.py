"""Every scenario option reaches the engine, and the engine's reported values are recorded."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from conftest import Drop, Recorder, some
from drop_physics import Camera, Scenario, simulate
from drop_physics.engine_report import LARGEST
from drop_physics.engines.pybullet import probe
from drop_physics.engines.pybullet.engine import p
from drop_physics.engines.pybullet.jointed import JointStates
from drop_physics.engines.pybullet.world import World
from drop_physics.errors import DropError, ScenarioError
from drop_physics.recording.frames import frames
from drop_physics.recording.reader import read
from drop_physics.stages.sweep.drop import RunDrop
from drop_physics.sweeping.plan import plan_of
from drop_physics.trace.events import Samples
from drop_physics.trace.states import BODY, FLOOR
from dropped import dropped_whole
from engine import DATA, MODES, box, lowered, shape, urdf_of


@pytest.fixture(autouse=True)
def untried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the trial load of bodies in a separate process, which `test_hostile_bodies.py` tests."""
    monkeypatch.setattr(probe, "problem_of", lambda _: ("", []))


def test_the_engine_reports_what_was_set(recorded: Recorder) -> None:
    recording = recorded(
        height_m=2.0,
        timestep_s=1 / 480,
        duration_s=0.1,
        gravity_m_s2=-1.62,
        mass_kg=0.25,
        velocity_m_s=(0.5, -0.25, 3.0),
        spin_rad_s=(1.0, 2.0, 3.0),
        restitution=0.7,
        solver_iterations=33,
        friction=0.3,
        substeps=4,
        orientation=(0.0, 0.0, 90.0),
    )
    engine, first = recording.engine, recording.states.row(0, named=True)
    assert engine.timestep_s == 1 / 480
    assert engine.gravity_m_s2 == (0.0, 0.0, -1.62)
    assert engine.mass_kg == 0.25
    assert engine.restitution == engine.floor_restitution == 0.7
    assert engine.solver_iterations == 33
    assert engine.lateral_friction == engine.floor_lateral_friction == 0.3
    assert engine.substeps == 4
    turned = [first[name] for name in ("qx", "qy", "qz", "qw")]
    assert turned == pytest.approx([0, 0, np.sqrt(0.5), np.sqrt(0.5)], abs=1e-15)
    assert [first[name] for name in ("x_m", "y_m", "z_m")] == [0.0, 0.0, 2.0]
    assert [first[name] for name in ("vx_m_s", "vy_m_s", "vz_m_s")] == [0.5, -0.25, 3.0]
    assert [first[name] for name in ("wx_rad_s", "wy_rad_s", "wz_rad_s")] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("coordinates", MODES)
@pytest.mark.parametrize("mass_kg", [0.1, 1.0, 49.0])
def test_a_mass_of_ones_own_scales_the_inertia_of_the_urdf(
    coordinates: Any, mass_kg: float
) -> None:
    """cube_small.urdf has three times a cube's inertia, and keeps that: m a²/2, not m a²/6."""
    with World(Scenario(mass_kg=mass_kg, coordinates=coordinates)) as world:
        report = world.report()
    assert report.mass_kg == mass_kg
    assert report.inertia_kg_m2 == pytest.approx([mass_kg * 0.05**2 / 2] * 3, rel=1e-14)


@pytest.mark.parametrize("coordinates", MODES)
@pytest.mark.parametrize("own_kg", [0.1, 49.0, 0.3])
def test_the_urdfs_own_mass_changes_nothing(
    tmp_path: Path, coordinates: Any, own_kg: float
) -> None:
    # 1 / (1 / 49) is not 49, and that is what a btRigidBody reports.
    urdf = urdf_of(tmp_path, box("0.1 0.2 0.3"), mass_kg=own_kg)
    plain = Scenario(body=urdf, spin_rad_s=(5.0, -3.0, 9.0), coordinates=coordinates)
    found = []
    for scenario in (plain, replace(plain, mass_kg=own_kg)):
        with World(scenario) as world:
            found.append((world.report(), next(world.samples(1000))))
    (report, fall), (same_report, same_fall) = found
    assert report == same_report
    assert report.mass_kg == own_kg
    assert_the_same(fall, same_fall)


# -- what the engine reports of a body -------------------------------------------------------------


@pytest.mark.parametrize("told", [None, 0.5])
def test_a_btrigidbody_bounces_with_the_restitution_that_is_reported(
    tmp_path: Path, told: float | None
) -> None:
    """The engine reports no restitution for a btRigidBody: our value must match its motion."""
    urdf = urdf_of(tmp_path, box("0.1 0.1 0.1"), contact='<restitution value="0.75"/>')
    scenario = Scenario(
        body=urdf, restitution=told, contact_erp=0.0, solver_residual=0.0, coordinates="maximal"
    )
    with World(scenario) as world:
        if told is None:  # plane.urdf has none, and the pair's is the product
            p.changeDynamics(world._floor, -1, restitution=1.0, physicsClientId=world._client)
        report, (fall,) = world.report(), world.samples(1000)
    assert report.restitution == (told or 0.75)
    assert report.pair_restitution is not None
    upwards_m_s = fall.bases[BODY][:, 9]
    up = int(np.argmax(upwards_m_s > 0))
    approach_m_s = upwards_m_s[up - 1] - 9.81 / 240
    assert upwards_m_s[up] == pytest.approx(report.pair_restitution * -approach_m_s, rel=1e-12)


@pytest.mark.parametrize("coordinates", MODES)
def test_one_substep_is_none(coordinates: Any) -> None:
    how: Any = {"coordinates": coordinates, "spin_rad_s": (1.0, 2.0, 3.0)}
    with World(Scenario(**how)) as plain, World(Scenario(**how, substeps=1)) as one:
        for fall, same in zip(plain.samples(1000), one.samples(1000), strict=True):
            assert_the_same(fall, same)


def assert_the_same(fall: Samples, other: Samples) -> None:
    for rows, others in ((fall.bases[BODY], other.bases[BODY]), (fall.contacts, other.contacts)):
        assert len(rows) > 0
        np.testing.assert_array_equal(rows, others)


def test_what_an_engine_does_not_report_is_none(recorded: Recorder) -> None:
    engine = recorded(floor=False, duration_s=1 / 240).engine
    assert engine.floor_restitution is engine.floor_lateral_friction is None
    assert engine.pair_restitution is engine.gl_renderer is None


def test_links_are_part_of_the_body() -> None:
    with World(Scenario(body="r2d2.urdf")) as world:
        report = world.report()
    assert (report.joints, len(report.link_masses_kg)) == (15, 16)
    assert report.mass_kg == pytest.approx(sum(report.link_masses_kg))
    assert report.mass_kg > 60 > report.link_masses_kg[0]
    assert (report.shape, report.shape_dimensions_m) == ("compound", ())
    assert report.shape_position_m is None


def test_a_body_with_joints_is_refused_in_maximal_coordinates() -> None:
    """PyBullet places only its base, and reports neither its links nor their contacts."""
    with pytest.raises(ScenarioError, match=r"has 15; use coordinates='reduced'"):
        World(Scenario(body="r2d2.urdf", coordinates="maximal"))


def test_a_shape_is_reported_where_it_is_from_the_centre_of_mass(tmp_path: Path) -> None:
    urdf = urdf_of(tmp_path, box("0.1 0.2 0.3", "0.1 0 0", "0 0 0.5"), centre="0 0 0.02")
    with World(Scenario(body=urdf)) as world:
        report = world.report()
    assert report.shape == "box"
    assert report.shape_dimensions_m == pytest.approx((0.1, 0.2, 0.3))
    assert report.shape_position_m == pytest.approx((0.1, 0, -0.02))
    assert report.shape_orientation == pytest.approx((0, 0, np.sin(0.25), np.cos(0.25)))


def test_a_body_without_a_shape_touches_nothing(tmp_path: Path) -> None:
    with World(Scenario(body=urdf_of(tmp_path))) as world:
        report = world.report()
    assert (report.shape, report.shape_dimensions_m, report.rest_height_m) == ("none", (), None)


# -- the height at which a body touches the floor --------------------------------------------------

CUBE, ROD = box("0.1 0.1 0.1"), shape('<cylinder radius="0.05" length="0.2"/>')
TURNED = {"upright": (0.0, 0.0, 0.0), "tilted": (17.0, 40.0, 0.0), "on its side": (90.0, 0.0, 0.0)}
BODIES: dict[str, tuple[tuple[str, ...], str, float]] = {
    # Shapes, centre of mass, and the rest height upright: half of an edge, or with the margin of a
    # millimetre that Bullet adds to the hull which it makes of a cylinder.
    "cube": ((CUBE,), "0 0 0", 0.05),
    "cube with its mass above": ((CUBE,), "0 0 0.02", 0.07),
    "cube above its origin": ((box("0.1 0.1 0.1", "0 0 0.1"),), "0 0 0", -0.05),
    "two cubes": ((box("0.1 0.1 0.1", "0 0 -.05"), box("0.1 0.1 0.1", "0 0 .05")), "0 0 0", 0.1),
    "rod": ((ROD,), "0 0 0", 0.101),
    "ball": ((shape('<sphere radius="0.05"/>'),), "0 0 0", 0.05),
    "ball beside its origin": ((shape('<sphere radius="0.05"/>', "0.1 0 0.02"),), "0 0 0", 0.03),
    "capsule": ((shape('<capsule radius="0.05" length="0.2"/>'),), "0 0 0", 0.15),
    "tiny": ((box("0.001 0.001 0.001"),), "0 0 0", 0.0005),
}
MESHES = ("lego/lego.urdf", "duck_vhacd.urdf", "teddy_vhacd.urdf")


def rest_height(body: str, turned: str) -> float:
    with World(Scenario(body=body, orientation=TURNED[turned])) as world:
        assert world.rest_height_m is not None
        return world.rest_height_m


@pytest.mark.parametrize("name", BODIES)
def test_the_rest_height_is_that_of_the_shape(tmp_path: Path, name: str) -> None:
    shapes, centre, expected_m = BODIES[name]
    urdf = urdf_of(tmp_path, *shapes, centre=centre)
    assert rest_height(urdf, "upright") == pytest.approx(expected_m, abs=1e-15)


def test_the_rest_height_of_a_cube_is_half_its_edge_to_the_bit() -> None:
    assert rest_height("cube_small.urdf", "upright") == 0.025


@pytest.mark.parametrize("turned", TURNED)
@pytest.mark.parametrize("maximal", [False, True])
@pytest.mark.parametrize("name", some([*BODIES, *MESHES], 4))
def test_at_the_rest_height_the_floor_begins_to_push(
    tmp_path: Path, name: str, maximal: bool, turned: str
) -> None:
    """A body that sinks by 1 µm a step is pushed once its penetration equals the slop of 10 µm."""
    shapes, centre, _ = BODIES.get(name, ((), "", 0.0))
    urdf = urdf_of(tmp_path, *shapes, centre=centre) if shapes else str(DATA / name)
    expected_m = rest_height(urdf, turned)
    orientation = Scenario(orientation=TURNED[turned]).orientation_xyzw
    pushed_m = lowered(urdf, orientation, from_m=expected_m + 1e-4, maximal=maximal)
    assert pushed_m is not None
    assert -11e-6 <= pushed_m - expected_m <= -8e-6


@pytest.mark.parametrize(
    ("change", "column"),
    some(
        [
            ({"linear_damping": 0.5}, "z_m"),
            ({"angular_damping": 0.5, "spin_rad_s": (0.0, 0.0, 9.0)}, "wz_rad_s"),
            ({"contact_erp": 0.5}, "z_m"),
            ({"solver_residual": 0.0}, "z_m"),
            ({"restitution": 0.5}, "z_m"),
            ({"coordinates": "maximal"}, "z_m"),
            ({"restitution_threshold_m_s": 5.0, "restitution": 0.9}, "z_m"),
            ({"friction": 0.1, "velocity_m_s": (1.0, 0.0, 0.0)}, "x_m"),
            ({"substeps": 2}, "z_m"),
            ({"orientation": (45.0, 0.0, 0.0)}, "z_m"),
        ],
        3,
    ),
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else value,
)
def test_what_the_engine_does_not_report_shows_in_the_fall(
    recorded: Recorder, change: dict[str, object], column: str
) -> None:
    left = ("spin_rad_s", "velocity_m_s", *(["restitution"] if len(change) > 1 else []))
    plain = {key: value for key, value in change.items() if key in left}
    assert not np.array_equal(recorded(**change).states[column], recorded(**plain).states[column])


def test_iterations_of_the_solver_show_where_the_residual_does_not_stop_it(
    recorded: Recorder,
) -> None:
    few = recorded(solver_residual=0.0, solver_iterations=1)
    many = recorded(solver_residual=0.0, solver_iterations=50)
    assert not np.array_equal(few.states["z_m"], many.states["z_m"])


@pytest.mark.parametrize(
    ("coordinates", "body_type"), [("reduced", "btMultiBody"), ("maximal", "btRigidBody")]
)
def test_coordinates_choose_the_kind_of_body(
    recorded: Recorder, coordinates: str, body_type: str
) -> None:
    recording = recorded(coordinates=coordinates, duration_s=1 / 240)
    assert recording.engine.body_type == body_type


def test_the_standard_drop_is_the_same_in_every_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Local files with the standard names are ignored; a path given explicitly is used."""
    shutil.copy(DATA / "block.urdf", tmp_path / "cube_small.urdf")
    shutil.copy(DATA / "cube.urdf", tmp_path / "plane.urdf")
    monkeypatch.chdir(tmp_path)
    simulate(Scenario(), "a.rrd", camera=None)
    standard = read(Path("a.rrd"))
    assert standard.engine.rest_height_m == 0.025
    assert standard.contacts["step"][0] == 109
    simulate(Scenario(body="./cube_small.urdf"), "b.rrd", camera=None)
    assert read(Path("b.rrd")).engine.mass_kg == 0.02


@pytest.mark.parametrize(
    ("body", "shape", "rest_height_m"),
    [
        ("cube_small.urdf", "box", 0.025),
        ("sphere_small.urdf", "sphere", 0.03),
        ("block.urdf", "box", 0.009),
        ("duck_vhacd.urdf", "mesh", None),
    ],
)
def test_any_body_of_pybullet_data_can_be_dropped(
    recorded: Recorder, body: str, shape: str, rest_height_m: float | None
) -> None:
    recording = recorded(body=body, duration_s=0.5)
    assert recording.engine.shape == shape
    assert recording.states["z_m"][0] == 1.0
    if rest_height_m is not None:
        assert recording.engine.rest_height_m == pytest.approx(rest_height_m, abs=1e-15)


def test_a_urdf_of_ones_own_is_found_by_its_path(tmp_path: Path) -> None:
    own = tmp_path / "my body.urdf"
    own.write_text(
        '<robot name="brick"><link name="base"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><box size="0.2 0.1 0.4"/></geometry></collision></link></robot>'
    )
    path = tmp_path / "brick.rrd"
    simulate(Scenario(body=str(own), duration_s=0.1), path, camera=None)
    engine = read(path).engine
    assert (engine.body_name, engine.mass_kg) == ("brick", 2.0)
    assert engine.rest_height_m == 0.2


@pytest.mark.parametrize("text", ["", "no robot here", "<robot name='x'></robot>"])
def test_a_urdf_that_bullet_cannot_load_is_an_error_of_the_scenario(
    tmp_path: Path, text: str
) -> None:
    (tmp_path / "bad.urdf").write_text(text)
    with pytest.raises(ScenarioError, match=r"bad\.urdf"):
        simulate(Scenario(body=str(tmp_path / "bad.urdf")), tmp_path / "run.rrd", camera=None)
    assert not (tmp_path / "run.rrd").exists()


STATE = [
    (call, place)
    for call in ("getBasePositionAndOrientation", "getBaseVelocity")
    for place in (0, 1)
]


@pytest.mark.parametrize("number", [math.nan, math.inf, 1.01e60])
@pytest.mark.parametrize(("call", "place"), STATE)
def test_a_state_that_is_no_number_any_more_is_an_error_and_no_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, place: int, number: float
) -> None:
    """Position, orientation, velocity or spin is wrong from step 50 on, in the second batch."""
    lose_numbers(monkeypatch, call, place, number, step=50)
    monkeypatch.setattr("drop_physics.stages.simulate.BATCH", 40)
    with pytest.raises(DropError, match=r"becomes non-finite at step 50 .*; try .*timestep_s"):
        simulate(Scenario(), tmp_path / "run.rrd", camera=None)
    assert not (tmp_path / "run.rrd").exists()


def test_the_largest_number_that_is_recorded_is_the_largest_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lose_numbers(monkeypatch, "getBaseVelocity", 0, LARGEST, step=50)
    simulate(Scenario(), tmp_path / "run.rrd", camera=None)
    assert read(tmp_path / "run.rrd").states["vz_m_s"][50] == LARGEST


@pytest.mark.parametrize("number", [math.nan, math.inf, 1.01e60])
@pytest.mark.parametrize("place", [8, 9])
def test_nor_may_a_contact_be_no_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: int, number: float
) -> None:
    """The contact's distance or force is no number."""
    told = p.getContactPoints

    def lost(*which: object) -> list[tuple[object, ...]]:
        return [(*one[:place], number, *one[place + 1 :]) for one in told(*which)]

    monkeypatch.setattr(p, "getContactPoints", lost)
    with pytest.raises(DropError, match="becomes non-finite at step 10"):
        simulate(Scenario(), tmp_path / "run.rrd", camera=None)
    assert not (tmp_path / "run.rrd").exists()


def test_nor_may_the_state_of_a_joint_be_no_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = JointStates.now
    monkeypatch.setattr(JointStates, "now", lambda self: [*told(self)[:-1], math.nan])
    with pytest.raises(DropError, match="becomes non-finite at step 0"):
        simulate(Scenario(body="r2d2.urdf", duration_s=0.1), tmp_path / "run.rrd", camera=None)


@pytest.mark.parametrize("step", [50, 150])
@pytest.mark.parametrize("recorded", [True, False])
def test_in_a_sweep_such_a_state_is_a_run_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recorded: bool, step: int
) -> None:
    """It fails before step 72, where the budget is computed, or later, where nothing reads it."""
    lose_numbers(monkeypatch, "getBasePositionAndOrientation", 0, math.nan, step=step)
    row = RunDrop(plan_of({}), tmp_path, "", 0.3, recorded, None)(0)
    assert "becomes non-finite" in str(row["error"])
    assert (row["simulated_m"], row["end_m"]) == (None, None)


def lose_numbers(
    monkeypatch: pytest.MonkeyPatch, call: str, place: int, number: float, *, step: int
) -> None:
    """Make one of the engine's calls return a non-finite number from a step on."""
    take_step, ask = p.stepSimulation, getattr(p, call)
    taken = []

    def stepped(client: int) -> None:
        take_step(client)
        taken.append(client)

    def asked(body: int, client: int) -> list[list[float]]:
        told = list(map(list, ask(body, client)))
        if len(taken) >= step:
            told[place][-1] = number
        return told

    monkeypatch.setattr(p, "stepSimulation", stepped)
    monkeypatch.setattr(p, call, asked)


def test_contact_is_recorded_where_it_acts(recorded: Recorder) -> None:
    recording = recorded()
    contacts = recording.contacts
    assert contacts["step"].min() == 109
    first, last = (contacts.filter(pl.col("step") == step) for step in (109, 240))
    assert len(first) == 4
    for point in first.iter_rows(named=True):
        bodies = {point["body_a"]: "a", point["body_b"]: "b"}
        assert sorted(bodies) == [BODY, FLOOR]
        assert point["distance_m"] == pytest.approx(0.01618091982485528 - 0.025)
        assert point[f"{bodies[FLOOR]}z_m"] == 0.0
        assert point[f"{bodies[BODY]}z_m"] == pytest.approx(0.01618091982485528 - 0.025)
        assert point["nz"] == (1.0 if bodies[BODY] == "a" else -1.0)  # from b to a
    corners = set(zip(first["ax_m"].round(12), first["ay_m"].round(12), strict=True))
    assert corners == {(x, y) for x in (-0.025, 0.025) for y in (-0.025, 0.025)}
    # At rest the floor carries the box's weight.
    assert last["normal_force_n"].sum() == pytest.approx(0.981, rel=1e-3)


@pytest.mark.parametrize("coordinates", MODES)
def test_the_forces_of_all_contact_points_are_what_moves_the_body(
    recorded: Recorder, coordinates: Any
) -> None:
    """The momentum changes by dt times normal and friction forces, in their recorded directions."""
    recording = recorded(
        coordinates=coordinates,
        velocity_m_s=(2.0, 0.5, 0.0),
        friction=0.5,
        duration_s=1.5,
        linear_damping=0.0,
        angular_damping=0.0,
    )
    on_a = [
        sum(
            pl.col(force) * pl.col(along)
            for force, along in (
                ("normal_force_n", f"n{axis}"),
                ("friction_1_n", f"f1{axis}"),
                ("friction_2_n", f"f2{axis}"),
            )
        )
        for axis in "xyz"
    ]
    sign = pl.when(pl.col("body_a") == BODY).then(1).otherwise(-1)
    forces = (
        recording.contacts.select(
            "step", *((force * sign).alias(axis) for force, axis in zip(on_a, "xyz", strict=True))
        )
        .group_by("step", maintain_order=True)
        .sum()
    )
    force_n = np.zeros((len(recording.states), 3))
    force_n[forces["step"]] = forces.select(*"xyz").to_numpy()
    velocity_m_s = recording.states.select("vx_m_s", "vy_m_s", "vz_m_s").to_numpy()
    pushed_m_s = np.diff(velocity_m_s, axis=0) - np.array([0, 0, -9.81 / 240])
    assert np.abs(force_n[:, :2]).max() > 1.0
    assert np.abs(pushed_m_s - force_n[1:] / 240 / 0.1).max() < 1e-15


def test_every_contact_point_of_a_body_with_joints_names_its_link(recorded: Recorder) -> None:
    recording = recorded(body="r2d2.urdf", height_m=0.5, duration_s=0.5)
    sides = recording.contacts.select("body_a", "link_a", "body_b", "link_b").rows()
    links = {b if one == FLOOR else a for one, a, _, b in sides}
    assert len(links) > 1
    assert links <= set(range(-1, recording.engine.joints))
    parts = recording.states.filter(pl.col("step") == 7)
    assert parts["link"].to_list() == list(range(-1, recording.engine.joints))


def test_camera_options_decide_the_frames(tmp_path: Path) -> None:
    camera = Camera(capture_every=20, size_px=(64, 48))
    made = simulate(Scenario(duration_s=0.25), tmp_path / "run.rrd", camera=camera)
    taken = dict(frames(read(tmp_path / "run.rrd")))
    assert list(taken) == [0, 20, 40, 60]
    assert made.frames == 4
    assert read(tmp_path / "run.rrd").camera == camera
    assert all(int.from_bytes(png[16:20]) == 64 for png in taken.values())


def test_a_simulation_is_the_same_every_time() -> None:
    def fall() -> Samples:
        with World(Scenario(spin_rad_s=(1.0, 2.0, 3.0))) as world:
            return dropped_whole(world)

    assert_the_same(fall(), fall())


def test_a_btrigidbody_without_a_mass_cannot_be_given_one(tmp_path: Path) -> None:
    """Bullet keeps it fixed, whereas a btMultiBody falls."""
    urdf = urdf_of(tmp_path, box("0.1 0.1 0.1"), mass_kg=0.0)
    with World(Scenario(body=urdf, mass_kg=1.0)) as world:
        (fall,) = world.samples(1000)
        assert fall.bases[BODY][-1, 2] < 1
    with pytest.raises(ScenarioError, match="coordinates='reduced'"):
        World(Scenario(body=urdf, mass_kg=1.0, coordinates="maximal"))


def test_where_there_is_no_memory_for_the_engine_one_line_says_so(
    drop: Drop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bullet aborts the process if an allocation fails (`std::bad_alloc`)."""
    monkeypatch.setattr("drop_physics.engines.pybullet.world.CLIENT_BYTES", 1 << 60)
    done = drop("simulate", "--no-camera", "--out", "run.rrd")
    assert done.returncode == 1
    assert done.stderr == "drop: there is not enough memory; free some, or see: ulimit -v\n"
