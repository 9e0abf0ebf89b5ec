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
    """The joints of a body in n steps; arrays have the shape (n, joint_rates) except `steps`."""

    steps: Int64
    """The sample that each step led to, shape (n,)."""
    before: Float64
    """Positions before each step [rad] or [m]; nan of a spherical joint."""
    after: Float64
    rate: Float64
    """Rates after each step."""
    target: Float64
    """Position asked for; nan where none is."""
    asked_rate: Float64
    """Rate asked of a velocity motor that may act; nan where none is."""
    default: Flags
    """Whether the engine's own motor holds the joint, as no call commanded it."""
    torque_asked: Flags
    """Whether a call or an actuator gives a torque."""
    torque: Float64
    """Efforts of motors [N m] or [N]."""
    limit: Float64
    """The largest torque that the motor may give."""
    at_limit: Flags
    at_stop: Flags

    @staticmethod
    def of(driven: JointTelemetry) -> JointSeries:
        """Return the columns of a piece."""
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
        """Return consecutive parts as one."""
        names = [field.name for field in fields(JointSeries)]
        return JointSeries(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        )

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)


@dataclass(eq=False)
class BaseTrack:
    """Displacement and rotation of a free base; grows piece by piece."""

    start_m: Float64
    """First position of the base [m], shape (3,)."""
    start_orientation: Float64
    """First orientation, a unit quaternion x, y, z, w."""
    farthest_m: Float64
    """Position farthest from the first [m], shape (3,)."""
    farthest_step: int = -1
    most_turned_rad: float = 0.0
    most_turned_step: int = -1

    def add(self, steps: Int64, position_m: Float64, orientation: Float64) -> None:
        """Add the poses after some steps, shapes (n, 3) and (n, 4)."""
        way = np.linalg.norm(position_m - self.start_m, axis=1)
        far = int(np.argmax(np.nan_to_num(way)))
        if way[far] > np.linalg.norm(self.farthest_m - self.start_m):
            self.farthest_m, self.farthest_step = position_m[far].copy(), int(steps[far])
        cosine = np.abs(orientation @ self.start_orientation).clip(0.0, 1.0)
        turned = 2 * np.arccos(cosine)
        most = int(np.argmax(np.nan_to_num(turned)))
        if turned[most] > self.most_turned_rad:
            self.most_turned_rad, self.most_turned_step = float(turned[most]), int(steps[most])
