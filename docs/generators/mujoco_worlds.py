"""Record and analyze environments from other packages, and make their table of docs/validation.md.

    python docs/generators/mujoco_worlds.py --python PYTHON gymnasium dm_control
    python docs/generators/mujoco_worlds.py --python PYTHON robosuite --only Lift

PYTHON is an interpreter in which these packages are installed. Each environment runs twice in one
script, with zero actions and with random ones, each STEPS steps of MuJoCo and the rest of an
action; and again without drop, whose last states must be the same. Rows are kept in
`mujoco_worlds.jsonl`, what is there already is not run again, and `python docs/regenerate.py
validation.md` makes the table. Nothing is wrong with these worlds, so each finding of the level
`broken` or `asked` is printed, to be read: goal are none that are not so.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from drop_physics.stages.analyze import analyze
from drop_physics.stages.record import record_script

ROWS = Path(__file__).with_suffix(".jsonl")
STEPS = 250
"""Least number of MuJoCo steps with each kind of actions."""
GRAVE = "broken", "asked"
"""Severity levels that findings about a faultless world must not have."""

BEGIN = """
import hashlib, os, random, sys, warnings
os.environ["MUJOCO_GL"] = "disabled"
warnings.simplefilter("ignore")
import numpy as np
random.seed(0)
np.random.seed(0)
rng, ends = np.random.default_rng(0), hashlib.sha256()
def end(data):
    for values in (data.qpos, data.qvel, data.act, data.ctrl, np.array([data.time])):
        ends.update(np.ascontiguousarray(values).tobytes())
def actions(low, high, steps):
    low, high = np.maximum(low, -1e3), np.minimum(high, 1e3)
    for share in (0.0, 1.0):
        yield [share * rng.uniform(low, high) for _ in range(steps)]
"""
"""Code at the beginning of every suite's scripts."""
SUITES = {
    "gymnasium": """
import gymnasium
env = gymnasium.make("{name}")
world, space = env.unwrapped, env.action_space
for given in actions(space.low, space.high, -(-{steps} // world.frame_skip)):
    env.reset(seed=0)
    for action in given:
        if any(env.step(action.astype(np.float32))[2:4]):
            env.reset()
    end(world.data)
""",
    "gymnasium_robotics": """
import gymnasium, gymnasium_robotics
gymnasium.register_envs(gymnasium_robotics)
env = gymnasium.make("{name}")
world, space = env.unwrapped, env.action_space
for given in actions(space.low, space.high, 20):
    env.reset(seed=0)
    for action in given:
        if any(env.step(action.astype(np.float32))[2:4]):
            env.reset()
    end(getattr(world, "data", None) or world.point_env.data)
""",
    "dm_control": """
from dm_control import suite
env = suite.load(*"{name}".split("/"), task_kwargs={{"random": 0}})
spec = env.action_spec()
for given in actions(spec.minimum, spec.maximum, -(-{steps} // env._n_sub_steps)):
    env.reset()
    for action in given:
        env.step(action)
    end(env.physics.data.ptr)
""",
    "robosuite": """
import robosuite
robots = {{"robots": ["Panda"] * (2 if "{name}".startswith("TwoArm") else 1)}}
env = robosuite.make("{name}", **robots, has_renderer=False, has_offscreen_renderer=False,
                     use_camera_obs=False, hard_reset=False, seed=0)
for given in actions(*env.action_spec, round({steps} * env.model_timestep * env.control_freq)):
    env.reset()
    for action in given:
        env.step(action)
    end(env.sim.data._data)
""",
}
"""A script for each suite that runs one of its environments."""
LISTS = {
    "gymnasium": """
import gymnasium
names = {key.split("-v")[0] for key, each in gymnasium.registry.items()
         if "envs.mujoco" in str(each.entry_point)}
print(*(f"{name}-v5" for name in sorted(names)))
""",
    "gymnasium_robotics": """
print("FetchReach-v4 FetchPush-v4 FetchSlide-v4 FetchPickAndPlace-v4 HandReach-v3 "
      "HandManipulateBlock-v1 HandManipulateEgg-v1 HandManipulatePen-v1 AdroitHandDoor-v1 "
      "AdroitHandHammer-v1 AdroitHandPen-v1 AdroitHandRelocate-v1 FrankaKitchen-v1 "
      "PointMaze_UMaze-v3 AntMaze_UMaze-v5")
""",
    "dm_control": """
from dm_control import suite
print(*("/".join(each) for each in suite.ALL_TASKS))
""",
    "robosuite": """
import robosuite
print(*sorted(robosuite.ALL_ENVIRONMENTS))
""",
}
"""Code for each suite that prints the names of its environments as the last line."""


