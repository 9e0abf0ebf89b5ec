"""Validation: what is said of creep, soft contact and what is not hit is true of bare PyBullet."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from asked import found, in_pieces
from conftest import some
from contact_scenes import BOX, FLOOR, GRIP, SLOPE, TRAY, bare
from scenes import site
from test_contact_overlaps import BOUNCES, HEAVY, run

# -- creeps ---------------------------------------------------------------------------------------

SOLVED = "p.setPhysicsEngineParameter(solverResidualThreshold=0, numSolverIterations=500)\n"
LOOSE = "p.setPhysicsEngineParameter(solverResidualThreshold={threshold})\n"
CREEPS = {
    "slope": (SLOPE.format(degrees=20, mu=0.9, above=0, steps=600), 1e-3),
    "flatter": (SLOPE.format(degrees=10, mu=0.5, above=0, steps=600), 3e-3),
    "large": (
        SLOPE.format(degrees=10, mu=0.5, above=0, steps=600).replace(
            "[0, 0, 0.05 + 0]", "[0, 0, .25], (.25, .25, .25)"
        ),
        3e-4,
    ),
    "by less than a millimetre": (SLOPE.format(degrees=15, mu=0.5, above=0, steps=2400), 1e-7),
}


@pytest.mark.parametrize("name", some(CREEPS, 1))
def test_what_the_solver_leaves_creeps(name: str, tmp_path: Path) -> None:
    scene, threshold = CREEPS[name]
    loose = LOOSE.format(threshold=threshold) + scene
    (one,) = found(loose, tmp_path, "creeps")
    assert one.level == "model"
    assert one.effect is not None
    start = np.array(bare(loose.replace("steps(", "steps(0 * "))["where"])
    way = np.linalg.norm(bare(loose)["where"] - start)
    assert one.effect.value == pytest.approx(way, rel=0.2)
    (other,) = in_pieces(loose, tmp_path, "creeps")
    assert (other.message, other.steps) == (one.message, one.steps)
    assert np.linalg.norm(bare(SOLVED + scene)["where"] - start) < 0.1 * way
    assert not found(SOLVED + scene, tmp_path, "creeps")
    assert not found(loose, tmp_path, "slides")


ROLLS = FLOOR + BOX + "b = ball(1, [0, 0, .1])\np.resetBaseVelocity(b, [.01, 0, 0], [0, .1, 0])\n"
SPINS = FLOOR + BOX + "b = box(1, [0, 0, .05])\np.resetBaseVelocity(b, [0, 0, 0], [0, 0, .1])\n"


@pytest.mark.parametrize(
    "scene",
    [
        SLOPE.format(degrees=20, mu=0.9, above=0, steps=600),
        ROLLS + "steps(480)",
        SPINS + "steps(240)",
        TRAY.format(mu=0.8),
        GRIP.format(mass=0.3, off=0, mu=0.3, force=10),
        SLOPE.format(degrees=25, mu=0.3, above=0, steps=240),
    ],
    ids=["slope", "rolls", "spins", "tray", "grip", "slides"],
)
def test_what_rests_or_slides_does_not_creep(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "creeps")


# -- slides: the numbers --------------------------------------------------------------------------

LONG = """
import math
a = math.radians({degrees})
p.setGravity(0, 0, -9.81)
p.setTimeStep({dt})
f = box(0, [0, 0, 0], (5, 2, .1), mu=.5, turned=(0, a, 0))
d = .1 + {half} + .001
b = box({mass}, [-math.cos(a) + d * math.sin(a), 0, d * math.cos(a) + math.sin(a)],
    (.1, .06, {half}), mu={mu}, turned=(0, a, 0))
