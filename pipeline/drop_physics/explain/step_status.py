"""Determines for each sample the kind of step before it, or why that step is unexplained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from drop_physics.arrays import Flags, Float64, Int8, Int64
from drop_physics.explain import segments
from drop_physics.explain.steps import SUBSTEPS, WITHOUT_SUM, BodySteps, Steps
from drop_physics.physics.moving import moved_on
from drop_physics.physics.step_law import Reason, StepLaw
from drop_physics.trace.events import Body

Segment = Literal[
    "set", "unexplained", "still", "pushed", "constrained", "contact", "driven", "flight"
]
SEGMENTS: tuple[Segment, ...] = get_args(Segment)
"""The segments of samples, in order of precedence."""
(SET, UNEXPLAINED, STILL, PUSHED, CONSTRAINED, CONTACT, DRIVEN, FLIGHT) = range(len(SEGMENTS))

ALONE = {segments.FLIGHT: FLIGHT, segments.CONTACT: CONTACT, segments.PUSHED: PUSHED}
"""Segments of the single-body law (`segments`), and the corresponding segments in this module."""

Unsolved = Literal[
    "nothing moves",
    "integrator",
    "version",
    "flex",
    "plugin",
    "plastic",
    "sleep",
    "delay",
    "auto-reset",
    "stale",
    "unknown",
    "not replayed",
    "not asked",
    "another engine",
]
"""Reason why a replayed step has no sum (`trace.events.REPLAYS`)."""
Why = Reason | Literal["timestep", "not finite", "before the recording", "remainder"] | Unsolved
WHYS: tuple[Why, ...] = (
    *get_args(Reason),
    "timestep",
    "not finite",
    "before the recording",
    "remainder",
    *get_args(Unsolved),
)
"""Reasons why samples are unexplained: first those of the law, then those found in the data."""


@dataclass(frozen=True, eq=False)
class SampleStatus:
    """Kind of step or reason for each of a body's n samples in a chunk, shape (n,) each."""

    body: Body
    steps: Int64
    segment: Int8
    """Indices into SEGMENTS."""
    kind: Int8
    """Kind of the step before the sample, as index into `SEGMENTS`, even if calls had set the
    step's initial state; `SET` if there was no step, or the body only kept a velocity that a call
    had set."""
    why: Int8
    """Indices into WHYS; -1 if the sample is explained."""
    unexplained: Float64
    """Ratio of the remainder to the largest term of the preceding step; 0 if there was no step."""
    intervals: Sequence[BodySteps]
    """The steps before the samples, in order, divided into intervals of constant settings."""

    @property
    def explained(self) -> Flags:
        """True if each sample is explained."""
        return np.asarray(self.segment != UNEXPLAINED)


@dataclass(frozen=True, eq=False)
class StepVerdicts:
    """The explained steps of a batch, and the reasons for the others; shape (n,) each."""

    kind: Int8
    why: Int8
    unexplained: Float64
    """Ratio of the remainder to the largest term; 0 if another law explains the step, or the body
    sleeps."""
    put: Flags
    """Whether calls had set the initial state of the step."""

    @staticmethod
    def of(steps: Steps, law: StepLaw, *, before: bool, soft_there: bool) -> StepVerdicts:
        """Judge steps by an engine's integration rule.

        `before`: whether the bodies existed before the recording began; `soft_there`: whether the
        simulation has soft bodies.
        """
        why = _whys(steps, law, before=before, soft_there=soft_there)
        # Another law's step has no sum, and that of a sleeping body need not close.
        other = (why < 0) & ~steps.closes
        return StepVerdicts(_kinds(steps), why, np.where(other, 0.0, steps.unexplained), steps.put)

    @cached_property
    def segment(self) -> Int8:
        """Kinds of the steps, as indices into `SEGMENTS`."""
        held = np.where(self.put, SET, self.kind)
        return np.where(self.why >= 0, UNEXPLAINED, held).astype(np.int8)


