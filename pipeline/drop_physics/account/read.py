"""Rows for what the script read about contacts and joint forces, compared with actual values."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import Term
from drop_physics.account.touches import PairKey, TouchedLinks
from drop_physics.account.words import RowWords, answered_range
from drop_physics.arrays import Float64
from drop_physics.explain.contact_points import Points
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.solids import solid_of
from drop_physics.messages import Message, joined
from drop_physics.physics.columns import rotation
from drop_physics.physics.reactions import Reactions
from drop_physics.physics.tree import BASE
from drop_physics.quantities import number, quantity
from drop_physics.trace.acts import Act
from drop_physics.trace.events import Sensor, located
from drop_physics.trace.history import Seen
from drop_physics.trace.readings import (
    DISTANCE,
    EFFORT,
    FIRST_FORCE,
    FORCE,
    FRACTION,
    POINTS,
    REACTION,
    Answer,
    Reading,
)
from drop_physics.trace.readings import Subject as Target

LEAST_N = 1e-9
UNITS = {"touch": "N", "force": "N", "rangefinder": "m"}
"""Units of the sensors that have a row."""
NOTHING_M = -1.0
"""The reading of a rangefinder whose ray meets nothing."""
SEES_NOTHING = 1.5
"""The salience of a rangefinder that never meets anything."""
LEAST = 0.03
"""Salience of rows about reactions that are read as 0, as most scripts read only the position."""
FELT = 1e-3
"""Share of a body's weight or mass below which a force or mass does not count."""
LOOKS = 64
"""Number of contact points of a chunk that are compared with a sensor's site."""


def reading_rows(
    seen: Seen,
    subjects: Mapping[int, MeasuredBody],
    pairs: Mapping[PairKey, TouchedLinks],
    filtered: Mapping[frozenset[int], str],
    across: Mapping[int, Reactions],
    words: RowWords,
) -> Iterator[AccountRow]:
    """Yield a row for each script line that reads contacts, rays, masses or reaction forces.

    `filtered` has the script line that disables contacts between bodies, by their ids. `across` are
    the forces across joints in the last step, by body id.
    """
    masses = [each for each in seen.readings if each.act is Act.READ_PROPERTIES]
    for reading in seen.readings:
        answers = {answer.name: answer for answer in reading.answers}
        its = {target.body for target in reading.targets} & subjects.keys()
        its = its or {each for each in subjects if seen.bodies[each].client == reading.client}
        if not its:
            continue
        subject, salience, group = subjects[min(its)], 0.4, None
        if POINTS in answers:
            told = _points(answers) + _pressing(reading, pairs, filtered)
            whom, got = _whom(reading, words), answers.get(FORCE)
        elif FRACTION in answers:
            told, got, whom = _met(answers), None, Message("a ray")
        elif any(abs(answers[name].last) > LEAST_N for name in answers if _is_reaction(name)):
            link = next((each.link for each in reading.targets), None)
            if link is None or not 0 <= link < subject.tree.links:
                continue
            told, got = _reaction(answers) + _beyond(subject, link), None
            whom = words.names.link(subject.body.number, link)
        elif (unset := _unset(reading, answers, subject, across)) is not None:
            told, got, salience = unset, None, LEAST
            whom, group = _whom(reading, words), ("unset", subject.body.number)
        elif reading.act is Act.READ_PROPERTIES and (told := _base_only(subject, masses)):
            whom, got = words.names.body(subject.body.number), None
        elif (balance := _balance(reading, subject, words)) is not None:
            told, got, whom = balance, None, words.names.body(subject.body.number)
        else:
            continue
        step = min(reading.last_step, subject.ledger.last)
        yield AccountRow(
            kind="reads",
            site=located(reading.file, reading.line),
            told=Message("{function} of {whom}: ", function=reading.function, whom=whom) + told,
            got=None if got is None else got.last,
            unit=None if got is None else "N",
            step=step,
            salience=salience,
            subject=subject.body,
            group=group,
        )


def _met(answers: Mapping[str, Answer]) -> Message:
    """Describe where a ray ends, as a share of its length and as a place."""
    place = ", ".join(number(answers[axis].last) for axis in "xyz" if axis in answers)
    return Message(
        "it ends at {share} of its length in the last reading, at {place}",
        share=number(answers[FRACTION].last),
        place=place,
    )


