"""Why a joint is not where it was sent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.joints import Driven
from drop_physics.explain.targets import Stood, Targets, rings_with
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Cure, Effect, Finding, Scene, Span, and_more
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.held_off import MOST, Cause, at_limit, cause_of, give_at_least, holds_off
from drop_physics.rules.joint import OFF, distance, effort, name_of, place, units_of

Flags = NDArray[np.bool_]

SMALL = 0.05
"""A positionGain below that is small: PyBullet's own is 0.1."""
LAWFUL = 0.1
"""A gap that differs by less than this share from what the motor's law leaves is the law's."""
OFTEN = 0.1
"""Of its steps, in which a motor is at its limit: less often it is no cause."""
GIVE_MORE = Message("give it more force, or each target more steps")


@dataclass(frozen=True, kw_only=True, eq=False)
class Missed:
    """A target that a joint did not get to."""

    joint: str
    unit: str
    off: float
    """The gap [rad] or [m]."""
    share: float
    """The gap over what is normal: 1 rad, or the body's size."""
    stood: Stood
    limit: str
    """Of its motor."""
    site: str | None
    cause: Cause | None = None
    """Of the gap in which it came to rest."""
    last: bool = False
    """Whether it stood at the end."""
    pressed: bool = False
    """Whether its joint was pressed onto a body that it holds."""


@dataclass(eq=False)
class _Joint:
    """What is known of the targets of one joint."""

    going: tuple[Driven, Missed] | None = None
    """The target that stands at the end of the steps so far."""
    rested: Missed | None = None
    """The worst that stood until the joint was at rest."""
    moved: int = 0
    """Targets that did not; for how many steps they stood, in how many its motor was at its limit,
    and the worst of those that the motor's law leaves, and of those that a weak motor does."""
    steps: int = 0
    at_limit: int = 0
    lag: Missed | None = None
    behind: Missed | None = None


