"""The recorded events of a simulation, for any engine."""

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
    """The moment of an event, as counts of steps and calls before it."""

    step: int
    """Number of steps of the simulation before the event."""
    time_s: float
    """Simulated time [s]: the sum of the timesteps of these steps."""
    call: int
    """Number of calls of the script before the event."""


def order(at: At) -> tuple[int, int]:
    """Return a key that sorts moments."""
    return at.step, at.call


@dataclass(frozen=True)
class Shape:
    """The visible shape of a link."""

    link: int
    kind: str
    """`box`, `sphere`, `ellipsoid`, `cylinder`, `capsule`, `mesh`, `plane`, or the engine's type
    number."""
    size_m: tuple[float, ...]
    """Full edge lengths of a box or an ellipsoid; radius of a sphere; length and radius; scale of a
    mesh; the two sides of a plane of which only a part is drawn."""
    file: str
    """File of the mesh; empty for other shapes."""
    position_m: tuple[float, ...]
    """Position of its centre from the link's centre of mass, in the axes of the link's inertia."""
    orientation: tuple[float, ...]
    """Quaternion x, y, z, w, in the same axes."""
    rgba: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """A shape that can be drawn without its original files."""

    shape: Shape
    mesh: bytes
    """Content of the mesh file; empty if the shape is not a mesh."""
    suffix: str
    """Suffix of the mesh file."""


def counted_s(timestep_s: float) -> float:
    """Return the simulated time that a step adds [s]: 0 if its timestep is not finite."""
    return timestep_s if math.isfinite(timestep_s) else 0.0


Pose = tuple[tuple[float, ...], tuple[float, ...]]
"""Position [m], and orientation as a quaternion x, y, z, w."""


@dataclass(frozen=True)
class Joint:
    """The joint between a link and its parent."""

    link: int
    name: str
    kind: str
    """`revolute`, `prismatic`, `spherical`, `planar`, `fixed`, or the engine's type number."""
    parent: int
    """The parent link; -1 is the base."""
    widths: tuple[int, int, int]
    """Numbers of positions, velocities and efforts; all 0 for a fixed joint."""
    limits: tuple[float, float] = (0.0, -1.0)
    """Lowest and highest position [rad] or [m]; without limits, the highest is below the lowest."""
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Axis of rotation or translation, in the inertial axes of the joint's link."""
    parent_position_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Position of the joint from the parent's centre of mass, in the axes of the parent's
    inertia."""
    parent_orientation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    """Rotation from the parent's inertial axes to those of the joint's link, at position 0."""
    damping: float = 0.0
    """Joint damping [N m s/rad] or [N s/m]."""
    friction: float = 0.0
    effort: float = 0.0
    """Effort limit from the model file [N m] or [N]; 0 if the file gives none."""
    velocity: float = 0.0
    """Velocity limit from the model file [rad/s] or [m/s]; 0 if the file gives none."""


@dataclass(frozen=True)
class Collision:
    """The collision shape of a link."""

    link: int
    kind: str
    """Kind of shape, as in `Shape`."""
    size_m: tuple[float, ...]
    """Size as the engine reports it: whole lengths of a box; length and radius; scale of a mesh."""
    file: str
    """Mesh file name without its folder; empty if there is none."""
    position_m: tuple[float, ...]
    """Position of its centre from the link's centre of mass, in the axes of the link's inertia."""
    orientation: tuple[float, ...]
    hull_m: tuple[float, ...] = ()
    """Vertices of the convex hull that the engine uses in place of a mesh, three coordinates each
    [m], relative to the link's centre of mass, in the link's inertial axes."""
    bits: tuple[int, int] | None = None
    """Collision group and mask: two shapes may collide if one's group and the other's mask share a
    bit. None if the engine has no such filter."""


@dataclass(frozen=True)
class FileLink:
    """A link's inertial data in its body's file."""

    name: str
    mass_kg: float
    """Mass; nan if the file has no `<inertial>`."""
    inertia_kg_m2: tuple[float, ...]
    """xx, xy, xz, yy, yz, zz about the centre of mass; empty if the file gives none."""
    position_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Position of the centre of mass in the link's frame."""
    rpy_rad: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Orientation of the inertia's axes, as roll, pitch and yaw."""


