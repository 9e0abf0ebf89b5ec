"""Why a motor has another force than it was given: the timestep changed after the call."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import effort, units_of
from drop_physics.analysis.answers.off_target import name_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven
from drop_physics.messages import Message

OTHER = 0.01
"""A force that differs by less than this share is the one that was given."""


@dataclass(kw_only=True)
class _Changed:
    name: str
    unit: str
    limit: float
    force: float
    site: float
    first: int
    last: int = 0
    count: int = 0

    @property
    def share(self) -> float:
        """How far apart they are, of the force that was given."""
        return abs(self.limit - self.force) / self.force


class TimestepAfterMotor(Answer):
    """PyBullet keeps force × timestep of the call, which a later timestep divides again."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[int, _Changed]] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                self._see(self._joints.setdefault(number, {}), driven)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            if not joints:
                continue
            worst = max(joints.values(), key=lambda each: each.share)
            site = self.scene.joints.site(worst.site)
            yield Finding(
                code="timestep-after-motor",
                level="asked",
                message=Message(
                    "{joint} has a motor of {limit} in place of the {force} it was given: the "
                    "timestep was changed after that call",
                    joint=worst.name, limit=effort(worst.limit, worst.unit),
                    force=effort(worst.force, worst.unit),
                ),
                advice=Message("call p.setTimeStep before the motors are commanded"),
                body=self.scene.body(number).label,
                joint=worst.name,
                effect=Effect(abs(worst.limit - worst.force), worst.unit),
                share=worst.share,
                steps=Span(worst.first, worst.last, worst.count),
                site=None if site is None else site_of(site),
            )  # fmt: skip

    def _see(self, joints: dict[int, _Changed], driven: Driven) -> None:
        asked, torque = driven.asked, np.abs(driven.torque)
        with np.errstate(invalid="ignore"):
            other = np.abs(driven.limit - asked.force) > OTHER * asked.force
            # It was reached, or what was asked for would have been.
            matters = driven.at_limit | (torque > (1 + OTHER) * asked.force)
        found = other & matters & (asked.pd != 1) & (asked.force > 0)
        for k in np.flatnonzero(found.any(axis=0)).tolist():
            rows = np.flatnonzero(found[:, k])
            steps = driven.steps.steps[rows]
            worst = joints.setdefault(
                k,
                _Changed(
                    name=name_of(driven, k), unit=units_of(driven, k)[1],
                    limit=float(driven.limit[rows[0], k]), force=float(asked.force[rows[0], k]),
                    site=float(asked.site[rows[0], k]), first=int(steps[0]),
                ),
            )  # fmt: skip
            worst.last, worst.count = int(steps[-1]), worst.count + len(rows)
