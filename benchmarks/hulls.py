"""`drop analyze` of an arm of mesh hulls: cost of overlap checks for pairs the model filters."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, process

SCENE = """
import sys
import mujoco
import numpy as np
points = np.random.default_rng(0).normal(size=(1500, 3))
points /= np.linalg.norm(points, axis=1)[:, None]
corners = " ".join(f"{x:.4f}" for x in (points * [0.05, 0.05, 0.14] + [0, 0, 0.1]).ravel())
links = "".join(
    f'<body pos="0 0 {0.2 if i else 0.5}"><joint axis="{i % 2} {(i + 1) % 2} 0" damping="1"/>'
    '<geom type="mesh" mesh="link" density="500"/>' for i in range(6)
) + "</body>" * 6
model = mujoco.MjModel.from_xml_string(
    f'<mujoco><asset><mesh name="link" vertex="{corners}"/></asset>'
    f'<worldbody>{links}</worldbody></mujoco>'
)
data = mujoco.MjData(model)
data.qpos[:] = 0.3
for _ in range(int(sys.argv[1])):
    mujoco.mj_step(model, data)
"""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure the processor time of whole processes."""
    script, steps = folder / "hulls.py", 50 if quick else 5_000
    script.write_text(SCENE, encoding="utf-8")
    process(*DROP, "record", "--out", "hulls.rrd", script, steps, folder=folder)
    analyze = (*DROP, "analyze", "--force", "hulls.rrd")
    runs = range(1 if quick else 3)
    taken_s = [process(*analyze, folder=folder).cpu_s for _ in runs]
    bare_s = min(process(sys.executable, script, steps, folder=folder).cpu_s for _ in runs)
    yield Measured(
        f"`drop analyze`, six mesh hulls of 1,500 corners, {steps:,} steps: processor time",
        "",
        taken_s,
        2.0,
        unit="s",
        detail=f"the bare script takes {bare_s:.2g} s",
    )
