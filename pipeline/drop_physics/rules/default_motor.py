"""Why a joint does not move: a motor that nobody thought of holds it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.commands import DEFAULT
from drop_physics.explain.joints import Driven
from drop_physics.messages import Message
from drop_physics.physics.dynamics import mass_matrix
from drop_physics.physics.kinematics import kinematics
from drop_physics.rules.answer import Answer, Effect, Finding, Noted, Scene
from drop_physics.rules.joint import effort, name_of, units_of

MOST = 0.5
"""A motor that cancels more of what acts on its joint than that holds it."""
MOVES = 0.05
"""What would give a joint less speed than that over the run [rad/s or m/s] moves nothing."""
NOTHING = 1e-3
"""What is below this share of the largest term that acts on a joint is what remains of others."""


@dataclass
class _Held:
    """One joint, in the steps in which a motor that was not asked to hold it could have."""

    name: str
    unit: str
    noted: Noted
    own: bool = True
    """Whether the motor is PyBullet's own."""
    motor: str | None = None
    torque: str | None = None
    """Where the motor was set, and the torque."""
    acting: float = 0.0
    """Σ |what acts on it, motor apart| [N s, N m s]; then the parts of gravity, contacts, calls."""
    weight: float = 0.0
    hit: float = 0.0
    pushed: float = 0.0
    taken: float = 0.0
    """What the motor took of it."""
    most: float = 0.0
    """The largest effort of the motor."""
    limit: float = 0.0
    time_s: float = 0.0
    """Of the steps in which anything acts."""
    inertia: float = np.inf
    since: set[float] = field(default_factory=set)
    """The steps of first torque commands: of several, it got a motor between them."""

    @property
    def holds(self) -> bool:
        """Whether a motor that nobody asked for holds a joint that would move."""
        moves = len(self.since) < 2 and self.acting > MOVES * self.inertia
        return moves and self.taken > MOST * self.acting


class DefaultMotor(Answer):
    """A joint that torques, weight or a hit should move, and its motor does not let."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._joints: dict[int, dict[tuple[int, bool], _Held]] = {}
        """By body, by rate and whether torques drive it."""
        self._asked: set[int] = set()
        """Robots of which any motor was commanded."""

    def see(self) -> None:
        """Take a piece."""
        for driven in self.scene.driven():
            asked, steps = driven.asked, driven.steps
            default, torqued = asked.mode == DEFAULT, ~np.isnan(asked.torque_since)
            if (~default | torqued).any():
                self._asked.add(driven.body.number)
            joints = self._joints.setdefault(driven.body.number, {})
            # Until a call gives it another motor, it was to stay where it was.
            sent = (~default & ~torqued).any(axis=0)
            for k in np.flatnonzero(sent).tolist():
                joints.pop((k, False), None)
            if not steps.covered or driven.body.before:
                continue
            on = (asked.impulse > 0) & (asked.pd != 1)
            on &= steps.closes[:, None]
            # What carries a body that is not fixed is not told apart from what should move it.
            own = on & ~torqued & default & ~sent & steps.law.tree.fixed
            for torque, which in ((True, on & torqued), (False, own)):
                for k in np.flatnonzero(which.any(axis=0)).tolist():
                    self._add(driven, k, np.flatnonzero(which[:, k]), torque=torque)

    def _add(self, driven: Driven, k: int, rows: NDArray[np.intp], *, torque: bool) -> None:
        steps, asked, row = driven.steps, driven.asked, rows[-1]
        first = Noted(int(steps.steps[rows[0]]))
        held = self._joints[driven.body.number].setdefault(
            (k, torque), _Held(name_of(driven, k), units_of(driven, k)[1], first)
        )
        rate = steps.law.tree.first_rate + k
        terms = {name: each[rows, rate] for name, each in steps.terms.items()}
        motor = terms.pop("motors")
        acting = np.asarray(sum(terms.values()))
        real = np.abs(acting) > NOTHING * np.max([np.abs(each) for each in terms.values()], axis=0)
        acting, sign = np.abs(acting[real]), np.sign(acting[real])
        held.acting += float(acting.sum())
        held.weight += float((terms["gravity"][real] * sign).sum())
        held.hit += float((terms["contacts"][real] * sign).sum())
        held.pushed += float((terms["applied"][real] * sign).sum())
        held.taken += float(np.clip(-motor[real] * sign, 0, acting).sum())
        held.time_s += float(steps.reported.timestep_s[rows][real].sum())
        (matrix,) = mass_matrix(kinematics(steps.law.tree, steps.before.at(rows[-1:])))
        held.inertia = float(matrix[rate, rate])
        held.most = max(held.most, float(np.abs(driven.torque[rows, k]).max()))
        held.limit, held.own = float(driven.limit[row, k]), bool(asked.mode[row, k] == DEFAULT)
        held.motor = self.scene.site(asked.site[row, k])
        held.torque = self.scene.site(asked.torque_site[row, k])
        if torque:
            held.since |= {*asked.torque_since[rows, k].tolist()}
        held.noted.go_on(steps.steps[rows])

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot."""
        for number, joints in self._joints.items():
            held = {
                key: each
                for key, each in joints.items()
                if each.holds
                and (key[1] or max(each.weight, each.hit, each.pushed) > MOST * each.acting)
            }
            # Where torques are commanded, they are what the reader asks about.
            held = {key: each for key, each in held.items() if key[1]} or held
            if held:
                k, torque = max(held, key=lambda key: held[key].taken)
                yield self._finding(number, held[k, torque], torque=torque)

    def _finding(self, number: int, held: _Held, *, torque: bool) -> Finding:
        values: dict[str, object] = {
            "joint": held.name,
            "most": effort(held.most, held.unit),
            "site": held.motor,
            "limit": effort(held.limit, held.unit),
            "share": min(held.taken / held.acting, 1.0),
            "weight": effort(held.weight / max(held.time_s, 1e-300), held.unit),
        }
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
        elif held.pushed > MOST * held.acting:
            template = Message(
                "{joint} is held by the velocity motor that PyBullet gives every joint: it takes "
                "{share:.0%} of what calls push it with, up to {most} of the {limit} that it may"
            )
        else:
            template = Message(
                "{joint} is held by the velocity motor that PyBullet gives every joint: it takes "
                "what touches it, up to {most} of the {limit} that it may"
            )
        return Finding(
            code="default-motor",
            level="note" if not torque and number in self._asked else "asked",
            message=Message(template, **values),
            advice=self._off(number, held.name),
            body=self.scene.body(number).label,
            joint=held.name,
            effect=Effect(held.most, held.unit),
            share=min(held.taken / held.acting, 1.0),
            steps=held.noted.span,
            site=held.torque,
        )

    def _off(self, number: int, name: str) -> Message:
        """Return the call that turns the motor of a joint off; a ball joint takes another."""
        kinds = {joint.name: joint.kind for joint in self.scene.body(number).joints}
        if kinds.get(name) == "spherical":
            return Message(
                "turn it off: p.setJointMotorControlMultiDof(…, p.POSITION_CONTROL, "
                "targetPosition=[0, 0, 0, 1], force=[0, 0, 0])"
            )
        return Message("turn it off: p.setJointMotorControl2(…, p.VELOCITY_CONTROL, force=0)")
