"""Rows for constraints: of calls, and of a model's equalities, by their gaps and forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.joined import FIXED, GEAR, POINT, UPRIGHT, ConstraintVersion
from drop_physics.explain.recording import NOBODY, ExplainedPiece
from drop_physics.messages import Message
from drop_physics.physics.rotations import matrix
from drop_physics.quantities import number, quantity
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import TENDON, Equality
from drop_physics.trace.history import Seen
from drop_physics.trace.writes import written_by

EXACT = 0.1
"""Share of a body's size to which the gap of a constraint is compared: its target distance is 0,
which gives no scale."""


@dataclass(eq=False)
class Gap:
    """How far a constraint is from what it demands, after each step; grows chunk by chunk."""

    most: float = 0.0
    step: int = -1
    """The sample at which it is largest."""
    end: float = 0.0
    """The gap after the last step in which the constraint is active."""

    def add(self, off: Float64, samples: Int64, active: Flags) -> None:
        """Add the gap after the steps to some samples, shape (n,)."""
        off = np.where(active & np.isfinite(off), np.abs(off), 0.0)
        at = int(np.argmax(off))
        if off[at] > self.most:
            self.most, self.step = float(off[at]), int(samples[at])
        if active.any():
            self.end = float(off[np.flatnonzero(active)[-1]])


@dataclass(eq=False)
class HeldEquality:
    """An equality constraint of a model; grows chunk by chunk."""

    equality: Equality
    gap: Gap = field(default_factory=Gap)
    """The distance between its anchors [m], or of a joint from what the other demands."""
    turned: Gap = field(default_factory=Gap)
    """The angle between the orientations that a weld brings together [rad]."""
    active: int = 0
    """Number of steps in which the equality is active."""
    steps: int = 0
    on: bool = True
    """Whether the equality is active in the last step."""


@dataclass(eq=False)
class HeldConstraint:
    """A constraint that brings two points together; grows chunk by chunk."""

    last: ConstraintVersion
    gap: Gap = field(default_factory=Gap)
    """The distance between the constraint's ends after a step [m]."""
    turned: Gap = field(default_factory=Gap)
    """The angle between their orientations [rad], if it holds these, too."""
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
        """Add a chunk to an equality: its active steps, and how far its sides are apart."""
        equality, first, end = held.equality, explained.piece.first, explained.piece.end
        last = self._seen.samples.get(equality.client, 0)
        samples = np.arange(max(first, 1), min(end, last))
        if not len(samples):
            return
        active = self._active(equality, explained, samples)
        held.steps, held.active = held.steps + len(samples), held.active + int(active.sum())
        held.on = bool(active[-1])
        if equality.tendons:
            return
        if equality.coefficients:
            held.gap.add(_off_joints(equality, explained, samples), samples, active)
            return
        sides = [_of_equality(equality, side) for side in (0, 1)]
        off_m, off_rad = _apart(sides, explained, samples)
        held.gap.add(off_m, samples, active)
        if equality.orientations:
            held.turned.add(off_rad, samples, active)

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
        sides = [
            Side(*each)
            for each in zip(
                version.bodies,
                version.links,
                version.pivots_m,
                version.orientations,
                strict=True,
            )
        ]
        off_m, off_rad = _apart(sides, explained, steps)
        if not np.isfinite(off_m).any():
            return
        held = self._held.setdefault((client, version.made.at.call), HeldConstraint(version))
        held.last, active = version, np.ones(len(steps), np.bool_)
        pull_n = np.linalg.norm(forces_n, axis=1)
        held.gap.add(off_m, steps, active)
        if version.kind == FIXED:
            held.turned.add(off_rad, steps, active)
        held.most_n = max(held.most_n, float(pull_n.max()))
        if held.gap.step in steps:
            at = int(np.searchsorted(steps, held.gap.step))
            held.pull_n = float(pull_n[at])
            held.limit_n = version.limit_n_s / self._timestep_s(explained, client, steps[at])

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
            row = _equality_row(equality, subjects, self._seen, words)
            if row is not None:
                yield row


def _switched(call: Call, number: int) -> bool | None:
    """Return whether a call enables an equality; None if the call does not name the equality."""
    written = written_by(call)
    mine = np.flatnonzero(written.indices == number)
    return bool(written.values[mine[-1]]) if len(mine) else None


