"""Why nothing moves: time passes only in p.stepSimulation()."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Finding, Scene
from drop_physics.rules.arguments import site_of
from drop_physics.trace.acts import PUSHES, Act
from drop_physics.trace.calls import Call

MOVES = Act.COMMAND, Act.CONSTRAIN, *PUSHES
"""What only has an effect in a step. Gravity is also set where poses are
only looked at, beside a simulation that is stepped."""


class NotStepped(Answer):
    """Time passes only in p.stepSimulation()."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asks: dict[int, Call] = {}
        """By client, the first call that waits for a step."""
        self._gravity: dict[int, Call] = {}

    def see(self) -> None:
        """Note which simulations were to move."""
        for asks, which in ((self._asks, MOVES), (self._gravity, (Act.SET_GRAVITY,))):
            if self.scene.times.keys() - asks.keys():
                for call in self.scene.piece.calls.of(*which):
                    asks.setdefault(call.client, call)

    def findings(self) -> Iterator[Finding]:
        """Yield the simulations in which something waits for a first step."""
        if self.scene.origin.get("ended") == "failed":
            return
        stepped = any(samples > 1 for samples in self.scene.seen.samples.values())
        asks = self._asks if stepped else self._gravity | self._asks
        for client, samples in self.scene.seen.samples.items():
            call = asks.get(client)
            bodies = self.scene.seen.bodies.values()
            if samples == 1 and call and any(b.moving for b in bodies if b.client == client):
                message = Message(
                    "simulation {client} is never stepped, so nothing in it moves by itself: time "
                    "passes only in p.stepSimulation()",
                    client=client,
                )
                yield Finding(
                    code="not-stepped",
                    level="asked",
                    message=message,
                    site=site_of(call),
                    advice=Message("call p.stepSimulation() in a loop"),
                )
