"""Finds why two PyBullet runs differ by swapping calls, as its hidden state cannot be read.

The log of the first run's calls is replayed, with some calls replaced by those of the second run.
Calls that make the replay equal the second run bit for bit, up to and beyond the first difference,
are the cause.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.compare.paired import PairedBody, columns_of, farthest
from drop_physics.experiments.swap.answer import (
    Class,
    DifferenceCause,
    End,
    ProvedDifference,
    SwapProof,
    Value,
)
from drop_physics.experiments.swap.cause import alone
from drop_physics.experiments.swap.first import differs, first_apart
from drop_physics.experiments.swap.minimal import minimal
from drop_physics.trace.logs import LoggedCall, Sets, attributes_apart
from drop_physics.trace.swaps import Common

MOST_CAUSES = 3
MOST_UNITS = 2000
"""Most differences between two logs that are examined one by one."""
LONGEST = 40
"""Longest value shown [characters]."""
SHOWN = 3
"""Most arguments of a call that are shown."""

States = Callable[[Sequence[LoggedCall], int], dict[int, Float64] | None]
"""Function that replays calls, and returns the states of bodies after each step, by body id."""


@dataclass(frozen=True, eq=False)
class CallUnit:
    """One difference between two call logs, which can be swapped by itself."""

    at: int
    """Index in the first log."""
    removed: Sequence[LoggedCall] = ()
    added: Sequence[LoggedCall] = ()
    argument: str = ""
    """The argument that differs, if a call differs only in that."""

    @property
    def step(self) -> int:
        """The step before which the calls are made."""
        return min(each.step for each in (*self.removed, *self.added))

    @property
    def sets(self) -> set[Sets]:
        """Names of the states and settings that the differing calls set."""
        return {each.sets for each in (*self.removed, *self.added)}

    @property
    def kind(self) -> object:
        """A key that is equal for differences in the same script calls, at any step."""
        calls = [[(e.function, e.site) for e in s] for s in (self.removed, self.added)]
        return str(calls), self.argument


@dataclass
class WhyCalls:
    """Finds which calls make two runs differ.

    Parameters
    ----------
    a, b
        The call logs of both runs.
    bodies
        The bodies that both runs have, with their ids in the logs.
    lengths, times_s
        Number of steps of each run, and the clock after each step of the first run [s].
    states
        Function that replays calls.
    tolerance
        The largest difference that counts as none; 0 if only equal bits count.
    """

    a: Sequence[LoggedCall]
    b: Sequence[LoggedCall]
    bodies: Sequence[tuple[int, PairedBody]]
    lengths: tuple[int, int]
    times_s: Float64
    states: States
    tolerance: float = 0.0
    moves_alone: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Names of bodies that move in one run only, by run: `a` and `b`."""
    _units: list[CallUnit] = field(default_factory=list)

    def answer(self) -> ProvedDifference:
        """Find the calls that make the runs differ, and return the result."""
        paired, count = [body for _, body in self.bodies], min(self.lengths)
        common = Common(("", ""), self.lengths, (self.times_s, self.times_s), columns_of(paired))
        first = first_apart(common, self.tolerance)
        self._units = [*units_of(self.a, self.b)]
        if first is None and any(self.moves_alone.values()):
            told = alone(self.moves_alone)
            return ProvedDifference(self.lengths, count - 1, 0.0, None, "model", told)
        if first is None:
            cls: Class = "none" if len({*self.lengths}) == 1 else "length"
            until_s = float(self.times_s[count - 1]) if count else 0.0
            idle = self._names(self._units) if cls == "none" else []
            return ProvedDifference(self.lengths, count - 1, until_s, None, cls, no_effect=idle)
        step = first.step
        until_s = float(self.times_s[step - 1]) if step else 0.0
        end = farthest(paired, count - 1)
        answer = ProvedDifference(
            self.lengths, step - 1, until_s, first, None, end=End(end.value, end.unit, end.body)
        )
        mine, theirs = (self.states(log, count) for log in (self.a, self.b))
        if not (self._is(mine, count, second=False) and self._is(theirs, count, second=True)):
            return answer  # the logs are not all that made these runs
        before = [unit for unit in self._units if unit.step <= step]
        if not before or len(before) > MOST_UNITS or not self._holds(before, step + 1):
            return answer
        least = minimal(before, lambda some: self._holds(some, step + 1))
        swapped, until = self._with_later(least, count)
        second = self._second(swapped, until) if until < count else []
        return replace(
            answer,
            cls=_class_of(least),
            because=[*_told(least, swapped)][:MOST_CAUSES],
            also=[*_told(second)][:MOST_CAUSES],
            proved=SwapProof("calls", until, count, not self.tolerance),
            no_effect=self._without_effect(before, [*least, *second]),
        )

    def _with_later(self, least: Sequence[CallUnit], count: int) -> tuple[list[CallUnit], int]:
        """Extend a cause by later differences of the same calls; also return steps explained."""
        kinds = {each.kind for each in least}
        swapped = [unit for unit in self._units if unit.kind in kinds]
        until = self._same_until(self.states(with_units(self.a, swapped), count), count)
        if until > max(each.step for each in least):
            return swapped, until
        states = self.states(with_units(self.a, least), count)
        return [*least], self._same_until(states, count)

    def _second(self, swapped: Sequence[CallUnit], until: int) -> list[CallUnit]:
        """Return the calls that make the runs differ again, once the first cause is swapped."""
        first = {*map(id, swapped)}
        others = [unit for unit in self._units if id(unit) not in first and unit.step <= until]
        if not others or len(others) > MOST_UNITS:
            return []

        def holds(some: Sequence[CallUnit]) -> bool:
            both = first | {*map(id, some)}  # in the order of the log
            return self._holds([unit for unit in self._units if id(unit) in both], until + 1)

        return minimal(others, holds) if holds(others) else []

    def _without_effect(self, before: Sequence[CallUnit], acting: Sequence[CallUnit]) -> list[str]:
        """Return the differing calls that have no effect."""
        kinds = {each.kind for each in acting}
        names = self._names([each for each in before if each.kind not in kinds])
        return [name for name in names if name not in self._names(acting)]

    def _names(self, units: Sequence[CallUnit]) -> list[str]:
        return [*dict.fromkeys(each.field or "" for each in _told(units))]

    def _holds(self, units: Sequence[CallUnit], steps: int) -> bool:
        return self._is(self.states(with_units(self.a, units), steps), steps, second=True)

    def _is(self, states: dict[int, Float64] | None, steps: int, *, second: bool) -> bool:
        """Return whether states equal those recorded in one of the runs."""
        return states is not None and self._same_until(states, steps, second=second) == steps

    def _same_until(
        self, states: dict[int, Float64] | None, steps: int, *, second: bool = True
    ) -> int:
        """Return the number of steps for which states equal those of a run."""
        same = steps
        for number, body in self.bodies:
            rows = None if states is None else states.get(number)
            if rows is None:
                return 0
            recorded = (body.b if second else body.a)[1 : steps + 1]
            there = ~np.isnan(recorded).any(axis=1)
            found = np.full(recorded.shape, np.nan)
            if max(body.places, default=-1) < rows.shape[1]:
                found = rows[:steps, [*body.places]]
            apart = differs(recorded, found, self.tolerance).any(axis=1) & there
            same = min(same, int(np.argmax(apart)) if apart.any() else steps)
        return same


