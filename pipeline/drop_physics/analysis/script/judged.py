"""One body of a script, judged: what each of its samples is, and why some are unexplained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.general.contacts import Contacts, Touches
from drop_physics.analysis.general.segments import (
    FLIGHT,
    JOINTED,
    SET,
    STILL,
    UNEXPLAINED,
    segments_of,
    unbroken,
)
from drop_physics.analysis.script.tracks import NUMBERS, POSE, Epoch, Flags, Track
from drop_physics.laws.base import EXACT_MACHINES
from drop_physics.laws.bullet import BulletLaw
from drop_physics.laws.bullet_air import EPSILON
from drop_physics.laws.bullet_contact import CONTACT_SLOP_M
from drop_physics.laws.lookup import RIGID, law_of
from drop_physics.laws.rotations import rotate_inverse
from drop_physics.messages import Message
from drop_physics.seen.events import Body

Float64 = NDArray[np.float64]
Int8 = NDArray[np.int8]

REASONS = (
    "",
    Message("contact in a step of several substeps, of which PyBullet reports only the last"),
    Message("a push in a step of several substeps"),
    Message("falling asleep, or waking up"),
    Message("continuous collision detection (ccdSweptSphereRadius), which stops a body mid-step"),
    Message("links of a btRigidBody, which PyBullet does not show"),
    Message("soft bodies, whose contact PyBullet does not report"),
    Message("a mass that is not positive and finite, or whose inverse is not finite"),
    Message(
        "no mass: nothing that it touches changes its velocity, and drop does not know PyBullet's "
        "law for that"
    ),
    Message("a timestep below 2.2e-16 s, or not finite, which the law does not cover"),
    Message(
        "a btRigidBody deep in another: Bullet corrects that outside its law (split impulse, from "
        "40 mm on by default; p.setPhysicsEngineParameter(useSplitImpulse=0) disables it)"
    ),
    Message(
        "contact with or a push of a btRigidBody right after a call turned it or changed its mass: "
        "Bullet turns it with its previous inertia"
    ),
    Message(
        "rolling friction with enableConeFriction=0: PyBullet reports its torque in place of the "
        "force of sliding friction"
    ),
    Message(
        "a btRigidBody that was added without mass: even if it gets mass later, Bullet does not "
        "integrate it, but lets contact and pushes change its velocity"
    ),
    Message(
        "contactProcessingThreshold: the engine leaves out points at a greater distance, of which "
        "PyBullet goes on reporting the last force"
    ),
    Message("a state that is not finite"),
    Message(
        "what a call set before the recording began, and PyBullet does not report: damping, for one"
    ),
    Message("unknown: nothing recorded explains it"),
)
"""Why a sample is unexplained, by number; 0 where it is explained."""
(
    SUBSTEPS, PUSHES, SLEEP, CCD, LINKS, SOFT, NO_INVERSE, MASSLESS, TIMELESS, SPLIT, STALE, ROLLS,
    STANDS, LEFT_OUT, INFINITE, BEFORE, UNKNOWN,
) = range(1, len(REASONS))  # fmt: skip

SPLITS = {"contactSlop": CONTACT_SLOP_M, "splitImpulsePenetrationThreshold": -0.04}
"""Defaults that decide where Bullet splits an impulse [m]: `btContactSolverInfo.h`."""
HIDDEN = -1
"""What PyBullet calls the body of a link that it does not show: always a btRigidBody."""
DISABLE_SLEEPING = 2
"""Of `activationState`."""


@dataclass(frozen=True)
class Judged:
    """A track, and what each of its samples is; all arrays have a row per sample."""

    track: Track
    code: Int8
    """Indices into `SEGMENTS`."""
    reason: Int8
    """Indices into `REASONS`."""
    deviation: Float64
    """How far the sample deviates from its law, in its worst number [m, m/s, rad/s, 1]."""
    falls: Flags
    """Whether a step of free flight led to it, from a known state."""
    held: Flags
    """Whether the engine clamped a velocity in that step."""
    impulse_n_s: Float64
    """Impulse of contact in that step, (samples, 3)."""
    energy_j: Float64
    """Kinetic energy that contact gave in that step; negative where it took."""
    touches: Touches
    """Its contact points: the step of each is the row of a sample."""
    point_energy_j: Float64
    """The same energy by contact point."""
    laws: list[tuple[Epoch, BulletLaw | None]]
    """The law of each epoch; None where there is none."""

    def kinetic_j(self, row: int, *, before: bool) -> float:
        """Return the kinetic energy at a sample, or at the start of its step [J]."""
        law = self.law_at(row)
        assert law is not None
        start = self.track.before.at(slice(row, row + 1))
        state = start if before else self.track.motion.at(slice(row, row + 1))
        spin = rotate_inverse(state.orientation, state.spin_rad_s)[0]
        velocity = state.velocity_m_s[0]
        inertia = np.array(law.inertia_kg_m2)
        return float(law.mass_kg * (velocity @ velocity) + inertia @ spin**2) / 2

    def law_at(self, row: int) -> BulletLaw | None:
        """Return the law of the step that led to a sample."""
        return next((law for epoch, law in self.laws if row < epoch.rows.stop), None)

    def runs(self, code: int) -> list[tuple[int, int]]:
        """Return first and last sample of each unbroken run of a segment, within one epoch."""
        return unbroken(self.code == code, self._breaks)

    @property
    def _breaks(self) -> Flags:
        """Whether a sample begins something new: other settings, or after missing steps."""
        breaks = ~self.track.led
        breaks[[epoch.rows.start for epoch, _ in self.laws]] = True
        return breaks


def judged(
    track: Track,
    contacts: Contacts,
    *,
    springy: frozenset[int],
    rigid: frozenset[int],
    rolling: frozenset[int],
    nearest_m: Mapping[int, float],
    soft: bool,
    stepped: bool,
    machine: str,
) -> Judged:
    """Judge one body.

    Parameters
    ----------
    track
        Its samples.
    contacts
        The contact points of all bodies.
    springy
        Bodies whose contact is a spring.
    rigid
        Those that are btRigidBodies.
    rolling
        Bodies with rolling or spinning friction, whose torque PyBullet does not report.
    nearest_m
        The least contactProcessingThreshold that a call gave each body, by number.
    soft
        Whether there are soft bodies.
    stepped
        Whether its simulation was ever stepped.
    machine
        Kind of processor; if empty, one that rounds each operation once is assumed.
    """
    rows = len(track)
    touches = _touches(track, contacts)
    code = np.where(track.led, UNEXPLAINED, SET if stepped else STILL).astype(np.int8)
    reason = np.zeros(rows, np.int8)
    deviation, energy_j = np.zeros((2, rows))
    impulse_n_s, point_energy_j = np.zeros((rows, 3)), np.zeros(len(touches.step))
    falls, held, split, masked = np.zeros((4, rows), dtype=bool)
    # Whether the momentum balances, and whether the body is where its velocities moved it.
    linear, moved = np.zeros((2, rows), dtype=bool)
    laws: list[tuple[Epoch, BulletLaw | None]] = []
    jointed = bool(track.body.joints)
    rolls = _with(touches, rolling, track)
    for epoch in track.epochs:
        law = (
            None if jointed else law_of(epoch.settings.values, epoch.dynamics.reported, epoch.given)
        )
        laws.append((epoch, law))
        part = epoch.rows
        points = (touches.step >= part.start) & (touches.step < part.stop)
        theirs = touches.at(points, touches.step[points] - part.start)
        deep = _deep(epoch, theirs, rigid)
        if epoch.stands:
            code[part] = np.where(track.led & _same(track, NUMBERS), STILL, code)[part]
            reason[part] = np.where(deep, SPLIT, UNKNOWN)
            reason[part][_same(track, POSE)[part]] = STANDS
            continue
        if law is None:
            code[part] = np.where(track.led[part], JOINTED, code[part])
            continue
        if not has_inverse(law.mass_kg):
            carried = law.mass_kg == 0 and law.coordinates == "reduced"
            if carried:
                code[part] = np.where(track.led & _same(track, NUMBERS), STILL, code)[part]
            reason[part] = MASSLESS if carried else NO_INVERSE
            continue
        if not can_step(law.timestep_s):
            reason[part] = TIMELESS
            continue
        pushes = track.pushes.at(part)
        segments = segments_of(
            track.motion.at(part),
            law,
            theirs,
            exact=machine in ("", *EXACT_MACHINES),
            pushes=pushes if pushes.acted.any() else None,
            placed=~track.led[part],
            before=track.before.at(part),
            rolls=rolls[part],
        )
        contact = segments.contact
        assert contact is not None
        code[part], deviation[part], held[part] = segments.code, segments.deviation, segments.held
        impulse_n_s[part], energy_j[part] = contact.impulse_n_s, contact.energy_j
        point_energy_j[points] = contact.point_energy_j
        falls[part] = segments.code == FLIGHT
        reason[part] = SOFT if soft else _reason(track.body, epoch, law)
        masked[part] = rolls[part] & _masked(epoch, theirs, rigid)
        linear[part] = contact.closes_linear
        # It moves bodies, but does not change their velocities.
        split[part] = deep & (contact.closes | (rolls & linear | masked)[part])
        moved[part] = segments.moved | deep
    forced = track.pushes.acted
    reason[forced & (reason == SUBSTEPS)] = PUSHES
    states = [getattr(each, name) for each in (track.motion, track.before) for name in NUMBERS]
    reason[~np.isfinite(np.hstack(states)).all(axis=1)] = INFINITE
    for number, why in (
        (ROLLS, masked & moved),
        (SPLIT, split),
        (LEFT_OUT, _left_out(track, touches, nearest_m) & moved),
        (STALE, _stale(track, touches, forced) & linear & moved),
    ):
        reason[why & (reason == UNKNOWN)] = number
    open_ = code == UNEXPLAINED
    code[open_ & (track.constrained | _with(touches, springy, track))] = JOINTED
    code[(code != UNEXPLAINED) & track.put & track.led & (code != JOINTED)] = SET
    _asleep(track, code, reason)
    if track.body.before:
        reason[reason == UNKNOWN] = BEFORE
    reason[code != UNEXPLAINED] = 0
    return Judged(
        track, code, reason, deviation, falls, held, impulse_n_s, energy_j, touches,
        point_energy_j, laws,
    )  # fmt: skip


def has_inverse(mass_kg: float) -> bool:
    """Whether the engine can divide by a mass."""
    return mass_kg > 0 and 0 < 1 / mass_kg < math.inf


def can_step(timestep_s: float) -> bool:
    """Whether the engine takes a timestep."""
    return EPSILON <= timestep_s < math.inf


def _touches(track: Track, contacts: Contacts) -> Touches:
    """Return the contact points of a body, by rows of its samples."""
    touches = contacts.of(track.body.number)
    rows = np.minimum(np.searchsorted(track.steps, touches.step), len(track) - 1)
    its = (track.steps[rows] == touches.step) & track.led[rows]
    return touches.at(its, rows[its])


def _with(touches: Touches, bodies: frozenset[int], track: Track) -> Flags:
    """Return in which samples a body touched one of some bodies, or anything if it is one."""
    met = np.zeros(len(track), dtype=bool)
    its = np.isin(touches.other_body, list(bodies)) | (track.body.number in bodies)
    met[touches.step[its]] = True
    return met


def _stale(track: Track, touches: Touches, forced: Flags) -> Flags:
    """Return in which samples a btRigidBody was pushed right after it was turned or changed."""
    # The first step of all follows whatever calls changed since the body was loaded.
    changed, last = np.zeros(len(track), dtype=bool), None
    changed[1:] = ~track.led[:-1]
    changed |= track.put
    for epoch in track.epochs:
        changed[epoch.rows.start] |= epoch.dynamics is not last
        last = epoch.dynamics
        if epoch.dynamics.reported["kind"][0] != RIGID:
            changed[epoch.rows] = False
    return changed & (forced | np.isin(np.arange(len(track)), touches.step))


def _deep(epoch: Epoch, touches: Touches, rigid: frozenset[int]) -> Flags:
    """Return in which samples a btRigidBody is so deep in another that Bullet moves them apart.

    `btSequentialImpulseConstraintSolver::setupContactConstraint`: where distance and slop are not
    above a threshold. PyBullet ignores a threshold or slop below 0.
    """
    moves = np.zeros(epoch.rows.stop - epoch.rows.start, dtype=bool)
    given = epoch.settings.values
    if epoch.dynamics.reported["kind"][0] == RIGID and given.get("set_useSplitImpulse", 1) != 0:
        slop_m, most_m = (
            float(value) if (value := np.ravel(given.get(f"set_{name}", -1))[0]) >= 0 else default
            for name, default in SPLITS.items()
        )
        deep = touches.distance_m + slop_m <= most_m
        moves[touches.step[deep & _meets(touches, rigid)]] = True
    return moves


def _meets(touches: Touches, rigid: frozenset[int]) -> NDArray[np.bool_]:
    """Return at which points a body touches a btRigidBody, (points,)."""
    return np.isin(touches.other_body, [HIDDEN, *rigid])


def _masked(epoch: Epoch, touches: Touches, rigid: frozenset[int]) -> Flags:
    """Return in which samples a reported friction may be rolling friction.

    `btMultiBodyConstraintSolver::addMultiBodyTorsionalFrictionConstraint`: with cone friction off
    its rows precede those of sliding friction, whose forces PyBullet reads at the first of both.
    Not between two btRigidBodies, which another solver has.
    """
    masked = np.zeros(epoch.rows.stop - epoch.rows.start, dtype=bool)
    if epoch.settings.values.get("set_enableConeFriction", 1) == 0:
        alone = epoch.dynamics.reported["kind"][0] == RIGID
        masked[touches.step[~(alone & _meets(touches, rigid))]] = True
    return masked


def _left_out(track: Track, touches: Touches, nearest_m: Mapping[int, float]) -> Flags:
    """Return in which samples a point was too far away for the engine to process.

    That is beyond the lesser of both bodies' thresholds
    (`btSequentialImpulseConstraintSolver::convertContact`).
    """
    own_m = nearest_m.get(track.body.number, math.inf)
    others, which = np.unique(touches.other_body, return_inverse=True)
    others_m = np.array([nearest_m.get(int(number), math.inf) for number in others])
    left_out = np.zeros(len(track), dtype=bool)
    if len(others):
        left_out[touches.step[touches.distance_m > np.minimum(own_m, others_m[which])]] = True
    return left_out


def _reason(body: Body, epoch: Epoch, law: BulletLaw) -> int:
    """Return why the samples of an epoch may be unexplained."""
    if law.substeps > 1:
        return SUBSTEPS
    if body.hides_links:
        return LINKS
    if epoch.given.get("ccdSweptSphereRadius", 0) > 0:
        return CCD
    return UNKNOWN


def _same(track: Track, names: Sequence[str]) -> Flags:
    """Return in which samples some numbers are those that the step began with."""
    after, before = (
        np.hstack([getattr(motion, name) for name in names])
        for motion in (track.motion, track.before)
    )
    return np.asarray((after == before).all(axis=1))


def _asleep(track: Track, code: Int8, reason: Int8) -> None:
    """Mark the samples at which a body that may fall asleep slept, began to, or woke up.

    Bullet stops a body that falls asleep, so that it has no velocity until something moves it.
    """
    same = _same(track, NUMBERS) & track.led
    at_rest, was_at_rest = (
        ~np.hstack((motion.velocity_m_s, motion.spin_rad_s)).any(axis=1)
        for motion in (track.motion, track.before)
    )
    may = np.zeros(len(track), dtype=bool)
    for epoch in track.epochs:
        state = epoch.given.get("activationState", 0)
        may[epoch.rows] = (track.body.can_sleep or state > 0) and not int(state) & DISABLE_SLEEPING
    open_ = (code == UNEXPLAINED) & may
    code[open_ & same & at_rest] = STILL
    reason[open_ & (at_rest | was_at_rest) & np.isin(reason, (UNKNOWN, SUBSTEPS))] = SLEEP
