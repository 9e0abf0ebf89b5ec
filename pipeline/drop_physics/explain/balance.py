"""Checks contact steps of a single body: free-flight rule plus the impulse of each contact point.

An engine that works with impulses makes the law's step first, and then adds the impulses:

    m (v' - v_law) = dt Σ F                    I (ω' - ω_law) = dt Σ r × F

summed over the contact points. F is the normal force and both frictions on the body, r points from
its centre to the contact point on it. F, r and I are those at the start of the step, when the
engine looks for contacts. A velocity beyond the engine's limit is clamped. The balance leaves out
rolling and spinning friction, which PyBullet does not report, and timesteps with several substeps.
Source: Newton and Euler; checked against PyBullet in `tests/test_segments.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.touching import Touches
from drop_physics.physics.base import ROUNDING, Law, Motion
from drop_physics.physics.rotations import rotate, rotate_inverse
from drop_physics.physics.rowed import Rowed
from drop_physics.physics.vectors import any_of, cross, largest, lengths, summed

CLOSES = 1e-12
"""Share of a step's summands within which the balance must close; measured: 2e-13."""
ULPS = 16
"""Allowed deviation of velocities while a body turns, in units of rounding of a step's terms.

The largest measured deviation is 5. For contact without a force, the unit is the rounding of
velocities that the solver may have added and removed again: the largest deviation was 0.8 in 5,822
samples of 596 recordings, and 6.3 in one, in which the touching body was 80 times as fast.
"""


@dataclass(frozen=True)
class Pushes(Rowed):
    """Forces and torques that the script applied to a body, step by step, in world axes."""

    force_n: Float64
    """Sum of the forces in each step, shape (samples, 3)."""
    torque_n_m: Float64
    """Sum of the torques about the centre of mass, (samples, 3)."""
    force_scale_n: Float64
    """Sum of the magnitudes of the forces, which may cancel, shape (samples,)."""
    torque_scale_n_m: Float64

    @property
    def acted(self) -> Flags:
        """Flag the steps in which the script applied any force or torque, shape (samples,)."""
        return np.asarray((self.force_scale_n != 0) | (self.torque_scale_n_m != 0))


@dataclass(frozen=True)
class Balance:
    """The effect of contacts on one body, step by step; row i describes the step to sample i.

    No step led to the first sample: its row is zeros. Vectors are in world axes, (samples, 3).
    """

    law: Motion
    """The motion that the law alone predicts from the previous sample."""
    impulse_n_s: Float64
    angular_impulse_n_m_s: Float64
    """Angular impulse about the centre of mass."""
    touched: Flags
    """Whether a contact force acted."""
    velocity_m_s: Float64
    """The velocity predicted by the law and the impulses."""
    spin_rad_s: Float64
    velocity_scale_m_s: Float64
    """Sum of the magnitudes of the velocity's summands, shape (samples,)."""
    spin_scale_rad_s: Float64
    held: Flags
    """Whether the engine clamped a velocity when it added forces or contact impulses."""
    near: Flags
    """Whether there is a contact point, with or without a force."""
    tried_m_s: Float64
    """Bound on the velocity that the solver may have added and removed again, shape (samples,)."""
    tried_rad_s: Float64
    """Bound on the spin that the solver may have added and removed again, shape (samples,)."""

    def closes(self, motion: Motion) -> Flags:
        """Flag the samples whose velocities follow from the free-flight rule and impulses."""
        angular = largest(motion.spin_rad_s - self.spin_rad_s)
        most = CLOSES * self.spin_scale_rad_s + self._rounding(self.tried_rad_s)
        return np.asarray(self.closes_linear(motion) & (angular <= most))

    def closes_linear(self, motion: Motion) -> Flags:
        """Flag the samples whose linear velocity follows from rule and impulses; ignore spin."""
        linear = largest(motion.velocity_m_s - self.velocity_m_s)
        most = CLOSES * self.velocity_scale_m_s + self._rounding(self.tried_m_s)
        return np.asarray(linear <= most)

    def _rounding(self, tried: Float64) -> Float64:
        """Bound the rounding error left by impulses that the solver added and removed again."""
        return np.where(self.touched, 0.0, ULPS * ROUNDING * tried)


