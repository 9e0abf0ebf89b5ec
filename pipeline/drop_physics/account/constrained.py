"""Rows for constraints: how far the constrained parts are apart, and with which force."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drop_physics.account.asked import Axis
from drop_physics.account.gap import (
    EXACT,
    ConstraintFrame,
    ConstraintGap,
    apart,
    frames,
    turned_by,
    with_gap,
    with_gaps,
)
from drop_physics.account.pinned import HeldConstraint
from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.words import RowWords
from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.explain.contact_points import Points
from drop_physics.explain.joined import FIXED, GEAR, POINT, UPRIGHT, ConstraintVersion
from drop_physics.explain.recording import NOBODY, ExplainedPiece
from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message
from drop_physics.quantities import number, quantity
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call
from drop_physics.trace.events import TENDON, Equality
from drop_physics.trace.history import Seen
from drop_physics.trace.writes import written_by


@dataclass(eq=False)
class HeldEquality:
    """A model's equality constraint, with its errors."""

    equality: Equality
    gap: ConstraintGap = field(default_factory=ConstraintGap)
    """The distance between the anchors [m], or between a joint's position and the one that the
    coupled joint demands [rad] or [m]."""
    turned: ConstraintGap = field(default_factory=ConstraintGap)
    """The angle between the two frames of a weld [rad]."""
    active: int = 0
    """Number of steps in which the equality is active."""
    steps: int = 0
    on: bool = True
    """Whether the equality is active in the last step."""


class Held:
    """The constraints of a recording, with their errors; filled chunk by chunk."""

    def __init__(self, seen: Seen, times: Mapping[int, StepTimes]) -> None:
        self._seen, self._times = seen, times
        self._held: dict[tuple[int, int], HeldConstraint] = {}
        """Constraints, by client and number of calls before the constraint was created."""
        self._gears: dict[tuple[int, int], ConstraintVersion] = {}
        self._equalities = [HeldEquality(equality) for equality in seen.equalities]
        self._on: dict[tuple[int, int], bool] = {
            (equality.client, equality.at.call): equality.active for equality in seen.equalities
        }
        """Whether each equality is active, by client and index."""

    def add(self, explained: ExplainedPiece, points: Points) -> None:
        """Add a chunk of explained steps."""
        for told, steps, forces in explained.constraints.in_steps():
            which = np.searchsorted([each.at.step for each in told], steps, side="left") - 1
            for made in dict.fromkeys(each.made.at.call for each in told):
                its = [each.made.at.call == made for each in told]
                rows = np.flatnonzero((which >= 0) & np.array(its)[which])
                version = told[which[rows[0]]] if len(rows) else None
                if version is None or version.kind not in (FIXED, POINT):
                    continue
                client = next(
                    self._seen.bodies[each].client for each in version.bodies if each != NOBODY
                )
                held = self._held.setdefault((client, made), HeldConstraint(version))
                parts = steps[rows], forces[rows, :3]
                held.add(told, which[rows], *parts, explained, points, self._times[client])
        for client in {body.client for body in self._seen.bodies.values()}:
            for version in explained.constraints.of_client(client):
                if version.kind == GEAR:
                    self._gears[client, version.made.at.call] = version
        for equality in self._equalities:
            self._look(equality, explained)

    def _look(self, held: HeldEquality, explained: ExplainedPiece) -> None:
        """Add a chunk to an equality: the steps in which it is active, and its error."""
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
        off_m, off_rad = apart(*frames(sides, explained, samples))
        held.gap.add(off_m, samples, active)
        if equality.orientations:
            held.turned.add(off_rad, samples, active)

    def _active(self, equality: Equality, explained: ExplainedPiece, samples: Int64) -> Flags:
        """Flag the samples at which an equality is active; the script may switch equalities off."""
        key = equality.client, equality.at.call
        active = np.full(len(samples), self._on[key])
        for call in explained.piece.calls.of(Act.SET_ACTIVE, Act.RESET_STATE):
            if call.client == equality.client:
                resets = call.act is Act.RESET_STATE
                written = equality.active if resets else _switched(call, equality.at.call)
                if written is not None:
                    active[samples > call.at.step] = self._on[key] = written
        return active

    def rows(self, subjects: Mapping[int, MeasuredBody], words: RowWords) -> Iterator[AccountRow]:
        """Yield the rows for all constraints, gears and equalities."""
        for held in self._held.values():
            its = [subjects[body] for body in held.last.bodies if body in subjects]
            if its:
                child = [body for body in held.last.bodies if body != NOBODY][-1]
                yield held.row(its, self._seen.bodies[child], words)
        for gear in self._gears.values():
            row = _gear_row(gear, subjects, words)
            if row is not None:
                yield row
        for equality in self._equalities:
            row = _equality_row(equality, subjects, self._seen, words)
            if row is not None:
                yield row


