"""The contents of a recorded MuJoCo script.

Verification: where links are, by our own kinematics from what was recorded, against MuJoCo's own
`xipos`; what was set, by which line; and that the script prints the same as without us.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Drop, some
from drop_physics.recording.reader import Recording, read
from drop_physics.stages.info import info
from drop_physics.stages.record import Recorded, ReplayedSteps, record_script
from mujoco_scripts import bare

SCENE = """
import json, mujoco, numpy as np
XML = '''<mujoco><asset><mesh name="wedge" vertex="0 0 0 .2 0 0 0 .2 0 0 0 .2"/></asset>
<worldbody><geom type="plane" size="5 5 1"/>
<body name="box" pos="0 0 0.15"><freejoint/>
<geom type="box" size="0.1 0.1 0.1" pos="0.01 0 0" euler="0 30 0"/><geom type="mesh" mesh="wedge"/>
</body>
<body name="stand" pos="1 0 0.4" euler="0 0 20"><geom type="cylinder" size="0.1 0.1"/>
<body name="arm" pos="0 0 0.6"><joint name="j" axis="0 1 0" ref="0.3"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/>
<body name="two" pos="0.3 0 0"><joint name="a" type="slide" axis="1 0 0" ref="0.02" pos="0 0 .02"/>
<joint name="b" type="ball" pos="0.01 0.02 0"/>
<geom type="box" size="0.1 0.02 0.03" pos="0.05 0.02 0.02" euler="10 20 30"/>
<body name="three" pos="0.1 0 0"><geom type="ellipsoid" size="0.03 0.04 0.05"/></body></body></body>
</body>
<body name="cart" pos="0 2 0.2" euler="0 0 45"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="tilt" axis="0 1 0" pos="0.1 0 0"/><geom size="0.1" pos="0 0 0.2"/></body>
<body name="hand" mocap="true" pos="0 -2 0.2"><geom size="0.05"/></body>
</worldbody>
<actuator><position name="p" joint="j" kp="20" forcerange="-3 3"/></actuator>
<keyframe><key name="lifted" qpos="0 0 0.3 1 0 0 0 0.5 0 1 0 0 0 0 0" ctrl="0.5"/></keyframe>
</mujoco>'''
m = mujoco.MjModel.from_xml_string(XML)
d = mujoco.MjData(m)
d.qvel[:] = 0.5 * np.random.default_rng(1).standard_normal(m.nv)
places = []
def look():
    other = mujoco.MjData(m)
    other.qpos[:], other.mocap_pos[:] = d.qpos, d.mocap_pos
    mujoco.mj_kinematics(m, other)
    places.append(other.xipos.tolist())
"""
DRIVEN = """
for k in range(60):
    look()
    d.ctrl[0] = 0.1 * k
    if k == 20:
        d.qpos[2] = 0.5
    if k == 30:
        m.opt.timestep = 0.001
        m.body_mass[1] = 3
    if k == 40:
        d.mocap_pos[0, 0] = 0.3
    mujoco.mj_step(m, d)
mujoco.mj_resetDataKeyframe(m, d, 0)
mujoco.mj_step(m, d, 10)
look()
print(json.dumps(places))
"""
KEPT = 60
"""Number of steps in which the script reads the bodies' positions."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recorded, str]:
    folder = tmp_path_factory.mktemp("recorded")
    script = folder / "driven.py"
    script.write_text(SCENE + DRIVEN)
    with (folder / "printed.txt").open("wb") as printed:
        found = record_script(str(script), out=folder / "run.rrd", stdout=printed.fileno())
    return found, (folder / "printed.txt").read_text()


@pytest.fixture(scope="module")
def held(recorded: tuple[Recorded, str]) -> Recording:
    return read(recorded[0].recording)