def balance_of(
    motion: Motion,
    law: Law,
    touches: Touches,
    pushes: Pushes | None = None,
    *,
    before: Motion | None = None,
) -> Balance:
    """Return the balance of every step: the change of motion by contacts, after free flight.

    Parameters
    ----------
    motion
        The recorded motion of a body.
    law
        The body's law of motion without contacts.
    touches
        The contact points of the body.
    pushes
        Forces and torques that the script applied; None without any.
    before
        The motion at the start of each step; None if it is always that of the previous sample.
    """
    dt, before = law.step_s, motion.before() if before is None else before
    alone = law.step(before)
    impulse_n_s, turn_n_m_s, scales = _impulses(touches, before, dt)
    touched = scales[:, 0] > 0
    start_m_s, start_rad_s = alone.velocity_m_s, alone.spin_rad_s
    if pushes is not None:
        # Pushes are part of the law's step, before the engine clamps velocities; contact is not.
        free = law.unlimited(before)
        start_m_s = free.velocity_m_s + dt * pushes.force_n / law.mass_kg
        start_rad_s = free.spin_rad_s + _spun(law, before, dt * pushes.torque_n_m)
        scales += dt * np.stack((pushes.force_scale_n, pushes.torque_scale_n_m), axis=1)
    first = _limited(law, start_m_s, start_rad_s)
    start_m_s, start_rad_s = law.held(start_m_s), law.held(start_rad_s)
    summed_m_s = start_m_s + impulse_n_s / law.mass_kg
    summed_rad_s = start_rad_s + _spun(law, before, turn_n_m_s)
    velocity_m_s, spin_rad_s = law.held(summed_m_s), law.held(summed_rad_s)
    near, tried_m_s, tried_rad_s = _tried(law, before, motion, touches)
    fastest = _largest(before.velocity_m_s, alone.velocity_m_s, velocity_m_s)
    quickest = _largest(before.spin_rad_s, alone.spin_rad_s, spin_rad_s)
    return Balance(
        law=alone,
        impulse_n_s=impulse_n_s,
        angular_impulse_n_m_s=turn_n_m_s,
        touched=touched,
        velocity_m_s=velocity_m_s,
        spin_rad_s=spin_rad_s,
        velocity_scale_m_s=scales[:, 0] / law.mass_kg + fastest,
        spin_scale_rad_s=scales[:, 1] / (min(law.inertia_kg_m2) or math.inf) + quickest,
        held=first | _limited(law, summed_m_s, summed_rad_s),
        near=near,
        tried_m_s=tried_m_s,
        tried_rad_s=tried_rad_s,
    )


def _impulses(touches: Touches, before: Motion, step_s: float) -> tuple[Float64, Float64, Float64]:
    """Return contact impulse, its moment about the centre, and the sum of magnitudes, per step.

    The first two have the shape (samples, 3); the last has the sums of the magnitudes of the
    summands of both, shape (samples, 2).
    """
    arm_m = touches.position_m - before.position_m[touches.step]
    impulse = touches.force_n * step_s
    turn, size = cross(arm_m, impulse), lengths(impulse)
    sizes = np.stack((size, size * lengths(arm_m)), axis=1)
    impulses, turns, scales = (
        summed(touches.step, each, count=len(before)) for each in (impulse, turn, sizes)
    )
    return impulses, turns, scales


def _spun(law: Law, before: Motion, turned_n_m_s: Float64) -> Float64:
    """Return the spin change that angular impulses cause [rad/s], world axes, (samples, 3)."""
    own = law.turned_by(rotate_inverse(before.orientation, turned_n_m_s), before)
    return rotate(before.orientation, own)


def _tried(
    law: Law, before: Motion, motion: Motion, touches: Touches
) -> tuple[Flags, Float64, Float64]:
    """Flag samples with contact points, and bound the rounding that the solver may have left, (n,).

    The solver adds impulses and takes them back; their rounding remains, even in a velocity that
    ends at 0. An impulse changes the velocity of its contact point by at most v: enough to stop the
    point, and to move it out of the other body in one step, if it is inside by d (d / dt; the
    engine only corrects a share, the ERP). The impulse changes the spin by v m r / (I + m r²),
    where r is the point's distance from the centre, and I the least moment of inertia.
    """
    terms_m_s, terms_rad_s = law.terms(before)
    near = np.isin(np.arange(len(before)), touches.step)
    arm_m, depth_m = np.zeros((2, len(before)))
    way_m = touches.position_m - before.position_m[touches.step]
    np.maximum.at(arm_m, touches.step, lengths(way_m))
    np.maximum.at(depth_m, touches.step, -touches.distance_m)
    turning_m_s = (terms_rad_s + lengths(motion.spin_rad_s)) * arm_m
    tried_m_s = terms_m_s + lengths(motion.velocity_m_s) + turning_m_s
    tried_m_s = np.where(near, tried_m_s + depth_m / law.step_s, 0.0)
    turning_m2 = min(law.inertia_kg_m2) / law.mass_kg + arm_m**2
    per_m = np.divide(arm_m, turning_m2, out=np.zeros_like(arm_m), where=turning_m2 > 0)
    return near, tried_m_s, tried_m_s * per_m


def _limited(law: Law, *velocities: Float64) -> Flags:
    """Flag the samples in which a velocity exceeds the engine's limit."""
    beyond = [np.isfinite(velocity) & (velocity != law.held(velocity)) for velocity in velocities]
    return any_of(np.hstack(beyond))


def _largest(*velocities: Float64) -> Float64:
    return largest(np.hstack(velocities))
