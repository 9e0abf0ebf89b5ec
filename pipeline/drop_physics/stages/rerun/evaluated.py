"""Runs a script again only to check an expectation, without recording."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drop_physics.engines.cures import trial_of
from drop_physics.engines.interventions import Operation
from drop_physics.engines.script import Program
from drop_physics.engines.source import SOURCE
from drop_physics.engines.watching.expression import Expression
from drop_physics.engines.watching.single_changes import Change
from drop_physics.experiments.motion import motion_of
from drop_physics.experiments.search import BranchedTrial, ChangeOutcome
from drop_physics.stages.rerun.reruns import Reruns
from drop_physics.stages.rerun.runs import RunsUnderWay
from drop_physics.sweeping.engines import in_threads
from drop_physics.trace.cures import NUDGE, ChangedRun

if TYPE_CHECKING:
    from drop_physics.engines.fork_server import Fork
    from drop_physics.engines.script import Script
    from drop_physics.recording.reader import Recording

NUDGES = 5
"""Number of control runs whose bodies are moved by 1e-9 m before the first step: if one of them
meets the expectation, the outcome is chance."""
CONFIRMS = 2
"""Number of nudged runs in which a change must meet the expectation, if chance matters."""
FINISHED = "finished"

QUARTERS = 4
"""Number of parts of a run; changes are also tried from the beginning of each part."""

Answer = Mapping[str, Any]


def evaluator_of(text: str | None, **how: object) -> dict[str, Any]:
    """Return the settings with which a script's process checks an expectation.

    Parameters
    ----------
    text
        An expression; None for an `assert` of the script that fails.
    how
        Further arguments of `watching.expected.ExpectationEvaluator`.
    """
    return {
        "module": "expected",
        "name": "ExpectationEvaluator",
        "arguments": {"text": text, **how},
    }


def outcome_of(answer: Answer, *, ended_well: bool) -> ChangeOutcome:
    """Return whether a run met the expectation, from the evaluation in the script's process."""
    margin, value = answer["margin"], answer["value"]
    return ChangeOutcome(
        holds=bool(answer["holds"] and answer["finite"] and ended_well),
        margin=-math.inf if margin is None else margin,
        value=math.nan if value is None else value,
        motion=[motion_of(each) for each in answer["motion"]],
    )


def expression_is_of_end(program: Program) -> bool:
    """Return whether an expectation concerns only the end of a run."""
    text = None if program.evaluator is None else program.evaluator["arguments"]["text"]
    return text is not None and Expression(text).is_of_end


def _may_begin_later(change: Change) -> bool:
    """Return whether a change can start in the middle of a run."""
    is_start = change.change.startswith("start.") or change.how[0] == "/"
    return change.engine != SOURCE and not is_start


NOT_MADE = ChangeOutcome(holds=False, margin=-math.inf, value=math.nan)
"""Outcome of a run that was stopped or died, or that the engine had to reset."""


