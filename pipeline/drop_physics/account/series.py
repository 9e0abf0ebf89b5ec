"""The states and commands of joints over all steps of a recording, as columns."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.commands import DEFAULT
from drop_physics.explain.joints import JointTelemetry, target_of
from drop_physics.trace.motors import VELOCITY


@dataclass(frozen=True, eq=False)
class JointSeries:
    """The joints of a body over n steps; arrays have the shape (n, joint_rates) except `steps`."""

    steps: Int64
    """The sample after each step, shape (n,)."""
    before: Float64
    """Positions before each step [rad] or [m]; nan for a spherical joint."""
    after: Float64
    rate: Float64
    """Joint rates after each step."""
    target: Float64
    """Commanded position; nan if there is none."""
    asked_rate: Float64
    """Commanded rate of an enabled velocity motor; nan if there is none."""
    default: Flags
    """Whether the engine's default motor holds the joint, because no call commanded it."""
    torque_asked: Flags
    """Whether a call or an actuator applies a torque."""
    torque: Float64
    """Efforts of motors [N m] or [N]."""
    limit: Float64
    """Maximum torque of the motor."""
    at_limit: Flags
    at_stop: Flags

    @staticmethod
    def of(driven: JointTelemetry) -> JointSeries:
        """Return the columns for a chunk."""
        asked = driven.asked
        turns = (asked.mode == VELOCITY) & (asked.impulse > 0) & (asked.pd != 1)
        default = asked.mode == DEFAULT
        return JointSeries(
            steps=driven.steps.steps.copy(),
            before=driven.before.copy(),
            after=driven.after.copy(),
            rate=driven.rate.copy(),
            target=target_of(driven),
            asked_rate=np.where(turns & ~default, asked.target_velocity, np.nan),
            default=default,
            torque_asked=~np.isnan(asked.torque_since),
            torque=driven.torque.copy(),
            limit=driven.limit.copy(),
            at_limit=driven.at_limit.copy(),
            at_stop=driven.at_stop.copy(),
        )

    @staticmethod
    def joined(parts: list[JointSeries]) -> JointSeries:
        """Concatenate consecutive parts."""
        names = [field.name for field in fields(JointSeries)]
        return JointSeries(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        )

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)


@dataclass(eq=False)
class BaseTrack:
    """Displacement and rotation of a free base; grows chunk by chunk."""

    start_m: Float64
    """First position of the base [m], shape (3,)."""
    start_orientation: Float64
    """First orientation, a unit quaternion x, y, z, w."""
    farthest_m: Float64
    """The position farthest from the first one [m], shape (3,)."""
    farthest_step: int = -1
    most_turned_rad: float = 0.0
    most_turned_step: int = -1

    def add(self, steps: Int64, position_m: Float64, orientation: Float64) -> None:
        """Add the poses after the given steps, shapes (n, 3) and (n, 4)."""
        way = np.linalg.norm(position_m - self.start_m, axis=1)
        far = int(np.argmax(np.nan_to_num(way)))
        if way[far] > np.linalg.norm(self.farthest_m - self.start_m):
            self.farthest_m, self.farthest_step = position_m[far].copy(), int(steps[far])
        cosine = np.abs(orientation @ self.start_orientation).clip(0.0, 1.0)
        turned = 2 * np.arccos(cosine)
        most = int(np.argmax(np.nan_to_num(turned)))
        if turned[most] > self.most_turned_rad:
            self.most_turned_rad, self.most_turned_step = float(turned[most]), int(steps[most])
