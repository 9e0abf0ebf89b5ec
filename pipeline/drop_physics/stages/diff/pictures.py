"""Counts the differing images of two runs that were recorded only as digests."""

from __future__ import annotations

from typing import NamedTuple

from drop_physics.recording.reader import Recording
from drop_physics.trace.acts import PICTURE


class PicturesApart(NamedTuple):
    """The differing images of two runs: their number, and the first one."""

    differing: int
    of: int
    first_step: int
    """Number of steps before the first image that differs."""
    site: str
    """The script line that drew the first differing image."""


def pictures_apart(a: Recording, b: Recording, until: int | None) -> PicturesApart | None:
    """Count the differing images drawn before the states differ; None if no image differs.

    Parameters
    ----------
    a, b
        The recordings.
    until
        The first step after which states differ; None if they never do.
    """
    mine, theirs = (each.seen.calls.named(PICTURE) for each in (a, b))
    both = [
        (x, y) for x, y in zip(mine, theirs, strict=False) if until is None or x.at.step <= until
    ]
    apart = [x for x, y in both if x.numbers != y.numbers]
    if not apart:
        return None
    return PicturesApart(len(apart), len(both), apart[0].at.step, apart[0].site.place)
