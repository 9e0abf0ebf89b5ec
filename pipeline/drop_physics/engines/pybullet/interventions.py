"""Interventions in PyBullet's words: what an advice asks for, and what a run does otherwise.

An advice names a call; `proposed` reads which intervention that is, with the advice's own numbers.
`operations` turns an intervention into what `watch/intervene.py` does in the script's interpreter.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drop_physics.trace.events import Body

Operation = dict[str, Any]
Values = dict[str, float]

MOTORS = ["setJointMotorControl2", "setJointMotorControlArray", "setJointMotorControlMultiDof"]
MAKES = ["loadURDF", "loadMJCF", "loadSDF", "createMultiBody", "loadBullet"]
BEGINS = ["connect", "resetSimulation"]
ENGINE, DYNAMICS, STEP = "setPhysicsEngineParameter", "changeDynamics", "stepSimulation"
VELOCITY, TORQUE, POSITION = 0, 1, 2
"""`controlMode` of a motor call."""
INERTIA_FROM_FILE, SELF_COLLISION, CONCAVE = 2, 8 | 16 | 32, 1
"""Flags: URDF_USE_INERTIA_FROM_FILE, the URDF_USE_SELF_COLLISION…, GEOM_FORCE_CONCAVE_TRIMESH."""
MORE = 10.0
"""Factor of what is to be raised or lowered where an advice gives no number."""
WIDE = 1e3
"""A joint limit that nothing reaches [rad, m]."""


@dataclass(frozen=True)
class Proposed:
    """An intervention that an advice names."""

    name: str
    call: str
    """What its user would write."""
    value: float | None = None
    arguments: Values = field(default_factory=dict)
    """What is given, by argument."""
    operations: Operation | None = None
    """What is done, of an advice about one call."""


# -- what an advice asks for ----------------------------------------------------------------------

CALL = re.compile(r"p\.(\w+)\(((?:[^()\[\]]|\[[^\]]*\])*)\)")
ARGUMENT = re.compile(r"(\w+)=(-?[\d.]+(?:e[+-]?\d+)?|…)")
LENGTH = re.compile(r"place it at least ([\d.e+-]+) mm farther away")
WANTED = re.compile(r"coefficients well above ([\d.e+-]+)")
COEFFICIENT = re.compile(r"\(coefficient ([\d.e+-]+)\)")
SUBSTEPS = re.compile(r"set the timestep to 1/(\d+) of it")
ADVISED: dict[tuple[str, str], str] = {
    ("setJointMotorControl2", "force"): "force",
    ("setJointMotorControl2", "positionGain"): "gains",
    ("setJointMotorControl2", "velocityGain"): "gains",
    ("setJointMotorControl2", "targetVelocity"): "gains",
    ("setJointMotorControl2", "maxVelocity"): "urdf-limits",
    (ENGINE, "deterministicOverlappingPairs"): "pairs-sorted",
    (ENGINE, "numSolverIterations"): "solver",
    (ENGINE, "enableConeFriction"): "cone",
    (ENGINE, "contactERP"): "solver",
    (ENGINE, "restitutionVelocityThreshold"): "restitution",
    (DYNAMICS, "linearDamping"): "damping",
    (DYNAMICS, "jointDamping"): "joint-damping",
    (DYNAMICS, "mass"): "mass",
    (DYNAMICS, "restitution"): "restitution",
    (DYNAMICS, "lateralFriction"): "friction",
    (DYNAMICS, "maxJointVelocity"): "limits",
    (DYNAMICS, "contactProcessingThreshold"): "restitution",
    ("calculateInverseKinematics", "maxNumIterations"): "ik",
    ("changeConstraint", "maxForce"): "constraint-force",
}
"""Interventions by function and the first of its arguments that decides."""
UNGIVEN: dict[str, float] = {"restitutionVelocityThreshold": 0.0, "maxJointVelocity": 1e5}
"""What is tried where an advice leaves the number to its reader."""
SAID: tuple[tuple[str, str, str], ...] = (
    (
        "VELOCITY_CONTROL, force=0",
        "default-motor-off",
        "p.setJointMotorControl2(…, p.VELOCITY_CONTROL, force=0)",
    ),
    (
        "POSITION_CONTROL, targetPosition=[0, 0, 0, 1], force=[0, 0, 0]",
        "default-motor-off",
        "p.setJointMotorControlMultiDof(…, force=[0, 0, 0])",
    ),
    ("URDF_USE_INERTIA_FROM_FILE", "inertia-from-file", "flags=p.URDF_USE_INERTIA_FROM_FILE"),
    (
        "parentFramePosition and childFramePosition",
        "constraint-frames",
        "p.createConstraint(…) where the bodies are",
    ),
    ("call p.setGravity(0, 0, -9.81)", "gravity", "p.setGravity(0, 0, -9.81)"),
    ("give the motors new targets after", "targets-held", "the reset positions as targets"),
    ("p.resetBaseVelocity(", "support-velocity", "p.resetBaseVelocity(…) of the moved body"),
    (
        "before each p.stepSimulation() in which it is to act",
        "push-repeated",
        "the push before each step",
    ),
    ("give it in p.LINK_FRAME, or", "push-at-centre", "the push at the centre"),
    ("give it in p.WORLD_FRAME, or", "push-at-centre", "the push at the centre"),
    ("load it without URDF_USE_SELF_COLLISION", "collision-off", "without URDF_USE_SELF_COLLISION"),
    ("flags=p.GEOM_FORCE_CONCAVE_TRIMESH", "concave", "flags=p.GEOM_FORCE_CONCAVE_TRIMESH"),
    ("JOINT_GEAR", "mimic", "p.createConstraint(…, p.JOINT_GEAR, …)"),
    ("give it more force", "force", f"force*{MORE:g}"),
    ("or other limits by p.changeDynamics(", "limits", "wider limits by p.changeDynamics(…)"),
    (
        "call p.setTimeStep before the motors are commanded",
        "timestep-first",
        "p.setTimeStep(…) first",
    ),
    ("call p.setTimeStep once, before the first motor", "timestep-first", "p.setTimeStep(…) first"),
)
"""Words of an advice that are an intervention, and its call."""


def proposed(advice: str, about: str, *, timestep_s: float, site: str | None) -> list[Proposed]:
    """Return the interventions that an advice names, in its own numbers; none if it names none.

    Parameters
    ----------
    advice
        Of a finding; empty if it has none.
    about
        The whole finding, whose numbers an advice may leave out.
    timestep_s
        Of the run.
    site
        File and line of the call that the finding is about.
    """
    found: list[Proposed] = []
    place = _place(site)
    for pattern, name, call, made in SPECIAL:
        match = pattern.search(about)
        if match is not None and (place or not made.needs_site):
            text = call.format(*match.groups())
            found.append(Proposed(name, text, operations=made.of(match, place)))
    found += [Proposed(name, call) for words, name, call in SAID if words in advice]
    if match := SUBSTEPS.search(advice):
        found.append(Proposed("substeps", f"{match[1]} steps of 1/{match[1]}", float(match[1])))
    if match := LENGTH.search(advice):
        by_m = float(match[1]) * 1e-3
        functions = ["resetBasePositionAndOrientation"] if " is set " in about else MAKES
        up: Operation = {"do": "lift", "functions": functions, "by_m": [0.0, 0.0, 1.001 * by_m]}
        lifted = {**up, "of_body": True}
        found.append(Proposed("lifted", f"{match[1]} mm higher", by_m, operations=lifted))
    if found:
        return found
    for function, text in CALL.findall(advice):
        found += (
            [_shorter(text, timestep_s)]
            if function == "setTimeStep"
            else _read(function, text, about)
        )
    return found


def _place(site: str | None) -> list[Any] | None:
    """Return file and line of a site, as an operation names them; None of a notebook's."""
    file, _, line = (site or "").rpartition(":")
    return [file, int(line)] if file and line.isdecimal() else None


