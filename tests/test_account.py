"""The account: for each body, the requested and the actual result, and the causes of the gap.

Verification: each kind of row against a closed form of the same motion; and the false rows that a
generic account is prone to, none of which may be told.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from conftest import some
from drop_physics.account.ranking import ranked
from drop_physics.account.rows import KINDS, AccountRow, RowTerm
from drop_physics.analysis.citing import citing
from drop_physics.analysis.results import Analysis
from drop_physics.errors import ScenarioError
from drop_physics.quantities import quantity
from drop_physics.report.account import rows_beside, who_of
from drop_physics.report.bodies import joint_table
from drop_physics.report.markdown import markdown_of
from drop_physics.report.terminal import block_lines
from drop_physics.report.words import beneath
from drop_physics.rules.answer import Effect, Finding
from drop_physics.stages.analyze import analyze
from drop_physics.stages.analyze.events import events
from drop_physics.stages.record import record_script

G = 9.81
Told = Callable[..., list[AccountRow]]

MODEL = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  {more}
  <worldbody>{world}</worldbody>
</mujoco>
"""
RUN = """
import mujoco
model = mujoco.MjModel.from_xml_string('''{model}''')
data = mujoco.MjData(model)
for step in range({steps}):
    {before}
    mujoco.mj_step(model, data)
"""


@pytest.fixture
def told(tmp_path: Path) -> Told:
    """Return a function that records a MuJoCo script and returns the rows of its account."""

    def rows(
        world: str, more: str = "", before: str = "pass", steps: int = 500
    ) -> list[AccountRow]:
        model = MODEL.format(world=world, more=more)
        script = tmp_path / "script.py"
        script.write_text(RUN.format(model=model, steps=steps, before=before))
        recorded = record_script(str(script), out=tmp_path / "script.rrd", force=True)
        return [*analyze(recorded.recording).account]

    return rows


def the(rows: Sequence[AccountRow], kind: str, who: str) -> AccountRow:
    """Return the only row of a kind about a given element."""
    found = [row for row in rows if row.kind == kind and who in (row.who, row.body)]
    assert len(found) == 1, [(row.kind, row.who, str(row.told)) for row in rows]
    return found[0]


def value(row: AccountRow, words: str) -> float:
    """Return the value of a row's only term whose description begins with a text."""
    (found,) = [term.value for term in row.terms if str(term.words).startswith(words)]
    return found


SLIDE = """
<body name="mass" pos="0 0 1">
  <joint name="up" type="slide" axis="0 0 1" damping="{damping}"/>
  <geom type="sphere" size="0.1" mass="2"/>
</body>
"""


def test_a_spring_like_servo_sags_by_weight_over_stiffness(told: Told) -> None:
    actuator = "<actuator><position name='a' joint='up' kp='200' kv='40'/></actuator>"
    row = the(told(SLIDE.format(damping=0), actuator, steps=1500), "asked", "up")
    assert row.gap == pytest.approx(-2 * G / 200, rel=1e-6)  # kp (target - q) = m g
    assert value(row, "kp × gap") == pytest.approx(2 * G, rel=1e-6)
    assert value(row, "gravity") == pytest.approx(-2 * G, rel=1e-6)
    assert row.time_s == pytest.approx(3.0, abs=0.01)  # its steady part, not the way there


def test_a_servo_with_damping_follows_a_ramp_behind_by_kv_rate_over_kp(told: Told) -> None:
    more = "<actuator><position name='a' joint='up' kp='400' kv='80'/></actuator>"
    world = SLIDE.format(damping=0).replace("</body>", "</body>")
    row = the(
        told(world, "<option gravity='0 0 0'/>" + more, "data.ctrl[0] = 0.5 * data.time", 1500),
        "asked",
        "up",
    )
    assert row.gap == pytest.approx(-80 * 0.5 / 400, rel=0.02)  # the target stands for a step
    assert value(row, "kp × gap") == pytest.approx(-value(row, "kv × rate"), rel=0.02)
    assert value(row, "kp × gap") == pytest.approx(80 * 0.5, rel=0.02)


def test_a_motor_at_its_limit_is_told_with_what_holding_takes(told: Told) -> None:
    more = (
        "<actuator><position name='a' joint='up' kp='2000' kv='100' "
        "forcerange='-15 15'/></actuator>"
    )
    floor = "<geom type='plane' size='5 5 1'/>"
    row = the(told(floor + SLIDE.format(damping=200), more), "asked", "up")
    assert row.at_limit
    assert f"holding its target takes {2 * G:.3g} N" in row.told
    assert value(row, "gravity") == pytest.approx(-2 * G, rel=1e-6)
    drive = sum(term.value for term in row.terms if str(term.words).startswith("k"))
    assert drive == pytest.approx(15, rel=1e-6)


def test_a_fall_is_given_by_gravity_and_stopped_by_the_floor(told: Told) -> None:
    world = """<geom name="floor" type="plane" size="5 5 1"/>
    <body name="ball" pos="0 0 1"><freejoint/><geom type="sphere" size="0.1" mass="2"/></body>"""
    rows = told(world)
    row = the(rows, "moved", "1_ball")
    fell = row.got
    assert fell is not None
    assert value(row, "gravity") == pytest.approx(2 * G * fell, rel=0.02)
    energy = the(rows, "energy", "1_ball")
    assert energy.gap is not None
    assert value(energy, "contact") == pytest.approx(energy.gap, rel=0.01)


def test_a_block_slides_as_far_as_friction_lets_it(told: Told) -> None:
    world = """<geom name="floor" type="plane" size="50 50 1" friction="0.3"/>
    <body name="block" pos="0 0 0.1"><freejoint/>
    <geom type="box" size="0.1 0.1 0.1" mass="2" friction="0.3"/></body>"""
    started = "data.qvel[0] = 0.5 if step == 300 else data.qvel[0]"  # once it has settled
    rows = told(world, before=started, steps=800)
    moved = the(rows, "moved", "1_block")
    assert moved.got == pytest.approx(0.5**2 / (2 * 0.3 * G), rel=0.05)
    assert value(moved, "friction") == pytest.approx(-0.5 * 2 * 0.5**2, rel=0.05)
    assert moved.told.endswith("no force gives it that: the script wrote its state")
    slips = the(rows, "slips", "world × block")
    assert slips.got is not None
    assert moved.got is not None
    assert slips.got <= moved.got * 1.05  # it slides while it touches: it hops a little


SLED = """<geom type="plane" size="9 9 1"/>
<body name="trunk" pos="0 0 0.1"><freejoint/><geom type="box" size="0.3 0.2 0.02" mass="5"/>
<body name="left" pos="0 0.3 0"><joint axis="0 0 1" range="-1 1" limited="true" stiffness="1e4"/>
<geom type="box" size="0.3 0.02 0.1" mass="1" friction="0.05" priority="1"/></body>
<body name="right" pos="0 -0.3 0"><joint axis="0 0 1" range="-1 1" limited="true" stiffness="1e4"/>
<geom type="box" size="0.3 0.02 0.1" mass="1" friction="0.05" priority="1"/></body></body>"""


def test_a_robot_whose_feet_slip_is_told_with_all_of_them(told: Told) -> None:
    """At 1 m/s and a coefficient of 0.05 each foot slides until v² / (2 μ g), and then stands."""
    rows = told(SLED, before="data.qvel[0] = 1.0 if step == 300 else data.qvel[0]", steps=1400)
    (row,) = [each for each in rows if each.kind == "slips"]
    assert row.alike == 1
    # It hops a little, and so slides a little less while it touches.
    assert row.got == pytest.approx(1 / (2 * 0.05 * G), rel=0.1)
    assert "friction at its limit, coefficient 0.05, in" in str(row.told)
    both, steps = (re.search(p, row.told) for p in (r"2 links slid (\S+) m", r"in ([\d,]+) steps"))
    assert both is not None
    assert steps is not None
    assert float(both[1]) == pytest.approx(2 / (2 * 0.05 * G), rel=0.1)
    assert int(steps[1].replace(",", "")) <= 1400  # a step counts once


def test_a_control_is_counted_at_each_end_of_its_range(told: Told) -> None:
    world = """<body name="rod"><joint name="hinge" axis="0 0 1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.5 0 0" mass="1"/></body>"""
    more = "<actuator><motor name='m' joint='hinge' ctrlrange='-1 1'/></actuator>"
    rows = told(world, more, "data.ctrl[0] = 2 if step < 100 else -3", 250)
    assert the(rows, "asked", "m").told == (
        "ctrl -3, clamped to -1 in 150 and to 1 in 100 of 250 steps"
    )


def test_a_control_that_a_callback_writes_is_the_one_in_effect(told: Told) -> None:
    world = """<body name="rod"><joint name="hinge" axis="0 0 1" damping="1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.5 0 0" mass="1"/></body>"""
    more = "<actuator><position joint='hinge' kp='1' ctrlrange='-2 2'/></actuator>"
    write = "mujoco.set_mjcb_control(lambda m, d: d.ctrl.__setitem__(0, 3 if d.time > 0.2 else 0))"
    assert the(told(world, more, write, 300), "asked", "hinge").asked == pytest.approx(2.0)


def test_a_torque_is_told_as_it_begins(told: Told) -> None:
    world = """<body name="rod"><joint name="hinge" axis="0 0 1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.5 0 0" mass="1"/></body>"""
    more = "<actuator><motor name='m' joint='hinge' gear='3' ctrlrange='-1 1'/></actuator>"
    rows = told(world, more, "data.ctrl[0] = 2")
    given = the(rows, "given", "hinge")
    assert "ctrl 2 clamped to 1 × gear 3" in given.told
    assert given.asked == pytest.approx(3.0, rel=1e-9)
    assert given.got == pytest.approx(3.0, rel=1e-6)  # nothing else acts: all of it accelerates
    assert the(rows, "asked", "m").got == 1.0


@pytest.mark.parametrize(
    ("world", "more", "before", "who", "words"),
    some(
        [
            (
                """<body name="one" pos="0 0 1"><freejoint/><geom size="0.1"/></body>""",
                "<option><flag gravity='disable'/></option>",
                "pass",
                "0_one",
                "which a flag of the model switches off",
            ),
            (
                SLIDE.format(damping=1),
                "<option><flag actuation='disable'/></option>"
                "<actuator><motor name='m' joint='up'/></actuator>",
                "data.ctrl[0] = 1",
                "m",
                "a flag of the model switches actuators off",
            ),
            (
                """<geom name="floor" type="plane" size="5 5 1"/><body name="ball" pos="0 0 1">
            <freejoint/><geom type="sphere" size="0.1" contype="2" conaffinity="2"/></body>""",
                "",
                "pass",
                "ball × world",
                "share no bit",
            ),
            (
                """<body name="one" pos="0 0 1"><freejoint name="f"/><geom size="0.1"/></body>""",
                "<equality><weld name='hold' body1='one' active='false'/></equality>",
                "pass",
                "hold",
                "it is not active",
            ),
        ],
        2,
    ),
    ids=["gravity", "actuation", "mask", "equality"],
)
def test_what_could_have_acted_is_told_with_the_reason(
    told: Told, world: str, more: str, before: str, who: str, words: str
) -> None:
    row = the(told(world, more, before), "idle", who)
    assert words in row.told


def test_a_state_that_is_written_each_step_is_told(told: Told) -> None:
    wall = "<geom name='wall' type='plane' size='5 5 1' pos='0 0 1.11'/>"
    world = wall + SLIDE.format(damping=0)
    row = the(told(world, before="data.qpos[0] = 0.2", steps=300), "set", "1_mass")
    assert row.told.startswith("the script wrote its state before 299 of the 299 steps after")
    # A sphere of 0.1 m around z = 1.2 reaches 10 mm below the plane.
    assert "up to 10 mm into world" in row.told


