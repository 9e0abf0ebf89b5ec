"""Momentum that changes with nothing outside that acts: the step's own error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.changes import energy_of
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.dynamics import angular_momenta
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.tree import BASE, States, Tree
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.rule import Match, Said, Worst, body_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import DRIFTS, FREE_STEPS, OF_ALL_MOVED

Float64 = NDArray[np.float64]

OUTSIDE = "contacts", "constraints", "rolling", "clamp"


@body_rule("momentum-drift", "model", consecutive=True, subject=1, least_count=FREE_STEPS)
def momentum_drift(bodies: BodyColumns) -> Match | None:
    """Momentum drifts in steps in a row in which nothing outside acts, gravity apart."""
    tree, verdict = bodies.law.tree, bodies.verdict
    if tree.fixed or not bodies.terms:
        return None
    acts = np.any([bodies.terms[name].any(axis=1) for name in OUTSIDE], axis=0)
    acts[bodies.reported.applied.step] = True
    rows = np.flatnonzero((verdict.why < 0) & ~acts)
    if not len(rows):
        return None
    # What calls set, or give another mass, begins anew.
    puts = np.concatenate([_puts(bodies.scene, each) for each in bodies.batch.bodies])[rows]
    masses = np.full(len(rows), hash(tree.masses_kg.tobytes() + tree.inertias_kg_m2.tobytes()))
    keys = np.column_stack([bodies.body[rows], puts, masses])
    begins = np.append(True, np.diff(keys, axis=0).any(axis=1) | (np.diff(bodies.step[rows]) != 1))
    first, run = np.flatnonzero(begins), np.cumsum(begins) - 1
    last = np.append(first[1:], len(rows)) - 1
    changes = [each.changes.momentum_kg_m_s for each in bodies.batch.bodies]
    integrated = np.concatenate([each["integrator"] for each in changes])[rows]
    changed = np.concatenate([np.sum([*each.values()], axis=0) for each in changes])[rows]
    began = bodies.before.at(rows[first])
    momenta = energy_of(bodies.law, began, np.zeros((len(first), 3)))[1]
    summed = np.cumsum(changed, axis=0)
    momenta = (momenta - (summed - changed)[first])[run] + summed
    after = bodies.after.at(rows)
    rates = np.linalg.norm(after.velocity, axis=1)
    fastest = np.lexsort((-rates, run))[first]
    turning, turned = np.zeros((2, len(rows), 3)), np.zeros(len(rows))
    for side, at, states in (
        (0, first, began),
        (1, fastest, after.at(fastest)),
        (1, last, after.at(last)),
    ):
        turning[side, at], parts = _turning(bodies.law.tree, states)
        turned[at] = np.maximum(turned[at], parts)
    damped = bodies.law.angular_damping != 0 or bodies.law.joint_damping.any()
    speed_m_s = np.linalg.norm(after.velocity[:, 3:6], axis=1)
    return Match(
        rows,
        np.zeros(len(rows)),
        sums={"drift": integrated},
        most={
            "momentum": np.linalg.norm(momenta, axis=1),
            "moved": tree.masses_kg.sum() * speed_m_s,
            "turned": turned,
            "damped": damped,
        },
        firsts={"turning": turning[0]},
        lasts={"turning_after": turning[1]},
        keys=keys,
    )


@momentum_drift.counts
def _(runs: Runs, _: Scene) -> Float64:
    linear, angular = _shares(runs)
    return np.where(linear > 0, linear, angular)


@momentum_drift.says
def _(worst: Worst) -> Said:
    linear, angular = _shares(worst.noted)
    effect = Effect(float(np.linalg.norm(worst.drift)), "kg m/s")
    message = Message(
        "{body} gains {drift:.3g} kg m/s in {count:,} steps in which nothing outside acts on "
        "it: that is the error of the explicit step"
    )
    before, after = np.array(worst.turning), np.array(worst.turning_after)
    if not linear[0] > 0:
        effect = Effect(float(np.linalg.norm(after - before)), "kg m²/s")
        message = Message(
            "the angular momentum of {body} goes from {before:.4g} to {after:.4g} kg m²/s in "
            "{count:,} steps in which nothing outside acts on it: that is the error of the "
            "explicit step"
        )
    sizes = {"before": np.linalg.norm(before), "after": np.linalg.norm(after)}
    return Said(
        message=message,
        values={"drift": effect.value, **{name: float(each) for name, each in sizes.items()}},
        advice=Message("a shorter timestep makes it less: p.setTimeStep(…)"),
        cure=Cure("timestep", value=4.0),
        effect=effect,
        share=float(max(linear[0], 0.0 if linear[0] > 0 else angular[0])),
    )


def _shares(runs: Runs) -> tuple[Float64, Float64]:
    """Return how far linear and angular momentum drift, over what there was; 0 if not so far."""
    turns = np.stack([runs.turning, runs.turning_after])
    found = []
    for drift, greatest, parts, sure in (
        (runs.drift, runs.momentum, runs.moved, True),
        (turns[1] - turns[0], np.linalg.norm(turns, axis=2).max(axis=0), runs.turned, ~runs.damped),
    ):
        size = np.linalg.norm(drift, axis=1)
        # Where parts cancel, what is left is small against them.
        whole = np.maximum(greatest, OF_ALL_MOVED * parts)
        found.append(np.where(sure & (size > DRIFTS * whole) & (whole > 0), size / whole, 0.0))
    return found[0], found[1]


def _puts(scene: Scene, steps: BodySteps) -> NDArray[np.int64]:
    """Return how often calls had set a body before each step."""
    puts = [each.at.step for each in scene.records[steps.body.number].puts]
    return np.searchsorted(puts, steps.steps)


def _turning(tree: Tree, states: States) -> tuple[Float64, Float64]:
    """Return the angular momentum about the centre of mass, shape (n, 3), and that of all links.

    The latter is the sum of its sizes, shape (n,).
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
