"""Chooses which parts of a long run to explain first, from a quick look at all states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.explain.times import StepTimes
from drop_physics.trace.episodes import Episode
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.states import by_body
from drop_physics.trace.sums import Window

MOST_CLIENTS = 4
"""Maximum number of simulations of which steps are examined: those with the most steps."""
SPAN, LEAST_SPAN, FREEDOMS = 200, 20, 30
"""Maximum and minimum number of steps around a moment, and the number of degrees of freedom up to
which the maximum applies."""
LAST_S = 2.0
"""Duration of the end of an episode that is examined [s]."""
STATES = 1 << 22
"""Maximum number of state values held in memory at once."""


def end_of(episode: Episode, times: StepTimes) -> Window:
    """Return the last two seconds of an episode as a window, or the whole of a shorter episode."""
    begin_s = times.of(episode.last) - LAST_S
    first = times.nearest(begin_s, episode.first, episode.last)
    return episode.client, episode.first if first is None else first, episode.last


def moments_of(seen: Seen, steps: Mapping[int, int]) -> list[Window]:
    """Return the step ranges to explain first: start, end, and the most violent steps.

    The most violent steps are those with the largest velocity and the largest change of velocity,
    and the first in which a call sets a state during the run. `steps` is the number of steps of
    each simulation, by client.
    """
    clients = sorted(steps, key=lambda client: -steps[client])[:MOST_CLIENTS]
    freedoms = {client: _freedoms(seen, client) for client in clients}
    found = {client: _Extremes() for client in clients}
    most = max(1, STATES // max(sum(freedoms.values()), 1))
    for piece in seen.pieces(min(most, 1 << 16)):
        for client in clients:
            found[client].take(*_velocities(seen, piece, client))
    windows = []
    for client in clients:
        n = steps[client]
        span = int(np.clip(SPAN * FREEDOMS // max(freedoms[client], 1), LEAST_SPAN, SPAN))
        puts = (put.at.step for put in seen.puts if put.body.client == client and put.counts)
        middles = [*found[client].steps, *([min(puts, default=0)])]
        spans = [(0, 2 * span), (n - span, n)]
        spans += [(middle - span // 2, middle + span // 2) for middle in middles]
        windows += [(client, *each) for each in _joined(spans, n)]
    return windows


class _Extremes:
    """Where a simulation's largest velocity and largest velocity change occurred."""

    def __init__(self) -> None:
        self._fastest = self._hardest = -1.0
        self._at = [0, 0]
        self._last: Float64 | None = None

    @property
    def steps(self) -> Sequence[int]:
        """The samples of the largest velocity and of the largest change."""
        return self._at

    def take(self, steps: Int64, velocities: Float64) -> None:
        """Update the extremes with the velocities of samples, shape (n, k)."""
        if not velocities.size:
            return
        speed = np.nan_to_num(np.abs(velocities)).max(axis=1)
        if speed.max() > self._fastest:
            self._fastest, self._at[0] = float(speed.max()), int(steps[speed.argmax()])
        change = np.abs(np.diff(velocities, axis=0, prepend=velocities[:1]))
        jump = np.nan_to_num(change).max(axis=1)
        if jump.max() > self._hardest:
            self._hardest, self._at[1] = float(jump.max()), int(steps[jump.argmax()])


def _freedoms(seen: Seen, client: int) -> int:
    return sum(body.freedoms for body in seen.bodies.values() if body.client == client)


def _velocities(seen: Seen, piece: Piece, client: int) -> tuple[Int64, Float64]:
    """Return the samples in a chunk that follow a step, and all velocities in them, (n, k)."""
    columns: list[Float64] = []
    steps = np.empty(0, np.int64)
    for number, rows in by_body(piece.bases).items():
        if seen.bodies[number].client == client:
            steps = rows["step"]
            columns += [rows["velocity_m_s"], rows["spin_rad_s"]]
    for number, joints in piece.joints.items():
        if seen.bodies[number].client == client:
            steps = joints.steps
            columns.append(joints.velocity)
    same = [column for column in columns if len(column) == len(steps)]
    return steps, np.hstack(same) if same else np.empty((0, 0))


def _joined(spans: Sequence[tuple[int, int]], n: int) -> list[tuple[int, int]]:
    """Clip spans to the run, and merge those that overlap."""
    found: list[tuple[int, int]] = []
    for first, end in sorted((max(a, 0), min(b, n)) for a, b in spans):
        if end <= first:
            continue
        if found and first <= found[-1][1]:
            found[-1] = found[-1][0], max(end, found[-1][1])
        else:
            found.append((first, end))
    return found
