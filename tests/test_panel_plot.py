"""Plots: a script's verdict and panels for the findings, a drop's error by terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import some
from drawn import is_within
from drop_physics import Scenario, simulate
from drop_physics import analyze as analyze_recording
from drop_physics.analysis.results import Analysis
from drop_physics.figures import style
from drop_physics.figures.panel_plot import build_figure, draw_beside, render
from drop_physics.figures.plot import Curve, Panel, Plot
from drop_physics.figures.theme import LIGHT
from drop_physics.messages import Message
from drop_physics.stages.panels import plot_of, viewed
from drop_physics.stages.run import Run
from matplotlib.figure import Figure
from scenes import analyze, record

ARM = """
p.setGravity(0, 0, -9.81)
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for joint, angle in enumerate([0, 0.8, 0, -1.2, 0, 0.5, 0]):
    p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, angle, force={force})
steps(480)
"""
BALL = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
ball = p.loadURDF("sphere2.urdf", [0, 0, 3], globalScaling=.4)
steps(480)
"""
SLOPE = """
p.setGravity(3, 0, -9)
p.loadURDF("plane.urdf")
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.2, .2, .1])
box = p.createMultiBody(2, shape, -1, [0, 0, .1])
p.changeDynamics(box, -1, lateralFriction=0.2)
steps(240)
"""


def told(scene: str, path: Path) -> tuple[Analysis, Plot]:
    """Return a scene's analysis, and the contents of its plot."""
    analysis = analyze(record(scene, path / "scene.rrd").seen)
    return analysis, plot_of(analysis)


# -- of any numbers -------------------------------------------------------------------------------

SPANS = (
    (-1.2, -1.2 - 1.07e-5),
    (0.0, 0.0),
    (-30.0, -30.0),
    (1e9, 1.0000001e9),
    (-1e-12, 1e-12),
    (-1234.5, 98765.4),
    (-1e-300, 0.0),
    (6e5, 6e5 + 1e-9),
    (-7e22, -6.9e22),
    (1e-4, 3e-4),
)
LONG = "left_front_wheel_suspension_joint_of_the_second_robot"
MANY = [f"{LONG}_{number}" for number in range(12)]


def panel_of(low: float, high: float, unit: str, names: Sequence[str], **how: bool) -> Panel:
    times_s = np.linspace(0, 1, 50)
    curves = [
        Curve(name, times_s, np.linspace(low, high, 50) * (1 + number * 1e-7), "#0072b2")
        for number, name in enumerate(names)
    ]
    return Panel(f"{names[0]}: torque of its motor", unit, curves, **how)


@pytest.mark.parametrize(
    ("spans", "names"),
    some([(SPANS[:5], ["total", LONG]), (SPANS[5:], MANY)], 1),
    ids=["few", "many"],
)
def test_no_label_is_cut_whatever_the_numbers(
    spans: Sequence[tuple[float, float]], names: list[str]
) -> None:
    """Plots are tested alone, and beside a video."""
    looks: list[dict[str, bool]] = [{}, {"zero": True}, {"stacked": True}, {}, {}]
    units = ("rad", "m", "N m", "J", "mm")
    panels = [
        panel_of(*span, unit, names, **look)
        for span, unit, look in zip(spans, units, looks, strict=True)
    ]
    plot = Plot(f"{LONG} is off", [LONG] * 7, panels)
    with style.themed(LIGHT):
        assert is_within(build_figure(plot, LIGHT))
        for first in (0, 2, 3):
            figure = Figure(figsize=(4.4, 3.3), dpi=91)
            draw_beside(figure, replace(plot, panels=panels[first:]), LIGHT)
            assert is_within(figure)


@pytest.mark.parametrize(("unit", "least"), [("rad", 1e-3), ("m", 1e-4), ("mm", 0.1)])
def test_what_hardly_moves_is_not_blown_up(unit: str, least: float) -> None:
    """Axes span at least 1 mrad or 0.1 mm."""
    for far, shown in ((0.01, least), (3.0, 3 * least)):
        panel = panel_of(-1.2, -1.2 + far * least, unit, ["a"])
        with style.themed(LIGHT):
            low, high = build_figure(Plot("t", [], [panel]), LIGHT).axes[0].get_ylim()
        assert high - low == pytest.approx(1.16 * shown, rel=1e-6)
        assert (low + high) / 2 == pytest.approx(-1.2 + far * least / 2, abs=1e-9)


