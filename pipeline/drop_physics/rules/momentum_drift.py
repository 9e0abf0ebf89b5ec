"""Momentum that changes with nothing outside that acts: the step's own error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.changes import energy_of
from drop_physics.explain.judged import Judged
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.dynamics import angular_momenta
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.tree import BASE, Tree
from drop_physics.rules.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.trace.events import Body

Float64 = NDArray[np.float64]

OUTSIDE = "contacts", "constraints", "rolling", "clamp"
DRIFT = 0.02
"""Of the largest momentum."""
LEAST_MOVED = 0.1
"""Of mass × speed of the base, or of the sum of what the links have: what is left where these
cancel is small against it."""
LEAST = 10
"""Steps in a row in which nothing outside acts."""


@dataclass
class _Free:
    """Steps in a row in which nothing outside acts."""

    body: Body
    tree: Tree
    first: int
    last: int
    mass_kg: float
    turning: Float64
    """Angular momentum about the centre of mass at the start, shape (3,)."""
    undamped: bool
    """Whether nothing damps its rotation."""
    drift: Float64
    """Linear momentum that the integrator gave it [kg m/s], shape (3,)."""
    momentum: Float64
    """Linear momentum at the end [kg m/s], shape (3,)."""
    greatest: float = 0.0
    """Of the linear momentum [kg m/s]."""
    moved: float = 0.0
    """Mass × speed of the base, the greatest [kg m/s]."""
    turned: float = 0.0
    """Sum of the sizes of all links' angular momenta, the greatest [kg m²/s]."""
    after: Float64 | None = None
    """Angular momentum at the end."""


class MomentumDrift(Answer):
    """Follows free bodies."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._now: dict[int, _Free] = {}
        self._found: dict[int, Finding] = {}

    def see(self) -> None:
        """Follow the steps in which nothing outside acts."""
        for number, judged in self.scene.judged.items():
            for steps in judged.stretches:
                if steps.law.tree.fixed or not steps.terms:
                    self._end(number)
                    continue
                free = _free(judged, steps)
                edges = np.flatnonzero(np.diff(free.astype(np.int8), prepend=0, append=0))
                if len(steps) and not free[0]:
                    self._end(number)
                for first, end in edges.reshape(-1, 2).tolist():
                    self._add(number, judged.body, steps, first, end)
                    if end < len(steps):
                        self._end(number)

    def _add(self, number: int, body: Body, steps: BodySteps, first: int, end: int) -> None:
        known, began = self._now.get(number), int(steps.steps[first])
        if known is not None and (
            known.last != began - 1 or steps.put[first] or not _alike(known.tree, steps.law.tree)
        ):
            self._end(number)
            known = None
        turning, turned = _turning(steps, first, end)
        undamped = steps.law.angular_damping == 0 and not steps.law.joint_damping.any()
        if known is None:
            known = self._now[number] = _Free(
                body,
                steps.law.tree,
                began,
                began,
                float(steps.law.tree.masses_kg.sum()),
                turning[0],
                undamped,
                np.zeros(3),
                energy_of(steps.law, steps.before.at(np.array([first])), np.zeros((1, 3)))[1][0],
            )
        known.last, known.after = int(steps.steps[end - 1]), turning[1]
        known.undamped &= undamped
        causes = {name: each[first:end] for name, each in steps.changes.momentum_kg_m_s.items()}
        known.drift = known.drift + causes["integrator"].sum(axis=0)
        momenta = known.momentum + np.cumsum(sum(causes.values()), axis=0)
        known.momentum = momenta[-1]
        known.greatest = max(known.greatest, float(np.linalg.norm(momenta, axis=1).max()))
        speed_m_s = np.linalg.norm(steps.after.velocity[first:end, 3:6], axis=1).max()
        known.turned = max(known.turned, turned)
        known.moved = max(known.moved, known.mass_kg * float(speed_m_s))

    def _end(self, number: int) -> None:
        known = self._now.pop(number, None)
        if known is None or known.last - known.first < LEAST:
            return
        finding = _finding(known)
        if finding is not None:
            worst = self._found.get(number)
            if worst is None or finding.share > worst.share:
                self._found[number] = finding

    def findings(self) -> Iterator[Finding]:
        """Yield the worst of each body."""
        for number in [*self._now]:
            self._end(number)
        yield from self._found.values()


def _alike(one: Tree, other: Tree) -> bool:
    """Whether no call changed a mass or an inertia."""
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("masses_kg", "inertias_kg_m2")
    )


def _free(judged: Judged, steps: BodySteps) -> NDArray[np.bool_]:
    """Return in which steps nothing outside acts, gravity apart."""
    free = judged.explained[np.searchsorted(judged.steps, steps.steps)]
    for name in OUTSIDE:
        free &= ~steps.terms[name].any(axis=1)
    pushed = np.zeros(len(steps), np.bool_)
    pushed[steps.reported.applied.step] = True
    pushed[1:] |= steps.put[1:]
    return np.asarray(free & ~pushed)


def _turning(steps: BodySteps, first: int, end: int) -> tuple[Float64, float]:
    """Return the angular momentum before and after some steps, shape (2, 3).

    And the sum of the sizes of the links', after them or where the rates are greatest.
    """
    tree, found, parts = steps.law.tree, [], []
    masses = tree.masses_kg
    fastest = first + int(np.argmax(np.linalg.norm(steps.after.velocity[first:end], axis=1)))
    for states, row in ((steps.before, first), (steps.after, fastest), (steps.after, end - 1)):
        kin = kinematics(tree, states.at(np.array([row])))
        moved = motion(kin, states.velocity[[row]])
        places, speeds = (
            np.array([each[link + 1][:, 0] for link in range(BASE, tree.links)])
            for each in (kin.centres, moved.velocities)
        )
        arms, own = (each - masses @ each / masses.sum() for each in (places, speeds))
        links = masses[:, None] * np.cross(arms, own)
        for link, turning in angular_momenta(kin, moved).items():
            links[link + 1] += np.ravel(turning)
        found.append(links.sum(axis=0))
        parts.append(float(np.linalg.norm(links, axis=1).sum()))
    return np.array(found)[[0, 2]], max(parts)


def _finding(free: _Free) -> Finding | None:
    count = free.last - free.first + 1
    drift, size = float(np.linalg.norm(free.drift)), max(free.greatest, LEAST_MOVED * free.moved)
    message, unit = (
        Message(
            "{body} gains {drift:.3g} kg m/s in {count:,} steps in which nothing outside acts on "
            "it: that is the error of the explicit step",
            body=free.body.label,
            drift=drift,
            count=count,
        ),
        "kg m/s",
    )
    if not drift > DRIFT * size > 0:
        if free.after is None or not free.undamped:
            return None
        before, after = (float(np.linalg.norm(each)) for each in (free.turning, free.after))
        drift, size = (
            float(np.linalg.norm(free.after - free.turning)),
            max(before, after, LEAST_MOVED * free.turned),
        )
        message, unit = (
            Message(
                "the angular momentum of {body} goes from {before:.4g} to {after:.4g} kg m²/s in "
                "{count:,} steps in which nothing outside acts on it: that is the error of the "
                "explicit step",
                body=free.body.label,
                before=before,
                after=after,
                count=count,
            ),
            "kg m²/s",
        )
    if not drift > DRIFT * size > 0:
        return None
    return Finding(
        code="momentum-drift",
        level="model",
        message=message,
        body=free.body.label,
        advice=Message("it halves with the timestep: p.setTimeStep(…)"),
        effect=Effect(drift, unit),
        share=drift / size,
        steps=Span(free.first, free.last, count),
    )
