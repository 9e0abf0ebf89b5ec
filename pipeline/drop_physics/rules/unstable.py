"""Rules about velocities that alternate in sign, or are clamped: `unstable`, `velocity-clamped`."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.cause_names import cause_in_words
from drop_physics.explain.targets import flips
from drop_physics.messages import Message
from drop_physics.rules.answer import and_more
from drop_physics.rules.by_name import called
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.joint import link_of, units
from drop_physics.rules.rows import Noted, Remedy, SayingRow, Worst
from drop_physics.rules.rule import Match, body_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import (
    RINGS_LEAST,
    RINGS_SHARE,
    RINGS_STEPS,
    SWITCHES,
    TURNS_MOST,
    TURNS_TOO,
)
from drop_physics.trace.events import Body
from drop_physics.trace.motors import POSITION

DRIVEN = 0.5
"""Share of what the clamp takes above which the script's own force counts as what drives a rate
there."""
FULL = 1 - 1e-9
"""Share of the clamp's limit above which a rate counts as clamped."""
AXES = (
    "spin about x",
    "spin about y",
    "spin about z",
    "velocity along x",
    "velocity along y",
    "velocity along z",
)
EXPLICIT = "joint damping", "applied", "damping"
"""Explicit terms that depend on rates. Terms of the solver are left out because they only react to
others, as for a trembling body at rest; reversals by a motor's own gains are reported as
`motor-gain`."""


def _own(bodies: BodyColumns) -> Flags:
    """Flag the steps without motors of excessive gain, which the rule `motor-gain` reports."""
    own = np.ones(len(bodies.step), np.bool_)
    for driven in bodies.driven:
        own[driven.steps.rows] &= ~(flips(driven) & (driven.asked.impulse > 0)).any(axis=1)
    return np.asarray(own[:, None])


def _named(subject: Body, keys: list[int], first_rate: int) -> Noted:
    """Return the joint of a degree of freedom, its name for a reader, and its velocity's unit."""
    k = keys[1] - first_rate
    if k < 0:
        return {"joint": None, "name": AXES[k], "unit": "rad/s" if k < -3 else "m/s"}
    joint = subject.joints[link_of(subject, k)]
    return {"joint": joint.name, "name": joint.name, "unit": f"{units(joint)[0]}/s"}


@body_rule("unstable", "broken", consecutive=True, least_count=RINGS_STEPS, subject=1)
def unstable(bodies: BodyColumns) -> Match | None:
    """A velocity changes its sign in every step, because a term is too stiff for the timestep."""
    if not bodies.terms:
        return None
    before, after = bodies.before.velocity, bodies.after.velocity
    size = np.minimum(np.abs(before), np.abs(after))
    greatest = bodies.greatest(np.abs(after))
    turns = (before * after < 0) & (size > np.maximum(RINGS_SHARE * greatest, RINGS_LEAST))
    turns &= _own(bodies) & ~bodies.put[:, None]
    if not turns.any():
        return None
    against = {name: -np.sign(before) * term for name, term in bodies.terms.items()}
    del against["clamp"]  # it ends what others feed
    none, applied = np.zeros(size.shape), bodies.terms["applied"]
    sums = {name: against.get(name, none) for name in (*EXPLICIT, "motors")}
    sums["every"] = sum((each.clip(0) for each in against.values()), none)
    return Match(
        turns,
        size,
        {"first_rate": bodies.law.tree.first_rate},
        sums=sums,
        most={
            "high": applied,
            "low": -applied,
            "least": -np.abs(applied),
            "greatest": greatest,
            "fastest": np.maximum(np.abs(before), np.abs(after)),
        },
    )


@unstable.counts
def _(
    runs: Runs,
    high: Float64,
    low: Float64,
    least: Float64,
    every: Float64,
    motors: Float64,
    size: Float64,
) -> Float64:
    most = np.maximum(high, low)
    # Forces that only change their sign, whatever the rate, are a switch: no gain is too large.
    switch = (most + least <= SWITCHES * most) & (high + low > most)
    turned = np.max([runs[name] for name in EXPLICIT], axis=0)
    # Where a motor turns it around too, its gains may be the cause: less damping leaves them more.
    said = (turned > TURNS_MOST * every) & (motors <= TURNS_TOO * turned)
    return np.where(said & ~switch, size, 0.0)


