"""Every scenario option reaches the engine, and what the engine reports is what is recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import Recorder

from pipeline import Camera, Scenario, simulate
from pipeline.errors import ScenarioError
from pipeline.physics.world import World
from pipeline.recording.reader import frames, read


def test_the_engine_reports_what_was_set(recorded: Recorder) -> None:
    recording = recorded(
        height_m=2.0, timestep_s=1 / 480, duration_s=0.1, gravity_m_s2=-1.62, mass_kg=0.25,
        velocity_m_s=(0.5, -0.25, 3.0), spin_rad_s=(1.0, 2.0, 3.0), restitution=0.7,
        solver_iterations=33,
    )  # fmt: skip
    engine, first = recording.engine, recording.states.row(0, named=True)
    assert engine.timestep_s == 1 / 480
    assert engine.gravity_m_s2 == (0.0, 0.0, -1.62)
    assert engine.mass_kg == 0.25
    assert engine.restitution == engine.floor_restitution == 0.7
    assert engine.solver_iterations == 33
    assert [first[name] for name in ("x_m", "y_m", "z_m")] == [0.0, 0.0, 2.0]
    assert [first[name] for name in ("vx_m_s", "vy_m_s", "vz_m_s")] == [0.5, -0.25, 3.0]
    assert [first[name] for name in ("wx_rad_s", "wy_rad_s", "wz_rad_s")] == [1.0, 2.0, 3.0]


def test_a_mass_of_ones_own_brings_the_inertia_of_the_shape(recorded: Recorder) -> None:
    """The URDF's inertia is three times a cube's, m a²/6; changing the mass replaces it."""
    assert recorded(duration_s=1 / 240).engine.inertia_kg_m2 == (0.000125,) * 3
    heavy = recorded(duration_s=1 / 240, mass_kg=1.0).engine.inertia_kg_m2
    assert heavy == pytest.approx([1.0 * 0.05**2 / 6] * 3, rel=1e-14)


@pytest.mark.parametrize(
    ("change", "column"),
    [
        ({"linear_damping": 0.5}, "z_m"),
        ({"angular_damping": 0.5, "spin_rad_s": (0.0, 0.0, 9.0)}, "wz_rad_s"),
        ({"contact_erp": 0.5}, "z_m"),
        ({"solver_residual": 0.0}, "z_m"),
        ({"restitution": 0.5}, "z_m"),
        ({"coordinates": "maximal"}, "z_m"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else value,
)
def test_what_the_engine_does_not_report_shows_in_the_fall(
    recorded: Recorder, change: dict[str, object], column: str
) -> None:
    plain = {key: value for key, value in change.items() if key == "spin_rad_s"}
    assert not np.array_equal(recorded(**change).column(column), recorded(**plain).column(column))


def test_iterations_of_the_solver_show_where_the_residual_does_not_stop_it(
    recorded: Recorder,
) -> None:
    few = recorded(solver_residual=0.0, solver_iterations=1)
    many = recorded(solver_residual=0.0, solver_iterations=50)
    assert not np.array_equal(few.column("z_m"), many.column("z_m"))


@pytest.mark.parametrize(
    ("coordinates", "body_type"), [("reduced", "btMultiBody"), ("maximal", "btRigidBody")]
)
def test_coordinates_choose_the_kind_of_body(
    recorded: Recorder, coordinates: str, body_type: str
) -> None:
    recording = recorded(coordinates=coordinates, duration_s=1 / 240)
    assert recording.engine.body_type == body_type


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
    assert recording.column("z_m")[0] == 1.0
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


def test_contact_is_recorded_where_it_acts(recorded: Recorder) -> None:
    recording = recorded()
    points = recording.column("contact_points")
    assert points[:109].max() == 0
    assert points[109] == 4
    assert recording.column("contact_distance_m")[109] == pytest.approx(0.01618091982485528 - 0.025)
    # At rest the floor carries the box's weight.
    assert recording.column("contact_force_n")[-1] == pytest.approx(0.981, rel=1e-3)


def test_camera_options_decide_the_frames(tmp_path: Path) -> None:
    camera = Camera(capture_every=20, size_px=(64, 48))
    made = simulate(Scenario(duration_s=0.25), tmp_path / "run.rrd", camera=camera)
    taken = dict(frames(tmp_path / "run.rrd"))
    assert list(taken) == [0, 20, 40, 60]
    assert made.frames == 4
    assert read(tmp_path / "run.rrd").camera == camera
    assert all(int.from_bytes(png[16:20]) == 64 for png in taken.values())


def test_a_simulation_is_the_same_every_time() -> None:
    def fall() -> np.ndarray:
        with World(Scenario(spin_rad_s=(1.0, 2.0, 3.0))) as world:
            return np.concatenate(list(world.samples(100)))

    assert np.array_equal(fall(), fall(), equal_nan=True)
