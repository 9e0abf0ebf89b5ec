"""The table of position targets for rules, each over the steps in which it was in effect."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64
from drop_physics.explain.joints import DrivenJoints, JointTelemetry
from drop_physics.explain.targets import HeldTargets, Targets
from drop_physics.rules.body_properties import size_m
from drop_physics.rules.joint import AT_TARGET, holds_off, units_of
from drop_physics.rules.thresholds import HALF_THE_STEPS
from drop_physics.trace.history import Seen


class StandingTargets:
    """The targets of position motors over chunks, and a table of each target in effect."""

    def __init__(self) -> None:
        self._targets: dict[int, Targets] = {}
        """Targets by body id."""
        self.going: dict[tuple[int, int], TargetColumns] = {}
        """The table of the target in effect, by body and rate."""

    def see(
        self, driven: JointTelemetry, seen: Seen, telemetry: DrivenJoints
    ) -> Iterator[TargetColumns]:
        """Yield the targets of a body that ended in the latest chunk, and those in effect."""
        targets = self._targets.setdefault(driven.body.number, Targets())
        for stood, going in targets.see(driven):
            key = driven.body.number, stood.k
            before = self.going.pop(key, None)
            # Where what a body is changes, a target ends that nobody saw end.
            if before is not None and before.stood.first[0] != stood.first[0]:
                before.ended, before.late = np.ones(1, np.bool_), True
                yield before
            table = TargetColumns(seen, telemetry, driven, stood, going=going)
            if going:
                self.going[key] = table
            yield table

    def left(self) -> Iterator[TargetColumns]:
        """Yield the targets that are still in effect when the run ends."""
        for table in self.going.values():
            table.late, table.ends_run = True, np.ones(1, np.bool_)
            yield table


class TargetColumns:
    """The targets of one joint, in order; columns of shape (m,)."""

    def __init__(
        self,
        seen: Seen,
        telemetry: DrivenJoints,
        driven: JointTelemetry,
        stood: HeldTargets,
        *,
        going: bool,
    ) -> None:
        self.driven, self.stood = driven, stood
        m, number = len(stood), driven.body.number
        self.step = stood.last
        self.keys = np.tile([number, stood.k], (m, 1))
        self.noted: Mapping[str, Float64] = {"site": driven.asked.site[stood.row, stood.k]}
        self.ended = np.full(m, not going)
        self.ends_run = np.zeros(m, np.bool_)
        """Whether each target was in effect at the last of its body's steps."""
        self.late = False
        """Whether the targets were set in earlier steps, and rules have already examined them."""
        self.off = np.abs(stood.gap)
        unit, _ = units_of(driven, stood.k)
        self.least = AT_TARGET[unit]
        """Gap below which the joint counts as at its target [rad] or [m]."""
        self.kd = driven.asked.kd[stood.row, stood.k]
        self.at_rest = driven.resting[stood.row, stood.k]
        """Whether the joint is at rest at the end of each target, shape (m,)."""
        share = self.off if unit == "rad" else self.off / size_m(driven.body)
        self.numbers: Mapping[str, NDArray[Any]] = {
            "off": self.off,
            "target": stood.target,
            "share": share,
            "kp": stood.kp,
            "limit": driven.limit[stood.row, stood.k],
            "force": driven.asked.force[stood.row, stood.k],
            "most": driven.asked.max_velocity[stood.row, stood.k],
            "stood": np.column_stack([stood.first, stood.last]),
            "weak": stood.at_limit > HALF_THE_STEPS * stood.steps,
        }
        """Values that the texts of every rule may name, by name."""
        self.stopped = self._stopped()
        """Whether each target ends with the motor at its limit, blocked by a body that touches the
        robot's links."""
        self.pressed = self._pressed(seen, telemetry)
        """Whether each target ends with the joint pressing against a body."""

    @cached_property
    def reached(self) -> Flags:
        """Flag the targets that the joint reached before they changed noticeably."""
        steps = np.abs(np.diff(self.stood.target))
        changed = np.append(0.0, np.cumsum(steps))[: len(self.stood)]
        alike = np.floor(changed / self.least)
        return np.isin(alike, alike[self.off <= self.least])

    def _stopped(self) -> Flags:
        stood, steps, rows, k = self.stood, self.driven.steps, self.stood.row, self.stood.k
        if not steps.covered:
            return np.zeros(len(stood), np.bool_)
        rate = steps.law.tree.first_rate + k
        motor, contacts = (steps.terms[name][rows, rate] for name in ("motors", "contacts"))
        against = -contacts * np.sign(motor)
        stopped = self.driven.at_limit[rows, k] & (against > HALF_THE_STEPS * np.abs(motor))
        return np.asarray(stopped & (rows >= 0))

    def _pressed(self, seen: Seen, telemetry: DrivenJoints) -> Flags:
        for at in np.flatnonzero(self.stopped)[:1].tolist():
            row, k = int(self.stood.row[at]), self.stood.k
            away = -float(np.sign(self.driven.torque[row, k]))
            if holds_off(seen, telemetry.holding(self.driven, row), k, away):
                return self.stopped
        return np.zeros(len(self.stood), np.bool_)
