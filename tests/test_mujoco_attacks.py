"""What an attacker's MuJoCo scripts are told: nothing false of right ones, and the right number.

Verification: the truth of each model of MODELS stands beside it; the numbers are those of MuJoCo
itself, or of a run that does what is advised.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from drop_physics.rules.answer import Finding
from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script

FLOOR = '<geom name="floor" type="plane" size="3 3 .1"/>'
RAMP = '<geom name="ramp" type="box" size="2 .5 .05" euler="0 15 0" friction="1"/>'
PEDESTAL = """<body name="pedestal" pos="0 0 .25"><geom type="cylinder" size=".06 .25"/>
<body name="forearm" pos="0 0 .24"><joint name="yaw" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .4 0 .0" size=".05" mass="1"/></body></body>"""


def box(name: str, height: float, half: float, mass: float, more: str = "") -> str:
    return (
        f'<body name="{name}" pos="0 0 {height}"><freejoint/><geom name="{name}" type="box" '
        f'size="{half} {half} {half}" mass="{mass}" {more}/></body>'
    )


def on_ramp(name: str, more: str = "") -> str:
    return RAMP + box(name, 0.156, 0.1, 1, more).replace(" pos", ' euler="0 15 0" pos')


def pair(first: str, second: str, words: str) -> str:
    return f'<contact><pair geom1="{first}" geom2="{second}" {words}/></contact>'


@dataclass(frozen=True)
class Model:
    """A model, what runs before each of its steps, and how many there are."""

    bodies: str
    more: str = ""
    drive: str = "pass"
    steps: int = 300

    @property
    def text(self) -> str:
        """Return it as MuJoCo reads it."""
        return f"<mujoco><worldbody>{self.bodies}</worldbody>{self.more}</mujoco>"


MODELS = {
    # The script writes qvel[0] alone, before each step.
    "racket": Model(
        '<geom type="box" pos="1.2 0 .2" size=".05 .5 .2"/><body name="racket" pos=".9 0 .2">'
        '<joint type="slide" axis="1 0 0"/><geom type="box" size=".05 .2 .1" mass="5"/></body>',
        drive="d.qvel[0] = 0.5",
        steps=900,
    ),
    # Lengths in mm: the floor carries 9810 N, which is what 1 kg weighs.
    "part": Model(FLOOR + box("part", 55, 50, 1), '<option gravity="0 0 -9810"/>'),
    # 500 kg on 0.5 kg, where gravity is 1.62 m/s²: some thousand times its weight.
    "light": Model(
        FLOOR + box("light", 0.1, 0.1, 0.5) + box("heavy", 0.3, 0.1, 500),
        '<option gravity="0 0 -1.62"/>',
        steps=1000,
    ),
    # What is pressed flat lets its load down on the floor: no time constant leaves 2 mm.
    "tiny": Model(FLOOR + box("tiny", 0.05, 0.05, 0.001) + box("huge", 0.2, 0.1, 1000), steps=1000),
    "paired": Model(
        on_ramp("paired", 'friction="1"'), pair("paired", "ramp", 'friction=".05 .05"')
    ),
    "slick": Model(on_ramp("slick", 'friction="1"'), pair("slick", "ramp", 'condim="1"')),
    "sunk": Model(
        FLOOR + box("sunk", 0.1, 0.1, 1), pair("sunk", "floor", 'solref="0.3 1"'), steps=2500
    ),
    "pedestal": Model(
        PEDESTAL,
        '<actuator><position joint="yaw" kp="200" kv="20"/></actuator>',
        "d.ctrl[0] = 0.6",
    ),
    # Index 0 is the world.
    "crate": Model(FLOOR + box("crate", 0.1, 0.1, 1), drive="d.xfrc_applied[0, :3] = 20, 0, 0"),
}

