"""The rule `not-finite`: infinite numbers and nan in a state, or given to actuators."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.messages import Message
from drop_physics.rules.arguments import site_of
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, MUJOCOS
from drop_physics.rules.rows import Case, Noted, SayingRow
from drop_physics.rules.rule import Match, body_rule, input_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.warned import IN_STEPS, warned
from drop_physics.trace.calls import BODY_NAMES, Call
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.log import Log

CONTROL = "bad control"
"""The warning after which the engine takes 0 for all controls."""
OVERFLOWS = float(np.sqrt(np.finfo(np.float64).max))
"""A number of at least this size has an infinite square."""


@body_rule("not-finite", "broken", engines=ANY)
def not_finite(bodies: BodyColumns, seen: Seen, chunk: StepChunk) -> Match | None:
    """The state after a step, or an impulse in it, is infinite or not a number."""
    names = ("velocity", "position_m", "orientation", "joints")
    states = np.hstack([getattr(bodies.after, name) for name in names])
    rows = np.flatnonzero(np.any([*map(_wrong, [states, *bodies.terms.values()])], axis=0))
    if not len(rows):
        return None
    calls = np.full(len(rows), None, object)
    _, firsts = np.unique(bodies.body[rows], return_index=True)
    for at in firsts.tolist():  # later steps have what the first one left
        body, step = seen.bodies[int(bodies.body[rows[at]])], int(bodies.step[rows[at]])
        calls[at] = _without_number(chunk.piece.calls, body, step)
    return Match(rows, np.ones(len(rows)), firsts={"given": calls})


@not_finite.notes
def _(first: int, given: Call | None) -> Noted:
    called = given is not None
    # The first counts, one that a call names before others.
    noted: Noted = {
        "why": "",
        "overflows": False,
        "stood": (first, first),
        "part": 1 + 1 / (first - called / 2),
    }
    if given is None:
        return noted
    number = float(np.abs(given.numbers).max())
    return noted | {
        "function": given.function,
        "arguments": given.arguments,
        "number": number,
        "overflows": number < np.inf,
        "site": site_of(given),
    }


not_finite.rows(
    SayingRow(
        when=lambda overflows: overflows,
        why=Message(
            ": p.{function}({arguments}) was given {number:.4g}, whose square is no number"
        ),
        site="site",
    ),
    SayingRow(
        when=lambda given: given is not None,
        why=Message(": p.{function}({arguments}) was given it"),
        site="site",
    ),
    SayingRow(),
    like=SayingRow(
        says=Message(
            "{body} has a state that is no number (nan or infinite) from step {first:,} on{why}"
        ),
        share="part",
    ),
)


def _wrong(numbers: Float64) -> Flags:
    return np.asarray(~np.isfinite(numbers).all(axis=1))


def _without_number(calls: Log, body: Body, step: int) -> Call | None:
    """Return a body's last call with an argument that makes the state nan or infinite."""
    for each in reversed(list[Call](calls)):
        numbers = (each.values[name][0] for name in BODY_NAMES if name in each.values)
        mine = next(numbers, body.engine_id) == body.engine_id
        wrong = each.at.step < step and not (np.abs(each.numbers) < OVERFLOWS).all()
        if each.client == body.client and mine and wrong:
            return each
    return None


@input_rule("not-finite", "broken", engines=MUJOCOS)
def bad_control(seen: Seen) -> Iterator[Case]:
    """A control is huge or not a number, so that no actuator acts in that step."""
    return warned(seen, CONTROL)


bad_control.rows(
    SayingRow(
        says=Message(
            "ctrl[{index}] is huge or no number in {steps}, first in step {first:,}, and MuJoCo "
            "then takes 0 for all controls"
        ),
        advice=Message("look for what the script divides by 0, or takes a root or arccos of"),
    ),
    like=IN_STEPS,
)
