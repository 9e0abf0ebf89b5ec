"""Finds when calls placed bodies: loaded them, or set their state."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.touching import STEPS
from drop_physics.rules.arguments import site_of
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Body
from drop_physics.trace.history import Piece, Seen

PLACES = Act.LOAD, Act.MAKE, Act.SET_POSE, Act.SET_JOINT, Act.RESTORE
"""Kinds of calls that place bodies."""
NEAR = 3
"""Number of placements above which a body counts as animated, and number of steps within which two
placements are neighbours."""


class Placing:
    """The steps that start from states that calls have set, and those calls."""

    def __init__(self, seen: Seen) -> None:
        came = [
            (appearance.body.number, appearance.at.step + 1)
            for appearance in seen.appearances
            if appearance.came
        ]
        moved = [(put.body.number, put.at.step + 1) for put in seen.puts]
        self._every = np.unique([number * STEPS + step for number, step in [*came, *moved]])
        self._came = np.unique([number * STEPS + step for number, step in came])
        self._sites: dict[tuple[int, int], list[tuple[int, str]]] = {}
        self._restored: set[int] = set()
        """Keys of bodies and steps that start from a restored state, so that no call chose the
        pose."""
        self._posed: set[int] = set()
        """Keys of bodies and steps before which a call set the pose."""
        self._reposed: set[int] = set()
        """Keys of bodies and steps before which another call than the load set the pose."""
        self._bodies, self._puts = seen.bodies, seen.puts

    @cached_property
    def animated(self) -> dict[int, tuple[Int64, Float64]]:
        """The base poses that calls set for bodies that they move often, by body."""
        puts: dict[int, dict[int, Float64]] = {}
        for put in self._puts:  # of several for a step, the last counts
            puts.setdefault(put.body.number, {})[put.at.step + 1] = put.base
        return {
            number: (np.array([*told], np.int64), np.array([*told.values()]))
            for number, told in puts.items()
            if len(told) > NEAR
        }

    def see(self, piece: Piece) -> None:
        """Add a chunk."""
        self._sites = {key: told[-1:] for key, told in self._sites.items()}
        for call in piece.calls.of(*PLACES):
            values, restores = call.values, call.act is Act.RESTORE
            (number,) = values.get("bodyUniqueId", (call.result,))
            keys = {
                body.number * STEPS + call.at.step + 1
                for body in self._bodies.values()
                if body.client == call.client and (restores or body.engine_id == number)
            }
            self._posed |= keys
            self._reposed |= keys if "bodyUniqueId" in values else set()
            self._restored |= keys if restores else set()
            if np.isfinite(number):
                told = self._sites.setdefault((call.client, int(number)), [])
                told.append((call.at.step, site_of(call)))

    def placed(self, bodies: Int64, steps: Int64) -> Flags:
        """Flag the bodies that a call placed before a step, but not in neighbouring steps."""
        keys = bodies * STEPS + steps
        return _once(keys, self._every) & ~np.isin(keys, [*self._restored])

    def posed(self, bodies: Int64, steps: Int64) -> Flags:
        """Flag the placed bodies that were loaded or given a pose, not only a velocity."""
        keys = bodies * STEPS + steps
        posed = _once(keys, np.array([*self._posed], np.int64)) | np.isin(keys, self._came)
        return self.placed(bodies, steps) & posed

    def moved(self, bodies: Int64, steps: Int64) -> Flags:
        """Flag the bodies that a call placed before a step."""
        return np.isin(bodies * STEPS + steps, self._every)

    def restored(self, body: Int64 | int, steps: Int64) -> Flags:
        """Flag the steps that start from a restored state."""
        return np.isin(body * STEPS + steps, [*self._restored])

    def came(self, bodies: Int64 | int, steps: Int64 | int) -> Flags:
        """Flag the bodies that were loaded immediately before a step."""
        return np.isin(bodies * STEPS + steps, self._came)

    def is_as_loaded(self, body: int, step: int) -> bool:
        """Return whether a body was loaded immediately before a step, and not moved since."""
        return bool(self.came(body, step)) and body * STEPS + step not in self._reposed

    def site(self, body: Body, step: int) -> str | None:
        """Return file and line of the last call that placed a body before a step."""
        told = self._sites.get((body.client, body.engine_id), [])
        return next((site for at, site in reversed(told) if at < step), None)


def _once(keys: Int64, among: Int64) -> Flags:
    """Flag the keys that occur in `among`, unless a key of a neighbouring step occurs, too."""
    once = np.isin(keys, among)
    for near in range(1, NEAR + 1):
        once &= ~(np.isin(keys - near, among) | np.isin(keys + near, among))
    return once
