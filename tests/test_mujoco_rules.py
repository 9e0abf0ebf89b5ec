"""Findings of `drop analyze` about faulty MuJoCo scripts, and none about the corrected ones.

Verification: each world of WORLDS has one thing wrong, whose truth stands beside it; the same
world, mended, is silent. Limits of stability are those at which the scheme itself, stepped here,
begins to grow.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import some
from drop_physics.analysis.results import Analysis
from drop_physics.arrays import Float64
from drop_physics.explain.solids import overlap_m, solid_of
from drop_physics.physics.servo import Servos
from drop_physics.rules.answer import Finding
from drop_physics.rules.rule import RULES
from drop_physics.stages.analyze import analyze
from drop_physics.stages.analyze.explaining import WhatToExplain
from drop_physics.stages.record import record_script
from drop_physics.trace.events import Collision

ARM = """<body name="arm" pos="0 0 1"><joint name="hinge" axis="0 1 0" damping="0.5" {joint}/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"
contype="0" conaffinity="0"/></body>"""
BOX = """<body name="{name}" pos="{pos}"><freejoint/>
<geom type="box" size="0.1 0.1 0.1" mass="1" {geom}/></body>"""
WRIST = """<body name="hand" pos="0 0 1"><joint name="wrist" axis="1 0 0"/>
<geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01" mass="0.05"
contype="0" conaffinity="0"/></body>"""
FLOOR = '<geom type="plane" size="5 5 1" {geom}/>'

WORLDS = f"""
import sys
import mujoco

MENDED = "mended" in sys.argv


def world(bodies, more="", option="", steps=100, drive=None, begin=None, dt=0.002):
    text = '<mujoco><option timestep="%g" ' % dt + option + '/><worldbody>' + bodies
    m = mujoco.MjModel.from_xml_string(text + '</worldbody>' + more + '</mujoco>')
    d = mujoco.MjData(m)
    if begin:
        begin(m, d)
    for k in range(steps):
        if drive:
            drive(m, d, k)
        mujoco.mj_step(m, d)


def sent(value):
    def drive(m, d, k):
        d.ctrl[:] = value
    return drive


ARM, BOX, WRIST, FLOOR = '''{ARM}''', '''{BOX}''', '''{WRIST}''', '''{FLOOR}'''


def servo(**more):
    words = " ".join(f'{{name}}="{{value}}"' for name, value in more.items())
    return f'<actuator><position name="servo" joint="hinge" {{words}}/></actuator>'


# off-target: kp 50 gives the 1.41 N m of its weight at 0.03 rad
world(ARM.format(joint=""), servo(kp=1000 if MENDED else 50), steps=900, drive=sent(0.3))
# off-target for two reasons on one robot
one, other = (ARM.format(joint="").replace("arm", name).replace("hinge", name)
              for name in ("left", "right"))
world('<body name="two">' + one + other + "</body>",
      '<actuator><position joint="left" kp="%g"/><position joint="right" kp="1000" '
      'forcerange="-%g %g"/></actuator>' % ((1000, 9, 9) if MENDED else (50, 0.5, 0.5)),
      steps=900, drive=sent(0.3))
# target-clamped
world(ARM.format(joint='').replace("arm", "clamped").replace("hinge", "knee"),
      servo(kp=1000, ctrlrange="-0.5 0.5").replace("hinge", "knee"),
      drive=sent(0.4 if MENDED else 1))
# unstable, auto-reset: kp h2/I = 33
world(WRIST, '<actuator><position joint="wrist" kp="%g"/></actuator>' % (1 if MENDED else 20),
      steps=40, drive=sent(0.1))


def pushed(m, d, k):
    if k == 20:
        d.xfrc_applied[1, 0] = 3
    if k == 21 and MENDED:
        d.xfrc_applied[1] = 0


world(FLOOR.format(geom='friction="0.1"') + BOX.format(name="pushed", pos="0 0 0.1",
      geom='friction="0.1"'), drive=pushed)


def edited(m, d, k):
    if k == 20:
        m.body_mass[1] *= 20
        m.body_inertia[1] *= 20
        if MENDED:
            mujoco.mj_setConst(m, mujoco.MjData(m))


