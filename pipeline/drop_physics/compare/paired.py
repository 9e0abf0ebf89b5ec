"""Puts coordinates and velocities of bodies in two recordings into corresponding columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64, Int64
from drop_physics.compare.motions import BodySamples, motions
from drop_physics.trace.events import Body
from drop_physics.trace.history import Seen
from drop_physics.trace.states import motion_of
from drop_physics.trace.swaps import EndApart, Paired

BASE = ("m",) * 3 + ("rad",) * 4 + ("m/s",) * 3 + ("rad/s",) * 3
"""Units of the numbers of a base: position, orientation as a quaternion, velocity, spin."""


@dataclass(frozen=True, eq=False)
class PairedBody:
    """A body that both runs have, with its numbers: 13 for the base, then those of the joints."""

    name: str
    a: Float64
    """The first run's values at each sample, shape (n + 1, k); nan where missing."""
    b: Float64
    units: Sequence[str]
    labels: Sequence[str]
    """The body or joint to which each number belongs."""
    places: Sequence[int]
    """Index of each number in the full list of a body's numbers: base, joint positions, joint
    velocities."""


def paired_bodies(
    a: Seen, b: Seen, bodies: Sequence[tuple[Body, Body]], steps: int
) -> list[PairedBody]:
    """Return the bodies of both runs with their samples, if they have the same joints."""
    mine, theirs = (_motions(each) for each in (a, b))
    found = []
    for x, y in bodies:
        both = mine.get(x.number), theirs.get(y.number)
        if both[0] is None or both[1] is None:
            continue
        units, labels, places = _columns(x, both[0])
        others, *_ = _columns(y, both[1])
        if units != others:
            continue
        rows = [_rows(body, held, steps) for body, held in ((x, both[0]), (y, both[1]))]
        found.append(PairedBody(_label(x), rows[0], rows[1], units, labels, places))
    return found


def moving_alone(a: Seen, b: Seen, bodies: Sequence[tuple[Body, Body]]) -> dict[str, list[str]]:
    """Return the names of moving bodies without a counterpart, by run: `a` and `b`."""
    found = {}
    for which, (side, seen) in enumerate((("a", a), ("b", b))):
        known = {pair[which].number for pair in bodies}
        moving = sorted({*_motions(seen)} - known)
        found[side] = [_label(seen.bodies[number]) for number in moving]
    return found


def columns_of(bodies: Sequence[PairedBody]) -> list[Paired]:
    """Return the numbers of bodies as columns, before and after each step."""
    return [
        Paired(
            body.name, "motion", body.labels, body.a[:-1], body.b[:-1], body.a[1:], body.b[1:],
            body.units,
        )
        for body in bodies
    ]  # fmt: skip


def farthest(bodies: Sequence[PairedBody], step: int) -> EndApart:
    """Return the largest distance between the runs after a step, and where it occurs."""
    found = EndApart(0.0, "m", bodies[0].name if bodies else "")
    for body in bodies:
        a, b = body.a[step + 1], body.b[step + 1]
        for value, unit, name in _distances(body, a, b):
            if value > found.value:
                found = EndApart(value, unit, name)
    return found


def _distances(body: PairedBody, a: Float64, b: Float64) -> Iterator[tuple[float, str, str]]:
    begin = 0
    if body.places[:1] == [0]:
        yield float(np.linalg.norm(a[:3] - b[:3])), "m", body.name
        off = min(float(np.linalg.norm(a[3:7] - b[3:7])), float(np.linalg.norm(a[3:7] + b[3:7])))
        yield 4.0 * float(np.arcsin(min(1.0, off / 2.0))), "rad", body.name
        begin = 13
    for column in range(begin, len(body.units)):
        if body.units[column] in ("m", "rad"):
            yield float(abs(a[column] - b[column])), body.units[column], body.labels[column]


def _motions(seen: Seen) -> Mapping[int, BodySamples]:
    piece = seen.sampled.piece(seen.sampled.first, seen.sampled.last + 1)
    return motions(piece.bases, piece.joints)


def _label(body: Body) -> str:
    return body.label.partition("_")[2] or body.name or body.label


def _columns(body: Body, held: BodySamples) -> tuple[list[str], list[str], list[int]]:
    """Return units, labels and indices of a body's numbers."""
    units: list[str] = []
    labels: list[str] = []
    places: list[int] = []
    if held.base is not None:
        units += BASE
        labels += [_label(body)] * len(BASE)
        places += range(len(BASE))
    if held.joints is not None:
        for rate in (0, 1):
            for number, joint in enumerate(body.joints):
                if joint.widths[:2] == (1, 1):
                    unit = "m" if joint.kind == "prismatic" else "rad"
                    units.append(f"{unit}/s" if rate else unit)
                    labels.append(joint.name)
                    places.append(len(BASE) + 2 * number + rate)
    return units, labels, places


def _rows(body: Body, held: BodySamples, steps: int) -> Float64:
    """Return a body's numbers in each of its samples, shape (steps + 1, k)."""
    parts: list[Float64] = []
    if held.base is not None:
        parts.append(motion_of(held.base))
    if held.joints is not None:
        for rate, rows in ((0, held.joints.position), (1, held.joints.velocity)):
            parts.append(rows[:, _scalar(body, rate)])
    numbers = np.hstack(parts)
    whole: Float64 = np.full((steps + 1, numbers.shape[1]), np.nan)
    within = held.steps <= steps
    whole[held.steps[within]] = numbers[within]
    return whole


def _scalar(body: Body, rate: int) -> Int64:
    """Return the columns of joints that have a single coordinate."""
    at, found = 0, []
    for joint in body.joints:
        if joint.widths[:2] == (1, 1):
            found.append(at)
        at += joint.widths[rate]
    return np.array(found, np.int64)
