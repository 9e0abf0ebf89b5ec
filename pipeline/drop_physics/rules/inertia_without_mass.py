"""Why a mass is another than the one given: an inertia was set without it."""

from __future__ import annotations

from collections.abc import Iterator

from drop_physics.messages import Message
from drop_physics.physics.laws.lookup import RIGID
from drop_physics.rules.answer import Answer, Finding, Scene
from drop_physics.rules.arguments import given, site_of
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Body


class InertiaWithoutMass(Answer):
    """Of a btRigidBody PyBullet then sets the mass, too, to whatever is in memory."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._rigid = {
            each.body.number
            for each in scene.seen.dynamics
            if int(each.reported["kind"][0]) == RIGID
        }
        self._alone: dict[int, tuple[Body, Call]] = {}

    def see(self) -> None:
        """Note the first such call for each body."""
        for call, body in self.scene.calls_of(Act.SET_PROPERTY):
            if given(call, "localInertiaDiagonal") and not given(call, "mass"):
                self._alone.setdefault(body.number, (body, call))

    def findings(self) -> Iterator[Finding]:
        """Yield each body."""
        for number, (body, call) in self._alone.items():
            if number in self._rigid:
                message = Message(
                    "{body} is a btRigidBody and gets an inertia without a mass: PyBullet then "
                    "takes as its mass what an earlier command left in memory",
                    body=body.label,
                )
                yield Finding(
                    code="inertia-without-mass",
                    level="model",
                    message=message,
                    body=body.label,
                    advice=Message("give p.changeDynamics its mass as well"),
                    site=site_of(call),
                )
