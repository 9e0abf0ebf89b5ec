"""Verification: every step of every body in a recording equals the sum of its named impulses.

The tolerance is the rule's own: a remainder up to 1e-9 of a step's largest term is rounding. What
was measured is 4e-12 at most; CLOSES is what the sums of causes may be off, of the largest cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import some
from drop_physics.explain import commands, step_status, steps
from drop_physics.explain.bodies import BodyConfigs
from drop_physics.explain.causes import CAUSES, Totals
from drop_physics.explain.recording import Explanation
from drop_physics.explain.step_status import SEGMENTS, SampleStatus
from drop_physics.physics.impulses import Forces
from drop_physics.physics.step_law import DampedTree, Reported
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.log import Log
from drop_physics.trace.tables import table_of
from scenes import explanation, record

CLOSES = 1e-9
MEASURED = 1e-10
FLOOR = "p.setGravity(0, 0, -9.81)\np.loadURDF('plane.urdf')\n"
AIR = "p.setGravity(0, 0, -9.81)\n"

BOX = (
    FLOOR
    + """
b = p.loadURDF("cube_small.urdf", [0, 0, 0.3], p.getQuaternionFromEuler([0.3, 0.2, 0]))
steps(240)
p.applyExternalForce(b, -1, [0, 0, 3], [0.1, 0, 0], p.LINK_FRAME)
p.applyExternalTorque(b, -1, [0, 0, 0.01], p.WORLD_FRAME)
steps(60)
"""
)
ARM = (
    AIR
    + """
import math
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
mode = "{mode}"
for j in range(7):
    p.resetJointState(k, j, 0.2 * j - 0.5, 0.1)
    if mode in ("free", "torque", "pd"):
        p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, force=0)
for i in range(120):
    where = [0.5 * math.sin(i / 240 + j) for j in range(7)]
    for j in range(7):
        if mode == "position":
            p.setJointMotorControl2(k, j, p.POSITION_CONTROL, where[j], force=60)
        elif mode == "velocity":
            p.setJointMotorControl2(k, j, p.VELOCITY_CONTROL, targetVelocity=where[j], force=60)
        elif mode == "torque":
            p.setJointMotorControl2(k, j, p.TORQUE_CONTROL, force=3 * where[j])
    if mode == "pd" and i % 40 == 20:
        p.setJointMotorControlArray(
            k, range(7), p.PD_CONTROL, targetPositions=where, targetVelocities=[0.1] * 7,
            positionGains=[20] * 7, velocityGains=[1] * 7, forces=[3] * 7)
    p.stepSimulation()
"""
)
GRIP = (
    FLOOR
    + """
a = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True)
ready = dict(zip((*range(7), 9, 10), (0, 0.3, 0, -2.2, 0, 2.5, 0.8, 0.04, 0.04)))
for j, q in ready.items():
    p.resetJointState(a, j, q)
c = p.loadURDF("cube_small.urdf", p.getLinkState(a, 11)[0])
for i in range(150):
    for j, q in ready.items():
        if j < 9:
            lift = 0.1 if i > 100 and j == 1 else 0
            p.setJointMotorControl2(a, j, p.POSITION_CONTROL, q + lift, force=200)
        else:
            p.setJointMotorControl2(a, j, p.VELOCITY_CONTROL, targetVelocity=-0.2, force=20)
    p.stepSimulation()
"""
)
LAIKAGO = (
    FLOOR
    + """
q = p.loadURDF("laikago/laikago_toes.urdf", [0, 0, 0.48], [0, 0.5, 0.5, 0],
    flags=p.URDF_USE_SELF_COLLISION)
for j in range(p.getNumJoints(q)):
    if p.getJointInfo(q, j)[2] == p.JOINT_REVOLUTE:
        p.setJointMotorControl2(q, j, p.POSITION_CONTROL, 0, force=30)
steps(120)
"""
)
R2D2 = (
    FLOOR
    + """
r = p.loadURDF("r2d2.urdf", [0, 0, 0.5])
for j in (2, 3, 6, 7):
    p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, targetVelocity=-8, force=20)
