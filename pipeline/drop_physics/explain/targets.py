"""Follows the targets of position motors, and the gaps left when a target changed.

A motor's law, off its limit, with e the position minus the target (`btMultiBodyJointMotor.cpp`):

    e' = (1 - kp) e + dt (kd v + (1 - kd) q̇_free)

so a target in effect for n steps at kd = 1 leaves (1 - kp)^n of the initial gap, plus a part due to
the target velocity v.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.joints import REST_STEPS, JointTelemetry, target_of
from drop_physics.trace.motors import POSITION, VELOCITY

KEYS = ("target", "target_velocity", "kp", "kd", "mode", "pd")
"""Settings that identify a target: two targets with equal values count as the same."""
STRAIGHT = 0.2
"""A joint trembles if its net displacement is less than this share of its path."""
SETTLED_STEPS, SETTLED = 60, 1e-3
"""A joint that stays within SETTLED [rad] or [m] over SETTLED_STEPS counts as at rest, even if it
bounces off its stop or creeps."""


@dataclass(frozen=True, eq=False)
class HeldTargets:
    """The targets of joints, m in all, each in effect for some steps; arrays have shape (m,)."""

    k: int
    """Index of the joint's rate among the rates of all joints."""
    first: Int64
    """The first sample after each target was set."""
    last: Int64
    row: Int64
    """Row of the target's last step in the current steps; -1 if it is not in them."""
    steps: Int64
    at_limit: Int64
    """Number of the target's steps in which the motor was at its limit."""
    target: Float64
    """The target as PyBullet uses it: clamped to the joint's limits."""
    gap: Float64
    """Position minus target after the last step."""
    before: Float64
    """Position minus target when the target was set."""
    lawful: Float64
    """The gap predicted by the motor's control law; nan if unknown."""
    kp: Float64
    rate: Float64
    """Mean rate over the last SETTLED_STEPS steps of the target, or over all if it had fewer; 0 for
    a joint that only trembles in place."""
    resting: Flags
    """Whether the joint came to rest while the target was in effect."""
    left: Flags
    """Whether calls reset the joint at the start of this target without setting the target again.
    """

    def __len__(self) -> int:
        """Return the number of targets."""
        return len(self.first)

    def only(self, which: Int64) -> HeldTargets:
        """Return the selected targets."""
        return HeldTargets(
            **{name: value if name == "k" else value[which] for name, value in vars(self).items()}
        )


@dataclass(eq=False)
class _OpenTarget:
    """The target of a joint that is still in effect."""

    key: Float64
    first: int
    last: int
    position: float
    """Position of the joint when the target was set."""
    at_limit: int
    placed: bool
    """Whether a call had reset the joint."""


