"""The rule `overwritten`: what is set before every step undoes what acts, or is undone itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE
from drop_physics.physics.vectors import lengths
from drop_physics.rules.answer import Span, so_many
from drop_physics.rules.arguments import site_of
from drop_physics.rules.engines import ANY, MUJOCO, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Case, Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule, input_rule, side_rule
from drop_physics.rules.tables import BodyColumns, PairColumns
from drop_physics.rules.thresholds import (
    COASTS_STEPS,
    DEEP_M,
    FALLS_STEPS,
    GATHERS,
    HALF_THE_STEPS,
    NO_FORCE,
    OVERLAPS_STEPS,
    SAME_GAP,
    SINKS_STEPS,
    TELEPORTED_M_S,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen


@side_rule(
    "overwritten",
    "asked",
    reason="pose-set-each-step",
    least_count=OVERLAPS_STEPS,
    subject=1,
    engines=ANY,
    proof="call",
)
def pose_set_each_step(pair: PairColumns, placing: Placing) -> Match:
    """A pose set in every step exerts no force: the body passes through obstacles."""
    posed, depth_m = placing.moved(pair.body, pair.step), pair.pairs.depth_m
    rows = np.flatnonzero(posed)
    for steps, its, at in pair.of_bodies(rows):  # of what can move, also by a velocity
        last = (at - 1).clip(0)
        follows = steps.steps[at] - steps.steps[last] == 1
        before, after = steps.before.at(at), steps.after.at(last)
        other = [
            (getattr(before, name) != getattr(after, name)).any(axis=1)
            for name in ("position_m", "orientation", "joints")
        ]
        posed[rows[its]] = follows & np.any(other, axis=0)
    deep = posed & (pair.pairs.normal_n > 0) & (depth_m > DEEP_M)
    return Match(
        posed,
        np.where(deep, depth_m, 0.0),
        {"on": pair.other, "link": pair.links[:, pair.side]},
        sums={"posed": posed * 1},
        counts=deep.astype(np.int64),
    )


@pose_set_each_step.counts
def _(posed: Float64, last: Int64, first: Int64, size: Float64) -> Float64:
    return np.where(posed >= HALF_THE_STEPS * (last - first + 1), size, 0.0)


@pose_set_each_step.notes
def _(inputs: Inputs, seen: Seen, subject: Body, engine: str, on: int, link: int) -> Noted | None:
    other = seen.bodies[on].label
    if engine == MUJOCO:  # one that cannot move is a mocap body
        return {"other": other} if subject.moving else None
    fast = set[int]()
    for use in inputs.of(Act.SET_VELOCITY):
        if use.body is subject and any(map(np.any, (*use.low.values(), *use.high.values()))):
            fast |= use.steps
    for use in inputs.of(Act.SET_JOINT, Act.SET_POSE):
        number = int(use.first.values.get("jointIndex", (BASE,))[0])
        if use.body is not subject or number not in (BASE, *_branch(subject, link)):
            continue
        made = seen.steps_of(subject.client) - use.first.at.step
        # What stays in its place goes through nothing, nor what has the velocity of its way.
        stays = use.constant("posObj") and use.constant("ornObj")
        if len(use.steps) < HALF_THE_STEPS * max(made, 1) or stays or fast & use.steps:
            continue
        by_joint = use.first.act is Act.SET_JOINT and number >= 0
        joint = subject.joints[number].name if by_joint else None
        return {
            "other": other,
            "joint": joint,
            "what": joint or subject.label,
            "function": use.first.function,
            "times": len(use.steps),
            "called": site_of(use.first),
        }
    return None


BY_CALL = SayingRow(
    says=Message(
        "{what} is set by p.{function} in {times:,} steps, and gets {size:mm} into what it meets: "
        "a pose that is set has no force"
    ),
    site="called",
)
POSED = SayingRow(cure=Remedy("support-velocity", bodies=("body",)), proposed=True).like(BY_CALL)
pose_set_each_step.rows(
    SayingRow(
        engines=MUJOCOS,
        says=Message(
            "{body} is set by qpos in {posed:,.0f} steps in which it touches {other}, and gets "
            "{size:mm} into it: a pose that is set has no force"
        ),
        advice=Message("move it by an actuator, or by a mocap body that it is welded to"),
        site=Act.SET_STATE,
    ),
    SayingRow(when=lambda joint: joint, cure=Remedy("without", "what", form="driven")).like(
        BY_CALL
    ),
    # What it presses onto something else stays in the way of any velocity, too.
    SayingRow(
        when=lambda subject: subject.base_moves,
        advice=Message("move it by a force, a velocity, or a constraint"),
    ).like(POSED),
    # A body without mass moves only where calls put it, and pushes others by its overlap.
    SayingRow(
        advice=Message("{call}, or give it a mass and move it by a constraint"), level="note"
    ).like(POSED),
    like=SayingRow(effect="size", normal=DEEP_M),
)


def _branch(body: Body, link: int) -> tuple[int, ...]:
    """Return the links from a given link down to the base."""
    return () if link < 0 else (link, *_branch(body, body.joints[link].parent))


@body_rule(
    "overwritten",
    "model",
    reason="pose-set-each-step",
    least_count=SINKS_STEPS,
    engines=MUJOCOS,
)
def rate_gathers(bodies: BodyColumns, placing: Placing) -> Match | None:
    """A pose is set in every step but its velocity is not, so that the velocity grows."""
    if bodies.law.tree.fixed:
        return None
    came, at = bodies.came(lambda states: states.position_m), bodies.before.position_m
    moved = placing.moved(bodies.body, bodies.step)
    speed = lengths(bodies.before.velocity[:, 3:6])
    way = lengths(np.diff(at, axis=0, append=at[-1:])) / bodies.reported.timestep_s
    # Where it is set back in each step, its velocity is of no way that it goes.
    where = moved & (at != came).any(axis=1) & (speed > TELEPORTED_M_S + GATHERS * way)
    return Match(where, speed, {"way": way})


rate_gathers.rows(
    SayingRow(
        says=Message(
            "{body} has {size:.3g} m/s at step {last:,} and goes {way:.3g} m/s: qpos is set in "
            "{steps} and qvel is not, which gathers what acts on it"
        ),
        advice=Message("write data.qvel with data.qpos"),
        effect="size",
        unit="m/s",
        site=Act.SET_STATE,
    )
)


@body_rule(
    "overwritten",
    "asked",
    reason="velocity-set-each-step",
    least_count=SINKS_STEPS,
    engines=ANY,
)
def falls_no_faster(bodies: BodyColumns, placing: Placing) -> Match | None:
    """A velocity written before each step removes the speed that gravity gave in the last one."""
    if bodies.law.tree.fixed:
        return None
    timestep_s, now = bodies.reported.timestep_s, bodies.before.velocity[:, 3:6]
    given = bodies.reported.gravity_m_s2 * timestep_s[:, None]
    taken = bodies.came(lambda states: states.velocity)[:, 3:6] - now
    moved = placing.moved(bodies.body, bodies.step)
    # A pose that is set stops the body, too.
    moved &= (bodies.came(lambda states: states.position_m) == bodies.before.position_m).all(axis=1)
    where = moved & (lengths(taken - given) <= NO_FORCE * lengths(given)) & given.any(axis=1)
    return Match(where, lengths(given), {"vz": now[:, 2], "timestep": timestep_s})


@falls_no_faster.notes
def _(
    inputs: Inputs,
    last_samples: Mapping[int, int],
    subject: Body,
    size: float,
    count: int,
    timestep: float,
) -> Noted:
    uses = (use for use in inputs.of(Act.SET_VELOCITY) if use.body is subject)
    call = next((use.first for use in uses), None)
    return {
        "taken": size * count,
        "way": size * timestep * 1e3,
        "called": None if call is None else site_of(call),
        "part": count / last_samples[subject.number],
    }


falls_no_faster.rows(
    SayingRow(
        engines=MUJOCOS,
        says=Message(
            "{body} falls no faster: qvel is written before {steps}, and takes away each time what "
            "gravity gave"
        ),
        advice=Message("write only the elements of data.qvel that are meant"),
        level="model",
        proposed=True,
        effect="taken",
        unit="m/s",
    ),
    SayingRow(
        says=Message(
            "{body} falls {way:.2g} mm a step and no faster: p.resetBaseVelocity before each step "
            "sets its vertical velocity to {vz:g} m/s again"
        ),
        cure=Remedy("without", "body", form="vertical"),
        share="part",
        site="called",
    ),
)


@input_rule("overwritten", "asked", "command-overwritten")
def command_overwritten(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A joint has one motor: if it gets a position and a velocity command in a step, one counts."""
    for (number, joint, _), (first, last, steps) in inputs.overridden.items():
        body, made = seen.bodies[number], inputs.motions[number].samples
        if len(steps) >= COASTS_STEPS and joint < len(body.joints):
            yield Case(
                subject=body,
                site=site_of(last),
                span=Span(min(steps) + 1, max(steps) + 1, len(steps)),
                values={
                    "joint": body.joints[joint].name,
                    "alone": first is last,
                    "first": site_of(first),
                    "last": site_of(last),
                    "steps": so_many(len(steps)),
                    "part": len(steps) / max(made, 1),
                },
            )


