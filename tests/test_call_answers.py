"""Validation: results that depend on the clock or on chance are reported, as bare PyBullet shows.

What else calls and files mean is in `corpus/attacks/calls.toml`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from asked import found as ask
from conftest import some
from contact_scenes import bare
from drop_physics.analysis.story import Story
from drop_physics.rules.answer import Finding
from scenes import ORIGIN, record, site

FLOOR = "p.setGravity(0, 0, -9.81); p.loadURDF('plane.urdf')\n"
AIR = "p.setGravity(0, 0, -9.81)\n"
PATH = "p.setAdditionalSearchPath(pybullet_data.getDataPath())\n"
CUBE = "c = p.loadURDF('cube_small.urdf', [0, 0, 1])\n"


def one(scene: str, path: Path, code: str) -> Finding:
    """Return the only finding of a code."""
    (finding,) = ask(scene, path, code)
    return finding


def test_real_time_is_blamed_on_the_call_that_turns_it_on(tmp_path: Path) -> None:
    scene = FLOOR + CUBE + "p.setRealTimeSimulation(0)\np.setRealTimeSimulation({})\nsteps(3)"
    seen = record(scene.format("1"), tmp_path / "x.rrd").seen
    for on in ("1", "True", "enableRealTimeSimulation=1"):
        seen = record(scene.format(on), tmp_path / "x.rrd").seen
        story = Story(replace(seen, real_time=True), ORIGIN)
        for explained in story.explanation.pieces():
            story.see(explained)
        (found,) = (finding for finding in story.findings() if finding.code == "real-time")
        assert found.site == site(4)
    off = record(scene.format(0), tmp_path / "x.rrd").seen
    story = Story(replace(off, real_time=True), ORIGIN)
    for explained in story.explanation.pieces():
        story.see(explained)
    assert "real-time" not in [finding.code for finding in story.findings()]


WINDOW = "import time\np.disconnect(); p.connect(p.GUI)\n"
RUNS_BY_ITSELF = {
    "a cube falls": (AIR + "b = p.loadURDF('cube_small.urdf', [0, 0, 1])\n", 0.25),
    "an arm swings": (
        AIR + "b = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)\n"
        "p.setJointMotorControl2(b, 1, p.POSITION_CONTROL, 0.5, force=200)\n", 0.05,
    ),
    "a ball rolls": (
        FLOOR + "b = p.loadURDF('sphere_small.urdf', [0, 0, 0.03])\np.setTimeStep(0.01)\n"
        "p.resetBaseVelocity(b, [1, 0, 0])\n", 0.4,
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", some(RUNS_BY_ITSELF, 1))
def test_with_a_window_the_clock_makes_the_steps(what: str, tmp_path: Path) -> None:
    bodies, wait_s = RUNS_BY_ITSELF[what]
    scene = WINDOW + PATH + bodies + "p.setRealTimeSimulation(1)\ntime.sleep({})\n"
    short, long = (
        record(scene.format(s), tmp_path / f"{s}.rrd").seen.sampled.last
        for s in (wait_s, 2 * wait_s)
    )
    assert long > 1.8 * short > 1.8
    assert one(scene.format(wait_s), tmp_path, "real-time").level == "repeat"
    stepped = scene.replace("Simulation(1)", "Simulation(0)") + "steps(9)\n"
    assert not ask(stepped.format(wait_s), tmp_path, "real-time")
    # Without a window nothing runs by itself.
    alone = bodies + "import time\np.setRealTimeSimulation(1)\ntime.sleep(0.01)\n"
    assert bare(alone)["where"] == bare(bodies)["where"]
    assert not ask(alone + "steps(9)\n", tmp_path, "real-time")


DRAWS = {
    "random": (
        "import random\n{seed}b = p.loadURDF('cube_small.urdf', [0, 0, random.uniform(1, 2)])\n"
        "steps(20)\n", "random.seed(3)\n", "random.uniform", 3,
    ),
    "numpy": (
        "import numpy as np\n{seed}b = p.loadURDF('racecar/racecar.urdf')\nfor i in range(30):\n"
        "    p.applyExternalForce(b, -1, [*np.random.randn(3)], [0, 0, 0], p.LINK_FRAME)\n"
        "    p.stepSimulation()\n", "np.random.seed(0)\n", "numpy.random.randn", 5,
    ),
    "a generator": (
        "import numpy as np\ndraw = np.random.default_rng({seed})\n"
        "b = p.loadURDF('sphere2.urdf', [0, 0, 1])\n"
        "p.resetBaseVelocity(b, [draw.normal(), 0, 0])\nsteps(20)\n", "7",
        "numpy.random.SeedSequence", 3,
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", DRAWS)
def test_unseeded_numbers_make_runs_differ(what: str, tmp_path: Path) -> None:
    scene, seed, called, line = DRAWS[what]
    unseeded, seeded = AIR + scene.format(seed=""), AIR + scene.format(seed=seed)
    found = one(unseeded, tmp_path, "unseeded")
    assert f"are drawn by {called} at" in found.message
    assert found.site == site(line)
    assert not np.array_equal(*(bare(unseeded)["where"] for _ in range(2)))
    assert np.array_equal(*(bare(seeded)["where"] for _ in range(2)))
    assert not ask(seeded, tmp_path, "unseeded")
