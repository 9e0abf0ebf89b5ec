"""Rules about MuJoCo values that a script writes: `push-stays`, `model-edited`."""

from __future__ import annotations

import math
from collections.abc import Iterator

from drop_physics.messages import Message
from drop_physics.quantities import effort
from drop_physics.rules.answer import Span, so_many
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.indexed import body_at, rate_at
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.lasting import LastingEdit, LastingForce
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.rules.thresholds import MASS_EDIT, PUSHES_STEPS
from drop_physics.trace.acts import Act
from drop_physics.trace.events import EngineWarning
from drop_physics.trace.history import Seen

POSITION = "bad position"
RESETS = POSITION, "bad velocity", "bad acceleration"
"""The warnings after which the engine resets the state."""


def _cleared(seen: Seen, force: LastingForce) -> int:
    """Return how many steps pass before the engine next clears a force by a reset of its own."""
    warnings = [each for each in seen.warnings if each.client == force.client]
    resets = [step for each in warnings if each.kind in RESETS for step in _first_and_last(each)]
    return min([seen.steps_of(force.client), *(step for step in resets if step > force.since)])


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
        body = body_at(seen, client, index)
        told |= {"step": edit.call.at.step + 1, "index": index}
        told["is_inert"] = any(
            each.body is body and "coupled" in each.reported for each in seen.dynamics
        )
        yield Case(call=edit.call, subject=body, values=told)


MODEL_EDITED = SayingRow(
    says=Message(
        "the mass of {body} is changed in place to {new:.4g} kg before step {step:,} "
        "(body_mass[{index}]), and what the model derives from it is still that of {old:.4g} kg: "
        "{why}"
    ),
    cure=Remedy("set-const"),
    effect="more",
    unit="kg",
    share="ratio",
)
INERT = SayingRow(
    why=Message("the inertia that forces act on, and how soft contacts and limits are")
)
SOFT = SayingRow(why=Message("how soft contacts, limits and equalities are"))
model_edited.rows(
    SayingRow(when=lambda is_inert, ratio: is_inert and ratio < MASS_EDIT, level="note").like(
        INERT
    ),
    SayingRow(when=lambda is_inert: is_inert).like(INERT),
    SayingRow(when=lambda ratio: ratio < MASS_EDIT, level="note").like(SOFT),
    SOFT,
    like=MODEL_EDITED,
)
