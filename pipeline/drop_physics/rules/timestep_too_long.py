"""Steps in which a body moves further than it is thick, or a robot's motors overshoot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.fields import fraction
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Noted, Notes, Scene

LONG_S = 1 / 30
"""A position motor's default closes a tenth of its gap in it, and a body falls 11 mm."""
ENDLESS_M = 1e20
"""A plane has a larger box."""


class TimestepTooLong(Answer):
    """Steps in which a body moves further than it is thick, or a robot's motors overshoot."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._far: Notes[int] = Notes()
        self._long: Notes[int] = Notes()

    def see(self) -> None:
        """Compare the way of each step that leads into a contact with the size of the body."""
        pairs = self.scene.touches.pairs
        for judged, steps in self.scene.stretches():
            body, box = judged.body, np.array(judged.body.bounds_m[:6])
            thick_m = float((box[3:] - box[:3]).min()) if len(box) == 6 else 0.0
            step_s = steps.reported.timestep_s / steps.epoch.substeps
            rows = np.flatnonzero(step_s > LONG_S) if body.joints else np.empty(0, np.intp)
            if len(rows):
                self._long.add(body.number, steps.steps[rows], step_s[rows])
            if body.joints or steps.law.tree.fixed or not 0 < thick_m < ENDLESS_M:
                continue
            way_m = np.linalg.norm(steps.after.velocity[:, 3:6], axis=1) * step_s
            rows = np.flatnonzero((way_m > thick_m) & np.isfinite(way_m))
            if not len(rows):
                continue
            touched = pairs.step[(pairs.body == body.number).any(axis=1)]
            ends = steps.steps[rows]
            rows = rows[np.isin(ends, touched) | np.isin(ends + 1, touched)]
            if len(rows):
                told = {"step": step_s[rows]}
                self._far.add(body.number, steps.steps[rows], way_m[rows], told, thick=thick_m)

    def findings(self) -> Iterator[Finding]:
        """Yield the worst step of each body."""
        for number, each in self._far.items():
            message = Message(
                "{body} moves {way:.3g} m in a step of {step_s} s, and is {thick:.3g} m thick: it "
                "can pass through others, or overlap them before contact acts",
                body=self.scene.body(number).label,
                way=each.most,
                step_s=fraction(each.at["step"]),
                thick=each.at["thick"],
            )
            yield self._finding(number, each, message, "m", each.most / each.at["thick"])
        for number, each in self._long.items():
            message = Message(
                "{body} is simulated in steps of {step_s} s: position motors close a share of "
                "their gap per step, and contacts act only at its end",
                body=self.scene.body(number).label,
                step_s=fraction(each.most),
            )
            yield self._finding(number, each, message, "s", each.most / LONG_S)

    def _finding(
        self, number: int, each: Noted, message: Message, unit: str, share: float
    ) -> Finding:
        return Finding(
            code="timestep-too-long",
            level="model",
            message=message,
            share=share,
            advice=Message("p.setTimeStep(…), smaller, before the motors"),
            steps=each.span,
            body=self.scene.body(number).label,
            effect=Effect(each.most, unit),
        )
