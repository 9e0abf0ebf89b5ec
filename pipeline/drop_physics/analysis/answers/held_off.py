"""Why a joint that is at rest is not at its target: its limit, what holds it, its gains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drop_physics.analysis.answers.answer import Level, Scene
from drop_physics.analysis.joints import Driven, target_of
from drop_physics.analysis.needs import Holding
from drop_physics.analysis.targets import Stood
from drop_physics.laws.dynamics import mass_matrix
from drop_physics.laws.kinematics import kinematics
from drop_physics.messages import Message
from drop_physics.seen.calls import POSITION

FREE = ("gravity", "bias", "damping", "joint damping", "applied", "clamp")
"""Terms that act before the motors do."""
CLOSE, MOST = 0.05, 0.5
"""A gap is that of a law if they differ by less than this share; most of a motor's torque."""
SPARE = 1.3
"""What a motor should have over what it needs."""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Why."""

    template: str
    """With `{what}` for what was missed."""
    values: dict[str, object]
    advice: Message | None
    level: Level = "asked"
    other: str | None = None


def units_of(driven: Driven, k: int) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    tree = driven.steps.law.tree
    rate = tree.first_rate + k
    joint = next(one for one, at in enumerate(tree.rates) if at.start <= rate < at.stop)
    return ("m", "N") if tree.joints[joint] == "prismatic" else ("rad", "N m")


def distance(value: float, unit: str) -> str:
    """Return a gap as text."""
    if unit == "m":
        return f"{abs(value) * 1e3:.3g} mm"
    return f"{abs(value):.3g} {unit}" if abs(value) >= 10 else f"{abs(value):.2g} {unit}"


def place(value: float, unit: str) -> str:
    """Return a position as text."""
    return f"{value:.3f} m" if unit == "m" else f"{value:.2f} {unit}"


def effort(value: float, unit: str) -> str:
    """Return a torque or force as text."""
    return f"{abs(value):.0f} {unit}" if 10 <= abs(value) < 1e6 else f"{abs(value):.2g} {unit}"


def enough(need: float) -> str:
    """Return a round force limit that leaves some to spare."""
    wanted = SPARE * need
    step = 10.0 ** (math.floor(math.log10(wanted)) - (wanted < 20))
    return f"{math.ceil(wanted / step) * step:g}"


def cause_of(scene: Scene, driven: Driven, held: Holding, stood: Stood) -> Cause | None:
    """Return why the target left its joint where it is; None if that is not sure."""
    row, k = int(stood.row[0]), stood.k
    gap = float(stood.gap[0])
    _, unit = units_of(driven, k)
    return (
        _too_weak(driven, held, stood, unit)
        or _held(scene, driven, held, row, k, math.copysign(1.0, gap))
        or _gains(driven, row, k, gap)
    )


def _too_weak(driven: Driven, held: Holding, stood: Stood, unit: str) -> Cause | None:
    row, k = int(stood.row[0]), stood.k
    limit, here = float(driven.limit[row, k]), abs(float(held.needs[k]))
    if not (driven.at_limit[row, k] and here > limit):
        return None
    positions = driven.steps.after.joints[row].copy()
    aims, tree = target_of(driven)[row], driven.steps.law.tree
    for link, at in enumerate(tree.coordinates):
        rate = tree.rates[link].start - tree.first_rate
        if at.stop - at.start == 1 and np.isfinite(aims[rate]):
            positions[at] = aims[rate]
    there = abs(float(held.at(positions)[k]))
    need = here if math.isnan(there) else max(here, there)
    values: dict[str, object] = {
        "limit": effort(limit, unit), "count": int(stood.at_limit[0]),
        "steps": int(stood.steps[0]), "here": effort(here, unit),
    }  # fmt: skip
    template = Message(
        "{what}: its motor is at its limit of {limit} in {count} of {steps} steps; "
        "holding it here takes {here}"
    )
    if not math.isnan(there):
        values["here"] = effort(here, unit).removesuffix(f" {unit}")
        values["there"] = effort(there, unit)
        template = Message(
            "{what}: its motor is at its limit of {limit} in {count} of {steps} steps; "
            "the target takes {there}, here it takes {here}"
        )
    force = float(driven.asked.force[row, k])
    advice = None if not math.isclose(force, limit) else Message(
        "give it at least {need}: p.setJointMotorControl2(…, force={force})",
        need=effort(need, unit), force=enough(need),
    )  # fmt: skip
    if force > need:  # another rule says why it has less than was asked for
        advice = Message("call p.setTimeStep before the motors are commanded")
    return Cause(template=template, values=values, advice=advice)


def _held(
    scene: Scene, driven: Driven, held: Holding, row: int, k: int, away: float
) -> Cause | None:
    """Return which contact or constraint takes most of what the motor gives."""
    torque = abs(float(driven.torque[row, k]))
    if not driven.at_limit[row, k]:
        return None
    most = max(held.contacts, key=lambda one: away * held.contacts[one][k], default=None)
    if most is not None and away * held.contacts[most][k] > MOST * torque:
        body = scene.body(most)
        unit = units_of(driven, k)[1]
        values: dict[str, object] = {"other": body.label}
        if most == driven.body.number:
            return Cause(template=Message("{what}: its own links meet"), values={}, advice=None)
        if body.base_moves and not body.joints:
            template = Message("{what}: it holds {other} with {force}")
            values["force"] = effort(float(held.contacts[most][k]), unit)
            return Cause(template=template, values=values, advice=None, level="note",
                other=body.label)  # fmt: skip
        template = Message("{what}: its motor is at its limit of {limit} against {other}")
        values["limit"] = effort(float(driven.limit[row, k]), unit)
        return Cause(template=template, values=values, advice=None, other=body.label)
    if away * held.constraints[k] > MOST * torque:
        return Cause(template=Message("{what}: a constraint holds it"), values={}, advice=None)
    return None


def _gains(driven: Driven, row: int, k: int, gap: float) -> Cause | None:
    """Return which of its gains leaves the gap, where the motor's law says so."""
    asked, steps = driven.asked, driven.steps
    if not (steps.covered and asked.mode[row, k] == POSITION) or driven.at_limit[row, k]:
        return None
    kp, kd, rate = (float(getattr(asked, name)[row, k]) for name in ("kp", "kd", "target_velocity"))
    if kp == 0:
        advice = Message("p.setJointMotorControl2(…, positionGain=0.1)")
        return Cause(template=Message("{what}: its positionGain is 0"), values={}, advice=advice)
    timestep_s = float(steps.reported.timestep_s[row])
    (matrix,) = mass_matrix(kinematics(steps.law.tree, steps.before.at(np.array([row]))))
    pull = sum(steps.terms[name][row] for name in FREE)
    free = (steps.before.velocity[row] + np.linalg.solve(matrix, pull))[
        steps.law.tree.first_rate + k
    ]
    parts = {"pushed": timestep_s * kd * rate / kp, "sags": timestep_s * (1 - kd) * free / kp}
    if abs(sum(parts.values()) - gap) > CLOSE * abs(gap):
        return None
    if abs(parts["pushed"]) > abs(parts["sags"]):
        return Cause(
            template=Message("{what}: its targetVelocity of {rate:.3g} pushes it past"),
            values={"rate": rate},
            advice=Message("p.setJointMotorControl2(…, targetVelocity=0)"),
        )
    return Cause(
        template=Message("{what}: with a velocityGain of {kd:.3g} its motor gives way to the load"),
        values={"kd": kd},
        advice=Message("p.setJointMotorControl2(…, velocityGain=1)"),
    )
