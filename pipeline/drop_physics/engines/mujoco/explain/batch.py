"""Collects replayed steps of one simulation, to explain many at once with array operations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import integrators
from .constraints import POINT, PairTable, constrained
from .copied import Copies
from .forces import Force, smooth
from .integrators import RK4, STAGES, WEIGHTS
from .layout import Layout
from .summed import TermSums, TermTable, summed

ANOTHER = "another engine"
"""Cause kind for the difference between another program's step and MuJoCo's, including the other
program's rounding."""


class ExplainedBatch(NamedTuple):
    """Explanations of a batch of steps."""

    steps: Any
    """Indices of the steps, shape (n,)."""
    summed: TermSums
    points: Any
    """Contacts (`constraints.POINT`); `row` is the step's index."""


class WaitingSteps:
    """Replayed steps of one integrator that wait to be explained together.

    Parameters
    ----------
    m, d
        The MjModel, and an MjData in which it is evaluated.
    layout, terms, pairs
        The model's `Layout`, `TermTable` and `PairTable`.
    integrator
        The integrator, as MuJoCo numbers it (`mjtIntegrator`).
    version
        The version of MuJoCo.
    """

    def __init__(
        self,
        m: Any,
        d: Any,
        layout: Layout,
        terms: TermTable,
        pairs: PairTable,
        integrator: int,
        version: tuple[int, ...],
    ) -> None:
        self._m, self._d, self._layout = m, d, layout
        self._terms, self._pairs = terms, pairs
        self.integrator, self._version = integrator, version
        implicit = integrator in (integrators.IMPLICIT, integrators.IMPLICITFAST)
        self.copies = Copies(m, d, layout.mass_name, implicit=implicit)
        self._stages = STAGES if integrator == RK4 else 1
        self.room = max(1, self.copies.room // self._stages)
        self._qpos, self._qvel = np.empty((self.room, m.nq)), np.empty((self.room, m.nv))
        self._after, self._reached = np.empty((self.room, m.nv)), np.empty((self.room, m.nq))
        self._begin()

    def _begin(self) -> None:
        self.steps: list[int] = []
        self._h: list[float] = []
        self._qfrc: dict[int, Any] = {}
        self._xfrc: dict[int, Any] = {}
        self._xipos: dict[int, Any] = {}
        self._rates: list[Any] = []
        self._gaps: dict[int, Any] = {}
        self.copies.begin()

    @property
    def is_full(self) -> bool:
        """Return whether the waiting steps have to be explained before another is added."""
        return len(self.steps) >= self.room or self.copies.is_full

    def before(self, qpos: Any, qvel: Any) -> None:
        """Store the state before a step."""
        at = len(self.steps)
        self._qpos[at], self._qvel[at] = qpos, qvel

    def evaluated(self, sparse: bool, applied: bool, pushed: bool) -> None:
        """Copy forces and matrices after an evaluation: once per step, or once per RK4 stage."""
        at, d = self.copies.count, self._d
        if applied:
            self._qfrc[at] = d.qfrc_applied.copy()
        if pushed:
            self._xfrc[at] = d.xfrc_applied.copy()
            self._xipos[at] = d.xipos.copy()
        if self._stages > 1:
            self._rates.append(d.qvel.copy())
        self.copies.copy(sparse)

    def after(self, step: int, qpos: Any, qvel: Any, h: float, gap: Any = None) -> None:
        """Add the state after a step; `gap` is the other program's velocities minus MuJoCo's."""
        self._reached[len(self.steps)], self._after[len(self.steps)] = qpos, qvel
        if gap is not None:
            self._gaps[len(self.steps)] = gap
        self.steps.append(step)
        self._h.append(h)

    def explain(self, *, sparse: bool) -> ExplainedBatch:
        """Explain the waiting steps as sums of impulses, and start a new batch."""
        m, layout, copies = self._m, self._layout, self.copies
        copies.contacts.check(self._d)
        n, h = len(self.steps), np.array(self._h)
        held = copies.named()
        count = copies.count
        if self._xipos:
            held["xipos"] = _filled(self._xipos, count, (m.nbody, 3))
        dense = smooth(
            m,
            layout,
            held,
            _filled(self._qfrc, count, (m.nv,)) if self._qfrc else None,
            _filled(self._xfrc, count, (m.nbody, 6)) if self._xfrc else None,
        )
        found = constrained(copies, self._pairs, layout.joint, m.nv, sparse=sparse)
        before = {"qpos": self._qpos[:n], "qvel": self._qvel[:n]}
        change = self._after[:n] - before["qvel"]
        mass = held[layout.mass_name]
        stages = self._stages
        momentum = layout.mass.times(mass[::stages], change)
        groups = found.groups
        if stages > 1:
            dense = [each._replace(values=integrators.averaged(each.values)) for each in dense]
            dense += integrators.added_by_stages(layout, held)
            added: list[Any] = []
            if groups is not None:
                weights = np.repeat(np.array(WEIGHTS)[groups.rows % stages], np.diff(groups.starts))
                groups = groups._replace(rows=groups.rows // stages, values=groups.values * weights)
        else:
            added = [
                integrators.added(
                    m, layout, held, self.integrator, h, before, change, self._version
                )
            ]
        if self._gaps:
            gaps = layout.mass.times(mass[::stages], _filled(self._gaps, n, (m.nv,)))
            added.append(Force(ANOTHER, -1, -1, None, gaps))
            momentum = momentum + gaps
        after = layout.mass.times(mass[::stages], self._after[:n])
        total = summed(self._terms, momentum, dense, groups, h, added, after)
        if stages > 1:
            rates = np.array(self._rates).reshape(n, stages, m.nv)
            strays = integrators.strays_by_stages(
                m, rates, h, before["qpos"], self._reached[:n], self._version
            )
            total.remainder[~(strays <= integrators.MOVED_BY)] = np.inf
        numbers = np.array(self.steps)
        answer = ExplainedBatch(numbers, total, _of_steps(found.points, numbers, stages))
        self._begin()
        return answer


def _filled(rows: dict[int, Any], count: int, shape: tuple[int, ...]) -> Any:
    """Return an array of `count` rows: the given rows at their indices, zero elsewhere."""
    full = np.zeros((count, *shape))
    for row, values in rows.items():
        full[row] = values
    return full


def _of_steps(rows: Any, numbers: Any, stages: int) -> Any:
    """Return the contacts of each step's first evaluation, with the step's number as `row`."""
    first = rows[rows["row"] % stages == 0] if stages > 1 else rows
    found = np.array(first, POINT)
    found["row"] = numbers[first["row"] // stages] if len(first) else 0
    return found
