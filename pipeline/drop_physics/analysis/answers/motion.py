"""How bodies move: put elsewhere, too far in a step, damped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Noted, Notes, Scene
from drop_physics.analysis.answers.placing import Placing
from drop_physics.analysis.explained.changes import energy_of
from drop_physics.analysis.explained.judged import FLIGHT
from drop_physics.analysis.explained.recording import Explained
from drop_physics.fields import fraction
from drop_physics.laws.tree import States
from drop_physics.messages import Message

MOVING_M_S = 1e-3
DAMPED = 0.01
"""Of the largest energy of a flight."""
LONG_S = 1 / 30
"""A position motor's default closes a tenth of its gap in it, and a body falls 11 mm."""
ENDLESS_M = 1e20
"""A plane has a larger box."""


class Teleported(Answer):
    """Bodies that a call puts elsewhere while they move; a restored state is none of these."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._placing = Placing(scene)
        self._last: dict[int, tuple[int, int, States]] = {}
        """By body: life, step, and the state of the last sample."""
        self._jumps: Notes[int] = Notes()

    def see(self, explained: Explained) -> None:
        """Compare states that calls set with those before."""
        self._placing.see(explained)
        for number, judged in explained.bodies.items():
            for steps in judged.stretches:
                if steps.law.tree.fixed or not len(steps):
                    continue
                life, rows = steps.epoch.life, np.flatnonzero(steps.put[1:]) + 1
                pairs = [(steps.after.at(rows - 1), steps.steps[rows - 1], rows)]
                known = self._last.get(number)
                if steps.put[0] and known is not None and known[0] == life:
                    pairs.insert(0, (known[2], np.array([known[1]]), np.array([0])))
                for came, at, its in pairs:
                    way = steps.before.position_m[its] - came.position_m
                    way_m, speed = (np.linalg.norm(each, axis=1)
                        for each in (way, came.velocity[:, 3:6]))  # fmt: skip
                    moved = (way_m > 0) & (speed > MOVING_M_S) & (at == steps.steps[its] - 1)
                    moved &= ~self._placing.restored(number, steps.steps[its])
                    if moved.any():
                        told = {"way": way_m[moved], "speed": speed[moved]}
                        first = np.arange(int(moved.sum()), 0, -1.0)  # of all the first is told
                        self._jumps.add(number, at[moved], first, told)
                self._last[number] = life, int(steps.steps[-1]), steps.after.at(slice(-1, None))

    def findings(self) -> Iterator[Finding]:
        """Yield the first time of each body."""
        for number, each in self._jumps.items():
            body = self.scene.body(number)
            more = Message(" (the first of {n:,} times)", n=each.count) if each.count > 1 else ""
            message = Message(
                "{body} is put {way:.3g} m away at step {step:,}{more}, while it moves at "
                "{speed:.3g} m/s: no force takes it there",
                body=body.label, way=each.at["way"], step=each.first, more=more,
                speed=each.at["speed"],
            )  # fmt: skip
            yield Finding(
                code="teleported", level="note", message=message, body=body.label,
                effect=Effect(each.at["way"], "m"), steps=each.span,
                site=self._placing.site(body, each.last + 1),
            )  # fmt: skip


class TimestepTooLong(Answer):
    """Steps in which a body moves further than it is thick, or a robot's motors overshoot."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._far: Notes[int] = Notes()
        self._long: Notes[int] = Notes()

    def see(self, explained: Explained) -> None:
        """Compare the way of each step with the size of the body."""
        with_shape = [each.client for each in self.scene.seen.bodies.values() if each.collisions]
        for number, judged in explained.bodies.items():
            body, box = judged.body, np.array(judged.body.bounds_m[:6])
            thick_m = float((box[3:] - box[:3]).min()) if len(box) == 6 else 0.0
            for steps in judged.stretches:
                step_s = steps.reported.timestep_s / max(steps.epoch.substeps, 1)
                rows = np.flatnonzero(step_s > LONG_S) if body.joints else np.empty(0, np.intp)
                if len(rows):
                    self._long.add(number, steps.steps[rows], step_s[rows])
                if body.joints or steps.law.tree.fixed or with_shape.count(body.client) < 2:
                    continue
                way_m = np.linalg.norm(steps.after.velocity[:, 3:6], axis=1) * step_s
                rows = np.flatnonzero((way_m > thick_m) & np.isfinite(way_m))
                if len(rows) and 0 < thick_m < ENDLESS_M:
                    told = {"step": step_s[rows]}
                    self._far.add(number, steps.steps[rows], way_m[rows], told, thick=thick_m)

    def findings(self) -> Iterator[Finding]:
        """Yield the worst step of each body."""
        for number, each in self._far.items():
            message = Message(
                "{body} moves {way:.3g} m in a step of {step_s} s, and is {thick:.3g} m thick: it "
                "can pass through others, or overlap them before contact acts",
                body=self.scene.body(number).label, way=each.most,
                step_s=fraction(each.at["step"]), thick=each.at["thick"],
            )  # fmt: skip
            yield self._finding(number, each, message, "m", each.most / each.at["thick"])
        for number, each in self._long.items():
            message = Message(
                "{body} is simulated in steps of {step_s} s: position motors close a share of "
                "their gap per step, and contacts act only at its end",
                body=self.scene.body(number).label, step_s=fraction(each.most),
            )  # fmt: skip
            yield self._finding(number, each, message, "s", each.most / LONG_S)

    def _finding(
        self, number: int, each: Noted, message: Message, unit: str, share: float
    ) -> Finding:
        return Finding(
            code="timestep-too-long", level="model", message=message, share=share,
            advice=Message("p.setTimeStep(…), smaller, before the motors"), steps=each.span,
            body=self.scene.body(number).label, effect=Effect(each.most, unit),
        )  # fmt: skip