def _unset(
    reading: Reading,
    answers: Mapping[str, Answer],
    subject: MeasuredBody,
    across: Mapping[int, Reactions],
) -> Message | None:
    """Describe a reaction that is always read as 0, as no sensor measures it; else None."""
    its = [answer for name, answer in answers.items() if _is_reaction(name)]
    links = [target.link for target in reading.targets if target.link is not None]
    forces = across.get(subject.body.number)
    if not its or not links or forces is None or any(each.least or each.greatest for each in its):
        return None
    if reading.last_step > reading.first_step:  # a loop, which reads the position
        return None
    if not 0 <= links[0] < len(forces.force_n):
        return None
    size_n = float(np.linalg.norm(forces.force_n[links[0]]))
    if not size_n > FELT * subject.weight_n:
        return None
    return Message(
        "its reaction is read as 0, as no sensor of it is on; it transmits {force} at the end",
        force=quantity(size_n, "N"),
    )


def _base_only(subject: MeasuredBody, masses: Sequence[Reading]) -> Message:
    """Describe the mass of a floating base if a script reads that of no other link; else nothing.

    `masses` are all readings of a link's properties.
    """
    number, tree = subject.body.number, subject.tree
    links = {each.link for one in masses for each in one.targets if each.body == number}
    base_kg, whole_kg = float(tree.masses_kg[0]), subject.mass_kg
    if links != {BASE} or tree.fixed or not base_kg < (1 - FELT) * whole_kg:
        return Message("")
    return Message(
        "its base has {base}, and with its links, which are not read, it has {whole}",
        base=quantity(base_kg, "kg"),
        whole=quantity(whole_kg, "kg"),
    )


