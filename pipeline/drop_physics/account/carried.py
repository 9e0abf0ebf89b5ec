"""The support of a fixed-base body: the base itself, or the bodies below it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from drop_physics.account.rows import AccountRow
from drop_physics.account.subjects import MeasuredBody
from drop_physics.arrays import Float64
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics
from drop_physics.physics.moving import moved
from drop_physics.physics.tree import States, Tree
from drop_physics.quantities import quantity

INSTANT_S = 1e-6
"""Time over which the displacement of the centres of mass gives their velocities."""
SETTLED = 0.1
"""Share of the weight below which the change of momentum must be for a mean force to be
meaningful."""
ROUNDED = 1e-9
"""Share of the weight below which a contact force is rounding error."""
OUTSIDE = {"applied", "constraints", "gravity compensation", "fluid", "remainder", "contacts"}
"""Causes that act on a body from outside, other than gravity and contacts with a known force."""
FREE = ("site", "body")
"""Targets of actuators whose forces do not act between two links."""


@dataclass(eq=False)
class Carried:
    """Impulses of contacts on a body with a fixed base; grows chunk by chunk."""

    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    """Impulse of all contacts, world axes [N s]."""
    first_n_s: Float64 | None = None
    """The momentum before the first step."""
    last_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    """The momentum after the last one."""
    put: bool = False
    """Whether the script wrote the state in between, which changes the momentum without a force."""

    def add(self, steps: BodySteps) -> None:
        """Add explained steps of the body."""
        contacts, tree = steps.reported.contacts, steps.law.tree
        if self.first_n_s is None:
            self.first_n_s = momentum_n_s(tree, steps.before.at(np.array([0])))
            self.put |= bool(steps.put[1:].any())
        else:
            self.put |= bool(steps.put.any())
        self.last_n_s = momentum_n_s(tree, steps.after.at(np.array([len(steps) - 1])))
        if len(contacts):
            timestep_s = steps.reported.timestep_s[contacts.step]
            self.impulse_n_s += (contacts.force_n * timestep_s[:, None]).sum(axis=0)

    def row(
        self, subject: MeasuredBody, gravity_m_s2: Float64, line: str | None
    ) -> AccountRow | None:
        """Return the row for the load on the base; None if it is unknown.

        `line` is that of the call which made the body, None where it is not known.
        The mean force of the base is the change of momentum without gravity's and contacts'; where
        other forces act from outside, or that change counts, there is no row.
        """
        body, ledger = subject.body, subject.ledger
        seconds = float(ledger.seconds.sum())
        causes = {term.cause for term in ledger.impulse}
        outside = causes & OUTSIDE or any(actuator.acts_on in FREE for actuator in body.actuators)
        pull = float(np.linalg.norm(gravity_m_s2))
        all_steps = slice(0, (ledger.last - ledger.first) // ledger.width + 1)
        if outside or self.put or self.first_n_s is None or not ledger.covers(all_steps):
            return None
        if body.links[0] == "world" or not pull:
            return None
        weight_n, up = subject.mass_kg * pull, -gravity_m_s2 / pull
        taken_n = float((self.last_n_s - self.first_n_s) @ up) / seconds
        if not abs(taken_n) < SETTLED * weight_n:
            return None
        rest_n = float(self.impulse_n_s @ up) / seconds
        base_n = weight_n + taken_n - rest_n
        return AccountRow(
            kind="held",
            told=self._told(base_n, weight_n, rest_n, line),
            asked=weight_n,
            got=base_n,
            unit="N",
            step=ledger.last,
            salience=0.03,
            subject=body,
            group=("carried", subject.kind),
        )

    def _told(self, base_n: float, weight_n: float, rest_n: float, line: str | None) -> Message:
        told = Message("its base is fixed")
        if line is not None:
            told = told + Message(" since {line}", line=line)
        told = told + Message(
            " and carries {base}; what moves of it weighs {weight}",
            base=quantity(base_n, "N"),
            weight=quantity(weight_n, "N"),
        )
        if abs(rest_n) <= ROUNDED * weight_n:
            return told + Message(", and no contact lifts it")
        push = Message("lift") if rest_n > 0 else Message("press")
        rest = quantity(abs(rest_n), "N")
        return told + Message(", and contacts {push} it with {rest}", push=push, rest=rest)


def momentum_n_s(tree: Tree, state: States) -> Float64:
    """Return the momentum of a tree in a single state, shape (3,)."""
    there = moved(tree, state, state.velocity, np.array([INSTANT_S]), np.inf)
    ways_m = [
        tree.masses_kg[link + 1] * (end.position_m(link) - begin.position_m(link))[0]
        for begin, end in [(kinematics(tree, state), kinematics(tree, there))]
        for link in range(tree.links)
    ]
    return np.asarray(sum(ways_m, start=np.zeros(3)) / INSTANT_S)
