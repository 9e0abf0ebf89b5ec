"""Writes commands to joints over time: a row whenever a target, limit or gain changes.

These rows are for display; numbers are computed from `calls`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.physics.tree import places
from drop_physics.recording import schema, writer
from drop_physics.recording.writer import Chunk, Times
from drop_physics.trace.events import Appearance, At, Body, Calls, Raised, Samples, Site
from drop_physics.trace.motors import PD, POSITION, TORQUE, VELOCITY, Command, commands_of

TOGETHER = 1 << 13
"""Number of commands that are buffered before they are written as rows."""
ROWS = {
    schema.TARGET: ("position", "velocity", "torque"),
    schema.LIMIT: ("force", "mode", "kp", "kd"),
}
"""Columns of each entity: first those shown as curves, then further numbers."""
NAMES = [name for names in ROWS.values() for name in names]


def joint_names(body: Body, what: str) -> list[str]:
    """Name the positions, velocities or efforts of a body's joints, one name per coordinate."""
    place, names = schema.OF_JOINTS.index(what), list[str]()
    for joint in body.joints:
        width = joint.widths[place]
        names += [joint.name] if width == 1 else [f"{joint.name} {axis}" for axis in "xyzw"[:width]]
    return names


class Commands:
    """The commands to the joints of all bodies; events must arrive in order."""

    def __init__(self) -> None:
        self._asked: dict[tuple[int, int], JointRequests] = {}
        """Commands to bodies, by simulation and the engine's body id."""
        self._held: list[Command] = []
        self._raised: set[int] = set()
        self._last: dict[int, Times] = {}
        """Step and time of the last sample, by simulation."""

    def on_appearance(self, seen: Appearance) -> Iterator[Chunk]:
        """Note a body that was added or removed."""
        key = seen.body.client, seen.body.engine_id
        if seen.came:
            self._asked[key] = JointRequests(seen.body, seen.at)
        elif not seen.there:
            yield from self.flush()
            if key in self._asked:
                yield from self._end(key)

    def on_samples(self, seen: Samples) -> None:
        """Note how far a simulation has progressed."""
        self._last[seen.client] = Times(seen.steps[-1:], seen.times_s[-1:])

    def on_calls(self, seen: Calls, sites: Mapping[int, Site], widths: Int64) -> Iterator[Chunk]:
        """Add calls, and yield rows once there are enough."""
        self._held += commands_of(seen, sites, widths)
        if sum(len(each.calls) for each in self._held) >= TOGETHER:
            yield from self.flush()

    def on_raised(self, seen: Raised) -> None:
        """Note a call that failed."""
        self._raised.add(seen.at.call)

    def end(self) -> Iterator[Chunk]:
        """Yield the remaining rows."""
        yield from self.flush()
        for key in [*self._asked]:
            yield from self._end(key)

    def _end(self, key: tuple[int, int]) -> Iterator[Chunk]:
        asked = self._asked.pop(key)
        if key[0] in self._last:
            yield from asked.end(self._last[key[0]])

    def flush(self) -> Iterator[Chunk]:
        """Yield all buffered rows, except for bodies that are not known yet."""
        held, self._held = self._held, []
        found: dict[tuple[int, int], list[Cells]] = {}
        for command in held:
            raised = np.isin(command.calls, [*self._raised])
            keys = np.stack((command.bodies, command.joints))[:, ~raised]
            for number, joint in np.unique(keys, axis=1).T.tolist():
                key = command.client, number
                its = command.only(~raised & (command.bodies == number) & (command.joints == joint))
                if key not in self._asked:
                    self._held.append(its)
                elif 0 <= joint < len(self._asked[key].places):
                    found.setdefault(key, []).extend(self._asked[key].cells(joint, its))
        self._raised.clear()
        for key, cells in found.items():
            if cells:  # a fixed joint has no motor
                yield from self._asked[key].chunks(cells)


class Cells(NamedTuple):
    """Joint settings made by n calls, in the columns of a body's rows."""

    calls: Int64
    steps: Int64
    times_s: Float64
    columns: slice
    values: Float64
    """Values, shape (n, columns)."""