def test_rows_of_equal_bodies_are_one(told: Told) -> None:
    ball = """<body name="b{n}" pos="{n} 0 1"><freejoint/>
    <geom type="sphere" size="0.1" mass="2"/></body>"""
    rows = told("".join(ball.format(n=n) for n in range(4)))
    falls = [row for row in rows if row.kind == "moved"]
    assert len(falls) == 1
    assert falls[0].alike == 3


@pytest.mark.pybullet
def test_no_row_tells_what_no_explained_step_shows(tmp_path: Path) -> None:
    """A box that starts inside another is thrown in the first step, hidden by its substeps."""
    script = tmp_path / "inside.py"
    script.write_text(
        textwrap.dedent(
            """
            import pybullet as p
            p.connect(p.DIRECT)
            p.setGravity(0, 0, -9.81)
            p.setPhysicsEngineParameter(numSubSteps=4)
            box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
            p.createMultiBody(0, box)
            p.createMultiBody(1, box, basePosition=[0, 0, 0.14])
            for _ in range(240):
                p.stepSimulation()
            """
        )
    )
    analysis = analyze(record_script(str(script), out=tmp_path / "inside.rrd").recording)
    assert analysis.explained.samples < analysis.explained.of
    assert not [row for row in analysis.account if "no force gives" in row.told]


def test_rows_are_ranked_and_their_numbers_are_finite(told: Told) -> None:
    rows = told(SLIDE.format(damping=0), before="pass")
    assert [row.salience for row in rows] == sorted((row.salience for row in rows), reverse=True)
    assert {row.kind for row in rows} <= set(KINDS)
    assert all(math.isfinite(term.value) for row in rows for term in row.terms)


FLOOR = "<geom name='floor' type='plane' size='5 5 1'/>"
CART = """<body name="cart" pos="0 0 0.05"><freejoint/>
<geom type="box" size="0.1 0.05 0.02" mass="1"/>
<body name="left" pos="0 0.08 0"><joint name="l" axis="0 1 0"/>
<geom type="cylinder" size="0.05 0.01" pos="{off} 0 0" euler="90 0 0" mass="0.1"/></body>
<body name="right" pos="0 -0.08 0"><joint name="r" axis="0 -1 0"/>
<geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.1"/></body></body>"""
WHEELS = """<actuator><velocity joint="l" kv="1"/><velocity joint="r" kv="1"/></actuator>"""


def test_wheels_that_do_as_asked_rank_with_the_body_that_they_turn(told: Told) -> None:
    rows = told(FLOOR + CART.format(off=0), WHEELS, "data.ctrl[:] = 3", steps=800)
    turned = the(rows, "turned", "1_cart")
    wheels = [the(rows, "asked", name) for name in "lr"]  # about y and -y: not alike
    axes = [str(row.told).partition("the world's ")[2] for row in wheels]
    assert sorted(axes) == ["-y at the end", "y at the end"]
    assert all(row.salience > 0.2 * turned.salience for row in wheels)
    assert rows.index(wheels[1]) < 4


def test_a_wheel_off_its_axle_is_told(told: Told) -> None:
    rows = told(FLOOR + CART.format(off=0.004), WHEELS, "data.ctrl[:] = 3", steps=50)
    assert "its cylinder of radius 50 mm is 4 mm off its axle" in the(rows, "asked", "l").told
    assert "off its axle" not in the(rows, "asked", "r").told


def test_a_centre_of_mass_outside_its_shape_is_told(told: Told) -> None:
    body = """<body name="plate" pos="0 0 0.3" euler="60 0 0"><freejoint/>
    <inertial pos="0 0 {z}" mass="1" diaginertia="0.01 0.01 0.01"/>
    <geom type="box" size="0.1 0.1 0.01"/></body>"""
    assert "110 mm outside" not in the(told(FLOOR + body.format(z=0)), "turned", "1_plate").told
    row = the(told(FLOOR + body.format(z=-0.12)), "turned", "1_plate")
    assert "its centre of mass is 0.11 m outside its shape" in row.told


def test_a_push_that_reaches_a_joint_no_more_is_told_with_the_axis_that_turned(told: Told) -> None:
    world = """<body name="arm"><joint name="pan" axis="0 0 1" damping="10"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0"/>
    <body name="roller" pos="0.3 0 0"><joint name="roll" axis="1 0 0" damping="0.01"/>
    <geom type="sphere" size="0.05" mass="0.2"/></body></body>"""
    more = "<actuator><position joint='pan' kp='200' kv='20' ctrlrange='-2 2'/></actuator>"
    turns = "data.xfrc_applied[2, 3] = 0.05; data.ctrl[0] = 1.5708 if step > 300 else 0"
    rows = told(world, "<option gravity='0 0 0'/>" + more, turns, steps=1500)
    row = the(rows, "moved", "roll")
    assert "the applied force gives it +0.05 N m at first" in row.told
    assert "its axis is x at first, y at the end" in row.told


@pytest.mark.parametrize(("condim", "told_of"), [(3, True), (6, False)])
def test_what_turns_for_ever_lacks_torsional_friction(
    told: Told, condim: int, told_of: bool
) -> None:
    ball = f"""<body name="ball" pos="0 0 0.1"><freejoint/>
    <geom type="sphere" size="0.1" condim="{condim}" friction="1 0.05 0.001"/></body>"""
    spun = "data.qvel[5] = 4 if step == 200 else data.qvel[5]"
    rows = told(FLOOR + ball, before=spun, steps=900)
    found = [row for row in rows if row.kind == "idle"]
    assert bool(found) is told_of
    if told_of:
        assert found[0].got == pytest.approx(4, rel=0.05)
        assert "only sliding would brake it" in found[0].told
        # 4 rad/s from step 200 on, which no orientation tells: 5.6 rad are more than half a turn.
        assert the(rows, "turned", "1_ball").got == pytest.approx(4 * 700 * 0.002, rel=0.05)


def test_a_fixed_base_carries_what_contacts_do_not(told: Told) -> None:
    arm = """<body name="mount" pos="0 0 {height}"><geom size="0.01" contype="0" conaffinity="0"/>
    <body name="leg"><joint name="lift" type="slide" axis="0 0 1" damping="20"/>
    <geom type="sphere" size="0.1" mass="2"/></body></body>"""
    hold = "<actuator><position joint='lift' kp='2000' kv='200'/></actuator>"
    row = the(told(arm.format(height=1), hold, steps=2000), "held", "0_mount")
    assert row.got == pytest.approx(2 * G, rel=1e-2)
    stands = the(told(FLOOR + arm.format(height=0.1), steps=2000), "held", "1_mount")
    assert stands.got == pytest.approx(0, abs=0.05 * 2 * G)


def test_a_base_is_not_said_to_carry_what_gravity_compensation_does(told: Told) -> None:
    arm = """<body name="mount" pos="0 0 1"><geom size="0.01" contype="0" conaffinity="0"/>
    <body name="leg" gravcomp="1"><joint name="lift" type="slide" axis="0 0 1" damping="20"/>
    <geom type="sphere" size="0.1" mass="2"/></body></body>"""
    assert not [row for row in told(arm) if row.kind == "held"]


def test_a_friction_that_does_not_act_is_told_where_it_would_let_go(told: Told) -> None:
    """On a slope of 15°, 0.05 would let a block slide, and 0.5 hold it, as the floor's 1 does."""
    block = """<body name="{name}" pos="0 {y} 0.05"><freejoint/>
    <geom type="box" size="0.05 0.05 0.05" friction="{mu}"/></body>"""
    blocks = [block.format(name=n, y=y, mu=mu) for n, y, mu in (("wet", 0, 0.05), ("dry", 1, 0.5))]
    slope = f"{G * math.sin(math.radians(15))} 0 {-G * math.cos(math.radians(15))}"
    more = f"<option gravity='{slope}' cone='elliptic'/>"
    rows = told("<geom type='plane' size='5 5 1'/>" + "".join(blocks), more, steps=200)
    (row,) = [row for row in rows if row.kind == "idle"]
    assert (
        "the friction 0.05 of wet does not act: the contact has the greater of both, 1" in row.told
    )
    reached = float(re.findall(r"reaches ([\d.]+)", row.told)[0])
    assert reached == pytest.approx(math.tan(math.radians(15)), abs=0.01)


def test_a_start_is_told_in_both_orders_of_its_quaternion_and_in_both_frames(told: Told) -> None:
    world = """<body name="sat" pos="0 0 1" quat="{w} {x} {y} {z}"><freejoint/>
    <geom type="box" size="0.1 0.2 0.3"/></body>"""
    c, s = math.cos(0.25), math.sin(0.25)
    none = "<option gravity='0 0 0'/>"
    spin = "data.qvel[3:6] = (0, 0, 2) if not step else data.qvel[3:6]"
    (row,) = [
        row
        for row in told(world.format(w=c, x=0, y=s, z=0), none, spin, 100)
        if row.kind == "turned"
    ]
    across = 2 * math.sin(0.5), 2 * math.cos(0.5)
    assert "(0, 0, 2) rad/s in its own axes" in row.told
    assert f"({across[0]:.3g}, 0, {across[1]:.3g}) rad/s in the world's" in row.told
    assert "w last" not in row.told
    (row,) = [
        row
        for row in told(world.format(w=0, x=s, y=0, z=c), none, spin, 100)
        if row.kind == "turned"
    ]
    assert f"with w last the same numbers are {math.degrees(0.5):.3g}° about y" in row.told


def test_a_ray_that_meets_nothing_is_told_with_its_direction(told: Told) -> None:
    drone = """<geom type="plane" size="5 5 1"/><body name="drone" pos="0 0 2" euler="30 0 0">
    <joint type="slide"/><geom size="0.1"/><site name="eye" pos="0 0 -0.2" euler="{turn} 0 0"/>
    </body>"""
    sensor = "<sensor><rangefinder name='sonar' site='eye'/></sensor>"
    row = the(told(drone.format(turn=0), sensor, steps=20), "reads", "sonar")
    assert "rangefinder on drone: -1 m at the end and in every step" in row.told
    sine, cosine = math.sin(math.radians(30)), math.cos(math.radians(30))
    assert f"at first (0, {-sine:.3g}, {cosine:.3g}) in the world" in row.told
    row = the(told(drone.format(turn=150), sensor, steps=1), "reads", "sonar")
    assert "meets nothing" not in row.told
    assert row.got == pytest.approx(2 - 0.2 * cosine, rel=1e-3)


def test_a_push_along_the_world_is_told_in_the_axes_of_a_turned_body(told: Told) -> None:
    world = """<body name="quad" pos="0 0 1" euler="0 {tilt} 0"><freejoint/>
    <geom type="box" size="0.2 0.2 0.05" mass="1"/></body>"""
    push = "data.xfrc_applied[1, 2] = 15"
    rows = told(world.format(tilt=20), "", push, 100)
    own = -math.sin(math.radians(20)), math.cos(math.radians(20))
    said = f"along the world's z on the whole, at the start ({own[0]:.3g}, 0, {own[1]:.3g}) in its"
    assert said in the(rows, "moved", "0_quad").told
    rows = told(world.format(tilt=0), "", push, 100)
    assert not [row for row in rows if "own axes" in row.told]


