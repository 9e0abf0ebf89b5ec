"""Why something bounces ever higher: the push out of the overlap comes on top of restitution.

Without that push, restitution still turns the speed around that gravity adds in the step of the
impact (`btMultiBodyConstraintSolver::setupMultiBodyContactConstraint`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.changes import energy_of
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.rule import Match, Said, Worst, pair_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import GAINED

Float64 = NDArray[np.float64]


@pair_rule("energy-gained", "broken", consecutive=True, argument="restitution")
def energy_gained(pair: PairColumns) -> Match:
    """Bodies leave a contact with more energy than they brought; no call moves them, no joints."""
    rows = np.flatnonzero((pair.normal_n > 0) & (pair.body != pair.other))
    bodies, steps = pair.pairs.body[rows], pair.step[rows]
    moved = pair.scene.placing.moved(bodies, steps[:, None]).any(axis=1)
    restitution = pair.restitution[rows]
    return Match(
        rows,
        np.zeros(len(rows)),
        sums={"gained": pair.energy_j[rows].sum(axis=1)},
        most={"unsure": moved | ~pair.explained[rows].all(axis=1), "restitution": restitution},
        firsts={"brought": _kinetic_j(pair, rows), "approach": pair.approach_m_s[rows]},
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
        cure = Cure("timestep", value=4.0)
    return Said(
        message=Message(
            "contact of {body} with {other} adds {gained:.3g} J to {brought:.3g} J of kinetic "
            "energy: they come together at {approach:.4g} m/s and part at {parting:.4g} m/s; their "
            "restitution is {restitution:.3g}, and {why}"
        ),
        values={"why": why},
        advice=advice,
        cure=cure,
        effect=Effect(worst.gained, "J"),
        share=worst.gained / worst.brought,
    )


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
