"""The steps of one body under constant settings, each as a sum of named impulses."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain import alone
from drop_physics.explain.bodies import Epoch, Record
from drop_physics.explain.chain import Chain, Stretch
from drop_physics.explain.changes import Changes, Transitions, changes_of
from drop_physics.explain.commands import Commanded, Commands
from drop_physics.explain.joined import Acting, Constraints, Poses
from drop_physics.explain.pushed import pushed
from drop_physics.explain.segments import FLIGHT
from drop_physics.explain.times import Times
from drop_physics.explain.touching import Sides, Touching, rows_of
from drop_physics.physics.impulses import Forces, Sum, impulses_of
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.laws.bullet.substeps import HELD, SubstepSum, sum_of_substeps
from drop_physics.physics.laws.bullet.tree import BulletTree, Reason, Reported, all_reported, sum_of
from drop_physics.physics.moving import moved_on
from drop_physics.physics.tree import BASE, States
from drop_physics.physics.vectors import distinct
from drop_physics.trace.calls import Push
from drop_physics.trace.events import Body, order

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Int8 = NDArray[np.int8]
Flags = NDArray[np.bool_]

EXPLAINED = 1e-9
"""A remainder up to this share of the largest term is rounding."""
NEVER, TRIALS = 1 << 30, 8
"""After how many of a step's pushes a call refreshed the poses of links: not at all, or after less
than so many; which calls did is not recorded."""
WITHOUT_SUM: frozenset[Reason] = frozenset(
    ("engine", "substeps", "soft", "maximal", "massless", "planar")
)
"""Where the law has no sum. Elsewhere the sum holds until what the reason names happens."""
SUBSTEPS: Reason = "substeps"


@dataclass(frozen=True, eq=False)
class Around:
    """What was seen of a piece, for one body."""

    record: Record
    chain: Chain
    times: Times
    """Of its simulation."""
    pushes: Sequence[Push]
    commands: Commands
    constraints: Constraints
    touching: Touching
    sides: Sides
    """Its contact points."""
    poses: Poses
    exact: bool
    """Whether the machine rounds each operation once."""


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of one body, or of a batch of equal bodies one after the other.

    Arrays have one row per step, shape (n,) if not said otherwise. All steps have the same law.
    """

    epoch: Epoch
    law: BulletTree
    """As in the epoch, unless the law does not know its joints: then as if they did not move."""
    steps: Int64
    """The samples that they led to."""
    before: States
    after: States
    put: Flags
    """Whether calls had set the state that a step began with."""
    reported: Reported
    """What is known of them; a row of Forces names its step by its row here."""
    sides: Sides
    """The contact points, in the order of `reported.contacts`."""
    terms: Mapping[str, Float64]
    """Impulses by cause [N s, N m s], shape (n, size) each; empty where the law has no sum."""
    remainder: Float64
    """What the terms do not explain, shape (n, size)."""
    largest: Float64
    """The largest entry of any term, or impulse of a single force."""
    unexplained: Float64
    """The largest entry of the remainder over `largest`; infinite where the law has no sum."""
    closes: Flags
    """Whether that is no more than rounding, or than what substeps may leave (`HELD`)."""
    unknown: Flags
    """Where a constraint acts that the law does not cover."""
    alone: Int8 | None
    """What they are by the law of a body without links (`alone`); None of other bodies."""

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)

    @property
    def substeps(self) -> int:
        """How many substeps each step has, at least 1."""
        return self.epoch.substeps

    @property
    def covered(self) -> bool:
        """Whether the law has a sum for these steps."""
        return bool(self.terms)

    @cached_property
    def point_energy_j(self) -> Float64:
        """What each contact point gave of the body's energy: ½ (u' + u)·P, shape (points,)."""
        contacts, tree = self.reported.contacts, self.law.tree
        if not len(contacts) or not tree.size:
            return np.zeros(len(contacts))
        used, rows = distinct(contacts.step)
        kin = kinematics(tree, self.before.at(used))
        timestep_s = self.reported.timestep_s[used]
        impulses = impulses_of(kin, replace(contacts, step=rows), timestep_s)
        mean = 0.5 * (self.before.velocity + self.after.velocity)[contacts.step]
        return np.asarray(np.einsum("ki,ki->k", mean, impulses))


