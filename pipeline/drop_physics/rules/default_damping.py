"""Why something loses speed in the air: PyBullet damps every body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.changes import energy_of
from drop_physics.explain.step_status import DRIVEN, FLIGHT
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.rule import Match, Said, Worst, body_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import DAMPED


@body_rule("default-damping", "model", subject=1)
def default_damping(bodies: BodyColumns) -> Match | None:
    """Damping that no call set takes a share of the energy of a flight."""
    its = [each.changes.energy_j.get("damping") for each in bodies.batch.bodies]
    if any(each is None for each in its) or bodies.epoch.damping != (None, None):
        return None
    # A robot whose motors hold its joints is in the air, too, if nothing is near; an arm is
    # mounted.
    near = np.full(len(bodies.step), bodies.law.tree.fixed)
    near[bodies.reported.contacts.step] = True
    segment = bodies.segment
    rows = np.flatnonzero((segment == FLIGHT) | ((segment == DRIVEN) & ~near))
    taken_j = -np.concatenate([each for each in its if each is not None])[rows]
    none = np.zeros((len(rows), 3))
    states = bodies.before.at(rows), bodies.after.at(rows)
    energy_j = np.max([energy_of(bodies.law, each, none)[0] for each in states], axis=0)
    lives = bodies.of_each(lambda each: each.epoch.life)
    keys = np.column_stack([bodies.body, lives])[rows]
    return Match(rows, energy_j, sums={"taken": taken_j}, keys=keys)


@default_damping.counts
def _(runs: Runs, _: Scene) -> NDArray[np.float64]:
    return np.where(runs.taken > DAMPED * runs.size, runs.taken, 0.0)


@default_damping.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "{body} loses {taken:.3g} J in the air, of at most {largest:.3g} J of kinetic energy: "
            "PyBullet damps every body, by 0.04 unless a call sets it"
        ),
        values={"largest": worst.size},
        advice=Message("p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)"),
        cure=Cure("damping", worst.body, 0.0),
        effect=Effect(worst.taken, "J"),
        share=min(worst.taken / worst.size, 1),
    )
