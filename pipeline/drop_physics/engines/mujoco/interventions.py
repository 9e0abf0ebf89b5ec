"""Changes that can be tried on a MuJoCo run, each as code for the user and as an operation.

The result of `makes` is carried out by `watch/intervene.py` in the script's interpreter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
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
    to,
)
from drop_physics.engines.mujoco.frames import PARTS
from drop_physics.engines.mujoco.played import played
from drop_physics.engines.mujoco.watch.derived import DERIVED_FROM
from drop_physics.engines.mujoco.watch.single_changes import ENGINE, trial_of
from drop_physics.engines.watching.single_changes import Change
from drop_physics.messages import Message
from drop_physics.trace.cures import ChangedRun, Cure, Scope
from drop_physics.trace.events import Actuator, Body

Applies = Callable[["FieldRow", Cure, Scope], Iterator[Operation]]
Elements = Callable[[Scope], Mapping[str, Any]]

WORLD = "world"
FLAGS = (
    "EQUALITY LIMIT FRICTIONLOSS SPRING DAMPER CLAMPCTRL WARMSTART FILTERPARENT REFSAFE EULERDAMP "
    "NATIVECCD MULTICCD ISLAND MIDPHASE OVERRIDE DIAGEXACT SPECULATIVE"
)
"""Names of flags of `mjtDisableBit` and `mjtEnableBit` that the search for causes toggles. SLEEP is
none of them: an `MjData` that was made without it holds no sleep states to start from."""
BELOW = 0.8
"""Share of a limit that a trial sets if a value has to stay below that limit."""
ABOVE = 2.0
"""Multiple of a required value that a trial sets if a value has to be well above the required one.
"""
LARGER = 64
"""Factor for the memory of a model's contacts and constraints."""
ARMATURE_KG_M2 = 0.01
"""Armature given to a joint that the script's own controller drives, for which no stability limit
is known."""
SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's default contact softness: `solref` and `solimp`."""
BOUNCES = 2500.0
"""Stiffness of a bouncing contact, equal to that of a time constant of 0.02 s [1/s²]."""
OPTIONS: dict[str, Sequence[str]] = {
    "solver": ("PGS", "CG", "Newton"),
    "cone": ("pyramidal", "elliptic"),
    "integrator": ("Euler", "RK4", "implicit", "implicitfast"),
    **dict.fromkeys(("impratio", "tolerance", "ls_tolerance", "ls_iterations"), ()),
    **dict.fromkeys(("noslip_iterations", "noslip_tolerance", "ccd_iterations"), ()),
}
"""Fields of `model.opt` that the intervention `parameter` sets. For a choice: its names, by
MuJoCo's number."""


def _bouncing(restitution: float) -> tuple[float, float]:
    """Return contact stiffness and damping for a restitution: those of a damped spring.

    Half a swing of damping ratio z leaves exp(-pi z / sqrt(1 - z²)) of the speed.
    """
    loss = -math.log(min(max(restitution, 1e-3), 1.0))
    return BOUNCES, 2 * math.sqrt(BOUNCES) * loss / math.hypot(math.pi, loss)


def _bounce(restitution: float | None) -> How:
    stiffness, damping = _bouncing(restitution or 0.0)
    return "=", (-stiffness, -damping)


def _at_least(number: float | None) -> How:
    return ">", number


def _lasting(constant_s: float | None) -> How:
    """Return the operation that sets `solref` to a time constant, critically damped."""
    return "=", (constant_s, 1.0)


# -- which elements -------------------------------------------------------------------------------


def _links(body: Body) -> list[str]:
    """Return the names of the MuJoCo bodies that make up a recorded body."""
    return [name for n, name in enumerate(body.links) if n or name != WORLD or not body.engine_id]


def _all_links(scope: Scope) -> list[str]:
    return [name for body in scope.bodies for name in _links(body)]


def _bodies(scope: Scope) -> dict[str, Any]:
    return {"of": "body", "names": _all_links(scope)}


