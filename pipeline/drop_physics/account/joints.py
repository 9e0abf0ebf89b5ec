"""The table of joints: their states in all steps, and a row each for the last step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drop_physics.account.series import CONTROLS, Control, JointSeries
from drop_physics.arrays import Vector
from drop_physics.explain.joints import DrivenJoints, PoseEfforts
from drop_physics.physics.vectors import triple
from drop_physics.trace.events import Body, Joint


@dataclass(frozen=True, kw_only=True)
class JointRow:
    """One degree of freedom at the last sample; torques [N m] or [N] have the joint's sign."""

    name: str
    """Name of the joint in the body's file."""
    index: int
    """Index of the joint's link, which is PyBullet's joint index."""
    axis: int | None
    """Axis of a spherical joint, 0 to 2; None for other joints."""
    kind: str
    """`revolute`, `prismatic` or `spherical`."""
    control: Control
    """Control mode of the last command; `default` is PyBullet's initial motor."""
    target: float | None
    """Target [rad] or [m]; for a velocity motor [rad/s] or [m/s]."""
    reached: float | None
    """Position or rate at the last sample, in the target's unit."""
    off: float | None
    """Position or rate minus target."""
    torque: float | None
    """Torque of the joint's motor in the last step; with several substeps, in the last substep."""
    force_limit: float | None
    """Maximum torque of the joint's motor in the last step; PyBullet allows it in each substep."""
    needs: float | None
    """Torque required to hold the last pose; None if undefined."""
    needs_at_target: float | None
    """Torque required to hold the pose with the joint at its target."""
    at_force_limit_steps: int
    """Number of steps in which the motor was at its limit."""
    at_stop_steps: int
    """Number of steps in which one of the joint's position limits pushed it."""
    reaction_n: Vector | None
    """Force of the link before the joint on the one behind it in the last step, world axes; None if
    unknown."""
    reaction_n_m: Vector | None
    """Torque across the joint, about its axis and across it, in the last step; None if unknown."""

    @property
    def unit(self) -> str:
        """The unit of `target` and `reached`."""
        unit = "m" if self.kind == "prismatic" else "rad"
        return f"{unit}/s" if self.control == "velocity" else unit

    @property
    def torque_unit(self) -> str:
        """The unit of `torque`."""
        return "N" if self.kind == "prismatic" else "N m"


class JointTable:
    """The joints of a recording or an episode, filled chunk by chunk."""

    def __init__(self) -> None:
        self._bodies: dict[int, Body] = {}
        self._parts: dict[int, list[JointSeries]] = {}
        self._efforts: dict[int, PoseEfforts] = {}

    def add(self, joints: DrivenJoints) -> None:
        """Add the joints of a chunk."""
        for number, found in joints.latest.items():
            parts = self._parts.setdefault(number, [])
            for driven in found:
                if parts and parts[-1].rate.shape[1] != driven.rate.shape[1]:
                    parts.clear()  # loaded again, with other joints
                parts.append(JointSeries.of(driven))
            self._bodies[number] = found[-1].body
            self._efforts[number] = joints.efforts[number]

    def series(self, body: int) -> JointSeries | None:
        """Return the joints of a body in all steps, by body id; None if it has no joints."""
        parts = self._parts.get(body)
        return JointSeries.joined(parts) if parts else None

    def efforts(self, body: int) -> PoseEfforts | None:
        """Return the joint torques at a body's last sample; None if it has no joints."""
        return self._efforts.get(body)

    def rows(self, body: int) -> Sequence[JointRow]:
        """Return the joints of a body at its last sample, by body id."""
        parts = self._parts.get(body)
        if not parts:
            return []
        series, its = JointSeries.joined(parts), self._bodies[body]
        return [
            _row_of(series, self._efforts[body], joint, k, place)
            for joint, place in zip(its.joints, its.rates, strict=True)
            for k in range(place.start, place.stop)
        ]


def _row_of(
    series: JointSeries, efforts: PoseEfforts, joint: Joint, k: int, place: slice
) -> JointRow:
    """Return the table row for joint rate `k`; `place` is the slice of all rates of its joint."""
    its = efforts.reactions
    control = CONTROLS[int(series.control[-1, k])]
    position, turns = control in ("position", "pd"), control == "velocity"
    asked = series.target if position else series.asked_rate
    target = float(asked[-1, k]) if position or turns else np.nan
    reached = float((series.rate if turns else series.after)[-1, k])
    known = control != "unknown"
    return JointRow(
        name=joint.name,
        index=joint.link,
        axis=k - place.start if place.stop - place.start > 1 else None,
        kind=joint.kind,
        control=control,
        target=_known(target),
        reached=_known(reached),
        off=_known(reached - target),
        torque=_known(float(series.torque[-1, k])),
        force_limit=_known(float(series.limit[-1, k])) if known else None,
        needs=_known(float(efforts.needs[k])),
        needs_at_target=_known(float(efforts.needs_at_target[k])) if position else None,
        at_force_limit_steps=int(series.at_limit[:, k].sum()) if known else 0,
        at_stop_steps=int(series.at_stop[:, k].sum()),
        reaction_n=None if its is None else triple(its.force_n[joint.link]),
        reaction_n_m=None if its is None else triple(its.torque_n_m[joint.link]),
    )


def _known(value: float) -> float | None:
    return value + 0.0 if np.isfinite(value) else None  # no -0.0
