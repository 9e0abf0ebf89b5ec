"""Validation: what is said of bodies that touch is true of bare PyBullet, and only then said.

Where a rule speaks, the one thing that it names is changed, and the symptom goes.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from asked import findings, told_in_pieces
from conftest import some
from contact_scenes import (
    BOX,
    DUCKS,
    FLOOR,
    GRIP,
    HEIGHT,
    JERKED,
    LIFT,
    PANDA,
    PUCK,
    PUSHED,
    SLOPE,
    STACK,
    TRAY,
    TURNED,
    bare,
)
from drop_physics.rules.answer import Finding
from scenes import record


def found(scene: str, path: Path, code: str) -> list[Finding]:
    """Return the findings of one code."""
    return [finding for finding in findings(scene, path / "scene.rrd") if finding.code == code]


def in_pieces(scene: str, path: Path, code: str) -> list[Finding]:
    """Return the same where the recording comes in pieces."""
    said = told_in_pieces(record(scene, path / "pieces.rrd").seen)
    return [each for each in said if each.code == code]


# -- slides ---------------------------------------------------------------------------------------

SLIDES = {
    "slope": (SLOPE.format(degrees=25, mu=0.3, above=0, steps=240), 1, "0.466"),
    "dropped onto a slope": (SLOPE.format(degrees=35, mu=0.3, above=0.002, steps=240), 1, "0.7"),
    "grip": (GRIP.format(mass=0.3, off=0, mu=0.1, force=10), 1, "0.147"),
    "grip of a heavy one": (GRIP.format(mass=2, off=0, mu=0.7, force=10), 1, "0.98"),
    "lift": (LIFT.format(mass=1, mu=0.2, force=10), 2, "0.5"),
    "tray": (TRAY.format(mu=0.3), 2, "0.5"),
    "turned": (TURNED.format(mu=0.3), 2, "0.3"),
    "jerked": (JERKED.format(mass=0.3, mu=0.3, force=10), 2, "(0.403)"),
}
HOLDS = {
    "slope": SLOPE.format(degrees=25, mu=0.6, above=0, steps=240),
    "dropped onto a slope": SLOPE.format(degrees=35, mu=0.9, above=0.002, steps=240),
    "grip": GRIP.format(mass=0.3, off=0, mu=0.3, force=10),
    "grip of a heavy one": GRIP.format(mass=2, off=0, mu=0.7, force=30),
    "lift": LIFT.format(mass=1, mu=1.5, force=10).replace("else 0)", "else 10)"),
    "tray": TRAY.format(mu=0.8),
    "turned": TURNED.format(mu=0.8),
    "jerked": JERKED.format(mass=0.3, mu=0.3, force=20),
}


@pytest.mark.parametrize("name", some(SLIDES, 2))
def test_what_friction_cannot_hold_slides(name: str, tmp_path: Path) -> None:
    scene, number, wanted = SLIDES[name]
    (one,) = found(scene, tmp_path, "slides")
    assert (one.level, one.body) == ("asked", f"{number}_box")
    assert wanted in one.message
    assert one.effect is not None
    assert one.effect.value > 0.01
    (other,) = in_pieces(scene, tmp_path, "slides")
    assert (other.message, other.steps) == (one.message, one.steps)
    # With more friction, or more force, it does not.
    held = np.array(bare(HOLDS[name])["where"]) - bare(scene)["where"]
    assert np.linalg.norm(held) > 0.5 * one.effect.value
    assert not found(HOLDS[name], tmp_path, "slides")


def test_no_factor_makes_friction_of_none(tmp_path: Path) -> None:
    (one,) = found(SLOPE.format(degrees=25, mu=0, above=0, steps=240), tmp_path, "slides")
    assert one.cure is None
    assert one.advice is not None
    assert "give both bodies a lateralFriction, with a product well above 0.466" in str(one.advice)


def test_what_is_restored_slides_once(tmp_path: Path) -> None:
    again = "s = p.saveState()\nsteps(60)\np.restoreState(s)\nsteps(60)\n"
    ways = []
    for n, then in ((0, again), (60, "")):
        scene = SLOPE.format(degrees=25, mu=0.3, above=0, steps=n) + then
        (one,) = found(scene, tmp_path, "slides")
        assert one.effect is not None
        ways.append(one.effect.value)
    assert ways[0] == pytest.approx(ways[1], rel=0.05)


TILT = "turned = p.getBasePositionAndOrientation(b)[1]\n"
CROSSWISE = (
    GRIP.replace("shape(.01, .01, .01)", "shape(.005, .015, .015)")
    .replace("[0, -.035, 1], [0, .035, 1]", "[-.035, 0, 1], [.035, 0, 1]")
    .replace("[[0, 1, 0], [0, -1, 0]]", "[[1, 0, 0], [-1, 0, 0]]")
    .replace("[{off}, 0, 1], (.3, .02, .02)", "[0, {off}, 1], (.02, .2, .03)")
)
BESIDE = {
    "a long way": (GRIP, {"mass": 0.15, "mu": 1, "force": 4}, 0.25),
    "a heavy bar": (GRIP, {"mass": 0.8, "mu": 0.9, "force": 15}, -0.1),
    "crosswise": (CROSSWISE, {"mass": 0.4, "mu": 0.8, "force": 12}, 0.15),
}


@pytest.mark.parametrize("name", BESIDE)
def test_what_is_gripped_beside_its_centre_turns(name: str, tmp_path: Path) -> None:
    scene, numbers, off = BESIDE[name]
    beside, centred = (scene.format(**numbers, off=each) for each in (off, 0))
    (one,) = found(beside, tmp_path, "slides")
    assert one.message.startswith("1_box turns in the grip of 0_box")
    weight = float(one.message.rsplit("takes ", 1)[1].split()[0])
    # Of a bar that turns the arm becomes shorter.
    assert 0.5 < weight / (numbers["mass"] * 9.81 * abs(off)) < 1.01
    tilts = [np.linalg.norm(bare(each + TILT)["turned"][:3]) for each in (beside, centred)]
    assert tilts[0] > 0.1
    assert tilts[1] < 0.1 * tilts[0]
    assert not found(centred, tmp_path, "slides")


@pytest.mark.parametrize(
    "scene", [PUCK, PUSHED, PANDA, DUCKS], ids=["puck", "pushed", "panda", "ducks"]
)
def test_what_is_meant_to_move_does_not_slide(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "slides")


def test_a_ball_rolls(tmp_path: Path) -> None:
    scene = SLOPE.format(degrees=40, mu=0.1, above=0, steps=240)
    assert not found(
        scene.replace("box(1, [0, 0, 0.05 + 0], mu=0.1)", "ball(1, [0, 0, .1])"), tmp_path, "slides"
    )


# -- starts-in-contact, self-collision ------------------------------------------------------------

CUBES = (
    FLOOR
    + """
