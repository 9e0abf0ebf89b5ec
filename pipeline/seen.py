"""What was observed of a simulation run by another program, whatever its engine."""

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
    """Steps of its simulation before it."""
    time_s: float
    """Simulated time: the sum of these steps' timesteps."""
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
    """Of a mesh; empty if it has none."""
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
    """Content of a mesh's file; empty if it is not a mesh."""
    suffix: str
    """Suffix of that file."""


def counted_s(timestep_s: float) -> float:
    """Return what a step adds to the time [s]: nothing if its timestep is not finite."""
    return timestep_s if math.isfinite(timestep_s) else 0.0


Pose = tuple[tuple[float, ...], tuple[float, ...]]
"""Position [m], and orientation as a quaternion x, y, z, w."""


@dataclass(frozen=True)
class Joint:
    """What connects a link to its parent."""

    link: int
    name: str
    kind: str
    """`revolute`, `prismatic`, `spherical`, `planar`, `fixed`, or the engine's number."""
    parent: int
    """The parent link; -1 is the base."""
    widths: tuple[int, int, int]
    """How many positions, velocities and torques it has; none if it is fixed."""
    limits: tuple[float, float] = (0.0, -1.0)
    """Lowest and highest position [rad] or [m]; without limits, the highest is below the lowest."""


@dataclass(frozen=True)
class Body:
    """A body as it was added to the simulation."""

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
    """Whether it was loaded with sleeping enabled."""
    hides_links: bool = False
    """Whether it has links that the engine does not report: those of a btRigidBody."""
    bounds_m: tuple[float, ...] = ()
    """Axis-aligned boxes around base and links when it was added: low and high corners, six numbers
    each."""


@dataclass(frozen=True)
class Appearance:
    """A body was added, removed, began to move, or got other shapes or colours."""

    at: At
    body: Body
    there: bool
    came: bool = False
    """Whether it was added: a new body, even if it has the number of an earlier one."""
    sampled: bool = False
    """Whether its simulation had sampled this step before the body was added."""


@dataclass(frozen=True)
class Dynamics:
    """What the engine reports about a body."""

    at: At
    body: Body
    reported: Mapping[str, Float64]
    """Of base and links, shape (links + 1,) or (links + 1, k)."""


@dataclass(frozen=True)
class Settings:
    """What the engine reports about itself, and settings it was given but never reports."""

    at: At
    client: int
    values: Mapping[str, float | Sequence[float]]


@dataclass(frozen=True)
class Given:
    """Properties of a body that a call has set, some of which the engine never reports."""

    at: At
    body: Body
    values: Mapping[str, float | Sequence[float]]


@dataclass(frozen=True)
class Call:
    """What the script did to the world."""

    at: At
    """When it was made."""
    client: int
    """Number of its client."""
    function: str
    """Its name."""
    arguments: str
    """As the script might have written them; long ones shortened."""
    file: str
    """File of the call."""
    line: int
    """Counted from 1."""
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
    """The engine's number for it: velocity, torque, position …"""
    force: float
    """As given: a torque, or the maximum force of a motor [N] or [Nm]; nan if none."""


@dataclass(frozen=True)
class Solver:
    """How often the solver of a simulation stopped before it had converged."""

    at: At
    client: int
    iterations: int
    """Its limit."""
    looked: int
    """Steps with that limit whose solver was queried: every eighth."""
    steps: int
    """Of these, steps that used all iterations, and changed a velocity by over 0.01 in the last."""
    first_step: int
    last_change: float
    """The largest change of a velocity in a last iteration [m/s or rad/s]."""
    worst_step: int


@dataclass(frozen=True)
class Constraint:
    """A constraint between bodies that was created or removed."""

    at: At
    client: int
    number: int
    """The engine's id."""
    bodies: tuple[int, ...]
    """Numbers of the bodies that it holds, without the world; empty when it is removed."""
    there: bool


@dataclass(frozen=True)
class Put:
    """The state of a body after calls have moved it, before the next step."""

    at: At
    body: Body
    states: Rows
    """Of dtype `STATE`, a row for base and each link."""
    joints: Joints
    counts: bool
    """Whether the next step starts from it; not so if the first sample of all follows it."""


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
    """File and line that asked for it, and its size: images with the same ones form a sequence."""
    rgba: NDArray[np.uint8]
    """Shape (height, width, 4)."""
    view: tuple[float, ...]
    """Column by column, 16 numbers; empty if none was given."""
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
    """Calls of the script before the last sample."""
    states: Rows
    """Of dtype `STATE`: as many rows per step as there are moving parts."""
    contacts: Rows
    """Of dtype `CONTACT`."""
    bases: Mapping[int, Rows]
    """By body number, all parts of the moving bodies, of dtype `STATE`: for drawing."""
    joints: Mapping[int, Joints]
    """By body number."""


