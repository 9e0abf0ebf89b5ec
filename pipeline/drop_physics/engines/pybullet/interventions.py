"""Interventions in PyBullet's words: a cure as the call that makes it, and as a changed run.

`call_of` writes a cure as its user would; `applied` turns it into what `watch/intervene.py` does in
the script's interpreter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from drop_physics.engines.pybullet.watch.arguments import ARGUMENTS, CLIENT
from drop_physics.messages import Message
from drop_physics.trace.cures import ChangedRun, Cure, Scope, below, whole_number
from drop_physics.trace.events import Body

Operation = dict[str, Any]
Values = Mapping[str, Any]
Applies = Callable[[Scope, Cure], Iterator[Operation]]

MOTORS = [
    "setJointMotorControl2",
    "setJointMotorControlArray",
    "setJointMotorControlMultiDof",
    "setJointMotorControl",
]
MAKES = ["loadURDF", "loadMJCF", "loadSDF", "createMultiBody", "loadBullet"]
BEGINS = ["connect", "resetSimulation"]
ENGINE, DYNAMICS, STEP = "setPhysicsEngineParameter", "changeDynamics", "stepSimulation"
POSE = "resetBasePositionAndOrientation"
VELOCITY, POSITION, PD = 0, 2, 3
"""`controlMode` of a motor call."""
INERTIA_FROM_FILE, SELF_COLLISION, CONCAVE = 2, 8 | 16 | 32, 1
"""Flags: URDF_USE_INERTIA_FROM_FILE, the URDF_USE_SELF_COLLISION…, GEOM_FORCE_CONCAVE_TRIMESH."""
MORE = 10.0
"""Factor for a value to be raised or lowered, if an advice gives no number."""
LIGHT_KG, LIGHT_KG_M2 = 1e-3, 1e-6
"""Mass and inertia of a link that is to weigh nothing; with less, the solver fails."""
UP, LIFTED_M = (0.0, 0.0, 1.0), 0.01
"""Direction and distance by which a body is moved, if no depth is known."""
RESIDUAL, TIMESTEPS = "solverResidualThreshold", ("fixedTimeStep", "numSubSteps", "timestep")
PARAMETERS = {*ARGUMENTS[ENGINE]}.difference(TIMESTEPS, [CLIENT])
"""Parameters of the engine that `parameter` sets; `timestep` varies timesteps."""
WIDE = 1e3
"""A joint limit that nothing reaches [rad, m]."""


# -- a cure as a call -----------------------------------------------------------------------------

FUNCTIONS = {
    "force": "setJointMotorControl2",
    "gains": "setJointMotorControl2",
    "urdf-limits": "setJointMotorControl2",
    "solver": ENGINE,
    "cone": ENGINE,
    "pairs-sorted": ENGINE,
    "damping": DYNAMICS,
    "joint-damping": DYNAMICS,
    "friction": DYNAMICS,
    "restitution": DYNAMICS,
    "limits": DYNAMICS,
    "mass": DYNAMICS,
    "ik": "calculateInverseKinematics",
    "constraint-force": "changeConstraint",
}
"""The function whose arguments a cure gives."""
CALLS = {
    "default-motor-off": "p.setJointMotorControl2(…, p.VELOCITY_CONTROL, force=0)",
    "default-motor-off:ball": "p.setJointMotorControlMultiDof(…, p.POSITION_CONTROL, "
    "targetPosition=[0, 0, 0, 1], force=[0, 0, 0])",
    "substeps": Message("{value:g} steps of 1/{value:g} of the timestep in place of substeps"),
    "timestep": "p.setTimeStep(… / {value:g})",
    "timestep-first": Message("p.setTimeStep(…) before motors and constraints get their force"),
    "inertia-from-file": "p.loadURDF(…, flags=p.URDF_USE_INERTIA_FROM_FILE)",
    "mimic": Message(
        "p.createConstraint(…, p.JOINT_GEAR, …) with gearRatio={ratio}, and the motor of joint "
        "{link} off, which else holds both"
    ),
    "targets-held": Message("new targets for the motors after p.{function}"),
    "constraint-frames": Message(
        "p.createConstraint with the parentFramePosition and childFramePosition of one and the "
        "same point"
    ),
    "constraint-frames:turned": Message(
        "p.createConstraint with the parentFrameOrientation and childFrameOrientation of one and "
        "the same frame"
    ),
    "collision-off": Message("without URDF_USE_SELF_COLLISION"),
    "collision-off:both-masks": "p.setPhysicsEngineParameter(…, collisionFilterMode=0)",
    "push-repeated": Message("p.{function} before each p.stepSimulation() in which it is to act"),
    "push-at-centre": Message("the point in p.{frame}, or at the centre of the body"),
    "concave": "p.createCollisionShape(…, flags=p.GEOM_FORCE_CONCAVE_TRIMESH)",
    "gravity": "p.setGravity(0, 0, {value:g})",
    "right-client": "p.{function}(…, physicsClientId={client})",
    "right-link": Message("{arguments} in a call of its own"),
    "right-link:joints": Message(
        "the answers to the joints that move, for which p.getJointInfo(body, joint)[3] > -1"
    ),
    "inertial": Message("an <inertial> of its own for each link"),
    "lifted": Message("{mm:.3g} mm farther away"),
    "lifted:set": Message("{mm:.3g} mm farther away"),
    "lifted:frame": "p.resetBasePositionAndOrientation(body, *p.multiplyTransforms(position, "
    "orientation, *p.getDynamicsInfo(body, -1)[3:5]))",
    "support-velocity": Message("p.resetBaseVelocity(…) with each pose that is set"),
    "mass:made": "p.createMultiBody(…, baseMass={value:g})",
    "without": Message("without p.{function}(…)"),
    "without:argument": Message("without p.{function}(…, {argument}=…)"),
    "without:of-body": Message("without p.{function}(…) of that body"),
    "without:vertical": Message("its vertical velocity handed on: p.getBaseVelocity(body)[0][2]"),
    "without:driven": Message("p.setJointMotorControl2(…, p.POSITION_CONTROL, …) in its place"),
}
"""Calls of cures that are more than the arguments of a function, by name and form."""
UNSAID = {
    **dict.fromkeys(("ratio", "link", "client", "arguments", "argument"), "…"),
    "function": "resetJointState",
    "frame": "LINK_FRAME",
}
"""Placeholder names in a call, for a cure that is tried by its name alone."""
USUAL = {"gravity": -9.81, "timestep": 2.0, "substeps": 2.0, "mass": 1.0, "lifted": LIFTED_M}
"""Default values of a cure without a number."""


def call_of(cure: Cure) -> str:
    """Return the call that a user would write for a cure."""
    text = CALLS.get(_key(cure))
    if text is not None:
        given = {
            name: ", ".join(map(str, each)) if isinstance(each, list) else each
            for name, each in cure.given.items()
        }
        number = _number(cure)
        return Message(text, **{**UNSAID, "value": number, "mm": 1e3 * number, **given})
    function = FUNCTIONS.get(cure.name)
    if function is None:
        return cure.name
    factors = _factors(cure)
    shown = [
        f"{name}*{each:.3g}" if each > 1 else f"{name}/{1 / each:.3g}"
        for name, each in factors.items()
    ]
    shown += [f"{name}={each:g}" for name, each in _values(cure).items() if name not in factors]
    return f"p.{function}(…, {', '.join(shown)})"


def _number(cure: Cure) -> float:
    return USUAL.get(cure.name, 0.0) if cure.value is None else cure.value


def _key(cure: Cure) -> str:
    return f"{cure.name}:{cure.form}" if cure.form else cure.name


def _factors(cure: Cure) -> dict[str, float]:
    """Return the factors of arguments, if no number is known."""
    match cure.name, cure.form:
        case "force", _ if cure.value is None:
            return {"force": MORE}
        case "friction", _:
            return {"lateralFriction": cure.value or MORE}
        case "constraint-force", "less":
            return {"maxForce": 1 / MORE}
        case "constraint-force", _ if cure.value is None:
            return {"maxForce": MORE}
    return {}


def _values(cure: Cure) -> Values:
    """Return the arguments that a cure gives, by their names."""
    if cure.given or cure.name not in GIVEN:
        return cure.given
    first, others = GIVEN[cure.name]
    of_value = {} if cure.value is None else dict.fromkeys(first, cure.value)
    return {**others, **of_value}


GIVEN: dict[str, tuple[tuple[str, ...], dict[str, float]]] = {
    "force": (("force",), {}),
    "gains": (("positionGain",), {"positionGain": 0.1, "velocityGain": 1.0}),
    "solver": (("numSolverIterations",), {"numSolverIterations": 500}),
    "cone": ((), {"enableConeFriction": 1}),
    "pairs-sorted": ((), {"deterministicOverlappingPairs": 1}),
    "damping": (
        ("linearDamping", "angularDamping"),
        {"linearDamping": 0.0, "angularDamping": 0.0},
    ),
    "joint-damping": (("jointDamping",), {"jointDamping": 0.0}),
    "restitution": (("restitution",), {"restitution": 1.0}),
    "mass": (("mass",), {"mass": 1.0}),
    "limits": ((), {"jointLowerLimit": -WIDE, "jointUpperLimit": WIDE}),
    "ik": (("maxNumIterations",), {"maxNumIterations": 1000, "residualThreshold": 1e-6}),
    "constraint-force": (("maxForce",), {}),
}
"""Arguments that take a cure's value, and their defaults without one."""


