"""The tables of a chunk that rules read: joints, actuators, constraints, contacts and bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import Any, Literal, Protocol, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int8, Int64
from drop_physics.explain.bodies import Record
from drop_physics.explain.driving import control_of
from drop_physics.explain.joints import JointTelemetry, target_of
from drop_physics.explain.step_status import StepVerdicts
from drop_physics.explain.steps import BodySteps, StepBatch, Steps
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.rules.answer import Scene
from drop_physics.rules.chunk import Column, StepChunk
from drop_physics.rules.earlier import EarlierRows
from drop_physics.rules.joint import AT_TARGET, units_of
from drop_physics.trace.events import Joint
from drop_physics.trace.motors import POSITION

Rows = NDArray[np.intp]
Value = TypeVar("Value", bound=np.generic)

TableName = Literal[
    "inputs",
    "account",
    "joints",
    "targets",
    "actuators",
    "pairs",
    "sides",
    "bodies",
]
TABLES: tuple[TableName, ...] = get_args(TableName)
"""The names of tables; the first two cover the whole run: the calls, and the account."""


class RuleTable(Protocol):
    """A table of n rows for rules, with named columns."""

    @property
    def keys(self) -> Int64:
        """The body ids of each row, shape (n, k)."""

    @property
    def step(self) -> Int64:
        """The sample after each row's step, shape (n,)."""

    @property
    def noted(self) -> Mapping[str, Float64]:
        """Columns whose values every rule records for its worst match."""


def tables(name: TableName, scene: Scene, earlier: EarlierRows) -> Iterator[RuleTable]:
    """Yield the tables of one kind for the latest chunk."""
    chunk = scene.chunk
    touching = len(chunk.pairs.starts) > 0
    if name == "joints":
        yield from (JointColumns(chunk, each, earlier) for each in chunk.driven)
    elif name == "actuators":
        yield from (
            ActuatorColumns(chunk, each, earlier)
            for _, each in chunk.intervals()
            if each.body.actuators
        )
    elif name == "targets":
        for driven in chunk.driven:
            yield from scene.standing.see(driven, scene.seen, scene.telemetry)
    elif name == "bodies":
        yield from (
            BodyColumns(chunk, *batch, scene.records, earlier)
            for batch in chunk.batches
            if len(batch[0].whole)
        )
    elif name == "sides" and touching:
        yield from (PairColumns(chunk, side) for side in (0, 1))
    elif touching:
        pair = PairColumns(chunk, 1)
        # Of two, one that can move is told of.
        still = ~np.isin(pair.body, scene.seen.moving)
        pair.keys[still] = pair.keys[still, ::-1]
        yield pair


