"""The rule about MuJoCo equalities that are never active: `not-taken`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.bodies import Record
from drop_physics.messages import Message
from drop_physics.physics.tree import BASE
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.rows import Case, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import LEFT_M
from drop_physics.trace.acts import Act
from drop_physics.trace.history import Seen


@input_rule("not-taken", "model", "inactive", engines=MUJOCOS)
def never_active(inputs: Inputs, seen: Seen, records: Mapping[int, Record]) -> Iterator[Case]:
    """An equality that is never active exerts no force, and its bodies move apart."""
    forces = inputs.lasting.forces
    switched = {client for client, act, _ in forces if act is Act.SET_ACTIVE}
    for equality in seen.equalities:
        number, end = equality.at.call, seen.samples.get(equality.client, 1) - 1
        mine = forces.get((equality.client, Act.SET_ACTIVE, number))
        # A script that switches others knows of this one.
        known = equality.client in switched if mine is None else mine.until(end) > 0
        if (
            equality.active
            or known
            or equality.tendons
            or (equality.link_a, equality.link_b) != (BASE, BASE)
        ):
            continue
        body, other = seen.bodies[equality.body_b], seen.bodies[equality.body_a]
        ways = [_way_m(inputs, one.number, end, records) for one in (body, other)]
        apart_m = float(np.linalg.norm(ways[0] - ways[1]))
        if not apart_m >= LEFT_M:
            continue
        told = {"apart": apart_m, "name": equality.name, "number": number, "mine": mine}
        call = None if mine is None else mine.call
        yield Case(call=call, subject=body, values={"other": other.label, **told})


never_active.rows(
    SayingRow(
        when=lambda mine: mine is not None,
        says=Message(
            "{body} and {other} part by {apart:.3g} m: eq_active[{number}] is written, and a "
            "reset before the next step sets it back, so {name} does not join them"
        ),
    ),
    SayingRow(
        says=Message(
            "{body} and {other} part by {apart:.3g} m: {name}, which joins them, is not active"
        )
    ),
    like=SayingRow(
        advice=Message('active="true" of it, or data.eq_active[{number}] = 1 after each reset'),
        effect="apart",
        share="apart",
    ),
)


def _way_m(inputs: Inputs, number: int, end: int, records: Mapping[int, Record]) -> Float64:
    """Return how far a base moved during the run [m], shape (3,); nan if unknown."""
    motion = inputs.motions.get(number)
    if motion is not None and motion.first_m is not None and motion.last_m is not None:
        return motion.last_m - motion.first_m
    base = records[number].base_at(np.array([0, end]))[:, :3]
    return np.asarray(base[1] - base[0])
