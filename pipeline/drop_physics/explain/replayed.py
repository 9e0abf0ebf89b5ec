"""Explains MuJoCo recordings from recorded impulses, where the engine replayed each step.

Each step is still judged: with the mass matrix from drop's own kinematics, the recorded impulses
must add up to the change of momentum, and the velocities after the step must lead to the pose after
it. `Replayed` is an `Explanation` that takes its terms from the recording instead of a law.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.bodies import Record
from drop_physics.explain.body_history import BodyHistory
from drop_physics.explain.causes import TENDON_LIMIT
from drop_physics.explain.changes import Transitions, changes_of
from drop_physics.explain.driving import actuator_commands
from drop_physics.explain.joined import Pull
from drop_physics.explain.recording import Explanation
from drop_physics.explain.step_status import (
    CONSTRAINED,
    CONTACT,
    DRIVEN,
    FLIGHT,
    PUSHED,
    SET,
    STILL,
    WHYS,
    StepVerdicts,
    stands,
)
from drop_physics.explain.steps import BodySteps, Interval, StepBatch, Steps, columns_of
from drop_physics.explain.touching import Touching, rows_of
from drop_physics.physics.dynamics import lifted_j, mass_matrix
from drop_physics.physics.impulses import EXPLAINED, MOVED, PULLED, Sum, Summed, change_of
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.moving import moved, way_between
from drop_physics.physics.rotations import products, rotate, rotate_inverse
from drop_physics.physics.step_law import DampedTree, Reported
from drop_physics.physics.tree import States
from drop_physics.trace.events import REPLAYS, Body, ImpulseCause, Impulses
from drop_physics.trace.history import Piece, Seen

ACTUATOR = "actuator"
ANOTHER = "another engine"
"""Cause of the difference between another program's step and the engine's own, which only imported
recordings have."""
NAMED = (ACTUATOR, "tendon", TENDON_LIMIT.strip())
"""The kinds of causes of which a body has several, distinguished by name."""
CONSTRAINTS = "constraints"
ALWAYS = (PULLED, MOVED, "damping", "applied", "contacts", CONSTRAINTS, "stops")
"""Causes for which every step has a term, which is zero if they do not act."""
NEVER, LATER = REPLAYS.index("not replayed"), REPLAYS.index("not asked")
RUNGE_KUTTA = 1.0
"""Value of the setting `integrator` for RK4, whose pose follows from velocities within the step."""
MOVED_BY = 1e-12
"""Maximum deviation [m, rad] of a pose from integrated velocities that counts as rounding, for a
body within 1 m of the origin; measured: 3e-15."""
SEGMENT_OF = (
    (DRIVEN, f"{ACTUATOR} "),
    (CONTACT, "contacts"),
    (CONSTRAINED, CONSTRAINTS),
    (CONSTRAINED, "tendon "),
    (PUSHED, "applied"),
)
"""Segment of a step in which a cause with the given prefix acts; the last match in this list
counts."""


def cause_name(cause: ImpulseCause) -> str:
    """Return the name of the term that sums up a cause."""
    return f"{cause.kind} {cause.name}" if cause.kind in NAMED else cause.kind


class Replayed(Explanation):
    """Explains a recording from the impulses stored in it."""

    def __init__(self, seen: Seen) -> None:
        super().__init__(seen)
        self.frictions = seen.frictions
        self._absent = LATER if seen.can_replay else NEVER

    def prepared(self, piece: Piece) -> Piece:
        """Return a chunk unchanged: its impulses need no correction."""
        return piece

    def batches(
        self,
        piece: Piece,
        intervals: Sequence[Interval],
        touching: Touching,
        histories: Mapping[int, tuple[BodyHistory, int]],  # noqa: ARG002 - some need it
    ) -> list[tuple[StepBatch, StepVerdicts]]:
        """Explain the steps of a chunk, interval by interval."""
        acted = {
            client: _Acted(parts, self.seen.causes, self._absent)
            for client, parts in piece.impulses.items()
            if any(len(part.steps) for part in parts)
        }
        return [
            self._steps(interval, piece, touching, acted.get(interval.record.body.client))
            for interval in intervals
        ]

    def _steps(
        self, interval: Interval, piece: Piece, touching: Touching, acted: _Acted | None
    ) -> tuple[StepBatch, StepVerdicts]:
        """Explain the steps of one body while its settings are constant."""
        record, history, config = interval.record, interval.states, interval.config
        law, body = config.law, record.body
        tree, real = law.tree, history.stepped[1:].copy()
        where = np.flatnonzero(real)
        states = history.states(tree)
        before, after = states.at(where), states.at(where + 1)
        ends, n, size = history.steps[where + 1], len(where), tree.size
        timestep_s, gravity_m_s2 = self.times[body.client].of_steps(ends)
        rows = Transitions(real, gravity_m_s2)
        status = np.full(n, self._absent) if acted is None else acted.status_of(ends)
        terms = {} if acted is None else acted.terms_of(body, ends, size)
        added = None
        if terms and size:
            turned = _frame_turn(record, before, after) if not tree.fixed else None
            added = _sum(law, states, rows, terms, turned)
            added = _without_causes(added, where[status != 0])
        sides, at = touching.of([body.number], np.zeros(n, np.int64), ends)
        joints = slice(tree.first_rate, None)
        motors = np.zeros((n, tree.joint_rates))
        for name, term in terms.items():
            if name.startswith(ACTUATOR):
                motors += term[:, joints] / timestep_s[:, None]
        nothing = np.zeros_like(motors)
        reported = Reported(
            timestep_s=timestep_s,
            gravity_m_s2=gravity_m_s2,
            motors=motors,
            commanded=nothing,
            pd=nothing,
            contacts=touching.forces(sides, at),
        )
        unexplained = np.zeros(n) if added is None else added.unexplained[real]
        whole = Steps(
            config=config,
            law=law,
            steps=ends,
            before=before,
            after=after,
            put=~history.sampled[where],
            asked=actuator_commands(body, piece, ends, timestep_s),
            reported=reported,
            sides=sides,
            **columns_of(added, real, size),
            unexplained=unexplained,
            closes=np.asarray((unexplained <= EXPLAINED) & (status == 0)),
            unknown=np.zeros(n, np.bool_),
            alone=None,
            pulls={} if acted is None else acted.pulls_of(body, ends, size),
        )
        stages = self._by_stages(body.client, ends)
        judged = tree.size and ANOTHER not in terms
        strays = _strays(record, whole) & ~stages if judged else np.zeros(n, np.bool_)
        (changes,) = changes_of(law, states, rows, added, [(slice(0, len(real)), slice(0, n))])
        batch = StepBatch(whole, [BodySteps(whole, slice(0, n), config, body, changes)])
        return batch, _verdicts(whole, status, strays)

    def _by_stages(self, client: int, ends: Int64) -> Flags:
        """Flag the steps integrated by RK4."""
        settings = self._settings[client]
        which = np.searchsorted([each.at.step for each in settings], ends - 1, side="right") - 1
        by = np.array([each.values.get("integrator") == RUNGE_KUTTA for each in settings])
        return np.asarray(by[which])


class _Acted:
    """The recorded impulses of one simulation in a chunk's steps."""

    def __init__(
        self, parts: Sequence[Impulses], causes: Mapping[int, ImpulseCause], absent: int
    ) -> None:
        self._causes, self._absent = causes, absent
        self.steps, self._status, counts, self._numbers, self._values = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("steps", "status", "counts", "causes", "values")
        )
        rows = np.repeat(np.arange(len(self.steps)), counts)
        width = np.array(
            [len(causes[number].places) for number in range(max(causes, default=-1) + 1)]
        )
        wide = width[self._numbers] if len(self._numbers) else np.empty(0, np.int64)
        begin = np.cumsum(wide) - wide
        order = np.argsort(self._numbers, kind="stable")
        bounds = np.flatnonzero(np.diff(self._numbers[order], prepend=-1, append=-2))
        self._of: dict[int, list[tuple[ImpulseCause, Int64, Int64]]] = {}
        """Causes on each body by id, with the rows of their steps and the index of their values."""
        for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            its = order[a:b]
            cause = causes[int(self._numbers[its[0]])]
            self._of.setdefault(cause.body, []).append((cause, rows[its], begin[its]))

    def status_of(self, ends: Int64) -> Int64:
        """Return the results of replaying the given steps, as indices into `REPLAYS`."""
        found, at = rows_of(ends, self.steps)
        status = np.full(len(ends), self._absent)
        status[found] = self._status[at]
        return status

    def terms_of(self, body: Body, ends: Int64, size: int) -> dict[str, Float64]:
        """Return the impulses on a body in the given steps, by cause, (n, size) each."""
        terms = {name: np.zeros((len(ends), size)) for name in ALWAYS}
        for cause, impulse in self._impulses(body, ends, size):
            name = cause_name(cause)
            terms[name] = terms[name] + impulse if name in terms else impulse
        return terms

    def pulls_of(self, body: Body, ends: Int64, size: int) -> dict[Pull, Float64]:
        """Return the impulses of constraints on a body, by constraint, (n, size) each."""
        its = self._impulses(body, ends, size)
        return {Pull(cause.name): impulse for cause, impulse in its if cause.kind == CONSTRAINTS}

    def _impulses(
        self, body: Body, ends: Int64, size: int
    ) -> Iterator[tuple[ImpulseCause, Float64]]:
        """Yield the causes that act on a body, with their impulses, shape (n, size)."""
        for cause, rows, begin in self._of.get(body.number, ()):
            found, at = rows_of(self.steps[rows], ends)
            if len(found):
                impulse = np.zeros((len(ends), size))
                index = begin[found][:, None] + np.arange(len(cause.places))
                impulse[at[:, None], np.array(cause.places)] = self._values[index]
                yield cause, impulse