@dataclass(frozen=True, eq=False)
class BodySteps(Steps):
    """Steps of one body."""

    body: Body
    asked: Commanded
    """What calls asked of its joints."""
    changes: Changes
    """How energy and momentum change, by cause."""
    whole: Steps
    """Those of the batch that they are part of."""
    rows: slice
    """Their rows in it."""
    points: slice
    """The rows of their contact points in it."""

    @cached_property
    def point_energy_j(self) -> Float64:
        """What each contact point gave of the body's energy: ½ (u' + u)·P, shape (points,)."""
        return self.whole.point_energy_j[self.points]


@dataclass(frozen=True, eq=False)
class StepBatch:
    """Steps of equal bodies, explained together."""

    whole: Steps
    bodies: list[BodySteps]
    """The steps of each body, in the order of `whole`."""

    @cached_property
    def body(self) -> Int64:
        """The number of the body of each step, shape (n,)."""
        numbers = np.array([each.body.number for each in self.bodies], np.int64)
        return np.repeat(numbers, [len(each) for each in self.bodies])


@dataclass(frozen=True, eq=False)
class RecordedSteps:
    """What was recorded of the steps of one stretch; arrays have one row per step."""

    stretch: Stretch
    around: Around
    law: BulletTree
    chain: Chain
    """The stretch's, without joints that the law does not know."""
    asked: Commanded
    reported: Reported
    """All that is known of the steps but pushes."""
    unknown: Flags
    sides: Sides

    @property
    def pushes(self) -> list[Push]:
        """The pushes of the body in its present life."""
        came = order(self.around.record.came[self.stretch.epoch.life].at)
        return [each for each in self.around.pushes if order(each.at) >= came]

    @property
    def kind(self) -> Hashable:
        """What is equal of stretches that may be one batch; the stretch itself if none may."""
        epoch = self.stretch.epoch
        if self.around.pushes or {*epoch.reasons} & WITHOUT_SUM:
            return id(self)
        body = self.around.record.body
        here = body.client, body.before, self.around.exact, self.reported.geared is None
        constant = epoch.reasons, epoch.cone_friction, epoch.substeps, epoch.damping
        return id(self.law), id(epoch.other), *here, *constant


def recorded_steps(stretch: Stretch, around: Around) -> Iterator[RecordedSteps]:
    """Yield the steps of a stretch in order, those whose substeps are known apart from others."""
    epoch = stretch.epoch
    if {*epoch.reasons} & WITHOUT_SUM != {SUBSTEPS} or not epoch.law.tree.size:
        yield _recorded(stretch, around)
        return
    reasons = tuple(each for each in epoch.reasons if each != SUBSTEPS)
    known = replace(stretch, epoch=replace(epoch, reasons=reasons))
    closes = _closes(_batch([_recorded(known, around)]).whole)
    ends = np.flatnonzero(stretch.chain.stepped[1:]) + 1
    for first, end in pairwise([0, *(np.flatnonzero(np.diff(closes)) + 1).tolist(), len(closes)]):
        begin, last = int(ends[first]) - 1, int(ends[end - 1]) + 1
        chain, part = stretch.chain.at(slice(begin, last)), known if closes[first] else stretch
        yield _recorded(replace(part, chain=chain, first=stretch.first + begin), around)


def _closes(steps: Steps) -> Flags:
    """Return which steps close; what is in flight without links must do so to the bit."""
    if steps.alone is None:
        return steps.closes
    acting = ("applied", "contacts", "rolling", "constraints")
    acts = np.any([steps.terms[name].any(axis=1) for name in acting], axis=0)
    return np.asarray(steps.closes & (acts | (steps.alone == FLIGHT)))


def _recorded(stretch: Stretch, around: Around) -> RecordedSteps:
    """Return what was recorded of the steps of a stretch."""
    chain, law = stretch.chain, stretch.epoch.law
    if "planar" in stretch.epoch.reasons:  # the states are not those of its tree
        chain, law = chain.without_joints(), _still(law)
    where = np.flatnonzero(chain.stepped[1:])
    begins, ends = chain.at(where), chain.at(where + 1)
    asked = around.commands.asked(around.record.body, ends.steps)
    before, substeps = begins.states(law.tree), stretch.epoch.substeps
    found, acting, sides = _reported(around, law, ends, before, asked, substeps)
    return RecordedSteps(stretch, around, law, chain, asked, found, acting.unknown, sides)