def test_the_script_prints_the_same(recorded: tuple[Recorded, str], tmp_path: Path) -> None:
    alone = bare(tmp_path, SCENE + DRIVEN)
    assert alone.stdout == recorded[1]
    assert recorded[0].ended == "finished"
    assert recorded[0].samples == 71
    assert not [*recorded[0].recording.parent.glob("*.part")]


def test_links_are_where_mujoco_has_them(recorded: tuple[Recorded, str], held: Recording) -> None:
    """Recorded poses equal MuJoCo's, for several joints per body, ball joints and mocap bodies."""
    places = np.array(json.loads(recorded[1]))
    numbers = {body.name: number for number, body in held.seen.bodies.items()}
    states, puts = held.seen.states, held.seen.puts
    names = ["world", "box", "stand", "arm", "two", "three", "cart", "hand"]
    for name in ("box", "arm", "two", "three", "cart"):
        body = held.seen.bodies[numbers.get(name, numbers["stand"])]
        link = body.links.index(name) - 1
        rows = states[(states["body"] == body.number) & (states["link"] == link)]
        for k in range(KEPT):
            (row,) = rows[rows["step"] == k]
            np.testing.assert_allclose(row["position_m"], places[k, names.index(name)], atol=1e-14)
        np.testing.assert_allclose(
            rows[-1]["position_m"], places[-1, names.index(name)], atol=1e-14
        )
    hand = [put for put in puts if put.body.name == "hand"]
    assert [put.at.step for put in hand] == [0, 40, 60]
    np.testing.assert_array_equal(hand[1].base[:3], places[41, names.index("hand")])


def test_velocities_are_those_of_centres_of_mass(held: Recording) -> None:
    """Semi-implicit Euler moves a free base by its new velocity, apart from its spin's share."""
    box = next(number for number, body in held.seen.bodies.items() if body.name == "box")
    base = held.seen.bases[held.seen.bases["body"] == box][5:15]
    moved = np.diff(base["position_m"], axis=0)
    # The centre of mass is off the frame's origin, about which MuJoCo turns it: an arm of 0.03 m.
    np.testing.assert_allclose(moved / 0.002, base["velocity_m_s"][1:], atol=2e-4)


def test_what_was_set_is_told_with_its_line(held: Recording) -> None:
    text = (SCENE + DRIVEN).splitlines()
    step = 1 + next(k for k, line in enumerate(text) if line == "    mujoco.mj_step(m, d)")
    reset = 1 + next(k for k, line in enumerate(text) if "resetDataKeyframe" in line)
    calls = [
        (call.function, call.arguments, call.site.place, call.at.step)
        for call in held.seen.calls
        if call.function != "ctrl"
    ]
    assert calls == [
        ("qpos", "[2]=0.5", f"driven.py:{step}", 20),
        ("body_mass", calls[1][1], f"driven.py:{step}", 30),
        ("opt.timestep", "0.001, was 0.002", f"driven.py:{step}", 30),
        ("mocap_pos", "[0]=0.3", f"driven.py:{step}", 40),
        ("mj_resetDataKeyframe", "key=0", f"driven.py:{reset}", 60),
    ]
    assert calls[1][1].startswith("[1]=3.0 was ")
    driven = [call for call in held.seen.calls if call.function == "ctrl"]
    assert [(call.at.step, call.numbers) for call in driven[:2]] == [(1, (0.1,)), (2, (0.2,))]
    assert [each.values["fixedTimeStep"] for each in held.seen.settings] == [0.002, 0.001]
    masses = {
        (each.at.step, each.body.name): each.reported["mass_kg"].tolist()
        for each in held.seen.dynamics
    }
    assert masses[30, "box"] == [3.0]
    assert masses[0, "stand"][0] == 0.0, "what stands has no mass to move"


def test_a_recording_says_what_made_it(recorded: tuple[Recorded, str]) -> None:
    import mujoco

    told = info(recorded[0].recording)
    assert told.engine.startswith(f"MuJoCo {mujoco.__version__} in Python ")
    assert told.samples == 71
    np.testing.assert_allclose(told.duration_s, 30 * 0.002 + 40 * 0.001)
    assert told.bodies[0] == "0_world, held still"