world(FLOOR.format(geom="") + BOX.format(name="heavy", pos="0 0 0.1", geom=""), steps=60,
      drive=edited)
# slides, once it has landed: tan 20 degrees is 0.364, and 0.2 m g cos 20 degrees 1.84 N
friction = 'friction="%g"' % (0.9 if MENDED else 0.2)
world(FLOOR.format(geom='euler="0 20 0" ' + friction) + BOX.format(name="sliding",
      pos="0.051 0 0.141", geom='euler="0 20 0" ' + friction), steps=150)
# static-parent
world('<body name="base" pos="0 0 0.5"><geom type="box" size="0.08 0.08 0.1" mass="5"/>'
      '<body name="link1" pos="0 0 0.1"><joint axis="0 1 0" damping="1"/>'
      '<geom type="box" size="0.06 0.06 0.16" pos="0 0 0.15" mass="2"/></body></body>',
      '<contact><exclude body1="base" body2="link1"/></contact>' if MENDED else "", steps=20)
# starts-in-contact
world(FLOOR.format(geom="") + BOX.format(name="low", pos="0 0 0.1", geom="")
      + BOX.format(name="high", pos="0 0 %g" % (0.3 if MENDED else 0.25), geom=""), steps=100)
# no-gravity
world(BOX.format(name="floating", pos="0 0 1", geom=""),
      option="" if MENDED else 'gravity="0 0 0"', steps=20)
# no-contact
world('<body name="tray" pos="0 0 0.5"><geom type="box" size="0.3 0.3 0.02" contype="2" '
      'conaffinity="2"/></body>' + BOX.format(name="falling", pos="0 0 0.63",
      geom='contype="%d" conaffinity="0"' % (2 if MENDED else 1)), steps=100)


def put_back(m, d, k):
    if k == 0:
        d.ctrl[:] = 0.5
    if k == 150:
        d.qpos[:] = 0
        d.ctrl[:] = 0 if MENDED else 0.5


world(ARM.format(joint="").replace('name="arm"', 'name="put" gravcomp="1"').replace(
      "hinge", "wheel"), servo(kp=30).replace("hinge", "wheel"), steps=400, drive=put_back)

# deep-penetration: 0.1 mm with MuJoCo's own 0.02, and the square of the time constant times as much
world(FLOOR.format(geom='solref="%g 1" priority="1"' % (0.02 if MENDED else 0.3))
      + BOX.format(name="sunk", pos="0 0 0.1", geom=""), steps=2500)


def led(m, d, k):
    d.mocap_pos[0] = 0.5 * 0.002 * k, 0, 1


world('<body name="lead" mocap="true" pos="0 0 1"/>' + BOX.format(name="led", pos="0 0 1",
      geom='contype="0" conaffinity="0"'), '<equality><weld body1="lead" body2="led" '
      'solref="%g 1"/></equality>' % (0.004 if MENDED else 0.05), 'gravity="0 0 0"', 500, led)


def carried(m, d, k):
    d.mocap_pos[0] = (0 if MENDED else 0.3 * 0.002 * k), 0, 0.95


world('<body name="cart" mocap="true" pos="0 0 0.95"><geom type="box" size="1 1 0.05"/></body>'
      + BOX.format(name="load", pos="0 0 1.1", geom=""), steps=300, drive=carried)


def at_home(m, d):
    d.qpos[:] = 0.5
    d.ctrl[:] = 0.5 if MENDED else 0


world(ARM.format(joint="").replace('name="arm"', 'name="kept" gravcomp="1"').replace(
      "hinge", "lever"), servo(kp=30).replace("hinge", "lever")
      + '<keyframe><key name="home" qpos="0.5" ctrl="0.5"/></keyframe>', steps=300, begin=at_home)


def thrown(m, d):
    d.qvel[0] = 5 if MENDED else 75  # 0.15 m in a step, and 0.10 m to go around


world('<geom type="box" size="0.02 1 1" pos="2 0 1"/><body name="bullet" pos="1.03 0 1">'
      '<freejoint/><geom size="0.03" mass="0.05"/></body>', steps=20, begin=thrown)
