"""How bodies move: put elsewhere, too far in a step, damped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.arguments import number
from drop_physics.analysis.explained.judged import FLIGHT, Judged
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.explained.steps import Steps
from drop_physics.fields import fraction
from drop_physics.laws.tree import States
from drop_physics.messages import Message
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Body

Float64 = NDArray[np.float64]

MOVING_M_S = 1e-3
KEPT = 1024
"""Calls before a piece whose step is in it."""
DAMPED = 0.01
"""Of the largest energy of a flight."""
LONG_S = 1 / 30
"""A position motor's default closes a tenth of its gap in it, and a body falls 11 mm."""
ENDLESS_M = 1e20
"""A plane has a larger box."""
PLACES, RESTORES = "resetBasePositionAndOrientation", "restoreState"


@dataclass
class _Jumps:
    body: Body
    first: int
    way_m: float
    speed_m_s: float
    call: Call
    last: int
    count: int = 0


class Teleported(Answer):
    """Bodies that a call puts elsewhere while they move; a restored state is none of these."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._last: dict[int, tuple[int, int, States]] = {}
        """By body: life, step, and the state of the last sample."""
        self._jumps: dict[int, _Jumps] = {}
        self._calls: list[Call] = []

    def see(self, explained: Explained) -> None:
        """Compare states that calls set with those before."""
        calls = [
            each for each in explained.piece.calls if each.function in (PLACES, "restoreState")
        ]
        self._calls = [*self._calls[-KEPT:], *calls]
        for body, judged in explained.bodies.items():
            for steps in judged.stretches:
                if steps.law.tree.fixed or not len(steps):
                    continue
                for row in np.flatnonzero(steps.put).tolist():
                    self._look(judged.body, steps, row)
                self._last[body] = (steps.epoch.life, int(steps.steps[-1]),
                    steps.after.at(np.array([len(steps) - 1])))  # fmt: skip

    def _look(self, body: Body, steps: Steps, row: int) -> None:
        step = int(steps.steps[row]) - 1
        before = steps.after.at(np.array([row - 1]))
        if row == 0:
            life, last, before = self._last.get(body.number, (-1, -1, before))
            if (life, last) != (steps.epoch.life, step):
                return
        elif steps.steps[row - 1] != step:
            return
        way_m = float(np.linalg.norm(steps.before.position_m[row] - before.position_m[0]))
        speed_m_s = float(np.linalg.norm(before.velocity[0, 3:6]))
        calls = [c for c in self._calls if (c.client, c.at.step) == (body.client, step)]
        own = [c for c in calls if number(c, "bodyUniqueId") == body.engine_id]
        if not own or any(c.function == RESTORES for c in calls):
            return
        if way_m > 0 and speed_m_s > MOVING_M_S:
            known = self._jumps.setdefault(
                body.number, _Jumps(body, step, way_m, speed_m_s, own[-1], step)
            )
            known.last, known.count = step, known.count + 1

    def findings(self) -> Iterator[Finding]:
        """Yield the first time of each body."""
        for each in self._jumps.values():
            more = Message(" (the first of {n:,} times)", n=each.count) if each.count > 1 else ""
            message = Message(
                "{body} is put {way:.3g} m away at step {step:,}{more}, while it moves at "
                "{speed:.3g} m/s: no force takes it there",
                body=each.body.label, way=each.way_m, step=each.first, more=more,
                speed=each.speed_m_s,
            )  # fmt: skip
            yield Finding(
                code="teleported", level="note", message=message, body=each.body.label,
                effect=Effect(each.way_m, "m"), steps=Span(each.first, each.last, each.count),
                site=site_of(each.call),
            )  # fmt: skip


@dataclass
class _Long:
    body: Body
    step: int
    way_m: float
    thick_m: float
    step_s: float
    first: int
    last: int
    count: int = 0


class TimestepTooLong(Answer):
    """Steps in which a body moves further than it is thick, or a robot's motors overshoot."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._far: dict[int, _Long] = {}
        self._long: dict[int, _Long] = {}

    def see(self, explained: Explained) -> None:
        """Compare the way of each step with the size of the body."""
        several: dict[int, int] = {}
        for each in self.scene.seen.bodies.values():
            several[each.client] = several.get(each.client, 0) + bool(each.collisions)
        for body, judged in explained.bodies.items():
            for steps in judged.stretches:
                step_s = steps.reported.timestep_s / max(steps.epoch.substeps, 1)
                rows = np.flatnonzero(step_s > LONG_S)
                if judged.body.joints and len(rows):
                    _note(self._long, body, judged, steps, rows, step_s, np.zeros(len(steps)), 0)
                box = np.array(judged.body.bounds_m[:6])
                if judged.body.joints or len(box) < 6 or several[judged.body.client] < 2:
                    continue
                thick_m = float((box[3:] - box[:3]).min())
                if steps.law.tree.fixed or not 0 < thick_m < ENDLESS_M:
                    continue
                way_m = np.linalg.norm(steps.after.velocity[:, 3:6], axis=1) * step_s
                rows = np.flatnonzero((way_m > thick_m) & np.isfinite(way_m))
                if len(rows):
                    _note(self._far, body, judged, steps, rows, step_s, way_m, thick_m)

    def findings(self) -> Iterator[Finding]:
        """Yield the worst step of each body."""
        advice = Message("p.setTimeStep(…), smaller, before the motors")
        for each in self._far.values():
            message = Message(
                "{body} moves {way:.3g} m in a step of {step_s} s, and is {thick:.3g} m thick: it "
                "can pass through others, or overlap them before contact acts",
                body=each.body.label, way=each.way_m, step_s=fraction(each.step_s),
                thick=each.thick_m,
            )  # fmt: skip
            yield Finding(
                code="timestep-too-long", level="model", message=message, body=each.body.label,
                advice=advice, effect=Effect(each.way_m, "m"), share=each.way_m / each.thick_m,
                steps=Span(each.first, each.last, each.count),
            )  # fmt: skip
        for each in self._long.values():
            message = Message(
                "{body} is simulated in steps of {step_s} s: position motors close a share of "
                "their gap per step, and contacts act only at its end",
                body=each.body.label, step_s=fraction(each.step_s),
            )  # fmt: skip
            yield Finding(
                code="timestep-too-long", level="model", message=message, body=each.body.label,
                advice=advice, effect=Effect(each.step_s, "s"), share=each.step_s / LONG_S,
                steps=Span(each.first, each.last, each.count),
            )  # fmt: skip


