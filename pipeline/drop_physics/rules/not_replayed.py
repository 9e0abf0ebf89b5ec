"""The rule `not-replayed`: MuJoCo steps whose results cannot be repeated."""

from __future__ import annotations

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.step_status import WHYS
from drop_physics.messages import Message
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Remedy, SayingRow
from drop_physics.rules.rule import Match, Sized, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.trace.acts import Act


@body_rule("not-replayed", "note", subject=0, engines=MUJOCOS)
def not_replayed(bodies: BodyColumns, chunk: StepChunk) -> Match:
    """Repeated steps lead to states that differ from the recorded ones."""
    piece, why = chunk.piece, bodies.verdict.why
    client = bodies.of_each(lambda each: each.body.client)
    replayed = np.isin(client, [each for each, held in piece.impulses.items() if held])
    writes = {(each.client, each.at.step + 1) for each in piece.calls.of(Act.SET_STATE)}
    written = [pair in writes for pair in zip(client.tolist(), bodies.step.tolist(), strict=True)]
    stale = why == WHYS.index("stale")
    return Match(
        replayed & (stale | (why == WHYS.index("not replayed"))),
        np.ones(len(client)),
        {"stale": stale},
        firsts={"written": np.array(written)},
        keys=np.column_stack([bodies.body, stale]),
    )


@not_replayed.counts
def _(stale: Flags, written: Flags, size: Float64) -> Sized:
    return Sized(np.where(stale & ~written, 0.0, size), graver=stale)


not_replayed.rows(
    SayingRow(
        when=lambda stale: stale,
        says=Message(
            "{steps} from step {first:,} on used what had been computed for the state before qpos "
            "was written: mj_step2 takes positions, contacts and forces as mj_step1 left them"
        ),
        cure=Remedy("forward"),
        reason="stale",
        level="asked",
        site=Act.SET_STATE,
    ),
    SayingRow(
        says=Message(
            "{steps} from step {first:,} on lead elsewhere than the recorded state and model do "
            "when they are taken again: what acted in them is not known"
        ),
    ),
    like=SayingRow(effect="count", unit="steps", share="count"),
)
