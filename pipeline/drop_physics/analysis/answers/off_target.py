"""Why a joint is not where it was sent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import (
    Cause,
    cause_of,
    distance,
    effort,
    place,
    units_of,
)
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.joints import Driven
from drop_physics.analysis.targets import Stood, Targets, rings_with
from drop_physics.messages import Message
from drop_physics.seen.events import Body

OFF = {"rad": 1e-2, "m": 1e-3}
"""Closer than that a joint is at its target."""
SMALL = 0.05
"""A positionGain below that is small: PyBullet's own is 0.1."""
LAWFUL = 0.1
"""A gap that differs by less than this share from what the motor's law leaves is the law's."""

GIVE_MORE = Message("give it more force, or each target more steps")


@dataclass(frozen=True, kw_only=True)
class Missed:
    """A target that a joint did not get to."""

    joint: str
    off: float
    target: float
    unit: str
    cause: Cause
    span: Span
    site: str | None
    last: bool = False
    """Whether it stood at the end."""


@dataclass(frozen=True, eq=False)
class _Going:
    """The target that stands at the end of the steps so far."""

    stood: Stood
    driven: Driven
    missed: Missed | None


@dataclass(eq=False)
class _Joint:
    """What is known of the targets of one joint."""

    going: _Going | None = None
    missed: Missed | None = None
    """The worst, of targets that stood until it was at rest."""
    moved: int = 0
    """Targets that did not."""
    steps: int = 0
    """For how long they stood."""
    at_limit: int = 0
    """In how many of these steps its motor was at its limit."""
    lag: Missed | None = None
    """The largest gap of these that the motor's law leaves."""
    behind: Missed | None = None
    """The largest that it does not: its motor was at its limit."""


