"""Compares two MuJoCo runs by stepping one run's engine from states of the other run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.engines.mujoco.elements import BALL, Elements, Matched
from drop_physics.engines.mujoco.fields_apart import FieldsApart, Swappable, elements_of_indices
from drop_physics.engines.mujoco.frames import ASLEEP, USER
from drop_physics.engines.mujoco.stages_apart import Computed, stages_apart
from drop_physics.engines.mujoco.swapping import Swapper
from drop_physics.engines.mujoco.taken import PASSIVE, TICK_S, TakenSteps, aligned
from drop_physics.trace.frames import CLOCK, FrameColumn, Frames, ModelEdit
from drop_physics.trace.swaps import Common, EndApart, Paired, StageApart, TermPut

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Flags = NDArray[np.bool_]

MOTION = ("qpos", "qvel")
TERMS = ("qfrc_passive", "qfrc_actuator")
"""Force terms of a step that an external force can replace."""
PUT = 1e-12
"""Velocities that differ by at most this are equal but for rounding."""
ROUNDING = 1e-9
"""Largest velocity difference that counts as rounding."""
ROWS_OF = {"qpos": "jnt", "qvel": "dof", "qacc_warmstart": "dof", "qfrc_applied": "dof"}
ROWS_OF |= {"act": "actuator", "ctrl": "actuator", "xfrc_applied": "body", "eq_active": "eq"}
ROWS_OF |= {"mocap_pos": "body", "mocap_quat": "body"}
"""The kind of element that the numbers of a part are of."""


@dataclass(frozen=True, eq=False)
class CrossedRun:
    """Engine, recorded steps and settings of one of two compared runs."""

    engine: str
    """Name and version of the run's MuJoCo."""
    swapper: Swapper
    fields: Mapping[str, NDArray[Any]]
    features: Sequence[str]
    steps: TakenSteps


