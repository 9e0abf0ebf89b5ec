"""The rule `no-gravity`: nothing pulls a free body down, and it stays where it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message
from drop_physics.rules.answer import Span
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.engines import ANY, MUJOCO, MUJOCOS, engine_of
from drop_physics.rules.inputs import BodyLife, Inputs
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import FALLS_STEPS, STANDARD_M_S2
from drop_physics.trace.acts import PUSHES, Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.switches import NO_GRAVITY, is_off

HOLDS = Act.SET_GRAVITY, Act.CONSTRAIN, *PUSHES
"""Kinds of calls that show that bodies without support do not need gravity."""


@input_rule("no-gravity", "asked", engines=ANY)
def no_gravity(inputs: Inputs, seen: Seen, times: Mapping[int, StepTimes]) -> Iterator[Case]:
    """Bodies without support do not fall: gravity is not set, taken away, or compensated."""
    said = set[tuple[int, object]]()
    # Where the call is there, and for another client, that is said.
    left_out = inputs.left_out(Act.SET_GRAVITY)[1]
    # Where no model gives it, gravity is 0 without being asked for.
    by_model = engine_of(seen) == MUJOCO
    free = [
        (body, life)
        for (number, _), life in inputs.lives.items()
        if (body := seen.bodies[number]).base_moves
        if not life.falls or is_off(seen, body.client, NO_GRAVITY)
        if (
            life.count >= FALLS_STEPS and not life.fastest
            if by_model
            else _would_fall_m(body, life, times) > size_m(body)
        )
    ]
    for body, life in sorted(free, key=lambda each: each[1].first):
        client = body.client
        # The reset that took gravity away: a later one found none.
        gave = (at.call for at, _ in inputs.made(client, Act.SET_GRAVITY) if at.step < life.first)
        last = max(gave, default=-1)
        resets = (
            each
            for each in inputs.made(client, Act.CLEAR)
            if last < each[0].call and each[0].step < life.first
        )
        reset, use = min(resets, key=lambda each: each[0].call, default=(None, None))
        gravity_m_s2 = 0.0
        if reset is not None:
            _, before = times[client].of_steps(np.array([reset.step]))
            gravity_m_s2 = float(np.linalg.norm(before))
        since, lost = -1 if reset is None else reset.call, gravity_m_s2 > 0
        held = (at for at, _ in inputs.made(client, *HOLDS) if since < at.call)
        flag = is_off(seen, client, NO_GRAVITY)
        why = "lost" if lost else "flag" if flag else "gravcomp" if life.lifted else "model"
        if (client, why) in said or client in left_out or any(at.step < life.last for at in held):
            continue
        said.add((client, why))
        # What moves without gravity may be meant to.
        moves = any(other.fastest > 0 for each, other in free if each.client == client)
        yield Case(
            call=use.first if use and lost else None,
            subject=body,
            span=Span(life.first, life.last, life.count),
            values={
                "why": why,
                "moves": moves,
                "step": life.first - 1,
                "gravity": gravity_m_s2,
                "client": client,
            },
        )


STARTS_WITHOUT = SayingRow(
    says=Message("gravity is 0, so {body} does not fall: PyBullet starts without it")
)
IN_CLIENT = Message("{call} with physicsClientId={client}")
no_gravity.rows(
    SayingRow(
        when=lambda why: why == "lost",
        says=Message(
            "gravity is 0 from step {step:,} on, so {body} does not fall: p.resetSimulation() "
            "sets it from {gravity:.3g} m/s² back to 0"
        ),
        advice=Message("{call} after each p.resetSimulation()"),
    ),
    SayingRow(
        when=lambda why: why == "flag",
        engines=MUJOCOS,
        says=Message("a flag of the model switches gravity off, so {body} does not fall"),
        cure=Remedy("gravity", form="flag"),
        share=1.0,
        reason="flag",
        level="model",
    ),
    SayingRow(
        when=lambda why: why == "gravcomp",
        engines=MUJOCOS,
        says=Message("gravcomp takes all of gravity off {body}, so it does not fall"),
        cure=Remedy("gravcomp", "body", 0.0),
        reason="gravcomp",
        level="note",
    ),
    SayingRow(
        engines=MUJOCOS,
        says=Message("the model's gravity is 0, so {body} does not fall"),
        level="note",
    ),
    SayingRow(when=lambda moves, client: moves and client, advice=IN_CLIENT, level="note").like(
        STARTS_WITHOUT
    ),
    SayingRow(when=lambda moves: moves, level="note").like(STARTS_WITHOUT),
    SayingRow(when=lambda client: client, advice=IN_CLIENT).like(STARTS_WITHOUT),
    STARTS_WITHOUT,
    like=SayingRow(cure=Remedy("gravity", value=-9.81)),
)


def _would_fall_m(body: Body, life: BodyLife, times: Mapping[int, StepTimes]) -> float:
    """Return how far a body would fall freely while it exists [m]."""
    end_s, begin_s = (times[body.client].of(step) for step in (life.last, life.first - 1))
    return STANDARD_M_S2 * (end_s - begin_s) ** 2 / 2