steps(100)
"""


@pytest.mark.parametrize(
    ("degrees", "mass", "mu", "half", "dt"),
    [(38, 1, 0.6, 0.09, "1/60"), (30, 50, 0.3, 0.03, "1/240"), (20, 0.01, 0.2, 0.05, "1/100")],
)
def test_what_sliding_takes_is_the_slope(
    degrees: float, mass: float, mu: float, half: float, dt: str, tmp_path: Path
) -> None:
    """However it chatters: of steps without a force, friction takes nothing."""
    scene = BOX + LONG.format(degrees=degrees, mass=mass, mu=mu, half=half, dt=dt)
    (one,) = found(scene, tmp_path, "slides")
    # slides … m on …: friction there gives at most … N (…), staying takes … N (…)
    available = float(one.message.split("at most ")[1].split()[0])
    needed, wanted = re.findall(r"takes (\S+) N \((\S+)\)", one.message)[0]
    angle = math.radians(degrees)
    assert float(wanted) == pytest.approx(math.tan(angle), rel=0.02)
    assert float(needed) == pytest.approx(mass * 9.81 * math.sin(angle), rel=0.02)
    assert available == pytest.approx(0.5 * mu * mass * 9.81 * math.cos(angle), rel=0.02)


FAST = SLOPE.format(degrees=25, mu=0.3, above=0, steps=240).replace(
    "\nsteps(", "\np.resetBaseVelocity(b, [2, 0, 0])\nsteps("
)
LANDS = SLOPE.format(degrees=30, mu=0.62, above=0.3, steps=240)
SLIPPERY_BALL = SLOPE.format(degrees=40, mu=0.1, above=0, steps=240).replace(
    "box(1, [0, 0, 0.05 + 0], mu=0.1)",
    "ball(1, [0, 0, .1])\np.changeDynamics(b, -1, lateralFriction=.1)",
)

PUSHED_UP = SLOPE.format(degrees=25, mu=0.3, above=0, steps=0) + (
    "for i in range(240):\n    p.applyExternalForce(b, -1, [-1, 0, 0], [0, 0, 0], p.LINK_FRAME)\n"
    "    p.stepSimulation()"
)
GROOVE = (
    BOX
    + """
p.setGravity(4, 0, -9)
half = math.sqrt(.5)
p.createMultiBody(0, -1, -1, [0, 0, 0], [0, 0, 0, 1], linkMasses=[0, 0],
    linkCollisionShapeIndices=[shape(2, .3, .01)] * 2, linkVisualShapeIndices=[-1] * 2,
    linkPositions=[[0, -.2, .2], [0, .2, .2]],
    linkOrientations=[p.getQuaternionFromEuler([s * math.pi / 4, 0, 0]) for s in (-1, 1)],
    linkInertialFramePositions=[[0, 0, 0]] * 2, linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
    linkParentIndices=[0, 0], linkJointTypes=[p.JOINT_FIXED] * 2, linkJointAxis=[[0, 0, 1]] * 2)
b = box(1, [0, 0, .05 / half + .02], mu=.1, turned=[math.pi / 4, 0, 0])
steps(120)
"""
).replace("\np.setGravity", "\nimport math\np.setGravity", 1)


@pytest.mark.parametrize(
    "scene",
    [FAST, LANDS, SLIPPERY_BALL, PUSHED_UP, GROOVE],
    ids=["given speed", "lands", "a ball that slips", "pushed up", "in a groove"],
)
def test_what_did_not_rest_or_rolls_does_not_slide(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "slides")


# -- deep-penetration: more causes ----------------------------------------------------------------

SOFT = (
    FLOOR
    + BOX
    + """
b = {shape}
p.changeDynamics(b, -1, contactStiffness={stiffness}, contactDamping={damping})
"""
)
ROD = (
    FLOOR
    + BOX
    + """