class OffTarget(Answer):
    """A target is judged when it has stood until its joint was at rest, others by the law."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._targets: dict[int, Targets] = {}
        self._joints: dict[int, dict[int, _Joint]] = {}

    def see(self) -> None:
        """Take a piece."""
        for number in self.scene.judged:
            targets = self._targets.setdefault(number, Targets())
            joints = self._joints.setdefault(number, {})
            for driven in self.scene.joints.latest.get(number, []):
                for stood, going in targets.see(driven):
                    joint = joints.setdefault(stood.k, _Joint())
                    held, joint.going = joint.going, None
                    if held is not None and held[1].stood.first[0] != stood.first[0]:
                        self._end(joint, *held)
                    if going:
                        joint.going = driven, self._held(joint, driven, stood)
                        continue
                    rested = np.flatnonzero(stood.resting)
                    if len(rested):
                        worst = stood.only(rested[[int(np.abs(stood.gap[rested]).argmax())]])
                        self._end(joint, driven, self._held(joint, driven, worst))
                    self._move(joint, driven, stood, self._pressed(driven, stood))

    def _held(self, joint: _Joint, driven: Driven, stood: Stood) -> Missed:
        """Return a target with the cause of its gap, if it is the worst one at rest."""
        missed, known = self._missed(driven, stood), joint.rested
        missed = replace(missed, pressed=bool(self._pressed(driven, stood)[0]))
        worse = missed.off >= OFF[missed.unit] and (known is None or missed.off >= known.off)
        if not (stood.resting[0] and worse):
            return missed
        held = self.scene.joints.holding(driven, int(stood.row[0]))
        return replace(missed, cause=cause_of(self.scene, driven, held, stood))

    def _missed(self, driven: Driven, stood: Stood) -> Missed:
        """Return one target."""
        off, row, k = abs(float(stood.gap[0])), int(stood.row[0]), stood.k
        position, force = units_of(driven, k)
        return Missed(
            joint=name_of(driven, k),
            unit=position,
            off=off,
            stood=stood,
            share=off if position == "rad" else off / size_m(driven.body),
            limit=effort(float(driven.limit[row, k]), force),
            site=self.scene.site(driven.asked.site[row, k]),
        )

    def _end(self, joint: _Joint, driven: Driven, missed: Missed) -> None:
        """Note a target that ended."""
        if not missed.stood.resting[0]:
            self._move(joint, driven, missed.stood, np.array([missed.pressed]))
        elif missed.cause is not None:  # the worst, or it would have none
            joint.rested = missed

    def _move(
        self, joint: _Joint, driven: Driven, stood: Stood, pressed: Flags, *, last: bool = False
    ) -> None:
        """Count targets that were replaced while their joint moved; not one left from before.

        Nor those that joints were `pressed` with, shape (m,).
        """
        least = OFF[units_of(driven, stood.k)[0]]
        moving = np.flatnonzero(~stood.left & ~stood.resting & ~pressed)
        reached, stood = _reached(stood, least)[moving], stood.only(moving)
        joint.moved += len(stood)
        joint.steps += int(stood.steps.sum())
        joint.at_limit += int(stood.at_limit.sum())
        gaps, off = np.abs(stood.gap), np.abs(stood.gap - stood.lawful)
        lawful = off <= np.maximum(LAWFUL * gaps, least * LAWFUL)
        weak = ~lawful & ~np.isnan(off) & (stood.at_limit > 0)
        for name, which in (("lag", lawful), ("behind", weak)):
            rows = np.flatnonzero(which & (gaps > least) & ~reached)
            known: Missed | None = getattr(joint, name)
            if len(rows):
                worst = self._missed(driven, stood.only(rows[[int(gaps[rows].argmax())]]))
                if known is None or worst.off > known.off:
                    setattr(joint, name, replace(worst, last=last))

    def _pressed(self, driven: Driven, stood: Stood) -> Flags:
        """Return which targets end with the joint pressed onto a body that it holds, shape (m,)."""
        none, steps, rows, k = np.zeros(len(stood), np.bool_), driven.steps, stood.row, stood.k
        if not steps.covered:
            return none
        rate = steps.law.tree.first_rate + k
        motor, contacts = (steps.terms[name][rows, rate] for name in ("motors", "contacts"))
        pressed = driven.at_limit[rows, k] & (-contacts * np.sign(motor) > MOST * np.abs(motor))
        pressed &= rows >= 0
        for at in np.flatnonzero(pressed)[:1].tolist():
            held = self.scene.joints.holding(driven, int(rows[at]))
            if not holds_off(self.scene, held, k, -float(np.sign(motor[at]))):
                return none
        return np.asarray(pressed)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot; notes of what it holds, and of targets that move."""
        for number, joints in self._joints.items():
            label = self.scene.body(number).label
            rows = self.scene.joints.rows(number)
            ends = [
                each
                for k, joint in joints.items()
                for each in self._ends(joint, rows[k].needs_at_target)
            ]
            asked = [each for each in ends if each.cause and each.cause.level == "asked"]
            for found in (asked, [each for each in ends if each not in asked]):
                if found:
                    yield _finding(label, found)
            lags = [(each, each.lag) for each in joints.values() if each.lag is not None]
            if lags and not asked:
                yield _lag(label, *max(lags, key=lambda pair: pair[1].off))

    def _ends(self, joint: _Joint, takes: float | None) -> Iterator[Missed]:
        """Yield the targets of a joint that it missed, with their causes."""
        if joint.going is not None:
            driven, missed = joint.going
            missed = replace(missed, last=True)
            if missed.stood.resting[0]:
                self._end(joint, driven, missed)
            elif joint.moved or missed.pressed:
                self._move(joint, driven, missed.stood, np.array([missed.pressed]), last=True)
            elif (cause := _moving(driven, missed, takes)) is not None:
                yield replace(missed, cause=cause)
        if joint.rested is not None:
            yield joint.rested
        if joint.behind is not None and joint.at_limit > OFTEN * joint.steps:
            weak = at_limit(joint.behind.limit, joint.at_limit, joint.steps)
            yield replace(joint.behind, cause=Cause(weak, GIVE_MORE, Cure("force")))


