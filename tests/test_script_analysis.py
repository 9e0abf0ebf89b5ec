"""`drop analyze` of a script's recording: each sample follows from its step, or is unexplained.

The scenes are recorded in PyBullet itself; what is said of them is held against what they were told
to do, against the contact points that PyBullet reports, and against steps that are taken again.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pybullet as p
import pybullet_data
import pytest
import scenes
from altered import otherwise
from clients import release_clients
from command import drop_here
from conftest import Drop, Recorder, judge, rerun_rrd, some
from drop_physics.analysis.results import Analysis, BodyAnalysis
from drop_physics.recording.reader import Recording
from drop_physics.report.episodes import episode_lines
from drop_physics.report.terminal import show
from drop_physics.trace.history import Seen
from drop_physics.trace.tables import table_of
from engine import MODES, ROUNDS_ONCE
from scenes import analyze, body_of, codes

GRAVITY = "p.setGravity(0, 0, -9.81)\n"
FLOOR = GRAVITY + 'p.loadURDF("plane.urdf")\n'
CUBE = 'b = p.loadURDF("cube_small.urdf", [0, 0, {}], useMaximalCoordinates={{maximal}})\n'
IN_AIR, ABOVE = CUBE.format(3), CUBE.format(0.3)
TURNED = "turned = p.getQuaternionFromEuler([0.4, 0.7, 0.1])\n"

SCENES: dict[str, tuple[str, dict[str, int]]] = {
    "free fall": (GRAVITY + IN_AIR + "steps(50)", {"flight": 50}),
    "tumbling bounces": (
        FLOOR + TURNED + ABOVE
        + "for one in (0, b): p.changeDynamics(one, -1, restitution=0.8)\n"
        "p.resetBasePositionAndOrientation(b, [0, 0, 0.3], turned)\n"
        "p.resetBaseVelocity(b, [0.3, 0, 0], [3, -5, 7])\nsteps(200)",
        {},
    ),
    "pushes": (
        GRAVITY + TURNED + IN_AIR
        + """
p.resetBasePositionAndOrientation(b, [0, 0, 3], turned)
p.resetBaseVelocity(b, [0.3, 0, 0], [3, -5, 7])
for i in range(80):
    x, y, z = p.getBasePositionAndOrientation(b)[0]
    if 10 <= i < 20:
        p.applyExternalForce(b, -1, [0.5, 0.1, 0], [x + 0.01, y, z + 0.02], p.WORLD_FRAME)
    if 30 <= i < 40:
        p.applyExternalForce(b, -1, [0.5, 0.1, 0], [0.01, -0.02, 0.02], p.LINK_FRAME)
    if 50 <= i < 60:
        p.applyExternalTorque(b, -1, [1e-4, 2e-4, 0], p.WORLD_FRAME)
    if 65 <= i < 75:
        p.applyExternalTorque(b, -1, [1e-4, 2e-4, 0], p.LINK_FRAME)
    p.stepSimulation()
""",
        {"flight": 40, "pushed": 40},
    ),
    "pushes that cancel": (
        GRAVITY + TURNED + IN_AIR
        + """
p.resetBasePositionAndOrientation(b, [0, 0, 3], turned)
for i in range(40):
    for x, y in ((0.1, 0), (0, 0.1), (-0.1, 0), (0, -0.1)):
        p.applyExternalForce(b, -1, [0, 0, 1.3], [x, y, 0.02], p.LINK_FRAME)
    p.stepSimulation()
for i in range(20):
    x, y, z = p.getBasePositionAndOrientation(b)[0]
    for sign in (-1, 1):
        p.applyExternalForce(b, -1, [0.3, sign, 7], [x + sign, y + 0.3, z], p.WORLD_FRAME)
        p.applyExternalForce(b, -1, [-0.3, -sign, -7], [x + sign, y + 0.3, z], p.WORLD_FRAME)
    p.stepSimulation()
""",
        {"pushed": 60},
    ),
    "loaded at three numbers": (
        GRAVITY + 'b = p.loadURDF("cube_small.urdf", 0, 0, 1)\nsteps(50)', {"flight": 50},
    ),
    "put elsewhere": (
        GRAVITY + IN_AIR
        + "steps(30)\np.resetBasePositionAndOrientation(b, [1, 0, 5], [0, 0, 0, 1])\n"
        "steps(30)\np.resetBaseVelocity(b, [1, 0, 2], [0, 3, 1])\nsteps(40)",
        {"flight": 98, "set": 3},
    ),
    "restored": (
        FLOOR + ABOVE
        + "steps(30)\ns = p.saveState()\nsteps(50)\np.restoreState(s)\nsteps(20)",
        {"set": 2},
    ),
    "timestep": (
        GRAVITY + IN_AIR
        + "p.resetBaseVelocity(b, [1, 0, 0], [1, 2, 3])\nsteps(30)\np.setTimeStep(1 / 100)\n"
        "steps(30)\np.setPhysicsEngineParameter(fixedTimeStep=1 / 500)\nsteps(30)",
        {"flight": 90},
    ),
    "gravity along x": ("p.setGravity(-9.81, 0, 0)\n" + IN_AIR + "steps(30)", {"flight": 30}),
    "damping and gravity": (
        GRAVITY + IN_AIR
        + "steps(20)\np.changeDynamics(b, -1, linearDamping=0, angularDamping=0)\nsteps(20)\n"
        "p.changeDynamics(b, -1, linearDamping=0.5)\nsteps(20)\n"
        "p.changeDynamics(b, -1, linearDamping=-1)\nsteps(10)\np.setGravity(0, 0, -1)\nsteps(10)",
        {"flight": 80},
    ),
    "mass": (
        FLOOR + ABOVE + "steps(30)\np.changeDynamics(b, -1, mass=3)\nsteps(90)", {"set": 1},
    ),
    "removed and loaded": (
        FLOOR + ABOVE + "steps(40)\np.removeBody(b)\nsteps(40)\n" + ABOVE + "steps(40)",
        {"flight": 79, "set": 2},
    ),
    "reset": (
        "for gravity in (-9.81, -20, -1):\n    p.resetSimulation()\n"
        '    p.setGravity(0, 0, gravity)\n    p.loadURDF("plane.urdf")\n    '
        + ABOVE + "    p.changeDynamics(b, -1, linearDamping=0.1 + gravity / 100)\n    steps(30)",
        {"set": 3},
    ),
    "rolling friction": (
        FLOOR + 'b = p.loadURDF("sphere_small.urdf", [0, 0, 0.1], useMaximalCoordinates={maximal})'
        "\np.changeDynamics(b, -1, rollingFriction=0.01, spinningFriction=0.01)\n"
        "p.resetBaseVelocity(b, [1, 0, 0], [0, 3, 9])\nsteps(150)",
        {"set": 1},
    ),
    "pushed where it may roll": (
        FLOOR + 'b = p.loadURDF("sphere_small.urdf", [0, 0, 0.03], useMaximalCoordinates={maximal})'
        "\np.changeDynamics(b, -1, rollingFriction=0.01)\nsteps(10)\nfor i in range(30):\n"
        "    p.applyExternalForce(b, -1, [0.5, 0, 0], [0, 0, 0], p.LINK_FRAME)\n    steps(1)",
        {"pushed": 30, "set": 1},
    ),
    "spring": (
        FLOOR + ABOVE + "p.changeDynamics(b, -1, contactStiffness=1000, contactDamping=10)\n"
        "steps(150)",
        {"set": 1},
    ),
    "pushed on the floor": (
        FLOOR + CUBE.format(0.025)
        + "steps(10)\nfor i in range(30):\n"
        "    p.applyExternalForce(b, -1, [0.5, 0, 0], [0, 0, 0], p.LINK_FRAME)\n    steps(1)",
        {"pushed": 30, "set": 1},
    ),
}  # fmt: skip
"""Scenes about the body loaded last, with the expected number of samples of each kind; all are
explained."""

Analyzed = Callable[[str], tuple[Recording, Analysis]]


@pytest.fixture(scope="session")
def analyzed(tmp_path_factory: pytest.TempPathFactory) -> Analyzed:
    """Return a function that records and analyzes a scene, once each."""
    folder, known = tmp_path_factory.mktemp("scenes"), dict[str, Any]()

    def call(scene: str) -> tuple[Recording, Analysis]:
        if scene not in known:
            recording = scenes.record(scene, folder / f"{len(known)}.rrd")
            known[scene] = recording, analyze(recording.seen, at_s=(0.1,))
        return known[scene]  # type: ignore[no-any-return]

    return call


def steps_with_forces(seen: Seen, number: int) -> set[int]:
    """Return the steps in which PyBullet reports a force on a body."""
    acts = pl.any_horizontal(pl.col("normal_force_n", "friction_1_n", "friction_2_n") != 0)
    its = (pl.col("body_a") == number) | (pl.col("body_b") == number)
    return set(table_of(seen.contacts).filter(its, acts)["step"].to_list())


def steps_that_are(analysis: Analysis, number: int, segment: str) -> list[int]:
    its = (pl.col("body") == number) & (pl.col("segment") == segment)
    return analysis.table.filter(its)["step"].to_list()


def check_flights(body: BodyAnalysis) -> None:
    """Check that the terms of each flight add up to its error, without a rounding term."""
    for flight in body.flights:
        for moment in (flight, *flight.at):
            if moment.terms_m is None:
                continue
            terms = np.array(astuple(moment.terms_m))
            # Bodies are some metres away: positions are doubles to 9e-16 m.
            assert np.abs(terms.sum(axis=0) - moment.error_m).max() <= 2e-15
            assert np.abs(terms[3]).max() < (1e-13 if ROUNDS_ONCE else 1e-9)


@pytest.mark.parametrize("maximal", [False, True], ids=["reduced", "maximal"])
@pytest.mark.parametrize("name", some(SCENES, 3))
def test_every_sample_is_explained(analyzed: Analyzed, name: str, *, maximal: bool) -> None:
    text, expected = SCENES[name]
    recording, analysis = analyzed(text.replace("{maximal}", str(maximal)))
    body = analysis.bodies[-1]
    counts = body.segments
    assert body.unexplained == []
    assert analysis.explained.samples == analysis.explained.of == sum(counts.values())
    assert counts["still"] == 0
    assert {name: counts[name] for name in expected} == expected
    touched = steps_with_forces(recording.seen, body.id)
    pushed = {one.at.step + 1 for one in recording.seen.calls.pushes()}
    assert set(steps_that_are(analysis, body.id, "contact")) == touched - pushed
    assert set(steps_that_are(analysis, body.id, "pushed")) == pushed
    assert not touched & set(steps_that_are(analysis, body.id, "flight"))
    check_flights(body)


FOUND_ONCE = {
    "a push off the centre of what has no inertia": """