a = p.loadURDF("cube_small.urdf", [0, 0, .025])
b = p.loadURDF("cube_small.urdf", [.2, 0, .025])
steps(240)
p.resetBasePositionAndOrientation(b, [{x}, .01, .025], [0, 0, 0, 1])
steps(60)
"""
)
LATER = (
    FLOOR
    + """
a = p.loadURDF("cube_small.urdf", [0, 0, .025])
steps(100)
b = p.loadURDF("sphere_small.urdf", [0, 0, {z}])
steps(5)
"""
)
STANDING = (
    FLOOR
    + """
b = p.loadURDF("laikago/laikago_toes_zup_lores.urdf", [0, 0, {z}])
steps(3)
"""
)
THROWN = FLOOR + BOX + "a = box(0, [0, 0, .5], (.5, .5, .3))\nb = box(1, [0, 0, {z}])\nsteps(3)"
OVERLAPS = {
    "set": (CUBES.format(x=0.02), CUBES.format(x=0.06), "asked", "is set 30 mm", 7),
    "loaded later": (LATER.format(z=0.05), LATER.format(z=0.09), "asked", "is loaded 30 mm", 6),
    "a robot": (STANDING.format(z=0.46), STANDING.format(z=0.53), "asked", "58.3 mm", 4),
    "thrown": (THROWN.format(z=0.75), THROWN.format(z=0.851), "broken", "100 mm", 6),
}


@pytest.mark.parametrize("name", some(OVERLAPS, 1))
def test_what_is_placed_inside_another(name: str, tmp_path: Path) -> None:
    scene, cured, level, text, line = OVERLAPS[name]
    (one,) = found(scene, tmp_path, "starts-in-contact")
    assert one.level == level
    assert text in one.message
    assert one.site == f"scene.py:{line}"
    assert one.cure is not None
    assert np.dot(one.cure.given["away"], [1, 0, 0] if name == "set" else [0, 0, 1]) > 0.9
    (other,) = in_pieces(scene, tmp_path, "starts-in-contact")
    assert (other.message, other.site) == (one.message, one.site)
    moved, rests = (np.linalg.norm(bare(each)["velocity"]) for each in (scene, cured))
    assert moved > rests
    assert not found(cured, tmp_path, "starts-in-contact")


FIXED = FLOOR + 'b = p.loadURDF("kuka_iiwa/model.urdf", [0, 0, -.05], useFixedBase=True)\nsteps(9)'
CARRIED = (
    FLOOR
    + BOX
    + """
