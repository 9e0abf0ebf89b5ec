"""Findings of how a simulation was set up: steps, gravity, time, random numbers, inertia."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from pipeline.analysis.script.evidence import Evidence
from pipeline.analysis.script.results import ScriptFinding
from pipeline.fields import counted, fraction
from pipeline.seen import Dynamics

OFTEN = 10
"""Steps in which the solver stops early that are more than an impact."""
TINY_INERTIA = 1e-3
"""Share of m R² below which no usual shape has its greatest moment of inertia; a rod has 1/3."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, the gravest first."""
    yield from _not_stepped(e)
    yield from _no_gravity(e)
    yield from _real_time(e)
    yield from _timestep_changed(e)
    yield from _unseeded(e)
    yield from _stopped_early(e)
    yield from _inertia(e)


def _not_stepped(e: Evidence) -> Iterator[ScriptFinding]:
    for client, samples in e.samples.items():
        if samples == 1:
            yield e.finding(
                "not-stepped",
                f"simulation {client} was never stepped, so nothing in it moves by itself: time "
                "passes only in p.stepSimulation()",
            )


def _no_gravity(e: Evidence) -> Iterator[ScriptFinding]:
    for client, samples in e.samples.items():
        called = any(one.function == "setGravity" and one.client == client for one in e.seen.calls)
        free = [
            one.label
            for one in e.seen.bodies.values()
            if one.client == client and one.number in e.judged and not one.joints
        ]
        weightless = all(
            not np.ravel(one.values[f"gravityAcceleration{axis}"]).any()
            for one in e.seen.settings
            if one.client == client
            for axis in "XYZ"
        )
        if samples > 1 and free and weightless and not called:
            yield e.finding(
                "no-gravity",
                f"gravity is 0 in simulation {client}, so that {free[0]} does not fall: PyBullet "
                "starts without; call p.setGravity(0, 0, -9.81)",
            )


def _real_time(e: Evidence) -> Iterator[ScriptFinding]:
    if e.seen.real_time:
        calls = [one for one in e.seen.calls if one.function == "setRealTimeSimulation"]
        site = f"{calls[0].file}:{calls[0].line}" if calls else None
        yield e.finding(
            "real-time",
            "the script asks for real-time simulation, whose steps depend on how fast the machine "
            "is, and which does nothing without a window; here a virtual clock has stepped it. For "
            "the same result each time call p.stepSimulation() instead",
            site=site,
        )


def _timestep_changed(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield where the timestep changed while a body was there: a new scene may have another."""
    told: set[tuple[int, int]] = set()
    for judged in e.judged.values():
        track = judged.track
        for one, other in pairwise(track.epochs):
            before_s, after_s = (
                float(np.ravel(epoch.settings.values["fixedTimeStep"])[0]) for epoch in (one, other)
            )
            at = other.settings.at
            if (
                before_s == after_s
                or one.life != other.life
                or (track.body.client, at.step) in told
            ):
                continue
            told.add((track.body.client, at.step))
            yield e.finding(
                "timestep-changed",
                f"the timestep goes from {fraction(before_s)} s to {fraction(after_s)} s at "
                f"step {at.step}: errors, contacts and motors behave differently from there "
                "on; set it once, before the first step",
                step=at.step,
                site=e.site(("setTimeStep", "setPhysicsEngineParameter"), at),
            )


def _stopped_early(e: Evidence) -> Iterator[ScriptFinding]:
    for one in e.seen.solvers:
        if one.steps >= OFTEN:
            yield e.finding(
                "solver-stopped-early",
                f"the contact solver of simulation {one.client} used all of its "
                f"{counted(one.iterations, 'iteration')} in {one.steps} steps from step "
                f"{one.first_step} on, and left up to {one.left_m_s:.3g} m/s of "
                f"what contacts, joints or motors ask for (step {one.worst_step}): stacks sink "
                "and joints give way by that; call "
                f"p.setPhysicsEngineParameter(numSolverIterations={4 * one.iterations})",
                step=one.first_step,
            )


def _unseeded(e: Evidence) -> Iterator[ScriptFinding]:
    if e.seen.unseeded:
        first = e.seen.unseeded[0]
        more = len(e.seen.unseeded) - 1
        others = f", and at {more} more place{'s' * (more > 1)}" if more else ""
        yield e.finding(
            "unseeded",
            f"random numbers that nothing has seeded are drawn by {first}{others}: no two runs are "
            "the same; record it with --seed 0, or seed them in the script",
            site=first.rpartition(" at ")[2] or None,
        )


def _inertia(e: Evidence) -> Iterator[ScriptFinding]:
    for number in e.judged:
        found = (one for told in e.dynamics_of(number) for one in _of_inertia(e, number, told))
        yield from itertools.islice(found, 1)


def _of_inertia(e: Evidence, number: int, told: Dynamics) -> Iterator[ScriptFinding]:
    """Yield what is wrong with the inertia that the engine reported of a body's parts."""
    given = [
        one.values
        for one in e.seen.by_body[number].given
        if (one.at.step, one.at.call) <= (told.at.step, told.at.call)
    ]
    by_call = any("localInertiaDiagonal" in one for one in given)
    site = e.site(("changeDynamics",), told.at, told.body, "localInertiaDiagonal")
    remedy = "correct <inertia> in its file, or give p.changeDynamics another localInertiaDiagonal"
    if by_call:
        remedy = "give p.changeDynamics another localInertiaDiagonal"
    for link, (mass_kg, moments) in enumerate(
        zip(told.reported["mass_kg"], told.reported["inertia_kg_m2"], strict=True), start=-1
    ):
        if not mass_kg > 0 or not moments.any():
            continue
        low, middle, high = sorted(moments.tolist())
        part = "" if link < 0 else f"link {told.body.links[link + 1]}: "
        if low + middle < high * (1 - 1e-6):
            yield e.finding(
                "impossible-inertia",
                f"{part}has moments of inertia of {low:.3g}, {middle:.3g} and {high:.3g} kg m², "
                "which no body can have: the two smaller ones must add up to the largest or more; "
                f"{remedy}",
                body=number,
                step=told.at.step,
                site=site if by_call else None,
            )
        edges_m = e.extents_m(number, link)
        if edges_m is None:
            continue
        most = float(mass_kg) * float(edges_m @ edges_m) / 4
        if high > most * (1 + 1e-6) or high < TINY_INERTIA * most:
            yield e.finding(
                "inertia-far-from-shape",
                f"{part}has a moment of inertia of {high:.3g} kg m²; {mass_kg:.3g} kg within its "
                f"shape have {most:.3g} at most: a torque turns "
                f"it {'less' if high > most else 'far more'} than its shape can; {remedy}",
                body=number,
                step=told.at.step,
                site=site if by_call else None,
            )