@dataclass(frozen=True)
class Special:
    """How an advice that is about one call is carried out."""

    make: Callable[[re.Match[str]], Operation]
    needs_site: bool = False
    of_body: bool = False

    def of(self, match: re.Match[str], place: list[Any] | None) -> Operation:
        """Return its operation."""
        where = {"site": place} if self.needs_site else {}
        return {**self.make(match), **where, "of_body": self.of_body}


SPECIAL: tuple[tuple[re.Pattern[str], str, str, Special], ...] = (
    (
        re.compile(r"leave \S+ out of the call"),
        "without",
        "without p.changeDynamics(…)",
        Special(lambda _: _leave([DYNAMICS]), needs_site=True, of_body=True),
    ),
    (
        re.compile(r"give ([\w, ]+) in a call of its own"),
        "without",
        "without {0}",
        Special(lambda match: _leave([DYNAMICS], *match[1].split(", ")), needs_site=True),
    ),
    (
        re.compile(r"p\.(\w+)\((?:[^()]|\([^()]*\))*\) came in between"),
        "without",
        "without p.{0}(…)",
        Special(lambda match: _leave([match[1]]), needs_site=True),
    ),
    (
        re.compile(r"p\.(\w+)\(…, physicsClientId=(\d+)\)"),
        "right-client",
        "p.{0}(…, physicsClientId={1})",
        Special(lambda match: {"do": "also", "functions": [match[1]], "of": int(match[2])}),
    ),
    (
        re.compile(r"drive it there: p\.setJointMotorControl2"),
        "without",
        "a position motor in its place",
        Special(lambda _: {"do": "drive", "functions": ["resetJointState", STEP]}, of_body=True),
    ),
    (
        re.compile(r"p\.createMultiBody\(baseMass=…\)"),
        "mass",
        "p.createMultiBody(…, baseMass=1)",
        Special(
            lambda _: {"do": "set", "functions": ["createMultiBody"], "values": {"baseMass": 1.0}},
            of_body=True,
        ),
    ),
    (
        re.compile(r"hand on its vertical velocity"),
        "without",
        "its vertical velocity handed on",
        Special(lambda _: {"do": "fall", "functions": ["resetBaseVelocity"]}, of_body=True),
    ),
    (
        re.compile(r"p\.multiplyTransforms\(position, orientation, \*p\.getDynamicsInfo"),
        "lifted",
        "the pose of the centre of mass",
        Special(
            lambda _: {"do": "frame", "functions": ["resetBasePositionAndOrientation"]},
            of_body=True,
        ),
    ),
    (
        re.compile(r"setPhysicsEngineParameter\(collisionFilterMode=0\)"),
        "collision-off",
        "p.setPhysicsEngineParameter(collisionFilterMode=0)",
        Special(lambda _: _begins(ENGINE, {"collisionFilterMode": 0})),
    ),
)
"""Advices about one call: their words, the intervention, its call, and what is done."""