p.setGravity(0, 0, -9.81)
b = p.createMultiBody(1, -1, -1, [0, 0, 2], useMaximalCoordinates={maximal})
steps(20)
p.applyExternalTorque(b, -1, [0, .1, 0], p.WORLD_FRAME)
steps(20)
p.applyExternalForce(b, -1, [1, 0, 0], [0, .1, 0], p.LINK_FRAME)
steps(20)
""",
    "pushed, then put elsewhere": """
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .15, .2])
turned = p.getQuaternionFromEuler([.3, .2, .1])
b = p.createMultiBody(1, box, -1, [0, 0, 2], turned, useMaximalCoordinates={maximal})
p.applyExternalForce(b, -1, [5, 2, 1], [0, .1, .05], p.LINK_FRAME)
p.resetBasePositionAndOrientation(b, [0, 0, 3], [0, 0, 0, 1])
steps(30)
p.applyExternalForce(b, -1, [5, 2, 1], [0, .1, .05], p.LINK_FRAME)
p.resetBasePositionAndOrientation(b, [0, 0, 3], [0, 0, 0, 1])
steps(10)
p.resetBasePositionAndOrientation(b, [0, 0, 2], turned)
p.applyExternalForce(b, -1, [5, 2, 1], [0, .1, 2.05], p.WORLD_FRAME)
p.resetBasePositionAndOrientation(b, [0, 0, 3], [0, 0, 0, 1])
steps(10)
""",
    "a push at the limit of the spin": """
p.setTimeStep(1 / 60)
shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=.18, height=.16)
b = p.createMultiBody(.1, shape, -1, [0, 0, 1], useMaximalCoordinates={maximal})
p.resetBaseVelocity(b, [0, 0, 0], [28, 14, -3])
for step in range(74):
    if step >= 45:
        p.applyExternalForce(b, -1, [-174, -28, 50], [0, -.122, -.1], p.WORLD_FRAME)
    p.stepSimulation()
""",
    "a moment of inertia of 0 on a floor": """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
turned = p.getQuaternionFromEuler([.3, .2, .1])
p.loadURDF("random_urdfs/000/000.urdf", [0, 0, .3], turned, {maximal},
           flags=p.URDF_USE_INERTIA_FROM_FILE)
steps(150)
""",
    "an impulse that is tried and taken back, of a spin of 0": """
p.setGravity(0, 0, -9.81)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
p.createMultiBody(0, box, useMaximalCoordinates={maximal})
p.createMultiBody(1, box, -1, [.02, 0, .165], useMaximalCoordinates={maximal})
steps(30)
""",
}
"""Scenes that were once reported as a mismatch by mistake."""


def test_a_push_of_what_is_gone_is_not_of_what_has_its_id(analyzed: Analyzed) -> None:
    _, analysis = analyzed("""
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
b = p.createMultiBody(1, shape, -1, [0, 0, 1])
steps(10)
p.applyExternalForce(b, -1, [5, 0, 0], [0, 0, 0], p.LINK_FRAME)
p.removeBody(b)
p.createMultiBody(2, shape, -1, [0, 0, 1])
steps(10)
""")
    assert all(one.segments["pushed"] == 0 for one in analysis.bodies)


def test_a_push_that_the_limit_holds_is_explained(analyzed: Analyzed) -> None:
    _, analysis = analyzed("""
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .15, .2])
b = p.createMultiBody(1, shape, -1, [0, 0, 9])
for _ in range(30):
    p.applyExternalForce(b, -1, [0, 0, 3000], [0, 0, 0], p.LINK_FRAME)
    p.stepSimulation()
""")
    assert analysis.bodies[0].unexplained == []


def test_a_body_that_loses_its_mass_on_the_way_is_recorded_on(analyzed: Analyzed) -> None:
    _, analysis = analyzed("""
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .15, .2])
b = p.createMultiBody(1, shape, -1, [0, 0, 3])
p.setGravity(0, 0, -9.81)
steps(20)
p.changeDynamics(b, -1, mass=0)
steps(20)
p.changeDynamics(b, -1, mass=1)
steps(20)
""")
    (body,) = analysis.bodies
    assert sum(body.segments.values()) == 61
    assert body.unexplained == []  # it keeps its velocity
    assert body.segments["set"] == 21


@pytest.mark.parametrize("timestep", ["0", "1e-17", "-1 / 240"])
@pytest.mark.parametrize("maximal", [False, True])
def test_a_timestep_that_is_none_has_no_law(
    analyzed: Analyzed, timestep: str, *, maximal: bool
) -> None:
    """Bullet skips a step of 0 or 1e-17 s, and reverses time for a negative one."""
    _, analysis = analyzed(f"""
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=.1)
b = p.createMultiBody(1, ball, -1, [0, 0, 5], useMaximalCoordinates={maximal})
p.changeDynamics(b, -1, activationState=p.ACTIVATION_STATE_ENABLE_SLEEPING)
p.setGravity(0, 0, -9.81)
steps(3)
p.setTimeStep({timestep})
steps(3)
p.setTimeStep(1 / 240)
steps(3)
""")
    (body,) = analysis.bodies
    (held,) = body.unexplained
    assert held.reason == "timestep"
    assert (held.first_step, held.samples, body.segments["flight"]) == (4, 3, 6)


def test_a_point_that_does_not_push_has_no_friction(analyzed: Analyzed) -> None:
    """Beyond contactProcessingThreshold the engine reports another contact point's friction."""
    _, analysis = analyzed("""
p.setGravity(0, 0, -9.81)
slab = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, .05])
f = p.createMultiBody(0, slab, -1, [0, 0, -.05])
b = p.createMultiBody(.17, p.createCollisionShape(p.GEOM_SPHERE, radius=.03), -1, [0, 0, .03])
for each in (f, b):
    p.changeDynamics(each, -1, linearDamping=0, lateralFriction=.2, contactProcessingThreshold=0)
p.resetBaseVelocity(b, [1, 0, 0])
steps(200)
assert any(c[9] == 0 and c[12] != 0 for c in p.getContactPoints(b))
""")
    assert body_of(analysis, 1).unexplained == []
    assert body_of(analysis, 1).touches[0].used <= 1 + 1e-9


