"""The rule `wheel-slip`: wheels whose rotation does not match the robot's motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import Points
from drop_physics.explain.steps import Steps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.tree import BASE, Tree
from drop_physics.physics.vectors import lengths, summed
from drop_physics.rules.body_properties import AskedOfBodies
from drop_physics.rules.chunk import StepChunk
from drop_physics.rules.engines import ANY, MUJOCO
from drop_physics.rules.rows import Noted, Remedy, SayingRow
from drop_physics.rules.rule import Match, Sized, joint_rule
from drop_physics.rules.tables import JointColumns
from drop_physics.rules.thresholds import (
    WHEEL_ALIKE,
    WHEEL_AT_LIMIT,
    WHEEL_HELD,
    WHEEL_LYING,
    WHEEL_SLIPS,
    WHEEL_TURN_RAD,
)
from drop_physics.trace.events import Body
from drop_physics.trace.history import DEFAULT_ENGINE as PYBULLET
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import VELOCITY

Rows = NDArray[np.intp]

SUMS = ("rolled", "slipped", "limited", "across", "available", "normal", "seconds")
"""Sums over a wheel's steps: rolled path, slipped path, the slipped path with friction at its
limit, sideways slip [m]; friction available, normal impulse [N s]; time [s]."""

OF_BOTH = {PYBULLET: Message("the product of both"), MUJOCO: Message("the larger of both")}
"""The friction coefficient that the engine uses for a pair."""


@joint_rule("wheel-slip", "asked", engines=ANY, commanded=False)
def wheel_slip(joints: JointColumns, chunk: StepChunk) -> Match | None:
    """A wheel slips: the motion of its contact point does not match its joint's rotation."""
    steps, number = joints.steps, joints.body.number
    drives = (joints.mode == VELOCITY) & (joints.asked.impulse > 0)
    if not steps.terms or steps.law.tree.fixed or not drives.any():
        return None
    sums, ground = np.zeros((*drives.shape, len(SUMS))), np.full(drives.shape, -1)
    held = np.zeros(drives.shape, np.bool_)
    points = chunk.pairs.points
    its = np.flatnonzero(
        (points.body == number).any(axis=1)
        & (points.normal_n > 0)
        & ~points.moves.all(axis=1)
        & points.explained.all(axis=1)
        & np.isin(points.step, steps.steps)
    )
    if len(its):
        rolling = Rolling(steps, points, its, number)
        row, rate = rolling.row, rolling.rate
        every = np.column_stack([drives, np.zeros(len(drives), np.bool_)])
        wheel = every[row, rate] & (np.abs(rolling.lying) < WHEEL_LYING)
        holds = rolling.held(wheel)[row]
        held[row[wheel & holds], rate[wheel & holds]] = True
        for k in np.unique(rate[wheel & ~holds]).tolist():
            rows = np.flatnonzero(wheel & ~holds & (rate == k))
            ends, which = np.unique(row[rows], return_inverse=True)
            sums[ends, k], ground[row[rows], k] = rolling.sums(rows, which), rolling.ground[rows]
    rolls = ground >= 0
    turned_rad = np.abs(joints.rate) * steps.reported.timestep_s[:, None]
    return Match(
        drives,
        sums[:, :, 1],
        sums={
            **{name: sums[:, :, k] for k, name in enumerate(SUMS)},
            "turned": turned_rad * rolls,
            "turned_in_all": turned_rad,
            "held": held.astype(float),
        },
        most={
            "ground": ground,
            "high": np.where(rolls, joints.after, -np.inf),
            "low": np.where(rolls, -joints.after, -np.inf),
        },
        counts=rolls.astype(np.int64),
    )


@wheel_slip.counts
def _(
    high: Float64,
    low: Float64,
    rolled: Float64,
    turned_in_all: Float64,
    turned: Float64,
    keys: Int64,
    slipped: Float64,
    limited: Float64,
    across: Float64,
    count: Int64,
    held: Float64,
) -> Sized:
    turns = high + low > WHEEL_TURN_RAD
    # One that touches only where it starts and brakes slips little of its way.
    in_all = rolled * turned_in_all / turned
    robot = np.unique(keys[:, 0], return_inverse=True)[1]
    # Of one that slips forwards and one that slips backwards, the robot loses nothing.
    all_rolled, all_slipped, all_limited, sideways, free, holds = (
        np.float64(1.0) * np.bincount(robot, each)[robot]
        for each in (
            *(np.where(turns, each, 0.0) for each in (in_all, slipped, limited)),
            across - WHEEL_SLIPS * np.abs(rolled),
            count.astype(float),
            held,
        )
    )
    dragged = (slipped * all_slipped < 0) & (abs(slipped) > WHEEL_SLIPS * in_all)
    loses = turns & (holds < free)
    loses &= _share(all_rolled, all_slipped, all_limited) > WHEEL_SLIPS
    sizes = np.where(loses, _share(rolled, slipped, limited), 0.0)
    # Of such robots some wheels slip the other way, or all across: the more friction, the more so.
    return Sized(sizes, {"dragged": np.bincount(robot, dragged)[robot], "turns": sideways > 0})