def test_held_controls_are_told_in_the_actuators_order(told: Told) -> None:
    arm = """<body name="arm"><joint name="one" axis="0 0 1" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.1"/>
    <body pos="0.3 0 0"><joint name="two" axis="0 0 1" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.1"/></body></body>"""
    servos = """<actuator><position name="b" joint="two" kp="50"/>
    <position name="a" joint="one" kp="50"/></actuator>"""
    rows = told(arm, servos, "data.ctrl[:] = 0.4, -0.2", 1000)
    assert "b 0.4, two 0.4 rad; a -0.2, one -0.2 rad" in the(rows, "given", "0_arm").told
    rows = told(arm, servos, "data.ctrl[:] = 0.4 * data.time, -0.2", 300)
    assert not [row for row in rows if "in their order" in row.told]


PENDULUM = """<body name="arm" pos="0 0 1"><joint name="pin" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="1"/>
<site name="tip" pos="0.4 0 0"/></body>"""
USES = {
    "kept": ("trace.append(data.qpos)", "trace.append(data.qpos.copy())"),
    "stale": (
        "data.qpos[0] = 1.0 if step == 1 else data.qpos[0]; tip = data.site_xpos[0].copy()",
        "data.qpos[0] = 1.0 if step == 1 else data.qpos[0]; mujoco.mj_kinematics(model, data); "
        "tip = data.site_xpos[0].copy()",
    ),
    "first": (
        "if not step: data.qpos[0] = 0.5\n    if not step: tip = data.site('tip').xpos.copy()",
        "tip = data.site('tip').xpos.copy()",
    ),
    "overwritten": ("data.qfrc_passive[0] = -5", "data.qfrc_applied[0] = -data.qfrc_passive[0]"),
    "left": (
        "if step < 20: data.xfrc_applied[1, 2] = 7",
        "data.xfrc_applied[1, 2] = 7 if step < 20 else 0",
    ),
}
"""For each use of an array: a line that has another effect than it seems, and a right one."""


@pytest.mark.parametrize("use", some(USES, 2))
def test_a_use_of_an_array_to_another_effect_is_told_with_its_line(
    tmp_path: Path, told: Told, use: str
) -> None:
    for line, is_wrong in zip(USES[use], (True, False), strict=True):
        before = f"trace = [] if not step else trace\n    {line}"
        rows = [row for row in told(PENDULUM, "", before, 120) if row.site and "script" in row.site]
        assert len(rows) == is_wrong, [str(row.told) for row in rows]
        if is_wrong:
            file, _, number = str(rows[0].site).partition(":")
            last = line.splitlines()[-1].strip()
            assert last in (tmp_path / file).read_text().splitlines()[int(number) - 1]
            said = str(rows[0].told)
    if use == "kept":
        assert said.startswith("qpos is kept in 64 steps or more")
    elif use == "first":  # what is read is 0, before anything is computed
        off_m = math.hypot(0.4 * math.cos(0.5), 1 - 0.4 * math.sin(0.5))
        assert f"is {off_m:.3g} m off" in said
    elif use == "stale":  # the tip goes from an angle of nearly 0 to one of 1 rad
        off = float(re.findall(r"is ([\d.]+) m off", said)[0])
        assert off == pytest.approx(2 * 0.4 * math.sin(0.5), rel=1e-2)
        assert "site_xpos of tip" in said
    elif use == "overwritten":
        assert said.startswith("qfrc_passive is written before 64 steps or more, to no effect")
    else:
        assert (
            "xfrc_applied of arm is used before 20 steps, for the last time before step 20" in said
        )


EDITED = """
import mujoco
model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>
<body name="ball" pos="0 0 1"><joint name="up" type="slide"/><geom name="shell" size="0.1"/></body>
</worldbody><actuator><position name="servo" joint="up" kp="10"/></actuator></mujoco>''')
{edit}
data = mujoco.MjData(model)
mujoco.mj_step(model, data, 20)
"""
EDITS = (
    ("model.geom('shell').size[:] = 0.2", "geom_size of shell is changed from 0.1 to 0.2"),
    ("model.actuator_gainprm[:, 0] = 40", "actuator_gainprm of servo is changed from 10 to 40"),
    ("model.actuator_gainprm[:, 0] = 40; model.actuator_biasprm[:, 1] = -40", None),
    ("model.geom_rgba[:] = 1", None),
)
"""Edits of a model before its first step; those that leave out something that belongs to them."""


@pytest.mark.parametrize(("edit", "said"), some(EDITS, 2))
def test_an_edit_before_the_first_step_is_told_with_what_it_leaves_out(
    tmp_path: Path, edit: str, said: str | None
) -> None:
    (tmp_path / "script.py").write_text(EDITED.format(edit=edit))
    recorded = record_script(str(tmp_path / "script.py"), out=tmp_path / "script.rrd")
    rows = analyze(recorded.recording).account
    told = [str(row.told) for row in rows if row.site and "script" in row.site]
    assert len(told) == (said is not None), told
    if said is not None:
        assert said in told[0]
        assert ("geom_rbound, body_mass, body_inertia" in told[0]) == ("shell" in said)


SWING = """<body name="upper" pos="0 0 2"><joint name="shoulder" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="2"/>{site}
<body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0.6 0.8 0" damping="0.3"/>
<geom type="box" size="0.15 0.03 0.02" pos="0.15 0 0" mass="1"/>{site}</body></body>"""


def test_what_a_joint_carries_is_what_a_sensor_there_reads(tmp_path: Path, told: Told) -> None:
    """Of a chain in mid-swing; in the bare run a force and a torque sensor stand at each joint."""
    row = the(told(SWING.format(site=""), "<option timestep='0.0002'/>"), "held", "shoulder")
    site = '<site name="{}"/>'
    model = mujoco.MjModel.from_xml_string(
        MODEL.format(
            world=SWING.replace("{site}", site).format("upper", "lower"),
            more="<option timestep='0.0002'/><sensor>"
            + "".join(
                f'<{kind} site="{name}"/>'
                for name in ("upper", "lower")
                for kind in ("force", "torque")
            )
            + "</sensor>",
        )
    )
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    read = data.sensordata.reshape(4, 3)
    (body,) = analyze(tmp_path / "script.rrd").bodies
    across = [each for j in body.joints for each in (j.reaction_n, j.reaction_n_m)]
    for link, its, sensed in zip((1, 1, 2, 2), across, read, strict=True):
        assert its is not None
        in_site = data.xmat[link].reshape(3, 3).T @ its
        assert in_site == pytest.approx(sensed, rel=5e-3, abs=1e-2 * np.linalg.norm(sensed))
    assert row.got == pytest.approx(np.linalg.norm(read[0]), rel=5e-3)
    assert row.asked == pytest.approx(3 * G)
    assert row.alike == 1  # the elbow


def test_a_connect_is_told_by_its_gap(told: Told) -> None:
    """A mass hangs on a soft connect constraint: at rest, the gap follows from the states."""
    world = """<body name="mass" pos="0 0 1"><joint name="up" type="slide" axis="0 0 1"/>
    <geom type="sphere" size="0.1" mass="2"/></body>"""
    more = """<equality><connect name="hook" body1="mass" anchor="0.02 0 0.1"
    solref="-{k} -200"/></equality>"""
    rows = told(world, more.format(k=5), steps=2000)
    row, slides = the(rows, "asked", "hook"), the(rows, "moved", "up")
    assert slides.got is not None
    assert row.got == pytest.approx(abs(slides.got), rel=1e-6)
    assert "connect of mass and world" in row.told


def test_an_equality_counts_only_while_it_is_active(told: Told) -> None:
    """A weld that is off while its body falls away has no error in that time."""
    body = """<body name="one" pos="0 0 1"><freejoint/><geom size="0.1"/></body>"""
    weld = "<equality><weld name='hold' body1='one'/></equality>"
    row = the(told(body, weld, "data.eq_active[0] = step < 100", steps=400), "asked", "hold")
    assert "active in 100 of 400 steps" in row.told
    assert row.got is not None
    assert row.got < 0.01  # it falls by 1.8 m once it is off


def test_a_joint_equality_is_told_by_how_far_it_is_off(told: Told) -> None:
    world = """<body><joint name="a" axis="0 0 1"/><geom size="0.1" pos="0.3 0 0"/></body>
    <body pos="0 2 0"><joint name="b" axis="0 0 1"/><geom size="0.1" pos="0.3 0 0"/></body>"""
    more = """<equality><joint name="belt" joint1="a" joint2="b" polycoef="0 2 0 0 0"/></equality>
    <actuator><motor joint="b"/></actuator>"""
    row = the(told(world, more, "data.ctrl[0] = 0.5", steps=300), "asked", "belt")
    assert "joint of a and b" in row.told
    assert row.got is not None
    assert 0 < row.got < 0.05


@pytest.mark.parametrize("sites", [False, True], ids=["bodies", "sites"])
def test_a_weld_is_told_by_the_angle_between_its_orientations(told: Told, *, sites: bool) -> None:
    """A soft weld is to turn a body on a hinge by 0.5 rad, and a spring holds it where it is.

    It creeps there, so that the hinge's angle at the end is what it turned of the 0.5 rad.
    """
    world = """<site name="there" quat="{turn}"/>
    <body name="mass"><joint name="turn" axis="0 0 1" stiffness="3" damping="1"/>
    <geom size="0.1" mass="2" pos="0.2 0 0"/><site name="here" quat="0.6 0 0.8 0"/></body>"""
    half = 0.25  # of the angle
    turn = f"{math.cos(half)} 0 0 {math.sin(half)}"
    joined = "body1='world' body2='mass' relpose='0 0 0 {turn}'"
    if sites:  # the frame of `here`, turned by 0.5 rad about z
        c, s = math.cos(half), math.sin(half)
        turn, joined = f"{0.6 * c} {-0.8 * s} {0.8 * c} {0.6 * s}", "site1='there' site2='here'"
    more = f"<equality><weld name='hold' {joined.format(turn=turn)} solref='-30 -40'/></equality>"
    rows = told(world.format(turn=turn), "<option gravity='0 0 0'/>" + more, steps=500)
    row, hinge = the(rows, "asked", "hold"), the(rows, "moved", "turn")
    assert hinge.got is not None
    assert 0.05 < hinge.got < 0.45
    assert row.unit == "rad"
    assert row.got == pytest.approx(0.5, abs=1e-3)  # at first
    assert f"({math.degrees(0.5 - hinge.got):.3g}° at the end)" in row.told


def test_a_tendon_equality_is_told_by_the_lengths(told: Told) -> None:
    """One tendon of a slide is to be as long as another one of that slide, and one as 0.4."""
    slide = """<body name="{name}" pos="0 {y} 0"><joint name="{name}" type="slide" axis="1 0 0"
    stiffness="9" damping="9"/><geom size="0.1" mass="{mass}"/></body>"""
    fixed = '<fixed name="of_{name}"><joint joint="{name}" coef="2"/></fixed>'
    names = "abc"
    world = "".join(
        slide.format(name=name, y=mass, mass=mass) for mass, name in enumerate(names, 1)
    )
    more = f"""<option gravity='0 0 0'/><tendon>{"".join(fixed.format(name=n) for n in names)}
    </tendon><equality><tendon name="both" tendon1="of_a" tendon2="of_b" polycoef="0.8 3 0 0 0"
    solref="-30 -30"/>
    <tendon name="one" tendon1="of_c" polycoef="0.4 0 0 0 0" solref="-30 -30"/></equality>"""
    rows = told(world, more, steps=500)
    a, b, c = (the(rows, "moved", name).got for name in names)
    assert a is not None
    assert b is not None
    assert c is not None
    both, one = the(rows, "asked", "both"), the(rows, "asked", "one")
    assert both.asked == pytest.approx(0.8 + 3 * 2 * b, rel=2e-2)
    assert both.gap == pytest.approx(2 * a - 0.8 - 3 * 2 * b, abs=3e-3)
    assert one.gap == pytest.approx(2 * c - 0.4, rel=2e-2)
    assert one.gap < -0.02  # the spring holds it back
    assert "tendon of of_c: length 0.4, got" in one.told
    assert (-0.4, "") in one.besides  # at first


