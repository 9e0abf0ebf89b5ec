"""Collects the recorded data of each body: its tree of links, and settings that calls change."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.physics.base import Law
from drop_physics.physics.laws.lookup import RIGID
from drop_physics.physics.step_law import DampedTree, Reason, StepConditions, StepLaw
from drop_physics.physics.tree import BASE, Tree
from drop_physics.physics.vectors import distinct
from drop_physics.trace import events
from drop_physics.trace.calls import Given
from drop_physics.trace.events import GIVEN, Appearance, Body, Dynamics, Put, order
from drop_physics.trace.history import Seen
from drop_physics.trace.poses import inertial_frames, tree_of

DISABLE_SLEEPING = 2
"""Bit of `activationState` that keeps a body awake."""
AT_ORIGIN = np.array([0.0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0])
"""State of a base without recorded states: at rest at the origin."""
KEPT = frozenset(
    (
        "linearDamping",
        "angularDamping",
        "jointDamping",
        "jointLowerLimit",
        "jointUpperLimit",
        "maxJointVelocity",
        "activationState",
    )
)
"""Properties that affect a step, but that the engine does not report after a call has set them."""


@dataclass(frozen=True, eq=False)
class BodyConfig:
    """A body over a period in which its settings do not change."""

    life: int
    """Index of the body among all bodies with the same id, from 0: a script may remove a body and
    load it again."""
    law: DampedTree
    reasons: tuple[Reason, ...]
    """Reasons, known from the settings, why the body's steps may not equal the sum."""
    cone_friction: bool
    """Value of the engine setting `enableConeFriction`."""
    substeps: int
    """Number of substeps per step, at least 1 (`numSubSteps`)."""
    damping: tuple[float | None, float | None]
    """Linear and angular damping set by calls; None if no call set it."""
    other: Law | None
    """Law of free flight for a drop in another engine than PyBullet; None for the engine's own law.
    """
    step_law: StepLaw | None
    """The engine's integration rule; None if the engine itself reports every impulse."""


@dataclass(eq=False)
class Record:
    """Everything recorded about one body except samples, in chronological order."""

    body: Body
    came: list[Appearance] = field(default_factory=list)
    dynamics: list[Dynamics] = field(default_factory=list)
    puts: list[Put] = field(default_factory=list)
    given: list[Given] = field(default_factory=list)
    """Calls so far that set properties in `KEPT`; each chunk adds more."""
    given_steps: list[int] = field(default_factory=list)
    """The step of each call in `given`."""

    def give(self, given: Given) -> None:
        """Add a call that set properties of the body, if they affect its motion."""
        if KEPT & given.values.keys():
            self.given.append(given)
            self.given_steps.append(given.at.step)

    def __post_init__(self) -> None:
        self._known: Int64 | None = None
        self._coefficients: dict[str, tuple[Int64, Float64]] = {}

    def base_at(self, steps: Int64) -> Float64:
        """Return the state of the base that calls last set before the samples, shape (n, 13).

        A state set at a step takes effect after the sample of this step, unless that is the body's
        first sample.
        """
        if not self.puts:
            return np.tile(AT_ORIGIN, (len(steps), 1))
        if self._known is None:
            self._known = np.array([put.at.step + put.counts for put in self.puts], np.int64)
        which = np.maximum(np.searchsorted(self._known, steps, side="right") - 1, 0)
        used, rows = distinct(which)
        return np.array([self.puts[one].base for one in used.tolist()]).reshape(-1, 13)[rows]

    def coefficients(self, name: str) -> tuple[Int64, Float64]:
        """Return the m reports of a coefficient, such as friction: steps, values (m, links + 1).

        Values are nan if the engine does not report the coefficient.
        """
        if name not in self._coefficients:
            held = [each for each in self.dynamics if name in each.reported]
            steps = np.array([each.at.step for each in held] or [0], np.int64)
            numbers = [each.reported[name] for each in held] or [np.array([np.nan])]
            self._coefficients[name] = steps, np.array(numbers, np.float64)
        return self._coefficients[name]

    def puts_between(self, first: int, end: int) -> list[Put]:
        """Return the states that calls set at the steps from `first` to before `end`."""
        at = [bisect_left(self.puts, step, key=_step_of) for step in (first, end)]
        return self.puts[at[0] : at[1]]

    def lives(self, steps: Int64) -> Int64:
        """Return how often the id was reused before each sample: 0 for the first body.

        A sample at the step in which a body appears belongs to this body, unless it was taken
        before the body appeared.
        """
        if len(self.came) == 1:
            return np.zeros(len(steps), np.int64)
        first = [each.at.step + each.sampled for each in self.came]
        return np.maximum(np.searchsorted(first, steps, side="right") - 1, 0)


