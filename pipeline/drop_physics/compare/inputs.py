"""Compares the inputs of two scripts: bodies, their dynamics, engine settings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Set
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from drop_physics.compare.difference import (
    INPUT,
    Dated,
    Difference,
    Setting,
    Side,
    Value,
    When,
    differs,
)
from drop_physics.compare.pairing import Pairing, lengths
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen

FOLLOWS = ("number", "label", "name", "engine_id", "client", "bounds_m", "asked")
"""Fields that are not compared: names and ids of bodies, which depend on the machine and on earlier
bodies; bounding boxes, which follow from poses; and properties in a body's file, of which only the
engine's result counts."""
MADE_WITH = "made_with_"
DID = ("unseeded", "real_time")
"""Properties that have the prefix of software versions, but describe the script's behaviour."""
OF_SCRIPT = ("script", "script_sha256", "arguments", "seed")

OF_VERSION = ("engine", "dynamics")
"""Entities of which only values that both engines report are compared."""
SET = "set_"
"""Prefix of the names of settings that were set by calls."""

Column = tuple[int | None, str]
"""Link and name of a value."""
Values = dict[Column, Value]
Key = tuple[str, int, int]
"""Entity, simulation and body id (-1 for none), as in the checked recording."""
THERE: Column = (None, "there")


def input_differences(run: Seen, golden: Seen, pairs: Pairing) -> Iterator[Dated]:
    """Yield the first differing input of each body and simulation.

    Inputs are compared at each step, until the first of both simulations ends.
    """
    numbers = {number: number for number in run.bodies}
    clients = {client: client for client in pairs.clients.values()}
    mine = _inputs(run, numbers, clients, pairs.common.keys())
    theirs = _inputs(golden, pairs.numbers, pairs.clients, pairs.common.keys())
    for kind in OF_VERSION:
        _keep_shared(kind, mine, theirs)
    ends = {client: min(both) - 1 for client, both in lengths(run, golden, pairs).items()}
    for key in {**mine, **theirs}:
        now, then = mine.get(key, {}), theirs.get(key, {})
        _, client, number = key
        label = None
        if number >= 0:
            label = run.bodies[number].label if number in run.bodies else pairs.label(number)
        yield from _first(key, label, now, then, ends.get(client, math.inf))


def _keep_shared(
    kind: str,
    mine: Mapping[Key, Mapping[int, tuple[int, Values]]],
    theirs: Mapping[Key, Mapping[int, tuple[int, Values]]],
) -> None:
    """Remove values that one of the two engines, or engine versions, never reports."""
    sides = (
        [
            values
            for (name, *_), changes in inputs.items()
            if name == kind
            for _, values in changes.values()
        ]
        for inputs in (mine, theirs)
    )
    here, there = ([*side] for side in sides)
    known = [{_reported(name) for values in each for _, name in values} for each in (here, there)]
    if not all(known):
        return
    for values in (*here, *there):
        for column in [*values]:
            name = _reported(column[1])
            if name is not None and not all(name in each for each in known):
                del values[column]


def _reported(name: str) -> str | None:
    """Return the name of a value that the engine reports; None for values set by calls."""
    return None if name.startswith(SET) else name.partition(".")[0]


def _first(
    key: Key,
    label: str | None,
    mine: Mapping[int, tuple[int, Values]],
    theirs: Mapping[int, tuple[int, Values]],
    end: float,
) -> Iterator[Dated]:
    """Yield the columns of an entity that differ at the first differing step."""
    absent: Values = {THERE: 0.0} if key[0] == "bodies" else {}
    now, then = absent, absent
    for step in sorted(mine.keys() | theirs.keys()):
        call, now = mine.get(step, (0, now))
        other, then = theirs.get(step, (0, then))
        differing = [each for each in {**now, **then} if differs(now.get(each), then.get(each))]
        if THERE in differing:
            differing = [THERE]
        if step >= end or not (now and then and differing):
            continue
        for link, name in differing:
            column = name if (link, name) == THERE else f"{key[0]}.{name}"
            values = now.get((link, name)), then.get((link, name))
            yield Dated(
                When(step, INPUT, max(call, other)),
                key[1],
                Difference(step, label, link, column, *values),
            )
        return


def _inputs(
    seen: Seen, numbers: Mapping[int, int], clients: Mapping[int, int], common: Set[int]
) -> dict[Key, dict[int, tuple[int, Values]]]:
    """Return the inputs after each change, by step, with the number of earlier calls."""
    inputs: dict[Key, dict[int, tuple[int, Values]]] = {}
    for came in seen.appearances:
        key = "bodies", clients.get(came.body.client, -1), numbers[came.body.number]
        values: Values = {THERE: 0.0}
        if came.there:
            names = (part.name for part in fields(Body) if part.name not in FOLLOWS)
            held = {name: getattr(came.body, name) for name in names}
            values = {THERE: 1.0, **dict(_flat(held))}
        inputs.setdefault(key, {})[came.at.step] = came.at.call, values
    for setting in seen.settings:
        if setting.client in clients:  # without bodies it has no effect
            key = "engine", clients[setting.client], -1
            inputs.setdefault(key, {})[setting.at.step] = (
                setting.at.call,
                dict(_flat(setting.values)),
            )
    for dynamics in seen.dynamics:
        number = numbers[dynamics.body.number]
        if number in common:
            key = "dynamics", clients[dynamics.body.client], number
            inputs.setdefault(key, {})[dynamics.at.step] = (
                dynamics.at.call,
                dict(_of_links(dynamics.reported)),
            )
    return inputs


def _flat(values: Mapping[str, Any], link: int | None = None) -> Iterator[tuple[Column, Value]]:
    """Yield numbers, texts and flags by name; a vector's elements are numbered from 0."""
    for name, value in values.items():
        if is_dataclass(value):
            inner = {part.name: getattr(value, part.name) for part in fields(value)}
        elif isinstance(value, np.ndarray | list | tuple):
            inner = {str(number): element for number, element in enumerate(value)}
        elif value is None:  # as if it were not there
            continue
        else:
            yield (link, name), value if isinstance(value, str) else float(value)
            continue
        yield from (((link, f"{name}.{of}"), element) for (_, of), element in _flat(inner))


def _of_links(reported: Mapping[str, Any]) -> Iterator[tuple[Column, Value]]:
    # The mass first: others follow from it, such as the inertia.
    for name, values in sorted(reported.items(), key=lambda item: item[0] != "mass_kg"):
        for number, value in enumerate(values):
            yield from _flat({name: value}, link=number - 1)


# -- facts that are no difference in physics ------------------------------------------------------


def script_settings(run: Side, golden: Side) -> Iterator[Setting]:
    """Yield how the scripts differ: name, digest of the text, arguments, seed."""
    for name in OF_SCRIPT:
        mine, theirs = (side.origin.get(name) for side in (run, golden))
        if mine != theirs:
            yield Setting(name, mine, theirs)


def script_versions(run: Side, golden: Side) -> Iterator[Setting]:
    """Yield the software versions that differ between two recordings, if both state one."""
    mine, theirs = (_made_with(side) for side in (run, golden))
    for name, value in mine.items():
        other = theirs.get(name)
        if None not in (value, other) and value != other:
            yield Setting(name, value, other)


def _made_with(side: Side) -> dict[str, Any]:
    names = (name.removeprefix(MADE_WITH) for name in side.ended if name.startswith(MADE_WITH))
    made = {
        "python_version" if name == "version" else name: side.ended[MADE_WITH + name]
        for name in names
        if name not in DID
    }
    return made | {"drop_version": side.origin.get("drop_version")}
