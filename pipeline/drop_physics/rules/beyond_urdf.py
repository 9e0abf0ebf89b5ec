"""Why a robot is faster or stronger than the real one: the limits in its file do not act."""

from __future__ import annotations

from typing import Any

import numpy as np

from drop_physics.explain.commands import DEFAULT
from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Noted, so_many
from drop_physics.rules.joint import JointAnswer, effort

BEYOND = 0.01
"""A limit is exceeded by more than this share of it."""


class BeyondUrdf(JointAnswer):
    """`getJointInfo` reports the effort and velocity of a file, and no motor heeds them."""

    code, level = "beyond-urdf", "model"

    def look(self, driven: Driven) -> None:
        """Note where motors that calls set drive a joint beyond a limit, after the start."""
        told = (driven.asked.mode != DEFAULT) | (driven.asked.pd == 1)
        told &= (driven.steps.steps > 1)[:, None]
        fast = told & (driven.torque * driven.rate > 0)
        for name, values, which in (
            ("velocity", driven.rate, fast),
            ("effort", driven.torque, told),
        ):
            joints = driven.body.joints
            limits = [
                getattr(each, name) * (each.widths[1] == 1)
                for each in joints
                for _ in range(each.widths[1])
            ]
            limit = np.broadcast_to(np.array(limits), values.shape)
            size = np.abs(values)
            beyond = which & (limit > 0) & (size > (1 + BEYOND) * limit)
            share = 1 - limit / np.maximum(size, 1e-300)
            self.note(driven, beyond, share, name, most=size, limit=limit)

    def words(self, worst: Noted) -> dict[str, Any]:
        """Return what is said of the joint that is farthest beyond."""
        most, limit, (position, force) = (worst.at[name] for name in ("most", "limit", "units"))
        fast = worst.at["kind"] == "velocity"
        unit = f"{position}/s" if fast else force
        message = Message(
            "{joint} reaches {most} where its file allows {limit}, in {steps}: PyBullet's "
            "motors do not heed that limit (joints beyond theirs: {count})",
            joint=worst.at["joint"],
            most=effort(most, unit),
            limit=f"{limit:g} {unit}",
            steps=so_many(worst.count),
            count=worst.at["joints"],
        )
        name = "maxVelocity" if fast else "force"
        advice = Message("p.setJointMotorControl2(…, {name}={limit:g})", name=name, limit=limit)
        return {
            "message": message,
            "advice": advice,
            "effect": Effect(most - limit, unit),
            "share": worst.most,
        }