steps(120)
"""
)
HUSKY = (
    FLOOR
    + """
r = p.loadURDF("husky/husky.urdf", [0, 0, 0.2])
for j in (2, 3, 4, 5):
    p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, targetVelocity=6, force=100)
steps(120)
"""
)
HUMANOID = (
    FLOOR
    + """
r = p.loadURDF("humanoid/humanoid.urdf", [0, 0, 4])
for j in range(p.getNumJoints(r)):
    if p.getJointInfo(r, j)[2] == p.JOINT_SPHERICAL:
        p.setJointMotorControlMultiDof(r, j, p.POSITION_CONTROL, targetPosition=[0, 0, 0, 1],
            positionGain=0.2, velocityGain=1, force=[200, 200, 200])
steps(200)
for i in range(10):
    p.setJointMotorControlMultiDof(r, 1, p.TORQUE_CONTROL, force=[1, 2, 3])
    p.stepSimulation()
"""
)
PUSH = (
    AIR
    + """
q = p.loadURDF("laikago/laikago_toes_zup_lores.urdf", [0, 0, 2])
for i in range(60):
    if i > 50:
        p.getLinkState(q, 3, computeForwardKinematics=True)
    p.applyExternalForce(q, 3, [3, 1, 2], [0.1, 0.02, 0.03], p.LINK_FRAME)
    p.applyExternalTorque(q, 7, [0.3, 0.1, 0.2], p.LINK_FRAME)
    p.applyExternalForce(q, -1, [3, 1, 2], [0.1, 0.02, 0.03], p.LINK_FRAME)
    if i > 30:
        p.getLinkState(q, 3, computeForwardKinematics=True)
    p.applyExternalForce(q, 5, [1, 1, 2], p.getLinkState(q, 5)[0], p.WORLD_FRAME)
    p.stepSimulation()
    if i == 40:
        p.resetJointState(q, 2, 0.3)
    if i == 45:
        p.resetBasePositionAndOrientation(q, [0, 0, 3], p.getQuaternionFromEuler([0, 0, 0.2]))
"""
)
HOLD = (
    AIR
    + """
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
x, y, z = p.getLinkState(k, 6)[0]
c = p.loadURDF("cube_small.urdf", [x + 0.1, y, z + 0.05])
h = p.createConstraint(k, 6, c, -1, p.JOINT_FIXED, [0, 0, 0], [0.01, 0.02, 0.08], [0.01, 0, 0.03],
    p.getQuaternionFromEuler([0.3, 0.2, 0.1]), p.getQuaternionFromEuler([0.1, 0, 0]))
for j in range(7):
    p.setJointMotorControl2(k, j, p.POSITION_CONTROL, 0.3, force=87)
steps(60)
p.changeConstraint(h, maxForce=20)
steps(30)
p.removeConstraint(h)
steps(30)
w = p.createConstraint(c, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0.05], [0.2, 0, 1])
steps(30)
p.changeConstraint(w, [0.3, 0, 1])
steps(30)
"""
)
GEAR = (
    FLOOR
    + """
r = p.loadURDF("racecar/racecar_differential.urdf", [0, 0, 0.1])
g = p.createConstraint(r, 9, r, 11, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0])
p.changeConstraint(g, gearRatio=-1.5, maxForce=10000)
p.setJointMotorControl2(r, 9, p.VELOCITY_CONTROL, targetVelocity=3, force=2)
steps(60)
"""
)
SET = (
    FLOOR
    + """
k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
b = p.loadURDF("cube_small.urdf", [0.5, 0, 0.3])
steps(20)
p.resetJointState(k, 1, 0.5, 0.3)
steps(20)
kept = p.saveState()
steps(20)
p.restoreState(kept)
p.setGravity(0, 0, -5)
steps(20)
p.setTimeStep(1 / 100)
steps(20)
p.changeDynamics(k, -1, jointDamping=0, linearDamping=0, angularDamping=0)
steps(10)
for j in range(7):
    p.changeDynamics(k, j, jointDamping=0)
