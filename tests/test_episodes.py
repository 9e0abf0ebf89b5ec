"""Episodes: where they begin and end, how they end, and what is reported about them.

Verification: against what the script itself counts and sums.
"""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import some
from drop_physics.account.episodes import EpisodeRow
from drop_physics.engines import whole_episodes
from drop_physics.engines.watching.environments import _unhealthy
from drop_physics.errors import ScenarioError
from drop_physics.recording.reader import read
from drop_physics.report.episodes import episode_lines
from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script
from drop_physics.stages.rerun.evaluated import BranchedTrial
from drop_physics.stages.why import why
from drop_physics.trace.episodes import episodes_of

Told = Callable[..., tuple[list[EpisodeRow], Any]]

TIMESTEP_S = 0.01
ENVIRONMENT = f"""
import json, sys
import gymnasium, mujoco
XML = '''<mujoco><option timestep="{TIMESTEP_S}"/><worldbody><geom type="plane" size="5 5 1"/>
<body name="ball" pos="0 0 0.55"><freejoint/><geom size="0.05"/></body></worldbody></mujoco>'''
class Falling(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-9, 9, (7,))
    action_space = gymnasium.spaces.Discrete(2)
    def __init__(self, low=0.3):
        self.low = low
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        return self.data.qpos.astype("f"), {{}}
    def step(self, action):
        mujoco.mj_step(self.model, self.data, 5)
        z = float(self.data.qpos[2])
        fell = z < self.low
        return self.data.qpos.astype("f"), z, fell, False, {{"fell": fell}}
said = []
"""
END = "print(json.dumps(said))"


@pytest.fixture
def told(tmp_path: Path) -> Told:
    """Return a function that records a script; it returns the episodes and the printed JSON."""

    def rows(script: str, **how: Any) -> tuple[list[EpisodeRow], Any]:
        file, printed = tmp_path / "script.py", tmp_path / "printed.txt"
        file.write_text(script)
        with printed.open("wb") as out:
            recorded = record_script(
                str(file), out=tmp_path / "run.rrd", force=True, stdout=out.fileno()
            )
        text = printed.read_text()
        found = analyze(recorded.recording, **how).episodes
        return [*found], json.loads(text) if text else None

    return rows


ROLLED = """
env = gymnasium.wrappers.TimeLimit(Falling(), 100)
for low, most in ((0.3, 100), (0.5, 100), (-1.0, 100), (-1.0, 7)):
    env.unwrapped.low = low
    env.reset()
    length, total = 0, 0.0
    for _ in range(most):
        *_, reward, terminated, truncated, _ = env.step(0)
        length, total = length + 1, total + reward
        if terminated or truncated:
            break
    said.append([length, total])
"""


def test_an_environment_tells_how_each_episode_ended(told: Told) -> None:
    rows, said = told(ENVIRONMENT + ROLLED + END)
    assert [row.ended for row in rows] == ["terminated", "terminated", "truncated", "run"]
    assert [[row.length, row.reward] for row in rows] == said
    assert [row.last_step - row.first_step for row in rows] == [5 * length for length, _ in said]
    assert [row.first_step for row in rows] == [0, *(row.last_step for row in rows[:-1])]
    assert [row.end_s for row in rows] == pytest.approx([TIMESTEP_S * r.last_step for r in rows])
    assert [row.why for row in rows] == ["fell", "fell", None, None]
    assert [row.failed for row in rows] == [True, True, False, False]
    assert [row.first_contact for row in rows[:2]] == [None, None]
    last = rows[3].first_contact  # it has fallen by 0.5 m
    assert last is not None
    assert last.time_s - rows[3].start_s == pytest.approx((2 * 0.5 / 9.81) ** 0.5, abs=0.02)
    assert sorted(last.links) == ["ball", "world"]


