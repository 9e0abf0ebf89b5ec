"""The common part of two runs, in columns that correspond, and the effects of single steps.

An engine delivers both: here is the form that it gives them, without a word of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

from drop_physics.arrays import Flags, Float64, Int64

Kind = Literal["motion", "hidden", "input", "edit"]
"""Positions and velocities; the rest of a state; what acts from outside; what is written into the
model while it runs."""


@dataclass(frozen=True, eq=False)
class Paired:
    """Numbers of one name in both runs, n steps in k columns that correspond."""

    name: str
    """The name in the engine's own words."""
    kind: Kind
    elements: Sequence[str]
    """The thing that each column is of."""
    before_a: Float64
    """Before each step, shape (n, k)."""
    before_b: Float64
    after_a: Float64 | None = None
    """After each step, shape (n, k); None for what no step changes."""
    after_b: Float64 | None = None
    units: Sequence[str] = ()
    """Units of the columns whose differences a reader is told: `m`, `rad`, `m/s`, `rad/s`."""
    is_setting: bool = False
    """Whether it is an option of the engine, written while it runs."""


class FieldApart(NamedTuple):
    """An element of the compiled models that differs between two runs."""

    field: str
    element: str
    """Name; empty for a field that has no elements."""
    of: str
    """Owner, such as the body of a shape; empty if that says no more."""
    a: tuple[float, ...]
    b: tuple[float, ...]
    is_derived: bool = False
    """Whether the engine computes it from other fields."""
    is_setting: bool = False
    """Whether it is an option of the engine rather than of something in the model."""
    is_structure: bool = False
    """Whether it says how elements hang together: such differences are swapped as one."""


class StageApart(NamedTuple):
    """The first stage of a step whose numbers differ between two engines."""

    stage: str
    """`kinematics`, `collision`, `constraint`, `passive`, `actuator`, `bias`, `solver` or
    `integrator`."""
    size: float
    """The largest difference, as a share of the largest number; infinite where counts differ."""
    what: str
    pair: tuple[str, str] | None = None
    """The shapes that touch."""
    bodies: tuple[str, ...] = ()
    """Their bodies that can move."""


@dataclass(frozen=True)
class TermPut:
    """A term of one engine, applied as a force in the other."""

    name: str
    left: float
    """The difference of velocities that is left, in the units of each."""


@dataclass(frozen=True, eq=False)
class EndApart:
    """The distance between two poses."""

    value: float
    unit: str
    body: str


@dataclass(frozen=True, eq=False)
class Common:
    """The common part of two runs."""

    engines: tuple[str, str]
    """Names and versions."""
    lengths: tuple[int, int]
    """Numbers of steps."""
    times_s: tuple[Float64, Float64]
    """The engine's clock after each step [s]."""
    columns: Sequence[Paired]
    fields: Sequence[FieldApart] = ()
    """The compiled elements that differ, and whose values can be swapped."""
    other_fields: Sequence[str] = ()
    """Names of fields that differ in form: they are not swapped."""
    only: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Elements that only one run has, `a` and `b`."""
    is_reordered: bool = False
    """Whether elements of the same names come in another order."""
    is_same_model: bool = False
    """Whether the compiled models are the same in all that a step reads."""

    moves_alone: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Those of them that move, or that the joints are of which move: `a` and `b`."""
    numbers: Int64 | None = None
    """The first run's number of each step that is compared; None if all are, in order."""
    count: int = -1
    """The number of steps that are compared; -1 for all that both make."""

    @property
    def steps(self) -> int:
        """The number of compared steps."""
        return min(self.lengths) if self.count < 0 else self.count

    def number(self, step: int) -> int:
        """Return the first run's number of a compared step."""
        return step if self.numbers is None or step < 0 else int(self.numbers[step])


class OneStep(Protocol):
    """Takes single steps of the second run's engine from states of the first."""

    common: Common

    def redone(self, *, whole: bool = False) -> Flags:
        """Return whether the first run's engine makes each of its steps again, shape (n,)."""

    def settled(self) -> Flags:
        """Flag the steps with a fully known hidden state, which can be judged, shape (n,)."""

    def crossed(
        self,
        steps: Int64,
        swapped: Sequence[int] = (),
        kept: Mapping[str, Sequence[int]] = {},
        *,
        whole: bool = False,
    ) -> Flags:
        """Return whether the second engine makes the first run's steps, from its states, (k,).

        Parameters
        ----------
        steps
            Which.
        swapped
            The fields, by number in `common.fields`, that have the first run's values.
        kept
            Columns of states and inputs, by name, that keep the second run's values.
        whole
            Whether hidden parts of the state count, too.
        """

    def sizes(self, steps: Int64, swapped: Sequence[int]) -> Float64:
        """Return the largest difference of velocities after each of these steps, shape (k,)."""

    def stages(
        self, steps: Int64, swapped: Sequence[int]
    ) -> list[tuple[StageApart, StageApart | None]]:
        """Return the first stage that differs in each of some steps, and the first beyond rounding.

        Raises
        ------
        DropError
            If a process ends before it is through.
        """

    def features(self, step: int, swapped: Sequence[int]) -> list[str]:
        """Return the features without any one of which both engines make the same step."""

    def term(self, step: int, swapped: Sequence[int]) -> TermPut | None:
        """Return the term whose difference, applied as a force, makes up for a step's."""

    def nudged(self, step: int, size: float, count: int) -> tuple[bool, list[float]]:
        """Continue the first run from a step, with its inputs and nudged velocities.

        Returns whether the unnudged run equals the first run to the bit, and the final distances of
        the nudged ones, ascending.
        """

    def apart(self, step: int) -> EndApart:
        """Return the place and size of the largest distance between the runs after a step."""