class OffTarget(Answer):
    """A target is judged when it has stood until its joint was at rest, others by the law."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._targets: dict[int, Targets] = {}
        self._joints: dict[int, dict[int, _Joint]] = {}

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            found = self.scene.joints.latest.get(number, [])
            targets = self._targets.setdefault(number, Targets())
            joints = self._joints.setdefault(number, {})
            for driven in found:
                for stood, going in targets.see(driven):
                    joint = joints.setdefault(stood.k, _Joint())
                    self._end(joint, stood)
                    if going:
                        joint.going = _Going(stood, driven, self._missed(joint, driven, stood))
                    else:
                        self._ended(joint, driven, stood)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot; notes of what it holds, and of targets that move."""
        for number, joints in self._joints.items():
            body, ends = self.scene.body(number), []
            for joint in joints.values():
                ends += self._last(joint)
            for joint in joints.values():
                ends += [each for each in (joint.missed, _counted(joint)) if each is not None]
            for level in ("asked", "note"):
                found = [each for each in ends if each.cause.level == level]
                if found:
                    yield _finding(body, found)
            lags = [joint for joint in joints.values() if joint.lag is not None]
            if lags and not any(each.cause.level == "asked" for each in ends):
                yield _lag(body, max(lags, key=_lagging))

    def _end(self, joint: _Joint, stood: Stood) -> None:
        """Judge the target that stood before these steps, if it does not go on in them."""
        going, joint.going = joint.going, None
        if going is not None and going.stood.first[0] != stood.first[0]:
            if going.stood.resting[0]:
                joint.missed = _worse(joint.missed, going.missed)
            else:
                self._move(joint, going.driven, going.stood)

    def _ended(self, joint: _Joint, driven: Driven, stood: Stood) -> None:
        rested = np.flatnonzero(stood.resting)
        if len(rested):
            worst = stood.only(rested[[int(np.abs(stood.gap[rested]).argmax())]])
            joint.missed = _worse(joint.missed, self._missed(joint, driven, worst))
        self._move(joint, driven, stood.only(np.flatnonzero(~stood.resting)))

    def _missed(self, joint: _Joint, driven: Driven, stood: Stood) -> Missed | None:
        """Return a target that was missed at rest, if it is worse than those before."""
        gap, known = abs(float(stood.gap[0])), joint.missed
        unit, _ = units_of(driven, stood.k)
        if not stood.resting[0] or gap < OFF[unit] or (known is not None and gap < known.off):
            return None
        held = self.scene.joints.holding(driven, int(stood.row[0]))
        cause = cause_of(self.scene, driven, held, stood)
        return None if cause is None else self._of(driven, stood, cause)

    def _of(self, driven: Driven, stood: Stood, cause: Cause) -> Missed:
        first, last = int(stood.first[0]), int(stood.last[0])
        site = self.scene.joints.site(driven.asked.site[stood.row[0], stood.k])
        return Missed(
            joint=name_of(driven, stood.k),
            off=abs(float(stood.gap[0])),
            target=float(stood.target[0]),
            unit=units_of(driven, stood.k)[0],
            cause=cause,
            span=Span(first, last, last - first + 1),
            site=None if site is None else site_of(site),
        )

    def _last(self, joint: _Joint) -> list[Missed]:
        """Return what there is to say of the target that stands at the end."""
        if joint.going is None:
            return []
        stood, driven, missed = joint.going.stood, joint.going.driven, joint.going.missed
        if stood.resting[0]:
            joint.missed = _worse(joint.missed, missed and replace(missed, last=True))
            return []
        unit, _ = units_of(driven, stood.k)
        if stood.left[0] or (driven.resting[stood.row[0], stood.k] and not joint.moved):
            return []  # reset-leaves', or too short a run to tell
        if joint.moved:
            known = joint.behind
            self._move(joint, driven, stood)
            if joint.behind is not known and joint.behind is not None:
                joint.behind = replace(joint.behind, last=True)
            return []
        shakes = bool(rings_with(stood.kp, driven.asked.kd[stood.row, stood.k])[0])
        if abs(float(stood.gap[0])) < OFF[unit] or shakes:  # that is motor-gain's
            return []
        rate = f"{abs(float(stood.rate[0])):.2g} {unit}/s"
        kp, template = float(stood.kp[0]), Message("{what}, still moving at {rate}")
        at_limit, steps = int(stood.at_limit[0]), int(stood.steps[0])
        if at_limit > steps / 2:
            template = Message(
                "{what}, still moving at {rate}: its motor is at its limit of {limit} in {count} "
                "of {steps} steps"
            )
        if kp < SMALL and abs(float(stood.lawful[0] / stood.gap[0]) - 1) < LAWFUL:
            template = Message(
                "{what}: a positionGain of {kp:.3g} is the share of the gap that a step closes"
            )
        limit = effort(float(driven.limit[stood.row[0], stood.k]), units_of(driven, stood.k)[1])
        values = {"rate": rate, "kp": kp, "count": at_limit, "steps": steps, "limit": limit}
        advice = GIVE_MORE if at_limit > steps / 2 else None
        cause = Cause(template=template, values=values, advice=advice)
        return [replace(self._of(driven, stood, cause), last=True)]

    def _move(self, joint: _Joint, driven: Driven, stood: Stood) -> None:
        """Count targets that were replaced while their joint moved; not one left from before."""
        stood = stood.only(np.flatnonzero(~stood.left))
        joint.moved += len(stood)
        joint.steps += int(stood.steps.sum())
        joint.at_limit += int(stood.at_limit.sum())
        unit, unit_of_effort = units_of(driven, stood.k)
        gaps, off = np.abs(stood.gap), np.abs(stood.gap - stood.lawful)
        lawful = off <= np.maximum(LAWFUL * gaps, OFF[unit] * LAWFUL)
        weak = ~lawful & ~np.isnan(off) & (stood.at_limit > 0)
        for name, which in (("lag", lawful), ("behind", weak)):
            rows = np.flatnonzero(which & (gaps > OFF[unit]))
            if not len(rows):
                continue
            worst = stood.only(rows[[int(gaps[rows].argmax())]])
            known: Missed | None = getattr(joint, name)
            if known is None or abs(float(worst.gap[0])) > known.off:
                left = (1 - float(worst.kp[0])) ** int(worst.steps[0])
                limit = float(driven.limit[worst.row[0], worst.k])
                template = Message(
                    "{what}: its motor is at its limit of {limit} in {count} of {steps} steps"
                )
                values = {
                    "left": left, "limit": effort(limit, unit_of_effort),
                }  # fmt: skip
                cause = Cause(template=template, values=values, advice=GIVE_MORE)
                setattr(joint, name, self._of(driven, worst, cause))


