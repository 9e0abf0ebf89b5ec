"""Why a body does not move: it has no mass, or it sleeps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Notes, Scene, site_of
from drop_physics.analysis.answers.arguments import calls_of, given, number
from drop_physics.analysis.answers.joint import OFF, units_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import target_of
from drop_physics.messages import Message
from drop_physics.seen.calls import Call

UNBALANCED = 0.1
"""Of the largest term, what is left of the sum: more than the solver leaves of one at rest."""


class Massless(Answer):
    """A body that was given no mass, and is then pushed, or hangs in the air."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._made: dict[tuple[int, int], Call] = {}
        """By client and the engine's id."""
        self._pushed: set[int] = set()
        self._touched: set[int] = set()
        self._falls: set[int] = set()
        """Clients with gravity."""

    def see(self, explained: Explained) -> None:
        """Note what was made without a mass, pushed, and touched."""
        for call in explained.piece.calls:
            if call.function == "createMultiBody" and not given(call, "baseMass"):
                self._made.setdefault((call.client, int(call.result)), call)
            elif call.function == "setGravity" and any(call.numbers[:3]):
                self._falls.add(call.client)
        if self._made:
            contacts, appearances = explained.piece.contacts, self.scene.seen.appearances
            self._touched.update(*(contacts[f"body_{side}"].unique().to_list() for side in "ab"))
            for call, body in calls_of(explained.piece, appearances, "applyExternal"):
                if int(number(call, "linkIndex", -1.0)) == -1:
                    self._pushed.add(body.number)

    def findings(self) -> Iterator[Finding]:
        """Yield those that were pushed, and those that nothing holds up."""
        for (client, engine_id), call in self._made.items():
            body = next((each for each in self.scene.seen.bodies.values()
                if (each.client, each.engine_id) == (client, engine_id)), None)  # fmt: skip
            if body is None or body.joints or body.base_moves or not body.collisions:
                continue
            pushed = body.number in self._pushed
            if not pushed and (client not in self._falls or body.number in self._touched):
                continue
            message = Message("{body} has no mass, so it does not fall", body=body.label)
            if pushed:
                message = Message("{body} has no mass, so no force moves it", body=body.label)
            yield Finding(
                code="massless", level="asked" if pushed else "note", message=message,
                advice=Message("p.createMultiBody(baseMass=…): without it a body is static"),
                body=body.label, site=site_of(call),
            )  # fmt: skip


class Asleep(Answer):
    """A body whose state stays the same to the bit, though something was to move it."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asleep: Notes[int] = Notes()

    def see(self, explained: Explained) -> None:
        """Note steps in which a body that may sleep does not answer."""
        for body, judged in explained.bodies.items():
            for steps in judged.stretches:
                if "asleep" not in steps.epoch.reasons or not steps.terms:
                    continue
                # What a call holds in place with every step does not sleep.
                moves = steps.put | steps.after.velocity.any(axis=1)
                for name in ("position_m", "orientation", "joints", "velocity"):
                    before, after = getattr(steps.before, name), getattr(steps.after, name)
                    moves |= (before != after).any(axis=1)
                left = np.abs(steps.remainder)
                calls, axes = steps.unexplained > UNBALANCED, left.argmax(axis=1)
                for driven in self.scene.joints.latest.get(body, []):
                    if driven.steps is steps:  # sleeping motors report no torque
                        least = [OFF[units_of(driven, k)[0]] for k in range(driven.after.shape[1])]
                        off = np.abs(driven.after - target_of(driven)) > least
                        calls |= (off & (driven.torque == 0) & (driven.limit > 0)).any(axis=1)
                rows = np.flatnonzero(~moves & calls)
                if len(rows):
                    force = left.max(axis=1)[rows] / steps.reported.timestep_s[rows]
                    row = int(rows[force.argmax()])
                    term = max(steps.terms, key=lambda name: abs(steps.terms[name][row, axes[row]]))
                    if not steps.unexplained[row] > UNBALANCED:
                        term = "motors"
                    self._asleep.add(body, steps.steps[rows], force, term=term)

    def findings(self) -> Iterator[Finding]:
        """Yield the bodies that slept through something."""
        for number_, each in self._asleep.items():
            body = self.scene.body(number_).label
            message = Message(
                "{body} sleeps from step {first:,} on: it does not move in {count:,} steps in "
                "which the sum of what acts on it is not zero, most of all {term}",
                body=body, first=each.first, count=each.count, term=each.at["term"],
            )  # fmt: skip
            yield Finding(
                code="asleep", level="asked", message=message, body=body, share=1.0,
                advice=Message("wake it and keep it awake: p.changeDynamics(body, -1, "
                    "activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)"),
                effect=Effect(each.most, "N or N m"), steps=each.span,
            )  # fmt: skip
