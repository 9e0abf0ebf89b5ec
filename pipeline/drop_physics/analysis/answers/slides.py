"""`slides`: what rests on something, or is held by it, slips: friction there is not enough."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.answers.asked_of_bodies import AskedOfBodies, size_m
from drop_physics.analysis.contact_points import Pairs
from drop_physics.analysis.explained.judged import Judged
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message

Float64 = NDArray[np.float64]
Rows = NDArray[np.intp]

SLIPS_M_S = 1e-3
"""Slower is creep."""
FROM_REST = 0.1
"""It began at rest if its slip began at less than this share of its greatest."""
LEAST_M, LEAST_SHARE = 1e-3, 0.01
"""Of a slip, and of its share of the body's size."""
NONE = 0.01
"""A force below this share of the normal force is none."""
LANDS_M_S = 0.02
"""Along the normal; then it does not rest there."""
GRIPPED = 0.1
"""Share of the normal forces that is left of them as a sum, where they press from both sides."""
SLIDING = 0.8
"""What slips less at the contact than its centre moves rolls or tumbles."""


@dataclass
class Run:
    """Consecutive steps in which a body slips on another, and nothing else pushes it.

    Sums over them; those of forces in a grip without the steps in which it closes.
    """

    first: int
    last: int
    began_m_s: float
    """How fast it slipped as the first of them began."""
    most_m_s: float
    sums: Float64
    """Of slip [m], way of the centre [m], time [s], normal, available, used impulse [N s], the
    impulse that moving with the support takes [N s], three numbers, and the way, three numbers."""

    def then(self, more: Run) -> Run:
        """Return both as one."""
        most_m_s = max(self.most_m_s, more.most_m_s)
        return Run(self.first, more.last, self.began_m_s, most_m_s, self.sums + more.sums)

    @property
    def slid_m(self) -> float:
        """How far it slipped."""
        return float(self.sums[0])

    @property
    def needed_n_s(self) -> float:
        """The impulse that moving with the support takes."""
        return float(np.linalg.norm(self.sums[6:9]))