# energy-gained: a spring that acts for 4 steps
world(FLOOR.format(geom='solref="%s" priority="1"' % ("0.02 1" if MENDED else "-125000 0"))
      + '<body name="sprung" pos="0 0 0.4"><freejoint/><geom size="0.05" mass="1"/></body>',
      steps=250)
# wheel-slip: tan 6 degrees is 0.105
wheel = ('<body name="{{0}}" pos="{{1}} {{2}} 0"><joint name="{{0}}" axis="0 1 0"/>'
         '<geom type="cylinder" size="0.08 0.02" euler="90 0 0" mass="0.3" friction="%g"/></body>'
         % (1 if MENDED else 0.11))
wheels = [("fl", 0.2, 0.15), ("fr", 0.2, -0.15), ("rl", -0.2, 0.15), ("rr", -0.2, -0.15)]


def rolls(m, d, k):
    d.ctrl[:] = 10


world(FLOOR.format(geom='euler="0 -6 0" friction="0.1"') + '<body name="car" pos="0 0 0.085" '
      'euler="0 -6 0"><freejoint/><geom type="box" size="0.25 0.12 0.03" mass="4" contype="0" '
      'conaffinity="0"/>' + "".join(wheel.format(*each) for each in wheels) + "</body>",
      '<actuator>' + "".join('<velocity joint="%s" kv="2"/>' % each[0] for each in wheels)
      + '</actuator>', 'integrator="implicitfast"', 500, rolls)
# deep-penetration: 200 kg on 0.5 kg
world(FLOOR.format(geom="") + BOX.format(name="carton", pos="0 0 0.1", geom="").replace(
      'mass="1"', 'mass="%g"' % (50 if MENDED else 0.5)) + BOX.format(name="block",
      pos="0 0 0.3", geom="").replace('mass="1"', 'mass="200"'), steps=500)


def coarser(m, d, k):
    if k == 20 and not MENDED:
        m.opt.timestep = 0.005


world(FLOOR.format(geom='solref="0.005 1" priority="1"')
      + BOX.format(name="left", pos="0 0 0.1", geom=""), steps=60, drive=coarser)
world(ARM.format(joint="").replace("arm", "coarse").replace("hinge", "slow"), steps=9,
      dt=0.002 if MENDED else 0.05)


def flag(name):
    return "" if MENDED else '<option><flag %s="disable"/></option>' % name


world(ARM.format(joint="").replace("arm", "limp").replace("hinge", "limp"),
      '<actuator><position name="idle" joint="limp" kp="1000"/></actuator>' + flag("actuation"),
      drive=sent(0.3))
world(BOX.format(name="hung", pos="0 0 1", geom=""), flag("gravity"), steps=20)


def stale():
    turned = ARM.format(joint="").replace("arm", "turned")
    m = mujoco.MjModel.from_xml_string(f'<mujoco><worldbody>{{turned}}</worldbody></mujoco>')
    d = mujoco.MjData(m)
    for k in range(20):
        mujoco.mj_step1(m, d)
        if k == 10:
            d.qpos[:] = 1.2
            if MENDED:
                mujoco.mj_step1(m, d)
        mujoco.mj_step2(m, d)


stale()


def moved_by_hand(m, d, k):
    d.qpos[0] = 0.001 * k - (0.1 if MENDED else 0)
    mujoco.mj_forward(m, d)


def cleared(m, d, k):
    if k == 0:
        d.ctrl[:] = 0.4
    if k == 50:
        mujoco.mj_resetData(m, d)
        d.ctrl[:] = 0.4 if MENDED else 0  # given anew


DOOR = ('<body name="door" pos="0 0 1"><joint name="{{0}}" axis="0 0 1" {{1}}/><geom type="box" '
        'size="0.4 0.02 0.9" pos="0.4 0 0" mass="8" contype="0" conaffinity="0"/></body>')
MOTOR = '<actuator><motor name="{{0}}" joint="{{0}}" {{1}}/></actuator>'
# joint-damping, friction-loss, armature: 3 N m on 1.7 kg m2
for name, lost in (("damped", "damping"), ("rubbed", "frictionloss"), ("heavy", "armature")):
    world(DOOR.format(name, lost + '="%g"' % (0.1 if MENDED else 100)), MOTOR.format(name, ""),
          steps=150, drive=sent(3))