# -- what a run does otherwise --------------------------------------------------------------------


def applied(cure: Cure, scope: Scope) -> ChangedRun | None:
    """Return the run with a cure; None if this engine does not support it."""
    if cure.name == "parameter":
        name = cure.given["name"]
        value = whole_number(cure.value or 0.0)
        return ChangedRun(below={"engine": {name: value}}) if name in PARAMETERS else None
    if cure.name == "substeps":
        return ChangedRun([_leave([ENGINE], "numSubSteps")], {"finer": int(_number(cure))})
    run = below(cure)
    if run is not None:
        return run
    made = TABLE.get(_key(cure))
    if made is None or NEEDS.get(_key(cure), "") not in ("", *cure.given):
        return None
    operations = [*made(scope, cure)]
    return ChangedRun(operations) if operations else None


def left_out(function: str, file: str, line: int, argument: str | None) -> ChangedRun:
    """Return a run without a call, or without one of its arguments."""
    left = [] if argument is None else [argument]
    return ChangedRun([{**_leave([function], *left), "site": [file, line]}])


def _leave(functions: list[str], *arguments: str) -> Operation:
    """Return the operation that leaves out a call, or arguments of it."""
    return {"do": "leave", "functions": functions, "arguments": [*arguments]}


def _of(body: Body) -> Operation:
    return {"client": body.client, "body": body.engine_id}


