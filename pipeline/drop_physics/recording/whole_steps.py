"""Finds the last complete step of an unfinished recording, which may end within a step.

Rows are written in groups. The order within a group is: calls, preceded by the call sites that they
refer to, then the series of each body, the states of bases, and the replay frames. A simulation is
therefore complete up to the end of the last group that has all of these parts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from drop_physics.recording import columns, schema
from drop_physics.recording.sampled import RecordedSamples
from drop_physics.recording.steps import RecordedSteps
from drop_physics.trace.events import Appearance, Body

NONE, LAST = -1, 2**62
"""Step numbers that mean before the first step, and after all steps."""
BASE = -1
"""Link number of a body's base."""


def last_whole_step(
    sampled: RecordedSamples,
    steps: RecordedSteps,
    appearances: Sequence[Appearance],
    *,
    efforts: bool,
) -> int:
    """Return the last complete step of an unfinished recording; -1 if there is none.

    Parameters
    ----------
    sampled, steps
        The recording's samples, and its replay frames.
    appearances
        The events in which its bodies appeared.
    efforts
        Whether the engine reports efforts of joints.
    """
    bodies = {appearance.body.number: appearance.body for appearance in appearances}
    appeared = {appearance.body.number: appearance.at.step for appearance in reversed(appearances)}
    newest_of, whole = [NONE], [*_unknown_calls(sampled)]
    for client in {body.client for body in bodies.values()}:
        own = [body for body in bodies.values() if body.client == client]
        parts = [*_joints(sampled, own, efforts=efforts), *_others(sampled, steps, client, own)]
        newest = max((end for _, ends in parts for end in ends), default=NONE)
        before = max((end for _, ends in parts for end in ends if end < newest), default=NONE)
        newest_of.append(newest)
        for of, ends in parts:
            last = max(ends, default=NONE)
            # What has ended earlier is gone, as a body that was removed; or it has not begun.
            has_begun = min(appeared[number] for number in of) < newest
            if last == before or (last == NONE and has_begun):
                whole.append(before)
    return min(max(newest_of), *whole, LAST)


Part = tuple[list[int], list[int]]
"""Body ids that a part of a simulation concerns, and the last steps of its groups of rows."""


def _joints(sampled: RecordedSamples, bodies: Sequence[Body], *, efforts: bool) -> Iterator[Part]:
    """Yield the last steps for which joint states were written."""
    moving = [body for body in bodies if any(any(joint.widths) for joint in body.joints)]
    for body, of in product(moving, schema.OF_JOINTS if efforts else schema.OF_JOINTS[:-1]):
        yield [body.number], _series(sampled, body, of)


def _others(
    sampled: RecordedSamples, steps: RecordedSteps, client: int, bodies: Sequence[Body]
) -> Iterator[Part]:
    """Yield the last steps with constraint forces, base states, and replay frames."""
    all_of = [body.number for body in bodies]
    for entity, held in sampled.entities.items():
        if entity.startswith(f"{schema.CONSTRAINTS}/{client}_"):
            yield all_of, held.last
    if bases := [body.number for body in bodies if BASE in body.moving]:
        yield bases, [*_states(sampled, bases)]
    if steps.models:
        yield all_of, steps.ends(client)


def _series(sampled: RecordedSamples, body: Body, of: str) -> list[int]:
    held = sampled.entities.get(f"{schema.JOINTS}/{body.label}/{of}")
    return [] if held is None else held.last


def _states(sampled: RecordedSamples, bodies: Sequence[int]) -> Iterator[int]:
    for chunk in sampled.chunks(schema.STATES.entity, 0, sampled.last + 1):
        rows = columns.rows(chunk, schema.STATES, sampled.path)
        own = np.isin(rows["body"], bodies)
        if own.any():
            yield int(rows["step"][own].max())


def _unknown_calls(sampled: RecordedSamples) -> Iterator[int]:
    """Yield the step of the first call whose script line is not described, if any."""
    for chunk in sampled.chunks(schema.CALLS, 0, sampled.last + 1):
        calls = columns.calls(chunk, sampled.path)
        unknown = ~np.isin(calls.sites, [*sampled.sites])
        if unknown.any():
            yield int(calls.steps[unknown].min()) - 1