def test_actuators_and_shapes_are_described(held: Recording) -> None:
    stand = next(body for body in held.seen.bodies.values() if body.name == "stand")
    (servo,) = stand.actuators
    assert (servo.name, servo.kind, servo.target, servo.kp) == ("p", "position", "j", 20.0)
    assert servo.force_range == (-3.0, 3.0)
    assert [joint.kind for joint in stand.joints] == [
        "revolute",
        "prismatic",
        "spherical",
        "fixed",
    ]
    box = next(body for body in held.seen.bodies.values() if body.name == "box")
    assert [shape.kind for shape in box.shapes] == ["box", "mesh"]
    assert len(box.collisions[1].hull_m) == 12


BOTH = """
import pybullet as p, mujoco
p.connect(p.DIRECT)
p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1))
m = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>')
d = mujoco.MjData(m)
def bullet():
    for _ in range(10): p.stepSimulation()
def muj():
    for _ in range(20): mujoco.mj_step(m, d)
"""
INTEGRATES = """
import mujoco
m = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>')
d = mujoco.MjData(m)
for _ in range(5):
    d.qpos[2] -= 0.1
    mujoco.mj_forward(m, d)
"""


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("text", "samples", "said"),
    [
        (INTEGRATES, 0, "positions change between 5 calls of mj_forward"),
        (
            f"{BOTH}import mujoco.rollout\nbullet()\nstate = [0] * 14\n"
            "mujoco.rollout.rollout(m, d, state, nstep=2)",
            11,
            "mujoco.rollout.rollout",
        ),
    ],
    ids=["own-integration", "rollout-beside-pybullet"],
)
def test_what_is_not_recorded_is_said(tmp_path: Path, text: str, samples: int, said: str) -> None:
    script, notes = tmp_path / "script.py", list[str]()
    script.write_text(text)
    found = record_script(str(script), out=tmp_path / "run.rrd", stdout=2, note=notes.append)
    assert found.samples == samples
    assert len([note for note in notes if said in note]) == 1
    read(found.recording)


@pytest.mark.pybullet
@pytest.mark.parametrize("first", some(["PyBullet", "MuJoCo"], 1))
def test_a_script_that_steps_two_engines_has_a_recording_of_each(
    tmp_path: Path, drop: Drop, monkeypatch: pytest.MonkeyPatch, first: str
) -> None:
    monkeypatch.chdir(tmp_path)
    calls = {"PyBullet": "bullet()", "MuJoCo": "muj()"}
    (other,) = {*calls} - {first}
    tmp_path.joinpath("script.py").write_text(
        f"{BOTH}{calls[first]}; {calls[other]}; bullet(); muj()\n"
        "print(p.getBasePositionAndOrientation(0)[0][2], d.qpos[2])"
    )
    text = tmp_path.joinpath("script.py").read_text()
    first_time, again = (json.loads(drop("record", "--json", "script.py").stdout) for _ in "ab")
    assert first_time["beside"]["recording"] == again["beside"]["recording"], "it is replaced"
    assert [again["samples"], again["beside"]["samples"]] == (
        [21, 41] if first == "PyBullet" else [41, 21]
    )
    ends = {}
    for found in (again, again["beside"]):
        held = read(Path(found["recording"])).seen
        assert len(held.bodies) == 1
        ends[held.engine.split()[0]] = float(held.bases["position_m"][-1, 2])
        assert ("replay" in found) == held.engine.startswith("MuJoCo")
    printed = [float(each) for each in bare(tmp_path, text).stdout.split()[-2:]]
    assert [ends["PyBullet"], ends["MuJoCo"]] == printed
    both = drop("script.py")
    assert both.stdout.count("script.py finished: 1 body, ") == 2, "both are analyzed"
    note = f"the script steps {first} and {other}: {other} has a recording of its own"
    assert note in " ".join(both.stderr.split())


