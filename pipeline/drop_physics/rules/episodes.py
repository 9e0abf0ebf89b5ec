"""Finds episodes: the steps that follow a saved, restored or written state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.rules.arguments import given
from drop_physics.rules.chunk import StepChunk
from drop_physics.trace.acts import FILTERS, MAKES, PUSHES, Act
from drop_physics.trace.calls import Call
from drop_physics.trace.history import Seen

STATES = Act.SAVE, Act.RESTORE, Act.CLEAR
"""Calls that begin an episode."""
BY_HAND = Act.SET_POSE, Act.SET_VELOCITY, Act.SET_JOINT
"""Calls that set a state directly: the first of these between two steps also begins an episode."""
SETTINGS = Act.SET_GRAVITY, Act.SET_TIMESTEP, Act.SET_ENGINE
"""Calls that change settings of the engine."""
SETS = (
    *(Act.SET_PROPERTY, Act.CONSTRAIN, Act.CHANGE_CONSTRAINT, Act.RELEASE, Act.COMMAND),
    *SETTINGS,
    *FILTERS,
)
"""Settings that stay in effect when a new episode begins."""
UNREPORTED = frozenset(
    (
        *("linearDamping", "angularDamping", "jointDamping", "maxJointVelocity"),
        *("jointLowerLimit", "jointUpperLimit", "activationState"),
    )
)
"""Properties that the engine never reports, so that a call that sets them may change something."""
IDS = "Id", "Index", "Indices", "Mode"
"""Suffixes of arguments that identify the target of a setter, instead of a value."""
Named = tuple[object, ...]
"""Target of a call: function and arguments, and the body and joint that it identifies."""
Key = tuple[int, str]
"""Key of a body: its simulation, and the id used by its reader, since a body may be
loaded again."""


def named(call: Call) -> Named:
    """Return a key for the quantity that a call sets, such as a body's pose."""
    site = call.site
    ids = tuple([call.numbers[at] for name, at in site.places.items() if name.endswith(IDS)])
    return call.client, site.function, site.names, ids


@dataclass
class AfterRestore:
    """An episode: the steps after a state was restored or written."""

    begin: Call
    end: int = 0
    """Number of steps before the next episode."""
    calls: dict[int, int] = field(default_factory=dict)
    """Combined effect of all calls between two steps, by the number of steps since the episode
    began."""
    again: set[Named] = field(default_factory=set)
    """Quantities that calls set before the episode's first step."""
    sets: dict[Named, tuple[tuple[float, ...] | None, Call]] = field(default_factory=dict)
    """Quantities set during the episode: the values before it, and the latest call."""
    starts: dict[Key, Float64] = field(default_factory=dict)
    """The state of each body before the first step of the episode."""
    touched: set[tuple[int, ...]] = field(default_factory=set)
    """The bodies and links in contact in the episode's first step, each pair once."""

    @property
    def kind(self) -> tuple[object, ...]:
        """A key for episodes that can be compared: the same saved state, or the same call."""
        act, client = self.begin.act, self.begin.client
        if act is Act.SAVE:
            return client, self.begin.result
        if act is Act.RESTORE:
            return client, *(given(self.begin, "stateId") or (self.begin.arguments,))
        return client, *((act,) if act is Act.CLEAR else BY_HAND)