# target-clamped of a motor, gear, damper: 78 N on kv 30
world(DOOR.format("weak", "damping='1'"), MOTOR.format("weak", 'ctrlrange="-2 2"'), steps=50,
      drive=sent(1 if MENDED else 9))
world(DOOR.format("geared", "damping='1'"), '<actuator><position name="geared" joint="geared" '
      'kp="100" kv="20" gear="%g"/></actuator>' % (1 if MENDED else 2), steps=50, drive=sent(0.6))
world('<body name="cab" pos="0 0 9"><joint name="hoist" type="slide" axis="0 0 1"/><geom '
      'size="0.1" mass="8"/></body>', '<actuator><velocity joint="hoist" kv="%g"/></actuator>'
      % (3000 if MENDED else 30), steps=900, drive=sent(0.2))
world(ARM.format(joint="").replace('name="arm"', 'name="cleared" gravcomp="1"').replace(
      "hinge", "cleared"), servo(kp=30).replace("hinge", "cleared"), steps=300, drive=cleared)
# overwritten
world('<geom type="box" size="0.02 1 1" pos="0.1 0 1"/><body name="paddle" pos="0 0 1"><joint '
      'type="slide" axis="1 0 0"/><geom size="0.05"/></body>', steps=80, drive=moved_by_hand)
# slides without friction, unbraked
tilted = 'euler="0 10 0" condim="%d"' % (3 if MENDED else 1)
world(FLOOR.format(geom=tilted) + BOX.format(name="frictionless", pos="0.0174 0 0.0985",
      geom=tilted), steps=100)


def rolling(m, d):
    d.qvel[0], d.qvel[4] = 1, 20


ball = 'friction="1 0.005 0.002" condim="%d"' % (6 if MENDED else 3)
world(FLOOR.format(geom=ball) + '<body name="ball" pos="0 0 0.05"><freejoint/><geom size="0.05" '
      'mass="0.2" %s/></body>' % ball, steps=200, begin=rolling)


def heaved(m, d, k):
    d.xfrc_applied[1, 0] = 9


world('<body name="rock" pos="0 0 1">' + ("<freejoint/>" if MENDED else "")
      + '<geom size="0.1" mass="1"/></body>', steps=9, drive=heaved)
# collides-as-hull: a gutter, in which a stone lies; a roof, on whose ridge it does
across = [(-1, 1), (0, 0), (1, 1), (1, 1.1), (0, 0.1), (-1, 1.1)]
corners = [(x, y, z) for x in (-1, 1) for y, z in across]
ends = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4)]
sides = [(i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6) for i in range(6)]
faces = [each[::-1] for each in ends] + [tuple(k + 6 for k in each) for each in ends]
faces += [each for i, j, k, l in sides for each in ((i, j, k), (i, k, l))]
text = [" ".join(str(n) for each in part for n in each) for part in (corners, faces)]
world('<geom type="mesh" mesh="gutter" euler="%d 0 0"/><body name="stone" pos="0 0 %g"><freejoint/>'
      '<geom size="0.1" mass="1"/></body>' % ((180, 0.12) if MENDED else (0, 1.22)),
      '<asset><mesh name="gutter" vertex="%s" face="%s"/></asset>' % tuple(text), steps=60)
