"""Finds the flights of a body, and compares each with free fall from its start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.results import BodyFlight, FlightSample
from drop_physics.arrays import Flags, Float64
from drop_physics.explain.alone import law_of, motion_of
from drop_physics.explain.decomposition import error_and_terms
from drop_physics.explain.step_status import FLIGHT, SET, UNEXPLAINED, SampleStatus
from drop_physics.explain.steps import Steps
from drop_physics.explain.times import StepTimes
from drop_physics.physics.base import Law, Motion


@dataclass(eq=False)
class _OpenFlight:
    """A flight that may continue."""

    law: Law
    start: Motion
    """Motion at the first row."""
    first_step: int
    last_step: int
    position_m: Float64
    """The position at the last sample [m], shape (3,)."""
    held: bool = False
    """Whether a velocity was clamped."""
    samples: int = 0
    """The number of the flight's samples, without an initial state that a call set."""
    asked: dict[int, tuple[Float64, bool]] = field(default_factory=dict)
    """Position at each requested step [m], and whether a velocity was clamped until then."""


class Flights:
    """The flights of one single-link body; filled chunk by chunk."""

    def __init__(self, times: StepTimes, asked_steps: Sequence[int]) -> None:
        self._times, self._asked = times, np.array(sorted(asked_steps), np.int64)
        self._open: _OpenFlight | None = None
        self._done: list[BodyFlight] = []

    def add(self, judged: SampleStatus) -> dict[int, Float64]:
        """Add a chunk; return the distance of flight samples from free fall [m], by row."""
        errors_m: dict[int, Float64] = {}
        for steps in judged.intervals:
            if steps.law.tree.links or steps.law.tree.fixed:
                continue
            rows = np.searchsorted(judged.steps, steps.steps)
            falls = (judged.kind[rows] == FLIGHT) & (judged.segment[rows] != UNEXPLAINED)
            for first, end in _runs(falls, _breaks(steps)) if falls.any() else ():
                part = slice(first, end)
                counted = int((judged.segment[rows[part]] != SET).sum())
                self._take(steps, first, end, counted)
                errors_m |= self._errors(steps, rows, first, end)
        return errors_m

    def all(self) -> list[BodyFlight]:
        """Return all flights, once all chunks have been added."""
        self._close()
        return self._done

    def _take(self, steps: Steps, first: int, end: int, counted: int) -> None:
        """Add consecutive steps in free flight."""
        reported, before = steps.reported, motion_of(steps.before)
        law = law_of(steps.config, float(reported.timestep_s[first]), reported.gravity_m_s2[first])
        assert law is not None  # it was explained
        begin, run = int(steps.steps[first]) - 1, self._open
        goes_on = run is not None and run.last_step == begin and run.law == law
        if run is None or not goes_on or steps.put[first]:
            self._close()
            start = before.at(slice(first, first + 1))
            run = self._open = _OpenFlight(law, start, begin, begin, start.position_m[0])
        run.last_step = int(steps.steps[end - 1])
        run.position_m = steps.after.position_m[end - 1]
        held = np.logical_or.accumulate(law.limited(before.at(slice(first, end)))) | run.held
        run.held, run.samples = bool(held[-1]), run.samples + counted
        for step in self._asked[(self._asked > begin) & (self._asked <= run.last_step)].tolist():
            row = step - begin - 1
            run.asked[step] = steps.after.position_m[first + row], bool(held[row])

    def _errors(
        self, steps: Steps, rows: NDArray[np.intp], first: int, end: int
    ) -> dict[int, Float64]:
        run = self._open
        assert run is not None
        time_s = (steps.steps[first:end, None] - run.first_step) * run.law.timestep_s
        pull = np.array(run.law.gravity_m_s2) * time_s / 2
        free_fall_m = run.start.position_m + (run.start.velocity_m_s + pull) * time_s
        errors_m = steps.after.position_m[first:end] - free_fall_m
        return dict(zip(rows[first:end].tolist(), errors_m, strict=True))

    def _close(self) -> None:
        run, self._open = self._open, None
        if run is None or not run.samples:
            return
        last = self._moment(run, run.last_step, run.position_m, held=run.held)
        self._done.append(
            BodyFlight(
                first_step=run.first_step,
                last_step=run.last_step,
                start_s=self._times.of(run.first_step),
                end_s=last.time_s,
                error_m=last.error_m,
                terms_m=last.terms_m,
                at=[
                    self._moment(run, step, position_m, held=held)
                    for step, (position_m, held) in run.asked.items()
                ],
            )
        )

    def _moment(
        self, run: _OpenFlight, step: int, position_m: Float64, *, held: bool
    ) -> FlightSample:
        steps = step - run.first_step
        error_m, terms_m = error_and_terms(run.start, position_m, run.law, steps=steps)
        return FlightSample(step, self._times.of(step), error_m, None if held else terms_m)


def _breaks(steps: Steps) -> Flags:
    """Flag the steps that begin a new flight: after a call set the state, or under another law."""
    reported = steps.reported
    breaks = steps.put.copy()
    breaks[1:] |= (np.diff(steps.steps) != 1) | (np.diff(reported.timestep_s) != 0)
    breaks[1:] |= (np.diff(reported.gravity_m_s2, axis=0) != 0).any(axis=1)
    return breaks


def _runs(held: Flags, breaks: Flags) -> list[tuple[int, int]]:
    """Return first row and end (exclusive) of each run of true values; a break starts a new run."""
    before = np.concatenate(([False], held[:-1]))
    after = np.concatenate((held[1:], [False]))
    ends = np.concatenate((breaks[1:], [True]))
    firsts, lasts = (
        np.flatnonzero(held & (~before | breaks)),
        np.flatnonzero(held & (~after | ends)),
    )
    return list(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True))
