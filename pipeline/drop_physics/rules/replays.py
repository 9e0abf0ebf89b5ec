"""`not-replayed`, `no-gravity`: the engine's own replay of steps, and its gravity."""

from __future__ import annotations

import numpy as np

from drop_physics.explain.step_status import WHYS
from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.rows import Said, Worst
from drop_physics.rules.rule import Match, body_rule
from drop_physics.rules.tables import BodyColumns
from drop_physics.rules.thresholds import FALLS_STEPS
from drop_physics.trace.acts import Act
from drop_physics.trace.switches import NO_GRAVITY, is_off


def _of_steps(bodies: BodyColumns, why: str) -> Match:
    """Return the steps of replayed simulations that are unexplained for some reason."""
    piece = bodies.scene.piece
    client = bodies.of_each(lambda each: each.body.client)
    replayed = np.isin(client, [each for each, held in piece.impulses.items() if held])
    writes = {(each.client, each.at.step + 1) for each in piece.calls.of(Act.SET_STATE)}
    written = [pair in writes for pair in zip(client.tolist(), bodies.step.tolist(), strict=True)]
    return Match(
        replayed & (bodies.verdict.why == WHYS.index(why)),
        np.ones(len(client)),
        firsts={"written": np.array(written)},
    )


@body_rule("not-replayed", "asked", reason="stale", subject=0, engines=MUJOCOS)
def stale_step(bodies: BodyColumns) -> Match:
    """A step that leads elsewhere than its state does was taken with data of another state."""
    return _of_steps(bodies, "stale")


@stale_step.says
def _(worst: Worst) -> Said:
    message = Message(
        "{steps} from step {first:,} on used what had been computed for another state: mj_step2 "
        "takes positions, contacts and forces as mj_step1 left them"
    )
    if worst.written:
        message = Message(
            "{steps} from step {first:,} on used what had been computed for the state before qpos "
            "was written: mj_step2 takes positions, contacts and forces as mj_step1 left them"
        )
    return Said(
        message=message,
        cure=Cure("forward"),
        effect=Effect(float(worst.count), "steps"),
        share=float(worst.count),
        site=worst.scene.only_site(Act.SET_STATE),
    )


@body_rule("not-replayed", "note", subject=0, engines=MUJOCOS)
def not_replayed(bodies: BodyColumns) -> Match:
    """Steps that are taken again from what was recorded lead elsewhere."""
    return _of_steps(bodies, "not replayed")


@not_replayed.says
def _(worst: Worst) -> Said:
    return Said(
        message=Message(
            "{steps} from step {first:,} on lead elsewhere than the recorded state and model do "
            "when they are taken again: what acted in them is not known"
        ),
        effect=Effect(float(worst.count), "steps"),
        share=float(worst.count),
    )


@body_rule("no-gravity", "model", least_count=FALLS_STEPS, engines=MUJOCOS)
def floats_without_gravity(bodies: BodyColumns) -> Match | None:
    """A free body that nothing holds, and that does not fall: gravity is zero, or off."""
    body = bodies.batch.bodies[0].body
    if not body.base_moves:
        return None
    acts = np.any(bodies.after.velocity, axis=1)
    if not is_off(bodies.scene.seen, body.client, NO_GRAVITY):
        acts |= bodies.reported.gravity_m_s2.any(axis=1)
    acts[bodies.reported.contacts.step] = True
    for term in bodies.terms.values():
        acts |= term.any(axis=1)
    return Match(~acts, np.ones(len(acts)))


@body_rule("no-gravity", "note", reason="gravcomp", least_count=FALLS_STEPS, engines=MUJOCOS)
def floats_by_compensation(bodies: BodyColumns) -> Match | None:
    """A free body that nothing touches, and whose `gravcomp` takes all of gravity off it."""
    lifts = bodies.terms.get("gravity compensation")
    if not bodies.batch.bodies[0].body.base_moves or lifts is None:
        return None
    weight, lift = bodies.terms["gravity"][:, 3:6], lifts[:, 3:6]
    still = np.any(lift, axis=1) & np.all(np.abs(lift + weight) <= 1e-9 * np.abs(weight), axis=1)
    acts = np.zeros(len(still), np.bool_)
    acts[bodies.reported.contacts.step] = True
    return Match(still & ~acts & ~bodies.after.velocity.any(axis=1), np.ones(len(still)))


@floats_by_compensation.says
def _(worst: Worst) -> Said | None:
    if worst.count < worst.scene.ends[worst.subject.number]:
        return None  # it moves at some time
    return Said(
        message=Message("gravcomp takes all of gravity off {body}, so it does not fall"),
        cure=Cure("gravcomp", worst.body, 0.0),
        share=0.0,  # the model says so
    )


@floats_without_gravity.says
def _(worst: Worst) -> Said | None:
    if worst.count < worst.scene.ends[worst.subject.number]:
        return None  # it moves at some time
    if is_off(worst.scene.seen, worst.subject.client, NO_GRAVITY):
        return Said(
            message=Message("a flag of the model switches gravity off, so {body} does not fall"),
            cure=Cure("gravity", form="flag"),
            reason="flag",
        )
    return Said(
        message=Message("the model's gravity is 0, so {body} does not fall"),
        cure=Cure("gravity", value=-9.81),
        level="note",  # the model says so
    )