class JointColumns:
    """The joints of a body over n steps; columns (n, joint_rates).

    The columns are those of `driven`, those of `asked` (the requests of calls), and some that rules
    share.
    """

    def __init__(self, chunk: StepChunk, driven: JointTelemetry, earlier: EarlierRows) -> None:
        self._chunk, self.driven, self.asked, self.earlier = chunk, driven, driven.asked, earlier
        self._settings = chunk.settings(driven.body.client)
        self.body, self.steps = driven.body, driven.steps
        self.before, self.after, self.rate = driven.before, driven.after, driven.rate
        self.torque, self.limit, self.at_limit = driven.torque, driven.limit, driven.at_limit
        self.resting, self.mode = driven.resting, self.asked.mode
        self.target_velocity = self.asked.target_velocity
        law, shape = driven.steps.law, driven.asked.target.shape
        self.step, self.noted = driven.steps.steps, {"site": self.asked.site}
        self.keys = np.full((shape[0], 1), driven.body.number)
        self.lower, self.upper = (np.broadcast_to(each, shape) for each in (law.lower, law.upper))
        self.target = target_of(driven)
        """The commanded position; nan where there is none."""
        self.rate_before = driven.steps.before.velocity[:, driven.steps.law.tree.first_rate :]
        pd = self.asked.pd == 1
        self.motor = (self.asked.force > 0) & ~pd
        """Whether a call enabled a motor that may exert force."""
        self.position_motor = (self.asked.mode == POSITION) & (self.asked.impulse > 0) & ~pd
        self.at_target = np.array([AT_TARGET[units_of(driven, k)[0]] for k in range(shape[1])])
        """Gap below which each joint counts as at its target, shape (joint_rates,)."""

    def setting(self, name: str, default: float) -> float:
        """Return a scalar setting of the engine."""
        return float(np.ravel(self._settings.get(name, default))[0])

    def of_joints(self, number: Callable[[Joint], float]) -> Float64:
        """Expand one number per joint to a column for all steps."""
        body = self.driven.body
        values = np.empty(self.asked.target.shape[1])
        for joint, place in zip(body.joints, body.rates, strict=True):
            values[place] = number(joint)
        return np.broadcast_to(values, self.asked.target.shape)

    @cached_property
    def inertia(self) -> Float64:
        """The inertia that each joint moves in the last step, all others at rest [kg m², kg]."""
        steps = self.driven.steps
        (matrix,) = mass_matrix(kinematics(steps.law.tree, steps.before.at(np.array([-1]))))
        return np.broadcast_to(np.diag(matrix)[steps.law.tree.first_rate :], self.target.shape)

    def latest(
        self, kept: dict[int, Float64], events: Flags, values: Float64
    ) -> tuple[Float64, Float64]:
        """Return values at the latest event up to each row, and up to the row before.

        All arrays have the shape (n, joint_rates); nan before the first event. `kept` has the last
        row of earlier chunks.
        """
        number = self.driven.body.number
        before = kept.get(number, np.full(values.shape[1], np.nan))
        rows = np.where(events, np.arange(len(values))[:, None], -1)
        rows = np.maximum.accumulate(rows, axis=0)
        found = np.where(rows < 0, before, np.take_along_axis(values, rows.clip(0), axis=0))
        kept[number] = found[-1]
        return found, np.vstack([before, found[:-1]])

    def came(self, column: Column) -> Float64:
        """Return a quantity of the body's states one step earlier; nan if there is none."""
        return self._chunk.came(self.steps, [(0, self.steps)], column)

    def term(self, name: str) -> Float64:
        """Return the impulses of a cause on the joints [N s, N m s]; 0 if it does not act."""
        steps = self.driven.steps
        found = steps.terms.get(name, np.zeros((len(steps), steps.law.tree.size)))
        return found[:, steps.law.tree.first_rate :]


class ActuatorColumns:
    """The actuators of a body over n steps; columns (n, actuators)."""

    def __init__(self, chunk: StepChunk, steps: BodySteps, earlier: EarlierRows) -> None:
        self.earlier, self.client, self.number = earlier, steps.body.client, steps.body.number
        self.body, self.actuators, self.step = steps.body, steps.body.actuators, steps.steps
        self.noted: dict[str, Float64] = {}
        self.keys = np.full((len(steps), 1), steps.body.number)
        self.given = np.column_stack(
            [
                control_of(actuator, steps.body, chunk.piece, steps.steps)
                for actuator in self.actuators
            ]
        )
        """The control of each actuator before clamping; nan if unknown."""
        last = earlier.controls.get(self.number, np.zeros(len(self.actuators)))
        self.before = np.vstack([last, self.given[:-1]])
        """The control in the previous step; 0 before the first."""
        earlier.controls[self.number] = self.given[-1]
        ranges = [actuator.ctrl_range or (-np.inf, np.inf) for actuator in self.actuators]
        self.lower, self.upper = np.broadcast_to(
            np.array(ranges).T[:, None], (2, *self.given.shape)
        )


