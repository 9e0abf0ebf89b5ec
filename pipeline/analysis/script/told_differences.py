"""What went into two simulations, held against each other: bodies, settings, pushes and more.

A recording has a row when something is told. Rows of one kind and one body, or one client, are
compared in their order; the first that differs says where they part, and no row after it counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import polars as pl

from pipeline.analysis.script.difference import PUT, TOLD, Difference, Found, Value, When
from pipeline.seen import At, Body, Put, Seen

Column = tuple[int | None, str]
"""Link and name."""
Row = tuple[At, dict[Column, Value]]
Told = dict[tuple[str, str | None, int], list[Row]]
"""By entity, label of a body, and client."""

FOLLOWS = ("number", "label", "name", "bounds_m")
"""What a body is called, with the folder of its file, and the boxes that follow from its pose."""


def told_differences(run: Seen, golden: Seen) -> Iterator[Found]:
    """Yield what differs first in what was told of each body and each client that has any."""
    for label, at, *there in _coming(run, golden):
        yield When(at.step, TOLD, at.call), Difference(at.step, label, None, "there", *there)
    both = labels_of(run) & labels_of(golden)
    mine, theirs = (_told(seen, both) for seen in (run, golden))
    ends = [_ends(seen) for seen in (run, golden)]
    clients = {body.client for seen in (run, golden) for body in seen.bodies.values()}
    for key in {**mine, **theirs}:
        if key[2] not in clients:  # without bodies there is nothing for settings to act on
            continue
        last = [one.get(key[2], 0) for one in ends]
        yield from _first(key, mine.get(key, []), theirs.get(key, []), last)


def _ends(seen: Seen) -> dict[int, int]:
    """Return the last step of each client of which there is a sample."""
    last: dict[int, int] = {}
    for number, step in seen.states.group_by("body").agg(pl.col("step").max()).iter_rows():
        client = seen.bodies[number].client
        last[client] = max(last.get(client, 0), step)
    return last


def labels_of(seen: Seen) -> set[str]:
    """Return the labels of all bodies that were ever there."""
    return {body.label for body in seen.bodies.values()}


def _coming(run: Seen, golden: Seen) -> Iterator[tuple[str, At, float, float]]:
    """Yield the bodies that only one of both has: when they came, and who has them."""
    for seen, other, has in ((run, golden, 1.0), (golden, run, 0.0)):
        for label in labels_of(seen) - labels_of(other):
            at = min((one.at for one in seen.appearances if one.body.label == label), key=_order)
            yield label, at, has, 1.0 - has


def _order(at: At) -> tuple[int, int]:
    return at.step, at.call


def _first(
    key: tuple[str, str | None, int],
    mine: Sequence[Row],
    theirs: Sequence[Row],
    last: Sequence[int],
) -> Iterator[Found]:
    """Yield all columns of the first row that differs.

    What one lacks because it has ended before, each at its `last` step, is no difference in itself.
    """
    entity, label, _ = key
    phase = PUT if entity == "set" else TOLD
    for one, other in zip_longest(mine, theirs):
        if one is None or other is None or one[0].step != other[0].step:
            # What comes first is what the other one lacks, whichever it is.
            first = min((row for row in (one, other) if row is not None), key=lambda r: r[0].step)
            step = first[0].step
            lacks = last.index(min(last))
            if (one, other)[lacks] is None and last[lacks] < max(last) and step >= last[lacks]:
                return
            counts = [sum(at.step <= step for at, _ in rows) for rows in (mine, theirs)]
            lacking = Difference(step, label, None, f"{entity}.rows", *counts)
            yield When(step, phase, first[0].call), lacking
            return
        (at, values), (_, golden) = one, other
        found = [name for name in {**values, **golden} if not _is(values, golden, name)]
        for link, name in found:
            column = (link, name)
            difference = Difference(
                at.step, label, link, f"{entity}.{name}", values.get(column), golden.get(column)
            )
            yield When(at.step, phase, at.call), difference
        if found:
            return


def _is(values: Mapping[Column, Value], golden: Mapping[Column, Value], name: Column) -> bool:
    """Whether both have the same of a column; what is not a number is none in both."""
    one, other = values.get(name), golden.get(name)
    return one == other or (one != one and other != other)


# -- what was told, as rows of columns ------------------------------------------------------------


def _told(seen: Seen, labels: Set[str]) -> Told:
    """Return what was told of the bodies of these labels, and of each client."""
    found: Told = {}

    def add(entity: str, at: At, of: Body | int, values: Iterable[tuple[Column, Value]]) -> None:
        label, client = (of.label, of.client) if isinstance(of, Body) else (None, of)
        if label is None or label in labels:
            found.setdefault((entity, label, client), []).append((at, dict(values)))

    for one in seen.appearances:
        flags = {"there": one.there, "came": one.came, "sampled": one.sampled}
        body = {part.name: getattr(one.body, part.name) for part in fields(Body)}
        told = {name: value for name, value in body.items() if name not in FOLLOWS}
        add("bodies", one.at, one.body, _flat(flags | told))
    for setting in seen.settings:
        add("engine", setting.at, setting.client, _flat(setting.values))
    for dynamics in seen.dynamics:
        add("dynamics", dynamics.at, dynamics.body, _of_links(dynamics.reported))
    for given in seen.given:
        add("dynamics/given", given.at, given.body, _flat(given.values))
    for held in seen.constraints:
        labelled = [seen.bodies[number].label for number in held.bodies]
        told = {"number": held.number, "bodies": labelled, "there": held.there}
        add("constraints", held.at, held.client, _flat(told))
    for motor in seen.motors:
        told = {"joint": motor.joint, "mode": motor.mode, "force": motor.force}
        add("motors", motor.at, motor.body, _flat(told))
    for push in seen.pushes:
        told = {part.name: getattr(push, part.name) for part in fields(push)[2:]}
        add("pushes", push.at, push.body, _flat(told))
    for put in seen.puts:
        add("set", put.at, put.body, _of_put(put))
    return found


def _flat(values: Mapping[str, Any], link: int | None = None) -> Iterator[tuple[Column, Value]]:
    """Yield numbers, texts and flags by name; of a vector each element, by its number from 0."""
    for name, value in values.items():
        if is_dataclass(value):
            inner = {part.name: getattr(value, part.name) for part in fields(value)}
        elif isinstance(value, np.ndarray | list | tuple):
            inner = {str(number): element for number, element in enumerate(value)}
        else:
            yield (link, name), value if isinstance(value, str) else float(value)
            continue
        yield from (((link, f"{name}.{of}"), one) for (_, of), one in _flat(inner))


def _of_links(reported: Mapping[str, Any]) -> Iterator[tuple[Column, Value]]:
    # What follows from the mass stands behind it, such as the inertia.
    for name, values in sorted(reported.items(), key=lambda one: one[0] != "mass_kg"):
        for number, value in enumerate(values):
            yield from _flat({name: value}, link=number - 1)


def _of_put(put: Put) -> Iterator[tuple[Column, Value]]:
    for state in put.states:
        for name in ("position_m", "orientation", "velocity_m_s", "spin_rad_s"):
            yield from _flat({name: state[name]}, link=int(state["link"]))
    for name in ("position", "velocity", "torque"):
        yield from _flat({f"joint_{name}": getattr(put.joints, name)[0]})
    yield (None, "counts"), float(put.counts)