BELTS = {
    "mass taken": "belt = p.createMultiBody(1, slab, -1, [0, 0, -.5])\n"
    "p.changeDynamics(belt, -1, mass=0)\np.resetBaseVelocity(belt, [1, 0, 0])\n",
    "none": "belt = p.createMultiBody(0, slab, -1, [0, 0, -.5])\n"
    "p.resetBaseVelocity(belt, [1, 0, 0])\n",
    "fixed base": 'belt = p.loadURDF("cube.urdf", [0, 0, -.5], useFixedBase=True)\n'
    "p.resetBaseVelocity(belt, [1, 0, 0])\n",
}


@pytest.mark.parametrize("what", BELTS)
def test_a_belt_without_mass_moves_and_is_recorded(analyzed: Analyzed, what: str) -> None:
    """A btMultiBody without mass keeps the velocity that was set."""
    recording, analysis = analyzed(
        "p.setGravity(0, 0, -9.81)\n"
        "slab = p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 5, .5])\n"
        + BELTS[what]
        + """
p.createMultiBody(1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1] * 3), -1, [0, 0, .1])
steps(240)
"""
    )
    belt = body_of(analysis, 0)
    assert belt.unexplained == []
    assert belt.segments["set"] == 241
    end = table_of(recording.seen.states).filter(pl.col("body") == 0)["x_m"][-1]
    assert end == pytest.approx(1, abs=1e-9)
    assert "energy-gained" not in codes(analysis)  # the belt gave it
    box = table_of(recording.seen.states).filter(pl.col("body") == 1)["x_m"][-1]
    # It slides by what the belt is ahead of it, not by its own way.
    assert body_of(analysis, 1).touches[0].slid_m == pytest.approx(end - box, rel=0.05)


def test_the_energy_of_links_is_that_after_the_step(analyzed: Analyzed) -> None:
    """Semi-implicit Euler loses m g² t dt / 2 in free fall; PyBullet reports links a step late."""
    _, analysis = analyzed("""
p.setGravity(0, 0, -9.8)
b = p.loadURDF("r2d2.urdf", [0, 0, 9])
for link in range(-1, p.getNumJoints(b)):
    p.changeDynamics(b, link, linearDamping=0, angularDamping=0)
steps(240)
""")
    body = body_of(analysis, 0)
    assert body.energy is not None
    lost_j = body.mass_kg * 9.8**2 / 240 / 2
    assert body.energy.end_j - body.energy.start_j == pytest.approx(-lost_j, rel=1e-6)


CHAIN = """
p.setGravity(1, 2, -9.81)
p.setTimeStep(1 / 100)
boxes = [
    p.createCollisionShape(p.GEOM_BOX, halfExtents=half)
    for half in ([0.1, 0.2, 0.3], [0.3, 0.1, 0.05], [0.05, 0.3, 0.2])
]
b = p.createMultiBody(
    2, boxes[0], -1, [0, 0, 5], [0.1, 0.2, 0.3, 0.927], linkMasses=[1, 0.5],
    linkCollisionShapeIndices=boxes[1:], linkVisualShapeIndices=[-1, -1],
    linkPositions=[[0.5, 0, 0], [0, 0.6, 0]], linkOrientations=[[0, 0, 0, 1], [0, 0.6, 0, 0.8]],
    linkInertialFramePositions=[[0.1, 0, 0], [0, 0, 0.2]],
    linkInertialFrameOrientations=[[0, 0, 0, 1], [0.6, 0, 0, 0.8]], linkParentIndices=[0, 1],
    linkJointTypes=[p.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 1, 0], [0, 0, 1]],
)
p.resetBaseVelocity(b, [1, 2, 3], [4, -3, 2])
for n in (0, 1):
    p.resetJointState(b, n, 0.3, 5 - 9 * n)
    p.setJointMotorControl2(b, n, p.VELOCITY_CONTROL, force=0)
steps(30)
p.resetJointState(b, 0, -0.4, 3)
steps(30)
"""


def test_the_energy_of_links_is_that_of_their_true_poses(analyzed: Analyzed) -> None:
    """PyBullet computes true poses on request: then the energy is known at every sample."""
    _, analysis = analyzed(CHAIN)
    energies_j: list[float] = []

    def steps(count: int) -> None:
        if not energies_j:
            energies_j.append(_energy_j())
        for _ in range(count):
            p.stepSimulation()
            energies_j.append(_energy_j())

    release_clients()  # what the chain calls is client 0
    p.connect(p.DIRECT)
    try:
        exec(CHAIN, {"p": p, "steps": steps})
    finally:
        p.disconnect()
    found_j = analysis.table["energy_j"].to_numpy()
    assert found_j == pytest.approx(np.array(energies_j), rel=1e-13)
    energy = body_of(analysis, 0).energy
    assert energy is not None
    assert (energy.start_j, energy.end_j) == (found_j[0], found_j[-1])


def _energy_j() -> float:
    """Return the energy of the chain, from poses that PyBullet recomputes."""
    energy_j, gravity_m_s2 = 0.0, np.array([1, 2, -9.81])
    for link in (-1, 0, 1):
        mass_kg, _, inertia_kg_m2, *_ = p.getDynamicsInfo(0, link)
        if link == -1:
            (x, q), (v, w) = p.getBasePositionAndOrientation(0), p.getBaseVelocity(0)
        else:
            x, q, *_, v, w = p.getLinkState(0, link, 1, 1)
        own = np.reshape(p.getMatrixFromQuaternion(q), (3, 3)).T @ w
        energy_j += mass_kg * np.dot(v, v) / 2 + np.dot(inertia_kg_m2, own**2) / 2
        energy_j -= mass_kg * np.dot(gravity_m_s2, x)
    return energy_j


def test_a_belt_that_stops_is_still(analyzed: Analyzed) -> None:
    _, analysis = analyzed("""
belt = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 5, .5]))
for speed in (1, 0, 1):
    p.resetBaseVelocity(belt, [speed, 0, 0])
    steps(10)
""")
    body = body_of(analysis, 0)
    assert (body.segments["still"], body.segments["set"]) == (9, 22)  # a call led to the tenth
    assert body.unexplained == []


def test_a_base_that_moves_later_is_recorded_from_then_on(analyzed: Analyzed) -> None:
    recording, analysis = analyzed("""
p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
b = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1] * 3), -1, [3, 0, 0])
steps(10)
for each in (0, b): p.resetBaseVelocity(each, [1, 0, 0], [0, 0, 1])
steps(10)
""")
    for body, start_m in ((0, -0.1), (1, 3.0)):
        base = table_of(recording.seen.bases).filter(body=body)
        assert base["step"].to_list() == list(range(11, 21))
        assert base["x_m"][0] == pytest.approx(start_m + 1 / 240, abs=1e-3)
    arm = body_of(analysis, 0)  # of which all links are there from the start
    assert arm.segments == {
        **dict.fromkeys(arm.segments, 0),
        "set": 1,
        "still": 10,
        "unexplained": 10,
    }
    assert arm.energy is not None


