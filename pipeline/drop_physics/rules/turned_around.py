"""The rule `unstable` for joints whose velocity reverses in every step, and why it does."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.cause_names import cause_in_words
from drop_physics.explain.causes import TENDON_LIMIT
from drop_physics.explain.steps import Steps
from drop_physics.fields import alternatives
from drop_physics.messages import Message
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.servo import Servos
from drop_physics.rules.answer import Cure
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import actuators_on, link_of
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import CROSSINGS, DOUBLES, GROWN, RINGS_STEPS

FOURTH_ORDER, AT_THE_END = 1, (2, 3)
"""Values of `opt.integrator`: Runge-Kutta, and those that use the damping of actuators at the
end of a step."""


@joint_rule("unstable", "broken", engines=MUJOCOS)
def turned_around(joints: JointColumns) -> Match:
    """A gain or a damper is too stiff for the timestep.

    The joint's rate reverses in every step and grows. Either the known law of an actuator or damper
    predicts this, or a torque of the script reverses the rate repeatedly, faster each time.
    """
    steps = joints.driven.steps
    nowhere = np.zeros(joints.target.shape, np.bool_)
    if not steps.covered:
        return Match(nowhere, np.zeros(nowhere.shape))
    first = steps.law.tree.first_rate
    before, after = (each.velocity[:, first:] for each in (steps.before, steps.after))
    explicit = int(joints.setting("integrator", 0)) == FOURTH_ORDER
    goes_on = steps.closes[:, None] & (before != 0)
    grown = goes_on & (np.abs(after) > np.abs(before))
    turned = goes_on & (before * after < 0)
    breaks = np.append(~steps.closes[1:], False)
    fastest, broken = np.abs(after), np.repeat(breaks[:, None], before.shape[1], axis=1)
    if not explicit:  # whose steps may grow without turning around
        grown &= turned
    where, size = nowhere.copy(), np.zeros(nowhere.shape)
    named = np.full(nowhere.shape, "", dtype=object)
    numbers = {name: np.full(nowhere.shape, np.nan) for name in NUMBERS}
    examined = functools.cache(lambda: _examined(steps))  # once for all joints of the body
    for k in np.flatnonzero((grown | turned).any(axis=0)).tolist():
        rows = np.flatnonzero(grown[:, k])
        its = _servos(joints, k, examined) if len(rows) else None
        if its is not None and its[0].alone(its[1]).grows:
            named[rows, k] = turner = _turner(joints, rows, first + k)
            acts = np.isin(turner, [_by(joints, k), "joint damping"])
            where[rows[acts], k], size[rows[acts], k] = True, its[0].growth
            numbers["gear"][rows, k] = (
                [each.gear for each in actuators_on(joints.driven.body, k)] or [1.0]
            )[0]
            numbers["lasts"][rows, k] = 1.0
            for name, value in _limits(*its).items():
                numbers[name][rows, k] = value
            continue
        rows = np.flatnonzero(turned[:, k])
        if not len(rows):
            continue
        named[rows, k] = turner = _turner(joints, rows, first + k)
        drives = [
            name.partition(" ")[0] in DRIVES and not name.startswith(TENDON_LIMIT)
            for name in turner.tolist()
        ]
        broken[rows, k] = ends = np.maximum.reduceat(breaks, rows)
        # What comes before a turn begins with the turn before it, or where the sum breaks.
        marks = np.unique(np.concatenate([[0], rows, np.flatnonzero(breaks) + 1]))
        most, at = np.maximum.reduceat(np.abs(after[:, k]), marks), np.searchsorted(marks, rows)
        fastest[rows, k] = tops = most[at]
        before_it = np.append(0.0, most)[at]
        size[rows, k] = _growth(before_it, tops, np.array(drives, np.bool_), ends)
        where[rows, k] = size[rows, k] > 0
        numbers["lasts"][rows, k] = np.diff(rows, append=2 * rows[-1] - rows[-2:][0])
    noted = {"turner": named.astype(np.str_), "timestep": steps.reported.timestep_s[:, None]}
    return Match(where, size, {**noted, **numbers}, most={"fastest": fastest, "broken": broken})


@turned_around.counts
def _(inertia: Float64, count: Int64, broken: Flags, size: Float64) -> Float64:
    # A law that is known is broken by one turn before a reset as well; else some turns are a bump.
    by_law = np.isfinite(inertia) & ((count >= CROSSINGS) | broken)
    return np.where(by_law | (count >= RINGS_STEPS), size, 0.0)


NUMBERS = (
    *("stiffness", "damping", "gear", "inertia", "springs", "most", "gain", "least_timestep"),
    *("armature", "implicit", "lasts"),
)
SERVOS = "position", "velocity"
POSES = 100
"""Number of poses in a chunk at which a joint's inertia is examined."""
DRIVES = "actuator", "applied", "tendon"
"""Kinds of terms that may reverse a joint by an unknown control law."""


