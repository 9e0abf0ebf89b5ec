"""Names, units and number formats of joints, for rules about joints."""

from __future__ import annotations

import math

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.joints import JointTelemetry, target_of
from drop_physics.explain.needs import PoseSupport
from drop_physics.messages import Message
from drop_physics.rules.thresholds import AT_TARGET_M, AT_TARGET_RAD, IN_DEGREES_RAD
from drop_physics.trace.events import Actuator, Body, Joint
from drop_physics.trace.history import Seen

AT_TARGET = {"rad": AT_TARGET_RAD, "m": AT_TARGET_M}
"""Distance below which a joint is at its target, by unit."""
SPARE = 1.3
"""Safety factor of a recommended force limit over the required force."""


def link_of(body: Body, k: int) -> int:
    """Return PyBullet's index of the joint that a rate belongs to."""
    return next(link for link, at in enumerate(body.rates) if at.start <= k < at.stop)


def aimed(driven: JointTelemetry, row: int) -> Float64:
    """Return the joint positions after a step, with targets in place, (joint_coordinates,)."""
    positions, aims = driven.steps.after.joints[row].copy(), target_of(driven)[row]
    tree = driven.steps.law.tree
    for at, rates in zip(tree.coordinates, tree.rates, strict=True):
        aim = aims[rates.start - tree.first_rate] if at.stop - at.start == 1 else np.nan
        if np.isfinite(aim):
            positions[at] = aim
    return np.asarray(positions)


def name_of(driven: JointTelemetry, k: int) -> str:
    """Return the name of the joint to which a rate belongs."""
    return driven.body.joints[link_of(driven.body, k)].name


def actuators_on(body: Body, k: int) -> list[Actuator]:
    """Return the actuators that act on the joint of a rate."""
    name = body.joints[link_of(body, k)].name
    return [
        actuator
        for actuator in body.actuators
        if (actuator.acts_on, actuator.target) == ("joint", name)
    ]


def units_of(driven: JointTelemetry, k: int) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    return units(driven.body.joints[link_of(driven.body, k)])


def units(joint: Joint) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    return ("m", "N") if joint.kind == "prismatic" else ("rad", "N m")


def holds_off(seen: Seen, held: PoseSupport, joint_rate: int, away: float) -> bool:
    """Return whether a body that the joint pushes or grips, rather than carries, blocks the motor.

    `away` is the sign of the direction in which the motor is blocked.
    """
    against = [one for one, contact in held.contacts.items() if contact[joint_rate] * away > 0]
    return any(
        seen.bodies[one].base_moves and held.from_one_side(one, joint_rate) is None
        for one in against
    )


def is_degrees(target: float, low: float, high: float) -> bool:
    """Return whether a target outside the limits is inside if read as degrees."""
    return abs(target) > IN_DEGREES_RAD and low <= math.radians(target) <= high


RADIANS = Message(
    "targets are in radians: if this is in degrees, math.radians({target:.4g}) is {in_radians:.4g}"
)
"""The advice for a target that may be in degrees."""


def as_degrees(target: float) -> dict[str, object]:
    """Return the numbers for the advice to convert degrees to radians."""
    return {"target": target, "in_radians": math.radians(target)}