@dataclass
class _Damped:
    noted: Noted
    taken_j: float = 0.0
    largest_j: float = 0.0


class DefaultDamping(Answer):
    """Energy that PyBullet's own damping takes from bodies in the air."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._damped: dict[tuple[int, int], _Damped] = {}
        """By body and its life."""

    def see(self, explained: Explained) -> None:
        """Add up what damping took in flights of bodies whose damping no call set."""
        for number, judged in explained.bodies.items():
            for steps in judged.stretches:
                damping = steps.changes.energy_j.get("damping")
                if damping is None or steps.epoch.damping != (None, None):
                    continue
                kinds = judged.segment[np.searchsorted(judged.steps, steps.steps)]
                rows = np.flatnonzero(kinds == FLIGHT)
                if len(rows):
                    first = _Damped(Noted(int(steps.steps[rows[0]])))
                    known = self._damped.setdefault((number, steps.epoch.life), first)
                    for states in (steps.before.at(rows[:1]), steps.after.at(rows)):
                        none = np.zeros((len(states), 3))
                        energy_j = float(energy_of(steps.law, states, none)[0].max())
                        known.largest_j = max(known.largest_j, energy_j)
                    known.taken_j -= float(damping[rows].sum())
                    known.noted.last = int(steps.steps[rows[-1]])
                    known.noted.count += len(rows)

    def findings(self) -> Iterator[Finding]:
        """Yield the bodies that lost more than a hundredth of their energy."""
        worst: dict[int, _Damped] = {}
        for (number, _), each in self._damped.items():
            if each.taken_j > max(DAMPED * each.largest_j, worst.get(number, each).taken_j * 0.999):
                worst[number] = each
        for number, each in worst.items():
            label = self.scene.body(number).label
            message = Message(
                "{body} loses {taken:.3g} J in the air, of at most {largest:.3g} J of motion: "
                "PyBullet damps every body, by 0.04 unless a call sets it",
                body=label, taken=each.taken_j, largest=each.largest_j,
            )  # fmt: skip
            yield Finding(
                code="default-damping", level="model", message=message, body=label,
                advice=Message("p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)"),
                effect=Effect(each.taken_j, "J"), share=min(each.taken_j / each.largest_j, 1),
                steps=each.noted.span,
            )  # fmt: skip
