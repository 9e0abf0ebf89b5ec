"""The episodes of a run, one row each: how it ended, joints at their limits, and contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drop_physics.account.names import Names
from drop_physics.account.touches import LIMIT, PairKey
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import PRESSED, Pairs, Points
from drop_physics.explain.driving import control_of, limited_motors
from drop_physics.explain.joints import JointTelemetry
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.times import StepTimes
from drop_physics.physics.vectors import distinct_rows
from drop_physics.trace.episodes import Episode
from drop_physics.trace.history import Seen

SLIPS_M_S = 0.01
"""Minimum slip speed of a contact whose friction is at its limit."""
LASTING, MOSTLY = 0.05, 0.9
"""A joint at its limit at the end is reported if it was there for at least the share LASTING of the
episode, in at least the share MOSTLY of those steps."""


@dataclass(frozen=True, kw_only=True)
class AtEnd:
    """A joint that is at a limit when an episode ends, and for how long."""

    body: str
    """The label of its body."""
    joint: str
    """Name of the joint, with the axis where it has three."""
    at_stop: bool
    """Whether the limit is the joint's stop; otherwise it is the limit of its drive."""
    limit: float | None
    """The largest torque [N m] or force [N] of the drive; None if unknown, and for a stop."""
    unit: str
    """The unit of the limit."""
    since_s: float
    """Simulated time from which the joint is at the limit in nine of ten steps."""


@dataclass(frozen=True, kw_only=True)
class FirstContact:
    """A contact of two links that had no contact earlier in the episode."""

    links: tuple[str, str]
    """Names of the links."""
    step: int
    """The sample after the first step in contact."""
    time_s: float
    """Simulated time of that sample."""


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """One episode of a run."""

    number: int
    """Number of the episode, from 1."""
    client: int
    """The number of its simulation."""
    first_step: int
    """The sample from which the episode starts."""
    last_step: int
    """The sample with which the episode ends."""
    start_s: float
    """Simulated time of the first sample, which keeps counting over episodes."""
    end_s: float
    """Simulated time of the last sample."""
    kept: bool
    """Whether the episode's steps are recorded; otherwise only its ending is known."""
    ended: str
    """`terminated` or `truncated`, as returned by the environment; `reset`, by a call or by writing
    an initial state; or `run`: the run ended."""
    why: str | None
    """Reason for the termination, as far as the environment reports one."""
    failed: bool
    """Whether the episode was terminated, or, if the environment reports its goal, whether the goal
    was missed."""
    success: bool | None
    """Whether the environment's goal was reached; None if the environment reports no goal."""
    length: int | None
    """Number of calls of the environment's `step`; None without an environment."""
    reward: float | None
    """The return: the sum of the rewards; None without an environment."""
    at_limit: float | None
    """Share of the episode's steps in which the drive of a joint is at its limit; None without
    drives."""
    at_stop: float | None
    """Share of the episode's steps in which a joint is at its stop; None without joints."""
    slipping: float | None
    """Share of the episode's explained steps in which a contact slips with friction at its limit;
    None if no step is explained."""
    at_end: Sequence[AtEnd]
    """The joints that are at a limit or a stop at the end; only for the episode that the account
    covers, empty for others."""
    first_contact: FirstContact | None
    """The first contact in the second half of the episode between two links that did not touch in
    its first half."""


@dataclass(eq=False)
class _Counts:
    """Counts of an episode so far: steps, joints at limits, contacts."""

    driven: int = 0
    jointed: int = 0
    at_limit: int = 0
    at_stop: int = 0
    touching: int = 0
    slipping: int = 0
    touched: dict[PairKey, int] = field(default_factory=dict)
    """The first sample in contact of each pair of links."""


@dataclass(eq=False)
class _Held:
    """Flags for each step: whether a joint's drive is at its limit, or the joint at its stop."""

    steps: list[Int64] = field(default_factory=list)
    at_limit: list[Flags] = field(default_factory=list)
    at_stop: list[Flags] = field(default_factory=list)
    limit: float = np.inf


