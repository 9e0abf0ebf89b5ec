"""Changes that can be tried on a PyBullet run, each as code for the user and as an operation.

The result of `makes` is carried out by `watch/intervene.py` in the script's interpreter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any

from drop_physics.engines.interventions import (
    AWAY,
    FACTOR,
    MORE,
    Becomes,
    ChangeRow,
    How,
    Interventions,
    Operation,
    always,
    done,
    named,
    raised,
    times,
    to,
)
from drop_physics.engines.pybullet.played import played
from drop_physics.engines.pybullet.watch.arguments import ARGUMENTS, CLIENT
from drop_physics.engines.pybullet.watch.functions import (
    COMMANDS,
    CONSTRAINS,
    IK,
    MAKES_BODIES,
    MOVES_BODY,
    PUSHES,
    SETS_ENGINE,
    SHAPES,
    those_that,
)
from drop_physics.engines.pybullet.watch.single_changes import TIMESTEP, trial_of
from drop_physics.engines.watching.single_changes import Change
from drop_physics.messages import Message
from drop_physics.trace.cures import ChangedRun, Cure, Scope, whole_number
from drop_physics.trace.events import Body

Applies = Callable[["CallRow", Cure, Scope], Iterator[Operation]]

MOTOR = "setJointMotorControl2"
MOTORS = [MOTOR, "setJointMotorControlArray", "setJointMotorControlMultiDof"]
MOTORS += ["setJointMotorControl"]
MAKES = ["loadURDF", "loadMJCF", "loadSDF", "createMultiBody", "loadBullet"]
BEGINS = ["connect", "resetSimulation"]
ENGINE, DYNAMICS, STEP = "setPhysicsEngineParameter", "changeDynamics", "stepSimulation"
CONSTRAINT, POSE = "changeConstraint", "resetBasePositionAndOrientation"
VELOCITY, POSITION, PD = 0, 2, 3
"""Values of `controlMode` in a motor call."""
INERTIA_FROM_FILE, SELF_COLLISION, CONCAVE = 2, 8 | 16 | 32, 1
"""Flags: URDF_USE_INERTIA_FROM_FILE, the URDF_USE_SELF_COLLISION…, GEOM_FORCE_CONCAVE_TRIMESH."""
LIGHT = {"mass": ("=", 1e-3), "localInertiaDiagonal": ("=", [1e-6] * 3)}
"""Mass [kg] and inertia [kg m²] of a link that should be weightless; with less, the solver
fails."""
UP, LIFTED_M = (0.0, 0.0, 1.0), 0.01
"""Direction and distance by which a body is moved, if no penetration depth is known."""
RESIDUAL, TIMESTEPS = "solverResidualThreshold", ("fixedTimeStep", "numSubSteps", "timestep")
PARAMETERS = {*ARGUMENTS[ENGINE]}.difference(TIMESTEPS, [CLIENT])
"""Engine parameters that `parameter` sets; timesteps are varied by `timestep`."""
FARTHER = Message("{mm:.3g} mm farther away")


@dataclass(frozen=True)
class CallRow(ChangeRow):
    """A change of PyBullet calls that may be suggested and tried."""

    makes: Applies | None = None
    _: KW_ONLY
    function: str = ""
    """The PyBullet function whose arguments are set."""
    each: str = ""
    """Kind of objects for each of which the search adds a call: `bodies`, `links`, movable
    `joints`, `constraints`, or `pairs` that touched; empty for a single call."""

    @property
    def tried(self) -> dict[str, Any]:
        """Describe this change for the search for causes, which runs in the script's process."""
        taken = [name for name, becomes in self.sets.items() if not isinstance(becomes, always)]
        fixed = {name: each(None) for name, each in self.sets.items() if name not in taken}
        change = self.change or f"{self.function}.{taken[0]}"
        call = {"call": self.function, "each": self.each, "fixed": fixed, "takes": taken}
        return {**super().tried, "change": change, **call}

    def changes(self, cure: Cure) -> dict[str, How]:
        """Return the changed arguments, from the finding or by the row's default."""
        if cure.given:
            return {name: ("=", value) for name, value in cure.given.items()}
        return super().changes(cure)

    def call_of(self, cure: Cure) -> str:
        """Return the call that a user would write to make a suggested change."""
        if self.words or not self.function:
            return super().call_of(cure)
        shown = (_shown(name, *change) for name, change in self.changes(cure).items())
        return f"p.{self.function}(…, {', '.join(shown)})"

    def operations(self, cure: Cure, scope: Scope) -> Iterable[Operation]:
        """Return the operations by which the script's process makes a suggested change."""
        return () if self.makes is None else self.makes(self, cure, scope)


