"""Verification: changeDynamics affects the link that bare PyBullet changes for the same call.

Each pair of keywords, and many sets of them, are given to link 0 of a body of two links; which link
then reports another spinning friction (or another mass) is the one that the call reached.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pybullet as p
import pytest
from conftest import some
from drop_physics.explain.recording import Explanation
from drop_physics.trace import log
from drop_physics.trace.properties import ORDER, link_reached
from drop_physics.trace.requests import requests
from scenes import explanation, record

GIVES: Mapping[str, Mapping[str, Any]] = {
    "jointLimitForce": {"jointLimitForce": 5.0},
    "jointLowerLimit": {"jointLowerLimit": -1.0, "jointUpperLimit": 1.0},
    "mass": {"mass": 3.0},
    "anisotropicFriction": {"anisotropicFriction": [1.0, 1.0, 1.0]},
    "localInertiaDiagonal": {"localInertiaDiagonal": [0.1, 0.2, 0.3]},
    "lateralFriction": {"lateralFriction": 0.9},
    "spinningFriction": {"spinningFriction": 0.1},
    "rollingFriction": {"rollingFriction": 0.1},
    "linearDamping": {"linearDamping": 0.1},
    "angularDamping": {"angularDamping": 0.1},
    "jointDamping": {"jointDamping": 0.7},
    "restitution": {"restitution": 0.5},
    "contactStiffness": {"contactStiffness": 1000.0, "contactDamping": 10.0},
    "frictionAnchor": {"frictionAnchor": 1},
    "ccdSweptSphereRadius": {"ccdSweptSphereRadius": 0.1},
    "activationState": {"activationState": 1},
    "contactProcessingThreshold": {"contactProcessingThreshold": 0.1},
    "maxJointVelocity": {"maxJointVelocity": 50.0},
    "collisionMargin": {"collisionMargin": 0.001},
    "sleepThreshold": {"sleepThreshold": 0.1},
}
"""Arguments with which a call makes PyBullet run the setter of an argument."""
IGNORED: Mapping[str, Mapping[str, Any]] = {
    "linearDamping": {"linearDamping": -1.0},
    "maxJointVelocity": {"maxJointVelocity": -0.5},
    "activationState": {"activationState": -1},
    "jointLowerLimit": {"jointLowerLimit": 1.0, "jointUpperLimit": -1.0},
    "restitution": {"restitution": -1.0},
}
"""Values for which PyBullet ignores the argument."""


@pytest.fixture(scope="module")
def client() -> Iterator[int]:
    client = p.connect(p.DIRECT)
    yield client
    p.disconnect(client)


def made(client: int) -> int:
    p.resetSimulation(client)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3, physicsClientId=client)
    return int(
        p.createMultiBody(
            1,
            box,
            linkMasses=[1],
            linkCollisionShapeIndices=[box],
            linkVisualShapeIndices=[-1],
            linkPositions=[[0, 0, 1]],
            linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0] * 3],
            linkInertialFrameOrientations=[[0, 0, 0, 1]],
            linkParentIndices=[0],
            linkJointTypes=[p.JOINT_REVOLUTE],
            linkJointAxis=[[1, 0, 0]],
            physicsClientId=client,
        )
    )


def changed(client: int, link: int, given: Mapping[str, Any]) -> list[int]:
    """Return the links whose reported properties change after a call."""
    body = made(client)
    before = [p.getDynamicsInfo(body, each, client) for each in (-1, 0)]
    p.changeDynamics(body, link, **given, physicsClientId=client)
    after = [p.getDynamicsInfo(body, each, client) for each in (-1, 0)]
    return [n - 1 for n in range(2) if before[n] != after[n]]


def reached(link: int, given: Mapping[str, Any]) -> int:
    values = {name: np.ravel(value).astype(float).tolist() for name, value in given.items()}
    return link_reached({"bodyUniqueId": [0.0], "linkIndex": [float(link)], **values})


def shown(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a call's arguments after a friction value, whose effect shows the changed link."""
    probe = "rollingFriction" if "spinningFriction" in given else "spinningFriction"
    return {probe: 0.33, **given}