@pytest.mark.long
@pytest.mark.pybullet
def test_the_steps_of_both_engines_are_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second run steps both engines equally often; the engine whose states differ is named."""
    monkeypatch.chdir(tmp_path)
    script = tmp_path / "script.py"
    notes: list[str] = []
    for drawn, differs in (("0.0", None), ("os.urandom(1)[0] + os.getpid()", 21)):
        script.write_text(f"import os\n{BOTH}bullet(); muj(); d.qvel[2] = {drawn}; bullet(); muj()")
        found = record_script("script.py", twice=True, stdout=2, note=notes.append)
        assert (found.twice, found.first_difference) == (True, differs)
    assert "recorded twice: every state is the same to the bit" in notes
    assert "the states that differ are those of MuJoCo" in notes


@pytest.mark.pybullet
@pytest.mark.long
def test_trust_and_why_say_that_they_compare_one_engine_of_two(
    tmp_path: Path, drop: Drop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their runs are stopped by that engine's steps, and so make all of them."""
    monkeypatch.chdir(tmp_path)
    tmp_path.joinpath("script.py").write_text(f"{BOTH}muj(); bullet(); muj()")
    said = drop("trust", "--vary", "nudge", "script.py")
    assert "the script steps two engines: only MuJoCo" in " ".join(said.stderr.split())
    kept = {path.stem: read(path) for path in Path("recordings/script-trust").glob("*.rrd")}
    assert len(kept) == 2
    assert {sum(each.seen.samples.values()) for each in kept.values()} == {41}
    said = drop("why", "--try", "gravity=-9", "--jobs", "1", "script.py")
    assert "the script steps two engines: only MuJoCo" in " ".join(said.stderr.split())


def test_an_edit_in_each_step_takes_its_own_bytes_alone(tmp_path: Path) -> None:
    """The samples are not cut into chunks of one step, and each edit applies from its step on."""
    script = tmp_path / "script.py"
    script.write_text(
        RANDOMISED.partition("for mass")[0] + "for k in range(100):\n"
        "    m.geom_friction[0, 0] = 1 + k\n"
        "    mujoco.mj_step(m, d)\n"
    )
    found = record_script(str(script), out=tmp_path / "run.rrd", stdout=2)
    assert found.replay == ReplayedSteps(100, 100, 100, pytest.approx(0, abs=1e-12))
    seen = read(found.recording).seen
    assert [told.at.step for told in seen.dynamics] == [0, *range(1, 100)]
    assert [told.reported["lateral_friction"][0] for told in seen.dynamics] == [*range(1, 101)]
    assert found.bytes < 250_000


@pytest.mark.long
def test_a_chain_of_hundreds_of_links_is_recorded(tmp_path: Path) -> None:
    """Entity paths of links nested one below the other would be too long to read."""
    link = '<body pos="0 .1 0"><joint/><geom size=".02" contype="0" conaffinity="0"/>'
    script = tmp_path / "script.py"
    script.write_text(
        "import mujoco\n"
        f"m = mujoco.MjModel.from_xml_string('<mujoco><worldbody>{link * 400}{'</body>' * 400}"
        "</worldbody></mujoco>')\nmujoco.mj_step(m, mujoco.MjData(m))"
    )
    found = record_script(str(script), out=tmp_path / "run.rrd", stdout=2)
    assert found.replay == ReplayedSteps(1, 1, 1, pytest.approx(0, abs=1e-11))
    (body,) = read(found.recording).seen.bodies.values()
    assert len(body.links) == 401


