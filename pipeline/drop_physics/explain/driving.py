"""Converts actuator controls to commands for the joints that the actuators drive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.commands import NAMES, Commanded
from drop_physics.trace.events import Actuator, Body
from drop_physics.trace.history import Piece
from drop_physics.trace.motors import POSITION, VELOCITY

LOUDER = {"motor": 0, "general": 0, "muscle": 0, "velocity": 1, "position": 2}
"""Rank of an actuator's kind: of several actuators on a joint, the one with the highest rank
determines the joint's command."""


def control_of(actuator: Actuator, body: Body, piece: Piece, ends: Int64) -> Float64:
    """Return an actuator's control in the given steps, shape (n,); nan if unknown."""
    steps, values = piece.controls.get(body.client, (np.empty(0, np.int64), np.empty((0, 0))))
    given = np.full(len(ends), np.nan)
    if actuator.number >= values.shape[1]:
        return given
    which = np.searchsorted(steps, ends, side="right") - 1
    given[which >= 0] = values[which[which >= 0], actuator.number]
    return given


def control_changed_at(actuator: Actuator, body: Body, piece: Piece, ends: Int64) -> Float64:
    """Return the step in which an actuator's control last changed, shape (n,); nan if unknown.

    If the last change was before the chunk, it is the step at which any actuator's control last
    changed.
    """
    steps, values = piece.controls.get(body.client, (np.empty(0, np.int64), np.empty((0, 0))))
    found = np.full(len(ends), np.nan)
    if actuator.number >= values.shape[1]:
        return found
    differs = np.diff(values[:, actuator.number], prepend=np.nan) != 0
    at = steps[np.maximum.accumulate(np.where(differs, np.arange(len(steps)), 0))]
    which = np.searchsorted(steps, ends, side="right") - 1
    found[which >= 0] = at[which[which >= 0]] - 1
    return found


def clamped(actuator: Actuator, given: Float64) -> Float64:
    """Return an actuator's control, clamped to its range."""
    return given if actuator.ctrl_range is None else np.clip(given, *actuator.ctrl_range)


def limited_motors(
    body: Body, controls: Mapping[Actuator, Float64]
) -> Iterator[tuple[int, Flags, float]]:
    """Yield motors with a limited control: rate, steps at the limit, and force at the limit.

    The steps are flags of shape (n,), set where the control is at an end of its range or beyond;
    the force is in [N] or [N m]. `controls` has the control of each actuator, shape (n,).
    """
    for actuator, given in controls.items():
        rate = body.rate_of(actuator)
        if rate is not None and actuator.ctrl_range is not None and actuator.kind == "motor":
            low, high = actuator.ctrl_range
            most = max(abs(low), abs(high)) * abs(actuator.gear * actuator.kp)
            yield rate, np.asarray((given <= low) | (given >= high)), most


def strongest(given: Float64) -> float:
    """Return the control with the largest magnitude."""
    return float(given[int(np.nanargmax(np.abs(given)))])


def limit_of(actuator: Actuator) -> float:
    """Return the largest force that an actuator exerts on a joint [N] or [N m]."""
    if actuator.force_range is None:
        return np.inf
    return max(abs(each) for each in actuator.force_range) * abs(actuator.gear)


def actuator_commands(body: Body, piece: Piece, ends: Int64, timestep_s: Float64) -> Commanded:
    """Convert actuator controls to commands for a body's joints in the steps to samples.

    A joint without an actuator has a motor that is off.
    """
    n, rates = len(ends), sum(joint.widths[1] for joint in body.joints)
    columns = {name: np.full((n, rates), np.nan) for name in NAMES}
    columns["mode"][:], columns["impulse"][:] = VELOCITY, 0.0
    for actuator in sorted(body.actuators, key=lambda each: LOUDER[each.kind]):
        k = body.rate_of(actuator)
        if k is None:
            continue
        given = clamped(actuator, control_of(actuator, body, piece, ends))
        columns["impulse"][:, k] = limit_of(actuator) * timestep_s
        columns["torque_since"][:, k] = np.nan
        columns["told"][:, k] = columns["began"][:, k] = control_changed_at(
            actuator, body, piece, ends
        )
        if actuator.kind == "position" and actuator.gear:
            columns["mode"][:, k] = POSITION
            columns["target"][:, k] = given / actuator.gear
            columns["kp"][:, k], columns["kd"][:, k] = actuator.kp, actuator.kv
        elif actuator.kind == "velocity" and actuator.gear:
            columns["mode"][:, k] = VELOCITY
            columns["target_velocity"][:, k] = given / actuator.gear
        else:
            columns["torque_since"][:, k] = 0.0
    return Commanded(**columns)