f = box(0, [0, 0, .5], (.3, .3, .02), mu=1)
b = box(1, [0, 0, .57], mu=1)
for i in range(120):
    p.resetBasePositionAndOrientation(f, [0, 0, .5 + i / 480], [0, 0, 0, 1])
    p.stepSimulation()
"""
)

ELEVATOR = (
    FLOOR
    + BOX
    + """
f = box(0, [0, 0, .5], (.3, .3, .02))
b = box(1, [0, 0, .57])
z = .5
for i in range(120):
    v = .5 if i > 40 else 0
    z += v / 240
    p.resetBasePositionAndOrientation(f, [0, 0, z], [0, 0, 0, 1])
    p.resetBaseVelocity(f, [0, 0, v])
    p.stepSimulation()
"""
)


@pytest.mark.parametrize(
    "scene",
    [FIXED, STACK, CARRIED, ELEVATOR, PANDA],
    ids=["fixed", "stack", "carried", "elevator", "panda"],
)
def test_what_touches_or_cannot_move_starts_well(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "starts-in-contact")


ITSELF = (
    BOX
    + """
v = [shape(.05, .05, .05)] * 3
b = p.createMultiBody(
    1, -1, -1, [0, 0, 0], [0, 0, 0, 1], linkMasses=[1] * 3, linkCollisionShapeIndices=v,
    linkVisualShapeIndices=[-1] * 3, linkPositions=[[0, 0, .2], [.2, 0, 0], [{x}, 0, 0]],
    linkOrientations=[[0, 0, 0, 1]] * 3, linkInertialFramePositions=[[0, 0, 0]] * 3,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 3, linkParentIndices=[0, 1, 1],
    linkJointTypes=[p.JOINT_PRISMATIC] * 3, linkJointAxis=[[1, 0, 0]] * 3{flags})
for j in range(3):
    p.setJointMotorControl2(b, j, p.VELOCITY_CONTROL, force=0)
