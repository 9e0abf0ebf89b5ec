"""Counts how often, and in which steps, each script line reads simulation values.

A reading takes PyBullet a microsecond, and counting it another one. Therefore, readings of a
frequently called function are counted only in one of 61 steps, with a weight of 61; rare ones, and
the first from each line, are always counted. The counts lie in memory shared with the recorder, so
a crash loses none.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from ...watching.pipe import ANSWERS, COUNTERS, EXTREMES, MOST_TARGETS, PLACES
from ...watching.sites import caller_of
from .answers import numbers_in
from .arguments import CLIENT, client_of, named, number, vector
from .calls import MOST_PLANS, is_numpy
from .functions import CONVERTS, PHOTOGRAPHS

if TYPE_CHECKING:
    from .hooks import BulletWatch
    from .worlds import WatchedWorld

EXACT, TOGETHER, SHARE = 256, 4, 61
"""All readings are counted in this many first steps; then in groups of consecutive steps: the size
of a group, and the ratio of all steps to counted ones. Between groups, only functions without a
reading in the last two groups are counted: a function that is called every tenth step always is."""
OF = {
    "bodyUniqueId": ("linkIndex", "linkIndices", "jointIndex", "jointIndices"),
    "objectUniqueId": ("linkIndex",),
    "bodyA": ("linkIndexA",),
    "bodyB": ("linkIndexB",),
    "parentObjectUniqueId": ("parentLinkIndex",),
    "constraintUniqueId": (),
}
"""Arguments that name the objects read, and those that name their links."""
FLAGS = ("computeLinkVelocity", "computeForwardKinematics", "flags", "reportHitNumber", "renderer")
"""Arguments that change the returned quantities: other values count as another reading line."""
PLAIN = {int, float, bool, str, type(None)}
"""Types of arguments by which a repeated reading is recognised; vectors usually differ in each
call."""


class Readings:
    """Counts a script's reading calls, such as `getJointState`, by line."""

    def __init__(self, watch: BulletWatch) -> None:
        self._watch, self._fails = watch, False
        self.next_turn = EXACT - TOGETHER - TOGETHER * SHARE
        """Number of steps after which `turn` must be called."""
        self._all = False
        """Whether all readings are counted in the current step."""
        self._unseen: dict[str, int] = {}
        """Functions of which only some readings are counted, and the weight of each counted one."""
        self._passing: dict[str, set[int]] = {}
        self._seen: dict[str, set[int]] = {}
        """Call instructions of each function: those whose readings are not counted for now, and all
        known ones."""
        self._read: set[str] = set()
        self._read_before: set[str] = set()
        """Functions with readings in the current group of steps, and in the previous one."""
        self._plans: dict[Any, tuple[int, WatchedWorld]] = {}
        """Number of each reading line, and its simulation, by code, instruction and arguments."""
        self._codes: list[Any] = []
        """References to the code objects of reading lines, so that Python does not reuse their
        addresses."""
        self._places: dict[Any, int] = {}
        self._numbers: dict[str, list[int]] = {}
        """Numbers of the reading lines, by function."""
        self._targets: dict[int, set[Any]] = {}
        """Subjects of the readings of each line."""

    def passing(self, name: str) -> set[int]:
        """Return the bytecode positions whose calls of a function are not counted for now."""
        return self._passing.setdefault(name, set())

    def turn(self, steps: int) -> None:
        """Start or end a sampling period, in which every reading is counted."""
        self._all = not self._all
        if self._all:
            self.next_turn, self._read = steps + TOGETHER, set()
            for name in self._unseen:
                self._passing[name].clear()
                self._unseen[name] = SHARE
            return
        self.look()
        self.next_turn = steps + TOGETHER * (SHARE - 1)
        if not self._watch.real_time_since:  # where a reading takes time
            for name in self._read & self._read_before & self._passing.keys():
                self._unseen[name] = 1
                self._passing[name] |= self._seen[name]
                for number in self._numbers[name]:
                    self._watch.pipe.counters[number * COUNTERS + 1] = 1
        self._read_before, self._read = self._read, set()

    def look(self) -> None:
        """Count every reading until the next sampling period."""
        for name in self._unseen:
            self._passing[name].clear()
        self._unseen = {}

    def forget(self) -> None:
        """Note that engine ids may now refer to other bodies."""
        self._plans, self._codes, self._targets = {}, [], {}

    def count(
        self,
        name: str,
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
        place: Any,
        answer: Any = None,
    ) -> None:
        """Count a reading, and keep the value that it returned."""
        key = name, id(place.f_code), place.f_lasti, args, *kwargs.items()
        try:
            at, world = self._plans[key]
        except (KeyError, TypeError):  # TypeError: a list among the arguments
            found = self._found(name, args, kwargs, place)
            if found is None:
                return
            at, world = found
            self._seen.setdefault(name, set()).add(place.f_lasti)
            if PLAIN.issuperset(map(type, (*args, *kwargs.values()))):
                if len(self._codes) >= MOST_PLANS:
                    self._plans, self._codes = {}, []
                self._plans[key] = found
                self._codes.append(place.f_code)
        self._read.add(name)
        counters = self._watch.pipe.counters
        if answer is not None:
            self._keep(at, numbers_in(name, answer))
        counters[at] += self._unseen.get(name, 1)
        counters[at + 2] = world.step

    def _keep(self, at: int, values: list[float]) -> None:
        """Update the first, last, least and greatest value that a line has read."""
        pipe = self._watch.pipe
        counters, kept = pipe.counters, pipe.answers
        begin, known = at // COUNTERS * ANSWERS * EXTREMES, counters[at + 3]
        for k, value in enumerate(values):
            one = begin + k * EXTREMES
            if k >= known:
                kept[one] = kept[one + 2] = kept[one + 3] = value
            kept[one + 1] = value
            if value < kept[one + 2]:
                kept[one + 2] = value
            if value > kept[one + 3]:
                kept[one + 3] = value
        counters[at + 3] = max(known, len(values))

    def fail(self, error: Exception) -> None:
        """Note a reading that could not be counted; the script continues."""
        if not self._fails:
            self._fails = True
            self._watch.pipe.note("unread", error=f"{type(error).__name__}: {error}")

    def _found(
        self, name: str, args: tuple[Any, ...], kwargs: dict[str, Any], place: Any
    ) -> tuple[int, WatchedWorld] | None:
        """Return the counter of a line, and the simulation that it reads; describe a new line."""
        watch, pipe = self._watch, self._watch.pipe
        world = watch.worlds.get(client_of(name, args, kwargs))
        if world is None and name in CONVERTS:  # which reads no simulation
            world = next(iter(watch.worlds.values()), None)
        if world is None:
            return None
        arguments = named(name, args, kwargs)
        arguments.pop(CLIENT, None)
        file, line = watch.host.sites.place(caller_of(place))
        flags = {key: number(arguments[key]) for key in FLAGS if key in arguments}
        described = name, file, line, world.client, *arguments, *flags.values()
        which = self._places.get(described)
        if which is None:
            which = self._places[described] = len(self._places)
            if which == PLACES:
                pipe.note("unread", error=f"it reads at more than {PLACES} places")
            elif which < PLACES:
                self._numbers.setdefault(name, []).append(which)
                pipe.note(
                    "reading",
                    number=which,
                    world=world.number,
                    function=name,
                    file=file,
                    line=line,
                    arguments=[*arguments],
                    flags=flags,
                    first_step=world.step,
                    camera=_camera(arguments) if name == PHOTOGRAPHS else None,
                )
        if which >= PLACES:
            return None
        known = self._targets.setdefault(which, set())
        new = [target for target in dict.fromkeys(_targets(arguments)) if target not in known]
        if new and len(known) <= MOST_TARGETS:  # one too many tells that there are more
            known.update(new)
            pipe.note("read", number=which, world=world.number, targets=new[: MOST_TARGETS + 1])
        return which * COUNTERS, world


def _targets(arguments: dict[str, Any]) -> list[Any]:
    """Return the subjects of a reading: one or two bodies, by engine id, with links or None."""
    parts = []
    for body, links in OF.items():
        which = number(arguments.get(body))
        if which is not None and which >= 0:
            found = [_numbers(arguments[link]) for link in links if link in arguments]
            parts.append([(which, link) for link in (found[0] if found else [None])])
    return [*itertools.product(*parts)] if parts else []


def _numbers(value: Any) -> list[int | None]:
    if is_numpy(type(value)):
        value = value.tolist()
    return [*map(number, value)] if isinstance(value, (list, tuple, range)) else [number(value)]


def _camera(arguments: dict[str, Any]) -> dict[str, Any]:
    return {
        "size_px": [number(arguments.get(side)) for side in ("width", "height")],
        "view": vector(arguments.get("viewMatrix")),
        "projection": vector(arguments.get("projectionMatrix")),
    }
