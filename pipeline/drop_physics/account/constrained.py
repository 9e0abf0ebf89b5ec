"""Rows for constraints, gears and equality constraints: position errors and forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.joined import FIXED, GEAR, POINT, ConstraintVersion
from drop_physics.explain.recording import NOBODY, ExplainedPiece
from drop_physics.messages import Message
from drop_physics.quantities import number, quantity
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import Equality
from drop_physics.trace.history import Seen
from drop_physics.trace.writes import written_by

EXACT = 0.1
"""Share of a body's size to which the gap of a constraint is compared: its target distance is 0,
which gives no scale."""


@dataclass(eq=False)
class HeldEquality:
    """An equality constraint of a model; grows chunk by chunk."""

    equality: Equality
    gap: float = 0.0
    """The largest distance between its anchors [m], or of a joint from the position required by the
    other."""
    gap_step: int = -1
    end: float = 0.0
    """The gap after the last step in which the equality is active."""
    active: int = 0
    """Number of steps in which the equality is active."""
    steps: int = 0


@dataclass(eq=False)
class HeldConstraint:
    """A constraint that closes the distance between two points; grows chunk by chunk."""

    last: ConstraintVersion
    gap_m: float = 0.0
    """The largest distance between the constraint's ends after a step."""
    gap_step: int = -1
    end_m: float = 0.0
    """The distance between the constraint's ends after the last step."""
    pull_n: float = 0.0
    """Force of the constraint at the largest distance."""
    most_n: float = 0.0
    limit_n: float = np.inf
    """Maximum force of the constraint, at the largest distance."""


class Held:
    """The constraints of a recording; grows chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._held: dict[tuple[int, int], HeldConstraint] = {}
        """Constraints, by client and number of calls before the constraint was created."""
        self._gears: dict[tuple[int, int], ConstraintVersion] = {}
        self._equalities = [HeldEquality(equality) for equality in seen.equalities]
        self._on: dict[tuple[int, int], bool] = {
            (equality.client, equality.at.call): equality.active for equality in seen.equalities
        }
        """Whether each equality is active, by client and index."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk."""
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
        for held in self._equalities:
            self._look(held, explained)

    def _look(self, held: HeldEquality, explained: ExplainedPiece) -> None:
        """Add a chunk to an equality: its active steps, and the distance between its ends."""
        equality, first, end = held.equality, explained.piece.first, explained.piece.end
        last = self._seen.samples.get(equality.client, 0)
        samples = np.arange(max(first, 1), min(end, last))
        if not len(samples):
            return
        active = self._active(equality, explained, samples)
        held.steps, held.active = held.steps + len(samples), held.active + int(active.sum())
        if equality.coefficients:
            off = _off_joints(equality, explained, samples)
        else:
            points = [_anchor_m(equality, side, explained, samples) for side in (0, 1)]
            off = np.linalg.norm(points[0] - points[1], axis=1)
        off = np.where(active & np.isfinite(off), np.abs(off), 0.0)
        most = int(np.argmax(off))
        if off[most] > held.gap:
            held.gap, held.gap_step = float(off[most]), int(samples[most])
        if active.any():
            held.end = float(off[np.flatnonzero(active)[-1]])

    def _active(self, equality: Equality, explained: ExplainedPiece, samples: Int64) -> Flags:
        """Flag the steps to samples in which an equality is active, as the script's writes say."""
        key = equality.client, equality.at.call
        active = np.full(len(samples), self._on[key])
        for call in explained.piece.calls.of(Act.SET_ACTIVE, Act.RESET_STATE):
            if call.client == equality.client:
                resets = call.act is Act.RESET_STATE
                written = equality.active if resets else _switched(call, equality.at.call)
                if written is not None:
                    active[samples > call.at.step] = self._on[key] = written
        return active

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

    def rows(self, subjects: Mapping[int, MeasuredBody], words: RowWords) -> Iterator[AccountRow]:
        """Yield the rows for constraints, gears and equalities."""
        for held in self._held.values():
            its = [subjects[body] for body in held.last.bodies if body in subjects]
            if its:
                yield _gap_row(held, its, words)
        for gear in self._gears.values():
            row = _gear_row(gear, subjects, words)
            if row is not None:
                yield row
        for equality in self._equalities:
            row = _equality_row(equality, subjects, words)
            if row is not None:
                yield row


def _point_m(
    version: ConstraintVersion, side: int, explained: ExplainedPiece, steps: Int64
) -> Float64:
    """Return the point of a constraint on one of its bodies after steps [m], shape (n, 3)."""
    body, link = version.bodies[side], version.links[side]
    place_m, axes = np.zeros((len(steps), 3)), np.tile(np.eye(3), (len(steps), 1, 1))
    if body != NOBODY:
        place_m, axes = explained.placed(body, link, steps)
    return np.asarray(place_m + axes @ np.asarray(version.pivots_m[side]))


def _switched(call: Call, number: int) -> bool | None:
    """Return whether a call enables an equality; None if the call does not name the equality."""
    written = written_by(call)
    mine = np.flatnonzero(written.indices == number)
    return bool(written.values[mine[-1]]) if len(mine) else None


