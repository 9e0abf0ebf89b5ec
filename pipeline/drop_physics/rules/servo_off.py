"""`off-target` of a joint whose actuator is a spring: what its force is short of, where it rests.

A position actuator of gain kp gives kp (ctrl - gear q), times its gear, and has no integral part.
At rest the forces on its joint sum to zero, so what the pose takes tells how far off it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drop_physics.explain.joints import Driven
from drop_physics.explain.targets import Stood, Targets
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span, and_more
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import OFF, distance, effort, link_of, name_of, place, units_of
from drop_physics.rules.thresholds import EACH_STEP, OWN_SHARE, SPRING_SHARE
from drop_physics.trace.events import Actuator

CLAMPED = "joint force range"
"""The term that a joint's own range of force takes off its actuators."""
SPARE = 1.3
"""What an actuator should have over what it needs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoGap:
    """A joint that rests off its target, and why."""

    joint: str
    unit: str
    off: float
    target: float
    share: float
    """The gap over what is normal: 1 rad, or the body's size."""
    rests: bool
    reason: str
    """`range`, `actuatorfrcrange`, `forcerange` or `spring`."""
    why: Message
    cure: Cure
    span: Span


class ServoOff(Answer):
    """A position actuator is a spring: a target that its joint rests off takes a force."""

    engines = MUJOCOS

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._targets: dict[int, Targets] = {}
        self._worst: dict[int, dict[int, ServoGap]] = {}
        """What is noted of joints, by the number of a body and the rate of a joint."""
        self._ends: dict[int, dict[int, ServoGap]] = {}
        """Likewise, joints that move with their actuators at a limit at the end of the steps."""

    def see(self) -> None:
        """Take a piece."""
        for number in self.scene.judged:
            targets = self._targets.setdefault(number, Targets())
            for driven in self.scene.joints.latest.get(number, []):
                self._ends[number] = {}
                for stood, going in targets.see(driven):
                    for i in np.flatnonzero(stood.resting & (stood.row >= 0)).tolist():
                        self._rests(driven, stood.only(np.array([i])))
                    if going and not stood.resting[0]:
                        self._moves(driven, stood)

    def _rests(self, driven: Driven, stood: Stood) -> None:
        """Note a target at which a joint came to rest, if it is the worst of its joint."""
        worst = self._worst.setdefault(driven.body.number, {})
        known = worst.get(stood.k)
        found = self._gap(driven, stood, 0.0 if known is None else known.off)
        if found is not None:
            worst[stood.k] = found

    def _moves(self, driven: Driven, stood: Stood) -> None:
        """Note a joint whose actuator has been at its limit, which its target takes more than."""
        row, k = int(stood.row[0]), stood.k
        needs = self._needs(driven, row, k)
        if needs is None or not abs(needs) > driven.limit[row, k]:
            return
        if driven.at_limit[row, k] and stood.at_limit[0] >= EACH_STEP * stood.steps[0]:
            found = self._gap(driven, stood, 0.0)
            if found is not None:
                self._ends[driven.body.number][k] = found

    def _gap(self, driven: Driven, stood: Stood, known: float) -> ServoGap | None:
        """Return how far a joint is off its target, if that is more than is known, and why."""
        row, k = int(stood.row[0]), stood.k
        unit, _ = units_of(driven, k)
        target = float(driven.asked.target[row, k])
        gap = float(driven.after[row, k]) - target
        if not abs(gap) > max(OFF[unit], known):
            return None
        found = self._why(driven, row, k, gap)
        if found is None:
            return None
        first, last = int(stood.first[0]), int(stood.last[0])
        return ServoGap(
            joint=name_of(driven, k),
            unit=unit,
            off=abs(gap),
            target=target,
            share=abs(gap) if unit == "rad" else abs(gap) / size_m(driven.body),
            rests=bool(stood.resting[0]),
            reason=found[0],
            why=found[1],
            cure=found[2],
            span=Span(first, last, last - first + 1),
        )

    def _why(
        self, driven: Driven, row: int, k: int, gap: float
    ) -> tuple[str, Message, Cure] | None:
        """Return why a joint rests off its target, and what would cure it; None if unsure."""
        steps, joint = driven.steps, name_of(driven, k)
        if not (steps.covered and steps.closes[row]):
            return None
        place_ = steps.law.tree.first_rate + k
        forces = {
            name: float(term[row, place_] / steps.reported.timestep_s[row])
            for name, term in steps.terms.items()
        }
        actuator = _servo(driven, k)
        if actuator is None:
            return None
        own, needs = forces.get(f"actuator {actuator.name}", 0.0), self._needs(driven, row, k)
        unit = units_of(driven, k)[1]
        low, high = steps.law.lower[k], steps.law.upper[k]
        if forces["stops"] * gap > 0 and abs(forces["stops"]) > OWN_SHARE * abs(own):
            limit = high if gap < 0 else low
            return (
                "range",
                Message(
                    "its range ends at {limit}, and the limit pushes it back with {force}",
                    limit=place(float(limit), units_of(driven, k)[0]),
                    force=effort(forces["stops"], unit),
                ),
                Cure("limits", joint, None, Message("range=… of the <joint>, or a target in it")),
            )
        takes = "" if needs is None else Message("; the target takes {n}", n=effort(needs, unit))
        more = abs(own if needs is None else needs) * SPARE
        if abs(forces.get(CLAMPED, 0.0)) > OWN_SHARE * abs(own):
            limit = own + forces[CLAMPED]
            return (
                "actuatorfrcrange",
                Message(
                    "the joint's actuatorfrcrange lets {limit} of the {own} through that its "
                    "actuator would give{takes}",
                    limit=effort(limit, unit),
                    own=effort(own, unit),
                    takes=takes,
                ),
                Cure(
                    "forcerange",
                    joint,
                    None if needs is None else more,
                    Message('a larger actuatorfrcrange="…" of the <joint>')
                    if needs is None
                    else Message(
                        'actuatorfrcrange="-{n:.2g} {n:.2g}" of the <joint>, or more', n=more
                    ),
                ),
            )
        if driven.at_limit[row, k]:
            if needs is not None and abs(needs) <= driven.limit[row, k]:
                return None  # something else holds it
            return (
                "forcerange",
                Message(
                    "its actuator is at its forcerange of {limit}{takes}",
                    limit=effort(own, unit),
                    takes=takes,
                ),
                Cure(
                    "forcerange",
                    joint,
                    None if needs is None else more,
                    Message('a larger forcerange="…" of the <position>')
                    if needs is None
                    else Message(
                        'forcerange="-{n:.2g} {n:.2g}" of the <position>, or more',
                        n=more / abs(actuator.gear),
                    ),
                ),
            )
        stiffness = actuator.kp * actuator.gear**2
        blocked = forces["contacts"] + forces["constraints"]
        is_spring = abs(own + stiffness * gap) <= SPRING_SHARE * abs(own)
        if not is_spring or abs(blocked) > OWN_SHARE * abs(own):
            return None
        enough = abs(needs or own) / (OFF[units_of(driven, k)[0]] * actuator.gear**2)
        return (
            "spring",
            Message(
                "a position actuator is a spring, and kp = {kp:.4g} gives the {force} that this "
                "pose takes only when it is so far off",
                kp=actuator.kp,
                force=effort(own, unit),
            ),
            Cure(
                "gains",
                joint,
                enough,
                Message(
                    'kp="{kp:.2g}" of the <position> leaves {off}, or gravcomp="1" of its bodies '
                    "takes gravity off it",
                    kp=enough,
                    off=distance(OFF[units_of(driven, k)[0]], units_of(driven, k)[0]),
                ),
            ),
        )

    def _needs(self, driven: Driven, row: int, k: int) -> float | None:
        """Return what the targets take of a joint's actuator; None if that is not determined."""
        steps, tree = driven.steps, driven.steps.law.tree
        positions, aims = steps.after.joints[row].copy(), driven.asked.target[row]
        for link, at in enumerate(tree.coordinates):
            rate = tree.rates[link].start - tree.first_rate
            if at.stop - at.start == 1 and np.isfinite(aims[rate]):
                positions[at] = aims[rate]
        needs = float(self.scene.joints.holding(driven, row).at(positions)[k])
        return needs if np.isfinite(needs) else None

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number in self._ends.keys() | self._worst.keys():
            gaps = self._ends.get(number, {}) | self._worst.get(number, {})
            if not gaps:
                continue
            worst = max(gaps.values(), key=lambda each: each.share)
            yield Finding(
                code="off-target",
                level="asked",
                reason=worst.reason,
                message=_message(worst, len(gaps)),
                advice=worst.cure.call,
                cure=worst.cure,
                body=self.scene.body(number).label,
                joint=worst.joint,
                effect=Effect(worst.off, worst.unit),
                share=worst.share,
                steps=worst.span,
            )


def _message(gap: ServoGap, joints: int) -> Message:
    values: dict[str, object] = {
        "joint": gap.joint,
        "more": and_more(joints),
        "off": distance(gap.off, gap.unit),
        "target": place(gap.target, gap.unit),
        "why": gap.why,
    }
    if gap.rests:
        return Message("{joint}{more} rests {off} off its target of {target}: {why}", **values)
    return Message("{joint}{more} ends {off} off its target of {target}: {why}", **values)


def _servo(driven: Driven, k: int) -> Actuator | None:
    """Return the position actuator of a joint, if it is the only actuator of it."""
    name = driven.body.joints[link_of(driven.body, k)].name
    its = [
        each for each in driven.body.actuators if each.acts_on == "joint" and each.target == name
    ]
    return its[0] if len(its) == 1 and its[0].kind == "position" and its[0].gear else None
