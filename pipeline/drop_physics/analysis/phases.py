"""The contacts of a body: consecutive samples that contact led to, and who pushed it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.results import BodyContact, Pusher
from drop_physics.explain.step_status import CONTACT, Judged
from drop_physics.explain.steps import Steps
from drop_physics.explain.times import Times
from drop_physics.physics.vectors import lengths, summed, triple
from drop_physics.trace.events import Body

Float64 = NDArray[np.float64]


@dataclass(eq=False)
class _Open:
    """A contact that may go on."""

    first_step: int
    last_step: int
    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    largest_force_n: float = 0.0
    energy_j: float = 0.0
    most_given_j: float = 0.0
    most_given_step: int | None = None
    by: dict[tuple[int, int], tuple[Float64, float]] = field(default_factory=dict)
    """Impulse and energy of each link of each other body."""


class Phases:
    """The contacts of one body; grow piece by piece."""

    def __init__(self, times: Times, bodies: Mapping[int, Body]) -> None:
        self._times, self._bodies = times, bodies
        self._open: _Open | None = None
        self._done: list[BodyContact] = []

    def add(self, judged: Judged) -> None:
        """Take a piece."""
        for steps in judged.stretches:
            touched = judged.segment[np.searchsorted(judged.steps, steps.steps)] == CONTACT
            gaps = np.flatnonzero(np.diff(steps.steps) != 1) + 1
            for part in np.split(np.arange(len(steps)), gaps):
                held = touched[part]
                edges = np.flatnonzero(np.diff(np.concatenate(([False], held, [False]))))
                for first, end in edges.reshape(-1, 2).tolist():
                    self._take(steps, int(part[first]), int(part[0]) + end)

    def all(self) -> list[BodyContact]:
        """Return all contacts, after the last piece."""
        self._close()
        return self._done

    def _take(self, steps: Steps, first: int, end: int) -> None:
        """Add steps in contact."""
        run, contacts = self._open, steps.reported.contacts
        if run is None or run.last_step + 1 != steps.steps[first]:
            self._close()
            run = self._open = _Open(int(steps.steps[first]), 0)
        run.last_step = int(steps.steps[end - 1])
        points = slice(*np.searchsorted(contacts.step, [first, end]))
        step = contacts.step[points] - first
        impulses = contacts.force_n[points] * steps.reported.timestep_s[contacts.step[points], None]
        per_step = summed(step, impulses, count=end - first)
        sizes_n = lengths(per_step) / steps.reported.timestep_s[first:end]
        point_j = steps.point_energy_j[points]
        given_j = summed(step, point_j[:, None], count=end - first)[:, 0]
        most = int(np.argmax(given_j))
        run.impulse_n_s = run.impulse_n_s + per_step.sum(axis=0)
        run.largest_force_n = max(run.largest_force_n, float(sizes_n.max()))
        run.energy_j += float(given_j.sum())
        if given_j[most] > run.most_given_j:
            run.most_given_j = float(given_j[most])
            run.most_given_step = int(steps.steps[first + most])
        bodies, links = steps.sides.other_body[points], steps.sides.other_link[points]
        firsts = np.unique(np.column_stack((bodies, links)).view("V16"), return_index=True)[1]
        for body, link in zip(bodies[firsts].tolist(), links[firsts].tolist(), strict=True):
            its = (bodies == body) & (links == link)
            impulse, energy = run.by.get((body, link), (np.zeros(3), 0.0))
            run.by[body, link] = (
                impulse + impulses[its].sum(axis=0),
                energy + float(point_j[its].sum()),
            )

    def _close(self) -> None:
        run, self._open = self._open, None
        if run is None:
            return
        by = [
            Pusher(self._label(body), body, link, triple(impulse), energy_j)
            for (body, link), (impulse, energy_j) in sorted(run.by.items())
        ]
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

    def _label(self, number: int) -> str:
        return self._bodies[number].label if number in self._bodies else str(number)
