"""Joint states and commands over all steps of a recording, as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Literal, get_args

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.commands import DEFAULT, Commanded
from drop_physics.explain.joints import JointTelemetry, target_of
from drop_physics.physics.rotations import rotation_vectors
from drop_physics.physics.tree import States
from drop_physics.physics.vectors import lengths
from drop_physics.trace.motors import POSITION, VELOCITY

Control = Literal["position", "velocity", "torque", "pd", "default", "off", "unknown"]
CONTROLS: tuple[Control, ...] = get_args(Control)
"""Controllers of a joint: `default` is the engine's own motor, and `unknown` a motor that a call
before the recording may have set."""


@dataclass(frozen=True, eq=False)
class JointSeries:
    """Joint states and commands of a body over n steps; arrays (n, joint_rates)."""

    steps: Int64
    """The sample after each step, shape (n,)."""
    before: Float64
    """Positions before each step [rad] or [m]; nan for a spherical joint."""
    after: Float64
    rate: Float64
    """Joint rates after each step [rad/s] or [m/s]."""
    target: Float64
    """Commanded position [rad] or [m]; nan if there is none."""
    asked_rate: Float64
    """Commanded rate of an enabled velocity motor [rad/s] or [m/s]; nan if there is none."""
    control: Int64
    """What controls the joint, as an index in CONTROLS."""
    switched_off: Flags
    """Whether the last call for the joint's motor gave it no force."""
    torque: Float64
    """Efforts of motors [N m] or [N]."""
    limit: Float64
    """Maximum torque or force of the motor [N m] or [N]."""
    at_limit: Flags
    at_stop: Flags
    resting: Flags
    """Whether the joint has been at rest for some steps."""

    @staticmethod
    def of(driven: JointTelemetry) -> JointSeries:
        """Return the arrays for one chunk."""
        asked = driven.asked
        turns = (asked.mode == VELOCITY) & (asked.impulse > 0) & (asked.pd != 1)
        return JointSeries(
            steps=driven.steps.steps.copy(),
            before=driven.before.copy(),
            after=driven.after.copy(),
            rate=driven.rate.copy(),
            target=target_of(driven),
            asked_rate=np.where(turns, asked.target_velocity, np.nan),
            control=_control(asked, known=not driven.body.before),
            switched_off=~np.isnan(asked.site) & (asked.impulse == 0),
            torque=driven.torque.copy(),
            limit=driven.limit.copy(),
            at_limit=driven.at_limit.copy(),
            resting=driven.resting.copy(),
            at_stop=driven.at_stop.copy(),
        )

    @staticmethod
    def joined(parts: list[JointSeries]) -> JointSeries:
        """Concatenate consecutive parts."""
        names = [each.name for each in fields(JointSeries)]
        return JointSeries(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        )

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)

    def controlled(self, *by: Control) -> Flags:
        """Flag steps in which a joint is controlled in a given way, shape (n, joint_rates)."""
        return np.isin(self.control, [CONTROLS.index(each) for each in by])


def _control(asked: Commanded, *, known: bool) -> Int64:
    """Return how each joint is controlled: motor, torque, free …, shape (n, joint_rates).

    `known` says whether all calls that set a motor are recorded.
    """
    cases: dict[Control, Flags] = {
        "pd": asked.pd == 1,
        "torque": ~np.isnan(asked.torque_since),
        "default" if known else "unknown": asked.mode == DEFAULT,
        "off": ~(asked.impulse > 0),
        "position": asked.mode == POSITION,
    }
    which = [CONTROLS.index(each) for each in cases]
    return np.select([*cases.values()], which, CONTROLS.index("velocity")).astype(np.int64)


@dataclass(eq=False)
class BaseTrack:
    """Displacement and rotation of a floating base; filled chunk by chunk."""

    start_m: Float64
    """First position of the base [m], shape (3,)."""
    start_orientation: Float64
    """First orientation, a unit quaternion x, y, z, w."""
    farthest_m: Float64
    """The position farthest from the first one [m], shape (3,)."""
    first_step: int
    """The first step of the body since it was loaded for the last time."""
    start_rad_s: Float64
    """First angular velocity in world axes, shape (3,)."""
    farthest_step: int = -1
    most_turned_rad: float = 0.0
    most_turned_step: int = -1
    spun_rad: Float64 = field(default_factory=lambda: np.zeros(3))
    """Sum of the rotation vectors from state to state, in world axes [rad], shape (3,); unlike an
    orientation, the sum counts full turns."""
    most_spun_rad: Float64 = field(default_factory=lambda: np.zeros(3))
    """The sum with the largest norm so far, shape (3,)."""
    most_spun_step: int = -1
    end_rad_s: float = 0.0
    """Size of the angular velocity after the latest step."""

    def add(self, steps: Int64, before: States, after: States) -> None:
        """Add the states around the given steps."""
        position_m, orientation = after.position_m, after.orientation
        self.end_rad_s = float(np.linalg.norm(after.velocity[-1, :3]))
        spun_rad = self.spun_rad + np.cumsum(rotation_vectors(before.orientation, orientation), 0)
        most = int(np.argmax(np.nan_to_num(lengths(spun_rad))))
        if lengths(spun_rad)[most] > np.linalg.norm(self.most_spun_rad):
            self.most_spun_rad, self.most_spun_step = spun_rad[most], int(steps[most])
        self.spun_rad = spun_rad[-1]
        way = np.linalg.norm(position_m - self.start_m, axis=1)
        far = int(np.argmax(np.nan_to_num(way)))
        if way[far] > np.linalg.norm(self.farthest_m - self.start_m):
            self.farthest_m, self.farthest_step = position_m[far].copy(), int(steps[far])
        cosine = np.abs(orientation @ self.start_orientation).clip(0.0, 1.0)
        turned = 2 * np.arccos(cosine)
        most = int(np.argmax(np.nan_to_num(turned)))
        if turned[most] > self.most_turned_rad:
            self.most_turned_rad, self.most_turned_step = float(turned[most]), int(steps[most])