class EpisodeTable:
    """The table of episodes, filled chunk by chunk.

    Parameters
    ----------
    seen
        The recorded data of the run.
    times
        Times of steps by client.
    episodes
        All episodes of the run.
    looked_at
        The episode that the account covers, whose joints at limits are listed; None for none.
    """

    def __init__(
        self,
        seen: Seen,
        times: Mapping[int, StepTimes],
        episodes: Sequence[Episode],
        looked_at: Episode | None,
    ) -> None:
        self._seen, self._times, self._episodes = seen, times, episodes
        self._looked_at, self._names = looked_at, Names(seen.bodies, seen.dynamics)
        self._counts = [_Counts() for _ in episodes]
        self._held: dict[tuple[int, int], _Held] = {}
        """States of joints at their limits, by body and rate."""
        self._of_client: dict[int, list[int]] = {}
        for k, episode in enumerate(episodes):
            self._of_client.setdefault(episode.client, []).append(k)

    def see(
        self,
        explained: ExplainedPiece,
        joints: Mapping[int, Sequence[JointTelemetry]],
        pairs: Pairs,
    ) -> None:
        """Add a chunk of explained steps, with its joints (by body id) and contact points."""
        for number, parts in joints.items():
            client = self._seen.bodies[number].client
            for driven in parts:
                for k, its in self._within(client, driven.steps.steps):
                    self._joints(k, driven, its, explained)
        self._contacts(pairs)

    def rows(self) -> list[EpisodeRow]:
        """Return one row per episode, in order."""
        return [*map(self._row, self._episodes, self._counts)]

    def _within(self, client: int, steps: Int64) -> Iterator[tuple[int, slice]]:
        """Yield the episodes that overlap the given steps, by index, with those steps."""
        for k in self._of_client.get(client, ()):
            episode = self._episodes[k]
            if episode.first < steps[-1] and steps[0] <= episode.last:
                first, end = np.searchsorted(steps, (episode.first + 1, episode.last + 1))
                if first < end:
                    yield k, slice(int(first), int(end))

    def _joints(
        self, k: int, driven: JointTelemetry, its: slice, explained: ExplainedPiece
    ) -> None:
        counts, steps = self._counts[k], driven.steps.steps[its]
        at_limit, limits = _limited(driven, explained)
        counts.jointed += len(steps)
        counts.at_stop += int(driven.at_stop[its].any(axis=1).sum())
        if np.isfinite(limits).any():
            counts.driven += len(steps)
            counts.at_limit += int(at_limit[its].any(axis=1).sum())
        if self._episodes[k] != self._looked_at:
            return
        for rate in range(at_limit.shape[1]):
            held = self._held.setdefault((driven.body.number, rate), _Held())
            held.steps.append(steps.copy())
            held.at_limit.append(at_limit[its, rate].copy())
            held.at_stop.append(driven.at_stop[its, rate].copy())
            held.limit = float(limits[rate])

    def _contacts(self, pairs: Pairs) -> None:
        points = pairs.points
        if not len(points):
            return
        pressed = points.normal_n > PRESSED
        rubs_n = np.linalg.norm(points.tangential_n, axis=1)
        slips = pressed & (rubs_n >= LIMIT * points.friction * points.normal_n)
        slips &= np.linalg.norm(points.slip_m_s, axis=1) > SLIPS_M_S
        for client in self._of_client:
            mine = [body.number for body in self._seen.bodies.values() if body.client == client]
            rows = np.flatnonzero(pressed & np.isin(points.body, mine).any(axis=1))
            if not len(rows):
                continue
            for k, its in self._within(client, points.step[rows]):
                self._touch(self._counts[k], points, rows[its], slips)

    def _touch(self, counts: _Counts, points: Points, rows: Int64, slips: Flags) -> None:
        counts.touching += len(np.unique(points.step[rows]))
        counts.slipping += len(np.unique(points.step[rows[slips[rows]]]))
        keys = np.concatenate((points.body[rows], points.link[rows]), axis=1)
        kinds, first, _ = distinct_rows(keys)
        for (a, b, i, j), at in zip(kinds.tolist(), first.tolist(), strict=True):
            counts.touched.setdefault((a, b, i, j), int(points.step[rows[at]]))

    def _row(self, episode: Episode, counts: _Counts) -> EpisodeRow:
        times, told = self._times[episode.client], episode.told
        return EpisodeRow(
            number=episode.number,
            client=episode.client,
            first_step=episode.first,
            last_step=episode.last,
            start_s=times.of(episode.first),
            end_s=times.of(episode.last),
            kept=episode.kept,
            ended=episode.ended,
            why=None if told is None or not told.why else told.why,
            failed=episode.failed,
            success=None if told is None else told.success,
            length=None if told is None else told.length,
            reward=None if told is None else told.reward,
            at_limit=counts.at_limit / counts.driven if counts.driven else None,
            at_stop=counts.at_stop / counts.jointed if counts.jointed else None,
            slipping=counts.slipping / counts.touching if counts.touching else None,
            at_end=[*self._at_end(episode)] if episode == self._looked_at else [],
            first_contact=self._first_contact(episode, counts),
        )

    def _first_contact(self, episode: Episode, counts: _Counts) -> FirstContact | None:
        late = (episode.first + episode.last) / 2
        new = [(step, key) for key, step in counts.touched.items() if step > late]
        if not new:
            return None
        step, (a, b, i, j) = min(new)
        links = self._names.pair((a, b, i, j))
        return FirstContact(links=links, step=step, time_s=self._times[episode.client].of(step))

    def _at_end(self, episode: Episode) -> Iterator[AtEnd]:
        """Yield the joints that are at a limit until the end of the examined episode."""
        times, least = self._times[episode.client], LASTING * (episode.last - episode.first)
        for (number, rate), held in self._held.items():
            body, steps = self._seen.bodies[number], np.concatenate(held.steps)
            joint = next(
                joint
                for joint, place in zip(body.joints, body.rates, strict=True)
                if place.start <= rate < place.stop
            )
            for at_stop, parts in ((False, held.at_limit), (True, held.at_stop)):
                since = _since(np.concatenate(parts))
                if len(steps) - since > max(least, 1):
                    yield AtEnd(
                        body=body.label,
                        joint=self._names.rate(body, rate),
                        at_stop=at_stop,
                        limit=held.limit if np.isfinite(held.limit) and not at_stop else None,
                        unit="N" if joint.kind == "prismatic" else "N m",
                        since_s=times.of(int(steps[since])),
                    )


def _since(flags: Flags) -> int:
    """Return the first row from which a flag is set in most rows to the end, or the length."""
    n = len(flags)
    after = np.cumsum(flags[::-1])[::-1] >= MOSTLY * np.arange(n, 0, -1)
    found = np.flatnonzero(after & flags)
    return int(found[0]) if len(found) and flags[-1] else n


def _limited(driven: JointTelemetry, explained: ExplainedPiece) -> tuple[Flags, Float64]:
    """Flag the joint drives at their limits, and return the largest torque of each drive.

    A drive is a motor, or an actuator whose control or force is at an end of its range.
    """
    body, ends = driven.body, driven.steps.steps
    at_limit = driven.at_limit.copy()
    limits = np.where(driven.limit[-1] > 0, driven.limit[-1], np.inf)
    controls = {each: control_of(each, body, explained.piece, ends) for each in body.actuators}
    for rate, at_end, most in limited_motors(body, controls):
        at_limit[:, rate] |= at_end
        limits[rate] = min(limits[rate], most)
    return at_limit, limits
