"""Why a motor is stronger than it was told: its limit counts in each substep."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import effort, units_of
from drop_physics.analysis.answers.off_target import name_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven
from drop_physics.messages import Message

MORE = 0.01
"""A motor that gives less than this share more than it may is at its limit."""


@dataclass(kw_only=True)
class _Stronger:
    name: str
    unit: str
    force: float
    substeps: int
    site: float
    first: int
    given: float = 0.0
    """The largest effort that it gave: the reported one is a substep's share."""
    last: int = 0
    count: int = 0


class SubstepsScaleMotors(Answer):
    """With `numSubSteps` a motor gives up to force × timestep in each substep."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[int, _Stronger]] = {}
        self._told: dict[int, list[tuple[int, int]]] = {}
        for each in scene.seen.settings:
            substeps = int(np.ravel(each.values["numSubSteps"])[0])
            self._told.setdefault(each.client, []).append((each.at.step, substeps))

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                if "substeps" in driven.steps.epoch.reasons:
                    self._see(self._joints.setdefault(number, {}), driven)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            if not joints:
                continue
            worst = max(joints.values(), key=lambda each: each.given / each.force)
            site = self.scene.joints.site(worst.site)
            yield Finding(
                code="substeps-scale-motors",
                level="asked",
                message=Message(
                    "{joint} has a motor that gives up to {given}, where {force} is its limit: "
                    "with numSubSteps={substeps} the limit counts in each substep",
                    joint=worst.name, given=effort(worst.given, worst.unit),
                    force=effort(worst.force, worst.unit), substeps=worst.substeps,
                ),
                advice=Message(
                    "in place of substeps set the timestep to 1/{substeps} of it, before the "
                    "motors are commanded, and step {substeps} times",
                    substeps=worst.substeps,
                ),
                body=self.scene.body(number).label,
                joint=worst.name,
                effect=Effect(worst.given - worst.force, worst.unit),
                share=worst.given / worst.force - 1,
                steps=Span(worst.first, worst.last, worst.count),
                site=None if site is None else site_of(site),
            )  # fmt: skip

    def _see(self, joints: dict[int, _Stronger], driven: Driven) -> None:
        asked = driven.asked
        told = self._told[driven.body.client]
        if len({substeps for _, substeps in told if substeps > 1}) > 1:
            return
        at = bisect_right(told, (int(driven.steps.steps[0]) - 1, 1 << 30)) - 1
        substeps = told[max(at, 0)][1]
        given = np.abs(driven.torque) * substeps
        with np.errstate(invalid="ignore"):
            found = (given > (1 + MORE) * driven.limit) & (asked.force > 0) & (asked.pd != 1)
        for k in np.flatnonzero(found.any(axis=0)).tolist():
            rows = np.flatnonzero(found[:, k])
            steps = driven.steps.steps[rows]
            worst = joints.setdefault(
                k,
                _Stronger(
                    name=name_of(driven, k), unit=units_of(driven, k)[1], substeps=substeps,
                    force=float(driven.limit[rows[0], k]), site=float(asked.site[rows[0], k]),
                    first=int(steps[0]),
                ),
            )  # fmt: skip
            worst.given = max(worst.given, float(given[rows, k].max()))
            worst.last, worst.count = int(steps[-1]), worst.count + len(rows)
