"""The answer to why one run is not another: its claims, and their proof."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Class = Literal["none", "length", "start", "input", "host", "model", "settings", "step", "engines"]
"""Nothing; one of them ends early; the state at the start or as the script set it; what acts from
outside; the same, as the same text gave another number; the compiled model; the engine's options;
the engine's step; two engines."""
Value = float | tuple[float, ...] | str | None
What = Literal["state", "input", "field", "element", "order", "step", "call", "known"]


@dataclass(frozen=True)
class DifferenceCause:
    """One difference between two runs, and the bodies or elements that it acts on."""

    what: What
    """`state`, `input`: a number that was given before a step; `field`: of the compiled model, or
    an option; `element`: only one run has it; `order`: the same elements in another order; `step`:
    the engine makes another step of the same state; `call`: a call of the script; `known`: a known
    difference between two engines."""
    field: str | None = None
    """Name in the engine's own words; for a call the function, and an argument."""
    element: str | None = None
    """The thing that it is of."""
    a: Value = None
    """Value in the first run."""
    b: Value = None
    """Value in the second run."""
    site_a: str | None = None
    """File and line that set it in the first run."""
    site_b: str | None = None
    """File and line that set it in the second run."""
    step: int | None = None
    """The first step that it acts in."""
    stage: str | None = None
    """Stage of the step: `kinematics`, `collision`, `constraint`, `passive`, `actuator`, `bias`,
    `solver` or `integrator`."""
    pair: tuple[str, str] | None = None
    """The shapes that touch."""
    feature: str | None = None
    """Features of the engine without any one of which both make the same step."""
    detail: str = dataclasses.field(default="", metadata={"json": False})
    """The number that differs in a stage; how a value comes late; another's body."""
    bodies: tuple[str, ...] = dataclasses.field(default=(), metadata={"json": False})
    others: int = dataclasses.field(default=0, metadata={"json": False})
    """Number of further elements with the same field."""
    steps: int | None = dataclasses.field(default=None, metadata={"json": False})
    """Number of steps that it acts in, of a second cause."""
    follows: tuple[str, ...] = dataclasses.field(default=(), metadata={"json": False})
    """Fields that the engine derives from it, and that act, too."""


@dataclass(frozen=True)
class First:
    """The first difference."""

    step: int
    """The step after which states are apart; 0 is the first."""
    time_s: float
    """The clock of the first run after it."""
    bodies: list[str]
    """The bodies and joints that are apart."""
    size: float
    """The largest difference of one number."""
    unit: str
    """Unit of the size: `m`, `rad`, `m/s` or `rad/s`."""


@dataclass(frozen=True)
class SwapProof:
    """Proof of a cause."""

    by: str
    """Kind of swap: `inputs`, `state`, `fields`, `written`, `engine`, `calls` or `known`."""
    steps: int
    """Number of single steps that are then the first run's, or that differ, if by `engine`."""
    of: int
    """Number of steps that were judged."""
    exact: bool
    """Whether they are the same to the bit, rather than within the tolerance."""
    beyond_rounding: int | None = dataclasses.field(default=None, metadata={"json": False})
    """Number of steps that differ by more than rounding, if by `engine`."""
    term: str | None = dataclasses.field(default=None, metadata={"json": False})
    """The term that makes up for the difference, applied as a force."""


@dataclass(frozen=True)
class End:
    """Distance of the two runs at the end."""

    value: float
    """The largest distance of a body or joint."""
    unit: str
    """`m`, of positions; `rad`, of orientations and joints that turn."""
    body: str
    """The body or joint."""


@dataclass(frozen=True)
class Nudges:
    """The dependence of the end on the first difference: the effect of other nudges of its size."""

    size: float
    """Size of a nudge of the velocities."""
    ends: list[float]
    """Final distances from the first run, ascending."""


@dataclass(frozen=True)
class ProvedDifference:
    """The proved reason why one run is not another."""

    steps: tuple[int, int]
    same_until: int
    """The last step after which all positions and velocities are the same; -1: none."""
    same_until_s: float
    first: First | None
    cls: Class | None
    """None where nothing is proved."""
    because: Sequence[DifferenceCause] = ()
    also: Sequence[DifferenceCause] = ()
    proved: SwapProof | None = None
    end: End | None = None
    nudges: Nudges | None = None
    no_effect: Sequence[str] = ()
    undone: int = 0
    """Number of steps that the first run's own engine does not make again, and that are left
    out."""
    is_halted: bool = False
    """Whether the user did not wait for the rest."""