class Records(dict[int, Record]):
    """The recorded data of each rigid body, by body id."""

    def __init__(self, records: Mapping[int, Record] | None = None) -> None:
        super().__init__(records or {})
        self._tables: dict[str, tuple[Float64, dict[int, tuple[Int64, Float64]]]] = {}

    def coefficients(self, name: str, steps: Int64, bodies: Int64, links: Int64) -> Float64:
        """Return a coefficient, such as friction, of links at the start of steps, shape (n,).

        Values are nan where the engine does not report the coefficient, and for bodies without a
        record.
        """
        latest, changing = self._table(name)
        rows, column = np.minimum(bodies, len(latest) - 1), latest.shape[1] - 1
        found = np.asarray(latest[rows, np.minimum(links + 1, column)])
        for number, (since, numbers) in changing.items():
            rows = np.flatnonzero(bodies == number)
            which = np.maximum(np.searchsorted(since, steps[rows] - 1, side="right") - 1, 0)
            found[rows] = numbers[which, np.minimum(links[rows] + 1, numbers.shape[1] - 1)]
        return found

    def any(self, name: str) -> bool:
        """Return whether any link ever had a nonzero value of a coefficient."""
        latest, changing = self._table(name)
        tables = latest, *(numbers for _, numbers in changing.values())
        return any(np.nan_to_num(table).any() for table in tables)

    def _table(self, name: str) -> tuple[Float64, dict[int, tuple[Int64, Float64]]]:
        """Return each link's last reported coefficient, and all reports of bodies with changes.

        The last row of the first array stands for bodies without a record.
        """
        if name not in self._tables:
            reports = {number: record.coefficients(name) for number, record in self.items()}
            widest = max((numbers.shape[1] for _, numbers in reports.values()), default=1)
            latest = np.full((max(reports, default=-1) + 2, widest), np.nan)
            for number, (_, numbers) in reports.items():
                latest[number, : numbers.shape[1]] = numbers[-1]
                latest[number, numbers.shape[1] :] = numbers[-1, -1]
            changing = {
                number: report
                for number, report in reports.items()
                if (report[1] != report[1][0]).any()
            }
            self._tables[name] = latest, changing
        return self._tables[name]


def _step_of(put: Put) -> int:
    return put.at.step


def records_of(seen: Seen) -> Records:
    """Collect the recorded data of each rigid body."""
    records = Records(
        {number: Record(body) for number, body in sorted(seen.bodies.items()) if not body.soft}
    )
    for appearance in seen.appearances:
        if appearance.came and appearance.body.number in records:
            records[appearance.body.number].came.append(appearance)
    for dynamics in seen.dynamics:
        if dynamics.body.number in records:
            records[dynamics.body.number].dynamics.append(dynamics)
    for put in seen.puts:
        if put.body.number in records:
            records[put.body.number].puts.append(put)
    return records


