"""The episodes of a run: each from a reset, or from a written start state, to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from drop_physics.arrays import Int64
from drop_physics.errors import ScenarioError
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Appearance, At, EpisodeEnd, Put, order
from drop_physics.trace.history import Seen
from drop_physics.trace.states import by_body, motion_of

OFTEN = 0.2
"""Share of a simulation's steps. A script that moves bodies by calls before more steps than this
drives the motion by calls: its moves do not start episodes."""
MOVED = 1e-9
"""A state write that changes positions by less than this [m, rad] counts as changing velocities
only."""

MOST_LOOKED = 64
"""Number of episode starts of a simulation that are examined; further ones are assumed to be
similar."""


@dataclass(frozen=True)
class Episode:
    """The steps of a simulation from one start state to the next."""

    number: int
    """Number of the episode, from 1."""
    client: int
    first: int
    """The first sample: the start state."""
    last: int
    """The last sample."""
    ended: str
    """How the episode ended: `terminated` or `truncated`, as the environment reported; `reset`; or
    `run`, with the end of the run."""
    told: EpisodeEnd | None = None
    """The environment's report, if there was one."""

    @property
    def kept(self) -> bool:
        """True if the episode's steps are recorded; otherwise only its end is known."""
        return self.last > self.first

    @property
    def failed(self) -> bool:
        """True if the episode ended without reaching its goal, as the environment reported."""
        return self.told is not None and self.told.failed


def episode_at(episodes: Sequence[Episode], client: int, steps: Int64 | Sequence[int]) -> Int64:
    """Return the episode number for each step that leads to a sample; 0 for none."""
    its = [(e.first, e.last, e.number) for e in episodes if e.client == client and e.kept]
    if not its:
        return np.zeros(len(steps), np.int64)
    first, last, number = np.array(sorted(its), np.int64).T
    which = np.maximum(np.searchsorted(first, steps) - 1, 0)  # the last that starts before it
    within = (first[which] < steps) & (np.asarray(steps) <= last[which])
    return np.where(within, number[which], 0)


def looked_at(episodes: Sequence[Episode], number: int | None) -> Episode | None:
    """Return an episode by number; without a number, the last failed episode.

    Raises
    ------
    ScenarioError
        If there is no such episode, or its steps were not recorded.
    """
    if number is None:
        return next((each for each in reversed(episodes) if each.failed and each.kept), None)
    if not 1 <= number <= len(episodes):
        raise ScenarioError(
            "--episode must be from 1 to {count}, got {number}",
            count=len(episodes),
            number=number,
        )
    if not episodes[number - 1].kept:
        raise ScenarioError(
            "--episode must be of an episode whose steps are recorded, got {number}, of which only "
            "the end is; drop record --episodes {number}, before the script, keeps them",
            number=number,
        )
    return episodes[number - 1]


def episodes_of(seen: Seen) -> list[Episode]:
    """Return the episodes of all simulations in the order in which they end.

    If environments reported episodes, these are returned. Otherwise an episode begins when
    everything is removed, or when calls move all movable bodies of a simulation at once, unless
    they do so in many steps.
    """
    told: dict[int, list[EpisodeEnd]] = {}
    for each in seen.episode_ends:
        told.setdefault(each.client, []).append(each)
    found = [
        (each.at, Episode(0, each.client, each.first, each.at.step, each.how, each))
        for ends in told.values()
        for each in ends
    ]
    for client, samples in seen.samples.items():
        if client not in told and samples > 1:
            found += _between(seen, client, samples - 1)
    found.sort(key=lambda each: order(each[0]))
    return [replace(episode, number=k) for k, (_, episode) in enumerate(found, 1)]


def _between(seen: Seen, client: int, end: int) -> Iterator[tuple[At, Episode]]:
    """Yield the episodes of a simulation, split at its start states."""
    starts = [At(0, 0.0, 0), *_starts(seen, client, end)]
    last = At(end, np.inf, 1 << 62)
    for first, then in pairwise([*starts, last]):
        how = "run" if then is last else "reset"
        yield then, Episode(0, client, first.step, then.step, how)


def _starts(seen: Seen, client: int, end: int) -> list[At]:
    """Return the times at which a simulation is reset after its first step."""
    mine = [each for each in seen.appearances if each.body.client == client]
    came = {each.at.step for each in mine if each.came}
    found = {
        each.at.step: each.at
        for each in mine
        if not each.there and 0 < each.at.step < end and each.at.step in came
        if not _there(mine, each.at)  # everything was removed, and something came in its place
    }
    puts: dict[int, list[Put]] = {}
    for put in seen.puts:
        if put.counts and 0 < put.at.step < end and put.body.client == client:
            puts.setdefault(put.at.step, []).append(put)
    if len(puts) > OFTEN * end:
        return [found[step] for step in sorted(found)]
    for number, (step, here) in enumerate(sorted(puts.items())):
        looked = number < MOST_LOOKED
        if _there(mine, here[-1].at) <= {put.body.number for put in here}:
            begins = not looked or _moves(seen, step, here)
        else:
            begins = looked and _is_reset(seen, client, step)
        if begins:
            found.setdefault(step, here[0].at)
    return [found[step] for step in sorted(found)]


def _is_reset(seen: Seen, client: int, step: int) -> bool:
    """Return whether a call before a step resets the whole state, even if no body moves."""
    calls = seen.sampled.piece(step, step + 1).calls.of(Act.RESET_STATE, Act.RESTORE)
    return any((each.client, each.at.step) == (client, step) for each in calls)


def _there(appearances: Iterable[Appearance], at: At) -> set[int]:
    """Return the ids of the movable bodies that exist at a moment."""
    there: set[int] = set()
    for each in appearances:
        if order(each.at) > order(at):
            break
        body = each.body
        if each.there and body.moving and not body.soft:
            there.add(body.number)
        elif not each.there:
            there.discard(body.number)
    return there


def _moves(seen: Seen, step: int, puts: Iterable[Put]) -> bool:
    """Return whether calls moved bodies away from where the previous step left them."""
    piece = seen.sampled.piece(step, step + 1)
    bases = by_body(piece.bases)
    for put in puts:
        number = put.body.number
        if number in bases and np.abs(motion_of(bases[number])[0] - put.base)[:7].max() > MOVED:
            return True
        joints = piece.joints.get(number)
        if joints is None or joints.position.shape[1:] != put.position.shape:
            continue
        if np.abs(joints.position[0] - put.position).max(initial=0.0) > MOVED:
            return True
    return False
