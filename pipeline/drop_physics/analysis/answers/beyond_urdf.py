"""Why a robot is faster or stronger than the real one: the limits in its file do not act."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import effort, units_of
from drop_physics.analysis.controls import DEFAULT, places_of
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven
from drop_physics.messages import Message

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

BEYOND = 0.01
"""A limit is exceeded by more than this share of it."""
Kind = Literal["velocity", "effort"]


@dataclass(kw_only=True)
class _Beyond:
    joint: str
    kind: Kind
    limit: float
    units: tuple[str, str]
    site: float
    first: int
    most: float = 0.0
    last: int = 0
    count: int = 0

    @property
    def share(self) -> float:
        """The part of its greatest that is beyond."""
        return 1 - self.limit / self.most


class BeyondUrdf(Answer):
    """`getJointInfo` reports the effort and velocity of a file, and no motor heeds them."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[tuple[int, Kind], _Beyond]] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                for joint, place in zip(driven.body.joints, places_of(driven.body), strict=True):
                    if place.stop - place.start == 1:
                        k = place.start
                        fast, strong = _beyond(driven, k, joint.velocity, joint.effort)
                        self._note(driven, k, "velocity", np.abs(driven.rate[:, k]), fast)
                        self._note(driven, k, "effort", np.abs(driven.torque[:, k]), strong)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            worst = max(joints.values(), key=lambda each: each.share, default=None)
            if worst is not None:
                count = len({k for k, _ in joints})
                yield self._finding(self.scene.body(number).label, worst, count)

    def _note(self, driven: Driven, k: int, kind: Kind, values: Float64, found: Flags) -> None:
        rows = np.flatnonzero(found)
        if not len(rows):
            return
        link = next(n for n, at in enumerate(places_of(driven.body)) if at == slice(k, k + 1))
        joint, steps = driven.body.joints[link], driven.steps.steps[rows]
        beyond = self._joints.setdefault(driven.body.number, {}).setdefault(
            (k, kind),
            _Beyond(
                joint=joint.name, kind=kind, limit=getattr(joint, kind), first=int(steps[0]),
                units=units_of(driven, k), site=float(driven.asked.site[rows[0], k]),
            ),
        )  # fmt: skip
        beyond.most = max(beyond.most, float(values[rows].max()))
        beyond.last, beyond.count = int(steps[-1]), beyond.count + len(rows)

    def _finding(self, label: str, worst: _Beyond, count: int) -> Finding:
        position, force = worst.units
        unit = f"{position}/s" if worst.kind == "velocity" else force
        values: dict[str, object] = {
            "joint": worst.joint, "most": effort(worst.most, unit), "steps": worst.count,
            "limit": f"{worst.limit:.3g} {unit}", "count": count, "number": f"{worst.limit:.3g}",
        }  # fmt: skip
        if worst.kind == "velocity":
            template = Message(
                "{joint} moves at up to {most} where its file allows {limit}, in {steps} steps: "
                "PyBullet's motors do not heed that limit (joints beyond theirs: {count})"
            )
            advice = Message("p.setJointMotorControl2(…, maxVelocity={number})", **values)
        else:
            template = Message(
                "{joint} is driven with up to {most} where its file allows {limit}, in {steps} "
                "steps: PyBullet's motors do not heed that limit (joints beyond theirs: {count})"
            )
            advice = Message("p.setJointMotorControl2(…, force={number})", **values)
        site = self.scene.joints.site(worst.site)
        return Finding(
            code="beyond-urdf",
            level="model",
            message=Message(template, **values),
            advice=advice,
            body=label,
            joint=worst.joint,
            effect=Effect(worst.most - worst.limit, unit),
            share=worst.share,
            steps=Span(worst.first, worst.last, worst.count),
            site=None if site is None else site_of(site),
        )


def _beyond(driven: Driven, k: int, velocity: float, force: float) -> tuple[Flags, Flags]:
    """Return in which steps a motor that a call set drives its joint beyond each limit."""
    asked, rate, torque = driven.asked, driven.rate[:, k], driven.torque[:, k]
    told = ((asked.mode[:, k] != DEFAULT) | (asked.pd[:, k] == 1)) & (driven.steps.steps > 1)
    fast = told & (np.abs(rate) > (1 + BEYOND) * velocity) & (torque * rate > 0) & (velocity > 0)
    strong = told & (np.abs(torque) > (1 + BEYOND) * force) & (force > 0)
    return fast, strong
