"""What contact did in each step: the impulse that each point gave, and the energy.

A step of an engine with impulses is the law's step and then the impulses:

    m (v' - v_law) = dt Σ F                    I (ω' - ω_law) = dt Σ r × F

over the contact points, F the normal force and both frictions on the body, r from its centre to its
own point. Both, and I, are those at the start of the step, when the engine looks for contacts. A
velocity beyond the engine's limit is clamped. Derivation of the energies: with J = dt F a step
changes m v²/2 + ω·Iω/2 from what it is by the law alone by

    Σ [J·(v_law + v')/2 + (r × J)·(ω_law + ω')/2]

point by point, since a² - b² = (a - b)·(a + b). The balance leaves out rolling and spinning
friction, which PyBullet does not report, and timesteps with several substeps.
Source: Newton and Euler; checked against PyBullet in `tests/test_segments.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.analysis.general.contacts import Touches
from pipeline.laws.base import Law, Motion
from pipeline.laws.rotations import rotate, rotate_inverse

Float64 = NDArray[np.float64]

CLOSES = 1e-12
"""Share of a step's summands to which the balance closes; measured: 2e-13."""


@dataclass(frozen=True)
class Balance:
    """What contact did to one body; the row of a sample is that of the step which led to it.

    The first sample has no such step: its row is zeros. Vectors in world axes, (samples, 3).
    """

    law: Motion
    """Where the law alone leads from the sample before."""
    impulse_n_s: Float64
    angular_impulse_n_m_s: Float64
    """About the centre of mass."""
    touched: NDArray[np.bool_]
    """Whether a force acted."""
    velocity_m_s: Float64
    """By law and impulses."""
    spin_rad_s: Float64
    velocity_scale_m_s: Float64
    """Size of the summands of the velocity, shape (samples,)."""
    spin_scale_rad_s: Float64
    point_energy_j: Float64
    """Energy that each contact point gave, shape (points,); negative where it took some."""
    energy_j: Float64
    """The same for each step, shape (samples,)."""
    held: NDArray[np.bool_]
    """Whether the engine clamped a velocity when forces or contact were added."""

    def closes(self, motion: Motion) -> NDArray[np.bool_]:
        """Return in which samples the recorded velocities follow from law and impulses."""
        angular = np.abs(motion.spin_rad_s - self.spin_rad_s).max(axis=1)
        return np.asarray(self.closes_linear(motion) & (angular <= CLOSES * self.spin_scale_rad_s))

    def closes_linear(self, motion: Motion) -> NDArray[np.bool_]:
        """Return the same, regardless of spin."""
        linear = np.abs(motion.velocity_m_s - self.velocity_m_s).max(axis=1)
        return np.asarray(linear <= CLOSES * self.velocity_scale_m_s)


def balance_of(
    motion: Motion,
    law: Law,
    touches: Touches,
    pushed: tuple[Float64, Float64] | None = None,
    *,
    before: Motion | None = None,
) -> Balance:
    """Return the balance of every step.

    Parameters
    ----------
    motion
        The recorded motion of a body.
    law
        The law that it follows where nothing touches it.
    touches
        Its contact points.
    pushed
        Forces [N] and torques about the centre of mass [N m] that were applied in the step which
        led to each sample, shape (samples, 3) each; None without any.
    before
        What each step began with; None where that is the sample before.
    """
    samples, dt = len(motion), law.step_s
    before = motion.before() if before is None else before
    alone = law.step(before)
    arm_m = touches.position_m - before.position_m[touches.step]
    impulse = touches.force_n * dt
    turn = np.cross(arm_m, impulse)
    forces = np.zeros((samples, 6))
    np.add.at(forces, touches.step, np.hstack((impulse, turn)))
    scales = np.zeros((samples, 2))
    sizes = [np.linalg.norm(each, axis=1) for each in (impulse, arm_m)]
    np.add.at(scales, touches.step, np.stack((sizes[0], sizes[0] * sizes[1]), axis=1))
    touched = scales[:, 0] > 0
    impulse_n_s, turn_n_m_s = forces[:, :3], forces[:, 3:]
    start_m_s, start_rad_s = alone.velocity_m_s, alone.spin_rad_s
    inertia = np.array(law.inertia_kg_m2)

    def spun(turned: Float64) -> Float64:
        own = law.turned_by(rotate_inverse(before.orientation, turned), before)
        return rotate(before.orientation, own)

    if pushed is not None:
        # Part of the law's step, before the engine clamps velocities; contact comes after.
        force_n, torque_n_m = pushed
        free = law.unlimited(before)
        start_m_s = free.velocity_m_s + dt * force_n / law.mass_kg
        start_rad_s = free.spin_rad_s + spun(dt * torque_n_m)
        scales += dt * np.stack([np.linalg.norm(each, axis=1) for each in pushed], axis=1)
    first = _limited(law, start_m_s, start_rad_s)
    start_m_s, start_rad_s = law.held(start_m_s), law.held(start_rad_s)
    summed_m_s = start_m_s + impulse_n_s / law.mass_kg
    summed_rad_s = start_rad_s + spun(turn_n_m_s)
    velocity_m_s, spin_rad_s = law.held(summed_m_s), law.held(summed_rad_s)
    mean_m_s = (alone.velocity_m_s + motion.velocity_m_s)[touches.step] / 2
    mean_rad_s = (alone.spin_rad_s + motion.spin_rad_s)[touches.step] / 2
    point_j = np.sum(impulse * mean_m_s + turn * mean_rad_s, axis=1)
    energy_j = np.zeros(samples)
    np.add.at(energy_j, touches.step, point_j)
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
        spin_scale_rad_s=scales[:, 1] / (inertia.min() or math.inf) + quickest,
        point_energy_j=point_j,
        energy_j=energy_j,
        held=first | _limited(law, summed_m_s, summed_rad_s),
    )


def _limited(law: Law, *velocities: Float64) -> NDArray[np.bool_]:
    """Return in which samples a velocity is beyond the engine's limit."""
    beyond = [np.isfinite(each) & (each != law.held(each)) for each in velocities]
    return np.asarray(np.hstack(beyond).any(axis=1))


def _largest(*velocities: Float64) -> Float64:
    return np.asarray(np.max([np.abs(each).max(axis=1) for each in velocities], axis=0))
