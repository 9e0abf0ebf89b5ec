"""What of a script's result stands: runs with variations, against known truths."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from conftest import Drop
from drop_physics.errors import ScenarioError
from drop_physics.stages.trust import Trust, trust, variations_of

HEAD = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -10)
def steps(number):
    for _ in range(number):
        p.stepSimulation()
"""


def trusted(folder: Path, text: str, **how: object) -> Trust:
    """Return what stands of a script's result."""
    script = folder / "script.py"
    script.write_text(HEAD + text)
    return trust(str(script), out=folder / "out", jobs=1, **how)  # type: ignore[arg-type]


def ends(found: Trust) -> dict[str, dict[str, float]]:
    """Return how far each variation ends apart, by unit."""
    return {one.name: {each.unit: each.value for each in one.apart.end} for one in found.variations}


def test_a_falling_box_converges_with_order_1(tmp_path: Path) -> None:
    found = trusted(
        tmp_path,
        "b = p.loadURDF('cube_small.urdf', [0, 0, 1])\n"
        "p.changeDynamics(b, -1, linearDamping=0)\nsteps(72)\n",
    )
    t, dt, g = 0.3, 1 / 240, 10
    # Semi-implicit Euler falls g t dt / 2 too far: half of that is left with half the timestep.
    apart = ends(found)
    assert apart["timestep/2"]["m"] == pytest.approx(g * t * dt / 4, rel=1e-12)
    assert apart["timestep/4"]["m"] == pytest.approx(g * t * dt * 3 / 8, rel=1e-12)
    assert apart["iterations*4"] == apart["residual 0"] == {"m": 0, "rad": 0}
    assert 0 < apart["nudge"]["m"] < math.sqrt(3) * 1e-9
    assert "seed" not in apart
    assert found.growth is None
    assert found.converging is not None
    assert found.converging.order == pytest.approx(1, rel=1e-9)
    assert found.converging.extrapolated == pytest.approx(1 - g * t * t / 2, rel=1e-12)
    assert found.variations[0].apart.from_s == dt


def test_a_box_at_rest_depends_on_nothing(tmp_path: Path) -> None:
    scene = "p.loadURDF('plane.urdf')\nb = p.loadURDF('cube.urdf', [0, 0, 0.5])\nsteps(120)\n"
    for name, apart in ends(trusted(tmp_path, scene)).items():
        # It settles by micrometres, and tilts by microradians: the solver stops early.
        assert apart["m"] < 1e-4, name
        assert apart["rad"] < 1e-5, name


def test_a_seed_is_varied_where_a_script_draws(tmp_path: Path) -> None:
    scene = "import random\nb = p.loadURDF('cube.urdf', [0, 0, random.random()])\nsteps(3)\n"
    apart = ends(trusted(tmp_path, scene))
    assert apart["seed"]["m"] > 1e-3
    assert apart["residual 0"]["m"] == 0


def test_other_variations_are_chosen_by_name(tmp_path: Path) -> None:
    scene = "b = p.loadURDF('cube.urdf', [0, 0, 9])\nsteps(24)\n"
    vary = {"gravity": [10, 5], "mass": [2], "contactERP": [0.1]}
    apart = ends(trusted(tmp_path, scene, vary=vary))
    assert [*apart] == ["gravity=10", "gravity=5", "mass=2", "contactERP=0.1"]
    assert apart["gravity=5"]["m"] == pytest.approx(0.025, rel=0.1)
    assert apart["gravity=10"]["m"] == apart["contactERP=0.1"]["m"] == 0
    with pytest.raises(ScenarioError, match="timestep/2"):
        variations_of({"fixedTimeStep": [1 / 480]})


def test_a_double_pendulum_grows_exponentially(tmp_path: Path) -> None:
    scene = """
b = p.createMultiBody(0, linkMasses=[1, 1], linkCollisionShapeIndices=[-1] * 2,
    linkVisualShapeIndices=[-1] * 2, linkPositions=[[0, 0, 0], [0, 0, -1]],
    linkOrientations=[[0, 0, 0, 1]] * 2, linkInertialFramePositions=[[0, 0, -1]] * 2,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2, linkParentIndices=[0, 1],
    linkJointTypes=[p.JOINT_REVOLUTE] * 2, linkJointAxis=[[0, 1, 0]] * 2)
p.changeDynamics(b, -1, linearDamping=0, angularDamping=0)
for j in range(2):
    p.changeDynamics(b, j, localInertiaDiagonal=[1e-3] * 3, jointDamping=0)
    p.setJointMotorControl2(b, j, p.VELOCITY_CONTROL, force=0)
    p.resetJointState(b, j, [2.5, 1.0][j])
steps(3000)
"""
    found = trusted(tmp_path, scene)
    assert found.growth is not None
    assert found.growth.lost_s is not None
    assert 0.5 < found.growth.rate_per_s < 8  # a few times sqrt(g / l) = 3.2 per second at most


def test_the_command_tells_what_stands_and_fails_where_a_variation_ends_too_far(
    tmp_path: Path, drop: Drop
) -> None:
    script = tmp_path / "script.py"
    script.write_text(f"{HEAD}b = p.loadURDF('cube.urdf', [0, 0, 9])\nprint(7)\nsteps(24)\n")
    call = ["trust", "--jobs", "1", "--vary", "gravity=9,10"]
    done = drop(*call, "--within", "0.01", "--json", "-o", tmp_path / "a", script)
    assert done.returncode == 0
    told = json.loads(done.stdout)
    assert [each["name"] for each in told["variations"]] == ["gravity=9", "gravity=10"]
    assert {*told["variations"][0]} >= {"name", "recording", "most", "end", "from_s"}
    again = drop(*call, "--within", "0.001", "--force", "-o", tmp_path / "a", script)
    assert again.returncode == 3
    assert "gravity=9" in again.stdout
    refused = drop(*call, "-o", tmp_path / "a", script)
    assert refused.returncode == 1
    assert "--force" in refused.stderr
    assert drop("trust", "--vary", "gravity", script).returncode == 2
