"""`target-clamped` of an actuator: what it is sent to lies outside of its range of control."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.explain.driving import given_to
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Notes, Scene, so_many
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.thresholds import BEYOND_RANGE, COASTS_STEPS
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Actuator, Body

SENT = "position", "velocity"
"""The kinds of actuators that are sent somewhere; of others a range is how strong they are."""


class ControlClamped(Answer):
    """An actuator that is sent beyond its ctrlrange is sent to the end of it."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: Notes[tuple[int, int]] = Notes()
        """How far beyond, by the number of a body and the place of an actuator among its own."""

    def see(self) -> None:
        """Take a piece."""
        for judged, steps in self.scene.stretches():
            for place, actuator in enumerate(judged.body.actuators):
                if actuator.ctrl_range is None or actuator.kind not in SENT:
                    continue
                low, high = actuator.ctrl_range
                given = given_to(actuator, judged.body, self.scene.piece, steps.steps)
                over = np.maximum(low - given, given - high)
                rows = np.flatnonzero(over > BEYOND_RANGE * (high - low))
                if len(rows):
                    key = judged.body.number, place
                    self._found.add(key, steps.steps[rows], over[rows], {"given": given[rows]})

    def findings(self) -> Iterator[Finding]:
        """Yield the worst actuator of each body."""
        worst: dict[int, tuple[float, Actuator]] = {}
        for (number, place), noted in self._found.items():
            actuator = self.scene.body(number).actuators[place]
            assert actuator.ctrl_range is not None
            low, high = actuator.ctrl_range
            share = noted.most / (high - low) if high > low else noted.most
            if noted.count >= COASTS_STEPS and share > worst.get(number, (0.0,))[0]:
                worst[number] = share, actuator
        for number, (share, actuator) in worst.items():
            body = self.scene.body(number)
            noted = self._found[number, body.actuators.index(actuator)]
            assert actuator.ctrl_range is not None
            low, high = actuator.ctrl_range
            unit = _unit(actuator, body)
            yield Finding(
                code="target-clamped",
                level="asked",
                message=Message(
                    "{actuator} is sent to {given:.4g} in {steps}, and its ctrlrange is {low:.4g} "
                    "to {high:.4g}: it takes the end of that",
                    actuator=actuator.name,
                    given=noted.at["given"],
                    steps=so_many(noted.count),
                    low=low,
                    high=high,
                ),
                advice=(
                    call := Message(
                        'send it within that, or ctrlrange="…" of the <{kind}> around {given:.4g}; '
                        "ctrl is in radians and metres, whatever the angles of the file",
                        kind=actuator.kind,
                        given=noted.at["given"],
                    )
                ),
                cure=Cure("ctrlrange", actuator.name, None, call),
                body=body.label,
                joint=actuator.target if actuator.acts_on == "joint" else None,
                effect=Effect(noted.most, unit) if unit else None,
                share=share,
                steps=noted.span,
                site=self.scene.only_site(Act.SET_CONTROL),
            )


def _unit(actuator: Actuator, body: Body) -> str:
    """Return the unit of what a position actuator is sent to; empty of any other."""
    kinds = {joint.name: joint.kind for joint in body.joints}
    if actuator.kind != "position" or actuator.acts_on != "joint":
        return ""
    return "m" if kinds.get(actuator.target) == "prismatic" else "rad"