@pytest.mark.parametrize("mass", ["", "p.changeDynamics(b, -1, mass=5)\n"])
def test_a_btrigidbody_whose_inertia_is_set_is_not_still(analyzed: Analyzed, mass: str) -> None:
    """PyBullet then sets its mass to 0, and divides by it; setting a mass repairs this."""
    recording, analysis = analyzed(
        GRAVITY + "ball = p.createCollisionShape(p.GEOM_SPHERE, radius=.1)\n"
        "b = p.createMultiBody(1, ball, -1, [0, 0, 1], useMaximalCoordinates=True)\n"
        "p.changeDynamics(b, -1, localInertiaDiagonal=[.001] * 3)\n" + mass + "steps(5)"
    )
    body = body_of(analysis, 0)
    finite = table_of(recording.seen.states)["z_m"].is_finite()
    if mass:
        assert finite.all()
        assert (body.segments["flight"], body.unexplained) == (5, [])
    else:
        assert finite.to_list() == [True] + [False] * 5
        assert [each.reason for each in body.unexplained] == ["not finite"]


def test_what_may_roll_flies_where_nothing_acts(analyzed: Analyzed) -> None:
    """The body is nearer to a surface than the threshold, but no force acts."""
    scene = (
        GRAVITY
        + """
p.setPhysicsEngineParameter(contactBreakingThreshold=0.3)
p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=.1), -1, [0, 0, .5])
p.changeDynamics(b, -1, restitution=.8, spinningFriction={})
p.changeDynamics(0, -1, restitution=1)
steps(240)
p.setPhysicsEngineParameter(contactBreakingThreshold=0.02)
"""
    )
    recording, analysis = analyzed(scene.format(0.1))
    forced = steps_with_forces(recording.seen, 1)
    assert 100 < len(forced) < 240
    assert body_of(analysis, 1).segments["contact"] == len(forced)
    assert body_of(analysis, 1).segments == body_of(analyzed(scene.format(0))[1], 1).segments


def test_a_state_that_is_no_number_is_said_to_be_that(analyzed: Analyzed) -> None:
    _, analysis = analyzed("""
shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .15, .2])
b = p.createMultiBody(1, shape, -1, [0, 0, 3])
p.setGravity(0, 0, -9.81)
steps(20)
p.resetBasePositionAndOrientation(b, [0, 0, 3], [0, 0, 0, 0])
steps(20)
""")
    (held,) = analysis.bodies[0].unexplained
    assert (held.reason, held.first_step) == ("not finite", 21)


INFINITE = {
    "gravity": "p.setGravity(0, 0, float('inf'))",
    "velocity": "p.resetBaseVelocity(b, [float('inf'), 0, 0])",
    "mass": "p.changeDynamics(b, -1, mass=float('inf'))",
    "position": "p.resetBasePositionAndOrientation(b, [0, 0, float('inf')], [0, 0, 0, 1])",
}
"""Calls that make states infinite."""


@pytest.mark.parametrize("maximal", [False, True])
@pytest.mark.parametrize("call", some(INFINITE, 1))
def test_nothing_is_printed_of_states_that_are_infinite(
    tmp_path: Path, drop: Drop, call: str, *, maximal: bool
) -> None:
    """Recording and analyzing them causes no numpy warnings, which would fail in pytest."""
    script, recording = tmp_path / "scene.py", tmp_path / "scene.rrd"
    script.write_text(
        f"{scenes.HEAD}p.setGravity(0, 0, -9.81)\n"
        "ball = p.createCollisionShape(p.GEOM_SPHERE, radius=.1)\n"
        f"b = p.createMultiBody(1, ball, -1, [0, 0, 5], useMaximalCoordinates={maximal})\n"
        f"steps(3)\n{INFINITE[call]}\nsteps(3)\n"
    )
    made = drop("record", "--out", str(recording), str(script))
    assert "Warning" not in made.stderr
    told = drop("analyze", str(recording))
    assert "Warning" not in told.stderr
    assert "broken" not in told.stderr


@pytest.mark.parametrize("maximal", [False, True])
@pytest.mark.parametrize("name", FOUND_ONCE)
def test_what_was_found_once_is_explained(analyzed: Analyzed, name: str, *, maximal: bool) -> None:
    _, analysis = analyzed(FOUND_ONCE[name].replace("{maximal}", str(maximal)))
    body = analysis.bodies[-1]
    # A btRigidBody that was just turned is pushed with the inertia of before.
    known = 3 if maximal and name == "pushed, then put elsewhere" else 0
    assert sum(one.samples for one in body.unexplained) == known
    check_flights(body)


def test_gravity_along_x_has_an_error_but_no_terms(analyzed: Analyzed) -> None:
    text, _ = SCENES["gravity along x"]
    _, analysis = analyzed(text.replace("{maximal}", "True"))
    (flight,) = body_of(analysis, 0).flights
    assert flight.terms_m is None
    # Semi-implicit Euler falls short by g t dt / 2 (a btRigidBody is not damped).
    assert flight.error_m[0] == pytest.approx(-9.81 * flight.end_s / 240 / 2, rel=1e-9)
    assert flight.error_m[1:] == (0.0, 0.0)


def test_a_flight_begins_where_a_call_put_the_body(analyzed: Analyzed) -> None:
    text, _ = SCENES["put elsewhere"]
    recording, analysis = analyzed(text.replace("{maximal}", "False"))
    body = body_of(analysis, 0)
    spans = [(one.first_step, one.last_step) for one in body.flights]
    assert spans == [(0, 30), (30, 60), (60, 100)]
    # From where it was put, where PyBullet lets it rest, and not from where it was.
    last = table_of(recording.seen.states).filter(step=60).row(0, named=True)
    z_m = 5.0 - 9.81 * (30 / 240) ** 2 / 2
    assert body.flights[1].error_m == pytest.approx(
        (last["x_m"] - 1.0, last["y_m"], last["z_m"] - z_m), abs=1e-14
    )
    assert -3e-3 < body.flights[1].error_m[2] < 0


def test_each_timestep_damping_and_gravity_begins_a_flight(analyzed: Analyzed) -> None:
    expected = {
        "timestep": [(0, 30), (30, 60), (60, 90)],
        "damping and gravity": [(0, 20), (20, 40), (40, 70), (70, 80)],
        "reset": [(0, 30), (30, 60), (60, 90)],
    }
    for name, spans in expected.items():
        _, analysis = analyzed(SCENES[name][0].replace("{maximal}", "False"))
        flights = analysis.bodies[-1].flights
        assert [(one.first_step, one.last_step) for one in flights] == spans, name
    ends = [one.end_s for one in analyzed_timestep(analyzed)]
    assert ends == pytest.approx([30 / 240, 30 / 240 + 30 / 100, 30 / 240 + 30 / 100 + 30 / 500])


def analyzed_timestep(analyzed: Analyzed) -> list[Any]:
    return body_of(analyzed(SCENES["timestep"][0].replace("{maximal}", "False"))[1], 0).flights


def test_a_body_that_is_loaded_again_has_its_own_damping(analyzed: Analyzed) -> None:
    _, analysis = analyzed(SCENES["reset"][0].replace("{maximal}", "True"))
    for flight, damping in zip(analysis.bodies[-1].flights, (0.0019, -0.1, 0.09), strict=True):
        assert flight.terms_m is not None
        assert (flight.terms_m.damping[2] > 0) == (damping > 0)
    assert "teleported" not in codes(analysis)  # nothing was moved: it is another body


SETTINGS = (
    "useSplitImpulse=1, splitImpulsePenetrationThreshold=0", "enableConeFriction=1",
    "constraintSolverType=p.CONSTRAINT_SOLVER_LCP_DANTZIG", "contactSlop=0.001",
    "warmStartingFactor=0", "frictionERP=0.3", "globalCFM=0.01", "contactERP=0.5", "enableSAT=1",
    "numSolverIterations=3", "restitutionVelocityThreshold=0", "contactBreakingThreshold=0.001",
)  # fmt: skip
"""Engine settings that change contact impulses, but not that the impulses add up."""


