"""Steps that depend on how fast the machine is."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Finding, Scene
from drop_physics.rules.arguments import site_of
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call


class RealTime(Answer):
    """Steps that depend on how fast the machine is."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._on: Call | None = None

    def see(self) -> None:
        """Keep the first call that turns it on."""
        for call in self.scene.piece.calls.of(Act.SET_REAL_TIME):
            if self._on is None:
                asked = call.numbers[0] if call.numbers else float("True" in call.arguments)
                self._on = call if asked else None

    def findings(self) -> Iterator[Finding]:
        """Yield that it was asked for."""
        if self.scene.seen.real_time and self._on is not None:
            message = Message(
                "the script asks for real-time simulation, in which the number of steps depends on "
                "how fast the machine is; here its own clock decides it"
            )
            yield Finding(
                code="real-time",
                level="repeat",
                message=message,
                site=site_of(self._on),
                advice=Message("call p.stepSimulation() instead, as often as there are steps"),
            )