@pytest.mark.parametrize("most", [3, 60])
def test_steps_after_the_end_of_an_episode_are_told(told: Told, tmp_path: Path, most: int) -> None:
    """An environment that is stepped on after its end, without a reset."""
    on = f"""
env = Falling()
env.reset()
for _ in range({most}):
    env.step(0)
said.append([0, 0])
"""
    rows, _ = told(ENVIRONMENT + on + END)
    samples = analyze(tmp_path / "run.rrd").samples
    (section,) = episode_lines(rows, 1, samples, verbose=False)
    after = samples - 1 - rows[0].last_step
    assert (after > 0) == (rows[0].ended == "terminated") == (most == 60)
    assert (f"{after} steps follow without a reset" in str(section)) == (after > 0)


@pytest.mark.parametrize(
    ("z", "said"),
    [
        (0.5, ["z 0.5 < 0.7"]),
        (0.69996, ["z 0.69996 < 0.7"]),
        (0.7, ["z 0.7 <= 0.7"]),
        (1.5, ["z 1.5 > 1"]),
        (float("nan"), ["z nan < 0.7"]),
        (0.8, []),
    ],
)
def test_a_quantity_is_told_in_digits_that_are_beyond_its_range(z: float, said: list[str]) -> None:
    model, data = SimpleNamespace(jnt_type=[0]), SimpleNamespace(qpos=[0, 0, z], qvel=[])
    environment = SimpleNamespace(model=model, data=data, _healthy_z_range=(0.7, 1.0))
    assert _unhealthy(environment) == said


def test_a_reset_before_the_end_ends_an_episode(told: Told) -> None:
    script = (
        "env = Falling()\nfor n in (3, 4):\n    env.reset()\n    [env.step(0) for _ in range(n)]"
    )
    rows, _ = told(ENVIRONMENT + script)
    assert [(row.ended, row.length) for row in rows] == [("reset", 3), ("run", 4)]


def test_environments_that_step_in_turn_have_episodes_of_their_own(told: Told) -> None:
    script = """
many = gymnasium.vector.SyncVectorEnv([lambda: Falling(0.3), lambda: Falling(0.5)])
many.reset()
for _ in range(12):
    many.step([0, 0])
"""
    rows, _ = told(ENVIRONMENT + script)
    alone, _ = told(ENVIRONMENT + ROLLED)
    first = {row.client: row for row in reversed(rows)}
    assert len(first) == 2
    assert sorted(row.length or 0 for row in first.values()) == sorted(
        row.length or 0 for row in alone[:2]
    )
    ended = [row for row in rows if row.ended == "terminated"]
    assert {(row.client, row.length) for row in ended} == {
        (r.client, r.length) for r in first.values()
    }


def test_a_wrapper_that_resets_within_a_step_begins_the_next_episode(told: Told) -> None:
    script = """
env = gymnasium.wrappers.Autoreset(Falling())
env.reset()
for _ in range(15):
    env.step(0)
"""
    rows, _ = told(ENVIRONMENT + script)
    alone, _ = told(ENVIRONMENT + ROLLED)
    assert [row.ended for row in rows] == ["terminated", "terminated", "run"]
    assert [row.length for row in rows[:2]] == [alone[0].length] * 2


def test_an_environment_is_pickled_without_us(told: Told) -> None:
    script = """
import cloudpickle, inspect
env = Falling()
env.reset()
env.step(0)
said = [len(cloudpickle.dumps(Falling)) > 0, str(inspect.signature(env.reset))]
"""
    _, said = told(ENVIRONMENT + script + END)
    assert said == [True, "(seed=None, options=None)"]


LOOP = """
import mujoco
model = mujoco.MjModel.from_xml_string('''<mujoco><worldbody><body pos="0 0 1"><freejoint/>
<geom size="0.05"/></body></worldbody></mujoco>''')
data = mujoco.MjData(model)
for step in range(60):
    {before}
    mujoco.mj_step(model, data)
"""