def test_a_touch_sensor_is_told_with_what_presses_outside_of_its_site(told: Told) -> None:
    box = """<body name="box" pos="0 0 0.1"><freejoint/>
    <geom type="box" size="0.1 0.1 0.1" mass="2"/>
    <site name="s" type="sphere" size="{size}" pos="0 0 -0.1"/></body>"""
    more = "<sensor><touch name='t' site='s'/></sensor>"
    small = the(told(FLOOR + box.format(size=0.01), more), "reads", "t")
    assert small.got == 0
    assert f"contacts press its link with {2 * G:.3g} N" in small.told
    assert "outside the sensor's site" in small.told  # the corners are 0.14 m off
    large = the(told(FLOOR + box.format(size=0.2), more), "reads", "t")
    assert large.got == pytest.approx(2 * G, rel=1e-3)
    assert "outside" not in large.told


def test_a_force_sensor_is_told_with_the_weight_of_what_hangs_on_it(told: Told) -> None:
    world = """<body name="arm" pos="0 0 1"><joint name="hinge" axis="1 0 0" damping="9"/>
    <geom size="0.05" mass="1"/><site name="s"/>
    <body name="hand" pos="0 0 -0.2"><geom size="0.05" mass="2"/></body></body>"""
    row = the(told(world, "<sensor><force name='f' site='s'/></sensor>"), "reads", "f")
    assert f"{3 * G:.3g} N at the end; what hangs on it has 3 kg and weighs {3 * G:.3g} N" in (
        row.told
    )


@pytest.mark.parametrize(("into_m", "is_told"), [(0.005, False), (0.04, True)])
def test_a_small_overlap_of_a_parent_and_its_child_is_how_a_robot_is_made(
    told: Told, into_m: float, *, is_told: bool
) -> None:
    """A ball on an arm of 0.3 m turns into its parent, with which it makes no contact."""
    world = f"""<body name="torso" pos="0 0 1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/>
    <body name="arm" pos="{0.45 - into_m} 0 0"><joint axis="0 1 0"/>
    <geom pos="0 0 0.3" size="0.05"/></body></body>"""
    before = f"data.qpos[7] = {-math.pi / 2} * (step > 0)"
    rows = told(world, "<option gravity='0 0 0'/>", before, steps=20)
    deep = [row for row in rows if row.kind == "idle" and row.unit == "m"]
    assert len(deep) == is_told
    for row in deep:
        assert row.got == pytest.approx(into_m, rel=1e-6)
        assert row.told.endswith("one is the parent of the other")


def test_what_presses_beside_the_centre_is_told_as_the_mean_of_named_steps(told: Told) -> None:
    """In a bare run the forces of these steps add up to the same arm, and to the same friction."""
    world = """<body name="peg"><geom type="box" size="0.05 0.05 0.2"/></body>
    <body name="plate" pos="0.08 0.01 0.23"><freejoint/>
    <geom type="box" size="0.2 0.2 0.02"/></body>"""
    row = the(told(world, steps=100), "turned", "1_plate")
    pattern = (
        r"from (\S+) s to (\S+) s, peg pressed it (\S+) mm .* average and rubbed with (\S+) of"
    )
    found = re.search(pattern, row.told)
    assert found is not None
    start_s, end_s, arm_mm, share = map(float, found.groups())
    model = mujoco.MjModel.from_xml_string(MODEL.format(world=world, more=""))
    data, force = mujoco.MjData(model), np.zeros(6)
    pressed, rubbed, moment = np.zeros((3, 3))
    for step in range(1, 101):
        mujoco.mj_step(model, data)
        if not start_s - 1e-6 < step * 0.002 < end_s + 1e-6:
            continue
        for index, contact in enumerate(data.contact):
            mujoco.mj_contactForce(model, data, index, force)
            along = contact.frame.reshape(3, 3)
            pressed += force[0] * along[0]
            rubbed += force[1:3] @ along[1:]
            moment += np.cross(contact.pos - data.xipos[2], force[0] * along[0])
    assert arm_mm == pytest.approx(1e3 * np.linalg.norm(moment) / np.linalg.norm(pressed), rel=0.01)
    assert share == pytest.approx(np.linalg.norm(rubbed) / np.linalg.norm(pressed), rel=0.01)


def test_without_gravity_nothing_weighs(told: Told) -> None:
    world = """<body name="arm"><joint name="hinge" axis="0 1 0"/><site name="s"/>
    <geom size="0.05" mass="3" pos="0.5 0 0"/></body>"""
    more = "<option gravity='0 0 0'/><sensor><force name='f' site='s'/></sensor>"
    rows = told(world, more, "data.qvel[0] = 2")
    row = the(rows, "held", "hinge")
    assert row.got == pytest.approx(3 * 2**2 * 0.5, rel=1e-3)  # centripetal
    assert row.asked == 0
    assert row.told.endswith("the links beyond it weigh 0 N")
    assert the(rows, "reads", "f").told.endswith("has 3 kg and weighs 0 N")


def test_what_no_force_brakes_goes_on(told: Told) -> None:
    world = "<body name='puck' pos='0 0 1'>{joint}<geom size='0.1' mass='2'/></body>"
    free = "<option gravity='0 0 0'/>"
    pushed = "data.xfrc_applied[1, 0] = 5 if step < 100 else 0"  # 1 N s
    row = the(told(world.format(joint="<freejoint/>"), free, pushed), "idle", "0_puck")
    assert "it goes on at 0.5 m/s; the damping of its free joint is 0" in row.told
    damped = "<joint type='free' damping='2'/>"
    assert not [r for r in told(world.format(joint=damped), free, pushed) if r.kind == "idle"]


def test_a_flexible_body_is_one_row_of_each_kind(told: Told) -> None:
    world = """<flexcomp name="cloth" type="grid" count="4 4 1" spacing="0.1 0.1 0.1" pos="0 0 1"
    radius="0.01" dim="2" mass="0.5"><contact selfcollide="none"/></flexcomp>"""
    rows = told(world, steps=50)
    assert {row.who for row in rows} == {"cloth"}
    assert len({row.kind for row in rows}) == len(rows)
    assert not [row for row in rows if row.terms]  # its steps have no sum


def test_a_flexible_body_is_told_with_its_fastest_mode(told: Told) -> None:
    """Against MuJoCo's forces on nodes that are moved by 1 µm; one corner is pinned.

    Beyond the frequency that an explicit step allows, it flies apart after a small push.
    """
    world = """<flexcomp name="pad" type="grid" dim="3" count="3 3 2" spacing="0.05 0.05 0.05"
    pos="0 0 1" radius="0.005" mass="1"><contact selfcollide="none"/><pin id="0"/>
    <elasticity young="3e5" poisson="0.2" damping="0.001"/></flexcomp>"""
    free = "<option gravity='0 0 0' integrator='Euler'/>"
    pushed = "data.qvel[0] = 1e-3 if step == 0 else data.qvel[0]"
    row = the(told(world, free, pushed, steps=100), "moved", "pad")
    model = mujoco.MjModel.from_xml_string(MODEL.format(world=world, more=free))
    data = mujoco.MjData(model)
    stiffness = np.zeros((model.nv, model.nv))
    for k in range(model.nv):
        for way in (1e-6, -1e-6):
            data.qpos[:] = model.qpos0
            data.qpos[k] += way
            mujoco.mj_forward(model, data)
            stiffness[:, k] -= data.qfrc_passive / way / 2
    masses = model.body_mass[model.dof_bodyid]
    highest = math.sqrt(np.linalg.eigvals(stiffness / masses[:, None]).real.max())
    assert f"natural frequencies of up to {quantity(highest, 'rad/s')}" in row.told
    most = 2 / math.sqrt(0.002 * (0.002 + 2 * 0.001))
    assert f"is stable up to {most:.3g} rad/s" in row.told
    assert highest > most
    assert abs(row.got or 0.0) > 1.0
    assert who_of(row) == "pad"


def test_what_falls_on_a_flexible_body_is_told_without_terms(told: Told) -> None:
    """No step of such a run has a sum; the body ends at rest, and has lost its potential energy."""
    world = """<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" pos="0 0 .3"
    radius="0.01" dim="2" mass="0.5"><contact selfcollide="none"/></flexcomp>
    <body name="ball" pos="2 0 0.3"><freejoint/><geom size="0.1" mass="1"/></body>"""
    rows = told(FLOOR + world, steps=400)
    lost = the(rows, "energy", next(row.body or "" for row in rows if "ball" in (row.body or "")))
    assert lost.gap == pytest.approx(-G * 0.2, rel=0.05)
    assert not lost.terms


PARTS = """
<body name="hung" pos="0 0 3"><joint name="up" type="slide" axis="0 0 1"/>
  <geom size="0.1" mass="3"/></body>
<body name="box" pos="3 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
<body name="top" pos="0 3 4"><freejoint/><geom size="0.1" mass="1"/></body>
<body name="load" pos="0 -3 1"><joint name="lift" type="slide" axis="0 0 1"/>
  <geom size="0.1" mass="2"/></body>
<body name="pincer" pos="-3 0 1"><geom size="0.01" contype="0" conaffinity="0"/>
  <body name="one" pos="-0.1 0 0"><joint name="push" type="slide" axis="1 0 0"/>
    <geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
  <body name="other" pos="0.1 0 0"><joint name="stay" type="slide" axis="1 0 0" damping="100"/>
    <geom type="box" size="0.1 0.1 0.1" mass="1"/></body></body>
<body name="rod" pos="-3 3 2"><joint name="socket" type="ball" damping="0.1"/>
  <geom type="capsule" fromto="-0.3 0 0 0.3 0 0" size="0.02" mass="1"/></body>
<body name="stamp" pos="3 3 0.1"><joint name="down" type="slide" axis="0 0 1"/>
  <geom type="box" size="0.1 0.1 0.1" mass="0.5"/></body>
<body name="fixed" pos="3 -3 1"><joint name="held" axis="0 1 0"/>
  <geom size="0.1" pos="0.2 0 0" mass="1"/></body>
"""
OF_PARTS = """
<equality><connect name="left" body1="hung" anchor="0 0.1 0" solref="-100 -20"/>
  <connect name="right" body1="hung" anchor="0 -0.1 0" solref="-100 -20"/>
  <joint name="lock" joint1="held" polycoef="0.3 0 0 0 0"/></equality>
<tendon><fixed name="cord"><joint joint="lift" coef="2"/></fixed></tendon>
<actuator><position name="hold" tendon="cord" kp="200" kv="30"/>
  <motor name="close" joint="push"/><motor name="spin" joint="socket" gear="0 0 1"/>
  <motor name="stamps" joint="down"/></actuator>
"""
EACH = """data.xfrc_applied[2, 0] = 4
    data.ctrl[1:] = 5, 0.01, -100
    data.qvel[12] = 3 if step == 0 else data.qvel[12]"""


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    """Return the analysis of several bodies in one scene, each with a closed-form solution."""
    folder = tmp_path_factory.mktemp("parts")
    script = folder / "script.py"
    model = MODEL.format(world=FLOOR + PARTS, more=OF_PARTS)
    script.write_text(RUN.format(model=model, steps=500, before=EACH))
    return analyze(record_script(str(script), out=folder / "script.rrd").recording)