def _shorter(text: str, timestep_s: float) -> Proposed:
    """Return a shorter timestep: the one that is named, or a quarter."""
    try:
        finer = min(max(2, math.ceil(timestep_s / float(text) - 1e-6)), 64)
    except (ValueError, ZeroDivisionError):
        finer = 4
    return Proposed("timestep", f"p.setTimeStep({timestep_s / finer:.4g})", float(finer))


def _read(function: str, text: str, about: str) -> Iterator[Proposed]:
    given = dict(ARGUMENT.findall(text))
    if "VELOCITY_CONTROL" in text and "force" in given:
        given = {"force": given["force"]}
    name = next((ADVISED[function, each] for each in given if (function, each) in ADVISED), None)
    if name is None:
        return
    first = next(iter(given))
    numbers = {
        key: UNGIVEN[key] if value == "…" else float(value)
        for key, value in given.items()
        if value != "…" or key in UNGIVEN
    }
    if name == "friction":
        yield _rougher(about)
    elif name == "constraint-force" and "less force" in about:
        less = {**_set("changeConstraint"), "factors": {"maxForce": 1 / MORE}, "of_body": False}
        yield Proposed(name, f"p.{function}(…, maxForce/{MORE:g})", operations=less)
    elif name == "constraint-force" and not numbers:
        yield Proposed(name, f"p.{function}(…, maxForce*{MORE:g})")
    elif numbers:
        shown = ", ".join(f"{key}={value:g}" for key, value in numbers.items())
        yield Proposed(name, f"p.{function}(…, {shown})", numbers.get(first), numbers)


def _rougher(about: str) -> Proposed:
    """Return a friction twice as large as a finding says it takes, as a factor; ten times else."""
    wanted, given = WANTED.search(about), COEFFICIENT.search(about)
    factor = MORE
    if wanted is not None and given is not None and float(given[1]) > 0:
        factor = max(2.0, 2 * float(wanted[1]) / float(given[1]))
    call = f"p.changeDynamics(…, lateralFriction*{factor:.3g})"
    return Proposed("friction", call, factor)


# -- what a run does otherwise --------------------------------------------------------------------


@dataclass(frozen=True)
class Scope:
    """What an intervention is made on."""

    bodies: Sequence[Body]
    joint: str | None = None
    """The joint of the only body; None for all of its joints."""
    commanded: frozenset[tuple[int, int]] = frozenset()
    """Numbers of bodies and links of the joints whose motors a call commands."""
    timestep_s: float = 1 / 240
    """The last one of the run."""

    def links(self, body: Body) -> list[int]:
        """Return the joints that are meant, of those that move, by their links."""
        return [
            joint.link
            for joint in body.joints
            if joint.widths[0] and self.joint in (None, joint.name)
        ]


@dataclass(frozen=True)
class Run:
    """What a run does otherwise."""

    operations: list[Operation]
    """The operations, as `watch/intervene.py` takes them."""
    finer: int = 1
    """Steps of the engine for each of the script's."""


