"""The joints of a recording: commands, positions, torques, and static torques of poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.commands import DEFAULT, Commanded
from drop_physics.explain.needs import PoseSupport, holding
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.steps import BodySteps
from drop_physics.physics.tree import Tree
from drop_physics.trace.events import Body, Site
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import POSITION

Control = Literal["position", "velocity", "torque", "pd", "default", "off", "unknown"]

REST_STEPS = 10
REST_SHARE, REST, NEVER_MOVED = 1e-3, 1e-3, 1e-5
"""A joint is at rest while its rate is below REST_SHARE of its highest rate, or below REST [SI] if
that is lower; a joint whose rate never exceeded NEVER_MOVED is also at rest."""
WAY_POSES = 32
"""Number of poses between start and target at which the static torque is computed."""
AT_LIMIT = 1 - 1e-6
STOPPED = 1e-6
"""A joint stop whose impulse is below this share of the step's largest impulse is ignored."""


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

    @property
    def unit(self) -> str:
        """The unit of `target` and `reached`."""
        unit = "m" if self.kind == "prismatic" else "rad"
        return f"{unit}/s" if self.control == "velocity" else unit

    @property
    def torque_unit(self) -> str:
        """The unit of `torque`."""
        return "N" if self.kind == "prismatic" else "N m"


@dataclass(frozen=True, eq=False)
class JointTelemetry:
    """The joints of a body over n steps; shape (n, joint_rates) unless stated otherwise."""

    body: Body
    steps: BodySteps
    before: Float64
    """Positions of the joints [rad] or [m] before each step; nan for spherical joints."""
    after: Float64
    rate: Float64
    """Joint rates after each step."""
    torque: Float64
    """Torques of the motors."""
    limit: Float64
    """Maximum torque of each motor; with several substeps, the sum over all of them."""
    at_limit: Flags
    at_stop: Flags
    """Whether a position limit of the joint pushed it."""
    resting: Flags
    """Whether the joint has been at rest for the last ten steps."""
    all_resting: Flags
    """Whether all degrees of freedom of the body are at rest, shape (n,)."""

    @property
    def asked(self) -> Commanded:
        """The motor commands in effect."""
        return self.steps.asked


@dataclass(eq=False)
class _Track:
    """Running values for a body."""

    body: Body
    greatest: Float64
    """The highest rate so far of each entry of u."""
    quiet: Int64
    """Number of steps since each entry of u came to rest."""
    at_limit: Int64
    at_stop: Int64
    last: JointTelemetry | None = None
    needs: Float64 = field(default_factory=lambda: np.empty(0))
    needs_at_target: Float64 = field(default_factory=lambda: np.empty(0))
    on_the_way: Float64 = field(default_factory=lambda: np.empty(0))
    numbers: Mapping[str, Float64] = field(default_factory=dict)


class JointTable:
    """The table of joints; grows chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._sites: Mapping[int, Site] = {}
        self._tracks: dict[int, _Track] = {}
        self._explained: ExplainedPiece | None = None
        self.latest: dict[int, list[JointTelemetry]] = {}
        """Telemetry of the joints in the latest chunk, by body id."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk."""
        self._sites = explained.piece.calls.sites
        self._explained, self.latest = explained, {}
        for number, judged in explained.bodies.items():
            rates = sum(joint.widths[1] for joint in judged.body.joints)
            found = [
                self._driven(judged.body, steps)
                for steps in judged.intervals
                if rates and steps.law.tree.joint_rates == rates
            ]
            if found:
                self.latest[number] = found
        for number, found in self.latest.items():
            self._end(self._tracks[number], found[-1])

    def forget(self) -> None:
        """Free the latest chunk."""
        self._explained, self.latest = None, {}

    def site(self, number: float) -> Site | None:
        """Return the call site with this id, as used in `Commanded`."""
        return None if np.isnan(number) else self._sites.get(int(number))

    def holding(self, driven: JointTelemetry, row: int) -> PoseSupport:
        """Return the forces that support a body's pose after a step of the latest chunk."""
        assert self._explained is not None
        return holding(
            self._explained,
            self._seen.bodies,
            driven.steps,
            row,
            number=driven.body.number,
            resting=bool(driven.all_resting[row]),
        )

    def on_the_way(self, body: int, joint_rate: int) -> float:
        """Return the maximum torque that a motor at its limit would need on the way to its target.

        The way goes straight from the last pose to the targets of all joints; the torque is that of
        holding a pose on it against the motion, or holding the last one [N] or [N m]. It is nan
        where that is not known, and at rest.
        """
        return float(self._tracks[body].on_the_way[joint_rate])

    def rows(self, body: int) -> Sequence[JointRow]:
        """Return the joints of a body, by body id."""
        track = self._tracks.get(body)
        if track is None:
            return []
        return [
            _row_of(track, joint.link, k, k - place.start if joint.widths[1] > 1 else None)
            for joint, place in zip(track.body.joints, track.body.rates, strict=True)
            for k in range(place.start, place.stop)
        ]

    def _driven(self, body: Body, steps: BodySteps) -> JointTelemetry:
        size = steps.law.tree.size
        track = self._tracks.get(body.number)
        if track is None or len(track.greatest) != size:
            zeros = np.zeros(steps.law.tree.joint_rates, np.int64)
            track = _Track(body, np.zeros(size), np.zeros(size, np.int64), zeros, zeros.copy())
            self._tracks[body.number] = track
        track.body = body
        driven = _driven(body, steps, track)
        track.at_limit += driven.at_limit.sum(axis=0)
        track.at_stop += driven.at_stop.sum(axis=0)
        return driven

    def _end(self, track: _Track, driven: JointTelemetry) -> None:
        """Record the state of the joints at the end of a chunk."""
        row = len(driven.steps) - 1
        tree = driven.steps.law.tree
        held, target = self.holding(driven, row), target_of(driven)[row]
        track.numbers = {
            name: getattr(driven, name)[row].copy() for name in ("after", "rate", "torque", "limit")
        } | {name: getattr(driven.asked, name)[row].copy() for name in vars(driven.asked)}
        positions = driven.steps.after.joints[row].copy()
        for k, place in enumerate(_coordinates(tree)):
            if place is not None and np.isfinite(target[k]):
                positions[place] = target[k]
        track.needs, track.needs_at_target = held.needs, held.at(positions)
        track.on_the_way = np.full(len(target), np.nan)
        if driven.at_limit.any() and not driven.all_resting[row]:
            now = driven.steps.after.joints[row]
            against = np.sign(target - driven.after[row])
            shares = np.arange(WAY_POSES)[:, None] / WAY_POSES
            ways = against * held.along(now + shares * (positions - now))
            track.on_the_way = np.maximum(np.max(ways, axis=0), np.abs(track.needs_at_target))