def _anchor_m(equality: Equality, side: int, explained: ExplainedPiece, samples: Int64) -> Float64:
    """Return the anchor of an equality on one side at samples [m], shape (n, 3); nan if unknown."""
    if not equality.anchors_m:
        return np.full((len(samples), 3), np.nan)
    anchor = np.asarray(equality.anchors_m[side])
    if equality.of_world[side]:
        return np.tile(anchor, (len(samples), 1))
    body = (equality.body_a, equality.body_b)[side]
    place_m, axes = explained.placed(body, (equality.link_a, equality.link_b)[side], samples)
    return np.asarray(place_m + axes @ anchor)


def _off_joints(equality: Equality, explained: ExplainedPiece, samples: Int64) -> Float64:
    """Return how far the first joint is from the position given by the second, shape (n,)."""
    at = [
        _joint_at(explained, body, link, samples)
        for body, link in ((equality.body_a, equality.link_a), (equality.body_b, equality.link_b))
    ]
    here, there = (each - rest for each, rest in zip(at, equality.rest, strict=True))
    return np.asarray(here - np.polynomial.Polynomial(equality.coefficients)(there))


def _joint_at(explained: ExplainedPiece, body: int, link: int, samples: Int64) -> Float64:
    """Return the position of a joint at samples, shape (n,); nan if unknown."""
    found = np.full(len(samples), np.nan)
    for steps in explained.bodies[body].intervals if body in explained.bodies else ():
        _, rows, its = np.intersect1d(steps.steps, samples, return_indices=True)
        if len(rows) and link < steps.law.tree.links:
            found[its] = steps.after.joints[rows, steps.law.tree.coordinates[link].start]
    return found


def _equality_row(
    held: HeldEquality, subjects: Mapping[int, MeasuredBody], words: RowWords
) -> AccountRow | None:
    """Return the row for an equality's gap; None if its bodies have no steps."""
    equality = held.equality
    sides = ((equality.body_a, equality.link_a), (equality.body_b, equality.link_b))
    its = [subjects[body] for body in dict.fromkeys(body for body, _ in sides) if body in subjects]
    if not its or not held.steps:
        return None
    lighter = min(its, key=lambda each: each.weight_n)
    joints = bool(equality.coefficients)
    names = [
        words.names.rate(subjects[body].body, subjects[body].body.rates[link].start)
        if joints
        else Message("world")
        if of_world
        else str(words.names.link(body, link))
        for (body, link), of_world in zip(sides, equality.of_world, strict=True)
    ]
    told = Message("{kind} of {one}", kind=equality.kind, one=names[0])
    if sides[0] != sides[1]:
        told = told + Message(" and {other}", other=names[1])
    told = told + Message(": ")
    idle = not held.active
    if idle:
        told = told + Message("it is not active in any step, and pulls with nothing")
    else:
        unit, size = ("m", min(each.size_m for each in its)) if not joints else ("", 1.0)
        template = (
            Message("{gap} off at {time} ({end} at the end)")
            if joints
            else Message("its points are {gap} apart at {time} ({end} at the end)")
        )
        told = told + Message(
            template,
            gap=quantity(held.gap, unit),
            time=words.time(lighter, held.gap_step),
            end=quantity(held.end, unit),
        )
        if held.active < held.steps:
            told = told + Message(
                "; active in {active:,} of {steps:,} steps", active=held.active, steps=held.steps
            )
    row = AccountRow(
        kind="idle" if idle else "asked",
        constraint=equality.name,
        told=told,
        salience=0.8,
        subject=lighter.body,
    )
    if idle:
        return row
    return replace(
        row,
        asked=0.0,
        got=held.gap,
        gap=held.gap,
        unit=unit or "rad",
        step=held.gap_step,
        salience=held.gap / size / EXACT,
    )


def _gap_row(held: HeldConstraint, its: list[MeasuredBody], words: RowWords) -> AccountRow:
    lighter = min(its, key=lambda each: each.weight_n)
    size_m = min(each.size_m for each in its)
    names = [
        str(words.names.link(body, link))
        for body, link in zip(held.last.bodies, held.last.links, strict=True)
    ]
    told = Message(
        "its ends are {gap} apart at {time} ({end} at the end), where it pulls with {pull} of "
        "{limit}; at most with {most}, {weights} times the weight of {lighter}",
        gap=quantity(held.gap_m, "m"),
        time=words.time(lighter, held.gap_step),
        end=quantity(held.end_m, "m"),
        pull=quantity(held.pull_n, "N"),
        limit=quantity(held.limit_n, "N"),
        most=quantity(held.most_n, "N"),
        weights=number(held.most_n / lighter.weight_n),
        lighter=words.names.body(lighter.body.number),
    )
    return AccountRow(
        kind="asked",
        constraint=" – ".join(names),
        told=told,
        asked=0.0,
        got=held.gap_m,
        gap=held.gap_m,
        unit="m",
        step=held.gap_step,
        at_limit=held.pull_n >= 0.999 * held.limit_n,
        salience=held.gap_m / size_m / EXACT,
        subject=lighter.body,
    )


def _gear_row(
    gear: ConstraintVersion, subjects: Mapping[int, MeasuredBody], words: RowWords
) -> AccountRow | None:
    """Return the row for the motions of a gear's two joints; None if these are unknown."""
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
    return AccountRow(
        kind="asked",
        constraint=f"gear {one} – {other}",
        told=told,
        asked=gear.ratio,
        salience=min(0.4, max(abs(first), abs(second))),
        subject=subject.body,
    )