def _sum(
    law: DampedTree,
    states: States,
    rows: Transitions,
    terms: Mapping[str, Float64],
    turned: Float64 | None,
) -> Summed:
    """Return transitions as sums of impulses; changes by calls have no terms."""
    kin = kinematics(law.tree, states)
    matrices, where = mass_matrix(kin), rows.where
    spread = {name: rows.spread(term) for name, term in terms.items()}
    if turned is not None:
        spread[MOVED][where] -= (matrices[where] @ turned[:, :, None])[:, :, 0]
    left = change_of(matrices, states.velocity) - sum(spread.values())
    lifted = lifted_j(kin, rows.gravity_then)
    forces_n_s = np.zeros(len(rows.real))
    found = Sum(matrices, states.velocity, spread, left, lifted, forces_n_s)
    return found.summed(fixed=law.tree.fixed)


def _without_causes(added: Summed, unknown: Int64) -> Summed:
    """Count the whole change as remainder in steps whose impulses are unknown."""
    if not len(unknown):
        return added
    parts = (added.energy_j, added.changed_j), (added.momentum_kg_m_s, added.moved_kg_m_s)
    energy_j, momentum_kg_m_s = (
        {name: _but(values, unknown, 0.0) for name, values in causes.items()}
        | {"remainder": _but(causes["remainder"], unknown, whole[unknown])}
        if causes
        else {}
        for causes, whole in parts
    )
    return replace(added, energy_j=energy_j, momentum_kg_m_s=momentum_kg_m_s)