def _shown(name: str, operator: str, value: float) -> str:
    if operator == "=":
        return f"{name}={value:g}"
    return f"{name}*{value:.3g}" if value > 1 else f"{name}/{1 / value:.3g}"


def _set_parameter(name: str, value: float) -> ChangedRun:
    return ChangedRun(below={"engine": {name: value}})


# -- operations -----------------------------------------------------------------------------------


def _leave(functions: list[str], *arguments: str) -> Operation:
    """Return the operation that omits a call, or some of its arguments."""
    return {"do": "leave", "functions": functions, "arguments": [*arguments]}


def _of(body: Body) -> Operation:
    return {"client": body.client, "body": body.engine_id}


def _at(scope: Scope) -> Operation:
    """Return the file and line of the finding's call for an operation; empty without a call."""
    file, _, line = (scope.site or "").rpartition(":")
    return {"site": [file, int(line)]} if file and line.isdecimal() else {}


def _done(do: str, *functions: str) -> Applies:
    """Make a function that returns one operation for each body of a finding."""
    return lambda _, __, scope: (
        {"do": do, "functions": [*functions], **_of(body)} for body in scope.bodies
    )


def _set(row: CallRow, cure: Cure, _: Scope) -> Iterator[Operation]:
    """Yield the operation that changes arguments in all calls of a function."""
    yield {"do": "set", "functions": [row.function], "sets": row.changes(cure)}


def _set_of(*functions: str) -> Applies:
    """Make a function that returns operations to change arguments in calls for given bodies."""
    return lambda row, cure, scope: (
        {**each, "sets": row.changes(cure)} for each in _done("set", *functions)(row, cure, scope)
    )


def _begin(row: CallRow, cure: Cure, _: Scope) -> Iterator[Operation]:
    """Yield the operation that adds a call at the start of each simulation."""
    yield {"do": "add", "functions": BEGINS, "call": row.function, "sets": row.changes(cure)}


