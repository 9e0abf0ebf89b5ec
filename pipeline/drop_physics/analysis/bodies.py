"""Analyzes one body, chunk by chunk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drop_physics.analysis.flights import Flights
from drop_physics.analysis.phases import BodyContacts, ContactRun, pushers, pushers_in
from drop_physics.analysis.results import (
    BodyAnalysis,
    Energy,
    Explained,
    Momentum,
    StepSum,
    Unexplained,
)
from drop_physics.explain.body_history import BodyHistory
from drop_physics.explain.causes import Totals
from drop_physics.explain.rows import SampleRows, rows_of
from drop_physics.explain.step_status import SEGMENTS, SampleStatus
from drop_physics.explain.steps import Steps
from drop_physics.physics.laws.lookup import step_law
from drop_physics.physics.vectors import triple
from drop_physics.rules.answer import Scene
from drop_physics.trace.events import Body, order

KEPT = ("set", "integrator", "remainder")
"""Causes that are listed even if they caused no change."""


class BodyStory:
    """Collects the analysis of one body: `add` takes chunks, `result` returns the analysis.

    Parameters
    ----------
    scene
        Data of the whole run, beyond single chunks.
    body
        The analysed body.
    at_s
        Times [s] at which the errors of flights are broken down, in addition to the end of each
        flight.
    sums_at_s
        Times [s] whose steps are reported as sums.
    """

    def __init__(
        self, scene: Scene, body: Body, *, at_s: Sequence[float], sums_at_s: Sequence[float]
    ) -> None:
        self._scene, self._body = scene, body
        self._times = scene.times[body.client]
        self._is_replayed = step_law(scene.seen.engine) is None
        self._flights = Flights(self._times, self._nearest(at_s))
        self._phases = BodyContacts(self._times, scene.seen.bodies)
        self._sums_at = self._nearest(sums_at_s)
        self._sums: list[StepSum] = []

    def _nearest(self, times_s: Sequence[float]) -> list[int]:
        last = self._scene.seen.steps_of(self._body.client)
        steps = (self._times.nearest(time_s, 0, last) for time_s in times_s)
        return [step for step in steps if step is not None]

    def add(
        self,
        judged: SampleStatus,
        history: BodyHistory,
        touched: Sequence[ContactRun],
        *,
        detailed: bool,
    ) -> SampleRows:
        """Add a chunk with its runs of contact steps; return a table row for each sample."""
        # A flight's theory is the law of an engine that reports no sum of its own.
        errors_m = {} if self._is_replayed else self._flights.add(judged)
        self._phases.add(touched)
        for steps in judged.intervals if self._sums_at else ():
            self._sums += [
                _sum_of(
                    steps,
                    int(row),
                    judged,
                    self._times.of(int(steps.steps[row])),
                    self._scene.seen.bodies,
                )
                for row in np.flatnonzero(np.isin(steps.steps, self._sums_at))
            ]
        sampled = np.flatnonzero(history.sampled)
        rows = sampled[np.searchsorted(history.steps[sampled], judged.steps)]
        return rows_of(judged, history.base[rows, :3], errors_m, self._times, detailed=detailed)

    def explained(self, totals: Totals | None) -> Explained:
        """Return the explained share of the body."""
        if totals is None:
            return Explained(0, 0, 0.0, None, None)
        left = totals.unexplained
        why = min(left, key=lambda each: left[each].first_step, default=None)
        until_s = None if why is None else self._times.of(left[why].first_step)
        return Explained(totals.explained, totals.samples, totals.remainder, until_s, why)

    def result(self, totals: Totals | None) -> BodyAnalysis:
        """Return the motion of the body, once all chunks have been added."""
        body, scene = self._body, self._scene
        reported = [each for each in scene.seen.dynamics if each.body.number == body.number]
        return BodyAnalysis(
            name=body.name,
            label=body.label,
            id=body.number,
            soft=body.soft,
            links=list(body.links),
            mass_kg=float(np.sum(reported[-1].reported["mass_kg"])) if reported else 0.0,
            segments=self._segments(totals),
            flights=self._flights.all(),
            contacts=self._phases.all(),
            unexplained=_unexplained(totals),
            energy=_energy(totals, all_causes=not self._is_replayed),
            momentum=_momentum(totals, all_causes=not self._is_replayed)
            if body.base_moves
            else None,
            joints=[],
            actuators=scene.actuators.rows(body, scene.seen),
            touches=[],
            at=self._sums,
        )

    def _segments(self, totals: Totals | None) -> dict[str, int]:
        counts: dict[str, int] = dict.fromkeys(SEGMENTS, 0)
        samples = self._scene.seen.samples.get(self._body.client, 1)
        if totals is not None:
            counts |= zip(SEGMENTS, totals.segments.tolist(), strict=True)
            if samples <= 1:  # nothing was ever stepped
                counts["still"], counts["set"] = counts["set"], 0
        elif not self._body.soft:
            there, moves = self._there(samples - 1), self._moves(samples - 1)
            counts["set"] = min(there, moves)
            counts["still"] = there - counts["set"]
        return counts

    def _there(self, last: int) -> int:
        """Return for how many samples a body existed, if it has no samples of its own."""
        there = 0
        mine = [
            appearance
            for appearance in self._scene.seen.appearances
            if appearance.body.number == self._body.number
        ]
        went = [each for each in mine if not each.there]
        for came in (each for each in mine if each.came):
            ends = [each.at.step for each in went if order(each.at) > order(came.at)]
            # A body removed at step 0 is gone before the first sample.
            end = min([last, *(step or -1 for step in ends)])
            there += max(0, end - came.at.step - came.sampled + 1)
        return there

    def _moves(self, last: int) -> int:
        """Return the number of steps before which calls moved the body."""
        came = {
            order(appearance.at)
            for appearance in self._scene.seen.appearances
            if appearance.came and appearance.body.number == self._body.number
        }
        return len(
            {
                put.at.step
                for put in self._scene.seen.puts
                if put.body.number == self._body.number
                and order(put.at) not in came
                and put.at.step < last
            }
        )


def _sum_of(
    steps: Steps, row: int, judged: SampleStatus, time_s: float, bodies: Mapping[int, Body]
) -> StepSum:
    at = int(np.searchsorted(judged.steps, steps.steps[row]))
    terms = {name: term[row].tolist() for name, term in steps.terms.items()}
    return StepSum(
        step=int(steps.steps[row]),
        time_s=time_s,
        segment=SEGMENTS[judged.segment[at]],
        terms=terms or None,
        remainder=steps.remainder[row].tolist() if terms else None,
        contact_by=pushers(pushers_in(steps, row), bodies),
    )


def _unexplained(totals: Totals | None) -> list[Unexplained]:
    if totals is None:
        return []
    return [
        Unexplained(why, left.samples, left.first_step, left.remainder)
        for why, left in totals.unexplained.items()
    ]


def _energy(totals: Totals | None, *, all_causes: bool) -> Energy | None:
    if totals is None or not totals.covered:
        return None
    causes = {
        name: value
        for name, value in totals.energy_j.items()
        if value or all_causes or name in KEPT
    }
    return Energy(totals.start_j, totals.end_j, causes)


def _momentum(totals: Totals | None, *, all_causes: bool) -> Momentum | None:
    if totals is None or not totals.covered:
        return None
    causes = {
        name: triple(each)
        for name, each in totals.momentum_kg_m_s.items()
        if each.any() or all_causes or name in KEPT
    }
    return Momentum(triple(totals.start_kg_m_s), triple(totals.end_kg_m_s), causes)
