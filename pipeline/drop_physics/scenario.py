"""The body and conditions of a drop: the two inputs of every run, validated, in SI units.

Each field of `Scenario` and `Camera` carries its command-line option, help and parser, so that the
command line, the recording and sweeps agree. This is the lowest room: it imports only the
declaration of fields.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import count
from typing import Literal, get_args

from drop_physics.errors import ScenarioError
from drop_physics.fields import Optioned, all_of, alternatives, option, shown
from drop_physics.option_types import (
    INTEGER,
    NUMBER,
    ORIENTATION,
    SIZE,
    VECTOR,
    OptionType,
    Quaternion,
    Vector,
    number,
)

Coordinates = Literal["reduced", "maximal"]
Engine = Literal["bullet", "mujoco"]
Integrator = Literal["euler", "rk4", "implicit", "implicitfast"]
Renderer = Literal["tiny", "egl"]
View = Literal["standard", "close", "follow"]

ENGINES: dict[Engine, str] = {"bullet": "PyBullet", "mujoco": "MuJoCo"}
"""The engines' proper names."""
INTEGRATORS: dict[Engine, tuple[Integrator, ...]] = {
    "mujoco": ("euler", "rk4", "implicit", "implicitfast"),
}
"""Integrators of each engine that offers a choice, the default first."""
EXACT_INTEGRATORS = ("rk4",)
"""Integrators that are exact under gravity alone."""
ENGINES_WITH: dict[str, tuple[Engine, ...]] = {
    "linear_damping": ("bullet",),
    "angular_damping": ("bullet",),
    "restitution": ("bullet",),
    "restitution_threshold_m_s": ("bullet",),
    "friction": ("bullet", "mujoco"),
    "contact_erp": ("bullet",),
    "solver_residual": ("bullet", "mujoco"),
    "solver_iterations": ("bullet", "mujoco"),
    "substeps": ("bullet",),
    "coordinates": ("bullet",),
}
"""Engines that support a field's option; options not listed here are supported by all engines."""
WITHOUT = {"linear_damping": 0.0, "angular_damping": 0.0, "substeps": 1}
"""Option values that correspond to an engine without the option."""

GRAVITY_PRESETS_M_S2 = {"earth": -9.81, "moon": -1.62, "mars": -3.71, "zero": 0.0}
BYTES_PER_SAMPLE = 480
"""Size of a sample in a recording without frames [bytes], for a box that rests on four corners and
creeps; in flight, it is half as large."""
MAX_STEPS = 1_000_000_000
"""Largest number of steps in a recording, which then takes over 500 GB."""


def gravity(text: str) -> float:
    """Parse a z component in m/s², or the name of a preset."""
    preset = GRAVITY_PRESETS_M_S2.get(text.lower())
    if preset is not None:
        return preset
    try:
        return number(text)
    except ScenarioError:
        presets = ", ".join(GRAVITY_PRESETS_M_S2)
        raise ScenarioError("a number or one of {presets}", presets=presets) from None


GRAVITY = OptionType(gravity, "NUMBER|NAME", float)


