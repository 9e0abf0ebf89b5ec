"""Compares the samples of two simulations: bases, joints, constraints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.arrays import Flags, Float64, Int64
from drop_physics.compare.contact_points import first_contact
from drop_physics.compare.difference import (
    FIRST,
    LED,
    Dated,
    Difference,
    Largest,
    When,
    earliest,
    off,
)
from drop_physics.compare.motions import NOTHING, BodySamples, motions, together
from drop_physics.compare.pairing import Pairing, lengths
from drop_physics.compare.tolerance import Tolerance
from drop_physics.physics.rotations import same_way
from drop_physics.trace.events import Body
from drop_physics.trace.history import Piece, Seen
from drop_physics.trace.states import BASE, MOTION_COLUMNS, motion_of

Forces = Mapping[tuple[int, int], tuple[Int64, Float64]]

VECTORS = (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13))
"""Column groups of a state: position, quaternion, velocity, spin."""
QUANTITIES = {"position": "m", "orientation": "rad", "velocity": "m/s", "spin": "rad/s"}
JOINT_QUANTITIES = {
    "joint_position": ("rad", "m"), "joint_velocity": ("rad/s", "m/s"),
    "joint_effort": ("N m", "N"),
}  # fmt: skip
"""Units of the quantities of revolute joints, and of prismatic ones."""


class SampleComparison:
    """Compares the samples of two simulations.

    Parameters
    ----------
    run, golden
        The checked and the golden recording.
    pairs
        The simulations and bodies that correspond.
    tolerance
        The allowed differences.
    """

    def __init__(self, run: Seen, golden: Seen, pairs: Pairing, tolerance: Tolerance) -> None:
        self.first: Dated | None = None
        """The first number that differs by more than allowed, or the first sample that one
        recording lacks.
        """
        self.parted: When | None = None
        """Moment of the first state that is not equal bit for bit."""
        self.shared = False
        """Whether both recordings have a sample of the same body and step."""
        self.unlike: dict[int, str] = {}
        """Labels of bodies that have other joints in the other recording, so that they are not
        compared.
        """
        self.largest: dict[tuple[int, str], Largest] = {}
        """The largest difference of each body and quantity."""
        self._run, self._golden = run, golden
        self._pairs, self._tolerance = pairs, tolerance
        self._touched: int | None = None
        began = [
            {
                (number, appearance.at.step)
                for appearance in seen.appearances
                if appearance.came and (number := numbers[appearance.body.number]) in pairs.common
            }
            for seen, numbers in ((run, {n: n for n in run.bodies}), (golden, pairs.numbers))
        ]
        # A body that came after a picture was taken has no sample of where it began.
        self._began = began[0] & began[1]
        self._fresh = {
            (appearance.body.number, appearance.at.step)
            for appearance in run.appearances
            if appearance.came and not appearance.sampled
        }

    def add(self, mine: Piece, theirs: Piece) -> None:
        """Compare the samples of the next steps."""
        contacts = self._pairs.renumbered(theirs.contacts, "body_a", "body_b")
        touched = [int(table["step"][0]) for table in (mine.contacts, contacts) if len(table)]
        if self._touched is None and touched:
            self._touched = min(touched)
        bases = self._pairs.renumbered(theirs.bases, "body")
        numbers = self._pairs.numbers
        joints = {numbers[number]: held for number, held in theirs.joints.items()}
        tracks = motions(mine.bases, mine.joints), motions(bases, joints)
        found = [
            self._first_of_body(number, *(track.get(number, NOTHING) for track in tracks))
            for number in self._pairs.common
        ]
        if self.first is None:
            found += [self._first_force(mine.forces, theirs.forces)]
            allowed = self._tolerance.of_contacts()
            if allowed is not None:
                found += [first_contact(self._run, self._pairs, mine.contacts, contacts, allowed)]
            self.first = earliest(*found)

    def end(self) -> None:
        """Compare the durations of the simulations, even if nothing moves."""
        for client, (mine, theirs) in lengths(self._run, self._golden, self._pairs).items():
            step, there = min(mine, theirs), (float(mine > theirs), float(theirs > mine))
            ended = Dated(When(step, LED), client, Difference(step, None, None, "there", *there))
            self.first = earliest(self.first, ended)
            self._part(ended.when)

    def _dated(
        self, number: int, step: int, link: int, column: str, value: float, golden: float
    ) -> Dated:
        body = self._pairs.common[number]
        part, unit = _part_of(body, link, column)
        difference = Difference(step, body.label, link, column, value, golden, None, part, unit)
        return Dated(self._when(number, step), body.client, difference)

    def _first_of_body(self, number: int, mine: BodySamples, theirs: BodySamples) -> Dated | None:
        """Return a body's first number that differs in the given samples."""
        dated = [self._lacking(number, mine.steps, theirs.steps)]
        mine, theirs = together(mine, theirs)
        steps = mine.steps
        body, other = self._pairs.common[number], self._pairs.bodies[number]
        columns = _columns(body, mine)
        if columns != _columns(other, theirs):
            self.unlike[number] = body.label
            mine, theirs = (BodySamples(each.steps, each.base, None) for each in (mine, theirs))
            columns = _columns(body, mine)
            if columns != _columns(other, theirs):
                return earliest(*dated)
        self.shared |= len(steps) > 0 and number not in self.unlike
        x, y = mine.numbers, theirs.numbers
        differing: Flags = np.logical_or.reduce(off(x, y), axis=1)
        if differing.any():
            self._part(self._when(number, int(steps[differing][0])))
            tracks = mine.at(differing), theirs.at(differing)
            parts = _parts(self._run, body, tracks[0]), _parts(self._golden, other, tracks[1])
            self._measure(number, columns, tracks, parts)
            allowed = self._tolerance.of_parts(
                body, other.client, steps[differing], self._touched, parts[1]
            )
            beyond = _beyond(*parts, allowed)
            exact = ~np.logical_or.reduce(allowed != 0, axis=(1, 2))
            (rows,) = np.nonzero(exact | np.logical_or.reduce(beyond, axis=(1, 2)))
            for row in rows[:1].tolist():
                x, y = (track.numbers[row] for track in tracks)
                place = _worst(off(x, y), None if exact[row] else beyond[row, 0], tracks[0])
                name, link = columns[place]
                step = int(tracks[0].steps[row])
                dated.append(
                    self._dated(number, step, link, name, float(x[place]), float(y[place]))
                )
        return earliest(*dated)

    def _part(self, when: When) -> None:
        self.parted = when if self.parted is None else min(when, self.parted)

    def _when(self, number: int, step: int) -> When:
        return When(step, FIRST if step == 0 or (number, step) in self._fresh else LED)

    def _lacking(self, number: int, mine: Int64, theirs: Int64) -> Dated | None:
        """Return the first step for which only one recording has a sample."""
        for step in np.setxor1d(mine, theirs).tolist():
            if (number, step) not in self._began:
                self._part(self._when(number, step))
                there = float(step in mine), float(step in theirs)
                return self._dated(number, step, BASE, "there", *there)
        return None

    def _first_force(self, mine: Forces, theirs: Forces) -> Dated | None:
        """Return the first constraint force that differs; None if only motion is compared."""
        dated: list[Dated] = []
        for (client, number), (their_steps, forces) in theirs.items():
            key = self._pairs.clients.get(client, -1), number
            if key not in mine or self._tolerance.air_m:
                continue
            steps, rows, others = np.intersect1d(mine[key][0], their_steps, return_indices=True)
            x, y = mine[key][1][rows], forces[others]
            differ = off(x, y) if x.shape == y.shape else np.zeros((0, 0), np.bool_)
            for row, column in np.argwhere(differ)[:1]:
                name = f"constraints.{number}.{column}"
                values = float(x[row, column]), float(y[row, column])
                difference = Difference(int(steps[row]), None, None, name, *values)
                dated.append(Dated(When(int(steps[row]), LED), key[0], difference))
        return earliest(*dated)

    # -- how far apart ----------------------------------------------------------------------------

    def _measure(
        self,
        number: int,
        columns: list[tuple[str, int]],
        tracks: tuple[BodySamples, BodySamples],
        parts: tuple[Float64, Float64],
    ) -> None:
        """Update a body's largest differences, by quantity."""
        x, y = parts
        with np.errstate(invalid="ignore", over="ignore"):
            for quantity, vector in zip(QUANTITIES, VECTORS, strict=True):
                one, other = x[..., vector], y[..., vector]
                if quantity == "orientation":
                    turned = same_way(other.reshape(-1, 4), one.reshape(-1, 4))
                    away = np.linalg.norm(one - turned.reshape(one.shape), axis=-1)
                    size = 4 * np.arcsin(np.minimum(away / 2, 1.0))
                else:
                    size = np.linalg.norm(one - other, axis=-1)
                self._note(number, quantity, tracks[0].steps, size, range(BASE, size.shape[1] - 1))
            apart = np.abs(tracks[0].numbers - tracks[1].numbers)
        for quantity in JOINT_QUANTITIES:
            these = [place for place, (name, _) in enumerate(columns) if name == quantity]
            links = [columns[place][1] for place in these]
            self._note(number, quantity, tracks[0].steps, apart[:, these], links)

    def _note(
        self, number: int, quantity: str, steps: Int64, size: Float64, links: range | list[int]
    ) -> None:
        """Update the largest difference of one quantity, from sizes of shape (n, links)."""
        size = np.where(np.isfinite(size), size, 0.0)
        most = float(size.max(initial=0.0))
        held = self.largest.get((number, quantity))
        if most > (0.0 if held is None else held.difference):
            row, column = np.unravel_index(np.argmax(size), size.shape)
            body, link = self._pairs.common[number], links[int(column)]
            part, unit = _part_of(body, link, quantity)
            self.largest[number, quantity] = Largest(
                body.label, link, quantity, most, int(steps[row]), unit, part
            )