class CrossedRuns:
    """Two compared MuJoCo runs, which implement the interface `trace.swaps.OneStep`.

    Parameters
    ----------
    a, b
        The runs; the second's engine takes steps from states of the first.
    tolerance
        The largest difference of a position or velocity at which steps are the same; 0 for the
        same bits.
    by_time
        Whether steps correspond that start and end at the same times, rather than in order.
    """

    def __init__(
        self, a: CrossedRun, b: CrossedRun, tolerance: float = 0.0, *, by_time: bool = False
    ) -> None:
        lengths, numbers = (len(a.steps), len(b.steps)), None
        if by_time:
            mine, theirs, numbers = aligned(a.steps, b.steps)
            ends_s = a.steps.whole.clock_s[-1:], b.steps.whole.clock_s[-1:]
            a, b = replace(a, steps=mine), replace(b, steps=theirs)
            if np.allclose(*ends_s, rtol=0.0, atol=TICK_S):
                lengths = len(mine), len(theirs)
        self._a, self._b, self._tolerance = a, b, tolerance
        self._matched = Matched(Elements(a.fields), Elements(b.fields))
        self._columns = {name: self._places(name) for name in (*a.steps.before, *a.steps.inputs)}
        found = FieldsApart(a.fields, b.fields, self._matched)
        self._swappable: Sequence[Swappable] = found.swappable
        self._count = min(len(a.steps), len(b.steps))
        columns = [*self._paired(), *self._added(), *self._edited()]
        self.common = Common(
            (a.engine, b.engine),
            lengths,
            (a.steps.whole.clock_s, b.steps.whole.clock_s),
            columns,
            [each.told for each in found.swappable],
            found.others,
            self._matched.only(),
            self._matched.is_reordered,
            not found.swappable and not found.others and self._matched.is_same_layout,
            self._matched.only(("jnt",)),
            numbers,
            self._count,
        )
        self._base = self._based()

    # -- what corresponds -------------------------------------------------------------------------

    def _places(self, name: str) -> tuple[Int64, Int64, list[str]]:
        """Return which columns of `qpos`, `qvel` … correspond in both runs, and their joints."""
        kind = ROWS_OF.get(name)
        if kind is None:
            width = self._width(self._a, name)
            if width != self._width(self._b, name):
                return np.empty(0, np.int64), np.empty(0, np.int64), []
            places = np.arange(width)
            return places, places, [name] * width
        mine, theirs, labels = [], [], []
        for i, j in self._matched.pairs(kind):
            both = [self._columns_of(side, name, n) for side, n in ((0, i), (1, j))]
            if len(both[0]) == len(both[1]):
                mine += both[0]
                theirs += both[1]
                labels += [self._matched.a.label(kind, i)] * len(both[0])
        return np.array(mine, np.int64), np.array(theirs, np.int64), labels

    def _columns_of(self, side: int, name: str, number: int) -> list[int]:
        """Return the columns of `qpos`, `qvel` … that belong to one joint or other element."""
        fields = (self._a, self._b)[side].fields
        if name == "qpos":
            first = int(fields["jnt_qposadr"][number])
            kind = int(fields["jnt_type"][number])
            return [*range(first, first + {0: 7, BALL: 4}.get(kind, 1))]
        if name == "act":
            first = int(fields["actuator_actadr"][number])
            return (
                [*range(first, first + int(fields["actuator_actnum"][number]))]
                if first >= 0
                else []
            )
        if name in ("mocap_pos", "mocap_quat"):
            mocap, width = int(fields["body_mocapid"][number]), 3 if name == "mocap_pos" else 4
            return [*range(width * mocap, width * (mocap + 1))] if mocap >= 0 else []
        width = 6 if name == "xfrc_applied" else 1
        return [*range(width * number, width * (number + 1))]

    def _width(self, side: CrossedRun, name: str) -> int:
        rows = side.steps.before.get(name, side.steps.inputs.get(name))
        return 0 if rows is None else rows.shape[1]

    def _paired(self) -> Iterator[Paired]:
        a, b, n = self._a.steps, self._b.steps, self._count
        for name, (mine, theirs, labels) in self._columns.items():
            if not len(mine) or (name not in b.before and name not in b.inputs):
                continue
            if name in USER:
                given = a.acting[name][:n, mine], b.acting[name][:n, theirs]
                yield Paired(name, "input", labels, *given)
                continue
            starts = a.before[name][:n, mine], b.before[name][:n, theirs]
            ends = a.after[name][:n, mine], b.after[name][:n, theirs]
            if name in MOTION:
                yield Paired(name, "motion", labels, *starts, *ends, self._units(name))
            else:
                yield Paired(name, "hidden", labels, *starts, *ends)

    def _added(self) -> Iterator[Paired]:
        """Yield the forces that the script's callbacks add to the passive forces, in either run."""
        a, b, n = self._a.steps.acting, self._b.steps.acting, self._count
        if PASSIVE in a or PASSIVE in b:
            mine, theirs, labels = self._columns["qvel"]
            rows = [
                np.zeros((n, len(places))) if PASSIVE not in held else held[PASSIVE][:n, places]
                for held, places in ((a, mine), (b, theirs))
            ]
            yield Paired(PASSIVE, "input", labels, rows[0], rows[1])

    def _units(self, name: str) -> list[str]:
        """Return the unit of each column of positions or velocities."""
        per = "" if name == "qpos" else "/s"
        found: list[str] = []
        kinds = self._a.fields["jnt_type"]
        for i, _ in self._matched.pairs("jnt"):
            kind = int(kinds[i])
            widths = {
                0: (3, 4 if not per else 3),
                1: (0, 4 if not per else 3),
                2: (1, 0),
                3: (0, 1),
            }
            metres, radians = widths[kind]
            found += [f"m{per}"] * metres + [f"rad{per}"] * radians
        return found

    def _edited(self) -> Iterator[Paired]:
        """Yield the model fields that either script writes during its run."""
        a, b, n = self._a.steps, self._b.steps, self._count
        for name in sorted(a.edited.keys() | b.edited.keys()):
            mine, theirs = self._a.fields.get(name), self._b.fields.get(name)
            if mine is None or theirs is None or mine.shape != theirs.shape:
                continue
            indices = np.unique(
                np.concatenate([each.edited[name][0] for each in (a, b) if name in each.edited])
            )
            rows = (
                _values(a.edited.get(name), mine, indices, n),
                _values(b.edited.get(name), theirs, indices, n),
            )
            labels = elements_of_indices(self._matched.a, name, mine, indices)
            self._columns[name] = indices, indices, labels
            yield Paired(name, "edit", labels, *rows, is_setting=name.startswith("opt."))

    # -- steps ------------------------------------------------------------------------------------

    def _based(self) -> Mapping[str, Float64]:
        """Return the first run's states and inputs, in the second run's columns, (n, width)."""
        a, b, n = self._a.steps, self._b.steps, self._count
        found = {}
        for group_a, group_b in ((a.before, b.before), (a.inputs, b.inputs)):
            for name, rows in group_b.items():
                whole = found[name] = rows[:n].copy()
                mine, theirs, *_ = self._columns.get(name, ((), ()))
                if name in group_a and len(mine):
                    whole[:, theirs] = group_a[name][:n, mine]
        return found

    def _crossing(self, steps: Int64, kept: Mapping[str, Sequence[int]] = {}) -> Frames:
        """Return start states of the first run's steps, converted for the second run's engine."""
        b = self._b.steps
        rows = {name: held[steps] for name, held in self._base.items()}
        for column in self.common.columns:
            if column.name in rows and len(its := [*kept.get(column.name, ())]):
                columns = self._columns[column.name][1][its]
                rows[column.name][:, columns] = column.before_b[steps][:, its]
        edits = [
            edit
            for column in self.common.columns
            if column.kind == "edit"
            for edit in _edits(
                column, steps, self._columns[column.name][0], kept.get(column.name, ())
            )
        ]
        return _frames(self._a.steps, b, rows, steps, edits)

    def redone(self, *, whole: bool = False) -> Flags:
        """Flag the steps that the first run's engine reproduces from their starts, shape (n,)."""
        a, steps = self._a.steps, np.arange(self._count)
        states = self._a.swapper.states(self._own(steps))
        same = np.ones(self._count, np.bool_)
        for name in a.after if whole else (*MOTION, "act"):
            if name in a.after:
                same &= self._same(states[name], a.after[name][steps])
        return same

    def settled(self) -> Flags:
        """Flag the steps in which no kinematic tree falls asleep or wakes, shape (n,)."""
        a = self._a.steps
        if ASLEEP not in a.before:
            return np.ones(self._count, np.bool_)
        starts, ends = a.before[ASLEEP][: self._count], a.after[ASLEEP][: self._count]
        return np.asarray(((starts >= 0) == (ends >= 0)).all(axis=1))

    def _same(self, mine: Float64, theirs: Float64) -> Flags:
        if self._tolerance:
            return np.asarray((np.abs(mine - theirs) <= self._tolerance).all(axis=1))
        both = [np.ascontiguousarray(each).view(np.uint64) for each in (mine, theirs)]
        return np.asarray((both[0] == both[1]).all(axis=1))

    def _edits_of(self, swapped: Sequence[int]) -> list[ModelEdit]:
        return [edit for each in swapped for edit in self._swappable[each].edits]

    def crossed(
        self,
        steps: Int64,
        swapped: Sequence[int] = (),
        kept: Mapping[str, Sequence[int]] = {},
        *,
        whole: bool = False,
    ) -> Flags:
        """Flag the steps of the first run that the second engine reproduces, shape (k,)."""
        states = self._b.swapper.states(self._crossing(steps, kept), self._edits_of(swapped))
        same = np.ones(len(steps), np.bool_)
        for name in self._a.steps.after if whole else (*MOTION, "act"):
            mine, theirs, *_ = self._columns.get(name, ((), ()))
            if len(mine) and name in states:
                after = self._a.steps.after[name][steps][:, mine]
                same &= self._same(states[name][:, theirs], after)
        return same

    def sizes(self, steps: Int64, swapped: Sequence[int]) -> Float64:
        """Return the largest velocity difference between the engines after each step, (k,)."""
        states = self._b.swapper.states(self._crossing(steps), self._edits_of(swapped))
        return self._off(states["qvel"], steps)

    def _off(self, rates: Float64, steps: Int64) -> Float64:
        mine, theirs, *_ = self._columns["qvel"]
        off = np.abs(rates[:, theirs] - self._a.steps.after["qvel"][steps][:, mine])
        return np.asarray(off.max(axis=1, initial=0.0))

    def stages(
        self, steps: Int64, swapped: Sequence[int]
    ) -> list[tuple[StageApart, StageApart | None]]:
        """Return each step's first computation stage that differs, and first beyond rounding."""
        mine = self._a.swapper.stages(self._own(steps))
        theirs = self._b.swapper.stages(self._crossing(steps), self._edits_of(swapped))
        return [
            stages_apart(Computed.of(mine, row), Computed.of(theirs, row), self._matched)
            for row in range(len(steps))
        ]

    def _own(self, steps: Int64) -> Frames:
        """Return start states of the first run's steps, unconverted, for its own engine."""
        a = self._a.steps
        rows = {name: held[steps] for name, held in {**a.before, **a.inputs}.items()}
        edits = [
            edit
            for name, (indices, values) in a.edited.items()
            for edit in _rows_edits(name, indices, values[steps])
        ]
        return _frames(a, a, rows, steps, edits)

    def features(self, step: int, swapped: Sequence[int]) -> list[str]:
        """Return the engine features that, if disabled, make both engines' steps agree."""
        steps, found = np.array([step]), []
        mine, theirs = self._own(steps), self._crossing(steps)
        for name in self._a.features:
            if name not in self._b.features:
                continue
            a = self._a.swapper.states(mine, (), [name])
            b = self._b.swapper.states(theirs, self._edits_of(swapped), [name])
            if all(
                self._same(b[part][:, columns[1]], a[part][:, columns[0]]).all()
                for part in MOTION
                for columns in [self._columns[part]]
            ):
                found.append(name)
        return found

    def term(self, step: int, swapped: Sequence[int]) -> TermPut | None:
        """Return the force term that explains why both engines' steps differ, if there is one.

        Its difference, applied as an external force, makes both steps agree.
        """
        steps, edits = np.array([step]), self._edits_of(swapped)
        crossing = self._crossing(steps)
        mine = self._a.swapper.stages(self._own(steps))
        theirs = self._b.swapper.stages(crossing, edits)
        columns_a, columns_b, *_ = self._columns["qvel"]
        for name in TERMS:
            off = np.zeros(len(theirs[name][0]))
            off[columns_b] = mine[name][0][columns_a] - theirs[name][0][columns_b]
            if off.any():
                applied = crossing.inputs["qfrc_applied"]
                inputs = {
                    **crossing.inputs,
                    "qfrc_applied": applied._replace(rows=applied.rows + off),
                }
                states = self._b.swapper.states(replace(crossing, inputs=inputs), edits)
                left = float(self._off(states["qvel"], steps)[0])
                if left <= PUT:
                    return TermPut(name.removeprefix("qfrc_"), left)
        return None

    def nudged(self, step: int, size: float, count: int) -> tuple[bool, list[float]]:
        """Repeat the first run from a step on, with slightly changed start velocities.

        Returns whether the unchanged repetition ends as recorded, and how far the others end from
        it.
        """
        a, draws = self._a.steps, np.random.default_rng(0)
        width = a.after["qvel"].shape[1]
        nudges = [np.zeros(width), *(size * draws.choice((-1.0, 1.0), width) for _ in range(count))]
        numbers = self.common.numbers
        begin = step if numbers is None else int(numbers[step])
        ends = self._a.swapper.rolled(a.full, begin, np.array(nudges))
        off = np.abs(ends[1:] - ends[0]).max(axis=1, initial=0.0)
        return bool(np.array_equal(ends[0], a.full.after["qpos"][-1])), sorted(off.tolist())

    def apart(self, step: int) -> EndApart:
        """Return the coordinate in which the runs differ most after a step, and by how much."""
        found = EndApart(0.0, "m", "")
        for i, j in self._matched.pairs("jnt"):
            a, b = (
                side.steps.after["qpos"][step, self._columns_of(n, "qpos", number)]
                for n, (side, number) in enumerate(((self._a, i), (self._b, j)))
            )
            body = self._matched.a.label("jnt", i)
            kind = int(self._a.fields["jnt_type"][i])
            for value, unit in _distances(a, b, kind):
                if value > found.value or not found.body:
                    found = EndApart(value, unit, body)
        return found