@dataclass(frozen=True, kw_only=True, slots=True)
class Scenario(Optioned):
    """One drop: the body, its world, and how the engine steps it.

    `None` means the engine's own value. World axes are x, y, z with z up; the floor is z = 0.

    Raises
    ------
    ScenarioError
        If a value is outside its domain, or the duration is not a whole number of steps.
    """

    height_m: float = option(
        "--height",
        "Centre of the body above the floor at release [m].",
        NUMBER,
        default=1.0,
        low=-1e6,
        high=1e6,
    )
    timestep_s: float = option(
        "--timestep",
        "Timestep [s]: a number, or a fraction such as 1/480.",
        NUMBER,
        default=1 / 240,
        shown="1/240",
        low=1e-9,
        high=10,
    )
    duration_s: float = option(
        "--duration",
        "Simulated time [s], a whole number of steps.",
        NUMBER,
        default=1.0,
        low=0,
        high=1e9,
        above=True,
    )
    gravity_m_s2: float = option(
        "--gravity",
        "z component of gravity [m/s²], or earth, moon, mars, zero.",
        GRAVITY,
        default=-9.81,
        low=-1e4,
        high=1e4,
    )
    linear_damping: float | None = option(
        "--linear-damping",
        "Bullet's coefficient of translational damping.",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=1,
    )
    angular_damping: float | None = option(
        "--angular-damping",
        "Bullet's coefficient of rotational damping.",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=1,
    )
    velocity_m_s: Vector = option(
        "--velocity",
        "Initial velocity X,Y,Z [m/s], world axes.",
        VECTOR,
        default=(0.0, 0.0, 0.0),
        shown="0,0,0",
        low=-1e4,
        high=1e4,
    )
    spin_rad_s: Vector = option(
        "--spin",
        "Initial angular velocity X,Y,Z [rad/s], world axes.",
        VECTOR,
        default=(0.0, 0.0, 0.0),
        shown="0,0,0",
        low=-1e4,
        high=1e4,
    )
    orientation: Vector | Quaternion = option(
        "--orientation",
        "Orientation at release: roll, pitch, yaw [deg] or a quaternion.",
        ORIENTATION,
        default=(0.0, 0.0, 0.0),
        shown="0,0,0",
        low=-360,
        high=360,
    )
    body: str = option(
        "--body", "URDF of the body, from pybullet_data or a path.", default="cube_small.urdf"
    )
    mass_kg: float | None = option(
        "--mass",
        "Mass of the body [kg].",
        NUMBER,
        default=None,
        shown="default",
        low=1e-9,
        high=1e9,
        left_to="the URDF's",
    )
    restitution: float | None = option(
        "--restitution",
        "Restitution of both body (all links) and floor.",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=1,
    )
    restitution_threshold_m_s: float | None = option(
        "--restitution-threshold",
        "Speed of approach below which nothing bounces [m/s].",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=1e4,
    )
    friction: float | None = option(
        "--friction",
        "Lateral friction of both body (all links) and floor.",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=10,
    )
    contact_erp: float | None = option(
        "--contact-erp",
        "Share of a penetration that contact corrects per step.",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=1,
    )
    solver_residual: float | None = option(
        "--solver-residual",
        "Residual at which the contact solver stops early.",
        NUMBER,
        default=None,
        shown="default",
        low=0,
        high=1,
    )
    solver_iterations: int | None = option(
        "--solver-iterations",
        "Maximum iterations of the contact solver per step.",
        INTEGER,
        default=None,
        shown="default",
        low=1,
        high=100_000,
    )
    substeps: int | None = option(
        "--substeps",
        "Substeps that the engine takes per timestep.",
        INTEGER,
        default=None,
        shown="default",
        low=1,
        high=1000,
    )
    coordinates: Coordinates = option(
        "--coordinates",
        "reduced (btMultiBody) or maximal (btRigidBody).",
        default="reduced",
        choices=get_args(Coordinates),
    )
    engine: Engine = option(
        "--engine", "Engine that drops the body.", default="bullet", choices=get_args(Engine)
    )
    integrator: Integrator | None = option(
        "--integrator",
        "Of MuJoCo: euler, rk4, implicit, implicitfast.",
        default=None,
        shown="default",
        choices=get_args(Integrator),
    )
    stepped: bool = option("--no-step", "Mistake 1: never call stepSimulation.", default=True)
    gravity_set: bool = option("--no-gravity", "Mistake 2: never call setGravity.", default=True)
    floor: bool = option("--no-floor", "Mistake 3: leave out the floor.", default=True)

    def __post_init__(self) -> None:
        self.check_domains()
        self._check_engine()
        if not self.body or "\0" in self.body:
            raise ScenarioError("--body must name a URDF file, got {body}", body=shown(self.body))
        if self.floor and not self.height_m > 0:
            raise ScenarioError(
                "--height must be above 0 and at most 1e+06, got {height}; only with --no-floor "
                "can a body start lower",
                height=shown(self.height_m),
            )
        if len(self.orientation) == 4:
            object.__setattr__(self, "orientation", _unit(self.orientation))
        ratio = self.duration_s / self.timestep_s
        if ratio > MAX_STEPS:
            raise ScenarioError(
                "--duration over --timestep must be at most {most:,} steps, got {steps:.3g}, about "
                "{disk:,.0f} GB on disk; try a longer timestep",
                most=MAX_STEPS,
                steps=ratio,
                disk=ratio * BYTES_PER_SAMPLE / 1e9,
            )
        # 1e-9: a rounded decimal such as 0.0041666666667 means the fraction.
        if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9 * ratio:
            near = [n * self.timestep_s for n in (math.floor(ratio), math.ceil(ratio)) if n > 0]
            raise ScenarioError(
                "--duration must be a whole number of timesteps of {timestep:.12g} s, got "
                "{duration:.12g} s, that is {steps:.12g} of them; try {near}",
                timestep=self.timestep_s,
                duration=self.duration_s,
                steps=ratio,
                near=alternatives(f"{duration_s:.12g}" for duration_s in near),
            )
        if self.substeps is not None:
            self._check_substeps(self.substeps)

    def _check_engine(self) -> None:
        """Check that the engine supports the given options."""
        name = ENGINES[self.engine]
        for field, engines in ENGINES_WITH.items():
            spec = self.options()[field]
            value = getattr(self, field)
            if value == WITHOUT.get(field) or self.engine in engines:
                continue
            if spec.written(value) != spec.default:
                others = all_of(ENGINES[engine] for engine in engines)
                raise ScenarioError(
                    "{option} is an option of {engines}, not of {engine}; omit it",
                    option=spec.name,
                    engines=others,
                    engine=name,
                )
        if self.integrator is not None and self.engine not in INTEGRATORS:
            raise ScenarioError(
                "--integrator must be omitted for {engine}, which has only one, got {given}",
                engine=name,
                given=self.integrator,
            )

    def _check_substeps(self, substeps: int) -> None:
        taken = _substeps_taken(self.timestep_s, substeps)
        if taken != {substeps}:
            near = (
                n for n in count(substeps - 1, -1) if _substeps_taken(self.timestep_s, n) == {n}
            )
            raise ScenarioError(
                "--substeps must be a number that the engine takes in every timestep; of "
                "{substeps} it takes only {taken} in some timesteps of {timestep:.12g} s, because "
                "dt / (dt/N) is rounded; try {near}",
                substeps=substeps,
                taken=min(taken),
                timestep=self.timestep_s,
                near=next(near),
            )

    @property
    def effective_integrator(self) -> Integrator | None:
        """The integrator that the engine uses; None where it has only one."""
        return self.integrator or next(iter(INTEGRATORS.get(self.engine, ())), None)

    @property
    def steps(self) -> int:
        """Number of timesteps in the duration; a recording has one more sample than that."""
        return round(self.duration_s / self.timestep_s)

    @property
    def orientation_xyzw(self) -> Quaternion:
        """The orientation at release as a unit quaternion; angles turn about world x, y, then z."""
        if len(self.orientation) == 4:
            return self.orientation
        half = [math.radians(angle) / 2 for angle in self.orientation]
        (sx, sy, sz), (cx, cy, cz) = map(math.sin, half), map(math.cos, half)
        return (
            sx * cy * cz - cx * sy * sz,
            cx * sy * cz + sx * cy * sz,
            cx * cy * sz - sx * sy * cz,
            cx * cy * cz + sx * sy * sz,
        )

    @property
    def effective_gravity_m_s2(self) -> float:
        """The z component of gravity as set in the engine; 0 if it was not set."""
        return self.gravity_m_s2 if self.gravity_set else 0.0