@pytest.mark.parametrize(
    ("before", "lasts"),
    some(
        [
            ("if step in (20, 50): mujoco.mj_resetData(model, data)", [20, 50, 60]),
            ("if step == 20: data.qpos[:3] = 0, 0, 2", [20, 60]),
            ("if step == 20: data.qvel[2] = 3", [60]),
            ("data.qpos[:3] = 0, 0, 2", [60]),
            ("pass", [60]),
        ],
        2,
    ),
    ids=["reset", "state", "kick", "led", "none"],
)
def test_a_start_state_that_is_written_begins_an_episode(
    told: Told, before: str, lasts: list[int]
) -> None:
    rows, _ = told(LOOP.format(before=before))
    assert [row.last_step for row in rows] == lasts
    assert [row.ended for row in rows] == ["reset"] * (len(lasts) - 1) + ["run"]


POSE = "[0, 0, 2], [0, 0, 0, 1]"
BULLET = """
import pybullet as p
p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
def load():
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)
    return p.createMultiBody(1, shape, basePosition=[0, 0, 1])
ball = load()
state = p.saveState()
for step in range(60):
    {before}
    p.stepSimulation()
"""


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("before", "lasts"),
    [
        ("if step == 20: p.restoreState(state)", [20, 60]),
        ("if step == 20: p.resetSimulation(); ball = load()", [20, 60]),
        (
            "if step == 20: p.resetBasePositionAndOrientation(ball, [0, 0, 2], [0, 0, 0, 1])",
            [20, 60],
        ),
        ("if step == 20: p.resetBaseVelocity(ball, [0, 0, 2])", [60]),
    ],
    ids=["restored", "cleared", "placed", "kick"],
)
def test_a_reset_begins_an_episode(told: Told, before: str, lasts: list[int]) -> None:
    rows, _ = told(BULLET.format(before=before))
    assert [row.last_step for row in rows] == lasts


DOOR = """</body><body name="door" pos="1 0 1"><joint axis="0 0 1"/><geom size="0.1"/></body>"""


def test_a_reset_begins_an_episode_also_where_a_body_has_not_moved(told: Told) -> None:
    calls = LOOP.replace("</body>", DOOR).format(
        before="if step in (20, 50): mujoco.mj_resetData(model, data)"
    )
    assert [row.last_step for row in told(calls)[0]] == [20, 50, 60]
    writes = LOOP.replace("</body>", DOOR).format(before="if step == 20: data.qpos[:3] = 0, 0, 2")
    assert [row.last_step for row in told(writes)[0]] == [60]


