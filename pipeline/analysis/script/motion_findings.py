"""Findings of how bodies move: set, held, damped, past what they should meet."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.analysis.general.segments import SET, UNEXPLAINED
from pipeline.analysis.script.evidence import Evidence
from pipeline.analysis.script.judged import UNKNOWN, Judged
from pipeline.analysis.script.results import ScriptFinding
from pipeline.fields import decimals, fraction
from pipeline.laws.bullet_air import DEFAULT_DAMPING
from pipeline.seen import Body

DAMPED_M = 1e-3
"""By how much damping must move a body in a flight to be worth reporting."""
MOVING_M_S = 1e-3
"""What is slower than that stands, whatever a call makes of it."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, the gravest first."""
    for number, judged in e.judged.items():
        yield from _mismatch(e, number, judged)
        yield from _tunnelled(e, number, judged)
        yield from _clamped(e, number, judged)
        yield from _too_fast(e, number, judged)
        yield from _teleported(e, number, judged)
        yield from _damped(e, number, judged)
    jointed = [one.track.body.label for one in e.judged.values() if one.track.body.joints]
    if jointed:
        names = ", ".join(jointed[:5]) + (" …" if len(jointed) > 5 else "")
        yield e.finding(
            "joints-not-explained",
            f"the laws here are those of one rigid body: of what has joints, motion, energy and "
            f"contacts are measured, not explained: {names}",
        )


def _mismatch(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    rows = np.flatnonzero((judged.code == UNEXPLAINED) & (judged.reason == UNKNOWN))
    if len(rows):
        row = int(rows[0])
        step = int(judged.track.steps[row])
        others = f", nor at {len(rows) - 1} more of its samples" if len(rows) > 1 else ""
        yield e.finding(
            "law-mismatch",
            f"does not follow the engine's law at step {step}, by {judged.deviation[row]:.2g} (m, "
            f"m/s or rad/s){others}: nothing that was recorded says why; "
            "if the recording was not altered, something acted that drop does not know",
            body=number,
            step=step,
        )


def _tunnelled(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    """Yield where a body went through a slab: from one side to the other, with no contact."""
    track = judged.track
    filtered = any(
        one.function.startswith("setCollisionFilter") and one.client == track.body.client
        for one in e.seen.calls
    )
    if track.body.joints or filtered:
        return
    moved = track.led & ~track.put
    before_m, after_m = track.before.position_m, track.motion.position_m
    for other, low, high in e.slabs:
        if other.client != track.body.client:
            continue
        axis = int(np.argmin(high - low))
        down = (before_m[:, axis] > high[axis]) & (after_m[:, axis] < low[axis])
        up = (before_m[:, axis] < low[axis]) & (after_m[:, axis] > high[axis])
        beside = [one for one in range(3) if one != axis]
        inside = _there(e, other, track.steps)
        for position_m in (before_m, after_m):
            inside &= ((position_m > low) & (position_m < high))[:, beside].all(axis=1)
        rows = np.flatnonzero(moved & inside & (down | up))
        touched = np.isin(rows, judged.touches.step[judged.touches.other_body == other.number])
        if len(rows) and not touched[0]:
            row = int(rows[0])
            way_m = float(np.abs(after_m[row, axis] - before_m[row, axis]))
            yield e.finding(
                "tunnelled",
                f"passes through {other.label} at step {int(track.steps[row])} without a contact: "
                f"it moves {way_m * 1e3:.4g} mm in that step, and {other.label} is "
                f"{(high - low)[axis] * 1e3:.4g} mm thick; use a smaller timestep",
                body=number,
                step=int(track.steps[row]),
            )


def _there(e: Evidence, body: Body, steps: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return in which steps a body was there, from the first to the last of its appearances."""
    found = np.zeros(len(steps), dtype=bool)
    for one in e.seen.appearances:
        if one.body.number == body.number:
            found[steps > one.at.step] = one.there
    return found


def _clamped(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    rows = np.flatnonzero(judged.held)
    if len(rows):
        step = int(judged.track.steps[rows[0]])
        yield e.finding(
            "velocity-clamped",
            f"reaches 100 m/s or rad/s at step {step} and is held there: a btMultiBody keeps every "
            "component within ±100; load it with useMaximalCoordinates=True",
            body=number,
            step=step,
        )


def _too_fast(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    edges_m, track = e.extents_m(number, -1), judged.track
    swept = any("ccdSweptSphereRadius" in epoch.given for epoch in track.epochs)
    alone = all(
        one is track.body or one.client != track.body.client for one in e.seen.bodies.values()
    )
    if edges_m is None or track.body.joints or swept or alone:
        return
    way_m = np.linalg.norm(track.motion.position_m - track.before.position_m, axis=1)
    rows = np.flatnonzero(track.led & ~track.put & (way_m > edges_m.min()))
    if len(rows):
        row = int(rows[np.argmax(way_m[rows])])
        law = judged.law_at(row)
        rate = "" if law is None else f" of {fraction(law.timestep_s)} s"
        yield e.finding(
            "timestep-too-long",
            f"moves {way_m[row] * 1e3:.4g} mm in a step{rate} at step {int(track.steps[row])}, and "
            f"is {edges_m.min() * 1e3:.4g} mm thick: it can pass through what is thin, and meets "
            "things deep inside; use a smaller timestep with p.setTimeStep",
            body=number,
            step=int(track.steps[row]),
        )


def _teleported(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    track = judged.track
    rows = np.flatnonzero((judged.code == SET) & track.put)
    rows = rows[(rows > 0) & (track.steps[rows - 1] == track.steps[rows] - 1)]
    # What a script loads again is nothing that it has moved.
    came = [one.at.step + 1 for one in e.seen.by_body[number].came]
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
    put = next(one for one in e.seen.puts if one.body.number == number and one.at.step == step)
    functions = ("resetBasePositionAndOrientation", "restoreState", "changeDynamics")
    yield e.finding(
        "teleported",
        f"is put {decimals(way_m[first] * 1e3, 1)} mm away at step {step} while it moves at "
        f"{speed_m_s[first]:.4g} m/s{_again(len(far) - 1)}: no force moved it there, and its "
        "velocity is what the call leaves",
        body=number,
        step=step,
        site=e.site(functions, put.at, put.body),
    )


def _again(more: int) -> str:
    return f", and {more} time{'s' * (more > 1)} more" if more else ""


def _damped(e: Evidence, number: int, judged: Judged) -> Iterator[ScriptFinding]:
    flights = next(one.flights for one in e.bodies if one.id == number)
    moved = [
        # What is gone without damping: its term, and what it and the timestep do to each other.
        (float(np.linalg.norm(np.add(terms_m.damping, terms_m.interaction))), flight)
        for flight in flights
        if (terms_m := flight.terms_m) is not None
    ]
    if not moved:
        return
    most_m, flight = max(moved, key=lambda one: one[0])
    row = int(np.searchsorted(judged.track.steps, flight.last_step))
    law = judged.law_at(row)
    epoch = next(epoch for epoch, _ in judged.laws if row < epoch.rows.stop)
    default = law is not None and law.drag.linear_per_s == DEFAULT_DAMPING["reduced"]
    if most_m >= DAMPED_M and default and "linearDamping" not in epoch.given:
        yield e.finding(
            "default-damping",
            f"is moved {most_m * 1e3:.3g} mm by damping in its flight from {flight.start_s:.4g} s "
            f"to {flight.end_s:.4g} s: PyBullet damps every body with 0.04 by default; call "
            "p.changeDynamics(body, -1, linearDamping=0)",
            body=number,
            step=flight.first_step,
        )
