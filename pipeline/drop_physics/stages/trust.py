"""Run a script again with variations, and say what holds in all of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.engines.cures import cures_of as engine_cures
from drop_physics.engines.script import Program
from drop_physics.errors import ScenarioError
from drop_physics.fields import shown
from drop_physics.option_types import number
from drop_physics.printable import Printable
from drop_physics.stages.asked import cures_of
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import SEEDED_CLOCK_S, checked_limits
from drop_physics.stages.proposals import Candidate, Proposals
from drop_physics.stages.runs import Progress
from drop_physics.stages.trust_runs import (
    BASE,
    Made,
    RunFolder,
    RunVariation,
    Varied,
    identity_of,
    made_of,
    run_kept,
)
from drop_physics.trace.cures import NUDGE, Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

if TYPE_CHECKING:
    from drop_physics.experiments.robustness import Converging, Growth, Standing
    from drop_physics.rules.answer import Finding
    from drop_physics.trace.history import Seen

USUAL = (
    *("timestep/2", "timestep/4", "iterations*4", "residual 0"),
    *("solver=CG", "solver=Newton", "cone=pyramidal", "cone=elliptic", "impratio=10"),
    *("nudge", "seed"),
)
"""The usual variations; an engine supports some, and its model may already have others."""
UNITS = {
    "m": (1.0, "m"),
    "cm": (1e-2, "m"),
    "mm": (1e-3, "m"),
    "µm": (1e-6, "m"),
    "um": (1e-6, "m"),
    "nm": (1e-9, "m"),
    "rad": (1.0, "rad"),
    "mrad": (1e-3, "rad"),
    "deg": (0.017453292519943295, "rad"),
    "°": (0.017453292519943295, "rad"),
}
LENGTH = re.compile(r"([^\s]*?[\d.])\s*([^\d\s.]+)?")


@dataclass(frozen=True)
class Trust(Printable, reported_by="drop_physics.report.trust"):
    """What holds of a script's result."""

    script: str
    made: Made
    """Its own run."""
    variations: list[Varied]
    standing: list[Standing]
    """How each position that matters depends on the variations, the most dependent first."""
    growth: Growth | None
    """How the nudge grows; None if it does not, or was left out."""
    converging: list[Converging]
    """How each final position that depends on the timestep converges, if three timesteps were
    run."""
    findings: list[Finding]

    @property
    def recording(self) -> Path:
        """The recording of its own run."""
        return self.made.recording

    def ends_within(self, lengths: Mapping[str, float]) -> bool:
        """Return whether no variation fails, and all end within some lengths, by unit."""
        if any(each.made.ended == "failed" != self.made.ended for each in self.variations):
            return False
        ends = [end for each in self.variations for end in each.apart.end]
        return bool(ends or not lengths) and all(
            end.value <= lengths[end.unit] for end in ends if end.unit in lengths
        )


def trust(
    target: str,
    arguments: Sequence[str] = (),
    *,
    out: Path | str | None = None,
    vary: Sequence[str] | None = None,
    is_module: bool = False,
    steps: int | None = None,
    duration_s: float | None = None,
    seed: int = 0,
    python: str | None = None,
    jobs: int | None = None,
    ray: str | None = None,
    force: bool = False,
    again: bool = False,
    stdout: int = 1,
    table: Path | str | None = None,
    plot: Path | str | None = None,
    dark: bool = False,
    note: Callable[[str], None] = lambda _: None,
    progress: Progress = lambda *_: None,
) -> Trust:
    """Run a script as it is and with variations, and compare them.

    Parameters
    ----------
    target, arguments, is_module
        The script's path or a module's name, and its arguments.
    out
        The folder for the recordings; None for one in `recordings`, under the script's name. What
        an interrupted call of the same has finished there is not run again.
    vary
        In place of the usual variations: texts such as `timestep/8`, `nudge` or `mass=0.9,1.1`, as
        `--vary` takes them.
    steps, duration_s, seed
        As of `record_script`; all runs but `seed` have the same seed.
    python
        The interpreter that runs it; None for the current one.
    jobs, ray
        Processes on this machine, None for one per core; or a Ray cluster's address.
    force
        Whether all is run again, and what is in the folder is replaced.
    again
        Whether a script that connects, opens devices or writes where it cannot be kept from doing
        so is run again all the same.
    stdout
        File descriptor of the script's standard output, in its own run.
    table
        A `.csv` or `.parquet` file for all distances, a row per variation and position, or None.
    plot
        A `.png` or `.svg` file for a plot of the distances over time, or None.
    dark
        Whether the plot is for a dark page.
    note
        Called with a sentence worth knowing that is not an error.
    progress
        Called while it runs.

    Raises
    ------
    ScenarioError
        If a limit or a variation is out of range.
    OutputError
        If the folder holds something else, or cannot be written.
    DropError
        If the interpreter cannot be started, or the script makes no step.
    """
    steps, duration_s, _ = checked_limits(steps, duration_s, seed)
    asked = cures_of(vary or USUAL, "--vary", whole=True)
    outputs = [None if each is None else Path(each) for each in (table, plot)]
    if any(outputs):
        from drop_physics.stages.trust_outputs import check_outputs, write_outputs

        check_outputs(target, *outputs, is_module=is_module, force=force)
    program = Program(
        target,
        tuple(map(str, arguments)),
        interpreter_of(target, is_module=is_module, given=python, note=note),
        is_module,
        steps,
        duration_s,
        seed=seed,
        begins_s=SEEDED_CLOCK_S,
        explain=True,
    )
    place = Path("recordings") / f"{Path(target).stem}-trust" if out is None else Path(out)
    folder = RunFolder(place.resolve(), identity_of(program), force)
    with folder.claimed((BASE, *(each.call for each in asked))):
        base, limited, rerun = folder.begun(program, anyway=again, stdout=stdout, note=note)
        candidates = candidates_of(base.seen, asked, "--vary", usual=not vary)
        work = RunVariation(
            limited, candidates, folder.path, base.path, base, rerun, runs=folder.runs
        )
        varied = run_kept(work, jobs=jobs, ray=ray, progress=progress)
    result = _trust(target, work, varied)
    if any(outputs):
        write_outputs(result, *outputs, dark=dark, force=force)
    return result