class JointRequests:
    """The commands to one body's joints, as rows of the recording."""

    def __init__(self, body: Body, at: At) -> None:
        self._entity, self._at = f"{schema.JOINTS}/{body.label}", at
        self._names = {
            schema.TARGET: joint_names(body, "position"),
            schema.LIMIT: joint_names(body, "effort"),
        }
        counts = [
            len(self._names[schema.TARGET if name == "position" else schema.LIMIT])
            for name in NAMES
        ]
        self._columns = dict(zip(NAMES, places(counts), strict=True))
        self.places = [
            {
                name: _moved(each[name != "position"], its.start)
                for name, its in self._columns.items()
            }
            for each in zip(body.coordinates, body.rates, strict=True)
        ]
        """Column slices of each joint's settings, by setting."""
        self._now = np.full(sum(counts), np.nan)
        self._named = False

    def cells(self, joint: int, asked: Command) -> Iterator[Cells]:
        """Convert calls for a joint to cells of the body's rows: targets, limits, gains."""
        places, mode = self.places[joint], asked.values["controlMode"][:, 0]
        width = places["force"].stop - places["force"].start
        if not width:
            return

        def of(argument: str, name: str) -> Float64:
            columns = places[name].stop - places[name].start
            return np.broadcast_to(asked.given(argument, columns), (len(mode), columns))

        position, motor = mode == POSITION, np.isin(mode, (VELOCITY, POSITION, PD))
        to, kp = of("targetPosition", "position"), of("positionGain", "kp")
        sets = {
            "position": (motor, np.where((position | (mode == PD))[:, None], to, np.nan)),
            "velocity": (motor, of("targetVelocity", "velocity")),
            "torque": (mode == TORQUE, of("force", "torque")),
            "force": (motor, of("force", "force")),
            "mode": (motor | (mode == TORQUE), np.tile(mode[:, None], width)),
            "kp": (motor, np.where((mode == VELOCITY)[:, None], 0.0, kp)),
            "kd": (motor, of("velocityGain", "kd")),
        }
        for name, (which, values) in sets.items():
            if which.any():
                yield Cells(
                    asked.calls[which],
                    asked.steps[which],
                    asked.times_s[which],
                    places[name],
                    values[which],
                )

    def chunks(self, cells: list[Cells]) -> Iterator[Chunk]:
        """Yield a row whenever a setting changes."""
        if not self._named:
            self._named = True
            for what, names in self._names.items():
                named = [f"{name} {what}" for name in names]
                yield writer.series_chunk(f"{self._entity}/{what}", named, stepped=True)
        # What was asked before a body was listed is dated to that moment.
        told = [np.maximum(cell.steps, self._at.step) for cell in cells]
        steps, first = np.unique(np.concatenate(told), return_index=True)
        times_s = np.concatenate([cell.times_s for cell in cells])[first]
        rows = np.full((len(steps) + 1, len(self._now)), np.nan)
        by = np.full(rows.shape, -1)  # the call that set each number: the last in a step counts
        rows[0], by[0] = self._now, 0
        for at_step, (calls, _, _, columns, values) in zip(told, cells, strict=True):
            row = np.searchsorted(steps, at_step) + 1
            late = calls > by[row, columns.start]
            rows[row[late], columns] = values[late]
            by[row[late], columns] = calls[late, None]
        last = np.maximum.accumulate(np.where(by < 0, 0, np.arange(len(rows))[:, None]), axis=0)
        rows = np.take_along_axis(rows, last, axis=0)
        same = (rows[1:] == rows[:-1]) | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))
        self._now = rows[-1]
        for what, parts in ROWS.items():
            its = slice(self._columns[parts[0]].start, self._columns[parts[-1]].stop)
            new = np.flatnonzero(~same[:, its].all(axis=1))
            if len(new):
                at = Times(steps[new], np.maximum(times_s[new], self._at.time_s))
                yield self._chunk(what, at, rows[new + 1])

    def end(self, at: Times) -> Iterator[Chunk]:
        """Repeat the last settings at the end of the recording, so that curves reach it."""
        if self._named:
            for what in ROWS:
                yield self._chunk(what, at, self._now[None])

    def _chunk(self, what: str, at: Times, rows: Float64) -> Chunk:
        parts = {name: rows[:, self._columns[name]] for name in ROWS[what]}
        scalars = parts.pop(ROWS[what][0])
        return writer.scalars_chunk(f"{self._entity}/{what}", at, scalars, parts)


def _moved(place: slice, by: int) -> slice:
    return slice(place.start + by, place.stop + by)