@dataclass(frozen=True)
class Mimic:
    """A mimic joint in a body's file: it should follow another joint."""

    joint: str
    of: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class FileDamping:
    """A joint's damping in its body's file."""

    joint: str
    damping: float
    """Joint damping [N m s/rad] or [N s/m]."""


@dataclass(frozen=True)
class FileRequests:
    """Properties in a body's file that an engine may ignore."""

    scale: float = 1.0
    """Factor by which a call scaled the whole body."""
    links: tuple[FileLink, ...] = ()
    mimics: tuple[Mimic, ...] = ()
    dampings: tuple[FileDamping, ...] = ()
    """Joint dampings in the file that the engine may not read."""


@dataclass(frozen=True)
class Actuator:
    """An actuator with its own control law, which the engine evaluates in each step."""

    name: str
    number: int
    """Index of the actuator in the simulation."""
    kind: str
    """`motor`, `position`, `velocity`, `muscle` or `general`."""
    acts_on: str
    """`joint`, `tendon`, `site`, `slider-crank` or `body`."""
    target: str
    """Name of the joint, tendon, site or body on which it acts."""
    gear: float
    kp: float
    """Gain of the control; for a position servo, the stiffness."""
    kv: float
    """Damping gain, if the actuator's force has a damping term."""
    ctrl_range: tuple[float, float] | None
    """The range to which the control is clamped; None if it is not clamped."""
    force_range: tuple[float, float] | None
    """The range to which the force is clamped; None if it is not clamped."""


@dataclass(frozen=True)
class Keyframe:
    """A named pose of a model (MuJoCo's keyframe)."""

    name: str
    joints: tuple[float, ...]
    """Joint positions."""
    given: tuple[float, ...]
    """Actuator controls."""


@dataclass(frozen=True)
class Body:
    """A body, as it was when it was added to the simulation."""

    number: int
    """Id in the recording: the engine's own id, unless an earlier body had the same one."""
    label: str
    """Name and id, as a part of an entity's path."""
    name: str
    engine_id: int
    client: int
    links: tuple[str, ...]
    """Names of base and links; the first is the base, link -1."""
    joints: tuple[Joint, ...]
    moving: tuple[int, ...]
    """Indices of the links that can move in a step; -1 is the base."""
    soft: bool
    shapes: tuple[Shape, ...]
    can_sleep: bool = False
    """Whether the body was loaded with sleeping enabled."""
    hides_links: bool = False
    """Whether the body has links that the engine does not report, as a btRigidBody may."""
    bounds_m: tuple[float, ...] = ()
    """Axis-aligned boxes around base and links when it was added: low and high corners, six numbers
    each."""
    collisions: tuple[Collision, ...] = ()
    asked: FileRequests = FileRequests()
    flags: int = 0
    """The load flags; 0 if they are unknown."""
    before: bool = False
    """Whether the body existed before the recording began; earlier calls that set its properties
    are then unknown."""
    actuators: tuple[Actuator, ...] = ()
    keyframes: tuple[Keyframe, ...] = ()
    apart: tuple[tuple[int, int, int], ...] = ()
    """Contacts excluded by the body's model: own link, id of the other body, and the other body's
    link."""
    node_of: str = ""
    """Name of the flexible body of which this body is a node; empty if it is no node."""
    elastic: tuple[float, ...] = ()
    """Largest natural frequency of the flexible body [rad/s], then its damping [s] if steps are
    explicit in elastic forces; empty if unknown."""

    @cached_property
    def coordinates(self) -> tuple[slice, ...]:
        """The slice of each joint's coordinates within those of all joints."""
        return places(joint.widths[0] for joint in self.joints)

    @cached_property
    def rates(self) -> tuple[slice, ...]:
        """The slice of each joint's velocities within those of all joints."""
        return places(joint.widths[1] for joint in self.joints)

    @property
    def freedoms(self) -> int:
        """The number of the body's degrees of freedom."""
        return 6 * self.base_moves + sum(joint.widths[1] for joint in self.joints)

    def rate_of(self, actuator: Actuator) -> int | None:
        """Return the velocity index of the joint that an actuator drives.

        None if the actuator drives something else, or a joint with several velocities.
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
    def short(self) -> str:
        """The label without the id."""
        number, _, name = self.label.partition("_")
        return name if number.isdigit() and name else self.label

    @property
    def base_moves(self) -> bool:
        """True if the base can move in a step, so that its state is sampled."""
        return -1 in self.moving


@dataclass(frozen=True)
class Appearance:
    """A change of a body: added, removed, made movable, or given new shapes or colours."""

    at: At
    body: Body
    there: bool
    came: bool = False
    """Whether the body was added, as a new body even if an earlier one had the same id."""
    sampled: bool = False
    """Whether the simulation's sample of this step had been taken before the body was added."""