def batches_of(recorded: Iterable[RecordedSteps]) -> list[StepBatch]:
    """Return the steps of stretches, those of equal bodies together."""
    groups: dict[Hashable, list[RecordedSteps]] = {}
    for each in recorded:
        groups.setdefault(each.kind, []).append(each)
    return [_batch(group) for group in groups.values()]


def _batch(group: Sequence[RecordedSteps]) -> StepBatch:
    """Return the steps of stretches of equal bodies under equal settings."""
    stretch, around, law = group[0].stretch, group[0].around, group[0].law
    chain = Chain.joined([each.chain for each in group])
    counts = [len(each.chain) for each in group]
    starts = np.cumsum([0, *counts])
    real = chain.stepped[1:].copy()
    real[starts[1:-1] - 1] = False  # from the last state of a body to the first of the next
    where = np.flatnonzero(real)
    steps = [len(each.reported.timestep_s) for each in group]
    firsts = np.cumsum([0, *steps])
    found = all_reported([each.reported for each in group], firsts[:-1].tolist())
    sides = Sides.joined([each.sides for each in group])
    states = chain.states(law.tree)
    before, after = states.at(where), states.at(where + 1)
    rows, added, codes = Transitions(real, found.gravity_m_s2), None, None
    n, size = len(where), law.tree.size
    unexplained, most = np.full(n, np.inf), np.full(n, EXPLAINED)
    without, several = {*stretch.epoch.reasons} & WITHOUT_SUM, stretch.epoch.substeps > 1
    if not size:
        unexplained[_coasts(law, chain.at(where), chain.at(where + 1), found.timestep_s)] = 0.0
    elif not without:
        added, found = _closing(group, rows, states, found)
        unexplained = added.unexplained[real]
        if isinstance(added, SubstepSum):
            most[added.held[real]] = HELD
    if size and not law.tree.links and (without or several) and without <= alone.ALONE:
        if without:
            found = replace(found, applied=_pushed(group[0], rows, np.full(n, NEVER)))
        touches = around.touching.touches(sides, found.contacts)
        codes = alone.explained(stretch.epoch, before, after, found, touches, exact=around.exact)
    whole = Steps(
        epoch=stretch.epoch,
        law=law,
        steps=chain.steps[where + 1],
        before=before,
        after=after,
        put=~chain.sampled[where],
        reported=found,
        sides=sides,
        terms={} if added is None else {name: each[real] for name, each in added.terms.items()},
        remainder=np.zeros((n, size)) if added is None else added.remainder[real],
        largest=np.zeros(n) if added is None else added.largest[real],
        unexplained=unexplained,
        closes=np.asarray(unexplained <= most),
        unknown=np.concatenate([each.unknown for each in group]),
        alone=codes,
    )
    parts = [
        (slice(start, start + count - 1), slice(first, first + made))
        for start, count, first, made in zip(starts, counts, firsts, steps, strict=False)
    ]
    changes = changes_of(law, states, rows, added, parts)
    bodies = [
        _of_body(whole, each, its, change)
        for each, (_, its), change in zip(group, parts, changes, strict=True)
    ]
    return StepBatch(whole, bodies)


def _of_body(whole: Steps, recorded: RecordedSteps, rows: slice, changes: Changes) -> BodySteps:
    """Return the rows of a batch that are the steps of one body."""
    points = slice(*np.searchsorted(whole.reported.contacts.step, (rows.start, rows.stop)))
    reported = replace(recorded.reported, pd=whole.reported.pd[rows])
    if len(whole.reported.applied):  # then it is the only one
        reported = whole.reported
    return BodySteps(
        epoch=recorded.stretch.epoch,
        law=whole.law,
        steps=whole.steps[rows],
        before=whole.before.at(rows),
        after=whole.after.at(rows),
        put=whole.put[rows],
        reported=reported,
        sides=recorded.sides,
        terms={name: each[rows] for name, each in whole.terms.items()},
        remainder=whole.remainder[rows],
        largest=whole.largest[rows],
        unexplained=whole.unexplained[rows],
        closes=whole.closes[rows],
        unknown=recorded.unknown,
        alone=None if whole.alone is None else whole.alone[rows],
        body=recorded.around.record.body,
        asked=recorded.asked,
        changes=changes,
        whole=whole,
        rows=rows,
        points=points,
    )