def units_of(a: Sequence[LoggedCall], b: Sequence[LoggedCall]) -> Iterator[CallUnit]:
    """Yield the differences between two logs, step by step."""
    groups: dict[int, tuple[list[int], list[LoggedCall]]] = {}
    for number, call in enumerate(a):
        groups.setdefault(call.step, ([], []))[0].append(number)
    for call in b:
        groups.setdefault(call.step, ([], []))[1].append(call)
    ends = 0
    for _, (numbers, theirs) in sorted(groups.items()):
        mine = [a[number] for number in numbers]
        begin = numbers[0] if numbers else ends
        ends = begin + len(numbers)
        keys = [each.key for each in mine], [their.key for their in theirs]
        if keys[0] == keys[1]:
            continue
        matcher = difflib.SequenceMatcher(None, *keys, autojunk=False)
        for how, i, j, k, m in matcher.get_opcodes():
            if how != "equal":
                yield from _split(begin + i, mine[i:j], theirs[k:m])


def _split(at: int, mine: Sequence[LoggedCall], theirs: Sequence[LoggedCall]) -> Iterator[CallUnit]:
    """Yield the single differences before a step; for corresponding calls, argument by argument."""
    functions = [[each.function for each in calls] for calls in (mine, theirs)]
    if functions[0] == functions[1]:
        for number, (x, y) in enumerate(zip(mine, theirs, strict=True)):
            names = [n for n in {**x.given, **y.given} if x.given.get(n) != y.given.get(n)]
            for name in names if x.makes == y.makes else ():
                yield CallUnit(at + number, [x], [y], name)
            if x.makes != y.makes:
                yield CallUnit(at + number, [x], [y])
    elif mine and theirs and not {*functions[0]} & {*functions[1]}:
        yield CallUnit(at, mine, theirs)
    else:
        for number, call in enumerate(mine):
            yield CallUnit(at + number, [call])
        for call in theirs:
            yield from _added(at, call)


def _added(at: int, call: LoggedCall) -> Iterator[CallUnit]:
    """Yield a call that only the second log has; each engine option becomes its own unit."""
    if call.sets != "setting" or len(call.given) < 2 or not call.function.endswith("Parameter"):
        yield CallUnit(at, (), [call])
        return
    for name, value in call.given.items():
        yield CallUnit(at, (), [replace(call, given={name: value})], name)