def _turner(joints: JointColumns, rows: NDArray[np.intp], place: int) -> NDArray[np.object_]:
    """Return the name of the term that contributes most to each reversal of a joint's rate."""
    steps = joints.driven.steps
    names = [*steps.terms]
    change = (steps.after.velocity - steps.before.velocity)[rows, place]
    pushed = np.stack([steps.terms[name][rows, place] for name in names]) * np.sign(change)
    return np.asarray(np.array(names, dtype=object)[np.argmax(pushed, axis=0)])


def _by(joints: JointColumns, k: int) -> str:
    """Return the term of a joint's only actuator; empty if it has none or several."""
    its = actuators_on(joints.driven.body, k)
    return f"actuator {its[0].name}" if len(its) == 1 else ""


Examined = tuple[NDArray[np.intp], Float64]
"""The steps at whose start the inertia is examined, and the inverse mass matrices there."""


def _examined(steps: Steps) -> Examined:
    """Return some steps of a chunk, and the inverse mass matrices of their poses."""
    rows = np.unique(np.linspace(0, len(steps) - 1, POSES).astype(int))
    rows = rows[np.isfinite(steps.before.position_m[rows]).all(axis=1)]
    inverse = np.linalg.inv(mass_matrix(kinematics(steps.law.tree, steps.before.at(rows))))
    return rows, np.asarray(inverse)


def _servos(
    joints: JointColumns, k: int, examined: Callable[[], Examined]
) -> tuple[Servos, int] | None:
    """Return a body's joints as springs and dampers, and the index of joint `k` among them.

    The pose is that of the chunk in which the joint has the least inertia. None for a spherical
    joint, and if several actuators act on the joint.
    """
    steps, body = joints.driven.steps, joints.driven.body
    if body.joints[link_of(body, k)].widths[1] != 1 or len(actuators_on(body, k)) > 1:
        return None
    integrator = int(joints.setting("integrator", 0))
    size, first = steps.law.tree.size, steps.law.tree.first_rate
    stiffness, ends, begins = np.zeros((3, size))
    own = begins if integrator == FOURTH_ORDER else ends
    of_actuators = ends if integrator in AT_THE_END else begins
    for joint, place in zip(body.joints, body.rates, strict=True):
        at = slice(first + place.start, first + place.stop)
        own[at] += joint.damping
        for actuator in body.actuators:
            if (actuator.acts_on, actuator.target) == ("joint", joint.name):
                of_actuators[at] += actuator.kv * actuator.gear**2 * (actuator.kind in SERVOS)
                stiffness[at] += actuator.kp * actuator.gear**2 * (actuator.kind == "position")
    rows, inverse = examined()
    least = int(np.argmax(inverse[:, first + k, first + k]))
    held = np.flatnonzero((stiffness + ends + begins > 0) | (np.arange(size) == first + k))
    servos = Servos(
        timestep_s=float(steps.reported.timestep_s[rows[least]]),
        inertia=np.linalg.inv(inverse[least][np.ix_(held, held)]),
        stiffness=stiffness[held],
        ends=ends[held],
        begins=begins[held],
        fourth_order=integrator == FOURTH_ORDER,
    )
    return servos, int(np.searchsorted(held, first + k))


