"""Why nothing falls: there is no gravity, or no longer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Finding, Notes, Scene
from drop_physics.rules.arguments import number, site_of
from drop_physics.trace.acts import PUSHES, Act
from drop_physics.trace.calls import Call

HOLDS = Act.SET_GRAVITY, Act.CONSTRAIN, *PUSHES
"""After these nothing falls freely by mistake."""


class NoGravity(Answer):
    """Bodies that nothing holds, and that do not fall; from each p.resetSimulation to the next."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._resets: dict[int, list[tuple[Call, float]]] = {}
        """By client, with the gravity that each found [m/s²]."""
        self._gravity: dict[int, float] = {}
        self._told: set[tuple[int, int]] = set()
        """Clients and episodes in which gravity was set, or something pushed a body."""
        self._floats: dict[tuple[int, int], Notes[str]] = {}
        """By client and episode, the bodies that nothing holds: how fast they move."""

    def see(self) -> None:
        """Follow what was asked for and what moved, episode by episode."""
        for call in self.scene.piece.calls.of(Act.CLEAR, *HOLDS):
            resets = self._resets.setdefault(call.client, [])
            if call.act is Act.CLEAR:
                resets.append((call, self._gravity.pop(call.client, 0.0)))
            else:
                self._told.add((call.client, len(resets)))
                if call.act is Act.SET_GRAVITY:
                    xyz = [number(call, f"grav{axis}", 0.0) for axis in "XYZ"]
                    self._gravity[call.client] = float(np.linalg.norm(xyz))
        for judged in self.scene.judged.values():
            body, client = judged.body, judged.body.client
            resets = self._resets.get(client, [])
            for steps in judged.stretches if body.base_moves else ():
                began = [call.at.step for call, _ in resets]
                episodes = np.searchsorted(began, steps.steps, side="left")
                for episode in np.unique(episodes).tolist():
                    rows, key = np.flatnonzero(episodes == episode), (client, episode)
                    if steps.reported.gravity_m_s2[rows].any():
                        self._told.add(key)
                    speed = np.abs(steps.after.velocity[rows]).max(axis=1, initial=0.0)
                    self._floats.setdefault(key, Notes()).add(body.label, steps.steps[rows], speed)

    def findings(self) -> Iterator[Finding]:
        """Yield the first episode of each simulation, and the first that lost its gravity."""
        found: dict[tuple[int, bool], Finding] = {}
        for (client, episode), floats in self._floats.items():
            resets = self._resets.get(client, [])
            call, before = resets[episode - 1] if episode else (None, 0.0)
            if client in self.scene.inputs.left_out(Act.SET_GRAVITY)[1]:
                continue  # the call is there, and for another client: `other-client`
            if (client, episode) not in self._told and (client, before > 0) not in found:
                found[client, before > 0] = _floats(floats, call, before)
        yield from found.values()


def _floats(floats: Notes[str], call: Call | None, before: float) -> Finding:
    body, first = next(iter(floats.items()))
    message = Message(
        "gravity is 0, so {body} does not fall: PyBullet starts without it", body=body
    )
    advice, lost = Message("call p.setGravity(0, 0, -9.81)"), call is not None and before > 0
    if lost:
        message = Message(
            "gravity is 0 from step {step:,} on, so {body} does not fall: p.resetSimulation() "
            "sets it from {gravity:.3g} m/s² back to 0",
            step=first.first - 1,
            body=body,
            gravity=before,
        )
        advice = Message("call p.setGravity(0, 0, -9.81) after each p.resetSimulation()")
    moves = any(each.most > 0 for each in floats.values())  # what moves without may be meant to
    return Finding(
        code="no-gravity",
        level="note" if moves and not lost else "asked",
        message=message,
        body=body,
        advice=advice,
        cure=Cure("gravity", value=-9.81),
        steps=first.span,
        site=site_of(call) if lost and call else None,
    )
