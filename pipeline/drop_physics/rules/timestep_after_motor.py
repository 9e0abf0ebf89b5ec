"""Why a motor has another force than it was given: the timestep was set after its call."""

from __future__ import annotations

from typing import Any

import numpy as np

from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Noted
from drop_physics.rules.joint import JointAnswer, effort

OTHER = 0.01
"""A force that differs by less than this share is the one that was given."""


class TimestepAfterMotor(JointAnswer):
    """PyBullet keeps force × timestep of the call, which a later timestep divides again."""

    code, level = "timestep-after-motor", "asked"

    def look(self, driven: Driven) -> None:
        """Note where that limit, or the one that was asked for, is met."""
        asked, force = driven.asked, driven.asked.force
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.round(np.abs(driven.limit - force) / force, 9)
            met = driven.at_limit | (np.abs(driven.torque) > (1 + OTHER) * force)
            which = met & (share > OTHER) & (force > 0) & (asked.pd != 1)
        self.note(driven, which, share, limit=driven.limit, force=force)

    def words(self, worst: Noted) -> dict[str, Any]:
        """Return what is said of the joint whose limit is farthest from what was asked."""
        limit, force, (_, unit) = (worst.at[name] for name in ("limit", "force", "units"))
        message = Message(
            "{joint} has a motor of {limit} in place of the {force} it was given: the timestep was "
            "changed after that call",
            joint=worst.at["joint"],
            limit=effort(limit, unit),
            force=effort(force, unit),
        )
        return {
            "message": message,
            "share": worst.most,
            "effect": Effect(abs(limit - force), unit),
            "advice": Message("call p.setTimeStep before the motors are commanded"),
        }
