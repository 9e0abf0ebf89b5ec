"""Why a joint does not move: a motor that nobody thought of holds it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drop_physics.analysis.answers.answer import Answer, Effect, Finding, Scene, Span, site_of
from drop_physics.analysis.answers.held_off import effort, units_of
from drop_physics.analysis.answers.off_target import name_of
from drop_physics.analysis.controls import DEFAULT
from drop_physics.analysis.explained.recording import Explained
from drop_physics.analysis.explained.steps import EXPLAINED
from drop_physics.analysis.joints import Driven
from drop_physics.laws.dynamics import mass_matrix
from drop_physics.laws.kinematics import kinematics
from drop_physics.messages import Message

Float64 = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST = 0.5
"""A motor that cancels more of what acts on its joint than that holds it."""
MOVES = 0.05
"""What would give a joint less speed than that over the run [rad/s or m/s] moves nothing."""
NOTHING = 1e-3
"""What is below this share of the largest term that acts on a joint is what remains of others."""
TURN_OFF = Message("turn it off: p.setJointMotorControl2(…, p.VELOCITY_CONTROL, force=0)")


@dataclass(eq=False)
class _Held:
    """One joint, in the steps in which a motor that was not asked to hold it could have."""

    acting: float = 0.0
    """Σ |what acts on it, motor apart| [N s or N m s]."""
    weight: float = 0.0
    """The part of it that is gravity's."""
    hit: float = 0.0
    """The part that is the contacts'."""
    taken: float = 0.0
    """What the motor took of it."""
    most: float = 0.0
    """The largest effort of the motor."""
    time_s: float = 0.0
    """Of the steps in which anything acts."""
    limit: float = 0.0
    inertia: float = np.inf
    first: int = -1
    last: int = -1
    count: int = 0
    name: str = ""
    unit: str = ""
    since: float = np.nan
    """The step of the first torque command; of several, between which it got a motor, -1."""
    own: bool = True
    """Whether the motor is PyBullet's own."""
    motor: float = np.nan
    torque: float = np.nan
    """Sites of the calls that set the motor, and the torque."""