def coupling(axis: Axis, subject: MeasuredBody, seen: Seen) -> Message:
    """Describe the equality c0 + c1 q by which a joint should follow another one; else nothing."""
    for each in seen.equalities:
        its = each.body_a == subject.body.number and each.link_a == axis.joint.link
        alone = (each.body_a, each.link_a) == (each.body_b, each.link_b)
        c0, c1, *higher = (*each.coefficients, 0.0, 0.0)
        if not its or each.tendons or not each.coefficients or alone or any(higher):
            continue
        other = seen.bodies[each.body_b].joints[each.link_b].name
        told = Message(
            "; {name} makes it follow {c1} × {other}", name=each.name, c1=number(c1), other=other
        )
        return told + (Message(" + {c0}", c0=number(c0)) if c0 else Message(""))
    return Message("")


def _switched(call: Call, number: int) -> bool | None:
    """Return whether a call enables an equality; None if the call is about another one."""
    written = written_by(call)
    mine = np.flatnonzero(written.indices == number)
    return bool(written.values[mine[-1]]) if len(mine) else None


def _of_equality(equality: Equality, side: int) -> ConstraintFrame:
    body = (equality.body_a, equality.body_b)[side]
    return ConstraintFrame(
        NOBODY if equality.of_world[side] else body,
        (equality.link_a, equality.link_b)[side],
        equality.anchors_m[side] if equality.anchors_m else (np.nan,) * 3,
        equality.orientations[side] if equality.orientations else UPRIGHT,
    )


def _off_joints(equality: Equality, explained: ExplainedPiece, samples: Int64) -> Float64:
    """Return the difference between a coupled joint's position and the demanded one, shape (n,)."""
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
    """Return the row for an equality's error; None if the error is unknown."""
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
        row = with_gap(row, held.gap, "rad", 1.0)
    else:
        size_m = min(each.size_m for each in its)
        gap = Message(
            "its points are {gap} apart at {time} ({end} at the end)",
            gap=quantity(held.gap.most, "m"),
            time=words.time(lighter, held.gap.step),
            end=quantity(held.gap.end, "m"),
        )
        gap = gap + turned_by(held.turned, held.gap.most / size_m, lighter, words)
        row = with_gaps(row, held.gap, held.turned, size_m)
    return replace(row, told=told + gap + _activity(held))


def _names(
    equality: Equality,
    sides: Sequence[tuple[int, int]],
    subjects: Mapping[int, MeasuredBody],
    words: RowWords,
) -> Iterator[str]:
    """Yield the names of the two joints, tendons or links that an equality couples."""
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


def _tendons_row(
    row: AccountRow, held: HeldEquality, seen: Seen, subject: MeasuredBody
) -> AccountRow | None:
    """Return the row for coupled tendons' lengths; None if the lengths are not recorded.

    Only the first, last, least and greatest length of each tendon are recorded. These give the
    largest gap of a tendon coupled to a constant, but only the final gap of two coupled tendons.
    There is no row if the equality is not active at the end.
    """
    equality, lasts = held.equality, subject.lasts(seen)
    lengths = seen.measured(TENDON, equality.client)
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


def _gear_row(
    gear: ConstraintVersion, subjects: Mapping[int, MeasuredBody], words: RowWords
) -> AccountRow | None:
    """Return the row for a gear, with the motions of both joints; None if a motion is unknown."""
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
