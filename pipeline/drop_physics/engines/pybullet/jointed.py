"""The joints of a dropped body, and their states after each step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.engines.pybullet.described import joint_of
from drop_physics.engines.pybullet.engine import p
from drop_physics.trace.events import Joint
from drop_physics.trace.states import Joints


def joints_of(body: int, links: Sequence[int], client: int) -> tuple[Joint, ...]:
    """Return the joints of the body's links, in order."""
    infos = [p.getJointInfo(body, link, client) for link in links]
    return tuple(
        joint_of(info, info[1].decode(errors="replace"), _widths(info, body, client))
        for info in infos
    )


def _widths(info: Any, body: int, client: int) -> tuple[int, int, int]:  # noqa: ANN401 - PyBullet's
    """Return how many positions, velocities and efforts a joint has."""
    if info[2] == p.JOINT_FIXED:
        return 0, 0, 0
    state = p.getJointStateMultiDof(body, info[0], physicsClientId=client)
    return len(state[0]), len(state[1]), len(state[3])


class JointStates:
    """Reads the states of a body's movable joints."""

    def __init__(self, body: int, client: int, joints: Sequence[Joint]) -> None:
        self.moving = [joint.link for joint in joints if any(joint.widths)]
        self._body, self._client = body, client
        self._several = any(max(joint.widths) > 1 for joint in joints)
        widths = np.array([joint.widths for joint in joints], dtype=np.int64).reshape(-1, 3)
        self._ends = np.cumsum(widths.sum(axis=0))[:2]

    def now(self) -> list[float]:
        """Return the current positions, then velocities, then efforts of all joints."""
        ask = p.getJointStatesMultiDof if self._several else p.getJointStates
        found = ask(self._body, self.moving, physicsClientId=self._client)
        if self._several:
            return [number for of in (0, 1, 3) for joint in found for number in joint[of]]
        return [joint[of] for of in (0, 1, 3) for joint in found]

    def table(self, steps: Int64, timestep_s: float, values: Float64) -> Joints:
        """Return the results of `now` in each step, shape (steps, numbers), as a `Joints` table."""
        times_s = np.asarray(steps * timestep_s, dtype=np.float64)
        return Joints(steps, times_s, *np.split(values, self._ends, axis=1))
