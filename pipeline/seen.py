"""What was seen of a simulation that somebody else's program runs, whatever its engine."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from pipeline.errors import ScenarioError
from pipeline.states import Rows

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]


@dataclass(frozen=True)
class At:
    """When something was seen."""

    step: int
    """Steps made before it, by its simulation."""
    time_s: float
    """Simulated time: the timesteps of these steps added up."""
    call: int
    """Calls of the script before it."""


@dataclass(frozen=True)
class Shape:
    """What is drawn of a link."""

    link: int
    kind: str
    """`box`, `sphere`, `cylinder`, `capsule`, `mesh`, `plane`, or the engine's number."""
    size_m: tuple[float, ...]
    """Whole lengths of a box; radius of a sphere; length and radius; the scale of a mesh."""
    file: str
    """Of a mesh; empty where it has none."""
    position_m: tuple[float, ...]
    """Of its centre from the link's centre of mass, in the axes of the link's inertia."""
    orientation: tuple[float, ...]
    """Quaternion x, y, z, w, in the same axes."""
    rgba: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """A shape that can be drawn without the files that it was loaded from."""

    shape: Shape
    mesh: bytes
    """What the file of a mesh held; empty where it is none."""
    suffix: str
    """Of that file."""


def counted_s(timestep_s: float) -> float:
    """Return what a step adds to the time [s]: nothing where its timestep is not finite."""
    return timestep_s if math.isfinite(timestep_s) else 0.0


Pose = tuple[tuple[float, ...], tuple[float, ...]]
"""Position [m], and orientation as a quaternion x, y, z, w."""


@dataclass(frozen=True)
class Joint:
    """What holds a link to the one before it."""

    link: int
    name: str
    kind: str
    """`revolute`, `prismatic`, `spherical`, `planar`, `fixed`, or the engine's number."""
    parent: int
    """The link before it; -1 is the base."""
    widths: tuple[int, int, int]
    """How many positions, velocities and torques it has; none where it is fixed."""
    limits: tuple[float, float] = (0.0, -1.0)
    """Lowest and highest position [rad] or [m]; without any, the highest is the lower."""


@dataclass(frozen=True)
class Body:
    """A body as it came into the simulation."""

    number: int
    """In the recording: the engine's own id, unless another body had it before."""
    label: str
    """Name and number, as a part of an entity's path."""
    name: str
    engine_id: int
    client: int
    links: tuple[str, ...]
    """Names of base and links, in this order: link -1 is the first."""
    joints: tuple[Joint, ...]
    moving: tuple[int, ...]
    """The links that time can move; -1 is the base."""
    soft: bool
    shapes: tuple[Shape, ...]
    can_sleep: bool = False
    """Whether it was loaded such that it may fall asleep."""
    hides_links: bool = False
    """Whether it has links that the engine does not show: those of a btRigidBody."""
    bounds_m: tuple[float, ...] = ()
    """Boxes along the world's axes around base and links as they came: low and high corners, six
    numbers each."""


@dataclass(frozen=True)
class Appearance:
    """A body came, went, or got other shapes or colours."""

    at: At
    body: Body
    there: bool
    came: bool = False
    """Whether it came: as another body than any before, though it may have the number of one."""
    sampled: bool = False
    """Whether its simulation has a sample of this step from before it came."""


@dataclass(frozen=True)
class Dynamics:
    """What the engine reports of a body, and what it never reports but was told."""

    at: At
    body: Body
    reported: Mapping[str, Float64]
    """Of base and links, shape (links + 1,) or (links + 1, k)."""


@dataclass(frozen=True)
class Settings:
    """What the engine reports of itself, and what it never reports but was told."""

    at: At
    client: int
    values: Mapping[str, float | Sequence[float]]


@dataclass(frozen=True)
class Given:
    """Properties of a body that a call has set, some of which no engine reports."""

    at: At
    body: Body
    values: Mapping[str, float | Sequence[float]]


@dataclass(frozen=True)
class Call:
    """What the script did to the world."""

    at: At
    """When it was made."""
    client: int
    """Number of the client that it was for."""
    function: str
    """Its name."""
    arguments: str
    """As the script might have written them; long ones shortened."""
    file: str
    """Where the call stands."""
    line: int
    """From 1 on."""
    raised: str = ""
    """What it raised."""


@dataclass(frozen=True)
class Push:
    """A force or torque from outside, for one step."""

    at: At
    body: Body
    link: int
    torque: bool
    vector: tuple[float, ...]
    """Force [N] or torque [Nm]."""
    position_m: tuple[float, ...]
    """Where the force acts; nan for a torque."""
    in_world_axes: bool


@dataclass(frozen=True)
class Motor:
    """How a joint is driven from now on."""

    at: At
    body: Body
    joint: int
    mode: int
    """The engine's number of it: of velocity, torque, position …"""
    force: float
    """What was given: a torque, or the greatest force of a motor [N] or [Nm]; nan without any."""


@dataclass(frozen=True)
class Solver:
    """How often the solver of a simulation stopped while it still changed something."""

    at: At
    client: int
    iterations: int
    """That it might use."""
    looked: int
    """Steps with that limit of which it is known what the solver did: every eighth."""
    steps: int
    """In which it used all of them, and the last still changed a velocity by over 0.01."""
    first_step: int
    last_change: float
    """The most that a last iteration changed a velocity by [m/s or rad/s]."""
    worst_step: int