def _columns(body: Body, track: BodySamples) -> list[tuple[str, int]]:
    """Return the name and link of each of a body's numbers."""
    columns = [] if track.base is None else [(name, BASE) for name in MOTION_COLUMNS]
    return columns + ([] if track.joints is None else [*_joint_columns(body)])


def _joint_columns(body: Body) -> Iterator[tuple[str, int]]:
    for number, name in enumerate(JOINT_QUANTITIES):
        for joint in body.joints:
            for _ in range(joint.widths[number]):
                yield name, joint.link


def _worst(differ: Flags, base: Flags | None, track: BodySamples) -> int:
    """Return the index of the number to report, preferably one of the base."""
    named = differ.copy()
    if base is not None and track.base is not None:
        named[: len(base)] = base
    return int(np.argmax(named if named.any() else differ))


def _beyond(mine: Float64, golden: Float64, allowed: Float64) -> Flags:
    """Flag the numbers of base and links that differ by more than allowed, (n, links, 13)."""
    x, y, most = (each.reshape(-1, 13) for each in (mine, golden.copy(), allowed))
    turns = VECTORS[1]  # a quaternion of the other sign is the same orientation
    y[:, turns] = same_way(y[:, turns], x[:, turns])
    return _states_off(x, y, most).reshape(mine.shape)