def _at(scope: Scope) -> Operation:
    """Return the file and line of a finding's call, as an operation names them; none without."""
    file, _, line = (scope.site or "").rpartition(":")
    return {"site": [file, int(line)]} if file and line.isdecimal() else {}


def _begins(call: str, values: Values) -> Operation:
    """Return the operation of a call at the beginning of each simulation."""
    return {"do": "add", "functions": BEGINS, "call": call, "values": values}


def _set(*functions: str) -> Operation:
    return {"do": "set", "functions": [*functions]}


def _done(do: str, *functions: str) -> Applies:
    """Return the operations on calls about each body."""
    return lambda scope, _: (
        {"do": do, "functions": [*functions], **_of(body)} for body in scope.bodies
    )


def _engine(_: Scope, cure: Cure) -> Iterator[Operation]:
    """Yield operations that set parameters of the engine from the beginning on."""
    values = {name: whole_number(each) for name, each in _values(cure).items()}
    yield _begins(ENGINE, values)
    yield {**_set(ENGINE), "values": values, "given": True}


def _dynamics(
    bodies: Sequence[Body],
    values: Values,
    links: Callable[[Body], Sequence[int]],
    factors: Mapping[str, float] | None = None,
) -> Iterator[Operation]:
    """Yield operations that set properties of links, after each load and call that sets them."""
    for body in bodies:
        each = {
            "do": "add",
            "call": DYNAMICS,
            "values": values,
            "factors": factors or {},
            "links": [*links(body)],
            "link_name": "linkIndex",
            **_of(body),
        }
        yield {**each, "functions": MAKES}
        yield {**each, "functions": [DYNAMICS], "only_after": True}


def _only(links: list[int]) -> Callable[[Body], list[int]]:
    return lambda _: links


def _all(body: Body) -> list[int]:
    return [-1, *_links(body)]


def _links(body: Body) -> list[int]:
    return [joint.link for joint in body.joints]


def _base(_: Body) -> list[int]:
    return [-1]


def _motors(*modes: int) -> Applies:
    """Return the operations on motor calls; of several joints, each gets at least a force."""

    def made(scope: Scope, cure: Cure) -> Iterator[Operation]:
        for body in scope.bodies:
            yield {
                "do": "motor",
                "functions": MOTORS,
                "values": _values(cure),
                "factors": _factors(cure),
                "least": cure.name == "force" and scope.joint is None and not scope.whole,
                "links": None if scope.joint is None else scope.links(body),
                "modes": [*modes],
                **_of(body),
            }

    return made


