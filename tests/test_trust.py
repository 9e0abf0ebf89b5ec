"""Trust in a script's result: runs with variations, compared with exact results."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from conftest import Drop
from drop_physics import analyze
from drop_physics.errors import OutputError, ScenarioError
from drop_physics.experiments import run_distance as comparing
from drop_physics.recording.reader import read
from drop_physics.stages.rerun.asked import cures_of
from drop_physics.stages.trust import Trust, lengths_of, trust
from drop_physics.trace.tables import table_of

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
    """Return the trust analysis of a script's result."""
    script = folder / "script.py"
    script.write_text(HEAD + text)
    return trust(str(script), out=folder / "out", jobs=1, **how)  # type: ignore[arg-type]


def ends(found: Trust) -> dict[str, dict[str, float]]:
    """Return the final distance of each variation, by unit."""
    return {one.name: {each.unit: each.value for each in one.apart.end} for one in found.variations}


@pytest.mark.long
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
    assert [variation.term for variation in found.variations] == ["integrator"] * 2 + [None] * 3
    assert found.variations[0].apart.from_s == dt
    (stands,) = found.standing
    # It falls 0.45 m, of which 4.7 mm are a hundredth: one digit stands.
    assert (stands.end_digits, stands.end_by) == (1, "timestep/4")


@pytest.mark.long
def test_a_box_at_rest_depends_on_nothing(tmp_path: Path) -> None:
    scene = "p.loadURDF('plane.urdf')\nb = p.loadURDF('cube.urdf', [0, 0, 0.5])\nsteps(120)\n"
    for name, apart in ends(trusted(tmp_path, scene)).items():
        # It settles by micrometres, and tilts by microradians: the solver stops early.
        assert apart["m"] < 1e-4, name
        assert apart["rad"] < 1e-5, name


@pytest.mark.long
def test_a_seed_is_varied_where_a_script_draws(tmp_path: Path) -> None:
    scene = "import random\nb = p.loadURDF('cube.urdf', [0, 0, random.random()])\nsteps(3)\n"
    apart = ends(trusted(tmp_path, scene))
    assert apart["seed"]["m"] > 1e-3
    assert apart["residual 0"]["m"] == 0


@pytest.mark.long
def test_other_variations_are_chosen_by_name(tmp_path: Path) -> None:
    scene = "b = p.loadURDF('cube.urdf', [0, 0, 9])\nsteps(24)\n"
    vary = ["gravity=10,5", "mass=2", "contactERP=0.1", "numSolverIterations=200", "timestep/8"]
    apart = ends(trusted(tmp_path, scene, vary=vary))
    assert [*apart] == [
        "gravity=10",
        "gravity=5",
        "mass=2",
        "contactERP=0.1",
        "numSolverIterations=200",
        "timestep/8",
    ]
    assert apart["gravity=5"]["m"] == pytest.approx(0.025, rel=0.1)
    assert apart["gravity=10"]["m"] == apart["contactERP=0.1"]["m"] == 0
    with pytest.raises(ScenarioError, match="timestep/2"):
        cures_of(["fixedTimeStep=0.002"], "--vary", whole=True)
    for wrong in ("gravity", "mass=", "timestep/1", "iterations*x", "noSuchParameter=1", "mass=-1"):
        with pytest.raises(ScenarioError, match="vary takes"):
            cures_of([wrong], "--vary", whole=True)


@pytest.mark.parametrize(
    ("text", "lengths"),
    [
        ("1mm", {"m": 1e-3}),
        ("0.01", {"m": 0.01}),
        ("2 µm,1 mrad", {"m": 2e-6, "rad": 1e-3}),
        ("180deg", {"rad": math.pi}),
        ("1/2 m", {"m": 0.5}),
        ("1 parsec", None),
        ("-1mm", None),
        ("1 m m", None),
        ("", None),
    ],
)
def test_lengths_have_units(text: str, lengths: dict[str, float] | None) -> None:
    if lengths is None:
        with pytest.raises(ScenarioError, match="within must be a length"):
            lengths_of(text)
    else:
        assert lengths_of(text) == pytest.approx(lengths)


