"""Who carries the weight of a body whose base is fixed: the base, or what it stands on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from drop_physics.account.ledger import Ledger
from drop_physics.account.rows import Row
from drop_physics.account.subjects import Subject
from drop_physics.account.words import Words
from drop_physics.arrays import Float64, Int64
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.quantities import quantity

SETTLED = 0.1
"""Share of the weight below which what takes up momentum has to be for a mean to tell anything."""
OUTSIDE = {"applied", "constraints", "gravity compensation", "fluid", "remainder", "contacts"}
"""Causes that act on a body from outside, besides gravity and contacts with a known force."""
FREE = ("site", "body")
"""What actuators act on whose forces are not between two links."""


@dataclass(eq=False)
class Carried:
    """What contacts gave a body with a fixed base; grows piece by piece."""

    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    """Of all contacts, world axes."""

    def add(self, steps: BodySteps) -> None:
        """Add explained steps of the body."""
        contacts = steps.reported.contacts
        if len(contacts):
            timestep_s = steps.reported.timestep_s[contacts.step]
            self.impulse_n_s += (contacts.force_n * timestep_s[:, None]).sum(axis=0)

    def row(self, subject: Subject, gravity_m_s2: Float64, words: Words) -> Row | None:
        """Return the row of what the base carries; None where it is not known.

        The mean force of the base is the change of momentum without gravity's and contacts'; where
        other forces act from outside, or that change counts, there is no row.
        """
        body, ledger = subject.body, subject.ledger
        seconds = float(ledger.seconds.sum())
        causes = {term.cause for term in ledger.impulse}
        outside = causes & OUTSIDE or any(each.acts_on in FREE for each in body.actuators)
        pull = float(np.linalg.norm(gravity_m_s2))
        all_steps = slice(0, (ledger.last - ledger.first) // ledger.width + 1)
        if outside or body.links[0] == "world" or not pull or not ledger.covers(all_steps):
            return None
        weight_n, up = subject.mass_kg * pull, -gravity_m_s2 / pull
        taken_n = float(_gained_n_s(subject) @ up) / seconds
        if not abs(taken_n) < SETTLED * weight_n:
            return None
        rest_n = float(self.impulse_n_s @ up) / seconds
        base_n = weight_n + taken_n - rest_n
        return Row(
            kind="held",
            body=body.label,
            told=Message(
                "its base is fixed and carries {base} of its weight of {weight}; contacts carry "
                "{rest}",
                base=quantity(base_n, "N"),
                weight=quantity(weight_n, "N"),
                rest=quantity(rest_n, "N"),
            ),
            asked=weight_n,
            got=base_n,
            unit="N",
            step=ledger.last,
            time_s=words.seconds(subject, ledger.last),
            salience=0.12,
            subject=body,
            group=("carried", subject.kind),
        )


def _gained_n_s(subject: Subject) -> Float64:
    """Return the change of a body's momentum from its first explained step to its last, (3,)."""
    ledger = subject.ledger
    known = np.flatnonzero(ledger.counts)
    first, last = (_velocity_m_s(ledger, known[part]) for part in (slice(0, 2), slice(-2, None)))
    return np.asarray(subject.mass_kg * (last - first))


def _velocity_m_s(ledger: Ledger, bins: Int64) -> Float64:
    """Return the velocity of the centre of mass between the ends of two bins, shape (3,)."""
    if len(bins) < 2:
        return np.full(3, np.nan)
    kin, masses = kinematics(ledger.tree, ledger.ends.at(bins)), ledger.tree.masses_kg[1:]
    places = np.stack([kin.position_m(link) for link in range(ledger.tree.links)])
    centre = np.tensordot(masses, places, 1) / masses.sum()
    return np.asarray((centre[1] - centre[0]) / ledger.seconds[bins[1]])