class PairColumns:
    """The contacts of pairs over steps, seen from one of the two bodies."""

    def __init__(self, chunk: StepChunk, side: int) -> None:
        self._chunk, self.side, self.pairs = chunk, side, chunk.pairs
        self.step, self.timestep_s = self.pairs.step, self.pairs.timestep_s
        self.points, self.starts = self.pairs.points, self.pairs.starts
        self.noted: dict[str, Float64] = {}
        self.sign = -1.0 if side else 1.0
        """Sign that converts a force on side 0 to a force on this side's body."""
        self.keys = self.pairs.body[:, [side, 1 - side]]
        self.body, self.other = self.pairs.body[:, side], self.pairs.body[:, 1 - side]

    def own(self, column: NDArray[Value]) -> NDArray[Value]:
        """Return this body's side of a two-sided column, shape (m, 2, …)."""
        return np.asarray(column[:, self.side])

    def others(self, column: NDArray[Value]) -> NDArray[Value]:
        """Return the other body's side of a two-sided column."""
        return np.asarray(column[:, 1 - self.side])

    @cached_property
    def links(self) -> Int64:
        """The links at each row's deepest point, on both sides, shape (m, 2)."""
        order = np.lexsort((self.points.distance_m, self.pairs.row))
        return np.asarray(self.points.link[order[self.starts]])

    def before(self, rows: Rows) -> Rows:
        """Return the row of the same pair one step earlier; -1 if there is none."""
        step, keys = self.step[rows], self.pairs.body[rows]
        order = np.lexsort((step, *keys.T))
        follows = (np.diff(keys[order], axis=0) == 0).all(axis=1) & (np.diff(step[order]) == 1)
        found = np.full(len(rows), -1)
        found[order[1:][follows]] = order[:-1][follows]
        return found

    def of_bodies(self, rows: Rows) -> Iterator[tuple[Steps, Rows, Rows]]:
        """Yield the steps of bodies in the given contact rows, with both indices."""
        return self._chunk.steps_at(self.body[rows], self.step[rows])


class BodyColumns:
    """The steps of equal bodies, one body after the other."""

    def __init__(
        self,
        chunk: StepChunk,
        batch: StepBatch,
        verdict: StepVerdicts,
        records: Mapping[int, Record],
        earlier: EarlierRows,
    ) -> None:
        self._chunk, self._records, self._earlier = chunk, records, earlier
        self.batch, self.whole, self.verdict = batch, batch.whole, verdict
        self.law, self.terms, self.reported = self.whole.law, self.whole.terms, self.whole.reported
        self.before, self.after, self.put = self.whole.before, self.whole.after, self.whole.put
        self.step = self.whole.steps
        self.noted: dict[str, Float64] = {}
        self.body = batch.body
        self.keys = self.body[:, None]

    def of_each(self, value: Callable[[BodySteps], Any]) -> NDArray[Any]:
        """Expand one value per body to a column for all of its steps."""
        bodies = self.batch.bodies
        return np.repeat([value(body) for body in bodies], [len(body) for body in bodies], axis=0)

    def greatest(self, values: Float64) -> Float64:
        """Return the running maximum of each body's rates, including earlier chunks.

        Argument and result have the shape (n, rates).
        """
        found, kept = np.empty_like(values), self._earlier.rates
        for body in self.batch.bodies:
            if len(mine := values[body.rows]):
                before = kept.get(body.body.number, mine[0])
                mine = np.maximum.accumulate(mine, axis=0)
                if before.shape == mine[0].shape:
                    mine = np.maximum(mine, before)
                found[body.rows], kept[body.body.number] = mine, mine[-1]
        return found

    @property
    def driven(self) -> Iterator[JointTelemetry]:
        """Yield the commanded joints of the bodies; `steps.rows` are their rows."""
        return (each for each in self._chunk.driven if each.steps.whole is self.whole)

    def joints(self, driven: JointTelemetry) -> JointColumns:
        """Return the table of a body's joints."""
        return JointColumns(self._chunk, driven, self._earlier)

    def came(self, column: Column) -> Float64:
        """Return a quantity of the bodies' states one step earlier; nan if there is none."""
        parts = [(body.rows.start, body) for body in self.batch.bodies if len(body)]
        return self._chunk.came(self.whole, parts, column)

    @property
    def puts(self) -> Int64:
        """How often calls set the body's state before each step; a change begins a new run."""
        records, its = self._records, self.batch.bodies
        puts = ([put.at.step for put in records[each.body.number].puts] for each in its)
        return np.concatenate(
            [np.searchsorted(at, each.steps) for at, each in zip(puts, its, strict=True)]
        )

    @property
    def segment(self) -> Int8:
        """The kind of each step, as an index into `SEGMENTS`."""
        return self.verdict.segment