"""


def analyzed(folder: Path, *arguments: str) -> Analysis:
    script = folder / "worlds.py"
    script.write_text(WORLDS)
    with (folder / "printed.txt").open("wb") as printed:
        recorded = record_script(
            str(script), list(arguments), out=folder / "run.rrd", stdout=printed.fileno()
        )
    return analyze(recorded.recording, explain=WhatToExplain(whole=True))


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Finding]:
    """Return the findings of all faulty simulations, by code and by joint or body."""
    findings = analyzed(tmp_path_factory.mktemp("wrong")).findings
    return {f"{each.code} {each.joint or each.body or ''}": each for each in findings}


def numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", text)]


@pytest.mark.parametrize(
    ("code", "about", "words"),
    some(
        [
            ("off-target", "hinge", r"is a spring, and kp = 50 .*kp="),
            ("off-target", "right", r"^right (rests|ends) .*its forcerange of 0\.5 N m"),
            ("target-clamped", "knee", r"sent to 1 .*ctrlrange is -0.5 to 0.5"),
            ("unstable", "wrist", r"by actuator .*kp = 20 .*kp h²/I = 33"),
            ("auto-reset", "wrist", r"reset in 10 steps of 40, first in step 4: the acceleration"),
            (
                "push-stays",
                "pushed",
                r"pushed by 3 N in 80 steps, from step 21 .*xfrc_applied\[1\]",
            ),
            (
                "model-edited",
                "heavy",
                r"to 20 kg before step 21 .*that of 1 kg: the inertia that forces.*mj_setConst",
            ),
            ("slides", "sliding", r"at most 1\.84 N \(coefficient 0\.2\).*\(0\.364\)"),
            ("static-parent", "base", r"link1 is 10 mm inside base .*<exclude"),
            ("starts-in-contact", "high", r"begins 50 mm inside .*low"),
            (
                "not-taken",
                "limp",
                r"idle is given up to 0\.3, and no actuator acts: a flag of the model",
            ),
            ("no-gravity", "hung", r"a flag of the model switches gravity off"),
            ("no-gravity", "floating", r"gravity is 0"),
            ("no-contact", "falling", r"conaffinity 2 and contype 2 of \d+_tray"),
            ("reset-leaves", "wheel", r"put to 0.00 rad .*ctrl is still the 0.50 rad"),
            (
                "deep-penetration",
                "sunk",
                r"gets 11 mm into .* solref 0\.3 1, which is softer .*0\.02 1",
            ),
            (
                "constraint-lags",
                "led",
                r"\d+_led follows \d+_lead 50 mm behind: .*0\.5 m/s .*0\.1 s late",
            ),
            ("dragged-by-nothing", "load", r"load stays behind .*_cart by 0\.17\d m .*<joint>"),
            (
                "reset-leaves",
                "lever",
                r"keyframe home .*ctrl is 0, and that of the keyframe is 0\.5",
            ),
            (
                "tunnelled",
                "bullet",
                r"goes 0\.15 m in one step.*is 0\.04\d* m thick.*timestep/\d",
            ),
            (
                "energy-gained",
                "sprung",
                r"part at .*a spring \(solref -125000 0\) that acts for [34] s",
            ),
            ("wheel-slip", "", r"on \d+_world but travels at 0\.0.*0\.11, the larger of both"),
            (
                "deep-penetration",
                "block",
                r"40\d times what \d+_carton weighs .*=\"0\.004 1\" of both",
            ),
            (
                "timestep-changed",
                "",
                r"1/500 s to 1/200 s at step 20: .*0\.01 s .* gives one 0\.005 s",
            ),
            ("timestep-too-long", "coarse", r"in steps of 1/20 s: .*timestep/4"),
            ("joint-damping", "damped", r"driven with 3 N m .*damping of 100 takes 9\d% of"),
            (
                "joint-damping",
                "rubbed",
                r"driven with 3 N m .*frictionloss of 100 takes 1?\d\d% of",
            ),
            ("armature", "heavy", r"driven with 3 N m .*armature of 100 takes 98% of"),
            (
                "target-clamped",
                "weak",
                r"weak is given up to 9, beyond its ctrlrange of -2 to 2 in 50",
            ),
            ("off-target", "geared", r"given 0\.6 and sends geared to 0\.3, as its gear is 2"),
            ("off-target", "hoist", r"-2\.\d+ m/s where its target is 0\.2: .*kv = 30 .*kv="),
            (
                "reset-leaves",
                "cleared",
                r"given 0 in 250 steps after a reset, .*was 0\.4.*after each",
            ),
            ("overwritten", "paddle", r"paddle is set by qpos in .* and gets \d+\.?\d* mm into"),
            (
                "slides",
                "frictionless",
                r"slides 0\.0\d+ m on .* in \d+ steps without .* have condim 1.*condim=\"3\"",
            ),
            (
                "not-taken",
                "ball",
                r"rolls 0\.39\d m on .* in \d+ steps, .* acts with condim 6, and theirs is 3",
            ),
            ("not-taken", "rock", r"given xfrc_applied\[1\], and has no joint: .*<freejoint/>"),
            ("collides-as-hull", "", r"stone touches .* mm off .*MuJoCo collides the convex hull"),
            (
                "not-replayed",
                "",
                r"one step from step 11 on used .*before qpos was written.*mj_step1",
            ),
        ],
        3,
    ),
)
def test_what_is_wrong_is_said(
    wrong: dict[str, Finding], code: str, about: str, words: str
) -> None:
    (finding,) = (each for key, each in wrong.items() if key.startswith(code) and about in key)
    assert re.search(words, f"{finding.message} {finding.advice}", re.DOTALL)


def test_nothing_else_is_said_of_them(wrong: dict[str, Finding]) -> None:
    assert len(wrong) == 38


@pytest.mark.long
def test_nothing_is_said_once_they_are_mended(tmp_path: Path) -> None:
    assert analyzed(tmp_path, "mended").findings == []


def test_a_spring_rests_where_its_weight_takes_it(wrong: dict[str, Finding]) -> None:
    effect = wrong["off-target hinge"].effect
    assert effect is not None
    # 50 e = 9.81 * 0.15 cos(0.3 + e), by three fixed-point iterations to 1e-6
    off = 0.0
    for _ in range(6):
        off = 9.81 * 0.15 * np.cos(0.3 + off) / 50
    assert effect.value == pytest.approx(off, abs=1e-4)


PRESSED = """
import mujoco, sys

