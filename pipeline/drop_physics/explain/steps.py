"""The steps of one body while its settings are constant, each as a sum of named impulses."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from drop_physics.arrays import Flags, Float64, Int8, Int64
from drop_physics.explain import alone
from drop_physics.explain.bodies import BodyConfig, BodyConfigs, Record
from drop_physics.explain.body_history import BodyHistory
from drop_physics.explain.changes import Changes, Transitions, changes_of
from drop_physics.explain.commands import Commanded, MotorCommands
from drop_physics.explain.joined import ConstraintEffect, Constraints, Poses, Pull
from drop_physics.explain.pushed import pushed
from drop_physics.explain.segments import FLIGHT
from drop_physics.explain.times import StepTimes
from drop_physics.explain.touching import Sides, Touching
from drop_physics.physics.impulses import EXPLAINED, Forces, Summed, impulses_of, per_step
from drop_physics.physics.kinematics import Kinematics, kinematics
from drop_physics.physics.moving import moved_on
from drop_physics.physics.step_law import DampedTree, Reason, Reported, StepLaw
from drop_physics.physics.tree import BASE, States, Tree
from drop_physics.physics.vectors import distinct
from drop_physics.trace.calls import Push
from drop_physics.trace.events import Body, order

NEVER, TRIALS = 1 << 30, 8
"""The number of pushes in a step before the link poses were refreshed, which is not recorded:
either NEVER, or one of fewer than TRIALS values is used, whichever explains the step best."""
WITHOUT_SUM: frozenset[Reason] = frozenset(
    ("engine", "substeps", "soft", "maximal", "massless", "planar")
)
"""Reasons for which there is no sum. With other reasons, the sum is valid in steps in which they do
not apply."""
SUBSTEPS: Reason = "substeps"


@dataclass(frozen=True, eq=False)
class PieceContext:
    """Data that the explanations of all bodies in a chunk share."""

    law: StepLaw
    """The law of the engine that stepped the bodies."""
    times: Mapping[int, StepTimes]
    """Times of each client's steps."""
    commands: MotorCommands
    constraints: Constraints
    touching: Touching
    poses: Poses
    exact: bool
    """Whether the machine rounds each operation once."""


@dataclass(frozen=True, eq=False)
class Interval:
    """Consecutive states of one body while its settings are constant, starting with a step."""

    record: Record
    whole: BodyHistory
    """All states of the body in the chunk."""
    first: int
    end: int
    """The interval consists of the states from `first` to before `end` of `whole`."""
    config: BodyConfig
    pushes: Sequence[Push] = ()
    """All pushes on the body in the chunk."""

    @property
    def states(self) -> BodyHistory:
        """The states of the interval."""
        return self.whole.at(slice(self.first, self.end))

    def kind(self, around: PieceContext) -> Hashable:
        """Return a key that is equal for intervals that can be explained in one batch."""
        config, body = self.config, self.record.body
        if self.pushes or {*config.reasons} & WITHOUT_SUM:
            return id(self)
        here = body.client, body.before, around.constraints.gears(body.number)
        constant = config.reasons, config.cone_friction, config.substeps, config.damping
        return id(config.law), id(config.other), *here, *constant


