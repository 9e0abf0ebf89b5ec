"""Motor commands in calls, as rows of numbers: motors, torques and PD control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import BODY_NAMES
from drop_physics.trace.events import Calls, Site

T = TypeVar("T")

VELOCITY, TORQUE, POSITION, PD = 0, 1, 2, 3
"""Values of `controlMode`."""
FORCE = 100000.0
"""PyBullet's default force limit of a motor [N m] or [N]."""
DEFAULTS_TO_FORCE = ("setJointMotorControl2", "setJointMotorControlArray")
"""Functions whose TORQUE_CONTROL uses `FORCE` as the torque if no force is given."""
DEFAULTS = {
    "targetPosition": 0.0,
    "targetVelocity": 0.0,
    "force": FORCE,
    "positionGain": 0.1,
    "velocityGain": 1.0,
    "maxVelocity": 0.0,
}
"""PyBullet's default arguments; a maxVelocity of 0 means no limit."""
ARGUMENTS = {
    "targetPosition": "targetPositions",
    "targetVelocity": "targetVelocities",
    "force": "forces",
    "positionGain": "positionGains",
    "velocityGain": "velocityGains",
    "maxVelocity": "maxVelocities",
}
"""Names of arguments in a call for one joint, and in a call for several joints."""


class Command(NamedTuple):
    """n calls from one site that each command the same joint."""

    client: int
    site: Site
    calls: Int64
    """Indices of the calls, shape (n,)."""
    steps: Int64
    times_s: Float64
    bodies: Int64
    """The engine's body ids."""
    joints: Int64
    values: Mapping[str, Float64]
    """Arguments, named as in a call for one joint, shape (n, k)."""

    def given(self, name: str, width: int = 1) -> Float64:
        """Return the numbers of an argument, shape (n, width) or, with one number each, (n, 1).

        The argument's default is returned if the call has too few numbers.
        """
        numbers = self.values.get(name)
        if numbers is not None and numbers.shape[1] in (1, width):
            return numbers
        return np.full((len(self.calls), 1), DEFAULTS[name])

    @property
    def torques(self) -> Float64 | None:
        """Torques of TORQUE_CONTROL calls [N m] or [N], shape (n, k); None if there are none."""
        given = self.values.get("force")
        if given is None and self.site.function in DEFAULTS_TO_FORCE:
            return np.full((len(self.calls), 1), FORCE)
        return given

    @property
    def ignored_targets(self) -> Float64 | None:
        """Positions [rad] or [m] given to a motor for rates, which ignores them; 0 counts as none.

        The shape is (n,), with nan in calls that give none; None if no call does.
        """
        given = self.values.get("targetPosition")
        if given is None or given.shape[1] != 1:
            return None
        ignored = (self.values["controlMode"] == VELOCITY) & (given != 0)
        return np.where(ignored, given, np.nan)[:, 0] if ignored.any() else None

    def only(self, which: Flags) -> Command:
        """Return the selected calls."""
        held = {name: values[which] for name, values in self.values.items()}
        return Command(
            self.client,
            self.site,
            self.calls[which],
            self.steps[which],
            self.times_s[which],
            self.bodies[which],
            self.joints[which],
            held,
        )


def commands_of(seen: Calls, sites: Mapping[int, Site], widths: Int64) -> Iterator[Command]:
    """Yield the motor commands in calls, one for each site and joint.

    `widths` contains how many numbers each call has.
    """
    starts = np.cumsum(widths) - widths
    for number in np.unique(seen.sites).tolist():
        site = sites[number]
        if site.act is not Act.COMMAND:
            continue
        its = np.flatnonzero(seen.sites == number)
        numbers = seen.numbers[starts[its, None] + np.arange(len(site.names))]
        places = {name: range(at.start, at.stop) for name, at in site.places.items()}
        body = next((places[name] for name in BODY_NAMES if name in places), None)
        joints = places.get("jointIndices", places.get("jointIndex", ()))
        if body is None or "controlMode" not in places:
            continue
        for which, joint in enumerate(joints):
            values = {"controlMode": places["controlMode"], **of_joint(places, which, len(joints))}
            yield Command(
                seen.client,
                site,
                seen.calls[its],
                seen.steps[its],
                seen.times_s[its],
                numbers[:, body[0]].astype(np.int64),
                numbers[:, joint].astype(np.int64),
                {name: numbers[:, [*columns]] for name, columns in values.items()},
            )


def of_joint(values: Mapping[str, Sequence[T]], number: int, joints: int) -> dict[str, Sequence[T]]:
    """Return one joint's arguments of a motor call for several joints.

    Parameters
    ----------
    values
        For each argument, its numbers or their indices in a row.
    number
        The index of the joint among the joints of the call.
    joints
        The number of joints in the call.
    """
    found: dict[str, Sequence[T]] = {}
    for name, plural in ARGUMENTS.items():
        if name in values:
            found[name] = values[name]
        elif plural in values and joints:
            width = max(len(values[plural]) // joints, 1)
            found[name] = values[plural][number * width : (number + 1) * width]
    return found