@pytest.mark.parametrize("maximal", [False, True], ids=["reduced", "maximal"])
@pytest.mark.parametrize("setting", some(SETTINGS, 4))
def test_contact_adds_up_whatever_the_solver_is_told(
    analyzed: Analyzed, setting: str, *, maximal: bool
) -> None:
    scene = f"""
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.setPhysicsEngineParameter({setting})
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.1, 0.2])
b = p.createMultiBody(1, s, basePosition=[0, 0, 0.3], baseOrientation=[0.1, 0.3, 0.2, 0.9],
    useMaximalCoordinates={maximal})
p.resetBaseVelocity(b, [0.4, 0, 0], [3, -2, 5])
steps(150)
"""
    _, analysis = analyzed(scene)
    assert (analysis.explained.samples, analysis.explained.of) == (151, 151)
    assert body_of(analysis, 1).segments["contact"] > 20


# -- held against steps that are taken again -------------------------------------------------------


@pytest.mark.parametrize("coordinates", MODES)
def test_flights_are_those_of_a_world_with_nothing_in_it(
    analyzed: Analyzed, coordinates: Any
) -> None:
    """Each step of a flight, repeated in a new world from the recorded state, leads to the next."""
    maximal = coordinates == "maximal"
    scene = FLOOR + ABOVE + "p.resetBaseVelocity(b, [0.5, -0.2, 1])\nsteps(140)"
    recording, analysis = analyzed(scene.replace("{maximal}", str(maximal)))
    states = table_of(recording.seen.states).filter(body=1)
    flown = steps_that_are(analysis, 1, "flight")
    flown = flown[: body_of(analysis, 1).flights[0].last_step]
    assert len(flown) > 50
    client = p.connect(p.DIRECT)
    try:
        p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        one = p.loadURDF("cube_small.urdf", useMaximalCoordinates=maximal, physicsClientId=client)
        for step in flown[::7]:
            before, after = (states.filter(step=each).row(0)[3:] for each in (step - 1, step))
            p.resetBasePositionAndOrientation(one, before[:3], before[3:7], physicsClientId=client)
            p.resetBaseVelocity(one, before[7:10], before[10:], physicsClientId=client)
            p.stepSimulation(client)
            pose = p.getBasePositionAndOrientation(one, client)
            found = [value for part in (*pose, *p.getBaseVelocity(one, client)) for value in part]
            assert found == pytest.approx(after, rel=0, abs=0 if ROUNDS_ONCE else 1e-12)
    finally:
        p.disconnect(client)


@pytest.mark.parametrize("column", ["x_m", "qz", "vy_m_s", "wx_rad_s"])
def test_a_state_that_was_altered_is_unexplained(analyzed: Analyzed, column: str) -> None:
    scene = FLOOR + TURNED + ABOVE + "p.resetBaseVelocity(b, [0.5, 0, 1], [1, 2, 3])\nsteps(200)"
    recording, before = analyzed(scene.replace("{maximal}", "False"))
    assert before.explained.samples == before.explained.of
    altered = pl.when(pl.col("step") == 40).then(pl.col(column) + 1e-9).otherwise(pl.col(column))
    bases = table_of(recording.seen.bases).with_columns(altered.alias(column))
    seen = otherwise(recording.seen, bases=bases)
    analysis = analyze(seen)
    # A spin may be off by what moves nothing further.
    assert steps_that_are(analysis, 1, "unexplained") in ([40, 41], [40][: column == "wx_rad_s"])
    (held,) = body_of(analysis, 1).unexplained
    assert (held.reason, held.first_step) == ("remainder", 40)
    assert held.remainder < 1e-6


def test_a_contact_that_was_altered_is_unexplained(analyzed: Analyzed) -> None:
    recording, _ = analyzed(SCENES["mass"][0].replace("{maximal}", "False"))
    contacts = table_of(recording.seen.contacts)
    step = max(steps_with_forces(recording.seen, 1))
    force = pl.col("normal_force_n")
    changed = pl.when(pl.col("step") == step).then(force * (1 + 1e-6)).otherwise(force)
    seen = otherwise(
        recording.seen, contacts=contacts.with_columns(changed.alias("normal_force_n"))
    )
    analysis = analyze(seen)
    assert steps_that_are(analysis, 1, "unexplained") == [step]


# -- what the laws do not cover is said to be that -------------------------------------------------


def test_contact_of_several_substeps_is_unexplained(analyzed: Analyzed) -> None:
    scene = FLOOR + ABOVE + "p.setPhysicsEngineParameter(numSubSteps=4)\nsteps(100)"
    recording, analysis = analyzed(scene.replace("{maximal}", "False"))
    body = body_of(analysis, 1)
    (held,) = body.unexplained
    assert held.reason == "substeps"
    assert held.first_step <= min(steps_with_forces(recording.seen, 1))
    assert body.segments["flight"] == held.first_step - 1 == body.flights[0].last_step
    check_flights(body)


def test_a_push_in_several_substeps_is_held_over_them(analyzed: Analyzed) -> None:
    scene = (
        GRAVITY
        + IN_AIR
        + "p.setPhysicsEngineParameter(numSubSteps=4)\n"
        + ("steps(5)\np.applyExternalTorque(b, -1, [1e-3, 0, 0], p.WORLD_FRAME)\nsteps(5)")
    )
    _, analysis = analyzed(scene.replace("{maximal}", "False"))
    body = body_of(analysis, 0)
    assert not body.unexplained
    assert (body.segments["pushed"], body.segments["flight"]) == (1, 9)


def test_a_body_is_constrained_while_a_constraint_holds(analyzed: Analyzed) -> None:
    scene = """
p.setGravity(0, 0, -9.81)
b = p.loadURDF("cube_small.urdf", [0, 0, 3])
c = p.loadURDF("cube_small.urdf", [1, 0, 3])
steps(30)
held = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 3])
steps(30)
p.removeConstraint(held)
steps(30)
"""
    _, analysis = analyzed(scene)
    assert steps_that_are(analysis, 0, "constrained") == [*range(31, 61)]
    spans = [(one.first_step, one.last_step) for one in body_of(analysis, 0).flights]
    assert spans == [(0, 30), (60, 90)]
    assert body_of(analysis, 1).segments["flight"] == 90


def test_a_body_that_fell_asleep_is_still(analyzed: Analyzed) -> None:
    """Sleeping is enabled when it is loaded, or later; PyBullet waits for two seconds."""
    scene = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("cube_small.urdf", [0, 0, 0.06], flags=p.URDF_ENABLE_SLEEPING)
b = p.loadURDF("cube_small.urdf", [1, 0, 0.06])
p.changeDynamics(b, -1, activationState=p.ACTIVATION_STATE_ENABLE_SLEEPING)
c = p.loadURDF("cube_small.urdf", [2, 0, 0.06])
p.changeDynamics(c, -1, activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)
steps(600)
"""
    _, analysis = analyzed(scene)
    for number in (1, 2):
        body = body_of(analysis, number)
        (held,) = body.unexplained
        assert held.samples == 1
        assert held.reason == "asleep"
        assert steps_that_are(analysis, number, "still") == [*range(held.first_step + 1, 601)]
    assert body_of(analysis, 3).segments["still"] == 0
    assert body_of(analysis, 3).unexplained == []


def test_a_body_that_may_sleep_but_moves_is_unexplained_for_another_reason(
    analyzed: Analyzed,
) -> None:
    scene = """
p.setGravity(0, 0, -9.81)
slab = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 0.1])
p.createMultiBody(0, slab, -1, useMaximalCoordinates=1)
p.loadURDF("cube_small.urdf", [0, 0, 0.07], useMaximalCoordinates=1, flags=p.URDF_ENABLE_SLEEPING)
steps(3)
"""
    reasons = [held.reason for held in body_of(analyzed(scene)[1], 1).unexplained]
    assert reasons
    assert all(reason == "maximal" for reason in reasons)


@pytest.mark.parametrize(("limit", "clamped"), [(0.5, True), (1000, False), (-1, False)])
def test_max_joint_velocity_is_part_of_the_law(
    analyzed: Analyzed, limit: float, *, clamped: bool
) -> None:
    """PyBullet ignores a negative value."""
    scene = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
b = p.loadURDF("cube_small.urdf", [0, 0, 0.1], p.getQuaternionFromEuler([0.3, 0.4, 0.5]))
"""
    scene += "p.resetBaseVelocity(b, [0.3, 0, 0], [0, 3, 0])\nsteps(3)\n"
    scene += f"p.changeDynamics(b, -1, maxJointVelocity={limit})\nsteps(100)"
    _, analysis = analyzed(scene)
    assert body_of(analysis, 1).unexplained == []
    energy = body_of(analysis, 1).energy
    assert energy is not None
    assert (energy.by_cause_j["clamp"] != 0) == clamped


