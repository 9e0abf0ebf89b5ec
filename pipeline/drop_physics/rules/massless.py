"""Why a body does not move: it was given no mass."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Finding, Scene
from drop_physics.rules.arguments import given, number, site_of
from drop_physics.trace.acts import PUSHES, Act


class Massless(Answer):
    """A body that was given no mass, and is then pushed, or hangs in the air."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._pushed: set[int] = set()
        self._falls: set[int] = set()
        """Clients with gravity."""

    def see(self) -> None:
        """Note what was pushed."""
        self._falls |= {
            call.client
            for call in self.scene.piece.calls.of(Act.SET_GRAVITY)
            if any(call.numbers[:3])
        }
        for call, body in self.scene.calls_of(*PUSHES):
            if int(number(call, "linkIndex", -1.0)) == -1:
                self._pushed.add(body.number)

    def findings(self) -> Iterator[Finding]:
        """Yield those that were pushed, and those that nothing holds up."""
        for number_, body in self.scene.seen.bodies.items():
            call, pushed = self.scene.asked.load(body), number_ in self._pushed
            if body.joints or body.base_moves or not body.collisions or call is None:
                continue
            if call.act is not Act.MAKE or given(call, "baseMass"):
                continue
            touched = self.scene.touches.rows(number_)
            if not pushed and (body.client not in self._falls or touched):
                continue
            message = Message("{body} has no mass, so it does not fall", body=body.label)
            if pushed:
                message = Message("{body} has no mass, so no force moves it", body=body.label)
            yield Finding(
                code="massless",
                level="asked" if pushed else "note",
                message=message,
                advice=Message("p.createMultiBody(baseMass=…): without it a body is static"),
                cure=Cure("mass", body.label, 1.0, form="made"),
                body=body.label,
                site=site_of(call),
            )
