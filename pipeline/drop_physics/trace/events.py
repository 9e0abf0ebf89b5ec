"""The events of a simulation run by another program, whatever its engine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Float64, Int64
from drop_physics.messages import Message
from drop_physics.physics.tree import places
from drop_physics.trace.acts import Act, act_of
from drop_physics.trace.frames import Frames, ModelPart
from drop_physics.trace.readings import Answer, Reading
from drop_physics.trace.states import Joints, Rows


@dataclass(frozen=True)
class At:
    """The moment of an event."""

    step: int
    """Number of steps of its simulation before it."""
    time_s: float
    """Simulated time: the sum of these steps' timesteps."""
    call: int
    """Number of calls of the script before it."""


def order(at: At) -> tuple[int, int]:
    """Return the sort key of a moment."""
    return at.step, at.call


@dataclass(frozen=True)
class Shape:
    """The visible shape of a link."""

    link: int
    kind: str
    """`box`, `sphere`, `ellipsoid`, `cylinder`, `capsule`, `mesh`, `plane`, or the engine's
    number."""
    size_m: tuple[float, ...]
    """Whole lengths of a box or an ellipsoid; radius of a sphere; length and radius; scale of a
    mesh; for a plane of which only a part is drawn, its two sides."""
    file: str
    """File of a mesh; empty if it has none."""
    position_m: tuple[float, ...]
    """Position of its centre from the link's centre of mass, in the axes of the link's inertia."""
    orientation: tuple[float, ...]
    """Quaternion x, y, z, w, in the same axes."""
    rgba: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """A shape that can be drawn without the files from which it was loaded."""

    shape: Shape
    mesh: bytes
    """Content of a mesh's file; empty if it is not a mesh."""
    suffix: str
    """Suffix of that file."""


def counted_s(timestep_s: float) -> float:
    """Return the time that a step adds [s]: nothing if its timestep is not finite."""
    return timestep_s if math.isfinite(timestep_s) else 0.0


Pose = tuple[tuple[float, ...], tuple[float, ...]]
"""Position [m], and orientation as a quaternion x, y, z, w."""


@dataclass(frozen=True)
class Joint:
    """The joint between a link and its parent."""

    link: int
    name: str
    kind: str
    """`revolute`, `prismatic`, `spherical`, `planar`, `fixed`, or the engine's number."""
    parent: int
    """The parent link; -1 is the base."""
    widths: tuple[int, int, int]
    """Number of positions, velocities and efforts; all 0 for a fixed joint."""
    limits: tuple[float, float] = (0.0, -1.0)
    """Lowest and highest position [rad] or [m]; without limits, the highest is below the lowest."""
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Direction that it turns about or slides along, in the axes of its link's inertia."""
    parent_position_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Position of the joint from the parent's centre of mass, in the axes of the parent's
    inertia."""
    parent_orientation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    """Rotation from the axes of the parent's inertia to those of its link's, at position 0."""
    damping: float = 0.0
    """[N m s/rad] or [N s/m]."""
    friction: float = 0.0
    effort: float = 0.0
    """Largest effort of the real joint, by its file [N m] or [N]; 0 if the file gives none."""
    velocity: float = 0.0
    """Largest velocity of the real joint, by its file [rad/s] or [m/s]; 0 likewise."""


@dataclass(frozen=True)
class Collision:
    """The collision shape of a link."""

    link: int
    kind: str
    """The same kinds as of a `Shape`."""
    size_m: tuple[float, ...]
    """Size as the engine reports it: whole lengths of a box; length and radius; scale of a mesh."""
    file: str
    """File of a mesh, without its folder; empty if there is none."""
    position_m: tuple[float, ...]
    """Position of its centre from the link's centre of mass, in the axes of the link's inertia."""
    orientation: tuple[float, ...]
    hull_m: tuple[float, ...] = ()
    """Corners of the convex hull that the engine uses in place of a mesh, three numbers each."""
    bits: tuple[int, int] | None = None
    """Collision group and mask: two shapes may touch if one's group and the other's mask share a
    bit. None if the engine has no such filter."""


@dataclass(frozen=True)
class FileLink:
    """A link's data in a body's file."""

    name: str
    mass_kg: float
    """Mass; nan if the file has no `<inertial>`."""
    inertia_kg_m2: tuple[float, ...]
    """xx, xy, xz, yy, yz, zz about the centre of mass; empty if it says nothing."""
    position_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Position of the centre of mass in the link's frame."""
    rpy_rad: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Orientation of the axes of that inertia."""


@dataclass(frozen=True)
class Mimic:
    """A joint that should follow another one, by its file."""

    joint: str
    of: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class FileDamping:
    """The damping of a joint, by its file."""

    joint: str
    damping: float
    """[N m s/rad] or [N s/m]."""


@dataclass(frozen=True)
class FileRequests:
    """Requests in a body's file that an engine may ignore."""

    scale: float = 1.0
    """Factor by which a call scaled the whole body."""
    links: tuple[FileLink, ...] = ()
    mimics: tuple[Mimic, ...] = ()
    dampings: tuple[FileDamping, ...] = ()
    """Joint dampings that the file asks for, and the engine may not read."""


