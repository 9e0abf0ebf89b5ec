"""The ledger of a body: impulse and work of each term over time, in bins of steps.

A bin is one step while the recording is short; when the bins no longer fit, pairs are merged. So
memory does not grow with a recording, and any window has its mean forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from drop_physics.account.terms import DRAG, Impulses, Term
from drop_physics.arrays import Float64, Int64
from drop_physics.explain.steps import BodySteps
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import States, Tree

MOST_BINS = 1 << 10
"""Maximum number of bins of a ledger."""
NUMBERS = 1 << 23
"""Maximum number of values in all ledgers together, if each body has TERMS terms."""
TERMS = 8
COVERED = 0.98
"""Minimum share of explained steps in a window for its mean forces to be reported; works, which
accumulate, need all steps."""

OWN = Term("own inertia")
"""The momentum taken up by the rate itself."""
OTHERS = Term(DRAG, "others")
"""The term for inertia that couples a rate to the acceleration of all others."""


def bins_for(freedoms: int) -> int:
    """Return the number of bins for each body's ledger, so that memory stays bounded."""
    most = NUMBERS // max(1, 2 * TERMS * freedoms)
    return max(64, min(MOST_BINS, 1 << max(0, most.bit_length() - 1)))


@dataclass(eq=False)
class Ledger:
    """Impulse and work of each term on one body; row i sums up `width` steps from `first` on."""

    tree: Tree
    first: int
    """The sample after the body's first step."""
    bins: int
    """Maximum number of bins; an even number."""
    width: int = 1
    """Number of steps per bin."""
    last: int = -1
    """The last sample of the body, explained or not."""
    counts: Int64 = field(init=False)
    """Number of explained steps in each bin, shape (bins,)."""
    seconds: Float64 = field(init=False)
    """Total time of these steps [s], shape (bins,)."""
    way: Float64 = field(init=False)
    """Path: sum over the steps of mean generalised velocity times timestep, shape (bins, size)."""
    gained: Float64 = field(init=False)
    """Sum over the steps of the change of the generalised velocity, shape (bins, size)."""
    ends: States = field(init=False)
    """A state for each bin: the one after its last step."""
    impulse: dict[Term, Float64] = field(default_factory=dict)
    """Impulses [N s, N m s], shape (bins, size) each."""
    work: dict[Term, Float64] = field(default_factory=dict)
    """Impulse times mean velocity [J], shape (bins, size) each."""

    def __post_init__(self) -> None:
        size, joints = self.tree.size, self.tree.joint_coordinates
        self.counts, self.seconds = np.zeros(self.bins, np.int64), np.zeros(self.bins)
        self.way, self.gained = np.zeros((2, self.bins, size))
        self.ends = States(
            position_m=np.zeros((self.bins, 3)),
            orientation=np.tile([0.0, 0.0, 0.0, 1.0], (self.bins, 1)),
            joints=np.zeros((self.bins, joints)),
            velocity=np.zeros((self.bins, size)),
        )

    def add(self, steps: BodySteps, impulses: Impulses) -> None:
        """Add steps and the impulses of each term; unexplained steps are skipped.

        `impulses` are the impulses of each term in all n steps, shape (n, size) each.
        """
        while (int(steps.steps[-1]) - self.first) // self.width >= self.bins:
            self._widen()
        closing = np.flatnonzero(steps.closes)
        if not len(closing):
            return
        rows = closing if len(closing) < len(steps) else slice(None)  # which copies nothing
        at = (steps.steps[rows] - self.first) // self.width
        timestep_s = steps.reported.timestep_s[rows]
        before, after = steps.before.velocity[rows], steps.after.velocity[rows]
        mean = 0.5 * (before + after)
        np.add.at(self.counts, at, 1)
        np.add.at(self.seconds, at, timestep_s)
        np.add.at(self.way, at, mean * timestep_s[:, None])
        np.add.at(self.gained, at, after - before)
        last = np.flatnonzero(np.diff(at, append=at[-1] + 1))
        for name in ("position_m", "orientation", "joints", "velocity"):
            getattr(self.ends, name)[at[last]] = getattr(steps.after, name)[closing[last]]
        for term, impulse in impulses.items():
            its = impulse[rows]
            for kept, values in ((self.impulse, its), (self.work, its * mean)):
                if term not in kept:
                    kept[term] = np.zeros((self.bins, self.tree.size))
                np.add.at(kept[term], at, values)

    def _widen(self) -> None:
        """Merge pairs of bins, to halve the resolution."""
        half, rest = self.bins // 2, self.bins - self.bins // 2

        def summed(values: Float64) -> Float64:
            pairs = values.reshape(half, 2, *values.shape[1:]).sum(axis=1)
            return np.concatenate((pairs, np.zeros((rest, *values.shape[1:]), values.dtype)))

        odd = self.counts[1::2] > 0
        for name in ("position_m", "orientation", "joints", "velocity"):
            column = getattr(self.ends, name)
            column[:half] = np.where(odd[:, None], column[1::2], column[::2])
        for name in ("counts", "seconds", "way", "gained"):
            setattr(self, name, summed(getattr(self, name)))
        for kept in (self.impulse, self.work):
            for term in kept:
                kept[term] = summed(kept[term])
        self.width *= 2

    def window(self, first: int, last: int) -> slice:
        """Return the bins that contain the steps from sample `first` to sample `last`."""
        low = max(0, (first - self.first) // self.width)
        return slice(low, max(low, (last - self.first) // self.width) + 1)

    def covers(self, window: slice, share: float = 1.0) -> bool:
        """Return whether at least the given share of a window's steps is explained."""
        steps = self.last - self.first + 1
        low, high = window.start * self.width, min(window.stop * self.width, steps)
        return low < high and bool(self.counts[window].sum() >= share * (high - low))

    def forces(self, rate: int, window: slice, sign: float = 1.0) -> dict[Term, float]:
        """Return each term's mean force along a rate over a window [N] or [N m], times `sign`.

        Inertial forces are included: the rate's own inertia, and the drag of other rates'
        acceleration through the mass matrix. Empty where steps of the window are not explained.
        """
        seconds = float(self.seconds[window].sum())
        if not seconds or not self.covers(window, COVERED):
            return {}
        found = {
            term: sign * float(values[window, rate].sum()) / seconds
            for term, values in self.impulse.items()
        }
        gained = self.gained[window].sum(axis=0)
        row = -self._at_middle(window)[rate] * gained / seconds * sign
        found[OWN] = float(row[rate])
        row[rate] = 0.0
        base = self.tree.first_rate
        if base and rate >= base:
            found[Term(DRAG)] = float(row[:base].sum())
            row[:base] = 0.0
        found |= {Term(DRAG, rate=int(k)): float(row[k]) for k in np.flatnonzero(row)}
        return {term: force for term, force in found.items() if force}

    def works(self, rates: Sequence[int], window: slice) -> dict[Term, Float64]:
        """Return each term's work along the given rates in each bin of a window [J].

        The inertia that couples them to all other rates is included. Empty where steps of the
        window are not explained.
        """
        if not self.covers(window):
            return {}
        found = {term: values[window, rates].sum(axis=1) for term, values in self.work.items()}
        if self.tree.links and len(rates) < self.tree.size:
            found[OTHERS] = self._gained_j(rates, window) - sum(found.values())
        return {term: values for term, values in found.items() if values.any()}

    def mean_kinetic_j(self, rates: Sequence[int], window: slice) -> float:
        """Return the kinetic energy of a window's mean motion along the given rates [J]."""
        seconds = float(self.seconds[window].sum())
        if not seconds:
            return 0.0
        block = self._at_middle(window)[np.ix_(rates, rates)]
        mean = self.way[window][:, rates].sum(axis=0) / seconds
        return float(0.5 * mean @ block @ mean)

    def _gained_j(self, rates: Sequence[int], window: slice) -> Float64:
        """Return the gain of kinetic energy along the given rates in each bin of a window [J].

        With u the rates after a bin, and M their block of the mass matrix there, it is
        ½ u·M u - ½ (u - Δu)·M (u - Δu).
        """
        block = self._inertias[window][:, rates][:, :, rates]
        after = self.ends.velocity[window][:, rates]
        before = after - self.gained[window][:, rates]
        return np.asarray(
            0.5 * np.einsum("nij,ni,nj->n", block, after, after)
            - 0.5 * np.einsum("nij,ni,nj->n", block, before, before)
        )

    @cached_property
    def _inertias(self) -> Float64:
        """The mass matrix at the end of each bin, shape (bins, size, size); 0 for empty bins."""
        found = np.zeros((self.bins, self.tree.size, self.tree.size))
        known = np.flatnonzero(self.counts)
        found[known] = mass_matrix(kinematics(self.tree, self.ends.at(known)))
        return found

    def _at_middle(self, window: slice) -> Float64:
        """Return the mass matrix at the middle of a window, shape (size, size)."""
        known = np.flatnonzero(self.counts[window]) + window.start
        middle = known[[len(known) // 2]]
        return np.asarray(mass_matrix(kinematics(self.tree, self.ends.at(middle)))[0])


def given_and_taken(works: Mapping[Term, Float64]) -> tuple[dict[Term, float], dict[Term, float]]:
    """Split works into energy given and energy taken [J]; terms of either sign are in both.

    A term whose net work is below a tenth of its gross work has both: its net would hide it.
    """
    gave: dict[Term, float] = {}
    took: dict[Term, float] = {}
    for term, values in works.items():
        size = max(1, len(values) // 50)
        parts = np.add.reduceat(values, np.arange(0, len(values), size)) if len(values) else values
        net, plus, minus = parts.sum(), parts[parts > 0].sum(), parts[parts < 0].sum()
        if abs(net) > 0.1 * (plus - minus):
            plus, minus = max(net, 0.0), min(net, 0.0)
        if plus > 0:
            gave[term] = float(plus)
        if minus < 0:
            took[term] = float(minus)
    return gave, took
