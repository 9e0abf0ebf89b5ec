"""Findings of joints: beyond their limits, motors that give all they may."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from pipeline.analysis.general.segments import unbroken
from pipeline.analysis.script.evidence import Evidence
from pipeline.analysis.script.results import ScriptFinding
from pipeline.seen import Body, Joint

BEYOND = 0.01
"""Share of its range that a joint may be beyond it before it is worth reporting."""
FOR_LONG = 10
"""Samples, one after the other, that a motor must be at its limit to be worth reporting."""
RESETS = ("resetJointState", "resetJointStateMultiDof")
POSITION_CONTROL = 2
"""As PyBullet numbers it. A motor that holds a velocity is often used as friction: its limit is its
purpose."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, by body."""
    for number in e.seen.joints:
        body = e.seen.bodies[number]
        moving = [one for one in body.joints if any(one.widths)]
        if all(one.widths == (1, 1, 1) for one in moving):
            for column, joint in enumerate(moving):
                yield from _beyond(e, body, joint, column)
            yield from _at_limit(e, body, moving)


def _beyond(e: Evidence, body: Body, joint: Joint, column: int) -> Iterator[ScriptFinding]:
    low, high = joint.limits
    if not low < high:
        return
    joints = e.seen.joints[body.number]
    position = joints.position[:, column]
    over = np.maximum(position - high, low - position)
    row = int(np.argmax(over))
    if over[row] > BEYOND * (high - low):
        unit = "m" if joint.kind == "prismatic" else "rad"
        yield e.finding(
            "joint-beyond-limits",
            f"has its joint {joint.name} at {position[row]:.4g} {unit} at step "
            f"{int(joints.steps[row])}; its limits are {low:.4g} and {high:.4g}: where a joint "
            "begins, and where p.resetJointState puts it, is not held against them, and the solver "
            "holds them only as well as it can",
            body=body.number,
            step=int(joints.steps[row]),
            site=_put_by(
                e, body, joint, int(joints.steps[np.argmax(over > BEYOND * (high - low))])
            ),
        )


def _put_by(e: Evidence, body: Body, joint: Joint, step: int) -> str | None:
    """Return file and line of the call that put a joint where it is at a step, or just before."""
    named = re.compile(rf"{body.engine_id}, {joint.link}\b|.*\bjointIndex={joint.link}\b")
    for call in reversed(e.seen.calls):
        reset = call.function in RESETS and call.client == body.client
        if reset and step - 1 <= call.at.step <= step and named.match(call.arguments):
            return e.site((call.function,), call.at, body)
    return None


def _at_limit(e: Evidence, body: Body, moving: list[Joint]) -> Iterator[ScriptFinding]:
    """Yield the motor of a body that gave all it may for longest."""
    joints, longest = e.seen.joints[body.number], (0, 0, 0, 0.0)
    for column, joint in enumerate(moving):
        told = [
            one
            for one in e.seen.motors
            if one.body.number == body.number and one.joint == joint.link
        ]
        if not told:
            continue
        which = np.searchsorted([one.at.step for one in told], joints.steps - 1, side="right") - 1
        drives = np.array([one.mode == POSITION_CONTROL and one.force > 0 for one in told])
        limits = np.array([one.force for one in told])
        torque = np.abs(joints.torque[:, column])
        full = (which >= 0) & drives[which] & (torque >= limits[which] * (1 - 1e-6))
        for first, last in unbroken(full, np.diff(joints.steps, prepend=-2) != 1):
            if last - first >= longest[0]:
                longest = last - first + 1, column, first, float(limits[which[first]])
    samples, column, first, limit = longest
    if samples >= FOR_LONG:
        unit = "N" if moving[column].kind == "prismatic" else "N m"
        yield e.finding(
            "motor-at-limit",
            f"drives its joint {moving[column].name} with all of its {limit:.4g} {unit} for "
            f"{samples} steps from step {int(joints.steps[first])} on, and lags behind its target "
            "as long; give p.setJointMotorControl2 more force",
            body=body.number,
            step=int(joints.steps[first]),
        )
