"""What a script's calls asked for: forces, and properties of bodies.

A recording holds a call as its site and its numbers. Here they get their meaning, by the names of
PyBullet's functions and arguments; another engine's would stand beside them.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

from drop_physics.seen.events import Appearance, At, Body, Calls, Raised, Site, order

T = TypeVar("T")

WORLD_FRAME = 2
"""The flag of `applyExternalForce`: its vectors are in the world's axes."""
BODY_NAMES = ("bodyUniqueId", "objectUniqueId", "bodyIndex")
MOTORS = "setJointMotorControl"
"""What the functions that command joints begin with."""
VELOCITY, TORQUE, POSITION, PD = 0, 1, 2, 3
"""How they drive a joint: `controlMode`."""
FORCE = 100000.0
"""PyBullet's default of a motor's limit [N m] or [N]."""
ARGUMENTS = {
    "targetPosition": "targetPositions", "targetVelocity": "targetVelocities", "force": "forces",
    "positionGain": "positionGains", "velocityGain": "velocityGains",
    "maxVelocity": "maxVelocities",
}  # fmt: skip
"""Arguments of a call for one joint, and of one for several."""
MOST_WHOLE = 2**53
"""Larger whole numbers are not all the same as doubles."""


@dataclass(frozen=True)
class Call:
    """What the script did to the world."""

    at: At
    """When it was made."""
    client: int
    """Number of its client."""
    site: Site
    numbers: tuple[float, ...]
    """All numbers in its arguments, in order."""
    result: float = math.nan
    """What it returned, where that is a number."""
    raised: str = ""
    """What it raised."""

    @property
    def function(self) -> str:
        """Its name."""
        return self.site.function

    @property
    def file(self) -> str:
        """File of the call."""
        return self.site.file

    @property
    def line(self) -> int:
        """Line of the call, from 1."""
        return self.site.line

    @property
    def arguments(self) -> str:
        """The arguments, as the script might have written them; long ones shortened."""
        return text_of(self.site, self.numbers)

    @cached_property
    def values(self) -> dict[str, tuple[float, ...]]:
        """The numbers of each argument."""
        return {name: self.numbers[place] for name, place in self.site.places.items()}


@dataclass(frozen=True)
class Push:
    """A force or torque from outside, for one step."""

    at: At
    body: Body
    link: int
    torque: bool
    vector: tuple[float, ...]
    """Force [N] or torque [N m]."""
    position_m: tuple[float, ...]
    """Where the force acts; nan for a torque."""
    in_world_axes: bool


@dataclass(frozen=True)
class Given:
    """Properties of a body that a call has set, some of which the engine never reports."""

    at: At
    body: Body
    values: Mapping[str, float | Sequence[float]]


def text_of(site: Site, numbers: Sequence[float]) -> str:
    """Return the arguments of a call as the script might have written them."""
    texts = [
        repr(int(number)) if whole and abs(number) <= MOST_WHOLE and number.is_integer()
        else repr(number)
        for number, whole in zip(numbers, site.whole, strict=True)
    ]  # fmt: skip
    return site.form.format(*texts)