def applied(each: Proposed, scope: Scope) -> Run | None:
    """Return what a run with an intervention does otherwise; None if this engine has none such."""
    name, value, arguments = each.name, each.value, each.arguments
    if each.operations is not None:
        if not each.operations["of_body"]:
            return Run([each.operations])
        return Run([{**each.operations, **_of(body)} for body in scope.bodies])
    if name == "timestep":
        return Run([], int(value or 2))
    if name == "substeps":
        return Run([_leave([ENGINE], "numSubSteps")], int(value or 2))
    made = TABLE.get(name)
    return None if made is None else Run([*made(scope, value, arguments)])


def left_out(function: str, file: str, line: int, argument: str | None) -> Run:
    """Return a run without a call, or without an argument of it."""
    left = [] if argument is None else [argument]
    return Run([{**_leave([function], *left), "site": [file, line]}])


def _leave(functions: list[str], *arguments: str) -> Operation:
    """Return a call left out, or arguments of it."""
    return {"do": "leave", "functions": functions, "arguments": [*arguments]}


def _of(body: Body) -> Operation:
    return {"client": body.client, "body": body.engine_id}


def _begins(call: str, values: Values) -> Operation:
    """Return a call at the beginning of each simulation."""
    return {"do": "add", "functions": BEGINS, "call": call, "values": values}


def _engine(_: Scope, __: float | None, arguments: Values) -> Iterator[Operation]:
    """Yield parameters of the engine, from the beginning on and whatever the script sets."""
    values = {
        name: int(each) if float(each).is_integer() else each for name, each in arguments.items()
    }
    yield _begins(ENGINE, values)
    yield {"do": "set", "functions": [ENGINE], "values": values, "given": True}


def _dynamics(
    bodies: Sequence[Body],
    values: Values,
    links: Callable[[Body], Sequence[int]],
    factors: Mapping[str, float] | None = None,
) -> Iterator[Operation]:
    """Yield properties of links, after their body is made and after a call sets them."""
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


def _all(body: Body) -> list[int]:
    return [-1, *(joint.link for joint in body.joints)]


def _base(_: Body) -> list[int]:
    return [-1]


def _motors(scope: Scope, values: Values, modes: list[int]) -> Iterator[Operation]:
    for body in scope.bodies:
        links = None if scope.joint is None else scope.links(body)
        yield {
            "do": "motor",
            "functions": MOTORS,
            "values": values,
            "links": links,
            "modes": modes,
            **_of(body),
        }


def _force(scope: Scope, value: float | None, _: Values) -> Iterator[Operation]:
    """Give motors a force; of several joints each at least that, since the largest needs it."""
    values, factors = ({}, {"force": MORE}) if value is None else ({"force": value}, {})
    for each in _motors(scope, values, [VELOCITY, POSITION]):
        yield {**each, "factors": factors, "least": scope.joint is None}


def _gains(scope: Scope, _: float | None, arguments: Values) -> Iterator[Operation]:
    values = arguments or {"positionGain": 0.1, "velocityGain": 1.0}
    yield from _motors(scope, values, [POSITION])