def _both(scope: Scope) -> dict[str, Any]:
    """Return the bodies of a finding, and the body that they touch."""
    other = [] if scope.other is None else _links(scope.other)
    return {"of": "body", "names": [*_all_links(scope), *other]}


def _joints(scope: Scope) -> dict[str, Any]:
    """Return the joint of a finding or, if it names none, its bodies."""
    return _bodies(scope) if scope.joint is None else {"of": "joint", "names": [scope.joint]}


def _all(_: Scope) -> dict[str, Any]:
    return {}


def _actuators(scope: Scope) -> Iterator[tuple[Actuator, dict[str, Any]]]:
    """Yield the actuators of a finding: those of its joint, the one that it names, or all."""
    for body in scope.bodies:
        for actuator in body.actuators:
            named = scope.target in (None, body.label, actuator.name)
            if scope.joint is not None:
                named = actuator.acts_on == "joint" and actuator.target == scope.joint
            if named:
                yield actuator, {"of": "actuator", "names": [actuator.name]}


@dataclass(frozen=True)
class FieldRow(ChangeRow):
    """A change of model or state fields that may be suggested and tried."""

    of: Elements = _all
    """Function that returns the elements whose fields are set."""
    _: KW_ONLY
    makes: Applies | None = None
    """Further operations of the intervention."""
    derived: bool = False
    """Whether MuJoCo derives other fields from the changed ones."""
    more: str = ""
    """Code for a change that has no number: the attribute that has to be multiplied."""

    def call_of(self, cure: Cure) -> str:
        """Return the attribute or line that a user would write to make a suggested change."""
        if self.more and self.number(cure) is None:
            return f"{self.more}*{MORE:g}"
        return super().call_of(cure)

    @property
    def tried(self) -> dict[str, Any]:
        """Describe this change for the search for causes, which runs in the script's process."""
        field = next(iter(self.sets), "").partition("[")[0].replace("opt.", "option.")
        return {**super().tried, "change": self.change or field}

    def known(self, cure: Cure) -> dict[str, Any]:
        """Return the values that may fill in a suggested change's code template, by name."""
        known = super().known(cure)
        stiffness, damping = _bouncing(known["value"])
        force = known["value"] / abs(cure.given.get("gear", 1.0))
        left_out = _written(str(cure.given.get("function", "")))
        more = {"larger": LARGER, "force": force, "left_out": left_out}
        return {**known, **more, "stiffness": stiffness, "damping": damping}

    def operations(self, cure: Cure, scope: Scope) -> Iterable[Operation]:
        """Return the operations by which the script's process makes a suggested change."""
        derived = {"derived": True} if self.derived else {}
        for name, how in self.changes(cure).items():
            yield {**_write(name, how), **self.of(scope), **derived}
        if self.makes is not None:
            yield from ({"engine": ENGINE, **make} for make in self.makes(self, cure, scope))

    def applied(self, cure: Cure, scope: Scope) -> ChangedRun | None:
        """Return the run with a suggested change, with finer steps if the finding needs them."""
        run, finer = super().applied(cure, scope), cure.given.get("finer", 1)
        return run if run is None or finer == 1 else run + ChangedRun(below={"finer": finer})


def _write(field: str, how: How) -> Operation:
    return {"engine": ENGINE, "do": "write", "field": field, "how": how}


def _written(function: str) -> str:
    """Return the script's own code for the call or write that a suggested change omits."""
    if function in PARTS:
        return f"data.{function}"
    return f"mujoco.{function}(…)" if function.startswith("mj_") else f"model.{function}"


def _set_parameter(name: str, value: float) -> ChangedRun:
    return ChangedRun([_write(f"opt.{name}", ("=", value))])


# -- operations -----------------------------------------------------------------------------------


