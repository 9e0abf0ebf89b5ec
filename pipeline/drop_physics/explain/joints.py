"""The joints in the steps of a chunk: commands, positions, efforts, and efforts to hold a pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.carrying import reactions_of
from drop_physics.explain.commands import Commanded
from drop_physics.explain.needs import PoseSupport, holding
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.steps import BodySteps
from drop_physics.physics.reactions import Reactions
from drop_physics.physics.tree import Tree
from drop_physics.trace.events import Body, Site, located
from drop_physics.trace.history import Seen
from drop_physics.trace.motors import POSITION

REST_STEPS = 10
REST_SHARE, REST, NEVER_MOVED = 1e-3, 1e-3, 1e-5
"""A joint is at rest while its rate is below REST_SHARE of its highest rate, or below REST [rad/s,
m/s] if that is lower; a joint whose rate never exceeded NEVER_MOVED always is."""
WAY_POSES = 32
"""Number of poses between start and target at which the static torque is computed."""
AT_LIMIT = 1 - 1e-6
STOPPED = 1e-6
"""A joint stop whose impulse is below this share of the step's largest impulse is ignored."""


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
    """Maximum torque or force of each motor [N m or N]; with several substeps, the sum over the
    substeps."""
    at_limit: Flags
    at_stop: Flags
    """Whether the joint was pushed by its position limit."""
    resting: Flags
    """Whether the joint has been at rest for the last ten steps."""
    all_resting: Flags
    """Whether all degrees of freedom of the body are at rest, shape (n,)."""

    @property
    def asked(self) -> Commanded:
        """The motor commands in effect."""
        return self.steps.asked


@dataclass(frozen=True, eq=False)
class PoseEfforts:
    """Joint torques at the end of a chunk, for a body's pose; shape (joint_rates,) each."""

    needs: Float64
    """Torque required to hold the last pose [N m] or [N]; nan if undefined."""
    needs_at_target: Float64
    """Torque required to hold the pose with each joint at its target; nan if undefined."""
    on_the_way: Float64
    """Largest torque that a motor at its limit would need on the path to its target.

    The path is a straight line in joint space from the last pose to the targets of all joints. The
    torque is the largest needed in the direction of the target to hold one of these poses, or in
    either direction to hold the pose at the target. It is nan if unknown, and for a joint at rest.
    """
    reactions: Reactions | None
    """Forces and torques across the joints in the last step; None if unknown."""

    def at_target(self, joint_rate: int) -> float | None:
        """Return the torque that holds the pose with a joint at its target; None if undefined."""
        needs = float(self.needs_at_target[joint_rate])
        return needs if np.isfinite(needs) else None


@dataclass(eq=False)
class _Pace:
    """The highest rates of a body so far, and how long each has been near 0; shape (size,) each."""

    greatest: Float64
    """The highest rate so far of each entry of u."""
    quiet: Int64
    """Number of steps since each entry of u came to rest."""


class DrivenJoints:
    """The joints of all bodies, with their commands, in the latest chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._sites: Mapping[int, Site] = {}
        self._paces: dict[int, _Pace] = {}
        self._explained: ExplainedPiece | None = None
        self.latest: dict[int, list[JointTelemetry]] = {}
        """Telemetry of the joints in the latest chunk, by body id."""
        self.efforts: dict[int, PoseEfforts] = {}
        """Efforts at the end of the last chunk in which the body has samples, by body id."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
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
            self.efforts[number] = self._efforts(found[-1])

    def forget(self) -> None:
        """Free the latest chunk."""
        self._explained, self.latest = None, {}

    def site(self, number: float) -> Site | None:
        """Return the script line of a command, by the id that `Commanded` refers to."""
        return None if np.isnan(number) else self._sites.get(int(number))

    def cited(self, number: float) -> str | None:
        """Return file and line of a command, by the same id."""
        site = self.site(number)
        return None if site is None else located(site.file, site.line)

    def holding(self, driven: JointTelemetry, row: int) -> PoseSupport:
        """Return the forces that hold a body's pose after a step of the latest chunk."""
        assert self._explained is not None
        return holding(
            self._explained,
            self._seen.bodies,
            driven.steps,
            row,
            number=driven.body.number,
            resting=bool(driven.all_resting[row]),
        )

    def _driven(self, body: Body, steps: BodySteps) -> JointTelemetry:
        size = steps.law.tree.size
        pace = self._paces.get(body.number)
        if pace is None or len(pace.greatest) != size:
            pace = self._paces[body.number] = _Pace(np.zeros(size), np.zeros(size, np.int64))
        return _driven(body, steps, pace)

    def _efforts(self, driven: JointTelemetry) -> PoseEfforts:
        """Return the torques that would hold the pose at the end of the latest chunk."""
        row = len(driven.steps) - 1
        tree = driven.steps.law.tree
        held, target = self.holding(driven, row), target_of(driven)[row]
        positions = driven.steps.after.joints[row].copy()
        for k, place in enumerate(_coordinates(tree)):
            if place is not None and np.isfinite(target[k]):
                positions[place] = target[k]
        needs, needs_at_target = held.needs, held.at(positions)
        on_the_way = np.full(len(target), np.nan)
        if driven.at_limit.any() and not driven.all_resting[row]:
            now = driven.steps.after.joints[row]
            against = np.sign(target - driven.after[row])
            shares = np.arange(WAY_POSES)[:, None] / WAY_POSES
            ways = against * held.along(now + shares * (positions - now))
            on_the_way = np.maximum(np.max(ways, axis=0), np.abs(needs_at_target))
        reactions = reactions_of(driven.steps, row)
        return PoseEfforts(needs, needs_at_target, on_the_way, reactions)


def target_of(driven: JointTelemetry) -> Float64:
    """Return the joints' position targets, shape (n, joint_rates); nan without a target."""
    asked = driven.asked
    motor = np.where((asked.mode == POSITION) & (asked.impulse > 0), asked.target, np.nan)
    return np.where(asked.pd == 1, asked.pd_target, motor)


def _driven(body: Body, steps: BodySteps, pace: _Pace) -> JointTelemetry:
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
    resting = _resting(np.abs(steps.after.velocity), pace)
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
    """Return the index of each joint rate's position; None for rates of spherical joints."""
    found: list[int | None] = []
    for rates, at in zip(tree.rates, tree.coordinates, strict=True):
        width = rates.stop - rates.start
        found += [at.start] if width == 1 else [None] * width
    return found


def _resting(rates: Float64, pace: _Pace) -> Flags:
    """Flag the velocities that have been near 0 for a while after each step, shape (n, size)."""
    greatest = np.maximum(np.maximum.accumulate(rates, axis=0), pace.greatest)
    slow = rates < np.clip(REST_SHARE * greatest, NEVER_MOVED, REST)
    number = np.arange(1, len(rates) + 1)[:, None]
    moved = np.maximum.accumulate(np.where(slow, 0, number), axis=0)
    run = np.where(moved == 0, number + pace.quiet, number - moved)
    pace.greatest, pace.quiet = greatest[-1], run[-1]
    return np.asarray(run >= REST_STEPS)