body = '<body pos="0 0 %s"><freejoint/><geom type="box" size="%s" mass="%s" solref="%s 1"/></body>'
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><geom type="plane" size="2 2 1" solref="%s 1"/>' % sys.argv[1]
    + body % ("0.02", "0.3 0.3 0.02", 0.05, sys.argv[1])
    + body % ("0.14", "0.1 0.1 0.1", 20, sys.argv[1])
    + "</worldbody></mujoco>")
data = mujoco.MjData(model)
for k in range(2000):
    mujoco.mj_step(model, data)
sys.stderr.write(str(-1e3 * data.contact.dist.min()))
"""


def test_the_depth_that_a_shorter_time_constant_leaves(tmp_path: Path) -> None:
    # It is within the width of solimp, where the impedance grows with the depth.
    script = tmp_path / "pressed.py"
    script.write_text(PRESSED, encoding="utf-8")
    mended = subprocess.run(
        [sys.executable, script, "0.004"], check=True, capture_output=True, text=True
    )
    recorded = record_script(str(script), ["0.02"], out=tmp_path / "pressed.rrd")
    (found,) = analyze(recorded.recording).findings
    assert found.code == "deep-penetration"
    left = re.search(r"leaves (\S+) mm", str(found.advice))
    assert left is not None
    assert float(left[1]) == pytest.approx(float(mended.stderr), rel=0.02)  # it settles


IN_DEGREES = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint name="waist" axis="0 0 1" damping="1" range="-90 90"/>'
    '<geom size="0.1" pos="0.3 0 0"/></body></worldbody><actuator><position joint="waist" '
    'name="servo" kp="100" inheritrange="1"/></actuator></mujoco>')
data = mujoco.MjData(model)
data.ctrl[0] = 45
for k in range(100):
    mujoco.mj_step(model, data)
"""


def test_a_control_in_degrees_is_told(tmp_path: Path) -> None:
    """The control is clamped to a range that contains it when read as an angle in degrees."""
    script = tmp_path / "in_degrees.py"
    script.write_text(IN_DEGREES, encoding="utf-8")
    (found,) = analyze(record_script(str(script), out=tmp_path / "a.rrd").recording).findings
    assert found.code == "target-clamped"
    assert "math.radians(45) is 0.7854" in str(found.advice)


FINGER = WRIST.replace("wrist", "knuckle").replace(
    "</body>", WRIST.replace("hand", "tip").replace("0 0 1", "0.05 0 0") + "</body>"
)
TWO_STIFF = f"""
import mujoco
servos = "".join(f'<position joint="{{each}}" kp="20"/>' for each in ("knuckle", "wrist"))
model = mujoco.MjModel.from_xml_string(
    '''<mujoco><worldbody>{FINGER}</worldbody><actuator>''' + servos + "</actuator></mujoco>")
data = mujoco.MjData(model)
for k in range(40):
    data.ctrl[:] = 0.1
    mujoco.mj_step(model, data)
"""


