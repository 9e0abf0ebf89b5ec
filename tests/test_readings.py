"""Reads that scripts make of the engine's state: the recorded ones match a hand-written list.

Verification: of each place its function, line, arguments, flags, what it reads, how often, and from
which step to which.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import scripts
from drop_physics import check, info, record_script
from drop_physics.recording import reader
from drop_physics.trace.events import Calls, Event, Raised, Samples, Site
from drop_physics.trace.readings import Lens, Reading
from watching import bare, blocks, watched

pytestmark = pytest.mark.pybullet

ARM = scripts.HEAD + 'arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)\n'
BOX = 'box = p.loadURDF("cube_small.urdf", [2, 0, 1])\n'
EXACT, SHARE, GROUP = 256, 61, 4
"""The first EXACT steps are checked one by one; later ones in groups of GROUP steps, of which one
in SHARE is checked."""


def readings(events: list[Event]) -> dict[str, Reading]:
    """Return the recorded reads by function; each function is called at one place in the script."""
    found = [event for event in events if isinstance(event, Reading)]
    assert [each.number for each in found] == [*range(len(found))]
    by_function = {each.function: each for each in found}
    assert len(by_function) == len(found)
    return by_function


def line_of(text: str, mark: str) -> int:
    (line,) = [number for number, line in enumerate(text.splitlines(), 1) if mark in line]
    return line


def parts(reading: Reading) -> list[list[tuple[int, int | None]]]:
    """Return the one or two subjects of a read, as bodies with links."""
    found = []
    for target in reading.targets:
        pair = [] if target.other is None else [(target.other, target.other_link)]
        found.append([(target.body, target.link), *pair])
    return found


def test_what_was_read_and_how_often(tmp_path: Path) -> None:
    text = (
        ARM
        + BOX
        + """
joints = range(p.getNumJoints(arm))
for j in joints:
    p.getJointInfo(arm, j)  # info
for i in range(20):
    p.stepSimulation()
    p.getJointStates(arm, [0, 3])  # states
    p.getLinkState(bodyUniqueId=arm, linkIndex=6, computeForwardKinematics=True)  # link
    if i % 5 == 2:
        p.getContactPoints(arm, box, 6)  # contacts
        p.getClosestPoints(bodyA=box, bodyB=arm, distance=0.1)  # closest
p.getEulerFromQuaternion([0, 0, 0, 1])  # angles
p.rayTest([0, 0, 0], [1, 1, 1], reportHitNumber=2)  # ray
p.getAABB(arm)  # box
"""
    )
    events, ending, _ = watched(tmp_path, text)
    found = readings(events)
    assert ending.notes == []
    assert all(each.exact and each.complete for each in found.values())
    assert all((each.file, each.client) == ("script.py", 0) for each in found.values())

    def one(function: str, mark: str) -> tuple[Any, ...]:
        each = found.pop(function)
        assert each.line == line_of(text, mark)
        flags = dict(each.flags)
        return each.arguments, flags, parts(each), each.first_step, each.last_step, each.count

    body, links = ("bodyUniqueId",), [[(0, j)] for j in range(7)]
    assert one("getNumJoints", "joints =") == (body, {}, [[(0, None)]], 0, 0, 1)
    assert one("getJointInfo", "# info") == ((*body, "jointIndex"), {}, links, 0, 0, 7)
    states = ((*body, "jointIndices"), {}, [[(0, 0)], [(0, 3)]], 1, 20, 20)
    assert one("getJointStates", "# states") == states
    kinematics = {"computeForwardKinematics": 1}
    link = ((*body, "linkIndex", *kinematics), kinematics, [[(0, 6)]], 1, 20, 20)
    assert one("getLinkState", "# link") == link
    pair = [[(0, 6), (1, None)]]
    contacts = (("bodyA", "bodyB", "linkIndexA"), {}, pair, 3, 18, 4)
    assert one("getContactPoints", "# contacts") == contacts
    closest = (("bodyA", "bodyB", "distance"), {}, [[(1, None), (0, None)]], 3, 18, 4)
    assert one("getClosestPoints", "# closest") == closest
    assert one("getEulerFromQuaternion", "# angles") == (("quaternion",), {}, [], 20, 20, 1)
    ray = ("rayFromPosition", "rayToPosition", "reportHitNumber")
    assert one("rayTest", "# ray") == (ray, {"reportHitNumber": 2}, [], 20, 20, 1)
    assert one("getAABB", "# box") == (body, {}, [[(0, None)]], 20, 20, 1)
    assert found == {}


def test_places_are_lines_and_forms(tmp_path: Path) -> None:
    text = (
        ARM
        + """
