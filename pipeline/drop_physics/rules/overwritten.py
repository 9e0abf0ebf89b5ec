"""The rule `overwritten`: a pose or a velocity written before every step exerts no force."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.rules.arguments import site_of
from drop_physics.rules.engines import ANY, MUJOCO, MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.placing import Placing
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule, pair_rule
from drop_physics.rules.tables import BodyColumns, PairColumns
from drop_physics.rules.thresholds import (
    DEEP_M,
    GATHERS,
    HALF_THE_STEPS,
    NO_FORCE,
    OVERLAPS_STEPS,
    SINKS_STEPS,
    TELEPORTED_M_S,
)
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body


@pair_rule("overwritten", "asked", reason="pose-set-each-step", engines=MUJOCOS)
def pose_set_in_contact(pair: PairColumns, placing: Placing) -> Match:
    """A pose set in every step exerts no force: the body passes through obstacles."""
    posed = _posed(pair, placing)
    deep = posed & (pair.pairs.normal_n > 0) & (pair.pairs.depth_m > DEEP_M)
    return Match(posed, np.where(deep, pair.pairs.depth_m, 0.0), sums={"deep": deep * 1})


def _posed(pair: PairColumns, placing: Placing) -> Flags:
    """Flag the rows in which a call set a body's pose, not only its velocity."""
    rows = np.flatnonzero(placing.moved(pair.body, pair.step))
    posed = np.zeros(len(pair.step), np.bool_)
    for steps, its, at in pair.of_bodies(rows):
        last = (at - 1).clip(0)
        follows = steps.steps[at] - steps.steps[last] == 1
        before, after = steps.before.at(at), steps.after.at(last)
        other = [
            (getattr(before, name) != getattr(after, name)).any(axis=1)
            for name in ("position_m", "orientation", "joints")
        ]
        posed[rows[its]] = follows & np.any(other, axis=0)
    return posed


@pose_set_in_contact.counts
def _(count: Int64, last: Int64, first: Int64, deep: Float64, size: Float64) -> Float64:
    often = count >= HALF_THE_STEPS * (last - first + 1)
    return np.where(often & (deep >= OVERLAPS_STEPS), size, 0.0)


pose_set_in_contact.rows(
    SayingRow(
        says=Message(
            "{body} is set by qpos in {steps} in which it touches {other}, and gets {size:mm} "
            "into it: a pose that is set has no force"
        ),
        advice=Message("move it by an actuator, or by a mocap body that it is welded to"),
        effect="size",
        normal=DEEP_M,
        site=Act.SET_STATE,
    )
)


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
        when=lambda engine: engine == MUJOCO,
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