def _distances(a: Float64, b: Float64, kind: int) -> Iterator[tuple[float, str]]:
    """Yield the distances between two positions of the same joint, each with its unit."""
    if kind in (2, 3):
        yield float(abs(a[0] - b[0])), "m" if kind == 2 else "rad"
        return
    if kind == 0:
        yield float(np.linalg.norm(a[:3] - b[:3])), "m"
    p, q = a[-4:], b[-4:]
    off = min(float(np.linalg.norm(p - q)), float(np.linalg.norm(p + q)))
    yield 4.0 * float(np.arcsin(min(1.0, off / 2.0))), "rad"


def _values(
    edited: tuple[Int64, Float64] | None, compiled: NDArray[Any], indices: Int64, count: int
) -> Float64:
    """Return the values of a model field's elements in each step, shape (count, k)."""
    start = np.ravel(compiled).astype(np.float64)[indices]
    rows = np.repeat(start[None], count, axis=0)
    if edited is not None:
        rows[:, np.searchsorted(indices, edited[0])] = edited[1][:count]
    return rows


def _edits(
    paired: Paired, steps: Int64, indices: Int64, kept: Sequence[int]
) -> Iterator[ModelEdit]:
    """Yield model edits that give a field the values that it had in the first run's steps."""
    rows = paired.before_a[steps].copy()
    rows[:, [*kept]] = paired.before_b[steps][:, [*kept]]
    yield from _rows_edits(paired.name, indices, rows)


