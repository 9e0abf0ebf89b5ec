"""Why nothing moves: time passes only in p.stepSimulation()."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.analysis.answers.answer import Answer, Finding, Scene
from drop_physics.analysis.answers.arguments import site_of
from drop_physics.messages import Message
from drop_physics.seen.calls import Call

MOVES = ("setGravity", "setJointMotorControl", "applyExternal",
    "createConstraint")  # fmt: skip
"""Beginnings of functions that only have an effect in a step."""


class NotStepped(Answer):
    """Time passes only in p.stepSimulation()."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asks: dict[int, Call] = {}
        """By client, the first call that waits for a step."""

    def see(self) -> None:
        """Note which simulations were to move."""
        if self.scene.times.keys() - self._asks.keys():
            for call in self.scene.piece.calls.of(*MOVES):
                self._asks.setdefault(call.client, call)

    def findings(self) -> Iterator[Finding]:
        """Yield the simulations in which something waits for a first step."""
        if self.scene.origin.get("ended") == "failed":
            return
        for client, samples in self.scene.seen.samples.items():
            call = self._asks.get(client)
            bodies = self.scene.seen.bodies.values()
            if samples == 1 and call and any(b.moving for b in bodies if b.client == client):
                message = Message(
                    "simulation {client} is never stepped, so nothing in it moves by itself: time "
                    "passes only in p.stepSimulation()",
                    client=client,
                )  # fmt: skip
                yield Finding(
                    code="not-stepped", level="asked", message=message, site=site_of(call),
                    advice=Message("call p.stepSimulation() in a loop"),
                )  # fmt: skip
