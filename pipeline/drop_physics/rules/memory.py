"""Rules about MuJoCo values that a script writes or reads, and when they take effect."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.quantities import effort
from drop_physics.rules.answer import Span, so_many
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.lasting import LastingEdit, LastingForce
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import MASS_EDIT, PUSHES_STEPS, WATCHED
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body, EngineWarning
from drop_physics.trace.history import Seen

POSITION = "bad position"
RESETS = POSITION, "bad velocity", "bad acceleration"
"""The warnings after which the engine resets the state."""
BASE_M = 3
"""Index of the quaternion in the coordinates of a free base."""


def bodies_of(seen: Seen, client: int) -> list[Body]:
    """Return the bodies of a simulation in the engine's order."""
    return [body for body in seen.bodies.values() if body.client == client]


def body_at(seen: Seen, client: int, index: int) -> Body | None:
    """Return the recorded body that contains a MuJoCo body, given the latter's index."""
    before = [body for body in bodies_of(seen, client) if body.engine_id <= index]
    return max(before, key=lambda each: each.engine_id, default=None)


def rate_at(seen: Seen, client: int, index: int) -> tuple[Body, str | None, str] | None:
    """Return body, joint (None for the base) and joint type for an engine's dof index."""
    for body in bodies_of(seen, client):
        if body.base_moves:
            if index < 6:
                return body, None, "prismatic" if index < 3 else "revolute"
            index -= 6
        for joint in body.joints:
            if index < joint.widths[1]:
                return body, joint.name, joint.kind
            index -= joint.widths[1]
    return None


def turn_at(seen: Seen, client: int, index: int) -> Body | None:
    """Return the body whose base quaternion starts at an index of `qpos`."""
    for body in bodies_of(seen, client):
        if body.base_moves and index == BASE_M:
            return body
        index -= sum(joint.widths[0] for joint in body.joints) + (7 if body.base_moves else 0)
    return None


def _ends(seen: Seen, client: int) -> int:
    return seen.samples.get(client, 1) - 1


