"""Single changes tried on a PyBullet run: bitwise equal to the user's own edit of the script.

Verification: a run with a change equals a bare run of PyBullet whose calls were written that way.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pybullet_data
import pytest
from conftest import some
from drop_physics.engines.cures import TABLES
from drop_physics.engines.pybullet.watch.intervene import CallInterventions
from drop_physics.engines.pybullet.watch.single_changes import possible, trial_of
from drop_physics.engines.watching.single_changes import Change

BULLET = TABLES["PyBullet"]
STEPS = 40
CALLS = {name: value for name, value in vars(p).items() if callable(value)}


class Watched:
    """PyBullet with its calls modified."""

    def __init__(self, operations: Any) -> None:
        self.fired: set[int] = set()
        self.interventions = CallInterventions(operations, self.fired.add)

    def __getattr__(self, name: str) -> Any:
        value = getattr(p, name)
        return self.interventions.of(name, CALLS, p) if name in CALLS else value  # type: ignore[arg-type]


def script(p: Any, **other: Any) -> Any:
    """Run a user's script, with arguments optionally replaced; return the state after each step."""

    def given(name: str, usual: Any) -> Any:
        return other.get(name, usual)

    p.disconnect()
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(*given("gravity", (0, 0, -9.81)))
    p.setPhysicsEngineParameter(numSolverIterations=given("iterations", 20))
    p.loadURDF("plane.urdf")
    box = p.loadURDF("cube_small.urdf", [0, 0, 0.03], useFixedBase=given("fixed", False))
    arm = p.loadURDF("pendulum5.urdf", [1, 0, 1], useFixedBase=True)
    for link in (box, given("second", arm)):
        p.changeDynamics(link, -1, lateralFriction=given("friction", 0.3))
    lid = p.createMultiBody(1, basePosition=[2, 0, 1])
    if given("joined", True):
        held = p.createConstraint(lid, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [2, 0, 1.2])
        p.changeConstraint(held, maxForce=given("most", 30))
    states = []
    for step in range(STEPS):
        target = given("targets", lambda step: 0.01 * step)(step)
        first = given("first", 0)
        p.setJointMotorControl2(arm, first, p.POSITION_CONTROL, target, force=given("force", 50))
        p.setJointMotorControl2(arm, 1, p.POSITION_CONTROL, 0.2, force=given("other", 5))
        if given("pushed", True):
            p.applyExternalForce(
                box, -1, [given("push", 0.4), 0, 0], [0, 0, 0], given("frame", p.LINK_FRAME)
            )
        if step == given("at", 0):
            given("before", lambda *_: None)(box, arm, lid)
        p.stepSimulation()
        joints = [each for n in range(4) for each in p.getJointState(arm, n)[:2]]
        ends = (p.getBasePositionAndOrientation(each) for each in (box, arm, lid))
        states.append([*joints, *(number for pose in ends for part in pose for number in part)])
    return np.array(states)


@pytest.fixture(autouse=True)
def simulation() -> Iterator[None]:
    assert p.connect(p.DIRECT) == 0
    yield
    p.disconnect()


def changes() -> list[Change]:
    """Return the single changes that are possible in the script."""
    run = Watched(BULLET.sees)
    states = script(run)
    found = possible(p, BULLET.tried, run.interventions.seen)
    assert states.tobytes() == script(p).tobytes()
    return found


def the(found: list[Change], change: str, op: str, *of: str) -> Change:
    """Return the change of one property by one operator."""
    alike = [each for each in found if (each.change, each.op) == (change, op)]
    if of:
        return next(each for each in alike if each.of == of)
    return alike[0]


def links(body: int) -> range:
    return range(-1, p.getNumJoints(body))


def dynamics(**values: float) -> Callable[..., None]:
    """Return a function that sets dynamics properties of all links of all bodies."""

    def set_them(*_: int) -> None:
        for body in range(p.getNumBodies()):
            for link in links(body):
                p.changeDynamics(body, link, **values)

    return set_them


def motors(**how: float) -> Callable[..., None]:
    def set_them(_: int, arm: int, __: int) -> None:
        for joint in range(p.getNumJoints(arm)):
            here = {"targetPosition": p.getJointState(arm, joint)[0]} if how["force"] else {}
            mode = p.POSITION_CONTROL if how["force"] else p.VELOCITY_CONTROL
            p.setJointMotorControl2(arm, joint, mode, **here, **how)

    return set_them


