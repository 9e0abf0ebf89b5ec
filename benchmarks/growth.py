"""Growth of a command's time and memory with steps, bodies, degrees of freedom, contacts, trials.

`python -m benchmarks.growth PICTURE.png` draws it; `--long` goes on to 10⁷ steps, in half an hour.
"""

from __future__ import annotations

import argparse
import functools
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from drop_physics import colours
from drop_physics.figures import style
from drop_physics.figures.theme import Theme
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, NullFormatter

from benchmarks.harness import DROP, HEAD, Measured, Ran, machine, process

SCENE = """
import sys
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
{load}
for _ in range(int(sys.argv[1])):
    p.stepSimulation()
"""
CHAIN = """count = 85
rod = p.createCollisionShape(p.GEOM_CAPSULE, radius=0.01, height=0.02)
p.createMultiBody(0, basePosition=[0, 0, 9], linkMasses=[0.1] * count,
    linkCollisionShapeIndices=[rod] * count, linkVisualShapeIndices=[-1] * count,
    linkPositions=[[0.01, 0, -0.05]] * count, linkOrientations=[[0, 0, 0, 1]] * count,
    linkInertialFramePositions=[[0, 0, 0]] * count, linkParentIndices=[*range(count)],
    linkInertialFrameOrientations=[[0, 0, 0, 1]] * count,
    linkJointTypes=[p.JOINT_REVOLUTE] * count, linkJointAxis=[[0, 1, 0]] * count)"""
ROBOTS = {
    7: 'p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)',
    18: 'p.loadURDF("laikago/laikago_toes_zup_lores.urdf", [0, 0, 0.5])',
    34: 'p.loadURDF("humanoid/humanoid.urdf", [0, 0, 1.2])',
    85: CHAIN,
}
"""Number of degrees of freedom -> the code that loads such a robot; the last is a hanging chain."""
TITLES = {
    "steps": "steps of one box at rest",
    "bodies": "boxes at rest, {steps} steps",
    "dofs": "degrees of freedom, {steps} steps",
    "contacts": "contact points a step, {steps} steps",
    "trials": "trials of a script of 240 steps",
}
FALL = """
import pybullet as p, pybullet_data
p.connect(p.DIRECT)
p.setAdditionalSearchPath(pybullet_data.getDataPath())
p.setGravity(0, 0, -9.81)
p.loadURDF("plane.urdf")
p.loadURDF("cube_small.urdf", [0, 0, 1])
for _ in range(240):
    p.stepSimulation()
"""


@dataclass(frozen=True)
class Case:
    """A script of a given number of steps."""

    what: str
    """The quantity that grows: a key of TITLES."""
    size: int
    steps: int
    load: str = ""

    @property
    def name(self) -> str:
        """The description shown in the table."""
        return f"{self.size:,} {TITLES[self.what].format(steps=f'{self.steps:,}')}"


@dataclass(frozen=True)
class Took:
    """Time and memory measured for a case."""

    case: Case
    runs: Mapping[str, Ran]
    """Measurements by CLI verb."""

    def rows(self) -> Iterator[Measured]:
        """Yield the rows of a table."""
        for verb, ran in self.runs.items():
            yield Measured(
                f"`drop {verb}`, {self.case.name}",
                "",
                [ran.wall_s],
                unit="s",
                detail=f"processor time {ran.cpu_s:.2f} s, {ran.peak_mb:.0f} MB",
            )


def boxes(count: int) -> str:
    """Return the lines of code that place this number of boxes on the floor."""
    side = max(10, math.isqrt(count))
    return f"""for number in range({count}):
    p.loadURDF("cube_small.urdf", [0.2 * (number % {side}), 0.2 * (number // {side}), 0.025])"""