def _unit(quaternion: Quaternion) -> Quaternion:
    """Normalize a quaternion, unless its length is 1 within rounding."""
    length = math.hypot(*quaternion)
    if not length > 0:
        raise ScenarioError("--orientation must not be the quaternion 0,0,0,0; try 0,0,0,1")
    if abs(length - 1) <= 1e-15:
        return quaternion
    x, y, z, w = quaternion
    return x / length, y / length, z / length, w / length


def _substeps_taken(timestep_s: float, substeps: int) -> set[int]:
    """Return the possible numbers of substeps that the engine makes if `substeps` are requested.

    Bullet accumulates the time not stepped yet, and takes as many whole substeps as fit into it
    (`btDiscreteDynamicsWorld::stepSimulation`): one fewer where dt / (dt/N) rounds below N.
    """
    substep_s, left_s, counts = timestep_s / substeps, 0.0, set()
    for _ in range(10):  # the remainder repeats from the second timestep on
        left_s += timestep_s
        taken = int(left_s / substep_s)
        left_s -= taken * substep_s
        counts.add(taken)
    return counts


@dataclass(frozen=True, kw_only=True, slots=True)
class Camera(Optioned):
    """The camera of a drop, aimed at a point, with z up; by default as in the original experiment.

    A view other than the standard one is aimed when the body is known (see
    `drop_physics.engines.pybullet.visible_world.framed`).
    """

    view: View = option(
        "--camera",
        "standard, close (where the body lands) or follow (moves with the body).",
        default="standard",
        choices=get_args(View),
    )
    capture_every: int = option(
        "--capture-every", "Take a frame every N steps.", INTEGER, default=6, low=1, high=1e9
    )
    size_px: tuple[int, int] = option(
        "--size",
        "Frame size WIDTHxHEIGHT [px].",
        SIZE,
        default=(480, 360),
        shown="480x360",
        low=16,
        high=4096,
    )
    renderer: Renderer = option(
        "--renderer",
        "tiny (software, the same everywhere) or egl (GPU or Mesa).",
        default="tiny",
        choices=get_args(Renderer),
    )
    target_m: Vector = (0.0, 0.0, 0.5)
    distance_m: float = 2.0
    yaw_deg: float = 45.0
    pitch_deg: float = -25.0
    roll_deg: float = 0.0
    vertical_fov_deg: float = 60.0
    near_m: float = 0.1
    far_m: float = 10.0

    def __post_init__(self) -> None:
        self.check_domains()

    def looking_at(self, position_m: Vector) -> Camera:
        """Return the camera aimed at a body's position [m]."""
        return replace(self, target_m=position_m) if self.view == "follow" else self

    def frames_of(self, steps: int) -> int:
        """Return the number of frames of a fall with this many steps, including the release."""
        return steps // self.capture_every + 1

    @property
    def focal_length_px(self) -> float:
        """Focal length of the pinhole [px], the same in both directions."""
        return self.size_px[1] / 2 / math.tan(math.radians(self.vertical_fov_deg) / 2)


STANDARD_CAMERA = Camera()