def intervals_of(
    record: Record,
    history: BodyHistory,
    first: int,
    configs: BodyConfigs,
    pushes: Sequence[Push] = (),
) -> Iterator[Interval]:
    """Yield a body's intervals whose steps end at state `first` or later."""
    ends = np.flatnonzero(history.stepped)
    ends = ends[ends >= first]
    for rows, config in configs.of(history.steps[ends] - 1):
        begin, end = int(ends[rows][0]) - 1, int(ends[rows][-1]) + 1
        yield Interval(record, history, begin, end, config, pushes)


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of a body, or of several equal bodies one after the other, as sums of impulses.

    Arrays have one row per step, shape (n,) unless noted. The same law applies to all steps.
    """

    config: BodyConfig
    law: DampedTree
    """The body's tree and damping, with all joints fixed if the law does not support them."""
    steps: Int64
    """The sample after each step."""
    before: States
    after: States
    put: Flags
    """Whether calls had set the initial state of a step."""
    asked: Commanded
    """The motor commands in effect."""
    reported: Reported
    """Forces reported by the engine; `step` in `Forces` is the row of the step in this object."""
    sides: Sides
    """The contact points, in the order of `reported.contacts`."""
    terms: Mapping[str, Float64]
    """Impulses by cause [N s, N m s], shape (n, size) each; empty if the law has no sum."""
    remainder: Float64
    """The part of the change that no term explains, shape (n, size)."""
    largest: Float64
    """The largest entry of any term, or a single force's largest impulse if that is larger, as a
    scale."""
    unexplained: Float64
    """Ratio of the largest entry of the remainder to `largest`; infinite if the law has no sum."""
    closes: Flags
    """Whether `unexplained` is within rounding, or within the possible error by substeps."""
    unknown: Flags
    """Whether a constraint acts that the law does not support."""
    alone: Int8 | None
    """Segments by the single-body law (`alone.explained`); None for other bodies."""
    pulls: Mapping[Pull, Float64] = field(default_factory=dict)
    """The constraints' impulses, by the body or equality that exerts them, shape (n, size) each, if
    known separately."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)

    @property
    def substeps(self) -> int:
        """The number of substeps of each step, at least 1."""
        return self.config.substeps

    @property
    def covered(self) -> bool:
        """Whether the law has a sum for these steps."""
        return bool(self.terms)

    @cached_property
    def point_impulses(self) -> Float64:
        """The generalised impulse of each contact point [N s, N m s], shape (points, size)."""
        return self._impulses_at_points(self.reported.contacts)

    @cached_property
    def point_normal_impulses(self) -> Float64:
        """The same impulses without friction, shape (points, size)."""
        contacts, normal = self.reported.contacts, self.sides.normal
        along = np.einsum("ki,ki->k", contacts.force_n, normal)[:, None] * normal
        still = np.zeros_like(contacts.torque_n_m)
        return self._impulses_at_points(replace(contacts, force_n=along, torque_n_m=still))

    @cached_property
    def point_energy_j(self) -> Float64:
        """The energy that each contact point gave to the body: ½ (u' + u)·P, shape (points,)."""
        mean = 0.5 * (self.before.velocity + self.after.velocity)[self.reported.contacts.step]
        return np.asarray(np.einsum("ki,ki->k", mean, self.point_impulses))

    @cached_property
    def contact_j(self) -> Float64:
        """The energy that all contact points together gave to the body in each step."""
        step = self.reported.contacts.step
        return np.bincount(step, self.point_energy_j, minlength=len(self)).astype(np.float64)

    @cached_property
    def _touched(self) -> tuple[Kinematics, Int64, Int64]:
        """Poses before the steps with contacts, these steps, and the index of each point's."""
        used, rows = distinct(self.reported.contacts.step)
        return kinematics(self.law.tree, self.before.at(used)), used, rows

    def _impulses_at_points(self, forces: Forces) -> Float64:
        """Return the generalised impulses of forces at the contact points, (points, size)."""
        if not len(forces) or not self.law.tree.size:
            return np.zeros((len(forces), self.law.tree.size))
        kin, used, rows = self._touched
        return impulses_of(kin, replace(forces, step=rows), self.reported.timestep_s[used])


class BodyColumn:
    """An array of `BodySteps`: a body's rows of the batch's array, cut out when first read.

    With `of_points`, the rows are those of its contact points.
    """

    def __init__(self, name: str, *, of_points: bool = False) -> None:
        self._name, self._of_points = name, of_points

    def __get__(self, steps: BodySteps, _: type[BodySteps]) -> object:
        column = getattr(steps.whole, self._name)
        cut = column[steps.points] if self._of_points else steps.cut(column)
        vars(steps)[self._name] = cut
        return cut


class BodySteps(Steps):
    """The steps of one body, as rows of its batch."""

    def __init__(
        self, whole: Steps, rows: slice, config: BodyConfig, body: Body, changes: Changes
    ) -> None:
        points = np.searchsorted(whole.reported.contacts.step, (rows.start, rows.stop))
        vars(self).update(
            config=config, body=body, changes=changes, whole=whole, rows=rows, points=slice(*points)
        )

    body: Body
    changes: Changes
    """Changes of energy and momentum, by cause."""
    whole: Steps
    """The steps of the whole batch."""
    rows: slice
    """The rows of these steps in the batch."""
    points: slice
    """The rows of their contact points in the batch."""

    def cut(self, column: Any) -> Any:  # noqa: ANN401
        """Return this body's rows of an array of the batch."""
        if isinstance(column, Mapping):
            return {name: each[self.rows] for name, each in column.items()}
        if isinstance(column, Sides):
            return column.at(self.points)
        if isinstance(column, np.ndarray):
            return column[self.rows]
        return column.at(self.rows) if hasattr(column, "at") else column

    def __len__(self) -> int:
        """Return the number of steps."""
        return int(self.rows.stop - self.rows.start)


for _column in (*(each.name for each in fields(Steps)), "contact_j"):
    setattr(BodySteps, _column, BodyColumn(_column))
for _column in ("point_impulses", "point_normal_impulses", "point_energy_j"):
    setattr(BodySteps, _column, BodyColumn(_column, of_points=True))


@dataclass(frozen=True, eq=False)
class StepBatch:
    """Steps of equal bodies, explained together."""

    whole: Steps
    bodies: list[BodySteps]
    """The steps of each body, in the order of the rows of `whole`."""

    @cached_property
    def body(self) -> Int64:
        """The body id of each step, shape (n,)."""
        numbers = np.array([each.body.number for each in self.bodies], np.int64)
        return np.repeat(numbers, [len(each) for each in self.bodies])


def columns_of(added: Summed | None, real: Flags, size: int) -> dict[str, Any]:
    """Return the arrays of `Steps` that follow from a sum; zeros if the law has no sum."""
    if added is None:
        n = np.count_nonzero(real)
        return {"terms": {}, "remainder": np.zeros((n, size)), "largest": np.zeros(n)}
    terms = {name: term[real] for name, term in added.terms.items()}
    return {"terms": terms, "remainder": added.remainder[real], "largest": added.largest[real]}


def batches_of(intervals: Iterable[Interval], around: PieceContext) -> list[StepBatch]:
    """Explain the steps of intervals; intervals of equal bodies share a batch."""
    groups: dict[Hashable, list[Interval]] = {}
    kept = [part for interval in intervals for part in _known_apart(interval, around)]
    for each in kept:
        groups.setdefault(each.kind(around), []).append(each)
    return [_batch(group, around) for group in groups.values()]


def _known_apart(interval: Interval, around: PieceContext) -> Iterator[Interval]:
    """Split an interval into runs of steps that a sum explains despite substeps, and other runs."""
    config = interval.config
    if {*config.reasons} & WITHOUT_SUM != {SUBSTEPS} or not config.law.tree.size:
        yield interval
        return
    reasons = tuple(reason for reason in config.reasons if reason != SUBSTEPS)
    known = replace(interval, config=replace(config, reasons=reasons))
    closes = _closes(_batch([known], around).whole)
    ends = interval.first + np.flatnonzero(interval.states.stepped[1:]) + 1
    for first, end in pairwise([0, *(np.flatnonzero(np.diff(closes)) + 1).tolist(), len(closes)]):
        part = known if closes[first] else interval
        yield replace(part, first=int(ends[first]) - 1, end=int(ends[end - 1]) + 1)


def _closes(steps: Steps) -> Flags:
    """Flag the steps whose impulses add up; a flying single body must match bitwise."""
    if steps.alone is None:
        return steps.closes
    acting = ("applied", "contacts", "rolling", "constraints")
    acts = np.any([steps.terms[name].any(axis=1) for name in acting], axis=0)
    return np.asarray(steps.closes & (acts | (steps.alone == FLIGHT)))


def _batch(group: Sequence[Interval], around: PieceContext) -> StepBatch:
    """Explain the steps of equal bodies under equal settings together."""
    config, law = group[0].config, group[0].config.law
    parts, bodies = [each.states for each in group], [each.record.body for each in group]
    if "planar" in config.reasons:  # the states are not those of its tree
        parts, law = [part.without_joints() for part in parts], _still(law)
    history = BodyHistory.joined(parts)
    starts = np.cumsum([0, *map(len, parts)])
    real = history.stepped[1:].copy()
    real[starts[1:-1] - 1] = False  # from the last state of a body to the first of the next
    where = np.flatnonzero(real)
    bounds = np.searchsorted(where, starts).tolist()
    its = [slice(first, end) for first, end in pairwise(bounds)]
    tree, states, ends = law.tree, history.states(law.tree), history.steps[where + 1]
    before, after = states.at(where), states.at(where + 1)
    timestep_s, gravity_m_s2 = around.times[bodies[0].client].of_steps(ends)
    asked = Commanded.joined(
        [around.commands.asked(body, ends[rows]) for body, rows in zip(bodies, its, strict=True)]
    )
    sides, points_at = around.touching.of(
        [body.number for body in bodies], np.repeat(np.arange(len(group)), np.diff(bounds)), ends
    )
    acting = [
        around.constraints.on(
            body.number, tree, ends[rows], before.at(rows), timestep_s[rows], around.poses
        )
        for body, rows in zip(bodies, its, strict=True)
    ]
    found = Reported(
        timestep_s=timestep_s,
        gravity_m_s2=gravity_m_s2,
        # PyBullet divides the last substep's impulse of a motor by the whole timestep.
        motors=config.substeps
        * asked.motors(tree, history.effort[where + 1][:, : tree.joint_rates]),
        commanded=np.concatenate(
            [
                around.commands.torques(body, tree, ends[rows])
                for body, rows in zip(bodies, its, strict=True)
            ]
        ),
        pd=asked.servos(law, before),
        contacts=around.touching.forces(sides, points_at),
        constraints=Forces.joined(
            [
                replace(each.forces, step=each.forces.step + rows.start)
                for each, rows in zip(acting, its, strict=True)
            ]
        ),
        geared=np.concatenate(
            [
                np.zeros((len(each.unknown), tree.joint_rates))
                if each.geared is None
                else each.geared
                for each in acting
            ]
        )
        if any(each.geared is not None for each in acting)
        else None,
    )
    rows, added, codes = Transitions(real, gravity_m_s2), None, None
    n, size = len(where), tree.size
    unexplained, allowed = np.full(n, np.inf), np.full(n, EXPLAINED)
    without, several = {*config.reasons} & WITHOUT_SUM, config.substeps > 1
    if not size:
        coasts = _coasts(
            law.tree,
            history.at(where),
            history.at(where + 1),
            timestep_s,
            around.law.most_turn_rad,
        )
        unexplained[coasts] = 0.0
    elif not without:
        added, found = _closing(around.law, group[0], law, asked, rows, states, found)
        unexplained, allowed = added.unexplained[real], added.allowed[real]
    if size and not tree.links and (without or several) and without <= alone.ALONE:
        if without:
            found = replace(found, applied=_pushed(group[0], rows, np.full(n, NEVER)))
        touches = around.touching.touches(sides, found.contacts)
        codes = alone.explained(config, before, after, found, touches, exact=around.exact)
    whole = Steps(
        config=config,
        law=law,
        steps=ends,
        before=before,
        after=after,
        put=~history.sampled[where],
        asked=asked,
        reported=found,
        sides=sides,
        **columns_of(added, real, size),
        unexplained=unexplained,
        closes=np.asarray(unexplained <= allowed),
        unknown=np.concatenate([each.unknown for each in acting]),
        alone=codes,
        pulls=_pulls(acting, its, tree, before, timestep_s),
    )
    ways = [slice(first, end - 1) for first, end in pairwise(starts.tolist())]
    changes = changes_of(law, states, rows, added, [*zip(ways, its, strict=True)])
    return StepBatch(
        whole,
        [
            BodySteps(whole, rows, each.config, each.record.body, change)
            for each, rows, change in zip(group, its, changes, strict=True)
        ],
    )


def _pulls(
    acting: Sequence[ConstraintEffect],
    its: Sequence[slice],
    tree: Tree,
    before: States,
    timestep_s: Float64,
) -> dict[Pull, Float64]:
    """Return the impulses of constraints, by the body or equality that exerts them."""
    found: dict[Pull, Float64] = {}
    for effect, rows in zip(acting, its, strict=True):
        for pull, forces in effect.by_partner.items():
            n = rows.stop - rows.start
            impulses = impulses_of(kinematics(tree, before.at(rows)), forces, timestep_s[rows])
            held = found.setdefault(pull, np.zeros((len(timestep_s), tree.size)))
            held[rows] += per_step(forces, impulses, steps=n)
    return found


def _coasts(
    tree: Tree, begins: BodyHistory, ends: BodyHistory, timestep_s: Float64, most_turn_rad: float
) -> Flags:
    """Flag the steps in which a massless base keeps the velocity that a call gave it."""
    free = replace(tree, fixed=False)
    before, after = begins.states(free), ends.states(free)
    kept = (before.velocity == after.velocity).all(axis=1)
    return np.asarray(kept & moved_on(free, before, after, timestep_s, most_turn_rad))


# -- pushes of links, whose pose is not recorded --------------------------------------------------


def _pushes(interval: Interval) -> list[Push]:
    """Return the forces that calls applied since this interval's body was created."""
    came = order(interval.record.came[interval.config.life].at)
    return [push for push in interval.pushes if order(push.at) >= came]


def _pushed(interval: Interval, rows: Transitions, refreshed: Int64) -> Forces:
    """Return the forces that calls applied in an interval's steps."""
    begins = interval.first + rows.where
    return pushed(
        _pushes(interval),
        interval.record,
        interval.config.law.tree,
        interval.whole,
        begins,
        interval.whole.steps[begins + 1],
        refreshed=refreshed,
    )


def _closing(
    step_law: StepLaw,
    one: Interval,
    law: DampedTree,
    asked: Commanded,
    rows: Transitions,
    states: States,
    found: Reported,
) -> tuple[Summed, Reported]:
    """Return the sum, with applied forces acting at the link poses that fit best in each step.

    `one` is the first interval of the batch, and the only one if forces are applied to the body.
    """
    config, pushes = one.config, _pushes(one)

    def servos(states: States) -> Float64:
        return rows.spread(asked.servos(law, states.at(rows.where)))

    def added(refreshed: Int64) -> tuple[Summed, Reported]:
        known = found
        if pushes:
            known = replace(found, applied=_pushed(one, rows, refreshed))
        whole, pd = step_law.sum_of(law, states, _spread(known, rows), config.substeps, servos)
        return whole, replace(known, pd=pd[rows.real])

    refreshed = np.full(len(rows.where), NEVER)
    best, known = added(refreshed)
    off = best.unexplained[rows.real]
    _, counts = np.unique(
        [push.at.step for push in pushes if push.link != BASE], return_counts=True
    )
    for trial in range(min(int(counts.max(initial=0)), TRIALS)):
        if not (off > EXPLAINED).any():
            break
        tried, _ = added(np.where(off > EXPLAINED, trial, refreshed))
        better = tried.unexplained[rows.real] < off
        refreshed[better] = trial
        off = np.minimum(off, tried.unexplained[rows.real])
        best, known = added(refreshed)
    return best, known


def _spread(reported: Reported, rows: Transitions) -> Reported:
    """Copy reported forces of steps to all transitions; a change by a call takes no time."""
    if rows.real.all():
        return reported
    where, spread = rows.where, rows.spread

    def moved(forces: Forces) -> Forces:
        return replace(forces, step=where[forces.step])

    return Reported(
        timestep_s=spread(reported.timestep_s),
        gravity_m_s2=rows.gravity_then,
        motors=spread(reported.motors),
        commanded=spread(reported.commanded),
        pd=spread(reported.pd),
        applied=moved(reported.applied),
        contacts=moved(reported.contacts),
        constraints=moved(reported.constraints),
        geared=None if reported.geared is None else spread(reported.geared),
    )


def _still(law: DampedTree) -> DampedTree:
    """Return a copy of a tree with all joints fixed."""
    nothing = np.empty(0)
    tree = replace(law.tree, joints=tuple("fixed" for _ in law.tree.joints))
    return replace(law, tree=tree, joint_damping=nothing, lower=nothing, upper=nothing)