# Models that are told the same, each alone.
HINGE = """<body name="arm" pos="0 0 1"><joint name="hinge" axis="0 0 1"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/></body>"""
WHEEL = """<body name="rotor" pos="0 0 1"><joint name="hinge" axis="0 0 1"/>
<geom type="cylinder" size="{0} .02" mass=".4"/></body>"""
MOTOR = '<actuator><motor name="m" joint="hinge"/></actuator><option gravity="0 0 0"/>'
TWO = """<body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="1"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
<body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping="1" armature="{armature}"/>
<geom type="capsule" fromto="0 0 0 .25 0 0" size=".025" mass=".5"/></body></body>"""
TWO_SERVOS = """<option timestep="{timestep}"/><actuator>
<position joint="shoulder" kp="300" kv="20"/><position joint="elbow" kp="200" kv="{kv}"/>
</actuator>"""
ARM = {"armature": 0.0, "timestep": 0.002, "kv": 10.0}
SINGLE = {
    # kd h/I is 2.05, where 2 is the limit: 743,000 rad/s after 300 steps, and no reset.
    "barely": Model(
        WHEEL.format(0.1), MOTOR, "d.ctrl[0] = 0.5 - d.qpos[0] - 2.05 * d.qvel[0]", 300
    ),
    "held": Model(
        HINGE,
        MOTOR,
        "d.ctrl[0] = d.ctrl[0] if k % 10 else 20 * (0.5 - d.qpos[0]) - 0.8 * d.qvel[0]",
        300,
    ),
    # The rate is added where it is to be taken off.
    "sign": Model(HINGE, MOTOR, "d.ctrl[0] = 5 * (0.5 - d.qpos[0]) + 0.05 * d.qvel[0]", 1000),
    # The first step ends with what the second turns around; the third is a reset.
    "at_once": Model(
        WHEEL.format(0.03),
        '<actuator><velocity joint="hinge" kv="5"/></actuator>',
        "d.ctrl[0] = 0 if k else 10",
        50,
    ),
    "tipped": Model(
        FLOOR + box("tipped", 0.1, 0.1, 1, 'friction="1 .01 .002"'),
        drive="d.qvel[:3], d.qvel[4] = (d.qvel[:3], d.qvel[4]) if k else ((0.6, 0, 0.6), 6)",
    ),
    # Without its kp it grows, and without its kv.
    "both": Model(
        WHEEL.format(0.03),
        '<actuator><position joint="hinge" kp="5000" kv="1"/></actuator>',
        "d.ctrl[0] = 0.5",
        50,
    ),
    "rope": Model(
        '<site name="a" pos="0 0 1"/><body name="bead" pos=".3 0 1"><joint name="hinge" '
        'type="slide" axis="1 0 0"/><geom size=".01" mass=".01"/><site name="b"/></body>',
        '<tendon><spatial name="t" damping="20"><site site="a"/><site site="b"/></spatial></tendon>'
        + MOTOR,
        "d.qvel[0] = d.qvel[0] if k else 0.1",
    ),
    "turning": Model(
        box("turning", 1, 0.1, 1),
        '<option integrator="RK4"/>',
        "d.qpos[3:], d.qvel[3:] = (d.qpos[3:], d.qvel[3:]) if k else (0, (1, 2, 3))",
        50,
    ),
    "arm": Model(TWO.format(**ARM), TWO_SERVOS.format(**ARM), "d.ctrl[:] = -.2, .3", 100),
}

# An arm that a keyframe bends; gravity is off, so that what it is given decides.
BENT = """<body name="{0}" pos="0 0 1"><joint name="{0}" axis="0 0 1" damping="1" {1}/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/></body>"""
SERVO = """<actuator><position joint="{0}" kp="100" kv="5"/></actuator>"""
LOADED = "mujoco.mj_resetDataKeyframe(m, d, 0) if k == 0 else None"
MODELS |= {
    "kept": Model(
        BENT.format("kept", ""),
        SERVO.format("kept") + '<keyframe><key name="home" qpos=".5"/></keyframe>',
        LOADED,
        400,
    ),
    # The keyframe is loaded with its ctrl, and the script then asks for another pose.
    "sent": Model(
        BENT.format("sent", ""),
        SERVO.format("sent") + '<keyframe><key name="home" qpos=".5" ctrl=".5"/></keyframe>',
        LOADED + "; d.ctrl[0] = 0.9",
        400,
    ),
    # At rest half-way between its target and the place of its own spring.
    "sprung": Model(
        BENT.format("sprung", 'stiffness="100"'), SERVO.format("sprung"), "d.ctrl[0] = 1", 900
    ),
    "afloat": Model(FLOOR + box("afloat", 0.6, 0.1, 1).replace("<body", '<body gravcomp="1"')),
    "hovers": Model(FLOOR + box("hovers", 2, 0.1, 1), drive="d.qvel[:] = .5, 0, 0, 0, 0, 0"),
    "glides": Model(FLOOR + box("glides", 2, 0.1, 1), drive="d.qvel[0] = .5"),
    # To MuJoCo a quaternion of zeros is no rotation.
    "zeroed": Model(FLOOR + box("zeroed", 0.1, 0.1, 1), drive="d.qpos[3:] = d.qpos[3:] * (k > 0)"),
    # A tray takes its load along, which does not roll.
    "carried": Model(
        '<body name="tray" pos="0 0 .5"><joint name="tray" type="slide" axis="1 0 0"/><geom '
        'type="box" size=".3 .3 .02" mass="4"/></body>'
        + box("carried", 0.57, 0.05, 0.5, 'friction="1 .01 .002"'),
        more='<actuator><position joint="tray" kp="800" kv="60"/></actuator>',
        drive="d.ctrl[0] = .3 * min(1, k / 1000) ** 2 * (3 - 2 * min(1, k / 1000))",
        steps=1200,
    ),
    # Actuators with a state of their own decide how fast they are.
    "pan": Model(
        BENT.format("pan", ""),
        '<actuator><intvelocity joint="pan" kp="60" actrange="-3 3"/></actuator>',
        "d.ctrl[0] = .5",
        1000,
    ),
    "unreal": Model(
        BENT.format("unreal", ""),
        SERVO.format("unreal"),
        "d.ctrl[0] = 0 if k < 99 else float('nan')",
    ),
}

