"""Findings on how a simulation was set up: steps, gravity, time, random numbers, inertia."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from drop_physics.analysis.script.evidence import OFTEN, Evidence
from drop_physics.analysis.script.results import ScriptFinding
from drop_physics.fields import fraction
from drop_physics.laws.lookup import RIGID
from drop_physics.messages import Message
from drop_physics.seen.events import At, Dynamics, order

ENDLESS_M = 1e20
"""A plane has a larger box."""
OFF = re.compile(r"(enableRealTimeSimulation=)?(0|False)\b")
"""The arguments of a call that turns real-time simulation off."""
TINY_INERTIA = 1e-3
"""The greatest moment of inertia of a usual shape is more than this share of m R²; a rod's: 1/3."""


def findings(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield them, the gravest first."""
    yield from _not_stepped(e)
    yield from _no_gravity(e)
    yield from _real_time(e)
    yield from _timestep_changed(e)
    yield from _unseeded(e)
    yield from _stopped_early(e)
    yield from _inertia_alone(e)
    yield from _inertia(e)


def _not_stepped(e: Evidence) -> Iterator[ScriptFinding]:
    for client, samples in e.samples.items():
        if samples == 1:
            message = Message(
                "simulation {client} was never stepped, so nothing in it moves by itself: time "
                "passes only in p.stepSimulation()",
                client=client,
            )
            yield e.finding("not-stepped", message)


def _no_gravity(e: Evidence) -> Iterator[ScriptFinding]:
    for client, samples in e.samples.items():
        called = any(
            call.function == "setGravity" and call.client == client for call in e.seen.calls
        )
        free = [
            body.label
            for body in e.seen.bodies.values()
            if body.client == client
            and body.number in e.judged.keys() & e.heavy
            and not (body.joints or e.seen.by_body[body.number].constraints)
        ]
        weightless = all(
            not np.ravel(settings.values[f"gravityAcceleration{axis}"]).any()
            for settings in e.seen.settings
            if settings.client == client
            for axis in "XYZ"
        )
        # What pushes bodies may be the script's own gravity.
        pushed = any(push.body.client == client for push in e.seen.pushes)
        if samples > 1 and free and weightless and not called and not pushed:
            message = Message(
                "gravity is 0 in simulation {client}, so {body} does not fall: PyBullet starts "
                "without gravity; call p.setGravity(0, 0, -9.81)",
                client=client,
                body=free[0],
            )
            yield e.finding("no-gravity", message)


def _real_time(e: Evidence) -> Iterator[ScriptFinding]:
    if e.seen.real_time:
        calls = [
            call
            for call in e.seen.calls
            if call.function == "setRealTimeSimulation" and not OFF.match(call.arguments)
        ]
        site = f"{calls[0].file}:{calls[0].line}" if calls else None
        message = Message(
            "the script asks for real-time simulation, whose steps depend on how fast the machine "
            "is, and which does nothing without a window; here drop stepped it by the script's "
            "clock. For the same result each time call p.stepSimulation() instead"
        )
        yield e.finding("real-time", message, site=site)


def _timestep_changed(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield where the timestep changed while a body was there: a new scene may have another."""
    changes: dict[int, dict[int, tuple[float, float, At]]] = {}
    for judged in e.judged.values():
        track = judged.track
        of_client = changes.setdefault(track.body.client, {})
        for epoch, after in pairwise(track.epochs):
            before_s, after_s = (
                float(np.ravel(each.settings.values["fixedTimeStep"])[0]) for each in (epoch, after)
            )
            if before_s != after_s and epoch.life == after.life:
                of_client[after.settings.at.step] = before_s, after_s, after.settings.at
    for of_client in filter(None, changes.values()):
        before_s, after_s, at = of_client[min(of_client)]
        when = Message("step {step}", step=at.step)
        if len(of_client) > 1:
            when = Message(
                "step {step} (the first of {changes:,} changes)",
                step=at.step,
                changes=len(of_client),
            )
        message = Message(
            "the timestep changes from {before} s to {after} s at {when}: errors, contacts and "
            "motors behave differently from there on; set it once, before the first step",
            before=fraction(before_s),
            after=fraction(after_s),
            when=when,
        )
        site = e.site(("setTimeStep", "setPhysicsEngineParameter"), at)
        yield e.finding("timestep-changed", message, step=at.step, site=site)


def _stopped_early(e: Evidence) -> Iterator[ScriptFinding]:
    for solver in e.seen.solvers:
        if solver.steps >= OFTEN:
            message = Message(
                "in {steps} of the {looked} steps examined, from step {first} on, the solver of "
                "simulation {client} used all its iterations, {iterations}, and the last one still "
                "changed a velocity by up to {change:.3g} m/s or rad/s (step {worst}): stopped "
                "like that, stacks sink and joints give way",
                steps=solver.steps,
                looked=solver.looked,
                first=solver.first_step,
                client=solver.client,
                iterations=solver.iterations,
                change=solver.last_change,
                worst=solver.worst_step,
            )
            if solver.client in e.unconverged:
                message = Message(
                    "{finding}; try p.setPhysicsEngineParameter(numSolverIterations={more}), which "
                    "does not help where contacts contradict each other",
                    finding=message,
                    more=4 * solver.iterations,
                )
            yield e.finding("solver-stopped-early", message, step=solver.first_step)


def _unseeded(e: Evidence) -> Iterator[ScriptFinding]:
    if e.seen.unseeded:
        first = e.seen.unseeded[0]
        where: str = first
        if len(e.seen.unseeded) > 1:
            where = Message(
                "{place} (the first of {places} places)", place=first, places=len(e.seen.unseeded)
            )
        message = Message(
            "unseeded random numbers are drawn by {where}: another run may differ; record it with "
            "--seed 0, or seed them in the script",
            where=where,
        )
        yield e.finding("unseeded", message, site=first.rpartition(" at ")[2] or None)


def _inertia_alone(e: Evidence) -> Iterator[ScriptFinding]:
    """Yield btRigidBodies that get an inertia without a mass (`processChangeDynamicsInfoCommand`).

    PyBullet then sets the mass to what an earlier command has left in its memory.
    """
    for number, record in e.seen.by_body.items():
        rigid = any(each.reported["kind"][0] == RIGID for each in record.dynamics)
        for given in record.given:
            alone = given.values.keys() & {"mass", "localInertiaDiagonal"} == {
                "localInertiaDiagonal"
            }
            if rigid and alone:
                site = e.site(("changeDynamics",), given.at, given.body, "localInertiaDiagonal")
                message = Message(
                    "{body} is a btRigidBody that gets an inertia without a mass: PyBullet then "
                    "takes as its mass what an earlier command left in memory, another one with us "
                    "than without; give p.changeDynamics its mass as well",
                    body=e.label(number),
                )
                yield e.finding(
                    "inertia-without-mass", message, body=number, step=given.at.step, site=site
                )
                break


def _inertia(e: Evidence) -> Iterator[ScriptFinding]:
    for number in e.judged:
        findings = (
            finding
            for dynamics in e.dynamics_of(number)
            for finding in _of_inertia(e, number, dynamics)
        )
        yield from itertools.islice(findings, 1)


def _of_inertia(e: Evidence, number: int, dynamics: Dynamics) -> Iterator[ScriptFinding]:
    """Yield what is wrong with the inertia that the engine reported of a body's parts."""
    at = order(dynamics.at)
    for link, (mass_kg, moments) in enumerate(
        zip(dynamics.reported["mass_kg"], dynamics.reported["inertia_kg_m2"], strict=True), start=-1
    ):
        if not mass_kg > 0 or not moments.any():
            continue
        low, middle, high = sorted(moments.tolist())
        part, site = e.label(number, link), None
        remedy = Message(
            "correct <inertia> if a file gives it, else give p.changeDynamics another "
            "localInertiaDiagonal"
        )
        if e.given(("localInertiaDiagonal",), number, link, at):
            site = e.site(("changeDynamics",), dynamics.at, dynamics.body, "localInertiaDiagonal")
            remedy = Message("give p.changeDynamics another localInertiaDiagonal")
        if low + middle < high * (1 - 1e-6):
            message = Message(
                "{part} has moments of inertia of {low:.3g}, {middle:.3g} and {high:.3g} kg m², "
                "which no body can have: the two smaller ones must add up to the largest or more; "
                "{remedy}",
                part=part,
                low=low,
                middle=middle,
                high=high,
                remedy=remedy,
            )
            yield e.finding(
                "impossible-inertia", message, body=number, step=dynamics.at.step, site=site
            )
        edges_m = e.extents_m(number, link, at)
        if edges_m is None or edges_m.max() > ENDLESS_M:
            continue
        most = float(mass_kg) * float(edges_m @ edges_m) / 4
        if high > most * (1 + 1e-6) or high < TINY_INERTIA * most:
            effect = Message("a torque turns it far more than its shape suggests")
            if high > most:
                effect = Message("a torque turns it less than any body of its shape")
            message = Message(
                "{part} has a moment of inertia of {high:.3g} kg m²; {mass:.3g} kg within its "
                "shape have {most:.3g} at most: {effect}; {remedy}",
                part=part,
                high=high,
                mass=mass_kg,
                most=most,
                effect=effect,
                remedy=remedy,
            )
            yield e.finding(
                "inertia-far-from-shape", message, body=number, step=dynamics.at.step, site=site
            )
