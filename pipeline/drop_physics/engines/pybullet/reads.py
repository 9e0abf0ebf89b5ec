"""Lists the script lines that read simulation values, such as `getBasePositionAndOrientation`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from drop_physics.arrays import Float64
from drop_physics.engines.pybullet.gathered import GatheredWorld
from drop_physics.engines.watching import pipe
from drop_physics.trace.readings import (
    DISTANCE,
    EFFORT,
    FIRST_FORCE,
    FORCE,
    POINTS,
    REACTION,
    TORQUE,
    Answer,
    Lens,
    Reading,
    Subject,
)

PLACE = ("x", "y", "z")
TURN = ("orientation x", "orientation y", "orientation z", "orientation w")
STATE = (
    "position",
    "rate",
    *(f"{REACTION} {axis}" for axis in ("fx", "fy", "fz", "mx", "my", "mz")),
)
OF_POINTS = (POINTS, FIRST_FORCE, FORCE, DISTANCE)
NAMES: Mapping[str, tuple[str, ...]] = {
    "getContactPoints": OF_POINTS,
    "getClosestPoints": OF_POINTS,
    "getJointState": (*STATE, TORQUE),
    "getJointStates": (*STATE, TORQUE),
    "getLinkState": (*PLACE, *TURN),
    "getBasePositionAndOrientation": (*PLACE, *TURN),
    "getBaseVelocity": (
        *(f"velocity {axis}" for axis in PLACE),
        *(f"spin {axis}" for axis in PLACE),
    ),
    "calculateInverseDynamics": tuple(f"{EFFORT} {k}" for k in range(pipe.ANSWERS)),
    "rayTest": ("body", "link", "fraction", *PLACE),
}
"""Names of the numbers that are kept of a return value; numbers of other functions are named by
index.
"""
Ids = Sequence[tuple[int, int | None]]
"""Subjects of readings, by engine id: bodies and their links, or a constraint."""


class Reads:
    """All script lines that read simulation values, with counts."""

    def __init__(self) -> None:
        self._places: dict[int, dict[str, Any]] = {}
        self._targets: dict[int, dict[Subject | int, None]] = {}
        """Subjects of each line's readings, in order of occurrence; constraints by their ids."""
        self._cut: set[int] = set()
        """Lines whose subjects are not all known."""
        self._waiting: list[tuple[GatheredWorld, int, Ids]] = []
        """Readings of bodies that were not described yet."""

    def describe(self, number: int, camera: dict[str, Any] | None, **described: Any) -> None:  # noqa: ANN401
        """Note a line of the script that reads values, under its number."""
        seen = camera and Lens(**{name: tuple(its or ()) for name, its in camera.items()})
        described["arguments"] = tuple(described["arguments"])
        self._places[number] = {"number": number, "camera": seen, **described}
        self._targets[number] = {}

    def read(self, world: GatheredWorld, number: int, targets: list[Ids]) -> None:
        """Note which bodies and joints a line reads."""
        self._waiting += [(world, number, target) for target in targets]
        self.bodies_came()

    def bodies_came(self) -> None:
        """Translate engine ids in readings to body ids of the recording, where known so far."""
        waiting, self._waiting = self._waiting, []
        for world, number, ids in waiting:
            if "constraintUniqueId" in self._places[number]["arguments"]:
                self._add(number, ids[0][0])
            elif all(body in world.ids for body, _ in ids):
                parts = [(world.ids[body].body.number, link) for body, link in ids]
                self._add(number, Subject(*parts[0], *itertools.chain(*parts[1:])))
            else:
                self._waiting.append((world, number, ids))

    def _add(self, number: int, target: Subject | int) -> None:
        targets = self._targets[number]
        if target in targets or len(targets) < pipe.MOST_TARGETS:
            targets[target] = None
        else:
            self._cut.add(number)

    def forget(self, world: GatheredWorld | None) -> None:
        """Give up translating engine ids that belong to undescribed bodies of a simulation."""
        self._cut |= {number for its, number, _ in self._waiting if world in (its, None)}
        self._waiting = [each for each in self._waiting if world not in (each[0], None)]

    def counted(self, counters: Sequence[int], answers: Float64) -> Iterator[Reading]:
        """Yield all lines that read values, with their counts."""
        self.forget(None)
        kept = answers.reshape(pipe.PLACES, pipe.ANSWERS, pipe.EXTREMES)
        for number, place in self._places.items():
            at, targets = number * pipe.COUNTERS, self._targets[number]
            count, is_estimate, last_step, numbers = counters[at : at + pipe.COUNTERS]
            yield Reading(
                **place,
                last_step=last_step,
                count=count,
                exact=not is_estimate,
                targets=tuple(target for target in targets if isinstance(target, Subject)),
                constraints=tuple(target for target in targets if isinstance(target, int)),
                complete=number not in self._cut,
                answers=tuple(_answers(place["function"], kept[number, :numbers])),
            )


def _answers(function: str, kept: Float64) -> Iterator[Answer]:
    """Yield the values that a line read, by name: first, last, least and greatest."""
    names = NAMES.get(function, ())
    for k, values in enumerate(kept.tolist()):
        yield Answer(names[k] if k < len(names) else str(k), *values)