def _reached(stood: Stood, least: float) -> Flags:
    """Return which targets their joint got to before they had changed by more than `least`."""
    changed = np.append(0.0, np.cumsum(np.abs(np.diff(stood.target))))[: len(stood)]
    alike = np.floor(changed / least)
    return np.isin(alike, alike[np.abs(stood.gap) <= least])


def _finding(label: str, found: list[Missed]) -> Finding:
    worst = max(found, key=lambda each: each.share)
    assert worst.cause is not None
    values: dict[str, object] = {
        "joint": worst.joint,
        "more": and_more(len(found)),
        "why": worst.cause.why,
        "off": distance(worst.off, worst.unit),
        "target": place(float(worst.stood.target[0]), worst.unit),
    }
    message = (
        Message("{joint}{more} ends {off} off its target of {target}: {why}", **values)
        if worst.last
        else Message("{joint}{more} misses a target of {target} by {off}: {why}", **values)
    )
    cure = worst.cause.cure
    if cure is not None and cure.name in ("force", "gains"):
        cure = replace(cure, target=worst.joint if len(found) == 1 else label)
    return _of(label, worst, worst.cause, message, cure)


def _lag(label: str, joint: _Joint, lag: Missed) -> Finding:
    every = round(joint.steps / joint.moved)
    often = Message("every {n} steps", n=every) if every > 1 else Message("with every step")
    message = Message(
        "{joint} follows its targets {off} behind: they change {often}, and {left:.2g} of each "
        "change remains",
        joint=lag.joint,
        off=distance(lag.off, lag.unit),
        often=often,
        left=(1 - float(lag.stood.kp[0])) ** every,
    )
    advice = Message("p.setJointMotorControl2(…, positionGain=1) leaves nothing of it")
    cure = Cure("gains", lag.joint, 1.0, given={"positionGain": 1.0})
    return _of(label, lag, Cause(message, advice, cure, "note"), message, cure)


def _of(label: str, missed: Missed, cause: Cause, message: Message, cure: Cure | None) -> Finding:
    first, last = int(missed.stood.first[0]), int(missed.stood.last[0])
    return Finding(
        code="off-target",
        level=cause.level,
        message=message,
        advice=cause.advice,
        cure=cure,
        body=label,
        joint=missed.joint,
        other=cause.other,
        effect=Effect(missed.off, missed.unit),
        share=missed.share,
        steps=Span(first, last, last - first + 1),
        site=missed.site,
    )


def _moving(driven: Driven, last: Missed, takes: float | None) -> Cause | None:
    """Return why a joint is not yet at the only target that it had; None if that is not sure.

    `takes` is what the target takes of its motor.
    """
    stood, kp = last.stood, float(last.stood.kp[0])
    row, k = int(stood.row[0]), stood.k
    rings = rings_with(stood.kp, driven.asked.kd[stood.row, k])[0]  # that is motor-gain's
    if stood.left[0] or driven.resting[row, k] or last.off < OFF[last.unit] or rings:
        return None  # or reset-leaves'; or it rests in a run too short to tell
    if kp < SMALL and abs(float(stood.lawful[0] / stood.gap[0]) - 1) < LAWFUL:
        return Cause(
            Message("a positionGain of {kp:.3g} is the share of the gap that a step closes", kp=kp)
        )
    why = Message("it still moves at {rate}", rate=f"{abs(float(stood.rate[0])):.2g} {last.unit}/s")
    count, steps = int(stood.at_limit[0]), int(stood.steps[0])
    if count <= steps / 2:
        return Cause(why)
    weak = at_limit(last.limit, count, steps)
    if takes is not None and abs(takes) > driven.limit[row, k]:
        unit = units_of(driven, k)[1]
        why = Message("{weak}; the target takes {need}", weak=weak, need=effort(takes, unit))
        return Cause(why, *give_at_least(takes, unit, float(driven.asked.force[row, k])))
    return Cause(Message("{why}, and {weak}", why=why, weak=weak), GIVE_MORE, Cure("force"))
