"""What an engineer waits for: the processor time to record a script, to analyze it, and both."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, ROOT, Measured, process

ARM = ROOT / "docs/examples/arm.py"
"""An arm simulated for 720 steps."""
HOP = """
import gymnasium as gym
env = gym.make("Humanoid-v5")
env.reset(seed=0)
env.action_space.seed(0)
for _ in range({steps}):
    _, _, terminated, truncated, _ = env.step(env.action_space.sample())
    if terminated or truncated:
        env.reset()
"""
"""A humanoid of Gymnasium, each of whose steps is five of MuJoCo; 600 steps are 27 episodes."""
GOALS_S = {
    ("record", "arm.py"): 0.7,
    ("analyze", "arm.py"): 0.6,
    ("arm.py",): 0.7,
    ("hop.py",): 2.5,
}
"""The most processor time that each command may take, with its script [s]."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure whole processes, each beside the bare script."""
    (folder / "arm.py").write_bytes(ARM.read_bytes())
    hops = 60 if quick else 600
    (folder / "hop.py").write_text(HOP.format(steps=hops), encoding="utf-8")
    made = {
        "arm.py": "720 steps",
        "hop.py": f"a humanoid of Gymnasium, {5 * hops:,} steps of MuJoCo",
    }
    for command, goal_s in [*GOALS_S.items()][3 if quick else 0 :]:
        *_, script = command
        ran = [
            (
                process(*DROP, *command, folder=folder),
                process(sys.executable, script, folder=folder),
            )
            for _ in range(1 if quick else 9)
        ]
        bare_s = statistics.median(bare.cpu_s for _, bare in ran)
        yield Measured(
            f"`drop {' '.join(command)}`, {made[script]}: processor time",
            "",
            [ours.cpu_s for ours, _ in ran],
            goal_s,
            unit="s",
            detail=f"the bare script takes {bare_s:.2g} s",
        )