@wheel_slip.notes
def _(
    seen: Seen,
    asked: AskedOfBodies,
    subject: Body,
    ground: int,
    rolled: float,
    slipped: float,
    seconds: float,
    available: float,
    normal: float,
    engine: str,
) -> Noted:
    return {
        "of": OF_BOTH[engine],
        "other": seen.bodies[ground].label,
        "rolls": rolled / seconds,
        "goes": (rolled - slipped) / seconds,
        "friction": available / normal,
        "part": abs(slipped) / abs(rolled),
        "called": asked.of["lateralFriction"].site(subject.number, ground),
    }


SPINS = Message(
    "{joint} spins at {rolls:.3g} m/s (rim) on {other} but travels at {goes:.3g} m/s: "
    "friction is at its limit (coefficient {friction:.3g}, {of})"
)
wheel_slip.rows(
    SayingRow(
        when=lambda turns: turns,
        says=Message(
            "{joint} spins at {rolls:.3g} m/s (rim) on {other} but travels at {goes:.3g} m/s: "
            "the robot's turn drags it sideways, too, with friction at its limit (coefficient "
            "{friction:.3g}, {of})"
        ),
    ),
    SayingRow(
        when=lambda dragged: dragged,
        says=SPINS,
        advice=Message("give its wheels speeds that go together: others are dragged"),
    ),
    SayingRow(
        says=SPINS,
        advice=Message(
            "{call} of the wheels or the ground, or change the wheels' speed more slowly"
        ),
        cure=Remedy("friction", "body"),
    ),
    like=SayingRow(effect="slipped", unit="m", share="part", site="called"),
)


class Rolling:
    """The k contact points between a robot and bodies that cannot move."""

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
        """Velocity of a contact point per unit rate of its joint [m], and the joint's rate
        [rad/s]."""
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
        """Flag the steps in which forces besides the ground's friction act along a wheel's path."""
        steps, n = self._steps, len(self._steps)
        timestep_s = steps.reported.timestep_s[:, None]
        outside = sum(steps.terms[name][:, 3:6] for name in ("contacts", "constraints", "applied"))
        normal = summed(self.row[wheel], self._normal[wheel] * self._normal_n[wheel, None], count=n)
        normal /= np.maximum(lengths(normal), 1e-12)[:, None]
        # A caster without a joint that drags on the same ground does not hold it.
        alike = np.einsum("ki,ki->k", self._normal, normal[self.row]) > WHEEL_ALIKE
        own = wheel | (alike & (self.rate == steps.law.tree.joint_rates))
        others = outside / timestep_s - summed(self.row[own], self._tangential_n[own], count=n)
        others = others - np.einsum("ni,ni->n", others, normal)[:, None] * normal
        most = (self._friction * self._normal_n)[wheel, None]
        available = summed(self.row[wheel], most, count=n)[:, 0]
        return np.asarray(lengths(others) > WHEEL_HELD * available)

    def sums(self, rows: Rows, which: Rows) -> Float64:
        """Return the quantities in SUMS for each step of a wheel; `which` is each point's step."""
        n = int(which[-1]) + 1
        normal_n = self._normal_n[rows]
        forward, line = self._forward_m[rows], self._normal[rows]
        forward = forward - np.einsum("ki,ki->k", forward, line)[:, None] * line
        arm = lengths(forward)
        forward = forward / np.maximum(arm, 1e-12)[:, None]
        rolls, slips = self._rate[rows] * arm, np.einsum("ki,ki->k", self._slip_m_s[rows], forward)
        across = lengths(self._slip_m_s[rows] - slips[:, None] * forward)
        # Forwards is where it rolls, or where it goes if that is more: a locked wheel slides on.
        sign = np.where(2 * rolls < slips, -1.0, 1.0)
        rolls, slips = sign * rolls, sign * slips
        means = summed(which, np.column_stack([rolls, slips, across]) * normal_n[:, None], count=n)
        normal = np.bincount(which, normal_n, n)
        rolled, slipped, across = means.T / normal
        available = np.bincount(which, normal_n * self._friction[rows], n)
        used = lengths(summed(which, self._tangential_n[rows], count=n))
        limited = slipped * (used > WHEEL_AT_LIMIT * available)
        timestep_s = self._timestep_s[rows][np.searchsorted(which, np.arange(n))]
        numbers = [rolled, slipped, limited, across, available, normal, np.ones(n)]
        return np.column_stack(numbers) * timestep_s[:, None]


def _share(rolled: Float64, slipped: Float64, limited: Float64) -> Float64:
    """Return the share of a path that was slip; 0 unless friction was at its limit."""
    slipped = np.abs(slipped)
    return np.where(np.abs(limited) > 0.5 * slipped, slipped / np.abs(rolled), 0.0)


def _joint(tree: Tree, link: int) -> int:
    """Return the joint that moves a link: its own or the nearest towards the base; BASE if none."""
    return next((each for each in tree.branch(link) if tree.joints[each] != "fixed"), BASE)
