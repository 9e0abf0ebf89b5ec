"""What the findings on a drop are drawn from, and what each of them is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drop_physics.analysis.answers.answer import Effect, Finding, Level, Span
from drop_physics.analysis.drop.case import Case
from drop_physics.analysis.drop.landing import Path
from drop_physics.analysis.drop.phases import Phases
from drop_physics.analysis.drop.results import Bounce, Impact, Landing, Moment, Rest
from drop_physics.messages import Message


@dataclass(frozen=True)
class Evidence:
    """What the findings are drawn from: the case and the results of its analysis."""

    case: Case
    phases: Phases
    mismatch_step: int | None
    """First sample that the law covers and does not lead to."""
    clamped_step: int | None
    """First sample at which a velocity is clamped to Bullet's limit."""
    moment: Moment | None
    """The sample whose error is broken down first."""
    landing: Landing | None
    impact: Impact | None
    tumbled_step: int | None
    bounces: list[Bounce]
    rest: Rest | None
    law: Path | None
    """The path by the contact law, where that covers the drop."""


LEVEL_OF: dict[str, Level] = {
    "law-mismatch": "broken", "tunnelled": "broken",
    "no-gravity": "asked", "not-stepped": "asked", "no-floor": "asked",
    "starts-in-contact": "asked", "velocity-clamped": "asked", "bounce-swallowed": "asked",
    "default-damping": "model", "no-damping-in-maximal-coordinates": "model",
    "refining-hurts": "model", "deep-penetration": "model", "restitution-inflated": "model",
    "rest-below-expected": "model", "tumbled": "note", "still-airborne": "note",
}  # fmt: skip


def found(
    code: str,
    message: str,
    advice: str | None = None,
    *,
    metres: float | None = None,
    case: Case | None = None,
    first: int | None = None,
) -> Finding:
    """Return a finding about the body; `metres` are ranked by its size, `first` is a step."""
    size_m = max(case.engine.reach_m, 1e-12) if case is not None else math.inf
    return Finding(
        code=code,
        level=LEVEL_OF[code],
        message=message,
        advice=advice,
        effect=None if metres is None else Effect(abs(metres), "m"),
        share=0.0 if metres is None else abs(metres) / size_m,
        steps=None if first is None else Span(first, first, 1),
    )


def shorten_step(case: Case, *, times: int | None = None) -> Message:
    """Return the advice to shorten the timestep, and how many times at least."""
    if times is not None and case.is_bullet:
        return Message(
            "shorten the step {times} times: p.setTimeStep, i.e. --timestep", times=times
        )
    if times is not None:
        return Message("shorten the step {times} times with --timestep", times=times)
    if case.is_bullet:
        return Message("shorten the step with p.setTimeStep, i.e. --timestep")
    return Message("shorten the step with --timestep")