def _states_off(mine: Float64, golden: Float64, allowed: Float64) -> Flags:
    """Flag the numbers of states that differ by more than allowed, shape (rows, 13).

    A tolerance applies to the length of a vector: if the difference is too long, but no component
    exceeds the tolerance, the largest component counts as different.
    """
    differ = off(mine, golden, allowed)
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.abs(mine - golden)
        for columns in VECTORS:
            long = np.linalg.norm(size[:, columns], axis=1) > allowed[:, columns].max(axis=1)
            (rows,) = np.nonzero(long & ~differ[:, columns].any(axis=1))
            differ[rows, columns.start + np.argmax(size[rows, columns], axis=1)] = True
    return differ


def _part_of(body: Body, link: int, column: str) -> tuple[str | None, str]:
    """Return the name of a link, or of its joint, and the unit of a quantity."""
    if column in JOINT_QUANTITIES:
        joint = next(joint for joint in body.joints if joint.link == link)
        return joint.name, JOINT_QUANTITIES[column][joint.kind == "prismatic"]
    return None if link < 0 else body.links[link + 1], QUANTITIES.get(column, "")


def _parts(seen: Seen, body: Body, track: BodySamples) -> Float64:
    """Return the states of base and links, shape (n, links, 13)."""
    if track.base is not None and (len(body.links) == 1 or body.hides_links):
        return motion_of(track.base)[:, None]
    return seen.motions(body, track.steps, track.base, track.joints)
