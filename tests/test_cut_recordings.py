"""Truncated recordings: the remaining whole steps are read, or an error is given in one line.

A recording of each kind is cut before the first, second and last chunk of each kind of entity, and
at places drawn by chance. What is left is analyzed, and holds the first steps of the whole, to the
bit.
"""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from conftest import some
from drop_physics import Scenario, simulate
from drop_physics.analysis.story import Story
from drop_physics.errors import RecordingError
from drop_physics.recording import recorder, rrd
from drop_physics.recording.reader import Recording, read
from drop_physics.stages.record import record_script

PYBULLET = """
import pybullet as p, pybullet_data
def world(height):
    client = p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    p.loadURDF("plane.urdf", physicsClientId=client)
    p.loadURDF("cube_small.urdf", [0, 0, height], physicsClientId=client)
    arm = p.loadURDF("kuka_iiwa/model.urdf", [1, 0, 0], useFixedBase=True, physicsClientId=client)
    return client, arm
a, b = world(0.1), world(0.2)
for i in range(90):
    for client, arm in (a, b):
        if i % 3 == 0:
            p.setJointMotorControl2(arm, i % 7, p.POSITION_CONTROL, 0.1 * (i % 5), force=50,
                                    physicsClientId=client)
        if i % 20 == 7:
            body = p.loadURDF("cube_small.urdf", [0, i, 1], physicsClientId=client)
            p.createConstraint(body, -1, -1, -1, p.JOINT_POINT2POINT, [0] * 3, [0] * 3, [0, i, 1],
                               physicsClientId=client)
        if i % 20 == 17:
            p.removeBody(body if client == b[0] else body, physicsClientId=client)
        p.stepSimulation(physicsClientId=client)
"""
ARM = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
for i in range(120):
    p.setJointMotorControl2(arm, i % 7, p.POSITION_CONTROL, 0.3, force=50)
    p.stepSimulation()
"""
MUJOCO = """
import mujoco
m = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
<body pos="0 0 .3"><freejoint/><geom size=".1"/></body>
<body pos="1 0 1"><joint name="j" axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body>
</worldbody><actuator><position joint="j" kp="5"/></actuator></mujoco>''')
d = mujoco.MjData(m)
for i in range(150):
    d.ctrl[0] = 0.01 * (i // 10)
    mujoco.mj_step(m, d)
"""
SCRIPTS = {"pybullet": PYBULLET, "arm": ARM, "mujoco": MUJOCO}
RECORDED = [
    "mujoco",
    pytest.param("drop", marks=pytest.mark.pybullet),
    *(
        pytest.param(name, marks=[pytest.mark.pybullet, pytest.mark.long])
        for name in ("pybullet", "arm")
    ),
]
BY_CHANCE = 50


@pytest.fixture(scope="module", params=RECORDED)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording whose rows are written in many batches."""
    path = tmp_path_factory.mktemp(request.param) / "run.rrd"
    if request.param == "drop":
        simulate(Scenario(duration_s=0.5), path)
        return path
    script = path.with_name("script.py")
    script.write_text(SCRIPTS[request.param])
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(recorder, "MANY", 10**9)
        patched.setattr("drop_physics.engines.watching.pipe.FLUSH_S", 0.0)
        record_script(str(script), out=path, stdout=2)
    return path


@pytest.mark.parametrize("part", some([*range(16)], 1))
def test_any_prefix_gives_its_whole_steps_or_one_line(whole: Path, part: int) -> None:
    data, borders = whole.read_bytes(), borders_of(whole)
    by_chance = random.Random(0).sample(range(1, len(data)), BY_CHANCE)
    complete, cut = read(whole), whole.with_name(f"{part}.rrd.part")
    steps = []
    for end in sorted({*borders, *by_chance})[part::16]:
        cut.write_bytes(data[:end])
        steps.append(whole_steps_of(cut, complete))
    if len({body.client for body in complete.seen.bodies.values()}) == 1:  # of two, one is ahead
        assert steps == sorted(steps)
    assert max(steps) > complete.seen.sampled.last / 2


def borders_of(whole: Path) -> set[int]:
    """Return the file positions of the first, second and last chunk of each kind of entity."""
    positions: dict[str, list[int]] = {}
    for chunk in rrd.chunks(whole):
        positions.setdefault(re.sub(r"\d+", "", chunk.entity), []).append(chunk.position)
    return {at for position in positions.values() for at in (*position[:2], position[-1])}


def whole_steps_of(path: Path, complete: Recording) -> int:
    """Return the last step of a truncated recording, after checking it against the whole one."""
    try:
        held = read(path)
        Story(held.seen, held.origin_and_end).analysis()
    except RecordingError:
        return -1
    last = held.seen.sampled.last
    if not held.partial:
        return last
    mine, theirs = states(held, last), states(complete, last)
    assert mine.keys() <= theirs.keys()
    assert all(theirs[name].startswith(values) for name, values in mine.items())
    if len({body.client for body in complete.seen.bodies.values()}) == 1:
        assert mine == theirs
    return last


def states(held: Recording, last: int) -> dict[object, bytes]:
    """Return all values up to and including a step, by body and component."""
    piece = held.seen.sampled.piece(0, last + 1)
    found: dict[object, bytes] = {}
    for number in held.seen.bodies:
        found[number, "base"] = piece.bases[piece.bases["body"] == number].tobytes()
        if number in piece.joints:
            of_joints = vars(piece.joints[number])
            found |= {(number, name): array.tobytes() for name, array in of_joints.items()}
        found[number, "contacts"] = piece.contacts[piece.contacts["body_a"] == number].tobytes()
    for key, (steps, forces) in piece.forces.items():
        found |= {(key, "steps"): steps.tobytes(), (key, "forces"): forces.tobytes()}
    return {name: values for name, values in found.items() if values}
