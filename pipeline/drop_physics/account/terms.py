"""Divides the impulses on a body by partner: the links in contact, the parts of a servo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drop_physics.arrays import Float64
from drop_physics.explain.steps import BodySteps, StepBatch
from drop_physics.physics.vectors import distinct_rows, largest, summed
from drop_physics.trace.events import Body

CONTACT, FRICTION, DRAG, GIVEN, GAP, RATE = "contact", "friction", "drag", "given", "gap", "rate"
"""Causes into which the terms of a step's sum are split: the normal and the tangential
force of a contact; the inertia that couples a rate to the acceleration of another one;
the torque of a call; the two components of a position servo, its stiffness times the gap
and its damping times the rate."""
HELD = "constraints"
"""The cause for the forces of constraints and equalities, by name where these are known
separately."""
ROUNDED = 1e-9
"""A component of a term below this share of the term is rounding."""
SINGLE = 1e-6
"""The same threshold for contact forces, which an engine may report in single precision."""
MOST_PARTNERS = 24
"""Maximum number of link pairs whose contacts are kept apart in one chunk; all weaker ones are
summed."""


@dataclass(frozen=True)
class Term:
    """A cause of impulses on a body, with the partner that exerts it, if any."""

    cause: str
    """A cause in the sum, or one of the components above."""
    name: str = ""
    """Name of the actuator, for components of its force."""
    link: int | None = None
    """The body's own link, for a contact."""
    other: int | None = None
    """Id of the other body, for a contact."""
    other_link: int | None = None
    rate: int | None = None
    """Index, in the generalised velocity, of the rate whose acceleration drags."""


Impulses = dict[Term, Float64]
"""Generalised impulses by term [N s, N m s], shape (n, size) each."""


def impulses_by_term(
    steps: BodySteps, contacts: Impulses, servos: Mapping[str, tuple[int, float]]
) -> Impulses:
    """Return impulses by term: contacts by partner, servos by stiffness and damping.

    `contacts` are the body's, as `contact_impulses` returns them.
    `servos` maps the name of each position servo to the index of the joint rate that it drives, and
    its damping [N m s/rad] or [N s/m].
    """
    found: Impulses = {}
    for cause, impulse in steps.terms.items():
        if not impulse.any():
            continue
        if cause == "contacts":
            found |= contacts
        elif (servo := servos.get(cause)) is not None:
            found |= _servo(steps, cause, impulse, *servo)
        elif cause == "applied":
            found |= _applied(steps, impulse)
        elif cause == HELD and steps.pulls:
            found |= _pulls(steps, impulse)
        else:
            found[Term(cause)] = impulse
    return found


def contact_impulses(batch: StepBatch) -> dict[BodySteps, Impulses]:
    """Return the contact impulses on each body of a batch by partner: normal forces, friction.

    All bodies of the batch are divided together, their strongest partners first, then their second
    strongest, and so on.
    """
    whole, sides, bodies = batch.whole, batch.whole.sides, batch.bodies
    impulse, step = whole.terms.get("contacts"), whole.reported.contacts.step
    if impulse is None:
        return {}
    if not len(step) or len(step) != len(sides):
        return {steps: {Term("contacts"): impulse[steps.rows]} for steps in bodies}
    acting, normal = whole.point_impulses, whole.point_normal_impulses
    place = np.repeat(
        np.arange(len(bodies)), [each.points.stop - each.points.start for each in bodies]
    )
    links = np.stack([sides.link, sides.other_link], axis=1)
    own = sides.other_body == sides.body
    links[own] = np.sort(links[own], axis=1)  # both sides of a contact between own links are one
    partners = np.stack([place, links[:, 0], sides.other_body, links[:, 1]], axis=1)
    kinds, _, which = distinct_rows(partners)
    strength = np.bincount(which, np.abs(acting).sum(axis=1), minlength=len(kinds))
    most, rank = np.zeros(len(kinds)), np.empty(len(kinds), np.int64)
    np.maximum.at(most, which, largest(acting))
    firsts = np.searchsorted(kinds[:, 0], kinds[:, 0])
    rank[np.lexsort((-strength, kinds[:, 0]))] = np.arange(len(kinds)) - firsts
    found: list[Impulses] = [{} for _ in bodies]
    left = impulse.copy()
    for each in range(min(int(rank.max()) + 1, MOST_PARTNERS)):
        its, among = np.flatnonzero(rank[which] == each), np.flatnonzero(rank == each)
        for cause, values in ((CONTACT, normal), (FRICTION, acting - normal)):
            part = summed(step[its], values[its], count=len(whole))
            strongest = largest(part)
            for kind in among.tolist():
                body, link, other, other_link = kinds[kind].tolist()
                rows = bodies[body].rows
                if strongest[rows].max() > SINGLE * most[kind]:
                    term = Term(cause, link=link, other=other, other_link=other_link)
                    found[body][term] = part[rows]
            left -= part
    rest, size = largest(left), largest(impulse)
    for steps, impulses in zip(bodies, found, strict=True):
        if rest[steps.rows].max(initial=0.0) > SINGLE * size[steps.rows].max(initial=0.0):
            impulses[Term("contacts")] = left[steps.rows]
    return dict(zip(bodies, found, strict=True))


def servos_of(body: Body) -> dict[str, tuple[int, float]]:
    """Return joint rate and damping of each position servo, by actuator name."""
    return {
        f"actuator {each.name}": (rate, each.kv * each.gear**2)
        for each in body.actuators
        if each.kind == "position" and each.kv and (rate := body.rate_of(each)) is not None
    }


def _servo(
    steps: BodySteps, cause: str, impulse: Float64, joint_rate: int, damping: float
) -> Impulses:
    """Split a servo's impulse into kp × gap and kv × velocity."""
    rate = steps.law.tree.first_rate + joint_rate
    damped = np.zeros_like(impulse)
    damped[:, rate] = -damping * steps.before.velocity[:, rate] * steps.reported.timestep_s
    _, _, name = cause.partition(" ")
    parts = {Term(GAP, name): impulse - damped, Term(RATE, name): damped}
    return {term: part for term, part in parts.items() if part.any()}


def _applied(steps: BodySteps, impulse: Float64) -> Impulses:
    """Split the impulses that calls applied into joint torques and pushes."""
    commanded = np.zeros_like(impulse)
    first = steps.law.tree.first_rate
    commanded[:, first:] = steps.reported.commanded * steps.reported.timestep_s[:, None]
    pushed = impulse - commanded
    pushed[np.abs(pushed) <= ROUNDED * np.abs(commanded)] = 0.0
    parts = {Term(GIVEN): commanded, Term("applied"): pushed}
    return {term: part for term, part in parts.items() if part.any()}


def _pulls(steps: BodySteps, impulse: Float64) -> Impulses:
    """Split the impulses of constraints by partner, with gears separate."""
    found = {
        Term(HELD, pull.name, other=pull.other, other_link=pull.other_link): part
        for pull, part in steps.pulls.items()
        if part.any()
    }
    left = impulse - sum(found.values())
    if np.abs(left).max() > ROUNDED * np.abs(impulse).max():
        found[Term(HELD)] = left
    return found