class Sensed:
    """How close contacts come to the sites of touch sensors; filled chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._sensors = [
            sensor for sensor in seen.sensors if sensor.kind == "touch" and sensor.place
        ]
        self._solids = [solid_of(sensor.place) for sensor in self._sensors if sensor.place]
        self.outside_m = {sensor.name: np.inf for sensor in self._sensors}
        """Distance of the nearest contact point outside a site [m], by sensor name."""
        self._rays = [
            sensor for sensor in seen.sensors if sensor.kind == "rangefinder" and sensor.place
        ]
        self._along: dict[str, Float64] = {}
        """Direction of a rangefinder's ray in the world at first, by sensor name."""

    def add(self, explained: ExplainedPiece, points: Points) -> None:
        """Add the contact points of a chunk."""
        for sensor in self._rays:
            steps = (
                explained.bodies[sensor.body].intervals if sensor.body in explained.bodies else ()
            )
            if sensor.name in self._along or not steps or not len(steps[0]):
                continue
            assert sensor.place is not None
            first = steps[0].steps[:1]
            _, axes = explained.placed(sensor.body, sensor.link, first, after=False)
            turn = rotation(np.array(sensor.place.orientation)[:, None])[..., 0]
            self._along[sensor.name] = axes[0] @ turn[:, 2]
        for sensor, solid in zip(self._sensors, self._solids, strict=True):
            mine = (points.body == sensor.body) & (points.link == sensor.link)
            rows = np.flatnonzero(mine.any(axis=1) & (points.normal_n > 0))
            if solid is None or not len(rows):
                continue
            rows = rows[:: max(1, len(rows) // LOOKS)]
            # Positions and contacts are those with which a step begins.
            place_m, axes = explained.placed(
                sensor.body, sensor.link, points.step[rows], after=False
            )
            at_m = points.at_m[rows].mean(axis=1)
            in_link = np.einsum("nji,nj->ni", axes, at_m - place_m)
            shape = solid.collision
            turn = rotation(np.array(shape.orientation)[:, None])[..., 0]
            in_site = (in_link - np.array(shape.position_m)) @ turn
            nearest = float(np.nanmin(-solid.depth_m(in_site)))
            self.outside_m[sensor.name] = min(self.outside_m[sensor.name], nearest)

    def rows(
        self,
        seen: Seen,
        subjects: Mapping[int, MeasuredBody],
        pairs: Mapping[PairKey, TouchedLinks],
        words: RowWords,
    ) -> Iterator[AccountRow]:
        """Yield the rows for a model's touch and force sensors, and its rangefinders."""
        for sensor in seen.sensors:
            subject = subjects.get(sensor.body)
            if subject is None or sensor.kind not in UNITS or not sensor.answers:
                continue
            if not subject.lasts(seen):
                continue
            unit = UNITS[sensor.kind]
            told = Message(
                "{kind} on {link}: {value} at the end",
                kind=sensor.kind,
                link=words.names.link(sensor.body, sensor.link),
                value=quantity(_size(sensor), unit),
            )
            if len(sensor.answers) == 1:
                told = told + answered_range(sensor.answers[0])
            if sensor.kind == "touch":
                told = told + self._touch(sensor, pairs)
            elif sensor.kind == "rangefinder":
                told = told + self._ray(sensor)
            elif sensor.link > BASE:
                told = told + _beyond(subject, sensor.link)
            last = subject.ledger.last
            yield AccountRow(
                kind="reads",
                site=sensor.name,
                told=told,
                got=sensor.answers[0].last if len(sensor.answers) == 1 else None,
                unit=unit,
                step=last,
                salience=SEES_NOTHING if _sees_nothing(sensor) else 0.4,
                subject=subject.body,
            )

    def _ray(self, sensor: Sensor) -> Message:
        """Describe where a rangefinder's ray goes, if it never meets anything."""
        along = self._along.get(sensor.name)
        if not _sees_nothing(sensor) or along is None:
            return Message("")
        return Message(
            " and in every step: its ray meets nothing; it goes along its site's z axis, at first "
            "({axis}) in the world",
            axis=joined(", ", [number(float(np.round(each, 3)) + 0.0) for each in along]),
        )

    def _touch(self, sensor: Sensor, pairs: Mapping[PairKey, TouchedLinks]) -> Message:
        target = Target(sensor.body, sensor.link)
        force_n = sum(its.normal_n for key, its in pairs.items() if _meant(target, key))
        told = Message(
            "; contacts press its link with {force} in the median", force=quantity(force_n, "N")
        )
        outside_m = self.outside_m.get(sensor.name, np.inf)
        if force_n and 0 < outside_m < np.inf:
            told = told + Message(
                ", and the nearest of their points is {outside} outside the sensor's site",
                outside=quantity(outside_m, "m"),
            )
        return told


def _size(sensor: Sensor) -> float:
    """Return a sensor's last reading: a number, or the size of a vector."""
    last = [answer.last for answer in sensor.answers]
    return last[0] if len(last) == 1 else float(np.linalg.norm(last))


def _sees_nothing(sensor: Sensor) -> bool:
    """Return whether a rangefinder meets nothing in any step."""
    answer = sensor.answers[0]
    return sensor.kind == "rangefinder" and answer.least == answer.greatest == NOTHING_M


def _whom(reading: Reading, words: RowWords) -> str:
    """Return the names of the bodies whose contacts a script line reads."""
    if not reading.targets:
        return Message("all bodies")
    first, *more = reading.targets
    whom = words.names.link(first.body, BASE if first.link is None else first.link)
    if first.other is not None:
        at = BASE if first.other_link is None else first.other_link
        whom = f"{whom} × {words.names.link(first.other, at)}"
    if more:
        whom = Message("{first} and {more} more", first=whom, more=len(more))
    return whom


def _points(answers: Mapping[str, Answer]) -> Message:
    told = Message("{points} in the last reading", points=_count(answers[POINTS].last))
    told = told + answered_range(answers[POINTS])
    if FORCE in answers:
        first, whole = answers[FIRST_FORCE], answers[FORCE]
        told = told + Message(
            ", the first with a normal force of {force}", force=quantity(first.last, "N")
        )
        told = told + answered_range(first)
        told = told + Message(", all together {force}", force=quantity(whole.last, "N"))
        told = told + answered_range(whole)
    if DISTANCE in answers and answers[FORCE].greatest <= LEAST_N:
        apart = quantity(answers[DISTANCE].last, "m")
        told = told + Message(", {apart} apart", apart=apart)
    return told


def _count(points: float) -> Message:
    return Message("1 point") if points == 1 else Message("{points:.0f} points", points=points)


def _pressing(
    reading: Reading, pairs: Mapping[PairKey, TouchedLinks], filtered: Mapping[frozenset[int], str]
) -> Message:
    """Return the total contact force between the bodies that a script line reads about."""
    its = [
        touched
        for key, touched in pairs.items()
        if not reading.targets or any(_meant(target, key) for target in reading.targets)
    ]
    force_n = sum(touched.normal_n for touched in its)
    if not force_n:
        told = Message("; no contact between them presses in any step")
        for target in reading.targets:
            both = {target.body} if target.other is None else {target.body, target.other}
            line = filtered.get(frozenset(both))
            if line is not None:
                told = told + Message(": {line} filters it", line=line)
                break
        return told
    force = quantity(force_n, "N")
    if len(reading.targets) > 1:
        return Message(
            "; the contacts of all of these press with {force} in the median", force=force
        )
    return Message("; contacts press with {force} in the median", force=force)


def _meant(target: Target, key: PairKey) -> bool:
    """Return whether a pair of links in contact is one that a script line reads about."""
    sides = ((key[0], key[2]), (key[1], key[3]))
    for one, other in (sides, sides[::-1]):
        here = one[0] == target.body and target.link in (None, one[1])
        there = target.other is None or (
            other[0] == target.other and target.other_link in (None, other[1])
        )
        if here and there:
            return True
    return False


def _is_reaction(name: str) -> bool:
    return name.startswith(REACTION)


def _reaction(answers: Mapping[str, Answer]) -> Message:
    its = [answer.last for name, answer in answers.items() if _is_reaction(name)]
    force, torque = (", ".join(number(value) for value in part) for part in (its[:3], its[3:]))
    return Message(
        "reaction {force} N and {torque} N m in the last reading, {size} together",
        force=force,
        torque=torque,
        size=quantity(float(np.linalg.norm(its[:3])), "N"),
    )


def _balance(reading: Reading, subject: MeasuredBody, words: RowWords) -> Message | None:
    """Describe an inverse-dynamics result beside the effort of gravity; None without a result.

    With velocities and accelerations of zero, the result is the opposite of gravity's effort on the
    joint.
    """
    efforts = [answer.first for answer in reading.answers if answer.name.startswith(EFFORT)]
    tree, ledger = subject.tree, subject.ledger
    if not efforts or not tree.fixed or len(efforts) < tree.joint_rates:
        return None
    window = ledger.window(reading.first_step + 1, reading.first_step + 1)
    pulls = [ledger.forces(rate, window).get(Term("gravity"), 0.0) for rate in range(tree.size)]
    if not any(pulls):
        return None
    left = np.abs(np.add(efforts[: tree.joint_rates], pulls))
    worst = int(np.argmax(left))
    joint = next(
        joint
        for joint, place in zip(subject.body.joints, subject.body.rates, strict=True)
        if place.start <= worst < place.stop
    )
    unit = "N" if joint.kind == "prismatic" else "N m"
    return Message(
        "{effort} for {joint} in the first reading, where gravity acts on it with {pull}",
        effort=quantity(efforts[worst], unit),
        joint=words.names.rate(subject.body, worst),
        pull=quantity(pulls[worst], unit),
    )


def _beyond(subject: MeasuredBody, link: int) -> Message:
    """Describe the mass that a joint carries."""
    mass_kg = mass_beyond_kg(subject, {link})
    return Message(
        "; what hangs on it has {mass} and weighs {weight}",
        mass=quantity(mass_kg, "kg"),
        weight=quantity(mass_kg * subject.pull_m_s2, "N"),
    )


def mass_beyond_kg(subject: MeasuredBody, links: Collection[int]) -> float:
    """Return the mass of links and of everything attached to them [kg]."""
    tree, held = subject.tree, set(links)
    for link, parent in enumerate(tree.parents):
        if parent in held:
            held.add(link)
    return float(sum(tree.masses_kg[link + 1] for link in held))