REASONS = {
    "continuous collision detection": FLOOR
    + ABOVE
    + "p.changeDynamics(b, -1, ccdSweptSphereRadius=0.02)\np.resetBaseVelocity(b, [0, 0, -40])\n"
    "steps(5)",
    "turned it or changed its mass": FLOOR
    + CUBE.format(0.03)
    + "steps(30)\np.changeDynamics(b, -1, mass=3)\nsteps(30)",
}
"""Reasons why a btRigidBody's sample is unexplained, each with code that causes it."""


@pytest.mark.parametrize("reason", REASONS)
def test_what_is_known_to_be_unknown_is_no_mismatch(analyzed: Analyzed, reason: str) -> None:
    _, analysis = analyzed(REASONS[reason].replace("{maximal}", "True"))
    (held,) = body_of(analysis, 1).unexplained
    assert held.samples == 1
    assert held.reason == "maximal"


SPLIT = {
    "": 0.04,
    "splitImpulsePenetrationThreshold=-0.02": 0.04,
    "splitImpulsePenetrationThreshold=0": 0.0,
    "contactSlop=0.015": 0.055,
    "useSplitImpulse=0": 1.0,
}
"""Engine parameters -> depth beyond which impulses are split [m], without the default slop."""


@pytest.mark.parametrize("told", SPLIT)
def test_what_is_deep_in_a_rigid_body_is_moved_beside_the_law(
    analyzed: Analyzed, told: str
) -> None:
    """Without split impulse the step is explained, as is a btMultiBody's, which never splits."""
    scene = """
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter({})
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
p.createMultiBody(0, box, useMaximalCoordinates=True)
b = p.createMultiBody(1, box, -1, [.02, 0, .14], useMaximalCoordinates={})
steps(30)
"""
    recording, analysis = analyzed(scene.format(told, True))
    deep = table_of(recording.seen.contacts).filter(pl.col("distance_m") + 1e-5 <= -SPLIT[told])
    held = body_of(analysis, 1).unexplained
    assert [one.samples for one in held] == [deep["step"].n_unique()] * (
        told != "useSplitImpulse=0"
    )
    assert all(one.reason == "maximal" for one in held)
    assert body_of(analyzed(scene.format(told, False))[1], 1).unexplained == []


ROUNDED = {
    "velocity of what does not move, with spinning friction": """
p.loadURDF("block.urdf", [0, 0, 0.1], globalScaling=0.31)
disc = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.188, height=0.139)
p.createMultiBody(8.3, disc, -1, [0, 0, 0.4], p.getQuaternionFromEuler([-0.956, -0.841, 2.499]))
turned = p.getQuaternionFromEuler([1.513, 2.011, 0.851])
p.loadURDF("cube_no_rotation.urdf", [0, 0, 0.55], turned, useMaximalCoordinates=True)
steps(3)
""",
}
"""Scenes without gravity or speed, in which the solver takes back all impulses and leaves
rounding."""


@pytest.mark.parametrize("what", ROUNDED)
def test_rounding_of_impulses_that_are_taken_back_is_no_mismatch(
    analyzed: Analyzed, what: str
) -> None:
    recording, analysis = analyzed(ROUNDED[what])
    assert table_of(recording.seen.contacts)["distance_m"].min() < -0.05  # type: ignore[operator]
    assert body_of(analysis, 0).unexplained == []


DEEP = "maximal"
UNREPORTED = {
    "sliding friction behind rolling friction": (
        FLOOR + "p.setPhysicsEngineParameter(enableConeFriction=0)\n"
        'b = p.loadURDF("sphere_small.urdf", [0, 0, 0.05])\n'
        "p.changeDynamics(b, -1, rollingFriction=0.01)\n"
        "p.resetBaseVelocity(b, [1, 0.5, 0], [3, 2, 1])\nsteps(30)",
        "rolling unreported",
    ),
    "split impulse beside rolling friction": (
        GRAVITY + """
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
p.createMultiBody(0, box, useMaximalCoordinates=True)
b = p.loadURDF("sphere_small.urdf", [.02, 0, .07], useMaximalCoordinates=True)
p.changeDynamics(b, -1, rollingFriction=0.01, spinningFriction=0.01)
p.resetBaseVelocity(b, [0, 0, 0], [3, 2, 1])
steps(10)
""",
        DEEP,
    ),
    "split impulse from a link that is not shown": (
        GRAVITY + """
p.loadURDF("cube_no_rotation.urdf", useMaximalCoordinates=True)
p.loadURDF("cube_small.urdf", [.3, .02, .47], useMaximalCoordinates=True)
steps(10)
""",
        DEEP,
    ),
    "force of a point that the engine left out": (
        GRAVITY + """
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, .1])
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=.1)
p.createMultiBody(0, box, useMaximalCoordinates=True)
p.createMultiBody(1, ball, -1, [0, 0, .3], useMaximalCoordinates=True)
for each in (0, 1): p.changeDynamics(each, -1, restitution=.9)
p.changeDynamics(0, -1, contactProcessingThreshold=0)
steps(50)
""",
        DEEP,
    ),
    "split impulse of what was added without mass": (
        """
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
p.createMultiBody(1, box, useMaximalCoordinates=True)
p.createMultiBody(0, box, -1, [0, 0, .14], useMaximalCoordinates=True)
p.changeDynamics(1, -1, mass=1)
steps(1)
""",
        DEEP,
    ),
}  # fmt: skip
"""Forces that PyBullet does not report, or reports too long, and the expected reason."""


@pytest.mark.parametrize("what", UNREPORTED)
def test_what_pybullet_does_not_report_is_no_mismatch(analyzed: Analyzed, what: str) -> None:
    scene, reason = UNREPORTED[what]
    _, analysis = analyzed(scene)
    assert {each.reason for each in body_of(analysis, 1).unexplained} == {reason}


@pytest.mark.parametrize("later", [0, 5])
def test_what_is_added_without_mass_as_a_btrigidbody_stands(analyzed: Analyzed, later: int) -> None:
    """Bullet applies neither gravity nor steps to such a body; contacts still change velocity."""
    recording, analysis = analyzed(f"""
p.setGravity(3, 0, -9.81)
ball = p.createCollisionShape(p.GEOM_SPHERE, radius=.1)
gone = p.loadURDF("sphere_small.urdf", useMaximalCoordinates=True)
p.removeBody(gone)
p.changeDynamics(gone, -1, mass=1)
a = p.loadURDF("sphere_small.urdf", useMaximalCoordinates=True, useFixedBase=True)
b = p.createMultiBody(0, ball, -1, [2, 0, 0], useMaximalCoordinates=True)
p.createMultiBody(1, ball, -1, [2, 0, .22])
steps({later})
for each in (a, b): p.changeDynamics(each, -1, mass=1)
steps(30)
""")
    led = 30 - (later > 0)  # until a body has mass it is not sampled
    assert body_of(analysis, 0).segments["still"] == led
    standing = body_of(analysis, 1)
    (held,) = standing.unexplained
    forced = [step for step in steps_with_forces(recording.seen, 1) if step > later]
    assert (held.samples, held.first_step) == (len(forced), min(forced))
    assert held.reason == "maximal"
    assert standing.segments["still"] == led - held.samples