@dataclass
class Episodes:
    """The episodes of a recording, filled chunk by chunk."""

    ended: list[AfterRestore] = field(default_factory=list)
    _now: dict[int, AfterRestore] = field(default_factory=dict)
    """The current episode of each client."""
    _set: dict[Named, tuple[float, ...]] = field(default_factory=dict)
    """The arguments of the latest call of each setter."""

    def all(self) -> Iterator[AfterRestore]:
        """Yield all episodes, in order within each simulation."""
        yield from self.ended
        yield from self._now.values()

    def between(self, first: AfterRestore, second: AfterRestore) -> Iterator[AfterRestore]:
        """Yield an episode and later ones of its simulation, up to the episode `second`."""
        for each in self.all():
            same = each.begin.client == first.begin.client
            if same and first.begin.at.call <= each.begin.at.call < second.begin.at.call:
                yield each

    def see(self, chunk: StepChunk, seen: Seen) -> None:
        """Add the calls and states of a chunk."""
        calls = chunk.piece.calls
        if not any(site.act in (*STATES, *BY_HAND) for site in calls.sites.values()):
            return  # in the whole recording nothing begins an episode
        pending = calls.of()
        for client in {body.client for body in seen.bodies.values()}:
            for call in [each for each in pending if each.client == client]:
                now = self._now.get(client)
                new = now is None or now.begin.at.step != call.at.step
                if call.act in STATES or (new and call.act in BY_HAND):
                    self._begin(chunk, client, call)
                else:
                    self._take(seen, now, call)
            if client in self._now:
                samples = seen.samples.get(client, chunk.piece.end)
                self._until(chunk, self._now[client], min(samples, chunk.piece.end) - 1)

    def _begin(self, chunk: StepChunk, client: int, call: Call) -> None:
        if (before := self._now.pop(client, None)) is not None:
            self._until(chunk, before, call.at.step)
            self.ended.append(before)
        self._now[client] = AfterRestore(call)

    def _take(self, seen: Seen, now: AfterRestore | None, call: Call) -> None:
        """Note a call, and the quantity that it sets."""
        pushes = call.act in PUSHES
        if now is not None:
            since = call.at.step - now.begin.at.step
            now.calls[since] = hash((now.calls.get(since), call.function, call.numbers))
            if since == 0:
                now.again.add(named(call))
        if not pushes and call.act not in (*SETS, *MAKES):
            return
        what = named(call)
        if now is not None and (pushes or what in self._set or _changes(seen, call)):
            before, _ = now.sets.get(what, (self._set.get(what), call))
            now.sets[what] = before, call
        if not pushes:
            self._set[what] = call.numbers

    def _until(self, chunk: StepChunk, episode: AfterRestore, end: int) -> None:
        """Note that an episode lasts up to a sample; keep the states that its bodies start from."""
        episode.end, start = end, episode.begin.at.step
        # A force that no step has used yet waits for the next episode's; used, it is gone.
        episode.sets = {
            what: (before, call)
            for what, (before, call) in episode.sets.items()
            if call.act not in PUSHES or call.at.step == end
        }
        if not chunk.piece.first <= start + 1 < chunk.piece.end:
            return
        for judged in chunk.judged.values():
            if judged.body.client != episode.begin.client:
                continue
            for steps in judged.intervals:
                if not start < end or not np.isin(start + 1, steps.steps):
                    continue
                row = int(np.searchsorted(steps.steps, start + 1))
                first = steps.before.at(slice(row, row + 1))
                episode.starts[judged.body.engine_id, judged.body.label] = np.hstack(
                    (first.position_m, first.orientation, first.joints, first.velocity)
                )[0]
                its = steps.sides.at(steps.sides.step == start + 1)
                pairs = np.stack((its.body, its.link, its.other_body, its.other_link), axis=1)
                episode.touched |= {
                    min((a, b, c, d), (c, d, a, b)) for a, b, c, d in pairs.tolist()
                }


def _changes(seen: Seen, call: Call) -> bool:
    """Return whether a setter's first call changed the value that the engine reported."""
    body = given(call, "bodyUniqueId")
    if call.act is Act.SET_PROPERTY:
        if UNREPORTED & call.site.places.keys():
            return True
        ends = [
            each.at
            for each in seen.dynamics
            if (each.body.client, each.body.engine_id) == (call.client, *body)
        ]
    elif call.act in SETTINGS:
        ends = [each.at for each in seen.settings if each.client == call.client]
    else:
        return True
    # A row is written where one changed, before the next step.
    return any(at.step == call.at.step and at.call >= call.at.call for at in ends)