steps(30)
"""
)


@pytest.mark.parametrize("x", [0.12, 0.15, 0.18])
def test_links_that_overlap_collide(x: float, tmp_path: Path) -> None:
    flags = ", flags=p.URDF_USE_SELF_COLLISION"
    (one,) = found(ITSELF.format(x=x, flags=flags), tmp_path, "self-collision")
    assert one.effect is not None
    assert one.effect.value == pytest.approx(0.1 - (0.2 - x), abs=2e-3)
    assert "0_box (link3) collides" in one.message
    assert "inside 0_box (link2)" in one.message
    for cured in (ITSELF.format(x=x, flags=""), ITSELF.format(x=0.09, flags=flags)):
        assert not found(cured, tmp_path, "self-collision")


# -- no-restitution -------------------------------------------------------------------------------

DROPPED = FLOOR + BOX + "b = ball(1, [0, 0, {z}])\np.changeDynamics(b, -1, restitution={r})\n"
BOUNCY = "p.changeDynamics(0, -1, restitution={r})\n"


@pytest.mark.parametrize(("z", "r"), some([(1, 0.9), (0.5, 0.5), (0.3, 1)], 1))
def test_one_restitution_is_none(z: float, r: float, tmp_path: Path) -> None:
    scene = DROPPED.format(z=z, r=r) + HEIGHT
    (one,) = found(scene, tmp_path, "no-restitution")
    assert f"{r:.3g} × 0" in one.message
    assert (one.body, one.other, one.site) == ("1_sphere", "0_plane", "scene.py:22")
    assert [piece.message for piece in in_pieces(scene, tmp_path, "no-restitution")] == [
        one.message
    ]
    cured = DROPPED.format(z=z, r=r) + BOUNCY.format(r=1) + HEIGHT
    landed = int(240 * (2 * (z - 0.1) / 9.81) ** 0.5) + 10
    tops = [max(bare(each)["z"][landed:]) for each in (scene, cured)]
    assert tops[0] < 0.115
    assert tops[1] > tops[0] + 0.25 * r**2 * (z - 0.1)
    assert not found(cured, tmp_path, "no-restitution")


@pytest.mark.parametrize(
    "scene",
    [
        DROPPED.format(z=0.1, r=0.5) + "steps(100)",
        DROPPED.format(z=0.101, r=0.9) + "steps(100)",
        DROPPED.format(z=1, r=0) + "steps(200)",
        DROPPED.format(z=1, r=0.3) + BOUNCY.format(r=0.5) + "steps(200)",
    ],
)
def test_what_was_placed_or_bounces_has_restitution(scene: str, tmp_path: Path) -> None:
    assert not found(scene, tmp_path, "no-restitution")


TILTED = (
    FLOOR
    + """
s = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.05, 0.05])
b = p.createMultiBody(1, s, -1, [0, 0, {z}], p.getQuaternionFromEuler([0, 0.3, 0]))
p.changeDynamics(b, -1, restitution=0.9, linearDamping=0)
steps(240)
"""
)


def test_a_corner_that_comes_down_later_is_not_how_fast_it_falls(tmp_path: Path) -> None:
    z, half_m = 1.0, 0.3 * np.sin(0.3) + 0.05 * np.cos(0.3)
    (one,) = found(TILTED.format(z=z), tmp_path, "no-restitution")
    (speed,) = re.findall(r"meets it at (\S+) m/s", one.message)
    assert float(speed) == pytest.approx((2 * 9.81 * (z - half_m)) ** 0.5, rel=0.02)


OTHERS = {
    "alone": ("", 1),
    "a ball that bounces": ("b = ball(1, [3, 0, 1])\np.changeDynamics(b, -1, restitution=0.4)", 0),
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_floor_is_for_other_things(what: str, tmp_path: Path) -> None:
    """Of a car nobody asks that it bounces, nor of a box where another thing was told to."""
    others, count = OTHERS[what]
    car = "p.loadURDF('racecar/racecar.urdf', [-3, 0, 0.2])"
    box = "box(1, [0, 0, 0.5])"
    scene = "\n".join((FLOOR, BOX, BOUNCY.format(r=0.5), box, car, others, "steps(120)"))
    said = found(scene, tmp_path, "no-restitution")
    assert [each.body for each in said] == ["1_box"] * count


AT_A_WALL = (
    BOX
    + """
