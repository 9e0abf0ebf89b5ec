"""Findings on joints: beyond their limits, motors at their maximum force."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.general.segments import unbroken
from drop_physics.analysis.script.evidence import Evidence, is_of
from drop_physics.analysis.script.results import ScriptFinding
from drop_physics.analysis.script.tracks import life_of
from drop_physics.messages import Message
from drop_physics.seen.events import At, Body, Joint, order

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

BEYOND = 0.01
"""Share of its range by which a joint may exceed it before it is worth reporting."""
FOR_LONG = 10
"""Consecutive samples at its limit that make a motor worth reporting, or that a joint must move on
beyond its limits to have none."""
LIMITS = {"jointLowerLimit": 1.0, "jointUpperLimit": -1.0}
"""Arguments of `changeDynamics`, and what they are by default."""
RESETS = ("resetJointState", "resetJointStateMultiDof")
LISTS = re.compile(r"\[[^]]*\]")
"""In a call's arguments."""
TIMESTEPS = re.compile(r"^[^=,]+(,|$)|fixedTimeStep|numSubSteps")
"""In the arguments of `setPhysicsEngineParameter`: the first one, or by name."""
POSITION_CONTROL = 2
"""PyBullet's number for it. A motor that holds a velocity is often used as friction, so being at
its limit is its purpose."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, by body."""
    for number in e.seen.joints:
        body = e.seen.bodies[number]
        moving = [joint for joint in body.joints if any(joint.widths)]
        if all(joint.widths == (1, 1, 1) for joint in moving):
            for column, joint in enumerate(moving):
                yield from _beyond(e, body, joint, column)
            yield from _at_limit(e, body, moving)


def _beyond(e: Evidence, body: Body, joint: Joint, column: int) -> Iterator[ScriptFinding]:
    joints = e.seen.joints[body.number]
    position = joints.position[:, column]
    lows, highs = _limits(e, body, joint)
    over = np.where(lows < highs, np.maximum(position - highs, lows - position), -np.inf)
    own = (lows == joint.limits[0]) & (highs == joint.limits[1])
    over[own & _moves_on(e, body, over, BEYOND * float(np.ptp(joint.limits)))] = -np.inf
    beyond = over > BEYOND * (highs - lows)
    if beyond.any():
        row = int(np.argmax(np.where(beyond, over, -np.inf)))
        step = int(joints.steps[row])
        message = Message(
            "{body} has its joint {joint} at {position:.4g} {unit} at step {step}; its limits are "
            "{low:.4g} and {high:.4g}: a start, p.resetJointState or new limits may "
            "leave it beyond them, and the solver enforces them only approximately, with no more "
            "than their jointLimitForce",
            body=body.label,
            joint=joint.name,
            position=position[row],
            unit="m" if joint.kind == "prismatic" else "rad",
            step=step,
            low=lows[row],
            high=highs[row],
        )
        first = int(joints.steps[np.argmax(beyond)])
        site = _put_by(e, body, joint, first)
        yield e.finding("joint-beyond-limits", message, body=body.number, step=step, site=site)


def _moves_on(e: Evidence, body: Body, over: Float64, far: float) -> Flags:
    """Return the samples of those lives of a body in which its joint moved far beyond its limits.

    Such a joint has none: PyBullet reports those that a file gives a continuous joint, and does not
    enforce them. One that has limits may creep on, but not far.
    """
    record, steps = e.seen.by_body[body.number], e.seen.joints[body.number].steps
    life = life_of(record, steps)
    again = (np.diff(steps, prepend=-2) != 1) | (np.diff(life, prepend=0) != 0)
    again |= np.isin(steps, [put.at.step + 1 for put in record.puts])
    with np.errstate(invalid="ignore"):  # without limits it is infinitely far from them
        further = (over > 0) & (np.diff(over, prepend=np.inf) > 0)
    runs = unbroken(further, again)
    on = [
        first for first, last in runs if last - first >= FOR_LONG and over[last] - over[first] > far
    ]
    return np.isin(life, life[on])


def _limits(e: Evidence, body: Body, joint: Joint) -> tuple[Float64, Float64]:
    """Return the lowest and the highest position in the step that led to each sample.

    `changeDynamics` changes both, `getJointInfo` goes on reporting those of the file. One that is
    not given is 1 or -1, and both are ignored where the lowest is above the highest
    (`pybullet_changeDynamicsInfo`). With a `jointLimitForce` of 0 there are none.
    """
    steps, record = e.seen.joints[body.number].steps, e.seen.by_body[body.number]
    life, came = life_of(record, steps), [order(each.at) for each in record.came]
    began = np.maximum(steps - 1, np.array([step for step, _ in came])[life])
    limits, off = np.tile(joint.limits, (len(steps), 1)), np.zeros(len(steps), dtype=bool)
    for given in record.given:
        low, high = (
            float(np.ravel(given.values.get(name, default))[0]) for name, default in LIMITS.items()
        )
        if given.values.get("linkIndex") != joint.link:
            continue
        its = (life == bisect_right(came, order(given.at)) - 1) & (began >= given.at.step)
        if low <= high:
            limits[its] = low, high
        force = float(np.ravel(given.values.get("jointLimitForce", -1))[0])
        if force >= 0:
            off[its] = force == 0
    limits[off] = -np.inf, np.inf
    return limits[:, 0], limits[:, 1]