JOINTS = """
n = len(starts)
b = p.createMultiBody(0, linkMasses=[1] * n, linkCollisionShapeIndices=[-1] * n,
    linkVisualShapeIndices=[-1] * n, linkPositions=[[0, 0, -(j > 0)] for j in range(n)],
    linkOrientations=[[0, 0, 0, 1]] * n, linkInertialFramePositions=[[0, 0, -1]] * n,
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * n, linkParentIndices=[*range(n)],
    linkJointTypes=[p.JOINT_REVOLUTE] * n, linkJointAxis=[[0, 1, 0]] * n)
p.changeDynamics(b, -1, linearDamping=0, angularDamping=0)
for j in range(n):
    p.changeDynamics(b, j, localInertiaDiagonal=[1e-3] * 3, jointDamping=0)
    p.setJointMotorControl2(b, j, p.VELOCITY_CONTROL, force=0)
    p.resetJointState(b, j, starts[j])
"""
"""A frictionless chain of 1 kg pendulums, 1 m each, released from given angles."""


@pytest.mark.long
def test_a_pendulum_converges_to_its_swing(tmp_path: Path) -> None:
    """The recursion u' = u - w² q dt, q' = q + u' dt is solved by a phase-shifted cosine."""
    start, t, dt = 0.01, 0.75, 1 / 240
    found = trusted(tmp_path, f"starts = [{start}]{JOINTS}steps(180)\n")
    w = math.sqrt(10 * 1 * 1 / (1e-3 + 1))

    def end(dt: float) -> float:
        phase = math.acos(1 - (w * dt) ** 2 / 2)
        steps = t / dt
        return start * (math.cos(steps * phase) - math.tan(phase / 2) * math.sin(steps * phase))

    apart = ends(found)
    for k in (2, 4):
        due = abs(end(dt / k) - end(dt))
        assert apart[f"timestep/{k}"]["rad"] == pytest.approx(due, rel=1e-3)  # sin q is not q
    assert apart["iterations*4"] == apart["residual 0"] == {"rad": 0}
    (angle,) = found.converging
    assert angle.order == pytest.approx(1, abs=0.05)
    swing = start * math.cos(w * t)
    assert angle.extrapolated is not None
    assert angle.uncertainty is not None
    assert abs(angle.extrapolated - swing) < angle.uncertainty < abs(end(dt) - swing)
    assert found.variations[0].term == "integrator"
    assert found.growth is None
    codes = [finding.code for finding in found.findings]
    assert codes == ["converges"]


