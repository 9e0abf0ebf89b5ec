"""Bodies that stand still because they have no mass."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.analysis.answers.answer import Answer, Finding, Scene, site_of
from drop_physics.analysis.answers.arguments import calls_of, given, number
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Body


class Massless(Answer):
    """A body that was given no mass, and is then pushed, or hangs in the air."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._made: dict[tuple[int, int], Call] = {}
        """By client and the engine's id."""
        self._pushed: dict[int, tuple[Body, Call]] = {}
        self._falls: set[int] = set()
        """Clients with gravity."""
        self._touched: set[int] = set()

    def see(self, explained: Explained) -> None:
        """Note what was made without a mass, pushed, and touched."""
        for call in explained.piece.calls:
            if call.function == "createMultiBody" and not given(call, "baseMass"):
                self._made.setdefault((call.client, int(call.result)), call)
            elif call.function == "setGravity" and any(call.numbers[:3]):
                self._falls.add(call.client)
        if not self._made:
            return
        contacts = explained.piece.contacts
        self._touched.update(*(contacts[name].unique().to_list() for name in ("body_a", "body_b")))
        for call, body in calls_of(explained.piece, self.scene.seen.appearances, "applyExternal"):
            if int(number(call, "linkIndex", -1.0)) == -1:
                self._pushed.setdefault(body.number, (body, call))

    def findings(self) -> Iterator[Finding]:
        """Yield those that were pushed, and those that nothing holds up."""
        for (client, engine_id), call in self._made.items():
            body = next((each for each in self.scene.seen.bodies.values()
                if (each.client, each.engine_id) == (client, engine_id)), None)  # fmt: skip
            if body is None or body.joints or body.base_moves or not body.collisions:
                continue
            pushed = self._pushed.get(body.number)
            if pushed is None and (client not in self._falls or body.number in self._touched):
                continue
            message = Message("{body} has no mass, so it does not fall", body=body.label)
            if pushed is not None:
                message = Message("{body} has no mass, so no force moves it", body=body.label)
            yield Finding(
                code="massless", level="note" if pushed is None else "asked", message=message,
                advice=Message("p.createMultiBody(baseMass=…): without it a body is static"),
                body=body.label, site=site_of(call),
            )  # fmt: skip
