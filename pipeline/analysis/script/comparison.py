"""Are two recordings of scripts the same physics? If not: what differs first, and why.

Inputs such as masses, settings and pushes count until a sample differs: from there on they may be
a reaction to the difference, in a script that controls by what it measures. Calls are reported, but
only their effects count. What is not recorded, such as how soft bodies move, is not compared:
nothing with such a body is the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.analysis.drop.comparison import Setting
from pipeline.analysis.script.aligned import aligned
from pipeline.analysis.script.cause import (
    OtherCall,
    Side,
    cause,
    cause_of_images,
    other_call,
    versions,
)
from pipeline.analysis.script.difference import INPUT, LED, Dated, Difference, When
from pipeline.analysis.script.input_differences import input_differences
from pipeline.analysis.script.likeness import STATES_ARE_THE_SAME, looks_like
from pipeline.analysis.script.sample_differences import (
    Paired,
    allowed,
    first_contact,
    first_end,
    first_joint,
    first_state,
    paired,
)
from pipeline.messages import Message
from pipeline.seen import Call, Seen


@dataclass(frozen=True)
class ScriptComparison:
    """How two recordings of scripts compare."""

    differences: list[Difference]
    """Inputs that differed before any sample did: bodies, settings, masses, pushes …"""
    versions: list[Setting]
    """The versions that made them, where these differ: not a difference in physics."""
    first: Difference | None
    """The first difference; None where there is none."""
    call_before: Call | None
    """The last call before the first difference."""
    other_call: OtherCall | None
    """The first call that differs from golden's; None where none does."""
    largest_difference_m: float | None
    """Between the positions, over all samples that both have; None where they share none."""
    looks_like: str | None
    """How far apart bodies are."""
    cause: str | None
    """Why they differ: another script, other calls, another engine."""
    samples_part_at: int | None
    """The first step with a sample that is not the same to the bit."""
    not_compared: list[str]
    """Bodies whose motion is not recorded, or not that of all links: soft bodies, and links that
    PyBullet does not show. Without a difference elsewhere the two are then neither the same nor
    different."""

    @property
    def same(self) -> bool:
        """Whether it is the same physics."""
        return self.first is None and not self.not_compared


def compare_scripts(run: Side, golden: Side, *, tolerance_m: float = 0.0) -> ScriptComparison:
    """Compare the recording of a script with the golden one.

    Parameters
    ----------
    run, golden
        The two recordings.
    tolerance_m
        Allowed difference in motion [m]; 0 means bit for bit, and then also in joints and contact
        points.
    """
    golden = replace(golden, seen=aligned(golden.seen, run.seen))
    of = paired(run.seen, golden.seen)
    state = first_state(of)
    others = [first_joint(of, run.seen, golden.seen), first_contact(run.seen, golden.seen)]
    end = first_end(run.seen, golden.seen)
    parted = _earliest(state, end, *others)
    inputs = sorted(
        (
            dated
            for dated in input_differences(run.seen, golden.seen)
            if _is_before(dated[0], parted)
        ),
        key=lambda dated: dated[0],
    )
    exact = state
    if tolerance_m:
        state, others = first_state(of, allowed(of, golden.seen, tolerance_m)), []
    earliest = _earliest(*inputs, state, end, *others)
    call = other_call(run.seen.calls, golden.seen.calls)
    differences = [difference for _, difference in inputs]
    made = list(versions(run, golden))
    first = before = why = like = None
    if earliest is not None:
        when, first = earliest
        counts = call is not None and not call.moved and _is_before(call.when, parted)
        before = _call_before(run.seen, when, first)
        why = cause(
            run, golden, first=first, call=call if counts else None, inputs=differences, made=made
        )
        like = looks_like(of, None if state is None else state[1])
        if state is None and exact is not None:
            like = Message("every state that both have is within the tolerance")
    return ScriptComparison(
        differences=differences,
        versions=made,
        first=first,
        call_before=before,
        other_call=call,
        largest_difference_m=_largest_m(of),
        looks_like=like,
        cause=why,
        samples_part_at=None if parted is None else parted[0].step,
        not_compared=list(dict.fromkeys([*_not_seen(run.seen), *_not_seen(golden.seen)])),
    )


def with_images(
    comparison: ScriptComparison, run: Side, golden: Side, *, step: int, both: bool
) -> ScriptComparison:
    """Say why images differ in two recordings where nothing else does.

    Parameters
    ----------
    comparison
        Of all but the images: the same to the bit.
    run, golden
        The two recordings.
    step
        That of the first image that differs.
    both
        Whether both took it.
    """
    call = comparison.other_call
    counts = call is not None and not call.moved and call.when.step <= step
    why = cause_of_images(
        run,
        golden,
        call=call if counts else None,
        made=comparison.versions,
        missing=None if both else step,
    )
    return replace(comparison, looks_like=STATES_ARE_THE_SAME, cause=why)


def _not_seen(seen: Seen) -> Iterator[str]:
    """Yield the labels of bodies whose motion is not recorded, or not that of all links."""
    for body in seen.bodies.values():
        if body.soft or body.hides_links:
            yield body.label


def _earliest(*differences: Dated | None) -> Dated | None:
    return min(filter(None, differences), key=lambda dated: dated[0], default=None)


def _is_before(when: When, parted: Dated | None) -> bool:
    return parted is None or when < parted[0]


def _call_before(run: Seen, when: When, first: Difference) -> Call | None:
    """Return the last call that can have caused it."""
    clients = {body.client for body in run.bodies.values() if body.label == first.body}
    for call in reversed(run.calls):
        if clients and call.client not in clients:
            continue
        if when.phase == INPUT and call.at.call > when.call:
            continue
        if call.at.step < when.step or (call.at.step == when.step and when.phase != LED):
            return call
    return None


def _largest_m(of: Paired) -> float | None:
    distance_m = of.distance_m[np.isfinite(of.distance_m)]
    return float(distance_m.max()) if len(distance_m) else None