def target_of(driven: JointTelemetry) -> Float64:
    """Return the position targets, shape (n, joint_rates); nan where there is none."""
    asked = driven.asked
    motor = np.where((asked.mode == POSITION) & (asked.impulse > 0), asked.target, np.nan)
    return np.where(asked.pd == 1, asked.pd_target, motor)


def _driven(body: Body, steps: BodySteps, track: _Track) -> JointTelemetry:
    tree, asked = steps.law.tree, steps.asked
    places = _coordinates(tree)
    before, after = (
        np.stack(
            [np.full(len(steps), np.nan) if at is None else states.joints[:, at] for at in places],
            axis=1,
        )
        for states in (steps.before, steps.after)
    )
    pd = asked.pd == 1
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = steps.substeps * asked.impulse / steps.reported.timestep_s[:, None]
    limit = np.where(pd, steps.substeps * asked.pd_force, limit)
    torque = steps.reported.motors + steps.reported.pd
    resting = _resting(np.abs(steps.after.velocity), track)
    joint = slice(tree.first_rate, None)
    if steps.covered:
        stopped = np.abs(steps.terms["stops"]) > STOPPED * steps.largest[:, None]
        at_stop = stopped[:, joint]
    else:
        bounded = steps.law.lower <= steps.law.upper
        at_stop = bounded & ((before <= steps.law.lower) | (before >= steps.law.upper))
    return JointTelemetry(
        body=body,
        steps=steps,
        before=before,
        after=after,
        rate=steps.after.velocity[:, joint],
        torque=torque,
        limit=limit,
        at_limit=(limit > 0) & (np.abs(torque) >= AT_LIMIT * limit),
        at_stop=at_stop,
        resting=resting[:, joint],
        all_resting=np.asarray(resting.all(axis=1)),
    )


def _coordinates(tree: Tree) -> list[int | None]:
    """Return the position coordinate of each joint rate; None if it has none."""
    found: list[int | None] = []
    for rates, at in zip(tree.rates, tree.coordinates, strict=True):
        width = rates.stop - rates.start
        found += [at.start] if width == 1 else [None] * width
    return found


def _resting(rates: Float64, track: _Track) -> Flags:
    """Flag the entries of u that are at rest after each step, shape (n, size)."""
    greatest = np.maximum(np.maximum.accumulate(rates, axis=0), track.greatest)
    slow = rates < np.clip(REST_SHARE * greatest, NEVER_MOVED, REST)
    number = np.arange(1, len(rates) + 1)[:, None]
    moved = np.maximum.accumulate(np.where(slow, 0, number), axis=0)
    run = np.where(moved == 0, number + track.quiet, number - moved)
    track.greatest, track.quiet = greatest[-1], run[-1]
    return np.asarray(run >= REST_STEPS)


def _row_of(track: _Track, index: int, k: int, axis: int | None) -> JointRow:
    joint, now = track.body.joints[index], {n: float(v[k]) for n, v in track.numbers.items()}
    control = _control(track.body, now)
    position = control == "position" or control == "pd"
    target = {
        "position": now["target"],
        "pd": now["pd_target"],
        "velocity": now["target_velocity"],
    }.get(control, np.nan)
    reached = now["rate"] if control == "velocity" else now["after"]
    return JointRow(
        name=joint.name,
        index=index,
        axis=axis,
        kind=joint.kind,
        control=control,
        target=_known(target),
        reached=_known(reached),
        off=_known(reached - target),
        torque=_known(now["torque"]),
        force_limit=None if control == "unknown" else _known(now["limit"]),
        needs=_known(float(track.needs[k])),
        needs_at_target=_known(float(track.needs_at_target[k])) if position else None,
        at_force_limit_steps=0 if control == "unknown" else int(track.at_limit[k]),
        at_stop_steps=int(track.at_stop[k]),
    )


def _control(body: Body, now: Mapping[str, float]) -> Control:
    if now["pd"] == 1:
        return "pd"
    if not np.isnan(now["torque_since"]):
        return "torque"
    if now["mode"] == DEFAULT:
        return "unknown" if body.before else "default"
    if not now["impulse"] > 0:
        return "off"
    return "position" if now["mode"] == POSITION else "velocity"


def _known(value: float) -> float | None:
    return value + 0.0 if np.isfinite(value) else None  # no -0.0