@dataclass(frozen=True)
class Side:
    """A frame on one of the links that a constraint holds together."""

    body: int
    """Id of the body; NOBODY for a frame of the world."""
    link: int
    place_m: tuple[float, ...]
    """Its origin from the link's centre of mass, in the axes of its inertia, or in the world."""
    orientation: tuple[float, ...]
    """Its axes in those: a quaternion x, y, z, w."""


def _of_equality(equality: Equality, side: int) -> Side:
    body = (equality.body_a, equality.body_b)[side]
    return Side(
        NOBODY if equality.of_world[side] else body,
        (equality.link_a, equality.link_b)[side],
        equality.anchors_m[side] if equality.anchors_m else (np.nan,) * 3,
        equality.orientations[side] if equality.orientations else UPRIGHT,
    )


def _apart(
    sides: Sequence[Side], explained: ExplainedPiece, samples: Int64
) -> tuple[Float64, Float64]:
    """Return the distance and the angle between two frames at samples [m] and [rad], (n,) each.

    With R the rotation between them it is |(R₃₂ - R₂₃, R₁₃ - R₃₁, R₂₁ - R₁₂)| = 2 sin φ and
    tr R - 1 = 2 cos φ.
    """
    places_m, frames = [], []
    for side in sides:
        place_m, axes = np.zeros((len(samples), 3)), np.tile(np.eye(3), (len(samples), 1, 1))
        if side.body != NOBODY:
            place_m, axes = explained.placed(side.body, side.link, samples)
        places_m.append(place_m + axes @ np.array(side.place_m))
        frames.append(axes @ matrix(side.orientation))
    turned = np.swapaxes(frames[0], 1, 2) @ frames[1]
    skewed = turned - np.swapaxes(turned, 1, 2)
    sine = np.linalg.norm(skewed[:, [2, 0, 1], [1, 2, 0]], axis=1)
    angle = np.arctan2(sine, np.trace(turned, axis1=1, axis2=2) - 1)
    return np.linalg.norm(places_m[0] - places_m[1], axis=1), np.asarray(angle)


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
    held: HeldEquality, subjects: Mapping[int, MeasuredBody], seen: Seen, words: RowWords
) -> AccountRow | None:
    """Return the row for an equality's gap; None if it is unknown."""
    equality = held.equality
    sides = ((equality.body_a, equality.link_a), (equality.body_b, equality.link_b))
    bodies = dict.fromkeys(body for body, _ in sides)
    its = [subjects[body] for body in bodies if body in subjects]
    if not its or not held.steps:
        return None
    lighter = min(its, key=lambda each: each.weight_n)
    names = [*_names(equality, sides, subjects, words)]
    told = Message("{kind} of {one}", kind=equality.kind, one=names[0])
    if names[0] != names[1]:
        told = told + Message(" and {other}", other=names[1])
    told = told + Message(": ")
    row = AccountRow(
        kind="asked", constraint=equality.name, told=told, salience=0.8, subject=lighter.body
    )
    if not held.active:
        told = told + Message("it is not active in any step, and pulls with nothing")
        return replace(row, kind="idle", told=told)
    if equality.tendons:
        return _tendons_row(row, held, seen, lighter)
    if equality.coefficients:
        gap = Message(
            "{gap} off at {time} ({end} at the end)",
            gap=quantity(held.gap.most, ""),
            time=words.time(lighter, held.gap.step),
            end=quantity(held.gap.end, ""),
        )
        row = _with_gap(row, held.gap, "rad", 1.0)
    else:
        size_m = min(each.size_m for each in its)
        gap = Message(
            "its points are {gap} apart at {time} ({end} at the end)",
            gap=quantity(held.gap.most, "m"),
            time=words.time(lighter, held.gap.step),
            end=quantity(held.gap.end, "m"),
        )
        gap = gap + _turned(held.turned, held.gap.most / size_m, lighter, words)
        row = _with_gaps(row, held.gap, held.turned, size_m)
    return replace(row, told=told + gap + _activity(held))