def cases(*, quick: bool, long: bool = False) -> Iterator[Case]:
    """Yield the cases to measure; `quick`, a single one of each way of measuring."""
    if quick:
        yield Case("dofs", 85, 10, CHAIN)
        yield Case("trials", 2, 240)
        return
    for steps in [10_000, 100_000, 1_000_000, 10_000_000][: 4 if long else 3]:
        yield Case("steps", steps, steps, boxes(1))
    for count in (1, 10, 100, 1000):
        yield Case("bodies", count, 100, boxes(count))
    for dofs, load in ROBOTS.items():
        yield Case("dofs", dofs, 2000, load)
    for count in (25, 250, 2500):
        yield Case("contacts", 4 * count, 10, boxes(count))
    for count in (10, 100, 1000)[: 3 if long else 2]:
        yield Case("trials", count, 240)


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Measure the time and memory of whole processes."""
    for took in measured(folder, quick=quick):
        yield from took.rows()


def measured(folder: Path, *, quick: bool = False, long: bool = False) -> Iterator[Took]:
    """Yield the measurements of each case: of recording and analyzing it, or of its trials."""
    for case in cases(quick=quick, long=long):
        if case.what == "trials":
            (folder / "fall.py").write_text(FALL, encoding="utf-8")
            values = ",".join(str(0.1 + number / 1000) for number in range(case.size))
            given = ("--try", f"friction={values}", "--force", "--out", "trials", "fall.py")
            yield Took(case, {"sweep": process(*DROP, "sweep", *given, folder=folder)})
            continue
        (folder / "scene.py").write_text(SCENE.format(load=case.load), encoding="utf-8")
        given = ("--force", "--duration", "1e9", "--out", "run.rrd", "scene.py")
        recorded = process(*DROP, "record", *given, case.steps, folder=folder)
        analyzed = process(*DROP, "analyze", "--force", "run.rrd", folder=folder)
        yield Took(case, {"record": recorded, "analyze": analyzed})


def draw(path: Path, *, long: bool) -> None:
    """Measure, print the table, and plot time against the quantity that grows."""
    found: list[Took] = []
    with tempfile.TemporaryDirectory() as folder:
        for took in measured(Path(folder), long=long):
            found.append(took)
            for row in took.rows():
                print(row.row(), flush=True)
    path.write_bytes(style.rendered(functools.partial(build_figure, found), "png", dark=False))


def build_figure(found: Sequence[Took], theme: Theme) -> Figure:
    """Return the figure of processor time against size, by the quantity that grows."""
    note = "start included; dotted: in proportion"
    figure = style.figure_of("Processor time of a command [s]", [note], 4.8, theme)
    panels = figure.subplots(2, 3).ravel()
    verbs = {
        "record": colours.SIMULATED,
        "analyze": colours.TIMESTEP,
        "sweep": colours.DAMPING,
    }
    for panel, what in zip(panels, TITLES, strict=False):
        its = [took for took in found if took.case.what == what]
        sizes = [took.case.size for took in its]
        panel.set_title(TITLES[what].format(steps=f"{its[0].case.steps:,}"), loc="left", size=9)
        panel.set_xscale("log")
        panel.set_yscale("log")
        most_s = max(ran.cpu_s for ran in its[-1].runs.values())
        along = [most_s * size / sizes[-1] for size in sizes]
        panel.plot(sizes, along, ":", color=theme.faint, lw=1)
        panel.yaxis.set_minor_formatter(NullFormatter())
        panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.xaxis.set_major_formatter(EngFormatter(sep=""))
        for verb in its[0].runs:
            # Robots differ in more than their degrees of freedom.
            seconds = [took.runs[verb].cpu_s for took in its]
            panel.plot(sizes, seconds, "o" if what == "dofs" else "o-", color=verbs[verb])
        panel.set_ylim(bottom=0.3)
    panels[-1].set_axis_off()
    for number, (verb, colour) in enumerate(verbs.items()):
        panels[-1].text(0.1, 0.8 - 0.2 * number, verb, color=colour, size=11)
    return style.laid_out(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("picture", metavar="PICTURE.png", type=Path, help="the plot to write")
    parser.add_argument("--long", action="store_true", help="10⁷ steps and 10³ trials, too")
    options = parser.parse_args()
    print(machine(), HEAD, sep="\n\n")
    draw(options.picture, long=options.long)
