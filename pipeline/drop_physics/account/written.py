"""Rows for states that the script set between steps, and for energy given and taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drop_physics.account.rows import AccountRow, magnitude
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import CONTACT, FRICTION, GIVEN, HELD, Term
from drop_physics.account.touching import DEEP
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import Points
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message, joined
from drop_physics.physics.tree import States, Tree
from drop_physics.quantities import quantity

ODD = ("integrator", "solver", "clamp", "remainder")
"""Non-physical causes, which give energy only if a step is wrong."""
UNKNOWN = 0.05
"""Unexplained share of a body's energy turnover above which no terms are reported."""
ROUNDING = 1e-9
"""Share of the energy turnover below which an energy is rounding error."""
TURNOVER = 0.02
"""Share of a body's energy turnover above which the energy from a non-physical cause counts."""


@dataclass(eq=False)
class WrittenStates:
    """The states of a body that calls set between steps; filled chunk by chunk."""

    steps: int = 0
    """Number of steps of the body."""
    written: int = 0
    """Number of steps before which the script wrote the body's state."""
    stopped: int = 0
    """Number of these writes that left a moving body at rest."""
    way: Float64 = field(default_factory=lambda: np.zeros(2))
    """Total path due to calls: of the base and of slides [m], and of other joints [rad]."""
    stepped: Float64 = field(default_factory=lambda: np.zeros(2))
    """Total path due to steps: of the base and of slides [m], and of other joints [rad]."""
    velocity: Float64 = field(default_factory=lambda: np.zeros(2))
    """Total change of velocities due to calls [m/s] and [rad/s]."""
    first_step: int | None = None
    """The first sample after a step from a state that the script wrote."""
    last_step: int = -1
    deepest_m: float = 0.0
    """The deepest overlap with another body in a state that the script wrote."""
    into: tuple[int, int] | None = None
    """The other body's id, and its link."""
    _last: States | None = None
    _life: int = 0
    """Index of the body's life in the latest steps: a body that is loaded again has another."""

    def add(self, steps: BodySteps, points: Points) -> bool:
        """Add explained steps of the body, and return whether it was loaded again before them.

        `points` are all contact points in the steps.
        """
        is_loaded_again = self._last is not None and steps.config.life != self._life
        self._life = steps.config.life
        if is_loaded_again:
            self._last = None
        before, after = steps.before, steps.after
        put = np.flatnonzero(steps.put)
        if len(put):
            self._meet(steps.body.number, points, steps.steps[put])
        tree, last = steps.law.tree, self._last
        self.steps += len(steps)
        self.stepped += _path(tree, before, after)
        if put[:1].tolist() == [0] and last and last.joints.shape == before.joints[:1].shape:
            self._jump(tree, int(steps.steps[0]), last, before.at(np.array([0])))
        for row in put[put > 0].tolist():
            end = after.at(np.array([row - 1]))
            self._jump(tree, int(steps.steps[row]), end, before.at(np.array([row])))
        self._last = after.at(np.array([len(steps) - 1]))
        return is_loaded_again

    def _meet(self, number: int, points: Points, steps: Int64) -> None:
        """Update the deepest overlap with another body (by id) at the start of steps."""
        its = (points.body == number).sum(axis=1) == 1
        rows = np.flatnonzero(its & np.isin(points.step, steps))
        if len(rows) and -points.distance_m[rows].min() > self.deepest_m:
            row = rows[np.argmin(points.distance_m[rows])]
            other = int(points.body[row, 0] == number)
            self.deepest_m = float(-points.distance_m[row])
            self.into = int(points.body[row, other]), int(points.link[row, other])

    def _jump(self, tree: Tree, step: int, end: States, begin: States) -> None:
        """Add how far calls moved the body between a step and the next one."""
        self.written += 1
        self.first_step = step if self.first_step is None else self.first_step
        self.last_step = step
        self.stopped += bool(end.velocity.any() and not begin.velocity.any())
        self.way += _path(tree, end, begin)
        changed, first = (begin.velocity - end.velocity)[0], tree.first_rate
        slides = _slides(tree)[first:]
        joints = np.abs(changed[first:])
        turned, moved = (float(np.linalg.norm(part)) for part in (changed[:3], changed[3:first]))
        if not first:
            turned = moved = 0.0
        self.velocity += moved + joints[slides].sum(), turned + joints[~slides].sum()

    def row(
        self, subject: MeasuredBody, subjects: Mapping[int, MeasuredBody], words: RowWords
    ) -> AccountRow | None:
        """Return the row for a body that calls have moved; None if no call changed anything."""
        way = self.way[0] / subject.size_m + self.way[1]
        if not self.written or (way <= 0.01 and self.velocity.sum() <= 0.01):
            return None
        told = Message(
            "the script wrote its state before {written:,} of the {steps:,} steps after the first",
            written=self.written,
            steps=self.steps - 1,
        )
        if self.way.any():
            told = told + Message(
                "; these writes moved it by {way} in total, its steps by {stepped}",
                way=_with_units(self.way, ("m", "rad")),
                stepped=_with_units(self.stepped, ("m", "rad")),
            )
        if self.velocity.any():
            told = told + Message(
                "; they changed its velocity by {velocity} in total",
                velocity=_with_units(self.velocity, ("m/s", "rad/s")),
            )
        other = None if self.into is None else subjects.get(self.into[0])
        size_m = min(subject.size_m, np.inf if other is None else other.size_m)
        if self.way.any() and self.into is not None and self.deepest_m > DEEP * size_m:
            told = told + Message(
                ", up to {depth} into {other}",
                depth=quantity(self.deepest_m, "m"),
                other=words.names.link(*self.into),
            )
        return AccountRow(
            kind="set",
            told=told,
            got=float(self.way[0] or self.way[1]),
            unit="m" if self.way[0] else "rad",
            besides=(
                (float(self.way[1]), "rad"),
                (float(self.velocity[0]), "m/s"),
                (self.deepest_m, "m"),
            ),
            step=self.last_step,
            salience=min(1.0, self.written / self.steps + 0.4 * min(way, 1.0)),
            subject=subject.body,
            group=("set", subject.kind, self.written),
        )


