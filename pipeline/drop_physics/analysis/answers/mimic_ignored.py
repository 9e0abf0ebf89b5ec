"""Why a joint does not follow the other that its file names: PyBullet ignores `<mimic>`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene
from drop_physics.analysis.answers.held_off import distance, units_of
from drop_physics.analysis.controls import DEFAULT, places_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven
from drop_physics.messages import Message
from drop_physics.seen.events import Body, Mimic

FOLLOWS = 0.01
"""A joint that is off by less than this share of its range follows."""


@dataclass(kw_only=True)
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
    off: float = 0.0
    """The largest gap at rest, and at the end."""
    now: float = 0.0


class MimicIgnored(Answer):
    """The gap is taken where both are at rest, and at the end: on the way they may lag."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[str, _Off]] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                rates = _rates(driven.body)
                for mimic in driven.body.asked.mimics:
                    if mimic.joint in rates and mimic.of in rates:
                        self._see(driven, mimic, rates[mimic.joint], rates[mimic.of])

    def _see(self, driven: Driven, mimic: Mimic, k: int, leads: int) -> None:
        joint = next(each for each in driven.body.joints if each.name == mimic.joint)
        lower, upper = joint.limits
        lead, own = driven.after[:, leads], driven.after[:, k]
        first, led = driven.before[0, k], driven.before[0, leads]
        began = float(first - mimic.multiplier * led - mimic.offset)
        off = self._joints.setdefault(driven.body.number, {}).setdefault(
            mimic.joint,
            _Off(
                mimic=mimic, unit=units_of(driven, k)[0], began=began,
                extent=upper - lower if upper > lower else 1.0,
            ),
        )  # fmt: skip
        apart = own - mimic.multiplier * lead - mimic.offset
        gaps, asked = np.abs(apart), driven.asked
        off.sent |= bool(((asked.mode != DEFAULT) & (asked.force != 0))[:, [k, leads]].any())
        rested = driven.resting[:, k] & driven.resting[:, leads]
        off.moved = max(off.moved, float(np.abs(apart - off.began).max()))
        off.off = max(off.off, float(gaps[rested].max(initial=0.0)))
        off.now = float(gaps[-1])

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            missed = [
                each
                for each in joints.values()
                if max(each.off, each.now) > FOLLOWS * each.extent
                and each.moved > FOLLOWS * each.extent
            ]
            if not missed:
                continue
            worst = max(missed, key=lambda each: max(each.off, each.now) / each.extent)
            sent = any(each.sent for each in missed)
            gap = max(worst.off, worst.now)
            yield Finding(
                code="mimic-ignored",
                level="asked" if sent else "note",
                message=Message(
                    "{joint} is {gap} from where its file wants it to follow {of}: PyBullet "
                    "ignores <mimic> (joints that do not follow: {count})",
                    joint=worst.mimic.joint, gap=distance(gap, worst.unit), of=worst.mimic.of,
                    count=len(missed),
                ),
                advice=Message(
                    "join them: c = p.createConstraint(…, p.JOINT_GEAR, …); "
                    "p.changeConstraint(c, gearRatio={ratio}, maxForce=…)",
                    ratio={1.0: "-1", -1.0: "1"}.get(worst.mimic.multiplier, "…"),
                ),
                body=self.scene.body(number).label,
                joint=worst.mimic.joint,
                effect=Effect(gap, worst.unit),
                share=gap / worst.extent,
            )  # fmt: skip


def _rates(body: Body) -> dict[str, int]:
    """Return the place of each joint with one degree of freedom among all rates, by name."""
    places = zip(body.joints, places_of(body), strict=True)
    return {joint.name: at.start for joint, at in places if at.stop - at.start == 1}