p.setTimeStep({dt})
b = box({mass}, [0, 0, 1], ({half}, .01, .01))
p.resetBaseVelocity(b, [0, 0, -4], [0, {spin}, 0])
"""
)
CAUSES = {
    "soft": (SOFT.format(shape="ball(100, [0, 0, .3])", stiffness=1e4, damping=10),
        SOFT.format(shape="ball(100, [0, 0, .3])", stiffness=1e6, damping=100), 400, "1e+04 N/m"),
    "a soft box": (SOFT.format(shape="box(10, [0, 0, .06])", stiffness=500, damping=50),
        FLOOR + BOX + "b = box(10, [0, 0, .06])\n", 300, "500 N/m"),
    "softer": (SOFT.format(shape="ball(1, [0, 0, .11])", stiffness=300, damping=1),
        SOFT.format(shape="ball(1, [0, 0, .11])", stiffness=30000, damping=10), 300, "300 N/m"),
    "a rod that spins": (ROD.format(dt="1/60", mass=1, half=0.3, spin=15),
        ROD.format(dt="1/1000", mass=1, half=0.3, spin=15), 60, "in one step"),
    "a heavier one": (ROD.format(dt="1/100", mass=20, half=0.5, spin=30),
        ROD.format(dt="1/2000", mass=20, half=0.5, spin=30), 60, "in one step"),
}  # fmt: skip


@pytest.mark.parametrize("name", some(CAUSES, 2))
def test_why_it_is_deep(name: str, tmp_path: Path) -> None:
    scene, cured, n, cause = CAUSES[name]
    (one,) = found(run(scene, n), tmp_path, "deep-penetration")
    assert cause in one.message
    assert one.effect is not None
    truth = bare(run(scene, n))["deepest"]
    assert one.effect.value == pytest.approx(truth, rel=1e-6)
    (other,) = in_pieces(run(scene, n), tmp_path, "deep-penetration")
    assert (other.message, other.steps) == (one.message, one.steps)
    finer = 20 if "setTimeStep" in scene else 1
    assert bare(run(cured, n * finer))["deepest"] < 0.5 * truth


@pytest.mark.long
def test_masses_that_no_solver_can_tell_apart_get_no_advice(tmp_path: Path) -> None:
    for mass, iterations in ((1e4, 50), (1e4, 500), (1e6, 500)):
        scene = run(HEAVY.format(mass=mass, iterations=iterations), 200)
        assert bare(scene)["deepest"] > 0.05
        for one in found(scene, tmp_path, "deep-penetration"):
            assert "times as heavy" not in one.message
        (tmp_path / "scene.rrd").unlink()


# -- tunnelled ------------------------------------------------------------------------------------

SHOT = (
    BOX
    + """
