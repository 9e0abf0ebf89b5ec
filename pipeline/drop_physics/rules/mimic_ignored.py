"""Why a joint does not follow the other that its file names: PyBullet ignores `<mimic>`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.explain.commands import DEFAULT
from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Effect, Finding, Scene
from drop_physics.rules.joint import distance, units_of
from drop_physics.trace.events import Mimic

FOLLOWS = 0.01
"""A joint that is off by less than this share of its range follows."""


@dataclass
class _Off:
    mimic: Mimic
    unit: str
    extent: float
    """Of the joint's range."""
    began: float
    """The gap at the beginning, with its sign."""
    sent: bool = False
    """Whether a call drives either joint."""
    moved: float = 0.0
    """How much that changed."""
    rested: float = 0.0
    """The largest gap at rest."""
    now: float = 0.0

    @property
    def share(self) -> float:
        """The gap, over the range; 0 where it never changed."""
        return max(self.rested, self.now) / self.extent * (self.moved > FOLLOWS * self.extent)


class MimicIgnored(Answer):
    """The gap is taken where both are at rest, and at the end: on the way they may lag."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[str, _Off]] = {}

    def see(self) -> None:
        """Take a piece."""
        for driven in self.scene.driven():
            if driven.body.asked.mimics:
                places = zip(driven.body.joints, driven.body.rates, strict=True)
                rates = {joint.name: at.start for joint, at in places if at.stop - at.start == 1}
                for mimic in driven.body.asked.mimics:
                    if mimic.joint in rates and mimic.of in rates:
                        self._look(driven, mimic, [rates[mimic.joint], rates[mimic.of]])

    def _look(self, driven: Driven, mimic: Mimic, rates: list[int]) -> None:
        joint = next(each for each in driven.body.joints if each.name == mimic.joint)
        lower, upper = joint.limits
        first, apart = (
            own - mimic.multiplier * leads - mimic.offset
            for own, leads in (driven.before[0, rates], driven.after[:, rates].T)
        )
        off = self._joints.setdefault(driven.body.number, {}).setdefault(
            mimic.joint,
            _Off(
                mimic,
                units_of(driven, rates[0])[0],
                upper - lower if upper > lower else 1.0,
                float(first),
            ),
        )
        gaps, asked = np.abs(apart), driven.asked
        off.sent |= bool(((asked.mode != DEFAULT) & (asked.force != 0))[:, rates].any())
        off.moved = max(off.moved, float(np.abs(apart - off.began).max()))
        rested = driven.resting[:, rates].all(axis=1)
        off.rested, off.now = max(off.rested, gaps[rested].max(initial=0.0)), float(gaps[-1])

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            missed = [each for each in joints.values() if each.share > FOLLOWS]
            if not missed:
                continue
            worst = max(missed, key=lambda each: each.share)
            gap, mimic = worst.share * worst.extent, worst.mimic
            yield Finding(
                code="mimic-ignored",
                level="asked" if any(each.sent for each in missed) else "note",
                message=Message(
                    "{joint} is {gap} away from where its <mimic> tag puts it: PyBullet ignores "
                    "the tag, and {of} moves alone (joints that do not follow: {count})",
                    joint=mimic.joint,
                    gap=distance(gap, worst.unit),
                    of=mimic.of,
                    count=len(missed),
                ),
                advice=Message(
                    "join them: c = p.createConstraint(…, p.JOINT_GEAR, …); "
                    "p.changeConstraint(c, gearRatio={ratio}, maxForce=…)",
                    ratio={1.0: "-1", -1.0: "1"}.get(mimic.multiplier, "…"),
                ),
                body=self.scene.body(number).label,
                joint=mimic.joint,
                effect=Effect(gap, worst.unit),
                share=worst.share,
            )