GIVEN = {"linear_damping": "linearDamping", "angular_damping": "angularDamping"}
"""Properties of a dropped body in `Dynamics` that drop itself set and no engine reports, with the
argument that sets each."""


@dataclass(frozen=True)
class Dynamics:
    """An engine's report of a body's dynamics properties."""

    at: At
    body: Body
    reported: Mapping[str, Float64]
    """Values for base and links, shape (links + 1,) or (links + 1, k)."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a hollow mesh that the engine replaces by its convex hull."""

    at: At
    body: int
    """Id of the body."""
    shape: int
    """Index of the shape in the body's collision shapes."""
    corners_m: Float64
    """Vertices in the axes of the link's inertia, shape (n, 3)."""
    triangles: Int64
    """Vertex indices of each triangle, shape (m, 3)."""


@dataclass(frozen=True)
class Settings:
    """The settings that an engine reports, and those set by a script that it never reports."""

    at: At
    client: int
    values: Mapping[str, float | Sequence[float]]
    engine: str = ""
    """Name and version of the engine; empty for PyBullet."""


def located(file: str, line: int) -> str:
    """Return file and line as `arm.py:13`, which terminals link; in a notebook `In[3], line 13`."""
    return f"{file}, line {line}" if file.startswith("In[") else f"{file}:{line}"


@dataclass(frozen=True)
class Site:
    """A line of the script that calls an engine function, with arguments of one structure."""

    number: int
    """Index in the recording, in the order of the first calls."""
    function: str
    file: str
    """File of the call, without this machine's folders; a notebook cell is `In[3]`."""
    line: int
    """Line number, from 1."""
    form: str
    """The argument text with `{}` for each number; other arguments stay as text."""
    names: tuple[str, ...]
    """The argument to which each number belongs; the components of a vector share a name."""
    whole: tuple[bool, ...]
    """Whether each number was an integer in the site's first call."""

    @property
    def act(self) -> Act:
        """The act of the calls."""
        return act_of(self.function)

    @property
    def place(self) -> str:
        """File and line, as findings cite them."""
        return located(self.file, self.line)

    @cached_property
    def places(self) -> Mapping[str, slice]:
        """The slice of each argument in the call's row of numbers."""
        places: dict[str, slice] = {}
        for k, name in enumerate(self.names):
            places[name] = slice(places[name].start if name in places else k, k + 1)
        return places


@dataclass(frozen=True)
class Calls:
    """Consecutive calls that changed a simulation, m in all."""

    client: int
    steps: Int64
    """Number of the simulation's steps before each call, shape (m,)."""
    times_s: Float64
    """Simulated time of each call, shape (m,)."""
    calls: Int64
    """Number of the script's calls before each call, shape (m,)."""
    sites: Int64
    """Index of each call's site, shape (m,)."""
    numbers: Float64
    """The numbers in the arguments of all calls, one call after the other."""
    results: Float64
    """The numbers that the calls returned; nan if a call returned none."""


