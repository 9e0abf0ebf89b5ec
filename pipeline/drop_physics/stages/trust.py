"""Run a script again with variations, and tell what of its result stands."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.engines.pybullet.script import Program
from drop_physics.errors import DropError
from drop_physics.messages import Message
from drop_physics.printable import Printable
from drop_physics.stages.program import SEEDED_CLOCK_S, STOPPED, checked_limits
from drop_physics.stages.runs import Progress
from drop_physics.stages.trust_runs import (
    BASE,
    Made,
    RunVariation,
    TrustFolder,
    Varied,
    identity_of,
    made_of,
    run_varied,
)
from drop_physics.stages.variations import Variations, of_engine, variations_of

if TYPE_CHECKING:
    from drop_physics.experiments.robustness import Converging, Growth, Standing
    from drop_physics.rules.answer import Finding


@dataclass(frozen=True)
class Trust(Printable, reported_by="drop_physics.report.trust"):
    """What of a script's result stands."""

    script: str
    made: Made
    """Its own run."""
    variations: list[Varied]
    standing: list[Standing]
    """What stands of each position that matters, the least first."""
    growth: Growth | None
    """How the nudge grows; None where it does not, or was left out."""
    converging: list[Converging]
    """How each end position that depends on the timestep converges, where three were run."""
    findings: list[Finding]

    @property
    def recording(self) -> Path:
        """Return the recording of its own run."""
        return self.made.recording

    def ends_within(self, lengths: Mapping[str, float]) -> bool:
        """Return whether all variations end as near as that, by unit, and none fails."""
        if any(each.made.ended == "failed" != self.made.ended for each in self.variations):
            return False
        ends = [end for each in self.variations for end in each.apart.end]
        return all(end.value <= lengths[end.unit] for end in ends if end.unit in lengths)


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
    stdout: int = 1,
    table: Path | str | None = None,
    plot: Path | str | None = None,
    dark: bool = False,
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
    stdout
        File descriptor of the script's standard output, in its own run.
    table
        A `.csv` or `.parquet` file for all distances, a row per variation and position, or None.
    plot
        A `.png` or `.svg` file for a plot of the distances over time, or None.
    dark
        Whether the plot is for a dark page.
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
    variations = variations_of(vary)
    outputs = [None if each is None else Path(each) for each in (table, plot)]
    if any(outputs):
        from drop_physics.stages.trust_outputs import check_outputs, write_outputs

        check_outputs(target, *outputs, is_module=is_module, force=force)
    program = Program(
        target,
        tuple(map(str, arguments)),
        python or sys.executable,
        is_module,
        steps,
        duration_s,
        seed=seed,
        begins_s=SEEDED_CLOCK_S,
        explain=True,
    )
    place = Path("recordings") / f"{Path(target).stem}-trust" if out is None else Path(out)
    folder = TrustFolder(place.resolve(), identity_of(program), force)
    with folder.claimed((BASE, *variations)):
        work, base = _begun(program, variations, folder, usual=not vary, stdout=stdout)
        try:
            varied = run_varied(work, jobs=jobs, ray=ray, progress=progress)
        except BaseException as stop:
            stop.add_note(Message("run the same command again to resume it"))
            raise
    result = _trust(target, base, varied, work.variations)
    if any(outputs):
        write_outputs(result, *outputs, dark=dark, force=force)
    return result


def _begun(
    program: Program, variations: Variations, folder: TrustFolder, *, usual: bool, stdout: int
) -> tuple[RunVariation, Made]:
    """Run the script itself, and return what runs its variations, and what it was."""
    steps = folder.run(BASE, program, stdout=stdout)
    if not steps:
        raise DropError(
            "{script} makes no step, so there is nothing to compare; give it the arguments "
            "with which it steps",
            script=program.target,
        )
    from drop_physics.recording.reader import read  # while the script ran

    base = read(folder.recording(BASE))
    made = made_of(BASE, base)
    settings = base.seen.settings[-1].values
    variations = of_engine(variations, settings, engine=made.engine, usual=usual)
    limited = replace(program, steps=steps + (made.ended not in STOPPED), duration_s=None)
    return RunVariation(limited, variations, folder, base), made


def _trust(
    target: str,
    base: Made,
    varied: dict[str, Varied],
    variations: Mapping[str, Mapping[str, Any]],
) -> Trust:
    from drop_physics.experiments.robustness import converging, geometric, growth, standing
    from drop_physics.stages.trust_findings import findings_of

    for name, given in variations.items():
        if given == {"draws": None} and varied[name].apart.same:  # it draws none
            del varied[name]
    nudge = next((name for name in varied if "nudge" in variations[name]), None)
    grown = nudge and growth(varied[nudge].apart, variations[nudge]["nudge"])
    finer = {
        variations[name].get("finer", 1): each
        for name, each in varied.items()
        if "finer" in variations[name]
    }
    three = geometric([*finer])
    found = []
    if three is not None:
        runs = [None if each == 1 else finer[each].apart for each in three]
        found = converging([1 / each for each in three], runs)
    stands = standing({name: each.apart for name, each in varied.items()})
    findings = findings_of(varied, grown or None, found, base)
    return Trust(target, base, [*varied.values()], stands, grown or None, found, findings)
