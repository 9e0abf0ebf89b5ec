"""Validation: findings about overlaps and energy gain are true of bare PyBullet."""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import found, in_pieces
from conftest import some
from contact_scenes import BOX, FLOOR, HEIGHT, PANDA, PUSHED, STACK, bare

# -- deep-penetration -----------------------------------------------------------------------------

DEEPEST = """
deepest = 0
for i in range({n}):
    {act}
    p.stepSimulation()
    deepest = max([deepest] + [-c[8] for c in p.getContactPoints(b)])
"""


def run(scene: str, n: int, act: str = "pass") -> str:
    """Return a scene that stores how deep its body b was in another body."""
    return scene + DEEPEST.format(n=n, act=act)


FALLS = FLOOR + BOX + "p.setTimeStep({dt})\nb = ball(1, [0, 0, {z}], {radius})\n"
FINGERS = (
    BOX
    + """
p.setPhysicsEngineParameter(numSolverIterations={iterations})
g = joined([shape(.01, .03, .03)] * 2, [[-.15, 0, 0], [.15, 0, 0]], [[1, 0, 0], [-1, 0, 0]],
    [0, 0], [.1, .1])
b = ball({mass}, [0, 0, 0], .05)
for j in (0, 1):
    p.setJointMotorControl2(g, j, p.POSITION_CONTROL, .15, force={force})
"""
)
DRAGGED = (
    BOX
    + """
p.setGravity(0, 0, -9.81)
t = box(0, [0, 0, 0], (.2, .2, .2))
b = box(1, [0, 0, .4])
c = p.createConstraint(b, -1, -1, -1, p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, .4])
"""
)
DOWN = "p.changeConstraint(c, [0, 0, .4 - .25 * min(i / 240, 1)]{more})"
HEAVY = (
    FLOOR
    + BOX
    + """
p.setPhysicsEngineParameter(numSolverIterations={iterations})
a = box(1, [0, 0, .1], (.1, .1, .1))
b = box({mass}, [0, 0, .3], (.1, .1, .1))
"""
)
RISES = (
    FLOOR
    + BOX
    + """
f = box(0, [0, 0, .5], (.3, .3, .02), mu=1)
b = box(1, [0, 0, .58], mu=1)
"""
)
UP = "p.resetBasePositionAndOrientation(f, [0, 0, .5 + {v} / 240 * (i + 1)], [0, 0, 0, 1])"
WITH = "; p.resetBaseVelocity(f, [0, 0, {v}])"

DEEP = {
    "falls": (
        run(FALLS.format(z=2, radius=0.03, dt="1/240"), 240),
        run(FALLS.format(z=2, radius=0.03, dt="1/960"), 960),
        "approach by 24.8 mm in one step",
    ),
    "falls in large steps": (
        run(FALLS.format(z=1, radius=0.1, dt="1/60"), 60),
        run(FALLS.format(z=1, radius=0.1, dt="1/480"), 480),
        "approach by",
    ),
    "falls far": (
        run(FALLS.format(z=6, radius=0.05, dt="1/240"), 300),
        run(FALLS.format(z=6, radius=0.05, dt="1/2000"), 2400),
        "approach by",
    ),
    "fingers": (
        run(FINGERS.format(mass=0.01, force=1000, iterations=50), 200),
        run(FINGERS.format(mass=0.01, force=100, iterations=50), 200),
        "motors press them",
    ),
    "fingers on a heavier ball": (
        run(FINGERS.format(mass=0.05, force=1000, iterations=50), 300),
        run(FINGERS.format(mass=0.05, force=1000, iterations=500), 300),
        "motors press them",
    ),
    "dragged into a table": (
        run(DRAGGED, 480, DOWN.format(more="")),
        run(DRAGGED, 480, DOWN.format(more=", maxForce=50")),
        "a constraint presses them",
    ),
    "a heavy one": (
        run(HEAVY.format(mass=1000, iterations=50), 400),
        run(HEAVY.format(mass=1000, iterations=500), 400),
        "one is 1000 times as heavy",
    ),
    "a support set without velocity": (
        run(RISES, 240, UP.format(v=0.6)),
        run(RISES, 240, UP.format(v=0.6) + WITH.format(v=0.6)),
        "it has no velocity",
    ),
    "a faster one": (
        run(RISES, 120, UP.format(v=1.0)),
        run(RISES, 120, UP.format(v=1.0) + WITH.format(v=1.0)),
        "it has no velocity",
    ),
}


@pytest.mark.parametrize("name", some(DEEP, 3))
def test_what_overlaps_deeply(name: str, tmp_path: Path) -> None:
    scene, cured, cause = DEEP[name]
    one = max(found(scene, tmp_path, "deep-penetration"), key=lambda each: each.share)
    assert cause in one.message
    assert one.effect is not None
    truth = bare(scene)["deepest"]
    assert one.effect.value == pytest.approx(truth, rel=1e-6)
    other = max(in_pieces(scene, tmp_path, "deep-penetration"), key=lambda piece: piece.share)
    assert (other.message, other.steps, other.level) == (one.message, one.steps, one.level)
    assert bare(cured)["deepest"] < 0.5 * truth


