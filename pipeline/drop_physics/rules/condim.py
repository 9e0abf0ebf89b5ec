"""Rules about MuJoCo contacts whose `condim` switches friction off: `slides`, `not-taken`."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.messages import Message
from drop_physics.physics.vectors import lengths
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, pair_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import (
    COASTS_STEPS,
    FROM_REST,
    LEFT_M,
    ROLLING,
    ROLLS_SLIP,
    SLIPS_STEPS,
    WHEEL_TURN_RAD,
)
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

ROLLS_WITH = 6
"""The smallest `condim` with which rolling friction acts."""


@pair_rule(
    "slides", "model", reason="condim", consecutive=True, least_count=SLIPS_STEPS, engines=MUJOCOS
)
def without_friction(pair: PairColumns) -> Match:
    """Contacts of condim 1 have no friction, so that bodies slide."""
    where = (pair.pairs.normal_n > 0) & (pair.pairs.summed(pair.points.friction) == 0)
    where &= pair.body != pair.other
    numbers = {"bodies": pair.pairs.body, "links": pair.links}
    way = pair.pairs.slip_m_s * pair.timestep_s
    return Match(
        where, pair.pairs.slip_m_s, numbers, {"slid": way}, firsts={"began": pair.pairs.slip_m_s}
    )


@without_friction.counts
def _(began: Float64, size: Float64, slid: Float64) -> Float64:
    # A puck that was thrown may be to glide on.
    rested = began <= FROM_REST * size
    return np.where(rested & (slid > LEFT_M), slid, 0.0)


without_friction.rows(
    SayingRow(
        when=lambda seen, bodies, links: seen.condim(bodies, links)[0] <= 1,
        says=Message(
            "{body} slides {slid:.3g} m on {other} in {steps} without friction: their contacts "
            "have condim 1, whatever friction= gives"
        ),
        cure=Remedy("friction", "body", 3.0, form="condim"),
        effect="slid",
        normal="body_size_m",
    )
)


@pair_rule("not-taken", "asked", reason="no-effect", least_count=COASTS_STEPS, engines=MUJOCOS)
def rolls_on(pair: PairColumns, seen: Seen) -> Match | None:
    """Rolling friction acts only with condim 6: with less, a rolling body is not braked."""
    given = seen.condims.values()
    if not any(1 < condim < ROLLS_WITH and rolling > ROLLING for condim, rolling in given):
        return None
    # What is carried goes along with what it touches; what rolls turns, on what stands still.
    stands = ~pair.points.moves[pair.starts, 1 - pair.side]
    rows = np.flatnonzero((pair.pairs.normal_n > 0) & stands)
    touching, (way, turn) = pair.own(pair.pairs.ended_m_s), np.zeros((2, len(pair.step)))
    for steps, which, at in pair.of_bodies(rows):
        if not steps.law.tree.fixed:
            spin, velocity = np.split(steps.after.velocity[at, :6], 2, axis=1)
            turn[rows[which]] = lengths(spin)
            way[rows[which]] = lengths(velocity - touching[rows[which]])
    # What slips little does not slide.
    rolls, dt = pair.pairs.slip_m_s < ROLLS_SLIP * way, pair.timestep_s
    numbers = {"bodies": pair.pairs.body, "links": pair.links}
    return Match(rolls, way * dt, numbers, {"way": way * dt, "turn": turn * dt})


@rolls_on.counts
def _(turn: Float64, way: Float64) -> Float64:
    # What tips over turns less.
    return np.where(turn > WHEEL_TURN_RAD, way, 0.0)


@rolls_on.notes
def _(seen: Seen, subject: Body, bodies: list[int], links: list[int]) -> Noted | None:
    condim, rolling = seen.condim(bodies, links)
    # What has wheels is driven.
    if subject.joints or not (1 < condim < ROLLS_WITH and rolling > ROLLING):
        return None
    return {"condim": condim, "rolling": rolling}


rolls_on.rows(
    SayingRow(
        says=Message(
            "{body} rolls {way:.3g} m on {other} in {steps}, unbraked: their rolling friction of "
            "{rolling:g} acts with condim 6, and theirs is {condim}"
        ),
        cure=Remedy("friction", "body", float(ROLLS_WITH), form="condim"),
        effect="way",
        normal="body_size_m",
    )
)