def _coasts(law: BulletTree, begins: Chain, ends: Chain, timestep_s: Float64) -> Flags:
    """Return in which steps a base that nothing pushes keeps its velocity, and moves with it."""
    free = replace(law.tree, fixed=False)
    before, after = begins.states(free), ends.states(free)
    kept = (before.velocity == after.velocity).all(axis=1)
    return np.asarray(kept & moved_on(free, before, after, timestep_s))


def _reported(
    around: Around,
    law: BulletTree,
    ends: Chain,
    before: States,
    asked: Commanded,
    substeps: int,
) -> tuple[Reported, Acting, Sides]:
    """Return what is known of the steps to samples but for pushes, and the contact points.

    PyBullet divides the last substep's impulse of a motor by the whole timestep.
    """
    tree, body = law.tree, around.record.body
    timestep_s, gravity_m_s2 = around.times.of_steps(ends.steps)
    sides = around.sides
    found, at = rows_of(sides.step, ends.steps)
    if len(found) < len(sides):
        sides = sides.at(found)
    acting = around.constraints.on(body.number, tree, ends.steps, before, timestep_s, around.poses)
    reported = Reported(
        timestep_s=timestep_s,
        gravity_m_s2=gravity_m_s2,
        motors=substeps * asked.motors(tree, ends.effort[:, : tree.joint_rates]),
        commanded=around.commands.torques(body, tree, ends.steps),
        pd=asked.servos(law, before),
        contacts=around.touching.forces(sides, at),
        constraints=acting.forces,
        geared=acting.geared,
    )
    return reported, acting, sides


# -- pushes, whose pose is not known --------------------------------------------------------------


def _pushed(recorded: RecordedSteps, rows: Transitions, refreshed: Int64) -> Forces:
    """Return what pushes do in the steps of a stretch."""
    around, stretch = recorded.around, recorded.stretch
    begins = stretch.first + rows.where
    ends = around.chain.steps[begins + 1]
    return pushed(
        recorded.pushes,
        around.record,
        stretch.epoch.law.tree,
        around.chain,
        begins,
        ends,
        refreshed=refreshed,
    )


def _closing(
    group: Sequence[RecordedSteps], rows: Transitions, states: States, found: Reported
) -> tuple[Sum | SubstepSum, Reported]:
    """Return the sum, with pushes at those poses of links with which each step closes best.

    Of a batch of several bodies none is pushed.
    """
    epoch, law, pushes = group[0].stretch.epoch, group[0].law, group[0].pushes
    ends = np.cumsum([0, *(len(each.reported.timestep_s) for each in group)]).tolist()

    def servos(states: States) -> Float64:
        efforts, begins = np.zeros((len(states), law.tree.joint_rates)), states.at(rows.where)
        efforts[rows.where] = np.concatenate(
            [
                each.asked.servos(law, begins.at(slice(first, end)))
                for each, (first, end) in zip(group, pairwise(ends), strict=True)
            ]
        )
        return efforts

    def added(refreshed: Int64) -> tuple[Sum | SubstepSum, Reported]:
        known = found
        if pushes:
            known = replace(found, applied=_pushed(group[0], rows, refreshed))
        said = _spread(known, rows)
        if epoch.substeps > 1:
            whole = sum_of_substeps(law, states, said, epoch.substeps, servos)
            return whole, replace(known, pd=whole.pd[rows.real])
        return sum_of(law, states, said), known

    refreshed = np.full(len(rows.where), NEVER)
    best, known = added(refreshed)
    off = best.unexplained[rows.real]
    _, counts = np.unique(
        [each.at.step for each in pushes if each.link != BASE], return_counts=True
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
    """Return the same for all transitions of a stretch; one that is no step takes no time."""
    if rows.real.all():
        return reported
    m, where = len(rows.real), rows.where

    def spread(values: Float64) -> Float64:
        out = np.zeros((m, *values.shape[1:]))
        out[where] = values
        return out

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


def _still(law: BulletTree) -> BulletTree:
    """Return a body as if none of its joints moved."""
    nothing = np.empty(0)
    tree = replace(law.tree, joints=tuple("fixed" for _ in law.tree.joints))
    return replace(law, tree=tree, joint_damping=nothing, lower=nothing, upper=nothing)