def _engine(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that set engine parameters before the first step."""
    for each in (*_begin(row, cure, scope), *_set(row, cure, scope)):
        sets = {name: (do, whole_number(value)) for name, (do, value) in each["sets"].items()}
        yield {**each, "sets": sets, "given": True}


def _dynamics(links: Callable[[Body], Sequence[int]]) -> Applies:
    """Make a function that returns operations to set properties of links, such as friction."""
    return lambda row, cure, scope: _of_links(scope.bodies, row.changes(cure), links)


def _of_links(
    bodies: Sequence[Body], sets: Mapping[str, How], links: Callable[[Body], Sequence[int]]
) -> Iterator[Operation]:
    """Yield operations that set link properties after loading, and in later calls that set them."""
    for body in bodies:
        how = {"links": [*links(body)], "link_name": "linkIndex", **_of(body)}
        each = {"do": "add", "call": DYNAMICS, "sets": sets, **how}
        yield {**each, "functions": MAKES}
        yield {**each, "functions": [DYNAMICS], "only_after": True}


def _links(body: Body) -> list[int]:
    return [joint.link for joint in body.joints]


def _all(body: Body) -> list[int]:
    return [-1, *_links(body)]


def _base(_: Body) -> list[int]:
    return [-1]


def _limits(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    everywhere = "maxJointVelocity" in cure.given
    return _of_links(scope.bodies, row.changes(cure), _all if everywhere else scope.links)


def _inertial(_: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that give almost no mass to links without a mass in their file."""
    for body in scope.bodies:
        none = [n - 1 for n, link in enumerate(body.asked.links) if math.isnan(link.mass_kg)]
        links = cure.given.get("links", none)
        yield from _of_links([body], LIGHT, lambda _, links=links: links)  # type: ignore[misc]


def _motors(*modes: int) -> Applies:
    """Make a function that returns operations to change motor commands."""

    def made(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
        sets = row.changes(cure)
        if row.name == "force" and scope.joint is None and not scope.whole:
            sets = {name: (">" if do == "=" else do, n) for name, (do, n) in sets.items()}
        for body in scope.bodies:
            yield {
                "do": "motor",
                "functions": MOTORS,
                "sets": sets,
                "links": None if scope.joint is None else scope.links(body),
                "modes": [*modes],
                **_of(body),
            }

    return made


def _urdf_limits(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that limit motor forces to the finding's force, or to the URDF's effort."""
    motors = _motors(VELOCITY, POSITION, PD)
    if cure.given:
        yield from motors(row, cure, scope)
        return
    for body in scope.bodies:
        for joint in body.joints:
            if joint.effort and scope.joint in (None, joint.name):
                one = replace(scope, bodies=[body], joint=joint.name)
                yield from motors(row, replace(cure, given={"force": joint.effort}), one)


def _motor_off(_: CallRow, __: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that disable default motors at loading.

    Without a named joint, joints that the script commands are left out.
    """
    for body in scope.bodies:
        named = scope.links(body) if scope.joint is not None else []
        for joint in body.joints:
            commanded = (body.number, joint.link) in scope.commanded
            if not joint.widths[0] or (commanded and joint.link not in named):
                continue
            if joint.kind == "spherical":
                call = "setJointMotorControlMultiDof"
                given = (POSITION, [0, 0, 0], [0, 0, 0, 1])
            else:
                call, given = MOTOR, (VELOCITY, 0)  # type: ignore[assignment]
            names = ("controlMode", "force", "targetPosition")
            yield {
                "do": "add",
                "functions": MAKES,
                "call": call,
                "sets": {name: ("=", value) for name, value in zip(names, given, strict=False)},
                "links": [joint.link],
                "link_name": "jointIndex",
                **_of(body),
            }


def _constraint(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that set a constraint's maximum force, at creation and later."""
    (each,) = _set(row, cure, scope)
    yield {**each, "given": True}
    yield {**each, "do": "pull", "functions": ["createConstraint"]}


def _frames(_: CallRow, __: Cure, ___: Scope) -> Iterator[Operation]:
    yield {"do": "frames", "functions": ["createConstraint"]}


def _first(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that set the run's final timestep from the start on, in all calls."""
    last = replace(cure, given={"timeStep": scope.timestep_s})
    yield from (*_begin(row, last, scope), *_set(row, last, scope))


def _repeated(_: CallRow, __: Cure, ___: Scope) -> Iterator[Operation]:
    yield {"do": "again", "functions": ["applyExternalForce", "applyExternalTorque", STEP]}


def _lifted(*functions: str) -> Applies:
    """Make a function that returns operations to move bodies out of each other."""

    def made(row: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
        by_m = [AWAY * (row.number(cure) or 0.0) * each for each in cure.given.get("away", UP)]
        for body in scope.bodies:
            yield {"do": "lift", "functions": [*functions], "by_m": by_m, **_of(body)}

    return made


def _mimic(_: CallRow, __: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield operations that connect mimic joints by gears, with their own motors off."""
    for body in scope.bodies:
        links = {joint.name: joint.link for joint in body.joints}
        for mimic in body.asked.mimics:
            if mimic.joint not in links or mimic.of not in links or not mimic.multiplier:
                continue
            yield {
                "do": "gear",
                "functions": MAKES,
                "links": [links[mimic.of], links[mimic.joint]],
                "ratio": -1 / mimic.multiplier,
                **_of(body),
            }


def _client(_: CallRow, cure: Cure, __: Scope) -> Iterator[Operation]:
    yield {"do": "also", "functions": [cure.given["function"]], "of": cure.given["client"]}


def _without(_: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield the operation that omits the call named in a finding."""
    place = _at(scope)
    if place:
        about = _of(scope.bodies[0]) if cure.form == "of-body" else {}
        yield {**_leave([cure.given["function"]]), **place, **about}


def _without_substeps(_: CallRow, __: Cure, ___: Scope) -> Iterator[Operation]:
    yield _leave([ENGINE], "numSubSteps")


def _redirected(_: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    links = [*map(list, cure.given["links"].items())]
    return ({**each, "links": links} for each in _done("redirect", *MOTORS)(_, cure, scope))


def _apart(_: CallRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Yield the operation that passes some arguments in a call of their own.

    PyBullet ignores them next to certain others.
    """
    arguments = {"arguments": cure.given["arguments"], **_at(scope)}
    yield {"do": "apart", "functions": [DYNAMICS], **arguments}


# -- the rows -------------------------------------------------------------------------------------


def _added(
    function: str, sets: Mapping[str, Becomes], each: str, tries: str, change: str = ""
) -> CallRow:
    return CallRow("", sets, function=function, each=each, tries=tries, change=change)


LEFT, LEFT_BREAKS = "left-out held late", "left-out held"
MOTOR_CALL, PUSH = r"setJointMotorControl\w*", r"applyExternal\w+"
POSITIVE, NUMBERS = "*10 *0.1 =0 default", "*10 *0.1 =0 *-1 default"
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
"""The identity orientation."""
SIZES = r".*\.(halfExtents|radius|height)"
TURNS = r".*\.(\w*[oO]rientation|ornObj)"
PLACES = r"(load|create|resetBase)\w+\.(basePosition|posObj)"
IN_CALLS = (
    (
        rf"{MOTOR_CALL}|setGravity|resetBaseVelocity|enable\w+|createConstraint",
        LEFT,
        LEFT_BREAKS,
    ),
    (PUSH, f"{LEFT} each-step", LEFT_BREAKS),
    (r"(set|change|reset|removeC)\w+", LEFT, ""),
    (rf"({MOTOR_CALL}|{PUSH}|resetJointState)\.(joint|link)Index", "+1 -1", ""),
    (r".*\.\w*(UniqueId[AB]?|Indices|Index[AB]?|Id|Type|Mode|fileName|body[AB])", "", ""),
    (r"loadURDF\.flags", "^2 ^8 ^128 ^4096", ""),
    (rf"{PUSH}\.flags", "^3", ""),
    (r".*\.flags", "", ""),
    (r".*\.(useFixedBase|enableCollision|useMaximalCoordinates)", "^1", ""),
    (r".*\.(timeStep|globalScaling|meshScale)", "*10 *0.1", ""),
    (SIZES, "*10 *0.1", "*0.1"),
    (TURNS, "=default default w-last", ""),
    (PLACES, "*10 *0.1 =0 *-1", "*10 *0.1 =0 *-1"),
    (r".*\.(mass|baseMass|\w*[iI]nertia\w*)", POSITIVE, POSITIVE),
    (rf"{MOTOR_CALL}\.forces?", POSITIVE, "=0"),
    (r".*\.(\w*(Friction|Damping|Stiffness|Gains?|Force)|max\w*Velocity)", POSITIVE, ""),
    (r".*\.(distance|restitution|erp|\w*ERP|num\w+)", POSITIVE, ""),
    (rf"{MOTOR_CALL}\.target\w+", NUMBERS, "=0 default"),
    (rf"{PUSH}\.\w+", NUMBERS, "=0"),
    (r"(setGravity|resetBaseVelocity)\.\w+", NUMBERS, NUMBERS),
    (r".*\..*", NUMBERS, ""),
)
"""Changes to calls that the search for causes tries: function, or function and argument; operators;
and those operators that remove a part of the scene or of the command. The sign of a positive
quantity is never changed, and the quantity never set to 0."""
SEEN = COMMANDS | PUSHES | MAKES_BODIES | MOVES_BODY | CONSTRAINS | SHAPES | IK | SETS_ENGINE
SEEN |= those_that("sets properties", "sets constraints", "sets what is touched", "sets sensors")
SEEN |= those_that("computes dynamics") | {"rayTest", "getClosestPoints", "getLinkState", STEP}
SEEN -= {"setRealTimeSimulation", "setInternalSimFlags", "performCollisionDetection"}
SEES = [{"do": "see", "functions": [name]} for name in sorted(SEEN)]

ROWS = (
    ChangeRow(
        "timestep",
        words="p.setTimeStep(… / {value:g})",
        below="finer",
        usual=2.0,
        whole_run=True,
        change="timestep",
        tries="/4",
    ),
    ChangeRow("iterations", below="iterations", usual=4.0, whole_run=True),
    *(ChangeRow(f"{name}:{FACTOR}", below=name) for name in ("gravity", "friction", "mass")),
    CallRow(
        "substeps",
        makes=_without_substeps,
        words=Message("{value:g} steps of 1/{value:g} of the timestep in place of substeps"),
        below="finer",
        usual=2.0,
        whole_run=True,
    ),
    CallRow(
        "timestep-first",
        makes=_first,
        function="setTimeStep",
        words=Message("p.setTimeStep(…) before motors and constraints get their force"),
        decides=True,
        whole_run=True,
    ),
    # Motors.
    CallRow("force", {"force": raised}, _motors(VELOCITY, POSITION, PD), function=MOTOR),
    CallRow(
        "gains",
        {"positionGain": to(0.1), "velocityGain": always("=", 1.0)},
        _motors(POSITION, PD),
        function=MOTOR,
    ),
    CallRow("urdf-limits", makes=_urdf_limits, function=MOTOR, decides=True),
    CallRow(
        "default-motor-off",
        makes=_motor_off,
        words="p.setJointMotorControl2(…, p.VELOCITY_CONTROL, force=0)",
    ),
    CallRow(
        "default-motor-off:ball",
        makes=_motor_off,
        words="p.setJointMotorControlMultiDof(…, p.POSITION_CONTROL, "
        "targetPosition=[0, 0, 0, 1], force=[0, 0, 0])",
    ),
    CallRow(
        "targets-held",
        makes=_done("hold", "resetJointState", MOTOR),
        words=Message("new targets for the motors after p.{function}"),
        unsaid={"function": "resetJointState"},
    ),
    CallRow(
        "mimic",
        makes=_mimic,
        words=Message(
            "p.createConstraint(…, p.JOINT_GEAR, …) with gearRatio={ratio}, and the motor of joint "
            "{link} off, which else holds both"
        ),
    ),
    CallRow(
        "right-link:joints",
        makes=_redirected,
        words=Message(
            "the answers to the joints that move, for which p.getJointInfo(body, joint)[3] > -1"
        ),
        needs="links",
        decides=True,
    ),
    CallRow(
        "ik",
        {"maxNumIterations": to(1000), "residualThreshold": always("=", 1e-6)},
        _set,
        function="calculateInverseKinematics",
        whole_run=True,
    ),
    # Links and joints.
    CallRow(
        "damping",
        {"linearDamping": to(0.0), "angularDamping": to(0.0)},
        _dynamics(_base),
        function=DYNAMICS,
        decides=True,
        each="links",
        tries="=0",
    ),
    # Of all joints, since a chain's act on each other.
    CallRow(
        "joint-damping",
        {"jointDamping": to(0.0)},
        _dynamics(_links),
        function=DYNAMICS,
        decides=True,
        each="links",
        tries="=0 =1",
    ),
    CallRow(
        "friction",
        {"lateralFriction": times},
        _dynamics(_all),
        function=DYNAMICS,
        each="links",
        tries="=0 =1 =3",
    ),
    CallRow(
        "restitution",
        {"restitution": to(1.0)},
        _dynamics(_all),
        function=DYNAMICS,
        each="links",
        tries="=0",
    ),
    CallRow(
        "limits",  # that nothing reaches [rad, m]
        {"jointLowerLimit": always("=", -1e3), "jointUpperLimit": always("=", 1e3)},
        _limits,
        function=DYNAMICS,
    ),
    CallRow(
        "mass",
        {"mass": to(1.0)},
        _dynamics(_base),
        function=DYNAMICS,
        each="links",
        tries="*0.1 *10",
        breaks="*0.1 *10",
    ),
    CallRow(
        "mass:made",
        {"baseMass": to(1.0)},
        _set_of("createMultiBody"),
        function="createMultiBody",
    ),
    CallRow("inertial", makes=_inertial, words=Message("an <inertial> of its own for each link")),
    CallRow(
        "right-link",
        makes=_apart,
        words=Message("{arguments} in a call of its own"),
        needs="arguments",
        decides=True,
    ),
    # As a body is loaded or placed.
    CallRow(
        "inertia-from-file",
        {"flags": always("|", INERTIA_FROM_FILE)},
        _set_of("loadURDF"),
        words="p.loadURDF(…, flags=p.URDF_USE_INERTIA_FROM_FILE)",
        decides=True,
    ),
    CallRow(
        "collision-off",
        {"flags": always("~", SELF_COLLISION)},
        _set_of("loadURDF", "loadMJCF"),
        words=Message("without URDF_USE_SELF_COLLISION"),
        decides=True,
    ),
    CallRow(
        "concave",
        {"flags": always("|", CONCAVE)},
        _set,
        function="createCollisionShape",
        words="p.createCollisionShape(…, flags=p.GEOM_FORCE_CONCAVE_TRIMESH)",
        decides=True,
        whole_run=True,
    ),
    CallRow("lifted", makes=_lifted(*MAKES), words=FARTHER, usual=LIFTED_M),
    CallRow("lifted:set", makes=_lifted(POSE), words=FARTHER, usual=LIFTED_M),
    CallRow(
        "lifted:frame",
        makes=_done("frame", POSE),
        words="p.resetBasePositionAndOrientation(body, *p.multiplyTransforms(position, "
        "orientation, *p.getDynamicsInfo(body, -1)[3:5]))",
    ),
    CallRow(
        "support-velocity",
        makes=_done("carry", POSE),
        words=Message("p.resetBaseVelocity(…) with each pose that is set"),
    ),
    # The engine.
    CallRow(
        "solver",
        {"numSolverIterations": to(500)},
        _engine,
        function=ENGINE,
        whole_run=True,
        tries="=1000",
    ),
    CallRow(
        "cone",
        {"enableConeFriction": to(1)},
        _engine,
        function=ENGINE,
        decides=True,
        whole_run=True,
        tries="=0",
    ),
    CallRow(
        "pairs-sorted",
        {"deterministicOverlappingPairs": to(1)},
        _engine,
        function=ENGINE,
        decides=True,
        whole_run=True,
    ),
    CallRow(
        "collision-off:both-masks",
        {"collisionFilterMode": to(0)},
        _begin,
        function=ENGINE,
        decides=True,
    ),
    CallRow(
        "gravity",
        {"gravX": always("=", 0.0), "gravY": always("=", 0.0), "gravZ": to(-9.81)},
        _begin,
        function="setGravity",
        words="p.setGravity(0, 0, {value:g})",
        usual=-9.81,
        decides=True,
        whole_run=True,
        tries="=0 =-9.81",
        breaks="=0",
    ),
    CallRow(
        "right-client",
        makes=_client,
        words="p.{function}(…, physicsClientId={client})",
        needs="function",
        decides=True,
        whole_run=True,
    ),
    # Constraints and pushes.
    CallRow(
        "constraint-force",
        {"maxForce": raised},
        _constraint,
        function=CONSTRAINT,
        whole_run=True,
        each="constraints",
        tries="=50",
    ),
    CallRow(
        "constraint-force:less",
        {"maxForce": always("*", 1 / MORE)},
        _constraint,
        function=CONSTRAINT,
        whole_run=True,
    ),
    CallRow(
        "constraint-frames",
        makes=_frames,
        words=Message(
            "p.createConstraint with the parentFramePosition and childFramePosition of one and the "
            "same point"
        ),
        decides=True,
        whole_run=True,
    ),
    CallRow(
        "constraint-frames:turned",
        makes=_frames,
        words=Message(
            "p.createConstraint with the parentFrameOrientation and childFrameOrientation of one "
            "and the same frame"
        ),
        decides=True,
        whole_run=True,
    ),
    CallRow(
        "push-repeated",
        makes=_repeated,
        words=Message("p.{function} before each p.stepSimulation() in which it is to act"),
        unsaid={"function": "applyExternalForce"},
        whole_run=True,
    ),
    CallRow(
        "push-at-centre",
        makes=_done("centre", "applyExternalForce"),
        words=Message("the point in p.{frame}, or at the centre of the body"),
        unsaid={"frame": "LINK_FRAME"},
        decides=True,
    ),
    # What only the causal search adds, before the first step.
    _added(
        "setJointMotorControl2",
        {"force": to(0), "controlMode": always("=", VELOCITY)},
        "joints",
        "=0",
    ),
    _added(
        "setJointMotorControl2",
        {
            "force": to(0),
            "controlMode": always("=", POSITION),
            "targetPosition": always("+", 0.0),
        },
        "joints",
        "=1000",
    ),
    *(
        _added(DYNAMICS, dict.fromkeys(names.split(), to(0)), "links", tries)
        for names, tries in (
            ("rollingFriction spinningFriction", "=0.001"),
            ("contactStiffness contactDamping", "=-1"),
            ("maxJointVelocity", "=100000"),
            ("ccdSweptSphereRadius", "=0.01"),
        )
    ),
    *(
        _added(ENGINE, {name: to(0)}, "", tries)
        for name, tries in (("numSubSteps", "=10"), ("useSplitImpulse", "=1"))
    ),
    _added(CONSTRAINT, {"erp": to(0)}, "constraints", "=0.9"),
    _added("setCollisionFilterPair", {"enableCollision": to(0)}, "pairs", "=0"),
    _added(
        POSE,
        {"posObj": always("+", [0.0, 0.0, LIFTED_M]), "ornObj": always("+", [0.0] * 4)},
        "bodies",
        f"+{LIFTED_M}",
        "start.base",
    ),
    # What the search changes in calls that the script makes, by function and argument: the first
    # pattern counts.
    *(
        ChangeRow(
            "",
            change=each,
            tries=tries,
            breaks=breaks,
            default=UPRIGHT if each == TURNS else 0.0,
            is_geometry=each in (SIZES, PLACES, TURNS),
        )
        for each, tries, breaks in IN_CALLS
    ),
    # Calls left out.
    CallRow("without", makes=_without, words=Message("without p.{function}(…)"), needs="function"),
    ChangeRow("without:argument", words=Message("without p.{function}(…, {argument}=…)")),
    CallRow(
        "without:of-body",
        makes=_without,
        words=Message("without p.{function}(…) of that body"),
        needs="function",
    ),
    CallRow(
        "without:vertical",
        makes=_done("fall", "resetBaseVelocity"),
        words=Message("its vertical velocity handed on: p.getBaseVelocity(body)[0][2]"),
    ),
    CallRow(
        "without:driven",
        makes=_done("drive", "resetJointState", STEP),
        words=Message("p.setJointMotorControl2(…, p.POSITION_CONTROL, …) in its place"),
    ),
)


FLAGS = {
    2: "p.URDF_USE_INERTIA_FROM_FILE",
    8: "p.URDF_USE_SELF_COLLISION",
    16: "p.URDF_USE_SELF_COLLISION_EXCLUDE_PARENT",
    32: "p.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS",
    128: "p.URDF_USE_IMPLICIT_CYLINDER",
    256: "p.URDF_GLOBAL_VELOCITIES_MB",
    2048: "p.URDF_ENABLE_SLEEPING",
    4096: "p.URDF_INITIALIZE_SAT_FEATURES",
    8192: "p.URDF_USE_SELF_COLLISION_INCLUDE_PARENT",
    131072: "p.URDF_MAINTAIN_LINK_ORDER",
    524288: "p.URDF_MERGE_FIXED_LINKS",
    2097152: "p.URDF_IGNORE_COLLISION_SHAPES",
}
"""Load flags that affect the physics, by bit."""
BOTH_FRAMES = {3: "p.LINK_FRAME, p.WORLD_FRAME"}


def _words_of(change: Change) -> str:
    """Describe a change for a reader, with the script line of its call."""
    function, _, argument = change.change.partition(".")
    added = change.how[1]
    place = "" if change.site is None else f" ({change.site[0]}:{change.site[1]})"
    if isinstance(added, Mapping):
        signs = {"=": "=", "*": "×"}
        sets = [
            f"{name}{signs[do]}{value}"
            for name, (do, value) in added["sets"].items()
            if do in signs
        ]
        call = f"p.{added['call']}(…, {', '.join(sets)})"
        of = named(change.target)
        where = Message("before the first step{place}", place=place)
        return (
            Message("{call} added for {of} {where}", call=call, of=of, where=where)
            if of
            else Message("{call} added {where}", call=call, where=where)
        )
    what = f"{argument} of p.{function}" if argument else f"p.{function}"
    if function == TIMESTEP:
        what = function
    if change.of and not change.bodies and any(change.target):  # only for some of its elements
        what = Message("{call} for {elements}", call=what, elements=named(change.target))
    how = done(change.op)
    if argument == "flags" and change.op[0] == "^":
        flags = BOTH_FRAMES if function in PUSHES else FLAGS
        flag = flags.get(int(change.op[1:]), change.op[1:])
        how = Message("with {flag} switched", flag=flag)
    return Message("{what}{place} {how}", what=what, place=place, how=how)


INTERVENTIONS = Interventions(
    ROWS, dict.fromkeys(PARAMETERS, ()), _set_parameter, SEES, trial_of, _words_of, played
)
