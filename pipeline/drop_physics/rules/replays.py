"""The rule `not-replayed`: MuJoCo steps whose results cannot be repeated."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.step_status import WHYS
from drop_physics.messages import Message
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, Sized, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import FALLS_STEPS
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.switches import NO_GRAVITY, is_off

STALE = "stale"
"""The reason of a step that used data of an older state."""


@body_rule("not-replayed", "note", subject=0, engines=MUJOCOS)
def not_replayed(bodies: BodyColumns, chunk: StepChunk) -> Match:
    """Repeated steps lead to states that differ from the recorded ones."""
    piece, why = chunk.piece, bodies.verdict.why
    client = bodies.of_each(lambda each: each.body.client)
    replayed = np.isin(client, [each for each, held in piece.impulses.items() if held])
    writes = {(each.client, each.at.step + 1) for each in piece.calls.of(Act.SET_STATE)}
    written = [pair in writes for pair in zip(client.tolist(), bodies.step.tolist(), strict=True)]
    stale = why == WHYS.index(STALE)
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
        reason=STALE,
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


@body_rule("no-gravity", "model", least_count=FALLS_STEPS, engines=MUJOCOS)
def floats_without_gravity(bodies: BodyColumns, seen: Seen) -> Match | None:
    """A free body without support does not fall, since gravity is zero or switched off."""
    body = bodies.batch.bodies[0].body
    if not body.base_moves:
        return None
    acts = np.any(bodies.after.velocity, axis=1)
    if not is_off(seen, body.client, NO_GRAVITY):
        acts |= bodies.reported.gravity_m_s2.any(axis=1)
    acts[bodies.reported.contacts.step] = True
    for term in bodies.terms.values():
        acts |= term.any(axis=1)
    return Match(~acts, np.ones(len(acts)))


@body_rule("no-gravity", "note", reason="gravcomp", least_count=FALLS_STEPS, engines=MUJOCOS)
def floats_by_compensation(bodies: BodyColumns) -> Match | None:
    """The `gravcomp` of a free body without contact cancels its weight."""
    lifts = bodies.terms.get("gravity compensation")
    if not bodies.batch.bodies[0].body.base_moves or lifts is None:
        return None
    weight, lift = bodies.terms["gravity"][:, 3:6], lifts[:, 3:6]
    still = np.any(lift, axis=1) & np.all(np.abs(lift + weight) <= 1e-9 * np.abs(weight), axis=1)
    acts = np.zeros(len(still), np.bool_)
    acts[bodies.reported.contacts.step] = True
    return Match(still & ~acts & ~bodies.after.velocity.any(axis=1), np.ones(len(still)))


@floats_by_compensation.notes
@floats_without_gravity.notes
def _(last_samples: Mapping[int, int], seen: Seen, subject: Body, count: int) -> Noted | None:
    if count < last_samples[subject.number]:
        return None  # it moves at some time
    return {"off": is_off(seen, subject.client, NO_GRAVITY)}


# The model says so, where no flag does.
floats_by_compensation.rows(
    SayingRow(
        says=Message("gravcomp takes all of gravity off {body}, so it does not fall"),
        cure=Remedy("gravcomp", "body", 0.0),
        share=0.0,
    )
)
floats_without_gravity.rows(
    SayingRow(
        when=lambda off: off,
        says=Message("a flag of the model switches gravity off, so {body} does not fall"),
        cure=Remedy("gravity", form="flag"),
        reason="flag",
    ),
    SayingRow(
        says=Message("the model's gravity is 0, so {body} does not fall"),
        cure=Remedy("gravity", value=-9.81),
        level="note",
    ),
)
