"""Validation: what is said of creep, soft contact and what is not hit is true of bare PyBullet."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from contact_scenes import BOX, FLOOR, GRIP, SLOPE, TRAY, bare
from test_contact_answers import found, in_pieces

# -- creeps ---------------------------------------------------------------------------------------

SOLVED = "p.setPhysicsEngineParameter(solverResidualThreshold=0, numSolverIterations=500)\n"
LOOSE = "p.setPhysicsEngineParameter(solverResidualThreshold={threshold})\n"
CREEPS = {
    "slope": (SLOPE.format(degrees=20, mu=0.9, above=0, steps=1200), 1e-3),
    "steeper": (SLOPE.format(degrees=30, mu=0.9, above=0, steps=600), 1e-3),
    "flatter": (SLOPE.format(degrees=5, mu=0.5, above=0, steps=2400), 1e-3),
}


@pytest.mark.parametrize("name", CREEPS)
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
    [SLOPE.format(degrees=20, mu=0.9, above=0, steps=600), ROLLS + "steps(480)",
     SPINS + "steps(240)", TRAY.format(mu=0.8), GRIP.format(mass=0.3, off=0, mu=0.3, force=10),
     SLOPE.format(degrees=25, mu=0.3, above=0, steps=240)],
    ids=["slope", "rolls", "spins", "tray", "grip", "slides"],
)  # fmt: skip
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
