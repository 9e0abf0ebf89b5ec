"""Are two recordings of scripts the same physics? If not: what differs first, and why.

What goes into a simulation, such as masses, settings and pushes, counts as far as no sample differs
yet: from there on it may be an answer to the difference, of a script that steers by what it sees.
Calls are told, and do not count: what they did to the world does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.analysis.drop.comparison import Setting
from pipeline.analysis.script.cause import (
    OtherCall,
    Side,
    cause,
    cause_of_images,
    other_call,
    versions,
)
from pipeline.analysis.script.difference import LED, TOLD, Difference, Found, When
from pipeline.analysis.script.likeness import STATES_ARE_THE_SAME, looks_like
from pipeline.analysis.script.sample_differences import (
    Faced,
    allowed,
    faced,
    first_contact,
    first_joint,
    first_state,
)
from pipeline.analysis.script.told_differences import told_differences
from pipeline.seen import Call, Seen


@dataclass(frozen=True)
class ScriptComparison:
    """What two recordings of scripts have in common."""

    differences: list[Difference]
    """What went in otherwise before any sample differed: bodies, settings, masses, pushes …"""
    versions: list[Setting]
    """What made them; a version is no difference in physics."""
    first: Difference | None
    """What differs first; None where nothing does."""
    call_before: Call | None
    """The last call before what differs first."""
    other_call: OtherCall | None
    """The first call that is not golden's; None where all are."""
    largest_difference_m: float | None
    """Between the positions, over all samples that both have; None where they share none."""
    looks_like: str | None
    """How far apart bodies are."""
    cause: str | None
    """Why they differ: another script, other calls, another engine."""
    samples_part_at: int | None
    """The first step of which a sample is not the same to the bit."""

    @property
    def same(self) -> bool:
        """Whether it is the same physics."""
        return self.first is None


def compare_scripts(run: Side, golden: Side, *, tolerance_m: float = 0.0) -> ScriptComparison:
    """Compare the recording of a script with the golden one.

    Parameters
    ----------
    run, golden
        The two recordings.
    tolerance_m
        Difference that is let pass in what moves [m]; 0 is bit for bit, and then joints and contact
        points are held to it too.
    """
    of = faced(run.seen, golden.seen)
    state = first_state(of)
    others = [first_joint(of, run.seen, golden.seen), first_contact(run.seen, golden.seen)]
    parted = _earliest(state, *others)
    told = sorted(
        (one for one in told_differences(run.seen, golden.seen) if _is_before(one[0], parted)),
        key=lambda one: one[0],
    )
    if tolerance_m:
        state, others = first_state(of, allowed(of, golden.seen, tolerance_m)), []
    found = _earliest(*told, state, *others)
    call = other_call(run.seen.calls, golden.seen.calls)
    differences = [one for _, one in told]
    made = list(versions(run, golden))
    first = before = why = like = None
    if found is not None:
        when, first = found
        counts = call is not None and not call.moved and _is_before(call.when, parted)
        before = _call_before(run.seen, when, first)
        why = cause(
            run, golden, first=first, call=call if counts else None, told=differences, made=made
        )
        like = looks_like(of, None if state is None else state[1])
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
    )


def with_images(found: ScriptComparison, run: Side, golden: Side, *, step: int) -> ScriptComparison:
    """Say why an image differs, first that of a step, in two recordings of which nothing else does.

    Parameters
    ----------
    found
        What was compared but the images: all is the same to the bit.
    run, golden
        The two recordings.
    step
        That of the first image that differs.
    """
    call = found.other_call
    counts = call is not None and not call.moved and call.when.step <= step
    why = cause_of_images(run, golden, call=call if counts else None, made=found.versions)
    return replace(found, looks_like=STATES_ARE_THE_SAME, cause=why)


def _earliest(*found: Found | None) -> Found | None:
    return min((one for one in found if one is not None), key=lambda one: one[0], default=None)


def _is_before(when: When, parted: Found | None) -> bool:
    return parted is None or when < parted[0]


def _call_before(run: Seen, when: When, first: Difference) -> Call | None:
    """Return the last call that can have had to do with it."""
    clients = {body.client for body in run.bodies.values() if body.label == first.body}
    for call in reversed(run.calls):
        if clients and call.client not in clients:
            continue
        if when.phase == TOLD and call.at.call > when.call:
            continue
        if call.at.step < when.step or (call.at.step == when.step and when.phase != LED):
            return call
    return None


def _largest_m(of: Faced) -> float | None:
    distance_m = of.distance_m[np.isfinite(of.distance_m)]
    return float(distance_m.max()) if len(distance_m) else None
