"""Whether time passes, anything falls, and it runs like this again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Notes, Scene, site_of
from drop_physics.analysis.answers.arguments import number
from drop_physics.analysis.explained.recording import Explained
from drop_physics.fields import fraction
from drop_physics.messages import Message
from drop_physics.seen.calls import Call

SETS_TIMESTEP = ("setTimeStep", "setPhysicsEngineParameter")
MOVES = ("setGravity", "setJointMotorControl", "applyExternal",
    "createConstraint")  # fmt: skip
"""Beginnings of functions that only have an effect in a step."""


class NotStepped(Answer):
    """Time passes only in p.stepSimulation()."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._asks: dict[int, Call] = {}
        """By client, the first call that waits for a step."""

    def see(self, explained: Explained) -> None:
        """Note which simulations were to move."""
        for call in explained.piece.calls:
            if call.client not in self._asks and call.function.startswith(MOVES):
                self._asks[call.client] = call

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


class RealTime(Answer):
    """Steps that depend on how fast the machine is."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._on: Call | None = None

    def see(self, explained: Explained) -> None:
        """Keep the first call that turns it on."""
        for call in explained.piece.calls:
            if self._on is None and call.function == "setRealTimeSimulation":
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
                code="real-time", level="repeat", message=message, site=site_of(self._on),
                advice=Message("call p.stepSimulation() instead, as often as there are steps"),
            )  # fmt: skip


class Unseeded(Answer):
    """Random numbers that another run draws differently."""

    def findings(self) -> Iterator[Finding]:
        """Yield where the first was drawn."""
        places = self.scene.seen.unseeded
        if not places:
            return
        where: str = places[0]
        if len(places) > 1:
            where = Message(
                "{place} (the first of {places} places)", place=places[0], places=len(places)
            )
        yield Finding(
            code="unseeded", level="repeat", site=places[0].rpartition(" at ")[2] or None,
            message=Message("unseeded random numbers are drawn by {where}", where=where),
            advice=Message("seed them in the script, or record it with --seed 0"),
        )  # fmt: skip


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

    def see(self, explained: Explained) -> None:
        """Follow what was asked for and what moved, episode by episode."""
        for call in explained.piece.calls:
            resets = self._resets.setdefault(call.client, [])
            if call.function == "resetSimulation":
                resets.append((call, self._gravity.pop(call.client, 0.0)))
            elif call.function.startswith(("setGravity", "createConstraint", "applyExternal")):
                self._told.add((call.client, len(resets)))
                if call.function == "setGravity":
                    xyz = [number(call, f"grav{axis}", 0.0) for axis in "XYZ"]
                    self._gravity[call.client] = float(np.linalg.norm(xyz))
        for judged in explained.bodies.values():
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
            step=first.first - 1, body=body, gravity=before,
        )  # fmt: skip
        advice = Message("call p.setGravity(0, 0, -9.81) after each p.resetSimulation()")
    moves = any(each.most > 0 for each in floats.values())  # what moves without may be meant to
    return Finding(
        code="no-gravity", level="note" if moves and not lost else "asked", message=message,
        body=body, advice=advice, steps=first.span, site=site_of(call) if lost and call else None,
    )  # fmt: skip


class TimestepChanged(Answer):
    """Steps of different length in the life of a body: a new scene may have others."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._last: dict[int, tuple[int, float]] = {}
        """By body, life and timestep of its last step."""
        self._changes: Notes[int] = Notes()
        """By client."""

    def see(self, explained: Explained) -> None:
        """Compare each step's timestep with that of the step before."""
        found: dict[int, dict[int, tuple[float, float]]] = {}
        for judged in explained.bodies.values():
            for steps in judged.stretches:
                timestep_s, life = steps.reported.timestep_s, steps.epoch.life
                lived, last_s = self._last.get(judged.body.number, (life, timestep_s[0]))
                before_s = np.append(last_s if lived == life else timestep_s[0], timestep_s[:-1])
                for row in np.flatnonzero(timestep_s != before_s).tolist():
                    change = float(before_s[row]), float(timestep_s[row])
                    found.setdefault(judged.body.client, {})[int(steps.steps[row]) - 1] = change
                self._last[judged.body.number] = life, float(timestep_s[-1])
        for client, changes in found.items():
            first, at = min(changes), np.array(sorted(changes))
            sites = [site_of(each) for each in explained.piece.calls if each.client == client
                and each.function in SETS_TIMESTEP and each.at.step == first]  # fmt: skip
            # Of all the first is told.
            self._changes.add(client, at, np.full(len(at), -float(first)), change=changes[first],
                site=sites[-1] if sites else None)  # fmt: skip

    def findings(self) -> Iterator[Finding]:
        """Yield the first change of each simulation."""
        for each in self._changes.values():
            (before_s, after_s), site = each.at["change"], each.at["site"]
            more = Message(" (the first of {n:,} changes)", n=each.count) if each.count > 1 else ""
            message = Message(
                "the timestep changes from {before} s to {after} s at step {step:,}{more}: motors "
                "and constraints keep force × timestep of their call, and a position motor closes "
                "a share of its gap per step",
                before=fraction(before_s), after=fraction(after_s), step=each.first, more=more,
            )  # fmt: skip
            low_s, high_s = sorted((before_s, after_s))
            ratio = high_s / low_s if low_s > 0 else 0.0
            yield Finding(
                code="timestep-changed", level="model", message=message,
                advice=Message("call p.setTimeStep once, before the first motor"),
                effect=Effect(ratio, "1"), share=ratio, steps=each.span, site=site,
            )  # fmt: skip
