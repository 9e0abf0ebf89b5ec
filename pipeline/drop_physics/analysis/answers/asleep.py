"""Bodies on which nothing acts, because they sleep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message
from drop_physics.seen.events import Body

UNBALANCED = 0.1
"""Of the largest term, what is left of the sum: more than the solver leaves of one at rest."""


@dataclass
class _Asleep:
    body: Body
    left: float
    term: str
    first: int
    last: int
    count: int = 0


class Asleep(Answer):
    """A body whose state stays the same to the bit, though what acts on it does not balance."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asleep: dict[int, _Asleep] = {}

    def see(self, explained: Explained) -> None:
        """Note steps in which a body that may sleep does not answer."""
        for number, judged in explained.bodies.items():
            for steps in judged.stretches:
                if "asleep" not in steps.epoch.reasons or not steps.terms:
                    continue
                moves = steps.before.velocity.any(axis=1) | steps.after.velocity.any(axis=1)
                for name in ("position_m", "orientation", "joints"):
                    before, after = getattr(steps.before, name), getattr(steps.after, name)
                    moves |= (before != after).any(axis=1)
                # What a call holds in place with every step does not sleep.
                moves |= steps.put
                rows = np.flatnonzero(~moves & (steps.unexplained > UNBALANCED))
                if not len(rows):
                    continue
                row, first, last = rows[0], int(steps.steps[rows[0]]), int(steps.steps[rows[-1]])
                left = np.abs(steps.remainder[row])
                axis = int(left.argmax())
                term = max(steps.terms, key=lambda name: abs(steps.terms[name][row, axis]))
                force = float(left[axis] / steps.reported.timestep_s[row])
                own = _Asleep(judged.body, force, term, first, last)
                known = self._asleep.setdefault(number, own)
                known.last, known.count = last, known.count + len(rows)

    def findings(self) -> Iterator[Finding]:
        """Yield the bodies that slept through something."""
        for each in self._asleep.values():
            message = Message(
                "{body} sleeps from step {first:,} on: it does not move in {count:,} steps in "
                "which the sum of what acts on it is not zero, most of all {term}",
                body=each.body.label, first=each.first, count=each.count, term=each.term,
            )  # fmt: skip
            yield Finding(
                code="asleep", level="asked", message=message, body=each.body.label, share=1.0,
                advice=Message("wake it and keep it awake: p.changeDynamics(body, -1, "
                    "activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)"),
                effect=Effect(each.left, "N or N m"),
                steps=Span(each.first, each.last, each.count),
            )  # fmt: skip