steps(10)
p.changeDynamics(k, 3, mass=5)
p.changeDynamics(b, -1, mass=2, linearDamping=0.5)
p.changeDynamics(k, 5, jointLowerLimit=-0.1, jointUpperLimit=-0.05)
steps(10)
p.changeDynamics(k, -1, maxJointVelocity=0.2)
p.setJointMotorControl2(k, 0, p.VELOCITY_CONTROL, targetVelocity=1, force=100)
steps(10)
p.resetBasePositionAndOrientation(k, [0, 1, 0], p.getQuaternionFromEuler([0.1, 0.2, 0.3]))
steps(10)
"""
)
AGAIN = """
for e in range(3):
    p.resetSimulation()
    p.setGravity(0, 0, -9.81)
    k = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
    b = p.loadURDF("cube_small.urdf", [1, 0, 0.3 + e], useFixedBase=e == 1)
    if e == 0:
        p.changeDynamics(b, -1, linearDamping=1)
        p.setJointMotorControl2(k, 3, p.PD_CONTROL, targetPosition=1, positionGain=5, force=10)
        p.setJointMotorControl2(k, 1, p.VELOCITY_CONTROL, force=0)
    steps(30)
p.removeBody(b)
b = p.loadURDF("cube_small.urdf", [1, 0, 2])
steps(20)
"""


@dataclass(frozen=True)
class Case:
    """A scene, and the expected kinds of segments for its bodies."""

    scene: str
    segments: dict[int, set[str]]
    """Kinds of segments by body id, in addition to `set`."""


CASES = {
    "box": Case(BOX, {1: {"flight", "contact", "pushed"}}),
    "kuka free": Case(ARM.format(mode="free"), {0: {"flight"}}),
    "kuka position": Case(ARM.format(mode="position"), {0: {"driven"}}),
    "kuka velocity": Case(ARM.format(mode="velocity"), {0: {"driven"}}),
    "kuka torque": Case(ARM.format(mode="torque"), {0: {"pushed"}}),
    "kuka pd": Case(ARM.format(mode="pd"), {0: {"flight", "driven"}}),
    "panda": Case(GRIP, {1: {"driven", "contact"}, 2: {"flight", "contact"}}),
    "laikago": Case(LAIKAGO, {1: {"contact"}}),
    "r2d2": Case(R2D2, {1: {"driven", "contact"}}),
    "husky": Case(HUSKY, {1: {"driven", "contact"}}),
    "humanoid": Case(HUMANOID, {1: {"driven", "contact", "pushed"}}),
    "push": Case(PUSH, {0: {"pushed"}}),
    "hold": Case(HOLD, {0: {"constrained", "driven", "contact"}, 1: {"constrained", "contact"}}),
    "gear": Case(GEAR, {1: {"constrained"}}),
    "set": Case(SET, {1: {"driven"}, 2: {"flight", "contact"}}),
    "again": Case(AGAIN, {0: {"driven"}, 1: {"flight"}}),
}
DRIVEN = ("kuka free", "kuka position", "kuka velocity", "kuka torque", "kuka pd")


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Seen]:
    """Return a function that records a scene, once, and returns the recorded data."""
    made: dict[str, Seen] = {}
    folder = tmp_path_factory.mktemp("explained")

    def of(scene: str) -> Seen:
        if scene not in made:
            made[scene] = record(scene, folder / f"{len(made)}.rrd").seen
        return made[scene]

    return of


def segments(totals: Totals) -> set[str]:
    return {SEGMENTS[number] for number in np.flatnonzero(totals.segments)}


def closes(totals: Totals) -> None:
    """Check that the impulses by cause add up to the change of momentum, to 1e-9 of the largest."""
    energy = totals.energy_j
    largest = max(map(abs, energy.values()))
    assert abs(sum(energy.values()) - totals.changed_j) <= CLOSES * largest
    assert abs(energy["remainder"]) <= CLOSES * largest
    momentum = totals.momentum_kg_m_s
    most = max(np.abs(each).max() for each in momentum.values())
    off = np.abs(sum(momentum.values()) - totals.moved_kg_m_s).max()
    assert off <= CLOSES * most
    assert set(energy) == set(CAUSES) - {"gravity"}
    assert set(momentum) == set(CAUSES)


@pytest.mark.parametrize("name", some(CASES, 5))
def test_every_sample_is_explained(name: str, seen: Callable[[str], Seen]) -> None:
    case, whole = CASES[name], explanation(seen(CASES[name].scene))
    for number, expected in case.segments.items():
        totals = whole.totals[number]
        assert totals.explained == totals.samples
        assert totals.unexplained == {}
        assert totals.remainder <= MEASURED
        assert segments(totals) - {"set", "still"} == expected
        assert totals.segments[SEGMENTS.index("set")] >= 1
        closes(totals)


@pytest.mark.parametrize("name", some(["push", "hold", "set", "again", "kuka torque"], 1))
def test_pieces_come_to_the_same(name: str, seen: Callable[[str], Seen]) -> None:
    """An analysis in chunks gives the same result, wherever the run is cut."""
    whole, pieces = explanation(seen(CASES[name].scene)), Explanation(seen(CASES[name].scene))
    for _ in pieces.pieces(7):
        pass
    for number, totals in whole.totals.items():
        other = pieces.totals[number]
        assert other.explained == other.samples == totals.samples
        assert (other.segments == totals.segments).all()
        largest = max(map(abs, totals.energy_j.values()))
        for cause, value in totals.energy_j.items():
            assert other.energy_j[cause] == pytest.approx(value, abs=1e-11 * largest)
        assert other.end_j == pytest.approx(totals.end_j, rel=1e-12)


def test_the_energy_of_a_box_by_hand(seen: Callable[[str], Seen]) -> None:
    """A box of 0.1 kg starts at rest at 0.3 m; its final energy is kinetic and potential."""
    found = seen(BOX)
    totals = explanation(found).totals[1]
    assert totals.start_j == pytest.approx(0.1 * 9.81 * 0.3, rel=1e-12)
    last = table_of(found.bases).row(-1, named=True)
    speed, spin = (
        sum(last[name.format(axis)] ** 2 for axis in "xyz") for name in ("v{}_m_s", "w{}_rad_s")
    )
    kinetic = (0.1 * speed + 0.000125 * spin) / 2
    assert totals.end_j == pytest.approx(kinetic + 0.1 * 9.81 * last["z_m"], rel=1e-9)
    assert totals.energy_j["contacts"] < -0.1
    assert totals.energy_j["applied"] > 0.005
    pulled = totals.momentum_kg_m_s["gravity"]
    assert pulled == pytest.approx([0, 0, -0.1 * 9.81 * 300 / 240], rel=1e-12)
    pushed = totals.momentum_kg_m_s["applied"]
    assert np.linalg.norm(pushed) == pytest.approx(3 / 240, rel=1e-9)
    assert totals.end_kg_m_s[2] == pytest.approx(0.1 * last["vz_m_s"], abs=1e-12)


def test_what_calls_set_is_a_cause_of_its_own(seen: Callable[[str], Seen]) -> None:
    scene = (
        AIR
        + """