def with_units(log: Sequence[LoggedCall], units: Sequence[CallUnit]) -> list[LoggedCall]:
    """Return a log with differences applied to it."""
    removed: set[int] = set()
    added: dict[int, list[LoggedCall]] = {}
    changed: dict[int, LoggedCall] = {}
    for unit in units:
        if unit.argument and unit.removed:
            call = changed.get(unit.at, unit.removed[0])
            changed[unit.at] = _with_argument(call, unit.added[0], unit.argument)
            continue
        removed |= {unit.at + number for number in range(len(unit.removed))}
        added.setdefault(unit.at, []).extend(unit.added)
    found = []
    for number in range(len(log) + 1):
        found += added.get(number, [])
        if number < len(log) and number not in removed:
            found.append(changed.get(number, log[number]))
    return found


def _with_argument(call: LoggedCall, other: LoggedCall, name: str) -> LoggedCall:
    """Return a call with an argument taken from another call, or removed if absent there."""
    given = {each: value for each, value in call.given.items() if each != name}
    if name in other.given:
        given[name] = other.given[name]
    is_file = call.content is not None and isinstance(other.given.get(name), str)
    return replace(call, given=given, content=other.content if is_file else call.content)


# -- in words -------------------------------------------------------------------------------------


def _class_of(units: Sequence[CallUnit]) -> Class:
    sets = set[Sets]().union(*(unit.sets for unit in units))
    if sets == {"setting"}:
        return "settings"
    if "input" in sets:
        return "input"
    return "start" if sets == {"state"} else "model"


def _told(units: Sequence[CallUnit], acting: Sequence[CallUnit] = ()) -> Iterator[DifferenceCause]:
    """Return differences as causes, equal ones merged."""
    removed, added = (
        [call for unit in units for call in (unit.added if which else unit.removed)]
        for which in (0, 1)
    )
    keys = [sorted(str(each.key) for each in calls) for calls in (removed, added)]
    if removed and keys[0] == keys[1]:
        made = [each for each in removed if each.makes is not None]
        yield DifferenceCause("order", element=_names_of(made or removed), site_a=removed[0].site,
                    site_b=added[0].site, step=removed[0].step or None)  # fmt: skip
        return
    first: dict[DifferenceCause, DifferenceCause] = {}
    elements: dict[DifferenceCause, dict[str, None]] = {}
    for cause in map(_told_unit, units):
        first.setdefault(_of_any(cause), cause)
    for cause in map(_told_unit, (*units, *acting)):
        if cause.element:
            elements.setdefault(_of_any(cause), {})[cause.element] = None
    for same, cause in first.items():
        of = [*elements.get(same, ())]
        shown = ", ".join(of[:MOST_CAUSES]) or None
        yield replace(cause, element=shown, others=len(of) - MOST_CAUSES)


def _of_any(cause: DifferenceCause) -> DifferenceCause:
    """Return a cause without element and step, to compare it with others."""
    return replace(cause, element=None, step=None)


def _told_unit(unit: CallUnit) -> DifferenceCause:
    x, y = (calls[0] if calls else None for calls in (unit.removed, unit.added))
    one = x or y
    assert one is not None
    about = next((each.about for each in (x, y) if each is not None and each.about), None)
    field, a, b = _apart(unit, x, y, one)
    return DifferenceCause(
        "call",
        field,
        about,
        a,
        b,
        site_a=None if x is None else x.site,
        site_b=None if y is None else y.site,
        step=unit.step or None,
    )


def _apart(
    unit: CallUnit, x: LoggedCall | None, y: LoggedCall | None, one: LoggedCall
) -> tuple[str, Value, Value]:
    """Return the name of a difference, and the value in each run."""
    if not unit.argument:
        a, b = (
            ", ".join(dict.fromkeys(call.function for call in calls)) or None
            for calls in (unit.removed, unit.added)
        )
        if x is None or y is None:  # a call that one run makes
            text = _call(one)
            a, b = (each and text for each in (a, b))
            return one.function, a, b
        return a or one.function, a, b
    if x is not None and y is not None and x.content and y.content:
        apart = [*attributes_apart(x.content, y.content)]
        if apart and isinstance(x.given.get(unit.argument), str):
            what, *values = apart[0]
            return f"{one.function}: {what}", _number(values[0]), _number(values[1])
    shown = [None if each is None else _shown(each.given.get(unit.argument)) for each in (x, y)]
    return f"{one.function}({unit.argument})", shown[0], shown[1]


def _call(call: LoggedCall) -> str:
    """Format a call as in the script, without its bodies."""
    given = [
        f"{name}={_shown(value)}"
        for name, value in call.given.items()
        if not (isinstance(value, list) and value and isinstance(value[0], str))
    ]
    more = ["…"] if len(given) > SHOWN else []
    return f"{call.function}({', '.join([*given[:SHOWN], *more])})"


def _names_of(calls: Sequence[LoggedCall]) -> str:
    names = dict.fromkeys(call.about or call.function for call in calls)
    return ", ".join([*names][:MOST_CAUSES])


def _shown(value: Any) -> float | str | None:  # noqa: ANN401 - an argument
    if value is None or isinstance(value, float | int):
        return value
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def _number(text: str | None) -> float | str | None:
    """Return a text from a file as a number, if it is one."""
    try:
        return text if text is None else float(text)
    except ValueError:
        return text
