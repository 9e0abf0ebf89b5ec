"""The data that a watched script's process sends, decoded as events, without the recorder.

Verification: a script prints the same with and without being watched, to the last bit; the events
hold what the script itself reads from the engine, and the calls as they were written.
"""

from __future__ import annotations

import gc
import json
import math
import os
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scripts
from conftest import some
from drop_physics.engines.channel import shared_block
from drop_physics.engines.decoder import Decoder
from drop_physics.engines.watching import ending, pipe, start
from drop_physics.trace.events import (
    Appearance,
    At,
    Body,
    Calls,
    Event,
    FileRequests,
    Put,
    Raised,
    Samples,
    Settings,
    Site,
)
from watching import bare, blocks, told, watched

pytestmark = pytest.mark.pybullet

WITNESS = """
import json
seen, held = [], []
def look():
    state = {}
    for b in bodies:
        n = range(p.getNumJoints(b))
        joints = [p.getJointStateMultiDof(b, j) for j in n if p.getJointInfo(b, j)[2] != 4]
        state[b] = [[x for v in (*p.getBasePositionAndOrientation(b), *p.getBaseVelocity(b))
            for x in v], *[[x for s in joints for x in s[k]] for k in (0, 1, 3)]]
    points = [[c[1], c[3], c[2], c[4], *c[5], *c[6], *c[7], *c[8:11], *c[11], c[12], *c[13]]
        for c in p.getContactPoints()]
    seen.append([state, points, {c: p.getConstraintState(c) for c in held}])
"""


SCENES = {
    "boxes": """
p.loadURDF("plane.urdf")
bodies = [p.loadURDF("cube_small.urdf", [0, 0, 0.2], [0.1, 0.2, 0, 1]),
    p.loadURDF("cube_small.urdf", [0.02, 0, 0.4], useMaximalCoordinates=True)]
""",
    "robots": """
p.loadURDF("plane.urdf")
bodies = [p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True),
    p.loadURDF("r2d2.urdf", [2, 0, 0.6])]
""",
    "spherical": """
p.loadURDF("plane.urdf")
bodies = [p.loadURDF("humanoid/humanoid.urdf", [0, 0, 1]),
    p.loadURDF("cube_small.urdf", [1, 0, 0.1])]
""",
    "held": """
a, b = bodies = [p.loadURDF("cube_small.urdf", [0, 0, 2]), p.loadURDF("r2d2.urdf", [2, 0, 1])]
held += [p.createConstraint(a, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 2]),
    p.createConstraint(b, 1, b, 2, p.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0])]
p.changeConstraint(held[1], gearRatio=-1, maxForce=10)
""",
}


@pytest.mark.parametrize("scene", SCENES)
def test_samples_hold_what_the_script_itself_reads(tmp_path: Path, scene: str) -> None:
    text = f"{scripts.HEAD}{WITNESS}{SCENES[scene]}"
    text += "for i in range(150):\n    p.stepSimulation()\n    look()\n"
    events, _, _ = watched(tmp_path, text + "json.dump(seen, open('seen.json', 'w'))\n")
    seen = json.loads(tmp_path.joinpath("seen.json").read_text())
    samples = joined(events)
    assert samples.steps.tolist() == list(range(151))
    bodies = {event.body.number: event.body for event in events if isinstance(event, Appearance)}
    for number, states in samples.bases.items():
        assert bodies[number].base_moves
        assert states[1:].tolist() == [state[str(number)][0] for state, _, _ in seen]
    for number, joints in samples.joints.items():
        for at, values in enumerate((joints.position, joints.velocity, joints.effort), 1):
            assert values[1:].tolist() == [state[str(number)][at] for state, _, _ in seen]
    moving = {number for number, body in bodies.items() if body.moving}
    assert {*samples.bases, *samples.joints} == moving
    points: dict[int, list[Any]] = {}
    for row in samples.contacts.tolist():
        step, *rest = row
        flat = [x for one in rest for x in (np.ravel(one).tolist())]
        points.setdefault(step, []).append(flat)
    assert [points.get(step, []) for step in range(1, 151)] == [found for _, found, _ in seen]
    for constraint, forces in samples.constraints.items():
        # A constraint is not asked before it has been through a step.
        assert forces.tolist() == [held[str(constraint)] for _, _, held in seen]
    assert set(map(str, samples.constraints)) == set(seen[-1][2])