p.setTimeStep({dt})
w = box(0, [2, 0, 1], {half}, turned={turned})
b = {shape}
p.resetBaseVelocity(b, {v})
steps({n})
"""
)
BULLETS = {
    "ball": {"half": (0.02, 1, 1), "turned": (0, 0, 0), "shape": "ball(.1, [0, 0, 1], .03)",
        "v": [60, 0, 0]},
    "box at a turned wall": {"half": (1, 0.01, 1), "turned": (0, 0, 1.2),
        "shape": "box(2, [0, 0, 1], (.02, .02, .02))", "v": [40, 0, 0]},
    "through a floor": {"half": (1, 1, 0.005), "turned": (0.3, 0, 0),
        "shape": "ball(1, [2, 0, 3.1], .02)", "v": [0, 0, -50]},
}  # fmt: skip


@pytest.mark.parametrize("name", some(BULLETS, 1))
def test_what_is_too_fast_passes_through(name: str, tmp_path: Path) -> None:
    scene = SHOT.format(**BULLETS[name], dt="1/240", n=40)
    (one,) = found(scene, tmp_path, "tunnelled")
    assert one.level == "broken"
    (other,) = in_pieces(scene, tmp_path, "tunnelled")
    assert (other.message, other.steps) == (one.message, one.steps)
    assert one.advice is not None
    shorter = 1 / 240 / float(one.advice.rsplit("/", 1)[1].rstrip(")"))
    steps = int(40 / 240 / shorter)
    cured = SHOT.format(**BULLETS[name], dt=shorter, n=steps)
    moves, stopped = (np.array(bare(each)["velocity"]) for each in (scene, cured))
    assert np.linalg.norm(stopped - moves) > 0.3 * np.linalg.norm(moves)
    assert not found(cured, tmp_path, "tunnelled")


FALLS = "p.setGravity(0, 0, -9.81)\n" + BOX + "f = box(0, [0, 0, 0], (1, 1, .05))\n"
PASSES = {
    "falls, seen only": (
        FALLS + "b = p.createMultiBody(2, {on}, "
        "p.createVisualShape(p.GEOM_SPHERE, radius=.1), [.3, 0, .4])\nsteps(120)\n",
        "-1", "p.createCollisionShape(p.GEOM_SPHERE, radius=.1)",
    ),
    "thrown onto a slope": (
        FALLS + "p.resetBasePositionAndOrientation(f, [0, 0, -1], [.2, 0, 0, 1])\n"
        "b = p.createMultiBody(.5, {on}, -1, [0, .2, 2])\np.resetBaseVelocity(b, [.1, 0, -3])\n"
        "steps(250)\n", "-1", "shape(.1, .1, .1)",
    ),
    "flies at a wall": (
        BOX + "w = box(0, [1, 0, 0], (.05, 1, 1))\nb = p.createMultiBody(.1, {on})\n"
        "p.resetBaseVelocity(b, [3, 0, 0])\nsteps(120)\n", "-1",
        "p.createCollisionShape(p.GEOM_CAPSULE, radius=.05, height=.1)",
    ),
    "a wall that is off": (
        BOX + "w = box(0, [1, 0, 0], (.05, 1, 1))\nb = ball(.2, [0, 0, 0])\n"
        "p.resetBaseVelocity(b, [3, 0, 0])\np.setCollisionFilterPair(b, w, -1, -1, {on})\n"
        "steps(120)\n", "0", "1",
    ),
    "a floor that is off": (
        FALLS + "b = p.loadURDF('sphere_small.urdf', [.2, .3, .5])\n"
        "p.setCollisionFilterPair(f, b, -1, -1, enableCollision={on})\nsteps(120)\n", "0", "1",
    ),
    "a shelf that is off": (
        FALLS + "s = box(0, [0, 0, 1], (.5, .5, .1))\nball(1, [0, 0, 1.5])\n"
        "b = p.loadURDF('duck_vhacd.urdf', [.2, 0, 1.4])\n"
        "p.setCollisionFilterPair(b, s, -1, -1, {on})\nsteps(90)\n", "0", "1",
    ),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", PASSES)
def test_what_cannot_touch_passes_through(name: str, tmp_path: Path) -> None:
    scene, off, on = PASSES[name]
    (one,) = found(scene.format(on=off), tmp_path, "tunnelled")
    if off == "-1":
        assert (one.level, one.site) == ("asked", None)
        assert one.message.endswith("it has no collision shape")
    else:
        line = scene[: scene.index("p.setCollisionFilterPair")].lstrip("\n").count("\n") + 1
        assert (one.level, one.site) == ("note", site(line))
        assert one.message.endswith("a call of p.setCollisionFilterPair switched this pair off")
    passed, held = (np.array(bare(scene.format(on=each))["where"]) for each in (off, on))
    assert np.linalg.norm(passed - held) > 0.3
    assert not found(scene.format(on=on), tmp_path, "tunnelled")


BESIDE = SHOT.format(
    half=(0.02, 1, 1),
    turned=(0, 0, 0),
    shape="ball(.1, [0, 1.5, 1], .03)",
    v=[60, 0, 0],
    dt="1/240",
    n=40,
)
MEANT = SHOT.format(
    half=(0.02, 1, 1),
    turned=(0, 0, 0),
    shape="ball(.1, [0, 0, 1], .03)\np.setCollisionFilterPair(w, b, -1, -1, 0)",
    v=[60, 0, 0],
    dt="1/240",
    n=40,
)
MOVED = (
    BOX
    + """
w = box(0, [2, 0, 1], (.02, 1, 1))
b = ball(1, [0, 0, 1])
steps(10)
p.resetBasePositionAndOrientation(b, [4, 0, 1], [0, 0, 0, 1])
steps(10)
"""
)


@pytest.mark.parametrize("scene", [BESIDE, MEANT, MOVED], ids=["beside", "meant", "moved"])
def test_what_goes_past_or_is_moved_does_not_tunnel(scene: str, tmp_path: Path) -> None:
    assert [each for each in found(scene, tmp_path, "tunnelled") if each.level != "note"] == []


# -- dragged-by-nothing ---------------------------------------------------------------------------

ON_ICE = (
    BOX
    + """
p.setGravity(0, 0, -9.81)
f = box(0, [0, 0, 0], (1, 1, .05), mu={mu})
b = box(1, [0, 0, .15], (.1, .1, .1), mu={mu})
for i in range(120):
    p.resetBasePositionAndOrientation(f, [.5 * (i + 1) / 240, 0, 0], [0, 0, 0, 1])
    p.resetBaseVelocity(f, [{v}, 0, 0])
    p.stepSimulation()