@pytest.fixture
def parts(analysis: Analysis) -> list[AccountRow]:
    """Return the account's rows for the scene of `analysis`."""
    return [*analysis.account]


def test_each_equality_is_a_term_of_its_own(parts: list[AccountRow]) -> None:
    row = the(parts, "moved", "up")  # the weight that gives way, half of it by each
    names = [str(term.words) for term in row.terms]
    assert {"constraint left", "constraint right"} <= {*names}
    assert value(row, "constraint left") == pytest.approx(value(row, "constraint right"))


def test_what_friction_holds_against_a_push_is_told(parts: list[AccountRow]) -> None:
    row = the(parts, "held", "2_box")
    assert row.asked == pytest.approx(4)
    assert value(row, "friction world") == pytest.approx(-4, rel=1e-3)


def test_what_spins_without_a_torque_has_it_from_the_start(parts: list[AccountRow]) -> None:
    row = the(parts, "turned", "3_top")
    assert row.got == pytest.approx(3 * 500 * 0.002, rel=0.01)
    assert "no force gives it that: its start velocity" in row.told


def test_an_actuator_on_a_tendon_is_told_by_its_length(parts: list[AccountRow]) -> None:
    row = the(parts, "asked", "hold")  # 2 kp (ctrl - length) = m g, as the length is twice the way
    assert row.gap == pytest.approx(-2 * G / 2 / 200, rel=0.01)
    assert "the length of cord 0, got " in row.told
    assert f"force {G:.3g}, with a moment arm of 2 on lift" in row.told


def test_an_actuator_on_sites_is_told_by_length_and_force(tmp_path: Path, told: Told) -> None:
    """A servo between two sites, with gear 2, against a spring: 2 kp (ctrl - 2 x) = k x."""
    world = """<site name="wall"/><body name="sled"><joint name="way" type="slide" axis="1 0 0"
    stiffness="100" damping="50"/><geom size="0.1" mass="1"/><site name="hook"/></body>"""
    more = """<option gravity='0 0 0'/><actuator><position name="pull" site="hook" refsite="wall"
    gear="2 0 0 0 0 0" kp="50"/></actuator>"""
    row = the(told(world, more, "data.ctrl[0] = 0.3", steps=1500), "asked", "pull")
    way_m = 2 * 50 * 0.3 / (100 + 4 * 50)
    assert row.got == pytest.approx(2 * way_m, rel=1e-3)
    assert row.gap == pytest.approx(2 * way_m - 0.3, rel=1e-3)
    (sled,) = analyze(tmp_path / "script.rrd").bodies
    (actuator,) = sled.actuators
    assert actuator.force == pytest.approx(50 * (0.3 - 2 * way_m), rel=1e-3)
    assert actuator.moments == {"way": pytest.approx(2.0, rel=1e-6)}
    assert actuator.length == row.got
    table = "\n".join(block_lines(joint_table(sled.label, sled.joints, sled.actuators)))
    (line,) = [line for line in table.splitlines() if "pull" in line]
    assert line.split()[:6] == ["pull", "position", "0.300", "0.200", "-0.100", "5.0"]
    assert "arm 2 on way" in line


def test_a_contact_of_own_links_is_one_term(parts: list[AccountRow]) -> None:
    of_pincer = [row for row in parts if row.body == "5_pincer"]
    (row,) = [row for row in of_pincer if row.joint == "push"]
    assert row.kind == "given"
    for each in of_pincer:
        names = [str(term.words) for term in each.terms if term.cause == "contact"]
        assert names in ([], ["contact one/other"])
    # The two move as one at 5 N / (100 N s/m): what one loses to the contact, the other gains.
    energy = the(parts, "energy", "5_pincer")
    assert value(energy, "joint damping") == pytest.approx(-value(energy, "actuator"), rel=0.05)
    assert not [term for term in energy.terms if term.cause == "contact"]


def test_a_press_is_told_with_its_force_in_weights(parts: list[AccountRow]) -> None:
    row = the(parts, "press", "world × stamp")
    assert row.got == pytest.approx(100 + 0.5 * G, rel=1e-2)
    assert f"{(100 + 0.5 * G) / (0.5 * G):.3g} times the weight of stamp" in row.told


def test_the_tables_show_what_the_rows_tell(analysis: Analysis, parts: list[AccountRow]) -> None:
    bodies = {body.label: body for body in analysis.bodies}
    row = the(parts, "press", "world × stamp")
    (touch,) = bodies[row.body or ""].touches
    assert [(touch.deepest_m, "m")] == [*row.besides]
    assert touch.deepest_m > 1e-3  # 100 N on a soft contact
    assert f"in {touch.steps:,} steps" in row.told
    assert touch.impulse_n_s is not None  # of the weight and the motor, over 1 s
    assert touch.impulse_n_s[2] == pytest.approx(100 + 0.5 * G, rel=1e-2)
    pushed = the(parts, "moved", "stay")  # 5 N / (100 N s/m) for 1 s: it is farthest at the end
    (joint,) = [each for each in bodies["5_pincer"].joints if each.name == "stay"]
    assert joint.reached == pushed.got == pytest.approx(0.05, rel=0.05)
    assert joint.control == "off"


def test_an_equality_that_locks_a_joint_commands_it(parts: list[AccountRow]) -> None:
    row = the(parts, "asked", "lock")
    assert row.got == pytest.approx(0.3, rel=0.05)  # as it begins, at 0
    moved = the(parts, "moved", "held")
    assert "no motor commands it; a constraint acts on it" in moved.told
    assert value(moved, "constraint lock") == pytest.approx(-value(moved, "gravity"), rel=0.1)


def test_an_axis_of_a_ball_is_that_of_its_link(parts: list[AccountRow]) -> None:
    """A rod along x has its z axis of inertia along x; its motor turns it about the link's z."""
    (row,) = [row for row in parts if row.kind == "given" and "socket" in str(row.joint)]
    assert str(row.joint) in ("socket[z]", "socket[-z]")
    assert row.asked == pytest.approx(0.01)
    assert "gear" not in row.told


BULLET = """
import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
cube = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
floor = p.createMultiBody(0, cube)
box = p.createMultiBody(8, cube, basePosition=[0, 0, 0.2])
{before}
for _ in range(240):
    p.stepSimulation()
    {each}
"""


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("before", "words"),
    [
        ("", f"all together {8 * G:.3g} N"),
        ("p.setCollisionFilterPair(floor, box, -1, -1, 0)", "script.py:8 filters it"),
    ],
)
def test_what_is_read_of_contacts_stands_beside_what_presses(
    tmp_path: Path, before: str, words: str
) -> None:
    script = tmp_path / "script.py"
    script.write_text(BULLET.format(before=before, each="p.getClosestPoints(floor, box, 1)"))
    if not before:
        text = script.read_text().replace(
            "ClosestPoints(floor, box, 1)", "ContactPoints(floor, box)"
        )
        script.write_text(text)
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    row = next(row for row in analyze(recorded.recording).account if row.kind == "reads")
    assert words in row.told
    if not before:
        assert row.got == pytest.approx(8 * G, rel=1e-3)
        assert f"contacts press with {8 * G:.3g} N in the median" in row.told


@pytest.mark.pybullet
def test_damping_that_the_engine_does_not_read_is_told(tmp_path: Path) -> None:
    (tmp_path / "swing.xml").write_text(
        """<mujoco><worldbody><body name="pole" pos="0 0 1">
        <joint name="hinge" type="hinge" axis="0 1 0" damping="1"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02"/></body></worldbody></mujoco>"""
    )
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            f"""
            import pybullet as p
            p.connect(p.DIRECT)
            p.setGravity(0, 0, -9.81)
            (swing,) = p.loadMJCF({str(tmp_path / "swing.xml")!r})
            for j in range(p.getNumJoints(swing)):
                p.setJointMotorControl2(swing, j, p.VELOCITY_CONTROL, force=0)
            for _ in range(100):
                p.stepSimulation()
            """
        )
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    row = the([*analyze(recorded.recording).account], "moved", "hinge")
    assert "its file gives it a damping of 1, the engine has 0" in row.told


@pytest.mark.pybullet
def test_each_constraint_is_named_by_what_it_holds_to(tmp_path: Path) -> None:
    """Double pendulum: the world constraint does little work, the neighbour's swings the body."""
    before = (
        "p.resetBasePositionAndOrientation(box, [0.3, 0, 1], [0, 0, 0, 1])\n"
        "more = p.createMultiBody(2, cube, basePosition=[0.9, 0, 1])\n"
        "hold = [box, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [-0.3, 0, 0], [0, 0, 1]]\n"
        "p.createConstraint(*hold)\n"
        "p.createConstraint(box, -1, more, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0.3, 0, 0],"
        " [-0.3, 0, 0])"
    )
    script = tmp_path / "script.py"
    script.write_text(BULLET.format(before=before, each="pass"))
    rows = [*analyze(record_script(str(script), out=tmp_path / "script.rrd").recording).account]
    energy = the(rows, "energy", "1_box")
    named = {str(term.words): term for term in energy.terms if term.cause == "constraints"}
    assert {"constraint to 2_box", "constraint to world"} >= named.keys()
    turned = next(row for row in rows if row.kind in ("turned", "moved") and row.body == "1_box")
    named |= {str(term.words): term for term in turned.terms if term.cause == "constraints"}
    assert "constraint to 2_box" in named
    assert named["constraint to 2_box"].body == "2_box"


@pytest.mark.pybullet
def test_inverse_dynamics_stands_beside_the_gravity_that_it_is_to_balance(tmp_path: Path) -> None:
    """Inverse dynamics takes gravity in base axes; here the base is rotated by a right angle."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import math
            import pybullet as p
            p.connect(p.DIRECT)
            p.setGravity(0, 0, -9.81)
            turned = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
            pole = p.createMultiBody(0, baseOrientation=turned, linkMasses=[2],
                linkCollisionShapeIndices=[-1], linkVisualShapeIndices=[-1],
                linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
                linkInertialFramePositions=[[0.5, 0, 0]],
                linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
                linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
            p.setJointMotorControl2(pole, 0, p.VELOCITY_CONTROL, force=0)
            for _ in range(10):
                q, v, *_ = p.getJointState(pole, 0)
                p.calculateInverseDynamics(pole, [q], [v], [0.0])
                p.stepSimulation()
            """
        )
    )
    rows = [*analyze(record_script(str(script), out=tmp_path / "script.rrd").recording).account]
    (row,) = [row for row in rows if row.kind == "reads"]
    # Its axis is level in the world, along gravity in the base: m g l against 0.
    assert "0 N m for " in row.told
    assert f"gravity acts on it with {-2 * G * 0.5:.3g} N m" in row.told


# -- rows that were false once --------------------------------------------------------------------


def test_a_servo_that_stands_where_it_was_sent_is_not_idle(told: Told) -> None:
    more = "<option gravity='0 0 0'/><actuator><position joint='up' kp='50'/></actuator>"
    sent = "data.ctrl[0] = data.qpos[0] = 0.2"
    assert not [r for r in told(SLIDE.format(damping=1), more, sent, 50) if r.kind == "idle"]


def test_an_idle_control_keeps_its_sign(told: Told) -> None:
    more = """<option><flag actuation='disable'/></option>
    <actuator><motor name='m' joint='up'/></actuator>"""
    row = the(told(SLIDE.format(damping=1), more, "data.ctrl[0] = -1", 50), "idle", "m")
    assert row.asked == -1