def state(link, **how):
    return p.getLinkState(arm, link, **how)  # both
for i in range(6):
    p.stepSimulation()
    state(6, computeForwardKinematics=i % 2)
    state(i, computeForwardKinematics=0)
    p.getJointState(arm, 0), p.getJointState(arm, 1)  # two on a line
    p.getJointState(arm, 0)  # another
"""
    )
    events, *_ = watched(tmp_path, text)
    found = [event for event in events if isinstance(event, Reading)]
    both, line, another = (line_of(text, mark) for mark in ("# both", "# two", "# another"))
    links = [[(0, j)] for j in (6, 0, 1, 2, 3, 4, 5)]
    assert [(each.line, each.count, dict(each.flags), parts(each)) for each in found] == [
        (both, 9, {"computeForwardKinematics": 0}, links),
        (line, 12, {}, [[(0, 0)], [(0, 1)]]),
        (another, 6, {}, [[(0, 0)]]),
        (both, 3, {"computeForwardKinematics": 1}, [[(0, 6)]]),
    ]


def test_what_reads_all_the_time_is_counted_in_a_sample_of_steps(tmp_path: Path) -> None:
    text = (
        ARM
        + BOX
        + """
def pose(body):
    return p.getBasePositionAndOrientation(body)
for i in range(5000):
    p.stepSimulation()
    for j in range(3):
        p.getJointState(arm, j)
    p.getJointStates(arm, [1, 2])
    pose(box)
    if i % 2:
        p.getLinkState(arm, 6)
    if i % 10 == 0:
        p.getBaseVelocity(box)
    if i == 4321:
        p.getAABB(box)
        print(p.getJointState(arm, 6)[0])  # late
print(pose(box)[0][2], p.getBasePositionAndOrientation(box)[1])  # last
"""
    )
    events, _, printed = watched(tmp_path, text)
    assert printed == bare(tmp_path, text).stdout
    found = [event for event in events if isinstance(event, Reading)]
    lines = {(each.function, each.line): each for each in found}
    joint, pose, every_second = (
        next(each for each in found if each.function == name)
        for name in ("getJointState", "getBasePositionAndOrientation", "getLinkState")
    )
    for each, count in ((joint, 15_000), (pose, 5_001), (every_second, 2_500)):
        assert not each.exact
        # What follows the last group of steps, and what groups of four steps miss of a period.
        assert abs(each.count - count) <= GROUP * SHARE * count / 5000
        assert each.first_step <= 2
        assert 0 <= 5000 - each.last_step <= GROUP * SHARE
    assert parts(joint) == [[(0, j)] for j in range(3)]
    by_function = {each.function: each for each in found}
    for name, count in (("getBaseVelocity", 500), ("getAABB", 1)):  # rarely, and so always seen
        assert (by_function[name].exact, by_function[name].count) == (True, count)
    late = lines["getJointState", line_of(text, "# late")]
    assert (late.count, late.first_step, late.last_step, parts(late)) == (1, 4322, 4322, [[(0, 6)]])
    last = lines["getBasePositionAndOrientation", line_of(text, "# last")]
    assert (last.count, last.first_step) == (1, 5000)


def test_bodies_are_those_of_the_recording(tmp_path: Path) -> None:
    """Bodies may be read before the first step, and ids may be reused after a reset."""
    text = (
        scripts.HEAD
        + """
def look(body):
    return p.getBaseVelocity(body)
for name in ("cube_small.urdf", "sphere_small.urdf", "cube_small.urdf"):
    look(p.loadURDF(name))
    p.stepSimulation()
    p.resetSimulation()
gone = p.loadURDF("cube_small.urdf")
p.getNumJoints(gone)
p.removeBody(gone)
p.resetSimulation()
p.loadURDF("sphere_small.urdf")
p.stepSimulation()
"""
    )
    events, *_ = watched(tmp_path, text)
    found = readings(events)
    assert parts(found["getBaseVelocity"]) == [[(0, None)], [(1, None)]]
    assert found["getBaseVelocity"].complete
    # A body that came and went between two steps is not known.
    assert (parts(found["getNumJoints"]), found["getNumJoints"].complete) == ([], False)


def test_simulations_and_constraints_are_told_apart(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + BOX
        + """
