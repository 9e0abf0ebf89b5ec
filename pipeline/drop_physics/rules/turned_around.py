"""`unstable`: a joint whose rate turns around with every step, and grows, and what turns it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64
from drop_physics.messages import Message
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.servo import Servo
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.joint import link_of
from drop_physics.rules.rule import Match, Said, Worst, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import CROSSINGS, DOUBLES
from drop_physics.trace.events import Actuator

FOURTH_ORDER, AT_THE_END = 1, (2, 3)
"""Of `opt.integrator`: Runge and Kutta's, and those that take actuators' damping at the end."""


@joint_rule("unstable", "broken", least_count=CROSSINGS, engines=MUJOCOS)
def turned_around(joints: JointColumns) -> Match:
    """A gain is too stiff for the timestep, or a damper for a step that takes it at its beginning.

    The rate turns around with every step and grows, by an actuator or a damper of a law that says
    so; or it doubles each time, until the engine resets the state or the sum no longer closes.
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
    if not explicit:  # whose steps may grow without turning around
        grown &= before * after < 0
    where, size = nowhere.copy(), np.zeros(nowhere.shape)
    named = np.full(nowhere.shape, "", dtype=object)
    numbers = {name: np.full(nowhere.shape, np.nan) for name in NUMBERS}
    for k in np.flatnonzero(grown.any(axis=0)).tolist():
        rows = np.flatnonzero(grown[:, k])
        turner = _turner(joints, rows, first + k)
        named[rows, k] = turner
        servo = _servo(joints, int(rows[0]), k)
        if servo is not None and servo.grows:
            acts = np.isin(turner, [_by(joints, k), "joint damping"])
            where[rows[acts], k], size[rows[acts], k] = True, servo.growth
            for name, value in _limits(servo).items():
                numbers[name][rows, k] = value
            continue
        blown = _blown(grown[:, k], np.abs(before[:, k]), np.abs(after[:, k]), steps.closes)
        driven_by = np.array([name.startswith("actuator ") for name in turner], np.bool_)
        where[rows, k] = blown[rows] & driven_by
        size[rows, k] = np.abs(after[rows, k] / before[rows, k])
    timestep = steps.reported.timestep_s[:, None]
    return Match(where, size, {"turner": named.astype(np.str_), "timestep": timestep, **numbers})


NUMBERS = ("stiffness", "damping", "inertia", "kp", "kv", "least_timestep", "armature")


def _turner(joints: JointColumns, rows: NDArray[np.intp], place: int) -> NDArray[np.object_]:
    """Return the term that pushes a rate most to where some steps bring it."""
    steps = joints.driven.steps
    names = [*steps.terms]
    change = (steps.after.velocity - steps.before.velocity)[rows, place]
    pushed = np.stack([steps.terms[name][rows, place] for name in names]) * np.sign(change)
    return np.asarray(np.array(names, dtype=object)[np.argmax(pushed, axis=0)])


def _by(joints: JointColumns, k: int) -> str:
    """Return the name of the term of the only actuator of a joint; empty if there is none."""
    its = _actuators(joints, k)
    return f"actuator {its[0].name}" if len(its) == 1 else ""


def _actuators(joints: JointColumns, k: int) -> list[Actuator]:
    body = joints.driven.body
    name = body.joints[link_of(body, k)].name
    return [each for each in body.actuators if each.acts_on == "joint" and each.target == name]


def _servo(joints: JointColumns, row: int, k: int) -> Servo | None:
    """Return a joint with its actuator as a spring with dampers; None of a spherical joint."""
    driven = joints.driven
    steps, body = driven.steps, driven.body
    joint = body.joints[link_of(body, k)]
    its = _actuators(joints, k)
    if joint.widths[1] != 1 or len(its) > 1:
        return None
    stiffness = damping = 0.0
    if its and its[0].kind in ("position", "velocity"):
        scale = its[0].gear ** 2
        damping = its[0].kv * scale
        stiffness = its[0].kp * scale if its[0].kind == "position" else 0.0
    integrator = int(joints.setting("integrator", 0))
    at_end = integrator in AT_THE_END
    fourth = integrator == FOURTH_ORDER
    ends = 0.0 if fourth else joint.damping + at_end * damping
    inertias = np.linalg.inv(
        mass_matrix(kinematics(steps.law.tree, steps.before.at(np.array([row]))))[0]
    )
    place = steps.law.tree.first_rate + k
    return Servo(
        timestep_s=float(steps.reported.timestep_s[row]),
        inertia=1 / float(inertias[place, place]),
        stiffness=stiffness,
        ends=ends,
        begins=joint.damping + damping - ends,
        fourth_order=fourth,
    )