def test_what_is_thrown_is_not_said_to_fall_by_nothing(told: Told) -> None:
    ball = """<body name="ball" pos="0 0 1"><freejoint/><geom size="0.1" mass="2"/></body>"""
    row = next(
        r
        for r in told(ball, before="data.qvel[0] = 9 if step == 0 else data.qvel[0]", steps=100)
        if r.kind == "moved"
    )
    assert row.told.startswith("x +1.8 m (and z -0.19")
    assert row.told.endswith("no force gives it that: its start velocity")


def test_no_torque_is_told_of_steps_without_a_sum(told: Told) -> None:
    """A step that resets itself has no sum: its initial torque is not reported as 0 N m."""
    world = """<body><joint name="j" axis="0 0 1" damping="-1000"/><geom size="0.1" mass="1"
    pos="0.1 0 0"/></body>"""
    more = "<option integrator='RK4'/><actuator><motor joint='j'/></actuator>"
    for row in told(world, more, "data.ctrl[0] = 1", 20):
        assert " 0 N m" not in row.told


@pytest.mark.pybullet
def test_a_filter_that_lets_a_box_fall_through_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        BULLET.format(before="p.setCollisionFilterGroupMask(box, -1, 0, 0)", each="pass").replace(
            "[0, 0, 0.2]", "[0, 0, 0.3]"
        )
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    (row,) = [row for row in analyze(recorded.recording).account if row.kind == "idle"]
    assert "script.py:8 filters their contacts" in row.told


def test_what_a_table_turns_is_not_said_to_lack_friction(told: Told) -> None:
    """A box riding on a turntable rotates at its rate; no contact friction brakes that rotation."""
    world = """<body name="table" pos="0 0 0.1"><joint name="spin" axis="0 0 1" damping="0.1"/>
    <geom type="cylinder" size="0.5 0.02" mass="5"/></body>
    <body name="box" pos="0.1 0 0.17"><freejoint/>
    <geom type="box" size="0.05 0.05 0.05" mass="1"/></body>"""
    more = "<actuator><velocity joint='spin' kv='50'/></actuator>"
    rows = told(world, more, "data.ctrl[0] = 2", 900)
    assert the(rows, "turned", "1_box").got == pytest.approx(2 * 900 * 0.002, rel=0.1)
    assert not [row for row in rows if row.kind == "idle"]


def test_a_pole_is_given_its_energy_by_the_cart_that_accelerates(told: Told) -> None:
    """Without gravity, only the inertia that couples it to the cart can turn the pole."""
    world = """<body name="cart"><joint name="slide" type="slide" axis="1 0 0"/>
    <geom type="box" size="0.1 0.1 0.1" mass="2"/><body name="pole"><joint name="pin"
    axis="0 1 0" damping="0.01"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.5" mass="1"
    contype="0" conaffinity="0"/></body></body>"""
    more = "<option gravity='0 0 0'/><actuator><motor joint='slide'/></actuator>"
    row = the(told(world, more, "data.ctrl[0] = 20", 100), "moved", "pin")
    assert row.towards[0].cause == "drag"
    assert row.towards[0].value > 10 * sum(abs(term.value) for term in row.terms[1:])


def test_a_joint_that_a_script_pushes_is_not_said_to_be_left_alone(told: Told) -> None:
    row = the(told(SLIDE.format(damping=1), before="data.qfrc_applied[0] = 30"), "moved", "up")
    assert "no motor commands it; the script pushes it" in row.told


def test_the_account_begins_with_what_is_asked_about(told: Told, tmp_path: Path) -> None:
    sags = """<body pos="{x} 0 1"><joint name="{name}" type="slide" axis="0 0 1" damping="5"/>
    <geom type="sphere" size="0.1" mass="{mass}"/></body>"""
    world = sags.format(x=0, name="one", mass=1) + sags.format(x=1, name="other", mass=3)
    more = "<actuator><position joint='one' kp='90'/><position joint='other' kp='90'/></actuator>"
    assert next(row.joint for row in told(world, more) if row.joint) == "other"
    recording = tmp_path / "script.rrd"
    analysis = analyze(recording, about="one")
    assert analysis.account[0].joint == "one"
    shown = str(markdown_of(analysis.report(most_rows=1)))
    assert "one  " in shown
    assert "other" not in shown
    assert f"--account {len(analysis.account)}" in shown
    assert f"· `--at {analysis.account[0].time_s:g}`" in shown
    assert f".view(at_s={analysis.account[0].time_s:g})" in analysis._repr_html_()
    moments = [line for _, _, line in events(analysis)]
    assert any("asked: one" in line for line in moments)
    with pytest.raises(ScenarioError, match=r"such as .*one"):
        analyze(recording, about="nobody")


ROW = AccountRow(
    kind="asked",
    body="0_arm",
    joint="elbow",
    told="1.4 rad, got 1.2 rad",
    got=1.2,
    gap=-0.2,
    unit="rad",
    salience=1.0,
)
FINDING = Finding(
    code="off-target",
    level="asked",
    message="elbow rests 0.2 rad off",
    body="0_arm",
    joint="elbow",
    effect=Effect(0.2, "rad"),
)


@pytest.mark.parametrize(
    ("finding", "cites"),
    [
        (FINDING, True),
        (replace(FINDING, effect=Effect(0.13, "rad")), True),  # in the mean, not at the worst
        (replace(FINDING, effect=Effect(0.01, "rad")), False),  # of another moment
        (replace(FINDING, effect=Effect(1.2, "rad")), False),  # where it stands
        (replace(FINDING, effect=Effect(0.2, "m")), False),  # how far the hand is off
        (replace(FINDING, effect=Effect(1.13, "1")), False),  # an inertia
        (replace(FINDING, joint="wrist"), False),
        (replace(FINDING, body="1_arm"), False),
    ],
    ids=["same", "mean", "moment", "stands", "hand", "inertia", "joint", "body"],
)
def test_a_finding_takes_the_place_of_the_row_that_tells_the_same(
    finding: Finding, cites: bool
) -> None:
    (cited,) = citing([finding], [ROW])
    assert (cited.row is ROW) is cites
    assert rows_beside([ROW], [cited]) == ([] if cites else [ROW])


def test_a_finding_about_two_bodies_takes_the_place_of_their_row() -> None:
    row = AccountRow(
        kind="press",
        body="1_box",
        other="0_finger",
        pair=("pad", "box"),
        told="25 N in the median",
        got=25.0,
        unit="N",
        besides=((0.00448, "m"),),
    )
    finding = replace(
        FINDING, body="0_finger", other="1_box", joint=None, effect=Effect(0.0035, "m")
    )
    (cited,) = citing([finding], [ROW, row])
    assert [str(each) for each in beneath(cited)] == ["pad × box: 25 N in the median"]
    (cited,) = citing([replace(finding, other="0_plane")], [ROW, row])
    assert cited.row is None


@pytest.mark.pybullet
def test_a_torque_is_told_as_given_beside_the_motor_that_holds_the_joint(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import pybullet as p
            p.connect(p.DIRECT)
            ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
            arm = p.createMultiBody(
                0, -1, -1, [0, 0, 1], [0, 0, 0, 1], linkMasses=[1],
                linkCollisionShapeIndices=[ball], linkVisualShapeIndices=[-1],
                linkPositions=[[0, 0, 0]],
                linkOrientations=[[0, 0, 0, 1]], linkInertialFramePositions=[[0.3, 0, 0]],
                linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
                linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 0, 1]])
            for _ in range(60):
                p.setJointMotorControl2(arm, 0, p.TORQUE_CONTROL, force=0.5)
                p.stepSimulation()
            """
        )
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    (row,) = [row for row in analyze(recorded.recording).account if row.kind == "given"]
    assert row.asked == pytest.approx(0.5, rel=1e-9)
    assert row.got == pytest.approx(0, abs=1e-6)  # its velocity motor takes all
    assert value(row, "motor") == pytest.approx(-0.5, rel=1e-3)


@pytest.mark.pybullet
def test_a_push_that_no_soft_body_takes_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import pybullet as p, pybullet_data
            p.connect(p.DIRECT)
            p.setAdditionalSearchPath(pybullet_data.getDataPath())
            p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD)
            soft = p.loadSoftBody(
                "cube.obj", basePosition=[0, 0, 2], scale=1, mass=1, useMassSpring=1)
            for force in (3, 4, 2):
                p.applyExternalForce(soft, -1, [0, 0, force], [0, 0, 0], p.LINK_FRAME)
                p.stepSimulation()
            """
        )
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    (row,) = [row for row in analyze(recorded.recording).account if row.kind == "idle"]
    assert (row.asked, row.got) == (4.0, 0.0)
    assert "up to 4 N in 3 calls" in row.told


