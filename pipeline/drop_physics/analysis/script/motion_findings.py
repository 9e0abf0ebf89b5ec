"""Findings on motion: teleported, clamped, damped, through walls."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drop_physics.analysis.general.segments import SET, UNEXPLAINED
from drop_physics.analysis.script.evidence import Evidence
from drop_physics.analysis.script.judged import UNKNOWN, Judged
from drop_physics.analysis.script.results import ScriptFinding
from drop_physics.analysis.script.tracks import life_of
from drop_physics.fields import decimals, fraction
from drop_physics.laws.bullet_air import DEFAULT_DAMPING, MAX_COORDINATE_VELOCITY_M_S
from drop_physics.laws.rotations import rotate
from drop_physics.messages import Message
from drop_physics.seen.events import order
from drop_physics.states import BASE

DAMPED_M = 1e-3
"""How far damping must move a body in a flight to be worth reporting."""
MOVING_M_S = 1e-3
"""A body slower than this is at rest: to put it elsewhere is not worth reporting."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, the gravest first."""
    for number, judged in e.judged.items():
        yield from _mismatch(e, number, judged)
        yield from _tunnelled(e, number, judged)
        yield from _clamped(e, number, judged)
        yield from _too_fast(e, number, judged)
        yield from _teleported(e, number, judged)
        yield from _damped(e, number, judged)
    jointed = [judged.track.body.label for judged in e.judged.values() if judged.track.body.joints]
    if jointed:
        message = Message(
            "the laws here are those of one rigid body: for bodies with joints, motion and "
            "contacts are measured, not explained: {names}",
            names=", ".join(jointed[:5]) + (" …" if len(jointed) > 5 else ""),
        )
        yield e.finding("joints-not-explained", message)


