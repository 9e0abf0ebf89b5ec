"""Interface to compare two runs: their common columns, and steps with swapped values.

Each engine implements this interface; it contains no term that only one engine uses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

from drop_physics.arrays import Flags, Float64, Int64

Kind = Literal["motion", "hidden", "input", "edit"]
"""Kind of a compared number: a position or velocity; another part of the state; an external input;
or a model field written during the run."""


@dataclass(frozen=True, eq=False)
class Paired:
    """One quantity in both runs: n steps in k corresponding columns."""

    name: str
    """The engine's name for the quantity."""
    kind: Kind
    elements: Sequence[str]
    """The model element to which each column belongs."""
    before_a: Float64
    """First run's values before each step, shape (n, k)."""
    before_b: Float64
    after_a: Float64 | None = None
    """First run's values after each step, shape (n, k); None for quantities that no step changes.
    """
    after_b: Float64 | None = None
    units: Sequence[str] = ()
    """Units of the columns whose differences are reported: `m`, `rad`, `m/s`, `rad/s`."""
    is_setting: bool = False
    """Whether the quantity is an engine option that is written during the run."""


class FieldApart(NamedTuple):
    """A model element whose compiled values differ between two runs."""

    field: str
    element: str
    """Name of the element; empty for a field without elements."""
    of: str
    """Owner of the element, such as the body of a shape; empty if it adds no information."""
    a: tuple[float, ...]
    b: tuple[float, ...]
    is_derived: bool = False
    """Whether the engine computes the field from other fields."""
    is_setting: bool = False
    """Whether the field is an engine option, not a property of the model."""
    is_structure: bool = False
    """Whether the field describes how elements are connected: such differences are swapped
    together."""


class StageApart(NamedTuple):
    """The first stage of a step whose numbers differ between two engines."""

    stage: str
    """`kinematics`, `collision`, `constraint`, `passive`, `actuator`, `bias`, `solver` or
    `integrator`."""
    size: float
    """The largest difference, as a share of the largest number; infinite if the counts differ."""
    what: str
    pair: tuple[str, str] | None = None
    """Names of the two shapes that touch."""
    bodies: tuple[str, ...] = ()
    """The movable bodies to which the two shapes belong."""


@dataclass(frozen=True)
class TermPut:
    """A force term of one engine, applied in the other as an external force."""

    name: str
    left: float
    """The largest remaining velocity difference, each velocity in its own unit."""


@dataclass(frozen=True, eq=False)
class EndApart:
    """Distance between the final states of two runs, and the coordinate in which it occurs."""

    value: float
    unit: str
    body: str


@dataclass(frozen=True, eq=False)
class Common:
    """Common steps and columns of two compared runs, and the differences between their models."""

    engines: tuple[str, str]
    """Engine name and version of each run."""
    lengths: tuple[int, int]
    """Number of steps of each run."""
    times_s: tuple[Float64, Float64]
    """The engine's clock after each step [s]."""
    columns: Sequence[Paired]
    fields: Sequence[FieldApart] = ()
    """The fields of compiled elements that differ and whose values can be swapped."""
    other_fields: Sequence[str] = ()
    """Names of fields whose structure differs, so that they cannot be swapped."""
    only: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Elements that only one run has, by run: `a` and `b`."""
    is_reordered: bool = False
    """Whether elements with the same names have another order."""
    is_same_model: bool = False
    """Whether the compiled models are equal in all fields that a step uses."""

    moves_alone: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Elements that only one run has and that move, or whose joints move, by run: `a` and `b`."""
    numbers: Int64 | None = None
    """The first run's index of each compared step; None if all steps are compared, in order."""
    count: int = -1
    """The number of compared steps; -1 for all that both runs make."""

    @property
    def steps(self) -> int:
        """The number of compared steps."""
        return min(self.lengths) if self.count < 0 else self.count

    def number(self, step: int) -> int:
        """Return the first run's index of a compared step."""
        return step if self.numbers is None or step < 0 else int(self.numbers[step])


class OneStep(Protocol):
    """Makes single steps with the second run's engine from states of the first run."""

    common: Common

    def redone(self, *, whole: bool = False) -> Flags:
        """Return whether the first run's engine reproduces each of its steps, shape (n,)."""

    def settled(self) -> Flags:
        """Flag the steps whose hidden state is fully known, so they can be judged, shape (n,)."""

    def crossed(
        self,
        steps: Int64,
        swapped: Sequence[int] = (),
        kept: Mapping[str, Sequence[int]] = {},
        *,
        whole: bool = False,
    ) -> Flags:
        """Return whether the second engine reproduces the first run's steps from its states, (k,).

        Parameters
        ----------
        steps
            The indices of the steps.
        swapped
            The fields, by index in `common.fields`, that get the first run's values.
        kept
            Columns of states and inputs, by name, that keep the second run's values.
        whole
            Whether hidden parts of the state must agree, too.
        """

    def sizes(self, steps: Int64, swapped: Sequence[int]) -> Float64:
        """Return the largest velocity difference between the engines after each step, (k,)."""

    def stages(
        self, steps: Int64, swapped: Sequence[int]
    ) -> list[tuple[StageApart, StageApart | None]]:
        """Return each step's first computation stage that differs, and first beyond rounding.

        Raises
        ------
        DropError
            If an engine's process ends early.
        """

    def features(self, step: int, swapped: Sequence[int]) -> list[str]:
        """Return the engine features that, if disabled, make both engines' steps agree."""

    def term(self, step: int, swapped: Sequence[int]) -> TermPut | None:
        """Return the force term that explains why both engines' steps differ, if there is one."""

    def nudged(self, step: int, size: float, count: int) -> tuple[bool, list[float]]:
        """Repeat the first run from a step on with slightly changed velocities.

        Returns whether the repetition without a change equals the first run to the bit, and the
        final distances of the changed repetitions, ascending.
        """

    def apart(self, step: int) -> EndApart:
        """Return the coordinate in which the runs differ most after a step, and by how much."""
