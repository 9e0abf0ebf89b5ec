"""Cost of `drop record` of a training loop: many steps of an environment, each read and kept.

Within the loop, it is the processor time of the script's own thread that is compared.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, process, worked
from benchmarks.watching import bare, watched

SCRIPT = """
import time
import gymnasium as gym
env = gym.make("Hopper-v5")
env.reset(seed=0)
env.action_space.seed(0)
began = time.thread_time()
for _ in range({steps}):
    _, _, terminated, truncated, _ = env.step(env.action_space.sample())
    if terminated or truncated:
        env.reset()
print(time.thread_time() - began)
"""
"""A random policy: half of the time its episodes end after twenty steps."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Compare the processor time of whole processes."""
    steps, pairs = (500, 1) if quick else (50_000, 3)
    path = folder / "train.py"
    path.write_text(SCRIPT.format(steps=steps), encoding="utf-8")
    yield Measured(
        f"watching a training loop, {steps:,} steps of Hopper, in the loop",
        "the bare script",
        [watched(path) / bare(path) for _ in range(pairs)],
        1.3,
    )
    ratios, detail = worked(
        lambda: process(*DROP, "record", "--force", path, folder=folder),
        lambda: process(sys.executable, path, folder=folder),
        pairs=pairs,
    )
    yield Measured(
        f"`drop record` of a training loop, {steps:,} steps of Hopper: processor time",
        "the bare script",
        ratios,
        1.5,
        detail=detail,
    )
