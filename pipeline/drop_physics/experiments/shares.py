"""Computes each cause's share of a result, from runs without the causes.

A part is the outcome minus its value with that cause alone switched off; the total is the outcome
minus its value with all of them off; the difference between total and parts is their interaction.
The timestep is switched off by halving it twice and Richardson's extrapolation, if the outcome
converges with an order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.experiments.refinement import richardson, solution_order
from drop_physics.experiments.robustness import LEAST_ORDER, MOST_ORDER
from drop_physics.experiments.run_distance import Apart, Track

FINER = (1, 2, 4)
"""Numbers of engine steps per script step, from which results are extrapolated to a timestep of
zero."""
SMALL = 1e-2
"""Parts below this share of the largest part are left out."""
INTERACT = 0.1
"""Largest interaction, as a share of the largest part: beyond it, one cause stands for another, and
no share can be attributed."""
TIMESTEP = "timestep"


@dataclass(frozen=True)
class Coordinate:
    """One number of a result: a joint's final position, or a base's along an axis."""

    body: str
    joint: str | None
    unit: str
    axis: int

    @property
    def name(self) -> str:
        """Display name of the number."""
        return self.joint or f"{self.body} {'xyz'[self.axis]}"

    def of(self, run: Apart) -> tuple[float, float, float] | None:
        """Return the number's final value in a run and in the unchanged run, and the time [s]."""
        track = next((each for each in run.tracks if self._is_of(each)), None)
        if track is None:
            return None
        return float(track.theirs[self.axis]), float(track.last[self.axis]), track.end_s

    def _is_of(self, track: Track) -> bool:
        return (track.body, track.joint, track.unit) == (self.body, self.joint, self.unit)


@dataclass(frozen=True)
class Shares:
    """One number of a result, as a sum over its causes."""

    quantity: str
    """Description of the number: a joint, or a body and an axis, at the end of the run."""
    unit: str
    """`m` or `rad`."""
    total: float
    """The number minus its value with all causes switched off."""
    parts: dict[str, float]
    """The number minus its value with one cause switched off, by cause; the largest first."""
    interaction: float
    """Interaction of the causes: the total minus the sum of the parts."""


def coordinate_of(trials: Mapping[str, Apart], noise: Mapping[str, float]) -> Coordinate | None:
    """Return the number that trials move most, if by more than chance.

    Parameters
    ----------
    trials
        Distances of the run without a cause, by cause.
    noise
        Distance by which a nudge moves the outcome, by unit.
    """
    found: dict[Coordinate, float] = {}
    for run in trials.values():
        for track in run.tracks:
            off = np.abs(track.theirs - track.last)
            if len(off) == 4 or not np.isfinite(off).all():  # a quaternion has no such numbers
                continue
            axis = int(np.argmax(off))
            if off[axis] > 100 * noise.get(track.unit, 0.0):
                each = Coordinate(track.body, track.joint, track.unit, axis)
                found[each] = max(found.get(each, 0.0), float(off[axis]))
    return max(found, key=lambda each: found[each], default=None)


def shares_of(
    coordinate: Coordinate,
    alone: Mapping[str, Apart],
    together: Mapping[int, Apart],
    finer: Mapping[int, Apart],
) -> Shares | None:
    """Return each cause's share; None if fewer than two causes have one.

    Also None if a run is missing, or ends at another time.

    Parameters
    ----------
    coordinate
        The number to attribute to causes.
    alone
        Distances of the run with only one cause switched off, by cause.
    together
        Distances of the run with all causes switched off, by number of engine steps per script
        step.
    finer
        Distances of the run with only a finer timestep, by number of engine steps per script step.
    """
    ends = {name: coordinate.of(run) for name, run in alone.items()}
    whole = {by: coordinate.of(run) for by, run in together.items()}
    timed = {by: coordinate.of(run) for by, run in finer.items()}
    known = [*ends.values(), *whole.values(), *timed.values()]
    times = {each[2] for each in known if each is not None}
    if None in known or len(times) != 1 or not ends:
        return None
    own = next(each[1] for each in known if each is not None)
    parts = {name: own - end[0] for name, end in ends.items() if end is not None}
    limit = _limit({1: own, **{by: each[0] for by, each in timed.items() if each}})
    none = _limit({by: each[0] for by, each in whole.items() if each})
    if limit is not None and none is not None:
        parts[TIMESTEP] = own - limit
    elif 1 in whole and whole[1] is not None:
        none = whole[1][0]
    most = max(map(abs, parts.values()))
    parts = {name: part for name, part in parts.items() if abs(part) > SMALL * most}
    if none is None or len(parts) < 2:
        return None
    total = own - none
    ordered = dict(sorted(parts.items(), key=lambda each: -abs(each[1])))
    interaction = total - sum(parts.values())
    if abs(interaction) > INTERACT * most:
        return None
    return Shares(coordinate.name, coordinate.unit, total, ordered, interaction)


def _limit(ends: Mapping[int, float]) -> float | None:
    """Extrapolate a result to a timestep of 0; None if it does not converge."""
    if any(by not in ends for by in FINER):
        return None
    values = [ends[by] for by in FINER]
    order = solution_order([1 / by for by in FINER], values)
    if order is None or not LEAST_ORDER <= order <= MOST_ORDER:
        return None
    return richardson(values[1], values[2], ratio=2.0, order=order)