"""
)


SLIPPERY = ON_ICE.format(mu=0.1, v=0.5)
TINY = ON_ICE.format(mu=1, v=0).replace(".5 * (i + 1)", ".01 * (i + 1)")
SHAKEN = ON_ICE.format(mu=1, v=0).replace(
    "    p.stepSimulation()",
    "    p.resetBasePositionAndOrientation(f, [.003 * (-1) ** i, 0, 0], [0, 0, 0, 1])\n"
    "    p.stepSimulation()",
)
GOES = ON_ICE.format(mu=1, v=0).replace(
    "    p.stepSimulation()", "    p.resetBaseVelocity(b, [.4, 0, 0])\n    p.stepSimulation()"
)


@pytest.mark.parametrize(
    "scene", [SLIPPERY, TINY, SHAKEN, GOES], ids=["slippery", "tiny", "shaken", "goes itself"]
)
def test_what_has_a_velocity_or_gets_nowhere_drags(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "dragged-by-nothing")


def test_without_friction_no_velocity_drags(tmp_path: Path) -> None:
    scene = ON_ICE.format(mu=0, v=0)
    assert abs(bare(ON_ICE.format(mu=0, v=0.5))["where"][0]) < 1e-6
    assert not found(scene, tmp_path, "dragged-by-nothing")
    (tmp_path / "scene.rrd").unlink()
    assert len(found(ON_ICE.format(mu=1, v=0), tmp_path, "dragged-by-nothing")) == 1
    assert bare(ON_ICE.format(mu=1, v=0.5))["where"][0] > 0.2


# -- energy-gained, no-restitution ----------------------------------------------------------------

SETTLES = (
    BOX
    + """
p.setGravity(0, 0, -20)
p.setTimeStep(1 / 60)
f = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
b = box(1000, [-.01, .05, .2483], (.0442, .2257, .1141))
for each, value in ((f, 1), (b, .3)):
    p.changeDynamics(each, -1, restitution=value)
steps(480)
"""
)
INSIDE = BOUNCES.format(z=0.07, r=0.5) + "p.resetBaseVelocity(b, [0, 0, -.3])\nsteps(60)"
SET = (
    BOUNCES.format(z=0.5, r=0.5)
    + "steps(30)\np.resetBasePositionAndOrientation(b, [0, 0, .07], [0, 0, 0, 1])\nsteps(60)"
)
THIRD = (
    FLOOR
    + BOX
    + """
b = ball(.1, [0, 0, .1])
a = ball(10, [.02, 0, 1])
for each in (0, a, b):
    p.changeDynamics(each, -1, restitution=1)
steps(200)
"""
)


@pytest.mark.parametrize(
    "scene", [SETTLES, INSIDE, SET, THIRD], ids=["settles", "inside", "set inside", "a third"]
)
def test_what_does_not_leave_faster_than_it_comes(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "energy-gained")


DROPPED = FLOOR + BOX + "b = ball(1, [0, 0, {z}])\np.changeDynamics(b, -1, restitution={r})\n"
SOFTLY = DROPPED.format(z=1, r=0.9) + (
    "p.changeDynamics(b, -1, contactStiffness=2000, contactDamping=5)\nsteps(240)"
)
MEANT = DROPPED.format(z=1, r=0.9) + "p.changeDynamics(0, -1, restitution=0)\nsteps(240)"
LIFTED_BY_OVERLAP = DROPPED.format(z=0.6, r=0.05) + "steps(240)"


@pytest.mark.parametrize(
    "scene", [SOFTLY, MEANT, LIFTED_BY_OVERLAP], ids=["soft", "asked for 0", "overlap"]
)
def test_what_rebounds_by_another_law_is_not_said_not_to(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "no-restitution")


# -- starts-in-contact ----------------------------------------------------------------------------

RESTORED = (
    FLOOR
    + BOX
    + """
p.setTimeStep(1 / 60)
b = ball(1, [0, 0, 1], .03)
for i in range(200):
    p.stepSimulation()
    if max([0, *(-c[8] for c in p.getContactPoints(b))]) > .002:
        break
state = p.saveState()
steps(20)
p.restoreState(state)
steps(20)
"""
)
NOT_PUSHED = "p.setPhysicsEngineParameter(contactERP=0)\n" + (
    FLOOR + BOX + "b = box(1, [0, 0, .045])\nsteps(60)"
)


@pytest.mark.parametrize("scene", [RESTORED, NOT_PUSHED], ids=["restored", "not pushed"])
def test_what_no_call_put_there_or_nothing_moves(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "starts-in-contact")