def widths_of(seen: Calls, sites: Mapping[int, Site]) -> Int64:
    """Return how many numbers each call has in its arguments, shape (m,)."""
    known, which = np.unique(seen.sites, return_inverse=True)
    return np.array([len(sites[site].names) for site in known.tolist()], np.int64)[which]


@dataclass(frozen=True)
class Raised:
    """A call that raised an error."""

    at: At
    """The moment of the call."""
    error: str
    """Type and message."""


@dataclass(frozen=True)
class SolverStop:
    """How often a simulation's solver stopped before it had converged."""

    at: At
    client: int
    iterations: int
    """The iteration limit."""
    looked: int
    """Number of steps with this iteration limit whose solver was checked: every eighth."""
    steps: int
    """Number of checked steps that used all iterations, and whose last iteration changed a velocity
    by more than 0.01 [m/s or rad/s]."""
    first_step: int
    last_change: float
    """The largest velocity change in a last iteration [m/s or rad/s]."""
    worst_step: int


@dataclass(frozen=True)
class Put:
    """The state of a body after calls have set it, before the next step."""

    at: At
    body: Body
    base: Float64
    """Position, orientation, linear and angular velocity: shape (13,)."""
    position: Float64
    """Joint positions [rad] or [m], shape (positions,)."""
    velocity: Float64
    """Joint velocities [rad/s] or [m/s]."""
    effort: Float64
    """Joint efforts [N m] or [N]."""
    counts: bool
    """Whether the next step starts from this state; False before the very first sample."""


@dataclass(frozen=True)
class Image:
    """An image taken by the script's camera."""

    at: At
    client: int
    camera: str
    """File and line of the call, and the image size: images with the same text form a sequence."""
    rgba: NDArray[np.uint8]
    """Pixels, shape (height, width, 4)."""
    view: tuple[float, ...]
    """View matrix in column order, 16 numbers; empty if none was given."""
    projection: tuple[float, ...]


@dataclass(frozen=True)
class Samples:
    """Consecutive samples of one simulation, with the same moving bodies."""

    client: int
    steps: Int64
    """Step of each sample, shape (n,)."""
    times_s: Float64
    """Simulated time of each sample, shape (n,)."""
    call: int
    """Number of the script's calls before the last sample."""
    bases: Mapping[int, Float64]
    """States of the movable bases, by body id: position, orientation (x, y, z, w), linear and
    angular velocity; shape (n, 13)."""
    joints: Mapping[int, Joints]
    """Joint states, by body id."""
    contacts: Rows
    """The contact points, of dtype `CONTACT`."""
    constraints: Mapping[int, Float64]
    """Forces of each constraint [N] or [N m], shape (n, k), by the engine's constraint id."""


@dataclass(frozen=True)
class ImpulseCause:
    """A cause of impulses on a body, named as the engine names it."""

    at: At
    number: int
    """Index in the recording."""
    client: int
    body: int
    """Id of the body on which the cause acts."""
    kind: str
    """`gravity`, `bias`, `spring`, `actuator`, `contact` …"""
    name: str
    """Name of the actuator, tendon, joint or equality constraint; for a contact, the label of the
    other body."""
    places: tuple[int, ...]
    """The degrees of freedom on which the cause acts, as indices into the body's generalised
    velocity."""


@dataclass(frozen=True)
class PairFriction:
    """The coefficient of friction between two touching links."""

    at: At
    client: int
    body_a: int
    link_a: int
    body_b: int
    link_b: int
    friction: float
    """Coefficient of friction; nan if the pair's contact points have different ones."""
    solref: tuple[float, ...] = ()
    """Contact softness (MuJoCo's solref): time constant [s] and damping ratio, or stiffness and
    damping."""
    solimp: tuple[float, ...] = ()
    """Contact impedance (MuJoCo's solimp): first and last value, depth [m] over which it rises …"""
    condim: int = 3
    """Dimensions of the contact force: 1 without friction, 3 sliding, 4 spinning, 6 rolling."""
    rolling: float = 0.0
    """Coefficient of rolling friction in the model [m]."""


