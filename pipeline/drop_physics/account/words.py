"""Formats times, windows and terms for the account's rows."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from drop_physics.account.ledger import OWN
from drop_physics.account.names import Names
from drop_physics.account.rows import RowTerm
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import DRAG, Term
from drop_physics.arrays import Float64, Int64
from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message
from drop_physics.quantities import number, rounded_off
from drop_physics.trace.events import Body
from drop_physics.trace.readings import Answer

MOST_TERMS = 6
"""Maximum number of terms in a row."""
SMALL = 1e-3
"""Terms below this share of a value displayed beside them are omitted."""
STEADY = 0.1
"""Largest spread of forces over a window, as a share of the largest force, at which they count as
steady."""
LEAST_SHARE = 0.05
"""Terms below this share of the largest are omitted."""


class RowWords:
    """Data for the wording of rows: names, times and script lines of a recording."""

    def __init__(self, names: Names, times: Mapping[int, StepTimes]) -> None:
        self.names, self._times = names, times

    def seconds(self, body: Body, step: int) -> float:
        """Return the time of a sample of a body [s]."""
        return self._times[body.client].of(step)

    def time(self, subject: MeasuredBody, step: int) -> Message:
        """Format the simulated time of a sample for a reader."""
        return Message("{time} s", time=number(self.seconds(subject.body, step)))

    def timesteps_s(self, subject: MeasuredBody, steps: Int64) -> Float64:
        """Return the timestep of the steps that lead to the given samples [s], shape (n,)."""
        return self._times[subject.body.client].of_steps(steps)[0]

    def around(self, subject: MeasuredBody, step: int, steps: int) -> slice:
        """Return the window of ledger bins within 1 % of the recording around a sample."""
        half = max(2, steps // 100)
        return subject.ledger.window(step - half, step + half)

    def mean(self, subject: MeasuredBody, rate: int, window: slice) -> Message:
        """Describe the steps of a window of ledger bins over which forces on a rate are averaged.

        Empty if the forces are steady, so that the mean is the force in each of these steps.
        """
        ledger = subject.ledger
        bins = np.flatnonzero(ledger.seconds[window]) + window.start
        forces = [each[bins, rate] / ledger.seconds[bins] for each in ledger.impulse.values()]
        largest = max((float(np.abs(each).max(initial=0.0)) for each in forces), default=0.0)
        if all(np.ptp(each) <= STEADY * largest for each in forces if len(each)):
            return Message("")
        last = min(ledger.first + window.stop * ledger.width - 1, ledger.last)
        return Message(
            "on average from {start} to {end}",
            start=self.time(subject, ledger.first + window.start * ledger.width),
            end=self.time(subject, last),
        )

    def drives(self, term: Term, drives: Collection[str]) -> bool:
        """Return whether a term comes from a joint's own command, such as a motor."""
        return term.cause in drives or term.cause.startswith("actuator ")

    def opposing(self, forces: Mapping[Term, float]) -> object:
        """Return the strongest term against a motion, as a key to group similar rows."""
        against = {t: f for t, f in forces.items() if f < 0 and t != OWN}
        if not against:
            return None
        most = min(against, key=lambda term: against[term])
        return most.cause

    def terms(
        self,
        subject: MeasuredBody,
        values: Mapping[Term, float],
        unit: str,
        drives: Collection[str] = (),
        beside: float = 0.0,
    ) -> tuple[RowTerm, ...]:
        """Return the terms that a row lists: drives first, then the largest others.

        Terms that are small compared with the largest one, or with the value `beside`, are left
        out, as are those that are rounding error beside the body's weight, or that times its size.
        """
        whole = subject.weight_n * (1.0 if unit == "N" else subject.size_m)
        told = {
            term: value
            for term, value in values.items()
            if term != OWN and rounded_off(value, whole)
        }
        most = max(map(abs, told.values()), default=0.0)
        most = max(most, SMALL / LEAST_SHARE * beside)
        ranked = sorted(
            (term for term, value in told.items() if abs(value) > LEAST_SHARE * most),
            key=lambda term: (not self.drives(term, drives), -abs(told[term])),
        )
        return tuple(self._told(subject, term, told[term], unit) for term in ranked[:MOST_TERMS])

    def _told(self, subject: MeasuredBody, term: Term, value: float, unit: str) -> RowTerm:
        body = link = None
        if term.other is not None:
            body = str(self.names.body(term.other))
            at = -1 if term.other_link is None else term.other_link
            link = str(self.names.link(term.other, at))
        elif term.cause == DRAG and term.rate is not None:
            first = subject.tree.first_rate
            link = self.names.rate(subject.body, term.rate - first) if term.rate >= first else None
        return RowTerm(
            cause=term.cause,
            words=self.names.term(subject.body, term, subject.tree.first_rate),
            body=body,
            link=link,
            value=value,
            unit=unit,
            towards=value > 0,
        )


def answered_range(answer: Answer) -> Message:
    """Format the least and greatest value that a script read; empty if they are equal."""
    if answer.greatest - answer.least <= 1e-3 * max(abs(answer.greatest), abs(answer.least)):
        return Message("")
    return Message(
        " (from {least} to {greatest})",
        least=number(answer.least),
        greatest=number(answer.greatest),
    )
