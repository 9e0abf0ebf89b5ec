"""Rules about bodies without contact: momentum that drifts, energy lost to damping."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.changes import energy_of
from drop_physics.explain.step_status import FLIGHT
from drop_physics.messages import Message
from drop_physics.physics.dynamics import angular_momenta
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.tree import BASE, States, Tree
from drop_physics.physics.vectors import lengths
from drop_physics.rules.by_name import called
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, body_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import (
    DAMPED,
    DRIFTS,
    FREE_STEPS,
    OF_ALL_MOVED,
    ROLLS_M_S,
    STOPS,
)

OUTSIDE = "contacts", "constraints", "rolling", "clamp"


@body_rule("momentum-drift", "model", consecutive=True, subject=1, least_count=FREE_STEPS)
def momentum_drift(bodies: BodyColumns) -> Match | None:
    """Momentum drifts in consecutive steps without any external force except gravity."""
    tree, verdict = bodies.law.tree, bodies.verdict
    if tree.fixed or not bodies.terms:
        return None
    acts = np.any([bodies.terms[name].any(axis=1) for name in OUTSIDE], axis=0)
    acts[bodies.reported.applied.step] = True
    rows = np.flatnonzero((verdict.why < 0) & ~acts)
    if not len(rows):
        return None
    # What calls set, or give another mass, begins anew.
    puts = bodies.puts[rows]
    masses = np.full(len(rows), hash(tree.masses_kg.tobytes() + tree.inertias_kg_m2.tobytes()))
    keys = np.column_stack([bodies.body[rows], puts, masses])
    begins = np.append(True, np.diff(keys, axis=0).any(axis=1) | (np.diff(bodies.step[rows]) != 1))
    integrated = [body.changes.momentum_kg_m_s["integrator"] for body in bodies.batch.bodies]
    after = bodies.after.at(rows)
    momenta = energy_of(bodies.law, after, np.zeros((len(rows), 3)))[1]
    turning, turned = np.zeros((2, len(rows), 3)), np.zeros((2, len(rows)))
    for side, at, states in (
        (0, np.flatnonzero(begins), bodies.before.at(rows)),
        (1, np.flatnonzero(np.append(begins[1:], True)), after),
    ):
        turning[side, at], turned[side, at] = _turning(tree, states.at(at))
    damped = bodies.law.angular_damping != 0 or bodies.law.joint_damping.any()
    speed_m_s = lengths(after.velocity[:, 3:6])
    return Match(
        rows,
        np.zeros(len(rows)),
        sums={"drift": np.concatenate(integrated)[rows]},
        most={
            "momentum": lengths(momenta),
            "moved": tree.masses_kg.sum() * speed_m_s,
            "turned": turned.max(axis=0),
            "damped": damped,
        },
        firsts={"turning": turning[0]},
        lasts={"turning_after": turning[1]},
        keys=keys,
    )


@momentum_drift.counts
def _(runs: Runs) -> Float64:
    linear, angular = called(_shares, runs)
    return np.where(linear > 0, linear, angular)


@momentum_drift.notes
def _(drift: list[float], turning: list[float], turning_after: list[float], noted: Runs) -> Noted:
    linear, angular = (float(each[0]) for each in called(_shares, noted))
    before, after = np.array(turning), np.array(turning_after)
    return {
        "straight": linear > 0,
        "drift": float(np.linalg.norm(drift)),
        "turned": float(np.linalg.norm(after - before)),
        "before": float(np.linalg.norm(before)),
        "after": float(np.linalg.norm(after)),
        "part": linear if linear > 0 else max(linear, angular),
    }


momentum_drift.rows(
    SayingRow(
        when=lambda straight: straight,
        says=Message(
            "{body} gains {drift:.3g} kg m/s in {count:,} steps in which nothing outside acts on "
            "it: that is the error of the explicit step"
        ),
        effect="drift",
        unit="kg m/s",
    ),
    SayingRow(
        says=Message(
            "the angular momentum of {body} goes from {before:.4g} to {after:.4g} kg m²/s in "
            "{count:,} steps in which nothing outside acts on it: that is the error of the "
            "explicit step"
        ),
        effect="turned",
        unit="kg m²/s",
    ),
    like=SayingRow(
        advice=Message("a shorter timestep makes it less: {call}"),
        cure=Remedy("timestep", value=4.0),
        share="part",
    ),
)


def _shares(
    drift: Float64,
    momentum: Float64,
    moved: Float64,
    turning: Float64,
    turning_after: Float64,
    turned: Float64,
    damped: Flags,
) -> tuple[Float64, Float64]:
    """Return the drift of linear and angular momentum relative to the momentum; 0 if none."""
    turns = np.stack([turning, turning_after])
    found = []
    for change, greatest, parts, sure in (
        (drift, momentum, moved, True),
        (turns[1] - turns[0], np.linalg.norm(turns, axis=2).max(axis=0), turned, ~damped),
    ):
        size = lengths(change)
        # Where parts cancel, what is left is small against them.
        whole = np.maximum(greatest, OF_ALL_MOVED * parts)
        found.append(np.where(sure & (size > DRIFTS * whole) & (whole > 0), size / whole, 0.0))
    return found[0], found[1]


def _turning(tree: Tree, states: States) -> tuple[Float64, Float64]:
    """Return the angular momentum about the centre of mass, and the sum of the links' magnitudes.

    The shapes are (n, 3) and (n,).
    """
    kin, masses = kinematics(tree, states), tree.masses_kg[:, None, None]
    moved = motion(kin, states.velocity)
    places, speeds = (
        np.array([each[link + 1].T for link in range(BASE, tree.links)])
        for each in (kin.centres, moved.velocities)
    )
    arms, own = (each - (masses * each).sum(axis=0) / masses.sum() for each in (places, speeds))
    links = masses * np.cross(arms, own)
    for link, turning in angular_momenta(kin, moved).items():
        links[link + 1] += turning.T
    return links.sum(axis=0), np.linalg.norm(links, axis=2).sum(axis=0)


# -- default-damping ------------------------------------------------------------------------------


def energy_taken(bodies: BodyColumns, term: str, where: Flags) -> Match | None:
    """Match steps in which a term takes energy, with the energy taken since calls set the state."""
    its = [body.changes.energy_j.get(term) for body in bodies.batch.bodies]
    if any(each is None for each in its):
        return None
    rows = np.flatnonzero(where)
    taken_j = -np.concatenate([each for each in its if each is not None])[rows]
    none = np.zeros((len(rows), 3))
    states = bodies.before.at(rows), bodies.after.at(rows)
    energy_j = np.max([energy_of(bodies.law, state, none)[0] for state in states], axis=0)
    lives = bodies.of_each(lambda each: each.config.life)
    keys = np.column_stack([bodies.body, lives, bodies.puts])[rows]
    masses_kg = bodies.of_each(lambda each: each.law.tree.masses_kg.sum())[rows]
    return Match(
        rows,
        energy_j,
        {"mass": masses_kg},
        sums={"taken": taken_j},
        keys=keys,
    )


@body_rule("default-damping", "note", subject=1, proposes=True)
def default_damping(bodies: BodyColumns) -> Match | None:
    """Damping that no call set takes a noticeable share of the energy of a body without contact."""
    if bodies.whole.config.damping != (None, None):
        return None
    # In the air is also a robot whose motors hold its joints, and what hangs on a constraint.
    near = np.full(len(bodies.step), bodies.law.tree.fixed)
    near[bodies.reported.contacts.step] = True
    return energy_taken(bodies, "damping", (bodies.segment == FLIGHT) | ~near)


@body_rule("rolling-friction", "note", subject=1)
def rolling_friction(bodies: BodyColumns) -> Match | None:
    """Rolling friction takes a noticeable share of a rolling body's energy."""
    if bodies.law.tree.size != 6:  # a robot has motors to make up for it
        return None
    return energy_taken(bodies, "rolling", bodies.verdict.why < 0)


