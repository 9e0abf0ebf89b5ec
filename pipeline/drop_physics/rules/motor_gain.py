"""Why a joint shakes about its target: gains are shares of the gap per step."""

from __future__ import annotations

from typing import Any

import numpy as np

from drop_physics.explain.joints import Driven, target_of
from drop_physics.explain.targets import grows_with, rings_with
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Noted
from drop_physics.rules.joint import OFF, JointAnswer, distance, units_of
from drop_physics.trace.motors import POSITION

CROSSINGS = 3
"""A joint that passes its target less often overshoots for another reason."""


class MotorGain(JointAnswer):
    """Off its limit a motor leaves gaps e with e' = (2 - kp - kd) e - (1 - kd) e_before."""

    code, level = "motor-gain", "asked"

    def look(self, driven: Driven) -> None:
        """Note where a joint passes its target in one step, as its gains say."""
        asked, target = driven.asked, target_of(driven)
        rings = rings_with(asked.kp, asked.kd) & np.isfinite(asked.kp + asked.kd)
        rings &= (asked.mode == POSITION) & (asked.pd != 1)
        if not rings.any():
            return
        before, after = driven.before - target, driven.after - target
        # Off its limit a motor does what the gains say; where they make gaps grow, it ends there.
        free = ~driven.at_limit | grows_with(asked.kp, asked.kd)
        least = [OFF[units_of(driven, k)[0]] for k in range(target.shape[1])]
        seen = np.maximum(np.abs(before), np.abs(after)) > least
        passed = rings & free & seen & (before * after < 0)
        self.note(driven, passed, np.abs(after), kp=asked.kp, kd=asked.kd)

    def says(self, noted: Noted) -> bool:
        """Return whether it passed its target often."""
        return noted.count >= CROSSINGS

    def words(self, worst: Noted) -> dict[str, Any]:
        """Return what is said of the joint that gets farthest off."""
        kp, kd, (unit, _) = (worst.at[name] for name in ("kp", "kd", "units"))
        left = float(np.abs(np.roots([1, kp + kd - 2, 1 - kd])).max())
        each = Message("each step leaves {left:.2g} of the gap on the other side", left=left)
        if left >= 1:
            each = Message("each step makes the gap {left:.3g} times as large", left=left)
        elif (2 - kp - kd) ** 2 < 4 * (1 - kd):
            each = Message("a swing keeps {left:.2g} of its size from step to step", left=left)
        message = Message(
            "{joint} shakes about its target, by up to {off}: gains are shares per step, and with "
            "positionGain={kp:.3g}, velocityGain={kd:.3g} {each}",
            joint=worst.at["joint"],
            off=distance(worst.most, unit),
            kp=kp,
            kd=kd,
            each=each,
        )
        return {
            "message": message,
            "effect": Effect(worst.most, unit),
            "share": worst.most,
            "advice": Message("p.setJointMotorControl2(…, positionGain=0.1, velocityGain=1)"),
        }