@input_rule("reset-leaves", "model", "reset-clears", engines=MUJOCOS)
def reset_clears_force(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A reset of the state sets forces to zero, and nothing sets them again."""
    for (client, act, place), force in inputs.lasting.forces.items():
        steps = _ends(seen, client) - force.since
        by_reset = force.since in inputs.lasting.episodes[client] and not force.now.any()
        # A body may be pushed for a while; what is reset before a step never pushes it.
        is_drive = act is Act.SET_JOINT_FORCE and force.from_start
        is_lost = act is not Act.SET_ACTIVE and not force.acts
        if by_reset and (is_drive or is_lost) and steps >= WATCHED and not force.was_cleared:
            told = {"field": force.call.function, "name": f"{force.call.function}[{place}]"}
            told |= {"steps": so_many(steps), "was": force.most[np.abs(force.most).argmax()]}
            yield Case(call=force.call, values=told)


reset_clears_force.rows(
    SayingRow(
        says=Message(
            "{name} is given 0 in {steps} after a reset, which clears it: before it was {was:.4g}"
        ),
        advice=Message("data.{field}[:] = … after each reset"),
        share=1.0,
    )
)


def _cleared(seen: Seen, force: LastingForce) -> int:
    """Return how many steps pass before the engine next clears a force by a reset of its own."""
    warnings = [each for each in seen.warnings if each.client == force.client]
    resets = [step for each in warnings if each.kind in RESETS for step in _first_and_last(each)]
    return min([_ends(seen, force.client), *(step for step in resets if step > force.since)])


def _first_and_last(warning: EngineWarning) -> tuple[int, int]:
    return warning.at.step, warning.last_step


@input_rule("push-stays", "model", engines=MUJOCOS)
def force_stays(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A force on a body or a joint acts in each step until it is written again."""
    for (client, act, place), force in inputs.lasting.forces.items():
        acts, first = force.until(_cleared(seen, force)), force.call.at.step + 1
        if acts < PUSHES_STEPS * force.writes or force.was_cleared or force.from_start:
            continue
        body, joint, kind = body_at(seen, client, place), None, "prismatic"
        if act is Act.SET_JOINT_FORCE:
            body, joint, kind = rate_at(seen, client, place) or (None, None, "")
        push = math.hypot(*force.most[:3])
        unit = "N" if kind == "prismatic" and push else "N m"
        if act is Act.SET_ACTIVE or body is None or not body.moving:
            continue
        yield Case(
            call=force.call,
            subject=body,
            span=Span(first, first + acts - 1, acts),
            values={
                "label": body.label,
                "joint": joint,
                "body": joint or body.label,
                "push": effort(push or math.hypot(*force.most), unit),
                "field": f"{force.call.function}[{place}]",
                "function": force.call.function,
                "count": acts,
                "acts": so_many(acts),
                "step": first,
            },
        )


force_stays.rows(
    SayingRow(
        says=Message(
            "{body} is pushed by {push} in {acts}, from step {step:,} on: {field} keeps what is "
            "written there until something else is"
        ),
        cure=Remedy("push-repeated", "label", given={"function": "function"}),
        proposed=True,  # a force that is written in each step may be the same in all
        effect="count",
        unit="steps",
        normal=PUSHES_STEPS,
    )
)


@input_rule("not-taken", "asked", "no-effect", engines=MUJOCOS)
def without_joint(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """A body without a joint is part of the world: no force moves it."""
    for (client, act, place), force in inputs.lasting.forces.items():
        body = body_at(seen, client, place) if act is Act.SET_BODY_FORCE else None
        if body is None or (body.moving and place):
            continue
        told = {"field": f"{force.call.function}[{place}]", "of_world": place == 0}
        if place == 0:
            first = next(each for each in bodies_of(seen, client) if each.moving)
            told |= {"index": first.engine_id, "body": first.label}
        yield Case(call=force.call, subject=body, values=told)


without_joint.rows(
    SayingRow(
        when=lambda of_world: of_world,
        says=Message("{field} is of the world, which no force moves"),
        advice=Message("the index of the body that is meant, such as {index} of {body}"),
    ),
    SayingRow(
        says=Message(
            "{body} is given {field}, and has no joint: what has none is part of the world, which "
            "no force moves"
        ),
        advice=Message("<freejoint/> in its <body>"),
    ),
    like=SayingRow(share=1.0),
)


@input_rule("model-edited", "model", engines=MUJOCOS)
def model_edited(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """Quantities that a model derives from its masses are computed only when it is compiled."""
    lasting = inputs.lasting
    anew = {(each.call.client, each.call.at.step) for each in lasting.edits[Act.SET_DERIVED]}
    derived: dict[tuple[int, int], tuple[int, float]] = {}
    """The step at which derived values were computed, and the mass then, by client and body."""
    worst: dict[int, tuple[float, float, float, LastingEdit, int]] = {}
    for edit in lasting.edits[Act.SET_MASS]:
        client, step = edit.call.client, edit.call.at.step
        for index, new, before in zip(
            *(element.tolist() for element in edit.elements), strict=True
        ):
            since, old = derived.get((client, index), (step, before))
            if any(of == client and since <= at <= step for of, at in anew):
                old = new if (client, step) in anew else before
                since = step
            derived[client, index] = since, old
            ratio = max(old, new) / max(min(old, new), 1e-300)
            if ratio > worst.get(client, (1.0,))[0]:
                worst[client] = ratio, old, new, edit, index
    for client, (ratio, old, new, edit, index) in worst.items():
        told: dict[str, object] = {"old": old, "new": new, "more": new - old, "ratio": ratio}
        told |= {"step": edit.call.at.step + 1, "index": index}
        yield Case(call=edit.call, subject=body_at(seen, client, index), values=told)


MODEL_EDITED = SayingRow(
    says=Message(
        "the mass of {body} is changed in place from {old:.4g} to {new:.4g} kg before step "
        "{step:,} (body_mass[{index}]), and what the model derives from it is not: contacts, "
        "limits and equalities are as soft as for {old:.4g} kg"
    ),
    cure=Remedy("set-const"),
    effect="more",
    unit="kg",
    share="ratio",
)
model_edited.rows(
    SayingRow(when=lambda ratio: ratio < MASS_EDIT, level="note"), SayingRow(), like=MODEL_EDITED
)


@input_rule("taken-elsewhere", "model", "quaternion-order", engines=MUJOCOS)
def w_first(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """MuJoCo expects quaternions with w first: with w last, a turn about z becomes half a turn."""
    for (client, place), (call, turn) in inputs.lasting.turned.items():
        body = turn_at(seen, client, place)
        if body is None:
            continue
        angle = 2 * math.atan2(turn[2], turn[3])
        written = ", ".join(f"{each:.3g}" for each in turn)
        told = {"place": place, "end": place + 4, "turn": written, "angle": angle}
        yield Case(call=call, subject=body, values=told)


W_FIRST = SayingRow(
    says=Message(
        "qpos[{place}:{end}] gives {body} the quaternion ({turn}), half a turn: MuJoCo has w "
        "first; with w last it would be {why}"
    ),
    advice=Message("np.roll(quaternion, 1) puts w first"),
    share=1.0,
)
w_first.rows(
    SayingRow(when=lambda angle: angle, why=Message("{angle:.3g} rad about z")),
    # Half a turn about z may be meant.
    SayingRow(why=Message("no turn"), level="note"),
    like=W_FIRST,
)