Event = (
    Appearance | Dynamics | Settings | Given | Call | Push | Motor | Solver | Constraint | Put
    | Image | Samples
)  # fmt: skip


@dataclass(frozen=True)
class Seen:
    """Everything observed of a script's simulations; lists in the order of events."""

    bodies: Mapping[int, Body]
    """By number, each as last seen."""
    appearances: list[Appearance]
    dynamics: list[Dynamics]
    given: list[Given]
    settings: list[Settings]
    pushes: list[Push]
    motors: list[Motor]
    solvers: list[Solver]
    """One for each simulation and iteration limit whose solver stopped early."""
    constraints: list[Constraint]
    calls: list[Call]
    puts: list[Put]
    samples: Mapping[int, int]
    """Number of samples of each simulation, by client; empty if unknown."""
    states: pl.DataFrame
    """One row per step and part, in the order of body, link and step."""
    contacts: pl.DataFrame
    """One row per contact point, in step order."""
    joints: Mapping[int, Joints]
    """By body number."""
    real_time: bool
    """Whether the script asked for real-time simulation, and was stepped by a clock instead."""
    unseeded: tuple[str, ...]
    """Where it drew unseeded random numbers."""
    machine: str
    """Kind of processor; empty if unknown."""

    @cached_property
    def parts(self) -> dict[tuple[int, int], pl.DataFrame]:
        """The states of each part, by body and link."""
        parts = self.states.partition_by("body", "link", as_dict=True, maintain_order=True)
        return {(int(body), int(link)): rows for (body, link), rows in parts.items()}

    @cached_property
    def by_body(self) -> dict[int, OfBody]:
        """What was seen of each body, by its number."""
        by_body = {number: OfBody() for number in self.bodies}
        for appearance in self.appearances:
            if appearance.came:
                by_body[appearance.body.number].came.append(appearance)
        for dynamics in self.dynamics:
            by_body[dynamics.body.number].dynamics.append(dynamics)
        for given in self.given:
            by_body[given.body.number].given.append(given)
        for push in self.pushes:
            by_body[push.body.number].pushes.append(push)
        for put in self.puts:
            by_body[put.body.number].puts.append(put)
        for constraint in self.constraints:
            for number in constraint.bodies:
                by_body[number].constraints.append(constraint)
        return by_body


@dataclass(frozen=True)
class OfBody:
    """What was seen of one body; lists in the order of events."""

    came: list[Appearance] = field(default_factory=list)
    """When it was added; several if a script loads it repeatedly."""
    dynamics: list[Dynamics] = field(default_factory=list)
    given: list[Given] = field(default_factory=list)
    pushes: list[Push] = field(default_factory=list)
    puts: list[Put] = field(default_factory=list)
    constraints: list[Constraint] = field(default_factory=list)
    """Those that were created."""

    @property
    def moves(self) -> list[Put]:
        """Where calls moved it after it was added: that is reported as a move, too."""
        came = {(each.at.step, each.at.call) for each in self.came}
        return [put for put in self.puts if (put.at.step, put.at.call) not in came]


@dataclass
class Ending:
    """How a watched program ended."""

    how: str = ""
    """`finished`, `steps`, `duration`, `interrupted` or `failed`."""
    error: str = ""
    """What failed, in a line."""
    notes: list[str] = field(default_factory=list)
    """What is worth knowing about the recording."""
    made_with: dict[str, Any] = field(default_factory=dict)
    """Versions, and whether time was virtual."""


def body_named(bodies: Iterable[Body], which: str) -> Body:
    """Return the only body of a number, name or label.

    Raises
    ------
    ScenarioError
        If there is none, or several have the name.
    """
    candidates = list(bodies)
    matches = [body for body in candidates if which in (str(body.number), body.label, body.name)]
    if len(matches) == 1:
        return matches[0]
    shown = matches or candidates
    listed = ", ".join(f"{body.number} ({body.name})" for body in shown[:10])
    listed += " …" if len(shown) > 10 else ""
    if matches:
        raise ScenarioError(
            "--body must be a body of the recording, got {which!r}, the name of several; "
            "use a number: {listed}",
            which=which,
            listed=listed,
        )
    raise ScenarioError(
        "--body must be a body of the recording, got {which!r}, which is none; it has: {listed}",
        which=which,
        listed=listed,
    )
