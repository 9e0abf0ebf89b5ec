"""The force balance of a joint off its position target: the drive, and what opposes it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.account.ledger import OWN
from drop_physics.account.series import JointSeries
from drop_physics.account.terms import CONTACT, DRAG, FRICTION, Term
from drop_physics.arrays import Float64
from drop_physics.explain.joints import REST_STEPS
from drop_physics.explain.targets import SETTLED, SETTLED_STEPS

DRIVE, CONTACTS = "drive", "contacts"
"""Keys in a balance: the sum of forces from the joint's command, and the sum of all contact
forces."""


@dataclass(frozen=True)
class JointBalance:
    """A joint off its position target; forces [N] or [N m] act towards the target if positive."""

    joint_rate: int
    """Index of the joint's rate among the rates of all joints."""
    goal: float
    gap: float
    """Position minus target [rad] or [m]."""
    ends: bool
    """Whether the balance is that of the last step with a target."""
    rests: bool
    """Whether the joint is at rest, or nearly so."""
    at_limit: bool
    limited: float
    """Share of the steps of the target in which the drive is at its limit."""
    limit: float
    needs: float | None
    """The force or torque required to hold the last target [N] or [N m]; None if unknown."""
    forces: Mapping[str, float]
    """The mean forces by cause [N] or [N m]; empty if steps are not explained."""
    fixed: bool
    """Whether the base of the body is fixed."""
    holder: int | None
    """Id of the body whose contacts oppose most; None if no contact does."""
    held: float
    """The force of these contacts [N] or [N m]."""

    def force(self, cause: str) -> float:
        """Return the force of a cause, 0 if there is none."""
        return self.forces.get(cause, 0.0)

    @property
    def too_weak(self) -> bool:
        """Whether holding the target is known to require more than the drive's limit."""
        return self.needs is not None and abs(self.needs) > self.limit

    @property
    def left(self) -> float:
        """The sum of all forces, which accelerates the joint [N] or [N m]."""
        return sum(self.forces.values())


def forces_by_cause(forces: Mapping[Term, float], drives: Mapping[Term, bool]) -> dict[str, float]:
    """Sum forces by cause, without inertia; `drives` flags the terms from the joint's command."""
    found = defaultdict[str, float](float)
    for term, force in forces.items():
        if term != OWN and term.cause != DRAG:
            touches = term.cause in (CONTACT, FRICTION)
            found[DRIVE if drives[term] else CONTACTS if touches else term.cause] += force
    return dict(found)


def holder_of(forces: Mapping[Term, float]) -> tuple[int | None, float]:
    """Return the body whose contacts act most against the target, by id, and their force."""
    found = defaultdict[int | None, float](float)
    for term, force in forces.items():
        if term.cause in (CONTACT, FRICTION):
            found[term.other] += force
    holder = min(found, key=lambda other: found[other], default=None)
    return (holder, found[holder]) if found and found[holder] < 0 else (None, 0.0)


def since_target(series: JointSeries, joint_rate: int, row: int) -> int:
    """Return the row in which the target that is in effect in a given row was set."""
    target = series.target[: row + 1, joint_rate]
    changes = np.flatnonzero(target[1:] != target[:-1])
    return int(changes[-1]) + 1 if len(changes) else 0


def is_at_rest(series: JointSeries, joint_rate: int, since: int, row: int) -> bool:
    """Return whether a joint is nearly at rest in a row; `since` is the row that set its target."""
    stood = row - since + 1
    if stood > REST_STEPS and series.resting[row, joint_rate]:
        return True
    path: Float64 = series.after[max(row + 1 - SETTLED_STEPS, 0) : row + 1, joint_rate]
    return stood > SETTLED_STEPS and bool(np.ptp(path) < SETTLED)
