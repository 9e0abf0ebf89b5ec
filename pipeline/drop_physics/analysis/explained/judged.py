"""What each sample of a body is: the kind of step that led to it, or why nothing explains it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.explained.steps import EXPLAINED, WITHOUT_SUM, Steps
from drop_physics.analysis.general import segments
from drop_physics.laws.bullet_tree import Reason
from drop_physics.seen.events import Body

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Int8 = NDArray[np.int8]
Flags = NDArray[np.bool_]

Segment = Literal[
    "set", "unexplained", "still", "pushed", "constrained", "contact", "driven", "flight"
]
SEGMENTS: tuple[Segment, ...] = get_args(Segment)
"""The first that applies to a sample."""
(SET, UNEXPLAINED, STILL, PUSHED, CONSTRAINED, CONTACT, DRIVEN, FLIGHT) = range(len(SEGMENTS))

ALONE = {segments.FLIGHT: FLIGHT, segments.CONTACT: CONTACT, segments.PUSHED: PUSHED}
"""What the law of a body alone calls a step, and what it is here."""

Why = Reason | Literal["not finite", "before the recording", "remainder"]
WHYS: tuple[Why, ...] = (*get_args(Reason), "not finite", "before the recording", "remainder")
"""Why a sample is unexplained: what the law says, from settings, before what was only seen."""


@dataclass(frozen=True, eq=False)
class Judged:
    """One body in a piece; arrays have one row per sample, shape (n,)."""

    body: Body
    steps: Int64
    segment: Int8
    """Indices into SEGMENTS."""
    kind: Int8
    """What acted in the step that led to it, whether calls had set its start or not: indices into
    SEGMENTS; SET where no step did."""
    why: Int8
    """Indices into WHYS; -1 where it is explained."""
    unexplained: Float64
    """The remainder of the step that led to it, over the largest term; 0 where none did."""
    stretches: Sequence[Steps]
    """The steps that led to samples, in order, each under constant settings."""

    @property
    def explained(self) -> Flags:
        """Whether each sample is explained."""
        return np.asarray(self.segment != UNEXPLAINED)


def judged(
    body: Body, sampled: Int64, stretches: Sequence[Steps], *, soft_there: bool = False
) -> Judged:
    """Return what each of some samples is; `soft_there`: whether there are soft bodies."""
    segment, kind = np.full((2, len(sampled)), SET, np.int8)
    why = np.full(len(sampled), -1, np.int8)
    unexplained = np.zeros(len(sampled))
    for steps in stretches:
        rows = np.searchsorted(sampled, steps.steps)
        reasons = _whys(steps, body, soft_there=soft_there)
        # What another law explains has no sum, and what sleeps need not close it.
        other = (reasons < 0) & ~(steps.unexplained <= EXPLAINED)
        why[rows], unexplained[rows] = reasons, np.where(other, 0.0, steps.unexplained)
        kind[rows] = _kinds(steps)
        held = np.where(steps.put, SET, kind[rows])
        segment[rows] = np.where(reasons >= 0, UNEXPLAINED, held)
    return Judged(body, sampled, segment, kind, why, unexplained, stretches)


def _kinds(steps: Steps) -> Int8:
    """Return what acted in each step."""
    kinds = np.full(len(steps), FLIGHT, np.int8)
    for code, kind in ALONE.items():
        if steps.alone is not None:
            kinds[steps.alone == code] = kind
    for kind, names in (
        (DRIVEN, ("motors",)), (CONTACT, ("contacts", "rolling")), (CONSTRAINED, ("constraints",)),
        (PUSHED, ("applied",)),
    ):  # fmt: skip
        for name in names:
            if name in steps.terms:
                kinds[steps.terms[name].any(axis=1)] = kind
    kinds[_same(steps)] = STILL
    return kinds


def _same(steps: Steps) -> Flags:
    """Return where nothing moved: the same state, to the bit, without velocity."""
    before, after = steps.before, steps.after
    moved = before.velocity.any(axis=1) | after.velocity.any(axis=1)
    for name in ("position_m", "orientation", "joints"):
        moved |= (getattr(before, name) != getattr(after, name)).any(axis=1)
    return np.asarray(~moved)


def _whys(steps: Steps, body: Body, *, soft_there: bool) -> Int8:
    """Return why each step is unexplained; -1 where it is explained."""
    why = np.full(len(steps), -1, np.int8)
    off = ~(steps.unexplained <= EXPLAINED)
    reasons = steps.epoch.reasons if steps.law.tree.size else ()  # what cannot move needs none
    outright = next((each for each in reasons if each in WITHOUT_SUM), None)
    if outright is not None:
        followed = np.zeros(len(steps), np.bool_)
        if steps.alone is not None:
            followed = np.isin(steps.alone, [*ALONE])
        why[~followed & ~_same(steps)] = WHYS.index(outright)
        return why
    if "asleep" in reasons:  # nothing acts on what sleeps
        off &= ~_same(steps)
    why[off] = WHYS.index("before the recording" if body.before else "remainder")
    finite = np.isfinite(steps.remainder).all(axis=1)
    for reason, holds in (
        ("not finite", ~finite), ("soft", soft_there), ("constraint", steps.unknown),
        *((each, True) for each in reversed(reasons)),
    ):  # fmt: skip
        why[off & holds] = WHYS.index(reason)
    if not steps.epoch.cone_friction:  # a torque that is not reported may hide what is wrong
        rolls = np.zeros(len(steps), np.bool_)
        rolls[steps.reported.contacts.step[steps.reported.contacts.rolling]] = True
        why[rolls] = WHYS.index("rolling unreported")
    return why