def _limits(servos: Servos, place: int) -> dict[str, float]:
    """Return the stability limit of each parameter of a joint, others unchanged; nan if none."""
    alone = servos.alone(place)
    now = {
        "stiffness": float(alone.stiffness[0]),
        "begins": float(alone.begins[0]),
        "timestep_s": servos.timestep_s,
    }

    def calm(of: Servos, name: str, at: int) -> float:
        factor = of.limit(name, at) if now.get(name, 1.0) else None
        return np.nan if factor is None else factor

    name = (
        "stiffness" if now["stiffness"] and np.isfinite(calm(alone, "stiffness", 0)) else "begins"
    )
    implicit = replace(servos, ends=servos.ends + servos.begins, begins=0 * servos.begins)
    return {
        "stiffness": now["stiffness"],
        "damping": now["begins"],
        "inertia": float(alone.inertia[0, 0]),
        "springs": float(name == "stiffness"),
        "most": now[name] / calm(alone, name, 0),
        "gain": now[name] / calm(servos, name, place),
        "least_timestep": servos.timestep_s / calm(servos, "timestep_s", place),
        "armature": (calm(servos, "inertia", place) - 1) * float(servos.inertia[place, place]),
        "implicit": float(not implicit.grows),
    }


def _growth(before: Float64, tops: Float64, drives: Flags, ends: Flags) -> Float64:
    """Return the factor by which a joint's speed grows per reversal, shape (turns,); else 0.

    The speed must grow by the factor GROWN over at least RINGS_STEPS reversals, or double with each
    one until steps are no longer explained. `drives` flags reversals by a term that may be the
    cause, `ends` those after which steps are unexplained.
    """
    found = np.zeros(len(tops))
    for factor in (1.0, DOUBLES):
        grows = drives & (tops > factor * before) & (before > 0)
        others = np.append(True, (grows[1:] != grows[:-1]) | ends[:-1])
        for start, end in pairwise([*np.flatnonzero(others).tolist(), len(grows)]):
            if not grows[start]:
                continue
            count, all_of_it = end - start, tops[end - 1] / before[start]
            rings = count >= RINGS_STEPS and all_of_it >= GROWN
            if rings or (factor == DOUBLES and count > 1 and ends[end - 1]):
                found[start:end] = all_of_it ** (1 / count)
    return found


@turned_around.notes
def _(
    unit: str,
    turner: str,
    lasts: float,
    fastest: float,
    stiffness: float,
    damping: float,
    gear: float,
    inertia: float,
    timestep: float,
    most: float,
    gain: float,
    springs: float,
    least_timestep: float,
    armature: float,
    implicit: float,
    broken: bool,
) -> Noted:
    h, kind = timestep, turner.partition(" ")[0]
    by_law, is_damper = bool(np.isfinite(inertia)), kind != "actuator" and not springs
    limit = gain if is_damper else gain / gear**2
    ways: list[str] = [Message("a timestep below {n:g} ms", n=_within(least_timestep * 1e3))]
    if np.isfinite(limit):
        name = "damping" if is_damper else "kp" if springs else "kv"
        ways.insert(0, Message("{name} below {n:g}", name=name, n=_within(limit)))
    if np.isfinite(armature):
        least = f"{-_within(-armature):g} {_unit(unit)}"
        ways.append(Message("armature above {least}", least=least))
    if implicit:
        ways.append(Message('integrator="implicitfast"'))
    return {
        "by_law": by_law,
        "by": kind,
        "springs": by_law and bool(springs),
        "either": by_law and bool(np.isnan(most)),
        "limit": limit,
        "rotor": -_within(-armature),
        "ways": alternatives(ways) if by_law else "",
        # Beside another joint that turns around no gain of its own holds it.
        "cure": Cure("timestep", value=float(np.ceil(h / _within(least_timestep))))
        if by_law
        else None,
        "term": cause_in_words(turner),
        "often": Message("every {n:.0f} steps", n=lasts) if lasts > 1 else EACH_STEP,
        "rate": f"{fastest:.3g} {unit}/s",
        "geared": Message(" at a gear of {gear:g}", gear=gear) if gear != 1 else "",
        "squared": "gear² " if gear != 1 else "",
        "kp": stiffness / gear**2,
        "kv": damping / gear**2,
        "inertia": f"{inertia:.2g} {_unit(unit)}",
        "h": h * 1e3,
        "ratio": stiffness * h**2 / inertia,
        "share": damping * h / inertia,
        "greatest": most * h ** (1 + springs) / inertia,
        # Who gives more with each swing may mean to.
        "level": "model" if lasts > 1 and not broken else None,
        "proposed": bool(lasts > 1) or None,
    }


