"""States that are no numbers: from which step on, and which call or term was first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.rules.answer import Answer, Finding, Scene, Span
from drop_physics.rules.arguments import site_of
from drop_physics.rules.engines import ANY
from drop_physics.trace.calls import BODY_NAMES, Call
from drop_physics.trace.events import Body
from drop_physics.trace.log import Log

Float64 = NDArray[np.float64]


class NotFinite(Answer):
    """States that are no numbers."""

    engines = ANY

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._found: dict[int, tuple[int, str, Call | None]] = {}
        """The first step, the term that was first, and the call, by body."""

    def see(self) -> None:
        """Keep the first of each body."""
        suspects = {
            each.body.number
            for batch, _ in self.scene.batches
            if not all(np.isfinite(numbers).all() for numbers in _numbers(batch.whole))
            for each in batch.bodies
        }
        for judged, steps in self.scene.stretches(*sorted(suspects)) if suspects else ():
            number = judged.body.number
            if number in self._found:
                break
            wrong = np.zeros(len(steps), np.bool_)
            for numbers in _numbers(steps):
                wrong |= ~np.isfinite(numbers).all(axis=1)
            rows = np.flatnonzero(wrong)
            if not len(rows):
                continue
            row = int(rows[0])
            step = int(steps.steps[row])
            terms = [n for n, each in steps.terms.items() if not np.isfinite(each[row]).all()]
            call = _without_number(self.scene.piece.calls, judged.body, step)
            self._found[number] = step, terms[0] if len(terms) == 1 else "", call

    def findings(self) -> Iterator[Finding]:
        """Yield the first body of each simulation, one that a call names before others."""
        by_client: dict[int, list[int]] = {}
        for number in self._found:
            by_client.setdefault(self.scene.body(number).client, []).append(number)
        for numbers in by_client.values():
            first = min(numbers, key=lambda n: (self._found[n][0], self._found[n][2] is None))
            step, term, call = self._found[first]
            body = self.scene.body(first)
            why = Message(", first in the term {term}", term=term) if term else ""
            if call is not None:
                why = Message(
                    ": p.{function}({arguments}) was given it",
                    function=call.function,
                    arguments=call.arguments,
                )
            message = Message(
                "{body} has a state that is no number (nan or infinite) from step {step:,} on{why}",
                body=body.label,
                step=step,
                why=why,
            )
            yield Finding(
                code="not-finite",
                level="broken",
                message=message,
                body=body.label,
                share=1.0,
                bodies=len(numbers),
                steps=Span(step, step, 1),
                site=None if call is None else site_of(call),
            )


def _numbers(steps: Steps) -> Iterator[Float64]:
    """Yield the states after steps, and their impulses, which may be too large for a sum."""
    yield steps.after.velocity
    for name in ("position_m", "orientation", "joints"):
        yield getattr(steps.after, name)
    yield from steps.terms.values()


def _without_number(calls: Log, body: Body, step: int) -> Call | None:
    """Return the last call for a body, or for all, that was given a number that is none."""
    return next(
        (
            each
            for each in reversed([*calls])
            if each.client == body.client and each.at.step < step
            if not np.isfinite(each.numbers).all()
            if next(
                (each.values[name][0] for name in BODY_NAMES if name in each.values), body.number
            )
            == body.number
        ),
        None,
    )