def joined(events: list[Event]) -> Samples:
    """Return all samples of a script's only simulation, joined, with its constraints."""
    found = [event for event in events if isinstance(event, Samples)]
    last, rows = found[-1], Samples.__dataclass_fields__
    assert all([*each.bases] == [*last.bases] for each in found)
    values: dict[str, Any] = {name: getattr(last, name) for name in rows}
    for name in ("steps", "times_s", "contacts"):
        values[name] = np.concatenate([getattr(each, name) for each in found])
    values["bases"] = {
        number: np.concatenate([each.bases[number] for each in found]) for number in last.bases
    }
    values["joints"] = {
        number: type(last.joints[number])(
            *(
                np.concatenate([getattr(each.joints[number], name) for each in found])
                for name in ("steps", "times_s", "position", "velocity", "effort")
            )
        )
        for number in last.joints
    }
    values["constraints"] = {
        number: np.concatenate(
            [each.constraints[number] for each in found if number in each.constraints]
        )
        for number in last.constraints
    }
    return Samples(**values)


# -- calls ----------------------------------------------------------------------------------------


CALLS = """
import numpy as np
from enum import IntEnum
class Mode(IntEnum):
    ON = 1
class Odd:
    pass
b = p.loadURDF("kuka_iiwa/model.urdf", [0, 0, 0], useFixedBase=True, flags=p.URDF_MERGE_FIXED_LINKS)
p.setPhysicsEngineParameter(enableFileCaching=False)
for force in (1, 2.5, 1e300, True, np.float32(0.1), np.int64(3), -0.0, float("nan"), None):
    try:
        p.setJointMotorControl2(b, 2, p.VELOCITY_CONTROL, targetVelocity=0.5, force=force)
    except TypeError:
        pass
for vector in ([0, 0, 1], (0, 0, 1.0), np.array([0.5, 0, 1]), np.arange(3), [0, np.float64(2), 1]):
    p.applyExternalForce(b, -1, vector, [0, 0, 0], flags=p.WORLD_FRAME, physicsClientId=0)
p.setJointMotorControlArray(b, range(3), p.POSITION_CONTROL, targetPositions=[0, 0.5, 1])
p.setJointMotorControlArray(b, [0] * 140, p.POSITION_CONTROL, targetPositions=[0.25] * 140)
p.changeVisualShape(b, -1, rgbaColor=[1, 0, 0, 1])
p.setGravity(0, 0, Mode.ON)
p.setGravity(0, 0, -9.81, 0)
for path in ("a{b}.urdf", "no 'such.urdf"):
    try:
        p.loadURDF(path)
    except p.error:
        pass
try:
    p.resetBaseVelocity(Odd(), {}, 10**400)
except TypeError:
    pass
for solver in (1, 2, 10**400, 0.5):
    try:
        p.setPhysicsEngineParameter(numSolverIterations=solver)
    except (TypeError, OverflowError):
        pass
p.stepSimulation()
"""
FEW = ", ".join(["0"] * 128) + ", … 140 values"
QUARTERS = ", ".join(["0.25"] * 128) + ", … 140 values"
MOTOR = ("setJointMotorControl2", "0, 2, 0, targetVelocity=0.5, force=")
PUSH = "applyExternalForce"
WRITTEN = [
    ("setGravity", "0, 0, -9.81"),
    ("loadURDF", "'kuka_iiwa/model.urdf', [0, 0, 0], useFixedBase=True, flags=524288"),
    ("setPhysicsEngineParameter", "enableFileCaching=False"),
    *((MOTOR[0], MOTOR[1] + force) for force in (
        "1", "2.5", "1e+300", "1", "0.10000000149011612", "3", "0", "nan", "None",
    )),
    (PUSH, "0, -1, [0, 0, 1], [0, 0, 0], flags=2"),
    (PUSH, "0, -1, [0, 0, 1], [0, 0, 0], flags=2"),
    (PUSH, "0, -1, [0.5, 0, 1], [0, 0, 0], flags=2"),
    (PUSH, "0, -1, [0, 1, 2], [0, 0, 0], flags=2"),
    (PUSH, "0, -1, [0, 2, 1], [0, 0, 0], flags=2"),
    ("setJointMotorControlArray", "0, [0, 1, 2], 2, targetPositions=[0, 0.5, 1]"),
    ("setJointMotorControlArray", f"0, [{FEW}], 2, targetPositions=[{QUARTERS}]"),
    ("changeVisualShape", "0, -1, rgbaColor=[1, 0, 0, 1]"),
    ("setGravity", "0, 0, 1"),
    ("setGravity", "0, 0, -9.81, 0"),
    ("loadURDF", "'a{b}.urdf'"),
    ("loadURDF", '"no \'such.urdf"'),
    ("resetBaseVelocity", f"<Odd>, <dict>, {10**400}"),
    *(
        ("setPhysicsEngineParameter", f"numSolverIterations={each}")
        for each in (1, 2, 10**400, 0.5)
    ),
]  # fmt: skip


