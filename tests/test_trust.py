"""What of a script's result stands: runs with variations, against known truths."""

from __future__ import annotations

import json
import math
from pathlib import Path

import polars as pl
import pytest
from conftest import Drop
from drop_physics import analyze
from drop_physics.errors import OutputError, ScenarioError
from drop_physics.stages.trust import Trust, trust
from drop_physics.stages.variations import lengths_of, variations_of

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
    (height,) = found.converging
    assert height.axis == "z"
    assert height.order == pytest.approx(1, rel=1e-9)
    assert height.extrapolated == pytest.approx(1 - g * t * t / 2, rel=1e-12)
    assert [each.term for each in found.variations] == ["integrator"] * 2 + [None] * 3
    assert found.variations[0].apart.from_s == dt
    (stands,) = found.standing
    # It falls 0.45 m, of which 4.7 mm are a hundredth: one digit stands.
    assert (stands.end_digits, stands.end_by) == (1, "timestep/4")


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
    vary = ["gravity=10,5", "mass=2", "contactERP=0.1", "numSolverIterations=200", "timestep/8"]
    apart = ends(trusted(tmp_path, scene, vary=vary))
    assert [*apart] == [
        "gravity=10", "gravity=5", "mass=2", "contactERP=0.1", "numSolverIterations=200",
        "timestep/8",
    ]  # fmt: skip
    assert apart["gravity=5"]["m"] == pytest.approx(0.025, rel=0.1)
    assert apart["gravity=10"]["m"] == apart["contactERP=0.1"]["m"] == 0
    with pytest.raises(ScenarioError, match="timestep/2"):
        variations_of(["fixedTimeStep=0.002"])
    for wrong in ("gravity", "mass=", "timestep/1", "iterations*x", "noSuchParameter=1", "mass=-1"):
        with pytest.raises(ScenarioError, match="vary must be"):
            variations_of([wrong])


@pytest.mark.parametrize(
    ("text", "lengths"),
    [
        ("1mm", {"m": 1e-3}), ("0.01", {"m": 0.01}), ("2 µm,1 mrad", {"m": 2e-6, "rad": 1e-3}),
        ("180deg", {"rad": math.pi}), ("1/2 m", {"m": 0.5}), ("1 parsec", None), ("-1mm", None),
        ("1 m m", None), ("", None),
    ],
)  # fmt: skip
def test_lengths_have_units(text: str, lengths: dict[str, float] | None) -> None:
    if lengths is None:
        with pytest.raises(ScenarioError, match="within must be a length"):
            lengths_of(text)
    else:
        assert lengths_of(text) == pytest.approx(lengths)


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
    assert found.growth.rate_per_s is not None
    assert 0.5 < found.growth.rate_per_s < 8  # a few times sqrt(g / l) = 3.2 per second at most


def test_the_command_tells_what_stands_and_fails_where_a_variation_ends_too_far(
    tmp_path: Path, drop: Drop
) -> None:
    script = tmp_path / "script.py"
    script.write_text(f"{HEAD}b = p.loadURDF('cube.urdf', [0, 0, 9])\nprint(7)\nsteps(24)\n")
    call = ["trust", "--jobs", "1", "--vary", "gravity=9,10"]
    done = drop(*call, "--within", "10mm", "--json", "-o", tmp_path / "a", script)
    assert done.returncode == 0
    told = json.loads(done.stdout)
    assert [each["name"] for each in told["variations"]] == ["gravity=9", "gravity=10"]
    assert {*told["variations"][0]} >= {"name", "recording", "most", "end", "from_s"}
    again = drop(*call, "--within", "1mm", "--force", "-o", tmp_path / "a", script)
    assert again.returncode == 3
    assert "gravity=9" in again.stdout
    refused = drop(*call, "-o", tmp_path / "a", script)
    assert refused.returncode == 1
    assert "--force" in refused.stderr
    assert drop("trust", "--vary", "gravity", script).returncode == 2


def test_a_finer_run_is_analyzed_with_its_own_timestep(tmp_path: Path) -> None:
    """The limit of a motor is force x timestep at the call: that was already the finer one."""
    scene = """
p.setTimeStep(1 / 100)
a = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)
p.setPhysicsEngineParameter(numSolverIterations=100, fixedTimeStep=1 / 50)
for j in range(7):
    p.setJointMotorControl2(a, j, p.POSITION_CONTROL, 0.8, force=30)
steps(40)
"""
    found = trusted(tmp_path, scene, vary=["timestep/3"])
    own, finer = (analyze(each) for each in (found.recording, found.variations[0].recording))
    assert finer.explained.samples == finer.explained.of
    limits = [joint.force_limit for each in (own, finer) for joint in each.bodies[0].joints]
    assert limits == pytest.approx([30.0] * 14)
    assert [each.code for each in finer.findings].count("timestep-after-motor") == 0


def test_an_interrupted_call_is_resumed_and_damage_is_found(tmp_path: Path) -> None:
    scene = "b = p.loadURDF('cube.urdf', [0, 0, 9])\nsteps(9)\n"
    vary = ["gravity=9", "gravity=8"]
    first = trusted(tmp_path, scene, vary=vary)
    with pytest.raises(OutputError, match="already"):
        trusted(tmp_path, scene, vary=vary)
    with pytest.raises(OutputError, match="something else"):
        trusted(tmp_path, scene + "\n", vary=vary)
    # As if it had been killed in the second variation.
    description = tmp_path / "out/trust.json"
    description.write_text(description.read_text().replace('"finished": true', '"finished": false'))
    second = tmp_path / "out/gravity=8.json"
    second.unlink()
    kept, gone = (tmp_path / f"out/{name}.rrd" for name in ("gravity=9", "gravity=8"))
    gone.unlink()
    written_at = kept.stat().st_mtime_ns
    again = trusted(tmp_path, scene, vary=vary)
    assert kept.stat().st_mtime_ns == written_at
    assert gone.exists()
    assert ends(again) == ends(first)
    # One bit of what is kept has changed.
    description.write_text(description.read_text().replace('"finished": true', '"finished": false'))
    whole = bytearray(kept.read_bytes())
    whole[len(whole) // 2] ^= 1
    kept.write_bytes(whole)
    with pytest.raises(OutputError, match="altered or replaced"):
        trusted(tmp_path, scene, vary=vary)
    assert ends(trusted(tmp_path, scene, vary=vary, force=True)) == ends(first)


def test_distances_are_written_as_a_table_and_plotted(tmp_path: Path) -> None:
    scene = "b = p.loadURDF('cube.urdf', [0, 0, 9])\nsteps(24)\n"
    plots = [tmp_path / f"{name}.svg" for name in ("light", "dark")]
    for plot in plots:
        found = trusted(
            tmp_path, scene, vary=["gravity=9", "timestep/2"], plot=plot, dark="dark" in plot.name,
            table=tmp_path / "t.csv", force=True,
        )  # fmt: skip
    table = pl.read_csv(tmp_path / "t.csv")
    assert table["variation"].to_list() == ["gravity=9"] * 2 + ["timestep/2"] * 2
    assert table["end"].to_list() == [
        track.end for each in found.variations for track in each.apart.tracks
    ]
    light, dark = (plot.read_text() for plot in plots)
    assert all(">gravity=9<" in text and ">1e-" in text for text in (light, dark))
    assert "#0d1117" in dark
    assert "#0d1117" not in light
    with pytest.raises(ScenarioError, match="plot must"):
        trusted(tmp_path, scene, plot=tmp_path / "x.gif")