w = box(0, (1.1, 0, 0), (.1, 1, 1))
shape = p.createCollisionShape({shape}, radius={size}, height=.3)
b = p.createMultiBody(.2, shape, -1, [{x}, 0, 0], [1, 0, 0, 1])
for each in (w, b):
    p.changeDynamics(each, -1, restitution={r}, linearDamping=0, angularDamping=0{more})
p.resetBaseVelocity(b, ({v}, 0, 0))
steps(480)
"""
)
EARLY = [
    ("p.GEOM_SPHERE", 0.2, 0, 1, 1),
    ("p.GEOM_CYLINDER", 0.1, 0.002, 0.5, 0.8),
    ("p.GEOM_CAPSULE", 0.1, 0.002, 0.5, 0.8),
]


@pytest.mark.parametrize(("shape", "size", "x", "v", "r"), some(EARLY, 1))
def test_a_contact_acts_before_it_touches(
    shape: str, size: float, x: float, v: float, r: float, tmp_path: Path
) -> None:
    scene, cured = (
        AT_A_WALL.format(shape=shape, size=size, x=x, v=v, r=r, more=more)
        for more in ("", ", contactProcessingThreshold=0")
    )
    (one,) = found(scene, tmp_path, "no-restitution")
    assert f"{v} m/s and leaves at 0 m/s" in one.message
    assert "before they touch" in one.message
    assert abs(bare(scene)["velocity"][0]) < 0.01 * v
    assert bare(cured)["velocity"][0] < -0.9 * r**2 * v
    assert not found(cured, tmp_path, "no-restitution")


SLOW = (
    BOX
    + """
w = box(0, [0, 0, 0], {wall})
b = {body}
for each in (w, b):
    p.changeDynamics(each, -1, restitution={r}, linearDamping=0, contactProcessingThreshold=0)
p.resetBaseVelocity(b, {v})
{more}
steps({n})
"""
)
QUICKER = "p.setPhysicsEngineParameter(restitutionVelocityThreshold=.01)"


@pytest.mark.parametrize(
    ("body", "wall", "v", "r", "n"),
    [
        ("ball(.3, [0, 0, .2], .05)", (1, 1, 0.1), [0, 0, -0.19], 0.9, 140),
        ("box(2, [-.2, 0, 0], (.02, .02, .02))", (0.1, 1, 1), [0.17, 0, 0], 1, 200),
        ("p.loadURDF('sphere_small.urdf', [0, .2, 0])", (1, 0.1, 1), [0, -0.18, 0], 0.7, 200),
    ],
)
def test_what_comes_slowly_does_not_bounce(
    body: str, wall: tuple[float, ...], v: list[float], r: float, n: int, tmp_path: Path
) -> None:
    slow, cured, faster = (
        SLOW.format(body=body, wall=wall, v=[k * each for each in v], r=r, n=n, more=more)
        for k, more in ((1, ""), (1, QUICKER), (3, ""))
    )
    (one,) = found(slow, tmp_path, "no-restitution")
    speed = np.linalg.norm(v)
    assert f"at {speed:.3g} m/s and leaves" in one.message
    assert "slower than 0.2 m/s" in one.message
    assert np.linalg.norm(bare(slow)["velocity"]) < 0.3 * r**2 * speed
    for scene, k in ((cured, 1), (faster, 3)):
        assert bare(scene)["velocity"] @ np.array(v) < -0.6 * r**2 * k * speed**2
        assert not found(scene, tmp_path, "no-restitution")


@pytest.mark.parametrize("x_m", [0.0003, 0.0005])
def test_a_threshold_that_was_set_is_not_bullets_own(x_m: float, tmp_path: Path) -> None:
    # An early contact takes the rebound: the threshold does not.
    scene = f"""
p.setPhysicsEngineParameter(restitutionVelocityThreshold=0.01)
wall = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 1, 1]),
                         basePosition=[1.1, 0, 0])
ball = p.createMultiBody(1, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1),
                         basePosition=[{x_m}, 0, 0])
for each in (wall, ball):
    p.changeDynamics(each, -1, restitution=1, linearDamping=0)
