"""Whether time passes, anything falls, and it runs like this again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
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


@dataclass
class _Episode:
    """From p.resetSimulation to the next."""

    client: int
    after_g: float = 0.0
    """Gravity before the reset that began it [m/s²]."""
    call: Call | None = None
    """That reset."""
    told: bool = False
    """Whether gravity was set, or something pushed a body."""
    free: str | None = None
    """Label of a body that nothing holds."""
    moved: bool = False
    first: int = -1
    steps: int = 0

    def finding(self) -> Finding | None:
        if self.told or self.free is None:
            return None
        advice, site = Message("call p.setGravity(0, 0, -9.81)"), None
        if self.call is not None and self.after_g > 0:
            site = site_of(self.call)
            message = Message(
                "gravity is 0 from step {step:,} on, so {body} does not fall: p.resetSimulation() "
                "sets it from {gravity:.3g} m/s² back to 0",
                step=self.first - 1, body=self.free, gravity=self.after_g,
            )  # fmt: skip
            advice = Message("call p.setGravity(0, 0, -9.81) after each p.resetSimulation()")
        else:
            message = Message(
                "gravity is 0, so {body} does not fall: PyBullet starts without it", body=self.free
            )
        # What moves without gravity may be meant to.
        level = "note" if self.moved and site is None else "asked"
        span = Span(self.first, self.first + self.steps - 1, self.steps)
        return Finding(code="no-gravity", level=level, message=message, body=self.free,  # type: ignore[arg-type]
            advice=advice, site=site, steps=span)  # fmt: skip


class NoGravity(Answer):
    """Bodies that nothing holds, and that do not fall."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._now: dict[int, _Episode] = {}
        self._found: dict[tuple[int, bool], Finding] = {}
        self._gravity: dict[int, float] = {}

    def see(self, explained: Explained) -> None:
        """Follow what was asked for and what moved, episode by episode."""
        calls = [c for c in explained.piece.calls
            if c.function in ("resetSimulation", "setGravity", "createConstraint")
            or c.function.startswith("applyExternal")]  # fmt: skip
        ends = [c for c in calls if c.function == "resetSimulation"]
        starts = {c.client: explained.piece.first for c in ends}
        for call in calls:
            now = self._now.setdefault(call.client, _Episode(call.client))
            if call.function == "resetSimulation":
                first = starts[call.client]
                self._look(explained, call.client, first, call.at.step)
                starts[call.client] = call.at.step + 1
                self._close(now)
                before = self._gravity.pop(call.client, 0.0)
                self._now[call.client] = _Episode(call.client, before, call)
            else:
                now.told = True
                if call.function == "setGravity":
                    xyz = [number(call, f"grav{axis}", 0.0) for axis in "XYZ"]
                    self._gravity[call.client] = float(np.linalg.norm(xyz))
        for client in {body.client for body in self.scene.seen.bodies.values()}:
            first = starts.get(client, explained.piece.first)
            self._look(explained, client, first, explained.piece.end)

    def _look(self, explained: Explained, client: int, first: int, last: int) -> None:
        """Note what moved in the steps that led to samples `first` to `last`."""
        now = self._now.setdefault(client, _Episode(client))
        for judged in explained.bodies.values():
            body = judged.body
            if body.client != client or not body.base_moves:
                continue
            for steps in judged.stretches:
                rows = np.flatnonzero((steps.steps >= first) & (steps.steps <= last))
                if not len(rows):
                    continue
                if steps.reported.gravity_m_s2[rows].any():
                    now.told = True
                now.free = now.free or body.label
                now.moved |= bool(steps.after.velocity[rows].any())
                if now.first < 0:
                    now.first = int(steps.steps[rows[0]])
                now.steps = max(now.steps, int(steps.steps[rows[-1]]) - now.first + 1)

    def _close(self, episode: _Episode) -> None:
        found = episode.finding()
        if found is not None:
            self._found.setdefault((episode.client, episode.after_g > 0), found)

    def findings(self) -> Iterator[Finding]:
        """Yield the first episode of each kind."""
        for episode in self._now.values():
            self._close(episode)
        yield from self._found.values()


@dataclass
class _Changes:
    """Of the timestep of one simulation."""

    step: int
    """Steps before the first."""
    before_s: float
    after_s: float
    last: int
    count: int = 0
    call: Call | None = None


class TimestepChanged(Answer):
    """Steps of different length in the life of a body: a new scene may have others."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._last: dict[int, tuple[int, float]] = {}
        """By body, life and timestep of its last step."""
        self._changes: dict[int, _Changes] = {}

    def see(self, explained: Explained) -> None:
        """Compare each step's timestep with that of the step before."""
        found: dict[int, dict[int, tuple[float, float]]] = {}
        for judged in explained.bodies.values():
            for steps in judged.stretches:
                timestep_s, life = steps.reported.timestep_s, steps.epoch.life
                lived, last_s = self._last.get(judged.body.number, (life, timestep_s[0]))
                before_s = np.concatenate(([last_s if lived == life else timestep_s[0]],
                    timestep_s[:-1]))  # fmt: skip
                for row in np.flatnonzero(timestep_s != before_s).tolist():
                    change = float(before_s[row]), float(timestep_s[row])
                    found.setdefault(judged.body.client, {})[int(steps.steps[row]) - 1] = change
                self._last[judged.body.number] = life, float(timestep_s[-1])
        for client, changes in found.items():
            first = min(changes)
            new = _Changes(first, *changes[first], first)
            known = self._changes.setdefault(client, new)
            known.count += len(changes)
            known.last = max(changes)
            for call in explained.piece.calls if known is new else ():
                if call.function in SETS_TIMESTEP and (call.client, call.at.step) == (
                    client,
                    first,
                ):
                    known.call = call

    def findings(self) -> Iterator[Finding]:
        """Yield the first change of each simulation."""
        for each in self._changes.values():
            more = Message(" (the first of {n:,} changes)", n=each.count) if each.count > 1 else ""
            message = Message(
                "the timestep changes from {before} s to {after} s at step {step:,}{more}: motors "
                "and constraints keep force × timestep of their call, and a position motor closes "
                "a share of its gap per step",
                before=fraction(each.before_s), after=fraction(each.after_s), step=each.step,
                more=more,
            )  # fmt: skip
            low_s, high_s = sorted((each.before_s, each.after_s))
            ratio = high_s / low_s if low_s > 0 else 0.0
            yield Finding(
                code="timestep-changed", level="model", message=message,
                advice=Message("call p.setTimeStep once, before the first motor"),
                effect=Effect(ratio, "1"), share=ratio,
                steps=Span(each.step, each.last, each.count),
                site=None if each.call is None else site_of(each.call),
            )  # fmt: skip