def parameter(**values: float) -> Callable[..., None]:
    return lambda *_: p.setPhysicsEngineParameter(**values)


def higher(*_: int) -> None:
    for body in range(p.getNumBodies()):
        at, turned = p.getBasePositionAndOrientation(body)
        p.resetBasePositionAndOrientation(body, [*at[:2], at[2] + 0.01], turned)


def apart(box: int, _: int, __: int) -> None:
    p.setCollisionFilterPair(0, box, -1, -1, 0)


def heavier(*_: int) -> None:
    for body in range(p.getNumBodies()):
        for link in links(body):
            p.changeDynamics(body, link, mass=10 * p.getDynamicsInfo(body, link)[0])


MOTOR = "setJointMotorControl2"
EDITS: dict[tuple[str, ...], dict[str, Any]] = {
    ("setGravity.gravZ", "*0.1"): {"gravity": (0, 0, 0.1 * -9.81)},
    ("setGravity", "left-out"): {"gravity": (0, 0, 0)},
    ("setPhysicsEngineParameter.numSolverIterations", "*0.1"): {"iterations": 2},
    ("loadURDF.useFixedBase", "^1", "1"): {"fixed": True},
    (f"{MOTOR}.force", "*0.1", "0"): {"force": 5},
    (f"{MOTOR}.force", "=0", "all"): {"force": 0, "other": 0},
    (f"{MOTOR}.force", "default", "1"): {"other": 1e5},
    (f"{MOTOR}.targetPosition", "*-1", "0"): {"targets": lambda step: -0.01 * step},
    (f"{MOTOR}.jointIndex", "+1", "0"): {"first": 1},
    (MOTOR, "held", "0"): {"targets": lambda _: 0.0},
    (MOTOR, "late", "0"): {"targets": lambda step: 0.01 * max(step - 1, 0)},
    ("applyExternalForce", "left-out"): {"pushed": False},
    ("applyExternalForce.forceObj", "*10"): {"push": 4.0},
    ("applyExternalForce.flags", "^3"): {"frame": p.WORLD_FRAME},
    ("changeConstraint.maxForce", "*0.1"): {"most": 3},
    # What is added before the first step.
    (f"{MOTOR}.force", "=0", "added"): {"before": motors(force=0)},
    (f"{MOTOR}.force", "=1000"): {"before": motors(force=1000)},
    ("changeDynamics.linearDamping", "=0"): {"before": dynamics(linearDamping=0, angularDamping=0)},
    ("changeDynamics.lateralFriction", "=3"): {"before": dynamics(lateralFriction=3)},
    ("changeDynamics.mass", "*10"): {"before": heavier},
    ("setPhysicsEngineParameter.numSubSteps", "=10"): {"before": parameter(numSubSteps=10)},
    ("setGravity.gravZ", "=0", "added"): {"before": lambda *_: p.setGravity(0, 0, 0)},
    ("changeConstraint.maxForce", "=50"): {"before": lambda *_: p.changeConstraint(1, maxForce=50)},
    ("setCollisionFilterPair.enableCollision", "=0"): {"before": apart},
    ("start.base", "+0.01"): {"before": higher},
}


def found_of(found: list[Change], key: tuple[str, ...]) -> Change:
    """Return a change from the list of possible ones, by its key."""
    alike = [each for each in found if (each.change, each.op) == key[:2]]
    added = [each for each in alike if isinstance(each.how[1], dict)]
    made = [each for each in alike if each not in added]
    match key[2:]:
        case ["added"]:
            return added[0]
        case ["all"]:
            return next(each for each in made if each.site is None)
        case [which] if which.isdecimal():
            lines = sorted({each.site for each in made if each.site})
            return next(each for each in made if each.site == lines[int(which)])
    return (made or added)[0]


@pytest.mark.parametrize("key", some(map(pytest.param, EDITS), 3), ids=" ".join)
def test_a_change_is_what_a_user_would_write(key: tuple[str, ...]) -> None:
    change = found_of(changes(), key)
    trial = json.loads(json.dumps(trial_of(change)))
    run = Watched(trial["interventions"])
    states = script(run)
    assert run.fired
    assert states.tobytes() == script(p, **EDITS[key]).tobytes()
    assert states.tobytes() != script(p).tobytes()