@pytest.mark.pybullet
def test_what_a_file_says_that_a_joint_follows_is_told(tmp_path: Path) -> None:
    body = """<link name="{name}"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"""
    joint = """<joint name="{name}" type="prismatic"><parent link="palm"/><child link="{name}"/>
    <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="9" velocity="9"/>{more}</joint>"""
    mimic = '<mimic joint="left" multiplier="2"/>'
    parts = [body.format(name=name) for name in ("palm", "left", "right")]
    parts += [joint.format(name="left", more=""), joint.format(name="right", more=mimic)]
    (tmp_path / "hand.urdf").write_text(f'<robot name="hand">{"".join(parts)}</robot>')
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import pybullet as p
            p.connect(p.DIRECT)
            p.setGravity(0, 0, -9.81)
            hand = p.loadURDF(HAND, useFixedBase=True)
            p.setJointMotorControlArray(hand, [0, 1], p.VELOCITY_CONTROL, forces=[0, 0])
            for _ in range(60):
                p.stepSimulation()
            """
        ).replace("HAND", repr(str(tmp_path / "hand.urdf")))
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    rows = [row for row in analyze(recorded.recording, about="right").account if row.joint]
    assert rows[0].kind == "moved"
    assert "its file says that it follows 2 × left" in rows[0].told


def test_a_bounce_that_is_shorter_than_a_bin_gives_what_it_gives(told: Told) -> None:
    """In a long run a bin holds several steps; the work is still computed for each step."""
    world = """<geom type="box" size="0.1 1 1" pos="0.6 0 0" solref="-2e5 -10"/>
    <body name="ball"><freejoint/><geom size="0.1" mass="2" solref="-2e5 -10"/></body>"""
    more = "<option gravity='0 0 0'/>"
    rows = told(world, more, "data.qvel[0] = 2 if step == 0 else data.qvel[0]", 2100)
    moved, energy = the(rows, "moved", "1_ball"), the(rows, "energy", "1_ball")
    given_j = sum(term.value for term in moved.terms if term.cause == "contact")
    assert given_j == pytest.approx(energy.gap, rel=1e-3)


def test_a_fall_along_a_slanted_gravity_is_told_once(told: Told) -> None:
    """No axis is vertical there, so the displacement is not split into along and across gravity."""
    ball = """<body name="ball"><freejoint/><geom size="0.1" mass="2"/></body>"""
    rows = told(ball, "<option gravity='3 0 -9'/>", steps=250)
    (row,) = [row for row in rows if row.kind == "moved"]
    assert row.told.startswith("x +0.377 m, z -1.13 m by 0.5 s; it falls")
    assert value(row, "gravity") == pytest.approx(0.5 * 2 * (0.5**2 * (3**2 + 9**2)), rel=1e-6)


def test_a_torque_that_begins_small_is_told_with_its_most(told: Told) -> None:
    """A controller that starts on target needs torque only at the end; the largest is reported."""
    more = "<actuator><motor name='m' joint='up'/></actuator>"
    before = "data.ctrl[0] = 0 if step < 60 else 0.01 if step < 90 else 5.0"
    row = the(told(SLIDE.format(damping=1), more, before, 64), "given", "up")
    assert "moved -79.9 mm; from 0.122 s on +0.01 N as the mean of 3 steps" in row.told
    assert value(row, "gravity") == pytest.approx(-2 * G, rel=1e-6)
    late = the(told(SLIDE.format(damping=1), more, before, 400), "given", "up")
    assert late.told.endswith("at most 5 N")


def test_the_spin_at_the_end_is_that_of_the_last_state(told: Told) -> None:
    """A sphere with damping d and inertia 2mr²/5 slows down as exp(-dt/I), in implicit steps."""
    world = """<body name="ball"><freejoint/><geom size="0.1" mass="1"/></body>"""
    more = "<option gravity='0 0 0'/>"
    before = "data.qvel[5] = 40.0 * 0.99**step"
    (row,) = [row for row in told(world, more, before) if row.kind == "turned"]
    assert f"still {40 * 0.99**499:.3g} rad/s at the end" in row.told


def test_turns_are_counted_by_the_states_of_all_steps(told: Told) -> None:
    """An orientation tells no more than half a turn, and most steps need no explanation."""
    world = """<body name="ball"><freejoint/><geom size="0.1" mass="1"/></body>"""
    before = "data.qvel[5] = 5.0 if step < 1500 else -5.0"
    (row,) = [
        row
        for row in told(world, "<option gravity='0 0 0'/>", before, 1600)
        if row.kind == "turned"
    ]
    assert f"{math.degrees(5 * 1500 * 0.002):.3g}°, mostly about z, by 3 s" in row.told


def test_a_rate_is_told_as_the_mean_of_the_steps_that_it_names(told: Told) -> None:
    """A wheel starts with 1 rad/s; a servo of the gain k turns it to 2 rad/s as exp(-kt/I)."""
    world = """<body name="wheel"><joint name="axle" axis="0 1 0"/>
    <geom type="cylinder" size="0.1 0.02" mass="10"/></body>"""
    more = "<actuator><velocity joint='axle' kv='0.5'/></actuator>"
    (row,) = [
        row for row in told(world, more, "data.ctrl[0] = 2", 1000) if "rad/s, got" in row.told
    ]
    first_s, last_s = (float(each) for each in re.findall(r"([0-9.]+) s", row.told)[:2])
    inertia = 10 * (0.1**2 / 4 + 0.04**2 / 12)
    lag = inertia / 0.5
    times_s = np.arange(first_s, last_s + 1e-9, 0.002)
    assert row.got == pytest.approx(2 - 2 * np.exp(-times_s / lag).mean(), rel=0.05)


def test_forces_are_no_multiple_of_a_weight_that_does_not_act(told: Told) -> None:
    world = """<geom type="plane" size="1 1 0.1"/>
    <body name="ball" pos="0 0 0.099"><freejoint/><geom size="0.1" mass="1"/></body>"""
    before = "data.xfrc_applied[1, 2] = -100"
    (row,) = [
        row for row in told(world, "<option gravity='0 0 0'/>", before) if row.kind == "press"
    ]
    assert "10.2 times what ball would weigh on Earth" in row.told
    (row,) = [row for row in told(world, before=before) if row.kind == "press"]
    assert "11.2 times the weight of ball" in row.told


def test_a_weight_is_that_of_the_body_that_is_named(told: Told) -> None:
    """The first link of an arm has the arm's name, and weighs a third of it."""
    world = """<body name="arm" pos="0 0 1"><joint axis="0 0 1"/><geom size="0.05" mass="1"/>
    <body pos="0.2 0 0"><joint name="way" type="slide" axis="1 0 0"/>
    <geom size="0.05" mass="2"/></body></body>
    <geom type="box" pos="0.3 0 1" size="0.05 0.2 0.2"/>"""
    more = "<actuator><motor joint='way'/></actuator>"
    (row,) = [row for row in told(world, more, "data.ctrl[0] = 900") if row.kind == "press"]
    assert row.got is not None
    assert f"{row.got / (3 * G):.3g} times the weight of all that moves of 1_arm" in row.told


def test_a_stack_is_told_with_the_weight_that_it_carries(told: Told) -> None:
    box = "<body name='b{}' pos='0 0 {}'><freejoint/><geom type='box' size='.2 .2 .05' mass='1'/>"
    boxes = "".join(box.format(k, 0.05 + 0.1 * k) + "</body>" for k in range(10))
    rows = told("<geom type='plane' size='1 1 .1'/>" + boxes)
    row = the(rows, "press", "world × b0")
    assert f"10 times the weight of b0 (all free bodies weigh {10 * G:.3g} N)" in row.told


def test_rows_whose_causes_act_on_opposite_sides_are_not_merged() -> None:
    push, brake = (
        RowTerm(cause=cause, words=cause, value=value, unit="N", towards=value > 0)
        for cause, value in (("contact", 5.0), ("friction", -4.0))
    )
    held = [
        AccountRow(kind="held", body=name, told="held", terms=terms, salience=1.0, group="alike")
        for name, terms in (
            ("a", (push, brake)),
            ("b", (replace(push, value=-5.0, towards=False), brake)),
            ("c", (brake,)),
        )
    ]
    assert [(row.body, row.alike) for row in ranked(held, ())] == [("a", 1), ("b", 0)]


def test_rounding_is_no_term(told: Told) -> None:
    """A cylinder that spins about an axis of its own needs no gyroscopic force."""
    world = """<body><freejoint name="free"/>
    <geom type="cylinder" size="0.2 0.05" mass="3"/></body>"""
    more = "<option gravity='0 0 0' integrator='RK4'/>"
    before = "if step == 0: data.qpos[3:7], data.qvel[4] = [0.8, 0.6, 0, 0], 2"
    row = the(told(world, more, before), "turned", "0_body1")
    assert not row.terms
    assert "its start velocity" in row.told


def test_bodies_that_move_opposite_ways_are_rows_of_their_own(told: Told) -> None:
    """A ball takes the motion of an equal one, which stops: nothing is alike but their kind."""
    ball = "<body name='{}' pos='{} 0 0'><freejoint/><geom size='0.1' mass='1'/></body>"
    world = ball.format("left", 0) + ball.format("right", 0.5)
    before = "data.qvel[0], data.qvel[6] = (1.0, -1.0) if step == 0 else data.qvel[[0, 6]]"
    rows = told(world, "<option gravity='0 0 0'/>", before, 100)
    moved = [row for row in rows if row.kind == "moved"]
    assert {row.told[:3] for row in moved} == {"x +", "x -"}
    assert not any(row.alike for row in moved)


@pytest.mark.pybullet
def test_a_plane_that_is_seen_lies_where_it_is_drawn(tmp_path: Path) -> None:
    """PyBullet gives a visual plane the scale 1, 1, 1 as its size, which is not its normal."""
    script = tmp_path / "script.py"
    floor = "p.loadURDF(pybullet_data.getDataPath() + '/plane.urdf')"
    script.write_text(
        BULLET.format(before="pass", each="pass")
        .replace("import pybullet as p", "import pybullet as p, pybullet_data")
        .replace("p.createMultiBody(0, cube)", floor)
        .replace("[0, 0, 0.2]", "[-3, -3, 8]")
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    assert not [row for row in analyze(recorded.recording).account if row.kind == "idle"]


@pytest.mark.pybullet
def test_a_motor_without_force_is_told_as_off(tmp_path: Path) -> None:
    """Not as a joint that nothing commands: a call for its motor gave it a force of 0."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
            import pybullet as p, pybullet_data
            p.connect(p.DIRECT)
            p.setAdditionalSearchPath(pybullet_data.getDataPath())
            p.setGravity(0, 0, -9.81)
            arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
            for joint in range(7):
                p.resetJointState(arm, joint, 0.5)
                p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, 0.5, force=0)
            for _ in range(120):
                p.stepSimulation()
        """)
    )
    recorded = record_script(str(script), out=tmp_path / "script.rrd")
    moved = [row for row in analyze(recorded.recording).account if row.kind == "moved"]
    assert moved
    assert all("its motor is off: the force that a call gives it is 0" in row.told for row in moved)


@pytest.mark.parametrize(
    ("quat", "turned"),
    [("0 0 1 1", "180° about (0, 0.707, 0.707)"), ("0.9 0 0 -1.2", "106° about -z")],
)
def test_a_body_that_starts_turned_says_by_how_much(told: Told, quat: str, turned: str) -> None:
    """An orientation with another order of components, or in degrees, is read off where it acts."""
    box = "<body pos='0 0 9'><freejoint/><geom type='box' size='.1 .03 .2' quat='0 1 1 0'/></body>"
    fell = the(told(box.replace("9'>", f"9' quat='{quat}'>"), steps=50), "moved", "0_body1")
    assert f"it starts turned by {turned}" in fell.told
    assert "starts turned" not in the(told(box, steps=50), "moved", "0_body1").told


def test_a_joint_that_starts_beyond_its_range_says_so(told: Told) -> None:
    hinge = (
        "<body><joint name='hinge' axis='0 0 1' range='-90 90' limited='true'/>"
        "<geom type='box' size='.4 .02 .9'/></body>"
    )
    rows = told(hinge, before="if step == 0: data.qpos[0] = 45", steps=100)
    assert "it starts beyond its range of -1.57 rad to 1.57 rad" in the(rows, "moved", "hinge").told
    rows = told(hinge, before="if step == 0: data.qpos[0], data.qvel[0] = 1.5, -1", steps=100)
    assert "beyond" not in the(rows, "moved", "hinge").told


@pytest.mark.parametrize(("inertia", "is_told"), [(10, True), (0.02, False)])
def test_an_inertia_that_no_mass_in_the_shape_has_is_told(
    told: Told, *, inertia: float, is_told: bool
) -> None:
    """The corners of a box of 0.2 m are 0.173 m from its centre: 1 kg has 0.03 kg m² there."""
    its = f"<inertial pos='0 0 0' mass='1' diaginertia='{inertia} {inertia} {inertia}'/>"
    box = f"<body><freejoint/>{its}<geom type='box' size='.1 .1 .1'/></body>"
    row = the(told(box, steps=50), "moved", "0_body1")
    assert ("moment of inertia is 10 kg m²" in row.told) == is_told
    assert ("at most 0.03 kg m²" in row.told) == is_told


@pytest.mark.parametrize(("axis", "is_told"), [("0 -1 0", True), ("0 1 0", False)])
def test_wheels_that_turn_opposite_ways_are_told_with_the_turn(
    told: Told, *, axis: str, is_told: bool
) -> None:
    wheel = (
        "<body pos='0 {y} 0'><joint name='{name}' axis='{axis}'/>"
        "<geom type='cylinder' size='.1 .02' euler='90 0 0' mass='1'/></body>"
    )
    wheels = wheel.format(y=0.2, name="left", axis="0 1 0")
    wheels += wheel.format(y=-0.2, name="right", axis=axis)
    body = f"<body><freejoint/><geom type='box' size='.1 .1 .03' mass='1'/>{wheels}</body>"
    motors = "".join(f"<velocity joint='{name}' kv='.5'/>" for name in ("left", "right"))
    more = f"<option gravity='0 0 0'/><actuator>{motors}</actuator>"
    row = the(told(body, more, "data.ctrl[:] = 5, 4"), "turned", "0_body1")
    words = "left is commanded to turn with 5 rad/s about y, right with 4 rad/s about -y"
    assert (words in row.told) == is_told
    assert ("is commanded" in row.told) == is_told


