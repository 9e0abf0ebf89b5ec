"""Rows for states that an engine reset by itself: what acted before the first reset."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drop_physics.account.asked import DRIVES, axes_of
from drop_physics.account.ledger import OWN
from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import DRAG
from drop_physics.account.words import RowWords
from drop_physics.messages import Message
from drop_physics.trace.history import Seen

RESETS = "bad velocity", "bad acceleration"
"""Warnings after which an engine resets the state, and which name a degree of freedom."""
BASE_RATES = 6
BEFORE = 3
"""Number of the ledger's bins before a reset whose mean forces are reported."""
INERTIAL = DRAG, "bias", OWN.cause
"""Causes that are not forces: the inertia of a rate, and its coupling to other rates."""


def engine_reset_rows(subject: MeasuredBody, seen: Seen, words: RowWords) -> Iterator[AccountRow]:
    """Yield a row for the degree of freedom because of which the engine first reset the state."""
    warnings = [
        each for each in seen.warnings if each.kind in RESETS and each.client == subject.body.client
    ]
    first = min(warnings, key=lambda each: each.at.step, default=None)
    rate = None if first is None else _rate_of(subject, seen, first.info)
    if first is None or rate is None:
        return
    ledger, axes = subject.ledger, {each.rate: each for each in axes_of(subject, words)}
    axis = axes.get(rate)
    unit = ("N m" if rate < BASE_RATES // 2 else "N") if axis is None else axis.force_unit
    step = first.at.step
    last = (step - ledger.first) // ledger.width  # the bin of the step that is not explained
    window = slice(max(0, last - BEFORE), last)
    forces = ledger.forces(rate, window)
    sign = float(np.sign(-forces.get(OWN, 0.0))) or 1.0
    acting = {term: sign * each for term, each in forces.items() if term.cause not in INERTIAL}
    terms = words.terms(subject, acting, unit, drives=DRIVES)
    if not terms:
        return
    count = sum(each.steps for each in warnings)
    mean = words.mean(subject, rate, window)
    yield AccountRow(
        kind="set",
        joint=None if axis is None else axis.name,
        told=Message(
            "the engine resets the state in {count:,} steps, first in step {step:,}; before that "
            "these forces act {mean}",
            count=count,
            step=step,
            mean=mean or Message("on average"),
        ),
        got=float(count),
        unit="steps",
        step=step,
        terms=terms,
        mean=mean,
        salience=1.2,
        subject=subject.body,
    )


def _rate_of(subject: MeasuredBody, seen: Seen, index: int) -> int | None:
    """Return the index in a body's generalised velocity of an engine's degree of freedom.

    None if the degree of freedom belongs to another body. In u the angular velocity of a free base
    comes first.
    """
    body, at = seen.freedom(subject.body.client, index) or (None, 0)
    if body is None or body.number != subject.body.number:
        return None
    base = BASE_RATES if body.base_moves else 0
    return at if at >= base else (at + base // 2) % base
