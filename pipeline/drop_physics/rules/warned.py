"""`auto-reset`, `not-finite`, `buffer-full`: warnings issued by the engine itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.messages import Message
from drop_physics.rules.answer import Cure, Effect, Span, so_many
from drop_physics.rules.engines import MUJOCOS
from drop_physics.rules.inputs import Inputs
from drop_physics.rules.memory import POSITION, RESETS, rate_at
from drop_physics.rules.rows import Said
from drop_physics.rules.rule import input_rule
from drop_physics.trace.calls import Call
from drop_physics.trace.events import EngineWarning
from drop_physics.trace.switches import NO_AUTO_RESET, is_off

CONTACTS, CONTROL = "contacts full", "bad control"


@input_rule("auto-reset", "broken", engines=MUJOCOS)
def auto_reset(inputs: Inputs) -> Iterator[Said]:
    """The engine resets the state by itself after a huge or non-finite number."""
    by_client: dict[int, list[EngineWarning]] = {}
    for warning in inputs.scene.seen.warnings:
        if warning.kind in RESETS:
            by_client.setdefault(warning.client, []).append(warning)
    for client, warnings in by_client.items():
        if is_off(inputs.scene.seen, client, NO_AUTO_RESET):
            continue
        first = min(warnings, key=lambda each: each.at.step)
        steps = sum(each.steps for each in warnings)
        of_rate = None if first.kind == POSITION else rate_at(inputs, client, first.info)
        body, joint, _ = of_rate or (None, None, "")
        number: str = Message("a position")
        if body is not None:
            number = Message("the acceleration of {what}", what=joint or body.label)
            if first.kind != "bad acceleration":
                number = Message("the velocity of {what}", what=joint or body.label)
        all_steps = inputs.scene.seen.samples.get(client, 1) - 1
        call = inputs.lasting.huge.get((client, first.at.step - 1))
        message = Message(
            "the state is reset in {steps} of {all:,}, first in step {first:,}: {number} was huge "
            "or no number{given}, and MuJoCo then starts again from the model's pose",
            steps=so_many(steps),
            all=all_steps,
            first=first.at.step,
            number=number,
            given="" if call is None else _given(call),
        )
        span = Span(first.at.step, max(each.last_step for each in warnings), steps)
        yield Said(
            call=call,
            subject=body,
            joint=joint,
            steps=span,
            message=message,
            effect=Effect(float(steps), "steps"),
            share=steps / all_steps,
        )


def _given(call: Call) -> Message:
    """Return the largest number among a call's arguments, or the non-finite one."""
    largest = float(call.numbers[int(np.argmax(np.abs(call.numbers)))])  # a nan before all others
    return Message(
        " after {function} was given {number:.4g}", function=call.function, number=largest
    )


@input_rule("not-finite", "broken", engines=MUJOCOS)
def bad_control(inputs: Inputs) -> Iterator[Said]:
    """A control is huge or not a number, so that no actuator acts in that step."""
    for warning in inputs.scene.seen.warnings:
        if warning.kind == CONTROL:
            yield Said(
                steps=Span(warning.at.step, warning.last_step, warning.steps),
                message=Message(
                    "ctrl[{index}] is huge or no number in {steps}, first in step {first:,}, and "
                    "MuJoCo then takes 0 for all controls",
                    index=warning.info,
                    steps=so_many(warning.steps),
                    first=warning.at.step,
                ),
                advice=Message(
                    "look for what the script divides by 0, or takes a root or arccos of"
                ),
                effect=Effect(float(warning.steps), "steps"),
                share=float(warning.steps),
            )


@input_rule("buffer-full", "broken", engines=MUJOCOS)
def buffer_full(inputs: Inputs) -> Iterator[Said]:
    """Contacts or constraints without room in memory do not act."""
    for warning in inputs.scene.seen.warnings:
        if warning.kind not in (CONTACTS, "constraints full"):
            continue
        message = Message(
            "{what} are left out in {steps} from step {first:,} on, because the memory of the "
            "model is full: what they would hold falls or passes through",
            what=Message("contacts") if warning.kind == CONTACTS else Message("constraints"),
            steps=so_many(warning.steps),
            first=warning.at.step,
        )
        span = Span(warning.at.step, warning.last_step, warning.steps)
        yield Said(
            steps=span,
            message=message,
            cure=Cure("memory"),
            effect=Effect(float(warning.steps), "steps"),
            share=float(warning.steps),
        )