def test_names_may_be_longer_than_an_entity_s(tmp_path: Path) -> None:
    """A chain of links with long names is nested, as deep as it has links."""
    deep = 64
    links = "".join(
        f'<body name="{number}{"n" * 6000}" pos="0 .1 0"><joint/><geom size=".02" contype="0"/>'
        for number in range(deep)
    )
    script = tmp_path / "script.py"
    script.write_text(
        "import mujoco\n"
        f"m = mujoco.MjModel.from_xml_string('<mujoco><worldbody>{links}{'</body>' * deep}"
        "</worldbody></mujoco>')\nmujoco.mj_step(m, mujoco.MjData(m))"
    )
    found = record_script(str(script), out=tmp_path / "run.rrd", stdout=2)
    (body,) = read(found.recording).seen.bodies.values()
    assert [name.rstrip("n") for name in body.links[1:]] == [*map(str, range(deep))]


@pytest.mark.long
def test_recordings_are_compared_to_the_bit(recorded: tuple[Recorded, str], tmp_path: Path) -> None:
    from drop_physics.stages.check import check

    script = tmp_path / "driven.py"
    script.write_text(SCENE + DRIVEN)
    with (tmp_path / "printed.txt").open("wb") as printed:
        again = record_script(
            str(script), out=tmp_path / "again.rrd", stdout=printed.fileno(), explain=False
        )
        script.write_text((SCENE + DRIVEN).replace("0.1 * k", "0.1 * k + 1e-9 * (k == 1)"))
        other = record_script(str(script), out=tmp_path / "other.rrd", stdout=printed.fileno())
    golden = recorded[0].recording
    assert check(again.recording, golden).same
    found = check(other.recording, golden)
    assert found.first is not None
    assert (found.first.step, found.first.body) == (2, "2_stand")
    assert found.comparison is not None
    assert found.comparison.other_call is not None
    assert found.comparison.other_call.value is not None
    assert found.comparison.other_call.value.function == "ctrl"


RANDOMISED = """
import mujoco
m = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>'
    '</worldbody></mujoco>')
d = mujoco.MjData(m)
for mass in (0.5, 2.0):
    m.body_mass[1] = mass
    mujoco.mj_setConst(m, mujoco.MjData(m))
    mujoco.mj_resetData(m, d)
    mujoco.mj_step(m, d, 5)
"""


def test_edits_that_another_state_of_the_model_saw_count(tmp_path: Path) -> None:
    """`mj_setConst` with separate data is the first call that sees an edited mass."""
    script = tmp_path / "script.py"
    script.write_text(RANDOMISED)
    found = record_script(str(script), out=tmp_path / "run.rrd", stdout=2)
    seen = read(found.recording).seen
    masses = [(each.at.step, each.reported["mass_kg"].tolist()) for each in seen.dynamics]
    assert masses == [(0, [0.5]), (5, [2.0])]
    told = [call for call in seen.calls if call.function == "body_mass"]
    assert [(call.at.step, call.numbers[1]) for call in told] == [(5, 2.0)]


MESHES = """
import mujoco
mesh = (
    '<mesh name="m" inertia="shell" vertex="0 0 0  0 1 0  {0} 0 {0}  {0} 1 {0}  -{0} 0 {0}'
    '  -{0} 1 {0}" face="0 1 2  1 3 2  0 4 1  1 4 5"/>'
)
body = '<body><freejoint/><geom type="mesh" mesh="m"/></body>'
for size in (1, 3):
    m = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{mesh.format(size)}</asset><worldbody>{body}</worldbody></mujoco>")
    mujoco.mj_step(m, mujoco.MjData(m))
"""


def test_meshes_of_one_name_in_two_models_are_each_its_own(tmp_path: Path) -> None:
    """A valley of two faces is 1 m long; in one model it is 2 m wide, in the other 6 m."""
    (tmp_path / "script.py").write_text(MESHES)
    record_script(str(tmp_path / "script.py"), out=tmp_path / "run.rrd")
    surfaces = read(tmp_path / "run.rrd").seen.surfaces
    widths_m = [np.ptp(surface.corners_m, axis=0).max() for surface in surfaces]
    assert np.allclose(widths_m, [2.0, 6.0], atol=1e-5)