HIDING = {
    'p.loadURDF("r2d2.urdf", useMaximalCoordinates=True)': [True],
    'p.loadURDF("cube_small.urdf", useMaximalCoordinates=True)': [False],
    'p.loadURDF("r2d2.urdf")': [False],
    'p.loadURDF("two.urdf", useMaximalCoordinates=1)': [True],
    'p.loadURDF("two.urdf", useMaximalCoordinates=1, flags=p.URDF_MERGE_FIXED_LINKS)': [False],
    'p.loadSDF("gripper/wsg50_one_motor_gripper.sdf", True)': [True],
    'p.loadSDF("stadium.sdf", useMaximalCoordinates=True)': [False] * 3,
    'p.loadMJCF("mjcf/ant.xml", useMultiBody=0)': [True],
    'p.loadMJCF("mjcf/capsule.xml", useMultiBody=0)': [False] * 2,
}
"""Calls that load bodies, and for each body, whether PyBullet hides links of it."""
TWO_LINKS = """\
<robot name="two">
  <link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>
</robot>
"""


@pytest.mark.parametrize("call", some(HIDING, 4))
def test_links_that_pybullet_does_not_show_are_known(
    analyzed: Analyzed, tmp_path: Path, call: str
) -> None:
    (tmp_path / "two.urdf").write_text(TWO_LINKS)
    search = f"p.setAdditionalSearchPath({str(tmp_path)!r})\n" if "two.urdf" in call else ""
    recording, analysis = analyzed(f"{search}{call}\nsteps(3)")
    bodies = recording.seen.bodies
    assert [bodies[number].hides_links for number in sorted(bodies)] == HIDING[call]
    reasons = {each.reason for body in analysis.bodies for each in body.unexplained}
    assert reasons <= {"maximal", "not finite"}


def test_what_a_call_gave_a_removed_body_is_not_given_to_the_next(analyzed: Analyzed) -> None:
    """The first body is removed before anything was recorded, and the second one gets its id."""
    recording, analysis = analyzed(
        GRAVITY
        + """
b = p.loadURDF("cube_small.urdf", [0, 0, 3])
p.changeDynamics(b, -1, linearDamping=0.7, mass=3)
p.removeBody(b)
assert p.loadURDF("cube_small.urdf", [0, 0, 3]) == b
steps(5)
"""
    )
    given = recording.seen.calls.given()
    assert not [each for each in given if each.body.number == 0]
    assert body_of(analysis, 0).segments["flight"] == 5


def test_a_mass_that_is_no_number_is_said_to_be_that(analyzed: Analyzed) -> None:
    """PyBullet loses the mass of a btRigidBody if a call sets only its inertia."""
    recording, _ = analyzed(SCENES["free fall"][0].replace("{maximal}", "True"))
    lost = [
        replace(one, reported={**one.reported, "mass_kg": np.array([np.nan])})
        for one in recording.seen.dynamics
    ]
    analysis = analyze(replace(recording.seen, dynamics=lost))
    (held,) = body_of(analysis, 0).unexplained
    assert (held.samples, held.reason) == (50, "maximal")
    json.dumps(analysis.as_json(), allow_nan=False)


# -- bodies, worlds, clients -----------------------------------------------------------------------


def test_what_has_joints_is_explained_and_so_is_what_meets_it(analyzed: Analyzed) -> None:
    scene = """
p.setGravity(0, 0, -9.81)
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
p.loadURDF("cube_small.urdf", [0.05, 0, 1.6])
steps(100)
"""
    _, analysis = analyzed(scene)
    robot, cube = analysis.bodies
    assert robot.segments["driven"] + robot.segments["contact"] == 100
    assert robot.unexplained == robot.flights == []
    assert len(robot.contacts) == len(cube.contacts)
    assert cube.unexplained == []
    assert [one.body for one in cube.contacts[0].by] == ["0_model"]
    assert cube.contacts[0].by[0].link >= 0
    assert (analysis.explained.samples, analysis.explained.of) == (202, 202)


def test_worlds_that_follow_each_other_have_no_step_between_them(analyzed: Analyzed) -> None:
    scene = """
p.disconnect()
for n in range(3):
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.81 - n)
    p.loadURDF("plane.urdf")
    p.loadURDF("cube_small.urdf", [0, 0, 0.3])
    steps(30)
    p.disconnect()
"""
    recording, analysis = analyzed(scene)
    body = body_of(analysis, 1)
    first = int(table_of(recording.seen.states)["step"].to_numpy().min())
    starts = [first + 31 * n for n in range(3)]
    assert steps_that_are(analysis, 1, "set") == starts
    assert [one.first_step for one in body.flights] == starts
    check_flights(body)
    for flight, gravity in zip(body.flights, (-9.81, -10.81, -11.81), strict=True):
        assert flight.terms_m is not None
        time_s = 30 / 240
        assert flight.terms_m.timestep[2] == pytest.approx(gravity * time_s / 240 / 2, rel=1e-9)


def test_what_stands_is_still_at_the_samples_at_which_it_is_there(analyzed: Analyzed) -> None:
    """The samples are as many as for a moving body, also if nothing else moves."""
    scene = """
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1])
p.createMultiBody(1, box, -1, [0, 0, 9])
steps(20)
late = p.createMultiBody({mass}, box, -1, [5, 0, 9])
steps(10)
p.removeBody(late)
steps(10)
late = p.createMultiBody({mass}, box, -1, [5, 0, 9])
steps(5)
beside = p.connect(p.DIRECT)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[.1, .1, .1], physicsClientId=beside)
p.createMultiBody(0, box, physicsClientId=beside)
for _ in range(30):
    p.stepSimulation(physicsClientId=beside)
"""
    for mass in (0, 1):
        recording, analysis = analyzed(scene.format(mass=mass))
        counts = [sum(body.segments.values()) for body in analysis.bodies]
        assert counts == [46, 10 + 5, 31]
        assert recording.ended is not None
        assert recording.ended["samples"] == 46 + 31
    still = [one.segments["still"] for one in analyzed(scene.format(mass=0))[1].bodies]
    assert still == [45, 15, 31]  # without gravity nothing moves


def test_clients_side_by_side_are_judged_by_themselves(analyzed: Analyzed) -> None:
    scene = """
other = p.connect(p.DIRECT)
for c in (0, other):
    p.setGravity(0, 0, -9.81 * (1 + c), c)
    p.setAdditionalSearchPath(pybullet_data.getDataPath(), c)
    p.loadURDF("plane.urdf", physicsClientId=c)
    p.loadURDF("cube_small.urdf", [0, 0, 0.3], physicsClientId=c)
p.setTimeStep(1 / 100, other)
for i in range(100):
    p.stepSimulation(0)
    if i % 2:
        p.stepSimulation(other)
"""
    _, analysis = analyzed(scene)
    one, other = body_of(analysis, 1), body_of(analysis, 3)
    assert one.unexplained == other.unexplained == []
    assert sum(one.segments.values()) == 101
    assert sum(other.segments.values()) == 51
    assert {by.body for contact in one.contacts for by in contact.by} == {"0_plane"}
    assert {by.body for contact in other.contacts for by in contact.by} == {"2_plane"}
    assert one.flights[0].end_s == one.flights[0].last_step / 240
    assert other.flights[0].end_s == pytest.approx(other.flights[0].last_step / 100, rel=1e-15)


def test_a_pile_is_explained_and_its_contacts_add_up(analyzed: Analyzed) -> None:
    """A body's energy from contacts is its change of kinetic energy less its weight's work."""
    scene = """
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
for i in range(4):
    p.loadURDF("cube_small.urdf", [0.01 * i, 0, 0.1 + 0.08 * i], [0.1 * i, 0.03, 0, 1],
        useMaximalCoordinates=i % 2)
steps(150)
"""
    _, analysis = analyzed(scene)
    assert analysis.explained.samples == analysis.explained.of == 4 * 151
    for body in analysis.bodies[1:]:
        check_flights(body)
        rows = analysis.table.filter(pl.col("body") == body.id)
        of_contacts = sum(one.energy_j for one in body.contacts)
        assert rows["contact_j"].sum() == pytest.approx(of_contacts, rel=1e-12, abs=1e-15)
        for contact in body.contacts:
            pushers = np.sum([one.impulse_n_s for one in contact.by], axis=0)
            assert pushers == pytest.approx(np.array(contact.impulse_n_s), abs=1e-12)
            of_pushers = sum(one.energy_j for one in contact.by)
            assert of_pushers == pytest.approx(contact.energy_j, abs=1e-12)