SCRIPT = """
import mujoco

def run(text, steps, drive):
    m = mujoco.MjModel.from_xml_string(text)
    d = mujoco.MjData(m)
    for k in range(steps):
        drive(m, d, k)
        mujoco.mj_step(m, d)

"""


# At 200 m/s three steps touch the wall, whose contact is far too soft to stop what comes.
BULLET = """<geom type="box" pos=".2 0 1" size=".01 .5 .5"/>
<body name="bullet" pos="0 0 1"><freejoint/><geom size=".01" mass=".01" solref="{0} 1"
priority="1"/></body>"""
TIMED = '<option timestep="{0}" gravity="0 0 0"/>'
SHOT = "d.qvel[0] = d.qvel[0] if k else 200"
# A motor bears its load and lets it down slowly.
SINGLE["borne"] = Model(
    BENT.format("borne", "").replace('axis="0 0 1"', 'axis="0 1 0"'),
    '<actuator><motor joint="borne"/></actuator>',
    "d.ctrl[0] = d.qfrc_bias[0] + .1",
    500,
)
# A torque of 400 (0.5 - q) is held for 40 steps: without its range it throws the arm further.
SINGLE["decimated"] = Model(
    HINGE,
    '<option gravity="0 0 0"/><actuator><motor joint="hinge" ctrlrange="-1 1"/></actuator>',
    "d.ctrl[0] = d.ctrl[0] if k % 40 else 400 * (0.5 - d.qpos[0])",
)
# Its 5.9 N sag by 2.9 mm, as lifts do.
SINGLE["lift"] = Model(
    '<body name="lift" pos="0 0 1"><joint name="lift" type="slide" axis="0 0 1" damping="40"/>'
    '<geom size=".05" mass=".6"/></body>',
    '<actuator><position joint="lift" kp="2000"/></actuator>',
    "d.ctrl[0] = 0.1",
    1000,
)
# Each episode is given 0.5, which shows only where it differs from what was there.
SINGLE["again"] = Model(
    BENT.format("again", ""),
    SERVO.format("again"),
    "d.qpos[0], d.qvel[0] = (d.qpos[0], d.qvel[0]) if k % 300 else (0, 0); d.ctrl[0] = 0.5",
    900,
)
# The script writes its force before each of 200 steps.
SINGLE["wind"] = Model(
    FLOOR + box("wind", 0.1, 0.1, 1, 'friction="1"'),
    drive="d.xfrc_applied[1, 0] = 3 if k >= 100 else 0",
)
# The script jolts it twice, and then gives it more than a step could take.
SINGLE["jolted"] = Model(
    HINGE, MOTOR, "d.ctrl[0] = {99: 0.1, 100: -10, 101: 1e3, 102: -1e9}.get(k, 0)", 300
)
SINGLE["bullet"] = Model(BULLET.format(0.02), TIMED.format(5e-5), SHOT, 60)
# A hand presses with 30 N from the first step on, and its fingers have closed after 25 steps.
HAND = """<body name="hand" pos="0 0 .2"><body name="l" pos="-.05 0 0"><joint name="l" type="slide"
axis="1 0 0"/><geom type="box" size=".01 .02 .03" mass=".05"/></body><body name="r" pos=".05 0 0">
<joint name="r" type="slide" axis="-1 0 0"/><geom type="box" size=".01 .02 .03" mass=".05"/></body>
</body>"""
GRIPS = (
    """<option noslip_iterations="{0}"/><actuator><motor joint="l"/><motor joint="r"/></actuator>"""
)
for number in (0, 10):
    SINGLE[f"grip{number}"] = Model(
        HAND + box("block", 0.2, 0.025, 0.2), GRIPS.format(number), "d.ctrl[:] = 15, 15", 1000
    )

