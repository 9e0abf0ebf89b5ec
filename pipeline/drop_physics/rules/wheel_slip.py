"""`wheel-slip`: wheels turn, and the robot does not go as far as they roll, or farther."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drop_physics.explain.contact_points import Points
from drop_physics.explain.joints import Driven
from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import BASE, Tree
from drop_physics.rules.answer import Answer, Effect, Finding, Scene, Span
from drop_physics.trace.motors import VELOCITY

Float64 = NDArray[np.float64]
Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]

LEAST = 0.05
"""Share of what it rolls."""
TURN_RAD = 2 * np.pi
"""What does not go round once is no wheel."""
LYING = 0.5
"""Cosine of the angle between axis and ground's normal: above, it is a brush."""
AT_LIMIT = ALIKE = 0.95
HELD = 0.1
"""Share of the friction available to the wheels: with more, something else holds the robot."""
SIDEWAYS = 0.2
"""Share of the slip: with more, it is dragged across by the robot's turn."""


@dataclass
class Wheel:
    """A joint in the steps in which it rolls on what cannot move."""

    ground: int
    first: int
    last: int = 0
    count: int = 0
    low_rad: float = np.inf
    high_rad: float = -np.inf
    turned_rad: float = 0.0
    """There, and in all steps in which it is driven: it may leave the ground in between."""
    turned_in_all_rad: float = 0.0
    sums: Float64 = field(default_factory=lambda: np.zeros(7))
    """What it rolls, what of it slips, the same where friction is at its limit, what it slips
    across [m]; friction available, normal impulse [N s]; time [s]."""

    @property
    def turns(self) -> bool:
        """Whether it goes round."""
        return self.high_rad - self.low_rad > TURN_RAD

    @property
    def in_all(self) -> Float64:
        """The sums, with what it rolls in all steps in which it is driven.

        One that touches only where it starts and brakes slips little of its way.
        """
        return self.sums * [self.turned_in_all_rad / self.turned_rad, *[1] * 6]

    @property
    def share(self) -> float:
        """Of what it rolls, that which slips."""
        return share_of(self.sums)


