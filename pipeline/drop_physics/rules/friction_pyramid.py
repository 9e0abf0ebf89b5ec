"""`friction-pyramid`: friction along two axes, each with its own limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Scene
from drop_physics.rules.rule import Match, Said, Worst, pair_rule
from drop_physics.rules.runs import Runs
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import PYRAMID, PYRAMID_M_S, PYRAMID_STEPS, PYRAMID_TURNS_RAD


@pair_rule("friction-pyramid", "model", least_count=PYRAMID_STEPS)
def friction_pyramid(pair: PairColumns) -> Match | None:
    """Friction is more than μN in most steps, or turns a slide, with enableConeFriction=0."""
    clients = pair.scene.clients_with("set_enableConeFriction", 0)
    bodies = [number for number, body in pair.scene.seen.bodies.items() if body.client in clients]
    slides = (pair.slip_m_s > PYRAMID_M_S) & (pair.available_n > 0) & (pair.body != pair.other)
    used = np.linalg.norm(pair.tangential_n, axis=1) / pair.available_n
    more = used > PYRAMID
    where = slides & np.isin(pair.body, bodies)
    along = pair.tangential_n / np.linalg.norm(pair.tangential_n, axis=1)[:, None]
    return Match(
        where,
        used,
        sums={"all": np.ones(len(used))},
        firsts={"began": along},
        lasts={"ended": along},
        counts=more.astype(np.int64),
    )


@friction_pyramid.counts
def _(runs: Runs, _: Scene) -> NDArray[np.float64]:
    straight = (runs.began * runs.ended).sum(axis=1) > np.cos(PYRAMID_TURNS_RAD)
    return np.where((2 * runs.count > runs.all) | ~straight, runs.size, 0.0)


@friction_pyramid.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "friction on {other} brakes {body} with up to {most:.3g} times μN: with "
            "enableConeFriction=0 each of two axes has a limit of its own"
        ),
        values={"most": worst.size},
        advice=Message("call p.setPhysicsEngineParameter(enableConeFriction=1)"),
        cure=Cure("cone", value=1.0),
        effect=Effect(worst.size, "1"),
    )