def test_calls_are_as_they_were_written(tmp_path: Path) -> None:
    events, _, _ = watched(tmp_path, scripts.HEAD + CALLS)
    assert [(function, text) for function, text, _ in told(events)] == WRITTEN
    source = tmp_path.joinpath("script.py").read_text().splitlines()
    assert all(function in source[line - 1] for function, _, line in told(events))
    sites = [event for event in events if isinstance(event, Site)]
    assert [site.number for site in sites] == list(range(len(sites)))
    motor = next(site for site in sites if site.function == MOTOR[0])
    assert motor.form == "{}, {}, {}, targetVelocity={}, force={}"
    assert motor.names == ("bodyUniqueId", "jointIndex", "controlMode", "targetVelocity", "force")
    assert motor.whole == (True, True, True, False, True)
    numbers = np.concatenate([each.numbers for each in events if isinstance(each, Calls)])
    assert np.signbit(numbers[numbers == 0]).any()  # -0.0, kept to the bit
    assert motor.file == "script.py"


def test_calls_of_one_form_share_a_site_however_often_they_are_made(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + """
b = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
from pybullet_utils.bullet_client import BulletClient
q = BulletClient(p.DIRECT)
c = q.loadURDF("/" + pybullet_data.getDataPath().strip("/") + "/cube_small.urdf")
for i in range(500):
    for j in range(7):
        p.setJointMotorControl2(b, j, p.POSITION_CONTROL, targetPosition=i / 10, force=200)
    q.applyExternalForce(c, -1, [i, 0.5, 0], [0, 0, 0], p.WORLD_FRAME)
    p.stepSimulation()
    if i % 2:
        q.stepSimulation()
"""
    )
    events, _, _ = watched(tmp_path, text)
    written = [call for call in told(events) if call[0] == MOTOR[0]]
    assert [text for _, text, _ in written] == [
        f"0, {j}, 2, targetPosition={i / 10}, force=200" for i in range(500) for j in range(7)
    ]
    sites = [event for event in events if isinstance(event, Site)]
    assert sorted(site.function for site in sites) == sorted(
        ["setGravity", "loadURDF", "loadURDF", MOTOR[0], PUSH]
    )
    steps = np.concatenate([one.steps for one in events if isinstance(one, Calls)])
    clients = np.concatenate(
        [np.full(len(one.steps), one.client) for one in events if isinstance(one, Calls)]
    )
    assert steps[clients == 0].tolist() == [0, 0, *(i for i in range(500) for _ in range(7))]
    assert steps[clients == 1].tolist() == [0, *(i // 2 for i in range(500))]


def test_calls_of_one_place_may_differ_in_form_and_simulation(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + """
b, q = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True), p.connect(p.DIRECT)
for client in (0, 0, q, 0):
    p.setGravity(0, 0, -1.5 - client, physicsClientId=client)
for given in (dict(force=1), dict(force=2), dict(force=3, maxVelocity=4), dict(maxVelocity=5)):
    p.setJointMotorControl2(b, 2, p.POSITION_CONTROL, **given)
left = (each for each in [0, 0, 3])
for vector in ([0, 0, 1], (0, 0, 2), left, [0, 1], [0, None, 4], [0, 0, 5]):
    try:
        p.applyExternalForce(b, -1, vector, [0, 0, 0], p.WORLD_FRAME)
    except (TypeError, SystemError, p.error) as error:
        print(error)
print([*left])
p.stepSimulation()
"""
    )
    events, _, printed = watched(tmp_path, text)
    assert printed == bare(tmp_path, text).stdout
    assert [call for *call, _ in told(events) if call[0] != "loadURDF"][1:] == [
        *(["setGravity", f"0, 0, {g}"] for g in (-1.5, -1.5, -2.5, -1.5)),
        *(
            [MOTOR[0], f"0, 2, 2, {given}"]
            for given in ("force=1", "force=2", "force=3, maxVelocity=4", "maxVelocity=5")
        ),
        *(
            [PUSH, f"0, -1, {vector}, [0, 0, 0], 2"]
            for vector in (
                "[0, 0, 1]",
                "[0, 0, 2]",
                "<generator>",
                "[0, 1]",
                "[0, None, 4]",
                "[0, 0, 5]",
            )
        ),
    ]
    clients = [each.client for each in events if isinstance(each, Calls) for _ in each.steps]
    assert clients.count(1) == 1


def test_results_and_errors_belong_to_their_calls(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + """
shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
a = p.createMultiBody(1, shape)
p.resetBaseVelocity(a, [1, 0, 0])
try:
    p.loadURDF("nothing.urdf")
except Exception:
    pass
p.stepSimulation()
s = p.saveState()
p.createConstraint(a, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 2])
"""
    )
    events, _, _ = watched(tmp_path, text)
    results = np.concatenate([one.results for one in events if isinstance(one, Calls)])
    expected = [math.nan, 0, 0, math.nan, math.nan, 0, 1]
    np.testing.assert_array_equal(results, expected)
    (raised,) = (one for one in events if isinstance(one, Raised))
    assert (raised.at.call, raised.at.step) == (5, 0)
    assert raised.error.startswith(("error: ", "TypeError: "))


def test_what_calls_have_set_is_read_back(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + """
b = p.loadURDF("cube_small.urdf", [0, 0, 1])
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
p.stepSimulation()
p.resetBaseVelocity(b, [1, 2, 3])
p.resetJointState(k, 2, 0.5, 0.25)
p.stepSimulation()
p.resetBasePositionAndOrientation(b, [0, 0, 5], [0, 0, 0, 1])
p.resetBasePositionAndOrientation(b, [0, 0, 6], [0, 0, 0, 1])
p.applyExternalForce(b, -1, [1, 0, 0], [0, 0, 0], p.LINK_FRAME)
p.stepSimulation()
"""
    )
    events, _, _ = watched(tmp_path, text)
    first, *puts = (event for event in events if isinstance(event, Put))
    assert (first.body.engine_id, first.counts) == (1, False)  # whose base no sample holds
    assert [(put.at.step, put.body.engine_id, put.at.call) for put in puts] == [
        (1, 0, 5),
        (1, 1, 5),
        (2, 0, 6),
        (2, 0, 7),
    ]
    assert puts[0].base[7:10].tolist() == [1, 2, 3]
    assert puts[1].position[2] == 0.5
    assert puts[1].velocity[2] == 0.25
    assert [put.base[2] for put in puts[2:]] == [5, 6]


# -- bodies ---------------------------------------------------------------------------------------


def bodies(events: list[Event]) -> list[Body]:
    return [event.body for event in events if isinstance(event, Appearance) and event.came]


ROBOT = """<robot name="r"><link name="base"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.5"/>
<mass value="2"/><inertia ixx="1" ixy="0.1" ixz="0.2" iyy="2" iyz="0.3" izz="3"/></inertial>
<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>
<link name="arm"><collision>{mesh}</collision></link><link name="hand"/>
<joint name="one" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.5"/><limit lower="-1" upper="2" effort="7" velocity="8"/>
<dynamics damping="0.25" friction="0.125"/></joint>
<joint name="two" type="prismatic"><parent link="arm"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" effort="5" velocity="6"/>
<mimic joint="one" multiplier="-2" offset="0.5"/></joint></robot>"""
MESH = '<geometry><mesh filename="duck.obj" scale="0.1 0.1 0.1"/></geometry>'


def test_bodies_tell_what_later_stages_need(tmp_path: Path) -> None:
    import pybullet_data

    duck = Path(pybullet_data.getDataPath(), "duck.obj")
    tmp_path.joinpath("duck.obj").write_bytes(duck.read_bytes())
    tmp_path.joinpath("robot.urdf").write_text(ROBOT.replace("{mesh}", MESH))
    concave = ROBOT.replace("<collision>{mesh}", "<collision concave='yes'>{mesh}")
    tmp_path.joinpath("concave.urdf").write_text(concave.replace("{mesh}", MESH))
    text = (
        scripts.HEAD
        + """
p.loadURDF("robot.urdf", globalScaling=2, flags=p.URDF_ENABLE_SLEEPING)
p.loadURDF("robot.urdf", [3, 0, 0])
p.loadURDF("humanoid/humanoid.urdf", [0, 5, 1])
p.loadURDF("concave.urdf", [6, 0, 0])
hull = p.createCollisionShape(p.GEOM_MESH, fileName="duck.obj", meshScale=[0.1] * 3)
mesh = p.createCollisionShape(p.GEOM_MESH, fileName="duck.obj", flags=p.GEOM_FORCE_CONCAVE_TRIMESH)
for shape in (hull, mesh):
    p.createMultiBody(0, shape)
p.loadURDF("robot.urdf", [9, 0, 0], useMaximalCoordinates=True)
field = dict(numHeightfieldRows=4, numHeightfieldColumns=4, heightfieldData=[0] * 16)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_HEIGHTFIELD, **field))
p.stepSimulation()
"""
    )
    expected = bare(tmp_path, text)
    events, ending, printed = watched(tmp_path, text)
    assert (ending.notes, printed) == ([], expected.stdout)
    scaled, robot, not_well_formed, concave_body, hull, mesh, *_ = bodies(events)
    one, two = robot.joints
    assert (one.damping, one.friction, one.effort, one.velocity) == (0.25, 0.125, 7, 8)
    assert (one.limits, two.limits) == ((-1, 2), (0, 1))
    assert one.axis == pytest.approx([0, 1, 0])
    assert two.axis == pytest.approx([1, 0, 0])
    # From the base's centre of mass, in its inertia's axes, turned by 0.5.
    x, y = -0.1 * math.cos(0.5), 0.1 * math.sin(0.5)
    assert one.parent_position_m == pytest.approx([x, y, 0.5])
    half = abs(one.parent_orientation[3]), abs(one.parent_orientation[2])
    assert half == pytest.approx([math.cos(0.25), math.sin(0.25)])
    assert robot.asked.scale == 1
    assert (scaled.asked.scale, scaled.flags, scaled.can_sleep) == (2, 1 << 11, True)
    base, arm, hand = robot.asked.links
    assert (base.name, base.mass_kg, base.position_m, base.rpy_rad) == (
        "base",
        2,
        (0.1, 0, 0),
        (0, 0, 0.5),
    )
    assert base.inertia_kg_m2 == (1, 0.1, 0.2, 2, 0.3, 3)
    assert math.isnan(arm.mass_kg)
    assert (hand.inertia_kg_m2, arm.name) == ((), "arm")
    (mimic,) = robot.asked.mimics
    assert (mimic.joint, mimic.of, mimic.multiplier, mimic.offset) == ("two", "one", -2, 0.5)
    box, duck_mesh = robot.collisions
    assert (box.link, box.kind, box.size_m) == (-1, "box", (0.1, 0.2, 0.3))
    assert (duck_mesh.link, duck_mesh.kind, duck_mesh.file) == (0, "mesh", "duck.obj")
    corners = np.reshape(duck_mesh.hull_m, (-1, 3))
    assert len(corners) > 20
    assert np.abs(corners).max() < 0.3
    assert not_well_formed.asked == FileRequests()
    assert [len(each.collisions[-1].hull_m) > 0 for each in (concave_body, hull, mesh)] == [
        False,
        True,
        False,
    ]
    assert not any(body.before for body in bodies(events))


# -- endings --------------------------------------------------------------------------------------

FALL = (
    scripts.HEAD
    + """
import sys, threading, atexit, time
b = p.loadURDF("cube_small.urdf", [0, 0, 9])
def step(n=10):
    for i in range(n):
        p.stepSimulation()
step()
"""
)
LATE = {
    "thread": ("def later():\n    time.sleep(0.3)\n    step()\n"
        "threading.Thread(target=later).start()", "finished"),
    "atexit": ("atexit.register(step)", "finished"),
    "exit": ("atexit.register(step)\nsys.exit(3)", "failed"),
    "finalizer": ("class Last:\n    def __del__(self):\n        step()\nlast = Last()", "finished"),
    "excepthook": ("def hook(*_):\n    step()\nsys.excepthook = hook\n1 / 0", "failed"),
    "after an error": ("atexit.register(step)\n1 / 0", "failed"),
}  # fmt: skip


@pytest.mark.parametrize("name", some(LATE, 2))
def test_steps_after_the_last_line_count(tmp_path: Path, name: str) -> None:
    late, how = LATE[name]
    events, ending, printed = watched(tmp_path, FALL + late)
    assert ending.how == how
    assert joined(events).steps.tolist() == list(range(21))
    assert printed == bare(tmp_path, FALL + late).stdout


def test_steps_after_the_limit_do_not_count(tmp_path: Path) -> None:
    late = "atexit.register(step)\nstep()"
    events, ending, _ = watched(tmp_path, FALL + late, steps=15)
    assert ending.how == "steps"
    assert joined(events).steps.tolist() == list(range(16))
    assert "Traceback" not in tmp_path.joinpath("said.txt").read_text()


def test_a_thread_that_never_ends_does_not_hold_up_the_end(tmp_path: Path) -> None:
    late = "def forever():\n    while True:\n        step(1)\n"
    late += "threading.Thread(target=forever, daemon=True).start()\ntime.sleep(0.1)\n"
    late += "class Last:\n    def __del__(self):\n        step(1)\nlast = Last()"
    events, ending, _ = watched(tmp_path, FALL + late)
    assert ending.how == "finished"
    steps = joined(events).steps
    assert steps.tolist() == list(range(len(steps)))


# -- blocks of Python -----------------------------------------------------------------------------

BEFORE = (
    scripts.HEAD
    + """
import threading, time
b = p.loadURDF("cube_small.urdf", [0, 0, 9])
c = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 9])
def step(n=10):
    for i in range(n):
        p.stepSimulation()
"""
)


def test_what_was_there_before_a_block_is_marked(tmp_path: Path) -> None:
    text = (
        BEFORE
        + """
with recorded("0"):
    p.loadURDF("cube_small.urdf", [0, 0, 2])
    step()
    p.removeBody(b)
    p.loadURDF("sphere_small.urdf", [0, 0, 2])
    step()
step()
show(p)
"""
    )
    done, (block,) = blocks(tmp_path, text)
    assert done.stdout == bare(tmp_path, text.replace('with recorded("0")', "if True")).stdout
    assert [(body.name, body.before) for body in bodies(block.events)] == [
        ("cube.urdf", True),
        ("cube_small.urdf", False),
        ("sphere_small.urdf", False),
    ]
    samples = [event for event in block.events if isinstance(event, Samples)]
    assert [step for sample in samples for step in sample.steps] == list(range(21))
    held = [number for sample in samples for number in sample.constraints]
    assert held
    assert not samples[-1].constraints


def test_a_block_within_a_block_is_recorded_in_both(tmp_path: Path) -> None:
    text = (
        BEFORE
        + """
with recorded("0"):
    step()
    with recorded("1"):
        p.applyExternalForce(b, -1, [1, 0, 0], [0, 0, 0], p.LINK_FRAME)
        step()
    step()
step()
show(p)
"""
    )
    done, (outer, inner) = blocks(tmp_path, text)
    plain = text.replace('with recorded("0")', "if True").replace('with recorded("1")', "if True")
    assert done.stdout == bare(tmp_path, plain).stdout, done.stderr
    for block, steps in ((outer, 31), (inner, 11)):
        assert joined_steps(block.events) == list(range(steps))
        ((function, _, line),) = told(block.events)
        assert (function, plain.splitlines()[line - 2].strip()[:20]) == (
            "applyExternalForce",
            "p.applyExternalForce",
        )


def test_threads_of_a_block_are_recorded_and_those_that_outlive_it_are_named(
    tmp_path: Path,
) -> None:
    text = (
        BEFORE
        + """
with recorded("0"):
    one = threading.Thread(target=step)
    one.start(); one.join()
go = True
stepped = threading.Event()
def forever():
    while go:
        step(1)
        stepped.set()
with recorded("1"):
    two = threading.Thread(target=forever)
    two.start()
    stepped.wait()
    step()
go = False
"""
    )
    done, (ended, outlived) = blocks(tmp_path, text)
    assert (done.returncode, done.stderr.count("Error")) == (0, 0), done.stderr
    assert joined_steps(ended.events) == list(range(11))
    assert ended.decoder.faults == []
    (fault,) = outlived.decoder.faults
    assert "threads that step the simulation outlive the block" in str(fault)


def joined_steps(events: list[Event]) -> list[int]:
    return [step for one in events if isinstance(one, Samples) for step in one.steps.tolist()]


@pytest.mark.long
def test_a_watch_that_is_over_is_forgotten() -> None:
    """Each watch takes a megabyte, and a test run may have a thousand blocks."""
    with shared_block() as memory:
        files = os.open(os.devnull, os.O_WRONLY), os.dup(memory.fileno())
        how = {"steps": None, "duration_s": None, "keep_sleeping": False, "seed": None}
        watch = start.watch(*files, **how)
        ending.end(watch, "finished")
        watch.remove()
        watch.pipe.close()
    kept = weakref.ref(watch)
    del watch
    gc.collect()
    assert kept() is None


# -- the stream -----------------------------------------------------------------------------------


def test_a_stream_that_ends_at_any_byte_is_understood_up_to_there() -> None:
    world = {"world": 0, "client": 0, "method": "DIRECT", "first_step": 0, "first_time_s": 0.0}
    layout = {"world": 0, "constraints": [], "bodies": []}
    site = {
        "number": 0,
        "function": "f",
        "file": "",
        "line": 1,
        "form": "{}",
        "names": [""],
        "whole": [False],
    }
    sent = pipe.MAGIC
    for what, note in (("world", world), ("layout", layout), ("site", site)):
        sent += pipe.frame(pipe.NOTE, pipe.encoded({"what": what, **note}))
    for step in range(20):
        row = pipe.CALL_HEAD.pack(0, 0) + pipe.NUMBER.pack(step)
        sent += pipe.frame(pipe.CALL, row) + pipe.frame(pipe.SAMPLE, pipe.HEAD.pack(0, step))
    for cut in range(0, len(sent), 7):
        decoder = Decoder()
        events = list(decoder.feed(sent[: cut // 2])) + list(decoder.feed(sent[cut // 2 : cut]))
        events += list(decoder.rest())
        calls = [one for one in events if isinstance(one, Calls)]
        numbers = [number for one in calls for number in one.numbers.tolist()]
        assert numbers == list(range(len(numbers)))
        steps = [step for one in events if isinstance(one, Samples) for step in one.steps]
        assert steps == list(range(len(steps)))
        assert len(steps) in (len(numbers), len(numbers) - 1)
    assert steps[-1] >= 18


def test_times_follow_the_timestep(tmp_path: Path) -> None:
    text = (
        scripts.HEAD
        + """
p.loadURDF("cube_small.urdf")
p.stepSimulation()
p.setTimeStep(0.5)
p.stepSimulation()
p.setGravity(0, 0, 0)
"""
    )
    events, _, _ = watched(tmp_path, text)
    assert joined(events).times_s.tolist() == [0, 1 / 240, 1 / 240 + 0.5]
    times = np.concatenate([one.times_s for one in events if isinstance(one, Calls)])
    assert times.tolist() == [0, 0, 1 / 240, 1 / 240 + 0.5]
    settings = [event for event in events if isinstance(event, Settings)]
    assert [each.at for each in settings] == [
        At(0, 0.0, 2),
        At(1, 1 / 240, 3),
        At(2, 1 / 240 + 0.5, 4),
    ]