# -- the experiment itself -------------------------------------------------------------------------

ARTICLE = """
import pybullet as p
import pybullet_data

p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
box = p.loadURDF("cube_small.urdf", [0, 0, 1])
for _ in range(240):
    p.stepSimulation()
"""


@pytest.fixture(scope="module")
def article(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which the command recorded the article's program."""
    folder = tmp_path_factory.mktemp("article")
    folder.joinpath("article.py").write_text(ARTICLE)
    done = drop_here("record", "--out", "article.rrd", "article.py", folder=folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_articles_program_has_the_four_terms_of_the_experiment(
    article: Path, drop: Drop, recorded: Recorder
) -> None:
    done = drop("analyze", article / "article.rrd", "--out", "layer.rrd", "--json")
    assert done.returncode == 0, done.stderr
    box = json.loads(done.stdout)["bodies"][1]
    (flight,) = box["flights"]
    (at,) = flight["at"]
    (moment,) = judge(recorded(), at_s=(0.3,)).at
    assert moment.terms_m is not None
    assert (at["step"], at["time_s"]) == (moment.step, moment.time_s)
    assert at["error_m"][2] == moment.error_m
    assert round(at["error_m"][2] * 1e3, 1) == -1.8
    for name, value_m in vars(moment.terms_m).items():
        assert at["terms_m"][name][2] == value_m, name
    assert box["segments"]["flight"] + box["segments"]["contact"] == 240


# -- the command -----------------------------------------------------------------------------------


def test_the_layer_opens_and_has_states(article: Path, drop: Drop, tmp_path: Path) -> None:
    done = drop("analyze", article / "article.rrd", "--out", "layer.rrd", "--table", "all.parquet")
    assert done.returncode == 0, done.stderr
    layer = tmp_path / "layer.rrd"
    assert "1 file verified" in rerun_rrd("verify", layer)
    assert "StateChange" in rerun_rrd("print", "-vv", layer)
    table = pl.read_parquet(tmp_path / "all.parquet")
    assert table["step"].to_list() == [*range(241)]
    assert table.filter(step=72)["error_z_m"].item() == pytest.approx(-1.8203476e-3, rel=1e-7)


def test_a_layer_is_no_recording(article: Path, drop: Drop) -> None:
    assert drop("analyze", article / "article.rrd", "--out", "layer.rrd").returncode == 0
    done = drop("analyze", "layer.rrd")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines() == [
        "drop: layer.rrd must be a recording, got a layer, as RUN.analysis.rrd is of RUN.rrd; give "
        "the recording that it belongs to"
    ]


def test_what_is_printed_fits_a_terminal(article: Path, drop: Drop) -> None:
    done = drop("analyze", article / "article.rrd", "--out", "layer.rrd")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert "100 % explained" in lines[0]
    box = ["1_cube_small", "z", "0.3", "s", "-6.1313", "+4.3102", "+0.0007", "-1.8203"]
    assert box in [line.split() for line in lines]  # of a fall, without being asked
    done = drop("analyze", article / "article.rrd", "--out", "layer2.rrd", "--verbose")
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.split() == ["total", "+0.0000", "+0.0000", "-1.8203"] for line in lines)
    begin = next(n for n, line in enumerate(lines) if line.startswith("Momentum"))
    table = lines[begin + 2 : lines.index("", begin)]
    rows = [row for row in table if not row.startswith("contact by")]
    told = {row.split()[-4]: float(row.split()[-1]) for row in rows}
    assert told["gravity"] == pytest.approx(-0.981, abs=1e-4)  # 1 s of 0.1 kg
    given = told["start"] + sum(told[cause] for cause in ("gravity", "damping", "contact"))
    assert given == pytest.approx(told["end"], abs=1e-4)


def test_long_names_and_many_bodies_fit_too(
    analyzed: Analyzed, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = """
import pathlib, shutil, tempfile
folder = pathlib.Path(tempfile.mkdtemp())
file = folder / ("a_long_name_of_a_file_" * 5 + ".urdf")
file.write_text(
    '<robot name="ball"><link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1"'
    ' izz="1" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><sphere radius="0.03"/>'
    '</geometry></collision></link></robot>')
p.setGravity(0, 0, -9.81)
for i in range(15):
    p.loadURDF(str(file), [0, 0, 1000 + 0.05 * i])
steps(60)
shutil.rmtree(folder)
"""
    _, analysis = analyzed(scene)
    told = replace(analysis, origin={"script": "scene.py", "ended": "finished"})
    show(told, as_json=False)
    lines = capfd.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert any("15 bodies" in line for line in lines)


def test_one_body_is_told_of_by_name_or_number(article: Path, drop: Drop) -> None:
    told = [
        json.loads(
            drop(
                "analyze", article / "article.rrd", "--out", f"{n}.rrd", "--json", "--body", which
            ).stdout
        )
        for n, which in enumerate(("1", "1_cube_small", "cube_small.urdf"))
    ]
    for one in told:
        assert [body["id"] for body in one["bodies"]] == [1]
        assert one["bodies"] == told[0]["bodies"]
    done = drop("analyze", article / "article.rrd", "--out", "layer.rrd", "--body", "duck")
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert "--body" in done.stderr
    assert "1 (cube_small.urdf)" in done.stderr


def test_what_is_said_of_one_body_is_of_it_alone(
    analyzed: Analyzed, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = f"""
{FLOOR}
for height in (1, 2):
    p.loadURDF("cube_small.urdf", [height, 0, height], useMaximalCoordinates=True)
p.setPhysicsEngineParameter(numSubSteps=2)
steps(110)
"""
    _, analysis = analyzed(scene)
    whole = replace(analysis, origin={"script": "scene.py", "ended": "finished"})
    assert whole.explained.of == 2 * 111
    held = sum(one.samples for one in body_of(whole, 1).unexplained)
    assert held
    part = whole.of_body(1).explained
    assert (part.samples, part.of) == (111 - held, 111)
    show(whole.of_body(2), as_json=False)
    told = capfd.readouterr().out
    assert "1 of 3 bodies" in told


def test_a_time_that_is_not_in_the_recording_is_wrong_usage(
    article: Path, drop: Drop, tmp_path: Path
) -> None:
    """The error is one line, as for a drop, and nothing is written."""
    for at in ("1.01", "-1", "nan", "inf"):
        done = drop("analyze", article / "article.rrd", "--out", "layer.rrd", "--at", at)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("drop: --at must lie within the recording, 0 to 1 s, got ")
        assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "layer.rrd").exists()
    done = drop("analyze", article / "article.rrd", "--out", "layer.rrd", "--at", "1")
    assert done.returncode == 0, done.stderr


# -- bodies that are loaded again -----------------------------------------------------------------

LOADED_AGAIN = """
for height_m in (0.5, 1.0):
    p.resetSimulation()
    p.loadURDF("sphere_small.urdf", [0, 0, height_m])
    steps(20)
"""
"""A ball without gravity, which stays where each episode loads it."""


def test_a_body_that_is_loaded_again_is_not_said_to_be_moved(tmp_path: Path) -> None:
    recording = scenes.record(LOADED_AGAIN, tmp_path / "run.rrd")
    assert {row.kind for row in analyze(recording.seen).account} == {"idle"}


WORLDS = """
moon = p.connect(p.DIRECT)
for world in (0, moon):
    p.loadURDF("sphere_small.urdf", [0, 0, 1], physicsClientId=world)
    p.setGravity(0, 0, -9.81, physicsClientId=world)
for _ in range(20):
    p.stepSimulation(physicsClientId=0)
    p.stepSimulation(physicsClientId=moon)
"""


def test_two_simulations_that_no_call_resets_are_no_episodes(tmp_path: Path) -> None:
    found = analyze(scenes.record(WORLDS, tmp_path / "run.rrd").seen)
    assert len(found.episodes) == 2
    assert [*episode_lines(found.episodes, None, found.samples, verbose=False)] == []