def test_a_slide_tells_whose_friction_counts_and_comes_before_the_energy(told: Told) -> None:
    """The contact has the greater coefficient; the energy has no other cause than the slide."""
    floor = "<geom type='plane' size='9 9 .1' friction='.02'/>"
    sled = "<body pos='0 0 .05'><freejoint/><geom type='box' size='.3 .1 .05'/></body>"
    rows = told(floor + sled, before="if step == 0: data.qvel[0] = 3", steps=900)
    slips = next(row for row in rows if row.kind == "slips")
    assert "coefficient 1 as the greater of 0.02 and 1" in slips.told
    kinds = [row.kind for row in rows]
    assert kinds.index("slips") < kinds.index("energy")


def test_a_slide_tells_that_its_links_part_between(told: Told) -> None:
    """What hops along slides only in the steps in which it presses."""
    floor = "<geom type='plane' size='9 9 .1'/>"
    ball = (
        "<body pos='0 0 .5'><freejoint/><geom type='box' size='.1 .1 .1' friction='.1'"
        " solref='-9000 -1' priority='1'/></body>"
    )
    rows = told(floor + ball, before="if step == 0: data.qvel[0] = 3", steps=900)
    slips = next(row for row in rows if row.kind == "slips")
    pressed, spell = map(int, re.findall(r"in (\d+) steps, those of (\d+) in", slips.told)[0])
    assert 0 < pressed < 0.8 * spell <= 0.8 * 900


@pytest.mark.pybullet
def test_what_stands_still_is_told_with_what_holds_it(tmp_path: Path) -> None:
    """A default motor that holds a pole, a hinge along the pull of gravity, and a mass of 0."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import pybullet as p, pybullet_data

            p.connect(p.DIRECT)
            p.setAdditionalSearchPath(pybullet_data.getDataPath())
            p.setGravity(0, 0, -10)
            cart = p.loadURDF("cartpole.urdf", useFixedBase=True)
            p.setJointMotorControl2(cart, 0, p.VELOCITY_CONTROL, force=0)
            p.resetJointState(cart, 1, 0.1)
            box = p.loadURDF("cube_small.urdf", [3, 0, 1])
            p.changeDynamics(box, -1, mass=0)
            for step in range(100):
                p.stepSimulation()
            """
        )
    )
    rows = [*analyze(record_script(str(script), out=tmp_path / "script.rrd").recording).account]
    stay = {row.joint: row for row in rows if row.kind == "held" and "stays at" in row.told}
    pole, cart = stay["cart_to_pole"], stay["slider_to_cart"]
    assert "stays at 0.1 rad: no call commands it" in pole.told
    assert value(pole, "motor") == pytest.approx(-value(pole, "gravity"), rel=1e-6)
    assert "its motor is off, and no force acts along it, gravity included" in cart.told
    assert "its mass is 0 since script.py:11" in the(rows, "idle", "1_cube_small").told


LOOSE = """
import pybullet as p

p.connect(p.DIRECT)
p.setGravity(0, 0, -10)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))


def chain(joints, place, mass, positions, axis):
    n = len(joints)
    return p.createMultiBody(
        mass, box, basePosition=place, linkMasses=[1] * n, linkCollisionShapeIndices=[box] * n,
        linkVisualShapeIndices=[-1] * n, linkPositions=positions,
        linkOrientations=[[0, 0, 0, 1]] * n, linkInertialFramePositions=[[0, 0, 0]] * n,
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * n,
        linkParentIndices=[*range(n)], linkJointTypes=joints, linkJointAxis=[axis] * n)


# The foot is a link, and the rug has no link but its base.
table = chain([p.JOINT_FIXED], [0, 0, 0.3], 1, [[0, 0, -0.2]], [0, 0, 1])
rug = p.createMultiBody(1, box, basePosition=[3, 0, 0.1])
for body in (table, rug):
    p.changeDynamics(body, -1, restitution=0.25)
swing = chain([p.JOINT_REVOLUTE] * 3, [9, 0, 5], 0, [[0, 0, -0.3]] * 3, [0, 1, 0])
for joint in (0, 2):
    p.setJointMotorControl2(swing, joint, p.VELOCITY_CONTROL, force=0)
p.resetJointState(swing, 0, 1)
turret = chain([p.JOINT_REVOLUTE] * 2, [-9, 0, 5], 0, [[0, 0, 0.3]] * 2, [0, 0, 1])
p.setJointMotorControlArray(
    turret, [0, 1], p.VELOCITY_CONTROL, targetPositions=[0.5, 0], targetVelocities=[0, 0])
for step in range(100):
    p.stepSimulation()
    if step == 49:
        p.resetBasePositionAndOrientation(rug, [3, 2, 1.1], [0, 0, 0, 1])
        p.resetBaseVelocity(rug, [5, 0, 0])
hit = p.rayTest([-12.1, 0, 5.3], [-2.1, 0, 5.3])[0]
print(p.getDynamicsInfo(table, -1)[0], p.getJointState(turret, 0)[2])
"""


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> list[AccountRow]:
    """Return the account of a script whose settings reach other links and joints than meant."""
    folder = tmp_path_factory.mktemp("loose")
    script = folder / "script.py"
    script.write_text(LOOSE)
    return [*analyze(record_script(str(script), out=folder / "script.rrd").recording).account]


@pytest.mark.pybullet
def test_a_setting_of_a_link_that_touches_nothing_is_told(loose: list[AccountRow]) -> None:
    (row,) = [row for row in loose if row.kind == "idle" and "restitution" in row.told]
    assert (row.body, row.asked) == ("1_box", 0.25)
    assert "sets restitution=0.25 for the base, which touches nothing; what touches is" in row.told


@pytest.mark.pybullet
def test_a_joint_whose_motor_alone_is_left_on_is_told(loose: list[AccountRow]) -> None:
    (row,) = [row for row in loose if "calls switch off the motors of 2 others" in row.told]
    assert (row.body, row.joint) == ("3_box", "joint2")
    assert row.salience > 0.5


@pytest.mark.pybullet
def test_a_position_that_a_command_of_a_rate_ignores_is_told(loose: list[AccountRow]) -> None:
    """The second joint is sent to 0, which is where it is."""
    (row,) = [row for row in loose if row.kind == "asked"]
    assert (row.body, row.joint, row.asked, row.alike) == ("4_box", "joint1", 0.5, 0)
    assert "script.py:30 commands a rate, 0 rad/s, and ignores the position" in row.told


@pytest.mark.pybullet
def test_what_is_read_of_rays_masses_and_sensors_is_told(loose: list[AccountRow]) -> None:
    """The turret's two links of 1 kg hang on the joint that has no sensor."""
    reads = [row.told for row in loose if row.kind == "reads"]
    ray, mass, reaction = (
        next(told for told in reads if word in told) for word in ("a ray: ", "kg", "sensor")
    )
    assert "it ends at 0.3 of its length in the last reading, at -9.1, 0, 5.3" in ray
    assert "its base has 1 kg, and with its links, which are not read, it has 2 kg" in mass
    assert "read as 0, as no sensor of it is on; it transmits 20 N" in reaction


@pytest.mark.pybullet
def test_what_a_script_and_what_steps_move_is_told_apart(loose: list[AccountRow]) -> None:
    """The rug is put 2 m aside, and flies 50 steps of 1/240 s at 5 m/s."""
    (row,) = [row for row in loose if row.kind == "moved" and row.body == "2_box"]
    assert re.match(r"x \+1.0\d m, y \+2 m .*; the script wrote its state, ", row.told)
    assert re.search(r"steps move it by x \+1.0\d m(;|$)", row.told)


def test_a_reset_by_the_engine_is_told_with_what_acted_before(told: Told) -> None:
    """A servo in degrees: 200 N m/rad times 30 rad."""
    arm = (
        "<body><joint name='hinge' axis='0 1 0'/>"
        "<geom type='capsule' fromto='0 0 0 .3 0 0' size='.03' mass='.5'/>"
        "<body pos='.3 0 0'><joint name='elbow' axis='0 1 0'/>"
        "<geom type='capsule' fromto='0 0 0 .3 0 0' size='.03' mass='.5'/></body></body>"
    )
    servos = "".join(f"<position name='{k}' joint='{k}' kp='200'/>" for k in ("hinge", "elbow"))
    more = f"<option integrator='Euler'/><actuator>{servos}</actuator>"
    before = "if step == 0: data.ctrl[:] = 30, 60"
    (row,) = [row for row in told(arm, more, before) if "the engine resets" in row.told]
    assert row.terms[0].cause == f"actuator {row.joint}"
    assert abs(row.terms[0].value) > 0.5 * 200 * 30
    # The three steps before the reset, over which the force is averaged, are told.
    assert row.time_s is not None
    ends_s = [float(each) for each in re.findall(r"([0-9.]+) s", row.mean)]
    assert ends_s == pytest.approx([row.time_s - 0.006, row.time_s - 0.002], abs=2e-4)


def test_a_joint_that_follows_another_is_told_with_the_factor(told: Told) -> None:
    finger = (
        "<body pos='{x} 0 0'><joint name='{name}' type='slide' axis='1 0 0' damping='5'/>"
        "<geom size='.02' mass='.1'/></body>"
    )
    both = finger.format(x=0, name="left") + finger.format(x=1, name="right")
    more = (
        "<equality><joint name='pair' joint1='right' joint2='left' polycoef='0.01 1 0 0 0'/>"
        "</equality><actuator><position joint='left' kp='100'/></actuator>"
    )
    row = the(told(both, more, "data.ctrl[0] = 0.05"), "moved", "right")
    assert "a constraint acts on it; pair makes it follow 1 × left + 0.01" in row.told


def test_what_falls_past_everything_is_told_with_its_height_and_size(told: Told) -> None:
    peg = "<body pos='0 0 {z}'><freejoint/><geom type='box' size='{r} {r} {r}'/></body>"
    floor = "<geom type='plane' size='9 9 .1'/>"
    row = the(told(floor + peg.format(z=20, r=0.1)), "moved", "1_body1")
    assert "it falls from a height of 20 m and touches nothing" in row.told
    assert " long and has" not in row.told
    row = the(told(floor + peg.format(z=60, r=20)), "moved", "1_body1")
    assert "it is 40 m long and has 6.4e+07 kg" in row.told
    assert (
        "touches nothing"
        not in the(told(floor + peg.format(z=0.9, r=0.1)), "moved", "1_body1").told
    )


@pytest.mark.pybullet
def test_a_pose_that_is_set_stops_what_moves(tmp_path: Path) -> None:
    """Each write of a pose sets the velocity to 0; and the friction of a contact is a product."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
            import pybullet as p, pybullet_data
            p.connect(p.DIRECT)
            p.setAdditionalSearchPath(pybullet_data.getDataPath())
            p.setGravity(0, 0, -9.81)
            ball = p.loadURDF("sphere_small.urdf", [0, 0, 0.5])
            tilt = p.getQuaternionFromEuler([0, 0.4, 0])
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[3, 1, 0.1])
            ramp = p.createMultiBody(0, shape, -1, [0, 9, 9], tilt)
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.1])
            box = p.createMultiBody(1, shape, -1, [0.08, 9, 9.19], tilt)
            p.changeDynamics(box, -1, lateralFriction=0.6)
            for step in range(200):
                pose, turned = p.getBasePositionAndOrientation(ball)
                p.resetBasePositionAndOrientation(ball, [0.002 * step, 0, pose[2]], turned)
                p.stepSimulation()
        """)
    )
    rows = [*analyze(record_script(str(script), out=tmp_path / "script.rrd").recording).account]
    assert "199 of these writes stop it" in the(rows, "moved", "0_sphere_small").told
    (slips,) = [row for row in rows if row.kind == "slips"]
    assert "coefficient 0.3 as the product of 0.5 and 0.6" in slips.told