@default_damping.counts
def losses(taken: Float64, size: Float64) -> Float64:
    """Return the energy that a term took of a body; 0 for a small share of it [J]."""
    return np.where(taken > DAMPED * size, taken, 0.0)


@rolling_friction.counts
def _(size: Float64, mass: Float64, taken: Float64) -> Float64:
    rolls = size > mass * ROLLS_M_S**2 / 2
    return np.where(rolls & (taken > STOPS * size), taken, 0.0)


@default_damping.notes
@rolling_friction.notes
def lost_share(taken: float, size: float) -> Noted:
    """Return the share of a body's energy that a term took."""
    return {"part": min(taken / size, 1.0)}


LOST = SayingRow(effect="taken", unit="J", share="part")
default_damping.rows(
    SayingRow(
        says=Message(
            "{body} loses {taken:.3g} J while nothing touches it, of at most {size:.3g} J of "
            "kinetic energy: PyBullet damps every body, by 0.04 unless a call sets it"
        ),
        cure=Remedy("damping", "body", 0.0),
    ),
    like=LOST,
)
rolling_friction.rows(
    SayingRow(
        says=Message(
            "{body} loses {taken:.3g} J to rolling friction, of at most {size:.3g} J of kinetic "
            "energy: rollingFriction or spinningFriction is set for it, or for what it rolls on"
        ),
        advice=Message("p.changeDynamics(body, -1, rollingFriction=0, spinningFriction=0) of both"),
    ),
    like=LOST,
)
