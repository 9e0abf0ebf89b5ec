"""Run two programs in pairs and compare their time: shared by all benchmarks."""

from __future__ import annotations

import json
import math
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from drop_physics import Scenario
from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.world import World
from drop_physics.trace.states import BODY
from drop_physics.workers import cores

DROP = (sys.executable, "-m", "drop_physics")
PYTHON = (sys.executable, "-c")
ROOT = Path(__file__).parents[1]
LIBRARIES = ("pybullet", "rerun-sdk", "numpy", "polars", "matplotlib", "pillow", "typer")


@dataclass(frozen=True)
class Measured:
    """The result of one benchmark: one value per pair of runs, or per run if runs are not paired.

    `goal` is an upper limit, or a lower one if `more_is_better`.
    """

    question: str
    compared_with: str
    values: Sequence[float]
    goal: float | None = None
    unit: str = "×"
    more_is_better: bool = False
    detail: str = ""

    @property
    def median(self) -> float:
        """The median of the values."""
        return statistics.median(self.values)

    @property
    def reached(self) -> bool | None:
        """Whether the median reaches the goal; None if there is no goal."""
        if self.goal is None:
            return None
        return self.median >= self.goal if self.more_is_better else self.median <= self.goal

    def row(self) -> str:
        """Return the result as a row of a Markdown table."""
        bound = "≥" if self.more_is_better else "≤"
        goal = "" if self.goal is None else f"{bound} {self.goal:g} {self.unit}"
        verdict = {True: "yes", False: "**no**", None: ""}[self.reached]
        spread = " / ".join(_digits(v) for v in (min(self.values), self.median, max(self.values)))
        return (
            f"| {self.question} | {self.compared_with} | {spread} {self.unit} | {goal} | {verdict} "
            f"| {self.detail} |"
        )


HEAD = """| question | compared with | min / median / max | goal | reached | detail |
| --- | --- | --- | --- | --- | --- |"""


@dataclass(frozen=True)
class Ran:
    """Time and memory that a process used."""

    wall_s: float
    cpu_s: float
    peak_mb: float


LAUNCHER = """
import json, os, subprocess, sys, time
began = time.perf_counter()
child = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, used = os.wait4(child.pid, 0)
wall_s = time.perf_counter() - began
child.returncode = os.waitstatus_to_exitcode(status)
cpu_s, peak_mb = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
print(json.dumps([child.returncode, wall_s, cpu_s, peak_mb]))
"""
"""Linux includes the parent's memory at the fork in the child's peak, so the parent must be small.
The processor time of the child's own children is included if it waits for them."""


def process(*command: object, folder: Path, expected: int = 0) -> Ran:
    """Run a command in a folder, discard its output, and return the time and memory that it used.

    Raises
    ------
    RuntimeError
        If it ends with another exit code than expected.
    """
    words = [str(part) for part in command]
    launched = subprocess.run(
        [sys.executable, "-S", "-c", LAUNCHER, *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"},
        check=True,
    )
    code, *took = json.loads(launched.stdout)
    if code != expected:
        raise RuntimeError(f"exit code {code}: {' '.join(words)[:200]}")
    return Ran(*took)


def paired(
    ours: Callable[[], Ran], theirs: Callable[[], Ran], *, pairs: int, warm: bool = True
) -> tuple[list[float], str]:
    """Return the ratio of our wall time to theirs for each pair, and the times themselves as text.

    Parameters
    ----------
    ours, theirs
        Do the work once.
    pairs
        How many pairs of runs.
    warm
        Whether both are run once first, so that files and bytecode are cached.
    """
    if warm:
        ours(), theirs()
    runs = [(ours(), theirs()) for _ in range(pairs)]
    ratios = [mine.wall_s / other.wall_s for mine, other in runs]
    mine_s, other_s = (
        statistics.median(ran.wall_s for ran in side) for side in zip(*runs, strict=True)
    )
    times = f"{_digits(mine_s)} s over {_digits(other_s)} s"
    work = statistics.median(mine.cpu_s / other.cpu_s for mine, other in runs)
    return ratios, times if math.isnan(work) else f"{times}; processor time {_digits(work)} ×"


def worked(
    ours: Callable[[], Ran], theirs: Callable[[], Ran], *, pairs: int
) -> tuple[list[float], str]:
    """Return the ratio of our processor time to theirs for each pair, and the times as text."""
    runs = [(ours(), theirs()) for _ in range(pairs)]
    ratios = [mine.cpu_s / other.cpu_s for mine, other in runs]
    mine_s, other_s = (
        statistics.median(ran.cpu_s for ran in side) for side in zip(*runs, strict=True)
    )
    return ratios, f"{_digits(mine_s)} s of processor time over {_digits(other_s)} s"


def done(work: Callable[[], object]) -> Ran:
    """Call a function in this process, and return only its time: workers cannot be separated."""
    began = time.perf_counter()
    work()
    return Ran(time.perf_counter() - began, math.nan, math.nan)


def slow_fall(count: int) -> tuple[Scenario, Float64]:
    """Return a falling body's scenario and its first poses, shape (count, 7), all distinct."""
    scenario = Scenario(timestep_s=1 / 2400)
    with World(scenario) as world:
        return scenario, next(world.samples(count)).bases[BODY][:, :7]


def machine() -> str:
    """Return a description of the machine and the library versions, in two lines."""
    about = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((li.split(":")[1].strip() for li in about if li.startswith("model name")), "")
    libraries = ", ".join(f"{name} {metadata.version(name)}" for name in LIBRARIES)
    return (
        f"{model or platform.processor()}, {cores()} cores, {platform.system()} "
        f"{platform.machine()}, load {os.getloadavg()[0]:.1f} at the start\n"
        f"Python {platform.python_version()}, {libraries}"
    )


def _digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:,.0f}"