@pytest.mark.long
def test_a_double_pendulum_grows_at_its_lyapunov_exponent(tmp_path: Path) -> None:
    """The reference is the exponent of the same recursion, written by hand (Benettin 1980)."""
    found = trusted(tmp_path, f"starts = [2.5, 1.0]{JOINTS}steps(3000)\n", vary=["nudge"])
    assert found.growth is not None
    assert found.growth.rate_per_s is not None
    assert found.growth.lost_s is not None
    inertia, g, dt = 1e-3, 10.0, 1 / 240

    def step(q: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c, s = math.cos(q[1]), math.sin(q[1])
        m = [[3 + 2 * c + 2 * inertia, 1 + c + inertia], [1 + c + inertia, 1 + inertia]]
        bias = np.array([-s * (2 * u[0] * u[1] + u[1] ** 2), s * u[0] ** 2])
        outer = math.sin(q[0] + q[1])
        weight = -g * np.array([2 * math.sin(q[0]) + outer, outer])
        u = u + dt * np.linalg.solve(m, weight - bias)
        return q + dt * u, u

    state = np.array([2.5, 1.0]), np.zeros(2)
    near, size, grown, logs = (state[0] + [1e-9, 0], state[1]), 1e-9, 0.0, []
    for _ in range(3000):
        state, near = step(*state), step(*near)
        logs.append(grown + math.log(abs(near[0] - state[0]).max() / size))
        off = [a - b for a, b in zip(near, state, strict=True)]
        by = size / np.hypot(np.linalg.norm(off[0]), np.linalg.norm(off[1]) / math.sqrt(g))
        grown -= math.log(by)
        near = state[0] + by * off[0], state[1] + by * off[1]
    times = np.arange(1, 3001) * dt
    within = (times >= found.growth.from_s) & (times <= found.growth.until_s)
    exponent = np.polyfit(times[within], np.array(logs)[within], 1)[0]
    assert found.growth.rate_per_s == pytest.approx(exponent, rel=0.15)
    # By hand the trajectory is the same: the last state is off by what rounding has grown to.
    (track, *_) = found.variations[0].apart.tracks
    assert track.last[0] == pytest.approx(state[0][0], abs=1e-6)
    (lost,) = [finding for finding in found.findings if finding.code == "one-of-many"]
    assert f"beyond {found.growth.lost_s:.3g} s" in lost.message


@pytest.mark.long
def test_a_ramp_that_holds_creeps_with_the_residual_threshold_only(tmp_path: Path) -> None:
    scene = """
import math
a = p.getQuaternionFromEuler([0, math.radians(20), 0])
g = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 1, 0.1]),
    baseOrientation=a)
b = p.createMultiBody(1, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3),
    basePosition=p.rotateVector(a, [0, 0, 0.2]), baseOrientation=a)
p.changeDynamics(g, -1, lateralFriction=1)
p.changeDynamics(b, -1, lateralFriction=0.5)  # tan 20 deg is 0.36
steps(480)
"""
    found = trusted(tmp_path, scene, vary=["iterations*4", "residual=0", "nudge"])
    way = {}
    for path in (found.recording, *(variation.recording for variation in found.variations)):
        x = table_of(read(path).seen.bases)["x_m"].to_numpy()
        way[path.stem] = abs(x[-1] - x[-240])
    assert way["base"] == way["iterations_4"] > 5e-6
    assert way["residual_0"] < 1e-9
    assert [variation.term for variation in found.variations] == [None, "contacts", None]
    apart = ends(found)
    assert apart["iterations*4"]["m"] == 0
    assert apart["nudge"]["m"] < 2e-9
    assert apart["residual 0"]["m"] > 1e-5


@pytest.mark.long
def test_an_arm_with_position_motors_gets_there_sooner_with_a_finer_step(tmp_path: Path) -> None:
    """A motor closes the fraction kp of the gap per step: (1 - kp)^n is left after n steps."""
    scene = """
a = p.loadURDF('kuka_iiwa/model.urdf', useFixedBase=True)
for j in range(7):
    p.changeDynamics(a, j, jointDamping=0)
    p.setJointMotorControl2(a, j, p.POSITION_CONTROL, 0.1, positionGain=0.02, velocityGain=1,
        force=1e6)
p.setPhysicsEngineParameter(solverResidualThreshold=0, numSolverIterations=500)
steps(60)
"""
    found = trusted(tmp_path, scene, vary=["timestep/2", "timestep/4"])
    for variation in found.variations:
        assert variation.term == "motors"
        k = int(variation.name[-1])
        (most,) = variation.apart.most
        gap = [0.1 * 0.98**n for n in range(61)], [0.1 * 0.98 ** (k * n) for n in range(61)]
        due = max(a - b for a, b in zip(*gap, strict=True))
        assert most.value == pytest.approx(due, rel=1e-3)
        assert "per step, not per second" in " ".join(str(found).split())
        tables = [line for line in str(found).splitlines() if "lbr_iiwa_joint_1  " in line]
        assert tables
        assert max(map(len, tables)) <= 80


@pytest.mark.long
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


@pytest.mark.long
def test_a_finer_run_is_analyzed_with_its_own_timestep(tmp_path: Path) -> None:
    """The motor's limit is force x timestep at the call, which already was the finer one."""
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
    assert [finding.code for finding in finer.findings].count("timestep-after-motor") == 0


@pytest.mark.long
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
    kept, gone = (tmp_path / f"out/{name}.rrd" for name in ("gravity=9", "gravity=8"))
    gone.unlink()
    written_at = kept.stat().st_mtime_ns
    again = trusted(tmp_path, scene, vary=vary)
    assert kept.stat().st_mtime_ns == written_at
    assert gone.exists()
    assert ends(again) == ends(first)
    # What is kept is cut off, or is another run's.
    whole = kept.read_bytes()
    for wrong in (whole[: len(whole) // 2], gone.read_bytes()):
        text = description.read_text().replace('"finished": true', '"finished": false')
        description.write_text(text)
        kept.write_bytes(wrong)
        with pytest.raises(OutputError, match="altered or replaced"):
            trusted(tmp_path, scene, vary=vary)
    assert ends(trusted(tmp_path, scene, vary=vary, force=True)) == ends(first)


@pytest.mark.long
def test_distances_are_written_as_a_table_and_plotted(tmp_path: Path) -> None:
    scene = "b = p.loadURDF('cube.urdf', [0, 0, 9])\nsteps(24)\n"
    plots = [tmp_path / f"{name}.svg" for name in ("light", "dark")]
    for plot in plots:
        found = trusted(
            tmp_path,
            scene,
            vary=["gravity=9", "timestep/2"],
            plot=plot,
            dark="dark" in plot.name,
            table=tmp_path / "t.csv",
            force=True,
        )
    table = pl.read_csv(tmp_path / "t.csv")
    assert table["variation"].to_list() == ["gravity=9"] * 2 + ["timestep/2"] * 2
    assert table["end"].to_list() == [
        track.end for variation in found.variations for track in variation.apart.tracks
    ]
    light, dark = (plot.read_text() for plot in plots)
    assert all(">gravity=9<" in text and ">1e-" in text for text in (light, dark))
    assert "#0d1117" in dark
    assert "#0d1117" not in light
    with pytest.raises(ScenarioError, match="plot must"):
        trusted(tmp_path, scene, plot=tmp_path / "x.gif")


@pytest.mark.long
def test_a_variation_that_fails_is_said_and_not_extrapolated(tmp_path: Path) -> None:
    scene = """
b = p.loadURDF('cube.urdf', [0, 0, 2])
steps(20)
assert abs(p.getBasePositionAndOrientation(b)[0][2] - 1.9635) < 1e-3, 'too far'
steps(5)
"""
    found = trusted(tmp_path, scene)
    assert [variation.made.ended for variation in found.variations].count("failed") == 1
    assert found.converging == []
    (failed,) = [finding for finding in found.findings if finding.level == "broken"]
    assert failed.message == "with timestep/4 the script fails: AssertionError: too far"
    assert not found.ends_within({"m": 1.0})
    loop = "b = p.loadURDF('cube.urdf', [0, 0, 2])\n" + (
        "while p.getBasePositionAndOrientation(b)[0][2] > 1.5: p.stepSimulation()\n"
    )
    found = trusted(tmp_path, loop, vary=["timestep/2", "gravity=20"], force=True)
    assert {"goes-on", "ends-earlier"} <= {finding.code for finding in found.findings}


@pytest.mark.long
def test_numbers_that_overflow_are_compared_until_then(tmp_path: Path) -> None:
    scene = """
b = p.loadURDF('cube.urdf', [0, 0, 2])
steps(9)
p.resetBaseVelocity(b, [1e300, 0, 0], [0, 0, 1e300])
steps(9)
"""
    found = trusted(tmp_path, scene, vary=["residual=0", "seed", "gravity=5"])
    assert [variation.name for variation in found.variations] == ["residual 0", "gravity=5"]
    assert found.variations[0].apart.same


@pytest.mark.long
def test_recordings_are_compared_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of seven steps give the result of the whole; a curve keeps a limited length."""
    scene = "p.loadURDF('plane.urdf')\n" + "".join(
        f"p.loadURDF('cube_small.urdf', [0, 0.01 * {n}, 0.2 + 0.1 * {n}])\n" for n in range(3)
    )
    found = trusted(tmp_path, scene + "steps(90)\n", vary=["timestep/2"])
    (varied,) = found.variations
    seen = [read(path).seen for path in (found.recording, varied.recording)]
    monkeypatch.setattr(comparing, "STEPS", 7)
    pieces = comparing.apart(*seen, finer=2)
    assert [vars(track) | {"start": 0, "last": 0, "theirs": 0} for track in pieces.tracks] == [
        vars(track) | {"start": 0, "last": 0, "theirs": 0} for track in varied.apart.tracks
    ]
    for unit, (times_s, off) in varied.apart.curves.items():
        assert np.array_equal(pieces.curves[unit], (times_s, off))
    monkeypatch.setattr(comparing, "MOST_POINTS", 8)
    times_s, off = comparing.apart(*seen, finer=2).curves["m"]
    assert len(times_s) <= 16
    assert times_s[-1] == pytest.approx(90 / 240)
    assert off.max() == varied.apart.curves["m"][1].max()
