"""`overwritten`: what a call undoes, step after step, or what undoes a call."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Span
from drop_physics.rules.input_rule import InputSubject, input_rule
from drop_physics.rules.inputs import Inputs, Use
from drop_physics.rules.rule import Said
from drop_physics.rules.thresholds import (
    DEEP_M,
    EACH_STEP,
    FALLS_STEPS,
    HALF_THE_STEPS,
    OVERLAPS_STEPS,
    SAME_GAP,
)
from drop_physics.trace.acts import Act


@input_rule("overwritten", "asked", "velocity-set-each-step")
def velocity_set_each_step(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A velocity that is set before each step takes away what gravity gave in the last one."""
    for use in inputs.of(Act.SET_VELOCITY):
        body, z = use.body, use.low.get("linearVelocity", np.zeros(0))
        if body is None or len(z) != 3:
            continue
        motion, steps = inputs.motions[body.number], len(use.steps)
        same = use.low["linearVelocity"][2] == use.high["linearVelocity"][2]
        falls = sorted(step for step in motion.in_flight if step - 1 in use.steps)
        dt, g = _falls(inputs, body.client)
        if not same or steps < EACH_STEP * motion.samples or len(falls) < FALLS_STEPS or not g:
            continue
        message = Message(
            "{body} falls {way:.2g} mm a step and no faster: p.resetBaseVelocity before each step "
            "sets its vertical velocity to {vz:g} m/s again",
            body=body.label,
            way=abs(g) * dt * dt * 1e3,
            vz=float(z[2]),
        )
        advice = Message("hand on its vertical velocity: p.getBaseVelocity(body)[0][2]")
        subject = InputSubject(use.first, body, steps=Span(falls[0], falls[-1], len(falls)))
        cure = Cure("without", body.label, form="vertical")
        share = len(falls) / motion.samples
        yield subject, Said(message=message, advice=advice, cure=cure, share=share)


def _falls(inputs: Inputs, client: int) -> tuple[float, float]:
    """Return timestep [s] and vertical gravity [m/s²] of a simulation at last."""
    settings = [each for each in inputs.scene.seen.settings if each.client == client][-1].values
    return tuple(
        float(np.ravel(settings[name])[0]) for name in ("fixedTimeStep", "gravityAccelerationZ")
    )  # type: ignore[return-value]


@input_rule("overwritten", "asked", "pose-set-each-step")
def pose_set_each_step(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A pose that is set step after step has no force: it goes through what it meets."""
    for use in inputs.of(Act.SET_JOINT, Act.SET_POSE):
        body = use.body
        if body is None or len(use.steps) < HALF_THE_STEPS * _steps(inputs, use):
            continue
        depths = inputs.deepest[body.number]
        deep = {step: d for step, d in depths.items() if step - 1 in use.steps and d > DEEP_M}
        if len(deep) < OVERLAPS_STEPS:
            continue
        most = max(deep.values())
        joint = None
        if use.first.act is Act.SET_JOINT:
            number = int(use.first.values.get("jointIndex", (0,))[0])
            joint = body.joints[number].name if number < len(body.joints) else None
        message = Message(
            "{what} is set by p.{function} in {count:,} steps, and gets {deep:.3g} mm into what it "
            "meets: a pose that is set has no force",
            what=joint or body.label,
            function=use.first.function,
            count=len(use.steps),
            deep=most * 1e3,
        )
        advice = Message("drive it there: p.setJointMotorControl2(…, p.POSITION_CONTROL, …)")
        if joint is None:
            advice = Message("move it by a force, a velocity, or a constraint")
        subject = InputSubject(use.first, body, joint, Span(min(deep), max(deep), len(deep)))
        yield (
            subject,
            Said(
                message=message,
                advice=advice,
                cure=Cure("without", joint or body.label, form="driven") if joint else None,
                effect=Effect(most, "m"),
                share=most / DEEP_M,
            ),
        )


def _steps(inputs: Inputs, use: Use) -> int:
    """Return how many steps the simulation of a use made from its first call on."""
    made = inputs.scene.seen.samples.get(use.first.client, 1) - 1
    return max(made - use.first.at.step, 1)


@input_rule("overwritten", "asked", "drive-lags")
def drive_lags(inputs: Inputs) -> Iterator[tuple[InputSubject, Said]]:
    """A constraint closes a share of the gap in a step; a target set from the body stays ahead."""
    for drive in inputs.drives.values():
        if len(drive.targets_m) < FALLS_STEPS * 2:
            continue
        places_m = np.array(drive.places_m)
        ahead_m = np.array(drive.targets_m) - places_m
        mean_m = ahead_m.mean(axis=0)
        gap_m = float(np.linalg.norm(mean_m))
        made_m = float(np.linalg.norm(np.diff(places_m, axis=0), axis=1)[1:].mean())
        spread_m = float(np.abs(ahead_m - mean_m).max())
        if spread_m > SAME_GAP * gap_m or not 0 < made_m < (1 - SAME_GAP) * gap_m:
            continue
        message = Message(
            "{body} goes {made:.2g} mm a step where p.changeConstraint asks for {gap:.2g} mm: the "
            "target is set from where {body} is, and a step makes {share:.2g} of the way there",
            body=drive.body.label,
            made=made_m * 1e3,
            gap=gap_m * 1e3,
            share=made_m / gap_m,
        )
        advice = Message("set each target from the last target, not from the body")
        yield (
            InputSubject(drive.call, drive.body),
            Said(message=message, advice=advice, share=1 - made_m / gap_m),
        )