class BodyConfigs:
    """The configurations of one body, each valid for a range of steps.

    `laws` contains the trees of all bodies by content: equal bodies share a tree, so that their
    steps can be explained in one batch.
    """

    def __init__(
        self,
        record: Record,
        settings: Sequence[events.Settings],
        other: Law | None,
        step_law: StepLaw | None,
        laws: dict[Hashable, DampedTree],
    ) -> None:
        self._record, self._other, self._laws = record, other, laws
        self._step_law = step_law
        self._settings = [each.at.step for each in settings]
        self._dynamics = [each.at.step for each in record.dynamics]
        self._came = [each.at.step + each.sampled - 1 for each in record.came[1:]]
        kinds = [_kind(each.values) for each in settings]
        self._kinds = sorted(set(kinds))
        self._which = [self._kinds.index(kind) for kind in kinds]
        self._made: tuple[tuple[int, ...], BodyConfig] | None = None

    def of(self, began: Int64) -> Iterator[tuple[slice, BodyConfig]]:
        """Yield ranges of steps that have the same configuration, in order.

        `began` is the number of steps before each step, shape (n,). Properties apply to a step if
        they were set before it began. Equal successive configurations are the same object.
        """
        if not len(began):
            return
        first, last = int(began[0]), int(began[-1])
        changes = {
            step
            for changed in (self._settings, self._dynamics, self._record.given_steps, self._came)
            for step in changed[bisect_right(changed, first) : bisect_right(changed, last)]
        }
        rows = sorted({0, *np.searchsorted(began, [*changes]).tolist()} if changes else (0,))
        keys = [self._at(int(began[row])) for row in rows]
        kept = [k for k in range(len(rows)) if not k or keys[k] != keys[k - 1]]
        for k, end in zip(kept, [*(rows[k] for k in kept[1:]), len(began)], strict=True):
            yield slice(rows[k], end), self._config(keys[k])

    def _at(self, began: int) -> tuple[int, ...]:
        """Return the indices of the settings, dynamics, calls and lifetime valid for a step."""
        settings, dynamics, given, life = (
            bisect_right(changed, began)
            for changed in (self._settings, self._dynamics, self._record.given_steps, self._came)
        )
        return self._which[max(settings - 1, 0)], dynamics - 1, given - 1, life

    def _config(self, key: tuple[int, ...]) -> BodyConfig:
        if self._made is None or self._made[0] != key:
            self._made = key, self._make(*key)
        return self._made[1]

    def _make(self, kind: int, of_body: int, given: int, life: int) -> BodyConfig:
        record, (substeps, cone) = self._record, self._kinds[kind]
        came = order(record.came[life].at)
        latest = record.dynamics[max(of_body, 0)]
        if order(latest.at) < came:
            latest = next(each for each in record.dynamics if order(each.at) >= came)
        reported = latest.reported
        calls = [each for each in record.given[: given + 1] if order(each.at) >= came]
        if known_from_start := {
            name: float(reported[key][0]) for key, name in GIVEN.items() if key in reported
        }:
            calls.insert(0, Given(latest.at, record.body, BASE, known_from_start))
        law = law_of(record.body, reported, calls, self._step_law)
        law = self._laws.setdefault(_content(law), law)
        settings = StepConditions(
            other_engine=self._other is not None,
            substeps=substeps,
            may_sleep=_may_sleep(record.body, calls),
            maximal="kind" in reported and int(reported["kind"][0]) == RIGID,
            planar=any(joint.kind == "planar" for joint in record.body.joints),
        )
        known = not (settings.planar or settings.maximal or settings.other_engine)
        engine = self._step_law
        reasons = (
            () if engine is None else engine.not_covered(settings, law.tree if known else None)
        )
        damping = _damping(calls)
        return BodyConfig(life, law, reasons, cone, substeps, damping, self._other, engine)


def _content(value: Any) -> Hashable:  # noqa: ANN401 - arrays, dataclasses, and what they hold
    """Return a key that is equal for values with equal content; arrays are compared bitwise."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if is_dataclass(value):
        return tuple(_content(getattr(value, each.name)) for each in fields(value))
    return value  # type: ignore[no-any-return]


def _damping(calls: Sequence[Given]) -> tuple[float | None, float | None]:
    """Return the linear and angular damping set by calls; PyBullet ignores a negative value."""
    given = [
        [_number(call.values.get(f"{which}Damping", -1.0)) for call in calls]
        for which in ("linear", "angular")
    ]
    linear, angular = (
        next((value for value in reversed(values) if value >= 0), None) for values in given
    )
    return linear, angular


def _kind(engine: Mapping[str, float | Sequence[float]]) -> tuple[int, bool]:
    """Return the engine settings that determine whether there is a sum of impulses."""
    cone = _number(engine.get("set_enableConeFriction", 1.0)) != 0
    return substeps_of(engine), cone


def substeps_of(engine: Mapping[str, float | Sequence[float]]) -> int:
    """Return the number of substeps of a step; the engine's 0 also means 1."""
    return max(int(_number(engine["numSubSteps"])), 1)


