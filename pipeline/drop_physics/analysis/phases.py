"""Finds when a body was in contact, and which bodies pushed it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from drop_physics.analysis.results import BodyContact, Pusher
from drop_physics.arrays import Float64, Int64
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.step_status import CONTACT, StepVerdicts
from drop_physics.explain.steps import StepBatch, Steps
from drop_physics.explain.times import StepTimes
from drop_physics.explain.touching import Sides
from drop_physics.physics.vectors import lengths, summed, triple
from drop_physics.trace.events import Body


@dataclass(eq=False)
class ContactRun:
    """Consecutive steps of a body, all in contact."""

    first_step: int
    last_step: int
    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    largest_force_n: float = 0.0
    energy_j: float = 0.0
    most_given_j: float = 0.0
    """The largest energy that contact gave in one step [J], and the first step in which it did."""
    most_given_step: int | None = None
    by: dict[tuple[int, int], tuple[Float64, float]] = field(default_factory=dict)
    """Impulse [N s] and energy [J] given by other bodies, by body id and link."""

    def add(self, run: ContactRun) -> None:
        """Append a run that directly follows this one."""
        self.last_step = run.last_step
        self.impulse_n_s = self.impulse_n_s + run.impulse_n_s
        self.largest_force_n = max(self.largest_force_n, run.largest_force_n)
        self.energy_j += run.energy_j
        if run.most_given_j > self.most_given_j:
            self.most_given_j, self.most_given_step = run.most_given_j, run.most_given_step
        for key, (given, energy_j) in run.by.items():
            impulse, energy = self.by.get(key, (np.zeros(3), 0.0))
            self.by[key] = impulse + given, energy + energy_j


def runs_of(explained: ExplainedPiece) -> dict[int, list[ContactRun]]:
    """Return the runs of steps in contact of each body in a chunk, in order, by body id."""
    found: dict[int, list[ContactRun]] = {}
    for batch, verdict in explained.batches:
        for number, run in _runs(batch, verdict):
            found.setdefault(number, []).append(run)
    for runs in found.values():
        runs.sort(key=lambda run: run.first_step)
    return found


def _runs(batch: StepBatch, verdict: StepVerdicts) -> Iterator[tuple[int, ContactRun]]:
    """Yield the runs of steps in contact in a batch, with the body id."""
    steps = batch.whole
    touched = verdict.segment == CONTACT
    rows = np.flatnonzero(touched)
    if not len(rows):
        return
    new = np.ones(len(rows), np.bool_)
    body, step = batch.body[rows], steps.steps[rows]
    new[1:] = (np.diff(body) != 0) | (np.diff(step) != 1) | (np.diff(rows) != 1)
    starts, contacts = np.flatnonzero(new), steps.reported.contacts
    run = np.full(len(steps), -1)
    run[rows] = np.cumsum(new) - 1
    points = np.flatnonzero(touched[contacts.step])
    at = contacts.step[points]
    impulses = contacts.force_n[points] * steps.reported.timestep_s[at, None]
    point_j = steps.point_energy_j[points]
    per_step = summed(at, impulses, count=len(steps))[rows]
    given_j = np.bincount(at, point_j, minlength=len(steps))[rows]
    sizes_n = lengths(per_step) / steps.reported.timestep_s[rows]
    ends = np.append(starts[1:], len(rows))
    most = [
        first + int(np.argmax(given_j[first:end]))
        for first, end in pairwise([*starts.tolist(), len(rows)])
    ]
    by = _by_other(run[at], steps.sides.at(points), impulses, point_j)
    impulse_n_s = np.add.reduceat(per_step, starts, axis=0)
    largest_n = np.maximum.reduceat(sizes_n, starts)
    energy_j = np.add.reduceat(given_j, starts)
    for row, (first, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        yield (
            int(body[first]),
            ContactRun(
                first_step=int(step[first]),
                last_step=int(step[end - 1]),
                impulse_n_s=impulse_n_s[row],
                largest_force_n=float(largest_n[row]),
                energy_j=float(energy_j[row]),
                most_given_j=float(given_j[most[row]]),
                most_given_step=int(step[most[row]]),
                by=by.get(row, {}),
            ),
        )


def _by_other(
    run: Int64, sides: Sides, impulses: Float64, point_j: Float64
) -> dict[int, dict[tuple[int, int], tuple[Float64, float]]]:
    """Return impulse [N s] and energy [J] given by each link of other bodies, for each run."""
    found: dict[int, dict[tuple[int, int], tuple[Float64, float]]] = {}
    if not len(run):
        return found
    order = np.lexsort((sides.other_link, sides.other_body, run))
    keys = np.stack((run, sides.other_body, sides.other_link))[:, order]
    starts = np.flatnonzero(np.append(True, (np.diff(keys, axis=1) != 0).any(axis=0)))
    impulse = np.add.reduceat(impulses[order], starts, axis=0)
    energy = np.add.reduceat(point_j[order], starts)
    for number, (which, body, link) in enumerate(keys[:, starts].T.tolist()):
        found.setdefault(which, {})[body, link] = impulse[number], float(energy[number])
    return found


def pushers_in(steps: Steps, row: int) -> dict[tuple[int, int], tuple[Float64, float]]:
    """Return impulse [N s] and energy [J] given by each link of each other body in one step."""
    contacts = steps.reported.contacts
    points = np.flatnonzero(contacts.step == row)
    impulses = contacts.force_n[points] * steps.reported.timestep_s[row]
    at = np.zeros(len(points), np.int64)
    by = _by_other(at, steps.sides.at(points), impulses, steps.point_energy_j[points])
    return by.get(0, {})


class BodyContacts:
    """The contact phases of one body; filled chunk by chunk."""

    def __init__(self, times: StepTimes, bodies: Mapping[int, Body]) -> None:
        self._times, self._bodies = times, bodies
        self._open: ContactRun | None = None
        self._done: list[BodyContact] = []

    def add(self, runs: Sequence[ContactRun]) -> None:
        """Add the contacts of a chunk."""
        for run in runs:
            contact = self._open
            if contact is None or contact.last_step + 1 != run.first_step:
                self._close()
                contact = self._open = ContactRun(run.first_step, 0)
            contact.add(run)

    def all(self) -> list[BodyContact]:
        """Return all contacts, once all chunks have been added."""
        self._close()
        return self._done

    def _close(self) -> None:
        run, self._open = self._open, None
        if run is None:
            return
        by = pushers(run.by, self._bodies)
        self._done.append(
            BodyContact(
                run.first_step,
                run.last_step,
                self._times.of(run.first_step),
                self._times.of(run.last_step),
                triple(run.impulse_n_s),
                run.largest_force_n,
                run.energy_j,
                run.most_given_j,
                run.most_given_step,
                by,
            )
        )


def pushers(
    by: Mapping[tuple[int, int], tuple[Float64, float]], bodies: Mapping[int, Body]
) -> list[Pusher]:
    """Return the links that pushed a body, ordered by body id."""
    return [
        Pusher(
            bodies[body].label if body in bodies else str(body),
            body,
            link,
            triple(impulse),
            energy_j,
        )
        for (body, link), (impulse, energy_j) in sorted(by.items())
    ]