def _urdf_limits(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give motors the force of a finding, or the effort that their file allows."""
    motors = _motors(VELOCITY, POSITION, PD)
    if cure.given:
        yield from motors(scope, cure)
        return
    for body in scope.bodies:
        for joint in body.joints:
            if joint.effort and scope.joint in (None, joint.name):
                one = replace(scope, bodies=[body], joint=joint.name)
                yield from motors(one, replace(cure, given={"force": joint.effort}))


def _motor_off(scope: Scope, _: Cure) -> Iterator[Operation]:
    """Switch off motors after the load: those that no call commands, and the named one."""
    for body in scope.bodies:
        named = scope.links(body) if scope.joint is not None else []
        for joint in body.joints:
            if not joint.widths[0]:
                continue
            if joint.link not in named and (body.number, joint.link) in scope.commanded:
                continue
            off: Operation = {
                "do": "add",
                "functions": MAKES,
                "link_name": "jointIndex",
                **_of(body),
            }
            if joint.kind == "spherical":
                off["call"] = "setJointMotorControlMultiDof"
                off["fixed"] = {
                    "controlMode": POSITION,
                    "targetPosition": [0, 0, 0, 1],
                    "force": [0, 0, 0],
                }
            else:
                off["call"] = "setJointMotorControl2"
                off["fixed"] = {"controlMode": VELOCITY, "force": 0}
            yield {**off, "links": [joint.link]}


def _damping(scope: Scope, cure: Cure) -> Iterator[Operation]:
    yield from _dynamics(scope.bodies, _values(cure), _base)


def _joint_damping(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Remove the damping of joints: of all, since a chain's joints act on each other."""
    yield from _dynamics(scope.bodies, _values(cure), _links)


def _friction(scope: Scope, cure: Cure) -> Iterator[Operation]:
    yield from _dynamics(scope.bodies, {}, _all, _factors(cure))


def _restitution(scope: Scope, cure: Cure) -> Iterator[Operation]:
    yield from _dynamics(scope.bodies, _values(cure), _all)


def _limits(scope: Scope, cure: Cure) -> Iterator[Operation]:
    everywhere = "maxJointVelocity" in cure.given
    yield from _dynamics(scope.bodies, _values(cure), _all if everywhere else scope.links)


def _mass(scope: Scope, cure: Cure) -> Iterator[Operation]:
    yield from _dynamics(scope.bodies, _values(cure), _base)


def _mass_made(scope: Scope, cure: Cure) -> Iterator[Operation]:
    values = {"baseMass": _number(cure)}
    return ({**_set("createMultiBody"), "values": values, **_of(body)} for body in scope.bodies)


def _inertial(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give links whose file gives no mass next to none."""
    for body in scope.bodies:
        none = [n - 1 for n, each in enumerate(body.asked.links) if math.isnan(each.mass_kg)]
        links = cure.given.get("links", none)
        values = {"mass": LIGHT_KG, "localInertiaDiagonal": [LIGHT_KG_M2] * 3}
        yield from _dynamics([body], values, _only(links))


def _inertia(scope: Scope, _: Cure) -> Iterator[Operation]:
    flags = {"flags": INERTIA_FROM_FILE}
    return ({**_set("loadURDF"), "flags": flags, **_of(body)} for body in scope.bodies)


def _collision(scope: Scope, _: Cure) -> Iterator[Operation]:
    """Load bodies without self-collision."""
    flags = {"flags": {"flags": 0}, "clear": SELF_COLLISION}
    return ({**_set("loadURDF", "loadMJCF"), **flags, **_of(body)} for body in scope.bodies)


def _concave(_: Scope, __: Cure) -> Iterator[Operation]:
    yield {**_set("createCollisionShape"), "flags": {"flags": CONCAVE}}


def _both_masks(_: Scope, __: Cure) -> Iterator[Operation]:
    yield _begins(ENGINE, {"collisionFilterMode": 0})


def _constraint(_: Scope, cure: Cure) -> Iterator[Operation]:
    """Give constraints a force: when they are made, and in each call that sets another."""
    factors, values = _factors(cure), _values(cure)
    given = {"factors": factors} if factors else {"values": values, "given": True}
    yield {**_set("changeConstraint"), **given}
    yield {"do": "pull", "functions": ["createConstraint"], "factors": factors, "values": values}


def _frames(_: Scope, __: Cure) -> Iterator[Operation]:
    yield {"do": "frames", "functions": ["createConstraint"]}


def _gravity(_: Scope, cure: Cure) -> Iterator[Operation]:
    yield _begins("setGravity", {"gravX": 0.0, "gravY": 0.0, "gravZ": _number(cure)})


def _first(scope: Scope, _: Cure) -> Iterator[Operation]:
    """Set the last timestep at the beginning, and in each call that would set another."""
    last = {"timeStep": scope.timestep_s}
    yield _begins("setTimeStep", last)
    yield {**_set("setTimeStep"), "values": last}


def _ik(_: Scope, cure: Cure) -> Iterator[Operation]:
    values = {
        name: int(each) if name == "maxNumIterations" else each
        for name, each in _values(cure).items()
    }
    yield {**_set("calculateInverseKinematics"), "values": values}


def _repeated(_: Scope, __: Cure) -> Iterator[Operation]:
    yield {"do": "again", "functions": ["applyExternalForce", "applyExternalTorque", STEP]}


def _lifted(*functions: str) -> Applies:
    """Place bodies farther away, a thousandth more than asked for."""

    def made(scope: Scope, cure: Cure) -> Iterator[Operation]:
        by_m = [1.001 * _number(cure) * each for each in cure.given.get("away", UP)]
        for body in scope.bodies:
            yield {"do": "lift", "functions": [*functions], "by_m": by_m, **_of(body)}

    return made


def _mimic(scope: Scope, _: Cure) -> Iterator[Operation]:
    """Connect joints that should follow others by gears, with their own motors off."""
    for body in scope.bodies:
        links = {joint.name: joint.link for joint in body.joints}
        for each in body.asked.mimics:
            if each.joint not in links or each.of not in links or not each.multiplier:
                continue
            yield {
                "do": "gear",
                "functions": MAKES,
                "links": [links[each.of], links[each.joint]],
                "ratio": -1 / each.multiplier,
                **_of(body),
            }


def _client(_: Scope, cure: Cure) -> Iterator[Operation]:
    yield {"do": "also", "functions": [cure.given["function"]], "of": cure.given["client"]}


def _without(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Leave out the call of a finding."""
    place = _at(scope)
    if place:
        about = _of(scope.bodies[0]) if cure.form == "of-body" else {}
        yield {**_leave([cure.given["function"]]), **place, **about}


def _redirected(scope: Scope, cure: Cure) -> Iterator[Operation]:
    links = [*map(list, cure.given["links"].items())]
    for body in scope.bodies:
        yield {"do": "redirect", "functions": MOTORS, "links": links, **_of(body)}


def _apart(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give arguments of a finding's call in an additional call."""
    yield {
        "do": "apart",
        "functions": [DYNAMICS],
        "arguments": cure.given["arguments"],
        **_at(scope),
    }


TABLE: dict[str, Applies] = {
    "force": _motors(VELOCITY, POSITION, PD),
    "default-motor-off": _motor_off,
    "default-motor-off:ball": _motor_off,
    "gains": _motors(POSITION, PD),
    "urdf-limits": _urdf_limits,
    "damping": _damping,
    "joint-damping": _joint_damping,
    "friction": _friction,
    "restitution": _restitution,
    "solver": _engine,
    "cone": _engine,
    "pairs-sorted": _engine,
    "inertia-from-file": _inertia,
    "collision-off": _collision,
    "collision-off:both-masks": _both_masks,
    "concave": _concave,
    "constraint-force": _constraint,
    "constraint-force:less": _constraint,
    "constraint-frames": _frames,
    "constraint-frames:turned": _frames,
    "gravity": _gravity,
    "timestep-first": _first,
    "limits": _limits,
    "ik": _ik,
    "targets-held": _done("hold", "resetJointState", MOTORS[0]),
    "support-velocity": _done("carry", POSE),
    "push-repeated": _repeated,
    "push-at-centre": _done("centre", "applyExternalForce"),
    "lifted": _lifted(*MAKES),
    "lifted:set": _lifted(POSE),
    "lifted:frame": _done("frame", POSE),
    "mimic": _mimic,
    "mass": _mass,
    "mass:made": _mass_made,
    "right-client": _client,
    "right-link": _apart,
    "right-link:joints": _redirected,
    "inertial": _inertial,
    "without": _without,
    "without:of-body": _without,
    "without:vertical": _done("fall", "resetBaseVelocity"),
    "without:driven": _done("drive", "resetJointState", STEP),
}
"""The function that makes each cure, by name and form; `timestep` and `substeps` are separate."""
NEEDS = {
    "right-client": "function",
    "right-link": "arguments",
    "right-link:joints": "links",
    "without": "function",
    "without:of-body": "function",
}
"""Values that a cure needs, by name and form, and that only a finding knows."""