from pybullet_utils.bullet_client import BulletClient
q = BulletClient(p.DIRECT)
q.setAdditionalSearchPath(pybullet_data.getDataPath())
ball = q.loadURDF("sphere_small.urdf")
held = p.createConstraint(box, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [2, 0, 1])
for i in range(8):
    p.stepSimulation()
    for client in (p, q):
        client.getBaseVelocity(0)
    if i % 2:
        q.stepSimulation()
    p.getConstraintState(held)
"""
    )
    events, *_ = watched(tmp_path, text)
    found = [event for event in events if isinstance(event, Reading)]
    base = [each for each in found if each.function == "getBaseVelocity"]
    assert [(each.client, each.count, each.last_step, parts(each)) for each in base] == [
        (0, 8, 8, [[(0, None)]]),
        (1, 8, 3, [[(1, None)]]),
    ]
    (constraint,) = [each for each in found if each.function == "getConstraintState"]
    assert (constraint.constraints, constraint.targets) == ((1,), ())


def test_pictures_tell_their_first_matrices(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + """
view = p.computeViewMatrix([1, 1, 1], [0, 0, 0], [0, 0, 1])
for far in (5, 9):
    lens = p.computeProjectionMatrixFOV(60, 1.5, 0.25, far)
    p.getCameraImage(6, 4, view, lens, renderer=p.ER_TINY_RENDERER)
print(view)
"""
    )
    events, _, printed = watched(tmp_path, text)
    camera = readings(events)["getCameraImage"]
    assert (camera.count, camera.exact) == (2, True)
    assert camera.camera is not None
    assert camera.camera.size_px == (6, 4)
    assert camera.camera.view == tuple(map(float, printed.strip("()\n").split(", ")))
    assert camera.camera.near_far_m == pytest.approx((0.25, 5), rel=1e-5)  # float32 in PyBullet


def test_near_and_far_follow_from_the_matrix() -> None:
    near, far = 0.25, 5.0
    lens = [0.0] * 16
    lens[10], lens[11], lens[14] = -(far + near) / (far - near), -1, -2 * far * near / (far - near)
    parallel = [0.0] * 16
    parallel[10], parallel[14], parallel[15] = -2 / (far - near), -(far + near) / (far - near), 1
    for matrix in (lens, parallel):
        assert Lens((), (), tuple(matrix)).near_far_m == pytest.approx((near, far))
    for wrong in ((), (0.0,) * 16, (*lens[:10], 1.0, *lens[11:])):
        assert Lens((), (), wrong).near_far_m is None


def test_a_reading_that_fails_is_a_call_and_no_reading(tmp_path: Path) -> None:
    text = (
        ARM
        + """
for i in range(600):
    try:
        p.getJointState(arm, 99 if i in (5, 500) else 0)  # here
    except Exception:
        pass
    p.stepSimulation()
"""
    )
    events, *_ = watched(tmp_path, text)
    (reading,) = readings(events).values()
    assert parts(reading) == [[(0, 0)]]
    sites = {event.number: event for event in events if isinstance(event, Site)}
    failed = [
        (sites[site].function, sites[site].line, int(step))
        for event in events
        if isinstance(event, Calls)
        for site, step in zip(event.sites.tolist(), event.steps, strict=True)
        if "get" in sites[site].function
    ]
    assert failed == [("getJointState", line_of(text, "# here"), step) for step in (5, 500)]
    assert len([event for event in events if isinstance(event, Raised)]) == 2


CRASHES = {
    "crash": "import ctypes; ctypes.string_at(0)",
    "kill": "import os; os.kill(os.getpid(), 9)",
    "exit": "import os; os._exit(0)",
}


@pytest.mark.parametrize("how", CRASHES)
def test_a_crash_loses_no_count(tmp_path: Path, how: str) -> None:
    text = ARM + "p.stepSimulation()\nfor i in range(77):\n    p.getJointState(arm, i % 7)\n"
    events, *_ = watched(tmp_path, text + CRASHES[how] + "\n")
    (reading,) = readings(events).values()
    assert (reading.count, reading.exact, reading.last_step) == (77, True, 1)
    assert parts(reading) == [[(0, j)] for j in range(7)]


def test_readings_at_the_very_end_count(tmp_path: Path) -> None:
    text = ARM + "import atexit\natexit.register(lambda: p.getAABB(arm))\np.stepSimulation()\n"
    events, *_ = watched(tmp_path, text)
    assert readings(events)["getAABB"].count == 1


def test_a_child_does_not_count(tmp_path: Path) -> None:
    text = (
        ARM
        + """