@dataclass(frozen=True, eq=False)
class Impulses:
    """The impulses in n consecutive steps of a simulation, as the engine's replay computed them."""

    client: int
    steps: Int64
    """The samples to which the steps lead, shape (n,)."""
    times_s: Float64
    """Simulated time after each step, shape (n,)."""
    status: Int64
    """Indices into `REPLAYS`, shape (n,)."""
    remainder: Float64
    """The unexplained remainder of each step as a share of its largest impulse, with the engine's
    own mass matrix, (n,)."""
    counts: Int64
    """Number of causes in each step, shape (n,)."""
    widths: Int64
    """Number of values of each cause, shape (n,)."""
    causes: Int64
    """The indices of the causes, step by step."""
    values: Float64
    """The impulses [N s or N m s], one cause after the other, each on its degrees of freedom."""

    def between(self, first: int, end: int) -> Impulses:
        """Return the steps that lead to samples from `first` up to, not including, `end`."""
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
"""Outcomes of replaying a step: `explained`, if its causes add up, or the reason why they do not.
`not replayed`: the replay led to another state. `not asked`: the step has not been replayed yet.
`another engine`: the states were imported, and this engine's step leads to another state."""


@dataclass(frozen=True, eq=False)
class Controls:
    """The actuator controls in n consecutive steps of a simulation."""

    client: int
    steps: Int64
    """The samples to which the steps lead, shape (n,)."""
    times_s: Float64
    """Simulated time after each step, shape (n,)."""
    names: tuple[str, ...]
    values: Float64
    """The controls, shape (n, actuators)."""


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Contact points of samples that are recorded already."""

    client: int
    steps: Int64
    """The samples to which these contact points belong, shape (n,)."""
    times_s: Float64
    """Simulated time of each sample, shape (n,)."""
    contacts: Rows
    """The contact points, of dtype `CONTACT`."""


@dataclass(frozen=True)
class EngineWarning:
    """A kind of engine warning, counted over a whole run."""

    at: At
    """The moment of the first warning."""
    client: int
    kind: str
    """`contacts full`, `constraints full`, `bad position`, `bad velocity`, `bad acceleration`, `bad
    control` or `inertia`."""
    count: int
    """Number of warnings."""
    steps: int
    """The number of steps with a warning."""
    last_step: int
    info: int
    """Number given by the engine with the first warning, such as the index of a degree of freedom,
    or a count of contacts."""


@dataclass(frozen=True)
class Equality:
    """An equality constraint between two links or joints of a model."""

    at: At
    client: int
    name: str
    kind: str
    """`connect` or `weld`; `joint` for two joints, each before one of the links, or for one joint
    with a fixed position, given as both; `tendon` for two tendons, or one with a fixed length,
    given as both."""
    body_a: int
    link_a: int
    body_b: int
    link_b: int
    solref: tuple[float, ...]
    """Softness (MuJoCo's solref): time constant [s] and damping ratio, or stiffness and damping if
    negative."""
    active: bool = True
    """Whether the constraint is active at the start of the run."""
    anchors_m: tuple[tuple[float, ...], ...] = ()
    """The two anchor points that the constraint brings together [m], each relative to its link's
    centre of mass in the link's inertial axes; in world axes for the world."""
    of_world: tuple[bool, bool] = (False, False)
    """Whether each side belongs to the world."""
    orientations: tuple[tuple[float, ...], ...] = ()
    """The two orientations that a weld brings together, quaternions x, y, z, w in the same axes as
    the anchors; empty if the links can rotate."""
    coefficients: tuple[float, ...] = ()
    """Coefficients of the polynomial by which the first joint or tendon follows the second:
    c0 + c1 x + …, relative to their reference positions or lengths."""
    rest: tuple[float, ...] = ()
    """The reference positions of both joints [rad] or [m], or lengths of both tendons."""
    tendons: tuple[str, ...] = ()
    """The names of both tendons; the links are those at which the tendons begin."""


TENDON, LENGTH, FORCE = "tendon", "actuator length", "actuator force"
"""Sensor kinds: length of a tendon; length of an actuator's transmission, before the gear ratio;
and force of an actuator."""


@dataclass(frozen=True)
class Sensor:
    """A sensor of a model, with a summary of its readings in all steps."""

    at: At
    client: int
    name: str
    kind: str
    """`touch`, `force`, `torque`, `accelerometer`, `velocimeter`, `gyro`, `magnetometer`,
    `rangefinder`; TENDON, LENGTH, FORCE for tendons and actuators; empty for any other."""
    body: int
    """Id of the body to which the sensor is attached; -1 if there is none, or it is unknown."""
    link: int
    answers: tuple[Answer, ...]
    """Readings after all steps, summarised for each component."""
    place: Collision | None = None
    """The sensor's site, as a shape on its link."""


@dataclass(frozen=True)
class ArrayUse:
    """A line of the script by which an array of the engine is used to another effect than it seems.

    The uses of one line are told once, at the end.
    """

    at: At
    """The moment of the first use."""
    client: int
    use: str
    """`kept`: a reference to the array is kept, which shows its later values; `stale`: the array is
    read after positions were written, and before it is computed from them; `overwritten`: the array
    is written, and computed anew before it has an effect; `left`: a force is written again and
    again, and then left where it is; `edited`: a field of the model is changed before the first
    step, and what depends on it is not."""
    name: str
    """Name of the array or the field: `qpos`, `site_xpos`, `geom_size` …"""
    file: str
    """File of the line, without this machine's folders."""
    line: int
    """Line number, from 1."""
    count: int
    """Number of steps, or of readings, in which the line did so at least; of steps before which a
    force was used; or of elements that were changed."""
    last_step: int
    """Number of steps before the last of these uses that was reported."""
    size: float = 0.0
    """Difference between what was read and what is computed next; magnitude of a force that is
    left; or new value of an element that was changed."""
    element: str = ""
    """Name of the body, site or other element that was read or changed; empty if it is unknown."""
    old: float = 0.0
    """The value of an element before it was changed."""
    others: tuple[str, ...] = ()
    """The fields that depend on an element that was changed, and are as they were."""


@dataclass(frozen=True)
class EpisodeEnd:
    """The end of an episode, as returned by a gymnasium environment."""

    at: At
    client: int
    first: int
    """Number of the simulation's steps before the episode's first step."""
    how: str
    """`terminated` or `truncated`, `reset` before it ended, or `run`: the run ended first."""
    why: str
    """Reason for the termination, if the environment gives one: `z 0.98 < 1`, `fell`; else
    empty."""
    length: int
    """Number of calls of the environment's `step`."""
    reward: float
    """Sum of the rewards."""
    success: bool | None
    """Whether the environment's goal was reached; None if it does not report one."""

    @property
    def failed(self) -> bool:
        """True if the episode ended without reaching its goal, as the environment reported."""
        return has_failed(self.how, self.success)


def has_failed(how: str, success: bool | None) -> bool:
    """Return whether an episode that an environment reported ended without reaching its goal.

    If the environment reports whether its goal was reached, that decides. Otherwise a terminated
    episode has failed.
    """
    if success is None:
        return how == "terminated"
    return not success and how in ENDS


ENDS = "terminated", "truncated"
"""The ways in which an environment ends an episode."""

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
    | ArrayUse
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
"""Descriptions of how a script ended."""


@dataclass
class Ending:
    """How a watched program ended."""

    how: str = ""
    """Why the program ended: `finished`, `steps`, `duration`, `idle`, `disk`, `interrupted` or
    `failed`."""
    error: str = ""
    """The error message, in one line."""
    printed: str = ""
    """What the program printed about the error."""
    site: str = ""
    """File and line of the script where the error occurred."""
    main_sha256: str | None = None
    """Digest of the text of the file that ran as `__main__`, a module or a script; None if
    unknown."""
    notes: list[str] = field(default_factory=list)
    """Warnings about the recording."""
    made_with: dict[str, Any] = field(default_factory=dict)
    """Versions, and whether the clock was virtual."""
    interpreter: str | None = None
    """The script's interpreter, if it differs from drop's own."""