class Targets:
    """The targets of one body, whose steps must be added in order."""

    def __init__(self) -> None:
        self._open: dict[int, _OpenTarget] = {}
        self._tail = np.empty((0, 0))
        """The last positions before the current steps."""
        self._tail_step = -1
        self._path = self._tail

    def see(self, driven: JointTelemetry) -> Iterator[tuple[HeldTargets, bool]]:
        """Yield the targets that ended in these steps, with False; those in effect, with True."""
        asked, steps = driven.asked, driven.steps
        target = target_of(driven)
        keys = np.stack([getattr(asked, name) for name in KEYS])
        keys[0] = target
        if len(self._tail) and steps.steps[0] != self._tail_step + 1:
            self._tail = self._tail[:0]
        came = np.concatenate((self._tail[-1:].reshape(-1, target.shape[1]), driven.after[:-1]))
        came = came if len(self._tail) else np.concatenate((driven.before[:1], came))
        put = steps.put[:, None] & (driven.before != came)
        self._path = np.concatenate((self._tail.reshape(-1, target.shape[1]), driven.after))
        for k in range(target.shape[1]):
            if np.isnan(target[:, k]).all() and k not in self._open:
                continue
            ended, going = self._of(driven, k, keys[:, :, k], put[:, k])
            if len(ended):
                yield ended, False
            if going is not None:
                yield going, True
        self._tail, self._tail_step = self._path[-SETTLED_STEPS:].copy(), int(steps.steps[-1])

    def _settled(self, stood: HeldTargets, end: int) -> Flags:
        """Return whether each joint hardly moved in the last `end` steps of its target."""
        settled = stood.resting.copy()
        for i in np.flatnonzero(~settled & (stood.steps >= SETTLED_STEPS)).tolist():
            last = len(self._path) - end + int(stood.row[i]) + 1
            path = self._path[max(last - SETTLED_STEPS, 0) : last, stood.k]
            settled[i] = len(path) == SETTLED_STEPS and np.ptp(path) < SETTLED
        return settled

    def _mean_rates(self, stood: HeldTargets, driven: JointTelemetry) -> Float64:
        """Return each joint's mean velocity in its target's last steps."""
        last = len(self._path) - len(driven.steps.steps) + stood.row
        count = np.minimum(np.minimum(stood.steps - 1, SETTLED_STEPS), last)
        path = self._path[:, stood.k]
        way, all_ways = path[last] - path[last - count], np.cumsum(np.abs(np.diff(path, prepend=0)))
        goes = np.abs(way) > STRAIGHT * (all_ways[last] - all_ways[last - count])
        time_s = np.maximum(count * driven.steps.reported.timestep_s[stood.row], 1e-300)
        return np.where(count > 0, np.where(goes, way / time_s, 0.0), stood.rate)

    def _of(
        self, driven: JointTelemetry, k: int, keys: Float64, put: Flags
    ) -> tuple[HeldTargets, HeldTargets | None]:
        ends = driven.steps.steps
        new = np.ones(len(ends), np.bool_)
        same = (keys[:, 1:] == keys[:, :-1]) | (np.isnan(keys[:, 1:]) & np.isnan(keys[:, :-1]))
        new[1:] = ~same.all(axis=0) | (np.diff(ends) != 1) | put[1:]
        held = self._open.pop(k, None)
        if held is not None and held.last + 1 == ends[0] and not put[0]:
            new[0] = not np.array_equal(held.key, keys[:, 0], equal_nan=True)
        begins = np.flatnonzero(new)
        rows = np.append(begins, len(ends))[1:] - 1
        position, total = driven.before[:, k], np.append(0, np.cumsum(driven.at_limit[:, k]))
        first, start = ends[begins], position[begins]
        counts = total[rows + 1] - total[begins]
        placed = put[begins]
        if not new[0]:  # the one that stood goes on
            assert held is not None
            until = begins[0] - 1 if len(begins) else len(ends) - 1
            rows = np.append(until, rows) if len(begins) else np.array([until])
            first, start = np.append(held.first, first), np.append(held.position, start)
            counts = np.append(total[until + 1] + held.at_limit, counts)
            placed = np.append(held.placed, placed)
        left = placed & (driven.asked.told[rows, k] < first - 1)
        found = _stood(driven, k, rows, first, start, counts, left)
        found = replace(
            found,
            resting=self._settled(found, len(ends)),
            rate=self._mean_rates(found, driven),
        )
        if np.isfinite(found.target[-1]):
            self._open[k] = _OpenTarget(
                keys[:, -1].copy(),
                int(first[-1]),
                int(ends[-1]),
                float(start[-1]),
                int(counts[-1]),
                bool(placed[-1]),
            )
        kept = np.isfinite(found.target)
        kept[-1] = False
        going = found.only(np.array([len(found) - 1])) if np.isfinite(found.target[-1]) else None
        return found.only(np.flatnonzero(kept)), going


def _stood(
    driven: JointTelemetry,
    k: int,
    rows: Int64,
    first: Int64,
    start: Float64,
    counts: Int64,
    left: Flags,
) -> HeldTargets:
    asked = driven.asked
    target, kp, kd, rate = (
        getattr(asked, name)[rows, k] for name in ("target", "kp", "kd", "target_velocity")
    )
    pd = asked.pd[rows, k] == 1
    law = driven.steps.law
    lower, upper = law.lower[k], law.upper[k]
    clipped = np.clip(target, lower, upper) if lower <= upper else target
    n = driven.steps.steps[rows] - first + 1
    timestep_s = driven.steps.reported.timestep_s[rows]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        remains = (1 - kp) ** n
        added = np.where(kp > 0, (1 - remains) / kp, n) * timestep_s * rate
    gap_law = remains * (start - clipped) + added
    sure = (kd == 1) & np.isnan(asked.max_velocity[rows, k]) & ~pd & driven.steps.covered
    aim = np.where(pd, asked.pd_target[rows, k], clipped)
    aim = np.where(np.isfinite(target_of(driven)[rows, k]), aim, np.nan)
    return HeldTargets(
        k=k,
        first=first,
        last=driven.steps.steps[rows],
        row=rows,
        steps=n,
        at_limit=counts,
        target=aim,
        gap=driven.after[rows, k] - aim,
        before=start - aim,
        lawful=np.where(sure, gap_law, np.nan),
        kp=kp,
        rate=driven.rate[rows, k],
        resting=driven.resting[rows, k] & (n >= REST_STEPS),
        left=left,
    )


def rings_with(kp: Float64, kd: Float64) -> Flags:
    """Return whether a motor's gains make its joint oscillate, or never arrive."""
    half, last = (2 - kp - kd) / 2, 1 - kd
    inside = half**2 - last
    with np.errstate(invalid="ignore"):
        root = np.sqrt(inside)
    low, high = half - root, half + root
    with np.errstate(invalid="ignore"):
        return np.asarray((kp > 0) & ((inside < -1e-12) | (low < -1e-9) | (high >= 1)))


def flips(driven: JointTelemetry) -> Flags:
    """Flag steps in which a motor's gains make its joint oscillate, shape (n, joint_rates)."""
    kp, kd = driven.asked.kp, driven.asked.kd
    position = rings_with(kp, kd) & (driven.asked.mode == POSITION) & (kp + kd > 2)
    velocity = (driven.asked.mode == VELOCITY) | (driven.asked.mode == POSITION)
    return np.asarray((position | velocity & (kd > 1)) & (driven.asked.pd != 1))
