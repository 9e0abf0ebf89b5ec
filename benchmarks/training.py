"""Cost of `drop record` of a training loop: many steps of an environment, each read and kept."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, process, worked

SCRIPT = """
import sys
import gymnasium as gym
env = gym.make("Hopper-v5")
env.reset(seed=0)
env.action_space.seed(0)
for _ in range(int(sys.argv[1])):
    _, _, terminated, truncated, _ = env.step(env.action_space.sample())
    if terminated or truncated:
        env.reset()
"""
"""A random policy: half of the time its episodes end after twenty steps."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare the processor time of whole processes."""
    steps = 500 if quick else 50_000
    (folder / "train.py").write_text(SCRIPT, encoding="utf-8")
    ratios, detail = worked(
        lambda: process(*DROP, "record", "--force", "train.py", steps, folder=folder),
        lambda: process(sys.executable, "train.py", steps, folder=folder),
        pairs=1 if quick else 3,
    )
    yield Measured(
        f"`drop record` of a training loop, {steps:,} steps of Hopper: processor time",
        "the bare script",
        ratios,
        1.5,
        detail=detail,
    )