@dataclass
class EvaluatedRuns:
    """Runs a script again and again to check an expectation, without recording.

    Parameters
    ----------
    program
        The script with the settings for repeated runs.
    reruns
        Makes the runs of the unedited script.
    of_text
        Makes the runs with edited source text.
    ends
        Endings of a run for which its outcome counts.
    until
        Time after which no further run is started, in Unix time [s].
    jobs
        Number of simultaneous runs.
    """

    program: Program
    reruns: Reruns
    of_text: Reruns
    ends: frozenset[str]
    until: float
    jobs: int
    made: int = 0
    """Number of runs made so far."""
    runs: RunsUnderWay = field(default_factory=RunsUnderWay)

    def answered(
        self, run: ChangedRun, evaluator: Mapping[str, Any] | None = None
    ) -> tuple[Answer | None, str]:
        """Run the script with a change; return the checked expectation, and the ending."""
        program = self.program.changed_by(run)
        program = program if evaluator is None else replace(program, evaluator=evaluator)
        with self._begun(program) as process:
            self.runs.under_way.add(process)
            for _ in process.events():
                pass
            self.runs.under_way.discard(process)
            ended = process.ending().how
        self.made += 1
        answer, error = process.decoder.answer or (None, "")
        return answer, error or ended

    def _begun(self, program: Program) -> AbstractContextManager[Script | Fork]:
        return (self.of_text if program.edits else self.reruns).begun(program)

    def changed(self, change: Change) -> ChangeOutcome | None:
        """Return whether a run with a change meets the expectation; None if no time is left."""
        if time.time() > self.until:
            return None
        return self._outcome(trial_of(change))

    def nudged(self, number: int, change: Change | None = None) -> ChangeOutcome | None:
        """Return the outcome of a run from slightly displaced positions, with or without change."""
        if time.time() > self.until:
            return None
        nudge = ChangedRun(below={"nudge": NUDGE, "seed": number})
        return self._outcome(nudge if change is None else trial_of(change) + nudge)

    def _outcome(self, run: ChangedRun) -> ChangeOutcome:
        answer, ended = self.answered(run)
        if answer is None or not answer["finite"]:  # what it shows is no motion
            return NOT_MADE
        return outcome_of(answer, ended_well=ended in self.ends)

    def all_of(self, changes: Iterator[Change]) -> Iterable[tuple[Change, ChangeOutcome | None]]:
        """Run the script with each change, and yield the outcomes as they arrive."""
        return in_threads(self.changed, changes, jobs=self.jobs, stop=self.runs.stop)

    def nudges(self, change: Change | None = None, number: int = NUDGES) -> list[ChangeOutcome]:
        """Return the outcomes of several runs from slightly displaced positions."""
        work = partial(self.nudged, change=change)
        made = in_threads(work, range(number), jobs=self.jobs, stop=self.runs.stop)
        return [outcome for _, outcome in made if outcome is not None]

    def recorded(
        self, change: Change, path: Path, own: Recording, name: str, *, drawn: bool
    ) -> None:
        """Run the script with a change once more, and record the run.

        Parameters
        ----------
        change
            The change to make.
        path, name
            The recording to write, and the name of the run in it.
        own
            The recording of the script's own run.
        drawn
            Whether to record also the data that only the viewer needs.
        """
        program = self.program.changed_by(trial_of(change))
        program = replace(program, streams=True, evaluator=None)
        with self._begun(program) as process:
            self.runs.varied(process, path, own, name, drawn=drawn)

    def latest_of(
        self, changes: Sequence[Change], steps: int, besides: Iterable[int] = ()
    ) -> list[int | None]:
        """Return for each change how late in the run it may begin and still help.

        The latest step is None if the change must begin with the run, or cannot begin later.

        Parameters
        ----------
        changes
            Changes that meet the expectation if they begin with the run.
        steps
            Number of steps of the script's own run; changes are tried from each quarter on.
        besides
            Further steps at which changes are tried.
        """
        latest: list[int | None] = [None for _ in changes]
        going = [n for n, each in enumerate(changes) if _may_begin_later(each)]
        tried_at = {steps * part // QUARTERS for part in range(1, QUARTERS)} | {*besides}
        starts = sorted(tried_at - {0})
        if not going or not starts or not expression_is_of_end(self.program):
            return latest
        with Reruns(self.program, self.reruns.again, at=starts[0]) as reruns:
            trials = replace(self, reruns=reruns, made=0)
            for step in starts:
                if not going or not (step == starts[0] or reruns.go_on(step)) or not reruns.parts:
                    break
                tried = [(n, trials.changed(changes[n])) for n in going]
                going = [n for n, outcome in tried if outcome is not None and outcome.holds]
                latest = [step if n in going else each for n, each in enumerate(latest)]
        self.made += trials.made
        return latest

    def branched_of(
        self, changes: Sequence[Change], first: int, last: int, played: Sequence[Operation]
    ) -> list[BranchedTrial]:
        """Try changes on the last steps of a failed episode, in an open and in a closed loop.

        The runs branch off from the script's own run after `first` steps. In an open loop, the
        recorded commands replace those of the script from there on, so that no controller reacts to
        the change; in a closed loop the script's controller does. Of the environments' episodes
        only the failed one counts. The runs are short, and are made even if the time is up.

        Parameters
        ----------
        changes
            Changes that meet the expectation if they begin with the run.
        first, last
            The steps after which the recorded commands begin and end.
        played
            The operations that give the recorded commands.
        """
        asked = self.program.evaluator
        if asked is None or not expression_is_of_end(self.program):
            return [BranchedTrial() for _ in changes]
        evaluator = evaluator_of(**{**asked["arguments"], "of_running": True})
        program = replace(self.program, evaluator=evaluator)
        with Reruns(program, self.reruns.again, at=first) as reruns:
            if not reruns.parts:
                return [BranchedTrial() for _ in changes]
            closed = replace(self, program=program, reruns=reruns, made=0)
            # One step more, so that the environment can return that its episode ends with the last.
            open_ = replace(closed, program=replace(program, steps=last + 1))
            commands = ChangedRun([*played])
            own, same = map(open_.answered, (ChangedRun(), commands))
            is_exact = bool(played) and own == same and own[0] is not None and not own[0]["holds"]
            found = []
            for change in changes:
                trial = BranchedTrial()
                if _may_begin_later(change):
                    run = trial_of(change)
                    played_too = open_.answered(commands + run) if is_exact else same
                    if played_too != same or not is_exact:  # else it came too late to act
                        holds = closed.holds(closed.answered(run))
                        trial = BranchedTrial(open_.holds(played_too) if is_exact else None, holds)
                found.append(trial)
        self.made += open_.made + closed.made
        return found

    def holds(self, answered: tuple[Answer | None, str]) -> bool | None:
        """Return whether a run met the expectation; None if its outcome does not count."""
        answer, ended = answered
        if answer is None or ended not in self.ends:
            return None
        return outcome_of(answer, ended_well=True).holds

    def stands(self, change: Change) -> bool:
        """Return whether a change also helps from slightly displaced positions."""
        return all(each.holds for each in self.nudges(change, CONFIRMS))
