"""Makes the trial runs of `drop why`, one per change, and measures their effects."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drop_physics.experiments.verdicts import Outcome
from drop_physics.stages.rerun.changed import RunChanged
from drop_physics.stages.rerun.proposals import Candidate
from drop_physics.stages.rerun.runs import Ended
from drop_physics.trace.cures import NUDGED, ChangedRun

if TYPE_CHECKING:
    from drop_physics.experiments.run_distance import Distance
    from drop_physics.recording.reader import Recording
    from drop_physics.rules.answer import Finding


@dataclass(frozen=True)
class TrialRun:
    """Result of a trial; all fields are None if it was not run, or was stopped."""

    outcome: Outcome | None
    recording: Path | None
    stopped: bool = False
    """Whether the trial was stopped because it took too long."""


@dataclass(frozen=True)
class RunTrial(RunChanged[TrialRun]):
    """Makes numbered trial runs of a script.

    The nudge and an unchanged run follow the last candidate.
    """

    until: float = np.inf
    """End of the time budget, in Unix time [s]."""
    took_s: list[float] = field(default_factory=list)
    """Durations of the trials made so far [s]."""

    @property
    def nudge(self) -> int:
        """Number of the run from slightly displaced positions."""
        return len(self.candidates)

    @property
    def unchanged(self) -> int:
        """Number of the unchanged run."""
        return len(self.candidates) + 1

    def __call__(self, number: int) -> TrialRun:
        """Make a trial run, and note how long it took."""
        began = time.monotonic()
        made = super().__call__(number)
        if made.outcome is not None:
            self.took_s.append(time.monotonic() - began)
        return made

    @property
    def ends_by(self) -> float:
        """End of the time budget, in Unix time [s]."""
        return self.until

    def is_late(self, number: int) -> bool:
        """Return whether too little time is left to start a trial."""
        del number
        return time.time() + max(self.took_s, default=0.0) > self.until

    def run_of(self, number: int) -> ChangedRun | None:
        """Return the changes of a trial; None if the engine does not support them."""
        others = {self.nudge: NUDGED, self.unchanged: ChangedRun()}
        return others[number] if number in others else self.candidates[number].run

    def not_made(self, number: int) -> TrialRun:
        """Return the result for a trial that was not run, or was stopped."""
        del number
        return TrialRun(None, None)

    def has_failed(self, made: TrialRun) -> bool:
        """Return whether a trial's run failed by itself, rather than being stopped by `drop`."""
        return made.outcome is not None and made.outcome.ended == "failed"

    def name_of(self, number: int) -> str:
        """Return the name of a trial."""
        if number >= self.nudge:
            return "nudge" if number == self.nudge else "unchanged"
        each = self.candidates[number].intervention
        return f"{number + 1}-{each.name}" + ("" if each.value is None else f"={each.value:g}")

    def made(self, number: int, ended: Ended) -> TrialRun:
        """Return a trial's result, from its recording."""
        from drop_physics.experiments.run_distance import apart
        from drop_physics.recording.reader import read

        path, base, finer = self.path_of(number), self.own, self.finer(number)
        if ended.how == "interrupted":
            path.unlink(missing_ok=True)
            return TrialRun(None, None, stopped=time.time() < self.until)
        other = read(path)
        with np.errstate(all="ignore"):  # of states that are not finite
            far = apart(base.seen, other.seen, finer=finer)
        findings = self._findings(number, other)
        steps = sum(samples - 1 for samples in other.seen.samples.values()) // finer
        run = self.run_of(number)
        fired = bool(ended.intervened or (run is not None and (run.below or run.edits)))
        error = str((other.ended or {}).get("error") or "")
        began = _began(base, other)
        return TrialRun(Outcome(fired, ended.how, error, steps, findings, far, began), path)

    def _findings(self, number: int, other: Recording) -> list[Finding]:
        """Return the findings in a trial run, with the labels of the unchanged run.

        Bodies have the labels that they have in the script's own run.
        """
        from drop_physics.analysis.story import Story
        from drop_physics.experiments.run_distance import paired
        from drop_physics.stages.analyze.explaining import explained

        if number == self.unchanged:
            return []
        if number != self.nudge and not self.candidates[number].findings:
            return []
        base, there = self.own.seen, other.seen.bodies
        names: dict[str | None, str] = {
            there[twin].label: base.bodies[number].label
            for number, twin in paired(base, other.seen).items()
        }
        return [
            replace(
                each,
                body=names.get(each.body, each.body),
                other=names.get(each.other, each.other),
            )
            for each in Story(explained(other).recording.seen, other.origin_and_end)
            .analysis()
            .findings
        ]


def _began(base: Recording, other: Recording) -> Distance | None:
    """Return how far a body moves in a trial, if it rests in the unchanged run; else None.

    A body whose state calls set between steps does not count as at rest.
    """
    from drop_physics.experiments.run_distance import apart

    still = {number for number, body in base.seen.bodies.items() if not body.moving}
    still -= {put.body.number for put in base.seen.puts if put.at.step > 0}
    there = other.seen.bodies
    moves = {number for number in still if number in there and there[number].moving}
    if not moves:
        return None
    tracks = (each for each in apart(other.seen, other.seen).tracks if each.number in moves)
    ways = (each.distance(each.moved, each.end_s) for each in tracks if each.moved)
    return max(ways, key=lambda each: each.value, default=None)


def first_tried(candidates: Sequence[Candidate]) -> Iterator[int]:
    """Yield the numbers of candidates in the order to try: the first of each finding first.

    First proposals of all findings come before any second one.
    """
    turns: dict[int, int] = {}
    keys = []
    for which, candidate in enumerate(candidates):
        turn = min((turns.get(place, 0) for place in candidate.findings), default=1)
        for place in candidate.findings:
            turns[place] = turns.get(place, 0) + 1
        keys.append((turn, which))
    yield from (which for _, which in sorted(keys))
