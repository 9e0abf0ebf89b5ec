"""Interventions in MuJoCo's words: a cure as an attribute or a line, and as a changed run.

`call_of` writes a cure as its user would; `applied` turns it into what `watch/intervene.py` does in
the script's interpreter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from drop_physics.engines.mujoco.frames import PARTS
from drop_physics.engines.mujoco.watch.intervene import ENGINE
from drop_physics.messages import Message
from drop_physics.trace.cures import ChangedRun, Cure, Scope, below, whole_number
from drop_physics.trace.events import Actuator, Body

Operation = dict[str, Any]
Applies = Callable[[Scope, Cure], Iterator[Operation]]

WORLD = "world"
NO_CONTACT, NO_GRAVITY = 1 << 4, 1 << 7
"""Bits of `disableflags` (`mjtDisableBit`)."""
MORE = 10.0
"""Factor of what is to be raised where a cure gives no number."""
BELOW = 0.8
"""The share of a limit that is tried where a cure is to stay below it."""
ABOVE = 2.0
"""The multiple of a need that is tried where a cure is to be well above it."""
LARGER = 64
"""Factor of the memory of a model's contacts and constraints."""
AWAY = 1.001
"""Factor of the distance by which a body is moved away from another."""
ARMATURE_KG_M2 = 0.01
"""Armature of a joint whose controller is the script's own, so that no limit is known."""
LEAST = {"": "value", "above": "least"}
"""How a number is written, by a cure's form."""
SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""How soft MuJoCo's own contacts are."""
BOUNCES = 2500.0
"""Stiffness of a contact that bounces, that of a time constant of 0.02 s [1/s²]."""
USUAL: dict[str, float] = {
    "timestep": 2.0,
    "solver": 500.0,
    "impratio": 10.0,
    "noslip": 5.0,
    "gravity": -9.81,
    "gravcomp": 1.0,
    "armature": ARMATURE_KG_M2,
    "damping": 0.0,
    "joint-damping": 0.0,
    "restitution": 1.0,
}
"""What is given where a cure has no number."""

OPTIONS: dict[str, tuple[str, ...]] = {
    "solver": ("PGS", "CG", "Newton"),
    "cone": ("pyramidal", "elliptic"),
    "integrator": ("Euler", "RK4", "implicit", "implicitfast"),
    **dict.fromkeys(("impratio", "tolerance", "ls_tolerance", "ls_iterations"), ()),
    **dict.fromkeys(("noslip_iterations", "noslip_tolerance", "ccd_iterations"), ()),
}
"""Fields of `model.opt` that `parameter` sets; where they are a choice, its names by their
numbers."""


def _number(cure: Cure) -> float | None:
    """Return what a cure gives: a share of a limit to stay below, a multiple of one to exceed."""
    value = USUAL.get(cure.name) if cure.value is None else cure.value
    if value is None:
        return None
    return value * (BELOW if cure.form.endswith("below") else ABOVE if cure.form == "above" else 1)


# -- a cure as an attribute or a line -------------------------------------------------------------