def _but(values: Float64, rows: Int64, others: Float64 | float) -> Float64:
    """Return a copy of an array with some rows replaced."""
    found = values.copy()
    found[rows] = others
    return found


def _arms(record: Record, states: States) -> Float64:
    """Return the vectors from a base's frame to its centre of mass [m], in world axes, (n, 3)."""
    reported = record.dynamics[-1].reported
    centre, axes = reported["inertial_position_m"][:1], reported["inertial_orientation"][:1]
    arm = np.tile(rotate_inverse(axes, centre), (len(states.position_m), 1))
    return rotate(states.orientation, arm)


def _frame_turn(record: Record, before: States, after: States) -> Float64:
    """Return how a free base's velocity change differs in engine axes, shape (n, size).

    The engine's u contains the spin in base axes, and the velocity of the frame's origin, which is
    at -a from the centre of mass; drop's u contains spin and velocity of the centre of mass in
    world axes. With Q the rotation from base axes to world axes before the step, r = Q a, and Q',
    r' the same after the step, the engine's u' - u is drop's plus

        spin      (Q Q'ᵀ - 1) ω'
        velocity  (Q Q'ᵀ ω') × r - ω' × r'
    """
    spin = after.velocity[:, :3]
    back = products(before.orientation, after.orientation * [-1.0, -1.0, -1.0, 1.0])
    turned = rotate(back, spin)
    out = np.zeros_like(before.velocity)
    out[:, :3] = turned - spin
    out[:, 3:6] = np.cross(turned, _arms(record, before))
    out[:, 3:6] -= np.cross(spin, _arms(record, after))
    return out


def _strays(record: Record, steps: Steps) -> Flags:
    """Flag the steps whose final velocities do not lead from start pose to end pose, shape (n,).

    MuJoCo moves a free base by the velocity of its frame's origin (`mj_integratePos`).
    """
    tree, before, after = steps.law.tree, steps.before, steps.after
    if not tree.fixed:
        arm = _arms(record, after)
        velocity = after.velocity.copy()
        velocity[:, 3:6] -= np.cross(velocity[:, :3], arm)
        before = replace(before, position_m=before.position_m - _arms(record, before))
        after = replace(after, position_m=after.position_m - arm, velocity=velocity)
    reached = moved(tree, before, after.velocity, steps.reported.timestep_s, np.inf)
    off = np.abs(way_between(tree, reached, after)).max(axis=1)
    far = 1.0 + np.abs(np.hstack((after.position_m, after.joints))).max(axis=1)
    return np.asarray(~(off <= MOVED_BY * far))


def _verdicts(steps: Steps, status: Int64, strays: Flags) -> StepVerdicts:
    """Return verdicts: a step is explained if it was replayed exactly and fits the kinematics."""
    n = len(steps)
    why = np.full(n, -1, np.int8)
    if steps.law.tree.size:
        known = np.array([WHYS.index(each) if each != "explained" else -1 for each in REPLAYS])
        why[:] = known[status]
        why[(status == 0) & (strays | ~(steps.unexplained <= EXPLAINED))] = WHYS.index("remainder")
        why[(why >= 0) & stands(steps) & (status < NEVER)] = -1
    kinds = np.full(n, FLIGHT if steps.law.tree.size else SET, np.int8)
    for kind, beginning in SEGMENT_OF:
        for name, term in steps.terms.items():
            if name.startswith(beginning):
                kinds[term.any(axis=1)] = kind
    kinds[stands(steps)] = STILL
    left = np.where(status == 0, steps.unexplained, 0.0)
    return StepVerdicts(kinds, why, left, steps.put)
