"""The calls of a script in a range of steps, with the bodies that each call concerns."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from drop_physics.arrays import Flags, Int64
from drop_physics.trace.acts import FILTERS, MAKES, PUSHES, Act
from drop_physics.trace.calls import BODY_NAMES, WORLD_FRAME, Call, Given, Push
from drop_physics.trace.events import Appearance, At, Calls, Raised, Site, order, widths_of
from drop_physics.trace.motors import Command, commands_of
from drop_physics.trace.properties import link_reached

PAIR = ("bodyUniqueIdA", "bodyUniqueIdB", "bodyUniqueId")
"""Arguments of the calls that filter contacts: for two bodies, or for one."""
BEFORE_ALL = -(1 << 62)
"""A number smaller than that of any call."""


class Log:
    """The calls in a range of steps, with the bodies that each call concerns.

    Parameters
    ----------
    rows
        The recorded calls.
    sites
        The call sites, by number.
    raised
        The errors that calls raised.
    appearances
        The appearances of all bodies.
    """

    def __init__(
        self,
        rows: Iterable[Calls] = (),
        sites: Mapping[int, Site] | None = None,
        raised: Iterable[Raised] = (),
        appearances: Iterable[Appearance] = (),
    ) -> None:
        self.sites = sites or {}
        self._rows = [(row, widths_of(row, self.sites)) for row in rows]
        self._known: dict[frozenset[int], list[Call]] = {}
        self._errors = {each.at.call: each.error for each in raised}
        self._came: dict[tuple[int, int], list[Appearance]] = {}
        """Appearances of the bodies that had an id, by client and the engine's id."""
        for appearance in appearances:
            if appearance.came:
                key = appearance.body.client, appearance.body.engine_id
                self._came.setdefault(key, []).append(appearance)
        self._lives: dict[tuple[int, int], list[tuple[int, int | None]]] | None = None
        self._borne: dict[tuple[int, int], tuple[list[Appearance], list[int], list[int]]] = {}

    def between(self, first: int, end: int) -> Log:
        """Return the calls made after at least `first` and fewer than `end` steps."""
        log = Log((), self.sites)
        log._errors, log._came = self._errors, self._came
        log._rows = [
            (_only(row, (row.steps >= first) & (row.steps < end), widths))
            for row, widths in self._rows
        ]
        return log

    # -- calls ------------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[Call]:
        """Yield all calls in order."""
        yield from self._made({*self.sites})

    def of(self, *acts: Act) -> list[Call]:
        """Return the successful calls with any of the given acts; without any act, all of them."""
        sites = {n for n, site in self.sites.items() if not acts or site.act in acts}
        return [call for call in self._made(sites) if not call.raised]

    def named(self, function: str) -> list[Call]:
        """Return the calls of a function by its name."""
        return self._made({n for n, site in self.sites.items() if site.function == function})

    def with_argument(self, *names: str) -> list[Call]:
        """Return the successful calls that set any of the given arguments."""
        sites = {n for n, site in self.sites.items() if {*names} & site.places.keys()}
        return [call for call in self._made(sites) if not call.raised]

    def failed(self) -> list[Call]:
        """Return the calls that raised an error."""
        return [call for call in self if call.raised] if self._errors else []

    def commands(self) -> Iterator[Command]:
        """Yield the motor commands in successful calls, grouped by site, not in time order."""
        failed = [*self._errors]
        for row, widths in self._rows:
            for command in commands_of(row, self.sites, widths):
                yield command.only(~np.isin(command.calls, failed)) if failed else command

    def _made(self, sites: set[int]) -> list[Call]:
        """Return the calls of the given sites in order, cached because many rules read them."""
        key = frozenset(sites)
        if key not in self._known:
            self._known[key] = self._calls_of(sites)
        return self._known[key]

    def _calls_of(self, sites: set[int]) -> list[Call]:
        made = []
        for row, widths in self._rows:
            which = np.flatnonzero(np.isin(row.sites, [*sites]))
            ends = np.cumsum(widths)
            numbers = row.numbers.tolist() if len(which) else []
            for step, time_s, number, site, result, start, end in zip(
                *(
                    each[which].tolist()
                    for each in (
                        row.steps,
                        row.times_s,
                        row.calls,
                        row.sites,
                        row.results,
                        ends - widths,
                        ends,
                    )
                ),
                strict=True,
            ):
                at, given = At(step, time_s, number), tuple(numbers[start:end])
                error = self._errors.get(number, "")
                made.append(Call(at, row.client, self.sites[site], given, result, error))
        return sorted(made, key=lambda call: call.at.call)

    # -- the bodies that they are about -----------------------------------------------------------

    def of_bodies(self, *acts: Act) -> Iterator[tuple[Call, At, Appearance]]:
        """Yield the calls with any of the given acts, each with its moment and its body.

        A new body is recorded before the next step: calls before that are dated to the body's
        appearance.
        """
        for call in self.of(*acts):
            place = next((at for name in BODY_NAMES if (at := call.site.places.get(name))), None)
            came = None if place is None else self.body_at(call, int(call.numbers[place.start]))
            if came is not None:
                yield call, max(call.at, came.at, key=order), came

    def body_at(self, call: Call, engine_id: int) -> Appearance | None:
        """Return the body with an engine id at a call, or that gets the id by the next step."""
        came, begins, which = self._bearers(call.client, engine_id)
        at = which[bisect_right(begins, call.at.call) - 1]
        return None if at < 0 else came[at]

    def bodies_at(
        self, client: int, engine_id: int, calls: Int64
    ) -> tuple[Sequence[Appearance], Int64]:
        """Return the bodies that ever had an engine id, and which of them had it at each call.

        The second array contains indices into the first, or -1 for no body, shape (n,). `calls` are
        the numbers of the calls.
        """
        came, begins, which = self._bearers(client, engine_id)
        return came, np.array(which)[np.searchsorted(begins, calls, side="right") - 1]

    def _bearers(
        self, client: int, engine_id: int
    ) -> tuple[list[Appearance], list[int], list[int]]:
        """Return the bodies that ever had an engine id, and which one has it from which call on.

        The numbers of calls increase; the last list has an index into the first, or -1 for no body.
        """
        key = client, engine_id
        if key not in self._borne:
            came, lives = self._came.get(key, []), self._life().get(key, [])
            began, made = [each.at.call for each in came], [call for call, _ in lives]
            begins = sorted({BEFORE_ALL, *began, *(call + 1 for call in made)})
            which = []
            for call in begins:
                at = max(bisect_right(began, call) - 1, 0) if came else -1
                life = bisect_left(made, call) - 1
                if life >= 0:
                    at, gone = bisect_left(began, made[life]), lives[life][1]
                    # One that was removed before the next step was never listed.
                    if at == len(came) or (gone is not None and began[at] >= gone):
                        at = -1
                which.append(at)
            self._borne[key] = came, begins, which
        return self._borne[key]

    def _life(self) -> dict[tuple[int, int], list[tuple[int, int | None]]]:
        """Return the calls that created and removed each body, by simulation and engine id."""
        if self._lives is None:
            self._lives = {}
            for call in self.of(*MAKES, Act.REMOVE, Act.CLEAR):
                if call.act in MAKES:
                    if math.isfinite(call.result):
                        lives = self._lives.setdefault((call.client, int(call.result)), [])
                        lives.append((call.at.call, None))
                    continue
                removed = call.values.get("bodyUniqueId")
                for (client, engine_id), lives in self._lives.items():
                    if client == call.client and (removed is None or int(removed[0]) == engine_id):
                        lives[-1] = lives[-1][0], lives[-1][1] or call.at.call
        return self._lives

    # -- what they asked for ----------------------------------------------------------------------

    def filters(self) -> Iterator[tuple[Call, tuple[int, ...]]]:
        """Yield calls that may disable contacts, between two bodies or of one body with all others.

        Each call is yielded with the ids of its bodies.
        """
        for call in self.of(*FILTERS):
            named = call.values
            if named.get("enableCollision", (0.0,))[0] == 0:
                its = [self.body_at(call, int(named[name][0])) for name in PAIR if name in named]
                yield call, tuple(each.body.number for each in its if each is not None)

    def pushes(self) -> Iterator[Push]:
        """Yield the external forces and torques that calls apply."""
        for call, at, came in self.of_bodies(*PUSHES):
            values = call.values
            torque = call.act is Act.TWIST
            vector = values.get("torqueObj" if torque else "forceObj", ())
            point = values.get("posObj", ())
            if len(vector) == 3:
                where = point if len(point) == 3 and not torque else (math.nan,) * 3
                link, flags = values.get("linkIndex", (-1,)), values.get("flags", (0,))
                world = int(flags[0]) == WORLD_FRAME
                yield Push(at, came.body, int(link[0]), torque, vector, where, in_world_axes=world)

    def given(self) -> Iterator[Given]:
        """Yield the body properties that calls set."""
        for call, at, came in self.of_bodies(Act.SET_PROPERTY):
            values: dict[str, float | Sequence[float]] = {
                name: held[0] if len(held) == 1 else list(held)
                for name, held in call.values.items()
                if name not in (*BODY_NAMES, "physicsClientId")
            }
            if values:
                yield Given(at, came.body, link_reached(call.values), values)


def _only(row: Calls, which: Flags, widths: Int64) -> tuple[Calls, Int64]:
    if which.all():
        return row, widths
    numbers = row.numbers[np.repeat(which, widths)]
    return Calls(
        row.client,
        row.steps[which],
        row.times_s[which],
        row.calls[which],
        row.sites[which],
        numbers,
        row.results[which],
    ), widths[which]