def test_of_two_servos_that_are_too_stiff_no_gain_alone_is_advised(tmp_path: Path) -> None:
    """Beside the other one no kp of one joint holds it, which is nan; a shorter timestep does."""
    script = tmp_path / "two_stiff.py"
    script.write_text(TWO_STIFF, encoding="utf-8")
    found, _ = analyze(record_script(str(script), out=tmp_path / "a.rrd").recording).findings
    assert (found.code, found.cure and found.cure.name) == ("unstable", "timestep")
    assert "holds it: a timestep below 0.42 ms" in str(found.advice)


def servos(
    *inertia: float, stiffness: float = 0, ends: float = 0, begins: float = 0, fourth: bool = False
) -> Servos:
    """Return coupled servos with one or two degrees of freedom, to test their stability."""
    n = round(len(inertia) ** 0.5)
    springs, late, early = (
        np.array([value, value / 10][:n]) for value in (stiffness, ends, begins)
    )
    return Servos(0.002, np.reshape(inertia, (n, n)), springs, late, early, fourth)


COUPLED = 2.4e-6, 1.5e-6, 1.5e-6, 4e-6
SERVOS = [
    servos(2.4e-6, stiffness=20.0),
    servos(2.4e-6, stiffness=20.0, ends=1e-3, begins=2e-4),
    servos(2.4e-6, begins=0.05),
    servos(2.4e-6, begins=0.02, fourth=True),
    servos(2.4e-6, stiffness=30.0, fourth=True),
    servos(*COUPLED, stiffness=2.0),
    servos(*COUPLED, begins=0.004),
    servos(*COUPLED, begins=0.006, fourth=True),
]


def grown(servo: Servos, steps: int = 4000) -> float:
    """Return the factor by which the integration scheme grows a state per step."""
    n, h = len(servo.inertia), servo.timestep_s
    x, v = 1e-3 * np.ones(n), 1e-3 / h * np.ones(n)
    size = np.hypot(x, v * h).max()
    damping = servo.ends + servo.begins
    heavy = servo.inertia + h * np.diag(servo.ends) * (not servo.fourth_order)

    def pulled(x: Float64, v: Float64) -> Float64:
        return np.asarray(np.linalg.solve(heavy, -(servo.stiffness * x + damping * v)))

    for _ in range(steps):
        if servo.fourth_order:
            stages, weights, at = [], (1, 2, 2, 1), (0.0, 0.5, 0.5, 1.0)
            dx = dv = np.zeros(n)
            for share in at:
                stages.append((v + share * h * dv, pulled(x + share * h * dx, v + share * h * dv)))
                dx, dv = stages[-1]
            x = x + h / 6 * sum(w * s[0] for w, s in zip(weights, stages, strict=True))
            v = v + h / 6 * sum(w * s[1] for w, s in zip(weights, stages, strict=True))
        else:
            v = v + h * pulled(x, v)
            x = x + h * v
        if not np.hypot(x, v).max() < 1e30:
            return np.inf
    return float(np.hypot(x, v * h).max() / size)


@pytest.mark.parametrize("servo", some(SERVOS, 3))
@pytest.mark.parametrize("name", ["stiffness", "begins", "timestep_s", "inertia"])
def test_a_limit_is_where_the_scheme_begins_to_grow(servo: Servos, name: str) -> None:
    limit = servo.limit(name, 0)
    if limit is None:  # another number is why it grows
        assert grown(servo.calmed(name, 0, 1e9)) == np.inf
        return
    assert grown(servo.calmed(name, 0, limit * 1.02)) < 30
    assert limit == 1 or grown(servo.calmed(name, 0, limit / 1.02)) == np.inf