def test_changes_are_those_that_change_something() -> None:
    found = changes()
    keys = {(each.change, each.op) for each in found}
    assert (MOTOR, "left-out") in keys
    assert (f"{MOTOR}.targetPosition", "default") not in keys  # it is given by its place
    absent = {
        ("setGravity.gravX", "*10"),
        (f"{MOTOR}.force", "*-1"),
        (f"{MOTOR}.bodyUniqueId", "*10"),
    }
    absent |= {
        ("applyExternalForce", "held"),
        ("loadURDF", "left-out"),
        ("setGravity.gravX", "*-1"),
    }
    absent |= {("createMultiBody.baseMass", "*-1"), ("createConstraint.jointType", "*10")}
    assert not absent & keys
    for change, of in (
        (
            found_of(found, (f"{MOTOR}.force", "*0.1", "all")),
            ("joint0 of pendulum", "joint1 of pendulum"),
        ),
        (found_of(found, ("changeDynamics.lateralFriction", "*10")), ("cube.urdf", "pendulum")),
        (found_of(found, ("setCollisionFilterPair.enableCollision", "=0")), ("plane x cube.urdf",)),
        (found_of(found, ("changeConstraint.maxForce", "=50")), ("constraint1",)),
    ):
        assert change.of == of
    breaks = {(each.change, each.op) for each in found if each.breaks}
    assert {
        ("setGravity.gravZ", "=0"),
        (MOTOR, "held"),
        ("createMultiBody.baseMass", "*10"),
    } <= breaks
    assert not {("changeDynamics.lateralFriction", "*10"), (f"{MOTOR}.force", "*10")} & breaks


def test_a_push_before_the_first_step_is_repeated_before_each() -> None:
    def pushed(p: Any, *, each: bool = False, box: int = 0) -> bytes:
        p.resetSimulation()
        for number in range(2):
            p.createMultiBody(1, basePosition=[number, 0, 0])
        for body in (0, 1):
            p.applyExternalForce(body, -1, [3, 0, 0], [0, 0, 0], p.LINK_FRAME)
        for _ in range(5):
            p.stepSimulation()
            if each:
                p.applyExternalForce(box, -1, [3, 0, 0], [0, 0, 0], p.LINK_FRAME)
        return np.array([p.getBasePositionAndOrientation(body)[0] for body in (0, 1)]).tobytes()

    seen = Watched(BULLET.sees)
    bare = pushed(seen)
    found = possible(p, BULLET.tried, seen.interventions.seen)
    change = the(found, "applyExternalForce", "each-step")
    for place in (0, 1):
        run = Watched(json.loads(json.dumps(trial_of(change.of_some([place]))))["interventions"])
        assert pushed(run) == pushed(p, each=True, box=place) != bare
        assert run.fired
    (added,) = (each for each in found if each.change == "changeDynamics.ccdSweptSphereRadius")
    assert Path(added.site[0]).name == Path(__file__).name, (
        "an added call has the first step's line"
    )
    assert "stepSimulation" in Path(__file__).read_text().splitlines()[added.site[1] - 1]
    assert f":{added.site[1]}" in BULLET.words_of(added)
    assert "site" not in trial_of(added)["interventions"][0]


def test_a_change_of_some_elements_or_by_another_factor() -> None:
    """An added call affects given elements only; a change may affect several lines of one joint."""
    found = changes()
    friction = found_of(found, ("changeDynamics.lateralFriction", "=3"))
    of_plane = friction.of_some([friction.ids.index((0, 0, -1))])

    def slippery(*_: int) -> None:
        p.changeDynamics(0, -1, lateralFriction=3)

    run = Watched(trial_of(of_plane)["interventions"])
    assert script(run).tobytes() == script(p, before=slippery).tobytes()
    force = found_of(found, (f"{MOTOR}.force", "*0.1", "all"))
    run = Watched(trial_of(force.of_some([1]).by(0.5))["interventions"])
    assert script(run).tobytes() == script(p, other=2.5).tobytes()