def _motor_off(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    """Turn motors off after the load: those that no call commands, and the named one."""
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


def _damping(scope: Scope, value: float | None, _: Values) -> Iterator[Operation]:
    values = {"linearDamping": value or 0.0, "angularDamping": value or 0.0}
    yield from _dynamics(scope.bodies, values, _base)


def _joint_damping(scope: Scope, value: float | None, _: Values) -> Iterator[Operation]:
    """Take the damping of joints away: of all, since a chain's joints act on each other."""
    values = {"jointDamping": value or 0.0}
    yield from _dynamics(scope.bodies, values, lambda body: [j.link for j in body.joints])


def _friction(scope: Scope, value: float | None, _: Values) -> Iterator[Operation]:
    yield from _dynamics(scope.bodies, {}, _all, {"lateralFriction": value or 4.0})


def _restitution(scope: Scope, value: float | None, arguments: Values) -> Iterator[Operation]:
    if "restitutionVelocityThreshold" in arguments:
        yield from _engine(scope, value, arguments)
        return
    yield from _dynamics(scope.bodies, arguments or {"restitution": 1.0}, _all)


def _inertia(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    for body in scope.bodies:
        flags = {"flags": INERTIA_FROM_FILE}
        yield {"do": "set", "functions": ["loadURDF"], "flags": flags, **_of(body)}


def _collision(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    """Load bodies without self-collision."""
    for body in scope.bodies:
        yield {
            "do": "set",
            "functions": ["loadURDF", "loadMJCF"],
            "flags": {"flags": 0},
            "clear": SELF_COLLISION,
            **_of(body),
        }


def _concave(_: Scope, __: float | None, ___: Values) -> Iterator[Operation]:
    yield {"do": "set", "functions": ["createCollisionShape"], "flags": {"flags": CONCAVE}}


def _constraint(_: Scope, value: float | None, __: Values) -> Iterator[Operation]:
    if value is None:
        yield {**_set("changeConstraint"), "factors": {"maxForce": MORE}}
    else:
        yield {**_set("changeConstraint"), "values": {"maxForce": value}, "given": True}


def _set(*functions: str) -> Operation:
    return {"do": "set", "functions": [*functions]}


def _frames(_: Scope, __: float | None, ___: Values) -> Iterator[Operation]:
    yield {"do": "frames", "functions": ["createConstraint"]}


def _gravity(_: Scope, value: float | None, __: Values) -> Iterator[Operation]:
    yield _begins("setGravity", {"gravX": 0.0, "gravY": 0.0, "gravZ": value or -9.81})


def _first(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    yield _begins("setTimeStep", {"timeStep": scope.timestep_s})


def _limits(scope: Scope, _: float | None, arguments: Values) -> Iterator[Operation]:
    if arguments:
        yield from _dynamics(scope.bodies, arguments, _all)
        return
    values = {"jointLowerLimit": -WIDE, "jointUpperLimit": WIDE}
    yield from _dynamics(scope.bodies, values, scope.links)


def _urdf(scope: Scope, _: float | None, arguments: Values) -> Iterator[Operation]:
    yield from _motors(scope, arguments, [VELOCITY, POSITION])


def _ik(_: Scope, __: float | None, arguments: Values) -> Iterator[Operation]:
    values = arguments or {"maxNumIterations": 1000, "residualThreshold": 1e-6}
    whole = {name: int(v) if name == "maxNumIterations" else v for name, v in values.items()}
    yield {"do": "set", "functions": ["calculateInverseKinematics"], "values": whole}


def _held(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    for body in scope.bodies:
        yield {"do": "hold", "functions": ["resetJointState", *MOTORS[:1]], **_of(body)}


def _carried(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    for body in scope.bodies:
        yield {"do": "carry", "functions": ["resetBasePositionAndOrientation"], **_of(body)}


def _repeated(_: Scope, __: float | None, ___: Values) -> Iterator[Operation]:
    yield {"do": "again", "functions": ["applyExternalForce", "applyExternalTorque", STEP]}


def _centre(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    for body in scope.bodies:
        yield {"do": "centre", "functions": ["applyExternalForce"], **_of(body)}


def _lifted(scope: Scope, value: float | None, _: Values) -> Iterator[Operation]:
    for body in scope.bodies:
        yield {"do": "lift", "functions": MAKES, "by_m": [0.0, 0.0, value or 0.0], **_of(body)}


def _mimic(scope: Scope, _: float | None, __: Values) -> Iterator[Operation]:
    """Join joints that their file wants to follow others by gears, their own motors off."""
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


def _mass(scope: Scope, value: float | None, _: Values) -> Iterator[Operation]:
    yield from _dynamics(scope.bodies, {"mass": value or 1.0}, _base)


TABLE: dict[str, Callable[[Scope, float | None, Values], Iterator[Operation]]] = {
    "force": _force,
    "default-motor-off": _motor_off,
    "gains": _gains,
    "urdf-limits": _urdf,
    "damping": _damping,
    "joint-damping": _joint_damping,
    "friction": _friction,
    "restitution": _restitution,
    "solver": lambda scope, value, arguments: _engine(
        scope, value, arguments or {"numSolverIterations": value or 500}
    ),
    "cone": lambda scope, value, _: _engine(scope, value, {"enableConeFriction": 1}),
    "pairs-sorted": lambda scope, value, _: _engine(
        scope, value, {"deterministicOverlappingPairs": 1}
    ),
    "inertia-from-file": _inertia,
    "collision-off": _collision,
    "concave": _concave,
    "constraint-force": _constraint,
    "constraint-frames": _frames,
    "gravity": _gravity,
    "timestep-first": _first,
    "limits": _limits,
    "ik": _ik,
    "targets-held": _held,
    "support-velocity": _carried,
    "push-repeated": _repeated,
    "push-at-centre": _centre,
    "lifted": _lifted,
    "mimic": _mimic,
    "mass": _mass,
}
"""How each intervention is applied; `timestep`, `substeps` and `without` are made otherwise."""