# -- of a drop ------------------------------------------------------------------------------------


def test_the_impact_is_enlarged_with_every_sample_around_it(standard: Run) -> None:
    with style.themed(LIGHT):
        figure = build_figure(plot_of(standard.analysis), LIGHT)
    (enlarged,) = figure.axes[0].child_axes
    simulated = enlarged.lines[-1].get_xydata()
    impact = standard.analysis.impact
    assert impact is not None
    assert impact.step is not None
    table = standard.analysis.table.filter(
        pl.col("step").is_between(impact.step - 4, impact.step + 10)
    )
    assert np.array_equal(simulated, table.select("time_s", "simulated_m").to_numpy())


def test_a_drop_shows_its_fall_beside_theory_and_its_error_by_terms(standard: Run) -> None:
    """At 0.3 s the budget is -6.131 mm timestep, +4.310 mm damping, -1.820 mm in total."""
    story = plot_of(standard.analysis)
    assert story.title == "cube_small.urdf dropped from 1 m"
    assert "at 0.3 s -1.820 mm: timestep -6.131, damping +4.310, interaction +0.001" in story.lines
    heights, errors = story.panels
    table = standard.analysis.table
    free, _, fall = (curve.values for curve in heights.curves)
    assert np.array_equal(fall, table["simulated_m"])
    times_s = heights.curves[0].times_s
    in_air = np.isfinite(free)
    assert free[in_air] == pytest.approx(1 - 9.81 * times_s[in_air] ** 2 / 2, abs=1e-9)
    assert in_air.sum() == np.isfinite(errors.curves[0].values).sum() == 108
    total, *terms = (curve.values[72] for curve in errors.curves)
    assert [*terms[:2], total] == pytest.approx([-6.13125, 4.31016, -1.82031], abs=1e-3)
    assert sum(terms) == pytest.approx(total, abs=1e-12)


@pytest.mark.parametrize(
    ("scenario", "title", "panels"),
    [
        (Scenario(stepped=False), "cube_small.urdf dropped from 1 m", 1),
        (Scenario(velocity_m_s=(1.0, 0.0, 0.0)), "cube_small.urdf thrown from 1 m", 2),
    ],
)
def test_a_title_says_whether_it_was_thrown_and_no_theory_falls_beside_what_hangs(
    scenario: Scenario, title: str, panels: int, tmp_path: Path
) -> None:
    simulate(scenario, tmp_path / "run.rrd", camera=None)
    story = plot_of(analyze_recording(tmp_path / "run.rrd"))
    assert (story.title, len(story.panels)) == (title, panels)
    assert (len(story.panels[0].curves) > 1) == scenario.stepped


def test_nothing_is_enlarged_where_it_would_hide_the_fall(tmp_path: Path) -> None:
    simulate(Scenario(duration_s=0.5), tmp_path / "run.rrd", camera=None)
    heights, *_ = plot_of(analyze_recording(tmp_path / "run.rrd")).panels
    assert heights.inset is None


# -- of a script ----------------------------------------------------------------------------------


def test_an_arm_too_weak_shows_its_joint_torque_and_limit(tmp_path: Path) -> None:
    analysis, story = told(ARM.format(force=20), tmp_path)
    joint = analysis.findings[0].joint
    assert str(joint) in story.title
    position, torque, *_ = story.panels
    assert (position.mark, position.unit) == ("1", "rad")
    reached, target = (curve.values for curve in position.curves)
    (row,) = (row for row in analysis.bodies[0].joints if row.name == joint)
    assert (reached[-1], target[-1]) == (row.reached, row.target)
    limit = next(curve for curve in torque.curves if curve.name == "limit")
    assert np.abs(torque.curves[0].values).max() == pytest.approx(20)
    assert np.abs(limit.values[-1]) == pytest.approx(20)


def test_what_slides_shows_the_friction_that_it_uses(tmp_path: Path) -> None:
    analysis, story = told(SLOPE, tmp_path)
    assert analysis.findings[0].code == "slides"
    available, used = story.panels[0].curves
    its = analysis.findings[0]
    assert (its.body, its.other) == ("1_body", "0_plane") or its.other in story.panels[0].title
    assert used.values[-1] == pytest.approx(available.values[-1], rel=1e-3)
    assert available.values[-1] == pytest.approx(0.2 * 2 * 9, rel=0.02)  # μ m g
    columns = analysis.curves.friction(0, 1).columns
    for curve, name in ((available, "available"), (used, "used")):
        assert np.array_equal(curve.values[np.isfinite(curve.values)], columns[name])