def test_every_pair_of_keywords_lands_where_the_order_says(client: int) -> None:
    assert list(ORDER) == [name for name in GIVES if name != "sleepThreshold"]
    base = set()
    for first, second in product(GIVES, GIVES):
        given = shown({**GIVES[first], **GIVES[second]})
        (link,) = changed(client, 0, given)
        assert link == reached(0, given), given
        assert changed(client, -1, given) == [-1] == [reached(-1, given)]
        if link == -1:
            base.add(first)
    assert base == {*GIVES}  # each keyword can be carried to the base by another


def test_many_keywords_together_land_where_the_last_one_says(client: int) -> None:
    draw = random.Random(20)
    found = set()
    for _ in range(400):
        names = draw.sample([*GIVES], draw.randint(3, 8))
        given = {key: value for name in names for key, value in GIVES[name].items()}
        for name in draw.sample([*IGNORED], 2):
            if name not in names:
                given |= IGNORED[name]
        given = shown(given)
        (link,) = changed(client, 0, given)
        assert link == reached(0, given), given
        found.add(link)
    assert found == {-1, 0}


@pytest.mark.parametrize("name", [*IGNORED])
def test_a_value_that_pybullet_ignores_carries_nothing(client: int, name: str) -> None:
    given = shown({"linearDamping": 0.1, **IGNORED[name]})
    (link,) = changed(client, 0, given)
    assert link == reached(0, given) == (0 if name == "linearDamping" else -1)


def test_a_call_that_names_no_link_of_the_body_reaches_none_but_by_the_base(client: int) -> None:
    assert changed(client, 7, {"mass": 3.0}) == []
    assert reached(7, {"mass": 3.0}) == 7
    given = {"mass": 3.0, "linearDamping": 0.0}
    assert changed(client, 7, given) == [-1] == [reached(7, given)]


# -- what becomes of the step ----------------------------------------------------------------------

ARM = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model_free_base.urdf", [0, 0, 1], useFixedBase=True)
for j in range(7):
    p.resetJointState(k, j, 0.3, 0.5)
    p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
    p.changeDynamics(k, j, {given})
steps(120)
"""
LINKED = {
    "damping of joints to the base": ("jointDamping=3, maxJointVelocity=90", False),
    "damping of joints, rescued": ("jointDamping=3, linearDamping=0.1", True),
    "limits to the base": (
        "jointLowerLimit=-0.4, jointUpperLimit=0.4, linearDamping=0, angularDamping=0",
        False,
    ),
    "limits, rescued by a word": (
        "jointLowerLimit=-0.4, jointUpperLimit=0.4, linearDamping=0, frictionAnchor=True",
        True,
    ),
    "not rescued by the frictions": (
        "jointDamping=3, lateralFriction=1, spinningFriction=0.1, activationState=2",
        False,
    ),
}


@pytest.mark.parametrize("name", some([*LINKED], 2))
def test_every_step_is_explained_wherever_a_call_lands(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If damping of the base is attributed to the named link, steps stay unexplained."""
    given, on_link = LINKED[name]
    seen = record(ARM.replace("{given}", given), tmp_path / "arm.rrd").seen
    assert {each.link >= 0 for each in seen.calls.given()} == {on_link}
    totals = explanation(seen).totals[0]
    assert totals.explained == totals.samples == 121
    monkeypatch.setattr(log, "link_reached", lambda values: int(values["linkIndex"][0]))
    named = explanation(seen).totals[0]
    assert (named.explained == named.samples) == (on_link or "jointDamping" not in given)


def test_limits_that_the_base_got_are_not_the_joints(tmp_path: Path) -> None:
    for name in (each for each in LINKED if "limits" in each):
        given, on_link = LINKED[name]
        whole = Explanation(record(ARM.replace("{given}", given), tmp_path / "arm.rrd").seen)
        (piece,) = whole.pieces(1000)
        law = piece.bodies[0].intervals[-1].law
        of_file = [joint.limits[1] for joint in piece.bodies[0].body.joints]
        assert law.upper.tolist() == ([0.4] * 7 if on_link else of_file)