class Slides(Answer):
    """Needed is what gravity and the support's acceleration ask of friction, not a push."""

    speeds_m_s = SLIPS_M_S, np.inf
    """Of the slips that it looks at."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asked = AskedOfBodies(scene, "lateralFriction")
        self._open: dict[tuple[int, int], Run] = {}
        self._found: dict[tuple[int, int], Run] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        self._asked.see(explained)
        pairs = self.scene.touches.pairs
        low_m_s, high_m_s = self.speeds_m_s
        slips = (pairs.slip_m_s > low_m_s) & (pairs.slip_m_s < high_m_s) & (pairs.normal_n > 0)
        for *both, rows in pairs.by_pair(slips):
            for side, number in enumerate(both):
                judged = explained.bodies.get(number)
                if judged is None or both[0] == both[1] or _jointed(judged):
                    continue
                for run in _runs(pairs, rows, side, judged):
                    self._take(number, both[1 - side], run)

    def _take(self, body: int, other: int, run: Run) -> None:
        last = self._open.get((body, other))
        if last is not None and last.last + 1 == run.first:
            run = last.then(run)
        else:
            self._close(body, other)
        self._open[body, other] = run

    def _close(self, body: int, other: int) -> None:
        """Keep the longest slip of those that friction could not stop."""
        run = self._open.pop((body, other), None)
        if run is None or not self.says(run, size_m(self.scene.body(body))):
            return
        found = self._found.get((body, other))
        if found is None or run.slid_m > found.slid_m:
            self._found[body, other] = run

    def says(self, run: Run, body_m: float) -> bool:
        """Whether friction was not enough for what was at rest."""
        slid, moved, _, normal, available = run.sums[:5]
        return bool(
            slid > max(LEAST_M, LEAST_SHARE * body_m)
            and run.began_m_s <= FROM_REST * run.most_m_s
            and run.needed_n_s > available
            and normal > NONE * run.needed_n_s  # else it hardly touches it
            and slid >= SLIDING * moved
        )

    def findings(self) -> Iterator[Finding]:
        """Yield each body that slides, with what it slides on."""
        for body, other in [*self._open]:
            self._close(body, other)
        for (body, other), run in self._found.items():
            yield self.finding(body, other, run)

    def finding(self, body: int, other: int, run: Run) -> Finding:
        """Return what is said of a body and what it slips on."""
        slid, _, seconds, normal, available, *_ = run.sums.tolist()
        on, needed = self.scene.body(other).label, run.needed_n_s
        return Finding(
            code="slides",
            level="asked",
            message=Message(
                "slides {slid:.3g} m on {on}: friction there gives at most {available:.3g} N "
                "(coefficient {given:.3g}), staying takes {needed:.3g} N ({wanted:.3g})",
                slid=slid, on=on, available=available / seconds, given=available / normal,
                needed=needed / seconds, wanted=needed / normal,
            ),
            advice=Message(
                "raise the product of both bodies' coefficients well above {wanted:.3g} with "
                "p.changeDynamics(…, lateralFriction=…), or press them together with more force",
                wanted=needed / normal,
            ),
            body=self.scene.body(body).label,
            other=on,
            effect=Effect(slid, "m"),
            share=slid / size_m(self.scene.body(body)),
            steps=Span(run.first, run.last, run.last - run.first + 1),
            site=self._asked.site(body) or self._asked.site(other),
        )  # fmt: skip


def _jointed(judged: Judged) -> bool:
    """Whether it is something else than one rigid body that moves."""
    return any(steps.law.tree.size != 6 for steps in judged.stretches)


def _runs(pairs: Pairs, rows: Rows, side: int, judged: Judged) -> Iterator[Run]:
    """Yield runs of consecutive steps of a pair."""
    needed, others, pushed, pressed, way = _forces(pairs, rows, side, judged)
    normal = pairs.normal_n[rows]
    # What is held from both sides hangs back, whoever else carries it; elsewhere that is a push.
    gripped = np.linalg.norm(pairs.pressed_n[rows], axis=1) < GRIPPED * normal
    alone = (pushed <= NONE * normal) & (gripped | (others <= NONE * normal))
    alone &= pairs.one_line[rows] & pairs.explained[rows].all(axis=1)
    rows, needed, way, gripped = rows[alone], needed[alone], way[alone], gripped[alone]
    if not len(rows):
        return
    step, dt, slip = pairs.step[rows], pairs.timestep_s[rows], pairs.slip_m_s[rows]
    # What lies on one side presses with what it needs, on average: step by step it chatters.
    normal = np.where(gripped, pairs.normal_n[rows], pressed[alone])
    available = pairs.available_n[rows] / pairs.normal_n[rows] * normal
    steady = ~gripped | (np.abs(pairs.approach_m_s[rows]) < LANDS_M_S)
    size = np.linalg.norm(needed, axis=1)
    towards = np.divide(needed, size[:, None], out=np.zeros_like(needed), where=size[:, None] > 0)
    used = np.einsum("ni,ni->n", pairs.tangential_n[rows], towards) * (-1.0 if side else 1.0)
    forces = [np.ones(len(rows)), normal, available, used, *needed.T]
    ways = [slip, np.linalg.norm(way, axis=1)]
    numbers = np.column_stack([*ways, *(each * steady for each in forces), way]) * dt[:, None]
    starts = np.flatnonzero(np.diff(step, prepend=step[0] - 2) != 1)
    sums, most = np.add.reduceat(numbers, starts), np.maximum.reduceat(slip, starts)
    began = pairs.began_slip_m_s[rows][starts]
    lasts = np.append(starts[1:], len(rows)) - 1
    for k, (start, end) in enumerate(zip(starts.tolist(), lasts.tolist(), strict=True)):
        yield Run(int(step[start]), int(step[end]), float(began[k]), float(most[k]), sums[k])


def _forces(
    pairs: Pairs, rows: Rows, side: int, judged: Judged
) -> tuple[Float64, Float64, Float64, Float64, Float64]:
    """Return what of a body's weight and inertia friction has to carry, shape (n, 3) [N].

    Then what other bodies do to it, what pushes and constraints do, what of its weight and inertia
    presses it on [N], shape (n,) each, and how its centre moves along the contact [m/s], shape
    (n, 3). NaN where the sum says nothing.
    """
    needed, moved = np.full((2, len(rows), 3), np.nan)
    other, pushed, pressed = np.full((3, len(rows)), np.nan)
    points, weights = pairs.points, pairs.points.normal_n[:, None]
    held = (points.ended_m_s - points.began_m_s)[:, 1 - side]
    support = pairs.summed(weights * held)[rows] / pairs.normal_n[rows, None]
    mean = pairs.summed(weights * points.ended_m_s[:, 1 - side])[rows] / pairs.normal_n[rows, None]
    sign, line, dt = (-1.0 if side else 1.0), pairs.line[rows], pairs.timestep_s[rows, None]
    for steps in judged.stretches:
        its = np.flatnonzero(np.isin(pairs.step[rows], steps.steps))
        if not len(its) or not steps.terms:
            continue
        at = np.searchsorted(steps.steps, pairs.step[rows][its])
        mass_kg = float(steps.law.tree.masses_kg[0])
        asked = mass_kg * (support[its] / dt[its] - steps.reported.gravity_m_s2[at])
        along = np.einsum("ni,ni->n", asked, line[its])
        needed[its], pressed[its] = asked - along[:, None] * line[its], np.abs(along)
        others = steps.terms["contacts"][at, 3:6] / dt[its] - sign * pairs.force_n[rows][its]
        more = (steps.terms["constraints"] + steps.terms["applied"])[at, 3:6] / dt[its]
        other[its], pushed[its] = (np.linalg.norm(each, axis=1) for each in (others, more))
        way = steps.after.velocity[at, 3:6] - mean[its]
        moved[its] = way - np.einsum("ni,ni->n", way, line[its])[:, None] * line[its]
    return needed, other, pushed, pressed, moved
