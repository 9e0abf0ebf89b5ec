"""Run a script again with variations, and tell what of its result stands."""

from __future__ import annotations

import contextlib
import os
import sys
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

from drop_physics.analysis.apart import Apart, Converging, Growth, apart, converging, growth
from drop_physics.engines.bullet import script as running
from drop_physics.engines.bullet.script import Program
from drop_physics.errors import DropError, ScenarioError
from drop_physics.files.outputs import check_target, make_folder
from drop_physics.recording import schema
from drop_physics.recording.reader import read
from drop_physics.recording.recorder import Recorder
from drop_physics.seen.events import Ending
from drop_physics.stages.record import SEEDED_CLOCK_S, STOPPED, checked_limits, written
from drop_physics.sweeping import engines
from drop_physics.workers import cores

NUDGE = 1e-9
"""How far bodies and joints are moved before the first step [m, rad]."""
VARIATIONS: dict[str, dict[str, Any]] = {
    "timestep/2": {"finer": 2},
    "timestep/4": {"finer": 4},
    "iterations*4": {"iterations": 4},
    "residual 0": {"engine": {"solverResidualThreshold": 0.0}},
    "nudge": {"nudge": NUDGE},
    "seed": {},
}
"""By name, what differs; `seed` runs with another one."""
FACTORS = ("gravity", "friction", "mass")
"""What `--vary` takes besides parameters of the engine."""


@dataclass(frozen=True)
class Varied:
    """A run with a variation, and how far it is from the script's own."""

    name: str
    recording: Path
    apart: Apart
    ended: str


@dataclass(frozen=True)
class Trust:
    """What of a script's result stands."""

    script: str
    recording: Path
    variations: list[Varied]
    growth: Growth | None
    """Of the nudge; None where it does not grow, or was left out."""
    converging: Converging | None
    """As the timestep shrinks; None where nothing changes, or it was left out."""


@dataclass(frozen=True)
class RunVariation:
    """Runs one variation, called with its number; picklable."""

    program: Program
    variations: Mapping[str, Mapping[str, Any]]
    base: Path

    def __call__(self, number: int) -> Varied:
        """Run a variation, record it, and compare it with the script's own run."""
        name, variation = [*self.variations.items()][number]
        program = replace(self.program, variation=variation)
        if name == "seed":
            program = replace(program, seed=(program.seed or 0) + 1)
        path = recording_of(self.base.parent, name)
        null = os.open(os.devnull, os.O_WRONLY)
        try:
            ending, _ = run_recorded(program, path, {"variation": name}, stdout=null, stderr=null)
        finally:
            os.close(null)
        if ending.how == "interrupted":
            raise DropError("{name} was interrupted", name=name)
        finer = variation.get("finer", 1)
        return Varied(name, path, apart(read(self.base).seen, read(path).seen, finer=finer),
            ending.how)  # fmt: skip


def recording_of(folder: Path, name: str) -> Path:
    """Return the recording of a variation."""
    return folder / f"{name.replace('/', '_').replace('*', '_').replace(' ', '_')}.rrd"