def test_the_account_is_of_the_end_of_what_failed(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(ENVIRONMENT + ROLLED)
    recorded = record_script(str(file), out=tmp_path / "run.rrd")
    failed = analyze(recorded.recording)
    assert failed.episode == 2
    second = failed.episodes[1]
    (fell,) = [row for row in failed.account if row.kind == "moved"]
    assert fell.step is not None
    assert second.first_step < fell.step <= second.last_step
    third = analyze(recorded.recording, episode=3)
    assert third.episode == 3
    begins = third.episodes[2].last_step - round(2 / TIMESTEP_S)
    assert all(row.step is None or row.step > begins for row in third.account)
    assert not [row for row in third.account if row.kind == "moved"]  # by then it lies
    (touch,) = third.bodies[-1].touches
    weight_n = third.bodies[-1].mass_kg * 9.81
    assert touch.impulse_n_s == pytest.approx((0, 0, weight_n * 2), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(
    ("episodes", "kept"),
    [("failing", [1, 2, 4]), ("2", [2]), (3, [3]), (None, [2, 4])],
)
def test_of_the_other_episodes_a_line_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, episodes: Any, kept: list[int]
) -> None:
    """The kept episode is bitwise equal, and each of its steps leads to the next one.

    None keeps all until there are too many; the last one has not ended, and may have failed.
    """
    file, rolled = tmp_path / "script.py", ROLLED.replace("env.reset()", RESET)
    file.write_text(ENVIRONMENT + rolled)
    whole = record_script(str(file), out=tmp_path / "whole.rrd", episodes="all")
    monkeypatch.setattr(whole_episodes, "MANY_BYTES", 0 if episodes is None else 1 << 27)
    some = record_script(str(file), out=tmp_path / "some.rrd", episodes=episodes)
    for recorded in (whole, some):
        assert recorded.replay is not None
        assert recorded.replay.explained == recorded.replay.steps == recorded.samples - 1
    sides = [read(each.recording).seen for each in (whole, some)]
    rows, its = map(episodes_of, sides)
    assert [each.number for each in its if each.kept] == kept
    assert [each.told and (each.told.length, each.told.how, each.told.reward) for each in its] == [
        each.told and (each.told.length, each.told.how, each.told.reward) for each in rows
    ]
    for number in kept:
        states = [
            seen.sampled.piece(each.first + 1, each.last + 1).bases["position_m"]
            for seen, each in zip(sides, (rows[number - 1], its[number - 1]), strict=True)
        ]
        assert len(states[0])
        assert np.array_equal(*states)


RESET = "env.reset(); env.unwrapped.data.xfrc_applied[1, 0] = 0.3"
"""A reset and a force that is the same in all episodes, so that it is sent for the first only."""


def test_an_episode_without_steps_is_not_looked_at(tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(ENVIRONMENT + ROLLED)
    recorded = record_script(str(file), out=tmp_path / "run.rrd", episodes=1)
    assert analyze(recorded.recording).episode == 1
    with pytest.raises(ScenarioError, match="drop record --episodes 2"):
        analyze(recorded.recording, episode=2)
    with pytest.raises(ScenarioError, match="failing, all, or the number"):
        record_script(str(file), out=tmp_path / "run.rrd", force=True, episodes="0")


def test_without_an_environment_every_step_is_recorded_and_that_is_said(tmp_path: Path) -> None:
    file, notes = tmp_path / "script.py", list[str]()
    file.write_text(LOOP.format(before="pass"))
    recorded = record_script(
        str(file), out=tmp_path / "run.rrd", episodes="failing", note=notes.append
    )
    assert recorded.samples == 61
    assert [each for each in notes if "every step is recorded" in each]


WATCHED = """
import drop_physics
from drop_physics.stages.analyze import analyze
"""


def test_watching_an_environment_records_its_episodes(tmp_path: Path) -> None:
    ran = _python(
        ENVIRONMENT
        + WATCHED
        + f"""
env = drop_physics.watch(Falling(), {str(tmp_path / "one.rrd")!r})
assert env.recorded is None
for _ in range(2):
    env.reset()
    while not env.step(0)[2]: pass
env.close()
env.recorded.recording
many = drop_physics.watch(
    gymnasium.vector.SyncVectorEnv([Falling] * 2), {str(tmp_path / "many.rrd")!r}
)
many.reset()
for _ in range(9): many.step([0, 0])
many.close()
bare = Falling()
said = [drop_physics.watch(bare) is bare, env.recorded.samples, many.recorded.samples]
"""
        + END
    )
    alone = [*analyze(tmp_path / "one.rrd").episodes]
    assert [row.ended for row in alone] == ["terminated", "terminated"]
    many = [*analyze(tmp_path / "many.rrd").episodes]
    assert {row.client for row in many} == {0, 1}
    # A sample before the first step of each simulation, and one after each.
    assert ran == [True, alone[-1].last_step + 1, sum(_last(many, k) + 1 for k in (0, 1))]


def _last(rows: list[EpisodeRow], client: int) -> int:
    return max(row.last_step for row in rows if row.client == client)


@pytest.mark.long
def test_each_worker_that_steps_apart_has_a_recording(tmp_path: Path) -> None:
    out = str(tmp_path / "run.rrd")
    said = _python(
        "import warnings; warnings.simplefilter('error')\n"
        + ENVIRONMENT
        + WATCHED
        + f"""
make = lambda: drop_physics.watch(Falling(), {out!r})
many = gymnasium.vector.AsyncVectorEnv([make] * 2, shared_memory=False)
many.reset()
for _ in range(9): many.step([0, 0])
many.close()
try:
    drop_physics.watch(gymnasium.vector.AsyncVectorEnv([Falling]), {out!r})
except drop_physics.DropError as error:
    said = str(error)
"""
        + END
    )
    assert "must be in the workers" in said
    assert sorted(each.name for each in tmp_path.iterdir()) == ["run-0.rrd", "run-1.rrd"]
    for worker in (0, 1):
        rows = analyze(tmp_path / f"run-{worker}.rrd").episodes
        assert rows[0].ended == "terminated"


def _python(script: str) -> Any:
    """Run a script without `drop record`; return the last line that it printed, parsed as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert not done.returncode, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.pybullet
@pytest.mark.parametrize(("resets", "said"), [(1, "; in episode 2"), (3, "; so in 3 episodes")])
def test_a_finding_of_a_reset_names_its_episode(tmp_path: Path, resets: int, said: str) -> None:
    example = Path(__file__).parents[1] / "docs/examples/why/reset_leaves.py"
    begins, _, again = example.read_text().rpartition("for joint, angle in enumerate(home)")
    script = tmp_path / "script.py"
    again = textwrap.indent("for joint, angle in enumerate(home)" + again, "    ")
    script.write_text(f"{begins}for _ in range({resets}):\n{again}")
    recorded = record_script(str(script), out=tmp_path / "run.rrd")
    analysis = analyze(recorded.recording)
    assert len(analysis.episodes) == resets + 1
    (found,) = [each for each in analysis.findings if each.code == "reset-leaves"]
    assert found.told.endswith(said)
    assert found.episodes == resets


BEGINS_INSIDE = """
for episode in range(20):
    {before}
    for _ in range(60):
        {step}
"""


@pytest.mark.parametrize(
    ("begins", "before", "step"),
    [
        (
            LOOP.partition("for step")[0].replace(
                "<worldbody>", '<worldbody><geom type="plane" size="5 5 1"/>'
            ),
            "mujoco.mj_resetData(model, data); data.qpos[2] = 0.02",
            "mujoco.mj_step(model, data)",
        ),
        pytest.param(
            BULLET.partition("state =")[0].replace(
                "ball =", "p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))\nball ="
            ),
            "p.resetBasePositionAndOrientation(ball, [0, 0, 0.05], [0, 0, 0, 1])",
            "p.stepSimulation()",
            marks=pytest.mark.pybullet,
        ),
    ],
    ids=["MuJoCo", "PyBullet"],
)
def test_what_happens_in_twenty_episodes_is_one_finding_with_a_count(
    tmp_path: Path, begins: str, before: str, step: str
) -> None:
    script = tmp_path / "script.py"
    script.write_text(begins + BEGINS_INSIDE.format(before=before, step=step))
    analysis = analyze(record_script(str(script), out=tmp_path / "run.rrd").recording)
    assert len(analysis.episodes) == 20
    (found,) = [each for each in analysis.findings if each.code == "starts-in-contact"]
    assert found.episodes == 20
    assert found.told.endswith("; so in 20 episodes")


@pytest.mark.parametrize("text", some(["not terminated", "length > 6"], 1))
def test_an_episode_that_would_go_on_for_ever_is_what_was_expected(
    tmp_path: Path, text: str
) -> None:
    """Without gravity the ball never falls, which meets the expectation; the trial has an end."""
    script = tmp_path / "script.py"
    script.write_text(f"""{ENVIRONMENT}
env = Falling()
env.reset()
while not env.step(0)[2]:
    pass
""")
    found = why(
        str(script), expect=text, tries=("option.gravity =0",), out=tmp_path / "why"
    ).expected
    assert found is not None
    assert not found.base.holds
    assert [each.tried.change.change for each in found.makes_true] == ["option.gravity"]


@pytest.mark.long
def test_a_change_is_tried_from_a_second_before_a_failure_on(tmp_path: Path) -> None:
    """A ball is pressed into the ground after 5.5 s; only a change in that last second matters."""
    script = tmp_path / "script.py"
    script.write_text(f"""{ENVIRONMENT}
env = Falling(0.04)
env.reset()
env.data.qpos[2] = 0.05
for k in range(200):
    env.data.xfrc_applied[1, 2] = -2000.0 * (k >= 110)
    if env.step(0)[2]:
        break
""")
    found = why(
        str(script),
        expect="not terminated",
        tries=("input.xfrc_applied =0",),
        out=tmp_path / "why",
    ).expected
    assert found is not None
    (last,) = [row.last_step for row in _rows(script, tmp_path / "run.rrd")]
    assert [*found.latest] == [last - round(1 / TIMESTEP_S)]
    assert last - round(1 / TIMESTEP_S) > 3 * last // 4


POLE = {
    "MuJoCo": """
import gymnasium, mujoco
XML = '''<mujoco><option timestep="0.01"/><worldbody>
<body name="pole"><joint name="hinge" axis="0 1 0"/>
<geom size="0.05" pos="0 0 0.5" mass="1" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor joint="hinge" ctrlrange="-0.5 0.5"/></actuator></mujoco>'''
class Pole(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-9, 9, (1,))
    def reset(self, seed=None, options=None):
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[0] = 0.105
        return self.seen(), {}
    def seen(self):
        return float(self.data.qpos[0]), float(self.data.qvel[0])
    def step(self, action):
        self.data.ctrl[0] = action
        mujoco.mj_step(self.model, self.data)
        angle, rate = self.seen()
        return (angle, rate), 1.0, abs(angle) > 1.2, False, {}
""",
    "PyBullet": """
import gymnasium, pybullet as p
class Pole(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-9, 9, (1,))
    def reset(self, seed=None, options=None):
        p.connect(p.DIRECT)
        p.setTimeStep(0.01)
        p.setGravity(0, 0, -9.81)
        self.pole = p.createMultiBody(
            0, basePosition=[0, 0, 1], linkMasses=[1], linkCollisionShapeIndices=[-1],
            linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
            linkInertialFramePositions=[[0, 0, 0.5]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
            linkParentIndices=[0], linkJointTypes=[p.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]])
        p.setJointMotorControl2(self.pole, 0, p.VELOCITY_CONTROL, force=0)
        p.resetJointState(self.pole, 0, 0.105)
        return self.seen(), {}
    def seen(self):
        return p.getJointState(self.pole, 0)[:2]
    def step(self, action):
        p.setJointMotorControl2(self.pole, 0, p.TORQUE_CONTROL, force=action)
        p.stepSimulation()
        angle, rate = self.seen()
        return (angle, rate), 1.0, abs(angle) > 1.2, False, {}
""",
}
"""A pole that a weak motor cannot hold up: of 4.9 N m at the horizontal it has 0.5."""
CONTROLLED = """
env = Pole()
(angle, rate), _ = env.reset()
done = False
while not done:
    push = min(max(-10 * angle - rate, -0.5), 0.5)
    (angle, rate), _, done, *_ = env.step(push)
"""


ARRAY = "setJointMotorControlArray(self.pole, [0], p.TORQUE_CONTROL, forces=[action])"
POLE["PyBullet, several joints in a call"] = POLE["PyBullet"].replace(
    "setJointMotorControl2(self.pole, 0, p.TORQUE_CONTROL, force=action)", ARRAY
)
PLAYED = [
    ("MuJoCo", "actuator_gear *10", False, True),
    ("MuJoCo", "actuator_gear *1.2", True, False),
    ("PyBullet", "setJointMotorControl2.force *10", False, True),
    ("PyBullet", "setGravity.gravZ =0", True, True),
    ("PyBullet", "setJointMotorControl2.force *1.2", True, False),
    ("PyBullet, several joints in a call", "setJointMotorControlArray.forces *10", False, True),
    ("PyBullet, several joints in a call", "setJointMotorControlArray.forces *1.2", True, False),
]


@pytest.mark.parametrize(
    ("engine", "change", "repeated", "answered"),
    [
        pytest.param(
            *each,
            marks=[pytest.mark.pybullet] * each[0].startswith("PyBullet")
            + [pytest.mark.long] * (n not in (0, 2)),
        )
        for n, each in enumerate(PLAYED)
    ],
)
def test_a_change_is_tried_with_the_recorded_commands_too(
    tmp_path: Path, engine: str, change: str, *, repeated: bool, answered: bool
) -> None:
    """A motor ten times as strong holds the pole up, but only if the controller notices.

    The recorded torque is -0.5 N m in the last second, the inertia 0.25 kg m²: ten times that
    throws the pole over to the other side, by -10 rad. 0.6 N m balance it near 0.12 rad, where it
    is a second before: it stays up for that second, but not for ever. Without gravity 0.5 N m turn
    it by -1 rad.
    """
    script = tmp_path / "script.py"
    script.write_text(POLE[engine] + CONTROLLED)
    made = why(str(script), expect="not terminated", tries=(change,), out=tmp_path / "why")
    found = made.expected
    assert found is not None
    assert [*found.branched] == [BranchedTrial(open_loop=repeated, closed_loop=answered)]
    (row,) = _rows(script, tmp_path / "run.rrd")
    assert found.second_before == row.last_step - 100
    (told,) = made.as_json()["makes_true"]
    loops = {"open_loop": repeated, "closed_loop": answered}
    assert told["second_before"] == {"from_step": found.second_before, **loops}
    yes, no = ("yes" if holds else "no" for holds in (repeated, answered))
    said = f"a second before the failure: open loop {yes}, closed loop {no}"
    assert said in " ".join(str(made).split())


@pytest.mark.long
def test_without_the_recorded_motion_no_open_loop_is_told(tmp_path: Path) -> None:
    """A controller with noise of its own does not repeat what was recorded."""
    script = tmp_path / "script.py"
    noise = "push *= 1 - 0.1 * os.urandom(1)[0] / 255"
    controlled = CONTROLLED.replace(
        "    (angle, rate), _, done", f"    {noise}\n    (angle, rate), _, done"
    )
    script.write_text("import os" + POLE["MuJoCo"] + controlled)
    found = why(
        str(script),
        expect="not terminated",
        tries=("option.gravity =0",),
        out=tmp_path / "why",
    ).expected
    assert found is not None
    assert [*found.branched] == [BranchedTrial(open_loop=None, closed_loop=True)]


@pytest.mark.parametrize("text", some(["terminated", "length < 1e3", "reward < 1e3"], 1))
def test_an_expectation_names_the_end_of_episodes(tmp_path: Path, text: str) -> None:
    script = tmp_path / "script.py"
    own = "\nterminated, length, reward = False, 1e6, 1e6\nenv.unwrapped.close()"
    script.write_text(ENVIRONMENT + ROLLED + own)
    (row, *_) = rows = _rows(script, tmp_path / "run.rrd")
    found = why(str(script), expect=text, out=tmp_path).expected
    assert found is not None
    ended = [each for each in rows if each.ended != "run"]
    known = {
        "terminated": 1.0,
        "length": min(each.length or 0 for each in ended),
        "reward": sum(each.reward or 0.0 for each in ended) / len(ended),
    }
    assert found.base.holds
    assert found.base.value == pytest.approx(known[text.partition(" ")[0]])
    assert row.ended == "terminated"


def _rows(script: Path, out: Path) -> list[EpisodeRow]:
    return [*analyze(record_script(str(script), out=out).recording).episodes]