p.resetBaseVelocity(ball, [0.19, 0, 0])
steps(1300)
"""
    assert not found(scene, tmp_path, "no-restitution")


# -- friction-pyramid -----------------------------------------------------------------------------

ALONG = (
    BOX
    + """
import math
p.setGravity(0, 0, -9.81)
p.setPhysicsEngineParameter(enableConeFriction={cone})
f = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
p.changeDynamics(f, -1, lateralFriction=1)
b = box(1, [0, 0, .03], (.1, .1, .03), mu={mu})
steps(60)
a = math.radians({degrees})
p.resetBaseVelocity(b, [{v} * math.cos(a), {v} * math.sin(a), 0])
steps(200)
"""
)


@pytest.mark.parametrize(
    ("degrees", "v", "mu"), some([(20, 3, 0.5), (45, 2, 0.3), (120, 4, 0.4)], 1)
)
def test_friction_has_two_axes(degrees: float, v: float, mu: float, tmp_path: Path) -> None:
    scene = ALONG.format(cone=0, degrees=degrees, v=v, mu=mu)
    (one,) = found(scene, tmp_path, "friction-pyramid")
    assert one.effect is not None
    assert one.effect.value == pytest.approx(2**0.5, rel=1e-3)
    assert in_pieces(scene, tmp_path, "friction-pyramid") == [one]
    cone = ALONG.format(cone=1, degrees=degrees, v=v, mu=mu)
    way, cured = (np.linalg.norm(bare(each)["where"][:2]) for each in (scene, cone))
    assert cured > 1.03 * way
    assert not found(cone, tmp_path, "friction-pyramid")


def test_along_an_axis_it_is_the_same(tmp_path: Path) -> None:
    assert not found(ALONG.format(cone=0, degrees=0, v=3, mu=0.5), tmp_path, "friction-pyramid")


# -- dragged-by-nothing ---------------------------------------------------------------------------

MOVED = (
    BOX
    + """
p.setGravity(0, 0, -9.81)
f = box(0, [0, 0, 0], (1, 1, .05), mu=1)
b = box({mass}, [0, 0, .15], (.1, .1, .1))
steps(60)
for i in range(240):
    p.resetBasePositionAndOrientation(f, [{way} * (i + 1) / 240, 0, 0], [0, 0, 0, 1])
    {more}
    p.stepSimulation()
"""
)


@pytest.mark.parametrize(("way", "mass"), some([(0.5, 1), (0.2, 3), (-0.7, 0.1)], 1))
def test_a_support_without_velocity_drags_nothing(way: float, mass: float, tmp_path: Path) -> None:
    scene = MOVED.format(way=way, mass=mass, more="pass")
    (one,) = found(scene, tmp_path, "dragged-by-nothing")
    assert one.effect is not None
    assert one.effect.value == pytest.approx(abs(way), rel=2e-2)
    (other,) = in_pieces(scene, tmp_path, "dragged-by-nothing")
    assert (other.message, other.steps) == (one.message, one.steps)
    cured = MOVED.format(way=way, mass=mass, more=f"p.resetBaseVelocity(f, [{way}, 0, 0])")
    assert abs(bare(scene)["where"][0]) < 0.01 * abs(way)
    assert bare(cured)["where"][0] == pytest.approx(way, rel=0.2)
    assert not found(cured, tmp_path, "dragged-by-nothing")


def test_a_table_that_is_set_once_is_no_drag(tmp_path: Path) -> None:
    scene = (
        BOX
        + """
p.setGravity(0, 0, -9.81)
f = box(0, [0, 0, 0], (1, 1, .05), mu=1)
b = box(1, [0, 0, .15], (.1, .1, .1))
for i in range(5):
    steps(40)
    p.resetBasePositionAndOrientation(f, [.1 * i, 0, 0], [0, 0, 0, 1])
steps(40)
"""
    )
    assert not found(scene, tmp_path, "dragged-by-nothing")
    assert not found(TRAY.format(mu=0.8), tmp_path, "dragged-by-nothing")