@unstable.notes
def _(worst: Worst, among: int, size: float, greatest: float) -> Noted:
    by = max(EXPLICIT, key=lambda each: float(worst[each]))
    more = {"more": and_more(among), "part": size / greatest}
    return {**called(_named, worst), **more, "by": by, "term": cause_in_words(by)}


unstable.rows(
    SayingRow(
        when=lambda by: by == "joint damping",
        advice=Message(
            "the joint's damping acts explicitly, on a small inertia: use a smaller timestep, or "
            "{call}"
        ),
        cure=Remedy("joint-damping", "body", 0.0),
    ),
    SayingRow(
        when=lambda by: by == "applied",
        advice=Message(
            "the script's own forces are too stiff for this timestep: lower its gains, most of all "
            "that of the velocity, or use a smaller timestep"
        ),
    ),
    SayingRow(
        advice=Message("damping acts explicitly: use a smaller timestep, or {call}"),
        cure=Remedy("damping", "body", 0.0),
    ),
    like=SayingRow(
        says=Message(
            "{name}{more} changes its sign with every step, at up to {fastest:.3g} {unit}, in "
            "{count:,} steps: the term {term} turns it around"
        ),
        effect="fastest",
        share="part",
    ),
)


@body_rule("velocity-clamped", "asked", subject=1, proposes=True)
def velocity_clamped(bodies: BodyColumns) -> Match | None:
    """A velocity reaches the limit at which PyBullet clamps it."""
    if not bodies.terms:
        return None
    taken, limit = np.abs(bodies.terms["clamp"]), bodies.law.velocity_limit
    # What rounding leaves is none, and what one rate's clamp takes of others is not theirs.
    fastest = np.maximum(np.abs(bodies.before.velocity), np.abs(bodies.after.velocity))
    held = (fastest >= FULL * limit) & (taken > 1e-9 * bodies.whole.largest[:, None])
    held &= _own(bodies) & (bodies.verdict.why < 0)[:, None]
    placed, first = np.zeros(taken.shape, np.bool_), bodies.law.tree.first_rate
    pushed = np.abs(bodies.terms["applied"])
    for driven in bodies.driven:
        its = (driven.asked.mode == POSITION) & (driven.asked.impulse > 0)
        placed[driven.steps.rows, first:] = its
    numbers = {"limit": limit, "first_rate": first, "placed": placed}
    return Match(held, taken, numbers, sums={"taken": taken, "pushed": pushed})


@velocity_clamped.counts
def _(count: Int64) -> Float64:
    return np.asarray(count, np.float64)


@velocity_clamped.notes
def _(worst: Worst, inputs: Inputs, subject: Body, count: int) -> Noted:
    named = called(_named, worst)
    return {
        **named,
        "of": "N m s" if named["unit"] == "rad/s" else "N s",
        "level": None if count >= RINGS_STEPS else "note",
        "part": count / inputs.motions[subject.number].samples,
    }


velocity_clamped.rows(
    SayingRow(
        when=lambda placed: placed,  # the faster it may be, the harder its motor drives it
        advice=Message(
            "let its motor drive it slower: p.setJointMotorControl2(…, force=…, maxVelocity=…)"
        ),
    ),
    # The script's own force, not the limit, is what drives it there.
    SayingRow(
        when=lambda pushed, taken: pushed > DRIVEN * taken,
        says=Message(
            "{name} reaches {limit:g} {unit}, where PyBullet clamps every rate: in {steps} it "
            "takes {taken:.3g} {of} away, and the force that the script gives adds "
            "{pushed:.3g} {of}"
        ),
        advice=Message("give less force, or force against the velocity"),
    ),
    SayingRow(cure=Remedy("limits", "body", given={"maxJointVelocity": 1e5})),
    like=SayingRow(
        says=Message(
            "{name} reaches {limit:g} {unit}, where PyBullet clamps every rate: in {steps} it "
            "takes {taken:.3g} {of} away"
        ),
        effect="taken",
        unit="{of}",
        share="part",
    ),
)
