"""Finds why a resting joint is off its target: force limit, obstacle or gains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drop_physics.explain.joints import JointTelemetry
from drop_physics.explain.needs import PoseSupport
from drop_physics.explain.targets import HeldTargets
from drop_physics.messages import Message
from drop_physics.quantities import effort
from drop_physics.rules.answer import Cure
from drop_physics.rules.codes import Level
from drop_physics.rules.joint import SPARE, aimed, units_of
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import POSITION

CLOSE, MOST = 0.05, 0.5
"""CLOSE: largest relative difference between a gap and the one predicted by a control law; MOST:
share of a motor's torque above which a cause accounts for most of that torque."""
MORE_FORCE = Message("give it more force")
Kind = Literal[
    "at its limit",
    "too weak here",
    "too weak at the target",
    "too weak on the way",
    "its own links",
    "an obstacle",
    "a load",
    "a constraint",
    "no gain",
    "a target velocity",
    "a velocity gain",
    "a small gain",
    "still moving",
    "moving away",
    "a speed limit",
    "moving at its limit",
]
"""Kinds of causes; of a body's missed targets with causes of one kind, the worst is reported."""


@dataclass(frozen=True)
class Cause:
    """Why a joint is off its target, with the suggested change."""

    kind: Kind
    why: Message
    advice: Message | None = None
    cure: Cure | None = None
    level: Level = "asked"
    other: str | None = None
    proposed: bool | None = None
    """Whether the advice is only a proposal."""
    need: str = ""
    """The advice to change the motor's force limit."""


def cause_of(
    seen: Seen, driven: JointTelemetry, held: PoseSupport, stood: HeldTargets
) -> Cause | None:
    """Return why a resting joint is off its target; None if that is uncertain."""
    row, k = int(stood.row[0]), stood.k
    if not driven.at_limit[row, k]:
        return _gains(driven, row, k)
    away = math.copysign(1.0, float(stood.gap[0]))
    alone = float(held.needs[k])
    shared = math.isnan(alone)  # others share its load
    here = held.weighs(k) if shared else alone
    if here is not None and not (shared and here * away >= 0) and abs(here) > driven.limit[row, k]:
        return _too_weak(driven, held, stood, abs(here))
    holds = _held(seen, driven, held, row, k, away)
    if holds is None and shared:
        return Cause("at its limit", _weak(driven, stood), MORE_FORCE, Cure("force"), proposed=True)
    return holds


def at_its_limit(limit: str, count: int, steps: int) -> Message:
    """Return the text for a motor at its force limit in some of the steps of its target."""
    return Message(
        "its motor is at its limit of {limit} in {count:,} of {steps:,} steps",
        limit=limit,
        count=count,
        steps=steps,
    )


def _weak(driven: JointTelemetry, stood: HeldTargets) -> Message:
    limit = effort(float(driven.limit[stood.row[0], stood.k]), units_of(driven, stood.k)[1])
    return at_its_limit(limit, int(stood.at_limit[0]), int(stood.steps[0]))


def _too_weak(driven: JointTelemetry, held: PoseSupport, stood: HeldTargets, here: float) -> Cause:
    row, k = int(stood.row[0]), stood.k
    unit = units_of(driven, k)[1]
    there = abs(float(held.at(aimed(driven, row))[k]))
    need = np.fmax(here, there)
    weak = _weak(driven, stood)
    kind: Kind = "too weak here"
    why = Message("{weak}; holding it here takes {here}", weak=weak, here=effort(here, unit))
    if not math.isnan(there):
        kind = "too weak at the target"
        why = Message(
            "{weak}; holding the target takes {there} ({here} where it is now)",
            weak=weak,
            there=effort(there, unit),
            here=effort(here, unit),
        )
    return give_at_least(kind, why, need, unit, float(driven.asked.force[row, k]))


def give_at_least(kind: Kind, why: Message, need: float, unit: str, force: float) -> Cause:
    """Return a cause whose suggested change is a higher force limit, rounded up.

    `force` is the limit that the call requested: if that suffices, the call was made before the
    timestep was set.
    """
    if force > abs(need):
        return Cause(kind, why, cure=Cure("timestep-first"))
    digit = 10.0 ** min(0, math.floor(math.log10(abs(need))) - 1)  # the last that is written
    least = effort(math.ceil(abs(need) / digit) * digit, unit)
    cure = Cure("force", value=float(to_spare(need)))
    return Cause(kind, why, Message("allow at least {need}: {call}"), cure, need=least)


def to_spare(need: float) -> str:
    """Round a force up, with a margin, for use as a limit."""
    wanted = SPARE * abs(need)
    step = 10.0 ** (math.floor(math.log10(wanted)) - (wanted < 20))
    return f"{math.ceil(wanted / step) * step:g}"


def _held(
    seen: Seen, driven: JointTelemetry, held: PoseSupport, row: int, k: int, away: float
) -> Cause | None:
    """Return the cause for a contact or constraint that opposes most of a motor's force."""
    torque, unit = abs(float(driven.torque[row, k])), units_of(driven, k)[1]
    most = max(held.contacts, key=lambda one: away * held.contacts[one][k], default=None)
    share = MOST if abs(held.constraints[k]) < CLOSE * torque else MOST / 2  # a gear has the rest
    if most is not None and away * held.contacts[most][k] > share * torque * (1 - CLOSE):
        body = seen.bodies[most]
        if most == driven.body.number:
            return Cause("its own links", Message("its own links meet"))
        limit = effort(float(driven.limit[row, k]), unit)
        why = Message(
            "its motor is at its limit of {limit} against {other}", limit=limit, other=body.label
        )
        if not (driven.steps.law.tree.fixed or body.base_moves):  # it may stand on that
            return Cause(
                "an obstacle", why, MORE_FORCE, Cure("force"), other=body.label, proposed=True
            )
        load = held.from_one_side(most, k)
        if body.joints or not body.base_moves or (load is not None and load.anchored):
            return Cause("an obstacle", why, other=body.label)
        if load is not None:
            return Cause("an obstacle", why, MORE_FORCE, Cure("force"), other=body.label)
        if abs(float(held.contacts[most][k])) > torque * (1 + CLOSE):
            return None  # what lies on it is more than its motor can press with
        force = effort(float(held.contacts[most][k]), unit)
        holds = Message("it holds {other} with {force}", other=body.label, force=force)
        return Cause("a load", holds, level="note", other=body.label)
    if away * held.constraints[k] > MOST * torque:
        return Cause("a constraint", Message("a constraint holds it"))
    return None


def _gains(driven: JointTelemetry, row: int, k: int) -> Cause | None:
    """Return the cause for a motor within its limit whose gains were set by calls."""
    asked = driven.asked
    if not driven.steps.covered or asked.mode[row, k] != POSITION:
        return None
    kp, kd, rate = (float(getattr(asked, name)[row, k]) for name in ("kp", "kd", "target_velocity"))
    if kp == 0:
        cure = Cure("gains", value=0.1, given={"positionGain": 0.1})
        return Cause("no gain", Message("its positionGain is {kp:g}", kp=kp), cure=cure)
    if rate:
        cure = Cure("gains", value=0.0, given={"targetVelocity": 0.0})
        why = Message(
            "its motor is below its limit, and has a targetVelocity of {rate:.3g}", rate=rate
        )
        return Cause("a target velocity", why, cure=cure, proposed=True)
    if kd == 1:
        return None
    cure = Cure("gains", value=1.0, given={"velocityGain": 1.0})
    why = Message("its motor is below its limit, and has a velocityGain of {kd:.4g}", kd=kd)
    return Cause("a velocity gain", why, cure=cure, proposed=True)