EACH_STEP = Message("with every step")
BY_SCRIPT = SayingRow(
    says=Message(
        "{joint} turns around {often}, {size:.3g} times as fast each time, up to {rate}, by {term}"
    )
)
ARMATURE = Remedy("armature", "joint")
HOLDS_IT = SayingRow(advice=Message("each of these holds it: {ways}"))
turned_around.rows(
    SayingRow(
        when=lambda by_law, by: not by_law and by == "tendon",
        says=Message(
            "{joint} turns around {often}, {size:.3g} times as fast each time, up to {rate}, "
            "by the spring and damper of {term}"
        ),
        advice=Message(
            'a smaller damping of the tendon, a shorter timestep, or integrator="implicitfast"'
        ),
        cure=ARMATURE,
    ),
    SayingRow(
        when=lambda by_law, lasts: not by_law and lasts > 1,
        advice=Message(
            "a gain of the rate that brakes, smaller gains, or forces that are given anew in each "
            "step"
        ),
        cure=ARMATURE,
    ).like(BY_SCRIPT),
    SayingRow(
        when=lambda by_law: not by_law,
        advice=Message(
            "smaller gains, most of all that of the rate, a shorter timestep, or armature=… of the "
            "<joint>"
        ),
        cure=ARMATURE,
    ).like(BY_SCRIPT),
    SayingRow(
        when=lambda springs: springs,
        says=Message(
            "{joint} turns around with every step and grows, by {term}: kp = {kp:.3g}{geared} on "
            "an inertia of {inertia} in steps of {h:.3g} ms has kp {squared}h²/I = "
            "{ratio:.3g}, and above {greatest:.3g} it grows"
        ),
        cure=Remedy("gains", "joint", "limit", form="kp-below"),
    ).like(HOLDS_IT),
    SayingRow(
        when=lambda by, either: by == "actuator" and either,
        says=Message(
            "{joint} turns around with every step and grows, by {term}: on an inertia of "
            "{inertia} in steps of {h:.3g} ms{geared} either gain alone makes it grow, "
            "kp = {kp:.3g} with kp {squared}h²/I = {ratio:.3g} and kv = {kv:.3g} with "
            "kv {squared}h/I = {share:.3g}"
        ),
        cure=Remedy("armature", "joint", "rotor"),
    ).like(HOLDS_IT),
    SayingRow(
        when=lambda by: by == "actuator",
        says=Message(
            "{joint} turns around with every step and grows, by {term}: kv = {kv:.3g}{geared} on "
            "an inertia of {inertia} in steps of {h:.3g} ms has kv {squared}h/I = "
            "{share:.3g}, and above {greatest:.3g} it grows"
        ),
        cure=Remedy("gains", "joint", "limit", form="kv-below"),
    ).like(HOLDS_IT),
    SayingRow(
        says=Message(
            "the rate of {joint} grows with every step, by its damping: damping = {damping:.3g} on "
            "an inertia of {inertia} in steps of {h:.3g} ms has damping h/I = {share:.3g}, "
            "and above 2.79 steps of Runge and Kutta grow, which take it at their beginning"
        ),
        cure=Remedy("damping", "joint", "limit", form="below"),
    ).like(HOLDS_IT),
    like=SayingRow(effect="size", unit="1"),
)


def _unit(unit: str) -> str:
    return "kg" if unit == "m" else "kg m²"


def _within(limit: float) -> float:
    """Round a limit down to two significant digits."""
    digit = 10.0 ** (np.floor(np.log10(abs(limit))) - 1)
    return float(f"{np.floor(limit / digit) * digit:.2g}")
