"""Rows of constraints: whether their ends meet, what they pull with, and gears and equalities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.account.rows import Row
from drop_physics.account.subjects import Subject
from drop_physics.account.terms import Term
from drop_physics.account.words import Words
from drop_physics.arrays import Float64, Int64
from drop_physics.explain.joined import FIXED, GEAR, POINT, ConstraintVersion
from drop_physics.explain.recording import NOBODY, ExplainedPiece
from drop_physics.messages import Message
from drop_physics.quantities import number, quantity
from drop_physics.trace.history import Seen

PULL = Term("constraints")


@dataclass(eq=False)
class HeldConstraint:
    """A constraint that closes the distance between two points; grows piece by piece."""

    last: ConstraintVersion
    gap_m: float = 0.0
    """The largest distance of its ends after a step."""
    gap_step: int = -1
    end_m: float = 0.0
    """Their distance after the last step."""
    pull_n: float = 0.0
    """Its pull at the largest distance."""
    most_n: float = 0.0
    limit_n: float = np.inf
    """The largest pull that it may have, at the largest distance."""


class Held:
    """The constraints of a recording; grows piece by piece."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._held: dict[tuple[int, int], HeldConstraint] = {}
        """Constraints, by client and number of calls before each was made."""
        self._gears: dict[tuple[int, int], ConstraintVersion] = {}

    def add(self, explained: ExplainedPiece) -> None:
        """Add a piece."""
        for told, steps, forces in explained.constraints.in_steps():
            which = np.searchsorted([each.at.step for each in told], steps, side="left") - 1
            for index in np.unique(which[which >= 0]).tolist():
                version, rows = told[index], np.flatnonzero(which == index)
                client = next(
                    self._seen.bodies[each].client for each in version.bodies if each != NOBODY
                )
                if version.kind in (FIXED, POINT):
                    self._add(client, version, explained, steps[rows], forces[rows, :3])
        for client in {body.client for body in self._seen.bodies.values()}:
            for version in explained.constraints.of_client(client):
                if version.kind == GEAR:
                    self._gears[client, version.made.at.call] = version

    def _add(
        self,
        client: int,
        version: ConstraintVersion,
        explained: ExplainedPiece,
        steps: Int64,
        forces_n: Float64,
    ) -> None:
        points = [_point_m(version, side, explained, steps) for side in (0, 1)]
        gap_m = np.linalg.norm(points[0] - points[1], axis=1)
        pull_n = np.linalg.norm(forces_n, axis=1)
        if not np.isfinite(gap_m).any():
            return
        held = self._held.setdefault((client, version.made.at.call), HeldConstraint(version))
        held.last = version
        most = int(np.nanargmax(gap_m))
        if gap_m[most] >= held.gap_m:
            held.gap_m, held.gap_step = float(gap_m[most]), int(steps[most])
            held.pull_n = float(pull_n[most])
            held.limit_n = version.limit_n_s / self._timestep_s(explained, client, steps[most])
        held.end_m, held.most_n = float(gap_m[-1]), max(held.most_n, float(pull_n.max()))

    def _timestep_s(self, explained: ExplainedPiece, client: int, step: int) -> float:
        """Return the timestep of the step to a sample [s]."""
        for judged in explained.bodies.values():
            for steps in judged.intervals:
                if judged.body.client == client and len(steps):
                    at = min(int(np.searchsorted(steps.steps, step)), len(steps) - 1)
                    return float(steps.reported.timestep_s[at])
        return np.nan

    def rows(self, subjects: Mapping[int, Subject], words: Words) -> Iterator[Row]:
        """Yield the rows of constraints, gears and equalities."""
        for held in self._held.values():
            its = [subjects[each] for each in held.last.bodies if each in subjects]
            if its:
                yield _gap_row(held, its, words)
        for gear in self._gears.values():
            row = _gear_row(gear, subjects, words)
            if row is not None:
                yield row
        for equality in self._seen.equalities:
            its = [
                subjects[each]
                for each in dict.fromkeys((equality.body_a, equality.body_b))
                if each in subjects
            ]
            pulling = [each for each in its if PULL in each.ledger.impulse]
            if its and not pulling:
                ends = (equality.body_a, equality.body_b)
                told = Message(
                    "{kind} of {one} and {other}: it pulls with nothing in any step",
                    kind=equality.kind,
                    one=words.names.body(ends[0]),
                    other=words.names.body(ends[1]),
                )
                if not equality.active:
                    told = told + Message("; it is not active")
                yield Row(
                    kind="idle",
                    body=its[0].body.label,
                    constraint=equality.name,
                    told=told,
                    salience=0.8,
                    subject=its[0].body,
                )


def _point_m(
    version: ConstraintVersion, side: int, explained: ExplainedPiece, steps: Int64
) -> Float64:
    """Return the point of a constraint on one of its bodies after steps [m], shape (n, 3)."""
    body, link = version.bodies[side], version.links[side]
    place_m, axes = np.zeros((len(steps), 3)), np.tile(np.eye(3), (len(steps), 1, 1))
    if body != NOBODY:
        place_m, axes = explained.placed(body, link, steps)
    return np.asarray(place_m + axes @ np.asarray(version.pivots_m[side]))


def _gap_row(held: HeldConstraint, its: list[Subject], words: Words) -> Row:
    lighter = min(its, key=lambda each: each.weight_n)
    size_m = min(each.size_m for each in its)
    names = [
        str(words.names.link(body, link))
        for body, link in zip(held.last.bodies, held.last.links, strict=True)
    ]
    told = Message(
        "its ends meet, got {gap} apart at {time} ({end} at the end); pulls {pull} of {limit}, at "
        "most {most}, {weights} weights",
        gap=quantity(held.gap_m, "m"),
        time=words.time(lighter, held.gap_step),
        end=quantity(held.end_m, "m"),
        pull=quantity(held.pull_n, "N"),
        limit=quantity(held.limit_n, "N"),
        most=quantity(held.most_n, "N"),
        weights=number(held.most_n / lighter.weight_n),
    )
    return Row(
        kind="asked",
        body=lighter.body.label,
        constraint=" – ".join(names),
        told=told,
        asked=0.0,
        got=held.gap_m,
        gap=held.gap_m,
        unit="m",
        step=held.gap_step,
        time_s=words.seconds(lighter, held.gap_step),
        at_limit=held.pull_n >= 0.999 * held.limit_n,
        salience=1.5 * held.gap_m / size_m,
        subject=lighter.body,
    )


def _gear_row(gear: ConstraintVersion, subjects: Mapping[int, Subject], words: Words) -> Row | None:
    """Return how far the two joints of a gear moved, None where that is not known."""
    moved: list[tuple[str, float]] = []
    for body, link in zip(gear.bodies, gear.links, strict=True):
        subject = subjects.get(body)
        if subject is None or not 0 <= link < len(subject.body.rates):
            return None
        place = subject.body.rates[link]
        if place.stop - place.start != 1:
            return None
        rate = subject.tree.first_rate + place.start
        moved.append(
            (words.names.rate(subject.body, place.start), float(subject.ledger.way[:, rate].sum()))
        )
    (one, first), (other, second) = moved
    told = Message(
        "ratio {ratio}: {one} moved {first}, {other} moved {second}",
        ratio=number(gear.ratio),
        one=one,
        first=number(first),
        other=other,
        second=number(second),
    )
    subject = subjects[gear.bodies[0]]
    return Row(
        kind="asked",
        body=subject.body.label,
        constraint=f"gear {one} – {other}",
        told=told,
        asked=gear.ratio,
        salience=0.4,
        subject=subject.body,
    )
