"""Cost of `drop why --expect` and of `drop diff`: the time that comparing two runs takes.

A gripper of MuJoCo's lifts a box that is too slippery: `drop why --expect` tries single changes of
2 s of it. The processor time of that is what it takes at most on a machine at rest. `drop diff` of
two scripts records both, compares and explains; it is held against two commands that only record
them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import DROP, Measured, Ran, process, worked

SCENE = """
import mujoco
FINGER = '''<body pos="0 {0} 0"><joint name="{1}" type="slide" axis="0 {2} 0" damping="5"/>
<geom type="box" size=".02 .01 .04" mass=".1" friction=".3"/></body>'''
model = mujoco.MjModel.from_xml_string(f'''<mujoco><worldbody>
<geom name="floor" type="plane" size="1 1 .1"/>
<body name="hand" pos="0 0 .06"><joint name="lift" type="slide" axis="0 0 1" damping="20"/>
<geom type="box" size=".02 .08 .01" pos="0 0 .06" mass=".5"/>
{FINGER.format(.06, "left", -1)}{FINGER.format(-.06, "right", 1)}</body>
<body name="box" pos="0 0 .03"><freejoint/>
<geom type="box" size=".03 .03 .03" mass=".4" friction=".3"/></body></worldbody>
<actuator><position joint="lift" kp="400"/><motor joint="left"/><motor joint="right"/></actuator>
</mujoco>''')
data = mujoco.MjData(model)
for step in range(1000):
    data.ctrl[:] = [max(0, step - 250) * 3e-4, FORCE, FORCE]
    mujoco.mj_step(model, data)
"""
EXPECTED = "z('box') > 0.15"
TRIALS, MOST_S = 100, 60.0
"""Number of trials requested, and the time limit for them [s]."""


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure whole processes."""
    for name, force in (("slips", 2.0), ("holds", 6.0)):
        text = SCENE.replace("FORCE", str(force))
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    budget_s = 2 if quick else 4 * MOST_S
    asked = (*DROP, "why", "--expect", EXPECTED, "--jobs", "2", "--budget", str(budget_s))
    ran = process(*asked, "--force", "--out", "why", "slips.py", folder=folder, expected=3)
    runs = json.loads((folder / "why/slips.why/why.json").read_text(encoding="utf-8"))["runs"]
    yield Measured(
        f"`drop why --expect`, a gripper of 2 s, {TRIALS} trials: processor time",
        "",
        [ran.cpu_s * TRIALS / runs],
        MOST_S,
        unit="s",
        detail=f"{runs} trials, {ran.wall_s:.3g} s of wall time, recording and analysis in it",
    )
    scripts = "slips.py", "holds.py"
    ratios, detail = worked(
        lambda: process(*DROP, "diff", *scripts, folder=folder, expected=3),
        lambda: _both([process(*DROP, "record", each, folder=folder) for each in scripts]),
        pairs=1 if quick else 3,
    )
    yield Measured(
        "`drop diff` of two scripts, 1,000 steps of a gripper: processor time",
        "`drop record` of both",
        ratios,
        1.5,
        detail=detail,
    )


def _both(runs: list[Ran]) -> Ran:
    walls, works, peaks = zip(*((run.wall_s, run.cpu_s, run.peak_mb) for run in runs), strict=True)
    return Ran(sum(walls), sum(works), max(peaks))
