"""The inputs of two simulations compared: bodies, settings, pushes and more.

A recording has a row for each input. Rows of one kind and one body, or one client, are compared in
order; the first that differs says where they part, and later rows do not count.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import polars as pl

from pipeline.analysis.script.cause import FOLDER
from pipeline.analysis.script.difference import INPUT, PUT, Dated, Difference, Value, When
from pipeline.analysis.script.tracks import order
from pipeline.seen import At, Body, Put, Seen

Column = tuple[int | None, str]
"""Link and name."""
Row = tuple[At, dict[Column, Value]]
Inputs = dict[tuple[str, str | None, int], list[Row]]
"""By entity, label of a body, and client."""

SOFT_CALLS = ("loadSoftBody", "createSoftBodyAnchor", "resetMeshData")
"""Whose effect is on a soft body, whose motion is not recorded."""
FOLLOWS = ("number", "label", "name", "bounds_m", "client")
"""A body's names, with the folder of its file, the boxes that follow from its pose, and the number
of its client, which is paired."""


def input_differences(run: Seen, golden: Seen) -> Iterator[Dated]:
    """Yield the first difference in the inputs of each body, and each client with bodies."""
    for label, at, *there in _coming(run, golden):
        yield When(at.step, INPUT, at.call), Difference(at.step, label, None, "there", *there)
    both = labels_of(run) & labels_of(golden)
    mine, theirs = _inputs(run, both), _inputs(golden, both)
    ends = _ends(run), _ends(golden)
    with_bodies = {body.client for seen in (run, golden) for body in seen.bodies.values()}
    for key in {**mine, **theirs}:
        if key[2] not in with_bodies:  # without bodies its settings have no effect
            continue
        last = [steps.get(key[2], 0) for steps in ends]
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
    """Yield the bodies that only one of both has: label, when they came, and who has them."""
    for seen, other, has in ((run, golden, 1.0), (golden, run, 0.0)):
        for label in sorted(labels_of(seen) - labels_of(other)):
            at = min((each.at for each in seen.appearances if each.body.label == label), key=order)
            yield label, at, has, 1.0 - has


def _first(
    key: tuple[str, str | None, int],
    mine: Sequence[Row],
    theirs: Sequence[Row],
    last: Sequence[int],
) -> Iterator[Dated]:
    """Yield all columns of the first row that differs.

    Rows that one lacks because it ended earlier, each at its `last` step, are not a difference.
    """
    entity, label, _ = key
    phase = PUT if entity == "set" else INPUT
    for row, other in zip_longest(mine, theirs):
        if row is None or other is None or row[0].step != other[0].step:
            # The earlier row is the one that the other side lacks.
            first = min(
                (each for each in (row, other) if each is not None), key=lambda r: r[0].step
            )
            step = first[0].step
            lacks = last.index(min(last))
            if (row, other)[lacks] is None and last[lacks] < max(last) and step >= last[lacks]:
                return
            counts = [sum(at.step <= step for at, _ in rows) for rows in (mine, theirs)]
            lacking = Difference(step, label, None, f"{entity}.rows", *counts)
            yield When(step, phase, first[0].call), lacking
            return
        (at, values), (_, golden) = row, other
        differing = [name for name in {**values, **golden} if not _is(values, golden, name)]
        for link, name in differing:
            column = (link, name)
            difference = Difference(
                at.step, label, link, f"{entity}.{name}", values.get(column), golden.get(column)
            )
            yield When(at.step, phase, at.call), difference
        if differing:
            return


def _is(values: Mapping[Column, Value], golden: Mapping[Column, Value], name: Column) -> bool:
    """Whether both have the same value in a column; nan equals nan."""
    value, other = values.get(name), golden.get(name)
    return value == other or (value != value and other != other)


# -- inputs as rows of columns --------------------------------------------------------------------


def _inputs(seen: Seen, labels: Set[str]) -> Inputs:
    """Return the inputs of the bodies with these labels, and of each client."""
    rows: Inputs = {}

    def add(entity: str, at: At, of: Body | int, values: Iterable[tuple[Column, Value]]) -> None:
        label, client = (of.label, of.client) if isinstance(of, Body) else (None, of)
        if label is None or label in labels:
            rows.setdefault((entity, label, client), []).append((at, dict(values)))

    for each in seen.appearances:
        flags = {"there": each.there, "came": each.came}  # a picture decides if it was sampled
        names = (part.name for part in fields(Body) if part.name not in FOLLOWS)
        add("bodies", each.at, each.body, _flat(flags | {n: getattr(each.body, n) for n in names}))
    for setting in seen.settings:
        add("engine", setting.at, setting.client, _flat(setting.values))
    for dynamics in seen.dynamics:
        add("dynamics", dynamics.at, dynamics.body, _of_links(dynamics.reported))
    for given in seen.given:
        add("dynamics/given", given.at, given.body, _flat(given.values))
    for held in seen.constraints:
        labelled = [seen.bodies[number].label for number in held.bodies]
        values = {"number": held.number, "bodies": labelled, "there": held.there}
        add("constraints", held.at, held.client, _flat(values))
    for motor in seen.motors:
        values = {"joint": motor.joint, "mode": motor.mode, "force": motor.force}
        add("motors", motor.at, motor.body, _flat(values))
    for push in seen.pushes:
        values = {part.name: getattr(push, part.name) for part in fields(push)[2:]}
        add("pushes", push.at, push.body, _flat(values))
    soft = [body.name for body in seen.bodies.values() if body.soft]
    for call in seen.calls:
        loads = call.function == "loadURDF" and any(name in call.arguments for name in soft)
        if call.function in SOFT_CALLS or loads:
            values = {"arguments": FOLDER.sub("", call.arguments), "raised": bool(call.raised)}
            add("calls", call.at, call.client, _flat({"function": call.function} | values))
    for record in seen.by_body.values():
        # Where a body that moves came, after a picture was taken, its next sample shows.
        came = {(each.at.step, each.at.call) for each in record.came}
        for put in record.puts:
            if not (put.counts and (put.at.step, put.at.call) in came):
                add("set", put.at, put.body, _of_put(put))
    for key, its in rows.items():
        if key[0] in ("dynamics", "engine"):  # a step takes them as the calls before it leave them
            rows[key] = [*{at.step: (at, values) for at, values in its}.values()]
    return rows


def _flat(values: Mapping[str, Any], link: int | None = None) -> Iterator[tuple[Column, Value]]:
    """Yield numbers, texts and flags by name; each element of a vector, numbered from 0."""
    for name, value in values.items():
        if is_dataclass(value):
            inner = {part.name: getattr(value, part.name) for part in fields(value)}
        elif isinstance(value, np.ndarray | list | tuple):
            inner = {str(number): element for number, element in enumerate(value)}
        else:
            yield (link, name), value if isinstance(value, str) else float(value)
            continue
        yield from (((link, f"{name}.{of}"), element) for (_, of), element in _flat(inner))


def _of_links(reported: Mapping[str, Any]) -> Iterator[tuple[Column, Value]]:
    # The mass first: others follow from it, such as the inertia.
    for name, values in sorted(reported.items(), key=lambda item: item[0] != "mass_kg"):
        for number, value in enumerate(values):
            yield from _flat({name: value}, link=number - 1)


def _of_put(put: Put) -> Iterator[tuple[Column, Value]]:
    for state in put.states:
        for name in ("position_m", "orientation", "velocity_m_s", "spin_rad_s"):
            yield from _flat({name: state[name]}, link=int(state["link"]))
    for name in ("position", "velocity", "torque"):
        yield from _flat({f"joint_{name}": getattr(put.joints, name)[0]})
    yield (None, "counts"), float(put.counts)
