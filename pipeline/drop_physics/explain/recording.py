"""Explains every body of a PyBullet recording, chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.bodies import Records, configs_of, records_of, settings_of, substeps_of
from drop_physics.explain.body_history import BodyHistory, history_of
from drop_physics.explain.causes import Totals
from drop_physics.explain.commands import MotorCommands
from drop_physics.explain.joined import Constraints
from drop_physics.explain.step_status import SampleStatus, StepVerdicts, judged
from drop_physics.explain.steps import (
    BodySteps,
    Interval,
    PieceContext,
    StepBatch,
    batches_of,
    intervals_of,
)
from drop_physics.explain.times import StepTimes
from drop_physics.explain.touching import STEPS, Touching, rows_of
from drop_physics.physics.base import EXACT_MACHINES, Law
from drop_physics.physics.columns import rotation
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.laws.lookup import step_law
from drop_physics.physics.step_law import StepLaw
from drop_physics.physics.tree import BASE, States, Tree
from drop_physics.trace.acts import CONSTRAINS, SETS_TIMESTEP, Act
from drop_physics.trace.calls import Call, Push
from drop_physics.trace.events import order
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.log import Log
from drop_physics.trace.states import Rows as StateRows
from drop_physics.trace.states import by_body

Rows = NDArray[np.intp]

MOST_STEPS, NUMBERS = 1 << 12, 1 << 17
"""Maximum number of steps in a chunk, and of steps times degrees of freedom of all bodies: about
100 MB."""
FORCES = ("normal_force_n", "friction_1_n", "friction_2_n")
"""Names of the force columns of a contact point."""
NOBODY = -1
"""Placeholder for the world where a body id is expected."""


@dataclass(frozen=True, eq=False)
class ExplainedPiece:
    """A chunk of a recording, with the explanation of its steps."""

    piece: Piece
    bodies: Mapping[int, SampleStatus]
    """The bodies that have samples in the chunk, by body id."""
    histories: Mapping[int, BodyHistory]
    """The states of the same bodies, starting with the last states of the previous chunk."""
    constraints: Constraints
    """The constraints as defined by calls at the end of the chunk."""
    records: Records
    batches: Sequence[tuple[StepBatch, StepVerdicts]]
    """The steps of `bodies` in batches: equal bodies share a batch."""
    frictions: Mapping[tuple[int, int, int, int], float] | None = None
    """Friction coefficient by ids of two bodies and two links, if the engine has one per pair; None
    if it is the product of both bodies' coefficients."""

    def steps_at(
        self, bodies: Int64, steps: Int64
    ) -> Iterator[tuple[StepBatch, StepVerdicts, Rows, Rows]]:
        """Find the steps that led to given samples of given bodies; both have shape (n,).

        Yields each batch with any of these steps, the batch's verdicts, the indices of the samples
        in the arguments, and the rows of the steps in the batch.
        """
        keys = bodies * STEPS + steps
        for (batch, verdict), places in zip(self.batches, self._places, strict=True):
            at = np.minimum(np.searchsorted(places, keys), len(places) - 1)
            its = np.flatnonzero(places[at] == keys) if len(places) else at[:0]
            if len(its):
                yield batch, verdict, its, at[its]

    def placed(
        self, number: int, link: int, samples: Int64, *, after: bool = True
    ) -> tuple[Float64, Float64]:
        """Return a link's position and axes at samples [m]; shapes (n, 3) and (n, 3, 3).

        Without `after`, they are those at the start of the steps that lead to the samples. A body
        that no step moves stays where calls have set it; unknown values are nan.
        """
        place_m, axes = np.full((len(samples), 3), np.nan), np.full((len(samples), 3, 3), np.nan)
        if number not in self.bodies and link == BASE:
            base = self.records[number].base_at(samples)
            place_m, axes = base[:, :3], np.moveaxis(rotation(base[:, 3:7].T), -1, 0)
        for steps in self.bodies[number].intervals if number in self.bodies else ():
            _, rows, its = np.intersect1d(steps.steps, samples, return_indices=True)
            if len(rows) and link < steps.law.tree.links:
                states = steps.after if after else steps.before
                kin = kinematics(steps.law.tree, states.at(rows))
                place_m[its], axes[its] = kin.position_m(link), kin.matrix(link)
        return place_m, axes

    @cached_property
    def _places(self) -> list[Int64]:
        """Sorted keys, body × STEPS + step, of the rows of each batch."""
        return [batch.body * STEPS + batch.whole.steps for batch, _ in self.batches]