b = p.loadURDF("cube_small.urdf", [0, 0, 1])
steps(10)
p.resetBasePositionAndOrientation(b, [0, 0, 3], [0, 0, 0, 1])
p.resetBaseVelocity(b, [2, 0, 0])
steps(10)
p.setGravity(0, 0, 0)
p.changeDynamics(b, -1, mass=0.2)
steps(10)
"""
    )
    found = seen(scene)
    totals = explanation(found).totals[0]
    closes(totals)
    assert totals.explained == totals.samples == 31
    first, last, end = (table_of(found.bases).row(number, named=True) for number in (10, 20, 30))
    put = 0.1 * (9.81 * (3 - first["z_m"]) + (4 - first["vz_m_s"] ** 2) / 2)
    heavier = 0.1 * (last["vx_m_s"] ** 2 + last["vz_m_s"] ** 2) / 2 - 0.1 * 9.81 * last["z_m"]
    assert totals.energy_j["set"] == pytest.approx(put + heavier, rel=1e-9)
    assert totals.end_j == pytest.approx(0.1 * (end["vx_m_s"] ** 2 + end["vz_m_s"] ** 2), rel=1e-9)


UNCOVERED = {
    "substeps": ("p.setPhysicsEngineParameter(numSubSteps=4)", "substeps", {}),
    "maximal": (
        "steps(60)\np.changeDynamics(b, -1, mass=3)",  # touches with the inertia that it had
        "maximal",
        {"useMaximalCoordinates": True},
    ),
    "rolling": (
        "p.setPhysicsEngineParameter(enableConeFriction=0)\n"
        "p.changeDynamics(b, -1, rollingFriction=0.01)",
        "rolling unreported",
        {},
    ),
    "asleep": ("", "asleep", {"flags": 1 << 11}),
}


@pytest.mark.parametrize("name", UNCOVERED)
def test_what_the_law_does_not_cover_says_why(name: str, seen: Callable[[str], Seen]) -> None:
    call, reason, how = UNCOVERED[name]
    given = "".join(f", {key}={value}" for key, value in how.items())
    scene = FLOOR + f'b = p.loadURDF("cube_small.urdf", [0, 0, 0.1]{given})\n{call}\nsteps(700)\n'
    totals = explanation(seen(scene)).totals[1]
    assert {*totals.unexplained} == {reason}
    left = totals.unexplained[reason]  # type: ignore[index]
    assert left.samples == totals.samples - totals.explained > 0
    assert left.first_step >= 1
    assert left.remainder > CLOSES
    energy = totals.energy_j
    assert sum(energy.values()) == pytest.approx(totals.changed_j, abs=1e-9)


def test_a_body_alone_follows_its_own_law(seen: Callable[[str], Seen]) -> None:
    """Such a body has no sum, so no causes; its flight and its contact are explained."""
    turn = "p.getQuaternionFromEuler([0.3, 0.2, 0])"
    box = f'b = p.loadURDF("cube_small.urdf", [0, 0, 0.3], {turn}, useMaximalCoordinates=True)\n'
    push = "p.applyExternalForce(b, -1, [0, 1, 0], [0, 0, 0.5], p.WORLD_FRAME)\n"
    totals = explanation(seen(f"{FLOOR}{box}steps(20)\n{push}steps(80)\n")).totals[1]
    counts = dict(zip(SEGMENTS, totals.segments.tolist(), strict=True))
    assert counts["flight"] >= 50
    assert counts["pushed"] == 1
    assert not counts["unexplained"]
    assert counts["contact"]
    assert not totals.covered
    assert totals.remainder == 0


def test_a_planar_joint_is_not_covered(seen: Callable[[str], Seen], tmp_path: Path) -> None:
    path = tmp_path / "planar.urdf"
    link = (
        '<link name="{}"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    path.write_text(
        f'<robot name="r">{link.format("a")}{link.format("b")}<joint name="j" type="planar">'
        '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    totals = explanation(seen(AIR + f"p.loadURDF({str(path)!r})\nsteps(5)\n")).totals[0]
    assert {why: left.samples for why, left in totals.unexplained.items()} == {"planar": 5}


class Unheard:
    """Samples of a recording that started after all calls."""

    def __init__(self, seen: Seen) -> None:
        self._sampled = seen.sampled
        self.first, self.last = seen.sampled.first, seen.sampled.last

    def piece(self, first: int, end: int) -> Piece:
        """Return a chunk of samples without its calls."""
        return replace(self._sampled.piece(first, end), calls=Log())


def test_what_was_set_before_the_recording_is_not_known(seen: Callable[[str], Seen]) -> None:
    """A default setting is assumed as long as the steps agree with it."""
    for call, reason in (("", None), ("p.changeDynamics(b, -1, linearDamping=0.5)", "before")):
        scene = AIR + f'b = p.loadURDF("cube_small.urdf", [0, 0, 9])\n{call}\nsteps(20)\n'
        known = seen(scene)
        bodies = {number: replace(body, before=True) for number, body in known.bodies.items()}
        unheard: Any = Unheard(known)
        totals = explanation(replace(known, bodies=bodies, sampled=unheard)).totals[0]
        reasons = {why: left.samples for why, left in totals.unexplained.items()}
        # At rest there is nothing to damp in the first step.
        assert reasons == ({} if reason is None else {"before the recording": 19})


def test_a_body_that_nothing_moves_is_still(seen: Callable[[str], Seen]) -> None:
    totals = explanation(seen('p.loadURDF("cube_small.urdf")\nsteps(5)\n')).totals[0]
    assert segments(totals) == {"set", "still"}


# -- each part is worth its test ----------------------------------------------------------------


def forgotten(name: str) -> Callable[[Any], Any]:
    """Return a function that builds a `Reported` with one field set to zero."""

    def made(**given: Any) -> Reported:
        nothing = Forces() if isinstance(given[name], Forces) else given[name] * 0
        return Reported(**(given | {name: nothing}))

    return made


BROKEN: dict[str, tuple[str, int]] = {
    "motors": ("kuka position", 0), "commanded": ("kuka torque", 0), "pd": ("kuka pd", 0),
    "contacts": ("laikago", 1), "constraints": ("hold", 1), "geared": ("gear", 1),
    "timestep_s": ("box", 1), "gravity_m_s2": ("box", 1),
}  # fmt: skip


@pytest.mark.parametrize("name", some(BROKEN, 4))
def test_without_any_part_it_does_not_close(
    name: str, seen: Callable[[str], Seen], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, body = BROKEN[name]
    monkeypatch.setattr(steps, "Reported", forgotten(name))
    totals = explanation(seen(CASES[scene].scene)).totals[body]
    assert totals.explained < 0.7 * totals.samples
    assert {*totals.unexplained} <= {"remainder", "timestep"}
    assert totals.unexplained


def test_without_pushes_it_does_not_close(
    seen: Callable[[str], Seen], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(steps, "pushed", lambda *_, **__: Forces())
    assert explanation(seen(PUSH)).totals[0].explained == 1


def test_poses_of_pushes_matter(
    seen: Callable[[str], Seen], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Poses are one step old until i = 30, and current where calls refreshed them afterwards."""
    monkeypatch.setattr(steps, "TRIALS", 0)
    totals = explanation(seen(PUSH)).totals[0]
    assert 30 <= totals.explained <= 34


