"""Rows for the supports of a body: the load on a fixed base and on each joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from drop_physics.account.read import mass_beyond_kg
from drop_physics.account.rows import AccountRow, magnitude
from drop_physics.account.subjects import MeasuredBody
from drop_physics.arrays import Float64
from drop_physics.explain.steps import BodySteps
from drop_physics.messages import Message
from drop_physics.physics.kinematics import kinematics, motion
from drop_physics.physics.reactions import Reactions
from drop_physics.physics.tree import BASE, States, Tree
from drop_physics.quantities import quantity

LEAST = 0.03
"""Salience of rows about supports: they have no gap, so the value is constant."""
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
    """Contact impulses on a fixed-base body, with its first and last momentum."""

    impulse_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    """Impulse of all contacts in world axes, shape (3,) [N s]."""
    first_n_s: Float64 | None = None
    """The linear momentum before the first step, shape (3,)."""
    last_n_s: Float64 = field(default_factory=lambda: np.zeros(3))
    """The linear momentum after the last step, shape (3,)."""
    put: bool = False
    """Whether the script wrote the state between two steps, which changes the momentum without a
    force."""

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
        """Return the row for the force on the fixed base; None if the force is unknown.

        `line` is the script line of the call that created the body; None if unknown. The mean force
        of the base is the mean change of momentum minus the forces of gravity and contacts. There
        is no row if other external forces act, or if the momentum changes noticeably.
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
            salience=LEAST,
            subject=body,
            group=("carried", subject.kind, rest_n > 0, magnitude(rest_n / weight_n)),
        )

    def _told(self, base_n: float, weight_n: float, rest_n: float, line: str | None) -> Message:
        told = Message("its base is fixed")
        if line is not None:
            told = told + Message(" since {line}", line=line)
        told = told + Message(
            " and carries {base} on average; what moves of it weighs {weight}",
            base=quantity(base_n, "N"),
            weight=quantity(weight_n, "N"),
        )
        if abs(rest_n) <= ROUNDED * weight_n:
            return told + Message(", and no contact lifts it")
        push = Message("lift") if rest_n > 0 else Message("press")
        rest = quantity(abs(rest_n), "N")
        return told + Message(", and contacts {push} it with {rest}", push=push, rest=rest)


def momentum_n_s(tree: Tree, state: States) -> Float64:
    """Return the linear momentum of a tree in one state, shape (3,)."""
    velocities = motion(kinematics(tree, state), state.velocity).velocities
    return np.asarray(
        sum(tree.masses_kg[link + 1] * velocities[link + 1][:, 0] for link in tree.moving)
        if tree.moving
        else np.zeros(3)
    )


def across_joints(
    subject: MeasuredBody, across: Reactions, *, of_base: bool
) -> Iterator[AccountRow]:
    """Yield a row for each joint with the force that it transmits in the last step.

    With `of_base`, a row of the base already reports the load, so joints on the base have no row.
    """
    body, ledger = subject.body, subject.ledger
    sizes_n = np.linalg.norm(across.force_n, axis=1)
    joints = [
        joint
        for joint, place in zip(body.joints, body.rates, strict=True)
        if place.start < place.stop
        and np.isfinite(sizes_n[joint.link])
        and not (of_base and joint.parent == BASE)
    ]
    # The row of the largest force stands for the others.
    others = Message("; no other joint transmits more") if len(joints) > 1 else Message("")
    for joint in joints:
        force_n = float(sizes_n[joint.link])
        weight_n = mass_beyond_kg(subject, {joint.link}) * subject.pull_m_s2
        torque_n_m = float(np.linalg.norm(across.torque_n_m[joint.link]))
        turns = torque_n_m > ROUNDED * force_n * subject.size_m
        yield AccountRow(
            kind="held",
            joint=joint.name,
            told=Message("transmits {force}", force=quantity(force_n, "N"))
            + (Message(" and {torque}", torque=quantity(torque_n_m, "N m")) if turns else "")
            + Message(
                " at the end; the links beyond it weigh {weight}", weight=quantity(weight_n, "N")
            )
            + (others if force_n == sizes_n[[each.link for each in joints]].max() else ""),
            asked=weight_n,
            got=force_n,
            unit="N",
            besides=((torque_n_m, "N m"),),
            step=ledger.last,
            salience=LEAST * force_n / (float(sizes_n.max()) or 1.0),
            subject=body,
            group=("carries", body.number),
        )