class Explanation:
    """Explains a recording from states and reported forces; `totals` grow chunk by chunk.

    A property that was set before the recording began and that the engine does not report is
    assumed to have its default; if this does not explain a step, the reason says so. `other` is the
    law of a single body in flight, for a drop in another engine than PyBullet.
    """

    frictions: Mapping[tuple[int, int, int, int], float] | None = None

    def __init__(self, seen: Seen, other: Law | None = None) -> None:
        self.seen, self.records = seen, records_of(seen)
        self._settings = settings_of(seen)
        self.times = {client: StepTimes(seen, client) for client in self._settings}
        self._law = step_law(seen.engine)
        self._configs = configs_of(self.records, self._settings, other, self._law)
        self._soft = {body.client for body in seen.bodies.values() if body.soft}
        self._constraints = Constraints(self._law)
        self._commands = MotorCommands(seen)
        self._pushes: dict[int, list[Push]] = {}
        self._lasts: dict[int, BodyHistory] = {}
        self.totals: dict[int, Totals] = {}
        """Energy, momentum and counts of each body so far, by body id."""

    def pieces(self, steps: int = 0) -> Iterator[ExplainedPiece]:
        """Yield each chunk with its explanation; `steps` sets the length of chunks unless 0."""
        substeps = max((substeps_of(each.values) for each in self.seen.settings), default=1)
        steps = steps or self.seen.piece_steps(MOST_STEPS, NUMBERS // substeps)
        # Unlike a loop variable, `map` does not keep a piece in memory while the next is read.
        yield from map(self._explained, self.seen.pieces(steps))

    def _explained(self, piece: Piece) -> ExplainedPiece:
        piece = self.prepared(piece)
        histories = self._histories(piece)
        touching = Touching(piece.contacts, self.records, histories)
        intervals = [
            interval
            for number, (history, first) in histories.items()
            for interval in intervals_of(
                self.records[number],
                history,
                first,
                self._configs[number],
                self._pushes.get(number, ()),
            )
        ]
        batches = self.batches(piece, intervals, touching, histories)
        found: dict[int, list[tuple[BodySteps, StepVerdicts]]] = {
            number: [] for number in histories
        }
        for batch, verdict in batches:
            for steps in batch.bodies:
                found[steps.body.number].append((steps, verdict))
        bodies: dict[int, SampleStatus] = {}
        for number, (history, first) in histories.items():
            sampled = history.steps[first:][history.sampled[first:]]
            its = sorted(found[number], key=lambda each: int(each[0].steps[0]))
            bodies[number] = judged(self.records[number].body, sampled, its)
            self.totals.setdefault(number, Totals(bodies[number].body)).add(bodies[number])
            self._lasts[number] = history.at(np.arange(len(history))[-2:])  # a copy
        held = {number: history for number, (history, _) in histories.items()}
        return ExplainedPiece(
            piece, bodies, held, self._constraints, self.records, batches, self.frictions
        )

    def prepared(self, piece: Piece) -> Piece:
        """Process the calls of a chunk; return it with contact forces corrected for substeps."""
        self._pushes = self._take_calls(piece)
        return replace(piece, contacts=self._in_substeps(piece.contacts))

    def batches(
        self,
        piece: Piece,  # noqa: ARG002 - some need it
        intervals: Sequence[Interval],
        touching: Touching,
        histories: Mapping[int, tuple[BodyHistory, int]],
    ) -> list[tuple[StepBatch, StepVerdicts]]:
        """Explain the steps of a chunk; bodies of equal structure share a batch."""
        assert self._law is not None  # other engines are explained by `Replayed`
        around = PieceContext(
            law=self._law,
            times=self.times,
            commands=self._commands,
            constraints=self._constraints,
            touching=touching,
            poses=lambda body, ends: self._poses(histories, body, ends),
            exact=self.seen.machine in ("", *EXACT_MACHINES),
        )
        return [(batch, self._verdict(batch, self._law)) for batch in batches_of(intervals, around)]

    def _verdict(self, batch: StepBatch, law: StepLaw) -> StepVerdicts:
        """Return which steps of a batch are explained, and why the others are not."""
        body = batch.bodies[0].body
        soft = any(each.body.client in self._soft for each in batch.bodies)
        return StepVerdicts.of(batch.whole, law, before=body.before, soft_there=soft)

    def _in_substeps(self, contacts: StateRows) -> StateRows:
        """Return contact points with the true forces of each step's last substep.

        PyBullet divides the impulses of the last of several substeps by the whole timestep.
        """
        for client, settings in self._settings.items():
            changed = [each.at.step for each in settings]
            substeps = np.array([substeps_of(each.values) for each in settings])
            if (substeps == 1).all():
                continue
            here = [n for n, body in self.seen.bodies.items() if body.client == client]
            rows = np.flatnonzero(np.isin(contacts["body_a"], here))
            at = np.searchsorted(changed, contacts["step"][rows] - 1, side="right") - 1
            contacts = contacts.copy()
            for name in FORCES:
                contacts[name][rows] *= substeps[np.maximum(at, 0)]
        return contacts

    def _histories(self, piece: Piece) -> dict[int, tuple[BodyHistory, int]]:
        """Return each body's states, and how many of them belong to the previous chunk."""
        bases, found = by_body(piece.bases), {}
        for number, record in self.records.items():
            last = self._lasts.get(number)
            history = history_of(record, bases.get(number), piece.joints.get(number), last)
            if history is not None:
                found[number] = history, 0 if last is None else len(last)
        return found

    def _poses(
        self, histories: Mapping[int, tuple[BodyHistory, int]], number: int, ends: Int64
    ) -> tuple[Tree, States]:
        """Return a body as a tree of links, with its states before the steps to `ends`."""
        record = self.records[number]
        _, config = next(self._configs[number].of(ends[:1] - 1))
        tree = config.law.tree
        if number not in histories:
            history = BodyHistory.of_base(record.base_at(ends), ends)
        else:
            history, _ = histories[number]
            sampled = np.flatnonzero(history.sampled)
            _, rows = rows_of(ends, history.steps[sampled])
            history = history.at(np.maximum(sampled[rows] - 1, 0))
        return tree, history.states(tree)

    # -- calls ------------------------------------------------------------------------------------

    def _take_calls(self, piece: Piece) -> dict[int, list[Push]]:
        """Process the calls of a chunk; return the forces that they apply, by body."""
        pushes = {
            number: [each for each in held if each.at.step + 1 >= piece.first]
            for number, held in self._pushes.items()
        }
        for given in piece.calls.given():
            if given.body.number in self.records:
                self.records[given.body.number].give(given)
        for push in piece.calls.pushes():
            pushes.setdefault(push.body.number, []).append(push)
        self._commands.take(piece)
        self._constraints.begin(piece.forces)
        for call in piece.calls.of(*SETS_TIMESTEP, *CONSTRAINS):
            self._join(call, piece.calls)
        return pushes

    def _join(self, call: Call, calls: Log) -> None:
        """Process a call that creates or changes a constraint, or sets the timestep."""
        if call.act in SETS_TIMESTEP:
            self._constraints.set_timestep(call)
        elif call.act is Act.CHANGE_CONSTRAINT:
            self._constraints.change(call)
        elif np.isfinite(call.result):
            ids = [
                int(call.values.get(f"{role}BodyUniqueId", (-1,))[0])
                for role in ("parent", "child")
            ]
            held = [None if each < 0 else calls.body_at(call, each) for each in ids]
            moments = [call.at, *(each.at for each in held if each is not None)]
            first, second = (NOBODY if each is None else each.body.number for each in held)
            self._constraints.create(call, max(moments, key=order), (first, second))