@pytest.mark.parametrize(
    ("what", "scene", "body"),
    [
        ("linear_damping", "set", 1),
        ("angular_damping", "box", 1),
        ("joint_damping", "set", 1),
        ("velocity_limit", "set", 1),
        ("lower", "set", 1),
    ],
)
def test_what_calls_set_matters(
    what: str,
    scene: str,
    body: int,
    seen: Callable[[str], Seen],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """If the integration rule's value differs from the engine's, steps are unexplained."""
    other = {"linear_damping": 0.3, "angular_damping": 0.3, "velocity_limit": 100.0}
    make = BodyConfigs._make

    def altered(self: BodyConfigs, *key: int) -> Any:
        epoch = make(self, *key)
        law: DampedTree = epoch.law
        nothing = law.lower * 0
        given = (
            {what: other[what]}
            if what in other
            else {
                "joint_damping": {"joint_damping": nothing + 0.5},
                "lower": {"lower": nothing, "upper": nothing - 1},
            }[what]
        )
        return replace(epoch, law=replace(law, **given))

    monkeypatch.setattr(BodyConfigs, "_make", altered)
    totals = explanation(seen(CASES[scene].scene)).totals[body]
    assert totals.unexplained["remainder"].samples >= 5


def test_pd_control_outlives_the_body(
    seen: Callable[[str], Seen], monkeypatch: pytest.MonkeyPatch
) -> None:
    """PyBullet keeps PD targets by id even after `resetSimulation`; without them no sum closes."""
    monkeypatch.setattr(
        commands.Commanded,
        "servos",
        lambda _, law, before: np.zeros((len(before), law.tree.joint_rates)),
    )
    totals = explanation(seen(AGAIN)).totals[0]
    assert totals.unexplained["remainder"].samples >= 100


def test_a_gear_between_joints_that_do_not_move_gives_nothing(seen: Callable[[str], Seen]) -> None:
    """PyBullet accepts such a gear; the force that it reports acts on no joint rate."""
    scene = GEAR.replace("racecar_differential", "racecar").replace(
        "p.setJoint", "0 and p.setJoint"
    )
    totals = explanation(seen(scene)).totals[1]
    assert {*totals.unexplained} <= {"constraint"}


def test_the_first_that_applies(seen: Callable[[str], Seen]) -> None:
    """A step belongs to the first kind that applies: `pushed` before `constrained`."""
    found: dict[int, SampleStatus] = {}
    for piece in Explanation(seen(HOLD)).pieces():
        found |= piece.bodies
    cube = found[1]
    held = (cube.steps >= 1) & (cube.steps <= 90)
    assert {SEGMENTS[one] for one in cube.segment[held]} == {"constrained"}
    terms = cube.intervals[0].terms
    assert terms["contacts"][:90].any()
    assert cube.segment[0] == step_status.SET
    assert (cube.why == -1).all()
    assert (cube.unexplained <= CLOSES).all()


# -- other robots ---------------------------------------------------------------------------------

MORE = (
    "cartpole.urdf", "quadruped/minitaur.urdf", "racecar/racecar.urdf", "a1/a1.urdf",
    "aliengo/aliengo.urdf", "mini_cheetah/mini_cheetah.urdf", "xarm/xarm6_with_gripper.urdf",
    "pr2_gripper.urdf", "spherical_joint_limit.urdf", "bicycle/bike.urdf",
    "differential/diff_ring.urdf", "franka_panda/panda.urdf", "r2d2.urdf", "husky/husky.urdf",
    "humanoid/humanoid.urdf", "laikago/laikago_toes_zup_lores.urdf",
)  # fmt: skip
ROBOT = (
    FLOOR
    + """
import math
mode = "{mode}"
r = p.loadURDF("{file}", [0, 0, 0.6], flags=p.URDF_USE_SELF_COLLISION)
moving = [j for j in range(p.getNumJoints(r)) if p.getJointInfo(r, j)[2] in (0, 1)]
for i in range(100):
    for j in moving:
        lower, upper = p.getJointInfo(r, j)[8:10]
        middle, half = ((lower + upper) / 2, (upper - lower) / 2) if lower < upper else (0, 1)
        where, rate = middle + 0.3 * half * math.sin(0.05 * i + j), math.cos(0.05 * i + j)
        if mode in ("torque", "pd") and i == 0:
            p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, force=0)
        if mode == "position":
            p.setJointMotorControl2(r, j, p.POSITION_CONTROL, where, force=60)
        elif mode == "velocity":
            p.setJointMotorControl2(r, j, p.VELOCITY_CONTROL, targetVelocity=rate, force=60)
        elif mode == "torque":
            p.setJointMotorControl2(r, j, p.TORQUE_CONTROL, force=0.5 * rate)
        elif mode == "pd":
            p.setJointMotorControl2(r, j, p.PD_CONTROL, targetPosition=where, targetVelocity=0.1,
                positionGain=2, velocityGain=0.05, force=1)
    if i % 10 == 0:
        p.applyExternalForce(r, p.getNumJoints(r) - 1, [1, 0, 2], [0, 0, 0.1], p.LINK_FRAME)
    p.stepSimulation()
"""
)


@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "mode"),
    [
        (file, ("default", "position", "velocity", "torque", "pd")[(number + other) % 5])
        for number, file in enumerate(MORE)
        for other in (0, 2)
    ],
)
def test_any_robot_in_any_mode_is_explained(file: str, mode: str, tmp_path: Path) -> None:
    seen = record(ROBOT.format(file=file, mode=mode), tmp_path / "robot.rrd").seen
    totals = explanation(seen).totals[1]
    assert totals.explained >= 0.99 * totals.samples
    assert "remainder" not in totals.unexplained
    closes(totals)