def test_what_stays_inside_is_broken(tmp_path: Path) -> None:
    (one,) = found(DEEP["fingers"][0], tmp_path, "deep-penetration")
    assert one.level == "broken"
    plate = FLOOR + BOX + "b = box(.02, [0, 0, .1], (.05, .05, .002))\nsteps(240)"
    assert {each.level for each in found(plate, tmp_path, "deep-penetration")} <= {"model"}


PLATE = (
    BOX
    + """
p.setGravity(0, 0, -9.81)
plate = box(0, [0, 0, .5], (.5, .5, .01), {turned})
b = ball(1, [0, 0, {z}], .05)
p.resetBaseVelocity(b, [0, 0, -3.6])
"""
)


@pytest.mark.parametrize("turned", ["", "turned=[0, .4, 0]"])
def test_the_thinner_one_may_be_what_stays(turned: str, tmp_path: Path) -> None:
    scene = run(PLATE.format(turned=turned, z=0.57), 20)
    (one,) = found(scene, tmp_path, "deep-penetration")
    assert f"{bare(scene)['deepest'] / 0.02:.0%} of the thinner one" in one.message


TUMBLES = FLOOR + BOX + "b = box(1, [0, 0, .4], turned=[.6, .3, 0])\nsteps(480)"


@pytest.mark.parametrize(
    "scene",
    some([PANDA, PUSHED, STACK, TUMBLES, HEAVY.format(mass=1, iterations=50) + "steps(300)"], 2),
    ids=["panda", "pushed", "stack", "tumbles", "as heavy"],
)
def test_what_rests_is_not_deep_and_gains_nothing(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "deep-penetration")
    assert not found(scene, tmp_path, "energy-gained")


# -- energy-gained --------------------------------------------------------------------------------

BOUNCES = (
    FLOOR
    + BOX
    + """
b = ball(1, [0, 0, {z}])
for each in (0, b):
    p.changeDynamics(each, -1, restitution={r}, linearDamping=0)
"""
)


@pytest.mark.parametrize(("z", "r"), some([(5, 1), (2, 1.1), (8, 1)], 1))
def test_what_bounces_ever_higher(z: float, r: float, tmp_path: Path) -> None:
    scene = BOUNCES.format(z=z, r=r) + HEIGHT.replace("240", "1200")
    (one,) = found(scene, tmp_path, "energy-gained")
    assert one.level == "broken"
    (other,) = in_pieces(scene, tmp_path, "energy-gained")
    assert (other.message, other.steps) == (one.message, one.steps)
    assert max(bare(scene)["z"]) > z + 0.01
    lower = BOUNCES.format(z=z, r=0.9) + HEIGHT.replace("240", "1200")
    assert max(bare(lower)["z"]) <= z
    assert not found(lower, tmp_path, "energy-gained")


MET = (
    BOX
    + """
p.setPhysicsEngineParameter(contactERP={erp})
a, b = ball(1, [0, 0, 0]), ball(2, [1, .05, 0])
for each in (a, b):
    p.changeDynamics(each, -1, restitution=1, linearDamping=0, lateralFriction=0)
p.resetBaseVelocity(a, [1, 0, 0])
steps(300)
"""
)


def test_two_that_meet_in_space_gain_from_the_push(tmp_path: Path) -> None:
    (one,) = found(MET.format(erp=0.2), tmp_path, "energy-gained")
    assert "the push out of the overlap" in one.message
    assert not found(MET.format(erp=0), tmp_path, "energy-gained")


def test_without_the_push_it_is_the_gravity_of_the_step(tmp_path: Path) -> None:
    scene = BOUNCES.format(z=2, r=1) + "p.setPhysicsEngineParameter(contactERP=0)\n"
    (one,) = found(scene + "steps(400)", tmp_path, "energy-gained")
    assert "gravity gives them in that step" in one.message
    assert not found(scene + "p.setTimeStep(1 / 2400)\nsteps(4000)", tmp_path, "energy-gained")


LIFTED = (
    BOX
    + """
p.setGravity(0, 0, -9.81)
t = joined([shape(.3, .3, .02)], [[0, 0, 0]], [[0, 0, 1]], [0], [2])
b = box(1, [0, 0, .07])
for each, link in ((t, 0), (b, -1)):
    p.changeDynamics(each, link, restitution=.9)
for i in range(480):
    p.setJointMotorControl2(t, 0, p.POSITION_CONTROL, min(i / 480, 1), force=500)
    p.stepSimulation()
"""
)
HIT = (
    FLOOR
    + BOX
    + """
a = ball(20, [-.5, 0, .1])
b = ball(.2, [0, 0, .1])
for each in (a, b):
    p.changeDynamics(each, -1, restitution=1)
p.resetBaseVelocity(a, [2, 0, 0])
steps(240)
"""
)


@pytest.mark.parametrize(
    "scene",
    [
        LIFTED,
        HIT,
        run(
            RISES + "p.changeDynamics(b, -1, restitution=1)\n"
            "p.changeDynamics(f, -1, restitution=1)\n",
            240,
            UP.format(v=0.6) + WITH.format(v=0.6),
        ),
    ],
    ids=["lifted", "hit", "carried"],
)
def test_what_is_lifted_or_hit_gains_nothing_from_nowhere(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "energy-gained")
