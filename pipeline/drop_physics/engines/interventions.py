"""The table of changes that can be suggested and tried: one row for each kind of change.

The rows of an engine are in its own folder (`interventions`); those of all engines are here.
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
"""Function from a fix's number, or None, to the operation on a value."""
NOT_SAID = "…"
MORE = 10.0
"""Default factor by which a value is raised, if the fix gives no number."""
AWAY = 1.001
"""Factor for the distance by which a body is moved away from another."""
FACTOR = "factor"
"""Variant of a fix that changes a factor for the whole run: of all friction or masses, or the
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
    """The name, as `--try` takes it; after a colon its variant, if there are several. Empty if only
    the causal search uses the row."""
    sets: Mapping[str, Becomes] = field(default_factory=dict)
    """New values, by name of the argument or field."""
    _: KW_ONLY
    words: str = ""
    """The code that a user would write, with `{value}`; the name if empty."""
    unsaid: Mapping[str, str] = field(default_factory=dict)
    """Value shown in the code if a fix is tried by its name alone."""
    usual: float | None = None
    """The value used for a fix without a number."""
    share: float = 1.0
    """Factor applied to a fix's number if that is a limit, to stay below or above it."""
    decides: bool = False
    """Whether the intervention removes its cause entirely, so that a trial without effect refutes
    the cause."""
    whole_run: bool = False
    """Whether it applies to the whole run, not to a body or joint."""
    needs: str = ""
    """Values that only the finding knows, by their names in `Cure.given`."""
    below: str = ""
    """The argument of a `Variation` that receives its value, invisible to the script."""
    tries: str = ""
    """The operators that the causal search tries, in the format of `watching.single_changes`."""
    breaks: str = ""
    """The operators in `tries` that remove a part of the scene or of the command."""
    default: object = 0.0
    """The engine's default value, for the operator `=default`."""
    change: str = ""
    """Target of the search's change, if it is not the first one in `sets`."""
    is_geometry: bool = False
    """Whether it changes positions or sizes, which users seldom get wrong."""

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
        """Return the operations that the engine's hooks carry out to make a change."""
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
"""Descriptions of the causal search's operators."""


def done(op: str) -> str:
    """Describe what an operator does to a value, such as ×10."""
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
        Its rows.
    parameters
        What `parameter` sets, by name; if it is a choice, the names by their numbers.
    set_parameter
        Returns a run with a parameter of some name and value.
    sees
        The operations of a run that is seen by the causal search.
    trial_of
        Returns what differs in a run with a single change: its `interventions` and its `variation`.
    words_of
        Returns a single change in words.
    played
        Returns the operations that replace the commands between two samples of a simulation by the
        recorded ones.
    written_as
        Returns the attribute that a single change is of, and a pattern of the tags that have it;
        None if it is of none.
    follows
        Returns the call that a user has to add where a single change is made between two steps;
        empty if there is none.
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
        """The rows that the causal search tries."""
        self.trial_of, self.words_of, self.written_as = trial_of, words_of, written_as
        self.played = played
        self.follows = follows
        self.sees = sees
        """The operations of a run in which it is seen what they would change."""
        self.parameters = parameters
        self._set_parameter = set_parameter

    def row_of(self, cure: Cure) -> ChangeRow | None:
        """Return the row for a suggested change; None if the engine has none.

        A row of the form `given` takes numbers of cures without a form.
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