class DefaultMotor(Answer):
    """A joint that torques, weight or a hit should move, and its motor does not let."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[tuple[int, bool], _Held]] = {}
        self._asked: set[int] = set()
        """Robots of which any motor was commanded."""

    def see(self, explained: Explained) -> None:
        """Take a piece."""
        for number in explained.bodies:
            for driven in self.scene.joints.latest.get(number, []):
                asked = driven.asked
                if ((asked.mode != DEFAULT) | ~np.isnan(asked.torque_since)).any():
                    self._asked.add(number)
                if driven.steps.covered:
                    joints = self._joints.setdefault(number, {})
                    for k in range(asked.mode.shape[1]):
                        _add(joints, driven, k)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            body = self.scene.body(number)
            if body.before:
                continue
            held = [
                (each, torque)
                for (_, torque), each in joints.items()
                if _holds(each) and (torque or max(each.weight, each.hit) > MOST * each.acting)
            ]
            # Where torques are commanded, they are what the reader asks about.
            held = [pair for pair in held if pair[1]] or held
            if held:
                worst, torque = max(held, key=lambda pair: pair[0].taken)
                note = not torque and number in self._asked
                yield self._finding(body.label, worst, len(held), torque=torque, note=note)

    def _finding(self, label: str, held: _Held, count: int, *, torque: bool, note: bool) -> Finding:
        motor, told = (self.scene.joints.site(site) for site in (held.motor, held.torque))
        values: dict[str, object] = {
            "joint": held.name, "count": count, "most": effort(held.most, held.unit),
            "limit": effort(held.limit, held.unit), "share": min(held.taken / held.acting, 1.0),
            "weight": effort(held.weight / max(held.time_s, 1e-300), held.unit),
            "site": "" if motor is None else site_of(motor),
        }  # fmt: skip
        if torque and held.own:
            template = Message(
                "{joint} does not follow the torques that it is given: the velocity motor that "
                "PyBullet gives every joint takes up to {most}, {share:.0%} of what acts on it"
            )
        elif torque:
            template = Message(
                "{joint} does not follow the torques that it is given: the motor set at {site} "
                "still acts and takes up to {most}, {share:.0%} of what acts on it"
            )
        elif held.weight > MOST * held.acting:
            template = Message(
                "{joint} is held by the velocity motor that PyBullet gives every joint: it takes "
                "{share:.0%} of its weight, {weight} on average"
            )
        else:
            template = Message(
                "{joint} is held by the velocity motor that PyBullet gives every joint: it takes "
                "what touches it, up to {most} of the {limit} that it may"
            )
        return Finding(
            code="default-motor",
            level="note" if note else "asked",
            message=Message(template, **values),
            advice=TURN_OFF,
            body=label,
            joint=held.name,
            effect=Effect(held.most, held.unit),
            share=min(held.taken / held.acting, 1.0),
            steps=Span(held.first, held.last, held.count),
            site=None if told is None else site_of(told),
        )


def _add(joints: dict[tuple[int, bool], _Held], driven: Driven, k: int) -> None:
    asked, steps = driven.asked, driven.steps
    torqued = ~np.isnan(asked.torque_since[:, k])
    on = (asked.impulse[:, k] > 0) & (asked.pd[:, k] != 1) & (steps.unexplained <= EXPLAINED)
    default = asked.mode[:, k] == DEFAULT
    for torque, which in ((True, on & torqued), (False, on & ~torqued & default)):
        # What carries a body that is not fixed is not told apart from what should move it.
        if not which.any() or not (torque or steps.law.tree.fixed):
            continue
        _count(joints.setdefault((k, torque), _Held()), driven, k, np.flatnonzero(which))


def _count(held: _Held, driven: Driven, k: int, rows: NDArray[np.intp]) -> None:
    steps, asked = driven.steps, driven.asked
    tree = steps.law.tree
    rate = tree.first_rate + k
    terms = {name: each[rows, rate] for name, each in steps.terms.items()}
    motor = terms.pop("motors")
    acting = np.asarray(sum(terms.values()))
    largest = np.max([np.abs(each) for each in terms.values()], axis=0)
    real = np.abs(acting) > NOTHING * largest
    sign = np.sign(acting[real])
    held.acting += float(np.abs(acting[real]).sum())
    held.weight += float((terms["gravity"][real] * sign).sum())
    held.time_s += float(steps.reported.timestep_s[rows][real].sum())
    held.hit += float((terms["contacts"][real] * sign).sum())
    held.taken += float(np.clip(-motor[real] * sign, 0, np.abs(acting[real])).sum())
    row = rows[-1]
    (matrix,) = mass_matrix(kinematics(tree, steps.before.at(np.array([row]))))
    held.inertia = float(matrix[rate, rate])
    held.most = max(held.most, float(np.abs(driven.torque[rows, k]).max()))
    held.limit = float(driven.limit[row, k])
    held.name, held.unit = name_of(driven, k), units_of(driven, k)[1]
    held.first = held.first if held.count else int(steps.steps[rows[0]])
    held.last, held.count = int(steps.steps[row]), held.count + len(rows)
    held.own = bool(asked.mode[row, k] == DEFAULT)
    held.motor, held.torque = float(asked.site[row, k]), float(asked.torque_site[row, k])
    since = np.unique(asked.torque_since[rows, k])
    if np.isfinite(since).all() and not np.isnan(held.since):
        since = np.unique(np.append(since, held.since))
    held.since = float(since[0]) if len(since) == 1 else -1.0


def _holds(held: _Held) -> bool:
    """Return whether a motor that nobody asked for holds a joint that would move."""
    return (
        held.since != -1.0
        and held.acting > MOVES * held.inertia
        and held.taken > MOST * held.acting
    )
