"""Rules about warnings of the engine itself: `auto-reset`, `buffer-full`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Span, so_many
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.indexed import rate_at
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.memory import POSITION, RESETS
from drop_physics.rules.rows import Case, Remedy, SayingRow
from drop_physics.rules.rule import input_rule
from drop_physics.trace.calls import Call
from drop_physics.trace.events import EngineWarning
from drop_physics.trace.history import Seen
from drop_physics.trace.switches import NO_AUTO_RESET, is_off

CONTACTS, CONSTRAINTS = "contacts full", "constraints full"


@input_rule("auto-reset", "broken", engines=MUJOCOS)
def auto_reset(inputs: Inputs, seen: Seen) -> Iterator[Case]:
    """The engine resets the state by itself after a huge or non-finite number."""
    by_client: dict[int, list[EngineWarning]] = {}
    for warning in seen.warnings:
        if warning.kind in RESETS:
            by_client.setdefault(warning.client, []).append(warning)
    for client, warnings in by_client.items():
        if is_off(seen, client, NO_AUTO_RESET):
            continue
        first = min(warnings, key=lambda each: each.at.step)
        steps = sum(each.steps for each in warnings)
        of_rate = None if first.kind == POSITION else rate_at(seen, client, first.info)
        body, joint, _ = of_rate or (None, None, "")
        number: str = Message("a position")
        if body is not None:
            number = Message("the acceleration of {what}", what=joint or body.label)
            if first.kind != "bad acceleration":
                number = Message("the velocity of {what}", what=joint or body.label)
        all_steps = seen.steps_of(client)
        call = inputs.lasting.huge.get((client, first.at.step - 1))
        yield Case(
            call=call,
            subject=body,
            span=Span(first.at.step, max(each.last_step for each in warnings), steps),
            values={
                "joint": joint,
                "count": steps,
                "steps": so_many(steps),
                "all": all_steps,
                "first": first.at.step,
                "number": number,
                "given": "" if call is None else _given(call),
                "part": steps / all_steps,
            },
        )


auto_reset.rows(
    SayingRow(
        says=Message(
            "the state is reset in {steps} of {all:,}, first in step {first:,}: {number} was huge "
            "or no number{given}, and MuJoCo then starts again from the model's pose"
        ),
        effect="count",
        unit="steps",
        share="part",
    )
)


def _given(call: Call) -> Message:
    """Return the largest number among a call's arguments, or a non-finite one."""
    largest = float(call.numbers[int(np.argmax(np.abs(call.numbers)))])  # a nan before all others
    return Message(
        " after {function} was given {number:.4g}", function=call.function, number=largest
    )


def warned(seen: Seen, *kinds: str) -> Iterator[Case]:
    """Yield the engine's warnings of given kinds, with their steps."""
    for each in seen.warnings:
        if each.kind in kinds:
            told = {"kind": each.kind, "index": each.info, "first": each.at.step}
            told |= {"count": each.steps, "steps": so_many(each.steps)}
            yield Case(span=Span(each.at.step, each.last_step, each.steps), values=told)


IN_STEPS = SayingRow(effect="count", unit="steps", share="count")


@input_rule("buffer-full", "broken", engines=MUJOCOS)
def buffer_full(seen: Seen) -> Iterator[Case]:
    """Contacts or constraints without room in memory do not act."""
    for case in warned(seen, CONTACTS, CONSTRAINTS):
        is_contacts = case["kind"] == CONTACTS
        case.values["what"] = Message("contacts") if is_contacts else Message("constraints")
        yield case


buffer_full.rows(
    SayingRow(
        says=Message(
            "{what} are left out in {steps} from step {first:,} on, because the memory of the "
            "model is full: what they would hold falls or passes through"
        ),
        cure=Remedy("memory"),
    ),
    like=IN_STEPS,
)