def name_of(driven: Driven, k: int) -> str:
    """Return the name of the joint of a rate."""
    tree = driven.steps.law.tree
    rate = tree.first_rate + k
    link = next(one for one, at in enumerate(tree.rates) if at.start <= rate < at.stop)
    return driven.body.joints[link].name


def _worse(one: Missed | None, other: Missed | None) -> Missed | None:
    if one is None or other is None:
        return one or other
    return one if one.off > other.off else other


def _counted(joint: _Joint) -> Missed | None:
    """Return the target that a motor at its limit fell behind, with how often it was there."""
    behind = joint.behind
    if behind is None:
        return None
    counts = {"count": joint.at_limit, "steps": joint.steps}
    return replace(behind, cause=replace(behind.cause, values=behind.cause.values | counts))


def _share(body: Body, missed: Missed) -> float:
    """Return the gap over what is normal: 1 rad, or the body's size."""
    if missed.unit == "rad" or not body.bounds_m:
        return missed.off
    boxes = np.reshape(body.bounds_m, (-1, 2, 3))
    return missed.off / max(float((boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)).max()), 1e-9)


def _finding(body: Body, found: list[Missed]) -> Finding:
    worst = max(found, key=lambda each: _share(body, each))
    values: dict[str, object] = {
        "joint": worst.joint, "off": distance(worst.off, worst.unit),
        "target": place(worst.target, worst.unit), "count": len(found),
    }  # fmt: skip
    if len(found) == 1:
        what = (
            Message("{joint} ends {off} off its target of {target}", **values)
            if worst.last
            else Message("{joint} misses a target of {target} by {off}", **values)
        )
    else:
        what = (
            Message("{joint}, the worst of {count} joints, ends {off} off its target of {target}",
                **values)
            if worst.last
            else Message("{joint}, the worst of {count} joints, misses a target of {target} "
                "by {off}", **values)
        )  # fmt: skip
    return Finding(
        code="off-target",
        level=worst.cause.level,
        message=Message(worst.cause.template, what=what, **worst.cause.values),
        advice=worst.cause.advice,
        body=body.label,
        joint=worst.joint,
        other=worst.cause.other,
        effect=Effect(worst.off, worst.unit),
        share=_share(body, worst),
        steps=worst.span,
        site=worst.site,
    )


def _lagging(joint: _Joint) -> float:
    return 0.0 if joint.lag is None else joint.lag.off


def _lag(body: Body, joint: _Joint) -> Finding:
    assert joint.lag is not None
    lag, every = joint.lag, joint.steps / joint.moved
    message = Message(
        "{joint} follows its targets {off} behind: they change every {every:.3g} steps, and "
        "{left:.2g} of each change remains",
        joint=lag.joint, off=distance(lag.off, lag.unit), every=every,
        left=lag.cause.values["left"],
    )  # fmt: skip
    return Finding(
        code="off-target",
        level="note",
        message=message,
        advice=Message("p.setJointMotorControl2(…, positionGain=1) leaves nothing of it"),
        body=body.label,
        joint=lag.joint,
        effect=Effect(lag.off, lag.unit),
        share=_share(body, lag),
        steps=lag.span,
        site=lag.site,
    )