@dataclass(frozen=True)
class Actuator:
    """A motor with a law of its own, which the engine evaluates in each step."""

    name: str
    number: int
    """Number in the simulation."""
    kind: str
    """`motor`, `position`, `velocity`, `muscle` or `general`."""
    acts_on: str
    """`joint`, `tendon`, `site`, `slider-crank` or `body`."""
    target: str
    """Name of the joint, tendon, site or body that it acts on."""
    gear: float
    kp: float
    """Gain of its control; for a position servo its stiffness."""
    kv: float
    """Damping, if its force has such a part."""
    ctrl_range: tuple[float, float] | None
    """The control is clamped to this range; None if it is not."""
    force_range: tuple[float, float] | None
    """The force is clamped to this range; None if it is not."""


@dataclass(frozen=True)
class Keyframe:
    """A named pose of a model."""

    name: str
    joints: tuple[float, ...]
    """Positions of the body's joints."""
    given: tuple[float, ...]
    """Controls of its actuators."""


@dataclass(frozen=True)
class Body:
    """A body as it was added to the simulation."""

    number: int
    """Number in the recording: the engine's own id, unless another body had it before."""
    label: str
    """Name and number, as a part of an entity's path."""
    name: str
    engine_id: int
    client: int
    links: tuple[str, ...]
    """Names of base and links, in this order: the first is that of link -1."""
    joints: tuple[Joint, ...]
    moving: tuple[int, ...]
    """The links that can move in a step; -1 is the base."""
    soft: bool
    shapes: tuple[Shape, ...]
    can_sleep: bool = False
    """Whether it was loaded with sleeping enabled."""
    hides_links: bool = False
    """Whether it has links that the engine does not report: those of a btRigidBody."""
    bounds_m: tuple[float, ...] = ()
    """Axis-aligned boxes around base and links when it was added: low and high corners, six numbers
    each."""
    collisions: tuple[Collision, ...] = ()
    asked: FileRequests = FileRequests()
    flags: int = 0
    """The flags that it was loaded with; 0 if they are unknown."""
    before: bool = False
    """Whether it existed before the recording began; what calls had set on it is not known."""
    actuators: tuple[Actuator, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()
    apart: tuple[tuple[int, int, int], ...] = ()
    """The contacts that its model excludes: own link, number of the other body, and its link."""
    node_of: str = ""
    """The flexible body that it is a node of; empty if it is none."""

    @cached_property
    def coordinates(self) -> tuple[slice, ...]:
        """The slice of each joint's coordinates among those of all joints."""
        return places(joint.widths[0] for joint in self.joints)

    @cached_property
    def rates(self) -> tuple[slice, ...]:
        """The slice of each joint's rates among those of all joints."""
        return places(joint.widths[1] for joint in self.joints)

    def rate_of(self, actuator: Actuator) -> int | None:
        """Return the rate of the joint that an actuator drives.

        None where it drives something else, or a joint that has several.
        """
        return self._rates_by_joint.get(actuator.target) if actuator.acts_on == "joint" else None

    @cached_property
    def _rates_by_joint(self) -> dict[str, int]:
        return {
            joint.name: place.start
            for joint, place in zip(self.joints, self.rates, strict=True)
            if joint.widths[1] == 1
        }

    @property
    def base_moves(self) -> bool:
        """True if its base can move in a step; its state is then sampled."""
        return -1 in self.moving


@dataclass(frozen=True)
class Appearance:
    """A body that was added, removed, began to move, or changed its shapes or colours."""

    at: At
    body: Body
    there: bool
    came: bool = False
    """Whether it was added: a new body, even if it has the number of an earlier one."""
    sampled: bool = False
    """Whether its simulation had sampled this step before the body was added."""


GIVEN = {"linear_damping": "linearDamping", "angular_damping": "angularDamping"}
"""Properties in the Dynamics of a drop's body that it was given, and that no engine reports, with
the argument that sets each."""


@dataclass(frozen=True)
class Dynamics:
    """An engine's report of a body."""

    at: At
    body: Body
    reported: Mapping[str, Float64]
    """Values of base and links, shape (links + 1,) or (links + 1, k)."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a hollow mesh that the engine replaces by its convex hull."""

    at: At
    body: int
    """Number of the body."""
    shape: int
    """Index of the shape among its collisions."""
    corners_m: Float64
    """Corners in the axes of the link's inertia, shape (n, 3)."""
    triangles: Int64
    """Indices of the corners of each triangle, shape (m, 3)."""


@dataclass(frozen=True)
class Settings:
    """The engine's reported settings, and given settings that it never reports."""

    at: At
    client: int
    values: Mapping[str, float | Sequence[float]]
    engine: str = ""
    """Name and version of the engine; empty for PyBullet."""


def located(file: str, line: int) -> str:
    """Return a place as `arm.py:13`, which terminals link; in a notebook as `In[3], line 13`."""
    return f"{file}, line {line}" if file.startswith("In[") else f"{file}:{line}"


@dataclass(frozen=True)
class Site:
    """A line of the script that calls a function of the engine, with arguments of one form."""

    number: int
    """Number in the recording, in the order of the first calls."""
    function: str
    file: str
    """File of the call, without folders of this machine; a notebook's cell is `In[3]`."""
    line: int
    """Line number, from 1."""
    form: str
    """The arguments as written, with `{}` for each number; other arguments are left in it."""
    names: tuple[str, ...]
    """The argument that each number belongs to; the numbers of a vector share a name."""
    whole: tuple[bool, ...]
    """Whether each number was a whole one in the first call."""

    @property
    def act(self) -> Act:
        """The meaning of its calls."""
        return act_of(self.function)

    @property
    def place(self) -> str:
        """File and line, as findings cite them."""
        return located(self.file, self.line)

    @cached_property
    def places(self) -> Mapping[str, slice]:
        """The slice of each argument's numbers."""
        places: dict[str, slice] = {}
        for k, name in enumerate(self.names):
            places[name] = slice(places[name].start if name in places else k, k + 1)
        return places


@dataclass(frozen=True)
class Calls:
    """Consecutive calls that change a simulation, m of them."""

    client: int
    steps: Int64
    """Number of steps of the simulation before each, shape (m,)."""
    times_s: Float64
    """Shape (m,)."""
    calls: Int64
    """Number of calls of the script before each, shape (m,)."""
    sites: Int64
    """Number of the site of each, shape (m,)."""
    numbers: Float64
    """The numbers in all their arguments, one call after the other."""
    results: Float64
    """The returned numbers; nan for calls that returned none."""


def widths_of(seen: Calls, sites: Mapping[int, Site]) -> Int64:
    """Return the number of numbers of each call, shape (m,)."""
    known, which = np.unique(seen.sites, return_inverse=True)
    return np.array([len(sites[site].names) for site in known.tolist()], np.int64)[which]


@dataclass(frozen=True)
class Raised:
    """A failed call."""

    at: At
    """The moment of the call."""
    error: str
    """Type and message."""


@dataclass(frozen=True)
class SolverStop:
    """The number of times that a simulation's solver stopped before it had converged."""

    at: At
    client: int
    iterations: int
    """The iteration limit."""
    looked: int
    """Number of steps with that limit whose solver was queried: every eighth."""
    steps: int
    """Number of these that used all iterations, and changed a velocity by over 0.01 in the last."""
    first_step: int
    last_change: float
    """The largest change of a velocity in a last iteration [m/s or rad/s]."""
    worst_step: int


@dataclass(frozen=True)
class Put:
    """The state of a body after calls have moved it, before the next step."""

    at: At
    body: Body
    base: Float64
    """Position, orientation, velocity, spin: shape (13,)."""
    position: Float64
    """Positions of its joints [rad] or [m], shape (positions,)."""
    velocity: Float64
    """Velocities of its joints [rad/s] or [m/s]."""
    effort: Float64
    """Efforts of its joints [N m] or [N]."""
    counts: bool
    """Whether the next step starts from it; False if the first sample of all follows it."""

    @property
    def joints(self) -> Joints:
        """The joints as a sample."""
        rows = (each[None] for each in (self.position, self.velocity, self.effort))
        return Joints(np.array([self.at.step]), np.array([self.at.time_s]), *rows)


@dataclass(frozen=True)
class Image:
    """A picture by the script's camera."""

    at: At
    client: int
    camera: str
    """File and line of the call, and the size: images that share these form a sequence."""
    rgba: NDArray[np.uint8]
    """Shape (height, width, 4)."""
    view: tuple[float, ...]
    """View matrix column by column, 16 numbers; empty if none was given."""
    projection: tuple[float, ...]


@dataclass(frozen=True)
class Samples:
    """Consecutive samples of one simulation, with the same moving bodies."""

    client: int
    steps: Int64
    """Shape (n,)."""
    times_s: Float64
    """Shape (n,)."""
    call: int
    """Number of calls of the script before the last sample."""
    bases: Mapping[int, Float64]
    """States of the bases that can move, by body number: position, orientation (x, y, z, w),
    velocity, spin; shape (n, 13)."""
    joints: Mapping[int, Joints]
    """Joints by body number."""
    contacts: Rows
    """The contact points, of dtype `CONTACT`."""
    constraints: Mapping[int, Float64]
    """Forces of each constraint [N] or [N m], shape (n, k), by the engine's id."""


@dataclass(frozen=True)
class ImpulseCause:
    """A source of impulses on a body, as its engine names it."""

    at: At
    number: int
    """Number in the recording."""
    client: int
    body: int
    """The number of the body that it acts on."""
    kind: str
    """`gravity`, `bias`, `spring`, `actuator`, `contact` …"""
    name: str
    """Name of the actuator, tendon, joint or equality; label of the other body in a contact."""
    places: tuple[int, ...]
    """The degrees of freedom that it acts on, as indices into the body's generalised velocity."""


@dataclass(frozen=True)
class PairFriction:
    """The coefficient of friction of two links that touch."""

    at: At
    client: int
    body_a: int
    link_a: int
    body_b: int
    link_b: int
    friction: float
    """Coefficient of friction; nan if several points of the pair have different ones."""
    solref: tuple[float, ...] = ()
    """Softness of the contact: time constant [s] and damping ratio, or stiffness and damping."""
    solimp: tuple[float, ...] = ()
    """Impedance of the contact: first and last value, depth [m] over which it rises …"""
    condim: int = 3
    """Dimensions of the contact force: 1 without friction, 3 sliding, 4 spinning, 6 rolling."""
    rolling: float = 0.0
    """Coefficient of rolling friction in the model [m]."""


@dataclass(frozen=True, eq=False)
class Impulses:
    """The impulses in n consecutive steps of a simulation, as its engine replayed them."""

    client: int
    steps: Int64
    """The samples that the steps led to, shape (n,)."""
    times_s: Float64
    """Shape (n,)."""
    status: Int64
    """Indices into REPLAYS, shape (n,)."""
    remainder: Float64
    """The remainder of each step over its largest impulse, with the engine's own mass matrix,
    (n,)."""
    counts: Int64
    """Number of causes that acted in each step, shape (n,)."""
    widths: Int64
    """Number of values of each, shape (n,)."""
    causes: Int64
    """The numbers of the causes, step by step."""
    values: Float64
    """The impulses [N s or N m s], one cause after the other, each on its places."""

    def between(self, first: int, end: int) -> Impulses:
        """Return the steps that led to samples from `first` to before `end`."""
        kept = (self.steps >= first) & (self.steps < end)
        if kept.all():
            return self
        return Impulses(
            self.client,
            self.steps[kept],
            self.times_s[kept],
            self.status[kept],
            self.remainder[kept],
            self.counts[kept],
            self.widths[kept],
            self.causes[np.repeat(kept, self.counts)],
            self.values[np.repeat(kept, self.widths)],
        )


REPLAYS = (
    *("explained", "remainder", "nothing moves", "integrator", "version", "flex", "plugin"),
    *("plastic", "sleep", "delay", "auto-reset", "stale", "unknown", "not replayed", "not asked"),
    "another engine",
)
"""The outcomes of replaying a step: its causes add up, or the reason why they do not. `not
replayed` means that the replay led elsewhere, `not asked` that there was none yet, `another engine`
that the states were imported, and this engine's step leads elsewhere."""


@dataclass(frozen=True, eq=False)
class Controls:
    """The controls of actuators in n consecutive steps of a simulation."""

    client: int
    steps: Int64
    """The samples that the steps led to, shape (n,)."""
    times_s: Float64
    """Shape (n,)."""
    names: tuple[str, ...]
    values: Float64
    """Shape (n, actuators)."""


@dataclass(frozen=True, eq=False)
class ContactRows:
    """The contact points of steps whose samples were sent earlier."""

    client: int
    steps: Int64
    """The samples whose contact points these are, all of them, shape (n,)."""
    times_s: Float64
    """Shape (n,)."""
    contacts: Rows
    """The contact points, of dtype `CONTACT`."""


@dataclass(frozen=True)
class EngineWarning:
    """A warning of the engine, over a whole run."""

    at: At
    """The moment of the first."""
    client: int
    kind: str
    """`contacts full`, `constraints full`, `bad position`, `bad velocity`, `bad acceleration`, `bad
    control` or `inertia`."""
    count: int
    """Number of times that it was given."""
    steps: int
    """The number of steps in which it was given."""
    last_step: int
    info: int
    """The engine's number with the first: of a degree of freedom, of contacts …"""


@dataclass(frozen=True)
class Equality:
    """Two links that a model holds together, initially if the constraint is active."""

    at: At
    client: int
    name: str
    kind: str
    """`connect` or `weld`; `joint` of two joints, those before the links, or of one that is held
    where it is, which then is both sides."""
    body_a: int
    link_a: int
    body_b: int
    link_b: int
    solref: tuple[float, ...]
    """Softness: time constant [s] and damping ratio, or stiffness and damping if negative."""
    active: bool = True
    """Whether it holds them as the run begins."""
    anchors_m: tuple[tuple[float, ...], ...] = ()
    """The points that are to meet, of both links, from the centre of mass in the axes of the
    link's inertia; where a link is of the world, in world axes."""
    of_world: tuple[bool, bool] = (False, False)
    """Whether each side is the world."""
    coefficients: tuple[float, ...] = ()
    """Coefficients of a polynomial by which the first joint follows the second: c0 + c1 x + …
    from the positions in which the model was made."""
    rest: tuple[float, ...] = ()
    """These positions of both joints [rad] or [m]."""


TENDON = "tendon"
"""Kind of what tells the length of a tendon."""


@dataclass(frozen=True)
class Sensor:
    """A sensor of a model, with its readings in all steps."""

    at: At
    client: int
    name: str
    kind: str
    """`touch`, `force`, `torque`, `accelerometer`, `velocimeter`, `gyro`, `magnetometer`,
    `rangefinder`; `tendon` of a tendon's length; empty of any other."""
    body: int
    """Number of the body that it is on; -1 if it is on none, or that is not known."""
    link: int
    answers: tuple[Answer, ...]
    """Reading after each step, a number each."""
    place: Collision | None = None
    """The site of a sensor, as a shape on its link."""


@dataclass(frozen=True)
class EpisodeEnd:
    """The end of an episode, as returned by an environment of gymnasium."""

    at: At
    client: int
    first: int
    """Number of steps of the simulation before its first one."""
    how: str
    """`terminated` or `truncated`, `reset` before it ended, or `run`: the run ended first."""
    why: str
    """Reason for its termination, as far as the environment says: `z 0.98 < 1`, `fell`; else empty.
    """
    length: int
    """Number of calls of the environment's `step`."""
    reward: float
    """Sum of the rewards."""
    success: bool | None
    """Whether the environment's goal was reached; None if it says nothing of one."""

    @property
    def failed(self) -> bool:
        """True if it ended short of its goal, according to its environment."""
        return has_failed(self.how, self.success)


def has_failed(how: str, success: bool | None) -> bool:
    """Return whether an episode that an environment has told ended short of its goal.

    One that says whether its goal is reached says so as it ends; of others being terminated fails.
    """
    if success is None:
        return how == "terminated"
    return not success and how in ENDS


ENDS = "terminated", "truncated"
"""How an environment ends an episode."""

Event = (
    Appearance
    | Surface
    | Dynamics
    | Settings
    | Site
    | Calls
    | Raised
    | SolverStop
    | Reading
    | Put
    | Image
    | Samples
    | ImpulseCause
    | PairFriction
    | EngineWarning
    | Equality
    | EpisodeEnd
    | Sensor
    | Impulses
    | Controls
    | ContactRows
    | ModelPart
    | Frames
)


ENDED = {
    "finished": Message("finished"),
    "steps": Message("stopped by --steps"),
    "duration": Message("stopped by --duration"),
    "idle": Message("stopped after waiting 60 s without a step"),
    "disk": Message("stopped before the disk was full"),
    "interrupted": Message("stopped by Ctrl-C"),
    "failed": Message("failed"),
}
"""Ending of a script, in words."""


@dataclass
class Ending:
    """The ending of a watched program."""

    how: str = ""
    """`finished`, `steps`, `duration`, `idle`, `disk`, `interrupted` or `failed`."""
    error: str = ""
    """The failure, in a line."""
    printed: str = ""
    """Output of the program about the failure."""
    site: str = ""
    """File and line of the script that failed."""
    main_sha256: str | None = None
    """Digest of the text of the file that ran as `__main__`, a module or a script; None if
    unknown."""
    notes: list[str] = field(default_factory=list)
    """Remarks on the recording."""
    made_with: dict[str, Any] = field(default_factory=dict)
    """Versions, and whether time was virtual."""
    interpreter: str | None = None
    """The script's interpreter, where it is not ours."""