@dataclass(frozen=True)
class Constraint:
    """A constraint that came between bodies, or went."""

    at: At
    client: int
    number: int
    """The engine's id."""
    bodies: tuple[int, ...]
    """Numbers of what it holds; the world is not among it. None where it goes."""
    there: bool


@dataclass(frozen=True)
class Put:
    """The state of a body that calls have moved, before time goes on."""

    at: At
    body: Body
    states: Rows
    """Of dtype `STATE`, a row for base and each link."""
    joints: Joints
    counts: bool
    """Whether time goes on from here; not so where the first sample of all comes after it."""


@dataclass(frozen=True)
class Joints:
    """The joints of a body that move, at n samples."""

    steps: Int64
    times_s: Float64
    position: Float64
    """[rad] or [m], shape (n, positions)."""
    velocity: Float64
    """[rad/s] or [m/s], shape (n, velocities)."""
    torque: Float64
    """Of the motors: [Nm] or [N], shape (n, torques)."""


@dataclass(frozen=True)
class Image:
    """What the script's camera saw."""

    at: At
    client: int
    camera: str
    """File and line that asked for it, and its size: images of one camera follow each other."""
    rgba: NDArray[np.uint8]
    """Shape (height, width, 4)."""
    view: tuple[float, ...]
    """Column by column, 16 numbers; empty where none was given."""
    projection: tuple[float, ...]


@dataclass(frozen=True)
class Samples:
    """Consecutive samples of one simulation, in which the same bodies move."""

    client: int
    steps: Int64
    """Shape (n,)."""
    times_s: Float64
    """Shape (n,)."""
    call: int
    """Calls before the last of them."""
    states: Rows
    """Of dtype `STATE`: as many rows per step as there are parts that move."""
    contacts: Rows
    """Of dtype `CONTACT`."""
    bases: Mapping[int, Rows]
    """By body number, all parts of the bodies that move, of dtype `STATE`: for drawing."""
    joints: Mapping[int, Joints]
    """By body number."""


Event = (
    Appearance | Dynamics | Settings | Given | Call | Push | Motor | Solver | Constraint | Put
    | Image | Samples
)  # fmt: skip


@dataclass(frozen=True)
class Seen:
    """All that was seen of the simulations of a script; lists in the order in which it happened."""

    bodies: Mapping[int, Body]
    """By number, each as it was seen last."""
    appearances: list[Appearance]
    dynamics: list[Dynamics]
    given: list[Given]
    settings: list[Settings]
    pushes: list[Push]
    motors: list[Motor]
    solvers: list[Solver]
    """One of each simulation, and limit of iterations, whose solver stopped early."""
    constraints: list[Constraint]
    calls: list[Call]
    puts: list[Put]
    samples: Mapping[int, int]
    """How many samples each simulation has, by client; empty where that is not known."""
    states: pl.DataFrame
    """One row per step and part, in the order of body, link and step."""
    contacts: pl.DataFrame
    """One row per contact point, in step order."""
    joints: Mapping[int, Joints]
    """By body number."""
    real_time: bool
    """Whether the script asked for real-time simulation, and was stepped by a clock instead."""
    unseeded: tuple[str, ...]
    """Where it drew random numbers that nothing had seeded."""
    machine: str
    """Kind of processor; empty where that is not known."""

    @cached_property
    def parts(self) -> dict[tuple[int, int], pl.DataFrame]:
        """The states of each part, by body and link."""
        parts = self.states.partition_by("body", "link", as_dict=True, maintain_order=True)
        return {(int(body), int(link)): rows for (body, link), rows in parts.items()}

    @cached_property
    def by_body(self) -> dict[int, OfBody]:
        """What was told of each body, by its number."""
        found = {number: OfBody() for number in self.bodies}
        for appearance in self.appearances:
            if appearance.came:
                found[appearance.body.number].came.append(appearance)
        for dynamics in self.dynamics:
            found[dynamics.body.number].dynamics.append(dynamics)
        for given in self.given:
            found[given.body.number].given.append(given)
        for push in self.pushes:
            found[push.body.number].pushes.append(push)
        for put in self.puts:
            found[put.body.number].puts.append(put)
        for constraint in self.constraints:
            for number in constraint.bodies:
                found[number].constraints.append(constraint)
        return found


@dataclass(frozen=True)
class OfBody:
    """What was told of one body; lists in the order in which it happened."""

    came: list[Appearance] = field(default_factory=list)
    """When it came; again and again, where a script loads it again."""
    dynamics: list[Dynamics] = field(default_factory=list)
    given: list[Given] = field(default_factory=list)
    pushes: list[Push] = field(default_factory=list)
    puts: list[Put] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    """Those that came."""


@dataclass
class Ending:
    """How it ended."""

    how: str = ""
    """`finished`, `steps`, `duration`, `interrupted` or `failed`."""
    error: str = ""
    """What failed, in a line."""
    notes: list[str] = field(default_factory=list)
    """What is worth knowing of the recording."""
    made_with: dict[str, Any] = field(default_factory=dict)
    """Versions, and whether time was virtual."""


def body_named(bodies: Iterable[Body], which: str) -> Body:
    """Return the one body of a number, name or label.

    Raises
    ------
    ScenarioError
        If there is none, or several have the name.
    """
    there = list(bodies)
    found = [one for one in there if which in (str(one.number), one.label, one.name)]
    if len(found) != 1:
        named = ", ".join(f"{one.number} ({one.name})" for one in (found or there)[:10])
        many = "several are called that" if found else "there is none"
        raise ScenarioError(
            f"--body must be a body of the recording, got {which!r}: {many}; by number: {named}"
        )
    return found[0]