CALLS = {
    "timestep": "timestep/{value:g}",
    "solver": 'iterations="{value:g}"',
    "gains": 'kp="{value:.4g}"',
    "gains:kp-below": 'kp="{value:.4g}"',
    "gains:kv-below": 'kv="{value:.4g}"',
    "forcerange": 'forcerange="-{force:.3g} {force:.3g}"',
    "forcerange:joint": 'actuatorfrcrange="-{force:.3g} {force:.3g}"',
    "ctrlrange": Message("without ctrlrange"),
    "limits": Message("without range"),
    "friction": 'friction="{value:.4g}"',
    "impratio": 'cone="elliptic" impratio="{value:g}"',
    "cone": 'cone="elliptic"',
    "noslip": 'noslip_iterations="{value:g}"',
    "solref": 'solref="0.02 1" solimp="0.9 0.95 0.001"',
    "solref:given": 'solref="{value:g} 1"',
    "solref:contact": 'solref="{value:g} 1"',
    "solref:stopping": Message('timestep/{finer:g} with solref="{value:g} 1" of both <geom>s'),
    "restitution": 'solref="-{stiffness:g} -{damping:.3g}"',
    "mass": 'mass="{value:g}"',
    "concave": Message("split it into convex parts, a <geom> for each"),
    "collision-off": "<exclude>",
    "gravity": 'gravity="0 0 {value:g}"',
    "gravity:flag": Message('without <flag gravity="disable"/>'),
    "gravcomp": 'gravcomp="{value:g}"',
    "armature": 'armature="{value:g}"',
    "damping": 'damping="{value:.4g}"',
    "joint-damping": 'damping="{value:.4g}"',
    "exclude": '<exclude body1="{parent}" body2="{child}"/>',
    "exclude:out": Message("without that <exclude>"),
    "contype": Message("contype and conaffinity that meet"),
    "contype:flag": Message('without <flag contact="disable"/>'),
    "filterparent": '<flag filterparent="disable"/>',
    "keyframe-ctrl": "mujoco.mj_resetDataKeyframe(…)",
    "targets-held": Message("data.ctrl with data.qpos"),
    "targets-held:reset": Message("data.ctrl[:] = … after each reset"),
    "gains:kv": 'kv="{value:.4g}"',
    "friction:loss": 'frictionloss="{value:g}"',
    "friction:condim": 'condim="{value:g}"',
    "push-repeated": Message("data.{function}[:] = 0 after each step"),
    "lifted": Message("{mm:.3g} mm higher"),
    "set-const": Message("mujoco.mj_setConst(…) after the edit"),
    "memory": Message('<size memory="…"/> of {larger} times as much'),
    "forward": Message("mujoco.mj_step1(…) before mj_step2"),
    "forward:read": Message("mujoco.mj_forward(…) after qpos is written"),
    "without": Message("without {left_out}"),
}
"""Messages by name and form."""
UNSAID = {"function": "xfrc_applied", "parent": "…", "child": "…"}
"""What a call names where a cure that is tried by its name alone does not say it."""
FACTORS = {"gains": "kp", "forcerange": "forcerange", "friction": "friction", "mass": "mass"}
"""What is multiplied where a cure gives no number."""


def call_of(cure: Cure) -> str:
    """Return what a cure's user would write."""
    number = _number(cure)
    if number is None and cure.name in FACTORS:
        return f"{FACTORS[cure.name]}*{MORE:g}"
    form = cure.form or ("given" if cure.name == "solref" and number is not None else "")
    text = CALLS.get(f"{cure.name}:{form}", CALLS.get(cure.name, cure.name))
    value = 0.0 if number is None else number
    bounce = dict(zip(("stiffness", "damping"), _bouncing(value), strict=True))
    force = value / abs(cure.given.get("gear", 1.0))
    numbers = {"value": value, "force": force, "mm": 1e3 * value, "larger": LARGER, **bounce}
    return Message(text, **{**UNSAID, "left_out": _written(cure), **cure.given, **numbers})


def _written(cure: Cure) -> str:
    """Return what a cure leaves out, as the script has it."""
    function = str(cure.given.get("function", ""))
    if function in PARTS:
        return f"data.{function}"
    return f"mujoco.{function}(…)" if function.startswith("mj_") else f"model.{function}"


# -- what a run does otherwise --------------------------------------------------------------------


def applied(cure: Cure, scope: Scope) -> ChangedRun | None:
    """Return what a run with a cure does otherwise; None if MuJoCo has none such."""
    if cure.name == "parameter":
        name, value = cure.given["name"], whole_number(cure.value or 0.0)
        return ChangedRun(below={"options": {name: value}}) if name in OPTIONS else None
    run = below(cure)
    if run is not None:
        return run
    file, _, line = (scope.site or "").rpartition(":")
    if cure.name == "without" and file and line.isdecimal():
        return left_out(str(cure.given["function"]), file, int(line), None)
    made = TABLE.get(cure.name)
    operations = [] if made is None else [{"engine": ENGINE, **each} for each in made(scope, cure)]
    finer = {name: cure.given[name] for name in ("finer",) if cure.given.get(name, 1) > 1}
    return ChangedRun(operations, finer) if operations else None


def left_out(function: str, file: str, line: int, argument: str | None) -> ChangedRun | None:
    """Return a run without what a script sets before a line; None of an argument alone."""
    if argument is not None:
        return None
    site = {"engine": ENGINE, "site": [file, line]}
    if function in PARTS:
        return ChangedRun([{**site, "do": "leave", "part": function}])
    if function.startswith("mj_"):
        return ChangedRun([{**site, "do": "skip", "function": function}])
    return ChangedRun([{**site, "do": "keep", "field": function}])


def _write(field: str, **how: object) -> Operation:
    return {"do": "write", "field": field, **how}


def _option(field: str) -> Applies:
    """Return what writes a cure's number into an option."""
    return lambda _, cure: iter([_write(f"opt.{field}", value=_number(cure))])