command_overwritten.rows(
    SayingRow(
        when=lambda alone: alone,
        says=Message(
            "{joint} is commanded more than once before a step, by {last} with different "
            "targets, in {steps}: it has one motor, and only the last command counts"
        ),
        advice=Message("give each joint one target before a step"),
    ),
    SayingRow(
        says=Message(
            "{joint} is commanded twice before a step, by {first} and then by {last}, in "
            "{steps}: it has one motor, and only the last command counts"
        ),
        advice=Message(
            "give one command: p.POSITION_CONTROL takes targetVelocity=… and maxVelocity=…, too"
        ),
    ),
    like=SayingRow(share="part"),
)


@input_rule("overwritten", "asked", "drive-lags")
def drive_lags(inputs: Inputs) -> Iterator[Case]:
    """A constraint closes only a share of its gap in a step, so a moving target stays ahead."""
    for drive in inputs.drives.values():
        if len(drive.targets_m) < FALLS_STEPS * 2:
            continue
        places_m = np.array(drive.places_m)
        ahead_m = np.array(drive.targets_m) - places_m
        mean_m = ahead_m.mean(axis=0)
        gap_m = float(np.linalg.norm(mean_m))
        made_m = float(lengths(np.diff(places_m, axis=0))[1:].mean())
        steady = np.abs(ahead_m - mean_m).max() <= SAME_GAP * gap_m
        if steady and 0 < made_m < (1 - SAME_GAP) * gap_m:
            share = made_m / gap_m
            yield Case(
                call=drive.call,
                subject=drive.body,
                values={
                    "made": made_m * 1e3,
                    "gap": gap_m * 1e3,
                    "share": share,
                    "part": 1 - share,
                },
            )


drive_lags.rows(
    SayingRow(
        says=Message(
            "{body} goes {made:.2g} mm a step where p.changeConstraint asks for {gap:.2g} mm: the "
            "target is set from where {body} is, and a step makes {share:.2g} of the way there"
        ),
        advice=Message("set each target from the last target, not from the body"),
        share="part",
    )
)