@dataclass(frozen=True)
class WorldRow:
    """The result for one environment."""

    suite: str
    name: str
    mujoco: str
    """The MuJoCo version that ran the steps."""
    date: str
    steps: int
    replayed: int
    """Number of steps whose replay reproduced the recorded state bit for bit."""
    explained: int
    """Number of replayed steps whose named impulses add up to the change of momentum."""
    remainder: float
    """The largest unexplained remainder, relative to the largest impulse."""
    bytes_per_step: float
    is_same: bool
    """Whether the final states are bitwise the same without drop."""
    grave: tuple[str, ...]
    """Findings of level `broken` or `asked`: their codes and sentences."""
    others: tuple[str, ...]
    """All other findings."""


def tried(suite: str, name: str, python: str) -> WorldRow:
    """Run an environment with and without drop, and return the result."""
    with tempfile.TemporaryDirectory() as folder:
        script, printed = Path(folder, "world.py"), Path(folder, "printed.txt")
        script.write_text(
            BEGIN + SUITES[suite].format(name=name, steps=STEPS) + "print(ends.hexdigest())\n"
        )
        bare = _last_line([python, str(script)])
        with printed.open("wb") as out:
            recorded = record_script(
                str(script), out=Path(folder, "run.rrd"), python=python, stdout=out.fileno()
            )
        if recorded.ended != "finished" or recorded.replay is None:
            raise RuntimeError(f"{suite} {name}: {recorded.ended}: {recorded.error}")
        analysis = analyze(recorded.recording)
        same = printed.read_text(encoding="utf-8").split()[-1] == bare
    again = recorded.replay
    said = [(each.level, f"{each.code}: {each.told} [{each.advice}]") for each in analysis.findings]
    return WorldRow(
        suite=suite,
        name=name,
        mujoco=str(next(iter(analysis.engine.values()))["engine"]).partition(" ")[2],
        date=datetime.datetime.now(datetime.UTC).date().isoformat(),
        steps=again.steps,
        replayed=again.replayed,
        explained=again.explained,
        remainder=again.remainder,
        bytes_per_step=recorded.bytes / again.steps,
        is_same=same,
        grave=tuple(text for level, text in said if level in GRAVE),
        others=tuple(text for level, text in said if level not in GRAVE),
    )


def _last_line(command: Sequence[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().rpartition("\n")[2])
    return done.stdout.split()[-1]


def known() -> list[WorldRow]:
    """Return the stored rows."""
    lines = ROWS.read_text(encoding="utf-8").splitlines() if ROWS.exists() else []
    return [WorldRow(**json.loads(line)) for line in lines]


def rows() -> str:
    """Return the stored results as a table, with a line per suite and version."""
    groups: dict[tuple[str, str], list[WorldRow]] = {}
    for row in known():
        groups.setdefault((row.suite, row.mujoco), []).append(row)
    lines = []
    for (suite, mujoco), its in groups.items():
        steps, replayed, explained = (
            sum(getattr(row, name) for row in its) for name in ("steps", "replayed", "explained")
        )
        cells = (
            suite,
            mujoco,
            max(row.date for row in its),
            f"{len(its)}",
            f"{sum(row.is_same for row in its)}",
            f"{steps:,}",
            f"{replayed:,}",
            f"{explained:,}",
            f"{max(row.remainder for row in its):.0e}",
            f"{sum(row.bytes_per_step * row.steps for row in its) / steps:,.0f}",
            f"{sum(len(row.grave) for row in its)}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Test environments, one after the other."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("suites", nargs="+", choices=[*SUITES])
    parser.add_argument("--python", required=True)
    parser.add_argument("--only", default="", help="names that contain this")
    parser.add_argument("--minutes", type=float, default=60.0, help="begin no other after that")
    parser.add_argument("--again", action="store_true", help="also those that are kept")
    given = parser.parse_args()
    os.environ["PYTHONHASHSEED"] = "0"  # one environment chooses among the members of a set
    until_s = time.monotonic() + given.minutes * 60
    for suite in given.suites:
        for name in _last_names(given.python, suite):
            there = {(row.suite, row.name) for row in known()}
            if given.only not in name or ((suite, name) in there and not given.again):
                continue
            if time.monotonic() > until_s:
                sys.exit("time is up: run it again to go on")
            try:
                row = tried(suite, name, given.python)
            except RuntimeError as error:
                print(f"{suite} {name} cannot be run: {error}", flush=True)
                continue
            print(suite, name, *row.grave, sep="\n    ", flush=True)
            kept = [row for row in known() if (row.suite, row.name) != (suite, name)]
            lines = [json.dumps(asdict(each), ensure_ascii=False) for each in (*kept, row)]
            ROWS.write_text("\n".join(sorted(lines)) + "\n", encoding="utf-8")


def _last_names(python: str, suite: str) -> list[str]:
    done = subprocess.run([python, "-c", LISTS[suite]], capture_output=True, text=True, check=True)
    return done.stdout.strip().rpartition("\n")[2].split()


if __name__ == "__main__":
    main()
