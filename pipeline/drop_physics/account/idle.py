"""Rows for pushes on soft bodies without effect, and for bodies and actuators without a force."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from drop_physics.account.rows import AccountRow, magnitude
from drop_physics.account.subjects import MeasuredBody
from drop_physics.account.terms import Term
from drop_physics.account.touches import PairKey, TouchedLinks
from drop_physics.account.words import RowWords
from drop_physics.arrays import Float64
from drop_physics.explain.driving import strongest
from drop_physics.explain.recording import ExplainedPiece
from drop_physics.messages import Message, joined
from drop_physics.quantities import number as number_of
from drop_physics.quantities import quantity
from drop_physics.trace.acts import Act
from drop_physics.trace.calls import Call, Push
from drop_physics.trace.events import Actuator, Body, order
from drop_physics.trace.history import Seen
from drop_physics.trace.properties import link_reached
from drop_physics.trace.states import BASE
from drop_physics.trace.switches import NO_ACTUATION, NO_GRAVITY, is_off

NO_FORCES = ("bias", "integrator", "remainder")
"""Causes of a sum that are not forces."""
CONTACT_PROPERTIES = {
    *("lateralFriction", "rollingFriction", "spinningFriction"),
    *("restitution", "contactStiffness"),
}
"""Properties of links, as calls name them, that matter only where the link touches another."""
SLOW = 0.01
"""A body that moves by less than this share of its size per second counts as standing still."""


class PushedSoft:
    """Forces that calls applied to soft bodies, which PyBullet ignores; filled chunk by chunk."""

    def __init__(self) -> None:
        self._most: dict[int, tuple[Push, int]] = {}
        """The strongest push on each body, and the number of pushes, by body id."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
        for push in explained.piece.calls.pushes():
            if push.body.soft:
                most, calls = self._most.get(push.body.number, (push, 0))
                stronger = np.linalg.norm(push.vector) > np.linalg.norm(most.vector)
                self._most[push.body.number] = push if stronger else most, calls + 1

    def rows(self) -> Iterator[AccountRow]:
        """Yield a row for each soft body on which applied forces have no effect."""
        for push, calls in self._most.values():
            unit = "N m" if push.torque else "N"
            most = float(np.linalg.norm(push.vector))
            yield AccountRow(
                kind="idle",
                told=Message(
                    "pushed with up to {force} in {calls:,} calls; it is soft, and no such force "
                    "acts on what is soft",
                    force=quantity(most, unit),
                    calls=calls,
                ),
                asked=most,
                got=0.0,
                gap=-most,
                unit=unit,
                step=push.at.step,
                salience=0.8,
                subject=push.body,
            )


