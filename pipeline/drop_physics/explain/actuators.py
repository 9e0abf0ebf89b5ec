"""Summarizes the actuators of a recording: control, force, and number of steps at a limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.driving import control_of
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.steps import BodySteps
from drop_physics.trace.events import FORCE, LENGTH, Actuator, Body
from drop_physics.trace.history import Piece, Seen

AT_LIMIT = 1 - 1e-6
"""Share of its force range above which an actuator counts as at its limit."""


@dataclass(frozen=True, kw_only=True)
class ActuatorRow:
    """An actuator at the last sample, with counts over the whole recording."""

    name: str
    """The name in the model."""
    kind: str
    """`motor`, `position`, `velocity`, `muscle` or `general`."""
    acts_on: str
    """`joint`, `tendon`, `site`, `slider-crank` or `body`."""
    target: str
    """Name of the joint, tendon, site, slider-crank or body."""
    given: float | None
    """Control set by the script in the last step."""
    ctrl_range: tuple[float, float] | None
    """Range to which the control is clamped; null without a range."""
    beyond_range_steps: int
    """Number of steps in which the control was outside its range."""
    length: float | None
    """Length of the actuator's transmission at the last step, before the gear ratio; for a joint
    its position [rad or m]; null if unknown."""
    force: float | None
    """Force in the last step [N] or [N m], before the gear ratio; null if unknown."""
    moments: dict[str, float]
    """Moment arm on each joint on which the actuator acts: force [N] or torque [N m] on the joint
    per unit of the actuator's force; empty without a force."""
    force_range: tuple[float, float] | None
    """Range to which the force is clamped; null without a range."""
    at_force_limit_steps: int
    """Number of steps in which the force was at a limit of its range."""
    energy_j: float
    """Energy that the actuator gave to the body."""


@dataclass
class _Sums:
    """Running sums for one actuator."""

    given: float = np.nan
    force: float = np.nan
    on_joints: Float64 = field(default_factory=lambda: np.empty(0))
    """Force on each rate of the joints in the last step [N] or [N m]."""
    most: float = 0.0
    """Largest magnitude of the control so far."""
    beyond: int = 0
    at_limit: int = 0
    energy_j: float = 0.0


class ActuatorTable:
    """The table of all actuators, filled chunk by chunk."""

    def __init__(self) -> None:
        self._sums: dict[tuple[int, int], _Sums] = {}
        """Sums by body id and actuator index."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
        for judged in explained.bodies.values():
            for steps in judged.intervals if judged.body.actuators else ():
                for actuator in judged.body.actuators:
                    if len(steps):
                        self._add(actuator, steps, explained.piece)

    def rows(self, body: Body, seen: Seen) -> Sequence[ActuatorRow]:
        """Return the actuators of a body of a recording."""
        lengths, forces = (
            {name: answer.last for name, answer in seen.measured(kind, body.client).items()}
            for kind in (LENGTH, FORCE)
        )
        return [
            self._row(
                body, each, length=lengths.get(each.name), force=forces.get(each.name, np.nan)
            )
            for each in body.actuators
        ]

    def sends(self, body: Body) -> bool:
        """Return whether a position servo of a body ever had a command other than 0."""
        places = (actuator.number for actuator in body.actuators if actuator.kind == "position")
        return any(self._sums[body.number, place].most for place in places)

    def _add(self, actuator: Actuator, steps: BodySteps, piece: Piece) -> None:
        sums = self._sums.setdefault((steps.body.number, actuator.number), _Sums())
        given = control_of(actuator, steps.body, piece, steps.steps)
        sums.given = float(given[-1])
        sums.most = max(sums.most, float(np.nan_to_num(np.abs(given)).max()))
        if actuator.ctrl_range is not None:
            low, high = actuator.ctrl_range
            sums.beyond += int(((given < low) | (given > high)).sum())
        name = f"actuator {actuator.name}"
        if steps.covered:
            impulse = steps.terms.get(name, np.zeros_like(steps.remainder))[-1]
            exerted = impulse / steps.reported.timestep_s[-1]
            sums.on_joints = exerted[steps.law.tree.first_rate :].copy()
        sums.energy_j += float(steps.changes.energy_j.get(name, np.zeros(1)).sum())
        force = _force(actuator, steps, name)
        if force is not None:
            sums.force = float(force[-1])
            if actuator.force_range is not None:
                low, high = actuator.force_range
                held = (force <= low * AT_LIMIT) if low < 0 else (force <= low)
                sums.at_limit += int((held | (force >= high * AT_LIMIT)).sum())

    def _row(
        self, body: Body, actuator: Actuator, *, length: float | None, force: float
    ) -> ActuatorRow:
        sums = self._sums.get((body.number, actuator.number), _Sums())
        return ActuatorRow(
            name=actuator.name,
            kind=actuator.kind,
            acts_on=actuator.acts_on,
            target=actuator.target,
            given=sums.given if np.isfinite(sums.given) else None,
            ctrl_range=actuator.ctrl_range,
            beyond_range_steps=sums.beyond,
            length=length,
            force=next((each for each in (sums.force, force) if np.isfinite(each)), None),
            moments=_moments(body, sums.on_joints, force),
            force_range=actuator.force_range,
            at_force_limit_steps=sums.at_limit,
            energy_j=sums.energy_j,
        )


def _moments(body: Body, exerted: Float64, force: float) -> dict[str, float]:
    """Return the moment arm of an actuator about each joint that it moves, by joint name.

    Of a joint with three rates, the largest of three moment arms is returned.
    """
    if not force or not np.isfinite(force) or not len(exerted):
        return {}
    arms = {
        joint.name: max((exerted[place] / force).tolist(), key=abs)
        for joint, place in zip(body.joints, body.rates, strict=True)
        if exerted[place].any()
    }
    return {name: float(arm) for name, arm in arms.items()}


def _force(actuator: Actuator, steps: BodySteps, name: str) -> Float64 | None:
    """Return an actuator's force in each step, shape (n,); None if it moves several joints."""
    place = steps.body.rate_of(actuator)
    if place is None or not actuator.gear or not steps.covered:
        return None
    term = steps.terms.get(name)
    if term is None:
        return np.zeros(len(steps))
    impulse = term[:, steps.law.tree.first_rate + place]
    return np.asarray(impulse / steps.reported.timestep_s / actuator.gear)
