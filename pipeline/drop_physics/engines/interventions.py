"""The table of changes that can be suggested and tried: one row for each kind of change.

An engine's rows are in the module `interventions` of its folder; rows that all engines have are
here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from string import Formatter
from typing import Any

from drop_physics.engines.watching.single_changes import MOST_NAMES, Change
from drop_physics.messages import Message
from drop_physics.trace.cures import NUDGE, ChangedRun, Cure, Scope, whole_number
from drop_physics.trace.history import Seen

Operation = dict[str, Any]
"""One operation on a run, as passed to the engine's hooks."""
How = Sequence[Any]
"""An operator from `watching.operators` and its operand: `("*", 10)`."""
Becomes = Callable[[float | None], How]
"""Function from the number of a suggested change, or None, to the operation on a value."""
NOT_SAID = "…"
MORE = 10.0
"""Default factor by which a value is raised, for a suggested change without a number."""
AWAY = 1.001
"""Factor for the distance by which a body is moved away from another."""
FACTOR = "factor"
"""Variant of a change that applies a factor to the whole run: to all friction or masses, or to the
magnitude of gravity [m/s²]."""


def to(usual: object) -> Becomes:
    """Return a function that sets a value to a suggested number or, without one, to a default."""
    return lambda number: ("=", usual if number is None else number)


@dataclass(frozen=True)
class always:  # noqa: N801 - it reads as `to` does
    """An operation with a fixed value, whatever number a suggested change has."""

    operator: str
    value: object

    def __call__(self, _: float | None) -> How:
        """Return the operator and its value."""
        return self.operator, self.value


def raised(number: float | None) -> How:
    """Return the operation that sets a number or, without one, multiplies by a default."""
    return ("*", MORE) if number is None else ("=", number)


def times(number: float | None) -> How:
    """Return the operation that multiplies by a number."""
    return ("*", number or MORE)


@dataclass(frozen=True)
class ChangeRow:
    """A kind of change: its name, the code that a user would write, and how a run makes it."""

    name: str
    """Name for `--try`, followed by a colon and a variant, if there are several. Empty if only the
    search for causes uses the row."""
    sets: Mapping[str, Becomes] = field(default_factory=dict)
    """New values, by name of the argument or field."""
    _: KW_ONLY
    words: str = ""
    """Code that a user would write, with `{value}`; empty if the name is the code."""
    unsaid: Mapping[str, str] = field(default_factory=dict)
    """Values shown in the code if a change is tried by its name alone."""
    usual: float | None = None
    """Value for a suggested change without a number."""
    share: float = 1.0
    """Factor on the number of a suggested change, to stay below or above a limit."""
    decides: bool = False
    """Whether the intervention removes its cause entirely, so that a trial without effect refutes
    the cause."""
    whole_run: bool = False
    """Whether the change applies to the whole run, not to a body or joint."""
    needs: str = ""
    """Values that the change needs from a finding, by name in `Cure.given`."""
    below: str = ""
    """Argument of a `Variation` that gets the number, so that the script cannot notice the change.
    """
    tries: str = ""
    """Operators that the search for causes tries, in the format of `watching.single_changes`."""
    breaks: str = ""
    """Operators in `tries` that remove a part of the scene or of the command."""
    default: object = 0.0
    """The engine's default value, for the operator `=default`."""
    change: str = ""
    """Name of the argument or field that the search for causes changes; empty if it is the first
    name in `sets`."""
    is_geometry: bool = False
    """Whether the change concerns positions or sizes, which users seldom get wrong."""

    @property
    def tried(self) -> dict[str, Any]:
        """Description of this change for the search for causes, in the script's process."""
        return {
            "change": self.change,
            "tries": self.tries.split(),
            "breaks": self.breaks.split(),
            "default": self.default,
            "is_geometry": self.is_geometry,
        }

    def number(self, cure: Cure) -> float | None:
        """Return the number of a suggested change, or the default."""
        value = self.usual if cure.value is None else cure.value
        return None if value is None else value * self.share

    def changes(self, cure: Cure) -> dict[str, How]:
        """Return which arguments or fields change, and how."""
        number = self.number(cure)
        return {name: becomes(number) for name, becomes in self.sets.items()}

    def call_of(self, cure: Cure) -> str:
        """Return the code that a user would write to make a suggested change."""
        if not self.words:
            return cure.name
        known = self.known(cure)
        names = [name for _, name, _, _ in Formatter().parse(self.words) if name]
        return Message(self.words, **{name: known.get(name, NOT_SAID) for name in names})

    def known(self, cure: Cure) -> dict[str, Any]:
        """Return the values that may fill in a suggested change's code template, by name."""
        number = self.number(cure) or 0.0
        given = {
            name: ", ".join(map(str, each)) if isinstance(each, list) else each
            for name, each in cure.given.items()
        }
        return {**self.unsaid, **given, "value": number, "mm": 1e3 * number}

    def operations(self, cure: Cure, scope: Scope) -> Iterable[Operation]:
        """Return the operations by which the script's process makes a change."""
        del cure, scope
        return ()

    def applied(self, cure: Cure, scope: Scope) -> ChangedRun | None:
        """Return the run with a suggested change; None if that would change nothing."""
        if self.needs and self.needs not in cure.given:
            return None
        operations, number = [*self.operations(cure, scope)], self.number(cure)
        if not self.below:
            return ChangedRun(operations) if operations else None
        value = None if number is None else whole_number(number)
        return ChangedRun(operations, {self.below: value})


