"""Compares runs by their recorded states alone, if no step can be repeated; proves no cause."""

from __future__ import annotations

import numpy as np

from drop_physics.compare.paired import columns_of, farthest, moving_alone, paired_bodies
from drop_physics.compare.pairing import pairing
from drop_physics.experiments.swap.answer import Class, End, ProvedDifference
from drop_physics.experiments.swap.cause import alone
from drop_physics.experiments.swap.first import first_apart
from drop_physics.explain.times import StepTimes
from drop_physics.stages.diff.by_calls import steps_of
from drop_physics.stages.diff.sides import RunSide
from drop_physics.trace.swaps import Common


def answered_by_samples(a: RunSide, b: RunSide, tolerance: float) -> ProvedDifference:
    """Return the last step up to which two runs agree, and their first difference.

    Raises
    ------
    RecordingError
        If a run has no step.
    """
    mine, theirs = a.recording.seen, b.recording.seen
    lengths = steps_of(a), steps_of(b)
    count = min(lengths)
    pairs = pairing(mine, theirs)
    both = [(mine.bodies[number], pairs.bodies[number]) for number in pairs.common]
    bodies = paired_bodies(mine, theirs, both, count)
    times_s = StepTimes(mine, 0).of_all(np.arange(1, lengths[0] + 1))
    common = Common(("", ""), lengths, (times_s, times_s), columns_of(bodies))
    first = first_apart(common, tolerance)
    moves = moving_alone(mine, theirs, both)
    if first is None and any(moves.values()):
        return ProvedDifference(lengths, count - 1, 0.0, None, None, alone(moves))
    if first is None:
        cls: Class = "none" if len({*lengths}) == 1 else "length"
        return ProvedDifference(lengths, count - 1, float(times_s[count - 1]), None, cls)
    end = farthest(bodies, count - 1)
    until_s = float(times_s[first.step - 1]) if first.step else 0.0
    end_apart = End(end.value, end.unit, end.body)
    return ProvedDifference(lengths, first.step - 1, until_s, first, None, end=end_apart)