import os
p.stepSimulation()
p.getAABB(arm)
child = os.fork()
if child == 0:
    p.getAABB(arm), p.getNumJoints(arm)
    os._exit(0)
os.waitpid(child, 0)
"""
    )
    events, *_ = watched(tmp_path, text)
    assert {name: reading.count for name, reading in readings(events).items()} == {"getAABB": 1}


def test_a_limit_also_stops_a_script_that_only_reads(tmp_path: Path) -> None:
    text = (
        ARM
        + """
try:
    while True:
        p.getJointState(arm, 0)
        p.stepSimulation()
except BaseException:
    while True:
        p.getJointState(arm, 0)
"""
    )
    events, ending, _ = watched(tmp_path, text, steps=400)
    assert ending.how == "steps"
    assert max(event.last_step for event in events if isinstance(event, Reading)) <= 400


def test_time_passes_while_a_script_reads(tmp_path: Path) -> None:
    text = (
        scripts.HEAD.replace("p.DIRECT", "p.GUI")
        + """
box = p.loadURDF("cube_small.urdf", [0, 0, 50])
p.setRealTimeSimulation(1)
steps = 0
while p.getBasePositionAndOrientation(box)[0][2] > 1:
    p.getBaseVelocity(box)
    steps += 1
print(steps)
"""
    )
    events, ending, printed = watched(tmp_path, text)
    assert ending.how == "finished"
    last_s = max(event.times_s[-1] for event in events if isinstance(event, Samples))
    # A tenth of a millisecond for each reading.
    assert last_s == pytest.approx(2e-4 * int(printed), abs=1 / 240)
    reading = readings(events)["getBasePositionAndOrientation"]
    assert (reading.exact, reading.count) == (True, int(printed) + 1)


def test_what_is_too_much_is_said(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + BOX
        + """
p.stepSimulation()
for j in range(1500):
    p.getContactPoints(bodyA=box, linkIndexA=j)
exec(compile("p.getNumBodies()\\n" * 4200, "many.py", "exec"))
"""
    )
    events, ending, _ = watched(tmp_path, text)
    found = [event for event in events if isinstance(event, Reading)]
    assert (len(found), found[0].count, found[0].complete) == (1 << 12, 1500, False)
    assert len(found[0].targets) == 1024
    assert ending.notes == [
        "not all is known that the script read: it reads at more than 4096 places"
    ]


def test_our_own_error_does_not_reach_the_script(tmp_path: Path) -> None:
    text = (
        ARM
        + """
from drop_physics.engines.pybullet.watch import readings
readings.named = None
with recorded("0"):
    for i in range(9):
        p.stepSimulation()
        print(p.getJointState(arm, 0))
        p.getAABB(arm)
print("fine")
"""
    )
    done, (block,) = blocks(tmp_path, text)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "fine"), done.stderr
    (fault,) = block.decoder.faults
    assert "not all is known that the script read: TypeError" in str(fault)


def test_a_recording_gives_them_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        ARM
        + BOX
        + """
lens = p.computeProjectionMatrixFOV(60, 1.5, 0.25, 5)
for i in range(300):
    p.getClosestPoints(arm, box, 0.1, 3)
    p.stepSimulation()
p.getCameraImage(6, 4, lens, lens, renderer=p.ER_TINY_RENDERER)
"""
    )
    events, *_ = watched(tmp_path, text)
    monkeypatch.chdir(tmp_path)
    record_script("script.py", out="out.rrd")
    held = reader.read(Path("out.rrd")).seen.readings
    assert held == [event for event in events if isinstance(event, Reading)]
    assert info("out.rrd").readings == held
    lens, closest, camera = json.loads(json.dumps(info("out.rrd").as_json()))["readings"]
    assert closest["targets"] == [{"body": 0, "link": 3, "other": 1, "other_link": None}]
    assert (closest["line"], lens["camera"]) == (line_of(text, "getClosestPoints"), None)
    assert camera["camera"]["size_px"] == [6, 4]


def test_what_a_script_reads_is_none_of_its_physics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for out, more in (("one.rrd", ""), ("two.rrd", "p.getAABB(arm)\n")):
        text = ARM.replace("from show import show\n", "") + "p.stepSimulation()\n" + more
        Path("script.py").write_text(text)
        record_script("script.py", out=out)
    assert [len(info(out).readings) for out in ("one.rrd", "two.rrd")] == [0, 1]
    assert check("two.rrd", "one.rrd").same