ALONE = ("tiny",)
"""Models of which the same is said as of a worse one."""


def recorded(folder: Path, *names: str) -> Path:
    """Record a script that steps some models, one after the other."""
    script, text = folder / "models.py", SCRIPT
    for name in names:
        model = MODELS.get(name) or SINGLE[name]
        text += f"def {name}(m, d, k):\n    {model.drive}\n"
        text += f"run('''{model.text}''', {model.steps}, {name})\n"
    script.write_text(text, encoding="utf-8")
    return record_script(str(script), out=folder / "run.rrd").recording


def analyzed(folder: Path, *names: str) -> list[Finding]:
    """Return the findings of such a script."""
    return list(analyze(recorded(folder, *names)).findings)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> list[Finding]:
    together = [name for name in MODELS if name not in ALONE]
    return analyzed(tmp_path_factory.mktemp("attacks"), *together)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("slides", r"_paired slides .*coefficient 0\.05.*\(that of a <pair> counts"),
        ("slides", r"_slick slides .* condim 1.*condim=\"3\""),
        ("deep-penetration", r"_sunk gets 11 mm .* solref 0\.3 1,.*or of the <pair>"),
        ("deep-penetration", r"_heavy gets 9\.04 mm .* 1\.08e\+03 times .*leaves 0\.5\d mm"),
        ("reset-leaves", r"^kept is driven off .* home by 0\.5 rad: .* each actuator 0 ctrl="),
        (
            "off-target",
            r"^sprung rests 0\.5 rad off .*: .* 50 N m stiffness=\"0\" of the <joint>, or",
        ),
        ("no-gravity", r"^gravcomp takes all of gravity off \d+_afloat.* gravcomp=\"0\""),
        (
            "not-finite",
            r"^ctrl\[0\] is huge or no number in 201 steps, first in step 100, .* 0 for",
        ),
        ("not-taken", r"xfrc_applied\[0\] is of the world.* such as 1 of \d+_crate"),
    ],
)
def test_what_is_wrong_is_said_as_it_is(found: list[Finding], code: str, words: str) -> None:
    said = [f"{each.message} {each.advice}" for each in found if each.code == code]
    assert [each for each in said if re.search(words, each, re.DOTALL)], said


def test_a_body_that_is_pressed_flat_gets_no_depth_as_advice(tmp_path: Path) -> None:
    (finding,) = analyzed(tmp_path, "tiny")
    assert finding.advice == "give 1_tiny a mass nearer to that of what lies on it"


@pytest.mark.parametrize("name", ["racket", "part", "sent", "glides", "zeroed", "carried", "pan"])
def test_nothing_is_said_of_what_is_right(found: list[Finding], name: str) -> None:
    assert [each.message for each in found if name in each.message] == []


@pytest.mark.parametrize("name", ["tipped", "borne"])
def test_nothing_is_said_of_what_is_right_alone(tmp_path: Path, name: str) -> None:
    assert analyzed(tmp_path, name) == []


def test_a_turn_from_a_quaternion_of_zeros_is_explained(tmp_path: Path) -> None:
    analysis = analyze(recorded(tmp_path, "turning"))
    assert (analysis.findings, analysis.explained.why) == ([], None)


