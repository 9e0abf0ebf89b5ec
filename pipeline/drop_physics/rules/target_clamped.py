"""Targets that a joint cannot reach."""

from __future__ import annotations

from typing import Any

import numpy as np

from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Noted, and_more
from drop_physics.rules.joint import JointAnswer
from drop_physics.trace.motors import POSITION

BEYOND = 0.01
"""Share of a joint's range by which a target must miss it: a rounded limit does not."""


class TargetClamped(JointAnswer):
    """PyBullet moves a position target to the limit that it is beyond of."""

    code, level = "target-clamped", "asked"

    def look(self, driven: Driven) -> None:
        """Note where targets are beyond the limits that hold."""
        asked, law = driven.asked, driven.steps.law
        lower, upper = (
            np.broadcast_to(each, asked.target.shape) for each in (law.lower, law.upper)
        )
        with np.errstate(invalid="ignore"):
            over = np.maximum(lower - asked.target, asked.target - upper)
            beyond = (lower < upper) & (over > BEYOND * (upper - lower))
            on = (asked.mode == POSITION) & (asked.impulse > 0) & (asked.pd != 1)
        self.note(driven, on & beyond, over, target=asked.target, lower=lower, upper=upper)

    def words(self, worst: Noted) -> dict[str, Any]:
        """Return what is said of the joint whose target is farthest beyond."""
        target, low, high = (worst.at[name] for name in ("target", "lower", "upper"))
        unit, _ = worst.at["units"]
        message = Message(
            "{joint}{more} is sent to {target:.4g} {unit}, beyond its {side} limit of {limit:.4g} "
            "{unit}: PyBullet takes the limit as the target",
            joint=worst.at["joint"],
            more=and_more(worst.at["joints"]),
            target=target,
            unit=unit,
            side=Message("upper") if target > high else Message("lower"),
            limit=high if target > high else low,
        )
        advice = Message(
            "give a target within {low:.4g} and {high:.4g}, or other limits by "
            "p.changeDynamics(body, {link}, jointLowerLimit=…, jointUpperLimit=…)",
            low=low,
            high=high,
            link=worst.at["link"],
        )
        return {
            "message": message,
            "advice": advice,
            "effect": Effect(worst.most, unit),
            "share": worst.most if unit == "rad" else worst.most / (high - low),
        }