def candidates_of(
    seen: Seen, asked: Sequence[Cure], option: str, *, usual: bool
) -> list[Candidate]:
    """Return the interventions that are asked for, as the engine supports them, on the whole run.

    Parameters
    ----------
    seen
        The script's own run.
    asked
        The interventions.
    option
        The option that names them.
    usual
        Whether to silently leave out those of other engines, and those that the model already has.

    Raises
    ------
    ScenarioError
        If the engine does not support one.
    """
    engine, settings = seen.engine, seen.settings[-1].values
    proposals, found = Proposals(seen, [], engine_cures(engine)), []
    for cure in asked:
        candidate, name = proposals.whole(cure), cure.given.get("name")
        if candidate.run is None and not usual:
            raise ScenarioError(
                "{option} {name} is no option of {engine}, which steps the script",
                option=option,
                name=cure.call,
                engine=engine,
            )
        has_it = usual and engine != PYBULLET and name and settings.get(name) == cure.value
        if candidate.run is not None and not has_it:
            found.append(candidate)
    return found


def _trust(target: str, work: RunVariation, varied: Sequence[Varied]) -> Trust:
    from drop_physics.experiments.robustness import converging, geometric, growth, standing
    from drop_physics.stages.trust_findings import findings_of

    base = made_of(BASE, work.own)
    made = [
        (each.intervention.cure, one)
        for each, one in zip(work.candidates, varied, strict=True)
        if not (each.intervention.call == "seed" and one.apart.same)  # it draws none
    ]
    nudged = next(((cure, one) for cure, one in made if cure.name == "nudge"), None)
    grown = nudged and growth(nudged[1].apart, nudged[0].value or NUDGE)
    finer = {int(cure.value or 0): one for cure, one in made if cure.name == "timestep"}
    three = geometric([*finer])
    found = []
    if three is not None:
        runs = [None if each == 1 else finer[each].apart for each in three]
        found = converging([1 / each for each in three], runs)
    varied = [one for _, one in made]
    stands = standing({each.name: each.apart for each in varied})
    findings = findings_of(varied, grown or None, found, base)
    return Trust(target, base, varied, stands, grown or None, found, findings)


def lengths_of(text: str | float | None) -> Mapping[str, float]:
    """Return the largest distances by unit, m or rad, of a text such as `1mm` or `1mm,0.5deg`.

    Raises
    ------
    ScenarioError
        If it is something else.
    """
    if text is None:
        return {}
    found: dict[str, float] = {}
    for part in str(text).split(","):
        match = LENGTH.fullmatch(part.strip())
        try:
            if match is None:
                raise ValueError
            value, (size, unit) = number(match[1]), UNITS[match[2] or "m"]
            if not 0 <= value < float("inf"):
                raise ValueError
        except (ScenarioError, KeyError, ValueError):
            raise ScenarioError(
                "--within must be a length or an angle such as 1mm or 0.5deg, got {text}",
                text=shown(text),
            ) from None
        found[unit] = value * size
    return found
