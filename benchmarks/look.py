"""The time that an engineer waits: to record a script, to analyze it, and to do both at once."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, ROOT, Measured, process

ARM = ROOT / "docs/examples/arm.py"
"""An arm simulated for 720 steps."""
GOALS_S = {("record",): 0.7, ("analyze",): 0.6, (): 1.5}
"""Time limit for each command [s], on two cores."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Time whole processes, and compare them with the bare script."""
    shutil.copy(ARM, folder)
    for command, goal_s in GOALS_S.items():
        ran = [
            (
                process(*DROP, *command, "arm.py", folder=folder),
                process(sys.executable, "arm.py", folder=folder),
            )
            for _ in range(3 if quick else 9)
        ]
        bare_s = sorted(bare.wall_s for _, bare in ran)[len(ran) // 2]
        yield Measured(
            f"`drop {' '.join([*command, 'arm.py'])}`, 720 steps",
            "",
            [ours.wall_s for ours, _ in ran],
            goal_s,
            unit="s",
            detail=f"the bare script takes {bare_s:.2g} s",
        )
