"""Why something loses speed in the air: PyBullet damps every body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.explain.changes import energy_of
from drop_physics.explain.judged import DRIVEN, FLIGHT
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Noted, Scene

DAMPED = 0.01
"""Of the largest energy of a flight."""


@dataclass
class _Damped:
    noted: Noted
    taken_j: float = 0.0
    largest_j: float = 0.0


class DefaultDamping(Answer):
    """Energy that PyBullet's own damping takes from bodies in the air."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._damped: dict[tuple[int, int], _Damped] = {}
        """By body and its life."""

    def see(self) -> None:
        """Add up what damping took in flights of bodies whose damping no call set."""
        for judged, steps in self.scene.stretches():
            number = judged.body.number
            damping = steps.changes.energy_j.get("damping")
            if damping is None or steps.epoch.damping != (None, None):
                continue
            kinds = judged.segment[np.searchsorted(judged.steps, steps.steps)]
            # A robot whose motors hold its joints is in the air, too, if nothing is near; an arm is
            # mounted.
            near = np.full(len(steps), steps.law.tree.fixed)
            near[steps.reported.contacts.step] = True
            rows = np.flatnonzero((kinds == FLIGHT) | ((kinds == DRIVEN) & ~near))
            if len(rows):
                first = _Damped(Noted(int(steps.steps[rows[0]])))
                known = self._damped.setdefault((number, steps.epoch.life), first)
                for states in (steps.before.at(rows[:1]), steps.after.at(rows)):
                    none = np.zeros((len(states), 3))
                    energy_j = float(energy_of(steps.law, states, none)[0].max())
                    known.largest_j = max(known.largest_j, energy_j)
                known.taken_j -= float(damping[rows].sum())
                known.noted.go_on(steps.steps[rows])

    def findings(self) -> Iterator[Finding]:
        """Yield the bodies that lost more than a hundredth of their energy."""
        worst: dict[int, _Damped] = {}
        for (number, _), each in self._damped.items():
            if each.taken_j > max(DAMPED * each.largest_j, worst.get(number, each).taken_j * 0.999):
                worst[number] = each
        for number, each in worst.items():
            label = self.scene.body(number).label
            message = Message(
                "{body} loses {taken:.3g} J in the air, of at most {largest:.3g} J of motion: "
                "PyBullet damps every body, by 0.04 unless a call sets it",
                body=label,
                taken=each.taken_j,
                largest=each.largest_j,
            )
            yield Finding(
                code="default-damping",
                level="model",
                message=message,
                body=label,
                advice=Message("p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)"),
                effect=Effect(each.taken_j, "J"),
                share=min(each.taken_j / each.largest_j, 1),
                steps=each.noted.span,
            )