def _note(
    known: dict[int, _Long], body: int, judged: Judged, steps: Steps, rows: NDArray[np.intp],
    step_s: Float64, way_m: Float64, thick_m: float,
) -> None:  # fmt: skip
    worst = int(rows[np.argmax(way_m[rows])])
    first, last = int(steps.steps[rows[0]]), int(steps.steps[rows[-1]])
    own = _Long(judged.body, int(steps.steps[worst]), float(way_m[worst]), thick_m,
        float(step_s[worst]), first, last)  # fmt: skip
    each = known.setdefault(body, own)
    each.last, each.count = last, each.count + len(rows)
    if own.way_m > each.way_m:
        each.step, each.way_m, each.step_s = own.step, own.way_m, own.step_s


@dataclass
class _Damped:
    body: Body
    taken_j: float = 0.0
    largest_j: float = 0.0
    first: int = -1
    last: int = -1
    count: int = 0


class DefaultDamping(Answer):
    """Energy that PyBullet's own damping takes from bodies in the air."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._damped: dict[int, _Damped] = {}

    def see(self, explained: Explained) -> None:
        """Add up what damping took in flights of bodies whose damping no call set."""
        for body, judged in explained.bodies.items():
            if judged.body.joints or not judged.body.base_moves:
                continue
            for steps in judged.stretches:
                damping = steps.changes.energy_j.get("damping")
                if damping is None or steps.epoch.damping != (None, None):
                    continue
                rows = np.flatnonzero(
                    judged.segment[np.searchsorted(judged.steps, steps.steps)] == FLIGHT
                )
                if not len(rows):
                    continue
                known = self._damped.setdefault(body, _Damped(judged.body))
                spin, speed = (np.linalg.norm(steps.after.velocity[rows, k : k + 3], axis=1)
                    for k in (0, 3))  # fmt: skip
                tree = steps.law.tree
                energy_j = tree.masses_kg[0] * speed**2 + tree.inertias_kg_m2[0].max() * spin**2
                known.largest_j = max(known.largest_j, float(energy_j.max()) / 2)
                known.taken_j -= float(damping[rows].sum())
                known.first = int(steps.steps[rows[0]]) if known.first < 0 else known.first
                known.last, known.count = int(steps.steps[rows[-1]]), known.count + len(rows)

    def findings(self) -> Iterator[Finding]:
        """Yield the bodies that lost more than a hundredth of their energy."""
        for each in self._damped.values():
            if each.taken_j > DAMPED * each.largest_j:
                message = Message(
                    "{body} loses {taken:.3g} J in the air, of at most {largest:.3g} J of motion: "
                    "PyBullet damps every body, by 0.04 unless a call sets it",
                    body=each.body.label, taken=each.taken_j, largest=each.largest_j,
                )  # fmt: skip
                yield Finding(
                    code="default-damping", level="model", message=message, body=each.body.label,
                    advice=Message(
                        "p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)"
                    ),
                    effect=Effect(each.taken_j, "J"), share=min(each.taken_j / each.largest_j, 1),
                    steps=Span(each.first, each.last, each.count),
                )  # fmt: skip
