"""Targets that a joint cannot reach."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.arguments import calls_of, given, number
from drop_physics.analysis.explained.recording import Explained
from drop_physics.messages import Message
from drop_physics.seen.calls import Call
from drop_physics.seen.events import Body

POSITION_CONTROL = 2
BEYOND = 0.01
"""Share of a joint's range by which a target must miss it: a rounded limit does not."""
LIMITS = "jointLowerLimit", "jointUpperLimit"


@dataclass
class _Beyond:
    """Targets of one joint beyond its limits."""

    call: Call
    target: float
    limits: tuple[float, float]
    over: float
    first: int
    last: int
    count: int


class TargetClamped(Answer):
    """PyBullet moves a position target to the limit that it is beyond of."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._limits: dict[tuple[int, int], tuple[float, float]] = {}
        self._beyond: dict[int, dict[int, _Beyond]] = {}
        """By body and joint."""

    def see(self, explained: Explained) -> None:
        """Compare targets with the limits that hold when they are given."""
        names = "setJointMotorControl", "changeDynamics", "load"
        for call, body in calls_of(explained.piece, self.scene.seen.appearances, *names):
            if call.function == "changeDynamics":
                self._change(call, body)
            elif int(number(call, "controlMode", -1.0)) == POSITION_CONTROL:
                forces = given(call, "forces") or given(call, "force")
                if forces and not any(forces):
                    continue  # a motor without force has no target
                joints = given(call, "jointIndices") or given(call, "jointIndex")
                targets = given(call, "targetPositions") or given(call, "targetPosition")
                for joint, target in zip(joints, targets, strict=False):
                    self._compare(call, body, int(joint), target)

    def _change(self, call: Call, body: Body) -> None:
        low, high = (number(call, name, default)
            for name, default in zip(LIMITS, (1.0, -1.0), strict=True))  # fmt: skip
        if low <= high:
            self._limits[body.number, int(number(call, "linkIndex", -1.0))] = low, high

    def _compare(self, call: Call, body: Body, joint: int, target: float) -> None:
        if not 0 <= joint < len(body.joints):
            return
        told = body.joints[joint]
        low, high = self._limits.get((body.number, joint), told.limits)
        over = max(low - target, target - high)
        if told.kind not in ("revolute", "prismatic") or not low < high:
            return
        if not over > BEYOND * (high - low):
            return
        found = self._beyond.setdefault(body.number, {})
        step, known = call.at.step + 1, found.get(joint)
        if known is None:
            found[joint] = _Beyond(call, target, (low, high), over, step, step, 1)
            return
        known.count += step != known.last
        known.last = step
        if over > known.over:
            known.call, known.target, known.limits, known.over = call, target, (low, high), over

    def findings(self) -> Iterator[Finding]:
        """Yield the worst joint of each body."""
        for number_, found in self._beyond.items():
            joint, worst = max(found.items(), key=lambda pair: pair[1].over)
            body = self.scene.body(number_)
            told = body.joints[joint]
            unit = "m" if told.kind == "prismatic" else "rad"
            side = int(worst.target > worst.limits[1])
            more = Message(" (and {n} more)", n=len(found) - 1) if len(found) > 1 else ""
            message = Message(
                "{joint}{more} is sent to {target:.4g} {unit}, beyond its {side} limit of "
                "{limit:.4g} {unit}: PyBullet takes the limit as the target",
                joint=told.name, more=more, target=worst.target, unit=unit,
                side=Message("upper") if side else Message("lower"), limit=worst.limits[side],
            )  # fmt: skip
            yield Finding(
                code="target-clamped", level="asked", message=message, body=body.label,
                advice=Message(
                    "give a target within {low:.4g} and {high:.4g}, or other limits by "
                    "p.changeDynamics(body, {link}, jointLowerLimit=…, jointUpperLimit=…)",
                    low=worst.limits[0], high=worst.limits[1], link=joint,
                ),
                joint=told.name, effect=Effect(worst.over, unit),
                share=worst.over if unit == "rad" else worst.over / float(np.ptp(worst.limits)),
                steps=Span(worst.first, worst.last, worst.count), site=site_of(worst.call),
            )  # fmt: skip
