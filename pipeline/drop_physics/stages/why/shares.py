"""Computes how much each cause contributes, by runs with causes removed singly and together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drop_physics.experiments.interventions import Intervention
from drop_physics.experiments.shares import FINER, TIMESTEP, Shares, coordinate_of, shares_of
from drop_physics.experiments.verdicts import Outcome, judged, moved
from drop_physics.stages.rerun.proposals import Candidate
from drop_physics.stages.why.trials import RunTrial, TrialRun
from drop_physics.trace.cures import ChangedRun, Cure

if TYPE_CHECKING:
    from drop_physics.experiments.run_distance import Apart

MOST_CAUSES = 4
"""Most causes that are switched off together: those that move the outcome most."""

Done = dict[int, TrialRun]


def shares(
    work: RunTrial,
    done: Done,
    run: Callable[[RunTrial, Sequence[int]], Done],
    own: Outcome,
) -> Shares | None:
    """Return each cause's share of the outcome; None with fewer than two causes.

    Parameters
    ----------
    work, done
        The trials, and their results by trial number.
    run
        Function that makes runs, given trials and the numbers of those to run.
    own
        Outcome of the script's own run.
    """
    nudge = done[work.nudge].outcome
    if nudge is None:
        return None
    causes = _causes(work, done, own, nudge)
    alone = {_name(candidate, causes): _apart(done[n]) for n, candidate in causes}
    halved = (done[n].outcome for n, each in enumerate(work.candidates) if _is_halved(each))
    timed = next((each.apart for each in halved if each is not None), None)
    coordinate = coordinate_of(alone, {each.unit: each.value for each in nudge.apart.end})
    if coordinate is None or (len(alone) < 2 and timed is None):
        return None
    off = ChangedRun()
    for _, cause in causes:
        off += cause.run or ChangedRun()
    by = FINER if timed is not None else FINER[:1]
    tries = [_switched_off(off, finer) for finer in by]
    if timed is not None:
        tries.append(_switched_off(ChangedRun(), FINER[-1]))
    others = run(replace(work, candidates=tries), range(len(tries)))
    if any(each.outcome is None for each in others.values()):
        return None
    together = {finer: _apart(others[n]) for n, finer in enumerate(by)}
    finer = {} if timed is None else {2: timed, FINER[-1]: _apart(others[len(by)])}
    return shares_of(coordinate, alone, together, finer)


def _causes(
    work: RunTrial, done: Done, own: Outcome, nudge: Outcome
) -> list[tuple[int, Candidate]]:
    """Return the trials that remove a cause and change the outcome, largest effect first."""
    found = []
    for number, candidate in enumerate(work.candidates):
        outcome, what = done[number].outcome, candidate.intervention
        if outcome is None or not outcome.fired or not (candidate.findings or what.decides):
            continue
        verdicts = [
            judged(own.findings[place], outcome, base=own, nudge=nudge).verdict
            for place in candidate.findings
        ]
        far = moved(outcome.apart, nudge.apart)
        decides = "cured" in verdicts or (what.decides and "void" not in verdicts)
        if far is not None and decides and what.name != TIMESTEP:
            found.append((far.value, number, candidate))
    found.sort(key=lambda each: -each[0])
    return [(number, candidate) for _, number, candidate in found[:MOST_CAUSES]]


def _name(candidate: Candidate, causes: Sequence[tuple[int, Candidate]]) -> str:
    """Return a cause's name; if several share it, with the body or joint that it acts on."""
    what = candidate.intervention
    if what.name == "without":
        return what.short
    alike = sum(each.intervention.name == what.name for _, each in causes) > 1
    return f"{what.name} {what.target or what.short}" if alike else what.name


def _is_halved(candidate: Candidate) -> bool:
    run = candidate.run
    return run is not None and run.finer == 2 and not run.operations


def _apart(made: TrialRun) -> Apart:
    if made.outcome is None:
        raise LookupError
    return made.outcome.apart


def _switched_off(run: ChangedRun, finer: int) -> Candidate:
    what = Cure("shares", value=float(finer), call=f"all of it, timestep/{finer}")
    below = {name: value for name, value in run.below.items() if name != "finer"}
    return Candidate(
        Intervention(what),
        ChangedRun(run.operations, below | ({"finer": finer} if finer > 1 else {})),
    )