def _done(do: str, **how: object) -> Applies:
    return lambda _, __: iter([{"do": do, **how}])


def _links(body: Body) -> list[str]:
    """Return the names of MuJoCo's bodies that a body is made of."""
    return [name for n, name in enumerate(body.links) if n or name != WORLD or not body.engine_id]


def _all_links(scope: Scope) -> list[str]:
    return [name for body in scope.bodies for name in _links(body)]


def _of(scope: Scope) -> dict[str, Any]:
    """Return the joint that is meant, or all bodies."""
    if scope.joint is not None:
        return {"of": "joint", "names": [scope.joint]}
    return {"of": "body", "names": _all_links(scope)}


def _actuators(scope: Scope) -> Iterator[Actuator]:
    """Yield the actuators that are meant: of a joint, of a name, or all."""
    for body in scope.bodies:
        for each in body.actuators:
            if scope.joint is None:
                if scope.target in (None, body.label, each.name):
                    yield each
            elif each.acts_on == "joint" and each.target == scope.joint:
                yield each


def _gains(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give actuators a gain; a servo's stiffness or damping with it."""
    number = _number(cure)
    for each in _actuators(scope):
        named = {"of": "actuator", "names": [each.name]}
        if number is None:
            gain, bias = {"factor": MORE}, {"factor": MORE}
        else:
            gain, bias = {"value": number}, {"value": -number}
        if each.kind == "velocity":
            yield _write("actuator_gainprm", column=0, **named, **gain)
            yield _write("actuator_biasprm", column=2, **named, **bias)
        elif each.kind == "position" and cure.form == "kv-below":
            yield _write("actuator_biasprm", column=2, **named, **bias)
        elif each.kind == "position":
            yield _write("actuator_gainprm", column=0, **named, **gain)
            yield _write("actuator_biasprm", column=1, **named, **bias)


def _force_range(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Widen what limits the force of actuators, and of their joints."""
    number = _number(cure)
    yield _write("jnt_actfrcrange", limited="jnt_actfrclimited", **_of(scope), **_wide(number, 1))
    for each in _actuators(scope):
        if each.force_range is not None:
            named = {"of": "actuator", "names": [each.name]}
            yield _write("actuator_forcerange", **named, **_wide(number, each.gear))


def _wide(number: float | None, gear: float) -> dict[str, float]:
    return {"factor": MORE} if number is None else {"widest": number / abs(gear or 1.0)}


def _control_range(scope: Scope, _: Cure) -> Iterator[Operation]:
    for each in _actuators(scope):
        if each.ctrl_range is not None:
            yield _write("actuator_ctrllimited", of="actuator", names=[each.name], value=0)


def _friction(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give geometries a friction; to hold, no less than they have: of a pair the larger counts."""
    number = _number(cure)
    if cure.form == "loss":
        yield _write("dof_frictionloss", value=number, **_of(scope))
        return
    if cure.form == "condim":
        for field in ("geom_condim", "pair_dim"):
            yield _write(field, value=int(number or 3), **_with_other(scope))
        return
    how = {"factor": MORE} if number is None else {LEAST[cure.form]: number}
    its = {"of": "body", "names": _all_links(scope)}
    yield _write("geom_friction", column=0, **(_with_other(scope) if cure.form else its), **how)
    for column in (0, 1):
        yield _write("pair_friction", column=column, **its, **how)


def _impratio(_: Scope, cure: Cure) -> Iterator[Operation]:
    yield _write("opt.impratio", value=_number(cure))
    yield _write("opt.cone", value=1)


def _softness(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give equalities or contacts a time constant, or contacts MuJoCo's own softness."""
    if cure.value is not None and not cure.form:
        links = {"of": "body", "names": _all_links(scope)}
        yield _write("eq_solref", column=0, value=cure.value, **links)
        return
    solref = SOLREF if cure.value is None else (cure.value, 1.0)
    for kind in ("geom", "pair"):
        yield _write(f"{kind}_solref", value=solref, **_with_other(scope))
        if cure.value is None:
            yield _write(f"{kind}_solimp", value=SOLIMP, **_with_other(scope))


def _with_other(scope: Scope) -> dict[str, Any]:
    """Return the bodies that are meant, with the other that they touch."""
    other = [] if scope.other is None else _links(scope.other)
    return {"of": "body", "names": [*_all_links(scope), *other]}


def _bouncing(restitution: float) -> tuple[float, float]:
    """Return stiffness and damping of a contact of some restitution: those of a damped spring.

    Half a swing of damping ratio z leaves exp(-pi z / sqrt(1 - z²)) of the speed.
    """
    loss = -math.log(min(max(restitution, 1e-3), 1.0))
    return BOUNCES, 2 * math.sqrt(BOUNCES) * loss / math.hypot(math.pi, loss)


def _bounce(scope: Scope, cure: Cure) -> Iterator[Operation]:
    stiffness, damping = _bouncing(_number(cure) or 0.0)
    yield _write("geom_solref", value=(-stiffness, -damping), **_with_other(scope))


def _armature(scope: Scope, cure: Cure) -> Iterator[Operation]:
    yield _write("dof_armature", value=_number(cure), derived=True, **_of(scope))


def _mass(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Give bodies a mass, and inertia in proportion; to a body of several parts, to its base."""
    names = [_links(body)[0] for body in scope.bodies]
    yield {"do": "weigh", "names": names, "mass": cure.value, "factor": MORE, "derived": True}


def _pass(scope: Scope, _: Cure) -> Iterator[Operation]:
    if scope.other is not None:
        yield {"do": "part", "names": [_all_links(scope), _links(scope.other)]}


def _compensation(scope: Scope, cure: Cure) -> Iterator[Operation]:
    names = _all_links(scope)
    yield _write("body_gravcomp", of="body", names=names, value=_number(cure), derived=True)


def _damping(scope: Scope, cure: Cure) -> Iterator[Operation]:
    yield _write("dof_damping", value=_number(cure), **_of(scope))


def _limits(scope: Scope, _: Cure) -> Iterator[Operation]:
    yield _write("jnt_limited", value=0, **_of(scope))


def _gravity(_: Scope, cure: Cure) -> Iterator[Operation]:
    yield _write("opt.gravity", value=[0.0, 0.0, _number(cure)])
    yield _write("opt.disableflags", clear=NO_GRAVITY)


def _exclude(scope: Scope, cure: Cure) -> Iterator[Operation]:
    """Keep a link and its parent apart; or take out what keeps bodies apart."""
    if cure.form == "out":
        yield {"do": "unexclude", "names": _both(scope, cure)}
    elif scope.target is not None:
        yield {"do": "part", "names": [[scope.target], None]}


def _meet(scope: Scope, cure: Cure) -> Iterator[Operation]:
    if cure.form == "flag":
        yield _write("opt.disableflags", clear=NO_CONTACT)
        return
    yield {"do": "meet", "names": _both(scope, cure)}


def _both(scope: Scope, cure: Cure) -> list[list[str]]:
    """Return the names of MuJoCo's bodies on both sides."""
    if "links" in cure.given:
        return [[name] for name in cure.given["links"]]
    other = scope.bodies[0] if scope.other is None else scope.other
    return [_links(scope.bodies[0]), _links(other)]


def _clear(_: Scope, __: Cure) -> Iterator[Operation]:
    for part in ("xfrc_applied", "qfrc_applied"):
        yield {"do": "clear", "part": part}


def _lift(scope: Scope, cure: Cure) -> Iterator[Operation]:
    up = [0.0, 0.0, AWAY * (_number(cure) or 0.0)]
    yield {"do": "lift", "names": _all_links(scope), "by_m": up}


TABLE: dict[str, Applies] = {
    "solver": _option("iterations"),
    "noslip": _option("noslip_iterations"),
    "impratio": _impratio,
    "cone": lambda _, __: iter([_write("opt.cone", value=1)]),
    "gains": _gains,
    "forcerange": _force_range,
    "ctrlrange": _control_range,
    "limits": _limits,
    "damping": _damping,
    "joint-damping": _damping,
    "friction": _friction,
    "solref": _softness,
    "gravity": _gravity,
    "gravcomp": _compensation,
    "armature": _armature,
    "mass": _mass,
    "restitution": _bounce,
    "collision-off": _pass,
    "exclude": _exclude,
    "contype": _meet,
    "filterparent": _done("flag", name="mjDSBL_FILTERPARENT"),
    "keyframe-ctrl": _done("key"),
    "targets-held": lambda _, cure: iter([{"do": "give" if cure.form == "reset" else "hold"}]),
    "push-repeated": _clear,
    "lifted": _lift,
    "set-const": _done("derive"),
    "memory": _done("arena", factor=LARGER, at_load=True),
    "forward": _done("pose"),
}
"""How each intervention is made."""