def _put_by(e: Evidence, body: Body, joint: Joint, step: int) -> str | None:
    """Return file and line of the call that put a joint where it is at a step, or just before."""
    named = re.compile(rf"{body.engine_id}, {joint.link}\b|.*\bjointIndex={joint.link}\b")
    for call in reversed(e.seen.calls):
        reset = call.function in RESETS and call.client == body.client
        if reset and step - 1 <= call.at.step <= step and named.match(call.arguments):
            return e.site((call.function,), call.at, body)
    return None


def _at_limit(e: Evidence, body: Body, moving: list[Joint]) -> Iterator[ScriptFinding]:
    """Yield the motor of a body that was at its maximum force for longest.

    One that nothing held if there is any: more force may not move what touches something.
    """
    joints, runs = e.seen.joints[body.number], list[tuple[bool, int, int, int, float]]()
    record = e.seen.by_body[body.number]
    came, life = [order(each.at) for each in record.came], life_of(record, joints.steps)
    again = (np.diff(joints.steps, prepend=-2) != 1) | (np.diff(life, prepend=0) != 0)
    for column, joint in enumerate(moving):
        motors = [
            motor
            for motor in e.seen.motors
            if motor.body.number == body.number and motor.joint == joint.link
        ]
        if not motors:
            continue
        began = [motor.at.step for motor in motors]
        which = np.searchsorted(began, joints.steps - 1, side="right") - 1
        drives = np.array([each.mode == POSITION_CONTROL and each.force > 0 for each in motors])
        limits = np.array([motor.force for motor in motors])
        torque = np.abs(joints.effort[:, column])
        # A body that is loaded again has none of the motors that it had.
        drives_it = np.array([bisect_right(came, order(motor.at)) - 1 for motor in motors])
        full = (
            (which >= 0)
            & (drives_it[which] == life)
            & drives[which]
            & (torque >= limits[which] * (1 - 1e-6))
        )
        if full.any():
            full &= joints.steps <= _until(e, body, [motor.at for motor in motors])[which]
        for first, last in unbroken(full, again):
            samples = last - first + 1
            if samples >= FOR_LONG:
                free = not _held(e, body, joint, int(joints.steps[first]), int(joints.steps[last]))
                runs.append((free, samples, column, first, float(limits[which[first]])))
    if runs:
        free, samples, column, first, limit = max(runs, key=lambda run: run[:2])
        step = int(joints.steps[first])
        message = Message(
            "{body} drives its joint {joint} with its maximum of {limit:.4g} {unit} for {samples} "
            "steps from step {step} on, and may lag behind its target",
            body=body.label,
            joint=moving[column].name,
            limit=limit,
            unit="N" if moving[column].kind == "prismatic" else "N m",
            samples=samples,
            step=step,
        )
        if free and _aims(e, body):
            message = Message("{finding}; give p.setJointMotorControl2 more force", finding=message)
        yield e.finding("motor-at-limit", message, body=body.number, step=step)


def _until(e: Evidence, body: Body, set_at: list[At]) -> Float64:
    """Return the last step at which each motor still has the maximum force that it was given.

    PyBullet keeps it as an impulse: force × the timestep at the time of the call
    (`processSendDesiredStateCommand`). Motors are recorded before the next step, so of several
    calls before it the first counts.
    """
    calls = [call for call in e.seen.calls if call.client == body.client]
    first: dict[int, int] = {}
    for call in calls:
        if call.function.startswith("setJointMotorControl") and is_of(call, body):
            first.setdefault(call.at.step, call.at.call)
    changes = [
        call.at
        for call in calls
        if call.function == "setTimeStep"
        or (call.function == "setPhysicsEngineParameter" and TIMESTEPS.search(call.arguments))
    ]
    since = [(at.step, first.get(at.step, at.call)) for at in set_at]
    return np.array(
        [
            min((each.step for each in changes if order(each) > began), default=math.inf)
            for began in since
        ]
    )


def _aims(e: Evidence, body: Body) -> bool:
    """Whether a call names a position for joints of a body; a motor without one is a brake."""
    for call in e.seen.calls:
        drives = call.function.startswith("setJointMotorControl")
        if drives and call.client == body.client and is_of(call, body):
            given = LISTS.sub("[]", call.arguments).split(", ")
            if "targetPosition" in call.arguments or (len(given) > 3 and "=" not in given[3]):
                return True
    return False


def _held(e: Evidence, body: Body, joint: Joint, first: int, last: int) -> bool:
    """Whether, in some steps, something else than its motor may have held what a joint moves.

    That is a contact, a constraint, or a limit of the velocity that a call gave the body.
    """
    moved = {joint.link}
    for each in body.joints:
        if each.parent in moved:
            moved.add(each.link)
    contacts = e.contacts
    rows = slice(*np.searchsorted(contacts.step, (first, last + 1)).tolist())
    on_a, on_b = (
        (bodies[rows] == body.number) & np.isin(links[rows], list(moved))
        for bodies, links in (
            (contacts.body_a, contacts.link_a),
            (contacts.body_b, contacts.link_b),
        )
    )
    touched = (on_a != on_b) & (contacts.normal_force_n[rows] > 0)
    record = e.seen.by_body[body.number]
    limited = any("maxJointVelocity" in given.values for given in record.given)
    return bool(touched.any() or record.constraints or limited)