def trust(
    target: str,
    arguments: Sequence[str] = (),
    *,
    out: Path | str,
    vary: Mapping[str, Sequence[float]] | None = None,
    is_module: bool = False,
    steps: int | None = None,
    duration_s: float | None = None,
    seed: int = 0,
    python: str | None = None,
    jobs: int | None = None,
    ray: str | None = None,
    force: bool = False,
    stdout: int = 1,
) -> Trust:
    """Run a script as it is and with variations, and compare them.

    Parameters
    ----------
    target, arguments, is_module
        The script's path or a module's name, and its arguments.
    out
        The folder for the recordings.
    vary
        Values by the name of a parameter of the engine, or `gravity` [m/s2], or `friction` or
        `mass`, which are factors: in place of the usual variations.
    steps, duration_s, seed
        As of `record_script`; all runs but `seed` have the same seed.
    python
        The interpreter that runs it; None for the current one.
    jobs, ray
        Processes on this machine, None for one per core; or a Ray cluster's address.
    force
        Whether existing recordings may be replaced.
    stdout
        File descriptor of the script's standard output, in its own run.

    Raises
    ------
    ScenarioError
        If a limit or a variation is out of range.
    OutputError
        If a recording exists or cannot be written.
    DropError
        If the interpreter cannot be started, or the script makes no step.
    """
    steps, duration_s, _ = checked_limits(steps, duration_s, seed)
    variations = VARIATIONS if vary is None else variations_of(vary)
    folder = Path(out).resolve()
    make_folder(folder, "--out")
    program = Program(
        target, tuple(arguments), python or sys.executable, is_module, steps, duration_s,
        seed=seed, begins_s=SEEDED_CLOCK_S,
    )  # fmt: skip
    base = folder / "base.rrd"
    for path in (base, *(recording_of(folder, name) for name in variations)):
        check_target(path, force=force)
    ending, made = run_recorded(program, base, {}, stdout=stdout)
    if not made:
        raise DropError("{script} makes no step: there is nothing to compare", script=target)
    most = made if ending.how in STOPPED else made + 1
    work = RunVariation(replace(program, steps=most, duration_s=None), variations, base)
    numbers, jobs = range(len(variations)), min(jobs or cores(), len(variations))
    runs = (
        engines.on_ray(work, numbers, address=ray) if ray is not None
        else engines.in_this_process(work, numbers) if jobs == 1
        else engines.in_processes(work, numbers, jobs=jobs)
    )  # fmt: skip
    with contextlib.closing(runs) as finished:
        done = {number: varied for number, varied in finished}  # noqa: C416 - in any order
    varied = {done[number].name: done[number] for number in numbers}
    if "seed" in varied and varied["seed"].apart.same:  # it draws none
        del varied["seed"]
    return Trust(
        target, base, [*varied.values()],
        growth(varied["nudge"].apart, NUDGE) if "nudge" in varied else None,
        _converging(base, varied),
    )  # fmt: skip


def _converging(base: Path, varied: Mapping[str, Varied]) -> Converging | None:
    if not {"timestep/2", "timestep/4"} <= varied.keys():
        return None
    seen = read(base).seen
    ends = [apart(seen, seen), varied["timestep/2"].apart, varied["timestep/4"].apart]
    return converging((1.0, 0.5, 0.25), ends)


def varied_by(texts: Sequence[str] | None) -> dict[str, list[float]] | None:
    """Return values by name, of texts such as `mass=0.9,1.1`.

    Raises
    ------
    ScenarioError
        If one is something else.
    """
    if not texts:
        return None
    found: dict[str, list[float]] = {}
    for text in texts:
        name, _, values = text.partition("=")
        try:
            found.setdefault(name, []).extend(map(float, values.split(",")))
        except ValueError:
            raise ScenarioError(
                "--vary must be NAME=V,… with numbers, got {text!r}", text=text
            ) from None
    return found


def variations_of(vary: Mapping[str, Sequence[float]]) -> dict[str, dict[str, Any]]:
    """Return variations by name, of values by parameter.

    Raises
    ------
    ScenarioError
        If the timestep is among them, which is varied by other means.
    """
    found = {}
    for name, values in vary.items():
        if name in ("fixedTimeStep", "numSubSteps"):
            raise ScenarioError("--vary takes no {name}: timestep/2 and /4 vary it", name=name)
        for value in values:
            kind = {name: value} if name in FACTORS else {"engine": {name: value}}
            found[f"{name}={value:g}"] = kind
    return found


def run_recorded(
    program: Program, path: Path, more: Mapping[str, Any], *, stdout: int, stderr: int | None = None
) -> tuple[Ending, int]:
    """Run and record a program; return how it ended, and its number of steps."""
    origin: dict[str, Any] = {
        "kind": "script",
        "script": f"-m {program.target}" if program.is_module else Path(program.target).name,
        "arguments": [*program.arguments] or None,
        "seed": program.seed,
        "steps": program.steps,
        "duration_s": program.duration_s,
        "drop_version": metadata.version("drop-physics"),
        **more,
    }
    recorder = Recorder({schema.ORIGIN_PROPERTY: origin})
    with running.Script(program, stdout=stdout, stderr=stderr) as process:
        ended = written(process, recorder, path, recording_id=uuid.uuid4().hex, force=True)
    return ended, process.decoder.steps
