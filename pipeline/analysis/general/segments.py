"""What each sample of a body is: the one step of a law that led to it, or why it is none.

    x' = x + v' dt        holds in every phase to the last bit, and so does the turn by ω'
    v', ω'                are the law's in flight, and the law's and the contacts' (`balance`) else

The segment of a sample is that of the step which led to it, so that each rests on two samples and
on the contacts between them. Not covered, and then `unexplained`: contact in a step that is made of
several, of which PyBullet reports the last; rolling and spinning friction, which it does not
report; and the first step of a btRigidBody that touches something after it was turned or given
another mass: it is pushed with the inertia of how it was loaded. Not covered, and `jointed`:
bodies with joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pipeline.analysis.general.balance import Balance, balance_of
from pipeline.analysis.general.contacts import Touches
from pipeline.laws.base import FUSED, Law, Motion

Float64 = NDArray[np.float64]

Segment = Literal["flight", "contact", "pushed", "set", "jointed", "still", "unexplained"]
SEGMENTS: tuple[Segment, ...] = get_args(Segment)
FLIGHT, CONTACT, PUSHED, SET, JOINTED, STILL, UNEXPLAINED = range(len(SEGMENTS))
EXPLAINED = (FLIGHT, CONTACT, PUSHED, SET, STILL)

ULPS = 16
"""Units of rounding of a step's terms that velocities may be off while a body turns; seen: 5.

Where something touched and gave no force, of what it may have given: seen, in 5,822 samples of 596
recordings, 0.8, and 6.3 in one, where what touched was 80 times as fast.
"""


@dataclass(frozen=True)
class Segments:
    """The segment of every sample of a body, and what it was told by."""

    code: NDArray[np.int8]
    """Places in `SEGMENTS`, shape (samples,)."""
    deviation: Float64
    """By how much the sample is off its law, in the worst of its numbers [m, m/s, rad/s, 1]."""
    balance: Balance | None
    """What contact did; None without a law."""
    held: NDArray[np.bool_]
    """Whether the engine held a velocity at its limit in the step to each sample.

    Where law and contacts do not lead to a sample, it is held if it got to the limit to the bit.
    """

    def placed_at(self, motion: Motion, start: Motion, law: Law) -> Segments:
        """Return the same where the first sample is held against a start that is known."""
        first, start = motion.at(slice(1)), law.released(start)
        turned = _off(_same_way(first.orientation, start.orientation), start.orientation)
        placed = [_off(getattr(first, name), getattr(start, name)) for name in _VECTORS]
        code, deviation = self.code.copy(), self.deviation.copy()
        deviation[0] = np.max([turned, *placed])
        if not (turned[0] <= law.oriented and max(each[0] for each in placed) == 0):
            code[0] = UNEXPLAINED
        return replace(self, code=code, deviation=deviation)

    def counts(self) -> dict[Segment, int]:
        """Return how many samples there are of each segment."""
        counts = np.bincount(self.code, minlength=len(SEGMENTS)).tolist()
        return dict(zip(SEGMENTS, counts, strict=True))

    @property
    def explained(self) -> NDArray[np.bool_]:
        """Whether each sample is explained."""
        return np.isin(self.code, EXPLAINED)

    @property
    def first_unexplained(self) -> int | None:
        """The first sample that is not."""
        steps = np.flatnonzero(~self.explained)
        return int(steps[0]) if len(steps) else None

    def runs(self, code: int) -> list[tuple[int, int]]:
        """Return first and last sample of each unbroken run of a segment."""
        held = self.code == code
        return unbroken(held, np.zeros(len(held), dtype=bool))


def unbroken(held: NDArray[np.bool_], breaks: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last row of each run of true ones, which ends before a break."""
    before, after = np.roll(held, 1), np.roll(held, -1)
    before[0] = after[-1] = False
    ends = np.append(breaks[1:], True)
    firsts, lasts = (
        np.flatnonzero(held & (~before | breaks)),
        np.flatnonzero(held & (~after | ends)),
    )
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def segments_of(
    motion: Motion,
    law: Law,
    touches: Touches,
    *,
    exact: bool = True,
    pushed: tuple[Float64, Float64] | None = None,
    placed: NDArray[np.bool_] | None = None,
    before: Motion | None = None,
    rolls: NDArray[np.bool_] | None = None,
) -> Segments:
    """Return the segment of every sample of one rigid body that was stepped.

    Parameters
    ----------
    motion
        The recorded motion of a body without joints.
    law
        The law that it follows where nothing touches it.
    touches
        What touches it.
    exact
        Whether the engine's machine rounds each operation once.
    pushed
        Forces [N] and torques [N m] that were applied in the step which led to each sample.
    placed
        Which samples a call put there, and no step; the first one without any.
    before
        What each step began with; None where that is the sample before.
    rolls
        In which samples contact may have given a torque that is not reported. It is `contact` by
        its momentum along the axes then, whatever its spin does; None where that is not enough.
    """
    before = motion.before() if before is None else before
    balance = balance_of(motion, law, touches, pushed, before=before)
    several, bits = law.substeps > 1, law.bits(before)
    exactly, ulps = 0.0 if exact else FUSED, ULPS * law.epsilon

    # With one step to a sample its own velocities moved it, whatever gave it these.
    alone = balance.law
    moved = alone if several else law.moved(before, motion.velocity_m_s, motion.spin_rad_s)
    position, orientation = motion.position_m, _same_way(motion.orientation, moved.orientation)
    terms_m_s, terms_rad_s = law.terms(before)
    turns = np.where(bits | law.moves_exactly, exactly, ulps)
    place_m, turn = _off(position, moved.position_m), _off(orientation, moved.orientation)
    there = place_m <= turns * (np.abs(position).max(axis=1) + law.timestep_s * terms_m_s)
    # As uncertain as the spin that turned it, which may be read back through a rotation too.
    dt, spin_rad_s = law.timestep_s, np.linalg.norm(motion.spin_rad_s, axis=1)
    there &= turn <= law.oriented + exactly + dt * (ulps * spin_rad_s + turns * terms_rad_s)

    # What the solver tries at a point and takes back leaves rounding: of a spin too that is 0 then.
    sum_m_s = terms_m_s + np.abs(motion.velocity_m_s).max(axis=1)
    sum_rad_s = terms_rad_s + np.abs(motion.spin_rad_s).max(axis=1)
    near, tried_m_s, tried_rad_s = _tried(law, before, touches, sum_m_s, sum_rad_s)
    rounded = np.where(bits & ~near, exactly, ulps)
    fall_m_s = _off(motion.velocity_m_s, alone.velocity_m_s)
    fall_rad_s = _off(motion.spin_rad_s, alone.spin_rad_s)
    free = fall_m_s <= rounded * (sum_m_s + tried_m_s)
    free &= fall_rad_s <= rounded * (sum_rad_s + tried_rad_s)
    balanced = balance.closes(motion) if not several else np.zeros(len(motion), dtype=bool)

    forced = np.zeros(len(motion), dtype=bool) if pushed is None else np.hstack(pushed).any(axis=1)
    code = np.full(len(motion), UNEXPLAINED, np.int8)
    code[there & free & ~balance.touched & ~forced] = FLIGHT
    code[there & balanced & balance.touched] = CONTACT
    if rolls is not None and not several:
        code[there & near & rolls & balance.closes_linear(motion)] = CONTACT
    code[there & balanced & forced] = PUSHED
    code[np.arange(len(motion)) == 0 if placed is None else placed] = SET
    off_m_s = np.where(
        balance.touched | forced, _off(motion.velocity_m_s, balance.velocity_m_s), fall_m_s
    )
    off_rad_s = np.where(
        balance.touched | forced, _off(motion.spin_rad_s, balance.spin_rad_s), fall_rad_s
    )
    deviation = np.max([place_m, turn, off_m_s, off_rad_s], axis=0)
    follows = (code == FLIGHT) | (np.isin(code, (CONTACT, PUSHED)) & balanced)
    held = np.where(follows, law.limited(before) | balance.held, _at_limit(law, before, motion))
    return Segments(code, deviation, balance, held)