OPERATORS = {
    "=default": Message("as the engine has it"),
    "default": Message("not given"),
    "stiff": Message("as stiff as the timestep allows"),
    "held": Message("held at its first value"),
    "late": Message("a step late"),
    "exchanged": Message("exchanged"),
    "reversed": Message("in reverse order"),
    "undone": Message("not written"),
    "w-first": Message("with w first in each quaternion"),
    "w-last": Message("with w last in the quaternion"),
    "each-step": Message("repeated before each later step"),
    "left-out": Message("left out"),
    "*-1": Message("reversed"),
    "^": Message("switched"),
    "+M0": Message("raised by the joint's own inertia"),
    "+10M0": Message("raised by 10/s × the joint's own inertia"),
}
"""Descriptions of the operators of the search for causes."""


def done(op: str) -> str:
    """Describe the effect of an operator on a value, such as ×10."""
    if op in OPERATORS or op[0] == "^":
        return OPERATORS.get(op, OPERATORS["^"])
    signs = {"*": "×", "/": "÷", "=": "= "}
    return signs.get(op[0], op[0]) + op[1:]


def named(names: Sequence[str]) -> str:
    """Return the names of elements as text, or their number if there are many."""
    return ", ".join(names) if len(names) <= MOST_NAMES else Message("all {n}", n=len(names))


PARAMETER = ChangeRow("parameter", whole_run=True)
OF_ANY = (
    ChangeRow("nudge", below="nudge", usual=NUDGE, whole_run=True),
    ChangeRow("seed", below="draws", whole_run=True),
    PARAMETER,
)
"""The rows that every engine has."""


class Interventions:
    """An engine's table of changes.

    Parameters
    ----------
    rows
        The rows of the table.
    parameters
        The parameters that `parameter` can set, by name; for a choice, the names by number.
    set_parameter
        A function that returns a run with a parameter set, given its name and value.
    sees
        The operations with which a run reports the calls or inputs that the search for causes could
        change.
    trial_of
        A function that returns the `interventions` and the `variation` of a run with a single
        change.
    words_of
        A function that describes a single change in words.
    played
        A function that returns the operations that replace a simulation's commands between two
        samples by recorded ones.
    written_as
        A function that returns the XML attribute edited by a single change, and a pattern of the
        tags that have it; None if no attribute is edited.
    follows
        A function that returns the call that a user has to add after a single change between two
        steps; empty without one.
    """

    def __init__(
        self,
        rows: Iterable[ChangeRow],
        parameters: dict[str, Sequence[str]],
        set_parameter: Callable[[str, float], ChangedRun],
        sees: Sequence[Operation],
        trial_of: Callable[[Change], dict[str, Any]],
        words_of: Callable[[Change], str],
        played: Callable[[Seen, int, int, int], list[Operation]],
        written_as: Callable[[Change], tuple[str, str] | None] = lambda _: None,
        follows: Callable[[Change], str] = lambda _: "",
    ) -> None:
        every = (*rows, *OF_ANY)
        self.rows = {row.name: row for row in every if row.name}
        self.tried = [row.tried for row in every if row.tries or not row.name]
        """The rows that the search for causes tries."""
        self.trial_of, self.words_of, self.written_as = trial_of, words_of, written_as
        self.played = played
        self.follows = follows
        self.sees = sees
        """The operations with which a run reports the calls or inputs that changes could affect."""
        self.parameters = parameters
        self._set_parameter = set_parameter

    def row_of(self, cure: Cure) -> ChangeRow | None:
        """Return the row for a suggested change; None if the engine has none.

        For a cure with a number but no variant, the variant `given` is used, if there is one.
        """
        form = cure.form or ("given" if cure.value is not None else "")
        return self.rows.get(f"{cure.name}:{form}") or self.rows.get(cure.name)

    def call_of(self, cure: Cure) -> str:
        """Return the call or attribute that a user would write to make a suggested change."""
        row = self.row_of(cure)
        return cure.name if row is None else row.call_of(cure)

    def applied(self, cure: Cure, scope: Scope) -> ChangedRun | None:
        """Return the run with a suggested change; None if the engine does not support it."""
        if cure.name == PARAMETER.name:
            name, value = cure.given["name"], whole_number(cure.value or 0.0)
            return self._set_parameter(name, value) if name in self.parameters else None
        row = self.row_of(cure)
        return None if row is None else row.applied(cure, scope)