def of_joint(values: Mapping[str, Sequence[T]], number: int, joints: int) -> dict[str, Sequence[T]]:
    """Return the arguments of a call of motors that are for one of several joints.

    Parameters
    ----------
    values
        What belongs to each argument: numbers, or their places in a row.
    number
        Which joint, among those of the call.
    joints
        How many the call has.
    """
    found: dict[str, Sequence[T]] = {}
    for name, plural in ARGUMENTS.items():
        if name in values:
            found[name] = values[name]
        elif plural in values and joints:
            width = max(len(values[plural]) // joints, 1)
            found[name] = values[plural][number * width : (number + 1) * width]
    return found


def calls_of(
    rows: Iterable[Calls], sites: Mapping[int, Site], raised: Iterable[Raised]
) -> list[Call]:
    """Return all calls in order, each with what it raised."""
    errors = {each.at.call: each.error for each in raised}
    calls = []
    for row in rows:
        start = 0
        numbers = row.numbers.tolist()
        for step, time_s, call, number, result in zip(
            *(each.tolist() for each in (row.steps, row.times_s, row.calls, row.sites)),
            row.results.tolist(),
            strict=True,
        ):
            site = sites[number]
            end = start + len(site.names)
            at = At(step, time_s, call)
            given = tuple(numbers[start:end])
            calls.append(Call(at, row.client, site, given, result, errors.get(call, "")))
            start = end
    return sorted(calls, key=lambda call: call.at.call)


class Meanings:
    """What calls meant, given the bodies that the simulations had."""

    def __init__(self, calls: Iterable[Call], appearances: Iterable[Appearance]) -> None:
        self._calls = [call for call in calls if not call.raised]
        self._lives: dict[tuple[int, int], list[tuple[int, int | None]]] = {}
        """By client and engine's id, the calls that made a body and that removed it."""
        self._came: dict[tuple[int, int], list[Appearance]] = {}
        for each in appearances:
            if each.came:
                key = each.body.client, each.body.engine_id
                self._came.setdefault(key, []).append(each)
        for call in self._calls:
            self._note_life(call)

    def pushes(self) -> Iterator[Push]:
        """Yield the forces and torques from outside."""
        for call, at, came in self.of_bodies("applyExternalForce", "applyExternalTorque"):
            values = call.values
            torque = call.function.endswith("Torque")
            vector = values.get("torqueObj" if torque else "forceObj", ())
            point = values.get("posObj", ())
            if len(vector) == 3:
                where = point if len(point) == 3 and not torque else (math.nan,) * 3
                link, flags = values.get("linkIndex", (-1,)), values.get("flags", (0,))
                world = int(flags[0]) == WORLD_FRAME
                yield Push(at, came.body, int(link[0]), torque, vector, where, in_world_axes=world)

    def given(self) -> Iterator[Given]:
        """Yield properties of bodies that calls have set."""
        for call, at, came in self.of_bodies("changeDynamics"):
            values: dict[str, float | Sequence[float]] = {
                name: held[0] if len(held) == 1 else list(held)
                for name, held in call.values.items()
                if name not in (*BODY_NAMES, "physicsClientId")
            }
            if values:
                yield Given(at, came.body, values)

    def of_bodies(self, *functions: str) -> Iterator[tuple[Call, At, Appearance]]:
        """Yield the calls of functions by the beginning of their names, each with its body.

        A body is listed with the next step: what calls did to it before is dated to that moment.
        """
        for call in self._calls:
            if not call.function.startswith(functions):
                continue
            values = call.values
            engine_id = next((values[name] for name in BODY_NAMES if name in values), None)
            came = None if engine_id is None else self.body_at(call, int(engine_id[0]))
            if came is not None:
                yield call, max(call.at, came.at, key=order), came

    def body_at(self, call: Call, engine_id: int) -> Appearance | None:
        """Return the body that had an id at a call, or got it with the step after it."""
        came = self._came.get((call.client, engine_id), [])
        lives = self._lives.get((call.client, engine_id), [])
        born = [made for made, _ in lives]
        life = bisect.bisect_left(born, call.at.call) - 1
        if life >= 0:
            made, gone = lives[life]
            later = (each for each in came if each.at.call >= made)
            found = next(later, None)
            # One that was removed before the next step was never listed.
            return None if found is None or (gone is not None and found.at.call >= gone) else found
        place = bisect.bisect_right([order(each.at) for each in came], order(call.at))
        return came[place - 1] if place else next(iter(came), None)

    def _note_life(self, call: Call) -> None:
        """Note whether a call makes a body, or removes bodies."""
        if call.function.startswith(("load", "createMultiBody")) and math.isfinite(call.result):
            lives = self._lives.setdefault((call.client, int(call.result)), [])
            lives.append((call.at.call, None))
        elif call.function in ("removeBody", "resetSimulation"):
            removed = call.values.get("bodyUniqueId")
            for (client, engine_id), lives in self._lives.items():
                if client == call.client and (removed is None or int(removed[0]) == engine_id):
                    lives[-1] = lives[-1][0], lives[-1][1] or call.at.call