def _rows_edits(name: str, indices: Int64, rows: Float64) -> Iterator[ModelEdit]:
    for row in range(len(rows)):
        if not row or (rows[row] != rows[row - 1]).any():
            yield ModelEdit(row, name, indices, rows[row])


def _frames(
    run: TakenSteps,
    into: TakenSteps,
    rows: Mapping[str, Float64],
    steps: Int64,
    edits: Sequence[ModelEdit],
) -> Frames:
    """Return replay frames in which step i starts from row i of the given arrays."""
    whole = run.whole
    starts_s = run.starts_s[steps]
    at = np.array([0])
    state = {name: rows[name] for name in into.before}
    return Frames(
        client=whole.client,
        model=whole.model,
        first=0,
        timestep_s=whole.timestep_s,
        clock_s=np.append(starts_s[1:], 0.0),
        functions=whole.functions[steps],
        after={name: _later(each) for name, each in state.items()},
        before={
            CLOCK: FrameColumn(at, starts_s[:1, None]),
            **{name: FrameColumn(at, each[:1]) for name, each in state.items()},
        },
        inputs={name: FrameColumn(np.arange(len(steps)), rows[name]) for name in into.inputs},
        posed=_posed(whole, steps),
        edits=sorted(edits, key=lambda edit: edit.step),
        answers=[
            (row, told)
            for row, step in enumerate(steps.tolist())
            for at_step, told in whole.answers
            if at_step == step
        ],
    )


def _later(rows: Float64) -> Float64:
    """Return, for each row, the row that follows; for the last row, the first."""
    later: Float64 = np.concatenate([rows[1:], rows[:1]])
    return later


def _posed(whole: Frames, steps: Int64) -> dict[str, FrameColumn]:
    """Return the older states from which the steps' derived positions were computed, by part."""
    found = {}
    for name, column in whole.posed.items():
        rows = dict(zip(column.at.tolist(), column.rows, strict=True))
        at = [row for row, step in enumerate(steps.tolist()) if step in rows]
        if at:
            held = np.array([rows[int(steps[row])] for row in at])
            found[name] = FrameColumn(np.array(at, np.int64), held)
    return found
