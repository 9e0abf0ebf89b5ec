"""Classifies a single body's samples by the kind of step before them: flight, contact and others.

    x' = x + v' dt        is exact in every segment to the last bit, and so is the rotation by ω'
    v', ω'                follow from the law in flight, else from law and contacts (`balance`)

The segment of a sample is that of the step before it, so it depends on two samples and the contacts
between them. Steps of these kinds are not covered, and `unexplained`: contact in a timestep of
several substeps, of which PyBullet reports only the last; rolling and spinning friction, which
PyBullet does not report, or reports instead of sliding friction if cone friction is off; and the
first contact step of a btRigidBody after a rotation or a change of mass, which PyBullet computes
with the inertia from loading. Bodies with joints are not covered at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from drop_physics.arrays import Flags, Float64, Int8
from drop_physics.explain.balance import ULPS, Pushes, balance_of
from drop_physics.explain.touching import Touches
from drop_physics.physics.base import FUSED, ORIENTED, ROUNDING, Law, Motion
from drop_physics.physics.rotations import same_way
from drop_physics.physics.vectors import any_of, largest, lengths

Segment = Literal["flight", "contact", "pushed", "set", "unexplained"]
SEGMENTS: tuple[Segment, ...] = get_args(Segment)
FLIGHT, CONTACT, PUSHED, SET, UNEXPLAINED = range(len(SEGMENTS))

BLOCK = 1 << 14
"""Number of samples classified at a time, small enough for the processor's cache."""


@dataclass(frozen=True)
class Segments:
    """The kind of step before each sample of a body; arrays have the shape (samples,)."""

    code: Int8
    """Indices into `SEGMENTS`."""
    held: Flags
    """Whether the engine clamped a velocity in the step before each sample.

    For an unexplained sample: whether a velocity is exactly at the limit.
    """


def segments_of(
    motion: Motion,
    law: Law,
    touches: Touches,
    *,
    exact: bool = True,
    pushes: Pushes | None = None,
    placed: Flags | None = None,
    before: Motion | None = None,
    rolls: Flags | None = None,
) -> Segments:
    """Return the kind of step before each sample of a single rigid body.

    Parameters
    ----------
    motion
        The recorded motion of a body without joints.
    law
        The body's law of motion without contacts.
    touches
        The contact points of the body, in the order of the samples.
    exact
        Whether the engine's machine rounds each operation once.
    pushes
        Forces and torques that the script applied in the step before each sample; None without any.
    placed
        Flags of samples before which a call set the state instead of a step; None for the first
        only.
    before
        The motion at the start of each step; None if it is always that of the previous sample.
    rolls
        Flags of samples before which contact may have exerted an unreported torque: they are
        `contact` or `pushed` if the linear momentum balances, whatever the spin. None if the spin
        must balance in all samples.
    """
    before = motion.before() if before is None else before
    placed = np.arange(len(motion)) == 0 if placed is None else placed
    blocks = []
    for first in range(0, max(1, len(motion)), BLOCK):
        rows = slice(first, first + BLOCK)
        points = slice(*np.searchsorted(touches.step, [first, first + BLOCK]))
        block = _of_block(
            motion.at(rows),
            law,
            touches.since(first, points),
            exact=exact,
            pushes=None if pushes is None else pushes.at(rows),
            placed=placed[rows],
            before=before.at(rows),
            rolls=None if rolls is None else rolls[rows],
        )
        blocks.append(block)
    return Segments(
        *(np.concatenate([getattr(each, name) for each in blocks]) for name in ("code", "held"))
    )


def _of_block(
    motion: Motion,
    law: Law,
    touches: Touches,
    *,
    exact: bool,
    pushes: Pushes | None,
    placed: Flags,
    before: Motion,
    rolls: Flags | None,
) -> Segments:
    """Return the kinds of step for consecutive samples."""
    balance = balance_of(motion, law, touches, pushes, before=before)
    several, bits = law.substeps > 1, law.bits(before)
    exactly, ulps = 0.0 if exact else FUSED, ULPS * ROUNDING

    # With one step per sample, the sample's own velocities moved the body, whatever caused them.
    alone = balance.law
    moved = alone if several else law.moved(before, motion.velocity_m_s, motion.spin_rad_s)
    position, orientation = motion.position_m, same_way(motion.orientation, moved.orientation)
    terms_m_s, terms_rad_s = law.terms(before)
    exactly_there = bits | law.moves_exactly
    turns = np.where(exactly_there, exactly, ulps)
    aside = np.where(exactly_there, 0.0, ORIENTED)
    place_m, turn = _off(position, moved.position_m), _off(orientation, moved.orientation)
    way_m = law.timestep_s * terms_m_s
    # A deviating orientation turns the path aside.
    there = place_m <= turns * (largest(position) + way_m) + aside * way_m
    # As uncertain as the spin that turned it, which may have been read back through a rotation.
    dt, spin_rad_s = law.timestep_s, lengths(motion.spin_rad_s)
    there &= turn <= ORIENTED + exactly + dt * (ulps * spin_rad_s + turns * terms_rad_s)

    sum_m_s = terms_m_s + largest(motion.velocity_m_s)
    sum_rad_s = terms_rad_s + largest(motion.spin_rad_s)
    near = balance.near
    rounded = np.where(bits & ~near, exactly, ulps)
    fall_m_s = _off(motion.velocity_m_s, alone.velocity_m_s)
    fall_rad_s = _off(motion.spin_rad_s, alone.spin_rad_s)
    free = fall_m_s <= rounded * (sum_m_s + balance.tried_m_s)
    free &= fall_rad_s <= rounded * (sum_rad_s + balance.tried_rad_s)
    closes, closes_linear = balance.closes(motion), balance.closes_linear(motion)
    balanced = closes & (not several)

    forced = np.zeros(len(motion), dtype=bool) if pushes is None else pushes.acted
    code = np.full(len(motion), UNEXPLAINED, np.int8)
    code[there & free & ~balance.touched & ~forced] = FLIGHT
    code[there & balanced & balance.touched] = CONTACT
    code[there & balanced & forced] = PUSHED
    if rolls is not None and not several:
        rolling = (code == UNEXPLAINED) & there & near & rolls & closes_linear
        code[rolling] = np.where(forced, PUSHED, CONTACT)[rolling]
    code[placed] = SET
    follows = (code == FLIGHT) | (np.isin(code, (CONTACT, PUSHED)) & balanced)
    held = np.where(follows, law.limited(before) | balance.held, _at_limit(law, before, motion))
    return Segments(code, held)


def _at_limit(law: Law, before: Motion, motion: Motion) -> Flags:
    """Flag samples whose velocity has just been clamped to the engine's limit, shape (n,)."""
    limited = np.zeros(len(motion), dtype=bool)
    for name in ("velocity_m_s", "spin_rad_s"):
        was, now = getattr(before, name), getattr(motion, name)
        beyond = np.nextafter(now, np.copysign(np.inf, now))
        reached = np.isfinite(now) & (law.held(beyond) == now) & (now != was)
        limited |= any_of(reached)
    return limited


def _off(values: Float64, reference: Float64) -> Float64:
    """Return the largest absolute difference in each sample, shape (samples,)."""
    return largest(values - reference)