class MadeStatic:
    """Bodies without joints whose mass a call set to 0; filled chunk by chunk."""

    def __init__(self) -> None:
        self._since: dict[int, tuple[Call, Body]] = {}
        """The call and the body, by body id."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
        for call, _, came in explained.piece.calls.of_bodies(Act.SET_PROPERTY):
            body, mass = came.body, call.values.get("mass")
            if mass is None or body.joints or link_reached(call.values) != BASE:
                continue
            if mass[0] == 0:
                self._since[body.number] = call, body
            else:
                self._since.pop(body.number, None)

    def rows(self) -> Iterator[AccountRow]:
        """Yield a row for each body that is static since a call."""
        for call, body in self._since.values():
            yield AccountRow(
                kind="idle",
                told=Message(
                    "its mass is 0 since {line}: it is static, and no force moves it",
                    line=call.site.place,
                ),
                asked=0.0,
                got=0.0,
                unit="kg",
                step=call.at.step,
                salience=0.6,
                subject=body,
                group=("static", call.site.place),
            )


class IdleSettings:
    """Contact properties that calls set for links; filled chunk by chunk."""

    def __init__(self, seen: Seen) -> None:
        self._seen = seen
        self._set: dict[tuple[int, str], dict[int, Call]] = {}
        """The last call for each link, by body id and property."""

    def add(self, explained: ExplainedPiece) -> None:
        """Add a chunk of explained steps."""
        for call, _, came in explained.piece.calls.of_bodies(Act.SET_PROPERTY):
            for name in CONTACT_PROPERTIES & call.values.keys():
                links = self._set.setdefault((came.body.number, name), {})
                links[link_reached(call.values)] = call

    def rows(self, pairs: Mapping[PairKey, TouchedLinks], words: RowWords) -> Iterator[AccountRow]:
        """Yield a row for each property that is set only for links of a body that touch nothing."""
        touching: dict[int, set[int]] = {}
        for (one, other, *links), touched in pairs.items():
            for number, link in zip((one, other), links, strict=True):
                if touched.steps:
                    touching.setdefault(number, set()).add(link)
        for (number, name), calls in self._set.items():
            touches = touching.get(number, set())
            if not touches or touches & calls.keys():
                continue
            link, call = max(calls.items(), key=lambda each: order(each[1].at))
            value = call.values[name][0]
            others = [words.names.link(number, each) for each in sorted(touches)]
            yield AccountRow(
                kind="idle",
                link=words.names.link(number, link),
                told=Message(
                    "{line} sets {name}={value} for {it}, which touches nothing; what touches is "
                    "{others}, for which no call sets it",
                    it=Message("the base") if link == BASE else Message("this link"),
                    name=name,
                    value=number_of(value),
                    line=call.site.place,
                    others=joined(", ", others),
                ),
                asked=value,
                unit="",
                step=call.at.step,
                salience=0.9,
                subject=self._seen.bodies[number],
            )


def unforced_row(subject: MeasuredBody, seen: Seen, gravity_m_s2: Float64) -> AccountRow | None:
    """Return the row for a free body on which no force acts, ever or at the end, else None.

    The end is the last tenth of its steps; a body that stands still there has no such row.
    """
    ledger, client = subject.ledger, subject.body.client
    whole = ledger.window(ledger.first, ledger.last)
    tenth = max(1, int(np.count_nonzero(ledger.counts)) // 10) * ledger.width
    late = ledger.window(ledger.last - tenth, ledger.last)
    if subject.tree.fixed or not ledger.covers(late) or _acts(ledger.impulse, late, 6):
        return None
    never = ledger.covers(whole) and not _acts(ledger.impulse, whole, subject.tree.size)
    way_m = ledger.way[late, 3:6].sum(axis=0)
    speed = float(np.linalg.norm(way_m)) / float(ledger.seconds[late].sum())
    if never:
        told = Message(
            "no force acts on it in any of {steps:,} steps; gravity is {gravity} m/s²",
            steps=int(ledger.counts.sum()),
            gravity=number_of(float(np.linalg.norm(gravity_m_s2))),
        )
        if is_off(seen, client, NO_GRAVITY):
            told = told + Message(", which a flag of the model switches off")
    elif speed < SLOW * subject.size_m:
        return None
    else:
        told = Message(
            "no force acts on it in the last steps, and it goes on at {speed}",
            speed=quantity(speed, "m/s"),
        )
        told = told + _damping_of_base(subject.body, seen)
    return AccountRow(
        kind="idle",
        told=told,
        got=None if never else speed,
        unit=None if never else "m/s",
        step=ledger.last,
        salience=0.7 if never else 0.6,
        subject=subject.body,
        group=("unforced", never, subject.kind, magnitude(speed)),
    )


def _acts(impulses: Mapping[Term, Float64], window: slice, rates: int) -> bool:
    """Return whether a force acts on any of a body's first `rates` rates in a window of steps."""
    forces = (each for term, each in impulses.items() if term.cause not in NO_FORCES)
    return any(each[window, :rates].any() for each in forces)


def _damping_of_base(body: Body, seen: Seen) -> Message:
    """Return the damping of a free joint, if the engine reports it."""
    reported = [each.reported for each in seen.dynamics if each.body.number == body.number]
    damping = reported[-1].get("base_damping") if reported else None
    if damping is None or not np.isfinite(damping[0]):
        return Message("")
    return Message(
        "; the damping of its free joint is {damping}", damping=number_of(float(damping[0]))
    )


def idle_actuator_rows(
    subject: MeasuredBody, seen: Seen, controls: Mapping[Actuator, Float64]
) -> Iterator[AccountRow]:
    """Yield a row for each actuator that was commanded but never exerted a force.

    A servo that stays at its target exerts no force, so it has no row.
    """
    for actuator, given in controls.items():
        if actuator.kind == "position" or not np.isfinite(given).any():
            continue
        most = strongest(given)
        acts = any(
            term.cause == f"actuator {actuator.name}" or term.name == actuator.name
            for term in subject.ledger.impulse
        )
        if most and not acts and subject.ledger.counts.any():
            told = Message(
                "ctrl up to {given}, and it gives no force in any step; it acts on {target}",
                given=number_of(most),
                target=actuator.target,
            )
            if is_off(seen, subject.body.client, NO_ACTUATION):
                told = told + Message("; a flag of the model switches actuators off")
            yield AccountRow(
                kind="idle",
                actuator=actuator.name,
                told=told,
                asked=most,
                got=0.0,
                salience=0.8,
                subject=subject.body,
                group=("idle actuator", subject.kind),
            )