def test_a_change_may_begin_at_any_step() -> None:
    """From the step at which a trial is forked, calls are added once, and others changed."""
    found = changes()
    added = found_of(found, ("changeDynamics.linearDamping", "=0"))
    run, later = Watched([]), Watched(trial_of(added)["interventions"])

    class Parting:
        def __init__(self) -> None:
            self.steps = 0

        def __getattr__(self, name: str) -> Any:
            self.steps += name == "stepSimulation"
            return getattr(later if self.steps > 15 else run, name)

    bare = script(p, at=15, before=dynamics(linearDamping=0, angularDamping=0))
    assert script(Parting()).tobytes() == bare.tobytes()
    assert bare.tobytes() != script(p).tobytes()


def test_two_bodies_of_one_name_are_told_apart_and_an_element_of_one_line_has_its_line() -> None:
    p.resetSimulation()
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    watched = Watched(BULLET.sees)
    for height in (1, 2):
        watched.loadURDF("cube_small.urdf", [0, 0, height])
    watched.loadURDF("plane.urdf")
    watched.stepSimulation()
    found = possible(p, BULLET.tried, watched.interventions.seen)
    fixed = [each for each in found if (each.change, each.op) == ("loadURDF.useFixedBase", "^1")]
    of_lines, together = fixed[:-1], fixed[-1]
    assert [each.of for each in of_lines] == [("cube_small body0", "cube_small body1"), ("plane",)]
    assert together.of == ("cube_small body0", "cube_small body1", "plane")
    assert together.site is None
    assert [together.of_some([n]).site for n in (0, 2)] == [each.site for each in of_lines]
    assert together.of_some([2]).key == of_lines[1].key
    # Of two bodies that one line loads, one alone stays where it is.
    p.resetSimulation()
    second = Watched(trial_of(replace(together.of_some([1]), site=None))["interventions"])
    for height in (1, 2):
        second.loadURDF("cube_small.urdf", [0, 0, height])
    p.setGravity(0, 0, -9.81)
    p.stepSimulation()
    assert p.getBasePositionAndOrientation(0)[0][2] < 1
    assert p.getBasePositionAndOrientation(1)[0][2] == 2


def test_what_makes_a_thing_and_is_left_out_returns_that_there_is_none() -> None:
    left_out = found_of(changes(), ("createConstraint", "left-out"))
    run = Watched(trial_of(replace(left_out, site=None, ids=((0, None, None),)))["interventions"])
    body = p.createMultiBody(1)
    joints = p.getNumConstraints()
    made = run.createConstraint(body, -1, -1, -1, p.JOINT_FIXED, [0] * 3, [0] * 3, [0] * 3)
    assert (made, p.getNumConstraints()) == (-1, joints)


def several(p: Any, *, targets: Any = (0.3, 0.2), joints: Any = (0, 1), turn: Any = None) -> bytes:
    """Run a script that commands two joints of a lying arm in one call; return its states."""
    p.disconnect()
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.81)
    turned = p.getQuaternionFromEuler([1.2, 0, 0]) if turn is None else turn
    arm = p.loadURDF("pendulum5.urdf", [0, 0, 1], turned, useFixedBase=True)
    states = []
    for _ in range(STEPS):
        p.setJointMotorControlArray(
            arm, joints, p.POSITION_CONTROL, targetPositions=targets, forces=[50] * len(joints)
        )
        p.stepSimulation()
        states += [p.getJointState(arm, joint)[0] for joint in range(4)]
    return np.array(states).tobytes()


def test_a_call_for_several_joints_is_changed_for_one_and_a_turned_body_stands_upright() -> None:
    run = Watched(BULLET.sees)
    several(run)
    found = possible(p, BULLET.tried, run.interventions.seen)
    targets = the(found, "setJointMotorControlArray.targetPositions", "*-1")
    assert len(targets.of) == 2

    def made(change: Change) -> bytes:
        changed = Watched(json.loads(json.dumps(trial_of(change)["interventions"])))
        return several(changed)

    assert made(targets) == several(p, targets=(-0.3, -0.2))
    assert made(targets.of_some([1])) == several(p, targets=(0.3, -0.2))
    out = the(found, "setJointMotorControlArray", "left-out")
    assert made(out.of_some([1])) == several(p, targets=(0.3,), joints=(0,))
    upright = the(found, "loadURDF.baseOrientation", "=default")
    assert made(upright) == several(p, turn=[0, 0, 0, 1])
    assert upright.target == ("pendulum5",)
    x, y, z, w = p.getQuaternionFromEuler([1.2, 0, 0])
    assert made(the(found, "loadURDF.baseOrientation", "w-last")) == several(p, turn=[y, z, w, x])