# -- asked and got ---------------------------------------------------------------------------------

ASKED = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model_free_base.urdf", [0, 0, 1], useFixedBase=True)
p.changeDynamics(k, 2, mass=2.5, lateralFriction=0.25)
b = p.loadURDF("cube_small.urdf", [2, 0, 3])
p.changeDynamics(b, -1, mass=3)
steps(3)
p.setTimeStep(1 / 100)
p.setPhysicsEngineParameter(numSolverIterations=-3, numSubSteps=0, contactERP=0.3)
p.changeDynamics(k, 5, lateralFriction=0.75, jointDamping=2, maxJointVelocity=90)
p.changeDynamics(k, 5, restitution=-1, spinningFriction=0.5)
p.changeDynamics(k, 4, rollingFriction=0.1)
p.changeDynamics(k, 4, rollingFriction=0.2)
steps(3)
p.changeDynamics(k, 9, mass=1)
p.changeDynamics(b, -1, mass=3)
m = p.createMultiBody(2, useMaximalCoordinates=True, basePosition=[5, 0, 5])
p.changeDynamics(m, -1, mass=0.3, restitution=0.5)
steps(2)
p.changeDynamics(b, -1, localInertiaDiagonal=[0.1, 0.2, 0.3])
"""
TURNS = (0.1, 0.2, 0.3)
EXPECTED = {
    # line, argument: link, link reached, asked, before, got, whether it took
    (3, "mass"): (2, 2, (2.5,), None, (2.5,), True),
    (3, "lateralFriction"): (2, 2, (0.25,), None, (0.25,), True),
    (5, "mass"): (-1, -1, (3.0,), None, (3.0,), True),
    (9, "lateralFriction"): (5, -1, (0.75,), (0.5,), (0.5,), False),
    (9, "jointDamping"): (5, -1, (2.0,), None, None, False),
    (9, "maxJointVelocity"): (5, -1, (90.0,), None, None, True),
    (10, "restitution"): (5, 5, (-1.0,), (0.0,), (0.0,), False),
    (10, "spinningFriction"): (5, 5, (0.5,), (0.0,), (0.5,), True),
    (12, "rollingFriction"): (4, 4, (0.2,), (0.0,), (0.2,), True),
    (14, "mass"): (9, 9, (1.0,), None, None, False),
    (15, "mass"): (-1, -1, (3.0,), (3.0,), (3.0,), True),
    (17, "mass"): (-1, -1, (0.3,), None, (0.3,), True),
    (17, "restitution"): (-1, -1, (0.5,), None, None, True),
    (19, "localInertiaDiagonal"): (-1, -1, TURNS, (3 * 0.05**2 / 6,) * 3, TURNS, True),
    (1, "gravX"): (-1, -1, (0.0,), None, (0.0,), True),
    (1, "gravY"): (-1, -1, (0.0,), None, (0.0,), True),
    (1, "gravZ"): (-1, -1, (-9.81,), None, (-9.81,), True),
    (7, "timeStep"): (-1, -1, (0.01,), (1 / 240,), (0.01,), True),
    (8, "numSolverIterations"): (-1, -1, (-3.0,), (50.0,), (50.0,), False),
    (8, "numSubSteps"): (-1, -1, (0.0,), (0.0,), (0.0,), True),
    (8, "contactERP"): (-1, -1, (0.3,), None, None, True),
}
"""Results of bare PyBullet: links have a friction of 0.5, the cube has edges of 5 cm. Values before
a body was listed are unknown; line 12 repeats line 11; there is no link 9."""


def test_what_was_asked_and_what_was_got_are_both_there(tmp_path: Path) -> None:
    seen = record(ASKED, tmp_path / "asked.rrd").seen
    found = requests(seen.calls, seen.dynamics, seen.settings)
    rows = {
        (each.call.line, each.name): (
            each.link,
            each.reached,
            each.asked,
            each.before,
            each.got,
            each.taken,
        )
        for each in found
    }
    assert rows == EXPECTED
    assert len(found) == len(rows)
    assert [each.elsewhere for each in found if each.elsewhere] == [(0.75,)]
