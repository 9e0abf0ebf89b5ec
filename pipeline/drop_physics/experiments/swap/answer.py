"""The result of a comparison of two runs: the causes of differences, and their proof."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Class = Literal["none", "length", "start", "input", "host", "model", "settings", "step", "engines"]
"""Kind of difference: none; one run ends early; the state at the start or as the script set it;
external inputs; the same, but from equal script text; the compiled model; the engine's options; the
engine's step; two engines."""
Value = float | tuple[float, ...] | str | None
What = Literal["state", "input", "field", "element", "order", "step", "call", "known"]


@dataclass(frozen=True)
class DifferenceCause:
    """One cause of a difference between runs, and the bodies or elements that it is about."""

    what: What
    """Kind of cause. `state`: a start state or a state set by the script; `input`: a number set
    before a step, such as a control; `field`: a field of the compiled model, or an option;
    `element`: an element that only one run has; `order`: the same elements in another order;
    `step`: the engine makes another step from the same state; `call`: a call of the script;
    `known`: a known difference between two engines."""
    field: str | None = None
    """The engine's name of the input or field; for a call, the function and an argument."""
    element: str | None = None
    """Name of the element, such as a joint or geom, that the value belongs to."""
    a: Value = None
    """Value in the first run."""
    b: Value = None
    """Value in the second run."""
    site_a: str | None = None
    """File and line that set the value in the first run."""
    site_b: str | None = None
    """File and line that set the value in the second run."""
    step: int | None = None
    """First step in which the cause acts."""
    stage: str | None = None
    """Stage of the step: `kinematics`, `collision`, `constraint`, `passive`, `actuator`, `bias`,
    `solver` or `integrator`."""
    pair: tuple[str, str] | None = None
    """The pair of touching shapes."""
    feature: str | None = None
    """Engine features: without any one of them, both engines make the same step."""
    detail: str = dataclasses.field(default="", metadata={"json": False})
    """Further detail: the number that differs in a stage; which run sets a value later; another
    element's body."""
    bodies: tuple[str, ...] = dataclasses.field(default=(), metadata={"json": False})
    others: int = dataclasses.field(default=0, metadata={"json": False})
    """Number of further elements whose same field differs."""
    steps: int | None = dataclasses.field(default=None, metadata={"json": False})
    """Number of steps in which the cause acts; only for a second cause."""
    follows: tuple[str, ...] = dataclasses.field(default=(), metadata={"json": False})
    """Fields that the engine derives from this one, and that also act."""


@dataclass(frozen=True)
class First:
    """The first difference between two runs."""

    step: int
    """The step after which the states differ; 0 is the first step."""
    time_s: float
    """Clock of the first run after this step."""
    bodies: list[str]
    """Bodies and joints that differ."""
    size: float
    """Largest difference of a single number, in `unit`."""
    unit: str
    """Unit of that difference: `m`, `rad`, `m/s` or `rad/s`."""


@dataclass(frozen=True)
class SwapProof:
    """The proof of a cause, by swapping it between the runs."""

    by: str
    """What is swapped: `inputs`, `state`, `fields`, `written`, `engine`, `calls` or `known`."""
    steps: int
    """Number of single steps that equal the first run's after the swap; for `engine`, that
    differ."""
    of: int
    """Number of steps that were tested."""
    exact: bool
    """Whether these steps are equal bit for bit, rather than within the tolerance."""
    beyond_rounding: int | None = dataclasses.field(default=None, metadata={"json": False})
    """Number of steps that differ by more than rounding, for `engine`."""
    term: str | None = dataclasses.field(default=None, metadata={"json": False})
    """The term of the sum that compensates the difference if applied as a force."""


@dataclass(frozen=True)
class End:
    """How far the two runs are apart at the end."""

    value: float
    """Largest distance of a body or joint."""
    unit: str
    """`m` for positions; `rad` for orientations and revolute joints."""
    body: str
    """Name of that body or joint."""


@dataclass(frozen=True)
class Nudges:
    """How far random changes of the first difference's size move the end."""

    size: float
    """Size of each nudge of the velocities."""
    ends: list[float]
    """Final distances from the first run, ascending."""


@dataclass(frozen=True)
class ProvedDifference:
    """The proved reason why two runs differ."""

    steps: tuple[int, int]
    same_until: int
    """Last step after which all positions and velocities are still the same; -1 if none is."""
    same_until_s: float
    first: First | None
    cls: Class | None
    """Kind of difference; None if nothing is proved."""
    because: Sequence[DifferenceCause] = ()
    also: Sequence[DifferenceCause] = ()
    proved: SwapProof | None = None
    end: End | None = None
    nudges: Nudges | None = None
    no_effect: Sequence[str] = ()
    undone: int = 0
    """Number of steps left out because the first run's own engine does not reproduce them."""
    is_halted: bool = False
    """Whether the user stopped the search early."""