def law_of(
    body: Body,
    reported: Mapping[str, Float64],
    calls: Sequence[Given],
    step_law: StepLaw | None,
) -> DampedTree:
    """Return a body as a tree of links, with the properties that calls have set.

    PyBullet ignores a negative damping or velocity limit, and a lower limit above the upper one
    (`pybullet_changeDynamicsInfo`). Joint damping and limits apply to the link that a call reached,
    and are lost on a base; all other properties apply to the whole body.
    """
    # An engine that reports armature lets links move a base that has no mass of its own.
    carried = body.base_moves and "armature" in reported
    tree: Tree = replace(
        tree_of(body.joints, inertial_frames(reported)),
        fixed=bool(reported["mass_kg"][0] == 0 and not carried),
        masses_kg=np.asarray(reported["mass_kg"], np.float64),
        inertias_kg_m2=np.asarray(reported["inertia_kg_m2"], np.float64),
        armature=_armature(reported),
        coupled=reported.get("coupled"),
    )
    damping = [joint.damping for joint in body.joints]
    limits = [joint.limits for joint in body.joints]
    usual, limit = (
        (0.0, np.inf) if step_law is None else (step_law.damping, step_law.velocity_limit)
    )
    whole = {"linearDamping": usual, "angularDamping": usual, "maxJointVelocity": limit}
    for call in calls:
        numbers = {name: _number(value) for name, value in call.values.items()}
        link = call.link
        whole |= {name: numbers[name] for name in whole if numbers.get(name, -1.0) >= 0}
        if not 0 <= link < len(damping):
            continue
        damping[link] = given if (given := numbers.get("jointDamping", -1)) >= 0 else damping[link]
        asked = numbers.get("jointLowerLimit", 1.0), numbers.get("jointUpperLimit", -1.0)
        limits[link] = asked if asked[0] <= asked[1] else limits[link]
    counts = [rate.stop - rate.start for rate in tree.rates]
    lower, upper = np.reshape(limits, (-1, 2)).T.astype(np.float64)
    return DampedTree(
        tree=tree,
        joint_damping=np.repeat(np.array(damping, np.float64), counts),
        lower=np.repeat(lower, counts),
        upper=np.repeat(upper, counts),
        linear_damping=whole["linearDamping"],
        angular_damping=whole["angularDamping"],
        velocity_limit=whole["maxJointVelocity"],
    )


def _armature(reported: Mapping[str, Float64]) -> Float64 | None:
    """Return the reported armature of all joints; None if all are 0."""
    found = reported.get("armature")
    return None if found is None or not found.any() else found


def _may_sleep(body: Body, calls: Sequence[Given]) -> bool:
    states = [int(_number(call.values.get("activationState", 0))) for call in calls]
    last = next((state for state in reversed(states) if state > 0), 0)
    return (body.can_sleep or last > 0) and not last & DISABLE_SLEEPING


def _number(value: float | Sequence[float]) -> float:
    return float(np.ravel(value)[0])


def settings_of(seen: Seen) -> dict[int, list[events.Settings]]:
    """Return the settings that each simulation's engine reported, in order, by client."""
    found: dict[int, list[events.Settings]] = {}
    for settings in seen.settings:
        found.setdefault(settings.client, []).append(settings)
    return found


def configs_of(
    records: Mapping[int, Record],
    settings: Mapping[int, Sequence[events.Settings]],
    other: Law | None,
    step_law: StepLaw | None,
) -> dict[int, BodyConfigs]:
    """Return the configurations of each body, by body id; equal bodies share one tree."""
    laws: dict[Hashable, DampedTree] = {}
    return {
        number: BodyConfigs(record, settings[record.body.client], other, step_law, laws)
        for number, record in records.items()
    }