def _names(
    equality: Equality,
    sides: Sequence[tuple[int, int]],
    subjects: Mapping[int, MeasuredBody],
    words: RowWords,
) -> Iterator[str]:
    """Yield the names of both joints, tendons or links of an equality."""
    if equality.tendons:
        yield from equality.tendons
        return
    for (body, link), of_world in zip(sides, equality.of_world, strict=True):
        if equality.coefficients:
            of = subjects[body].body
            yield words.names.rate(of, of.rates[link].start)
        else:
            yield Message("world") if of_world else str(words.names.link(body, link))


def _activity(held: HeldEquality) -> Message:
    if held.active == held.steps:
        return Message("")
    return Message(
        "; active in {active:,} of {steps:,} steps", active=held.active, steps=held.steps
    )


def _turned(gap: Gap, beside: float, subject: MeasuredBody, words: RowWords) -> Message:
    """Describe the angle between two orientations; nothing if it is small beside a share."""
    if gap.most <= 0.1 * beside:
        return Message("")
    return Message(
        "; turned by {angle}° at {time} ({end}° at the end)",
        angle=number(float(np.degrees(gap.most))),
        time=words.time(subject, gap.step),
        end=number(float(np.degrees(gap.end))),
    )


def _with_gap(row: AccountRow, gap: Gap, unit: str, size: float) -> AccountRow:
    """Return a row with a gap; `size` is that to which it is compared."""
    return replace(
        row,
        asked=0.0,
        got=gap.most,
        gap=gap.most,
        unit=unit,
        step=gap.step,
        salience=gap.most / size / EXACT,
    )


def _with_gaps(row: AccountRow, gap: Gap, turned: Gap, size_m: float) -> AccountRow:
    """Return a row with the larger of a distance and an angle, and the other besides."""
    if turned.most > gap.most / size_m:
        return replace(_with_gap(row, turned, "rad", 1.0), besides=((gap.most, "m"),))
    return replace(_with_gap(row, gap, "m", size_m), besides=((turned.most, "rad"),))


def _tendons_row(
    row: AccountRow, held: HeldEquality, seen: Seen, subject: MeasuredBody
) -> AccountRow | None:
    """Return the row for the lengths of tendons; None if these are not recorded.

    The first, last, least and greatest length of each is recorded: of one tendon alone its largest
    gap follows, of two the gap at the end; while the equality is not active neither counts.
    """
    equality, lasts = held.equality, subject.lasts(seen)
    lengths = {
        sensor.name: sensor.answers[0]
        for sensor in seen.sensors
        if sensor.kind == TENDON and sensor.client == equality.client
    }
    if not all(name in lengths for name in equality.tendons) or not held.on or not lasts:
        return None
    one, other = (lengths[name] for name in equality.tendons)
    alone = equality.tendons[0] == equality.tendons[1]
    follows = np.polynomial.Polynomial(equality.coefficients)
    asked = equality.rest[0] + float(follows(0.0 if alone else other.last - equality.rest[1]))
    told = Message(
        "length {asked}, got {got} at the end", asked=number(asked), got=number(one.last)
    )
    off = most = one.last - asked
    if alone and held.active == held.steps:
        most = max(one.least - asked, one.greatest - asked, key=abs)
        told = told + Message("; {most} off at most", most=number(most, "+"))
    return replace(
        row,
        told=row.told + told + _activity(held),
        asked=asked,
        got=one.last,
        gap=off,
        unit="",
        step=subject.ledger.last,
        besides=((most, ""),),
        salience=abs(most) / (abs(asked) + 0.1) / EXACT,
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
        gap=quantity(held.gap.most, "m"),
        time=words.time(lighter, held.gap.step),
        end=quantity(held.gap.end, "m"),
        pull=quantity(held.pull_n, "N"),
        limit=quantity(held.limit_n, "N"),
        most=quantity(held.most_n, "N"),
        weights=number(held.most_n / lighter.weight_n),
        lighter=words.names.body(lighter.body.number),
    )
    row = AccountRow(
        kind="asked",
        constraint=" – ".join(names),
        told=told + _turned(held.turned, held.gap.most / size_m, lighter, words),
        at_limit=held.pull_n >= 0.999 * held.limit_n,
        subject=lighter.body,
    )
    return _with_gaps(row, held.gap, held.turned, size_m)


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