def _gains(row: FieldRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Set the gains of actuators; for a servo, also the bias terms that contain kp and kv."""
    do, number = raised(row.number(cure))
    gain, bias = (do, number), (do, number if do == "*" else -number)
    for each, its in _actuators(scope):
        if each.kind not in ("velocity", "position"):
            continue
        is_damping = each.kind == "velocity" or row.name == "gains:kv-below"
        if each.kind == "velocity" or not is_damping:
            yield {**_write("actuator_gainprm[0]", gain), **its}
        yield {**_write(f"actuator_biasprm[{2 if is_damping else 1}]", bias), **its}


def _force_range(row: FieldRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Widen the force limits of actuators and of their joints."""
    number = row.number(cure)
    its = {"limited": "jnt_actfrclimited", **_joints(scope)}
    yield from ({**each, **its} for each in _wider("jnt_actfrcrange", number, 1.0))
    for each, its in _actuators(scope):
        if each.force_range is not None:
            wider = _wider("actuator_forcerange", number, each.gear)
            yield from ({**one, **its} for one in wider)


def _wider(field: str, number: float | None, gear: float) -> Iterator[Operation]:
    if number is None:
        yield _write(field, ("*", MORE))
        return
    most = number / abs(gear or 1.0)
    yield _write(f"{field}[0]", ("<", -most))
    yield _write(f"{field}[1]", (">", most))


def _control_range(_: FieldRow, __: Cure, scope: Scope) -> Iterator[Operation]:
    for each, its in _actuators(scope):
        if each.ctrl_range is not None:
            yield {**_write("actuator_ctrllimited", ("=", 0)), **its}


def _mass(_: FieldRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Set the mass of bodies, and scale their inertia; of several links, only the base changes."""
    names = [_links(body)[0] for body in scope.bodies]
    yield {"do": "weigh", "names": names, "mass": cure.value, "factor": MORE, "derived": True}


def _pass(_: FieldRow, __: Cure, scope: Scope) -> Iterator[Operation]:
    if scope.other is not None:
        yield {"do": "part", "names": [_all_links(scope), _links(scope.other)]}


def _exclude(_: FieldRow, __: Cure, scope: Scope) -> Iterator[Operation]:
    """Disable contacts between a link and its parent."""
    if scope.target is not None:
        yield {"do": "part", "names": [[scope.target], None]}


def _between(do: str) -> Applies:
    """Return an operation on the contacts or constraints between a finding's two bodies."""

    def made(_: FieldRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
        other = scope.bodies[0] if scope.other is None else scope.other
        names = [_links(scope.bodies[0]), _links(other)]
        if "links" in cure.given:
            names = [[name] for name in cure.given["links"]]
        yield {"do": do, "names": names}

    return made


def _done(do: str, **how: object) -> Applies:
    return lambda _, __, ___: iter([{"do": do, **how}])


def _clear(_: FieldRow, __: Cure, ___: Scope) -> Iterator[Operation]:
    for part in ("xfrc_applied", "qfrc_applied"):
        yield {"do": "clear", "part": part}


def _lift(row: FieldRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    up = [0.0, 0.0, AWAY * (row.number(cure) or 0.0)]
    yield {"do": "lift", "names": _all_links(scope), "by_m": up}


def _without(_: FieldRow, cure: Cure, scope: Scope) -> Iterator[Operation]:
    """Omit the script's call or write that a finding is about."""
    file, _, line = (scope.site or "").rpartition(":")  # type: ignore[assignment]
    if file and line.isdecimal():
        function = str(cure.given["function"])
        how = {"do": "keep", "field": function}
        if function in PARTS:
            how = {"do": "leave", "part": function}
        elif function.startswith("mj_"):
            how = {"do": "skip", "function": function}
        yield {"site": [file, int(line)], **how}


# -- the rows -------------------------------------------------------------------------------------


def _option(field: str, usual: float) -> dict[str, Becomes]:
    return {f"opt.{field}": to(usual)}


GEOM_FRICTION = "geom_friction[0]"
PAIR_FRICTION = ("pair_friction[0]", "pair_friction[1]")
SOFT = ("geom_solref", "pair_solref")
GRAVITY: dict[str, Becomes] = {
    "opt.gravity": lambda number: ("=", [0.0, 0.0, number]),
    "opt.disableflags": always("~", "mjDSBL_GRAVITY"),
}

GEOMETRY = (
    *("jnt_axis", "jnt_pos", "geom_pos", "geom_size", "body_ipos", "site_pos", "site_size"),
)
"""Fields that set positions and sizes."""
SET_CONST = Message("mujoco.mj_setConst(…) after the edit")
SEARCHED = (
    ("jnt_stiffness", "stiffness", "=0 *0.1 *10", ""),
    ("jnt_axis", "axis", "*-1", ""),
    ("jnt_pos", "pos", "=0", ""),
    ("jnt_solref", "solreflimit", "stiff", ""),
    ("actuator_gear", "gear", "*0.1 *10 *-1 =1", ""),
    ("actuator_kp", "kp", "*0.1 *10", ""),
    ("actuator_kv", "kv", "=0 *0.1 *10", ""),
    ("actuator_kp_kv", "kp and kv", "*0.1 *10", ""),
    ("actuator_off", "actuator", "=0", "=0"),
    ("actuator_forcelimited", "forcelimited", "=0", ""),
    ("actuator_dyntype", "dyntype", "=0", ""),
    ("geom_condim_friction", 'condim="6" and its friction', "*10 *100", ""),
    ("geom_margin", "margin", "=0", ""),
    ("geom_pos", "pos", "=0", ""),
    ("geom_size", "size", "*0.5", ""),
    ("pair_friction", "friction", "=0 *0.1 *10", ""),
    ("body_inertia", "inertia", "*0.1 *10", "*0.1 *10"),
    ("body_ipos", "pos of <inertial>", "=0", ""),
    ("site_pos", "pos", "=0", ""),
    ("site_size", "size", "*0.1 *10", ""),
    ("eq_active", "active", "=0", ""),
    ("eq_solimp", "solimp", "stiff", ""),
    ("tendon_stiffness", "stiffness", "=0 *0.1 *10", ""),
    ("tendon_damping", "damping", "=0 *0.1 *10", ""),
    ("tendon_limited", "limited", "=0", ""),
    ("option.integrator", "integrator", "=0 =1 =2 =3", ""),
    ("option.density", "density", "=0", ""),
    ("option.viscosity", "viscosity", "=0", ""),
    ("option.wind", "wind", "=0", ""),
    ("model.derived", "model", "derive", ""),
    ("start.qpos", "data.qpos", "=default +0.001 +0.01 w-first", ""),
    ("start.qvel", "data.qvel", "=0", "=0"),
    *(
        (f"input.{part}", f"data.{part}", f"=0 *0.1 *10 *-1 held late{orders}", "=0 held")
        for part, orders in (
            ("ctrl", " exchanged reversed"),
            ("qfrc_applied", ""),
            ("xfrc_applied", ""),
        )
    ),
    ("input.mocap_pos", "data.mocap_pos", "held late", "held"),
    ("input.qpos", "data.qpos", "undone", ""),
    ("input.qvel", "data.qvel", "undone", ""),
    *((f"flag.{name}", name.lower(), "^", "^") for name in ("CONTACT", "GRAVITY", "ACTUATION")),
    *((f"flag.{name}", name.lower(), "^", "") for name in FLAGS.split()),
)
"""Changes that only the search for causes makes: field, attribute, operators, and those operators
that remove a part of the scene."""

ROWS = (
    # The whole run.
    ChangeRow(
        "timestep",
        words="timestep/{value:g}",
        below="finer",
        usual=2.0,
        whole_run=True,
        change="option.timestep",
        tries="/2 /10",
    ),
    FieldRow("iterations", {"opt.iterations": lambda n: ("*", n)}, usual=4.0, whole_run=True),
    FieldRow(f"gravity:{FACTOR}", {"opt.gravity": lambda size: ("size", size)}),
    FieldRow(
        f"friction:{FACTOR}",
        dict.fromkeys(("geom_friction", "pair_friction"), lambda n: ("*", n)),
    ),
    FieldRow(
        f"mass:{FACTOR}",
        dict.fromkeys(("body_mass", "body_inertia"), lambda n: ("*", n)),
        derived=True,
    ),
    FieldRow(
        "solver",
        {"opt.iterations": to(0)},
        words='iterations="{value:g}"',
        usual=500.0,
        whole_run=True,
        tries="*10",
    ),
    FieldRow(
        "noslip",
        {"opt.noslip_iterations": to(0)},
        words='noslip_iterations="{value:g}"',
        usual=5.0,
        whole_run=True,
        tries="=0 =10",
    ),
    FieldRow(
        "impratio",
        {"opt.impratio": to(0), "opt.cone": always("=", 1)},
        words='cone="elliptic" impratio="{value:g}"',
        usual=10.0,
        whole_run=True,
        tries="=1 *10",
    ),
    FieldRow(
        "cone",
        {"opt.cone": always("=", 1)},
        words='cone="elliptic"',
        decides=True,
        whole_run=True,
        tries="=0 =1",
    ),
    FieldRow(
        "gravity",
        GRAVITY,
        words='gravity="0 0 {value:g}"',
        usual=-9.81,
        decides=True,
        whole_run=True,
        tries="=0 =default",
        breaks="=0",
        default=(0.0, 0.0, -9.81),
    ),
    FieldRow(
        "gravity:flag",
        GRAVITY,
        words=Message('without <flag gravity="disable"/>'),
        usual=-9.81,
        decides=True,
        whole_run=True,
    ),
    FieldRow(
        "filterparent",
        {"opt.disableflags": always("|", "mjDSBL_FILTERPARENT")},
        words='<flag filterparent="disable"/>',
        decides=True,
        whole_run=True,
    ),
    FieldRow(
        "contype:flag",
        {"opt.disableflags": always("~", "mjDSBL_CONTACT")},
        words=Message('without <flag contact="disable"/>'),
        decides=True,
    ),
    FieldRow(
        "memory",
        makes=_done("arena", factor=LARGER, at_load=True),
        words=Message('<size memory="…"/> of {larger} times as much'),
        whole_run=True,
    ),
    # Actuators.
    FieldRow("gains", makes=_gains, words='kp="{value:.4g}"', more="kp"),
    FieldRow("gains:kv", makes=_gains, words='kv="{value:.4g}"'),
    FieldRow("gains:kp-below", makes=_gains, words='kp="{value:.4g}"', share=BELOW),
    FieldRow("gains:kv-below", makes=_gains, words='kv="{value:.4g}"', share=BELOW),
    FieldRow(
        "forcerange",
        makes=_force_range,
        words='forcerange="-{force:.3g} {force:.3g}"',
        more="forcerange",
    ),
    FieldRow(
        "forcerange:joint",
        makes=_force_range,
        words='actuatorfrcrange="-{force:.3g} {force:.3g}"',
        more="forcerange",
    ),
    FieldRow(
        "ctrlrange",
        makes=_control_range,
        words=Message("without ctrlrange"),
        change="actuator_ctrllimited",
        tries="=0",
    ),
    FieldRow("targets-held", makes=_done("hold"), words=Message("data.ctrl with data.qpos")),
    FieldRow(
        "targets-held:reset",
        makes=_done("give"),
        words=Message("data.ctrl[:] = … after each reset"),
    ),
    FieldRow(
        "keyframe-ctrl",
        makes=_done("key"),
        words="mujoco.mj_resetDataKeyframe(…)",
        decides=True,
        whole_run=True,
    ),
    # Joints.
    FieldRow(
        "limits",
        {"jnt_limited": always("=", 0)},
        _joints,
        words=Message("without range"),
        tries="=0",
    ),
    *(
        FieldRow(
            name,
            {"dof_damping": to(0)},
            _joints,
            words='damping="{value:.4g}"',
            usual=0.0,
            share=share,
            decides=True,
            tries=tries,
        )
        for name, share, tries in (
            ("damping", 1.0, "=0 *0.1 *10 +10M0"),
            ("joint-damping", 1.0, ""),
            ("damping:below", BELOW, ""),
        )
    ),
    FieldRow(
        "friction:loss",
        {"dof_frictionloss": to(0)},
        _joints,
        words='frictionloss="{value:g}"',
        tries="=0 *10",
    ),
    FieldRow(
        "armature",
        {"dof_armature": to(0)},
        _joints,
        words='armature="{value:g}"',
        usual=ARMATURE_KG_M2,
        derived=True,
        tries="=0 *10 +M0",
    ),
    # Bodies.
    FieldRow(
        "mass",
        makes=_mass,
        words='mass="{value:g}"',
        more="mass",
        change="body_mass",
        tries="*0.1 *10",
        breaks="*0.1 *10",
    ),
    FieldRow(
        "gravcomp",
        {"body_gravcomp": to(0)},
        _bodies,
        words='gravcomp="{value:g}"',
        usual=1.0,
        derived=True,
        tries="=0 =1",
        breaks="=1",
    ),
    FieldRow("lifted", makes=_lift, words=Message("{mm:.3g} mm higher")),
    FieldRow(
        "friction",
        dict.fromkeys((GEOM_FRICTION, *PAIR_FRICTION), raised),
        _bodies,
        words='friction="{value:.4g}"',
        more="friction",
        tries="=0 *0.1 *10 =default",
        default=(1.0, 0.005, 0.0001),
    ),
    # To hold, no less than they have: of a pair the larger counts.
    FieldRow(
        "friction:above",
        dict.fromkeys((GEOM_FRICTION, *PAIR_FRICTION), _at_least),
        _both,
        words='friction="{value:.4g}"',
        share=ABOVE,
    ),
    FieldRow(
        "friction:condim",
        {"geom_condim": to(3), "pair_dim": to(3)},
        _both,
        words='condim="{value:g}"',
        tries="=1 =3 =4 =6",
    ),
    FieldRow(
        "solref",
        {
            **dict.fromkeys(SOFT, always("=", SOLREF)),
            **dict.fromkeys(("geom_solimp", "pair_solimp"), always("=", SOLIMP)),
        },
        _both,
        words='solref="0.02 1" solimp="0.9 0.95 0.001"',
        tries="=default stiff",
        default=SOLREF,
    ),
    FieldRow(
        "solref:given",
        {"eq_solref[0]": to(0)},
        _bodies,
        words='solref="{value:g} 1"',
        tries="=default stiff",
        default=SOLREF,
    ),
    FieldRow("solref:contact", dict.fromkeys(SOFT, _lasting), _both, words='solref="{value:g} 1"'),
    FieldRow(
        "solref:stopping",
        dict.fromkeys(SOFT, _lasting),
        _both,
        words=Message('timestep/{finer:g} with solref="{value:g} 1" of both <geom>s'),
    ),
    FieldRow(
        "restitution",
        {"geom_solref": _bounce},
        _both,
        words='solref="-{stiffness:g} -{damping:.3g}"',
        usual=1.0,
    ),
    # What touches what.
    FieldRow(
        "collision-off", makes=_pass, words="<exclude>", decides=True, change="pair", tries="=0"
    ),
    FieldRow(
        "exclude",
        makes=_exclude,
        words='<exclude body1="{parent}" body2="{child}"/>',
        decides=True,
    ),
    FieldRow(
        "exclude:out",
        makes=_between("unexclude"),
        words=Message("without that <exclude>"),
        decides=True,
    ),
    FieldRow(
        "contype",
        makes=_between("meet"),
        words=Message("contype and conaffinity that meet"),
        decides=True,
        change="geom_collides",
        tries="=0 =1",
        breaks="=0",
    ),
    ChangeRow(
        "concave",
        words=Message("split it into convex parts, a <geom> for each"),
        decides=True,
        whole_run=True,
    ),
    # Calls and writes of the script.
    FieldRow(
        "push-repeated",
        makes=_clear,
        words=Message("data.{function}[:] = 0 after each step"),
        unsaid={"function": "xfrc_applied"},
        whole_run=True,
    ),
    FieldRow(
        "set-const",
        makes=_done("derive"),
        words=SET_CONST,
        decides=True,
        whole_run=True,
    ),
    FieldRow(
        "forward",
        makes=_done("pose"),
        words=Message("mujoco.mj_step1(…) before mj_step2"),
        decides=True,
        whole_run=True,
    ),
    FieldRow(
        "forward:read",
        makes=_done("pose"),
        words=Message("mujoco.mj_forward(…) after qpos is written"),
        decides=True,
        whole_run=True,
    ),
    *(
        ChangeRow(
            "",
            change=change,
            words=words,
            tries=tries,
            breaks=breaks,
            is_geometry=change in GEOMETRY,
        )
        for change, words, tries, breaks in SEARCHED
    ),
    ChangeRow("", change="geom_solimp", words="solimp", tries="=default stiff", default=SOLIMP),
    FieldRow("without", makes=_without, words=Message("without {left_out}"), needs="function"),
)
SEES = [{"engine": ENGINE, "do": "see"}]


def _words_of(change: Change) -> str:
    """Describe a change by the attribute that a user would edit."""
    kind, _, part = change.change.partition(".")
    elements, how = named(change.target), done(change.op)
    if kind == "model":
        return SET_CONST
    if kind == "flag":
        return Message("flag {name} switched", name=part.lower())
    if kind == "pair":
        return Message("no contact of {elements}", elements=elements)
    if kind == "start" and change.how[0] == "+":
        return Message("bodies {mm:g} mm higher at the start", mm=1e3 * change.how[1])
    if kind == "option" and OPTIONS.get(part) and change.how[0] == "=":
        how = OPTIONS[part][int(change.how[1])]
    if kind in ("option", "start"):
        return Message("{attribute} {how}", attribute=f"{kind} {part}", how=how)
    attribute = f"data.{part}" if part else WRITTEN_AS.get(kind, kind.partition("_")[2])
    return Message(
        "{attribute} of {elements} {how}", attribute=attribute, elements=elements, how=how
    )


WRITTEN_AS = {
    "actuator_kp_kv": "kp and kv",
    "actuator_off": "force",
    "body_mass": Message("mass, and with it inertia,"),
    "geom_collides": "contype",
    "geom_condim_friction": 'condim="6", friction of torsion and rolling',
}
"""Attribute names in MJCF of fields that have another name."""
TAGS = {
    "geom": "geom",
    "jnt": "joint|freejoint",
    "dof": "joint|freejoint",
    "body": "body",
    "site": "site",
    "actuator": r"\w+",
    "eq": r"\w+",
    "tendon": "fixed|spatial",
}
"""Patterns of MJCF tags, by the prefix of the element's fields."""


def _written_as(change: Change) -> tuple[str, str] | None:
    """Return the XML attribute that a change edits, and a pattern of the tags that have it."""
    kind, _, field = change.change.partition("_")
    attribute = {"kp_kv": "kp", "collides": "contype", "condim_friction": "condim"}.get(
        field, field
    )
    return (attribute, TAGS[kind]) if field and kind in TAGS else None


def _follows(change: Change) -> str:
    """Return the call that must follow an edit made between steps; empty if none is needed."""
    return "mujoco.mj_setConst" if change.change in DERIVED_FROM else ""


INTERVENTIONS = Interventions(
    ROWS,
    OPTIONS,
    _set_parameter,
    SEES,
    trial_of,
    _words_of,
    played,
    _written_as,
    _follows,
)
