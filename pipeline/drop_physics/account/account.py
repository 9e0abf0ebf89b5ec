"""The account of a recording: a list of requests, their results, and the impulses between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from drop_physics.account import asked, moved
from drop_physics.account.array_uses import array_use_rows
from drop_physics.account.carried import Carried, across_joints
from drop_physics.account.constrained import Held, coupling
from drop_physics.account.engine_resets import engine_reset_rows
from drop_physics.account.feedback import GivenControls
from drop_physics.account.held_controls import held_controls_rows
from drop_physics.account.idle import (
    IdleSettings,
    MadeStatic,
    PushedSoft,
    idle_actuator_rows,
    unforced_row,
)
from drop_physics.account.joints import JointTable
from drop_physics.account.ledger import Ledger, bins_for
from drop_physics.account.names import Names
from drop_physics.account.opposed import opposed
from drop_physics.account.overlaps import Overlaps
from drop_physics.account.ranking import ranked
from drop_physics.account.read import Sensed, reading_rows
from drop_physics.account.rows import AccountRow
from drop_physics.account.series import BaseTrack
from drop_physics.account.subjects import MeasuredBody, subject_of
from drop_physics.account.terms import (
    Impulses,
    contact_impulses,
    impulses_by_term,
    servos_of,
)
from drop_physics.account.touches import TouchTable
from drop_physics.account.touching import touching_rows
from drop_physics.account.transmitted import transmission_rows
from drop_physics.account.twins import weaker_rows
from drop_physics.account.words import RowWords
from drop_physics.account.written import WrittenStates, energy_row
from drop_physics.arrays import Float64
from drop_physics.explain.actuators import ActuatorTable
from drop_physics.explain.causes import Totals
from drop_physics.explain.contact_points import Points
from drop_physics.explain.driving import control_of
from drop_physics.explain.joints import JointTelemetry
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.explain.steps import BodySteps
from drop_physics.explain.times import StepTimes
from drop_physics.messages import Message
from drop_physics.trace.acts import MAKES
from drop_physics.trace.events import Actuator, Body
from drop_physics.trace.history import Seen
from drop_physics.trace.log import Log


class Account:
    """Collects a recording chunk by chunk, and lists its requests and results as rows.

    Parameters
    ----------
    seen
        The recorded data of the run.
    times
        Times of steps by client.
    joints, touches, actuators
        The tables of joints, touching pairs and actuators; the caller fills them with the same
        chunks.
    """

    def __init__(
        self,
        seen: Seen,
        times: Mapping[int, StepTimes],
        joints: JointTable,
        touches: TouchTable,
        actuators: ActuatorTable,
    ) -> None:
        freedoms = sum(body.freedoms for body in seen.bodies.values() if not body.soft)
        self._seen, self._bins = seen, bins_for(freedoms)
        self._joints, self._touches, self._actuators = joints, touches, actuators
        self._words = RowWords(Names(seen.bodies, seen.dynamics), times)
        self._servos = {number: servos_of(body) for number, body in seen.bodies.items()}
        self._ledgers: dict[int, Ledger] = {}
        self._controls: dict[int, list[Float64]] = {}
        """The controls of a body's actuators, shape (n, actuators) for each chunk."""
        self._tracks: dict[int, BaseTrack] = {}
        self._written: dict[int, WrittenStates] = {}
        self._carried: dict[int, Carried] = {}
        self._gravity: dict[int, Float64] = {}
        """The strongest gravity that acted on each body, shape (3,)."""
        self._broken: dict[int, int] = {}
        """The first sample of each body with a nan or infinite state."""
        self._held, self._overlaps = Held(seen, times), Overlaps(seen)
        self._sensed, self._pushed, self._static = Sensed(seen), PushedSoft(), MadeStatic()
        self._settings = IdleSettings(seen)
        self._filtered: dict[frozenset[int], str] = {}
        """The script line that may have disabled contacts of two bodies, or of one, by body ids."""
        self._ignored: dict[tuple[int, int], tuple[float, str]] = {}
        """The last position given to a motor for rates, and the script line, by body id and link.
        """
        self._made: dict[tuple[int, int], set[str]] = {}
        """The script lines that created bodies, by client and the engine's id."""

    def see(
        self,
        explained: ExplainedPiece,
        joints: Mapping[int, Sequence[JointTelemetry]],
        points: Points,
    ) -> None:
        """Add a chunk of explained steps, with its joints (by body id) and contact points."""
        contacts = dict[BodySteps, Impulses]()
        for batch, _ in explained.batches:
            contacts |= contact_impulses(batch)
        for number, judged in explained.bodies.items():
            for steps in judged.intervals:
                if len(steps) and steps.law.tree.size:
                    self._add(number, steps, contacts.get(steps, {}), points)
        for found in joints.values():
            for driven in found:
                self._add_controls(driven.body, explained, driven.steps)
        for call, bodies in explained.piece.calls.filters():
            self._filtered[frozenset(bodies)] = call.site.place
        for call in explained.piece.calls.of(*MAKES):
            if np.isfinite(call.result):
                made = self._made.setdefault((call.client, int(call.result)), set())
                made.add(call.site.place)
        self._note_ignored(explained.piece.calls)
        self._sensed.add(explained, points)
        self._held.add(explained, points)
        self._overlaps.add(explained)
        self._pushed.add(explained)
        self._static.add(explained)
        self._settings.add(explained)

    def _note_ignored(self, calls: Log) -> None:
        for command in calls.commands():
            targets = command.ignored_targets
            if targets is None:
                continue
            rows = np.flatnonzero(~np.isnan(targets))
            joints = zip(command.bodies[rows].tolist(), command.joints[rows].tolist(), strict=True)
            last = dict(zip(joints, rows.tolist(), strict=True))
            for (engine_id, link), row in last.items():
                came, (which,) = calls.bodies_at(command.client, engine_id, command.calls[[row]])
                if which >= 0:
                    key = came[which].body.number, link
                    self._ignored[key] = float(targets[row]), command.site.place

    def rows(self, totals: Mapping[int, Totals]) -> list[AccountRow]:
        """Return all rows, unsorted; `totals` are the explanation's totals by body."""
        subjects = {
            number: subject_of(self._seen.bodies[number], ledger, self._gravity[number])
            for number, ledger in self._ledgers.items()
        }
        with np.errstate(all="ignore"):  # of states that are no numbers
            return [*map(self._placed, self._rows(subjects, totals))]

    def ranked(self, rows: Iterable[AccountRow], about: str | None = None) -> list[AccountRow]:
        """Sort rows by salience, but rows about the body or joint named `about` come first."""
        read = {
            target.body
            for reading in self._seen.readings
            if reading.complete
            for target in reading.targets
        }
        return ranked(rows, read if len(read) < len(self._ledgers) else set(), about)

    def _placed(self, row: AccountRow) -> AccountRow:
        """Return a row completed by the label of its body and the time of its step."""
        body = row.subject
        if body is None:
            return row
        time_s = None if row.step is None else self._words.seconds(body, row.step)
        return replace(row, body=body.label, time_s=time_s)

    def _rows(
        self, subjects: Mapping[int, MeasuredBody], totals: Mapping[int, Totals]
    ) -> Iterator[AccountRow]:
        words = self._words
        for number, subject in subjects.items():
            if number in self._broken:
                yield _not_finite(subject, self._broken[number], words)
            yield from self._joint_rows(subject)
            yield from engine_reset_rows(subject, self._seen, words)
            if number in self._tracks:
                yield from moved.base_rows(
                    subject,
                    self._tracks[number],
                    self._gravity[number],
                    self._written[number],
                    opposed(subject, self._joints.series(number), words),
                    words,
                    w_first=self._seen.w_first,
                )
            total = totals.get(number)
            if total is not None and total.covered:
                row = energy_row(subject, total.energy_j, total.start_j, total.end_j, words)
                if row is not None:
                    yield row
            written = self._written[number]
            idle = unforced_row(subject, self._seen, self._gravity[number])
            yield from filter(None, (written.row(subject, subjects, words), idle))
            yield from self._carrying(subject)
        links = self._touches.links
        across = {
            number: efforts.reactions
            for number in subjects
            if (efforts := self._joints.efforts(number)) is not None
            and efforts.reactions is not None
        }
        yield from reading_rows(self._seen, subjects, links, self._filtered, across, words)
        yield from self._sensed.rows(self._seen, subjects, links, words)
        yield from array_use_rows(self._seen)
        yield from self._pushed.rows()
        yield from self._static.rows()
        if self._seen.windows:  # what touched, and held, is known of some steps only
            return
        yield from self._settings.rows(links, words)
        yield from self._held.rows(subjects, words)
        yield from touching_rows(links, subjects, self._seen, words)
        yield from self._overlaps.rows(subjects, links, words)

    def _carrying(self, subject: MeasuredBody) -> Iterator[AccountRow]:
        """Yield the rows for the loads on a fixed base and on joints."""
        body, row = subject.body, None
        if body.number in self._carried:
            lines = self._made.get((body.client, body.engine_id), set())
            line = next(iter(lines)) if len(lines) == 1 else None
            row = self._carried[body.number].row(subject, self._gravity[body.number], line)
            yield from filter(None, (row,))
        efforts = self._joints.efforts(body.number)
        if efforts is not None and efforts.reactions is not None:
            yield from across_joints(subject, efforts.reactions, of_base=row is not None)

    def _joint_rows(self, subject: MeasuredBody) -> Iterator[AccountRow]:
        number, words = subject.body.number, self._words
        series, rates = self._joints.series(number), subject.tree.joint_rates
        if series is None or series.after.shape[1] != rates:
            return
        if len(subject.body.joints) != subject.tree.links:
            return
        controls = self._controls_of(subject.body, len(series))
        yield from asked.clamped_rows(subject, controls, series.steps)
        yield from idle_actuator_rows(subject, self._seen, controls)
        yield from held_controls_rows(subject, series, controls)
        of_body = self._actuators.rows(subject.body, self._seen)
        yield from transmission_rows(subject, self._seen, of_body)
        given = GivenControls(subject, series, controls, words)
        yield from given.rows
        for k, aim in given.aims.items():
            series.target[:, k] = aim.target
        efforts = self._joints.efforts(number)
        torqued = series.controlled("torque")
        axes = [*asked.axes_of(subject, words)]
        yield from weaker_rows(subject, axes, series)
        for axis in axes:
            k = axis.joint_rate
            motors = {
                actuator: given
                for actuator, given in controls.items()
                if actuator.acts_on == "joint"
                and actuator.target == axis.joint.name
                and actuator.kind in ("motor", "general", "muscle")
            }
            rate = series.asked_rate[:, k]
            turns = np.isfinite(rate)
            row: AccountRow | None
            ignored = self._ignored.get((number, axis.joint.link))
            if np.isfinite(series.target[:, k]).mean() > asked.SELDOM:
                needs = None if efforts is None else efforts.at_target(k)
                row = asked.position_row(subject, axis, series, words, needs, given.stiffness(k))
            elif ignored is not None:
                row = asked.ignored_row(subject, axis, series, words, *ignored)
            elif turns.mean() > asked.SELDOM and np.abs(rate[turns]).max(initial=0.0) > 0:
                row = asked.rate_row(subject, axis, series, words)
            elif motors or torqued[:, k].mean() > asked.SELDOM:
                row = asked.torque_row(subject, axis, series, words, motors)
            else:
                coupled = coupling(axis, subject, self._seen)
                row = moved.joint_row(subject, axis, series, coupled, words)
            if row is not None:
                yield row

    def _add(self, number: int, steps: BodySteps, contacts: Impulses, points: Points) -> None:
        tree, first = steps.law.tree, int(steps.steps[0])
        ledger = self._ledgers.get(number)
        if ledger is None or ledger.tree.size != tree.size:
            ledger = self._ledgers[number] = Ledger(tree, first, self._bins)
        ledger.tree, ledger.last = tree, int(steps.steps[-1])
        if steps.covered:
            ledger.add(steps, impulses_by_term(steps, contacts, self._servos[number]))
            if tree.fixed:
                self._carried.setdefault(number, Carried()).add(steps)
        is_loaded_again = self._written.setdefault(number, WrittenStates()).add(steps, points)
        pull = steps.reported.gravity_m_s2
        strongest = pull[int(np.argmax(np.linalg.norm(pull, axis=1)))].copy()
        known = self._gravity.get(number)
        if known is None or np.linalg.norm(strongest) > np.linalg.norm(known):
            self._gravity[number] = strongest
        finite = np.isfinite(steps.after.velocity).all(axis=1)
        finite &= np.isfinite(steps.after.position_m).all(axis=1)
        if not finite.all():
            self._broken.setdefault(number, int(steps.steps[int(np.argmin(finite))]))
        if not tree.fixed:
            before = steps.before
            track = self._tracks.get(number)
            if track is None or is_loaded_again:
                track = self._tracks[number] = BaseTrack(
                    before.position_m[0].copy(),
                    before.orientation[0].copy(),
                    before.position_m[0].copy(),
                    int(steps.steps[0]),
                    before.velocity[0, :3].copy(),
                )
            track.add(steps.steps, before, steps.after)

    def _add_controls(self, body: Body, explained: ExplainedPiece, steps: BodySteps) -> None:
        if body.actuators:
            given = [
                control_of(each, body, explained.piece, steps.steps) for each in body.actuators
            ]
            self._controls.setdefault(body.number, []).append(np.stack(given, axis=1))

    def _controls_of(self, body: Body, steps: int) -> dict[Actuator, Float64]:
        parts = self._controls.get(body.number, [])
        if not parts or sum(map(len, parts)) != steps:
            return {}
        given = np.concatenate(parts)
        return {each: given[:, k] for k, each in enumerate(body.actuators)}


def _not_finite(subject: MeasuredBody, step: int, words: RowWords) -> AccountRow:
    """Return the row for a body whose state has become nan or infinite."""
    return AccountRow(
        kind="moved",
        told=Message(
            "its state is no number from step {step:,} on ({time})",
            step=step,
            time=words.time(subject, step),
        ),
        step=step,
        salience=1e3,
        subject=subject.body,
        group=("not finite",),
    )