def test_shapes_overlap_by_no_more_than_they_do() -> None:
    place = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    ball = solid_of(Collision(-1, "sphere", (0.05,), "", *place))
    box = solid_of(Collision(-1, "box", (0.2, 0.2, 0.2), "", *place))
    floor = solid_of(Collision(-1, "plane", (), "", *place))
    assert ball is not None
    assert box is not None
    assert floor is not None
    n = 41
    heights = np.linspace(0.2, -0.2, n)
    turns = np.tile(np.eye(3), (n, 1, 1))
    there = np.column_stack([np.zeros((n, 2)), heights])
    origin = np.zeros((n, 3)), turns
    assert overlap_m(ball, (there, turns), floor, origin) == pytest.approx(
        np.maximum(0.05 - heights, 0), abs=1e-12
    )
    exact = np.maximum(0.15 - np.abs(heights), 0)  # to the nearest face
    found = overlap_m(ball, (there, turns), box, origin)
    assert (found <= exact + 1e-12).all()
    assert found[exact > 0.01].min() > 0


def test_rules_speak_of_the_engines_whose_words_they_have() -> None:
    both = {rule.code for rule in RULES if len(rule.engines) > 1}
    general = {"dragged-by-nothing", "unseeded", "tunnelled", "timestep-too-long"}
    general |= {"timestep-changed", "energy-gained", "wheel-slip", "collides-as-hull", "no-contact"}
    general |= {"overwritten", "no-gravity", "not-stepped", "reset-leaves"}
    assert general <= both <= general | {"script-failed", "not-finite"}


CHATTERS = """
import mujoco
model = mujoco.MjModel.from_xml_string('''<mujoco><option timestep="0.005"/><worldbody>
<body><joint name="spin" axis="0 1 0"/><geom type="cylinder" size="0.05 0.01" mass="0.1"/></body>
</worldbody><actuator><motor name="m" joint="spin" ctrlrange="-2 2"/></actuator></mujoco>''')
data = mujoco.MjData(model)
for _ in range(100):
    data.ctrl[0] = {control}
    mujoco.mj_step(model, data)
"""


@pytest.mark.parametrize(
    ("control", "chatters"), [("0.5 * (10.0 - data.qvel[0])", True), ("35", False)]
)
def test_a_control_that_overshoots_in_each_step_gets_no_greater_range(
    tmp_path: Path, control: str, *, chatters: bool
) -> None:
    """Without ctrlrange, a gain of 20 inertias per timestep makes the speed diverge."""
    script = tmp_path / "script.py"
    script.write_text(CHATTERS.format(control=control))
    found = analyze(record_script(str(script), out=tmp_path / "script.rrd").recording).findings
    (clamped,) = [each for each in found if each.code == "target-clamped"]
    assert ("changes its sign in 99 of them" in clamped.message) == chatters
    assert (clamped.cure is None) == chatters


@pytest.mark.parametrize(("kv", "grows"), [(0.3, True), (0.02, False)])
def test_a_wheel_that_its_law_drives_ever_faster_does_not_slip(
    tmp_path: Path, kv: float, *, grows: bool
) -> None:
    """With kv h / I = 2.4 its speed grows with every step; with 0.16 it spins on ice."""
    wheels = "".join(
        f'<body pos=".12 {y} 0"><joint name="{name}" axis="0 1 0"/>'
        '<geom type="cylinder" size=".07 .02" euler="90 0 0" mass=".1" friction=".01"/></body>'
        for name, y in (("l", 0.13), ("r", -0.13))
    )
    motors = "".join(f'<velocity joint="{name}" kv="{kv}"/>' for name in "lr")
    script = tmp_path / "script.py"
    script.write_text(
        "import mujoco\nmodel = mujoco.MjModel.from_xml_string('''<mujoco><worldbody>"
        '<geom type="plane" size="9 9 1" friction=".01"/><body pos="0 0 .07"><freejoint/>'
        '<geom type="box" size=".2 .1 .02" mass="1"/><geom type="sphere" size=".03" '
        f'pos="-.15 0 -.04" mass=".1" condim="1"/>{wheels}</body></worldbody><actuator>{motors}'
        "</actuator></mujoco>''')\ndata = mujoco.MjData(model)\ndata.ctrl[:] = 50\n"
        "for _ in range(400):\n    mujoco.mj_step(model, data)\n"
    )
    found = analyze(record_script(str(script), out=tmp_path / "script.rrd").recording).findings
    codes = {each.code for each in found}
    assert ("unstable" in codes) == grows
    assert ("wheel-slip" in codes) != grows
