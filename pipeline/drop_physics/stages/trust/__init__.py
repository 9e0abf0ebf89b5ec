"""The command `trust`: runs a script with variations, and says which results hold in all."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drop_physics.engines.cures import cures_of as engine_cures
from drop_physics.engines.script import Program
from drop_physics.errors import ScenarioError
from drop_physics.fields import shown
from drop_physics.option_types import number
from drop_physics.printable import Printable
from drop_physics.stages import verbs
from drop_physics.stages.interpreter import interpreter_of
from drop_physics.stages.program import SEEDED_CLOCK_S, checked_limits
from drop_physics.stages.rerun.asked import cures_of
from drop_physics.stages.rerun.proposals import Candidate, Proposals
from drop_physics.stages.rerun.single import possible
from drop_physics.stages.trust.runs import (
    BASE,
    Made,
    RunFolder,
    RunVariation,
    Varied,
    identity_of,
    made_of,
    run_kept,
)
from drop_physics.stages.verbs.taken import takes_those_of
from drop_physics.trace.cures import NUDGE, Cure
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET

if TYPE_CHECKING:
    from drop_physics.engines.watching.single_changes import Change
    from drop_physics.experiments.robustness import Converging, Growth, Standing
    from drop_physics.rules.answer import Finding
    from drop_physics.stages.rerun.again import Again
    from drop_physics.trace.history import Seen

USUAL = (
    *("timestep/2", "timestep/4", "iterations*4", "residual 0"),
    *("solver=CG", "solver=Newton", "cone=pyramidal", "cone=elliptic", "impratio=10"),
    *("nudge", "seed"),
)
"""Default variations; those that the engine does not support, or that the model has already, are
left out."""
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
    """How far a script's result can be trusted: the effects of variations."""

    script: str
    made: Made
    """The recording of the script's own run."""
    variations: list[Varied]
    standing: list[Standing]
    """How much each relevant position depends on the variations, the most dependent first."""
    growth: Growth | None
    """Growth of the nudge during the run; None if it does not grow, or was left out."""
    converging: list[Converging]
    """How each timestep-dependent final position converges, if three timesteps were run."""
    findings: list[Finding]

    @property
    def recording(self) -> Path:
        """Path of the recording of the script's own run."""
        return self.made.recording

    def ends_within(self, lengths: Mapping[str, float]) -> bool:
        """Return whether no variation fails, and all end within the given distances, by unit."""
        if any(each.made.ended == "failed" != self.made.ended for each in self.variations):
            return False
        ends = [end for each in self.variations for end in each.apart.end]
        return bool(ends or not lengths) and all(
            end.value <= lengths[end.unit] for end in ends if end.unit in lengths
        )


@takes_those_of(verbs.TrustArguments)
def trust(asked: verbs.TrustArguments) -> Trust:
    """Run a script as it is and with variations, and compare them.

    Raises
    ------
    ScenarioError
        If a limit or a variation is out of range.
    OutputError
        If the folder contains other files, or cannot be written to.
    DropError
        If the interpreter cannot be started, or the script makes no step.
    """
    duration_s, steps = asked.duration_s, asked.steps
    steps, duration_s, _ = checked_limits(steps, duration_s, asked.seed)
    cures = cures_of(asked.vary or USUAL, "--vary", whole=True)
    outputs = [None if each is None else Path(each) for each in (asked.table, asked.plot)]
    if any(outputs):
        from drop_physics.stages.trust.outputs import check_outputs, write_outputs

        check_outputs(asked.target, *outputs, is_module=asked.is_module, force=asked.force)
    program = Program(
        asked.target,
        tuple(map(str, asked.arguments)),
        interpreter_of(
            asked.target, is_module=asked.is_module, given=asked.python, note=asked.note
        ),
        asked.is_module,
        steps,
        duration_s,
        seed=asked.seed,
        begins_s=SEEDED_CLOCK_S,
        explain=True,
    )
    place = (
        Path("recordings") / f"{Path(asked.target).stem}-trust"
        if asked.out is None
        else Path(asked.out)
    )
    folder = RunFolder(place.resolve(), identity_of(program), asked.force)
    with folder.claimed((BASE, *(each.call for each in cures))):
        base, limited, rerun = folder.begun(
            program, anyway=asked.again, stdout=asked.stdout, note=asked.note
        )
        known = OwnRun(base.seen, limited, rerun)
        candidates = candidates_of(known, cures, "--vary", usual=not asked.vary)
        work = RunVariation(
            limited, candidates, folder.path, base.path, base, rerun, runs=folder.runs
        )
        varied = run_kept(work, jobs=asked.jobs, ray=asked.ray, progress=asked.progress)
    result = _trust(asked.target, work, varied)
    if any(outputs):
        write_outputs(result, *outputs, dark=asked.dark, force=asked.force)
    return result


@dataclass(frozen=True)
class OwnRun:
    """The unchanged run of a script, with the data needed to run it again."""

    seen: Seen
    program: Program
    again: Again

    def possible(self) -> list[Change]:
        """Return the single changes that are possible in the unchanged run."""
        return possible(self.program, self.again, self.seen.engine.partition(" ")[0])


def candidates_of(
    known: OwnRun, asked: Sequence[Cure], option: str, *, usual: bool
) -> list[Candidate]:
    """Return the requested changes, applied to the whole run, if the engine supports them.

    Parameters
    ----------
    known
        The script's unchanged run.
    asked
        The requested interventions.
    option
        The command-line option with which they were requested, for error messages.
    usual
        Whether interventions for other engines, and those that the model already has, are silently
        left out.

    Raises
    ------
    ScenarioError
        If the engine does not support an intervention.
    """
    engine, settings = known.seen.engine, known.seen.settings[-1].values
    proposals = Proposals(known.seen, [], engine_cures(engine), known.possible)
    found = []
    for cure in asked:
        candidate, name = proposals.whole(cure), cure.given.get("name")
        if not usual:
            proposals.required(cure, option)
        has_it = usual and engine != PYBULLET and name and settings.get(name) == cure.value
        if candidate.run is not None and not has_it:
            found.append(candidate)
    return found


def _trust(target: str, work: RunVariation, varied: Sequence[Varied]) -> Trust:
    from drop_physics.experiments.robustness import converging, geometric, growth, standing
    from drop_physics.stages.trust.findings import findings_of

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
    """Parse the largest distances by unit, m or rad, from a text such as `1mm` or `1mm,0.5deg`.

    Raises
    ------
    ScenarioError
        If the text has another form.
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