def _slides(tree: Tree) -> Flags:
    """Flag the entries of u that are speeds [m/s], not rates of a rotation, shape (size,)."""
    slides = np.zeros(tree.size, np.bool_)
    slides[3 : tree.first_rate] = True
    for joint, place in zip(tree.joints, tree.rates, strict=True):
        slides[place] = joint == "prismatic"
    return slides


def _path(tree: Tree, start: States, end: States) -> Float64:
    """Return the path between states, of base and slides [m] and of other joints [rad], (2,)."""
    moved = np.abs(end.joints - start.joints).sum(axis=0)
    slides = np.zeros(tree.joint_coordinates, np.bool_)
    for joint, place in zip(tree.joints, tree.coordinates, strict=True):
        slides[place] = joint == "prismatic"
    way_m = np.linalg.norm(end.position_m - start.position_m, axis=1).sum()
    return np.array([way_m + moved[slides].sum(), moved[~slides].sum()])


def _with_units(values: Float64, units: tuple[str, str]) -> Message:
    """Format a length and an angle, or their rates; zeros beside a nonzero value are left out."""
    told = [quantity(float(each), unit) for each, unit in zip(values, units, strict=True) if each]
    return joined(" and ", told or [quantity(0.0, units[0])])


def energy_row(
    subject: MeasuredBody,
    by_cause_j: Mapping[str, float],
    start_j: float,
    end_j: float,
    words: RowWords,
) -> AccountRow | None:
    """Return the row that says where a body's energy came from and went to."""
    values = {Term(cause): value for cause, value in by_cause_j.items() if value}
    for cause, parts in (("contacts", (CONTACT, FRICTION)), (HELD, (HELD,))):
        apart = {
            term: float(work.sum())
            for term, work in subject.ledger.work.items()
            if term.cause in parts
        }
        if apart and Term(cause) in values:
            del values[Term(cause)]
            values |= apart
    commanded = subject.ledger.work.get(Term(GIVEN))
    if commanded is not None and Term("applied") in values:
        values[Term(GIVEN)] = float(commanded.sum())
        values[Term("applied")] -= float(commanded.sum())
    given = sum(value for value in values.values() if value > 0)
    taken = -sum(value for value in values.values() if value < 0)
    turnover, potential = max(given, taken), subject.weight_n * subject.size_m
    if abs(values.get(Term("remainder"), 0.0)) > UNKNOWN * turnover:
        values = {}
    if turnover < 1e-9 * potential or not (values or abs(end_j - start_j) > ROUNDING * turnover):
        return None
    odd = max((values.get(Term(cause), 0.0) for cause in ODD), default=0.0) / turnover
    large = min(turnover / potential, 1.0)
    main = max(values, key=lambda term: abs(values[term])).cause if values else ""
    return AccountRow(
        kind="energy",
        told=Message(
            "{start} to {end}",
            start=quantity(_rounded(start_j, turnover), "J"),
            end=quantity(_rounded(end_j, turnover), "J"),
        ),
        asked=start_j,
        got=end_j,
        gap=end_j - start_j,
        unit="J",
        step=subject.ledger.last,
        terms=words.terms(subject, values, "J"),
        salience=max(1.2 * odd * large if odd > TURNOVER else 0.0, 0.22 * large),
        subject=subject.body,
        group=("energy", subject.kind, main, end_j > start_j, magnitude(end_j - start_j)),
    )


def _rounded(energy_j: float, turnover_j: float) -> float:
    """Return an energy, or 0 if it is rounding error relative to the turnover."""
    return energy_j if abs(energy_j) > ROUNDING * turnover_j else 0.0
