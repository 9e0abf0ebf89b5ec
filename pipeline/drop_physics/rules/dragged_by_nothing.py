"""`dragged-by-nothing`: calls move a support that has no velocity, and what lies on it stays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.engines import ANY, MUJOCO
from drop_physics.rules.placing import NEAR
from drop_physics.rules.rule import Match, Said, Worst, side_rule
from drop_physics.rules.tables import PairColumns
from drop_physics.rules.thresholds import AHEAD, STAYS

Float64 = NDArray[np.float64]


@side_rule("dragged-by-nothing", "asked", engines=ANY)
def dragged_by_nothing(pair: PairColumns) -> Match | None:
    """Friction acts on velocities: where only poses are set, there is none to be dragged by."""
    moves = pair.points.moves[pair.starts]
    lies = moves[:, pair.side] & ~moves[:, 1 - pair.side] & (pair.available_n > 0)
    ahead_m, where = np.zeros((len(lies), 3)), np.zeros(len(lies), np.bool_)
    for support, (steps, bases) in pair.scene.placing.animated.items():
        rows = np.flatnonzero(lies & (pair.other == support))
        held = np.minimum(np.searchsorted(steps, pair.step[rows]), len(steps) - 1)
        moved = (held > 0) & (steps[held] == pair.step[rows])
        moved &= steps[held] - steps[held - 1] <= NEAR
        moved &= np.linalg.norm(bases[held, 7:10], axis=1) < 1e-9
        where[rows] = moved
        ahead_m[rows] = bases[held, :3] - bases[held - 1, :3]
    if not where.any():
        return None
    went_m = pair.own("ended_m_s") * pair.timestep_s[:, None]
    ways = {"ahead_m": _along(ahead_m, pair.line), "went_m": _along(went_m, pair.line)}
    return Match(where, pair.normal_n, sums=ways)


@dragged_by_nothing.says
def _(worst: Worst) -> Said | None:
    ways, size = np.array([worst.ahead_m, worst.went_m]), worst.body_size_m
    behind, (ahead, went) = float(np.linalg.norm(ways[0] - ways[1])), np.linalg.norm(ways, axis=1)
    if went > STAYS * ahead or behind < AHEAD * size:
        return None
    advice = Message("set the velocity, too: p.resetBaseVelocity({other}, …), each step")
    cure: Cure | None = Cure("support-velocity", worst.other, bodies=(worst.other,))
    if worst.engine == MUJOCO:
        advice = Message("let a <joint> with an actuator move it, or <weld> it to the mocap body")
        cure = None
    return Said(
        message=Message(
            "{body} stays behind while calls move {other} by {ahead:.3g} m under it: a "
            "body whose pose is set has no velocity, and drags nothing"
        ),
        values={"ahead": float(ahead)},
        advice=advice,
        cure=cure,
        effect=Effect(behind, "m"),
        share=behind / size,
        site=worst.scene.placing.site(worst.partner, worst.last),
    )


def _along(ways: Float64, line: Float64) -> Float64:
    """Return the parts of ways along a contact, given its normals, shape (n, 3)."""
    return np.asarray(ways - np.einsum("mi,mi->m", ways, line)[:, None] * line)