def _limits(servo: Servo) -> dict[str, float]:
    """Return where a joint would hold, each number changed alone; nan where none would do."""
    limits = {
        "kp": servo.limit("stiffness"),
        "kv": servo.limit("begins"),
        "least_timestep": servo.limit("timestep_s"),
        "armature": servo.limit("inertia"),
    }
    held = {name: np.nan if value is None else value for name, value in limits.items()}
    held["armature"] -= servo.inertia
    numbers = {"stiffness": servo.stiffness, "damping": servo.begins, "inertia": servo.inertia}
    return held | numbers


def _blown(grown: Flags, before: Float64, after: Float64, closes: Flags) -> Flags:
    """Return the steps of runs that double with each turn until the sum no longer closes."""
    doubles = grown & (after > DOUBLES * before)
    found = np.zeros(len(grown), np.bool_)
    ends = np.append(~closes[1:], False) & doubles
    for end in np.flatnonzero(ends).tolist():
        start = end
        while start and doubles[start - 1]:
            start -= 1
        if end > start:
            found[start : end + 1] = True
    return found


@turned_around.says
def _(worst: Worst) -> Said:
    spring = worst.stiffness > 0 and np.isfinite(worst.kp)
    unit = "kg" if worst.unit == "m" else "kg m²"
    if np.isnan(worst.inertia):
        message = Message(
            "{joint} turns around with every step, {growth:.3g} times as fast, until the state "
            "is reset or no longer a number; what turns it is {term}, by what the script gives it"
        )
        advice = Message(
            "smaller gains in the script, a shorter timestep, or armature=… of the <joint>"
        )
        cure = Cure("armature", worst.joint)
    elif spring:
        message = Message(
            "{joint} turns around with every step and grows, by {term}: kp = {stiffness:.3g} on an "
            "inertia of {inertia} in steps of {timestep:.3g} ms has kp h²/I = {ratio:.3g}, "
            "and above {most:.3g} it grows"
        )
        advice = Message(
            "kp below {kp:.2g}, timestep below {shorter:.2g} ms, or armature above {armature} "
            "hold it, each alone"
        )
        cure = Cure("gains", worst.joint, worst.kp, form="kp-below")
    elif worst.turner.startswith("actuator "):
        message = Message(
            "{joint} turns around with every step and grows, by {term}: kv = {damping:.3g} on an "
            "inertia of {inertia} in steps of {timestep:.3g} ms has kv h/I = {share:.3g}, and "
            "above {most:.3g} it grows"
        )
        advice = Message(
            "kv below {kv:.2g}, timestep below {shorter:.2g} ms, armature above {armature}, or "
            'integrator="implicitfast" hold it, each alone'
        )
        cure = Cure("gains", worst.joint, worst.kv, form="kv-below")
    else:
        message = Message(
            "the rate of {joint} grows with every step, by its damping: damping = {damping:.3g} on "
            "an inertia of {inertia} in steps of {timestep:.3g} ms has damping h/I = {share:.3g}, "
            "and above 2.79 steps of Runge and Kutta grow, which take it at their beginning"
        )
        advice = Message(
            'integrator="Euler" or "implicitfast" takes it at the end; else damping below '
            "{kv:.2g}, timestep below {shorter:.2g} ms or armature above {armature}"
        )
        cure = Cure("damping", worst.joint, worst.kv, form="below")
    h, inertia = worst.timestep, worst.inertia
    return Said(
        message=message,
        values={
            "term": worst.turner,
            "growth": worst.size,
            "inertia": f"{inertia:.2g} {unit}",
            "timestep": h * 1e3,
            "shorter": worst.least_timestep * 1e3,
            "armature": f"{worst.armature:.2g} {unit}",
            "ratio": worst.stiffness * h**2 / inertia,
            "share": worst.damping * h / inertia,
            "most": (worst.kp * h**2 if spring else worst.kv * h) / inertia,
        },
        advice=advice,
        cure=cure,
        effect=Effect(worst.size, "1"),
    )