def test_a_force_of_several_points_is_that_of_the_pair(found: list[Finding]) -> None:
    model = mujoco.MjModel.from_xml_string(MODELS["pedestal"].text)
    data, most, force = mujoco.MjData(model), 0.0, np.zeros(6)
    data.ctrl[0] = 0.6
    for _ in range(MODELS["pedestal"].steps):
        mujoco.mj_step(model, data)
        total = 0.0
        for k in range(data.ncon):
            mujoco.mj_contactForce(model, data, k, force)
            total += force[0]
        most = max(most, total)
    (said,) = (each.message for each in found if each.code == "static-parent")
    assert f"up to {most:.0f} N" in said


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "barely",
            r"^hinge turns around with every step, 1\.05 times .* 7\.43e\+05 rad/s, by actuator m",
        ),
        ("held", r"^hinge turns around every 10 steps, 3\.25 times .* by actuator m$"),
        (
            "sign",
            r"^hinge turns around every 4\d steps, 1\.7\d? times .* \S+ rad/s, by actuator m$",
        ),
        ("at_once", r"^hinge turns around with every step and grows, .* has kv h/I = 55"),
        (
            "both",
            r"^hinge .* either gain alone makes it grow, kp = 5e\+03 .* = 111 and kv = 1 w",
        ),
        ("rope", r"^hinge turns around with every step, .* by the spring and damper of tendon t"),
    ],
)
def test_what_explodes_is_told_what_turns_it(tmp_path: Path, name: str, words: str) -> None:
    said = [each for each in analyzed(tmp_path, name) if each.code == "unstable"]
    assert [each for each in said if re.search(words, each.message)], said
    assert [each.level for each in said] == ["model" if name == "sign" else "broken"]


def test_two_jolts_before_a_reset_are_no_instability(tmp_path: Path) -> None:
    assert [each.code for each in analyzed(tmp_path, "jolted")] == ["auto-reset"]


@pytest.mark.parametrize(
    ("name", "code", "level", "proposed"),
    [
        ("decimated", "target-clamped", "model", True),
        ("lift", "off-target", "note", False),
        ("again", "reset-leaves", "note", True),
        ("wind", "push-stays", "model", True),
    ],
)
def test_what_nothing_may_hang_on_is_said_with_less_weight(
    tmp_path: Path, name: str, code: str, level: str, *, proposed: bool
) -> None:
    (said,) = analyzed(tmp_path, name)
    assert (said.code, said.level, said.proposed) == (code, level, proposed)
    assert not re.search("once|had before", said.message)


def test_each_number_that_is_advised_holds_in_all_poses(tmp_path: Path) -> None:
    found = analyzed(tmp_path, "arm")
    (advice,) = (str(each.advice) for each in found if each.joint == "elbow" and each.advice)
    told = {
        "kv": re.search(r"kv below (\S+)", advice),
        "timestep": re.search(r"timestep below (\S+) ms", advice),
        "armature": re.search(r"armature above (\S+)", advice),
    }
    for name, number in told.items():
        assert number is not None
        value = float(number[1]) * (1e-3 if name == "timestep" else 1)
        changed = {**ARM, name: value}
        model = mujoco.MjModel.from_xml_string(
            Model(TWO.format(**changed), TWO_SERVOS.format(**changed)).text
        )
        data = mujoco.MjData(model)
        data.ctrl[:] = -0.2, 0.3
        while data.time < 3:
            mujoco.mj_step(model, data)
        assert np.abs(data.qvel).max() < 1e-6, name


def test_a_bullet_that_touches_a_wall_and_passes_is_told_what_stops_it(tmp_path: Path) -> None:
    (finding,) = analyzed(tmp_path, "bullet")
    assert re.search(r"^\d_bullet passes through .* although they touch", finding.message)
    advice = re.fullmatch(
        r'timestep/(\d+) with solref="(\S+) 1" of both <geom>s', finding.advice or ""
    )
    assert advice is not None
    text = BULLET.format(float(advice[2])), TIMED.format(5e-5 / float(advice[1]))
    model = mujoco.MjModel.from_xml_string(Model(*text).text)
    data = mujoco.MjData(model)
    data.qvel[0] = 200
    while data.time < 0.01:
        mujoco.mj_step(model, data)
    assert data.qpos[0] < 0.2


