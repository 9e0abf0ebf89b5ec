"""Why a joint does not turn as fast as it is told to: its motor gives all it may."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np

from drop_physics.explain.joints import Driven
from drop_physics.explain.targets import flips
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Noted, Scene, and_more
from drop_physics.rules.held_off import at_limit, give_at_least, holds_off
from drop_physics.rules.joint import JointAnswer, effort
from drop_physics.trace.motors import VELOCITY

SLOW = 0.5
"""Of its target: a joint that turns slower has not reached it."""


class TooSlow(JointAnswer):
    """A velocity motor that is at its limit, most of the time that its target stood.

    What grips something, or presses its stop, is to stand still; and a target beyond every rate
    stands for a constant force.
    """

    code, level = "off-target", "asked"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._told: defaultdict[tuple[int, int], tuple[int, int]] = defaultdict(lambda: (0, 0))
        """By robot and rate: in how many steps it has a velocity to reach, and the last of them."""

    def look(self, driven: Driven) -> None:
        """Note the steps in which a velocity motor is at its limit."""
        asked, target = driven.asked, driven.asked.target_velocity
        told = (asked.mode == VELOCITY) & (asked.impulse > 0) & (target != 0)
        told &= np.abs(target) < driven.steps.law.velocity_limit
        weak = told & driven.at_limit & ~flips(driven)  # else that is motor-gain's
        takes, number = np.full_like(target, np.nan), driven.body.number
        for k in np.flatnonzero(told.any(axis=0)).tolist():
            row = int(np.flatnonzero(told[:, k])[-1])
            count, last = int(told[:, k].sum()), int(driven.steps.steps[row])
            self._told[number, k] = self._told[number, k][0] + count, last
            if weak[row, k]:
                held, way = self.scene.joints.holding(driven, row), float(np.sign(target[row, k]))
                weak[:, k] &= held.stops[k] * way >= 0 and not holds_off(self.scene, held, k, -way)
                takes[:, k] = held.needs[k] * way
        when = np.broadcast_to(driven.steps.steps[:, None].astype(np.float64), target.shape)
        rates = np.broadcast_to(np.arange(target.shape[1], dtype=np.float64), target.shape)
        self.note(
            driven,
            weak,
            when,
            rate=driven.rate,
            target=target,
            limit=driven.limit,
            takes=takes,
            force=asked.force,
            k=rates,
            number=np.full_like(target, number),
        )

    def says(self, noted: Noted) -> bool:
        """Return whether it is at its limit in most of these steps, and slow in the last."""
        at = noted.at
        steps, last = self._told[at["number"], at["k"]]
        slow = at["rate"] / at["target"] < SLOW
        return slow and noted.last == last and noted.count > steps / 2

    def words(self, worst: Noted) -> dict[str, Any]:
        """Return what is said of the joint that was slow for longest."""
        at, (unit, force_unit) = worst.at, worst.at["units"]
        rate, target, takes = at["rate"], at["target"], at["takes"]
        weak = at_limit(
            effort(at["limit"], force_unit), worst.count, self._told[at["number"], at["k"]][0]
        )
        advice = cure = None
        if takes > at["limit"]:
            weak = Message(
                "{weak}; holding it here takes {here}", weak=weak, here=effort(takes, force_unit)
            )
            advice, cure = give_at_least(takes, force_unit, at["force"])
            if cure.name == "force":
                cure = replace(cure, target=at["joint"] if at["joints"] == 1 else None)
        message = Message(
            "{joint}{more} ends at {rate:.2g} {unit}, its target is {target:.3g}: {weak}",
            joint=at["joint"],
            more=and_more(at["joints"]),
            rate=rate,
            unit=f"{unit}/s",
            target=target,
            weak=weak,
        )
        gap = abs(target - rate)
        return {
            "message": message,
            "advice": advice,
            "cure": cure,
            "effect": Effect(gap, f"{unit}/s"),
            "share": gap / abs(target),
        }