def judged(
    body: Body, sampled: Int64, intervals: Sequence[tuple[BodySteps, StepVerdicts]]
) -> SampleStatus:
    """Return the status of a body's samples, from the verdicts on its steps."""
    segment, kind = np.full((2, len(sampled)), SET, np.int8)
    why = np.full(len(sampled), -1, np.int8)
    unexplained = np.zeros(len(sampled))
    for steps, verdict in intervals:
        rows, its = np.searchsorted(sampled, steps.steps), steps.rows
        why[rows], unexplained[rows] = verdict.why[its], verdict.unexplained[its]
        kind[rows] = verdict.kind[its]
        segment[rows] = verdict.segment[its]
    return SampleStatus(
        body, sampled, segment, kind, why, unexplained, [each for each, _ in intervals]
    )


def _kinds(steps: Steps) -> Int8:
    """Return the kind of each step, from the causes that act in it."""
    kinds = np.full(len(steps), FLIGHT if steps.law.tree.size else SET, np.int8)
    if steps.alone is not None and not steps.covered:
        for code, kind in ALONE.items():
            kinds[steps.alone == code] = kind
    for kind, names in (
        (DRIVEN, ("motors",)),
        (CONTACT, ("contacts", "rolling")),
        (CONSTRAINED, ("constraints",)),
        (PUSHED, ("applied",)),
    ):
        for name in names:
            if name in steps.terms:
                kinds[steps.terms[name].any(axis=1)] = kind
    if steps.covered:  # pushes that cancel count, too
        applied = steps.reported.applied
        acts = applied.force_n.any(axis=1) | applied.torque_n_m.any(axis=1)
        kinds[applied.step[acts]] = PUSHED
    kinds[stands(steps)] = STILL
    return kinds


def stands(steps: Steps) -> Flags:
    """Flag the steps in which nothing moved: bitwise equal states, without velocity."""
    before, after = steps.before, steps.after
    moved = before.velocity.any(axis=1) | after.velocity.any(axis=1)
    for name in ("position_m", "orientation", "joints"):
        moved |= (getattr(before, name) != getattr(after, name)).any(axis=1)
    return np.asarray(~moved)


def _whys(steps: Steps, law: StepLaw, *, before: bool, soft_there: bool) -> Int8:
    """Return the reason why each step is unexplained; -1 where it is explained."""
    why = np.full(len(steps), -1, np.int8)
    same, reasons = stands(steps), steps.config.reasons
    outright = next((each for each in reasons if each in WITHOUT_SUM), None)
    off = ~steps.closes
    if not steps.law.tree.size:  # it moves only by a velocity that a call gave it
        outright, off = "massless", off & ~same
    elif outright is not None:
        off = ~(_followed(steps) | same)
    else:
        if steps.substeps == 1:  # with several, `closes` covers the pose, too
            timestep_s, most_rad = steps.reported.timestep_s, law.most_turn_rad
            off |= ~moved_on(steps.law.tree, steps.before, steps.after, timestep_s, most_rad)
        if steps.alone is not None:  # in flight to the bit, as the law of a body alone is
            off |= (_kinds(steps) == FLIGHT) & (steps.alone != segments.FLIGHT)
            off &= ~_followed(steps)
        if "asleep" in reasons:  # nothing acts on what sleeps
            off &= ~same
    finite = np.isfinite(
        np.hstack(
            [
                getattr(state, name)
                for state in (steps.before, steps.after)
                for name in ("position_m", "orientation", "joints", "velocity")
            ]
        )
    ).all(axis=1)
    timestep_s = steps.reported.timestep_s
    timely = (timestep_s >= law.least_timestep_s) & np.isfinite(timestep_s)
    rest: Why = SUBSTEPS if steps.substeps > 1 else "remainder"
    why[off] = WHYS.index("before the recording" if before else rest)
    for reason, holds in (
        ("soft", soft_there),
        ("constraint", steps.unknown),
        *((each, True) for each in reversed(reasons)),
        *([(outright, True)] if outright is not None else []),
        ("not finite", ~finite),
    ):
        why[off & holds] = WHYS.index(reason)
    if steps.law.tree.size:
        why[~timely] = WHYS.index("timestep")
    if not steps.config.cone_friction:  # an unreported torque may hide an error
        rolls = np.zeros(len(steps), np.bool_)
        rolls[steps.reported.contacts.step[steps.reported.contacts.rolling]] = True
        why[rolls] = WHYS.index("rolling unreported")
    return why


def _followed(steps: Steps) -> Flags:
    """Flag the steps that a single body's law explains."""
    if steps.alone is None:
        return np.zeros(len(steps), np.bool_)
    return np.isin(steps.alone, [*ALONE])