def test_a_creep_is_told_from_when_the_grip_has_closed(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(SINGLE["grip0"].text)
    data = mujoco.MjData(model)
    data.ctrl[:] = 15, 15
    for _ in range(500):
        mujoco.mj_step(model, data)
    (finding,) = analyzed(tmp_path, "grip0")
    speed = re.search(r"creeps \S+ mm .* (\S+) mm/s", finding.message)
    assert speed is not None
    assert float(speed[1]) == pytest.approx(-1e3 * data.body("block").cvel[5], rel=0.03)


def test_what_slips_while_a_grip_closes_is_no_creep(tmp_path: Path) -> None:
    assert analyzed(tmp_path, "grip10") == []


# -- numbers that hold ----------------------------------------------------------------------------

# A hill of 2 m on a field of 8 m: a box in it is inside of many prisms, whose normals oppose.
X, Y = np.meshgrid(*[np.linspace(-1, 1, 32)] * 2)
HILL = " ".join(f"{height:.6f}" for height in np.exp(-3 * (X**2 + Y**2)).ravel())
FIELD = f"""<asset><hfield name="field" nrow="32" ncol="32" size="4 4 2 .1" elevation="{HILL}"/>
</asset>"""
LYING = '<geom type="hfield" hfield="field"/>'
SINGLE |= {
    "stuck": Model(
        LYING + box("stuck", 0.5, 0.15, 3).replace("0.15 0.15 0.15", ".2 .15 .08"), FIELD, steps=600
    ),
    "tower": Model(FLOOR + "".join(box(f"b{k}", 0.1 + 0.1 * k, 0.1, 0.5) for k in range(4))),
    "beside": Model(
        '<geom type="box" size=".1 1 1" pos="0 0 1"/>'
        + box("beside", 1, 0.13, 1).replace('"0 0 1"', '".15 0 1"'),
    ),
    "brake": Model(
        HINGE,
        '<actuator><damper joint="hinge" kv="2" ctrlrange="0 5"/></actuator>',
        "d.ctrl[0] = -1",
    ),
    # Nothing but a call presses on it.
    "shoved": Model(
        FLOOR + box("shoved", 0.1, 0.1, 0.5), drive="d.xfrc_applied[1, 2] = -2000", steps=800
    ),
    # Fingers from both sides: their forces cancel, and the block weighs nothing.
    "pinched": Model(
        HAND.replace('mass=".05"', 'mass=".05" solref=".1 1" priority="1"').replace(
            "slide", 'slide" damping="20'
        )
        + box("block", 0.2, 0.025, 0.2),
        '<option gravity="0 0 0"/><actuator><motor joint="l"/><motor joint="r"/></actuator>',
        "d.ctrl[:] = 3, 3",
        1500,
    ),
    "weightless": Model(box("weightless", 1, 0.1, 1), '<option gravity="0 0 0"/>'),
}
SOLVED = """
import mujoco
import numpy as np
m = mujoco.MjModel.from_xml_string({text!r})
d = mujoco.MjData(m)
for k in range({calls}):
    d.qpos[0] = {target}
    mujoco.{function}(m, d)
"""


@pytest.mark.parametrize("name", ["stuck", "beside"])
def test_what_is_inside_is_not_lifted_by_a_depth_that_is_not_up(tmp_path: Path, name: str) -> None:
    said = analyzed(tmp_path, name)
    assert [each.advice for each in said if each.code == "starts-in-contact"] == [None], said
    assert not [each for each in said if each.code == "deep-penetration"], said


def test_a_load_that_no_body_makes_asks_for_no_mass(tmp_path: Path) -> None:
    said = analyzed(tmp_path, "shoved")
    assert not [each for each in said if each.code == "deep-penetration"], said


def test_a_grip_has_no_load_that_one_number_tells(tmp_path: Path) -> None:
    (finding,) = (each for each in analyzed(tmp_path, "pinched") if each.code == "deep-penetration")
    assert re.search(r"mm into \S+: their contact has solref 0\.1 1", finding.message)


def test_of_a_chain_of_overlaps_no_height_is_said(tmp_path: Path) -> None:
    said = [each for each in analyzed(tmp_path, "tower") if each.code == "starts-in-contact"]
    advices = {str(each.advice) for each in said}
    assert advices == {"a <geom>'s size is half of its length, or its radius"}


def test_a_damper_keeps_its_range(tmp_path: Path) -> None:
    (finding,) = (each for each in analyzed(tmp_path, "brake") if each.code == "target-clamped")
    assert finding.advice == "give it a ctrl of 0 to 5"
    assert finding.cure is None


def test_gravity_that_a_model_gives_as_0_is_a_note(tmp_path: Path) -> None:
    assert [(each.code, each.level) for each in analyzed(tmp_path, "weightless")] == [
        ("no-gravity", "note")
    ]


@pytest.mark.parametrize("function", ["mj_kinematics", "mj_forward"])
@pytest.mark.parametrize(("target", "codes"), [("min(k, 20) / 20", []), ("0.5", ["not-stepped"])])
def test_positions_that_a_script_computes_wait_for_no_step(
    tmp_path: Path, function: str, target: str, codes: list[str]
) -> None:
    script = tmp_path / "solved.py"
    text = SOLVED.format(text=Model(HINGE).text, calls=60, target=target, function=function)
    script.write_text(text, encoding="utf-8")
    found = analyze(record_script(str(script), out=tmp_path / "run.rrd").recording).findings
    assert [each.code for each in found] == codes
