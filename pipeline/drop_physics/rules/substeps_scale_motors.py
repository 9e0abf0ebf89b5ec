"""Why a motor gives more than its limit: with substeps the limit counts in each of them."""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np

from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.rules.answer import Effect, Noted, Scene
from drop_physics.rules.joint import JointAnswer, effort

BEYOND = 0.01
"""What exceeds the limit by less than this share is at it."""


class SubstepsScaleMotors(JointAnswer):
    """With `numSubSteps` a motor gives up to force × timestep in each substep."""

    code, level = "substeps-scale-motors", "asked"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._told: dict[int, list[tuple[int, int]]] = {}
        for each in scene.seen.settings:
            substeps = int(np.ravel(each.values["numSubSteps"])[0])
            self._told.setdefault(each.client, []).append((each.at.step, substeps))

    def look(self, driven: Driven) -> None:
        """Note where motors give more than their limit: what is reported is a substep's share."""
        told, asked = self._told[driven.body.client], driven.asked
        if "substeps" not in driven.steps.epoch.reasons or (
            len({substeps for _, substeps in told if substeps > 1}) > 1
        ):
            return
        at = bisect_right(told, (int(driven.steps.steps[0]) - 1, 1 << 30)) - 1
        substeps = np.full_like(driven.torque, told[max(at, 0)][1])
        given = np.abs(driven.torque) * substeps
        with np.errstate(invalid="ignore", divide="ignore"):
            share = given / driven.limit - 1
            which = (share > BEYOND) & (asked.force > 0) & (asked.pd != 1)
        self.note(driven, which, share, given=given, force=driven.limit, substeps=substeps)

    def words(self, worst: Noted) -> dict[str, Any]:
        """Return what is said of the joint that got most beyond its limit."""
        given, force, (_, unit) = (worst.at[name] for name in ("given", "force", "units"))
        substeps = int(worst.at["substeps"])
        message = Message(
            "{joint} has a motor that gives up to {given}, where {force} is its limit: with "
            "numSubSteps={substeps} the limit counts in each substep",
            joint=worst.at["joint"],
            given=effort(given, unit),
            force=effort(force, unit),
            substeps=substeps,
        )
        advice = Message(
            "in place of substeps set the timestep to 1/{substeps} of it, before the motors are "
            "commanded, and step {substeps} times",
            substeps=substeps,
        )
        return {
            "message": message,
            "advice": advice,
            "share": worst.most,
            "effect": Effect(given - force, unit),
        }
