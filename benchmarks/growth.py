"""How the cost of `drop record` and `drop analyze` grows: with steps, bodies, degrees of freedom.

`python -m benchmarks.growth PICTURE.png` draws it.
"""

from __future__ import annotations

import argparse
import functools
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
ROBOTS = {
    7: 'p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)',
    18: 'p.loadURDF("laikago/laikago_toes_zup_lores.urdf", [0, 0, 0.5])',
    34: 'p.loadURDF("humanoid/humanoid.urdf", [0, 0, 1.2])',
}
"""Degrees of freedom, and what is loaded."""


@dataclass(frozen=True)
class Case:
    """A script of so many steps."""

    what: str
    """What grows: `steps`, `bodies` or `dofs`."""
    size: int
    steps: int
    load: str

    @property
    def name(self) -> str:
        """What is shown of it."""
        count = self.size if self.what == "bodies" else 1
        boxes = "1 box" if count == 1 else f"{count} boxes"
        sized = (
            f"a robot of {self.size} degrees of freedom"
            if self.what == "dofs"
            else f"{boxes} at rest"
        )
        return f"{sized}, {self.steps:,} steps"


def boxes(count: int) -> str:
    """Return lines that lay so many boxes on the floor."""
    return f"""for number in range({count}):
    p.loadURDF("cube_small.urdf", [0.2 * (number % 10), 0.2 * (number // 10), 0.025])"""


def cases(*, quick: bool) -> Iterator[Case]:
    """Yield what is measured."""
    counts = [1_000, 10_000, 100_000, 1_000_000][: 2 if quick else 4]
    for steps in counts:
        yield Case("steps", steps, steps, boxes(1))
    for count in (1, 10, 100):
        yield Case("bodies", count, counts[1] // (10 if quick else 1), boxes(count))
    for dofs, load in ROBOTS.items():
        yield Case("dofs", dofs, counts[1] // (10 if quick else 1), load)


def measure(folder: Path, *, quick: bool) -> Iterator[Measured]:
    """Time whole processes, and their memory."""
    for case, *both in measured(folder, quick=quick):
        yield from rows(case, *both)


def rows(case: Case, recorded: Ran, analyzed: Ran) -> Iterator[Measured]:
    """Yield the rows of a table."""
    for verb, ran in (("record", recorded), ("analyze", analyzed)):
        yield Measured(
            f"`drop {verb}`, {case.name}",
            "",
            [ran.wall_s / case.steps * 1e6],
            unit="µs a step",
            detail=f"{ran.wall_s:.2f} s, {ran.peak_mb:.0f} MB",
        )


def measured(folder: Path, *, quick: bool) -> Iterator[tuple[Case, Ran, Ran]]:
    """Yield each case with what recording and analyzing it took."""
    for case in cases(quick=quick):
        (folder / "scene.py").write_text(SCENE.format(load=case.load), encoding="utf-8")
        recorded = process(
            *DROP,
            "record",
            "--force",
            "--duration",
            "1e9",
            "--out",
            "run.rrd",
            "scene.py",
            case.steps,
            folder=folder,
        )
        yield case, recorded, process(*DROP, "analyze", "--force", "run.rrd", folder=folder)


def draw(path: Path, *, quick: bool) -> None:
    """Measure, print the table, and draw seconds over steps, bodies and degrees of freedom."""
    found: dict[str, list[tuple[int, float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for case, recorded, analyzed in measured(Path(folder), quick=quick):
            found.setdefault(case.what, []).append((case.size, recorded.wall_s, analyzed.wall_s))
            for row in rows(case, recorded, analyzed):
                print(row.row(), flush=True)
    path.write_bytes(style.rendered(functools.partial(build_figure, found), "png", dark=False))


def build_figure(found: Mapping[str, Sequence[tuple[int, float, float]]], theme: Theme) -> Figure:
    """Return the figure of sizes, and of seconds to record and to analyze, by what grows."""
    titles = {
        "steps": "steps of one box at rest",
        "bodies": "boxes at rest, 10,000 steps",
        "dofs": "degrees of freedom, 10,000 steps",
    }
    note = "start included; dotted: in proportion"
    figure = style.figure_of("Seconds that a command takes", [note], 2.9, theme)
    panels = figure.subplots(1, 3)
    for panel, (what, its) in zip(panels, found.items(), strict=True):
        sizes, *seconds = (list(column) for column in zip(*its, strict=True))
        panel.set_title(titles[what], loc="left", size=10)
        if what != "dofs":
            panel.set_xscale("log")
            panel.set_yscale("log")
            along = [max(seconds[1]) * size / sizes[-1] for size in sizes]
            panel.plot(sizes, along, ":", color=theme.faint, lw=1)
            panel.yaxis.set_minor_formatter(NullFormatter())
            panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            panel.xaxis.set_major_formatter(EngFormatter(sep=""))
        for each, colour in zip(seconds, (colours.SIMULATED, colours.TIMESTEP), strict=True):
            # Robots differ in more than their degrees of freedom.
            panel.plot(sizes, each, "o" if what == "dofs" else "o-", color=colour)
        panel.set_ylim(*((0.5, 100) if what != "dofs" else (0, None)))
    ends = zip(("record", "analyze"), seconds, (colours.SIMULATED, colours.TIMESTEP), strict=True)
    style.name_curves(
        panels[-1], [(name, each[-1], colour) for name, each, colour in ends], columns=21, size=10
    )
    return style.laid_out(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("picture", metavar="PICTURE.png", type=Path, help="the plot to write")
    parser.add_argument("--quick", action="store_true", help="a tenth of the work, as a smoke test")
    options = parser.parse_args()
    print(machine(), HEAD, sep="\n\n")
    draw(options.picture, quick=options.quick)