class WheelSlip(Answer):
    """At the contact point: what the joint alone moves it by, against how it moves."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._wheels: dict[tuple[int, int], Wheel] = {}
        """By body and joint."""
        self._steps: dict[int, NDArray[np.int64]] = {}
        """By body, in which something else holds it, and the others."""
        self._turned_rad: defaultdict[int, Float64 | float] = defaultdict(float)
        """By body, how far its joints turn in steps in which they are driven."""

    def see(self) -> None:
        """Take a piece."""
        for driven in self.scene.driven():
            drives = (driven.asked.mode == VELOCITY) & (driven.asked.impulse > 0)
            if driven.steps.terms and not driven.steps.law.tree.fixed and drives.any():
                turned_rad = driven.steps.reported.timestep_s @ np.abs(driven.rate * drives)
                self._turned_rad[driven.body.number] += turned_rad
                self._see(driven, drives)

    def _see(self, driven: Driven, drives: Flags) -> None:
        """Take steps of a robot whose base can move."""
        points, number = self.scene.touches.pairs.points, driven.body.number
        its = np.flatnonzero(
            (points.body == number).any(axis=1)
            & (points.normal_n > 0)
            & ~points.moves.all(axis=1)
            & points.explained.all(axis=1)
            & np.isin(points.step, driven.steps.steps)
        )
        if not len(its):
            return
        rolling = Rolling(driven.steps, points, its, number)
        drives = np.column_stack([drives, np.zeros(len(drives), np.bool_)])
        wheel = drives[rolling.row, rolling.rate] & (np.abs(rolling.lying) < LYING)
        held = rolling.held(wheel)[rolling.row]
        steps = self._steps.setdefault(number, np.zeros(2, np.int64))
        steps += [len(np.unique(rolling.row[wheel & each])) for each in (held, ~held)]
        wheel &= ~held
        for k in np.unique(rolling.rate[wheel]).tolist():
            self._add(driven, k, rolling, np.flatnonzero(wheel & (rolling.rate == k)))

    def _add(self, driven: Driven, k: int, rolling: Rolling, rows: Rows) -> None:
        ends, which = np.unique(rolling.row[rows], return_inverse=True)
        steps, angle = driven.steps.steps[ends], driven.after[ends, k]
        key = driven.body.number, k
        wheel = self._wheels.setdefault(key, Wheel(int(rolling.ground[rows[0]]), int(steps[0])))
        wheel.turned_rad += float(
            driven.steps.reported.timestep_s[ends] @ np.abs(driven.rate[ends, k])
        )
        wheel.last, wheel.count = int(steps[-1]), wheel.count + len(steps)
        wheel.low_rad = min(wheel.low_rad, float(angle.min()))
        wheel.high_rad = max(wheel.high_rad, float(angle.max()))
        wheel.sums += rolling.sums(rows, which)

    def findings(self) -> Iterator[Finding]:
        """Yield a line per robot, of its worst wheel."""
        for number, (held, free) in self._steps.items():
            its = {
                k: each for (body, k), each in self._wheels.items() if body == number and each.turns
            }
            for k, each in its.items():
                each.turned_in_all_rad = float(np.ravel(self._turned_rad[number])[k])
            # Of one that slips forwards and one that slips backwards, the robot loses nothing.
            whole = np.sum([each.in_all for each in its.values()], axis=0) if its else np.zeros(7)
            if held < free and share_of(whole) > LEAST:
                k = max(its, key=lambda k: its[k].share)
                yield self._finding(number, k, its[k])

    def _finding(self, number: int, k: int, wheel: Wheel) -> Finding:
        body, ground = self.scene.body(number), self.scene.body(wheel.ground)
        rolled, slipped, _, across, available, normal, seconds = wheel.sums.tolist()
        joint = self.scene.joints.rows(number)[k].name
        values = {
            "joint": joint,
            "rolls": rolled / seconds,
            "ground": ground.label,
            "goes": (rolled - slipped) / seconds,
            "friction": available / normal,
        }
        turns = across > SIDEWAYS * abs(slipped)
        if turns:
            message = Message(
                "{joint} spins at {rolls:.3g} m/s (rim) on {ground} but travels at {goes:.3g} m/s: "
                "the robot's turn drags it sideways, too, with friction at its limit (coefficient "
                "{friction:.3g}, the product of both)",
                **values,
            )
        else:
            message = Message(
                "{joint} spins at {rolls:.3g} m/s (rim) on {ground} but travels at {goes:.3g} m/s: "
                "friction is at its limit (coefficient {friction:.3g}, the product of both)",
                **values,
            )
        advice = Message(
            "p.changeDynamics(…, lateralFriction=…) of the wheels or the ground, or "
            "change the wheels' speed more slowly"
        )
        return Finding(
            code="wheel-slip",
            level="asked",
            message=message,
            advice=None if turns else advice,
            body=body.label,
            joint=joint,
            other=ground.label,
            effect=Effect(abs(slipped), "m"),
            share=wheel.share,
            steps=Span(wheel.first, wheel.last, wheel.count),
            site=self.scene.asked.of["lateralFriction"].site(number, wheel.ground),
        )


class Rolling:
    """Contact points of a robot with what cannot move, k of them."""

    def __init__(self, steps: Steps, points: Points, its: Rows, number: int) -> None:
        side = (points.body[its, 1] == number).astype(int)
        sign = np.where(side, -1.0, 1.0)[:, None]
        tree = steps.law.tree
        self._steps, self._timestep_s = steps, points.timestep_s[its]
        self.row = np.searchsorted(steps.steps, points.step[its])
        self.ground = points.body[its, 1 - side]
        self._normal = points.normal[its]
        self._normal_n, self._friction = points.normal_n[its], points.friction[its]
        self._tangential_n = points.tangential_n[its] * sign
        self._slip_m_s = points.slip_m_s[its] * sign
        link = np.minimum(points.link[its, side], tree.links - 1)
        joint = np.array([_joint(tree, each) for each in range(BASE, tree.links)])[link + 1]
        rates = [at.start - tree.first_rate for at in tree.rates] + [tree.joint_rates]
        self.rate = np.where(joint == BASE, tree.joint_rates, np.array(rates)[joint])
        used, at = np.unique(self.row, return_inverse=True)
        kin = kinematics(tree, steps.before.at(used))
        self._forward_m, self._rate = np.zeros((len(its), 3)), np.zeros(len(its))
        """How a point moves by a radian of its joint, and the joint's rate."""
        self.lying = np.ones(len(its))
        for k in np.unique(joint[joint != BASE]).tolist():
            if tree.joints[k] == "revolute":
                rows = np.flatnonzero(joint == k)
                axis, pivot = kin.axes[k][0].T[at[rows]], kin.pivots[k].T[at[rows]]
                self._rate[rows] = steps.after.velocity[self.row[rows], tree.rates[k].start]
                arm = points.at_m[its[rows], side[rows]] - pivot
                self._forward_m[rows] = np.cross(axis, arm)
                self.lying[rows] = np.einsum("ki,ki->k", axis, self._normal[rows])

    def held(self, wheel: Flags) -> Flags:
        """Return in which steps something besides the ground's friction acts along it."""
        steps, n = self._steps, len(self._steps)
        timestep_s = steps.reported.timestep_s[:, None]
        outside = sum(steps.terms[name][:, 3:6] for name in ("contacts", "constraints", "applied"))
        normal = _summed(self._normal[wheel] * self._normal_n[wheel, None], self.row[wheel], n)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
        # A caster without a joint that drags on the same ground does not hold it.
        alike = np.einsum("ki,ki->k", self._normal, normal[self.row]) > ALIKE
        own = wheel | (alike & (self.rate == steps.law.tree.joint_rates))
        others = outside / timestep_s - _summed(self._tangential_n[own], self.row[own], n)
        others = others - np.einsum("ni,ni->n", others, normal)[:, None] * normal
        most = (self._friction * self._normal_n)[wheel, None]
        available = _summed(most, self.row[wheel], n)[:, 0]
        return np.asarray(np.linalg.norm(others, axis=1) > HELD * available)

    def sums(self, rows: Rows, which: Rows) -> Float64:
        """Return the sums of a `Wheel` over its contact points; `which` is the step of each."""
        n = int(which[-1]) + 1
        normal_n = self._normal_n[rows]
        forward, line = self._forward_m[rows], self._normal[rows]
        forward = forward - np.einsum("ki,ki->k", forward, line)[:, None] * line
        arm = np.linalg.norm(forward, axis=1)
        forward = forward / np.maximum(arm, 1e-12)[:, None]
        rolls, slips = self._rate[rows] * arm, np.einsum("ki,ki->k", self._slip_m_s[rows], forward)
        across = np.linalg.norm(self._slip_m_s[rows] - slips[:, None] * forward, axis=1)
        # Forwards is where it rolls, or where it goes if that is more: a locked wheel slides on.
        sign = np.where(2 * rolls < slips, -1.0, 1.0)
        rolls, slips = sign * rolls, sign * slips
        means = _summed(np.column_stack([rolls, slips, across]) * normal_n[:, None], which, n)
        normal = np.bincount(which, normal_n, n)
        rolled, slipped, across = means.T / normal
        available = np.bincount(which, normal_n * self._friction[rows], n)
        used = np.linalg.norm(_summed(self._tangential_n[rows], which, n), axis=1)
        limited = slipped * (used > AT_LIMIT * available)
        timestep_s = self._timestep_s[rows][np.searchsorted(which, np.arange(n))]
        numbers = [rolled, slipped, limited, across, available, normal, np.ones(n)]
        return np.asarray(timestep_s @ np.column_stack(numbers))


def share_of(sums: Float64) -> float:
    """Return what of a way slips; 0 where that is not due to friction at its limit."""
    rolled, slipped, at_limit = np.abs(sums[:3])
    return float(slipped / rolled) if at_limit > 0.5 * slipped else 0.0


def _joint(tree: Tree, link: int) -> int:
    """Return the joint that moves a link: its own or the nearest below; BASE if there is none."""
    return next((each for each in tree.branch(link) if tree.joints[each] != "fixed"), BASE)


def _summed(values: Float64, row: Rows, n: int) -> Float64:
    """Return the sums of vectors by row, shape (n, k)."""
    out = np.zeros((n, values.shape[1]))
    np.add.at(out, row, values)
    return out
