"""Curves of a recording, for plots and the viewer: joints, friction, and energy by cause."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.causes import CAUSES, OF_REPLAYS, family
from drop_physics.explain.contact_points import Pairs
from drop_physics.explain.joints import JointTelemetry, target_of
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.step_status import SampleStatus
from drop_physics.explain.times import StepTimes
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import POSITION, VELOCITY

POINTS = 2000
"""Maximum number of points of a curve: more than a screen has pixels."""
NUMBERS = 1 << 20
"""Maximum number of points of all bodies together, for one kind of curve."""
FORCES = (*CAUSES[1:], *OF_REPLAYS)
"""The causes that change energy."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Several curves over the same n samples."""

    steps: Int64
    """Step of each value, shape (n,)."""
    columns: dict[str, Float64]
    """Values by name, shape (n,), or for joints (n, joint_rates); nan where undefined."""

    @staticmethod
    def of(parts: Sequence[Curves], names: Iterable[str]) -> Curves:
        """Concatenate consecutive curves; a name missing from one of them is 0 there."""
        columns = {
            name: np.concatenate(
                [part.columns.get(name, np.zeros(len(part.steps))) for part in parts]
            )
            for name in names
        }
        return Curves(np.concatenate([part.steps for part in parts]), columns)


class CurveTable:
    """The curves of all bodies, filled chunk by chunk; long curves keep every k-th step."""

    def __init__(self, seen: Seen, times: Mapping[int, StepTimes]) -> None:
        self._times = {
            number: times[body.client]
            for number, body in seen.bodies.items()
            if body.client in times
        }
        points = min(POINTS, NUMBERS // max(1, len(seen.bodies)))
        self._every = 1 + max(seen.samples.values(), default=0) // points
        self._parts: dict[tuple[str, int, int], list[Curves]] = {}
        self._given: dict[int, Float64] = {}
        """Cumulative energy given by each of FORCES, by body."""
        self._start_j: dict[int, float] = {}

    def add(
        self,
        explained: ExplainedPiece,
        joints: Mapping[int, Sequence[JointTelemetry]],
        pairs: Pairs,
    ) -> None:
        """Add a chunk, with the telemetry of its joints by body id and its contact points."""
        for number, judged in explained.bodies.items():
            self._energy(number, judged)
        for number, found in joints.items():
            for driven in found:
                self._joint(number, driven)
        self._friction(pairs)

    def times_s(self, body: int, steps: Int64) -> Float64:
        """Return the times of the steps of a body [s]."""
        return self._times[body].of_all(steps)

    def joints(self, body: int) -> Curves | None:
        """Return a body's `position`, `target`, `rate`, `target_rate`, `torque` and `limit`."""
        return self._whole("joints", body)

    def energy(self, body: int) -> Curves | None:
        """Return the change of a body's energy since its first sample [J]: `whole`, by cause."""
        return self._whole("energy", body, names=(*FORCES, "whole", "set"))

    def friction(self, body: int, other: int) -> Curves | None:
        """Return friction `used` and `available` between two bodies [N]."""
        return self._whole("friction", *sorted((body, other)))

    def _whole(
        self, kind: str, body: int, other: int = -1, *, names: Iterable[str] = ()
    ) -> Curves | None:
        parts = self._parts.get((kind, body, other))
        return None if parts is None else Curves.of(parts, names or parts[0].columns)

    def _keep(self, key: tuple[str, int, int], steps: Int64, columns: dict[str, Float64]) -> None:
        due = steps % self._every == 0
        self._add(key, steps[due], {name: values[due] for name, values in columns.items()})

    def _add(self, key: tuple[str, int, int], steps: Int64, columns: dict[str, Float64]) -> None:
        if len(steps):
            self._parts.setdefault(key, []).append(Curves(steps, columns))

    def _joint(self, number: int, driven: JointTelemetry) -> None:
        asked = driven.asked
        turns = (asked.mode == VELOCITY) & (asked.impulse > 0)
        columns = {
            "position": driven.after,
            "target": target_of(driven),
            "rate": driven.rate,
            "target_rate": np.where(turns, asked.target_velocity, np.nan),
            "torque": driven.torque,
            "limit": np.where(turns | (asked.mode == POSITION), driven.limit, np.nan),
        }
        parts = self._parts.get(("joints", number, -1))
        if parts is None or parts[0].columns["rate"].shape[1] == driven.rate.shape[1]:
            self._keep(("joints", number, -1), driven.steps.steps, columns)

    def _energy(self, number: int, judged: SampleStatus) -> None:
        for steps in judged.intervals:
            changes = steps.changes
            start_j = self._start_j.setdefault(number, changes.begin_j)
            so_far = self._given.setdefault(number, np.zeros(len(FORCES)))
            due = steps.steps % self._every == 0
            given = np.tile(so_far, (int(due.sum()), 1))
            causes: dict[int, Float64] = {}
            for cause, each in changes.energy_j.items():
                k = FORCES.index(family(cause))
                causes[k] = causes[k] + each if k in causes else each
            for k, each in causes.items():
                gave = np.cumsum(each) + so_far[k]
                given[:, k], so_far[k] = gave[due], gave[-1]
            columns = {name: given[:, k] for k, name in enumerate(FORCES) if given[:, k].any()}
            columns["whole"] = changes.after_j[due] - start_j
            # The rest was set by calls between two steps.
            columns["set"] = columns["whole"] - given.sum(axis=1)
            self._add(("energy", number, -1), steps.steps[due], columns)

    def _friction(self, pairs: Pairs) -> None:
        for first, second, rows in pairs.by_pair(pairs.acts):
            columns = {
                "used": np.linalg.norm(pairs.tangential_n[rows], axis=1),
                "available": pairs.available_n[rows],
            }
            self._keep(("friction", first, second), pairs.step[rows], columns)