def test_what_holds_uses_less_friction_than_there_is(tmp_path: Path) -> None:
    analysis, _ = told(SLOPE.replace("lateralFriction=0.2", "lateralFriction=0.8"), tmp_path)
    its = analysis.curves.friction(0, 1).columns
    assert its["used"][-1] == pytest.approx(2 * 3, rel=0.02)  # what gravity pulls sideways
    assert its["available"][-1] == pytest.approx(0.8 * 2 * 9, rel=0.02)


def test_what_flies_shows_its_height_beside_free_fall(tmp_path: Path) -> None:
    _, story = told(BALL, tmp_path)
    (heights,) = (panel for panel in story.panels if "height" in panel.title)
    fall, ball = heights.curves
    known = np.isfinite(fall.values) & (fall.times_s < 0.5)
    assert fall.values[known] == pytest.approx(3 - 9.81 * fall.times_s[known] ** 2 / 2, abs=1e-9)
    assert ball.values[0] == 3


@pytest.mark.long
@pytest.mark.parametrize(
    "scene", some([ARM.format(force=20), ARM.format(force=300), SLOPE, BALL], 1)
)
def test_energy_closes_and_every_text_is_inside_the_picture(scene: str, tmp_path: Path) -> None:
    analysis, story = told(scene, tmp_path)
    assert 1 <= len(story.panels) <= 4
    names = [curve.name for panel in story.panels for curve in panel.curves]
    assert all(isinstance(name, Message) for name in names), names  # so translated
    for body in analysis.bodies:
        its = analysis.curves.energy(body.id)
        if its is not None and body.energy is not None:
            given = sum(values for name, values in its.columns.items() if name != "whole")
            assert given == pytest.approx(its.columns["whole"], abs=1e-9)
            change_j = body.energy.end_j - body.energy.start_j
            assert its.columns["whole"][-1] == pytest.approx(change_j, rel=1e-9, abs=1e-9)
    with style.themed(LIGHT):
        assert is_within(build_figure(story, LIGHT))
    assert render(story, "png", dark=True) == render(story, "png", dark=True)


CAR = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
car = p.loadURDF("husky/husky.urdf", [0, 0, .1])
for wheel in (2, 3, 4, 5):
    p.setJointMotorControl2(car, wheel, p.VELOCITY_CONTROL, targetVelocity=10, force=50)
steps(480)
"""


def test_a_noisy_torque_is_evened_and_says_over_how_long(tmp_path: Path) -> None:
    analysis, story = told(CAR, tmp_path)
    (panel,) = (panel for panel in story.panels if "torque of its motor" in panel.title)
    assert panel.title.endswith("mean over 0.033 s")
    (car,) = (body for body in analysis.bodies if body.joints)
    place = next(k for k, row in enumerate(car.joints) if row.name in panel.title)
    torque = analysis.curves.joints(car.id).columns["torque"][:, place]
    shown = panel.curves[0].values
    assert shown[100] == pytest.approx(torque[96:104].mean())
    assert np.ptp(shown[240:]) < 0.5 * np.ptp(torque[240:])


def test_the_viewer_shows_few_joints_and_no_joint_for_what_its_file_lacks(tmp_path: Path) -> None:
    analysis, _ = told(ARM.format(force=20), tmp_path)
    panels, bodies = viewed(analysis, record(ARM.format(force=20), tmp_path / "b.rrd").seen.bodies)
    assert bodies == ["0_model"]
    positions, motors, *_ = panels
    assert (positions.unit, motors.unit) == ("rad", "N m")
    assert [panel.title.split(",")[0] for panel in (positions, motors)] == [
        "Joint positions",
        "Motors",
    ]
    assert positions.curves[0].name == analysis.findings[0].joint
    assert (motors.curves[1].name, motors.curves[1].look) == (motors.curves[0].name, "dashed")
    assert set(np.abs(motors.curves[1].values)) == {20.0}
    assert sum(curve.look != "dashed" for curve in positions.curves) == 4
    for panel in panels:
        assert all(len(curve.steps) == len(curve.values) for curve in panel.curves)
    assert any("energy of 0_model" in panel.title for panel in panels)
    files = [replace(finding, code="no-inertial") for finding in analysis.findings if finding.joint]
    story = plot_of(replace(analysis, findings=files))
    assert not any(panel.mark for panel in story.panels)
