"""Why a body does not move: it sleeps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import target_of
from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Notes, Scene, so_many
from drop_physics.rules.joint import OFF, units_of

UNBALANCED = 0.1
"""Of the largest term, what is left of the sum: more than the solver leaves of one at rest."""


class Asleep(Answer):
    """A body whose state stays the same to the bit, though something was to move it."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asleep: Notes[int] = Notes()

    def see(self) -> None:
        """Note steps in which a body that may sleep does not answer."""
        for judged, steps in self.scene.stretches():
            if "asleep" in steps.epoch.reasons and steps.terms:
                unbalanced = steps.unexplained > UNBALANCED
                rows = np.flatnonzero(_still(steps) & (unbalanced | self._off_target(steps)))
                if len(rows):
                    left = np.abs(steps.remainder)
                    force = left.max(axis=1)[rows] / steps.reported.timestep_s[rows]
                    row = int(rows[force.argmax()])
                    axis = left[row].argmax()
                    term = max(steps.terms, key=lambda name: abs(steps.terms[name][row, axis]))
                    self._asleep.add(
                        judged.body.number,
                        steps.steps[rows],
                        force,
                        term=term if unbalanced[row] else "motors",
                    )

    def _off_target(self, steps: Steps) -> NDArray[np.bool_]:
        """Return in which steps motors have something to do, and force to do it."""
        off = np.zeros(len(steps), np.bool_)
        for driven in self.scene.driven():
            if driven.steps is steps:
                least = [OFF[units_of(driven, k)[0]] for k in range(driven.after.shape[1])]
                far = np.abs(driven.after - target_of(driven)) > least
                off |= (far & ~driven.at_limit & (driven.limit > 0) & (driven.asked.kp > 0)).any(
                    axis=1
                )
        return off

    def findings(self) -> Iterator[Finding]:
        """Yield the bodies that slept through something."""
        for number_, each in self._asleep.items():
            body = self.scene.body(number_).label
            message = Message(
                "{body} sleeps from step {first:,} on: it does not move in {steps} in which "
                "the sum of what acts on it is not zero, most of all {term}",
                body=body,
                first=each.first,
                steps=so_many(each.count),
                term=each.at["term"],
            )
            yield Finding(
                code="asleep",
                level="asked",
                message=message,
                body=body,
                share=1.0,
                advice=Message(
                    "wake it and keep it awake: p.changeDynamics(body, -1, "
                    "activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)"
                ),
                effect=Effect(each.most, "N or N m"),
                steps=each.span,
            )


def _still(steps: Steps) -> NDArray[np.bool_]:
    """Return which steps leave the state to the bit; not those that a call set anew."""
    moves = steps.put | steps.after.velocity.any(axis=1)
    for name in ("position_m", "orientation", "joints", "velocity"):
        before, after = getattr(steps.before, name), getattr(steps.after, name)
        moves |= (before != after).any(axis=1)
    return ~moves