def _mismatch(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    rows = np.flatnonzero((judged.code == UNEXPLAINED) & (judged.reason == UNKNOWN))
    if len(rows):
        row = int(rows[0])
        step = int(judged.track.steps[row])
        when = Message("step {step}", step=step)
        if len(rows) > 1:
            when = Message(
                "step {step} (the first of {samples} samples)", step=step, samples=len(rows)
            )
        message = Message(
            "{body} departs from the engine's law at {when}, by {deviation:.2g} (m, m/s or rad/s): "
            "nothing that was recorded says why; if the recording was not altered, something acted "
            "that drop does not know",
            body=e.label(number),
            when=when,
            deviation=judged.deviation[row],
        )
        yield e.finding("law-mismatch", message, body=number, step=step)


def _tunnelled(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    """Yield where a body passed through a slab without a contact.

    Its shape may be beside its centre of mass, and it may have a hole: what counts is the middle of
    its box, and that no part of it reaches beyond the slab's edges.
    """
    track = judged.track
    if track.body.joints:
        return
    moved, passed = track.led & ~track.put, set()
    record = e.seen.by_body[number]
    balls = np.array([e.ball_m(came) for came in record.came])[life_of(record, track.steps)]
    offset_m, radius_m = balls[:, :3], balls[:, 3:]
    before_m, after_m = (
        motion.position_m + rotate(motion.orientation, offset_m)
        for motion in (track.before, track.motion)
    )
    for other, low, high, after, until in e.slabs:
        if other.client != track.body.client or other.number in passed:
            continue
        if e.filtered(track.body, other):
            continue
        axis = int(np.argmin(high - low))
        down = (before_m[:, axis] > high[axis]) & (after_m[:, axis] < low[axis])
        up = (before_m[:, axis] < low[axis]) & (after_m[:, axis] > high[axis])
        beside = [other for other in range(3) if other != axis]
        inside = (track.steps > after) & (track.steps <= until)
        for position_m in (before_m, after_m):
            within = (position_m - radius_m > low) & (position_m + radius_m < high)
            inside &= within[:, beside].all(axis=1)
        rows = np.flatnonzero(moved & inside & (down | up))
        if not len(rows):
            continue
        touched = np.isin(rows, judged.touches.step[judged.touches.other_body == other.number])
        if not touched[0]:
            row = int(rows[0])
            step = int(track.steps[row])
            passed.add(other.number)
            message = Message(
                "{body} passes through {other} at step {step} without a contact: it moves "
                "{way:.4g} mm in that step, and {other} is {thickness:.4g} mm thick; use a smaller "
                "timestep",
                body=e.label(number),
                other=other.label,
                step=step,
                way=float(np.abs(after_m[row, axis] - before_m[row, axis])) * 1e3,
                thickness=(high - low)[axis] * 1e3,
            )
            yield e.finding("tunnelled", message, body=number, step=step)


def _clamped(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    rows = np.flatnonzero(judged.held)
    if not len(rows):
        return
    step, law = int(judged.track.steps[rows[0]]), judged.law_at(rows[0])
    assert law is not None
    values = {"body": e.label(number), "limit": law.velocity_limit, "step": step}
    record = e.seen.by_body[number]
    if law.velocity_limit != MAX_COORDINATE_VELOCITY_M_S:
        message = Message(
            "{body} exceeds {limit:g} m/s or rad/s within step {step} and is clamped: its "
            "maxJointVelocity limits every component to ±{limit:g}; if that is not intended, "
            "pass changeDynamics a larger one",
            **values,
        )
    elif e.seen.bodies[number].joints or record.constraints:
        message = Message(
            "{body} exceeds {limit:g} m/s or rad/s within step {step} and is clamped: a "
            "btMultiBody, which joints and constraints need, limits every component to ±{limit:g}; "
            "keep it slower",
            **values,
        )
    else:
        message = Message(
            "{body} exceeds {limit:g} m/s or rad/s within step {step} and is clamped: a "
            "btMultiBody limits every component to ±{limit:g}; load it with "
            "useMaximalCoordinates=True",
            **values,
        )
    yield e.finding("velocity-clamped", message, body=number, step=step)


def _too_fast(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    track = judged.track
    swept = any("ccdSweptSphereRadius" in epoch.given for epoch in track.epochs)
    if track.body.joints or swept or not e.may_meet(track.body):
        return
    edges_m = [e.extents_m(number, BASE, order(came.at)) for came in e.seen.by_body[number].came]
    thick_m = np.array([math.inf if edge is None else edge.min() for edge in edges_m])
    thin_m = thick_m[life_of(e.seen.by_body[number], track.steps)]
    way_m = np.linalg.norm(track.motion.position_m - track.before.position_m, axis=1)
    for epoch, law in judged.laws:
        # The engine looks for contact in each substep.
        way_m[epoch.rows] /= law.substeps if law is not None else 1
    rows = np.flatnonzero(track.led & ~track.put & (way_m > thin_m))
    if len(rows):
        row = int(rows[np.argmax(way_m[rows])])
        law, step = judged.law_at(row), int(track.steps[row])
        of_step = Message("a step")
        if law is not None and law.substeps > 1:
            of_step = Message("a substep of {timestep} s", timestep=fraction(law.step_s))
        elif law is not None:
            of_step = Message("a step of {timestep} s", timestep=fraction(law.timestep_s))
        message = Message(
            "{body} moves {way:.4g} mm in {of_step} at step {step}, and is {thickness:.4g} mm "
            "thick: it can pass through thin bodies, and overlaps others before contact acts; use "
            "a smaller timestep with p.setTimeStep",
            body=e.label(number),
            way=way_m[row] * 1e3,
            of_step=of_step,
            step=step,
            thickness=thin_m[row] * 1e3,
        )
        yield e.finding("timestep-too-long", message, body=number, step=step)


def _teleported(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    track = judged.track
    rows = np.flatnonzero((judged.code == SET) & track.put)
    rows = rows[(rows > 0) & (track.steps[rows - 1] == track.steps[rows] - 1)]
    # A body that is loaded again was not moved.
    came = [appearance.at.step + 1 for appearance in e.seen.by_body[number].came]
    rows = rows[~np.isin(track.steps[rows], came)]
    if not len(rows):
        return
    before = track.motion.at(rows - 1)
    way_m = np.linalg.norm(track.before.position_m[rows] - before.position_m, axis=1)
    speed_m_s = np.linalg.norm(before.velocity_m_s, axis=1)
    far = np.flatnonzero((way_m > 0) & (speed_m_s > MOVING_M_S))
    if not len(far):
        return
    first = int(far[0])
    step = int(track.steps[rows[first]]) - 1
    put = next(put for put in e.seen.puts if put.body.number == number and put.at.step == step)
    functions = ("resetBasePositionAndOrientation", "restoreState", "changeDynamics")
    when = Message("step {step}", step=step)
    if len(far) > 1:
        when = Message("step {step} (the first of {times} times)", step=step, times=len(far))
    message = Message(
        "{body} is put {way} mm away at {when} while it moves at {speed:.4g} m/s: no force moved "
        "it there, and the call decides its velocity",
        body=e.label(number),
        way=decimals(way_m[first] * 1e3, 1),
        when=when,
        speed=speed_m_s[first],
    )
    site = e.site(functions, put.at, put.body)
    yield e.finding("teleported", message, body=number, step=step, site=site)


def _damped(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    flights = next(body.flights for body in e.bodies if body.id == number)
    moved = [
        # All that would vanish without damping: its term, and its interaction with the timestep.
        (float(np.linalg.norm(np.add(terms_m.damping, terms_m.interaction))), flight)
        for flight in flights
        if (terms_m := flight.terms_m) is not None
    ]
    if not moved:
        return
    most_m, flight = max(moved, key=lambda pair: pair[0])
    row = int(np.searchsorted(judged.track.steps, flight.last_step))
    law = judged.law_at(row)
    epoch = next(epoch for epoch, _ in judged.laws if row < epoch.rows.stop)
    default = law is not None and law.drag.linear_per_s == DEFAULT_DAMPING["reduced"]
    if most_m >= DAMPED_M and default and "linearDamping" not in epoch.given:
        message = Message(
            "{body} is moved {moved:.3g} mm by damping in its flight from {start:.4g} s to "
            "{end:.4g} s: PyBullet damps every body with 0.04 by default; call "
            "p.changeDynamics(body, -1, linearDamping=0)",
            body=e.label(number),
            moved=most_m * 1e3,
            start=flight.start_s,
            end=flight.end_s,
        )
        yield e.finding("default-damping", message, body=number, step=flight.first_step)
