"""Validation: the cause of a deep contact, checked in bare PyBullet; no energy gain is reported.

What else is said of bodies that touch is in `corpus/attacks/contacts.toml`.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from asked import found, in_pieces
from conftest import some
from contact_scenes import BOX, FLOOR, bare
from test_contact_overlaps import BOUNCES, HEAVY, run

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
