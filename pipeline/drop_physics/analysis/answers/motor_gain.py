"""Why a joint shakes about its target: gains are shares of the gap per step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import distance, units_of
from drop_physics.analysis.answers.off_target import OFF, name_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven, target_of
from drop_physics.analysis.targets import grows_with, rings_with
from drop_physics.messages import Message
from drop_physics.seen.calls import POSITION

Flags = NDArray[np.bool_]

CROSSINGS = 3
"""A joint that passes its target less often overshoots for another reason."""


@dataclass(kw_only=True)
class _Shakes:
    joint: str
    unit: str
    kp: float
    kd: float
    site: float
    first: int
    off: float = 0.0
    last: int = 0
    count: int = 0


class MotorGain(Answer):
    """Off its limit a motor leaves gaps e with e' = (2 - kp - kd) e - (1 - kd) e_before."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[int, _Shakes]] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                rings = rings_with(driven.asked.kp, driven.asked.kd)
                rings &= (driven.asked.mode == POSITION) & (driven.asked.pd != 1)
                for k in np.flatnonzero(rings.any(axis=0)).tolist():
                    self._see(self._joints.setdefault(number, {}), driven, k, rings[:, k])

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            shakes = [each for each in joints.values() if each.count >= CROSSINGS]
            if not shakes:
                continue
            worst = max(shakes, key=lambda each: each.off)
            largest = float(np.abs(np.roots([1, worst.kp + worst.kd - 2, 1 - worst.kd])).max())
            template = Message(
                "{joint} shakes about its target, by up to {off}: gains are shares per step, and "
                "with positionGain={kp:.3g}, velocityGain={kd:.3g} each step leaves {left:.2g} of "
                "the gap on the other side"
            )
            if largest >= 1:
                template = Message(
                    "{joint} shakes about its target, by up to {off}: gains are shares per step, "
                    "and with positionGain={kp:.3g}, velocityGain={kd:.3g} each step makes the "
                    "gap {left:.3g} times as large"
                )
            elif (2 - worst.kp - worst.kd) ** 2 < 4 * (1 - worst.kd):
                template = Message(
                    "{joint} swings about its target, by up to {off}: gains are shares per step, "
                    "and with positionGain={kp:.3g}, velocityGain={kd:.3g} a swing keeps "
                    "{left:.2g} of its size from step to step"
                )
            site = self.scene.joints.site(worst.site)
            yield Finding(
                code="motor-gain",
                level="asked",
                message=Message(
                    template, joint=worst.joint, off=distance(worst.off, worst.unit), kp=worst.kp,
                    kd=worst.kd, left=largest,
                ),
                advice=Message("p.setJointMotorControl2(…, positionGain=0.1, velocityGain=1)"),
                body=self.scene.body(number).label,
                joint=worst.joint,
                effect=Effect(worst.off, worst.unit),
                share=worst.off,
                steps=Span(worst.first, worst.last, worst.count),
                site=None if site is None else site_of(site),
            )  # fmt: skip

    def _see(self, joints: dict[int, _Shakes], driven: Driven, k: int, rings: Flags) -> None:
        unit, _ = units_of(driven, k)
        target, steps = target_of(driven)[:, k], driven.steps
        before, after = driven.before[:, k] - target, driven.after[:, k] - target
        # It passed the target in one step, its motor being free to do what the gains say; where
        # they make the gap grow, it ends at its limit.
        free = ~driven.at_limit[:, k] | grows_with(driven.asked.kp, driven.asked.kd)[:, k]
        passed = rings & (before * after < 0) & free
        passed &= np.maximum(np.abs(before), np.abs(after)) > OFF[unit]
        passed &= np.isfinite(driven.asked.kp[:, k] + driven.asked.kd[:, k])
        rows = np.flatnonzero(passed)
        if not len(rows):
            return
        asked, row = driven.asked, rows[0]
        shakes = joints.setdefault(
            k,
            _Shakes(
                joint=name_of(driven, k), unit=unit, kp=float(asked.kp[row, k]),
                kd=float(asked.kd[row, k]), site=float(asked.site[row, k]),
                first=int(steps.steps[row]),
            ),
        )  # fmt: skip
        shakes.count += len(rows)
        shakes.last = int(steps.steps[rows[-1]])
        shakes.off = max(shakes.off, float(np.abs(after[rows]).max()))