def _at_limit(law: Law, before: Motion, motion: Motion) -> NDArray[np.bool_]:
    """Return which samples have a velocity at the engine's limit that they had not before, (n,)."""
    found = np.zeros(len(motion), dtype=bool)
    for name in ("velocity_m_s", "spin_rad_s"):
        was, now = getattr(before, name), getattr(motion, name)
        beyond = np.nextafter(now, np.copysign(np.inf, now))
        reached = np.isfinite(now) & (law.held(beyond) == now) & (now != was)
        found |= reached.any(axis=1)
    return found


def _tried(
    law: Law, before: Motion, touches: Touches, sum_m_s: Float64, sum_rad_s: Float64
) -> tuple[NDArray[np.bool_], Float64, Float64]:
    """Return where a point touches, and what an impulse there may add to velocity and spin, (n,).

    One that stops the point: with v its speed and r its way from the centre it changes the velocity
    by v at most, and the spin by v m r / (I + m r²), I the least moment of inertia.
    """
    near = np.isin(np.arange(len(before)), touches.step)
    arm_m = np.zeros(len(before))
    way_m = touches.position_m - before.position_m[touches.step]
    np.maximum.at(arm_m, touches.step, np.linalg.norm(way_m, axis=1))
    speed_m_s = np.where(near, sum_m_s + sum_rad_s * arm_m, 0.0)
    turning = min(law.inertia_kg_m2) / law.mass_kg + arm_m**2
    turn_per_m = np.divide(arm_m, turning, out=np.zeros_like(arm_m), where=turning > 0)
    return near, sum_rad_s * arm_m, speed_m_s * turn_per_m


def still_segments(motion: Motion) -> Segments:
    """Return the segments of a body that was never stepped: nothing changes, or it was altered."""
    state = np.hstack(
        (motion.position_m, motion.orientation, motion.velocity_m_s, motion.spin_rad_s)
    )
    deviation = np.abs(state - state[0]).max(axis=1)
    code = np.where(deviation == 0, STILL, UNEXPLAINED).astype(np.int8)
    return Segments(code, deviation, None, np.zeros(len(motion), dtype=bool))


def jointed_segments(samples: int) -> Segments:
    """Return the segments of a body with joints, of which only the release is known."""
    code = np.full(samples, JOINTED, np.int8)
    code[0] = SET
    return Segments(code, np.zeros(samples), None, np.zeros(samples, dtype=bool))


_VECTORS = ("position_m", "velocity_m_s", "spin_rad_s")


def _off(values: Float64, reference: Float64) -> Float64:
    """Return the largest difference in each sample, shape (samples,)."""
    return np.asarray(np.abs(values - reference).max(axis=1))


def _same_way(orientation: Float64, reference: Float64) -> Float64:
    """Return quaternions with the sign of others: it and its negative are one orientation."""
    agree = np.sum(orientation * reference, axis=1, keepdims=True)
    return np.where(agree < 0, -orientation, orientation)
