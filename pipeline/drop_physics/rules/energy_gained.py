"""Why something bounces ever higher: the push out of the overlap comes on top of restitution.

Without that push, restitution still turns the speed around that gravity adds in the step of the
impact (`btMultiBodyConstraintSolver::setupMultiBodyContactConstraint`). A contact of MuJoCo is a
spring, which gives back more than it took where it acts for a few steps and is damped too little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.changes import energy_of
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.engines import ANY, MUJOCO
from drop_physics.rules.rule import Match, Said, Worst, pair_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import GAINED

Float64 = NDArray[np.float64]

FINER = 4.0
"""By what a timestep is divided to be tried."""


@pair_rule("energy-gained", "broken", consecutive=True, argument="restitution", engines=ANY)
def energy_gained(pair: PairColumns) -> Match:
    """Bodies leave a contact with more energy than they brought; no call moves them, no joints."""
    rows = np.flatnonzero((pair.normal_n > 0) & (pair.body != pair.other))
    bodies, steps = pair.pairs.body[rows], pair.step[rows]
    moved = pair.scene.placing.moved(bodies, steps[:, None]).any(axis=1)
    solref = _solref(pair, rows)
    # Less damped than critically, or by a number of its own; what else did it is not sure.
    springs = ((solref[:, 0] < 0) | (solref[:, 1] < 1)).astype(float)
    restitution = np.where(np.isnan(solref[:, 0]), pair.restitution[rows], springs)
    return Match(
        rows,
        np.zeros(len(rows)),
        sums={"gained": pair.energy_j[rows].sum(axis=1)},
        most={"unsure": moved | ~pair.explained[rows].all(axis=1), "restitution": restitution},
        firsts={
            "brought": _kinetic_j(pair, rows),
            "approach": pair.approach_m_s[rows],
            "solref": solref,
            "timestep": pair.timestep_s[rows],
        },
        lasts={"parting": pair.parting_m_s[rows]},
        keys=pair.keys[rows],
    )


@energy_gained.counts
def _(runs: Runs, _: Scene) -> Float64:
    # Without restitution what did it is not sure.
    faster = (runs.restitution > 0) & (runs.parting > runs.approach) & (runs.approach > 0)
    gains = faster & ~runs.unsure & (runs.gained > GAINED * runs.brought) & (runs.brought > 0)
    return np.where(gains, runs.gained, 0.0)


@energy_gained.says
def _(worst: Worst) -> Said | None:
    scene = worst.scene
    for each in (worst.subject, worst.partner):
        if each.moving and len(scene.touches.rows(each.number)) > 1:
            return None  # a third body may have given it
    message = Message(
        "contact of {body} with {other} adds {gained:.3g} J to {brought:.3g} J of kinetic "
        "energy: they come together at {approach:.4g} m/s and part at {parting:.4g} m/s; their "
        "restitution is {restitution:.3g}, and {why}"
    )
    why, advice = (
        Message("the push out of the overlap comes on top"),
        Message(
            "give them less restitution, or no push: p.setPhysicsEngineParameter(contactERP=0)"
        ),
    )
    cure = Cure("solver", value=0.0, given={"contactERP": 0})
    if worst.subject.client in scene.clients_with("set_contactERP", 0):
        why = Message("it turns the speed around that gravity gives them in that step, too")
        advice = Message("give them less restitution, or use a shorter timestep: p.setTimeStep(…)")
        cure = Cure("timestep", value=FINER)
    if worst.engine == MUJOCO:
        message = Message(
            "contact of {body} with {other} adds {gained:.3g} J to {brought:.3g} J of kinetic "
            "energy: they come together at {approach:.4g} m/s and part at {parting:.4g} m/s; it is "
            "a spring (solref {soft}) that acts for {steps} of {timestep:g} s"
        )
        advice = Message(
            'use a shorter timestep: <option timestep="{finer:.2g}"/>, or more damping in solref'
        )
        cure = Cure("timestep", value=FINER)
    return Said(
        message=message,
        values={
            "why": why,
            "soft": " ".join(f"{each:g}" for each in np.ravel(worst.solref)),
            "finer": worst.timestep / FINER,
        },
        advice=advice,
        cure=cure,
        effect=Effect(worst.gained, "J"),
        share=worst.gained / worst.brought,
    )


def _solref(pair: PairColumns, rows: NDArray[np.intp]) -> Float64:
    """Return `solref` of the first point of each row, shape (rows, 2); nan of other engines."""
    seen, first = pair.scene.seen, pair.starts[rows]
    if not seen.softness:
        return np.full((len(rows), 2), np.nan)
    places = np.column_stack([pair.points.body[first], pair.points.link[first]])
    known, which = np.unique(places, axis=0, return_inverse=True)
    soft = [seen.soft(each[:2], each[2:]) for each in known.tolist()]
    held = [(np.nan, np.nan) if each is None else each[0][:2] for each in soft]
    return np.reshape(held, (-1, 2))[which.ravel()]


def _kinetic_j(pair: PairColumns, rows: NDArray[np.intp]) -> Float64:
    """Return the kinetic energy of both bodies as steps began, where they did not touch before.

    0 of what stands, nan of bodies with joints; shape (rows,).
    """
    energy_j, bodies = np.zeros(len(rows)), pair.pairs.body[rows]
    begins = np.flatnonzero(pair.before(rows) < 0)
    for side in (0, 1):
        number, step = bodies[begins, side], pair.step[rows[begins]]
        of_side = np.where(np.isin(number, [*pair.scene.judged]), np.nan, 0.0)
        for steps, its, at in pair.scene.steps_at(number, step):
            if steps.law.tree.size == 6:
                of_side[its] = energy_of(steps.law, steps.before.at(at), np.zeros((len(at), 3)))[0]
        energy_j[begins] += of_side
    return energy_j
